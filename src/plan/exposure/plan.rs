//! The plan of one exposure: plain data that any backend can draw.

use crate::exposure::motion::{Motion, Shutter};
use crate::exposure::pose::{PathNode, Pose};
use crate::exposure::source::{PlannedStar, PlannedTarget};
use crate::exposure::{
    mean_field::Correction, method::Method, moments::TracePoint, sampling::PsfSampling, smear::SmearField,
    track::StarTrack, whole::WholeStars,
};
use crate::optics::PsfModel;
use base::drawn::Degradation;
use core::ops::Range;
use sky::astrometry::CameraGeometry;

/// Drawing method of the stars of one list.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Drawing {
    /// The PSF once, at the mean position.
    Once,
    /// The PSF at every node, each star by its own displacements.
    Nodes,
    /// The PSF convolved with the path of a star at this place, once at the mean position.
    Kernel(StarTrack),
    /// Four lists, made for the corners of a cell of the field, blended by the star's place in it.
    Blend(Cell),
    /// The PSF at every node, each star by its own displacements, in double precision as far as the PSF goes
    /// ([`crate::exposure::whole`]).
    Whole,
}

/// A cell of the field between four lists.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// Lists of the corners: top left, top right, bottom left, bottom right.
    pub corners: [u32; 4],
    /// Top left corner, px.
    pub origin_px: [f64; 2],
    /// Width and height, px.
    pub size_px: [f64; 2],
}

impl Cell {
    /// Returns the shares of the four lists for a star at `px`; they sum to 1.
    pub fn shares(&self, px: [f64; 2]) -> [f64; 4] {
        let [x, y] = core::array::from_fn(|i| ((px[i] - self.origin_px[i]) / self.size_px[i]).clamp(0.0, 1.0));
        [(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y]
    }
}

/// Path nodes and their use, for some of the stars.
#[derive(Debug, Clone, PartialEq)]
pub struct NodeList {
    /// Range in [`ExposurePlan::nodes`].
    pub nodes: Range<usize>,
    /// Their mean pose.
    pub mean: Pose,
    /// The mean of the nodes' displacements minus the displacement of the mean pose.
    pub correction: Correction,
    /// Drawing method.
    pub drawing: Drawing,
    /// The place of the PSF that is drawn, px, if the PSF depends on the place.
    pub psf_px: [f64; 2],
}

/// Predicted effect of a method on a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Assessment {
    /// The method.
    pub method: Method,
    /// Bound of the 5 x 5 centroid error, px.
    pub centroid_px: f64,
    /// Bound of the relative flux error of a star that no edge cuts.
    pub flux_rel: f64,
    /// Bound of the largest pixel error in units of that pixel's noise sigma.
    pub pixel_sigma: f64,
    /// Predicted time, ms.
    pub cost_ms: f64,
    /// Comparison with the budget.
    pub verdict: Verdict,
}

/// Stars of similar brightness, and the method that draws them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StarClass {
    /// Electrons of its brightest star.
    pub brightest_e: f64,
    /// Lower limit of the class, e-: fainter stars are in the next class.
    pub faintest_e: f64,
    /// Number of stars.
    pub stars: usize,
    /// Bands of rows with a list of nodes each (more than one: rolling shutter).
    pub bands: usize,
    /// Its method.
    pub chosen: Assessment,
    /// Its stars are drawn whole ([`crate::exposure::whole`]), at the nodes of the method.
    pub is_whole: bool,
}

impl StarClass {
    /// Returns a class without stars, ordinary ones in a single band.
    pub fn none(chosen: Assessment) -> Self {
        Self { brightest_e: 0.0, faintest_e: 0.0, stars: 0, bands: 1, chosen, is_whole: false }
    }
}

/// Largest reach of an effective PSF from a star's mean position, px: its table grows with the square.
pub const LONGEST_KERNEL_PX: f64 = 256.0;
/// The same for a frame with a time budget: backends reserve memory for kernels of this reach with the first frame.
pub const RESERVED_KERNEL_PX: f64 = 16.0;
/// Nodes of such a kernel: twice those of samples.
pub const RESERVED_KERNEL_NODES: usize = 2048;

/// Share of the budget's centroid error for a method's bound; the rest is reserved for errors outside the bound.
pub const MOTION_SHARE: f64 = 0.5;

/// Largest memory of all kernels of a frame, bytes (a device holds up to four times as much).
pub const MOST_KERNEL_BYTES: usize = 256 << 20;

/// Largest number of kernels of a frame: with the PSF's own table, the layers of a texture.
pub const MOST_KERNELS: usize = 255;

/// Result of the comparison of a method with its limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Inside the budget.
    Fits,
    /// Its domain is smooth motion, and there is jitter.
    NeedsSmoothMotion,
    /// The path is too long for a kernel ([`LONGEST_KERNEL_PX`]).
    PathTooLong,
    /// Its kernels together are too large ([`MOST_KERNEL_BYTES`]).
    TooManyKernels,
    /// Its kernels are made of exact pixel integrals, and another sampling was requested.
    OtherSampling,
    /// Its centroid error is over the budget.
    CentroidOverBudget,
    /// Its pixel error is over the budget.
    PixelOverBudget,
    /// Its flux error is over the budget (the footprint cap of a PSF with wide wings, or a rolling shutter that
    /// stretches a fast star).
    FluxOverBudget,
}

impl Verdict {
    /// Returns true when every error is inside the budget.
    pub fn is_met(self) -> bool {
        self == Self::Fits
    }

    /// Returns true when motion is drawn inside the budget; light may be lost by any method.
    pub fn keeps_shape(self) -> bool {
        matches!(self, Self::Fits | Self::FluxOverBudget)
    }

    /// Returns true when the method can be drawn.
    pub fn is_drawable(self) -> bool {
        !matches!(self, Self::NeedsSmoothMotion | Self::PathTooLong | Self::TooManyKernels | Self::OtherSampling)
    }
}

/// Stars that were left out because they stay below a share of the noise.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CutOff {
    /// Number of stars.
    pub stars: usize,
    /// Their electrons together.
    pub electrons: f64,
    /// Bound of the light missing in any pixel, e-.
    pub most_in_pixel_e: f64,
}

/// Everything a backend needs to draw one exposure.
#[derive(Debug, Clone, PartialEq)]
pub struct ExposurePlan {
    /// The camera.
    pub camera: CameraGeometry,
    /// Exposure of its rows.
    pub shutter: Shutter,
    /// The PSF.
    pub psf: PsfModel,
    /// Method to compute pixel values from the PSF.
    pub sampling: PsfSampling,
    /// Footprint half-width, px: a star is drawn in the square of `2 half_px + 1` pixels around each node.
    pub half_px: usize,
    /// Stars that are drawn whole, in a wider footprint.
    pub whole: WholeStars,
    /// The method of the brightest stars and its predicted error, with the cost of the whole frame.
    pub chosen: Assessment,
    /// All methods that were weighed for the brightest stars, cheapest first.
    pub assessed: Vec<Assessment>,
    /// The stars by brightness, brightest first.
    pub classes: Vec<StarClass>,
    /// Stars that were left out.
    pub cut_off: CutOff,
    /// Degradation to keep the time budget.
    pub degradation: Degradation,
    /// Path nodes of all lists.
    pub nodes: Vec<PathNode>,
    /// Lists of nodes.
    pub lists: Vec<NodeList>,
    /// Bound of the path's length on the detector, px.
    pub reach_px: f64,
    /// Largest distance of a star from its mean position along the path, px.
    pub extent_px: f64,
    /// Narrower side of the box about the path of a star in the middle of the detector, px.
    pub narrow_px: f64,
    /// Steps that planning the motion took (see `cost`); 0 where nothing moves.
    pub path_steps: usize,
    /// Motion of a star during the exposure, by its place.
    pub smear: SmearField,
    /// The stars, in source order; behind them the nodes of the targets.
    pub stars: Vec<PlannedStar>,
    /// The visible targets.
    pub targets: Vec<PlannedTarget>,
    /// Motion of the image, for backends that integrate it exactly.
    pub motion: Motion,
}

impl CutOff {
    /// Adds further stars that were left out.
    pub fn add(&mut self, more: &Self) {
        self.stars += more.stars;
        self.electrons += more.electrons;
        self.most_in_pixel_e += more.most_in_pixel_e;
    }
}

impl ExposurePlan {
    /// Returns the stars without the nodes of targets.
    pub fn sky_stars(&self) -> &[PlannedStar] {
        let nodes = self.targets.first().map_or(self.stars.len(), |target| target.nodes.start);
        &self.stars[..nodes.min(self.stars.len())]
    }

    /// Returns a test for the stars of a class.
    pub fn is_member(&self, class: usize) -> impl Fn(&PlannedStar) -> bool + Copy + Sync + use<> {
        let only = self.classes.len() == 1;
        let (above, faintest) = self.brightness_of(class);
        move |star| only || (star.electrons < above && star.electrons >= faintest)
    }

    /// Returns the electrons between which the stars of a class lie: below the first, from the second on.
    pub fn brightness_of(&self, class: usize) -> (f64, f64) {
        let above_e = class.checked_sub(1).map_or(f64::INFINITY, |before| self.classes[before].faintest_e);
        (above_e, self.classes[class].faintest_e)
    }

    /// Returns the nodes of a list.
    pub fn nodes_of(&self, list: &NodeList) -> &[PathNode] {
        &self.nodes[list.nodes.clone()]
    }

    /// Returns the list that a star is drawn with.
    pub fn list_of(&self, star: &PlannedStar) -> &NodeList {
        &self.lists[star.list as usize]
    }

    /// Returns the origin of a star's poses when it is drawn node by node, so that its mean is at `mean_px`.
    pub fn origin_px(&self, star: &PlannedStar, track: &StarTrack) -> [f64; 2] {
        let list = self.list_of(star);
        let ([x, y], [cx, cy]) = (track.displacement_px(&list.mean), list.correction.at(star.place.mid_px));
        [star.mean_px[0] - x - cx, star.mean_px[1] - y - cy]
    }

    /// Returns the displacement about its mean, for every node, of a star at the position for which the kernel is made:
    /// the shape of an effective PSF.
    pub fn kernel_trace<'a>(
        &'a self,
        nodes: &'a [PathNode],
        at: &'a StarTrack,
    ) -> impl Iterator<Item = TracePoint> + 'a {
        let mean = nodes.iter().fold([0.0; 2], |[x, y], node| {
            let [dx, dy] = at.exact_px(&self.camera, &node.pose);
            [x + node.weight * dx, y + node.weight * dy]
        });
        nodes.iter().map(move |node| {
            let [x, y] = at.exact_px(&self.camera, &node.pose);
            [node.weight, x - mean[0], y - mean[1]]
        })
    }

    /// Returns the lists that draw a star, with their shares of its light.
    pub fn parts(&self, star: &PlannedStar) -> impl Iterator<Item = (usize, f64)> + use<> {
        let parts = match self.list_of(star).drawing {
            Drawing::Blend(cell) => {
                let shares = cell.shares(star.mean_px);
                core::array::from_fn(|i| (cell.corners[i] as usize, shares[i]))
            }
            Drawing::Once | Drawing::Nodes | Drawing::Kernel(_) | Drawing::Whole => {
                [(star.list as usize, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)]
            }
        };
        parts.into_iter().filter(|(_, share)| *share > 0.0)
    }

    /// Returns the widest footprint's half-width of the plan's stars, px.
    pub fn widest_half_px(&self) -> usize {
        let is_any_whole = self.lists.iter().any(|list| list.drawing == Drawing::Whole);
        if is_any_whole { self.whole.half_px } else { self.half_px }
    }

    /// Returns true when any star is drawn from a kernel.
    pub fn has_kernel(&self) -> bool {
        self.lists.iter().any(|list| matches!(list.drawing, Drawing::Kernel(_)))
    }

    /// Returns the sum of the electrons that land on the detector.
    pub fn electrons_on_detector(&self) -> f64 {
        self.stars.iter().map(|star| star.electrons_on_detector).sum()
    }
}
