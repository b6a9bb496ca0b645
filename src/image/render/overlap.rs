//! "The brighter of the two": stars and targets drawn apart, each pixel shows the larger of both.
//!
//! In: a plan with targets. Out: `max(stars, targets)` per pixel and the light lost by it, `sum of min(stars,
//! targets)`. This is the mask of some simulations, not physics: photons add. It is off unless asked for, and then
//! costs a second drawing and a pass over the image. Tests: below, `tests/physics/overlap.rs`, `tests/gpu/overlap.rs`.

use crate::{gpu::Electrons, render::Backend};
use base::{image::Image, refused::Refused};
use plan::exposure::ExposurePlan;

/// One half of a plan at a time, and the image of both.
#[derive(Debug)]
pub struct Apart {
    half: Option<Box<ExposurePlan>>,
    single: Image<f32>,
    precise: Image<f64>,
    is_precise: bool,
    /// Electrons that the latest image lacks: the light of the fainter in every pixel.
    pub lost_e: f64,
}

impl Apart {
    /// Returns a renderer for images of any size; buffers are made with the first.
    pub fn new() -> Self {
        let (single, precise) = (Image::new(0, 0), Image::new(0, 0));
        Self { half: None, single, precise, is_precise: false, lost_e: 0.0 }
    }

    /// Returns the plan without its targets.
    pub fn stars_of(&mut self, plan: &ExposurePlan) -> &ExposurePlan {
        let half = self.copy_of(plan);
        half.stars.extend_from_slice(plan.sky_stars());
        half
    }

    /// Returns the plan's targets alone.
    pub fn targets_of(&mut self, plan: &ExposurePlan) -> &ExposurePlan {
        let first = plan.sky_stars().len();
        let half = self.copy_of(plan);
        half.stars.extend_from_slice(&plan.stars[first..]);
        half.targets.extend_from_slice(&plan.targets);
        for target in &mut half.targets {
            target.nodes = target.nodes.start - first..target.nodes.end - first;
        }
        half
    }

    /// Returns a copy without sources, in buffers that are kept.
    fn copy_of(&mut self, plan: &ExposurePlan) -> &mut ExposurePlan {
        let half = self.half.get_or_insert_with(|| Box::new(plan.clone()));
        half.camera = plan.camera;
        half.shutter = plan.shutter;
        half.sampling = plan.sampling;
        (half.half_px, half.whole) = (plan.half_px, plan.whole);
        half.chosen = plan.chosen;
        half.degradation = plan.degradation;
        half.cut_off = plan.cut_off;
        (half.reach_px, half.extent_px, half.smear) = (plan.reach_px, plan.extent_px, plan.smear);
        if half.psf != plan.psf {
            half.psf.clone_from(&plan.psf);
        }
        half.classes.clone_from(&plan.classes);
        half.assessed.clone_from(&plan.assessed);
        half.nodes.clone_from(&plan.nodes);
        half.lists.clone_from(&plan.lists);
        half.motion.los.copy_from(&plan.motion.los);
        half.motion.image_path.clone_from(&plan.motion.image_path);
        half.stars.clear();
        half.targets.clear();
        half
    }

    /// Draws both halves with a backend that draws in memory.
    ///
    /// # Errors
    /// When the backend failed, or draws on a device.
    pub fn render(&mut self, backend: &mut dyn Backend, plan: &ExposurePlan) -> Result<(), Refused> {
        backend.render(self.stars_of(plan))?;
        match backend.electrons() {
            Electrons::Host(image) => copy(image, &mut self.single),
            Electrons::Precise(image) => copy(image, &mut self.precise),
            Electrons::Device(_) => {
                return Err(Refused(format!("the GPU failed while drawing: {}", "a host backend drew on a device")));
            }
        }
        backend.render(self.targets_of(plan))?;
        self.lost_e = match backend.electrons() {
            Electrons::Host(image) => {
                self.is_precise = false;
                keep_brighter(self.single.pixels_mut(), image.pixels())
            }
            Electrons::Precise(image) => {
                self.is_precise = true;
                keep_brighter(self.precise.pixels_mut(), image.pixels())
            }
            Electrons::Device(_) => 0.0,
        };
        Ok(())
    }

    /// Returns the electrons of the latest [`Self::render`].
    pub fn electrons(&self) -> Electrons<'_> {
        if self.is_precise { Electrons::Precise(&self.precise) } else { Electrons::Host(&self.single) }
    }

    /// Sets the light that was lost on a device, e-.
    pub fn set_lost_e(&mut self, lost_e: f64) {
        self.lost_e = lost_e;
    }
}

impl Default for Apart {
    fn default() -> Self {
        Self::new()
    }
}

fn copy<T: Copy + Default>(from: &Image<T>, to: &mut Image<T>) {
    if [from.width(), from.height()] != [to.width(), to.height()] {
        *to = Image::new(from.width(), from.height());
    }
    to.pixels_mut().copy_from_slice(from.pixels());
}

/// Returns the larger of two numbers in every pixel; the sum of the smaller ones.
fn keep_brighter<T: Copy + PartialOrd + Into<f64>>(kept: &mut [T], other: &[T]) -> f64 {
    let mut lost_e = 0.0;
    for (kept, other) in kept.iter_mut().zip(other) {
        let (larger, smaller) = if *other > *kept { (*other, *kept) } else { (*kept, *other) };
        *kept = larger;
        lost_e += smaller.into();
    }
    lost_e
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_larger_stays_and_the_smaller_is_counted() {
        let mut kept = [5.0_f32, 0.0, 2.0, 7.0];
        let lost_e = keep_brighter(&mut kept, &[1.0, 4.0, 2.0, 9.0]);
        assert_eq!(kept, [5.0, 4.0, 2.0, 9.0]);
        assert!((lost_e - (1.0 + 0.0 + 2.0 + 7.0)).abs() < 1e-12);
    }
}
