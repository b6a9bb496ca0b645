//! Parameters of the effects that depend on the pixel's place, on its neighbours or on the frame before; all of them
//! off.

use crate::detector::protons::{ProtonFlux, SensitiveLayer};
use crate::detector::window::{OutputGeometry, Window};
use crate::detector::{
    binning::Binning, blooming::Blooming, charge_transfer::ChargeTransfer, colour_filter::ColourFilter,
    defects::DefectPopulation, image_lag::ImageLag, tdi::Tdi,
};
use base::bayer::BayerPattern;

/// Spatial effects that are on; `None`: off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpatialParams {
    /// Filters before the pixels.
    pub colour_filter: Option<ColourFilter>,
    /// Random defects from the seed.
    pub defects: DefectPopulation,
    /// Layer in which protons leave charge.
    pub layer: SensitiveLayer,
    /// Protons from the first frame on.
    pub protons: Option<ProtonFlux>,
    /// Charge that stays in the pixel.
    pub image_lag: Option<ImageLag>,
    /// Charge above the full well spills; without it the excess is lost.
    pub blooming: Option<Blooming>,
    /// Charge that transfers leave behind.
    pub charge_transfer: Option<ChargeTransfer>,
    /// Squares of pixels become one.
    pub binning: Option<Binning>,
    /// The window that is cut out for the output.
    pub window: Option<Window>,
    /// Time-delayed integration.
    pub tdi: Option<Tdi>,
}

impl SpatialParams {
    /// None of it.
    pub const OFF: Self = Self {
        colour_filter: None,
        defects: DefectPopulation::NONE,
        layer: SensitiveLayer::TYPICAL,
        protons: None,
        image_lag: None,
        blooming: None,
        charge_transfer: None,
        binning: None,
        window: None,
        tdi: None,
    };

    /// Returns the colours of the output image, from its first pixel; `None` where its pixels have none: without
    /// filters, and where binning adds colours up.
    pub fn output_colours(&self) -> Option<BayerPattern> {
        let first_px = self.window.map_or([0; 2], |window| [window.left_px, window.top_px]);
        let filter = self.colour_filter.filter(|_| self.binning.is_none())?;
        Some(filter.pattern.from_pixel(first_px))
    }

    /// Returns the mapping from the pixels of a sensor to those of the output image.
    pub fn output(&self, sensor_px: [usize; 2]) -> OutputGeometry {
        OutputGeometry::new(sensor_px, self.binning.map_or(1, |binning| binning.factor), self.window)
    }
}
