//! [`crate::detector::neighbour_stage`] on a device.

use crate::detector::{Effect, neighbour_stage::FrameAt};
use crate::gpu::{GpuDevice, GpuError};
use core::fmt::Debug;

/// One stage. Its pipeline, buffers and bind groups are made once, in
/// [`stages`](crate::detector::gpu::neighbours::stages).
pub trait GpuNeighbourStage: Debug + Send + Sync {
    /// Returns which effect it is.
    fn effect(&self) -> Effect;

    /// Records the stage's work on the charge it was made for.
    ///
    /// # Errors
    /// When the device failed.
    fn record(&mut self, gpu: &GpuDevice, encoder: &mut wgpu::CommandEncoder, at: &FrameAt) -> Result<(), GpuError>;

    /// Clears its state from frame to frame.
    fn reset(&mut self) {}
}
