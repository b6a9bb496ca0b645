//! What a frame costs, from a handful of constants per backend.
//!
//! The defaults were measured by `cargo bench` on a two-core AVX-512 machine (README); they order the methods and
//! give `check` its prediction. Error: a factor of two on other machines.

use crate::exposure::method::Method;
use crate::optics::PsfModel;

/// Cost constants of one backend.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CostModel {
    /// Per frame, whatever is in it, ms.
    pub frame_ms: f64,
    /// Per star and node of an analytic (Gaussian) PSF, ns.
    pub splat_ns: f64,
    /// Per star, node and table pixel of a tabulated PSF, ns.
    pub table_pixel_ns: f64,
    /// Per node and table entry while an effective PSF is built, ns.
    pub kernel_entry_ns: f64,
}

impl CostModel {
    /// CPU backend, two cores.
    pub const CPU: Self = Self { frame_ms: 0.1, splat_ns: 44.0, table_pixel_ns: 1.2, kernel_entry_ns: 0.4 };
    /// GPU backend on software Vulkan, two cores.
    pub const SOFTWARE_GPU: Self = Self { frame_ms: 3.0, splat_ns: 55.0, table_pixel_ns: 35.0, kernel_entry_ns: 0.4 };
    /// GPU backend on a hardware adapter (an estimate until measured there).
    pub const GPU: Self = Self { frame_ms: 0.5, splat_ns: 1.0, table_pixel_ns: 0.02, kernel_entry_ns: 0.4 };
    /// Reference backend.
    pub const REFERENCE: Self = Self { frame_ms: 20.0, splat_ns: 8_000.0, table_pixel_ns: 1e5, kernel_entry_ns: 1e3 };

    /// Milliseconds `method` should take for `stars` stars with footprint half-width `half_px`, when the path adds
    /// `extent_px` to every side of an effective PSF.
    #[must_use]
    pub fn predict_ms(&self, method: Method, psf: &PsfModel, stars: usize, half_px: usize, extent_px: f64) -> f64 {
        let stars = stars as f64;
        let width = 2.0 * half_px as f64 + 1.0;
        let analytic = matches!(psf, PsfModel::Gaussian { .. });
        let per_star_node_ns = if analytic { self.splat_ns } else { self.table_pixel_ns * width * width };
        let work_ns = match method {
            Method::EffectivePsf { nodes } => {
                let table_width = width + 2.0 * extent_px.ceil();
                let oversampling = if analytic { 8.0 } else { 16.0 };
                let per_entry = if analytic { 1.0 } else { 16.0 };
                let entries = (table_width * oversampling).powi(2) * per_entry;
                entries * nodes as f64 * self.kernel_entry_ns + stars * table_width * table_width * self.table_pixel_ns
            }
            other => stars * other.nodes() as f64 * per_star_node_ns,
        };
        self.frame_ms + work_ns * 1e-6
    }
}
