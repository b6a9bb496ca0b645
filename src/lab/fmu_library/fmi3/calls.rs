//! Life of an instance: made, initialised, stepped, ended, freed.

use crate::instance::{Instance, Log, LogMessage3, call, deny, free, of, put, text};
use crate::protocol::{Operation, Status};
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
    let resources = text(resource_path).ok_or("the resource path must be a text; got null or bytes that are not UTF-8");
    let resources = resources.map(str::to_owned).map_err(str::to_owned);
    Instance::start("3", resources, token, Log::Three(environment, log_message))
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
pub extern "C" fn fmi3EnterStepMode(instance: *mut c_void) -> Status {
    deny(instance, "fmi3EnterStepMode", "event mode")
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
    let content = [from_s.to_ne_bytes(), step_s.to_ne_bytes()].concat();
    let (status, time) = instance.ask(Operation::Step, &content);
    [event_handling_needed, terminate_simulation, early_return].into_iter().for_each(|place| put(place, false));
    put(last_successful_s, time.first_chunk().map_or(from_s, |word| f64::from_ne_bytes(*word)));
    status
}
