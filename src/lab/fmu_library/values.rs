//! Getting and setting variables.

use crate::instance::{Instance, Status, call, of, slice, slice_mut, text};
use core::ffi::{c_char, c_void};
use fmu::Slave;
use std::ffi::CString;

fn no_such(reference: u32, kind: &str) -> String {
    format!("value reference {reference} is no {kind} variable that can be got or set now")
}

fn too_few(given: usize) -> String {
    format!("got {given} values, which is not what the variables have together")
}

/// Fills `values` from variables that have `part` of them each.
fn get<T: Copy>(
    instance: *mut c_void,
    references: &[u32],
    values: &mut [T],
    kind: &str,
    read: impl Fn(&Slave, u32) -> Option<Vec<T>>,
) -> Status {
    call(instance, |slave| {
        let mut place = 0;
        for reference in references {
            let part = read(slave, *reference).ok_or_else(|| no_such(*reference, kind))?;
            let Some(into) = values.get_mut(place..place + part.len()) else { return Err(too_few(values.len())) };
            into.copy_from_slice(&part);
            place += part.len();
        }
        if place == values.len() { Ok(()) } else { Err(too_few(values.len())) }
    })
}

/// Sets single values.
fn set<T: Copy>(
    instance: *mut c_void,
    references: &[u32],
    values: &[T],
    kind: &str,
    write: impl Fn(&mut Slave, u32, T) -> bool,
) -> Status {
    call(instance, |slave| {
        if references.len() != values.len() {
            return Err(too_few(values.len()));
        }
        for (reference, value) in references.iter().zip(values) {
            if !write(slave, *reference, *value) {
                return Err(no_such(*reference, kind));
            }
        }
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetFloat64(
    instance: *mut c_void,
    references: *const u32,
    count: usize,
    values: *mut f64,
    value_count: usize,
) -> Status {
    let read = |slave: &Slave, reference| slave.float64(reference).map(<[f64]>::to_vec);
    get(instance, slice(references, count), slice_mut(values, value_count), "Float64", read)
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3SetFloat64(
    instance: *mut c_void,
    references: *const u32,
    count: usize,
    values: *const f64,
    value_count: usize,
) -> Status {
    let (references, values) = (slice(references, count), slice(values, value_count));
    call(instance, |slave| {
        let mut rest = values;
        for reference in references {
            let into = slave.float64_input(*reference).ok_or_else(|| no_such(*reference, "Float64"))?;
            let Some((part, others)) = rest.split_at_checked(into.len()) else { return Err(too_few(values.len())) };
            if part.iter().any(|value| !value.is_finite()) {
                return Err(format!("value reference {reference}: wanted finite numbers, got {part:?}"));
            }
            into.copy_from_slice(part);
            rest = others;
        }
        if rest.is_empty() { Ok(()) } else { Err(too_few(values.len())) }
    })
}

/// Reads variables of a whole-number type; refuses every reference when the unit has no variable of that type.
macro_rules! whole {
    ($($get:ident, $set:ident, $kind:literal, $number:ty;)*) => {$(
        #[unsafe(no_mangle)]
        pub extern "C" fn $get(
            instance: *mut c_void,
            references: *const u32,
            count: usize,
            values: *mut $number,
            value_count: usize,
        ) -> Status {
            let read = |slave: &Slave, reference| {
                slave.whole(reference).and_then(|value| <$number>::try_from(value).ok()).map(|value| vec![value])
            };
            get(instance, slice(references, count), slice_mut(values, value_count), $kind, read)
        }

        #[unsafe(no_mangle)]
        pub extern "C" fn $set(
            instance: *mut c_void,
            references: *const u32,
            count: usize,
            values: *const $number,
            value_count: usize,
        ) -> Status {
            let write = |slave: &mut Slave, reference, value: $number| {
                u32::try_from(value).is_ok_and(|value| slave.set_whole(reference, value))
            };
            set(instance, slice(references, count), slice(values, value_count), $kind, write)
        }
    )*};
}

whole! {
    fmi3GetInt8, fmi3SetInt8, "Int8", i8;
    fmi3GetUInt8, fmi3SetUInt8, "UInt8", u8;
    fmi3GetInt16, fmi3SetInt16, "Int16", i16;
    fmi3GetUInt16, fmi3SetUInt16, "UInt16", u16;
    fmi3GetInt32, fmi3SetInt32, "Int32", i32;
    fmi3GetUInt32, fmi3SetUInt32, "UInt32", u32;
    fmi3GetInt64, fmi3SetInt64, "Int64", i64;
    fmi3GetUInt64, fmi3SetUInt64, "UInt64", u64;
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetBoolean(
    instance: *mut c_void,
    references: *const u32,
    count: usize,
    values: *mut bool,
    value_count: usize,
) -> Status {
    let read = |slave: &Slave, reference| slave.boolean(reference).map(|value| vec![value]);
    get(instance, slice(references, count), slice_mut(values, value_count), "Boolean", read)
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3SetBoolean(
    instance: *mut c_void,
    references: *const u32,
    count: usize,
    values: *const bool,
    value_count: usize,
) -> Status {
    set(instance, slice(references, count), slice(values, value_count), "Boolean", Slave::set_boolean)
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetString(
    instance: *mut c_void,
    references: *const u32,
    count: usize,
    values: *mut *const c_char,
    value_count: usize,
) -> Status {
    let Some(instance) = of(instance) else { return Status::Error };
    let (references, values) = (slice(references, count), slice_mut(values, value_count));
    // One text variable there is: it is kept until the next call.
    let mut found = CString::default();
    let status = instance.call(|slave| {
        for reference in references {
            let text = slave.text(*reference).ok_or_else(|| no_such(*reference, "String"))?;
            found = CString::new(text).unwrap_or_default();
        }
        if references.len() == values.len() { Ok(()) } else { Err(too_few(values.len())) }
    });
    if status == Status::Ok {
        let Instance { text, .. } = instance;
        *text = found;
        values.fill(text.as_ptr());
    }
    status
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3SetString(
    instance: *mut c_void,
    references: *const u32,
    count: usize,
    values: *const *const c_char,
    value_count: usize,
) -> Status {
    let write = |slave: &mut Slave, reference, value: *const c_char| {
        text(value).is_some_and(|value| slave.set_text(reference, value))
    };
    set(instance, slice(references, count), slice(values, value_count), "String", write)
}
