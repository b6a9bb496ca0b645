//! A panic of the Parquet reader as an error: it asserts things of files that damaged files do not keep.

use core::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    static IS_READING: Cell<bool> = const { Cell::new(false) };
}

/// Returns the result of `read`, or its message when it panics. Panics elsewhere are reported as usual.
pub(super) fn caught<T>(read: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    static QUIET_WHILE_READING: Once = Once::new();
    QUIET_WHILE_READING.call_once(|| {
        let announce = take_hook();
        set_hook(Box::new(move |panic| {
            if !IS_READING.get() {
                announce(panic);
            }
        }));
    });
    IS_READING.set(true);
    let done = catch_unwind(AssertUnwindSafe(read));
    IS_READING.set(false);
    done.unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<&str>().copied().or(panic.downcast_ref::<String>().map(String::as_str));
        Err(format!("the reader gave up: {}", text.unwrap_or("it does not say why")))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panics_are_errors_and_the_next_reading_is_as_before() {
        assert_eq!(caught::<()>(|| panic!("no {}", "dictionary")), Err("the reader gave up: no dictionary".into()));
        assert_eq!(caught::<()>(|| panic!("plain")), Err("the reader gave up: plain".into()));
        assert_eq!(caught(|| Ok(5)), Ok(5));
        assert_eq!(caught::<()>(|| Err("no".into())), Err("no".into()));
    }
}
