//! Values of variables between the importer's arrays and the program's words.

use crate::instance::{of, text};
use crate::protocol::{Kind, Operation, Status, selection};
use core::ffi::{CStr, c_char, c_void};

/// A number of the C interface that travels as a word of eight bytes.
pub trait Word: Copy {
    /// Returns the number in a word; `None` when it does not fit.
    fn of(word: [u8; 8]) -> Option<Self>;
    /// Returns its word; `None` when it does not fit.
    fn word(self) -> Option<[u8; 8]>;
}

impl Word for f64 {
    fn of(word: [u8; 8]) -> Option<Self> {
        Some(Self::from_ne_bytes(word))
    }

    fn word(self) -> Option<[u8; 8]> {
        Some(self.to_ne_bytes())
    }
}

impl Word for bool {
    fn of(word: [u8; 8]) -> Option<Self> {
        Some(i64::from_ne_bytes(word) != 0)
    }

    fn word(self) -> Option<[u8; 8]> {
        Some(i64::from(self).to_ne_bytes())
    }
}

macro_rules! whole_words {
    ($($number:ty),*) => {$(
        impl Word for $number {
            fn of(word: [u8; 8]) -> Option<Self> {
                Self::try_from(i64::from_ne_bytes(word)).ok()
            }

            fn word(self) -> Option<[u8; 8]> {
                i64::try_from(self).ok().map(i64::to_ne_bytes)
            }
        }
    )*};
}

whole_words!(i8, u8, i16, u16, i32, u32, i64, u64);

const DOES_NOT_FIT: &str = "a value does not fit the type of this function; take one of a wider type";

/// Fills `values` from variables, arrays one after the other.
pub fn get<T: Word>(instance: *mut c_void, kind: Kind, references: &[u32], values: &mut [T]) -> Status {
    let Some(instance) = of(instance) else { return Status::Error };
    let (status, content) = instance.ask(Operation::Get, &selection(kind, references));
    if status != Status::Ok {
        return status;
    }
    let words = content.as_chunks::<8>().0;
    if words.len() != values.len() {
        return instance.fail(&format!(
            "got places for {} values, and the variables have {}",
            values.len(),
            words.len()
        ));
    }
    for (place, word) in values.iter_mut().zip(words) {
        let Some(value) = T::of(*word) else { return instance.fail(DOES_NOT_FIT) };
        *place = value;
    }
    Status::Ok
}

/// Sets variables, arrays one after the other.
pub fn set<T: Word>(instance: *mut c_void, kind: Kind, references: &[u32], values: &[T]) -> Status {
    let Some(instance) = of(instance) else { return Status::Error };
    let mut content = selection(kind, references);
    for value in values {
        let Some(word) = value.word() else { return instance.fail(DOES_NOT_FIT) };
        content.extend(word);
    }
    instance.ask(Operation::Set, &content).0
}

/// Gets texts; they are kept until the next call.
pub fn get_texts(instance: *mut c_void, references: &[u32], values: &mut [*const c_char]) -> Status {
    let Some(instance) = of(instance) else { return Status::Error };
    let (status, content) = instance.ask(Operation::Get, &selection(Kind::Text, references));
    if status != Status::Ok {
        return status;
    }
    instance.texts = content;
    let mut rest = instance.texts.as_slice();
    for place in values {
        let Ok(text) = CStr::from_bytes_until_nul(rest) else {
            return instance.fail("got places for more texts than there are variables");
        };
        *place = text.as_ptr();
        rest = rest.get(text.count_bytes() + 1..).unwrap_or_default();
    }
    Status::Ok
}

/// Sets texts.
pub fn set_texts(instance: *mut c_void, references: &[u32], values: &[*const c_char]) -> Status {
    let Some(instance) = of(instance) else { return Status::Error };
    let mut content = selection(Kind::Text, references);
    for value in values {
        let Some(text) = text(*value) else {
            return instance.fail("a text must end with a zero and be UTF-8; got null or other bytes");
        };
        content.extend_from_slice(text.as_bytes());
        content.push(0);
    }
    instance.ask(Operation::Set, &content).0
}
