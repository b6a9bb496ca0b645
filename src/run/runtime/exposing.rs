//! One head's exposures as commands shape them: the shutter, the command queues of its clients, and automatic exposure.
//!
//! In: commands of queues ([`DeskEnd`]) and of the bus, images. Out: slots, the settings of the exposure that is drawn,
//! and events for clients. A refused or missed command is an event of the ledger.

use crate::runtime::ledger::{Event, EventKind, Ledger};
use crate::runtime::shutter::{NextSlot, Shutter, ShutterParams};
use crate::runtime::slot::{Slot, Started};
use crate::runtime::{camera_intake::CameraView, params::RunParams};
use base::image::DnImage;
use base::time::{Span, Tai};
use frames::camera_control::{
    AutoMode, CameraCommand, CameraEvent, CameraEventKind, CameraRange, CameraSettings, CommandSource, Commanded,
    DeskEnd, EXPOSURE_LEAST, GAIN_MAX_DB, Regions, SettingRefusal, StartSettings, longest_exposure_s,
};

/// Target of automatic exposure and gain: mean of the image as a share of full scale above the black level.
const AUTO_TARGET: f64 = 0.25;
/// Tolerance as a share of the target: within it nothing is changed, and `Once` is done.
const AUTO_NEAR: f64 = 0.02;
/// Largest factor by which one image changes the exposure or the gain, up or down.
const AUTO_STEP: f64 = 8.0;
/// Commands of one client that are taken in one look; the frame loop looks every millisecond.
const COMMANDS_PER_LOOK: usize = 16;

/// Times and settings of one exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exposed {
    /// Its first instant.
    pub start: Tai,
    /// The event that started it.
    pub started: Started,
    /// Its settings.
    pub settings: CameraSettings,
}

/// The exposures of one head.
#[derive(Debug)]
pub struct Exposing {
    shutter: Shutter,
    /// Settings of the exposure that is drawn.
    settings: CameraSettings,
    /// Exposure time without commands, and the same in seconds as given in the camera's file.
    own: (Span, f64),
    largest_dn: f64,
    /// True when a command was accepted.
    pub is_commanded: bool,
    has_line: bool,
    auto_exposure: AutoMode,
    auto_gain: AutoMode,
    desks: Vec<DeskEnd>,
    /// Number of the frame after the last one whose start was reported.
    reported: u32,
    /// Whether a trigger is awaited, as reported last; `None`: it is to be reported again.
    reported_awaited: Option<bool>,
}

impl Exposing {
    /// Returns the exposures of a run without commands so far.
    pub fn new(params: &RunParams) -> Self {
        let camera = &params.camera;
        let own = Span::from_s(camera.exposure_s);
        let settings = CameraSettings {
            exposure: own,
            gain_db: 0.0,
            black_level_dn: camera.detector.black_level_dn,
            regions: Regions::WHOLE,
        };
        let shutter = ShutterParams {
            first_exposure: params.first_exposure,
            period: params.frame_period,
            readout: Span::from_s(camera.readout_s),
            size_px: camera.output().size_px,
            ahead: params.ahead,
            end: params.exposure_start(params.frames),
            settings,
        };
        // A display has no exposure time to command.
        let is_sensor = params.drawn_from_sensor.is_none() && params.ahead == Span::ZERO;
        let range = is_sensor.then(|| range_of(params));
        Self {
            shutter: Shutter::new(shutter, range),
            settings,
            own: (own, camera.exposure_s),
            largest_dn: f64::from(camera.detector.largest_dn()),
            is_commanded: false,
            has_line: false,
            auto_exposure: AutoMode::Off,
            auto_gain: AutoMode::Off,
            desks: Vec::new(),
            reported: 0,
            reported_awaited: None,
        }
    }

    /// Returns the range of values that commands may set; `None` when nothing may be set, as for a display.
    pub fn range(&self) -> Option<&CameraRange> {
        self.shutter.range()
    }

    /// Returns the range of values that commands may set while these regions are read out.
    pub fn range_reading(&self, regions: &Regions) -> Option<CameraRange> {
        self.shutter.range_reading(regions)
    }

    /// Returns the range of values that commands may set, and how many more commands may wait.
    pub fn view(&self) -> CameraView {
        CameraView { range: self.range().copied(), places: self.shutter.places() }
    }

    /// Accepts commands from this queue from here on, and reports events to it. Allocates.
    pub fn add_desk(&mut self, desk: DeskEnd) {
        self.desks.push(desk);
    }

    /// Returns true when a client may command the camera at any instant.
    pub fn has_desks(&self) -> bool {
        !self.desks.is_empty()
    }

    /// Records that edges of a line trigger this head.
    pub fn set_has_line(&mut self) {
        self.has_line = true;
    }

    /// Returns true when edges of a line trigger this head.
    pub fn has_line(&self) -> bool {
        self.has_line
    }

    /// Returns the number of exposures of a run without commands.
    pub fn own_exposures(&self) -> u64 {
        self.shutter.own_exposures()
    }

    /// Returns the next slot according to the commands so far.
    pub fn next(&self) -> NextSlot {
        self.shutter.next()
    }

    /// Returns the start settings of exposures according to the commands up to the last exposure.
    pub fn start(&self) -> &StartSettings {
        self.shutter.start()
    }

    /// Returns the start settings of exposures according to all commands so far.
    pub fn next_start(&self) -> StartSettings {
        self.shutter.next_start()
    }

    /// Returns the settings of the next exposure according to the commands so far.
    pub fn next_settings(&self) -> &CameraSettings {
        self.shutter.settings()
    }

    /// Returns the slot of frame `number` without commands.
    pub fn nominal(&self, number: u32) -> Slot {
        self.shutter.nominal(number)
    }

    /// Returns the times and settings of the exposure of the slot that is drawn; `None` until the first command.
    pub fn exposed(&self, slot: &Slot) -> Option<Exposed> {
        let Slot { exposure_start: start, started, .. } = *slot;
        self.is_commanded.then_some(Exposed { start, started, settings: self.settings })
    }

    /// Draws frame `number` as it was exposed in another run; returns its slot. `None` uses the settings of the
    /// camera's file.
    pub fn repeat(&mut self, number: u32, exposed: Option<&Exposed>) -> Slot {
        let Some(Exposed { start, started, settings }) = exposed else {
            self.settings = *self.shutter.nominal_settings();
            return self.shutter.nominal(number);
        };
        self.settings = *settings;
        self.shutter.slot(number, *start, settings, *started)
    }

    /// Starts drawing the frame of the next slot: its settings are in use from here on.
    pub fn begin(&mut self, ledger: &mut Ledger) {
        if let NextSlot::Slot(slot) = self.shutter.next() {
            self.report_start(&slot);
            self.report(CameraEventKind::ExposureEnd, slot.exposure_end, slot.number);
        }
        self.settings = *self.shutter.settings();
        self.shutter.advance();
        self.note_triggers(ledger);
    }

    /// Returns the settings of a slot that is drawn or comes next.
    pub fn settings_of(&self, slot: &Slot) -> &CameraSettings {
        let is_next = self.shutter.next().slot().is_some_and(|next| next.number == slot.number);
        if is_next { self.shutter.settings() } else { &self.settings }
    }

    /// Returns the settings of the exposure that is drawn.
    pub fn settings(&self) -> &CameraSettings {
        &self.settings
    }

    /// Returns the time of the exposure that is drawn, s.
    pub fn exposure_s(&self) -> f64 {
        let (own, own_s) = self.own;
        if self.settings.exposure == own { own_s } else { self.settings.exposure.s() }
    }

    /// Returns the ratio of that time to the camera's own: 1 without commands.
    pub fn light_factor(&self) -> f64 {
        self.exposure_s() / self.own.1
    }

    /// Accepts commands that wait in the queues, no more than `COMMANDS_PER_LOOK` of each, and reports an exposure
    /// that has started. A client that sends faster has full queues; frames do not wait for it.
    pub fn poll(&mut self, now: Tai, ledger: &mut Ledger) {
        for number in 0..self.desks.len() {
            for _ in 0..COMMANDS_PER_LOOK {
                let Some(commanded) = self.desks[number].commands().next() else { break };
                // A refused command is recorded as an event; the sender has checked the value against the same range.
                let _noted = self.take(&commanded, ledger);
            }
        }
        if let NextSlot::Slot(slot) = self.shutter.next()
            && slot.exposure_start <= now
        {
            self.report_start(&slot);
        }
        self.report_awaited(now);
    }

    /// Accepts one command.
    ///
    /// # Errors
    /// When the camera cannot do it; the ledger records it too.
    pub fn take(&mut self, commanded: &Commanded, ledger: &mut Ledger) -> Result<(), SettingRefusal> {
        let taken = self.shutter.take(commanded);
        self.is_commanded |= taken.is_ok();
        if matches!(commanded.command, CameraCommand::Trigger { .. }) {
            // Its sender presumes that no other one is awaited.
            self.reported_awaited = None;
        }
        if taken.is_ok() {
            if let CameraCommand::AutoExposure(mode) = commanded.command {
                self.auto_exposure = mode;
            }
            if let CameraCommand::AutoGain(mode) = commanded.command {
                self.auto_gain = mode;
            }
        }
        let is_automatic = commanded.from == CommandSource::Automatic;
        if taken.is_err() || !is_automatic {
            let kind = if taken.is_ok() { EventKind::CameraCommand } else { EventKind::CameraRefused };
            ledger.note(Event::new(kind, commanded.at, None, Span::ZERO));
        }
        self.note_triggers(ledger);
        taken
    }

    /// Measures the image that was drawn, and commands exposure and gain where they are automatic.
    pub fn see(&mut self, image: &DnImage, at: Tai, ledger: &mut Ledger) {
        if (self.auto_exposure, self.auto_gain) == (AutoMode::Off, AutoMode::Off) {
            return;
        }
        let black_dn = self.settings.black_level_dn;
        let full_dn = self.largest_dn - black_dn;
        let sum: u64 = image.pixels().iter().map(|dn| u64::from(*dn)).sum();
        // Pixels that are not read out are 0.
        let pixels = self.settings.regions.pixels([image.width(), image.height()]);
        let mean_dn = sum as f64 / pixels.max(1) as f64 - black_dn;
        let wanted = AUTO_TARGET * full_dn / mean_dn.max(1e-3 * full_dn);
        if (wanted - 1.0).abs() <= AUTO_NEAR {
            self.end_once(at);
            return;
        }
        let factor = wanted.clamp(1.0 / AUTO_STEP, AUTO_STEP);
        let Some(command) = self.automatic(factor) else { return };
        let _noted = self.take(&Commanded { command, at, from: CommandSource::Automatic }, ledger);
        let frame = self.reported;
        if let CameraCommand::Exposure(exposure) = command {
            self.report(CameraEventKind::ExposureChosen(exposure), at, frame);
        }
        if let CameraCommand::GainDb(gain_db) = command {
            self.report(CameraEventKind::GainChosen(gain_db), at, frame);
        }
    }

    /// Ends automatic exposure and gain that were set to work once.
    fn end_once(&mut self, at: Tai) {
        let frame = self.reported;
        if self.auto_exposure == AutoMode::Once {
            self.auto_exposure = AutoMode::Off;
            self.report(CameraEventKind::ExposureAutoDone, at, frame);
        }
        if self.auto_gain == AutoMode::Once {
            self.auto_gain = AutoMode::Off;
            self.report(CameraEventKind::GainAutoDone, at, frame);
        }
    }

    /// Returns the command that makes the image brighter by `factor`: it changes the exposure first, then the gain.
    fn automatic(&self, factor: f64) -> Option<CameraCommand> {
        let range = self.shutter.range()?;
        let before = self.settings.exposure;
        let exposure = Span::from_s(before.s() * factor).clamp(range.exposure[0], range.exposure[1]);
        if self.auto_exposure != AutoMode::Off && exposure != before {
            return Some(CameraCommand::Exposure(exposure));
        }
        let gain_db = (self.settings.gain_db + 20.0 * factor.log10()).clamp(range.gain_db[0], range.gain_db[1]);
        let is_changed = self.auto_gain != AutoMode::Off && gain_db.total_cmp(&self.settings.gain_db).is_ne();
        is_changed.then_some(CameraCommand::GainDb(gain_db))
    }

    fn note_triggers(&mut self, ledger: &mut Ledger) {
        let seen = self.shutter.take_seen();
        let number = self.shutter.next().slot().map(|slot| slot.number);
        if let Some(at) = seen.missed_at {
            ledger.note_many(Event::new(EventKind::CameraTriggerMissed, at, number, Span::ZERO), seen.missed.into());
            for _ in 0..seen.missed {
                self.report(CameraEventKind::FrameTriggerMissed, at, number.unwrap_or(0));
            }
        }
        if let Some(at) = seen.ignored_at {
            ledger.note_many(Event::new(EventKind::CameraTriggerIgnored, at, number, Span::ZERO), seen.ignored.into());
        }
    }

    fn report_start(&mut self, slot: &Slot) {
        if self.reported > slot.number {
            return;
        }
        self.reported = slot.number + 1;
        if let Started::Trigger { at, .. } = slot.started {
            self.report(CameraEventKind::FrameTrigger, at, slot.number);
        }
        self.report(CameraEventKind::ExposureStart, slot.exposure_start, slot.number);
    }

    fn report_awaited(&mut self, now: Tai) {
        let is_awaited = self.shutter.awaits_trigger(now);
        if self.reported_awaited != Some(is_awaited) && self.has_desks() {
            self.reported_awaited = Some(is_awaited);
            self.report(CameraEventKind::TriggerAwaited(is_awaited), now, self.reported);
        }
    }

    fn report(&self, kind: CameraEventKind, at: Tai, frame: u32) {
        for desk in &self.desks {
            desk.report(CameraEvent { kind, at, frame });
        }
    }
}

/// Returns the range of values that the commands of a run may set on its camera.
fn range_of(params: &RunParams) -> CameraRange {
    let camera = &params.camera;
    let own = Span::from_s(camera.exposure_s);
    let longest = Span::from_s(longest_exposure_s(camera.exposure_s));
    let least_period_s = if camera.readout_s > params.frame_period.s() { 0.0 } else { camera.readout_s };
    let detector = &camera.detector;
    CameraRange {
        exposure: [EXPOSURE_LEAST.min(own), longest],
        gain_db: [0.0, GAIN_MAX_DB],
        black_level_dn: [0.0, f64::from(detector.largest_dn()).max(2.0 * detector.black_level_dn) / 2.0],
        frame_rate_max_hz: 1.0 / least_period_s.max(EXPOSURE_LEAST.s()),
        delay_max: Span::from_ms(10_000),
        size_px: camera.output().size_px,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wiring::bench_parts::run_params;
    use config::{Document, Scenario};
    use frames::camera_control::desk;
    use std::path::Path;

    #[test]
    fn a_flood_of_commands_is_taken_in_bounded_pieces() {
        let document = Document::open(Path::new("benches/loopback.toml")).unwrap();
        let bench = Scenario::from_document(&document).unwrap().bench;
        let mut exposing = Exposing::new(&run_params(&bench, Tai::from_ns(0)).unwrap());
        let (desk, end) = desk();
        exposing.add_desk(end);
        let (mut ledger, at) = (Ledger::default(), Tai::from_ns(0));
        let command = CameraCommand::Exposure(Span::from_ms(1));
        let mut taken = || {
            let put = (0..1000).filter(|_| desk.put(Commanded { command, at, from: CommandSource::Control })).count();
            let before = ledger.total();
            exposing.poll(at, &mut ledger);
            (put, ledger.total() - before)
        };
        assert_eq!(
            taken(),
            (256, COMMANDS_PER_LOOK as u64),
            "as many as the queue holds, and no more than a look takes"
        );
        assert_eq!(taken(), (COMMANDS_PER_LOOK, COMMANDS_PER_LOOK as u64));
    }
}
