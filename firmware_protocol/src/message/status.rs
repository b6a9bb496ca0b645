//! The stimulator's state, one page per message.

use crate::Reject;
use crate::bytes::{Reader, Writer};

/// 2^32 of these make one turn: 0.3 milliarcsec each.
const ANGLE_LSB_RAD: f64 = core::f64::consts::TAU / 4_294_967_296.0;

/// Bits of [`StatusPage::Pointing`]'s flags. A stimulator before protocol 1.3 sends none; unknown bits are ignored.
pub mod frame_flag {
    /// Jitter samples were missing when the frame was drawn.
    pub const JITTER_MISSING: u16 = 1;
    /// Part of the exposure lies after the newest attitude, though its middle does not.
    pub const PARTLY_EXTRAPOLATED: u16 = 1 << 1;
}

/// `0x19n`, 8 bytes, multiplexed by byte 0.
///
/// | page | 1 | 2..4 | 4..8 |
/// |---|---|---|---|
/// | 0 state | mode | frames sent, modulo 2^16 | latency, us, u32 |
/// | 1 prediction | reserved | horizon, 10 us, i16 | predicted error, arcsec, f32 |
/// | 2 clock | reserved | drift, 0.1 ppm, i16 | residual offset, ns, i32 |
/// | 3 rejects | reason | reserved | count, u32 |
/// | 4, 5, 6 pointing | frame, modulo 256 | [`frame_flag`] bits, u16 | right ascension, declination, roll; 2^-32 turn, u32 |
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StatusPage {
    /// Mode, frames and latency.
    State {
        /// State of the stimulator.
        mode: StimulatorMode,
        /// Frames reported so far, modulo 2^16.
        frames: u16,
        /// Epoch of the newest attitude to the frame going out.
        latency_us: u32,
    },
    /// How far, and how well, attitude is predicted.
    Prediction {
        /// Mid-exposure minus the epoch of the newest attitude, 10 us; negative when interpolated.
        horizon_10us: i16,
        /// Predicted line-of-sight error.
        error_arcsec: f32,
    },
    /// Time correlation.
    Clock {
        /// Rate of the flight computer's clock against the stimulator's, 0.1 ppm.
        drift_0_1ppm: i16,
        /// Last mark minus the estimate.
        residual_ns: i32,
    },
    /// How often input was rejected for one reason.
    Rejects {
        /// The reason.
        reason: Reject,
        /// How often.
        count: u32,
    },
    /// Where the rendered boresight points.
    Pointing {
        /// Which of the three angles.
        angle: PointingAngle,
        /// Frame number, modulo 256: pages of one frame belong together.
        frame: u8,
        /// Bits of [`frame_flag`], the same on the three pages of a frame. Since protocol 1.3; before, zero.
        flags: u16,
        /// The angle in units of 2^-32 turn; see [`PointingAngle::to_turns`].
        turns_2_32: u32,
    },
}

/// Angles of the rendered boresight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum PointingAngle {
    /// Right ascension, 0 to 2 pi.
    RightAscension = 4,
    /// Declination, -pi/2 to pi/2.
    Declination = 5,
    /// Position angle of image up, east of north, -pi to pi.
    Roll = 6,
}

/// State of the stimulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum StimulatorMode {
    /// Waiting for RUN.
    Idle = 0,
    /// Rendering the received attitude.
    Running = 1,
    /// The stream stopped: holding the last attitude.
    Holding = 2,
    /// The stream stopped: dark frames.
    Blank = 3,
    /// The stream stopped: no frames.
    Stopped = 4,
}

impl StimulatorMode {
    const ALL: [Self; 5] = [Self::Idle, Self::Running, Self::Holding, Self::Blank, Self::Stopped];

    /// Returns the mode of a code on the wire.
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }
}

impl PointingAngle {
    /// The angle as 2^-32 turns, modulo one turn.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the wrap modulo one turn is wanted; NaN becomes 0"
    )]
    pub fn to_turns(angle_rad: f64) -> u32 {
        let counts = angle_rad / ANGLE_LSB_RAD;
        (counts + 0.5_f64.copysign(counts)) as i64 as u32
    }

    /// Returns the angle of 2^-32 turns: right ascension in 0 to 2 pi, the others in -pi to pi.
    pub fn to_rad(self, turns_2_32: u32) -> f64 {
        match self {
            Self::RightAscension => f64::from(turns_2_32) * ANGLE_LSB_RAD,
            Self::Declination | Self::Roll => f64::from(turns_2_32.cast_signed()) * ANGLE_LSB_RAD,
        }
    }
}

impl StatusPage {
    pub(crate) fn write(&self, to: &mut Writer) {
        match *self {
            Self::State { mode, frames, latency_us } => to.u8(0).u8(mode as u8).u16(frames).u32(latency_us),
            Self::Prediction { horizon_10us, error_arcsec } => {
                to.u8(1).u8(0).put(&horizon_10us.to_le_bytes()).f32s(&[error_arcsec])
            }
            Self::Clock { drift_0_1ppm, residual_ns } => {
                to.u8(2).u8(0).put(&drift_0_1ppm.to_le_bytes()).put(&residual_ns.to_le_bytes())
            }
            Self::Rejects { reason, count } => to.u8(3).u8(reason.code()).u16(0).u32(count),
            Self::Pointing { angle, frame, flags, turns_2_32 } => {
                to.u8(angle as u8).u8(frame).u16(flags).u32(turns_2_32)
            }
        };
    }

    pub(crate) fn read(from: &mut Reader<'_>) -> Result<Self, Reject> {
        match from.u8()? {
            0 => Self::read_state(from),
            1 => {
                from.u8()?;
                let (horizon_10us, [error_arcsec]) = (from.i16()?, from.f32s()?);
                Ok(Self::Prediction { horizon_10us, error_arcsec })
            }
            2 => {
                from.u8()?;
                Ok(Self::Clock { drift_0_1ppm: from.i16()?, residual_ns: from.u32()?.cast_signed() })
            }
            3 => Self::read_rejects(from),
            4 => Self::read_pointing(PointingAngle::RightAscension, from),
            5 => Self::read_pointing(PointingAngle::Declination, from),
            6 => Self::read_pointing(PointingAngle::Roll, from),
            _ => Err(Reject::UnknownValue),
        }
    }

    fn read_state(from: &mut Reader<'_>) -> Result<Self, Reject> {
        let mode = StimulatorMode::from_code(from.u8()?).ok_or(Reject::UnknownValue)?;
        Ok(Self::State { mode, frames: from.u16()?, latency_us: from.u32()? })
    }

    fn read_rejects(from: &mut Reader<'_>) -> Result<Self, Reject> {
        let reason = Reject::from_code(from.u8()?).ok_or(Reject::UnknownValue)?;
        from.u16()?;
        Ok(Self::Rejects { reason, count: from.u32()? })
    }

    fn read_pointing(angle: PointingAngle, from: &mut Reader<'_>) -> Result<Self, Reject> {
        Ok(Self::Pointing { angle, frame: from.u8()?, flags: from.u16()?, turns_2_32: from.u32()? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_round_trip_to_half_a_count() {
        for (angle, rad) in [
            (PointingAngle::RightAscension, 6.2),
            (PointingAngle::Declination, -1.57),
            (PointingAngle::Roll, -3.1),
            (PointingAngle::Roll, 3.1),
        ] {
            let back = angle.to_rad(PointingAngle::to_turns(rad));
            assert!((back - rad).abs() <= 0.5 * ANGLE_LSB_RAD, "{back} for {rad}");
        }
        assert_eq!(PointingAngle::to_turns(f64::NAN), 0);
    }
}
