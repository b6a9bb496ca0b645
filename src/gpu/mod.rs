//! wgpu machinery: device, buffers, passes, readback, timing. No physics.

use crate::base::image::Image;

/// Where a mean electron image lives after a backend has rendered it.
pub enum Electrons<'a> {
    /// On the host, single precision (CPU backend).
    Host(&'a Image<f32>),
    /// On the host, double precision (reference backend).
    Precise(&'a Image<f64>),
}
