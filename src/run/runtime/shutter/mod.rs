//! When the exposures of a head start, how long they last, and with which settings.
//!
//! In: commands with their instants ([`Commanded`]). Out: the next slot, and the settings of its exposure. A command
//! acts from the first exposure that starts at or after its instant; an exposure that has started is not changed. The
//! next slot is a forecast until its frame is drawn: each command that comes before may move it. Without commands the
//! slots are those of the frame rate, to the nanosecond.
//!
//! Rules, after GenICam SFNC 2.7.1 and the manuals of global-shutter cameras:
//! * an exposure starts when the one before has ended, and so late that its readout does not meet the readout before;
//! * free running: one period after the start before, or as soon as the rules allow it;
//! * a readout lasts as long as its rows: of regions those that have a pixel in any of them;
//! * a command whose exposures do not fit into the run ends nothing: further commands may come until the end;
//! * by trigger: `delay` after the trigger. A trigger that comes too early for its overlap mode, or while another one
//!   waits, is missed: it is counted and reported, with no other effect. The first one after a free run is taken while
//!   the last exposure of that run is under way, and waits until it is over.
//!
//! Allocates nothing after construction. Tests: `tests`, and `hil_scripts/tests/test_camera.py`.

mod state;
#[cfg(test)]
mod tests;

use crate::runtime::slot::{Slot, Started};
use base::region::Regions;
use base::time::{Span, Tai};
use frames::camera_control::{CameraCommand, CameraRange, CameraSettings, Commanded, SettingRefusal, StartSettings};
use state::{Outcome, State};
use std::collections::VecDeque;

/// Capacity for commands that wait for the exposure that they act on.
const PLACES: usize = 256;
/// No frame is due sooner after its exposure than this, or than the readout of all rows.
const DUE_LEAST: Span = Span::from_ms(10);

/// Exposures of a head without commands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShutterParams {
    /// Start of the first exposure.
    pub first_exposure: Tai,
    /// Time from one exposure's start to the next.
    pub period: Span,
    /// Time from the end of an exposure to its frame when all rows are read out.
    pub readout: Span,
    /// Columns and rows of the image.
    pub size_px: [usize; 2],
    /// How long before the end of an exposure work on its frame starts.
    pub ahead: Span,
    /// No exposure starts at or after this instant, or lasts beyond it.
    pub end: Tai,
    /// Settings of exposures.
    pub settings: CameraSettings,
}

impl ShutterParams {
    /// Returns the time from the end of an exposure to its frame: the sensor reads out the rows that have a pixel in a
    /// region.
    fn readout_of(&self, regions: &Regions) -> Span {
        let rows = self.size_px[1];
        if regions.is_whole() || rows == 0 {
            return self.readout;
        }
        Span::from_s(self.readout.s() * (regions.rows(self.size_px) as f64 / rows as f64))
    }

    /// Returns the time from the end of an exposure to the instant at which its frame is due: its readout. That of few
    /// rows is shorter than drawing takes: such frames are due [`DUE_LEAST`] after the exposure, or with the readout of
    /// all rows where that is sooner.
    fn delivery_of(&self, regions: &Regions) -> Span {
        self.readout_of(regions).max(self.readout.min(DUE_LEAST))
    }
}

/// The next slot of a head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NextSlot {
    /// An exposure that has started, or will.
    Slot(Slot),
    /// Waiting for a trigger, or for a command after which an exposure fits into the run again, until this instant.
    Waiting(Tai),
    /// No further exposure fits into the run, and no client commands the camera.
    Over,
}

impl NextSlot {
    /// Returns the slot, if there is one.
    pub fn slot(self) -> Option<Slot> {
        match self {
            Self::Slot(slot) => Some(slot),
            Self::Waiting(_) | Self::Over => None,
        }
    }

    /// Returns true when no further frame can come at an instant.
    pub fn is_over(self, now: Tai) -> bool {
        match self {
            Self::Slot(_) => false,
            Self::Waiting(until) => now >= until,
            Self::Over => true,
        }
    }
}

/// Counts of triggers since the last call of [`Shutter::take_seen`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TriggersSeen {
    /// Accepted, each the start of an exposure or of a burst.
    pub accepted: u32,
    /// Missed: they came too early.
    pub missed: u32,
    /// Ignored: exposures do not wait for triggers, or not for those of this source.
    pub ignored: u32,
    /// Time of the last missed trigger.
    pub missed_at: Option<Tai>,
    /// Time of the last ignored trigger.
    pub ignored_at: Option<Tai>,
}

/// The times and settings of one head's exposures.
#[derive(Debug, Clone)]
pub struct Shutter {
    params: ShutterParams,
    /// Range of values that commands may set when the whole image is read out; `None` when nothing may be set, as for a
    /// display.
    whole_range: Option<CameraRange>,
    /// The same when the regions of the last command are read out.
    range: Option<CameraRange>,
    /// State after the last exposure that was drawn.
    state: State,
    /// Commands by rising instant; those of one instant in order of arrival.
    commands: VecDeque<Commanded>,
    /// True once a command was accepted: its sender may send another one.
    is_commanded: bool,
    next: NextSlot,
    settings: CameraSettings,
    seen: TriggersSeen,
}

impl Shutter {
    /// Returns a shutter; without a range every command is refused.
    pub fn new(params: ShutterParams, range: Option<CameraRange>) -> Self {
        let mut shutter = Self {
            params,
            whole_range: range,
            range,
            state: State::new(&params),
            commands: VecDeque::with_capacity(PLACES),
            is_commanded: false,
            next: NextSlot::Over,
            settings: params.settings,
            seen: TriggersSeen::default(),
        };
        shutter.forecast();
        shutter
    }

    /// Returns the range of values that commands may set; `None`: nothing.
    pub fn range(&self) -> Option<&CameraRange> {
        self.range.as_ref()
    }

    /// Returns the range of values that commands may set while these regions are read out.
    pub fn range_reading(&self, regions: &Regions) -> Option<CameraRange> {
        self.whole_range.map(|range| range.reading(regions))
    }

    /// Returns the start settings of exposures according to the commands up to the last exposure.
    pub fn start(&self) -> &StartSettings {
        self.state.start()
    }

    /// Returns the start settings of exposures according to all commands so far.
    pub fn next_start(&self) -> StartSettings {
        *self.walk().state.start()
    }

    /// Returns the next slot according to the commands so far.
    pub fn next(&self) -> NextSlot {
        self.next
    }

    /// Returns true when no exposure is under way and a trigger at this instant would start one.
    pub fn awaits_trigger(&self, at: Tai) -> bool {
        matches!(self.next, NextSlot::Waiting(_)) && self.commands.is_empty() && self.state.awaits_trigger(at)
    }

    /// Returns the settings of the next slot's exposure.
    pub fn settings(&self) -> &CameraSettings {
        &self.settings
    }

    /// Returns the counts of triggers since the last call.
    pub fn take_seen(&mut self) -> TriggersSeen {
        core::mem::take(&mut self.seen)
    }

    /// Returns how many further commands may wait.
    pub fn places(&self) -> usize {
        PLACES.saturating_sub(self.commands.len())
    }

    /// Accepts a command.
    ///
    /// # Errors
    /// When the camera cannot do it, or too many wait.
    pub fn take(&mut self, commanded: &Commanded) -> Result<(), SettingRefusal> {
        self.range.as_ref().ok_or(SettingRefusal::Unsupported)?.check(&commanded.command)?;
        if self.commands.len() >= PLACES && self.next.slot().is_none() {
            // No exposure is under way that they could act on: they act now, so that the next command has a place.
            let walk = self.walk();
            self.use_up(&walk);
        }
        if self.commands.len() >= PLACES {
            return Err(SettingRefusal::TooMany);
        }
        if let CameraCommand::Regions(regions) = &commanded.command {
            self.range = self.range_reading(regions);
        }
        let place = self.commands.partition_point(|other| other.at <= commanded.at);
        self.commands.insert(place, *commanded);
        self.is_commanded = true;
        self.forecast();
        Ok(())
    }

    /// Ends the forecast of the next slot: its frame is drawn now.
    pub fn advance(&mut self) {
        let NextSlot::Slot(slot) = self.next else { return };
        let walk = self.walk();
        self.use_up(&walk);
        self.state.expose(&slot, self.params.readout_of(&self.settings.regions));
        self.forecast();
    }

    /// Returns the slot of frame `number` without commands.
    pub fn nominal(&self, number: u32) -> Slot {
        let start = self.params.first_exposure + Span::from_ns(self.params.period.ns() * i64::from(number));
        self.slot(number, start, &self.params.settings, Started::Rate)
    }

    /// Returns the number of exposures of a run without commands: fewer than its periods where exposures, or their
    /// readouts, last longer than a period. They are evenly spaced: the number of all follows from the first two.
    pub fn own_exposures(&self) -> u64 {
        let mut alone = Self::new(self.params, self.whole_range);
        let Some(first) = alone.next.slot() else { return 0 };
        alone.advance();
        let Some(second) = alone.next.slot() else { return 1 };
        let step_ns = (second.exposure_start - first.exposure_start).ns();
        // Each starts before the end, and is over by then.
        let by_start_ns = (self.params.end - first.exposure_start).ns() - 1;
        let by_end_ns = (self.params.end + ROUNDING - first.exposure_end).ns();
        1 + (by_start_ns.min(by_end_ns) / step_ns).unsigned_abs()
    }

    /// Returns the settings of exposures without commands.
    pub fn nominal_settings(&self) -> &CameraSettings {
        &self.params.settings
    }

    /// Returns the slot of an exposure.
    pub fn slot(&self, number: u32, exposure_start: Tai, settings: &CameraSettings, started: Started) -> Slot {
        let exposure_end = exposure_start + settings.exposure;
        let release = exposure_end - self.params.ahead;
        let due = release + self.params.delivery_of(&settings.regions);
        Slot { number, exposure_start, exposure_end, release, due, started }
    }

    /// Computes the next slot for the case that no further command comes.
    fn forecast(&mut self) {
        let walk = self.walk();
        self.settings = walk.state.settings;
        let Some((start, started)) = walk.candidate else {
            // These commands act on no exposure that is under way.
            self.use_up(&walk);
            self.next = NextSlot::Waiting(self.params.end);
            return;
        };
        self.settings.exposure = self.exposure(&walk, started);
        let slot = self.slot(self.state.number(), start, &self.settings, started);
        let fits = start < self.params.end && slot.exposure_end <= self.params.end + ROUNDING;
        self.next = match fits {
            true => NextSlot::Slot(slot),
            false if self.is_commanded => NextSlot::Waiting(self.params.end),
            false => NextSlot::Over,
        };
    }

    /// Applies the commands up to the start of the next exposure.
    fn walk(&self) -> Walk {
        let (mut state, mut used, mut seen) = (self.state, 0, TriggersSeen::default());
        loop {
            let candidate = state.candidate(&self.params);
            match self.commands.get(used).filter(|next| candidate.is_none_or(|(start, _)| next.at <= start)) {
                None => return Walk { state, used, candidate, seen },
                Some(next) => {
                    used += 1;
                    match state.apply(next) {
                        Outcome::Set => {}
                        Outcome::Accepted => seen.accepted += 1,
                        Outcome::Ignored => (seen.ignored, seen.ignored_at) = (seen.ignored + 1, Some(next.at)),
                        Outcome::Missed => (seen.missed, seen.missed_at) = (seen.missed + 1, Some(next.at)),
                    }
                }
            }
        }
    }

    /// Removes the commands of a walk from the queue.
    fn use_up(&mut self, walk: &Walk) {
        self.commands.drain(..walk.used);
        self.state = walk.state;
        self.seen.accepted += walk.seen.accepted;
        self.seen.missed += walk.seen.missed;
        self.seen.ignored += walk.seen.ignored;
        self.seen.missed_at = walk.seen.missed_at.or(self.seen.missed_at);
        self.seen.ignored_at = walk.seen.ignored_at.or(self.seen.ignored_at);
    }

    /// Returns the length of the next exposure: as set, or as long as the line of its trigger is active.
    fn exposure(&self, walk: &Walk, started: Started) -> Span {
        let (true, Started::Trigger { source, at }) = (walk.state.is_by_width(), started) else {
            return walk.state.settings.exposure;
        };
        let [least, most] = self.range.as_ref().map_or([Span::ZERO, Span::ZERO], |range| range.exposure);
        let ends =
            |next: &&Commanded| next.at >= at && next.command == CameraCommand::Trigger { source, is_rising: false };
        let width = self.commands.iter().find(ends).map_or(most, |falling| falling.at - at);
        width.clamp(least, most)
    }
}

/// Tolerance for the separate rounding of exposure and period to nanoseconds.
const ROUNDING: Span = Span::from_ns(1000);

/// Result of applying the commands before the next exposure.
struct Walk {
    state: State,
    used: usize,
    /// Start of the next exposure and what starts it; `None` while waiting for a trigger.
    candidate: Option<(Tai, Started)>,
    seen: TriggersSeen,
}
