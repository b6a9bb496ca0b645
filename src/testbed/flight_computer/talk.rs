//! The flight computer's side of the session: HELLO, INFO, RUN, then triggers and camera commands; each said again
//! until it is answered.
//!
//! In: time, commands to say, responses. Out: commands when due, one at a time. A refusal of HELLO, INFO or RUN ends
//! the talk: nothing is said any more; that of a later command is counted. Limits: one talk per boot, begun with the
//! stream. Tests: below, `tests/closed_loop/session.rs` and `triggers.rs`.
//! Messages received are counted, and the last of each kind is kept ([`Received`]).

use firmware_protocol::message::{CameraStatus, Command, Exposure, Refusal, Reply, Request, Response, StatusPage};
use firmware_protocol::{Message, version};
use link::Stamped;
use std::collections::VecDeque;

/// A command that is not answered is said again after this, us.
const RETRY_US: u64 = 500_000;

/// Requests that start a session, in this order.
const WORDS: [Request; 3] = [Request::Hello(version::CURRENT), Request::Info { page: 0 }, Request::Run];

/// The first word comes this long after the stream's begin, behind the first time mark, us.
pub(super) const BEGIN_US: u64 = 5_000;

/// Commands that may wait to be said.
pub(super) const WAITING_MAX: usize = 64;

/// Answers of the stimulator to triggers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TriggerAnswers {
    /// Taken.
    pub taken: u64,
    /// Of those, the ones that came after their instant.
    pub late: u64,
    /// Refused.
    pub refused: u64,
}

/// Answers of the stimulator to camera commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CameraAnswers {
    /// Settings taken.
    pub set: u64,
    /// Triggers taken.
    pub triggered: u64,
    /// Of those, the ones that came after their instant.
    pub late: u64,
    /// Refused.
    pub refused: u64,
    /// Why the last one was refused.
    pub last_refusal: Option<Refusal>,
}

/// How far the talk is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Talk {
    /// Word that is to be said or waits for its answer.
    word: usize,
    due_us: u64,
    is_refused: bool,
    /// The first is being said.
    waiting: VecDeque<Request>,
    /// The answers of the stimulator to triggers.
    pub(super) answers: TriggerAnswers,
    /// The answers of the stimulator to camera commands.
    pub(super) camera: CameraAnswers,
}

impl Talk {
    /// Returns a talk that begins at `start_us`.
    pub(super) fn new(start_us: u64) -> Self {
        let (answers, camera) = (TriggerAnswers::default(), CameraAnswers::default());
        let waiting = VecDeque::with_capacity(WAITING_MAX);
        Self { word: 0, due_us: start_us, is_refused: false, waiting, answers, camera }
    }

    /// Returns when the next word is due; `u64::MAX` when all is said.
    pub(super) fn next_us(&self) -> u64 {
        if self.is_refused || self.request().is_none() { u64::MAX } else { self.due_us }
    }

    /// Says a command as soon as what is before it has been answered; false when too many wait already.
    pub(super) fn say(&mut self, request: Request, now_us: u64) -> bool {
        if self.waiting.len() >= WAITING_MAX {
            return false;
        }
        if self.request().is_none() {
            self.due_us = now_us;
        }
        self.waiting.push_back(request);
        true
    }

    /// Returns the request that is sent until it is answered.
    fn request(&self) -> Option<Request> {
        WORDS.get(self.word).copied().or(self.waiting.front().copied())
    }

    /// Returns the word that is due, to be said now.
    pub(super) fn take(&mut self, now_us: u64) -> Option<Command> {
        if self.next_us() > now_us {
            return None;
        }
        self.due_us = now_us + RETRY_US;
        let request = self.request()?;
        Some(Command { token: self.token(), request })
    }

    /// Takes an answer in; the next word is due at once.
    pub(super) fn take_in(&mut self, response: &Response, now_us: u64) {
        let Some(request) = self.request().filter(|_| response.token == self.token()) else { return };
        let is_later = self.word >= WORDS.len();
        match response.reply {
            Reply::Refused { .. } if !is_later => return self.is_refused = true,
            Reply::Refused { .. } if matches!(request, Request::Trigger(_)) => self.answers.refused += 1,
            Reply::Refused { reason, .. } => {
                (self.camera.refused, self.camera.last_refusal) = (self.camera.refused + 1, Some(reason));
            }
            Reply::CameraSet(_) => self.camera.set += 1,
            Reply::CameraTriggered(triggered) => {
                self.camera.triggered += 1;
                self.camera.late += u64::from(triggered.is_late);
            }
            Reply::Triggered(triggered) => {
                self.answers.taken += 1;
                self.answers.late += u64::from(triggered.is_late);
            }
            Reply::Hello(_) | Reply::Info(_) | Reply::Run | Reply::Stop | Reply::Applied(_) => {}
        }
        if is_later {
            self.waiting.pop_front();
        }
        (self.word, self.due_us) = (self.word + 1, now_us);
    }

    /// Returns whether RUN was accepted.
    pub(super) fn is_running(&self) -> bool {
        self.word >= WORDS.len()
    }

    fn token(&self) -> u8 {
        // 1 to 255, then from 1 again.
        u8::try_from(self.word % 255 + 1).unwrap_or(u8::MAX)
    }
}

/// Counts of what came in, and the newest of each kind.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Received {
    /// EXPOSURE messages.
    pub exposures: u64,
    /// The newest EXPOSURE.
    pub last_exposure: Option<Stamped<Exposure>>,
    /// STATUS pages.
    pub status_pages: u64,
    /// The newest STATUS page.
    pub last_status: Option<Stamped<StatusPage>>,
    /// CAMERA_STATUS pages.
    pub camera_pages: u64,
    /// The newest CAMERA_STATUS page.
    pub last_camera: Option<Stamped<CameraStatus>>,
    /// Other messages.
    pub others: u64,
}

impl Received {
    pub(super) fn count(&mut self, message: Stamped<Message>) {
        let at = message.at;
        match message.value {
            Message::Exposure(value) => {
                self.exposures += 1;
                self.last_exposure = Some(Stamped { at, value });
            }
            Message::Status(value) => {
                self.status_pages += 1;
                self.last_status = Some(Stamped { at, value });
            }
            Message::Camera(value) => {
                self.camera_pages += 1;
                self.last_camera = Some(Stamped { at, value });
            }
            Message::Sync(_)
            | Message::TimeFollowUp(_)
            | Message::Attitude(_)
            | Message::Jitter(_)
            | Message::JitterPair(_)
            | Message::Wheels(_)
            | Message::Table(_)
            | Message::Command(_)
            | Message::Response(_)
            | Message::Heartbeat(_) => self.others += 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_protocol::message::{CameraSet, CameraSetting, CameraTrigger, CameraTriggered, Trigger, Triggered};

    fn answer(talk: &mut Talk, token: u8, reply: Reply, now_us: u64) {
        talk.take_in(&Response { token, reply }, now_us);
    }

    #[test]
    fn each_word_is_said_until_its_own_answer_comes() {
        let mut talk = Talk::new(1000);
        assert_eq!(talk.take(999), None);
        let hello = talk.take(1000).unwrap();
        assert_eq!(hello, Command { token: 1, request: Request::Hello(version::CURRENT) });
        assert_eq!(talk.take(2000), None, "waits");
        assert_eq!(talk.take(1000 + RETRY_US), Some(hello), "the same token: a retry");
        answer(&mut talk, 7, Reply::Stop, 600_000);
        assert_eq!(talk.token(), 1, "the answer to something else");
        for (token, reply) in [(1, Reply::Run), (2, Reply::Run), (3, Reply::Run)] {
            assert!(!talk.is_running());
            answer(&mut talk, token, reply, 600_000);
        }
        assert!(talk.is_running());
        assert_eq!((talk.next_us(), talk.take(u64::MAX - 1)), (u64::MAX, None), "all is said");
    }

    #[test]
    fn triggers_are_said_one_at_a_time_after_run_each_with_its_own_token() {
        let mut talk = Talk::new(0);
        let trigger = |number| Request::Trigger(Trigger { number, at_us: 5 });
        assert!(talk.say(trigger(1), 0) && talk.say(trigger(2), 0));
        for token in 1..=3 {
            assert!(!matches!(talk.take(10).unwrap().request, Request::Trigger(_)), "not before RUN");
            answer(&mut talk, token, Reply::Run, 10);
        }
        let first = talk.take(10).unwrap();
        assert_eq!(first, Command { token: 4, request: trigger(1) });
        assert_eq!((talk.take(20), talk.take(10 + RETRY_US)), (None, Some(first)), "again with the same token");
        answer(&mut talk, 4, Reply::Refused { opcode: 6, reason: Refusal::TriggerTime }, 600_000);
        let second = talk.take(600_000).unwrap();
        assert_eq!(second, Command { token: 5, request: trigger(2) }, "the talk goes on");
        answer(&mut talk, 5, Reply::Triggered(Triggered { number: 2, is_late: true }), 700_000);
        assert_eq!(talk.answers, TriggerAnswers { taken: 1, late: 1, refused: 1 });
        assert_eq!((talk.next_us(), talk.is_running()), (u64::MAX, true));
        assert!(talk.say(trigger(3), 800_000));
        assert_eq!((talk.next_us(), talk.take(800_000).unwrap().token), (800_000, 6), "due when it was asked for");
        assert!((0..).take_while(|number| talk.say(trigger(*number), 0)).count() == WAITING_MAX - 1, "full");
    }

    #[test]
    fn camera_commands_are_said_like_triggers_and_counted_apart() {
        let mut talk = Talk::new(0);
        let setting = Request::Camera(CameraSetting { kind: 1, head: 0, value: 5000 });
        let trigger = Request::CameraTrigger(CameraTrigger { head: 0, at_us: 0 });
        for token in 1..=3 {
            talk.take(10);
            answer(&mut talk, token, Reply::Run, 10);
        }
        assert!([setting, setting, trigger].into_iter().all(|request| talk.say(request, 20)));
        assert_eq!(talk.take(20), Some(Command { token: 4, request: setting }));
        answer(&mut talk, 4, Reply::CameraSet(CameraSet { kind: 1, head: 0 }), 30);
        assert_eq!(talk.take(30), Some(Command { token: 5, request: setting }));
        answer(&mut talk, 5, Reply::Refused { opcode: 7, reason: Refusal::CameraRange }, 40);
        assert_eq!(talk.take(40), Some(Command { token: 6, request: trigger }));
        answer(&mut talk, 6, Reply::CameraTriggered(CameraTriggered { head: 0, is_late: true }), 50);
        let last_refusal = Some(Refusal::CameraRange);
        assert_eq!(talk.camera, CameraAnswers { set: 1, triggered: 1, late: 1, refused: 1, last_refusal });
        assert_eq!(talk.answers, TriggerAnswers::default());
    }

    #[test]
    fn a_refused_sender_stops_asking() {
        let mut talk = Talk::new(0);
        talk.take(0);
        answer(&mut talk, 1, Reply::Refused { opcode: 1, reason: Refusal::WrongMajor }, 10);
        assert_eq!((talk.next_us(), talk.is_running()), (u64::MAX, false));
    }
}
