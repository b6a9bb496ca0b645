//! The C interface of FMI 3.0.2 (fmi3FunctionTypes.h) for co-simulation, over [`fmu::Slave`].
//!
//! An importer calls these functions with what the standard promises: pointers that it got from here or that point to
//! as many values as it says. Each function checks for null, calls safe code, and turns errors into a status and a log
//! message. A panic does not cross the border: the instance is lost and the status is fatal.
//!
//! What the description denies (states to be kept, derivatives, clocks, model exchange) is refused by an error.

#![allow(unsafe_code, reason = "a C interface passes pointers; every block says what it relies on")]
#![allow(
    clippy::not_unsafe_ptr_arg_deref,
    reason = "a caller in C knows no unsafe functions; the standard says what it promises"
)]
#![allow(missing_docs, reason = "the functions are those of fmi3FunctionTypes.h, and the standard describes them")]

pub mod calls;
pub mod denied;
pub mod instance;
pub mod values;
