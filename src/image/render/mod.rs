//! Plan -> mean electrons per pixel, by one of three backends behind one trait.
//!
//! * `cpu`: all cores, vectorised; agrees with `reference` to the budget and repeats bit for bit.
//! * `gpu`: wgpu compute; the same methods in the same order, integer accumulation, repeats bit for bit.
//! * `reference`: f64, slow, integrates the exact motion: the truth that the others are compared with.

mod bands;
pub mod cpu;
pub mod gpu;
pub mod grid;
mod kernel;
pub mod overlap;
pub mod plan_tables;
mod products;
pub mod profile;
mod psf_samples;
pub mod reference;
pub mod spline;
mod spots;
mod stamp;
pub mod table;
mod weights;
mod whole;

use crate::gpu::Electrons;
use base::{refused::Refused, region::Regions};
use plan::exposure::plan::{LONGEST_KERNEL_PX, MOST_KERNEL_BYTES, MOST_KERNELS, StarClass, Verdict};
use plan::exposure::sampling::{oversampling, table_images};
use plan::exposure::{ExposurePlan, PsfSampling};

/// Draws plans.
pub trait Backend: Send {
    /// Returns the name people type: `cpu`, `gpu` or `reference`.
    fn name(&self) -> &'static str;

    /// Returns the device behind it, for reports.
    fn description(&self) -> String;

    /// Draws `plan`; the image stays with the backend until the next call.
    ///
    /// # Errors
    /// When the device failed.
    fn render(&mut self, plan: &ExposurePlan) -> Result<(), Refused>;

    /// Limits drawing, from the next image on, to these parts of the sensor, in sensor pixels. A backend may draw all
    /// of it, or leave old values in the other pixels.
    fn set_regions(&mut self, _regions: &Regions) {}

    /// Returns the latest image.
    fn electrons(&self) -> Electrons<'_>;
}

/// Refuses a plan whose tables would be beyond all bounds.
///
/// # Errors
/// When the tables of a field of PSFs are too large, the path leads further than [`LONGEST_KERNEL_PX`] from its mean,
/// or there are too many kernels.
pub fn check_kernel(plan: &ExposurePlan) -> Result<(), Refused> {
    let long = plan.extent_px.is_nan() || plan.extent_px > LONGEST_KERNEL_PX;
    if plan.has_kernel() && long {
        return Err(Refused(format!(
            "effective-psf: the path leads {extent_px:.0} px from its mean, wanted at most {LONGEST_KERNEL_PX} px; use \
         samples or auto",
            extent_px = plan.extent_px
        )));
    }
    let nodes = plan.psf.nodes().len();
    let side = 2 * plan.half_px + 1;
    let bytes = nodes * table_images(oversampling(&plan.psf)) * side * side.next_multiple_of(16) * size_of::<f32>();
    if nodes > 1 && bytes > MOST_KERNEL_BYTES {
        return Err(Refused(format!(
            "the tables of {nodes} PSFs over the field, {half_px} px to each side, would take {got_mib} MiB, wanted at most {} MiB; \
         take fewer nodes, PSFs on smaller grids, or a looser flux budget",
            MOST_KERNEL_BYTES >> 20,
            half_px = plan.half_px,
            got_mib = bytes >> 20
        )));
    }
    let too_many = |class: &StarClass| class.chosen.verdict == Verdict::TooManyKernels;
    if let Some(class) = plan.classes.iter().find(|class| too_many(class)) {
        return Err(Refused(format!(
            "{method}: its kernels would take more than {} MiB or {MOST_KERNELS} tables; use samples or auto",
            MOST_KERNEL_BYTES >> 20,
            method = class.chosen.method
        )));
    }
    Ok(())
}

/// Refuses a sampling of the PSF that only an analytic form has, where there is none.
///
/// # Errors
/// When the sampling is neither automatic nor a table, and the PSF is not drawn analytically.
pub fn check_sampling(plan: &ExposurePlan, is_analytic: bool) -> Result<(), Refused> {
    match plan.sampling {
        PsfSampling::Auto | PsfSampling::Table { .. } => Ok(()),
        PsfSampling::Supersampled { .. } | PsfSampling::Point | PsfSampling::Bicubic => {
            let is_drawn = is_analytic && !plan.has_kernel();
            if is_drawn {
                Ok(())
            } else {
                Err(Refused(format!(
                    "PSF sampling \"{sampling}\" is for narrow Gaussian PSFs on the CPU backend, drawn star by star: use auto or table:S, \
         or another method",
                    sampling = plan.sampling
                )))
            }
        }
    }
}
