//! Plans one exposure: attitude samples -> line-of-sight path -> plan.
//!
//! * [`attitude`]: time correlation, history, prediction, jitter, the line-of-sight path of one exposure;
//! * [`optics`]: point-spread functions and radiometry: magnitude -> electrons;
//! * [`exposure`]: the planner: method, number of samples, stars to draw, predicted error and cost.

pub mod attitude;
pub mod exposure;
pub mod optics;
