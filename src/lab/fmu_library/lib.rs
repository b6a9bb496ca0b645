//! The C interface of FMI 3.0.2 and FMI 2.0.4 for co-simulation: the library in a unit, which importers load.
//!
//! It holds nothing but the interface. Each instance is the program `starloop` of the unit's resources, and every call goes
//! to it as a message (`protocol`): `fmi3DoStep -> worker -> socket -> starloop fmu --worker -> fmu::Slave`. Reasons:
//!
//! * One installation is enough. `cargo install` installs programs alone; this library has no dependencies, so the build of the
//!   crate `fmu` compiles it in a second and the program carries it. A library with the whole product in it was a second
//!   build as long as the first one.
//! * The program cannot be the library itself: glibc refuses to load an executable, and an executable's variables of a thread
//!   lie at places that only its own process has.
//! * Whatever happens to the program, the simulator goes on: its threads, memory and graphics driver are not the
//!   simulator's, and its end is a fatal status with a reason.
//!
//! A call costs some 15 microseconds more, a thousandth of a frame.
//!
//! An importer calls these functions with what the standards promise: pointers that it got from here or that point to as many
//! values as it says. Each function checks for null. What the description denies (states to be kept, derivatives, clocks,
//! model exchange) is refused by an error.

#![allow(unsafe_code, reason = "a C interface passes pointers; every block says what it relies on")]
#![allow(
    clippy::not_unsafe_ptr_arg_deref,
    reason = "a caller in C knows no unsafe functions; the standard says what it promises"
)]
#![allow(missing_docs, reason = "the functions are those of the standards' headers, and the standards describe them")]
#![cfg_attr(test, allow(clippy::unwrap_used, reason = "a test may stop at the first surprise"))]

pub mod fmi2;
pub mod fmi3 {
    //! FMI 3.0.2 (fmi3FunctionTypes.h).
    pub mod calls;
    pub mod denied;
}
pub mod instance;
pub mod protocol;
pub mod wire;
pub mod worker;
