//! Writes to the features of a camera that clients command: each becomes a command to the frame loop.
//!
//! A value outside the camera's range is an invalid parameter; when too many commands wait, the device is busy.
//! Commands are dated by the bench clock and act from the first exposure that starts then or later. The camera reads out
//! no more than its regions, from the next start of an acquisition on, at the frame rate that was set for them.

use super::{SOURCE_ACTION, values::Values};
use crate::network_camera::registers::{OVERLAPS, SOURCES};
use crate::network_camera::{features::own, gvcp::Status, params::CommandParams};
use base::time::{Span, Tai};
use frames::camera_control::{
    AutoMode, CameraCommand, CameraRange, CommandSource, Commanded, ExposureMode, Regions, TriggerSources,
};

const AUTO_MODES: [AutoMode; 3] = [AutoMode::Off, AutoMode::Once, AutoMode::Continuous];

/// Numbers of double precision that are written in two halves.
const NUMBERS: [u32; 5] = [own::EXPOSURE_TIME, own::GAIN, own::BLACK_LEVEL, own::FRAME_RATE, own::TRIGGER_DELAY];

/// How clients command the camera that makes the frames.
pub(super) struct Commander {
    pub(super) params: CommandParams,
    /// Regions that the camera reads out.
    read_out: Regions,
    /// The frame rate was set for regions that the camera does not read out yet, or is lower because of them.
    rate_waits: bool,
}

/// Returns true for registers that a command to the frame loop sets.
pub(super) fn is_commanded(address: u32) -> bool {
    let is_half = NUMBERS.iter().any(|number| address == *number || address == *number + 4);
    let words = own::FRAME_RATE_ENABLE..=own::EXPOSURE_MODE;
    is_half || words.contains(&address) || matches!(address, own::TRIGGER_MODE | own::TRIGGER_SOURCE)
}

impl Commander {
    pub(super) fn new(params: CommandParams) -> Self {
        Self { params, read_out: Regions::WHOLE, rate_waits: false }
    }

    /// Returns the time of the bench.
    pub(super) fn time(&self) -> Tai {
        self.params.clock.now()
    }

    /// Carries out a write to a commanded feature.
    pub(super) fn write(
        &mut self,
        values: &mut Values,
        address: u32,
        value: u32,
        is_running: bool,
    ) -> Result<(), Status> {
        if NUMBERS.contains(&address) {
            values.high_half = (address, value);
            return Ok(());
        }
        if let Some(number) = NUMBERS.iter().find(|number| **number + 4 == address) {
            return self.write_number(values, *number, value);
        }
        let by_number = |names: &[AutoMode; 3]| names.get(value as usize).copied();
        let command = match address {
            own::TRIGGER_MODE | own::FRAME_RATE_ENABLE if value > 1 => None,
            own::TRIGGER_MODE if is_running => return Err(Status::Busy),
            own::TRIGGER_MODE => Some(CameraCommand::Triggered(value == 1)),
            own::TRIGGER_SOURCE => {
                SOURCES.get(value as usize).map(|source| CameraCommand::Sources(TriggerSources::only(*source)))
            }
            own::TRIGGER_OVERLAP => OVERLAPS.get(value as usize).copied().map(CameraCommand::Overlap),
            own::FRAME_RATE_ENABLE => Some(CameraCommand::Period((value == 1).then(|| period(values)).flatten())),
            own::BURST => Some(CameraCommand::Burst(value)),
            own::EXPOSURE_AUTO => by_number(&AUTO_MODES).map(CameraCommand::AutoExposure),
            own::GAIN_AUTO => by_number(&AUTO_MODES).map(CameraCommand::AutoGain),
            own::EXPOSURE_MODE if value == 0 => Some(CameraCommand::Mode(ExposureMode::Timed)),
            own::EXPOSURE_MODE => {
                (value == 1 && self.params.has_line).then_some(CameraCommand::Mode(ExposureMode::TriggerWidth))
            }
            _ => return values.memory.read(address, 4).and(Err(Status::WriteProtect)),
        };
        let command = command.ok_or(Status::InvalidParameter)?;
        if matches!(command, CameraCommand::Period(Some(_))) && self.regions_wait(values) {
            self.rate_waits = true;
        } else {
            self.put(command, values, self.time())?;
        }
        values.memory.set(address, value);
        Ok(())
    }

    fn write_number(&mut self, values: &mut Values, address: u32, low: u32) -> Result<(), Status> {
        let number = values.number_at(address, low);
        values.high_half = (0, 0);
        let is_on = |register| values.memory.word(register) != 0;
        let command = match address {
            own::EXPOSURE_TIME if is_on(own::EXPOSURE_AUTO) => return Err(Status::WriteProtect),
            own::GAIN if is_on(own::GAIN_AUTO) => return Err(Status::WriteProtect),
            own::EXPOSURE_TIME => micros(number).map(CameraCommand::Exposure),
            own::GAIN => Some(CameraCommand::GainDb(number)),
            own::BLACK_LEVEL => Some(CameraCommand::BlackLevelDn(number)),
            own::TRIGGER_DELAY => micros(number).map(CameraCommand::Delay),
            _ => period_of(number).map(|period| CameraCommand::Period(Some(period))),
        };
        let command = command.ok_or(Status::InvalidParameter)?;
        if address == own::FRAME_RATE && (!is_on(own::FRAME_RATE_ENABLE) || self.regions_wait(values)) {
            self.check(&command, values)?;
            self.rate_waits = true;
        } else {
            self.put(command, values, self.time())?;
        }
        values.memory.set_long(address, number.to_bits());
        Ok(())
    }

    /// Starts an exposure, when the camera waits for triggers.
    pub(super) fn trigger(&self, values: &Values, source: u32, at: Tai) -> Result<bool, Status> {
        let is_heeded = values.memory.word(own::TRIGGER_MODE) == 1;
        let Some(named) = SOURCES.get(source as usize).filter(|_| is_heeded) else { return Ok(false) };
        let full = if source == SOURCE_ACTION { Status::Overflow } else { Status::Busy };
        self.put(CameraCommand::Trigger { source: *named, is_rising: true }, values, at).map_err(|_| full)?;
        Ok(true)
    }

    /// Makes the camera read out the regions from the next exposure on, when they have changed, at the frame rate that
    /// was set for them.
    pub(super) fn read_out_regions(&mut self, values: &Values) -> Result<(), Status> {
        let (wanted, at) = (values.wanted_read_out(), self.time());
        if wanted != self.read_out {
            self.put(CameraCommand::Regions(wanted), values, at)?;
            self.read_out = wanted;
        }
        if self.rate_waits && values.memory.word(own::FRAME_RATE_ENABLE) == 1 {
            self.put(CameraCommand::Period(period(values)), values, at)?;
        }
        self.rate_waits = false;
        Ok(())
    }

    /// Returns true when the camera does not read out yet what is set.
    fn regions_wait(&self, values: &Values) -> bool {
        values.wanted_read_out() != self.read_out
    }

    /// Shows the highest frame rate with the regions that are set; the frame rate becomes no higher.
    pub(super) fn show_rate_range(&mut self, values: &mut Values) {
        let most = self.range(values).frame_rate_max_hz.to_bits();
        values.memory.set_long(own::FRAME_RATE_MOST, most);
        if self.check(&CameraCommand::Period(period(values)), values).is_err() {
            values.memory.set_long(own::FRAME_RATE, most);
            self.rate_waits = true;
        }
    }

    /// Returns the limits of commands with the regions that are set.
    fn range(&self, values: &Values) -> CameraRange {
        self.params.range.reading(&values.regions.present())
    }

    /// Refuses settings that are impossible for the regions that are set.
    fn check(&self, command: &CameraCommand, values: &Values) -> Result<(), Status> {
        self.range(values).check(command).map_err(|_| Status::InvalidParameter)
    }

    fn put(&self, command: CameraCommand, values: &Values, at: Tai) -> Result<(), Status> {
        self.check(&command, values)?;
        let is_taken = self.params.desk.put(Commanded { command, at, from: CommandSource::NetworkCamera });
        if is_taken { Ok(()) } else { Err(Status::Busy) }
    }
}

/// Returns the period of the frame rate that is set.
fn period(values: &Values) -> Option<Span> {
    period_of(values.memory.float(own::FRAME_RATE))
}

/// Returns a time given in microseconds; `None` when it is not finite or too long to count in nanoseconds.
fn micros(number_us: f64) -> Option<Span> {
    (number_us.is_finite() && number_us.abs() < 1e12).then(|| Span::from_s(number_us * 1e-6))
}

/// Returns the period of a rate, Hz; `None` for none that a camera has.
fn period_of(rate_hz: f64) -> Option<Span> {
    (rate_hz.is_finite() && rate_hz >= 1e-3).then(|| Span::from_s(1.0 / rate_hz))
}
