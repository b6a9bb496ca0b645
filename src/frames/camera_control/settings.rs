//! The settings of one exposure, and the triggers of exposures. Names and meanings: GenICam SFNC 2.7.1.

use base::region::Regions;
use base::time::{Span, Tai};

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

base::words! {
    /// Source of a trigger.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum TriggerSource {
        /// A command of a GenICam client.
        Software = "software",
        /// An action command of GigE Vision, at once or scheduled.
        Action = "action",
        /// A message of the flight computer on the bus.
        Bus = "bus",
        /// An edge of a line of this machine.
        Line = "line",
        /// The control socket.
        Control = "control",
    }
}

impl TriggerSource {
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

// Allowed values of the settings of a camera.

/// Shortest integration time that a command may ask for.
pub const EXPOSURE_LEAST: Span = Span::from_ns(10_000);
/// Largest gain beyond that of the camera's file, dB: that of usual CMOS cameras.
pub const GAIN_MAX_DB: f64 = 48.0;

/// Returns the longest integration time that a command may ask of a camera with such an own one, s.
pub fn longest_exposure_s(own_s: f64) -> f64 {
    own_s.max(1.0)
}

/// Limits of the settings of one camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraRange {
    /// Shortest and longest integration time.
    pub exposure: [Span; 2],
    /// Least and largest gain beyond that of the camera's file, dB.
    pub gain_db: [f64; 2],
    /// Least and largest black level, DN.
    pub black_level_dn: [f64; 2],
    /// Highest frame rate, Hz: by the readout time.
    pub frame_rate_max_hz: f64,
    /// Longest delay from a trigger to the exposure.
    pub delay_max: Span,
    /// Columns and rows of the image.
    pub size_px: [usize; 2],
}

/// Why a camera does not take a setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SettingRefusal {
    /// A number is not finite, or outside the range of the camera.
    #[error("outside the range of the camera")]
    OutOfRange,
    /// A region is not on the sensor, or there are too many.
    #[error("a region outside the image, or too many regions")]
    Region,
    /// This camera does not have the setting of the command.
    #[error("this camera cannot do that")]
    Unsupported,
    /// Too many commands wait.
    #[error("too many commands wait for an exposure")]
    TooMany,
}

impl CameraRange {
    /// Returns this range, which is that of the whole image, as it is when these regions are read out: fewer rows leave
    /// time for more frames.
    #[must_use]
    pub fn reading(mut self, regions: &Regions) -> Self {
        let rows = [self.size_px[1], regions.rows(self.size_px)].map(|rows| rows.max(1) as f64);
        self.frame_rate_max_hz = (self.frame_rate_max_hz * rows[0] / rows[1]).min(1.0 / EXPOSURE_LEAST.s());
        self
    }

    /// Refuses a command whose value the camera cannot take.
    ///
    /// # Errors
    /// When the value is outside the range, or a region outside the image.
    pub fn check(&self, command: &CameraCommand) -> Result<(), SettingRefusal> {
        let within = |value: f64, [least, most]: [f64; 2]| value >= least && value <= most;
        let spans = |value: Span, [least, most]: [Span; 2]| value >= least && value <= most;
        let is_taken = match command {
            CameraCommand::Exposure(exposure) => spans(*exposure, self.exposure),
            CameraCommand::GainDb(gain_db) => within(*gain_db, self.gain_db),
            CameraCommand::BlackLevelDn(level_dn) => within(*level_dn, self.black_level_dn),
            CameraCommand::Regions(regions) => return self.check_regions(regions),
            // A period is a whole number of nanoseconds: the highest rate may lie between two.
            CameraCommand::Period(Some(period)) => {
                *period > Span::ZERO && period.s() + 0.51e-9 >= 1.0 / self.frame_rate_max_hz
            }
            CameraCommand::Delay(delay) => spans(*delay, [Span::ZERO, self.delay_max]),
            CameraCommand::Burst(frames) => *frames > 0,
            CameraCommand::Period(None)
            | CameraCommand::Triggered(_)
            | CameraCommand::Sources(_)
            | CameraCommand::Overlap(_)
            | CameraCommand::Mode(_)
            | CameraCommand::AutoExposure(_)
            | CameraCommand::AutoGain(_)
            | CameraCommand::Trigger { .. } => true,
        };
        if is_taken { Ok(()) } else { Err(SettingRefusal::OutOfRange) }
    }

    fn check_regions(&self, regions: &Regions) -> Result<(), SettingRefusal> {
        let is_inside = regions.as_slice().iter().all(|region| region.is_within(self.size_px));
        if is_inside { Ok(()) } else { Err(SettingRefusal::Region) }
    }
}

// Commands to a camera.

/// One command to a camera: a new value of a setting, or a trigger.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "commands wait in queues that are made once; a box would allocate")]
pub enum CameraCommand {
    /// Integration time.
    Exposure(Span),
    /// Gain beyond that of the camera's file, dB.
    GainDb(f64),
    /// Black level of a pixel, DN.
    BlackLevelDn(f64),
    /// Parts of the image that are read out.
    Regions(Regions),
    /// From one exposure's start to the next; `None`: as fast as exposure and readout allow.
    Period(Option<Span>),
    /// Whether exposures wait for triggers.
    Triggered(bool),
    /// The triggers that count.
    Sources(TriggerSources),
    /// From a trigger to the start of the exposure.
    Delay(Span),
    /// When triggers are accepted.
    Overlap(TriggerOverlap),
    /// Exposures of one trigger.
    Burst(u32),
    /// Rule for the length of an exposure.
    Mode(ExposureMode),
    /// Mode that sets the integration time.
    AutoExposure(AutoMode),
    /// Mode that sets the gain.
    AutoGain(AutoMode),
    /// A trigger: the instant of the command starts an exposure. Only exposures by width heed the falling edge.
    Trigger {
        /// Source of the trigger.
        source: TriggerSource,
        /// The line became active; false: inactive.
        is_rising: bool,
    },
}

/// Source of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CommandSource {
    /// A client of the network camera.
    NetworkCamera,
    /// The flight computer, over the bus.
    Bus,
    /// A client of the control socket.
    Control,
    /// The star tracker inside.
    Tracker,
    /// A line of this machine.
    Line,
    /// The camera itself: automatic exposure or gain.
    Automatic,
}

/// A command with its instant and its sender.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Commanded {
    /// The change that is requested.
    pub command: CameraCommand,
    /// When it acts: its arrival, or the instant of a scheduled action.
    pub at: Tai,
    /// Source of the command.
    pub from: CommandSource,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera_control::{Region, TriggerSource};

    const RANGE: CameraRange = CameraRange {
        exposure: [Span::from_ns(20_000), Span::from_ms(500)],
        gain_db: [0.0, 24.0],
        black_level_dn: [0.0, 511.0],
        frame_rate_max_hz: 100.0,
        delay_max: Span::from_ms(1000),
        size_px: [64, 48],
    };

    #[test]
    fn values_are_checked_on_both_sides() {
        let region = |left_px| Regions::of(&[Region { left_px, top_px: 0, width_px: 32, height_px: 48 }]).unwrap();
        let taken = [
            CameraCommand::Exposure(Span::from_ns(20_000)),
            CameraCommand::Exposure(Span::from_ms(500)),
            CameraCommand::GainDb(24.0),
            CameraCommand::BlackLevelDn(0.0),
            CameraCommand::Period(Some(Span::from_ms(10))),
            CameraCommand::Period(None),
            CameraCommand::Delay(Span::ZERO),
            CameraCommand::Burst(1),
            CameraCommand::Regions(region(32)),
            CameraCommand::Trigger { source: TriggerSource::Bus, is_rising: true },
        ];
        for command in taken {
            assert_eq!(RANGE.check(&command), Ok(()), "{command:?}");
        }
        let refused = [
            CameraCommand::Exposure(Span::from_ns(19_999)),
            CameraCommand::Exposure(Span::from_ns(500_000_001)),
            CameraCommand::GainDb(24.01),
            CameraCommand::GainDb(f64::NAN),
            CameraCommand::BlackLevelDn(-1.0),
            CameraCommand::Period(Some(Span::from_ms(9))),
            CameraCommand::Period(Some(Span::from_ns(9_999_999))),
            CameraCommand::Delay(Span::from_ns(-1)),
            CameraCommand::Burst(0),
        ];
        for command in refused {
            assert_eq!(RANGE.check(&command), Err(SettingRefusal::OutOfRange), "{command:?}");
        }
        assert_eq!(RANGE.check(&CameraCommand::Regions(region(33))), Err(SettingRefusal::Region));
        let third = CameraRange { frame_rate_max_hz: 30.0, ..RANGE };
        assert_eq!(third.check(&CameraCommand::Period(Some(Span::from_s(1.0 / 30.0)))), Ok(()), "rounded down");
    }

    #[test]
    fn fewer_rows_leave_time_for_more_frames() {
        let region = |top_px| Region { left_px: 3, top_px, width_px: 5, height_px: 6 };
        let two = Regions::of(&[region(0), region(20)]).unwrap();
        assert_eq!(RANGE.reading(&two).frame_rate_max_hz, 400.0, "12 of 48 rows");
        assert_eq!(RANGE.reading(&Regions::WHOLE), RANGE);
    }
}
