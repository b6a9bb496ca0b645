use super::*;
use crate::runtime::triggers::FiredTrigger;
use base::units::NS_PER_S;
use config::AttitudeSettings;
use firmware_protocol::can::{Decoder, Format, IdMap, encode};
use firmware_protocol::message::{AttitudeFlags, AttitudeRecord, Scet, Sync, TimeFollowUp, Trigger};
use firmware_protocol::ticks::{ticks_diff, wrapped};
use firmware_protocol::version::CURRENT;
use plan::attitude::{EstimateLimits, HistoryLimits, RemoteClockLimits, StalePolicy};

/// Interval between attitudes and between time marks.
const PERIOD_NS: i64 = NS_PER_S / 100;

/// Returns the parameters of a receiver of these tests.
pub(super) fn params() -> AttitudeParams {
    AttitudeParams {
        settings: AttitudeSettings {
            estimate: EstimateLimits { policy: StalePolicy::Hold, ..EstimateLimits::default() },
            history: HistoryLimits::default(),
            jitter_history: HistoryLimits::default(),
            jitter_max_gap: Span::from_ms(100),
            jitter_wait: Span::from_ms(20),
            policy_on_real_clock: StalePolicy::Drop,
            clock: RemoteClockLimits::default(),
        },
        jitter_lines: Vec::new(),
        jitter_epoch: Tai::from_ns(0),
        jitter_record: None,
        sensor_from_body: Rotation::IDENTITY,
    }
}

/// A flight computer whose clock may restart and step, the decoder of its port, and what receives it.
struct Cable {
    decoder: Decoder,
    receiver: Receiver,
    ledger: Ledger,
    now_ns: i64,
    /// Time of its clock minus ours.
    ahead_ns: i64,
    counter: u8,
    token: u8,
    rejects: u32,
}

impl Cable {
    /// Returns a cable with a clock that reads `scet_s` at the start.
    fn new(scet_s: i64) -> Self {
        let now_ns = 1000 * NS_PER_S;
        let mut receiver = Receiver::new(params()).unwrap();
        receiver.session.expect_trigger(5);
        Self {
            decoder: Decoder::new(IdMap::new(0, 0).unwrap()),
            receiver,
            ledger: Ledger::default(),
            now_ns,
            ahead_ns: scet_s * NS_PER_S - now_ns,
            counter: 0,
            token: 0,
            rejects: 0,
        }
    }

    fn scet_ns(&self) -> i64 {
        self.now_ns + self.ahead_ns
    }

    /// Sets the clock's reading from here on.
    fn set_clock(&mut self, scet_ns: i64) {
        self.ahead_ns = scet_ns - self.now_ns;
    }

    fn send(&mut self, message: &Message) {
        for frame in encode(message, Format::Fd, &IdMap::new(0, 0).unwrap()).unwrap().iter() {
            match self.decoder.read(frame) {
                Ok(Some(value)) => {
                    self.receiver.accept(0, &value, Tai::from_ns(self.now_ns), &mut self.ledger);
                }
                Ok(None) => {}
                Err(_refused) => self.rejects += 1,
            }
        }
    }

    fn send_mark(&mut self) {
        self.counter = self.counter.wrapping_add(1);
        self.send(&Message::Sync(Sync { counter: self.counter }));
        let scet = Scet::from_ns(u64::try_from(self.scet_ns()).unwrap());
        self.send(&Message::TimeFollowUp(TimeFollowUp { scet, counter: self.counter }));
        self.now_ns += PERIOD_NS;
    }

    fn send_attitude(&mut self, seq: u8) {
        self.send_record(seq, [1.0, 0.0, 0.0, 0.0], [0.0; 3]);
    }

    fn send_record(&mut self, seq: u8, q_wxyz: [f32; 4], acceleration_rad_s2: [f32; 3]) {
        let flags = AttitudeFlags { rate: true, acceleration: true };
        let t_us = wrapped(self.scet_ns().div_euclid(1000));
        let record = AttitudeRecord { t_us, seq, flags, q_wxyz, rate_rad_s: [0.0; 3], acceleration_rad_s2 };
        self.send(&Message::Attitude(record));
        self.now_ns += PERIOD_NS;
    }

    fn send_request(&mut self, request: Request) {
        self.token = self.token.wrapping_add(1);
        self.send(&Message::Command(Command { token: self.token, request }));
    }

    fn remote_us_at(&self, at: Tai) -> Option<u32> {
        self.receiver.attitudes.remote_us_at(at, &self.receiver.clock.remote)
    }

    fn accepted(&self) -> u64 {
        self.receiver.attitudes.history.counts().accepted
    }
}

/// Tests every sequence number as the last one before the restart: those within the replay window of 0 need a decoder
/// that notices the restart, all others a receiver that accepts everything the decoder passes.
#[test]
fn restarted_flight_computer_is_accepted_at_its_first_attitude_whatever_the_last_number() {
    for last in 0..=u8::MAX {
        for with_hello in [false, true] {
            let mut cable = Cable::new(100);
            cable.send_mark();
            (0..80_u8).rev().for_each(|behind| cable.send_attitude(last.wrapping_sub(behind)));
            assert_eq!((cable.accepted(), cable.rejects), (80, 0), "before the restart, to number {last}");
            cable.now_ns += 100_000_000;
            cable.set_clock(NS_PER_S / 2);
            if with_hello {
                cable.send_request(Request::Hello(CURRENT));
            }
            cable.send_mark();
            cable.send_attitude(0);
            let taken = (cable.accepted(), cable.rejects, cable.receiver.attitudes.history.len());
            assert_eq!(taken, (81, 0, 1), "after {last}, HELLO: {with_hello}");
            assert_eq!(cable.ledger.count(EventKind::ClockRestarted), 1);
            assert_eq!(cable.ledger.count(EventKind::SampleRefused), 0);
        }
    }
}

/// Tests that a HELLO alone shows the restart of a flight computer whose SCET goes on because another clock keeps it.
#[test]
fn hello_alone_makes_all_sequence_numbers_new() {
    for (with_hello, wanted) in [(true, (2, 0)), (false, (1, 1))] {
        let mut cable = Cable::new(100);
        cable.send_mark();
        cable.send_attitude(7);
        if with_hello {
            cable.send_request(Request::Hello(CURRENT));
        }
        cable.send_attitude(0);
        assert_eq!((cable.accepted(), cable.rejects), wanted, "HELLO: {with_hello}");
    }
}

/// Tests signed tag differences: unsigned ones of two clocks are near 2^32 us, and the reported time would be wrong.
#[test]
fn exposure_time_is_that_of_the_new_clock_after_a_step_either_way() {
    for step_ns in [2 * NS_PER_S, -2 * NS_PER_S, -99 * NS_PER_S, 4000 * NS_PER_S] {
        let mut cable = Cable::new(100);
        cable.send_mark();
        (0..20).for_each(|seq| cable.send_attitude(seq));
        cable.set_clock(cable.scet_ns() + step_ns);
        cable.send_mark();
        (20..40).for_each(|seq| cable.send_attitude(seq));
        let middle_ns = cable.now_ns - 10 * PERIOD_NS;
        for off_ns in [-5 * PERIOD_NS, -1_234_000, 0, 3_000_000] {
            let at_ns = middle_ns + off_ns;
            let reported = cable.remote_us_at(Tai::from_ns(at_ns)).unwrap();
            let error_us = ticks_diff(reported, wrapped((at_ns + cable.ahead_ns).div_euclid(1000)));
            assert!(error_us.abs() <= 2, "step of {step_ns} ns, at {off_ns} ns: {error_us} us off");
        }
        let before = cable.remote_us_at(Tai::from_ns(middle_ns - 25 * PERIOD_NS)).unwrap();
        let error_us = ticks_diff(before, wrapped((middle_ns - 25 * PERIOD_NS + cable.ahead_ns).div_euclid(1000)));
        assert!(error_us.abs() < 100, "an exposure before the step is reported in the present time: {error_us} us");
    }
}

/// Tests an estimate that moves back by more than an attitude's period, so that tags and epochs rise in different
/// orders.
#[test]
fn exposure_time_stays_near_its_tags_when_the_order_of_epochs_is_another_than_that_of_tags() {
    let mut cable = Cable::new(100);
    let at = |ms: i64| Tai::from_ns(ms * 1_000_000);
    cable.send_mark();
    for (t_us, ms) in [(1_000_000, 0), (1_010_000, 10), (1_020_000, 5)] {
        cable.receiver.attitudes.keep_tag(t_us, at(ms));
    }
    // Between the epochs 5 and 10 ms lie the tags 1 020 000 and 1 010 000.
    let reported = cable.remote_us_at(at(7)).unwrap();
    assert!((1_010_000..=1_020_000).contains(&reported), "{reported}");
}

#[test]
fn triggers_follow_a_stepped_clock_and_leave_a_restarted_one() {
    for (new_scet_s, fired, forgotten) in [(130, 1, 0), (1, 0, 1)] {
        let mut cable = Cable::new(100);
        cable.send_mark();
        cable.send_request(Request::Hello(CURRENT));
        cable.send_request(Request::Trigger(Trigger { number: 5, at_us: 140_000_000 }));
        cable.set_clock(new_scet_s * NS_PER_S);
        let stepped_at = Tai::from_ns(cable.now_ns);
        cable.send_mark();
        let (triggers, up_to) = (cable.receiver.session.triggers.of_mut(0), stepped_at + Span::from_ms(11_000));
        let acted: Vec<FiredTrigger> = core::iter::from_fn(|| triggers.next(up_to)).collect();
        assert_eq!(acted.len(), fired, "the clock reads {new_scet_s} s");
        for trigger in acted {
            let off = trigger.at - (stepped_at + Span::from_ms(10_000));
            assert!(off.ns().abs() < 1_000_000, "{off:?} from SCET 140 s");
        }
        assert_eq!(cable.ledger.count(EventKind::TriggerForgotten), forgotten);
        assert_eq!(cable.receiver.session.triggers.of(0).waiting(), 0, "no place is held for ever");
    }
}

#[test]
fn motion_that_no_spacecraft_makes_is_refused_and_counted() {
    let mut cable = Cable::new(100);
    cable.send_mark();
    cable.send_attitude(0);
    cable.send_record(1, [1.0, 0.0, 0.0, 0.0], [0.0, 3.4e38, 0.0]);
    cable.send_record(2, [1.0, 0.0, 0.0, 0.0], [1e3, 0.0, 0.0]);
    // Half a turn 1 us after the first one.
    cable.now_ns += 1000 - 3 * PERIOD_NS;
    cable.send_record(3, [0.0, 1.0, 0.0, 0.0], [0.0; 3]);
    cable.now_ns += 3 * PERIOD_NS;
    cable.send_record(4, [1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0]);
    assert_eq!((cable.accepted(), cable.receiver.attitudes.history.counts().too_fast), (2, 3));
    assert_eq!(cable.ledger.count(EventKind::SampleRefused), 3);
}

#[test]
fn pairs_are_counted_since_the_start_and_those_left_out_by_reason() {
    let mut cable = Cable::new(100);
    for _ in 0..500 {
        cable.send_mark();
    }
    let counts = |cable: &Cable| {
        let clock = &cable.receiver.clock.remote;
        (clock.pairs, clock.late, clock.outliers)
    };
    assert_eq!(counts(&cable), (500, 0, 0), "not those of a window");
    // Stamps 300 ms in the past are late; stamps 50 ms ahead are outliers.
    cable.now_ns += NS_PER_S;
    for (off_ms, wanted) in [(-300, (500, 1, 0)), (50, (500, 1, 1)), (0, (501, 1, 1))] {
        cable.ahead_ns += off_ms * 1_000_000;
        cable.send_mark();
        cable.ahead_ns -= off_ms * 1_000_000;
        assert_eq!(counts(&cable), wanted, "{off_ms} ms");
    }
}

#[test]
fn samples_of_a_plant_outside_keep_double_precision_and_their_instants() {
    let mut cable = Cable::new(5);
    let (now, mut ledger) = (Tai::from_ns(cable.now_ns), Ledger::default());
    let turned = Rotation::IDENTITY.rotated_by(DVec3::new(1e-9, 2e-9, 0.3));
    let attitude =
        PlantAttitude { body_from_icrf: turned, rate_rad_s: DVec3::Z * 1e-9, acceleration_rad_s2: DVec3::ZERO };
    let state = BarycentricState { position_km: DVec3::X * 7000.0, velocity_km_s: DVec3::Y * 7.5 };
    let sample =
        PlantSample { at: now, attitude: Some(attitude), jitter_rad: Some(DVec3::X * 1e-7), observer: Some(state) };
    assert!(cable.receiver.take_plant(&sample, now, &mut ledger));
    let newest = cable.receiver.attitudes.history.newest().unwrap();
    assert_eq!((newest.at, newest.rate_rad_s.z), (now, 1e-9));
    assert!(newest.body_from_icrf.rotation_vector_to(&turned).length() < 1e-15, "single precision would be 1e-8 off");
    assert_eq!(cable.receiver.mountings.of_mut(0).take_observers().collect::<Vec<_>>(), [(now, state)]);
    assert_eq!(cable.receiver.mountings.of_mut(0).take_observers().count(), 0, "each state once");
    assert_eq!(ledger.count(EventKind::SampleRefused), 0);
    // The same instant again, and an old instant: each part is counted.
    assert!(!cable.receiver.take_plant(&sample, now, &mut ledger));
    let old = PlantSample { attitude: Some(attitude), ..PlantSample::at(now - Span::from_s(60.0)) };
    let refused = ledger.count(EventKind::SampleRefused);
    assert!(!cable.receiver.take_plant(&old, now, &mut ledger));
    assert_eq!(ledger.count(EventKind::SampleRefused), refused + 1);
    assert_eq!(cable.receiver.attitudes.age_at(now), Some(Span::ZERO));
}

#[test]
fn rates_on_the_bus_that_contradict_the_attitudes_are_events_unless_they_are_not_measured() {
    for (has_rate, rate_rad_s, wanted) in [(true, 0.02, 0), (true, -0.02, 3), (true, 0.0, 3), (false, 0.0, 0)] {
        let mut cable = Cable::new(1000);
        (0..4).for_each(|_| cable.send_mark());
        let start_ns = cable.now_ns;
        for i in 0..=300_u32 {
            let half = 0.5 * 0.02 * (cable.now_ns - start_ns) as f64 * 1e-9;
            let record = AttitudeRecord {
                t_us: wrapped(cable.scet_ns().div_euclid(1000)),
                seq: (i % 256) as u8,
                flags: AttitudeFlags { rate: has_rate, acceleration: false },
                q_wxyz: [half.cos() as f32, -half.sin() as f32, 0.0, 0.0],
                rate_rad_s: [rate_rad_s, 0.0, 0.0],
                acceleration_rad_s2: [0.0; 3],
            };
            cable.send(&Message::Attitude(record));
            cable.now_ns += PERIOD_NS;
        }
        assert_eq!(cable.ledger.count(EventKind::RatesContradict), wanted, "{has_rate} {rate_rad_s}");
        assert!(cable.accepted() > 290, "{}", cable.accepted());
    }
}
