//! One frame on its way out: pixels, the stars that are truly in it, and how it came about.

use crate::sink::frame_fault::{ActiveFaults, FaultFlags};
use crate::{camera_control::Regions, sink::target_table::TargetRow, sink::wcs::Wcs};
use base::drawn::{Degradation, FrameMethod, PathOrigin};
use base::time::{Span, Tai};
use base::{bayer::BayerPattern, image::DnImage, source_id::SourceId};
use std::sync::Arc;

/// Targets on the sky that fit without allocation from the start.
const TARGETS_RESERVED: usize = 64;

/// A finished frame. Its buffers are made once and travel between the frame thread and the sink thread.
#[derive(Debug, Clone, PartialEq)]
pub struct SentFrame {
    /// Digital numbers from the detector, DN.
    pub image: DnImage,
    /// The stars in the image; empty when the frame is blank.
    pub truth: Vec<TruthStar>,
    /// The targets on the sky in the image.
    pub targets: Vec<TargetRow>,
    /// Everything else that is known about the frame.
    pub meta: FrameMeta,
}

impl SentFrame {
    /// Buffers for frames of `width` by `height` pixels; up to `max_stars` stars fit without allocation.
    pub fn with_capacity(width: usize, height: usize, max_stars: usize, camera: Arc<str>) -> Self {
        Self {
            image: DnImage::new(width, height),
            truth: Vec::with_capacity(max_stars),
            targets: Vec::with_capacity(TARGETS_RESERVED),
            meta: FrameMeta::empty(camera),
        }
    }

    /// Returns a copy with the same capacity for stars, every page of it written to.
    pub fn touched_copy(&self) -> Self {
        let mut copy = self.clone();
        copy.truth.resize(self.truth.capacity(), TruthStar::NONE);
        copy.truth.truncate(self.truth.len());
        copy.truth.copy_from_slice(&self.truth);
        copy
    }

    /// Becomes a copy of `from` in its own buffers; allocates only where these are too small or of another size.
    pub fn copy_from(&mut self, from: &Self) {
        if [self.image.width(), self.image.height()] == [from.image.width(), from.image.height()] {
            self.image.pixels_mut().copy_from_slice(from.image.pixels());
        } else {
            self.image.clone_from(&from.image);
        }
        self.truth.clone_from(&from.truth);
        self.targets.clone_from(&from.targets);
        self.meta.clone_from(&from.meta);
    }
}

base::words! {
    /// Kind of a row of the truth table.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
    pub enum TruthKind {
        /// A star of the catalog.
        #[default]
        Star = "star",
        /// A scripted target.
        Target = "target",
        /// A star that is in no catalog, by a commanded fault.
        FalseStar = "false_star",
        /// A planet.
        Planet = "planet",
        /// The Moon.
        Moon = "moon",
        /// The Earth.
        Earth = "earth",
        /// The track of a proton through the detector, by a commanded fault.
        ProtonTrack = "proton_track",
    }
}

/// One star, or whatever else left light in one place, as it was put into the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruthStar {
    /// Identifier: the catalog's; false stars and targets have ranges of their own.
    pub id: u32,
    /// Right ascension and declination in which the moving observer sees it at mid-exposure, ICRF axes, deg: with
    /// aberration and deflection. Not a number for objects that are not on the sky.
    pub apparent_deg: [f64; 2],
    /// The same without aberration and deflection, as a catalog has it: ICRS at the frame's epoch, space motion and
    /// parallax applied.
    pub catalog_deg: [f64; 2],
    /// Magnitude in the instrument's band; infinite for a target that is dark at mid-exposure, not a number where there
    /// is none.
    pub mag: f32,
    /// Mean column over the exposure, px (first pixel's centre is 0).
    pub x_px: f64,
    /// Mean row over the exposure, px, down.
    pub y_px: f64,
    /// Electrons collected in the exposure, mean, before noise.
    pub electrons: f64,
    /// Kind of the object.
    pub kind: TruthKind,
    /// Length of its path over the image during the exposure, px: slews, jitter, a target's own motion.
    pub smear_px: f64,
    /// Direction from the start of that path to its end, from columns towards rows, deg; 0 for one that comes back.
    pub smear_deg: f64,
    /// Name in its source catalog, where it has one.
    pub source_id: Option<SourceId>,
}

impl TruthStar {
    /// A row with nothing in it.
    pub const NONE: Self = Self {
        id: 0,
        apparent_deg: [0.0; 2],
        catalog_deg: [0.0; 2],
        mag: 0.0,
        x_px: 0.0,
        y_px: 0.0,
        electrons: 0.0,
        kind: TruthKind::Star,
        smear_px: 0.0,
        smear_deg: 0.0,
        source_id: None,
    };
}

/// Metadata of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameMeta {
    /// Frame number in the run.
    pub number: u32,
    /// Middle of the exposure: the epoch of validity of attitude and truth.
    pub mid_exposure: Tai,
    /// Integration time, s.
    pub exposure_s: f64,
    /// Start of the exposure: `rate`, or the source of its trigger.
    pub started_by: &'static str,
    /// From the trigger to the start of the exposure; zero without one.
    pub trigger_delay: Span,
    /// Gain beyond that of the camera's file, dB.
    pub gain_db: f64,
    /// Parts of the image that were read out.
    pub regions: Regions,
    /// Test pattern that took the place of the image on its way out; `Off`: the image is the detector's.
    pub test_pattern: &'static str,
    /// Attitude at mid-exposure, `sensor_from_icrf`: Hamilton, passive (`v_sensor = q v_icrf q*`), scalar first.
    pub attitude_wxyz: [f64; 4],
    /// Rotation vector of the line of sight beside that attitude at mid-exposure, sensor axes, rad: jitter.
    pub jitter_rad: [f64; 3],
    /// Right ascension of the boresight, deg.
    pub ra_deg: f64,
    /// Declination of the boresight, deg.
    pub dec_deg: f64,
    /// Position angle of the image's up direction, east of north, deg.
    pub roll_deg: f64,
    /// Angular rate with respect to ICRF in sensor axes, deg/s.
    pub rate_deg_s: [f64; 3],
    /// Seed of the sensor (fixed patterns) and of faults.
    pub seed: u64,
    /// Seed of the exposure's noise.
    pub noise_seed: u64,
    /// Completion minus deadline; negative when early.
    pub lateness: Span,
    /// Age of the newest attitude sample when the frame was planned.
    pub attitude_age: Span,
    /// Newest attitude sample to mid-exposure: how far the attitude was predicted; negative when it was interpolated.
    pub horizon: Span,
    /// Newest attitude sample used to the end of the exposure: how far its last part was extrapolated; negative when it
    /// was not.
    pub end_horizon: Span,
    /// The middle of the exposure was interpolated, and two or more attitude samples were missing at one of its ends.
    pub is_partly_extrapolated: bool,
    /// Largest motion in the exposure beyond rate and acceleration, arcsec; above 0.01 it is drawn, along a polyline.
    pub residual_arcsec: f64,
    /// Part of the exposure that lacks jitter samples of a stream that was expected to go on.
    pub jitter_missing: Span,
    /// Render backend.
    pub backend: &'static str,
    /// Smear method.
    pub method: FrameMethod,
    /// Degree to which the frame was degraded to be ready in time.
    pub degradation: Degradation,
    /// Stars that were left out: too faint to be seen, or for want of time.
    pub left_out_stars: usize,
    /// Their electrons together.
    pub left_out_e: f64,
    /// Stars that would be on the detector if the Earth or the Moon did not cover them.
    pub occulted_stars: usize,
    /// Electrons that the image lacks because each pixel shows only the brighter of stars and targets.
    pub overlap_lost_e: f64,
    /// Source of the attitude.
    pub origin: PathOrigin,
    /// Commanded faults active in this frame.
    pub faults: FaultFlags,
    /// Faults of frames and of the imaging chain, one by one.
    pub active: ActiveFaults,
    /// Camera name.
    pub camera: Arc<str>,
    /// Detector gain, e-/DN; not a number where the image is codes of luminance for a display.
    pub gain_e_per_dn: f64,
    /// Black level, DN.
    pub black_level_dn: f64,
    /// Sensor pixels of one image pixel, along each side.
    pub binning: u32,
    /// First sensor pixel of the image, column and row.
    pub window_px: [u32; 2],
    /// Further facts about the camera; `None` where the image is not that of its own detector.
    pub facts: Option<CameraFacts>,
    /// Observer's velocity about the barycentre over the speed of light, ICRF axes; zeros without stars.
    pub observer_beta: [f64; 3],
    /// Places of its pixels on the sky; `None` without stars, and for an image that does not show its attitude.
    pub wcs: Option<Wcs>,
}

/// Numbers of a camera that readers of its images want.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraFacts {
    /// Pitch of the sensor's pixels, um.
    pub pixel_pitch_um: f64,
    /// Focal length, mm.
    pub focal_length_mm: f64,
    /// Digital number at which a pixel of the image saturates: of the full well or of the converter, whichever is less.
    pub saturation_dn: f64,
    /// Read noise of one pixel of the image, e- rms.
    pub read_noise_e_rms: f64,
    /// Temperature of the detector, degrees Celsius.
    pub temperature_c: f64,
    /// Gaia G magnitude of the faintest stars that are drawn.
    pub drawn_to_mag_g: f64,
    /// Colours of the image's pixels; `None` where they have none.
    pub colours: Option<BayerPattern>,
}

impl FrameMeta {
    /// Returns the metadata of a frame that has not been exposed yet.
    pub fn empty(camera: Arc<str>) -> Self {
        Self {
            number: 0,
            mid_exposure: Tai::from_ns(0),
            exposure_s: 0.0,
            started_by: "rate",
            trigger_delay: Span::ZERO,
            gain_db: 0.0,
            regions: Regions::WHOLE,
            test_pattern: "Off",
            attitude_wxyz: [1.0, 0.0, 0.0, 0.0],
            jitter_rad: [0.0; 3],
            ra_deg: 0.0,
            dec_deg: 0.0,
            roll_deg: 0.0,
            rate_deg_s: [0.0; 3],
            seed: 0,
            noise_seed: 0,
            lateness: Span::ZERO,
            attitude_age: Span::ZERO,
            horizon: Span::ZERO,
            end_horizon: Span::ZERO,
            is_partly_extrapolated: false,
            residual_arcsec: 0.0,
            jitter_missing: Span::ZERO,
            backend: "none",
            method: FrameMethod::None,
            degradation: Degradation::Full,
            left_out_stars: 0,
            left_out_e: 0.0,
            occulted_stars: 0,
            overlap_lost_e: 0.0,
            origin: PathOrigin::Absent,
            faults: FaultFlags::NONE,
            active: ActiveFaults::NONE,
            camera,
            gain_e_per_dn: 1.0,
            black_level_dn: 0.0,
            binning: 1,
            window_px: [0; 2],
            facts: None,
            observer_beta: [0.0; 3],
            wcs: None,
        }
    }

    /// Returns the start of the exposure.
    pub fn exposure_start(&self) -> Tai {
        self.mid_exposure - Span::from_s(self.exposure_s / 2.0)
    }

    /// Returns the end of the exposure.
    pub fn exposure_end(&self) -> Tai {
        self.exposure_start() + Span::from_s(self.exposure_s)
    }
}
