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

/// Every word for `do`, and what it is.
pub(super) const ACTIONS: [(&str, Kind); 42] = [
    ("slew", Kind::Slew),
    ("safe", Kind::Safe),
    ("resume", Kind::Resume),
    ("bus_loss", Kind::BusLoss),
    ("bus_silence", Kind::BusSilence),
    ("bus_delay", Kind::BusDelay),
    ("bus_duplicate", Kind::BusDuplicate),
    ("bus_wrong_bits", Kind::BusWrongBits),
    ("bus_reorder", Kind::BusReorder),
    ("bus_truncate", Kind::BusTruncate),
    ("bus_babble", Kind::BusBabble),
    ("bus_off", Kind::BusOff),
    ("clock_step", Kind::ClockStep),
    ("clock_drift", Kind::ClockDrift),
    ("bus_back_loss", Kind::BusBackLoss),
    ("frame_drop", Kind::FrameDrop),
    ("frame_duplicate", Kind::FrameDuplicate),
    ("frame_late", Kind::FrameLate),
    ("frame_torn", Kind::FrameTorn),
    ("frame_blank", Kind::FrameBlank),
    ("frame_bit_flip", Kind::BitFlip),
    ("stray_light", Kind::StrayLight),
    ("stray_light_ramp", Kind::StrayLightRamp),
    ("defocus_step", Kind::Defocus),
    ("contamination", Kind::Contamination),
    ("temperature_step", Kind::TemperatureStep),
    ("saturation", Kind::Saturation),
    ("false_stars", Kind::FalseStars),
    ("missing_stars", Kind::MissingStars),
    ("missing_bright_stars", Kind::MissingBrightStars),
    ("hot_pixels", Kind::HotPixels),
    ("dead_pixels", Kind::DeadPixels),
    ("rts_pixels", Kind::RtsPixels),
    ("stuck_pixels", Kind::StuckPixels),
    ("proton_storm", Kind::ProtonStorm),
    ("gyro_dropout", Kind::GyroDropout),
    ("gyro_stuck", Kind::GyroStuck),
    ("gyro_bias_jump", Kind::GyroBiasJump),
    ("gyro_spike", Kind::GyroSpike),
    ("wheel_failure", Kind::WheelFailure),
    ("tracker_off", Kind::TrackerOff),
    ("trigger", Kind::Trigger),
];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Slew,
    Safe,
    Resume,
    BusLoss,
    BusSilence,
    BusDelay,
    BusDuplicate,
    BusWrongBits,
    BusReorder,
    BusTruncate,
    BusBabble,
    BusOff,
    ClockStep,
    ClockDrift,
    BusBackLoss,
    FrameDrop,
    FrameDuplicate,
    FrameLate,
    FrameTorn,
    FrameBlank,
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
    HotPixels,
    DeadPixels,
    RtsPixels,
    StuckPixels,
    ProtonStorm,
    GyroDropout,
    GyroStuck,
    GyroBiasJump,
    GyroSpike,
    WheelFailure,
    TrackerOff,
    Trigger,
}

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
        self.has_key("head") && self != Self::TrackerOff
    }

    /// The keys that go with it beside `at_s` and `do`: those it needs, and those that may be left out.
    pub(super) fn keys(self) -> (&'static [&'static str], &'static [&'static str]) {
        match self {
            Self::Slew => (&["ra_deg", "dec_deg"], &["roll_deg"]),
            Self::Safe | Self::Resume => (&[], &[]),
            Self::BusLoss | Self::BusDuplicate | Self::BusWrongBits | Self::BusTruncate | Self::BusBackLoss => {
                (&["for_s", "share"], &[])
            }
            Self::BusReorder => (&["for_s", "share", "delay_ms"], &[]),
            Self::BusBabble => (&["for_s", "can_id", "period_ms"], &["bytes"]),
            Self::ClockStep => (&["for_s", "step_ms"], &[]),
            Self::ClockDrift => (&["for_s", "ppm"], &[]),
            Self::BusSilence | Self::BusOff | Self::GyroDropout | Self::GyroStuck => (&["for_s"], &[]),
            Self::BusDelay => (&["for_s", "delay_ms"], &["jitter_ms"]),
            Self::FrameDrop | Self::FrameDuplicate | Self::FrameTorn | Self::FrameBlank | Self::TrackerOff => {
                (&["for_s"], &["head"])
            }
            Self::FrameLate => (&["for_s", "late_ms"], &["head"]),
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
            Self::HotPixels => (&["for_s", "e_per_s"], &["px", "column", "row", "count", "head"]),
            Self::DeadPixels => (&["for_s"], &["response", "px", "column", "row", "count", "head"]),
            Self::RtsPixels => (&["for_s", "e_per_s"], &["high_s", "low_s", "px", "column", "row", "count", "head"]),
            Self::StuckPixels => (&["for_s", "dn"], &["px", "column", "row", "count", "head"]),
            Self::ProtonStorm => (&["for_s", "per_cm2_s", "energy_mev"], &["incidence_deg", "azimuth_deg", "head"]),
            Self::Trigger => (&["number"], &[]),
            Self::GyroBiasJump => (&["rate_deg_h"], &[]),
            Self::GyroSpike => (&["for_s", "rate_deg_h"], &[]),
            Self::WheelFailure => (&["wheel"], &[]),
        }
    }

    pub(super) fn has_key(self, name: &str) -> bool {
        let (needed, optional) = self.keys();
        needed.contains(&name) || optional.contains(&name)
    }
}
