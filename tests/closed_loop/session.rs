//! Tests the session over the simulated bus: HELLO and RUN start it, STOP ends it, STATUS echoes the rendered pointing.

use crate::bench::{built_in, fly_head, start};
use base::axes::{Icrf, Rotation, Sensor, ra_dec_roll};
use base::clock::{Clock, Virtual};
use base::time::{Span, Tai};
use base::units::ARCSEC;
use config::{Bench, SessionStart};
use firmware_protocol::message::{
    Command, PointingAngle, Refusal, Reply, Request, Response, StatusPage, StimulatorMode, Table, Trigger, Triggered,
};
use firmware_protocol::tables::{Applied, LineRow, cells, crc};
use firmware_protocol::{DBC_CRC32, Message, Reject};
use firmware_protocol::{can::IdMap, version::Version};
use frames::sink::NullSink;
use link::simulated::simulated_bus;
use link::{Link, Packet, Port, Stamped};
use run::runtime::{EventKind, FrameEngine, Head, RunOutcome};
use run::{runtime::receiver::Receiver, wiring::bench_parts};
use std::sync::Arc;
use testbed::flight_computer::FlightComputer;

/// Tolerance: the echo's own resolution is 0.3 mas; f32 on the wire 0.019 arcsec, time tags of 1 us at 0.5 deg/s 0.002.
const ECHO_ARCSEC: f64 = 0.03;

/// A run with a third party on the bus, which sends the messages of a script and receives everything.
struct Overheard {
    outcome: RunOutcome,
    computer: FlightComputer,
    received: Vec<Stamped<Message>>,
}

/// An action of the third party: at this time, this message or these raw bytes.
enum Says {
    Message(Message),
    Garbage,
}

fn overhear(bench: &Bench, script: &[(f64, Says)]) -> Overheard {
    let start = start(bench);
    let params = bench_parts::run_params(bench, start).unwrap();
    let mut head = Head::new(FrameEngine::new(params.clone()).unwrap(), Box::new(NullSink::new()));
    let mut receiver = Receiver::new(params.attitude).unwrap().with_session(bench.session);
    [2, 3].into_iter().for_each(|number| receiver.session.expect_trigger(number));
    let clock = Arc::new(Virtual::new(start));
    let shared: Arc<dyn Clock> = clock.clone();
    let (bus, format) = bench_parts::bus(bench);
    let ids = IdMap::new(0, 0).unwrap();
    let mut links = simulated_bus(bus, &shared, 4).into_iter();
    let mut port = || Port::new(Box::new(links.next().unwrap()), format, ids);
    let (mut near, mut far, mut ear) = (port(), port(), port());
    let mut mouth = links.next().unwrap();
    let mut speaker = Speaker { script, next: 0, start };
    let mut computer = FlightComputer::new(bench_parts::flight_computer(bench, start));
    let mut received = Vec::new();
    let outcome = fly_head(
        &mut head,
        &mut receiver,
        &mut near,
        &clock,
        &mut |now| {
            computer.step(now, &mut far)?;
            while let Some(message) = ear.receive(now)? {
                received.push(message);
            }
            speaker.speak(now, &mut mouth, ids);
            Ok(computer.next_due().min(speaker.next_due()))
        },
        &mut |_, _| true,
    );
    assert!(outcome.error.is_none(), "{:?}", outcome.error.map(|error| error.to_string()));
    Overheard { outcome, computer, received }
}

struct Speaker<'a> {
    script: &'a [(f64, Says)],
    next: usize,
    start: Tai,
}

impl Speaker<'_> {
    fn next_due(&self) -> Tai {
        self.script.get(self.next).map_or(Tai::from_ns(i64::MAX), |(s, _)| self.start + Span::from_s(*s))
    }

    fn speak(&mut self, now: Tai, link: &mut impl Link, ids: IdMap) {
        while self.next_due() <= now {
            match &self.script[self.next].1 {
                Says::Message(message) => {
                    let frames =
                        firmware_protocol::can::encode(message, firmware_protocol::can::Format::Fd, &ids).unwrap();
                    for frame in frames.iter() {
                        link.send(&Packet::Can(*frame)).unwrap();
                    }
                }
                Says::Garbage => {
                    let frame = firmware_protocol::can::CanFrame::fd(0x300, &[0xFF; 48]).unwrap();
                    link.send(&Packet::Can(frame)).unwrap();
                }
            }
            self.next += 1;
        }
    }
}

fn command(token: u8, request: Request) -> Says {
    Says::Message(Message::Command(Command { token, request }))
}

impl Overheard {
    fn count(&self, kind: EventKind) -> u64 {
        self.outcome.record.ledger.count(kind)
    }

    fn responses(&self) -> Vec<Response> {
        let response = |message: &Stamped<Message>| match message.value {
            Message::Response(response) => Some(response),
            _ => None,
        };
        self.received.iter().filter_map(response).collect()
    }

    fn modes(&self) -> Vec<StimulatorMode> {
        let mode = |message: &Stamped<Message>| match message.value {
            Message::Status(StatusPage::State { mode, .. }) => Some(mode),
            _ => None,
        };
        self.received.iter().filter_map(mode).collect()
    }
}

#[test]
fn hello_and_run_begin_a_session_and_stop_ends_it() {
    let mut bench = built_in(4.0);
    bench.session.start = SessionStart::OnRun;
    let run = overhear(&bench, &[(3.0, command(200, Request::Stop)), (3.1, command(200, Request::Stop))]);
    assert!(run.computer.is_running(), "the flight computer knows that RUN is accepted");
    assert_eq!((run.count(EventKind::SessionRun), run.count(EventKind::SessionHalt)), (1, 1));
    // Frames are exposed from 1 s on, every 0.1 s; STOP comes at 3 s.
    assert!((19..=21).contains(&run.count(EventKind::NotRunning)), "{}", run.count(EventKind::NotRunning));
    let modes = run.modes();
    assert_eq!((modes[5], modes[35]), (StimulatorMode::Running, StimulatorMode::Idle));
    let responses = run.responses();
    assert_eq!(responses.iter().filter(|response| response.token == 200).count(), 2, "a retry is answered again");
    let dbc = responses.iter().find_map(|response| match response.reply {
        Reply::Info(firmware_protocol::message::Info::DbcCrc32(crc)) => Some(crc),
        _ => None,
    });
    assert_eq!(dbc, Some(DBC_CRC32));
}

#[test]
fn another_major_version_is_refused_and_may_not_run() {
    let other = Version { major: firmware_protocol::version::MAJOR + 1, minor: 0 };
    let script = [(1.5, command(100, Request::Hello(other))), (1.6, command(101, Request::Run))];
    let run = overhear(&built_in(2.0), &script);
    let refused =
        |token: u8| run.responses().iter().find(|response| response.token == token).map(|response| response.reply);
    assert_eq!(refused(100), Some(Reply::Refused { opcode: 1, reason: Refusal::WrongMajor }));
    assert_eq!(refused(101), Some(Reply::Refused { opcode: 3, reason: Refusal::NoHandshake }));
    assert_eq!((run.count(EventKind::VersionRefused), run.count(EventKind::SessionHalt)), (1, 1));
    assert!(run.count(EventKind::NotRunning) >= 14, "{}", run.count(EventKind::NotRunning));
}

#[test]
fn status_echoes_the_pointing_of_each_frame_at_the_time_reported_for_it() {
    let run = overhear(&built_in(4.0), &[]);
    let (mut angles, mut compared) = ([f64::NAN; 3], 0);
    let mut reported: Option<(u8, Tai)> = None;
    for message in &run.received {
        match message.value {
            Message::Exposure(exposure) => {
                // The run is shorter than the wrap of 71.6 min: the tag is the time since boot.
                let boot = start(&built_in(4.0));
                reported = Some((exposure.frame, boot + Span::from_ns(i64::from(exposure.mid_exposure_us) * 1000)));
            }
            Message::Status(StatusPage::Pointing { angle, frame, turns_2_32, .. }) => {
                let Some((number, at)) = reported else { continue };
                assert_eq!(frame, number, "pages follow the EXPOSURE of their frame");
                angles[angle as usize - PointingAngle::RightAscension as usize] = angle.to_rad(turns_2_32);
                if angle != PointingAngle::Roll {
                    continue;
                }
                let truth = run.computer.truth(at).unwrap().body_from_icrf;
                let [ra, dec, roll] = ra_dec_roll(&Rotation::<Sensor, Icrf>::from_quat(truth.quat()));
                let wrapped = |angle: f64| angle.sin().atan2(angle.cos()).abs() / ARCSEC;
                let off = [(angles[0] - ra) * dec.cos(), angles[1] - dec, angles[2] - roll].map(wrapped);
                assert!(off.iter().all(|off| *off < ECHO_ARCSEC), "frame {number}: {off:?} arcsec");
                compared += 1;
            }
            _ => {}
        }
    }
    assert_eq!(compared, 40, "every frame");
}

#[test]
fn a_table_of_jitter_is_uploaded_and_applied_once() {
    let lines = [LineRow { frequency_hz: 7.0, amplitude_xyz_arcsec: [10.0, 0.0, 0.0], phase_rad: 0.0 }];
    let apply = |token, crc| command(token, Request::Apply { table: 1, rows: 1, crc, seed: 0 });
    let mut script: Vec<(f64, Says)> = cells(&lines).map(|cell| (1.5, Says::Message(Message::Table(cell)))).collect();
    script.extend([(1.6, apply(50, !crc(&lines))), (1.7, apply(51, crc(&lines))), (1.8, apply(51, crc(&lines)))]);
    let run = overhear(&built_in(2.0), &script);
    let replies = |token: u8| {
        let of = |response: &Response| (response.token == token).then_some(response.reply);
        run.responses().iter().filter_map(of).collect::<Vec<_>>()
    };
    assert_eq!(replies(50), [Reply::Refused { opcode: 5, reason: Refusal::TableCrc }]);
    let done = Reply::Applied(Applied { table: Table::Lines, rows: 1 });
    assert_eq!((replies(51), run.count(EventKind::TableApplied)), (vec![done, done], 1), "a retry is not done twice");
}

#[test]
fn a_trigger_is_answered_fired_once_and_refused_by_name() {
    let fire = |token, number, at_us| command(token, Request::Trigger(Trigger { number, at_us }));
    let script = [
        // Before the flight computer's first message.
        (0.001, fire(50, 1, 0)),
        (1.5, fire(51, 2, 0)),
        (1.6, fire(51, 2, 0)),
        (1.7, fire(52, 2, 3_700_000_000)),
        (1.8, fire(53, 3, 3_000_000)),
        (1.85, fire(55, 7, 0)),
        (1.88, fire(55, 7, 0)),
        (1.9, command(54, Request::Stop)),
    ];
    let run = overhear(&built_in(2.0), &script);
    let reply = |token: u8| {
        let of = |response: &Response| (response.token == token).then_some(response.reply);
        run.responses().iter().filter_map(of).collect::<Vec<_>>()
    };
    let refused = |reason| vec![Reply::Refused { opcode: 6, reason }];
    let done = |number| Reply::Triggered(Triggered { number, is_late: false });
    assert_eq!(reply(50), refused(Refusal::NoHandshake));
    assert_eq!(reply(51), [done(2), done(2)], "the repeat is answered");
    assert_eq!(reply(52), refused(Refusal::TriggerTime));
    assert_eq!(reply(53), [done(3)]);
    assert_eq!(
        reply(55),
        [refused(Refusal::UnknownTrigger), refused(Refusal::UnknownTrigger)].concat(),
        "and its repeat"
    );
    let kinds = [EventKind::TriggerTaken, EventKind::TriggerFired, EventKind::TriggerForgotten];
    assert_eq!(kinds.map(|kind| run.count(kind)), [2, 1, 1], "fired once; the other is forgotten at STOP");
    let refusals = [EventKind::TriggerRefused, EventKind::CommandRefused].map(|kind| run.count(kind));
    assert_eq!(refusals, [2, 1], "out of range, nothing waits for it; before HELLO");
}

#[test]
fn rejections_are_reported_once_a_second_at_most() {
    let garbage = (0..200).map(|i| (1.0 + 0.01 * f64::from(i), Says::Garbage)).collect::<Vec<_>>();
    let run = overhear(&built_in(4.0), &garbage);
    let reported = |is: &dyn Fn(&Message) -> bool| run.received.iter().filter(|message| is(&message.value)).count();
    let rejects =
        |message: &Message| matches!(message, Message::Status(StatusPage::Rejects { reason: Reject::BadCrc, .. }));
    assert!((2..=4).contains(&reported(&rejects)), "{} of 200 bad packets in 2 s", reported(&rejects));
    let last = run.received.iter().rev().find_map(|message| match message.value {
        Message::Status(StatusPage::Rejects { reason: Reject::BadCrc, count }) => Some(count),
        _ => None,
    });
    assert_eq!(last, Some(200), "the last one has them all");
}
