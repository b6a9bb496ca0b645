//! One run: what is drawn, when, and what became of it.
//!
//! * [`runtime`]: receiver, scene, frame engine, ledger, delivery, one loop per clock;
//! * [`wiring`]: a checked bench or scenario -> the parts of a run; the closed loop.

pub mod runtime;
pub mod wiring;
