//! Camera commands of the flight computer: judged by what the heads can do, answered, and kept until the loop gives
//! them to the heads.
//!
//! In: CAMERA and CAMERA_TRIGGER with their arrivals, what each head can do ([`CameraView`]). Out: commands by head, a
//! refusal with its reason, whether CAMERA_STATUS is wanted. A command for all heads is taken by all or by none. The
//! loop shows the heads before a command is taken in, and passes them accepted commands right after (`head`).
//! Allocates nothing after the start. Tests: below, and `tests/closed_loop/camera_bus.rs`.

use base::time::{Span, Tai};
use core::ops::Range;
use firmware_protocol::message::{ALL_HEADS, CameraKind, CameraSetting, Refusal};
use frames::camera_control::{
    AutoMode, CameraCommand, CameraRange, CommandSource, Commanded, ExposureMode, SettingRefusal, TriggerOverlap,
    TriggerSource,
};
use std::collections::VecDeque;

/// Heads that a command on the bus can name.
pub const HEADS_MAX: usize = 16;

/// Capabilities of a head at this moment.
#[derive(Debug, Clone, Copy)]
pub struct CameraView {
    /// Range of values that commands may set; `None` when nothing may be set, as for a display.
    pub range: Option<CameraRange>,
    /// Number of further commands that fit into its queue.
    pub places: usize,
}

/// The camera commands of one flight computer.
#[derive(Debug, Clone)]
pub struct CameraIntake {
    views: Vec<CameraView>,
    taken: VecDeque<(usize, Commanded)>,
    /// True when CAMERA_STATUS is wanted.
    pub is_reporting: bool,
}

impl Default for CameraIntake {
    fn default() -> Self {
        let (views, taken) = (Vec::with_capacity(HEADS_MAX), VecDeque::with_capacity(HEADS_MAX));
        Self { views, taken, is_reporting: false }
    }
}

impl CameraIntake {
    /// Stores what a head can do. Heads come in the order of their numbers; heads beyond the last number a command can
    /// name are ignored.
    pub fn see(&mut self, head: usize, view: CameraView) {
        match self.views.get_mut(head) {
            Some(known) => *known = view,
            None if head < HEADS_MAX => self.views.push(view),
            None => {}
        }
    }

    /// Starts a new conversation, in which CAMERA_STATUS has not been requested.
    pub fn begin(&mut self) {
        self.is_reporting = false;
    }

    /// Removes and returns the next command with the number of its head.
    pub fn take(&mut self) -> Option<(usize, Commanded)> {
        self.taken.pop_front()
    }

    /// Accepts a setting that arrived at `at`.
    ///
    /// # Errors
    /// When the head does not exist, or one of the addressed heads cannot do it.
    pub fn set(&mut self, setting: CameraSetting, at: Tai) -> Result<(), Refusal> {
        match command_of(setting)? {
            Some(command) => self.put(setting.head, command, at),
            None => {
                self.is_reporting = choice(setting.value, [false, true])?;
                Ok(())
            }
        }
    }

    /// Accepts a trigger that acts at `at`.
    ///
    /// # Errors
    /// The same errors as [`Self::set`].
    pub fn trigger(&mut self, head: u8, at: Tai) -> Result<(), Refusal> {
        self.put(head, CameraCommand::Trigger { source: TriggerSource::Bus, is_rising: true }, at)
    }

    fn put(&mut self, head: u8, command: CameraCommand, at: Tai) -> Result<(), Refusal> {
        let heads = self.heads(head)?;
        for view in &self.views[heads.clone()] {
            let range = view.range.as_ref().ok_or(SettingRefusal::Unsupported);
            range.and_then(|range| range.check(&command)).map_err(refusal)?;
            if view.places == 0 {
                return Err(refusal(SettingRefusal::TooMany));
            }
        }
        for head in heads {
            self.views[head].places -= 1;
            self.taken.push_back((head, Commanded { command, at, from: CommandSource::Bus }));
        }
        Ok(())
    }

    /// Returns the heads that a command addresses.
    fn heads(&self, head: u8) -> Result<Range<usize>, Refusal> {
        let (all, one) = (0..self.views.len(), usize::from(head));
        let heads = if head == ALL_HEADS { all.clone() } else { one..one + 1 };
        if heads.is_empty() || heads.end > all.end { Err(Refusal::UnknownHead) } else { Ok(heads) }
    }
}

/// Returns the answer sent to a flight computer when a camera refuses its setting.
fn refusal(why: SettingRefusal) -> Refusal {
    match why {
        SettingRefusal::OutOfRange | SettingRefusal::Region => Refusal::CameraRange,
        SettingRefusal::Unsupported => Refusal::CameraUnsupported,
        SettingRefusal::TooMany => Refusal::CameraFull,
    }
}

/// Converts a setting to a camera command in the camera's units; `None` for a report request, which changes no camera.
fn command_of(setting: CameraSetting) -> Result<Option<CameraCommand>, Refusal> {
    let value = setting.value;
    let kind = CameraKind::from_number(setting.kind).ok_or(Refusal::CameraUnsupported)?;
    let command = match kind {
        CameraKind::Exposure => CameraCommand::Exposure(micros(value)),
        CameraKind::Gain => CameraCommand::GainDb(f64::from(value) / 100.0),
        CameraKind::BlackLevel => CameraCommand::BlackLevelDn(f64::from(value) / 16.0),
        CameraKind::FramePeriod => CameraCommand::Period((value > 0).then(|| micros(value))),
        CameraKind::Triggered => CameraCommand::Triggered(choice(value, [false, true])?),
        CameraKind::TriggerDelay => CameraCommand::Delay(micros(value)),
        CameraKind::TriggerOverlap => {
            let overlaps = [TriggerOverlap::Off, TriggerOverlap::ReadOut, TriggerOverlap::PreviousFrame];
            CameraCommand::Overlap(choice(value, overlaps)?)
        }
        CameraKind::Burst => CameraCommand::Burst(value),
        CameraKind::ExposureMode => {
            CameraCommand::Mode(choice(value, [ExposureMode::Timed, ExposureMode::TriggerWidth])?)
        }
        CameraKind::AutoExposure => CameraCommand::AutoExposure(choice(value, AUTO)?),
        CameraKind::AutoGain => CameraCommand::AutoGain(choice(value, AUTO)?),
        CameraKind::Report => return Ok(None),
    };
    Ok(Some(command))
}

const AUTO: [AutoMode; 3] = [AutoMode::Off, AutoMode::Once, AutoMode::Continuous];

fn micros(value: u32) -> Span {
    Span::from_ns(i64::from(value) * 1000)
}

fn choice<T: Copy, const N: usize>(value: u32, choices: [T; N]) -> Result<T, Refusal> {
    let place = usize::try_from(value).unwrap_or(usize::MAX);
    choices.get(place).copied().ok_or(Refusal::CameraRange)
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE: CameraRange = CameraRange {
        exposure: [Span::from_ns(20_000), Span::from_ms(500)],
        gain_db: [0.0, 24.0],
        black_level_dn: [0.0, 511.0],
        frame_rate_max_hz: 100.0,
        delay_max: Span::from_ms(1000),
        size_px: [64, 48],
    };

    fn at() -> Tai {
        Tai::from_ns(7)
    }

    /// Returns two cameras and a display.
    fn intake() -> CameraIntake {
        let mut intake = CameraIntake::default();
        intake.see(0, CameraView { range: Some(RANGE), places: 9 });
        intake.see(1, CameraView { range: Some(RANGE), places: 1 });
        intake.see(2, CameraView { range: None, places: 9 });
        intake
    }

    fn set(intake: &mut CameraIntake, kind: CameraKind, head: u8, value: u32) -> Result<(), Refusal> {
        intake.set(CameraSetting { kind: kind.number(), head, value }, at())
    }

    fn taken(intake: &mut CameraIntake) -> Vec<(usize, CameraCommand)> {
        core::iter::from_fn(|| intake.take()).map(|(head, commanded)| (head, commanded.command)).collect()
    }

    #[test]
    fn units_of_the_wire_are_those_of_the_camera() {
        let wanted = [
            (CameraKind::Exposure, 5000, CameraCommand::Exposure(Span::from_ms(5))),
            (CameraKind::Gain, 605, CameraCommand::GainDb(6.05)),
            (CameraKind::BlackLevel, 1032, CameraCommand::BlackLevelDn(64.5)),
            (CameraKind::FramePeriod, 10_000, CameraCommand::Period(Some(Span::from_ms(10)))),
            (CameraKind::FramePeriod, 0, CameraCommand::Period(None)),
            (CameraKind::Triggered, 1, CameraCommand::Triggered(true)),
            (CameraKind::TriggerDelay, 250, CameraCommand::Delay(Span::from_ns(250_000))),
            (CameraKind::TriggerOverlap, 2, CameraCommand::Overlap(TriggerOverlap::PreviousFrame)),
            (CameraKind::Burst, 3, CameraCommand::Burst(3)),
            (CameraKind::ExposureMode, 1, CameraCommand::Mode(ExposureMode::TriggerWidth)),
            (CameraKind::AutoExposure, 1, CameraCommand::AutoExposure(AutoMode::Once)),
            (CameraKind::AutoGain, 2, CameraCommand::AutoGain(AutoMode::Continuous)),
        ];
        for (kind, value, command) in wanted {
            let mut intake = intake();
            assert_eq!(set(&mut intake, kind, 0, value), Ok(()), "{kind:?}");
            assert_eq!(taken(&mut intake), [(0, command)]);
        }
    }

    #[test]
    fn impossible_command_is_refused_with_its_reason_and_not_stored() {
        let mut intake = intake();
        for (kind, head, value, wanted) in [
            (CameraKind::Exposure, 0, 19, Refusal::CameraRange),
            (CameraKind::Exposure, 0, u32::MAX, Refusal::CameraRange),
            (CameraKind::Gain, 0, 2401, Refusal::CameraRange),
            (CameraKind::Triggered, 0, 2, Refusal::CameraRange),
            (CameraKind::AutoGain, 0, 3, Refusal::CameraRange),
            (CameraKind::Burst, 0, 0, Refusal::CameraRange),
            (CameraKind::Report, 0, 2, Refusal::CameraRange),
            (CameraKind::Exposure, 2, 5000, Refusal::CameraUnsupported),
            (CameraKind::Exposure, 3, 5000, Refusal::UnknownHead),
            (CameraKind::Exposure, 254, 5000, Refusal::UnknownHead),
            (CameraKind::Exposure, ALL_HEADS, 5000, Refusal::CameraUnsupported),
        ] {
            assert_eq!(set(&mut intake, kind, head, value), Err(wanted), "{kind:?} of head {head} to {value}");
        }
        let later = CameraSetting { kind: 200, head: 0, value: 1 };
        assert_eq!(intake.set(later, at()), Err(Refusal::CameraUnsupported));
        assert_eq!(taken(&mut intake), [], "all heads or none");
        // Negative control: a value at the edge is taken.
        assert_eq!(set(&mut intake, CameraKind::Exposure, 0, 20), Ok(()));
        assert_eq!(taken(&mut intake).len(), 1);
        assert_eq!(CameraIntake::default().trigger(0, at()), Err(Refusal::UnknownHead), "no head was shown");
        assert_eq!(CameraIntake::default().trigger(ALL_HEADS, at()), Err(Refusal::UnknownHead));
    }

    #[test]
    fn command_for_all_heads_goes_to_each_and_the_place_after_the_last_is_refused() {
        let mut intake = intake();
        intake.see(2, CameraView { range: Some(RANGE), places: 3 });
        assert_eq!(intake.trigger(ALL_HEADS, at()), Ok(()));
        let trigger = CameraCommand::Trigger { source: TriggerSource::Bus, is_rising: true };
        assert_eq!(taken(&mut intake), [(0, trigger), (1, trigger), (2, trigger)]);
        assert_eq!(intake.trigger(ALL_HEADS, at()), Err(Refusal::CameraFull), "head 1 has no place left");
        assert_eq!((taken(&mut intake), intake.trigger(0, at())), (vec![], Ok(())));
    }

    #[test]
    fn status_is_off_until_it_is_asked_for_and_after_hello() {
        let mut intake = CameraIntake::default();
        assert!(!intake.is_reporting);
        assert_eq!(set(&mut intake, CameraKind::Report, 9, 1), Ok(()), "whatever the head");
        assert!(intake.is_reporting);
        intake.begin();
        assert!(!intake.is_reporting);
    }
}
