//! The ways in which a frame, or the chain that images it, can be spoilt on purpose, and all that is said of each.
//!
//! The word, the flag, the amount and the pixels of a fault are here; `run::runtime` does it, files name it.

use crate::sink::fault_pixels::{DefectSpots, FaultPixels};
use base::time::Span;
use core::fmt;
use core::ops::{BitOr, BitOrAssign};
/// Makes the constants and the names of a list of flags.
macro_rules! flags {
    ($($(#[$doc:meta])* $constant:ident = $bit:literal, $name:literal;)*) => {
        impl FaultFlags {
            $($(#[$doc])* pub const $constant: Self = Self::from_bits(1 << $bit);)*

            /// Every fault there is, with its name in files, by bit.
            pub const NAMED: &'static [(Self, &'static str)] = &[$((Self::$constant, $name)),*];
        }
    };
}

/// The unit of faults that take a whole frame: there is no more or less of them.
const WHOLE: &str = "frame";

/// Image on which the pixels of a fault are counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelsOf {
    /// The detector.
    Detector,
    /// The images that are sent.
    Images,
}

/// Fault of defective pixels.
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
        /// The digital number.
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

/// Fault of a frame, by what it changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FrameFault {
    /// When or how often an image is sent, or which one: that needs a run.
    Sending(SendingFault),
    /// One image.
    Image(ImageFault),
    /// Detector or optics, for all images after it, until it is taken back.
    Camera(CameraFault),
}

/// Fault of the sending of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SendingFault {
    /// The frame is not sent.
    Drop,
    /// The previous image in place of this one.
    Duplicate,
    /// Sent late by this.
    Late(Span),
    /// The upper half is the previous frame's.
    Torn,
}

/// Fault of one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ImageFault {
    /// Every pixel reads the black level: no light.
    Blank,
    /// One bit of some pixels' numbers is the other way, new pixels at random in every frame.
    BitFlip {
        /// Number of the bit, from 0.
        bit: u8,
        /// Pixels of the fault.
        pixels: FaultPixels,
    },
    /// Uniform stray light, electrons per second and pixel.
    StrayLight {
        /// e-/s in every pixel.
        e_per_s: f64,
    },
    /// Uniform stray light that changes evenly while it lasts.
    StrayLightRamp {
        /// e-/s in every pixel at the start.
        from_e_per_s: f64,
        /// And at the end.
        to_e_per_s: f64,
    },
    /// Only a share of the light of stars, targets and sky comes through; it changes evenly while it lasts.
    Contamination {
        /// Share at the start.
        from_share: f64,
        /// And at the end.
        to_share: f64,
    },
    /// The detector is warmer, and its dark current larger.
    TemperatureStep {
        /// Step, K.
        by_k: f64,
    },
    /// Light floods every pixel.
    Saturation {
        /// Light in each exposure, full wells.
        full_wells: f64,
    },
    /// Stars that are in no catalog, in the same places while it lasts.
    FalseStars {
        /// Places of the stars.
        pixels: FaultPixels,
        /// Their magnitude in the instrument's band.
        mag: f64,
    },
    /// Catalog stars are left out, the same ones while it lasts.
    MissingStars {
        /// Share of stars that are left out.
        share: f64,
    },
    /// The brightest catalog stars on the detector are left out.
    MissingBrightStars {
        /// Number of stars.
        count: u32,
    },
    /// Tracks of protons.
    Protons(ProtonStorm),
}

/// Fault of the detector or the optics.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CameraFault {
    /// The point-spread function is another one, a Gaussian.
    Defocus {
        /// Its sigma, px.
        sigma_px: f64,
    },
    /// Pixels with a defect.
    Pixels {
        /// Pixels with the defect.
        spots: DefectSpots,
        /// Fault of these pixels.
        fault: PixelFault,
    },
}

flags! {
    /// Messages lost on the link.
    LINK_DROP = 0, "link_drop";
    /// Messages repeated on the link.
    LINK_DUPLICATE = 1, "link_duplicate";
    /// Messages delayed on the link.
    LINK_DELAY = 2, "link_delay";
    /// Messages out of order on the link.
    LINK_REORDER = 3, "link_reorder";
    /// Messages with wrong bits or a wrong CRC on the link.
    LINK_CORRUPT = 4, "link_corrupt";
    /// An attitude stream that repeats an old value or stops.
    LINK_STALE = 5, "link_stale";
    /// A step of a clock.
    CLOCK_STEP = 6, "clock_step";
    /// A quaternion that is not finite or not of unit norm.
    BAD_QUATERNION = 7, "bad_quaternion";
    /// A frame withheld.
    FRAME_DROP = 8, "frame_drop";
    /// A frame sent twice.
    FRAME_DUPLICATE = 9, "frame_duplicate";
    /// A frame sent late on purpose.
    FRAME_LATE = 10, "frame_late";
    /// A frame made of two.
    FRAME_TORN = 11, "frame_torn";
    /// Pixels that do not respond.
    DEAD_PIXELS = 12, "dead_pixels";
    /// Pixels with excess dark signal.
    HOT_PIXELS = 13, "hot_pixels";
    /// Pixels with random telegraph signal.
    RTS_PIXELS = 14, "rts_pixels";
    /// Stars that are in no catalog.
    FALSE_STARS = 15, "false_stars";
    /// Catalog stars left out.
    MISSING_STARS = 16, "missing_stars";
    /// Tracks of energetic protons.
    PROTON_TRACKS = 17, "proton_tracks";
    /// Stray light beyond the scene's own.
    STRAY_LIGHT = 18, "stray_light";
    /// A blank image in place of the scene.
    BLANK = 19, "blank";
    /// Packets of nonsense on the link.
    LINK_BABBLE = 20, "link_babble";
    /// The controller off the bus.
    LINK_OFF = 21, "link_off";
    /// A drift of a clock.
    CLOCK_DRIFT = 22, "clock_drift";
    /// Bits of pixels the other way.
    FRAME_BIT_FLIP = 23, "frame_bit_flip";
    /// Another point-spread function.
    DEFOCUS = 24, "defocus";
    /// Optics that let less light through.
    CONTAMINATION = 25, "contamination";
    /// A detector at another temperature.
    TEMPERATURE = 26, "temperature";
    /// Pixels flooded with light.
    SATURATION = 27, "saturation";
    /// Pixels that always read the same number.
    STUCK_PIXELS = 28, "stuck_pixels";
}

/// The facts of a fault: its word in files, its flag, and its size at the start and at the end.
struct Facts(&'static str, FaultFlags, [f64; 2], &'static str);

impl FrameFault {
    fn facts(self) -> Facts {
        use FaultFlags as Flag;
        let whole = |word, flag| Facts(word, flag, [1.0; 2], WHOLE);
        let steady = |word, flag, amount, unit| Facts(word, flag, [amount; 2], unit);
        match self {
            Self::Sending(fault) => match fault {
                SendingFault::Drop => whole("frame_drop", Flag::FRAME_DROP),
                SendingFault::Duplicate => whole("frame_duplicate", Flag::FRAME_DUPLICATE),
                SendingFault::Late(by) => steady("frame_late", Flag::FRAME_LATE, by.ms(), "ms"),
                SendingFault::Torn => whole("frame_torn", Flag::FRAME_TORN),
            },
            Self::Image(fault) => match fault {
                ImageFault::Blank => whole("frame_blank", Flag::BLANK),
                ImageFault::BitFlip { bit, .. } => {
                    steady("frame_bit_flip", Flag::FRAME_BIT_FLIP, f64::from(bit), "bit")
                }
                ImageFault::StrayLight { e_per_s } => steady("stray_light", Flag::STRAY_LIGHT, e_per_s, "e-/s"),
                ImageFault::StrayLightRamp { from_e_per_s, to_e_per_s } => {
                    Facts("stray_light_ramp", Flag::STRAY_LIGHT, [from_e_per_s, to_e_per_s], "e-/s")
                }
                ImageFault::Contamination { from_share, to_share } => {
                    Facts("contamination", Flag::CONTAMINATION, [from_share, to_share], "of the light")
                }
                ImageFault::TemperatureStep { by_k } => steady("temperature_step", Flag::TEMPERATURE, by_k, "K"),
                ImageFault::Saturation { full_wells } => {
                    steady("saturation", Flag::SATURATION, full_wells, "full wells")
                }
                ImageFault::FalseStars { mag, .. } => steady("false_stars", Flag::FALSE_STARS, mag, "mag"),
                ImageFault::MissingStars { share } => {
                    steady("missing_stars", Flag::MISSING_STARS, share, "of the stars")
                }
                ImageFault::MissingBrightStars { count } => {
                    steady("missing_bright_stars", Flag::MISSING_STARS, f64::from(count), "stars")
                }
                ImageFault::Protons(storm) => {
                    steady("proton_storm", Flag::PROTON_TRACKS, storm.per_cm2_s, "per cm2 and s")
                }
            },
            Self::Camera(CameraFault::Defocus { sigma_px }) => {
                steady("defocus_step", Flag::DEFOCUS, sigma_px, "px sigma")
            }
            Self::Camera(CameraFault::Pixels { fault, .. }) => match fault {
                PixelFault::Hot { e_per_s } => steady("hot_pixels", Flag::HOT_PIXELS, e_per_s, "e-/s"),
                PixelFault::Dead { response } => steady("dead_pixels", Flag::DEAD_PIXELS, response, "of the light"),
                PixelFault::Rts { e_per_s, .. } => steady("rts_pixels", Flag::RTS_PIXELS, e_per_s, "e-/s"),
                PixelFault::Stuck { dn } => steady("stuck_pixels", Flag::STUCK_PIXELS, f64::from(dn), "DN"),
            },
        }
    }

    /// Returns its word in files.
    pub fn name(self) -> &'static str {
        self.facts().0
    }

    /// Returns the flag it sets in the frames it hits.
    pub fn flag(self) -> FaultFlags {
        self.facts().1
    }

    /// Returns how much of it a frame has when `share` of its time is over.
    pub fn amount(self, share: f64) -> Amount {
        let Facts(_, _, [from, to], unit) = self.facts();
        let value = if from == to { from } else { from + (to - from) * share };
        Amount { value, unit }
    }

    /// Returns the pixels that it names, and the image on which they are counted.
    pub fn spots(self) -> Option<(PixelsOf, DefectSpots)> {
        match self {
            Self::Image(ImageFault::BitFlip { pixels, .. }) => Some((PixelsOf::Images, pixels.into())),
            Self::Image(ImageFault::FalseStars { pixels, .. }) => Some((PixelsOf::Detector, pixels.into())),
            Self::Camera(CameraFault::Pixels { spots, .. }) => Some((PixelsOf::Detector, spots)),
            Self::Sending(_) | Self::Image(_) | Self::Camera(_) => None,
        }
    }
}

impl fmt::Display for FrameFault {
    /// Returns how much of it there is, from begin to end; nothing when it takes a whole frame.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Facts(_, _, [from, to], unit) = self.facts();
        match unit {
            WHOLE => Ok(()),
            unit if from == to => write!(f, "{from} {unit}"),
            unit => write!(f, "{from} to {to} {unit}"),
        }
    }
}

// Which commanded faults were active in a frame: a small set in one word; the list of the flags is in `frame_fault`.

/// Set of faults.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct FaultFlags(u32);

impl FaultFlags {
    /// No fault.
    pub const NONE: Self = Self(0);

    /// Returns the set as a word, for files and the wire.
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// Returns the set from a word; bits without a name are kept.
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// Returns whether no fault is in the set.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Returns whether every fault of `other` is in the set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Returns the names in the set, by bit.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Self::NAMED.iter().filter(move |(fault, _)| self.contains(*fault)).map(|&(_, name)| name)
    }
}

impl BitOr for FaultFlags {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitOrAssign for FaultFlags {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

impl fmt::Display for FaultFlags {
    /// Writes `none`, or the names joined by `+`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_empty() {
            return f.write_str("none");
        }
        for (i, name) in self.names().enumerate() {
            write!(f, "{}{name}", if i == 0 { "" } else { "+" })?;
        }
        Ok(())
    }
}

// Which commanded faults a frame was made under, with their numbers: part of its truth.
//
// A list of fixed length, so that frames travel without allocation; faults that do not fit are counted.

/// Faults of one frame that are named; more are counted.
pub const NAMED_FAULTS: usize = 12;

/// A number with its unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Amount {
    /// The number.
    pub value: f64,
    /// Its unit.
    pub unit: &'static str,
}

/// A fault as it acts on one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActiveFault {
    /// Its word in files.
    pub name: &'static str,
    /// Its number in the run's list of faults, from 1.
    pub number: u16,
    /// Size of the fault.
    pub amount: Amount,
}

impl ActiveFault {
    const NONE: Self = Self { name: "", number: 0, amount: Amount { value: 0.0, unit: "" } };
}

impl fmt::Display for ActiveFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}#{}={} {}", self.name, self.number, self.amount.value, self.amount.unit)
    }
}

/// The faults of one frame, in the order of their numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActiveFaults {
    list: [ActiveFault; NAMED_FAULTS],
    count: usize,
}

impl ActiveFaults {
    /// No fault.
    pub const NONE: Self = Self { list: [ActiveFault::NONE; NAMED_FAULTS], count: 0 };

    /// Adds one.
    pub fn push(&mut self, fault: ActiveFault) {
        if let Some(place) = self.list.get_mut(self.count) {
            *place = fault;
        }
        self.count += 1;
    }

    /// Returns the faults that are named.
    pub fn named(&self) -> &[ActiveFault] {
        &self.list[..self.count.min(NAMED_FAULTS)]
    }

    /// Returns how many there are, named or not.
    pub fn count(&self) -> usize {
        self.count
    }
}

impl Default for ActiveFaults {
    fn default() -> Self {
        Self::NONE
    }
}

impl fmt::Display for ActiveFaults {
    /// Writes `none`, or faults joined by `; `, and how many more.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.count == 0 {
            return f.write_str("none");
        }
        for (i, fault) in self.named().iter().enumerate() {
            write!(f, "{}{fault}", if i == 0 { "" } else { "; " })?;
        }
        match self.count.checked_sub(NAMED_FAULTS).filter(|more| *more > 0) {
            Some(more) => write!(f, "; {more} more"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_has_the_amount_and_how_it_changes() {
        let pixels = FaultPixels { at: Some([3, 4]), random: 0 };
        for (fault, wanted) in [
            (FrameFault::Sending(SendingFault::Torn), ""),
            (FrameFault::Sending(SendingFault::Late(Span::from_ms(300))), "300 ms"),
            (FrameFault::Image(ImageFault::FalseStars { pixels, mag: 4.5 }), "4.5 mag"),
            (FrameFault::Image(ImageFault::Contamination { from_share: 0.8, to_share: 0.8 }), "0.8 of the light"),
            (
                FrameFault::Image(ImageFault::Contamination { from_share: 0.8, to_share: 0.4 }),
                "0.8 to 0.4 of the light",
            ),
        ] {
            assert_eq!(fault.to_string(), wanted);
        }
    }

    #[test]
    fn pixels_are_counted_on_images_or_on_the_detector() {
        let pixels = FaultPixels { at: Some([3, 4]), random: 0 };
        let of = |fault: FrameFault| fault.spots().map(|(of, spots)| (of, spots.to_string()));
        assert_eq!(
            of(FrameFault::Image(ImageFault::BitFlip { bit: 1, pixels })),
            Some((PixelsOf::Images, "px = [3, 4]".to_owned()))
        );
        let stars = FrameFault::Image(ImageFault::FalseStars { pixels, mag: 4.5 });
        assert_eq!(of(stars), Some((PixelsOf::Detector, "px = [3, 4]".to_owned())));
        assert_eq!(of(FrameFault::Image(ImageFault::Blank)), None);
    }
}

#[cfg(test)]
mod faults_tests {
    use super::*;

    #[test]
    fn bits_and_names_are_unique_and_found_again() {
        let mut all = FaultFlags::NONE;
        for &(fault, name) in FaultFlags::NAMED {
            assert!(!all.contains(fault), "{name} shares a bit");
            assert_eq!(fault.names().collect::<Vec<_>>(), [name]);
            all |= fault;
        }
        assert_eq!(all.names().count(), FaultFlags::NAMED.len());
    }

    #[test]
    fn text_names_what_is_active() {
        assert_eq!(FaultFlags::NONE.to_string(), "none");
        assert_eq!((FaultFlags::HOT_PIXELS | FaultFlags::LINK_DROP).to_string(), "link_drop+hot_pixels");
    }
}

#[cfg(test)]
mod active_fault_tests {
    use super::*;

    #[test]
    fn faults_are_named_with_their_numbers_and_none_is_lost() {
        let mut active = ActiveFaults::NONE;
        assert_eq!((active.to_string().as_str(), active.count()), ("none", 0));
        let fault = |number| ActiveFault { name: "stray_light", number, amount: Amount { value: 2.5e4, unit: "e-/s" } };
        active.push(fault(1));
        active.push(fault(7));
        assert_eq!(active.to_string(), "stray_light#1=25000 e-/s; stray_light#7=25000 e-/s");
        for number in 8..30 {
            active.push(fault(number));
        }
        assert_eq!((active.named().len(), active.count()), (NAMED_FAULTS, 24));
        assert!(active.to_string().ends_with("; 12 more"), "{active}");
    }
}
