//! Allowed values of the settings of a camera.

use crate::camera_control::command::CameraCommand;
use base::{region::Regions, time::Span};

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
