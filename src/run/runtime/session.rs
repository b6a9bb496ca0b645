//! The conversation with the flight computer: HELLO, RUN, STOP, tables of parameters, triggers, camera commands,
//! heartbeats.
//!
//! In: commands and heartbeats, stamped. Out: answers, whether frames show stars, events when a peer is refused, falls
//! silent or returns. One answer per command; a retry gets the same answer and changes nothing (the protocol's
//! `handshake`). Limits: on one bus every sender of commands for this node is the same flight computer. Tests: below,
//! and `tests/closed_loop/session.rs`.
//!
//! A value for each head of a run.

use crate::runtime::camera_intake::CameraIntake;
use crate::runtime::ledger::{Event, EventKind, Ledger};
use crate::runtime::slot::Slot;
use crate::runtime::triggers::{FiredTrigger, Taken, Triggers, instant_of};
use base::time::{Span, Tai};
use config::{SessionParams, SessionStart};
use firmware_protocol::handshake::{Answer, Handshake, Takes};
use firmware_protocol::message::{
    CameraSetting, CameraTrigger, Command, Heartbeat, Rates, Refusal, Reply, Request, Trigger, Triggered, capability,
};
use firmware_protocol::tables::TableStore;
use firmware_protocol::{DBC_CRC32, version};
use frames::report::FrameEnd;
use plan::attitude::ClockEstimate;

/// Rates that are guaranteed to be accepted; faster records are accepted too.
const RATES: Rates = Rates { attitude_hz: 100, jitter_hz: 1000 };
/// Optional capabilities of the stimulator besides attitude.
const CAPABILITIES: u16 = capability::PARAMETER_TABLES
    | capability::JITTER_SAMPLES
    | capability::WHEELS
    | capability::TRIGGERS
    | capability::CAMERA;

/// The state of the conversation.
#[derive(Debug, Clone)]
pub struct Session {
    params: SessionParams,
    handshake: Handshake,
    /// The parameter tables in effect.
    pub tables: TableStore,
    /// The waiting triggers of each head: every head takes them by its own exposures.
    pub triggers: PerHead<Triggers>,
    /// The camera commands taken in.
    pub cameras: CameraIntake,
    /// True when stopped or refused since the last RUN.
    is_halted: bool,
    /// True when it was a STOP.
    is_halted_by_stop: bool,
    /// True when frames have shown stars.
    has_rendered: bool,
    /// Arrival of the last heartbeat.
    last_heartbeat: Option<Tai>,
    is_silent: bool,
    /// True when its last heartbeat was of another major version.
    is_foreign: bool,
}

impl Session {
    /// Returns the state before the first message.
    pub fn new(params: SessionParams) -> Self {
        let handshake = Handshake::new(DBC_CRC32, RATES).with_capabilities(CAPABILITIES);
        Self {
            params,
            handshake,
            tables: TableStore::new(),
            triggers: PerHead::new(Triggers::default()),
            cameras: CameraIntake::default(),
            is_halted: false,
            is_halted_by_stop: false,
            has_rendered: params.start == SessionStart::AtOnce,
            last_heartbeat: None,
            is_silent: false,
            is_foreign: false,
        }
    }

    /// Adds the next head, before anything is received.
    pub(super) fn add_head(&mut self) {
        self.triggers.push(self.triggers.of(0).beside());
    }

    /// Accepts triggers of this number from now on; all others are refused.
    pub fn expect_trigger(&mut self, number: u16) {
        self.triggers.each(|head| head.expect(number));
    }

    /// Passes the triggers of a head that act by the end of a slot's exposure to `fire`, by rising time, each once for each
    /// head; the first head's are recorded. Allocates nothing.
    pub fn fire_triggers(&mut self, head: usize, slot: Slot, ledger: &mut Ledger, fire: &mut dyn FnMut(FiredTrigger)) {
        while let Some(fired) = self.triggers.of_mut(head).next(slot.exposure_end) {
            if head == 0 {
                let ahead = slot.exposure_end - fired.at;
                ledger.note(Event::new(EventKind::TriggerFired, fired.at, Some(slot.number), ahead));
            }
            fire(fired);
        }
    }

    /// Returns true when frames show the received attitude.
    pub fn is_rendering(&self) -> bool {
        match self.params.start {
            SessionStart::AtOnce => !self.is_halted,
            SessionStart::OnRun => self.handshake.is_running(),
        }
    }

    /// Returns what a frame counts as while the session is not running.
    pub fn end_while_dark(&self) -> FrameEnd {
        match (self.has_rendered, self.is_halted_by_stop) {
            (false, _) => FrameEnd::BlankAtStart,
            (true, true) => FrameEnd::Commanded,
            (true, false) => FrameEnd::Blank,
        }
    }

    /// Returns the single answer to a command that arrived at `at`; `clock` is the estimate of the flight computer's
    /// clock.
    pub fn answer(&mut self, command: &Command, at: Tai, clock: Option<&ClockEstimate>, ledger: &mut Ledger) -> Answer {
        let was_rendering = self.is_rendering();
        let (triggers, cameras) = (&mut self.triggers, &mut self.cameras);
        let mut taking = Taking { triggers, cameras, clock, at, trigger: None, is_camera_refused: false };
        let answer = self.handshake.answer_by(command, &mut self.tables, &mut taking);
        let Taking { trigger: taken, is_camera_refused, .. } = taking;
        if is_camera_refused {
            ledger.note(Event::new(EventKind::CameraRefused, at, None, Span::ZERO));
        }
        if matches!(command.request, Request::Hello(_)) {
            self.cameras.begin();
        }
        match (command.request, answer.response.reply) {
            (Request::Hello(_), Reply::Refused { .. }) => {
                (self.is_halted, self.is_halted_by_stop) = (true, false);
                self.forget_triggers(at, ledger);
                ledger.note(Event::new(EventKind::VersionRefused, at, None, Span::ZERO));
            }
            (Request::Stop, Reply::Stop) => {
                (self.is_halted, self.is_halted_by_stop) = (true, true);
                self.forget_triggers(at, ledger);
            }
            (Request::Run, Reply::Run) => (self.is_halted, self.has_rendered) = (false, true),
            (_, Reply::Triggered(_)) => self.note_trigger(taken, at, ledger),
            (Request::Trigger(_), Reply::Refused { reason, .. }) if reason != Refusal::NoHandshake => {
                self.note_trigger(taken, at, ledger);
            }
            (Request::Camera(_) | Request::CameraTrigger(_), Reply::Refused { reason, .. })
                if reason != Refusal::NoHandshake => {}
            (_, Reply::Refused { .. }) => ledger.note(Event::new(EventKind::CommandRefused, at, None, Span::ZERO)),
            _ => {}
        }
        match (was_rendering, self.is_rendering()) {
            (false, true) => ledger.note(Event::new(EventKind::SessionRun, at, None, Span::ZERO)),
            (true, false) => ledger.note(Event::new(EventKind::SessionHalt, at, None, Span::ZERO)),
            _ => {}
        }
        answer
    }

    /// Records that a trigger was accepted or refused, or counts its repeat.
    fn note_trigger(&mut self, taken: Option<Result<Taken, Refusal>>, at: Tai, ledger: &mut Ledger) {
        match taken {
            Some(Ok(Taken { triggered, ahead })) if triggered.is_late => {
                ledger.note(Event::new(EventKind::TriggerLate, at, None, Span::from_ns(-ahead.ns())));
            }
            Some(Err(_)) => ledger.note(Event::new(EventKind::TriggerRefused, at, None, Span::ZERO)),
            Some(Ok(Taken { ahead, .. })) => ledger.note(Event::new(EventKind::TriggerTaken, at, None, ahead)),
            None => self.triggers.each(Triggers::count_repeat),
        }
    }

    fn forget_triggers(&mut self, at: Tai, ledger: &mut Ledger) {
        let forgotten = self.triggers.each(Triggers::forget);
        note_forgotten(forgotten, at, ledger);
    }

    /// Discards the triggers that wait for an instant of a clock that has restarted.
    pub fn forget_dated_triggers(&mut self, at: Tai, ledger: &mut Ledger) {
        let forgotten = self.triggers.each(Triggers::forget_dated);
        note_forgotten(forgotten, at, ledger);
    }

    /// Moves the waiting triggers to their instants on a clock that has stepped, and discards those that are then out
    /// of range.
    pub fn step_triggers(&mut self, clock: &ClockEstimate, at: Tai, ledger: &mut Ledger) {
        let forgotten = self.triggers.each(|head| head.follow_step(clock, at));
        note_forgotten(forgotten, at, ledger);
    }

    /// Accepts a heartbeat of the flight computer.
    pub fn take_in(&mut self, heartbeat: &Heartbeat, at: Tai, ledger: &mut Ledger) {
        let is_foreign = heartbeat.major != version::MAJOR;
        if is_foreign && !self.is_foreign {
            ledger.note(Event::new(EventKind::VersionRefused, at, None, Span::ZERO));
        }
        self.is_foreign = is_foreign;
        if let (true, Some(last)) = (self.is_silent, self.last_heartbeat) {
            ledger.note(Event::new(EventKind::HeartbeatBack, at, None, at - last));
        }
        self.is_silent = false;
        self.last_heartbeat = self.last_heartbeat.max(Some(at));
    }

    /// Detects, once each time, that heartbeats have stopped.
    pub fn watch(&mut self, now: Tai, ledger: &mut Ledger) {
        let silence = self.last_heartbeat.map_or(Span::ZERO, |last| now - last);
        if !self.is_silent && silence > self.params.heartbeat_timeout {
            self.is_silent = true;
            ledger.note(Event::new(EventKind::HeartbeatLost, now, None, silence));
        }
    }
}

/// Executes what one command requests beyond the handshake.
struct Taking<'a> {
    triggers: &'a mut PerHead<Triggers>,
    cameras: &'a mut CameraIntake,
    clock: Option<&'a ClockEstimate>,
    at: Tai,
    /// Result of the trigger; `None` without one, and for a repeat.
    trigger: Option<Result<Taken, Refusal>>,
    /// False for a repeat.
    is_camera_refused: bool,
}

impl Takes for Taking<'_> {
    fn trigger(&mut self, trigger: Trigger) -> Result<Triggered, Refusal> {
        let (clock, at) = (self.clock, self.at);
        let result = self.triggers.each(|head| head.take(trigger, clock, at));
        self.trigger = Some(result);
        result.map(|taken| taken.triggered)
    }

    fn camera(&mut self, setting: CameraSetting) -> Result<(), Refusal> {
        let set = self.cameras.set(setting, self.at);
        self.is_camera_refused = set.is_err();
        set
    }

    fn camera_trigger(&mut self, trigger: CameraTrigger) -> Result<bool, Refusal> {
        let taken = instant_of(trigger.at_us, self.clock, self.at).and_then(|instant| {
            self.cameras.trigger(trigger.head, instant.at)?;
            Ok(instant.ahead < Span::ZERO)
        });
        self.is_camera_refused = taken.is_err();
        taken
    }
}

fn note_forgotten(forgotten: u64, at: Tai, ledger: &mut Ledger) {
    for _ in 0..forgotten {
        ledger.note(Event::new(EventKind::TriggerForgotten, at, None, Span::ZERO));
    }
}

/// A value for each head of a run; at least one.
#[derive(Debug, Clone)]
pub struct PerHead<T> {
    first: T,
    others: Vec<T>,
}

impl<T> PerHead<T> {
    /// Returns the value of a run with one head.
    pub(super) fn new(first: T) -> Self {
        Self { first, others: Vec::new() }
    }

    /// Adds the value of the next head.
    pub(super) fn push(&mut self, next: T) {
        self.others.push(next);
    }

    /// Returns the value of a head; of the first one when the head does not exist.
    pub fn of(&self, head: usize) -> &T {
        head.checked_sub(1).and_then(|place| self.others.get(place)).unwrap_or(&self.first)
    }

    /// Returns the value of a head for changes; of the first one when the head does not exist.
    pub fn of_mut(&mut self, head: usize) -> &mut T {
        match head.checked_sub(1) {
            Some(place) if place < self.others.len() => &mut self.others[place],
            _ => &mut self.first,
        }
    }

    /// Does the same to the value of every head; returns the first one's result.
    pub(super) fn each<R>(&mut self, mut act: impl FnMut(&mut T) -> R) -> R {
        let result = act(&mut self.first);
        self.others.iter_mut().for_each(|other| drop(act(other)));
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_protocol::message::{NodeState, Trigger};
    use firmware_protocol::version::Version;

    fn at_ms(ms: i64) -> Tai {
        Tai::from_ns(ms * 1_000_000)
    }

    struct Talk {
        session: Session,
        ledger: Ledger,
        token: u8,
    }

    fn talk(start: SessionStart) -> Talk {
        let params = SessionParams { start, ..SessionParams::default() };
        Talk { session: Session::new(params), ledger: Ledger::default(), token: 0 }
    }

    impl Talk {
        fn say(&mut self, request: Request) -> Reply {
            self.token += 1;
            let command = Command { token: self.token, request };
            self.session.answer(&command, at_ms(0), None, &mut self.ledger).response.reply
        }

        fn count(&self, kind: EventKind) -> u64 {
            self.ledger.count(kind)
        }
    }

    #[test]
    fn on_run_nothing_is_shown_before_hello_and_run_and_nothing_after_stop() {
        let mut talk = talk(SessionStart::OnRun);
        assert!(!talk.session.is_rendering());
        assert!(matches!(talk.say(Request::Run), Reply::Refused { .. }), "no HELLO yet");
        assert_eq!((talk.session.is_rendering(), talk.count(EventKind::CommandRefused)), (false, 1));
        talk.say(Request::Hello(version::CURRENT));
        assert!(!talk.session.is_rendering(), "not yet");
        talk.say(Request::Run);
        assert!(talk.session.is_rendering());
        talk.say(Request::Stop);
        assert!(!talk.session.is_rendering());
        assert_eq!((talk.count(EventKind::SessionRun), talk.count(EventKind::SessionHalt)), (1, 1));
    }

    #[test]
    fn at_once_stars_are_shown_until_a_stop_or_a_peer_of_another_major() {
        let mut talk = talk(SessionStart::AtOnce);
        assert!(talk.session.is_rendering());
        talk.say(Request::Hello(Version { major: version::MAJOR + 1, minor: 0 }));
        assert_eq!((talk.session.is_rendering(), talk.count(EventKind::VersionRefused)), (false, 1));
        assert!(matches!(talk.say(Request::Run), Reply::Refused { .. }), "another major may not run");
        assert!(!talk.session.is_rendering());
        talk.say(Request::Hello(version::CURRENT));
        talk.say(Request::Run);
        assert!(talk.session.is_rendering());
    }

    #[test]
    fn trigger_that_nothing_waits_for_is_refused_noted_once_and_not_fired() {
        let mut talk = talk(SessionStart::AtOnce);
        talk.session.expect_trigger(3);
        talk.say(Request::Hello(version::CURRENT));
        let trigger = |number| Request::Trigger(Trigger { number, at_us: 0 });
        let refused = Reply::Refused { opcode: 6, reason: Refusal::UnknownTrigger };
        assert_eq!(talk.say(trigger(7)), refused);
        talk.token -= 1;
        assert_eq!(talk.say(trigger(7)), refused, "the repeat");
        let counts = talk.session.triggers.of(0).counts();
        assert_eq!((counts.refused, counts.repeated, talk.session.triggers.of(0).waiting()), (1, 1, 0));
        assert_eq!((talk.count(EventKind::TriggerRefused), talk.count(EventKind::CommandRefused)), (1, 0));
        // Negative control: the number that a fault waits for is accepted.
        assert!(matches!(talk.say(trigger(3)), Reply::Triggered(_)));
        assert_eq!((talk.count(EventKind::TriggerRefused), talk.count(EventKind::TriggerTaken)), (1, 1));
    }

    #[test]
    fn refused_camera_commands_are_noted_once_and_hello_ends_reports() {
        let mut talk = talk(SessionStart::AtOnce);
        let setting = |kind, value| Request::Camera(CameraSetting { kind, head: 0, value });
        assert_eq!(talk.say(setting(12, 1)), Reply::Refused { opcode: 7, reason: Refusal::NoHandshake });
        assert_eq!((talk.count(EventKind::CommandRefused), talk.count(EventKind::CameraRefused)), (1, 0));
        talk.say(Request::Hello(version::CURRENT));
        let refused = Reply::Refused { opcode: 7, reason: Refusal::UnknownHead };
        assert_eq!(talk.say(setting(1, 5000)), refused, "no head was shown");
        talk.token -= 1;
        assert_eq!(talk.say(setting(1, 5000)), refused, "the repeat");
        assert_eq!((talk.count(EventKind::CommandRefused), talk.count(EventKind::CameraRefused)), (1, 1));
        assert!(matches!(talk.say(setting(12, 1)), Reply::CameraSet(_)));
        assert!(talk.session.cameras.is_reporting);
        talk.say(Request::Hello(version::CURRENT));
        assert!(!talk.session.cameras.is_reporting);
        let early = Request::CameraTrigger(CameraTrigger { head: 0, at_us: 7 });
        assert_eq!(talk.say(early), Reply::Refused { opcode: 8, reason: Refusal::NoTimeYet });
    }

    #[test]
    fn silence_is_reported_once_and_so_is_its_end() {
        let mut talk = talk(SessionStart::AtOnce);
        let beat = Heartbeat { state: NodeState::Running, major: version::MAJOR };
        talk.session.watch(at_ms(60_000), &mut talk.ledger);
        assert_eq!(talk.count(EventKind::HeartbeatLost), 0, "who never spoke is not silent");
        talk.session.take_in(&beat, at_ms(0), &mut talk.ledger);
        for ms in [3_500, 3_501, 9_000] {
            talk.session.watch(at_ms(ms), &mut talk.ledger);
            assert_eq!(talk.count(EventKind::HeartbeatLost), u64::from(ms > 3_500), "{ms} ms");
        }
        talk.session.take_in(&beat, at_ms(10_000), &mut talk.ledger);
        talk.session.take_in(&beat, at_ms(11_000), &mut talk.ledger);
        assert_eq!(talk.count(EventKind::HeartbeatBack), 1);
    }
}
