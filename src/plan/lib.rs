//! What one exposure needs: attitude samples -> line-of-sight path -> plan.
//!
//! * [`attitude`]: time correlation, history, prediction, jitter, the line-of-sight path of one exposure;
//! * [`optics`]: point-spread functions and radiometry: magnitude -> electrons;
//! * [`exposure`]: the planner: which method, how many samples, which stars, at what predicted error and cost.

pub mod attitude;
pub mod exposure;
pub mod optics;
