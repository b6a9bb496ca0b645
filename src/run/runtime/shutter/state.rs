//! Keeps the settings made by commands, and computes when the next exposure may start.

use crate::runtime::shutter::{ROUNDING, ShutterParams};
use crate::runtime::slot::{Slot, Started};
use base::time::{Span, Tai};
use frames::camera_control::{
    CameraCommand, CameraSettings, Commanded, ExposureMode, StartSettings, TriggerOverlap, TriggerSource,
};

/// Result of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outcome {
    /// A setting was changed.
    Set,
    /// A trigger started an exposure.
    Accepted,
    /// A trigger came too early.
    Missed,
    /// Exposures do not wait for such triggers.
    Ignored,
}

/// The exposure before.
#[derive(Debug, Clone, Copy)]
struct Previous {
    start: Tai,
    end: Tai,
    /// End of its readout.
    read: Tai,
    /// It was one of the free run: no trigger could come before it was over.
    is_free: bool,
}

/// An accepted trigger whose exposure has not started.
#[derive(Debug, Clone, Copy)]
struct Armed {
    source: TriggerSource,
    at: Tai,
    start: Tai,
}

/// Settings, and facts about earlier exposures.
#[derive(Debug, Clone, Copy)]
pub(super) struct State {
    pub(super) settings: CameraSettings,
    start: StartSettings,
    number: u32,
    /// Earliest start of a free-running exposure.
    free_from: Tai,
    /// Instant of the latest command: what it changes starts no exposure in its past.
    not_before: Tai,
    previous: Option<Previous>,
    armed: Option<Armed>,
    /// Remaining exposures of a burst.
    burst_left: u32,
}

impl State {
    pub(super) fn new(params: &ShutterParams) -> Self {
        let start = StartSettings::free_running(params.period);
        let (settings, free_from) = (params.settings, params.first_exposure);
        let not_before = Tai::from_ns(i64::MIN);
        Self { settings, start, number: 0, free_from, not_before, previous: None, armed: None, burst_left: 0 }
    }

    pub(super) fn start(&self) -> &StartSettings {
        &self.start
    }

    /// Returns the number of the next frame.
    pub(super) fn number(&self) -> u32 {
        self.number
    }

    /// Returns true when the length of exposures is that of the trigger signal.
    pub(super) fn is_by_width(&self) -> bool {
        self.start.mode == ExposureMode::TriggerWidth
    }

    /// Returns the start of the next exposure and what starts it; `None` while waiting for a trigger.
    pub(super) fn candidate(&self, params: &ShutterParams) -> Option<(Tai, Started)> {
        let earliest = self.earliest(params);
        match self.armed {
            _ if !self.start.is_triggered => Some((self.free_start(earliest).max(self.not_before), Started::Rate)),
            Some(Armed { source, at, start }) if self.burst_left > 0 => {
                let next = if self.is_first_of_burst() { start } else { self.free_from };
                Some((next.max(earliest).max(self.not_before), Started::Trigger { source, at }))
            }
            _ => None,
        }
    }

    /// Returns the free-running start. Period, exposure and readout are rounded separately: this must not move an
    /// exposure.
    fn free_start(&self, earliest: Tai) -> Tai {
        if earliest <= self.free_from + ROUNDING { self.free_from } else { earliest }
    }

    fn is_first_of_burst(&self) -> bool {
        self.armed.is_some_and(|armed| self.previous.is_none_or(|previous| previous.start < armed.at))
    }

    /// Returns the first instant at which the sensor can start an exposure.
    fn earliest(&self, params: &ShutterParams) -> Tai {
        let Some(previous) = self.previous else { return params.first_exposure };
        // A readout longer than the period is a delay of delivery: several frames are then in flight.
        let after_readout =
            if params.readout <= params.period { previous.read - self.settings.exposure } else { previous.end };
        previous.end.max(after_readout)
    }

    /// Applies a command that comes before the next exposure.
    pub(super) fn apply(&mut self, commanded: &Commanded) -> Outcome {
        self.not_before = self.not_before.max(commanded.at);
        match commanded.command {
            CameraCommand::Exposure(exposure) => self.settings.exposure = exposure,
            CameraCommand::GainDb(gain_db) => self.settings.gain_db = gain_db,
            CameraCommand::BlackLevelDn(level_dn) => self.settings.black_level_dn = level_dn,
            CameraCommand::Regions(regions) => self.settings.regions = regions,
            CameraCommand::Period(period) => self.set_period(period),
            CameraCommand::Triggered(is_triggered) => self.set_triggered(is_triggered, commanded.at),
            CameraCommand::Sources(sources) => self.start.sources = sources,
            CameraCommand::Delay(delay) => self.start.delay = delay,
            CameraCommand::Overlap(overlap) => self.start.overlap = overlap,
            CameraCommand::Burst(frames) => self.start.burst = frames,
            CameraCommand::Mode(mode) => self.start.mode = mode,
            CameraCommand::Trigger { source, is_rising } => return self.trigger(source, is_rising, commanded.at),
            // Handled by the engine, which measures images.
            CameraCommand::AutoExposure(_) | CameraCommand::AutoGain(_) => {}
        }
        Outcome::Set
    }

    fn set_period(&mut self, period: Option<Span>) {
        self.start.period = period;
        if let Some(previous) = self.previous {
            self.free_from = previous.start + period.unwrap_or(Span::ZERO);
        }
    }

    fn set_triggered(&mut self, is_triggered: bool, at: Tai) {
        if self.start.is_triggered && !is_triggered {
            self.free_from = self.free_from.max(at);
        }
        self.start.is_triggered = is_triggered;
        (self.armed, self.burst_left) = (None, 0);
    }

    fn trigger(&mut self, source: TriggerSource, is_rising: bool, at: Tai) -> Outcome {
        if !is_rising {
            return Outcome::Set;
        }
        if !self.start.is_triggered || !self.start.sources.has(source) {
            return Outcome::Ignored;
        }
        if !self.is_ready(at) {
            return Outcome::Missed;
        }
        self.armed = Some(Armed { source, at, start: at + self.start.delay });
        self.burst_left = self.start.burst;
        Outcome::Accepted
    }

    /// Returns true when a trigger at this instant is not too early.
    fn is_ready(&self, at: Tai) -> bool {
        let is_over = match (self.previous, self.start.overlap) {
            // The free run has ended: the first trigger waits until its last exposure is over.
            (Some(Previous { is_free: true, .. }), _) => true,
            (None, _) | (Some(_), TriggerOverlap::PreviousFrame) => true,
            (Some(previous), TriggerOverlap::ReadOut) => at >= previous.end,
            (Some(previous), TriggerOverlap::Off) => at >= previous.read,
        };
        self.burst_left == 0 && is_over
    }

    /// Returns true when exposures wait for triggers, and one at this instant is not too early.
    pub(super) fn awaits_trigger(&self, at: Tai) -> bool {
        self.start.is_triggered && self.is_ready(at)
    }

    /// Records an exposure that is over for the shutter.
    pub(super) fn expose(&mut self, slot: &Slot, readout: Span) {
        let Slot { exposure_start: start, exposure_end: end, started, .. } = *slot;
        self.number += 1;
        self.previous = Some(Previous { start, end, read: end + readout, is_free: started == Started::Rate });
        self.free_from = start + self.start.period.unwrap_or(Span::ZERO);
        self.burst_left = self.burst_left.saturating_sub(1);
        if self.burst_left == 0 {
            self.armed = None;
        }
    }
}
