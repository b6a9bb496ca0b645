//! wgpu machinery: device, buffers, passes, readback, timing. No physics.
//!
//! One [`crate::gpu::GpuDevice`] is shared by everything that draws on it. After warm-up a frame allocates no device
//! memory and makes no bind group; wgpu itself allocates a small amount per submission. Everything fits wgpu's default
//! limits. A failure of the device, at whatever call, is an error of the next call into this module, never a panic.
//! Tests: `tests/gpu`.

pub mod buffers;
pub mod device;
pub mod electrons;
pub mod shader;

pub use device::{AdapterChoice, GpuDevice, GpuError};
pub use electrons::DeviceElectrons;

use base::image::Image;

/// Memory in which a mean electron image is after a backend has rendered it.
pub enum Electrons<'a> {
    /// On the host, single precision (CPU backend).
    Host(&'a Image<f32>),
    /// On the host, double precision (reference backend).
    Precise(&'a Image<f64>),
    /// On a GPU, fixed point (GPU backend).
    Device(&'a DeviceElectrons),
}
