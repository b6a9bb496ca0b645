//! Writes to the features of a camera that clients command: each becomes a command to the frame loop.
//!
//! A value outside the camera's range is an invalid parameter; when too many commands wait, the device is busy.
//! Commands are dated by the bench clock and act from the first exposure that starts then or later.

use super::{Device, SOURCE_ACTION};
use crate::network_camera::gvcp::Status;
use crate::network_camera::registers::{OVERLAPS, SOURCES, own};
use base::time::{Span, Tai};
use frames::camera_control::{
    AutoMode, CameraCommand, CameraEventKind, CameraRange, CommandSource, Commanded, ExposureMode, TriggerSources,
};

const AUTO_MODES: [AutoMode; 3] = [AutoMode::Off, AutoMode::Once, AutoMode::Continuous];

/// Numbers of double precision that are written in two halves.
const NUMBERS: [u32; 5] = [own::EXPOSURE_TIME, own::GAIN, own::BLACK_LEVEL, own::FRAME_RATE, own::TRIGGER_DELAY];

impl Device {
    /// Returns true for registers that a command to the frame loop sets.
    pub(super) fn is_commanded(address: u32) -> bool {
        let is_half = NUMBERS.iter().any(|number| address == *number || address == *number + 4);
        let words = own::FRAME_RATE_ENABLE..=own::EXPOSURE_MODE;
        is_half || words.contains(&address) || matches!(address, own::TRIGGER_MODE | own::TRIGGER_SOURCE)
    }

    /// Returns the time of the bench: that of its own clock when clients command the camera.
    pub(super) fn bench_time(&self, now: Tai) -> Tai {
        self.commands.as_ref().map_or(now, |commands| commands.clock.now())
    }

    /// Returns the number whose high half was written last and whose low half is this one.
    pub(super) fn number_at(&self, address: u32, low: u32) -> f64 {
        let kept = || self.memory.word(address);
        let high = if self.high_half.0 == address { self.high_half.1 } else { kept() };
        f64::from_bits(u64::from(high) << 32 | u64::from(low))
    }

    /// Takes a value that the camera has chosen for itself: clients read it from now on.
    pub(super) fn take_events(&mut self) {
        let Some(commands) = &self.commands else { return };
        for event in commands.desk.events() {
            self.messages.push(event, &self.shared.tally);
            match event.kind {
                CameraEventKind::ExposureChosen(exposure) => {
                    self.memory.set_long(own::EXPOSURE_TIME, (exposure.ns() as f64 * 1e-3).to_bits());
                }
                CameraEventKind::GainChosen(gain_db) => self.memory.set_long(own::GAIN, gain_db.to_bits()),
                CameraEventKind::ExposureAutoDone => self.memory.set(own::EXPOSURE_AUTO, 0),
                CameraEventKind::GainAutoDone => self.memory.set(own::GAIN_AUTO, 0),
                CameraEventKind::FrameTrigger
                | CameraEventKind::FrameTriggerMissed
                | CameraEventKind::ExposureStart
                | CameraEventKind::ExposureEnd => {}
            }
        }
    }

    /// Carries out a write to a commanded feature.
    pub(super) fn write_commanded(&mut self, address: u32, value: u32, at: Tai) -> Result<(), Status> {
        if NUMBERS.contains(&address) {
            self.high_half = (address, value);
            return Ok(());
        }
        if let Some(number) = NUMBERS.iter().find(|number| **number + 4 == address) {
            return self.write_number(*number, value, at);
        }
        let by_number = |names: &[AutoMode; 3]| names.get(value as usize).copied();
        let command = match address {
            own::TRIGGER_MODE | own::FRAME_RATE_ENABLE if value > 1 => None,
            own::TRIGGER_MODE => {
                if self.acquisition.is_running(&self.shared.wanted) {
                    return Err(Status::Busy);
                }
                Some(CameraCommand::Triggered(value == 1))
            }
            own::TRIGGER_SOURCE => {
                SOURCES.get(value as usize).map(|source| CameraCommand::Sources(TriggerSources::only(*source)))
            }
            own::TRIGGER_OVERLAP => OVERLAPS.get(value as usize).copied().map(CameraCommand::Overlap),
            own::FRAME_RATE_ENABLE => Some(CameraCommand::Period((value == 1).then(|| self.period()).flatten())),
            own::BURST => Some(CameraCommand::Burst(value)),
            own::EXPOSURE_AUTO => by_number(&AUTO_MODES).map(CameraCommand::AutoExposure),
            own::GAIN_AUTO => by_number(&AUTO_MODES).map(CameraCommand::AutoGain),
            own::EXPOSURE_MODE => self.exposure_mode(value).map(CameraCommand::Mode),
            _ => return self.memory.read(address, 4).and(Err(Status::WriteProtect)),
        };
        let command = command.ok_or(Status::InvalidParameter)?;
        if matches!(command, CameraCommand::Period(Some(_))) && self.regions_wait() {
            self.rate_waits = true;
        } else {
            self.put(command, at)?;
        }
        self.memory.set(address, value);
        Ok(())
    }

    fn exposure_mode(&self, value: u32) -> Option<ExposureMode> {
        let has_line = self.commands.as_ref().is_some_and(|commands| commands.has_line);
        match value {
            0 => Some(ExposureMode::Timed),
            1 if has_line => Some(ExposureMode::TriggerWidth),
            _ => None,
        }
    }

    /// Returns the period of the frame rate.
    pub(super) fn period(&self) -> Option<Span> {
        period_of(self.memory.float(own::FRAME_RATE))
    }

    fn write_number(&mut self, address: u32, low: u32, at: Tai) -> Result<(), Status> {
        let number = self.number_at(address, low);
        self.high_half = (0, 0);
        let is_auto = |register| self.memory.word(register) != 0;
        let command = match address {
            own::EXPOSURE_TIME if is_auto(own::EXPOSURE_AUTO) => return Err(Status::WriteProtect),
            own::GAIN if is_auto(own::GAIN_AUTO) => return Err(Status::WriteProtect),
            own::EXPOSURE_TIME => micros(number).map(CameraCommand::Exposure),
            own::GAIN => Some(CameraCommand::GainDb(number)),
            own::BLACK_LEVEL => Some(CameraCommand::BlackLevelDn(number)),
            own::TRIGGER_DELAY => micros(number).map(CameraCommand::Delay),
            _ => period_of(number).map(|period| CameraCommand::Period(Some(period))),
        };
        let command = command.ok_or(Status::InvalidParameter)?;
        let is_rate = address == own::FRAME_RATE;
        let is_kept_for_later = is_rate && (self.memory.word(own::FRAME_RATE_ENABLE) == 0 || self.regions_wait());
        if is_kept_for_later {
            self.check(&command)?;
            self.rate_waits = true;
        } else {
            self.put(command, at)?;
        }
        self.memory.set_long(address, number.to_bits());
        Ok(())
    }

    /// Starts an exposure, when the camera acquires and waits for triggers.
    pub(super) fn command_trigger(&mut self, source: u32, at: Tai) -> Result<(), Status> {
        let is_heeded = self.acquisition.is_running(&self.shared.wanted) && self.memory.word(own::TRIGGER_MODE) == 1;
        let Some(named) = SOURCES.get(source as usize).filter(|_| is_heeded) else { return Ok(()) };
        let full = if source == SOURCE_ACTION { Status::Overflow } else { Status::Busy };
        self.put(CameraCommand::Trigger { source: *named, is_rising: true }, at).map_err(|_| full)?;
        self.tally().triggers.one();
        Ok(())
    }

    /// Refuses settings that are impossible for the regions that are set.
    pub(super) fn check(&self, command: &CameraCommand) -> Result<(), Status> {
        let range = self.range().ok_or(Status::WriteProtect)?;
        range.check(command).map_err(|_| Status::InvalidParameter)
    }

    /// Returns the limits of commands with the regions that are set; `None`: clients do not command the camera.
    pub(super) fn range(&self) -> Option<CameraRange> {
        self.commands.as_ref().map(|commands| commands.range.reading(&self.regions.present()))
    }

    pub(super) fn put(&self, command: CameraCommand, at: Tai) -> Result<(), Status> {
        self.check(&command)?;
        let commands = self.commands.as_ref().ok_or(Status::WriteProtect)?;
        let is_taken = commands.desk.put(Commanded { command, at, from: CommandSource::NetworkCamera });
        if is_taken { Ok(()) } else { Err(Status::Busy) }
    }
}

/// Returns a time given in microseconds; `None` when it is not finite or too long to count in nanoseconds.
fn micros(number_us: f64) -> Option<Span> {
    (number_us.is_finite() && number_us.abs() < 1e12).then(|| Span::from_s(number_us * 1e-6))
}

/// Returns the period of a rate, Hz; `None` for none that a camera has.
fn period_of(rate_hz: f64) -> Option<Span> {
    (rate_hz.is_finite() && rate_hz >= 1e-3).then(|| Span::from_s(1.0 / rate_hz))
}
