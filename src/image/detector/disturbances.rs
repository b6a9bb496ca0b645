//! The disturbances of single pixels of a detector: its defects and the protons that hit it -> each frame's outliers.
//!
//! Both backends own one; the same seed and the same commands give the same list. Nothing is allocated after the start.

use crate::detector::binning::{Binning, BinningKind};
use crate::detector::defects::{DefectSpace, Defects};
use crate::detector::outliers::{Outlier, Outliers};
use crate::detector::protons::{ProtonFlux, ProtonTrack, Protons};
use crate::detector::{conditions::DetectorConditions, dark_current::DarkLaw, params::DetectorParams, seeds::Seeds};
use base::image::DnImage;

/// Defects that may be commanded besides those of the camera file.
pub const SPARE_DEFECTS: usize = 4096;
/// Pixels of such defects: four columns of 4096 px.
pub const SPARE_PX: usize = 16_384;
/// Tracks of one frame.
pub const MOST_TRACKS: usize = 1024;
/// Pixels with charge of tracks in one frame.
pub const MOST_TRACK_PX: usize = 32_768;
/// Frames per second as long as no other rate is set.
const FRAME_PERIOD_S: f64 = 1.0;

/// Defects and protons.
#[derive(Debug, Clone)]
pub struct Disturbances {
    defects: Defects,
    protons: Protons,
    own_flux: Option<ProtonFlux>,
    outliers: Outliers,
}

impl Disturbances {
    /// Returns the defects of the parameters, with capacity for more.
    pub fn new(params: &DetectorParams, size_px: [usize; 2], seeds: Seeds) -> Self {
        let spatial = &params.spatial;
        let population = spatial.defects.count(size_px[0] * size_px[1]);
        let charge_binning = match spatial.binning {
            Some(Binning { factor, kind: BinningKind::Charge { .. } }) => factor,
            _ => 1,
        };
        let space =
            DefectSpace { size_px, charge_binning, defects: population + SPARE_DEFECTS, pixels: population + SPARE_PX };
        let mut defects = Defects::new(space, seeds.noise, FRAME_PERIOD_S);
        // The list has capacity for all of them, and all are on the detector.
        let _ = defects.insert_all(spatial.defects.draw(size_px, seeds.sensor));
        let protons = Protons::new(size_px, spatial.layer, seeds.noise, MOST_TRACKS, MOST_TRACK_PX);
        let outliers = Outliers::with_capacity(space.pixels + MOST_TRACK_PX);
        Self { defects, protons, own_flux: spatial.protons, outliers }
    }

    /// Returns the defects.
    pub fn defects(&self) -> &Defects {
        &self.defects
    }

    /// Returns the defects for changes that take effect with the next frame.
    pub fn defects_mut(&mut self) -> &mut Defects {
        &mut self.defects
    }

    /// Returns the proton tracks of the latest frame, in sensor pixels.
    pub fn proton_tracks(&self) -> &[ProtonTrack] {
        self.protons.tracks()
    }

    /// Protons that no longer fitted into their frames, since the start.
    pub fn protons_left_out(&self) -> u64 {
        self.protons.left_out()
    }

    /// Makes the outliers of a frame; the list has capacity for those of defects and tracks together.
    pub fn advance(&mut self, frame: u32, conditions: &DetectorConditions, dark: DarkLaw) {
        let exposure_s = conditions.exposure_s;
        // Extra dark current of hot pixels grows with temperature as all dark current does.
        let warmer = dark.warmer_by(conditions.warmer_k).factor() / dark.factor();
        let defects: &[Outlier] = self.defects.at_frame(frame, exposure_s * warmer);
        let tracks = self.protons.at_frame(frame, exposure_s, conditions.protons.or(self.own_flux));
        self.outliers.merge(defects, tracks);
    }

    /// Returns the outliers of the latest frame.
    pub fn outliers(&self) -> &Outliers {
        &self.outliers
    }

    /// Writes the numbers of stuck pixels into the image that the ADC made.
    pub fn stick(&self, adc: &mut DnImage) {
        self.defects.stick(adc);
    }
}
