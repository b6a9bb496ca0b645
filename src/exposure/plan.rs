//! The plan of one exposure: plain data that any backend can draw.

use crate::astrometry::CameraGeometry;
use crate::exposure::features::{Features, PathNode};
use crate::exposure::method::Method;
use crate::exposure::motion::Motion;
use crate::exposure::track::StarTrack;
use crate::optics::PsfModel;
use glam::DVec3;

/// One star of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlannedStar {
    /// Identifier of the source.
    pub id: u32,
    /// Magnitude in the instrument's band (NaN: not a star of a catalog).
    pub mag: f32,
    /// Electrons the star sends into the whole image plane during the exposure.
    pub electrons: f64,
    /// Electrons of it that land on the detector within the footprint.
    pub electrons_on_detector: f64,
    /// Direction at mid-exposure, sensor axes, unit.
    pub mid_sensor: DVec3,
    /// Place at mid-exposure and response to the path.
    pub track: StarTrack,
    /// Exposure-averaged position: the star's true centroid, px.
    pub mean_px: [f64; 2],
}

/// What a method is predicted to do to a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Assessment {
    /// The method.
    pub method: Method,
    /// Bound of the 5 x 5 centroid error, px.
    pub centroid_px: f64,
    /// Bound of the relative flux error.
    pub flux_rel: f64,
    /// Bound of the largest pixel error in units of that pixel's noise sigma.
    pub pixel_sigma: f64,
    /// Predicted time, ms.
    pub cost_ms: f64,
    /// What the budget says.
    pub verdict: Verdict,
}

/// Furthest an effective PSF may reach from a star's mean position, px: its table grows with the square.
pub const LONGEST_KERNEL_PX: f64 = 256.0;

/// Whether a method may be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Inside the budget.
    Fits,
    /// Its domain is smooth motion, and there is jitter.
    NeedsSmoothMotion,
    /// The path is too long for a kernel ([`LONGEST_KERNEL_PX`]).
    PathTooLong,
    /// Its centroid error is over the budget.
    CentroidOverBudget,
    /// Its pixel error is over the budget.
    PixelOverBudget,
    /// Its flux error is over the budget (the footprint cap of a PSF with wide wings).
    FluxOverBudget,
}

impl Verdict {
    /// True when motion is drawn inside the budget (light beyond a footprint's cap is told in `flux_rel`).
    #[must_use]
    pub fn is_met(self) -> bool {
        matches!(self, Self::Fits | Self::FluxOverBudget)
    }
}

/// Everything a backend needs to draw one exposure.
#[derive(Debug, Clone, PartialEq)]
pub struct ExposurePlan {
    /// The camera.
    pub camera: CameraGeometry,
    /// The PSF.
    pub psf: PsfModel,
    /// Footprint half-width, px: a star is drawn in the square of `2 half_px + 1` pixels around each node.
    pub half_px: usize,
    /// The chosen method and its predicted error and cost.
    pub chosen: Assessment,
    /// All methods that were weighed, cheapest first.
    pub assessed: Vec<Assessment>,
    /// Path nodes of the chosen method.
    pub nodes: Vec<PathNode>,
    /// Mean features of the path.
    pub mean: Features,
    /// Response of a star at the centre of the detector: what an effective PSF is built with.
    pub centre_response: [Features; 2],
    /// Bound of the path's length on the detector, px.
    pub reach_px: f64,
    /// Furthest the path leads a star from its mean position, px.
    pub extent_px: f64,
    /// The stars, in source order.
    pub stars: Vec<PlannedStar>,
    /// What moves the image, for backends that integrate it exactly.
    pub motion: Motion,
}

impl ExposurePlan {
    /// Displacement of a star with the centre's response, about the mean, for every node: the shape of an effective
    /// PSF. Yields `(weight, dx_px, dy_px)`.
    pub fn kernel_path(&self) -> impl Iterator<Item = (f64, f64, f64)> {
        let centre = StarTrack { mid_px: [0.0; 2], response: self.centre_response };
        let mean = centre.displacement_px(&self.mean);
        self.nodes.iter().map(move |node| {
            let [x, y] = centre.displacement_px(&node.phi);
            (node.weight, x - mean[0], y - mean[1])
        })
    }

    /// Sum of the electrons that land on the detector.
    #[must_use]
    pub fn electrons_on_detector(&self) -> f64 {
        self.stars.iter().map(|star| star.electrons_on_detector).sum()
    }
}
