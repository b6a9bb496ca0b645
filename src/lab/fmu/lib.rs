//! A run as an FMI 3.0 or 2.0 co-simulation unit (FMU): an outside simulator is the plant, in lockstep.
//!
//! ```text
//! run file -> archive (.fmu: description, library, program, packed run file)   written by `starloop fmu`
//! archive  -> importer -> fmu_library (C interface)                            in the simulator's process
//!          -> socket -> worker -> Slave -> SteppedRun                          in a process of the program, from the unit
//! ```
//!
//! * [`variables`] has every variable with its reference, type, unit and meaning, in one table;
//! * [`description`] writes `modelDescription.xml`;
//! * [`archive`] writes the .fmu file;
//! * [`worker`] serves one instance to the library, in messages of [`protocol`];
//! * [`slave`] is the life of one instance, and `values` are its variables.
//!
//! Standards: FMI 3.0.2, <https://fmi-standard.org/docs/3.0.2/>; FMI 2.0.4. Tests: below, and with FMPy in
//! `hil_scripts/tests/test_fmu.py`.

#![cfg_attr(
    test,
    allow(
        clippy::unwrap_used,
        clippy::panic,
        clippy::float_cmp,
        reason = "a test may stop at the first surprise and compares exact values where exactness is the claim"
    )
)]

pub mod archive;
pub mod description;
mod error;
#[path = "../fmu_library/protocol.rs"]
pub mod protocol;
pub mod slave;
mod values;
pub mod variables;
pub mod worker;

pub use error::FmuError;
pub use slave::Slave;
