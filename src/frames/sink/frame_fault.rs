//! The ways in which a frame, or the chain that images it, can be spoilt on purpose; `run::runtime` does it, files name it.

use crate::sink::active_fault::Amount;
use crate::sink::faults::FaultFlags;
use base::time::Span;

/// Pixels of a fault: one given, and others at random by the seed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FaultPixels {
    /// Column and row.
    pub at: Option<[u32; 2]>,
    /// How many at random.
    pub random: u32,
}

/// Where the pixels of a detector are defective.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DefectSpots {
    /// Single pixels.
    pub pixels: FaultPixels,
    /// A whole column.
    pub column: Option<u32>,
    /// A whole row.
    pub row: Option<u32>,
}

/// What is wrong with defective pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PixelFault {
    /// More dark current, e-/s.
    Hot {
        /// Mean electrons per second more.
        e_per_s: f64,
    },
    /// Less response to light.
    Dead {
        /// Share of the light that is counted, 0 to 1.
        response: f64,
    },
    /// Dark current that switches between two levels.
    Rts {
        /// Mean electrons per second more at the high level.
        e_per_s: f64,
        /// Mean time at the high level, s.
        high_s: f64,
        /// Mean time at the low level, s.
        low_s: f64,
    },
    /// Always the same digital number.
    Stuck {
        /// Which.
        dn: u16,
    },
}

/// Protons through the detector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProtonStorm {
    /// Protons per square centimetre and second.
    pub per_cm2_s: f64,
    /// Their kinetic energy, MeV.
    pub energy_mev: f64,
    /// Angle from the detector's normal and azimuth of a beam, deg; `None`: from all sides.
    pub beam_deg: Option<[f64; 2]>,
}

/// How a frame is spoilt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FrameFault {
    /// Not sent.
    Drop,
    /// The previous image in place of this one.
    Duplicate,
    /// Sent late by this.
    Late(Span),
    /// The upper half is the previous frame's.
    Torn,
    /// Every pixel reads the black level: no light.
    Blank,
    /// One bit of some pixels' numbers is the other way, new pixels at random in every frame.
    BitFlip {
        /// Which bit, from 0.
        bit: u8,
        /// Of which pixels.
        pixels: FaultPixels,
    },
    /// Uniform stray light, electrons per second and pixel.
    StrayLight {
        /// e-/s in every pixel.
        e_per_s: f64,
    },
    /// Uniform stray light that changes evenly while it lasts.
    StrayLightRamp {
        /// e-/s in every pixel at the begin.
        from_e_per_s: f64,
        /// And at the end.
        to_e_per_s: f64,
    },
    /// Another point-spread function: a Gaussian.
    Defocus {
        /// Its sigma, px.
        sigma_px: f64,
    },
    /// Only a share of the light of stars, targets and sky comes through; it changes evenly while it lasts.
    Contamination {
        /// Share at the begin.
        from_share: f64,
        /// And at the end.
        to_share: f64,
    },
    /// The detector is warmer, and its dark current larger.
    TemperatureStep {
        /// By this, K.
        by_k: f64,
    },
    /// Light floods every pixel.
    Saturation {
        /// With this much in each exposure, full wells.
        full_wells: f64,
    },
    /// Stars that are in no catalog, in the same places while it lasts.
    FalseStars {
        /// Where.
        pixels: FaultPixels,
        /// Their magnitude in the instrument's band.
        mag: f64,
    },
    /// Catalog stars are left out, the same ones while it lasts.
    MissingStars {
        /// This share of them.
        share: f64,
    },
    /// The brightest catalog stars on the detector are left out.
    MissingBrightStars {
        /// How many.
        count: u32,
    },
    /// Pixels with a defect.
    Pixels {
        /// Which.
        spots: DefectSpots,
        /// What is wrong with them.
        fault: PixelFault,
    },
    /// Tracks of protons.
    Protons(ProtonStorm),
}

impl FrameFault {
    /// Its word in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Drop => "frame_drop",
            Self::Duplicate => "frame_duplicate",
            Self::Late(_) => "frame_late",
            Self::Torn => "frame_torn",
            Self::Blank => "frame_blank",
            Self::BitFlip { .. } => "frame_bit_flip",
            Self::StrayLight { .. } => "stray_light",
            Self::StrayLightRamp { .. } => "stray_light_ramp",
            Self::Defocus { .. } => "defocus_step",
            Self::Contamination { .. } => "contamination",
            Self::TemperatureStep { .. } => "temperature_step",
            Self::Saturation { .. } => "saturation",
            Self::FalseStars { .. } => "false_stars",
            Self::MissingStars { .. } => "missing_stars",
            Self::MissingBrightStars { .. } => "missing_bright_stars",
            Self::Pixels { fault: PixelFault::Hot { .. }, .. } => "hot_pixels",
            Self::Pixels { fault: PixelFault::Dead { .. }, .. } => "dead_pixels",
            Self::Pixels { fault: PixelFault::Rts { .. }, .. } => "rts_pixels",
            Self::Pixels { fault: PixelFault::Stuck { .. }, .. } => "stuck_pixels",
            Self::Protons(_) => "proton_storm",
        }
    }

    /// The flag it sets in the frames it hits.
    #[must_use]
    pub fn flag(self) -> FaultFlags {
        match self {
            Self::Drop => FaultFlags::FRAME_DROP,
            Self::Duplicate => FaultFlags::FRAME_DUPLICATE,
            Self::Late(_) => FaultFlags::FRAME_LATE,
            Self::Torn => FaultFlags::FRAME_TORN,
            Self::Blank => FaultFlags::BLANK,
            Self::BitFlip { .. } => FaultFlags::FRAME_BIT_FLIP,
            Self::StrayLight { .. } | Self::StrayLightRamp { .. } => FaultFlags::STRAY_LIGHT,
            Self::Defocus { .. } => FaultFlags::DEFOCUS,
            Self::Contamination { .. } => FaultFlags::CONTAMINATION,
            Self::TemperatureStep { .. } => FaultFlags::TEMPERATURE,
            Self::Saturation { .. } => FaultFlags::SATURATION,
            Self::FalseStars { .. } => FaultFlags::FALSE_STARS,
            Self::MissingStars { .. } | Self::MissingBrightStars { .. } => FaultFlags::MISSING_STARS,
            Self::Pixels { fault: PixelFault::Hot { .. }, .. } => FaultFlags::HOT_PIXELS,
            Self::Pixels { fault: PixelFault::Dead { .. }, .. } => FaultFlags::DEAD_PIXELS,
            Self::Pixels { fault: PixelFault::Rts { .. }, .. } => FaultFlags::RTS_PIXELS,
            Self::Pixels { fault: PixelFault::Stuck { .. }, .. } => FaultFlags::STUCK_PIXELS,
            Self::Protons(_) => FaultFlags::PROTON_TRACKS,
        }
    }

    /// How much of it a frame has when `share` of its time is over.
    #[must_use]
    pub fn amount(self, share: f64) -> Amount {
        let between = |from: f64, to: f64| from + (to - from) * share;
        let (value, unit) = match self {
            Self::Drop | Self::Duplicate | Self::Torn | Self::Blank => (1.0, "frame"),
            Self::Late(by) => (by.ms(), "ms"),
            Self::BitFlip { bit, .. } => (f64::from(bit), "bit"),
            Self::StrayLight { e_per_s } => (e_per_s, "e-/s"),
            Self::StrayLightRamp { from_e_per_s, to_e_per_s } => (between(from_e_per_s, to_e_per_s), "e-/s"),
            Self::Defocus { sigma_px } => (sigma_px, "px sigma"),
            Self::Contamination { from_share, to_share } => (between(from_share, to_share), "of the light"),
            Self::TemperatureStep { by_k } => (by_k, "K"),
            Self::Saturation { full_wells } => (full_wells, "full wells"),
            Self::FalseStars { mag, .. } => (mag, "mag"),
            Self::MissingStars { share } => (share, "of the stars"),
            Self::MissingBrightStars { count } => (f64::from(count), "stars"),
            Self::Pixels { fault, .. } => match fault {
                PixelFault::Hot { e_per_s } | PixelFault::Rts { e_per_s, .. } => (e_per_s, "e-/s"),
                PixelFault::Dead { response } => (response, "of the light"),
                PixelFault::Stuck { dn } => (f64::from(dn), "DN"),
            },
            Self::Protons(storm) => (storm.per_cm2_s, "per cm2 and s"),
        };
        Amount { value, unit }
    }
}
