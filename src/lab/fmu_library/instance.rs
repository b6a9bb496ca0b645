//! An instance behind the pointer that the importer holds, and what its pointers lead to.

use crate::protocol::{Operation, Request, Status, words};
use crate::worker::Worker;
use core::ffi::{CStr, c_char, c_void};
use std::ffi::CString;

/// `fmi3LogMessageCallback`.
pub type LogMessage3 = Option<unsafe extern "C" fn(*mut c_void, Status, *const c_char, *const c_char)>;

/// `fmi2CallbackLogger`: the message is a format of printf.
pub type LogMessage2 =
    Option<unsafe extern "C" fn(*mut c_void, *const c_char, Status, *const c_char, *const c_char, ...)>;

/// Where messages go.
pub enum Log {
    /// To an importer of FMI 3, with its environment.
    Three(*mut c_void, LogMessage3),
    /// To an importer of FMI 2, with its environment and its name for the instance.
    Two(*mut c_void, CString, LogMessage2),
}

impl Log {
    /// Calls the importer's log, where it gave one.
    pub fn say(&self, status: Status, message: &str) {
        let percent = if matches!(self, Self::Two(..)) { "%%" } else { "%" };
        let Ok(message) = CString::new(message.replace('\0', " ").replace('%', percent)) else { return };
        let category = if status == Status::Ok { c"logEvents" } else { c"logStatusError" };
        match self {
            Self::Three(environment, Some(callback)) => {
                // SAFETY: the importer promises a function of this type; the texts live until it returns.
                unsafe { callback(*environment, status, category.as_ptr(), message.as_ptr()) };
            }
            Self::Two(environment, name, Some(callback)) => {
                // SAFETY: likewise; a format without directives takes no further arguments.
                unsafe { callback(*environment, name.as_ptr(), status, category.as_ptr(), message.as_ptr()) };
            }
            Self::Three(_, None) | Self::Two(_, _, None) => {}
        }
    }
}

/// An instance, to which the importer has a pointer.
pub struct Instance {
    worker: Worker,
    log: Log,
    /// When the importer's time begins, s: FMI 2 gives it before it is asked for.
    pub start_s: f64,
    /// The values got last: texts that were handed out lie in it.
    pub got: Vec<u8>,
}

impl Instance {
    /// Starts an instance; returns the importer's pointer to it, null with a message where it cannot start.
    pub fn start(resources: Result<String, String>, token: *const c_char, log: Log) -> *mut c_void {
        let started = resources.and_then(|resources| {
            let token =
                text(token).ok_or("the instantiation token must be a text; got null or bytes that are not UTF-8")?;
            Worker::start(&resources, token)
        });
        match started {
            Ok(worker) => Box::into_raw(Box::new(Self { worker, log, start_s: 0.0, got: Vec::new() })).cast(),
            Err(why) => {
                log.say(Status::Error, &why);
                core::ptr::null_mut()
            }
        }
    }

    /// Asks the program; logs what it says. Without success the content is empty.
    pub fn ask(&mut self, code: Operation, references: &[u32], content: Vec<u8>) -> (Status, Vec<u8>) {
        let head = references.iter().flat_map(|reference| reference.to_ne_bytes()).collect();
        let reply = self.worker.ask(&Request { code, head, content });
        if !reply.head.is_empty() {
            self.log.say(reply.code, &String::from_utf8_lossy(&reply.head));
        }
        (reply.code, reply.content)
    }

    /// Logs an error.
    pub fn fail(&self, why: &str) -> Status {
        self.log.say(Status::Error, why);
        Status::Error
    }
}

/// Returns the instance behind a pointer; `None` for null.
pub fn of<'a>(instance: *mut c_void) -> Option<&'a mut Instance> {
    // SAFETY: not null, so by the standard one that was returned to the importer and that is not freed; it calls one
    // function of an instance at a time.
    unsafe { instance.cast::<Instance>().as_mut() }
}

/// Frees an instance; null is allowed.
pub fn free(instance: *mut c_void) {
    if !instance.is_null() {
        // SAFETY: by the standard a pointer that was returned to the importer, freed once.
        drop(unsafe { Box::from_raw(instance.cast::<Instance>()) });
    }
}

/// Asks the program of the instance behind a pointer, with times in s.
pub fn call(instance: *mut c_void, operation: Operation, times_s: &[f64]) -> Status {
    of(instance).map_or(Status::Error, |instance| instance.ask(operation, &[], words(times_s)).0)
}

/// Refuses a call that the description excludes.
pub fn deny(instance: *mut c_void, function: &str, why: &str) -> Status {
    of(instance).map_or(Status::Error, |instance| {
        instance.fail(&format!("{function}: this unit has no {why}, as its description says"))
    })
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
