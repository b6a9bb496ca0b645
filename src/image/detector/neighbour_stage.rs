//! Stages of the detector that need more than one pixel or an earlier frame: their trait.

use crate::detector::Effect;
use base::image::Image;
use core::fmt::Debug;

/// The frame to which the charge belongs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameAt {
    /// Number of the frame: random words are counted by it.
    pub frame: u32,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Key of the seed.
    pub key: [u32; 2],
}

/// One stage.
pub trait NeighbourStage: Debug + Send + Sync {
    /// Returns which effect it is: stages run in the order of [`crate::detector::ORDER`].
    fn effect(&self) -> Effect;

    /// Changes the charge, e- per pixel, and returns the image that the next stage goes on with: the same one, or one
    /// of the stage's own where the size changes.
    fn apply<'a>(&'a mut self, charge: &'a mut Image<f32>, at: &FrameAt) -> &'a mut Image<f32>;

    /// Clears its state from frame to frame.
    fn reset(&mut self) {}
}
