//! Star trackers outside in the loop: frames that went out, and what comes back on a tracker's line -> attitudes, the
//! latency of each, and what was late or missing.
//!
//! An answer belongs to the frame that it names by number, else to the one whose exposure its time tag is within. Its
//! latency is from the middle of that exposure, on the bench's clock, to its arrival: what a control has to live with.
//! The far end's thread looks at the lines every [`LOOK`], so that a latency is long by so much at most. Tests: below;
//! `hil_scripts/tests/test_tracker_in.py`.

use crate::runtime::ledger::{Event, EventKind};
use crate::runtime::tracker_out::Outlet;
use base::axes::{COMPUTED_NORM_TOLERANCE, Icrf, Rotation, Sensor};
use base::time::{Span, Tai};
use base::units::ARCSEC;
use crossbeam_channel::{Receiver, Sender, bounded};
use frames::report::{AnswerRow, StageHistogram};
use frames::sink::{NullSink, SentFrame, Sink, SinkError, SinkSummary};
use glam::{DMat3, DVec3};
use std::collections::VecDeque;
use telemetry::{Wire, reading::Measured, reading::Reader};
use testbed::tracker::{Mode, Outcome, Reason, Solution};

/// Interval at which lines are looked at.
pub const LOOK: Span = Span::from_ns(500_000);
/// A frame without an answer for so long is given up: no estimator takes an older attitude.
const GIVEN_UP: Span = Span::from_ms(2000);
/// An answer may come this much before the news of its frame, which another thread brings.
const NEWS: Span = Span::from_ms(50);
/// A time tag may be so far outside its exposure.
const TAG_SLACK: Span = Span::from_ms(1);
/// News of frames that wait for the far end.
const FRAMES: usize = 64;
/// Events that are kept one by one; those after them are added to the last one of their kind.
const EVENTS: usize = 4096;
/// Packets that are read at one look.
const PACKETS: usize = 64;
/// Identifiers of CANopen: network management, and a node's heartbeat.
const NMT: u16 = 0x000;
const HEARTBEAT: u16 = 0x700;
/// States of a CANopen node that waits for its start: boot-up and pre-operational.
const WAITING_STATES: [u8; 2] = [0x00, 0x7F];

/// Parameters of one tracker outside.
#[derive(Debug, Clone)]
pub struct TrackerInParams {
    /// Its place in the bench.
    pub place: String,
    /// Protocol.
    pub protocol: &'static str,
    /// Head whose frames it sees, in the bench.
    pub head: usize,
    /// From the middle of an exposure to an answer that is not late.
    pub late_after: Span,
    /// Standard deviations of its attitudes about the sensor's axes, rad.
    pub sigma_rad: DVec3,
    /// From the end of an exposure to when its frame is due.
    pub due_after: Span,
    /// CANopen node that is started; `None` with other protocols.
    pub node: Option<u8>,
}

/// One tracker outside.
pub struct TrackerIn {
    params: TrackerInParams,
    outlet: Outlet,
    reader: Box<dyn Reader>,
    /// News of frames from the head's sinks.
    news: (Sender<Shown>, Receiver<Shown>),
    /// Frames that wait for their answers, oldest first.
    frames: VecDeque<Shown>,
    /// Number of the newest one.
    newest: Option<u32>,
    /// Answers whose frames are not known yet.
    early: Vec<Measured>,
    latency: StageHistogram,
    since_sent: StageHistogram,
    /// Sums of squares of the errors about the sensor's axes, rad^2.
    squares: DVec3,
    row: AnswerRow,
    /// Late and missing answers, each with how often it happened.
    events: Vec<(Event, u64)>,
}

/// A frame that went out.
#[derive(Debug, Clone, Copy)]
struct Shown {
    number: u32,
    mid: Tai,
    half_exposure: Span,
    sent: Tai,
    drawn: Option<Rotation<Sensor, Icrf>>,
}

/// A tracker's answer to a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// Head of the bench.
    pub head: usize,
    /// Number of the frame.
    pub frame: u32,
    /// Attitude, or none.
    pub outcome: Outcome,
}

impl TrackerIn {
    /// Returns a tracker that has seen no frame. A CANopen node is started.
    pub fn new(params: TrackerInParams, outlet: Outlet, reader: Box<dyn Reader>, start: Tai) -> Self {
        let (place, protocol, line) = (params.place.clone(), params.protocol.into(), outlet.name().into());
        let late_after_ms = params.late_after.ms();
        let row = AnswerRow { place, head: params.head, protocol, line, late_after_ms, ..AnswerRow::default() };
        let (latency, since_sent) = (StageHistogram::default(), StageHistogram::default());
        let (frames, early, events) = (VecDeque::new(), Vec::new(), Vec::new());
        let (squares, news, newest) = (DVec3::ZERO, bounded(FRAMES), None);
        let mut tracker =
            Self { params, outlet, reader, news, frames, newest, early, latency, since_sent, squares, row, events };
        tracker.start_node(start);
        tracker
    }

    /// Returns where it is expected, for people.
    pub fn words(&self) -> String {
        let AnswerRow { place, protocol, line, head, .. } = &self.row;
        format!("{place}: {protocol} on {line}, answers to head {head}")
    }

    /// Returns the head of the bench whose frames it sees.
    pub fn head(&self) -> usize {
        self.params.head
    }

    /// Returns what goes beside the sinks of its head and brings news of the frames that they get.
    pub fn sink(&self) -> Box<dyn Sink> {
        Box::new(NewsSink { due_after: self.params.due_after, to: self.news.0.clone() })
    }

    /// Reads the line, and adds the answers that came.
    pub fn listen(&mut self, now: Tai, answers: &mut Vec<Answer>) {
        self.outlet.welcome(now);
        for _ in 0..PACKETS {
            let Some((wire, _)) = self.outlet.receive() else { break };
            let is_waiting = self.params.node.is_some_and(|node| waits_for_start(&wire, node));
            if is_waiting {
                self.start_node(now);
            }
            let before = self.early.len();
            self.reader.take(&wire, now, &mut self.early);
            if self.early.len() > before {
                self.outlet.keep_client();
            }
        }
        self.take_news();
        for measured in core::mem::take(&mut self.early) {
            match self.take(&measured) {
                Some(answer) => answers.push(answer),
                None if now - measured.at < NEWS => self.early.push(measured),
                None => self.row.of_no_frame += 1,
            }
        }
        while self.frames.front().is_some_and(|frame| now - frame.mid > GIVEN_UP) {
            self.give_up(now);
        }
    }

    /// Ends it at `now`: its row, and the events of late and missing answers. A frame that went out so late that its
    /// answer is not due yet is not judged.
    pub fn finish(mut self, now: Tai) -> (AnswerRow, Vec<(Event, u64)>) {
        self.take_news();
        while self.frames.front().is_some_and(|frame| now - frame.mid > self.params.late_after) {
            self.give_up(now);
        }
        let count = self.row.attitudes.max(1) as f64;
        let rms = |squares: f64| (squares / count).sqrt() / ARCSEC;
        if self.row.attitudes > 0 {
            self.row.error_across_arcsec = Some(rms(self.squares.x + self.squares.y));
            self.row.error_about_arcsec = Some(rms(self.squares.z));
        }
        self.row.not_judged = self.frames.len() as u64;
        (self.row.damaged, self.row.of_other_senders) = (self.reader.damaged(), self.outlet.foreign());
        (self.row.latency, self.row.since_sent) = (self.latency.quantiles(), self.since_sent.quantiles());
        (self.row, self.events)
    }

    /// Takes the news of frames. One that a fault sends twice is one.
    fn take_news(&mut self) {
        for frame in self.news.1.try_iter() {
            let is_there = self.frames.iter().any(|other| other.number == frame.number);
            if self.newest != Some(frame.number) && !is_there {
                self.newest = Some(frame.number);
                self.row.frames += 1;
                self.frames.push_back(frame);
            }
        }
    }

    /// Returns the answer to a frame that waits for one; `None` when no such frame does.
    fn take(&mut self, measured: &Measured) -> Option<Answer> {
        let place = match (measured.frame, measured.time_tag) {
            (Some(number), _) => self.frames.iter().position(|frame| frame.number == number),
            (None, Some(tag)) => self.frames.iter().position(|frame| frame.is_exposed(tag)),
            (None, None) => None,
        }?;
        let frame = self.frames.remove(place)?;
        let latency = measured.at - frame.mid;
        self.row.answers += 1;
        self.latency.record(latency);
        self.since_sent.record(measured.at - frame.sent);
        if latency > self.params.late_after {
            self.row.late += 1;
            self.note(EventKind::AnswerLate, measured.at, frame.number, latency);
        }
        let attitude = measured.attitude_wxyz.and_then(|q| Rotation::from_wxyz(q, COMPUTED_NORM_TOLERANCE));
        let outcome = match attitude {
            None => Outcome::NoSolution(Reason::NotSaid),
            Some(sensor_from_icrf) => {
                self.row.attitudes += 1;
                let error = frame.drawn.map(|drawn| drawn.rotation_vector_to(&sensor_from_icrf));
                self.squares += error.map_or(DVec3::ZERO, |error| error * error);
                Outcome::Solved(Solution {
                    at: measured.time_tag.unwrap_or(frame.mid),
                    sensor_from_icrf,
                    covariance_rad2: DMat3::from_diagonal(self.params.sigma_rad * self.params.sigma_rad),
                    mode: Mode::Tracking,
                    stars: measured.stars.map_or(0, u32::from),
                    residual_rms_px: 0.0,
                    chi_square_per_dof: 1.0,
                    background_dn: f64::NAN,
                })
            }
        };
        Some(Answer { head: self.params.head, frame: frame.number, outcome })
    }

    /// Gives the oldest frame up.
    fn give_up(&mut self, now: Tai) {
        let Some(frame) = self.frames.pop_front() else { return };
        self.row.missing += 1;
        self.note(EventKind::AnswerMissing, now, frame.number, now - frame.mid);
    }

    fn note(&mut self, kind: EventKind, at: Tai, frame: u32, span: Span) {
        let is_full = self.events.len() >= EVENTS;
        match self.events.iter_mut().rev().find(|(event, _)| is_full && event.kind == kind) {
            Some((_, times)) => *times += 1,
            None => self.events.push((Event::new(kind, at, Some(frame), span), 1)),
        }
    }

    fn start_node(&mut self, now: Tai) {
        let start = self.params.node.and_then(|node| Wire::can(NMT, &[1, node]));
        // A node that is not there yet says so when it comes.
        start.iter().for_each(|start| drop(self.outlet.send(start, now, None)));
    }
}

/// Brings news of the frames that the sinks of a head get; runs on the head's sink thread.
struct NewsSink {
    due_after: Span,
    to: Sender<Shown>,
}

impl Sink for NewsSink {
    fn name(&self) -> &'static str {
        "tracker outside"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        let meta = &frame.meta;
        let (number, mid, half_exposure) = (meta.number, meta.mid_exposure, Span::from_s(0.5 * meta.exposure_s));
        let sent = mid + half_exposure + self.due_after + meta.lateness;
        let drawn = Rotation::from_wxyz(meta.attitude_wxyz, COMPUTED_NORM_TOLERANCE);
        // The far end takes them every half a millisecond: a full queue means that it has ended.
        let _ = self.to.try_send(Shown { number, mid, half_exposure, sent, drawn });
        Ok(())
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        NullSink::new().finish()
    }
}

impl Shown {
    fn is_exposed(&self, tag: Tai) -> bool {
        let slack = self.half_exposure + TAG_SLACK;
        tag - self.mid <= slack && self.mid - tag <= slack
    }
}

/// Returns whether a packet is the heartbeat of a CANopen node that waits for its start.
fn waits_for_start(wire: &Wire, node: u8) -> bool {
    let Wire::Can(frame) = wire else { return false };
    frame.id() == HEARTBEAT + u16::from(node)
        && frame.data().first().is_some_and(|state| WAITING_STATES.contains(state))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::UdpSocket;
    use telemetry::{Sense, json::JsonReader};

    const LATE: Span = Span::from_ms(300);

    fn at(ms: i64) -> Tai {
        Tai::from_ns(1_000_000 * ms)
    }

    /// A tracker with a socket to its line.
    fn tracker() -> (TrackerIn, UdpSocket) {
        let params = TrackerInParams {
            place: "tracker_in[0]".into(),
            protocol: "json",
            head: 1,
            late_after: LATE,
            sigma_rad: DVec3::new(1e-5, 1e-5, 1e-4),
            due_after: Span::from_ms(20),
            node: None,
        };
        let outlet = Outlet::answers("127.0.0.1:0".parse().unwrap(), true).unwrap();
        let address = outlet.name().trim_start_matches("udp ").to_owned();
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.connect(address).unwrap();
        (TrackerIn::new(params, outlet, Box::new(JsonReader::new(Sense::Starloop)), at(0)), socket)
    }

    fn show(tracker: &TrackerIn, number: u32, mid_ms: i64) {
        let mut frame = SentFrame::with_capacity(4, 4, 0, "camera".into());
        (frame.meta.number, frame.meta.mid_exposure, frame.meta.exposure_s) = (number, at(mid_ms), 0.1);
        let mut sink = tracker.sink();
        sink.send(&frame).unwrap();
        sink.send(&frame).unwrap();
    }

    /// Sends a line and returns the answers at `ms`; the kernel passes datagrams on loopback at once.
    fn say(tracker: &mut TrackerIn, socket: &UdpSocket, text: &str, ms: i64) -> Vec<Answer> {
        socket.send(text.as_bytes()).unwrap();
        let mut answers = Vec::new();
        tracker.listen(at(ms), &mut answers);
        answers
    }

    #[test]
    fn answers_find_their_frames_by_number_and_by_time() {
        let (mut tracker, socket) = tracker();
        show(&tracker, 7, 1000);
        show(&tracker, 8, 1100);
        let by_time = say(&mut tracker, &socket, r#"{"tai_ns": 1130000000, "q_wxyz": [1, 0, 0, 0]}"#, 1250);
        assert_eq!((by_time.len(), by_time[0].frame, by_time[0].head), (1, 8, 1));
        let Outcome::Solved(solution) = by_time[0].outcome else { panic!("an attitude") };
        assert_eq!(solution.at, at(1130), "the tracker's own tag");
        let lost = say(&mut tracker, &socket, r#"{"frame": 7, "q_wxyz": null}"#, 1350);
        assert_eq!((lost[0].frame, lost[0].outcome), (7, Outcome::NoSolution(Reason::NotSaid)));
        let (row, events) = tracker.finish(at(1400));
        assert_eq!((row.frames, row.answers, row.attitudes, row.late, row.missing), (2, 2, 1, 1, 0));
        assert_eq!(events, [(Event::new(EventKind::AnswerLate, at(1350), Some(7), Span::from_ms(350)), 1)]);
        assert!((row.latency.max_ms - 350.0).abs() < 0.5 && (row.since_sent.max_ms - 280.0).abs() < 0.5, "{row:?}");
        assert_eq!(row.error_across_arcsec, Some(0.0));
    }

    #[test]
    fn an_answer_before_its_frame_waits_and_one_of_no_frame_is_counted() {
        let (mut tracker, socket) = tracker();
        assert!(say(&mut tracker, &socket, r#"{"frame": 7, "q_wxyz": [1, 0, 0, 0]}"#, 1080).is_empty());
        show(&tracker, 7, 1000);
        let mut answers = Vec::new();
        tracker.listen(at(1082), &mut answers);
        assert_eq!(answers.len(), 1, "control: the frame is known now");
        say(&mut tracker, &socket, r#"{"frame": 7, "q_wxyz": [1, 0, 0, 0]}"#, 1090);
        tracker.listen(at(1200), &mut answers);
        assert_eq!((answers.len(), tracker.finish(at(1300)).0.of_no_frame), (1, 1), "a second answer to one frame");
    }

    #[test]
    fn frames_without_an_answer_are_missing_when_it_was_due() {
        let (mut tracker, _socket) = tracker();
        [(1, 1000), (2, 3000), (3, 3900)].into_iter().for_each(|(number, ms)| show(&tracker, number, ms));
        tracker.listen(at(3001), &mut Vec::new());
        assert_eq!(tracker.row.missing, 1, "given up while the run goes on");
        let (row, events) = tracker.finish(at(4000));
        assert_eq!((row.missing, row.not_judged), (2, 1));
        assert!(events.iter().all(|(event, _)| event.kind == EventKind::AnswerMissing) && events.len() == 2);
    }

    #[test]
    fn a_run_without_answers_keeps_no_more_events_than_it_must() {
        let (mut tracker, _socket) = tracker();
        let count = u32::try_from(EVENTS).unwrap() + 10;
        for number in 0..count {
            show(&tracker, number, 3000 * i64::from(number));
            tracker.take_news();
        }
        let (row, events) = tracker.finish(at(3000 * i64::from(count)));
        assert_eq!((row.missing, events.len()), (u64::from(count), EVENTS));
        assert_eq!(events.iter().map(|(_, times)| times).sum::<u64>(), u64::from(count));
    }

    #[test]
    fn a_node_that_waits_for_its_start_is_known_by_its_heartbeat() {
        let heartbeat = |node: u16, state: u8| Wire::can(HEARTBEAT + node, &[state]).unwrap();
        assert!(waits_for_start(&heartbeat(96, 0x00), 96) && waits_for_start(&heartbeat(96, 0x7F), 96));
        assert!(!waits_for_start(&heartbeat(96, 0x05), 96) && !waits_for_start(&heartbeat(97, 0x00), 96));
    }
}
