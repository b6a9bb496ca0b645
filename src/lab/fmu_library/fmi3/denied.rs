//! Functions of FMI 3.0 that the description excludes: each call is refused with an error.

use crate::instance::{Log, LogMessage3, deny};
use crate::{protocol::Status, wire::denied};
use core::ffi::{c_char, c_void};

type References = *const u32;
type Any = *mut c_void;

denied! { "event or configuration mode":
    fmi3EnterStepMode();
    fmi3EnterEventMode();
    fmi3EnterConfigurationMode();
    fmi3ExitConfigurationMode();
    fmi3EvaluateDiscreteStates();
    fmi3UpdateDiscreteStates(Any, Any, Any, Any, Any, Any);
}

denied! { "state that can be kept":
    fmi3GetFMUState(Any);
    fmi3SetFMUState(Any);
    fmi3FreeFMUState(Any);
    fmi3SerializedFMUStateSize(Any, *mut usize);
    fmi3SerializeFMUState(Any, *mut u8, usize);
    fmi3DeserializeFMUState(*const u8, usize, Any);
}

denied! { "derivatives or dependencies":
    fmi3GetNumberOfVariableDependencies(u32, *mut usize);
    fmi3GetVariableDependencies(u32, *mut usize, *mut u32, *mut usize, Any, usize);
    fmi3GetDirectionalDerivative(References, usize, References, usize, *const f64, usize, *mut f64, usize);
    fmi3GetAdjointDerivative(References, usize, References, usize, *const f64, usize, *mut f64, usize);
    fmi3GetOutputDerivatives(References, usize, *const i32, *mut f64, usize);
}

denied! { "variables of that type":
    fmi3GetFloat32(References, usize, *mut f32, usize);
    fmi3SetFloat32(References, usize, *const f32, usize);
    fmi3GetBinary(References, usize, *mut usize, Any, usize);
    fmi3SetBinary(References, usize, *const usize, Any, usize);
}

denied! { "model exchange or scheduled execution":
    fmi3EnterContinuousTimeMode();
    fmi3CompletedIntegratorStep(bool, *mut bool, *mut bool);
    fmi3SetTime(f64);
    fmi3SetContinuousStates(*const f64, usize);
    fmi3GetContinuousStateDerivatives(*mut f64, usize);
    fmi3GetEventIndicators(*mut f64, usize);
    fmi3GetContinuousStates(*mut f64, usize);
    fmi3GetNominalsOfContinuousStates(*mut f64, usize);
    fmi3GetNumberOfEventIndicators(*mut usize);
    fmi3GetNumberOfContinuousStates(*mut usize);
    fmi3ActivateModelPartition(u32, f64);
}

denied! { "clocks":
    fmi3GetClock(References, usize, *mut bool);
    fmi3SetClock(References, usize, *const bool);
    fmi3GetIntervalDecimal(References, usize, *mut f64, Any);
    fmi3GetIntervalFraction(References, usize, *mut u64, *mut u64, Any);
    fmi3GetShiftDecimal(References, usize, *mut f64);
    fmi3GetShiftFraction(References, usize, *mut u64, *mut u64);
    fmi3SetIntervalDecimal(References, usize, *const f64);
    fmi3SetIntervalFraction(References, usize, *const u64, *const u64);
    fmi3SetShiftDecimal(References, usize, *const f64);
    fmi3SetShiftFraction(References, usize, *const u64, *const u64);
}

const COSIMULATION_ONLY: &str = "this unit is for co-simulation only, as its description says";

#[unsafe(no_mangle)]
pub extern "C" fn fmi3InstantiateModelExchange(
    _instance_name: *const c_char,
    _token: *const c_char,
    _resource_path: *const c_char,
    _visible: bool,
    _logging_on: bool,
    environment: *mut c_void,
    log_message: LogMessage3,
) -> *mut c_void {
    Log::Three(environment, log_message).say(Status::Error, COSIMULATION_ONLY);
    core::ptr::null_mut()
}

#[unsafe(no_mangle)]
pub extern "C" fn fmi3InstantiateScheduledExecution(
    _instance_name: *const c_char,
    _token: *const c_char,
    _resource_path: *const c_char,
    _visible: bool,
    _logging_on: bool,
    environment: *mut c_void,
    log_message: LogMessage3,
    _clock_update: Option<unsafe extern "C" fn()>,
    _lock_preemption: Option<unsafe extern "C" fn()>,
    _unlock_preemption: Option<unsafe extern "C" fn()>,
) -> *mut c_void {
    Log::Three(environment, log_message).say(Status::Error, COSIMULATION_ONLY);
    core::ptr::null_mut()
}
