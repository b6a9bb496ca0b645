//! Life of an instance: made, initialised, set, stepped, read, ended, freed.

use crate::instance::{Instance, Log, LogMessage3, call, free, of, put, slice, slice_mut, text};
use crate::protocol::{Kind, Operation, Status, words};
use crate::wire::{accessors, get, set};
use core::ffi::{c_char, c_void};

/// `fmi3IntermediateUpdateCallback`, which is never called.
type IntermediateUpdate = Option<unsafe extern "C" fn()>;

#[unsafe(no_mangle)]
pub extern "C" fn fmi3GetVersion() -> *const c_char {
    c"3.0".as_ptr()
}

#[unsafe(no_mangle)]
#[allow(clippy::too_many_arguments, reason = "the standard's")]
pub extern "C" fn fmi3InstantiateCoSimulation(
    _instance_name: *const c_char,
    token: *const c_char,
    resource_path: *const c_char,
    _visible: bool,
    _logging_on: bool,
    _event_mode_used: bool,
    _early_return_allowed: bool,
    _required_intermediate: *const u32,
    _required_count: usize,
    environment: *mut c_void,
    log_message: LogMessage3,
    _intermediate_update: IntermediateUpdate,
) -> *mut c_void {
    let resources = text(resource_path).map(str::to_owned);
    let resources =
        resources.ok_or_else(|| "the resource path must be a text; got null or bytes that are not UTF-8".into());
    Instance::start(resources, token, Log::Three(environment, log_message))
}

/// Frees an instance; null is allowed.
#[unsafe(no_mangle)]
pub extern "C" fn fmi3FreeInstance(instance: *mut c_void) {
    free(instance);
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3SetDebugLogging(
    _instance: *mut c_void,
    _on: bool,
    _count: usize,
    _categories: *const *const c_char,
) -> Status {
    Status::Ok
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3EnterInitializationMode(
    instance: *mut c_void,
    _has_tolerance: bool,
    _tolerance: f64,
    start_s: f64,
    _has_stop: bool,
    _stop_s: f64,
) -> Status {
    call(instance, Operation::Enter, &[start_s])
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3ExitInitializationMode(instance: *mut c_void) -> Status {
    call(instance, Operation::Exit, &[])
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3Terminate(instance: *mut c_void) -> Status {
    call(instance, Operation::Terminate, &[])
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3Reset(instance: *mut c_void) -> Status {
    call(instance, Operation::Reset, &[])
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3DoStep(
    instance: *mut c_void,
    from_s: f64,
    step_s: f64,
    _no_state_before: bool,
    event_handling_needed: *mut bool,
    terminate_simulation: *mut bool,
    early_return: *mut bool,
    last_successful_s: *mut f64,
) -> Status {
    let Some(instance) = of(instance) else { return Status::Error };
    let (status, time) = instance.ask(Operation::Step, &[], words(&[from_s, step_s]));
    [event_handling_needed, terminate_simulation, early_return].into_iter().for_each(|place| put(place, false));
    put(last_successful_s, time.first_chunk().map_or(from_s, |word| f64::from_ne_bytes(*word)));
    status
}

accessors! {
    fmi3GetFloat64, fmi3SetFloat64, Real, f64, value_count;
    fmi3GetInt8, fmi3SetInt8, Whole, i8, value_count;
    fmi3GetUInt8, fmi3SetUInt8, Whole, u8, value_count;
    fmi3GetInt16, fmi3SetInt16, Whole, i16, value_count;
    fmi3GetUInt16, fmi3SetUInt16, Whole, u16, value_count;
    fmi3GetInt32, fmi3SetInt32, Whole, i32, value_count;
    fmi3GetUInt32, fmi3SetUInt32, Whole, u32, value_count;
    fmi3GetInt64, fmi3SetInt64, Whole, i64, value_count;
    fmi3GetUInt64, fmi3SetUInt64, Whole, u64, value_count;
    fmi3GetBoolean, fmi3SetBoolean, Boolean, bool, value_count;
    fmi3GetString, fmi3SetString, Text, *const c_char, value_count;
}
