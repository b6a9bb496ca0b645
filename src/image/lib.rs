//! A plan -> mean electrons -> digital numbers.
//!
//! * [`gpu`]: wgpu machinery: device, buffers, passes, readback; no physics;
//! * [`render`]: plan -> mean electrons: trait `Backend` (gpu, cpu, reference);
//! * [`detector`]: electrons -> digital numbers: one ordered list of stages.

pub mod detector;
pub mod gpu;
pub mod render;
