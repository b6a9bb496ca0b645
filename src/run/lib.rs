//! Runs one run file: what is drawn, when, and the results.
//!
//! * [`runtime`]: receiver, scene, frame engine, ledger, delivery, one loop per clock;
//! * [`wiring`]: a checked bench or scenario -> the parts of a run; the closed loop.

pub mod runtime;
pub mod wiring;
