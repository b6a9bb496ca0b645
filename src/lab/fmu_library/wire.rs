//! Values of variables between the importer's arrays and the program's words.

use crate::instance::{of, text};
use crate::protocol::{Kind, Operation, Status, next_text, next_word};
use core::ffi::{CStr, c_char, c_void};

/// A value of the C interface on its way to the program or from it.
pub trait Wire: Copy {
    /// Takes the value at the front of the content; `None` where there is none, or it does not fit.
    fn take(rest: &mut &[u8]) -> Option<Self>;
    /// Returns its bytes; `None` when it does not fit.
    fn bytes(self) -> Option<Vec<u8>>;
}

impl Wire for f64 {
    fn take(rest: &mut &[u8]) -> Option<Self> {
        next_word(rest).map(Self::from_ne_bytes)
    }

    fn bytes(self) -> Option<Vec<u8>> {
        Some(self.to_ne_bytes().into())
    }
}

impl Wire for bool {
    fn take(rest: &mut &[u8]) -> Option<Self> {
        i64::take(rest).map(|number| number != 0)
    }

    fn bytes(self) -> Option<Vec<u8>> {
        i64::from(self).bytes()
    }
}

macro_rules! whole_numbers {
    ($($number:ty),*) => {$(
        impl Wire for $number {
            fn take(rest: &mut &[u8]) -> Option<Self> {
                next_word(rest).and_then(|word| i64::from_ne_bytes(word).try_into().ok())
            }

            fn bytes(self) -> Option<Vec<u8>> {
                i64::try_from(self).ok().map(|number| number.to_ne_bytes().into())
            }
        }
    )*};
}

whole_numbers!(i8, u8, i16, u16, i32, u32, i64, u64);

impl Wire for *const c_char {
    fn take(rest: &mut &[u8]) -> Option<Self> {
        next_text(rest).map(CStr::as_ptr)
    }

    fn bytes(self) -> Option<Vec<u8>> {
        text(self).map(|text| [text.as_bytes(), &[0]].concat())
    }
}

/// Fills `values` from variables, arrays one after the other. Texts last until the next call, as the standards say.
pub fn get<T: Wire>(instance: *mut c_void, kind: Kind, references: &[u32], values: &mut [T]) -> Status {
    let Some(instance) = of(instance) else { return Status::Error };
    let (status, content) = instance.ask(Operation::Get(kind), references, Vec::new());
    if status != Status::Ok {
        return status;
    }
    instance.got = content;
    let mut rest = instance.got.as_slice();
    let are_all = values.iter_mut().all(|place| T::take(&mut rest).map(|value| *place = value).is_some());
    if are_all && rest.is_empty() {
        return Status::Ok;
    }
    instance.fail("wanted places for as many values as the variables have, of a type that holds them")
}

/// Sets variables, arrays one after the other.
pub fn set<T: Wire>(instance: *mut c_void, kind: Kind, references: &[u32], values: &[T]) -> Status {
    let Some(instance) = of(instance) else { return Status::Error };
    match values.iter().map(|value| value.bytes()).collect::<Option<Vec<_>>>() {
        Some(content) => instance.ask(Operation::Set(kind), references, content.concat()).0,
        None => instance.fail("wanted whole numbers below 2^63, texts in UTF-8; got another, or null"),
    }
}

/// Functions that get and set variables of a type. Those of FMI 3 say beside the count of references how many values
/// there are: `$total`.
macro_rules! accessors {
    ($($get:ident, $set:ident, $kind:ident, $value:ty $(, $total:ident)?;)*) => {$(
        #[unsafe(no_mangle)]
        pub extern "C" fn $get(
            instance: *mut c_void,
            references: *const u32,
            count: usize,
            values: *mut $value,
            $($total: usize,)?
        ) -> Status {
            let references = slice(references, count);
            $(let count = $total;)?
            get(instance, Kind::$kind, references, slice_mut(values, count))
        }

        #[unsafe(no_mangle)]
        pub extern "C" fn $set(
            instance: *mut c_void,
            references: *const u32,
            count: usize,
            values: *const $value,
            $($total: usize,)?
        ) -> Status {
            let references = slice(references, count);
            $(let count = $total;)?
            set(instance, Kind::$kind, references, slice(values, count))
        }
    )*};
}
pub(crate) use accessors;

/// Functions that the description excludes. Their first argument is the instance; the others are not looked at.
macro_rules! denied {
    ($why:literal: $($name:ident($($argument:ty),*);)*) => {$(
        #[unsafe(no_mangle)]
        pub extern "C" fn $name(instance: *mut c_void, $(_: $argument),*) -> Status {
            deny(instance, stringify!($name), $why)
        }
    )*};
}
pub(crate) use denied;
