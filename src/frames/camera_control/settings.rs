//! The settings of one exposure, and the triggers of exposures. Names and meanings: GenICam SFNC 2.7.1.

use base::{region::Regions, time::Span};

/// The settings of one exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraSettings {
    /// Integration time.
    pub exposure: Span,
    /// Gain beyond that of the camera's file, dB: `DN = e / gain_e_per_dn * 10^(gain_db / 20)`.
    pub gain_db: f64,
    /// Black level of a pixel, DN.
    pub black_level_dn: f64,
    /// Parts of the image that are read out; none: all of it.
    pub regions: Regions,
}

impl CameraSettings {
    /// Returns the factor of the numbers of an image by its gain.
    pub fn gain_factor(&self) -> f64 {
        if self.gain_db == 0.0 { 1.0 } else { 10_f64.powf(self.gain_db / 20.0) }
    }
}

/// Source of a trigger.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TriggerSource {
    /// A command of a GenICam client.
    Software,
    /// An action command of GigE Vision, at once or scheduled.
    Action,
    /// A message of the flight computer on the bus.
    Bus,
    /// An edge of a line of this machine.
    Line,
    /// The control socket.
    Control,
}

impl TriggerSource {
    /// Every source, with its name in files and messages.
    pub const NAMED: [(&'static str, Self); 5] = [
        ("software", Self::Software),
        ("action", Self::Action),
        ("bus", Self::Bus),
        ("line", Self::Line),
        ("control", Self::Control),
    ];

    /// Returns its name in files and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Software => "software",
            Self::Action => "action",
            Self::Bus => "bus",
            Self::Line => "line",
            Self::Control => "control",
        }
    }

    const fn bit(self) -> u8 {
        match self {
            Self::Software => 1,
            Self::Action => 2,
            Self::Bus => 4,
            Self::Line => 8,
            Self::Control => 16,
        }
    }
}

/// A set of trigger sources.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TriggerSources(u8);

impl TriggerSources {
    /// Every source starts exposures.
    pub const ALL: Self = Self(31);

    /// Returns the set of one source.
    pub const fn only(source: TriggerSource) -> Self {
        Self(source.bit())
    }

    /// Returns true when triggers of this source start exposures.
    pub const fn has(self, source: TriggerSource) -> bool {
        self.0 & source.bit() != 0
    }
}

/// When a trigger is accepted while the frame before is not over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TriggerOverlap {
    /// After the readout of the frame before.
    Off,
    /// From the end of its exposure on, while it is read out.
    ReadOut,
    /// At any time during it: the trigger is kept and acts when its exposure has ended. One is kept.
    PreviousFrame,
}

/// Rule for the length of an exposure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExposureMode {
    /// By the exposure time.
    Timed,
    /// By the time for which the trigger's line is active.
    TriggerWidth,
}

/// Mode of a setting that a camera can choose for itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AutoMode {
    /// The client.
    Off,
    /// The camera, until the image is as bright as wanted.
    Once,
    /// The camera, always.
    Continuous,
}

/// Settings of the start of exposures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StartSettings {
    /// Exposures wait for triggers; otherwise they follow each other at the frame rate.
    pub is_triggered: bool,
    /// The triggers that count.
    pub sources: TriggerSources,
    /// From a trigger to the start of the exposure.
    pub delay: Span,
    /// When triggers are accepted.
    pub overlap: TriggerOverlap,
    /// Exposures of one trigger.
    pub burst: u32,
    /// Rule for the length of an exposure.
    pub mode: ExposureMode,
    /// From one exposure's start to the next when free running, at least; `None`: as fast as exposure and readout
    /// allow.
    pub period: Option<Span>,
}

impl StartSettings {
    /// Returns those of a camera that runs free with this period: triggers of every source count once it waits for
    /// them.
    pub const fn free_running(period: Span) -> Self {
        Self {
            is_triggered: false,
            sources: TriggerSources::ALL,
            delay: Span::ZERO,
            overlap: TriggerOverlap::ReadOut,
            burst: 1,
            mode: ExposureMode::Timed,
            period: Some(period),
        }
    }
}
