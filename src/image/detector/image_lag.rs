//! Image lag: a share of the charge stays in the pixel when it is read, and comes with the next frame.
//!
//! In: charge of a frame, e-. Out: `(1 - share) (charge + rest)`; the new rest is `share (charge + rest)`. After light
//! goes out, frames show `(1 - share) share^n` of it. The state from frame to frame is the rest, one number per pixel.
//! A frame whose number is not above the last one's starts again with no rest (so warming up leaves nothing, and a
//! replay draws the same bits); skipped frames are read out as well, without light: the rest is then `share^missed` of
//! the earlier one. Charge is conserved: out + new rest = in + old rest, to f32 rounding (tests below). Source: EMVA
//! 1288 R4.0 does not treat it; this is the linear model of Janesick, "Photon transfer" (2007), chapter 9. Limits:
//! traps whose share depends on signal are not modelled.

use crate::detector::Effect;
use crate::detector::effect_order::{FrameAt, NeighbourStage};
use base::image::Image;

/// Share of the charge that stays.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageLag {
    /// Share of the charge that stays, 0 to less than 1.
    pub share: f64,
}

/// Charge below this leaves nothing behind, e-: rests would fade into denormal numbers, which are slow.
pub const LEAST_E: f32 = 1e-6;

/// From which frame the rest is.
#[derive(Debug, Clone, Copy, Default)]
pub struct Memory {
    latest: Option<u32>,
}

impl Memory {
    /// Returns the share of the rest that comes with frame `frame`, which is then the latest.
    #[allow(clippy::cast_possible_truncation, reason = "the inner loops work in single precision")]
    pub fn advance(&mut self, frame: u32, share: f64) -> f32 {
        let missed = self.latest.and_then(|latest| frame.checked_sub(latest)).and_then(|step| step.checked_sub(1));
        self.latest = Some(frame);
        // `None`: the first frame, or not a later one.
        missed.map_or(0.0, |missed| libm::pow(share, f64::from(missed)) as f32)
    }

    /// Clears the rest: the next frame starts without lag.
    pub fn reset(&mut self) {
        self.latest = None;
    }
}

/// The stage and its rest.
#[derive(Debug)]
pub struct ImageLagStage {
    share: f64,
    full_well_e: f32,
    memory: Memory,
    rest_e: Image<f32>,
}

impl ImageLagStage {
    /// Returns the stage for images of this size.
    pub fn new(lag: &ImageLag, full_well_e: f32, [width, height]: [usize; 2]) -> Self {
        Self { share: lag.share, full_well_e, memory: Memory::default(), rest_e: Image::new(width, height) }
    }
}

impl NeighbourStage for ImageLagStage {
    fn effect(&self) -> Effect {
        Effect::ImageLag
    }

    #[allow(clippy::cast_possible_truncation, reason = "the inner loops work in single precision")]
    fn apply<'a>(&'a mut self, charge: &'a mut Image<f32>, at: &FrameAt) -> &'a mut Image<f32> {
        let carried = self.memory.advance(at.frame, self.share);
        let share = self.share as f32;
        for (e, rest) in charge.pixels_mut().iter_mut().zip(self.rest_e.pixels_mut()) {
            let all = *e + carried * *rest;
            // No more stays behind than a full pixel leaves.
            *rest = if all < LEAST_E { 0.0 } else { share * all.min(self.full_well_e) };
            *e = all - *rest;
        }
        charge
    }

    fn reset(&mut self) {
        self.memory.reset();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the charge of frames `numbers`, one pixel each, from the input.
    fn frames(stage: &mut ImageLagStage, frames: &[(u32, f32)]) -> Vec<f32> {
        frames
            .iter()
            .map(|(frame, light_e)| {
                let mut image = Image::new(1, 1);
                image.pixels_mut()[0] = *light_e;
                stage.apply(&mut image, &FrameAt { frame: *frame, exposure_s: 0.1, key: [0; 2] }).pixels()[0]
            })
            .collect()
    }

    fn lag(share: f64) -> ImageLagStage {
        ImageLagStage::new(&ImageLag { share }, 1e5, [1, 1])
    }

    #[test]
    fn a_flash_fades_by_the_share() {
        let out = frames(&mut lag(0.1), &[(0, 1000.0), (1, 0.0), (2, 0.0), (3, 0.0)]);
        for (got, wanted) in out.iter().zip([900.0, 90.0, 9.0, 0.9]) {
            assert!((got / wanted - 1.0).abs() < 1e-6, "{out:?}");
        }
        let sum: f32 = out.iter().sum();
        assert!((sum / 999.9 - 1.0).abs() < 1e-6, "all but what is still there: {sum}");
        assert!((frames(&mut lag(0.11), &[(0, 1000.0)])[0] / 900.0 - 1.0).abs() > 1e-3, "negative control");
    }

    #[test]
    fn steady_light_is_seen_whole_in_the_end() {
        let light: Vec<(u32, f32)> = (0..40).map(|frame| (frame, 500.0)).collect();
        let out = frames(&mut lag(0.3), &light);
        assert!((out[0] - 350.0).abs() < 1e-3, "the first frame has less");
        assert!((out[39] - 500.0).abs() < 1e-3, "{}", out[39]);
    }

    #[test]
    fn an_earlier_frame_or_a_reset_starts_again_and_gaps_fade() {
        let mut stage = lag(0.5);
        let first = frames(&mut stage, &[(0, 100.0), (1, 0.0)]);
        assert_eq!(frames(&mut stage, &[(0, 100.0), (1, 0.0)]), first, "back to frame 0");
        assert_eq!(frames(&mut stage, &[(1, 100.0)]), [50.0], "the same frame once more");
        assert_eq!(frames(&mut stage, &[(4, 0.0)]), [50.0 * 0.25 * 0.5], "two frames between");
        stage.reset();
        assert_eq!(frames(&mut stage, &[(9, 0.0)]), [0.0]);
    }
}
