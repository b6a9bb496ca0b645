//! The C interface of FMI 2.0.4 (fmi2FunctionTypes.h) for co-simulation. Arrays of the unit are scalar variables here.

use crate::instance::{Instance, Log, LogMessage2, call, deny, free, of, slice, slice_mut, text};
use crate::protocol::{Kind, Operation, Status};
use crate::wire::{accessors, denied, get, set};
use core::ffi::{c_char, c_int, c_void};
use std::ffi::CString;

/// `fmi2CallbackFunctions`; memory and the end of a step are not called for.
#[repr(C)]
pub struct Callbacks {
    pub logger: LogMessage2,
    pub allocate_memory: Option<unsafe extern "C" fn(usize, usize) -> *mut c_void>,
    pub free_memory: Option<unsafe extern "C" fn(*mut c_void)>,
    pub step_finished: Option<unsafe extern "C" fn(*mut c_void, Status)>,
    pub environment: *mut c_void,
}

/// `fmi2CoSimulation` of `fmi2Type`.
const CO_SIMULATION: c_int = 1;

#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetTypesPlatform() -> *const c_char {
    c"default".as_ptr()
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi2GetVersion() -> *const c_char {
    c"2.0".as_ptr()
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi2Instantiate(
    instance_name: *const c_char,
    unit_type: c_int,
    guid: *const c_char,
    resource_location: *const c_char,
    callbacks: *const Callbacks,
    _visible: c_int,
    _logging_on: c_int,
) -> *mut c_void {
    // SAFETY: null, or the callbacks that the importer promises.
    let callbacks = unsafe { callbacks.as_ref() };
    let name = CString::new(text(instance_name).unwrap_or_default()).unwrap_or_default();
    let log = match callbacks {
        Some(callbacks) => Log::Two(callbacks.environment, name, callbacks.logger),
        None => Log::Two(core::ptr::null_mut(), name, None),
    };
    if unit_type != CO_SIMULATION {
        log.say(Status::Error, "this unit is for co-simulation only, as its description says");
        return core::ptr::null_mut();
    }
    Instance::start(folder_of(resource_location), guid, log)
}

/// Returns the folder that the address of the resources means: `file:///tmp/unit/resources`.
fn folder_of(location: *const c_char) -> Result<String, String> {
    let wanted = "wanted fmuResourceLocation as file:///folder/resources";
    let location = text(location).ok_or_else(|| format!("{wanted}, got null or bytes that are not UTF-8"))?;
    let refuse = || format!("{wanted}, got {location}");
    let rest = location.strip_prefix("file:").ok_or_else(refuse)?;
    let path = rest.strip_prefix("//localhost").or_else(|| rest.strip_prefix("//")).unwrap_or(rest);
    if !path.starts_with('/') {
        return Err(refuse());
    }
    unescaped(path).ok_or_else(refuse)
}

/// Returns the text without escapes such as `%20`; `None` where an escape or the text makes no sense.
fn unescaped(path: &str) -> Option<String> {
    let mut parts = path.split('%');
    let mut out = parts.next()?.as_bytes().to_vec();
    for part in parts {
        let (digits, rest) = part.split_at_checked(2)?;
        out.push(u8::from_str_radix(digits, 16).ok()?);
        out.extend(rest.as_bytes());
    }
    String::from_utf8(out).ok()
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi2FreeInstance(instance: *mut c_void) {
    free(instance);
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi2SetDebugLogging(
    _instance: *mut c_void,
    _on: c_int,
    _count: usize,
    _categories: *const *const c_char,
) -> Status {
    Status::Ok
}

/// Keeps the start for `fmi2EnterInitializationMode`; the standard allows several calls.
#[unsafe(no_mangle)]
pub extern "C" fn fmi2SetupExperiment(
    instance: *mut c_void,
    _has_tolerance: c_int,
    _tolerance: f64,
    start_s: f64,
    _has_stop: c_int,
    _stop_s: f64,
) -> Status {
    let Some(instance) = of(instance) else { return Status::Error };
    instance.start_s = start_s;
    Status::Ok
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi2EnterInitializationMode(instance: *mut c_void) -> Status {
    let start_s = of(instance).map_or(0.0, |instance| instance.start_s);
    call(instance, Operation::Enter, &[start_s])
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi2ExitInitializationMode(instance: *mut c_void) -> Status {
    call(instance, Operation::Exit, &[])
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi2DoStep(instance: *mut c_void, from_s: f64, step_s: f64, _no_state_before: c_int) -> Status {
    call(instance, Operation::Step, &[from_s, step_s])
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi2Terminate(instance: *mut c_void) -> Status {
    call(instance, Operation::Terminate, &[])
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi2Reset(instance: *mut c_void) -> Status {
    call(instance, Operation::Reset, &[])
}

accessors! {
    fmi2GetReal, fmi2SetReal, Real, f64;
    fmi2GetInteger, fmi2SetInteger, Whole, i32;
    fmi2GetBoolean, fmi2SetBoolean, Boolean, i32;
    fmi2GetString, fmi2SetString, Text, *const c_char;
}

type Any = *mut c_void;
type References = *const u32;

denied! { "state that can be kept":
    fmi2GetFMUstate(Any);
    fmi2SetFMUstate(Any);
    fmi2FreeFMUstate(Any);
    fmi2SerializedFMUstateSize(Any, *mut usize);
    fmi2SerializeFMUstate(Any, *mut c_char, usize);
    fmi2DeSerializeFMUstate(*const c_char, usize, Any);
}

denied! { "derivatives":
    fmi2GetDirectionalDerivative(References, usize, References, usize, *const f64, *mut f64);
    fmi2SetRealInputDerivatives(References, usize, *const c_int, *const f64);
    fmi2GetRealOutputDerivatives(References, usize, *const c_int, *mut f64);
}

denied! { "steps that go on by themselves":
    fmi2CancelStep();
    fmi2GetStatus(c_int, *mut Status);
    fmi2GetRealStatus(c_int, *mut f64);
    fmi2GetIntegerStatus(c_int, *mut c_int);
    fmi2GetBooleanStatus(c_int, *mut c_int);
    fmi2GetStringStatus(c_int, *mut *const c_char);
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::ffi::CStr;

    fn folder(location: &CStr) -> Result<String, String> {
        folder_of(location.as_ptr())
    }

    #[test]
    fn an_address_of_resources_is_a_folder() {
        for location in
            [c"file:///tmp/a%20b/resources", c"file:/tmp/a b/resources", c"file://localhost/tmp/a%20b/resources"]
        {
            assert_eq!(folder(location).as_deref(), Ok("/tmp/a b/resources"));
        }
        for location in [c"http://a/b", c"file://tmp", c"file:///tmp/%zz", c"file:///tmp/%2"] {
            let why = folder(location).unwrap_err();
            assert!(why.contains("got ") && why.contains("fmuResourceLocation"), "{why}");
        }
        assert!(folder_of(core::ptr::null()).unwrap_err().contains("null"));
    }
}
