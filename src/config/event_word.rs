//! The words of `[[event]]` and the keys that go with each.

use serde::Deserialize;

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct EventKeys {
    pub(super) at_s: Option<f64>,
    pub(super) at_frame: Option<i64>,
    pub(super) on_trigger: Option<i64>,
    pub(super) for_s: Option<f64>,
    pub(super) for_frames: Option<i64>,
    #[serde(rename = "do")]
    pub(super) action: Option<String>,
    pub(super) ra_deg: Option<f64>,
    pub(super) dec_deg: Option<f64>,
    pub(super) roll_deg: Option<f64>,
    pub(super) share: Option<f64>,
    pub(super) delay_ms: Option<f64>,
    pub(super) jitter_ms: Option<f64>,
    pub(super) can_id: Option<i64>,
    pub(super) period_ms: Option<f64>,
    pub(super) bytes: Option<i64>,
    pub(super) step_ms: Option<f64>,
    pub(super) ppm: Option<f64>,
    pub(super) late_ms: Option<f64>,
    pub(super) e_per_s: Option<f64>,
    pub(super) rate_deg_h: Option<[f64; 3]>,
    pub(super) head: Option<i64>,
    pub(super) wheel: Option<i64>,
    pub(super) number: Option<i64>,
    pub(super) bit: Option<i64>,
    pub(super) px: Option<[i64; 2]>,
    pub(super) count: Option<i64>,
    pub(super) from_e_per_s: Option<f64>,
    pub(super) to_e_per_s: Option<f64>,
    pub(super) sigma_px: Option<f64>,
    pub(super) throughput: Option<f64>,
    pub(super) to_throughput: Option<f64>,
    pub(super) by_k: Option<f64>,
    pub(super) full_wells: Option<f64>,
    pub(super) mag: Option<f64>,
    pub(super) column: Option<i64>,
    pub(super) row: Option<i64>,
    pub(super) response: Option<f64>,
    pub(super) high_s: Option<f64>,
    pub(super) low_s: Option<f64>,
    pub(super) dn: Option<i64>,
    pub(super) per_cm2_s: Option<f64>,
    pub(super) energy_mev: Option<f64>,
    pub(super) incidence_deg: Option<f64>,
    pub(super) azimuth_deg: Option<f64>,
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

impl EventKeys {
    /// Every key that belongs to some words only, and whether it is given.
    pub(super) fn given(&self) -> [(&'static str, bool); 39] {
        [
            ("for_s", self.for_s.is_some()),
            ("ra_deg", self.ra_deg.is_some()),
            ("dec_deg", self.dec_deg.is_some()),
            ("roll_deg", self.roll_deg.is_some()),
            ("share", self.share.is_some()),
            ("delay_ms", self.delay_ms.is_some()),
            ("jitter_ms", self.jitter_ms.is_some()),
            ("can_id", self.can_id.is_some()),
            ("period_ms", self.period_ms.is_some()),
            ("bytes", self.bytes.is_some()),
            ("step_ms", self.step_ms.is_some()),
            ("ppm", self.ppm.is_some()),
            ("late_ms", self.late_ms.is_some()),
            ("e_per_s", self.e_per_s.is_some()),
            ("rate_deg_h", self.rate_deg_h.is_some()),
            ("head", self.head.is_some()),
            ("wheel", self.wheel.is_some()),
            ("number", self.number.is_some()),
            ("bit", self.bit.is_some()),
            ("px", self.px.is_some()),
            ("count", self.count.is_some()),
            ("from_e_per_s", self.from_e_per_s.is_some()),
            ("to_e_per_s", self.to_e_per_s.is_some()),
            ("sigma_px", self.sigma_px.is_some()),
            ("throughput", self.throughput.is_some()),
            ("to_throughput", self.to_throughput.is_some()),
            ("by_k", self.by_k.is_some()),
            ("full_wells", self.full_wells.is_some()),
            ("mag", self.mag.is_some()),
            ("column", self.column.is_some()),
            ("row", self.row.is_some()),
            ("response", self.response.is_some()),
            ("high_s", self.high_s.is_some()),
            ("low_s", self.low_s.is_some()),
            ("dn", self.dn.is_some()),
            ("per_cm2_s", self.per_cm2_s.is_some()),
            ("energy_mev", self.energy_mev.is_some()),
            ("incidence_deg", self.incidence_deg.is_some()),
            ("azimuth_deg", self.azimuth_deg.is_some()),
        ]
    }
}

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
