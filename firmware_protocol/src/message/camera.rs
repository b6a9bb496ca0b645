//! Commands to the camera, and what the stimulator says of each exposure's settings. Since protocol 1.4.
//!
//! EXPOSURE, from stimulator to flight computer: which exposure was rendered from which attitude.

use crate::bytes::{Reader, Writer};
use crate::{EncodeError, Reject};

/// Counts of a black level at most: 24 bits.
const BLACK_LEVEL_MAX: u32 = (1 << 24) - 1;

/// Head of a command that is for every camera head.
pub const ALL_HEADS: u8 = 255;

/// The setting of a camera command, and the unit of its value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum CameraKind {
    /// Integration time, us.
    Exposure = 1,
    /// Gain beyond that of the camera's file, 0.01 dB.
    Gain = 2,
    /// Black level, 1/16 DN.
    BlackLevel = 3,
    /// From one exposure's start to the next, us; 0: as fast as exposure and readout allow.
    FramePeriod = 4,
    /// 1: exposures wait for triggers; 0: they follow each other.
    Triggered = 5,
    /// From a trigger to the start of its exposure, us.
    TriggerDelay = 6,
    /// When triggers are accepted: 0 after the readout of the frame before, 1 during it, 2 during its exposure too.
    TriggerOverlap = 7,
    /// Exposures of one trigger.
    Burst = 8,
    /// 0: exposures last for the integration time; 1: for as long as the line of their trigger is active.
    ExposureMode = 9,
    /// 0: the integration time is commanded; 1: the camera sets it once; 2: always.
    AutoExposure = 10,
    /// The same of the gain.
    AutoGain = 11,
    /// 1: CAMERA_STATUS is sent for each frame of every head; 0: it is not, as after HELLO.
    Report = 12,
}

impl CameraKind {
    /// Every kind, in the order of the numbers, which begin with 1.
    pub const ALL: [Self; 12] = [
        Self::Exposure,
        Self::Gain,
        Self::BlackLevel,
        Self::FramePeriod,
        Self::Triggered,
        Self::TriggerDelay,
        Self::TriggerOverlap,
        Self::Burst,
        Self::ExposureMode,
        Self::AutoExposure,
        Self::AutoGain,
        Self::Report,
    ];

    /// Returns the kind of a number; `None` for one of a later version.
    pub fn from_number(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.number() == number)
    }

    /// Returns the number on the wire.
    pub const fn number(self) -> u8 {
        self as u8
    }
}

/// Argument of the command CAMERA. The values are judged by the camera, not by a decoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CameraSetting {
    /// Number of a [`CameraKind`]; kept as it came, so that an unknown one can be refused by name.
    pub kind: u8,
    /// Camera head, 0 to 15; [`ALL_HEADS`] for all.
    pub head: u8,
    /// The value, in the unit of its kind.
    pub value: u32,
}

/// Answer to an accepted CAMERA: it acts from the first exposure that starts at or after its arrival.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CameraSet {
    /// Number of the kind that was set.
    pub kind: u8,
    /// Head of the command.
    pub head: u8,
}

/// Argument of the command CAMERA_TRIGGER.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CameraTrigger {
    /// Camera head, 0 to 15; [`ALL_HEADS`] for all.
    pub head: u8,
    /// When it acts: SCET in microseconds, modulo 2^32; 0 for at once. For an instant whose microseconds are 0, say 1.
    pub at_us: u32,
}

/// Answer to an accepted CAMERA_TRIGGER.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CameraTriggered {
    /// Head of the command.
    pub head: u8,
    /// Its instant was past when it came: it acts at once.
    pub is_late: bool,
}

impl CameraTrigger {
    /// Returns true when it acts as soon as it has come.
    pub const fn is_at_once(&self) -> bool {
        self.at_us == 0
    }
}

/// Cause of an exposure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum StartedBy {
    /// The frame rate.
    Rate = 0,
    /// A software trigger of a client of the network camera.
    Software = 1,
    /// An action command of the network camera's client.
    Action = 2,
    /// CAMERA_TRIGGER.
    Bus = 3,
    /// An edge of a line.
    Line = 4,
    /// The control socket.
    Control = 5,
}

impl StartedBy {
    /// Everything that starts exposures, in the order of the codes.
    pub const ALL: [Self; 6] = [Self::Rate, Self::Software, Self::Action, Self::Bus, Self::Line, Self::Control];

    /// Returns the source of a code on the wire.
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }
}

/// `0x1An`, 8 bytes, multiplexed by byte 0. For each frame of each head, once CAMERA has asked for it.
///
/// | page | 1 | 2 | 3 | 4..8 |
/// |---|---|---|---|---|
/// | 0 exposure | head | frame, modulo 256 | [`StartedBy`] | integration time, us, u32 |
/// | 1 levels | head | frame, modulo 256 | gain, 0.01 dB, u16 in 3..5 | black level, 1/16 DN, u24 in 5..8 |
/// | 2 trigger | head | frame, modulo 256 | reserved | from the trigger to the start of the exposure, us, u32 |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CameraStatus {
    /// Camera head.
    pub head: u8,
    /// Frame number, modulo 256: pages of one frame belong together.
    pub frame: u8,
    /// One page of its facts.
    pub page: CameraPage,
}

/// One page of [`CameraStatus`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraPage {
    /// The exposure.
    Exposure {
        /// Its cause.
        started_by: StartedBy,
        /// Integration time.
        exposure_us: u32,
    },
    /// Gain and black level.
    Levels {
        /// Gain beyond that of the camera's file, 0.01 dB.
        gain_cdb: u16,
        /// Black level, 1/16 DN; below 2^24.
        black_level_dn_16: u32,
    },
    /// The trigger.
    Trigger {
        /// From the trigger to the start of the exposure; 0 for one that the frame rate started.
        delay_us: u32,
    },
}

impl CameraPage {
    /// Returns its number.
    pub const fn number(&self) -> u8 {
        match self {
            Self::Exposure { .. } => 0,
            Self::Levels { .. } => 1,
            Self::Trigger { .. } => 2,
        }
    }
}

impl CameraStatus {
    pub(crate) fn write(&self, to: &mut Writer) -> Result<(), EncodeError> {
        to.u8(self.page.number()).u8(self.head).u8(self.frame);
        match self.page {
            CameraPage::Exposure { started_by, exposure_us } => to.u8(started_by as u8).u32(exposure_us),
            CameraPage::Levels { gain_cdb, black_level_dn_16 } => {
                if black_level_dn_16 > BLACK_LEVEL_MAX {
                    let (field, limit) = ("CAMERA_STATUS black_level, 1/16 DN", f64::from(BLACK_LEVEL_MAX));
                    return Err(EncodeError::OutOfRange { field, got: f64::from(black_level_dn_16), limit });
                }
                to.u16(gain_cdb).u24(black_level_dn_16)
            }
            CameraPage::Trigger { delay_us } => to.u8(0).u32(delay_us),
        };
        Ok(())
    }

    pub(crate) fn read(from: &mut Reader<'_>) -> Result<Self, Reject> {
        let [page, head, frame] = from.take()?;
        let page = match page {
            0 => {
                let started_by = StartedBy::from_code(from.u8()?).ok_or(Reject::UnknownValue)?;
                CameraPage::Exposure { started_by, exposure_us: from.u32()? }
            }
            1 => CameraPage::Levels { gain_cdb: from.u16()?, black_level_dn_16: from.u24()? },
            2 => {
                from.u8()?;
                CameraPage::Trigger { delay_us: from.u32()? }
            }
            _ => return Err(Reject::UnknownValue),
        };
        Ok(Self { head, frame, page })
    }
}

const AGE_LSB_US: u32 = 10;

/// `0x18n`, 8 bytes.
///
/// | byte | field |
/// |---|---|
/// | 0 | frame number, modulo 256 |
/// | 1 | sequence number of the newest attitude received when the frame was drawn |
/// | 2..6 | mid-exposure, us, u32 |
/// | 6..8 | age of that attitude at mid-exposure, 10 us, u16; 0 when interpolated |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Exposure {
    /// Frame number, modulo 256.
    pub frame: u8,
    /// Sequence number of the newest attitude received when the frame was drawn.
    pub attitude_seq: u8,
    /// Mid-exposure in the flight computer's time: SCET in microseconds, modulo 2^32.
    pub mid_exposure_us: u32,
    age: u16,
}

impl Exposure {
    /// Returns an exposure; an age above 655 350 us is sent as 655 350 us.
    pub fn new(frame: u8, attitude_seq: u8, mid_exposure_us: u32, age_us: u32) -> Self {
        let age = u16::try_from(age_us / AGE_LSB_US).unwrap_or(u16::MAX);
        Self { frame, attitude_seq, mid_exposure_us, age }
    }

    /// Returns the age of the newest attitude at mid-exposure, in steps of 10 us; 655 350 us means that or more.
    pub fn age_us(&self) -> u32 {
        u32::from(self.age) * AGE_LSB_US
    }

    pub(crate) fn write(&self, to: &mut Writer) {
        to.u8(self.frame).u8(self.attitude_seq).u32(self.mid_exposure_us).u16(self.age);
    }

    pub(crate) fn read(from: &mut Reader<'_>) -> Result<Self, Reject> {
        let (frame, attitude_seq, mid_exposure_us) = (from.u8()?, from.u8()?, from.u32()?);
        Ok(Self { frame, attitude_seq, mid_exposure_us, age: from.u16()? })
    }
}
