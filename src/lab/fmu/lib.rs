//! A run as an FMI 3.0 co-simulation unit (FMU): an outside simulator is the plant, in lockstep.
//!
//! ```text
//! run file -> archive (.fmu: description, library, packed run file)          written by `starloop fmu`
//! archive  -> importer -> fmu_library (C interface) -> Slave -> SteppedRun   in the simulator's process
//! ```
//!
//! * [`variables`] has every variable with its reference, type, unit and meaning, in one table;
//! * [`description`] writes `modelDescription.xml`;
//! * [`archive`] writes the .fmu file;
//! * [`slave`] is the life of one instance, and `values` are its variables.
//!
//! Standard: FMI 3.0.2, <https://fmi-standard.org/docs/3.0.2/>. Tests: below, and with FMPy in
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
pub mod slave;
mod values;
pub mod variables;

pub use error::FmuError;
pub use slave::Slave;
