//! Life of an instance: made, initialised, stepped, ended, freed.

use crate::instance::{Instance, LogMessage, Status, call, log, of, put, text};
use core::ffi::{c_char, c_void};
use fmu::{FmuError, Slave};
use std::{panic::catch_unwind, path::Path};

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
    log_message: LogMessage,
    _intermediate_update: IntermediateUpdate,
) -> *mut c_void {
    let fail = |why: &str| {
        log(log_message, environment, Status::Error, why);
        core::ptr::null_mut()
    };
    let (Some(token), Some(resources)) = (text(token), text(resource_path)) else {
        return fail("instantiation token and resource path must be texts; got null or bytes that are not UTF-8");
    };
    match catch_unwind(|| Slave::new(Path::new(resources), token)) {
        Ok(Ok(slave)) => Box::into_raw(Box::new(Instance::new(slave, environment, log_message))).cast(),
        Ok(Err(error)) => fail(&error.to_string()),
        Err(_panic) => fail("a fault of the program: please report it with the run file"),
    }
}

/// Frees an instance; null is allowed.
///
/// # Safety
/// The pointer is null, or one that `fmi3InstantiateCoSimulation` returned and that is not freed yet.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn fmi3FreeInstance(instance: *mut c_void) {
    if !instance.is_null() {
        // SAFETY: by the standard a pointer that `fmi3InstantiateCoSimulation` returned, freed once.
        let instance = unsafe { Box::from_raw(instance.cast::<Instance>()) };
        let _ = catch_unwind(std::panic::AssertUnwindSafe(|| drop(instance))); // a panic ends here
    }
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
    call(instance, |slave| slave.enter(start_s))
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3ExitInitializationMode(instance: *mut c_void) -> Status {
    call(instance, Slave::exit)
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3EnterStepMode(instance: *mut c_void) -> Status {
    of(instance).map_or(Status::Error, |instance| instance.fail("fmi3EnterStepMode: this unit has no event mode"))
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3Terminate(instance: *mut c_void) -> Status {
    let Some(instance) = of(instance) else { return Status::Error };
    let mut lost = None;
    let status = instance.call(|slave| {
        lost = slave.terminate()?;
        Ok::<_, FmuError>(())
    });
    match lost {
        Some(lost) => {
            instance.say(Status::Warning, &lost);
            Status::Warning
        }
        None => status,
    }
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3Reset(instance: *mut c_void) -> Status {
    call(instance, |slave| {
        slave.reset();
        Ok::<_, FmuError>(())
    })
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
    let mut until_s = from_s;
    let status = instance.call(|slave| {
        let stepped = slave.step(from_s, step_s);
        until_s = slave.time_s();
        stepped
    });
    [event_handling_needed, terminate_simulation, early_return].into_iter().for_each(|place| put(place, false));
    put(last_successful_s, until_s);
    status
}
