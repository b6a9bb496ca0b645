//! Commands to a camera.

use crate::camera_control::settings::{AutoMode, ExposureMode, TriggerOverlap, TriggerSource, TriggerSources};
use base::region::Regions;
use base::time::{Span, Tai};

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
