//! An instance behind the pointer that the importer holds.

use core::ffi::{CStr, c_char, c_void};
use fmu::Slave;
use std::ffi::CString;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// `fmi3Status`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub enum Status {
    Ok,
    Warning,
    Discard,
    Error,
    Fatal,
}

/// `fmi3LogMessageCallback`.
pub type LogMessage = Option<unsafe extern "C" fn(*mut c_void, Status, *const c_char, *const c_char)>;

/// An instance, to which the importer has a pointer.
pub struct Instance {
    /// The unit; `None` when a panic has ended it.
    slave: Option<Slave>,
    environment: *mut c_void,
    log: LogMessage,
    /// The latest text that was handed out, kept until the next one.
    pub text: CString,
}

impl Instance {
    pub fn new(slave: Slave, environment: *mut c_void, log: LogMessage) -> Self {
        Self { slave: Some(slave), environment, log, text: CString::default() }
    }

    /// Calls safe code; an error becomes a log message and a status, a panic the end of the instance.
    pub fn call<E: core::fmt::Display>(&mut self, work: impl FnOnce(&mut Slave) -> Result<(), E>) -> Status {
        let Some(mut slave) = self.slave.take() else {
            self.say(Status::Fatal, "the instance was lost in an earlier call: free it");
            return Status::Fatal;
        };
        match catch_unwind(AssertUnwindSafe(|| (work(&mut slave), slave))) {
            Ok((outcome, slave)) => {
                self.slave = Some(slave);
                outcome.map_or_else(|error| self.fail(&error.to_string()), |()| Status::Ok)
            }
            Err(_panic) => {
                self.say(Status::Fatal, "a fault of the program: please report it with the run file");
                Status::Fatal
            }
        }
    }

    /// Logs an error.
    pub fn fail(&self, why: &str) -> Status {
        self.say(Status::Error, why);
        Status::Error
    }

    /// Logs a message.
    pub fn say(&self, status: Status, message: &str) {
        log(self.log, self.environment, status, message);
    }
}

/// Calls the importer's log, where it gave one.
pub fn log(callback: LogMessage, environment: *mut c_void, status: Status, message: &str) {
    let (Some(callback), Ok(message)) = (callback, CString::new(message.replace('\0', " "))) else { return };
    let category = if status == Status::Ok { c"logEvents" } else { c"logStatusError" };
    // SAFETY: the importer promises a function of this type; both texts live until it returns.
    unsafe { callback(environment, status, category.as_ptr(), message.as_ptr()) };
}

/// Returns the instance behind a pointer; `None` for null.
pub fn of<'a>(instance: *mut c_void) -> Option<&'a mut Instance> {
    // SAFETY: not null, so by the standard one that `fmi3InstantiateCoSimulation` returned and that is not freed; the
    // importer calls one function of an instance at a time.
    unsafe { instance.cast::<Instance>().as_mut() }
}

/// Calls safe code on the instance behind a pointer.
pub fn call<E: core::fmt::Display>(instance: *mut c_void, work: impl FnOnce(&mut Slave) -> Result<(), E>) -> Status {
    of(instance).map_or(Status::Error, |instance| instance.call(work))
}

/// Returns `count` values behind a pointer; none for null.
pub fn slice<'a, T>(values: *const T, count: usize) -> &'a [T] {
    if values.is_null() || count == 0 {
        return &[];
    }
    // SAFETY: the importer promises so many initialised values, which nothing changes during the call.
    unsafe { core::slice::from_raw_parts(values, count) }
}

/// Returns `count` places behind a pointer; none for null.
pub fn slice_mut<'a, T>(values: *mut T, count: usize) -> &'a mut [T] {
    if values.is_null() || count == 0 {
        return &mut [];
    }
    // SAFETY: the importer promises so many values, which nothing else touches during the call.
    unsafe { core::slice::from_raw_parts_mut(values, count) }
}

/// Returns a text; `None` for null or what is not UTF-8.
pub fn text<'a>(text: *const c_char) -> Option<&'a str> {
    if text.is_null() {
        return None;
    }
    // SAFETY: the importer promises a text that ends with a zero.
    unsafe { CStr::from_ptr(text) }.to_str().ok()
}

/// Writes a value where a pointer leads; nothing for null.
pub fn put<T>(place: *mut T, value: T) {
    if !place.is_null() {
        // SAFETY: the importer promises a place for one value.
        unsafe { place.write(value) };
    }
}
