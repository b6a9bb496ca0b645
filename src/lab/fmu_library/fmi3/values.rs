//! Getting and setting variables.

use crate::instance::{slice, slice_mut};
use crate::protocol::{Kind, Status};
use crate::wire::{get, get_texts, set, set_texts};
use core::ffi::{c_char, c_void};

macro_rules! numbers {
    ($($get:ident, $set:ident, $kind:ident, $number:ty;)*) => {$(
        #[unsafe(no_mangle)]
        pub extern "C" fn $get(
            instance: *mut c_void,
            references: *const u32,
            count: usize,
            values: *mut $number,
            value_count: usize,
        ) -> Status {
            get(instance, Kind::$kind, slice(references, count), slice_mut(values, value_count))
        }

        #[unsafe(no_mangle)]
        pub extern "C" fn $set(
            instance: *mut c_void,
            references: *const u32,
            count: usize,
            values: *const $number,
            value_count: usize,
        ) -> Status {
            set(instance, Kind::$kind, slice(references, count), slice(values, value_count))
        }
    )*};
}

numbers! {
    fmi3GetFloat64, fmi3SetFloat64, Real, f64;
    fmi3GetInt8, fmi3SetInt8, Whole, i8;
    fmi3GetUInt8, fmi3SetUInt8, Whole, u8;
    fmi3GetInt16, fmi3SetInt16, Whole, i16;
    fmi3GetUInt16, fmi3SetUInt16, Whole, u16;
    fmi3GetInt32, fmi3SetInt32, Whole, i32;
    fmi3GetUInt32, fmi3SetUInt32, Whole, u32;
    fmi3GetInt64, fmi3SetInt64, Whole, i64;
    fmi3GetUInt64, fmi3SetUInt64, Whole, u64;
    fmi3GetBoolean, fmi3SetBoolean, Boolean, bool;
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetString(
    instance: *mut c_void,
    references: *const u32,
    count: usize,
    values: *mut *const c_char,
    value_count: usize,
) -> Status {
    get_texts(instance, slice(references, count), slice_mut(values, value_count))
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3SetString(
    instance: *mut c_void,
    references: *const u32,
    count: usize,
    values: *const *const c_char,
    value_count: usize,
) -> Status {
    set_texts(instance, slice(references, count), slice(values, value_count))
}
