//! Draws many frames for one result. No run needs this crate.
//!
//! * [`still`]: single images of any attitude and instant;
//! * [`chart`]: accuracy compared with speed: every method, scene and backend -> CSV and SVG;
//! * [`verify`]: a camera compared with its file, from its own frames;
//! * [`study`]: the closed loop compared with theory; [`campaign`]: faults drawn from seeds.

pub mod campaign;
pub mod chart;
pub mod still;
pub mod study;
pub mod verify;
