//! The words of `[[event]]` and the keys that go with each.

use crate::key::section;
use crate::key_type::{Raw, Shape, Whole, Word};
use image::detector::protons::stopping_power::DOMAIN_MEV;

section! {
    /// A command to the flight computer, or a fault, at its time.
    EventKeys at "event" {
        /// What happens.
        r#do: Word<Kind> = Needed, ACTIONS;
        /// Seconds after the first exposure; after the trigger, when it waits for one.
        at_s: f64 = Optional, NotNegative;
        /// The first frame that it hits, from 0, in place of at_s.
        at_frame: Whole = Optional, 0..=1_000_000_000;
        /// The number of a trigger that it waits for, such as 1.
        on_trigger: Whole<u16> = Optional, 0..=65_535;
        /// How many seconds it lasts.
        for_s: f64 = Optional, Positive;
        /// How many frames it hits, in place of for_s.
        for_frames: Whole = Optional, 1..=1_000_000_000;
        /// Right ascension of the boresight to slew to, in degrees, not hours: 5h 30m is 82.5.
        ra_deg: f64 = Optional, Within(-360.0, 360.0);
        /// Declination of the boresight to slew to, degrees.
        dec_deg: f64 = Optional, Within(-90.0, 90.0);
        /// Position angle of the image's up direction after a slew, east of north, degrees.
        roll_deg: f64 = Silent(0.0), Within(-360.0, 360.0);
        /// A share of the packets, of missing_stars a share of the catalog's stars, 0 to 1.
        share: f64 = Optional, Within(0.0, 1.0);
        /// Milliseconds by which packets are late.
        delay_ms: f64 = Optional, Within(0.0, MOST_MS);
        /// Random part of the delay, milliseconds.
        jitter_ms: f64 = Silent(0.0), Within(0.0, MOST_MS);
        /// An identifier of 11 bits, such as 0x123; no use on serial.
        can_id: Whole<u16> = Optional, 0..=0x7FF, "an identifier of 11 bits, such as 0x123; no use on serial";
        /// Milliseconds from one packet to the next, such as 0.5.
        period_ms: f64 = Optional, Within(0.05, MOST_MS);
        /// Bytes of content, 8 if left out.
        bytes: Whole<u8> = Silent(8), 0..=64;
        /// Milliseconds by which a clock steps, below zero for a clock that falls behind.
        step_ms: f64 = Optional, Within(-MOST_MS, MOST_MS);
        /// Parts per million, below zero for a slow clock.
        ppm: f64 = Optional, Within(-10_000.0, 10_000.0);
        /// Milliseconds by which frames are late.
        late_ms: f64 = Optional, Within(0.0, MOST_MS);
        /// Electrons per second in every pixel, such as 200000.0; of a hot or blinking pixel what it has more.
        e_per_s: f64 = Optional, PositiveUpTo(1e12);
        /// Degrees per hour about the body axes, such as [5.0, 0.0, 0.0].
        rate_deg_h: [f64; 3] = Optional, Within(-1e6, 1e6);
        /// Which head, counted from 0; left out: all.
        head: Whole<usize> = Optional, 0..=15;
        /// Which wheel, counted from 0.
        wheel: Whole<usize> = Optional, 0..=15;
        /// The number of a trigger, such as 1.
        number: Whole<u16> = Optional, 0..=65_535;
        /// Which bit of the pixels' numbers, from 0.
        bit: Whole<u8> = Optional, 0..=15;
        /// Column and row, from 0, such as [100, 200].
        px: Raw<[i64; 2]> = Optional, Shape::Row(2, Box::new(Shape::Whole(0..=65_535)));
        /// How many at random, of missing_bright_stars how many of the brightest.
        count: Whole = Optional, 0..=1_000_000;
        /// Electrons per second in every pixel at the begin of a ramp, such as 200000.0.
        from_e_per_s: f64 = Optional, Within(0.0, 1e12);
        /// Electrons per second in every pixel at the end of a ramp, such as 200000.0.
        to_e_per_s: f64 = Optional, Within(0.0, 1e12);
        /// Sigma of the defocused, Gaussian spot, px.
        sigma_px: f64 = Optional, Within(0.2, 12.0);
        /// A share of the light, 0 to 1.
        throughput: f64 = Optional, Within(0.0, 1.0);
        /// The share of the light at the end of the event, 0 to 1; left out: as at the begin.
        to_throughput: f64 = Computed("throughput"), Within(0.0, 1.0);
        /// Kelvin by which the detector is warmer, below zero for colder.
        by_k: f64 = Optional, Within(-100.0, 100.0);
        /// Light in each exposure, full wells; 4 if left out.
        full_wells: f64 = Silent(4.0), PositiveUpTo(1e3);
        /// Magnitude in the instrument's band.
        mag: f64 = Optional, Within(-30.0, 40.0);
        /// Number of a column, from 0.
        column: Whole = Optional, 0..=65_535;
        /// Number of a row, from 0.
        row: Whole = Optional, 0..=65_535;
        /// A share of the light, 0 to 1, that a dead pixel still counts.
        response: f64 = Silent(0.0), Within(0.0, 1.0);
        /// Mean seconds at the high level; 1 if left out.
        high_s: f64 = Silent(1.0), Within(1e-3, 1e6);
        /// Mean seconds at the low level; 1 if left out.
        low_s: f64 = Silent(1.0), Within(1e-3, 1e6);
        /// The digital number that stuck pixels read.
        dn: Whole<u16> = Optional, 0..=65_535;
        /// Protons per square centimetre and second.
        per_cm2_s: f64 = Optional, PositiveUpTo(1e9);
        /// Energy of the protons in MeV.
        energy_mev: f64 = Optional, Within(DOMAIN_MEV[0], DOMAIN_MEV[1]);
        /// Degrees from the detector's normal: a beam from there; from all sides when neither angle is given.
        incidence_deg: f64 = Silent(0.0), Within(0.0, 89.9), BEAM;
        /// Degrees on the image from +x: a beam from there; from all sides when neither angle is given.
        azimuth_deg: f64 = Silent(0.0), Within(-360.0, 360.0), BEAM;
    }
}

const MOST_MS: f64 = 60_000.0;
const BEAM: &str = "degrees: a beam from there; from all sides when neither angle is given";

/// Keys that go with every word, as far as it lasts.
pub(super) const OF_ALL: [&str; 5] = ["do", "at_s", "at_frame", "on_trigger", "for_frames"];

impl EventKeys {
    /// The same, now when it says no other time.
    pub(super) fn begun_by(mut self, now_s: f64) -> Self {
        if self.at_frame.is_none() && self.on_trigger.is_none() {
            self.at_s.get_or_insert(now_s);
        }
        self
    }
}

/// Every word for `do` with its kind.
pub(super) const ACTIONS: [(&str, Kind); 42] = [
    ("slew", Kind::Slew),
    ("safe", Kind::Safe),
    ("resume", Kind::Resume),
    ("bus_loss", Kind::Bus(BusKind::Loss)),
    ("bus_silence", Kind::Bus(BusKind::Silence)),
    ("bus_delay", Kind::Bus(BusKind::Delay)),
    ("bus_duplicate", Kind::Bus(BusKind::Duplicate)),
    ("bus_wrong_bits", Kind::Bus(BusKind::WrongBits)),
    ("bus_reorder", Kind::Bus(BusKind::Reorder)),
    ("bus_truncate", Kind::Bus(BusKind::Truncate)),
    ("bus_babble", Kind::Bus(BusKind::Babble)),
    ("bus_off", Kind::Bus(BusKind::Off)),
    ("clock_step", Kind::Bus(BusKind::ClockStep)),
    ("clock_drift", Kind::Bus(BusKind::ClockDrift)),
    ("bus_back_loss", Kind::BusBackLoss),
    ("frame_drop", Kind::Frame(FrameKind::Drop)),
    ("frame_duplicate", Kind::Frame(FrameKind::Duplicate)),
    ("frame_late", Kind::Frame(FrameKind::Late)),
    ("frame_torn", Kind::Frame(FrameKind::Torn)),
    ("frame_blank", Kind::Frame(FrameKind::Blank)),
    ("frame_bit_flip", Kind::Frame(FrameKind::BitFlip)),
    ("stray_light", Kind::Frame(FrameKind::StrayLight)),
    ("stray_light_ramp", Kind::Frame(FrameKind::StrayLightRamp)),
    ("defocus_step", Kind::Frame(FrameKind::Defocus)),
    ("contamination", Kind::Frame(FrameKind::Contamination)),
    ("temperature_step", Kind::Frame(FrameKind::TemperatureStep)),
    ("saturation", Kind::Frame(FrameKind::Saturation)),
    ("false_stars", Kind::Frame(FrameKind::FalseStars)),
    ("missing_stars", Kind::Frame(FrameKind::MissingStars)),
    ("missing_bright_stars", Kind::Frame(FrameKind::MissingBrightStars)),
    ("hot_pixels", Kind::Frame(FrameKind::Pixels(PixelKind::Hot))),
    ("dead_pixels", Kind::Frame(FrameKind::Pixels(PixelKind::Dead))),
    ("rts_pixels", Kind::Frame(FrameKind::Pixels(PixelKind::Rts))),
    ("stuck_pixels", Kind::Frame(FrameKind::Pixels(PixelKind::Stuck))),
    ("proton_storm", Kind::Frame(FrameKind::ProtonStorm)),
    ("gyro_dropout", Kind::Gyro(GyroKind::Dropout)),
    ("gyro_stuck", Kind::Gyro(GyroKind::Stuck)),
    ("gyro_bias_jump", Kind::Gyro(GyroKind::BiasJump)),
    ("gyro_spike", Kind::Gyro(GyroKind::Spike)),
    ("wheel_failure", Kind::WheelFailure),
    ("tracker_off", Kind::TrackerOff),
    ("trigger", Kind::Trigger),
];

/// The kinds of events, in groups: each group is read by a function of its own, whose match has an arm for every kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Slew,
    Safe,
    Resume,
    Bus(BusKind),
    BusBackLoss,
    Frame(FrameKind),
    Gyro(GyroKind),
    WheelFailure,
    TrackerOff,
    Trigger,
}

/// Faults on the bus towards the stimulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum BusKind {
    Loss,
    Silence,
    Delay,
    Duplicate,
    WrongBits,
    Reorder,
    Truncate,
    Babble,
    Off,
    ClockStep,
    ClockDrift,
}

/// Faults of frames and of the imaging chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FrameKind {
    Drop,
    Duplicate,
    Late,
    Torn,
    Blank,
    BitFlip,
    StrayLight,
    StrayLightRamp,
    Defocus,
    Contamination,
    TemperatureStep,
    Saturation,
    FalseStars,
    MissingStars,
    MissingBrightStars,
    Pixels(PixelKind),
    ProtonStorm,
}

/// Defects of pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PixelKind {
    Hot,
    Dead,
    Rts,
    Stuck,
}

/// Faults of the gyro.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum GyroKind {
    Dropout,
    Stuck,
    BiasJump,
    Spike,
}

/// Keys that an event needs, and keys that may be left out.
type Keys = (&'static [&'static str], &'static [&'static str]);

/// The words whose kind is wanted, each in quotes.
pub(super) fn words(is_wanted: impl Fn(Kind) -> bool) -> String {
    let wanted = ACTIONS.iter().filter(|(_, kind)| is_wanted(*kind));
    wanted.map(|(word, _)| format!("\"{word}\"")).collect::<Vec<_>>().join(", ")
}

impl Kind {
    /// True for faults of frames and of the imaging chain, which may wait for a trigger.
    pub(super) fn is_of_frames(self) -> bool {
        matches!(self, Self::Frame(_))
    }

    /// The keys that go with it beside `at_s` and `do`: those it needs, and those that may be left out.
    pub(super) fn keys(self) -> Keys {
        match self {
            Self::Slew => (&["ra_deg", "dec_deg"], &["roll_deg"]),
            Self::Safe | Self::Resume => (&[], &[]),
            Self::Bus(kind) => kind.keys(),
            Self::BusBackLoss => (&["for_s", "share"], &[]),
            Self::Frame(kind) => kind.keys(),
            Self::Gyro(kind) => kind.keys(),
            Self::WheelFailure => (&["wheel"], &[]),
            Self::TrackerOff => (&["for_s"], &["head"]),
            Self::Trigger => (&["number"], &[]),
        }
    }

    pub(super) fn has_key(self, name: &str) -> bool {
        let (needed, optional) = self.keys();
        needed.contains(&name) || optional.contains(&name)
    }
}

impl BusKind {
    fn keys(self) -> Keys {
        match self {
            Self::Loss | Self::Duplicate | Self::WrongBits | Self::Truncate => (&["for_s", "share"], &[]),
            Self::Silence | Self::Off => (&["for_s"], &[]),
            Self::Delay => (&["for_s", "delay_ms"], &["jitter_ms"]),
            Self::Reorder => (&["for_s", "share", "delay_ms"], &[]),
            Self::Babble => (&["for_s", "can_id", "period_ms"], &["bytes"]),
            Self::ClockStep => (&["for_s", "step_ms"], &[]),
            Self::ClockDrift => (&["for_s", "ppm"], &[]),
        }
    }
}

impl FrameKind {
    fn keys(self) -> Keys {
        match self {
            Self::Drop | Self::Duplicate | Self::Torn | Self::Blank => (&["for_s"], &["head"]),
            Self::Late => (&["for_s", "late_ms"], &["head"]),
            Self::BitFlip => (&["for_s", "bit"], &["px", "count", "head"]),
            Self::StrayLight => (&["for_s", "e_per_s"], &["head"]),
            Self::StrayLightRamp => (&["for_s", "from_e_per_s", "to_e_per_s"], &["head"]),
            Self::Defocus => (&["for_s", "sigma_px"], &["head"]),
            Self::Contamination => (&["for_s", "throughput"], &["to_throughput", "head"]),
            Self::TemperatureStep => (&["for_s", "by_k"], &["head"]),
            Self::Saturation => (&["for_s"], &["full_wells", "head"]),
            Self::FalseStars => (&["for_s", "mag"], &["px", "count", "head"]),
            Self::MissingStars => (&["for_s", "share"], &["head"]),
            Self::MissingBrightStars => (&["for_s", "count"], &["head"]),
            Self::Pixels(kind) => kind.keys(),
            Self::ProtonStorm => (&["for_s", "per_cm2_s", "energy_mev"], &["incidence_deg", "azimuth_deg", "head"]),
        }
    }
}

impl PixelKind {
    fn keys(self) -> Keys {
        match self {
            Self::Hot => (&["for_s", "e_per_s"], &["px", "column", "row", "count", "head"]),
            Self::Dead => (&["for_s"], &["response", "px", "column", "row", "count", "head"]),
            Self::Rts => (&["for_s", "e_per_s"], &["high_s", "low_s", "px", "column", "row", "count", "head"]),
            Self::Stuck => (&["for_s", "dn"], &["px", "column", "row", "count", "head"]),
        }
    }
}

impl GyroKind {
    fn keys(self) -> Keys {
        match self {
            Self::Dropout | Self::Stuck => (&["for_s"], &[]),
            Self::BiasJump => (&["rate_deg_h"], &[]),
            Self::Spike => (&["for_s", "rate_deg_h"], &[]),
        }
    }
}
