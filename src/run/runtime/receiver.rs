//! Messages -> time correlation, attitude history, jitter history, triggers, answers to commands.
//!
//! Messages of the protocol and plain messages of an external simulator are taken in by the parts of a [`Receiver`]: a
//! message is dated by its clock, and what it carries goes to the attitudes, the mountings of the heads or the session.
//!
//! A plain message ([`PlainRecord`]) becomes a [`PlantSample`] by the bench's clock. A tag of any clock (Unix time too:
//! the bench's clock may play another day) is also a time mark, so the offset and drift of that clock are estimated like
//! those of a flight computer on the bus, and its steps and restarts are the same events. Without a time, values are
//! valid when they arrive. Values that are too old, too new or repeated are refused by the histories: an attitude is
//! never drawn at another instant than its own. Tests: `receiver_tests`, `plain_intake_tests`,
//! `hil_scripts/tests/test_plain_links.py`.

use crate::runtime::attitude_intake::{AttitudeIntake, NORM_TOLERANCE};
use crate::runtime::clock_intake::{ClockIntake, Mark, PORTS_MAX};
use crate::runtime::ledger::{Event, EventKind, Ledger};
use crate::runtime::plant_queue::{PlantAttitude, PlantSample};
use crate::runtime::session::{PerHead, Session};
use crate::runtime::{error::Result, jitter_tables, mounting::Mounting, params::AttitudeParams};
use base::axes::Rotation;
use base::time::{Span, Tai};
use config::SessionParams;
use firmware_protocol::message::{Command, Request};
use firmware_protocol::{Message, handshake::Did};
use glam::DVec3;
use link::plain::{PlainAttitude, PlainRecord, PlainState, PlainTime};
use link::{Input, Stamped};
use plan::attitude::ClockEstimate;
use sky::observer::BarycentricState;

/// Shortest interval between two tables that are put into effect.
const APPLY_PERIOD: Span = Span::from_ms(50);

/// The receiving half of the stimulator: one for all heads of a run, each with its [`Mounting`].
pub struct Receiver {
    /// The parameters.
    pub params: AttitudeParams,
    /// The sender's clock.
    pub clock: ClockIntake,
    /// The attitudes of the body.
    pub attitudes: AttitudeIntake,
    /// State of each head.
    pub mountings: PerHead<Mounting>,
    /// The conversation with the flight computer.
    pub session: Session,
    /// Messages taken in by each port, all kinds; ports beyond the last one share its counter.
    pub messages: [u64; PORTS_MAX],
    /// When a table was put into effect last.
    applied: Option<Tai>,
}

impl Receiver {
    /// Returns a receiver that has received nothing, for one head.
    ///
    /// # Errors
    /// When a jitter line is not finite.
    pub fn new(params: AttitudeParams) -> Result<Self> {
        Ok(Self {
            clock: ClockIntake::new(params.settings.clock),
            attitudes: AttitudeIntake::new(params.settings.history),
            mountings: PerHead::new(Mounting::new(&params)?),
            session: Session::new(SessionParams::default()),
            messages: [0; PORTS_MAX],
            applied: None,
            params,
        })
    }

    /// Returns the receiver with other session parameters than the default; call before heads are added and anything is
    /// received.
    #[must_use]
    pub fn with_session(mut self, params: SessionParams) -> Self {
        self.session = Session::new(params);
        self
    }

    /// Adds the next head; of its parameters the mounting and the jitter are its own.
    ///
    /// # Errors
    /// When a jitter line is not finite.
    pub fn add_head(&mut self, params: &AttitudeParams) -> Result<()> {
        self.mountings.push(Mounting::new(params)?);
        self.session.add_head();
        Ok(())
    }

    /// Accepts a message of either kind; returns an answer to send by the same port, if it needs one. Plain messages
    /// need none. Ports beyond the first `PORTS_MAX` share one place for time marks.
    pub fn accept_input(&mut self, port: usize, input: &Stamped<Input>, ledger: &mut Ledger) -> Option<Message> {
        match &input.value {
            Input::Message(message) => self.accept(port, message, input.at, ledger),
            Input::Plain(record) => {
                self.messages[port.min(PORTS_MAX - 1)] += 1;
                self.accept_plain(record, input.at, ledger);
                None
            }
        }
    }

    /// Accepts a message of the protocol; returns an answer to send by the same port, if it needs one.
    pub fn accept(&mut self, port: usize, message: &Message, at: Tai, ledger: &mut Ledger) -> Option<Message> {
        let port = port.min(PORTS_MAX - 1);
        self.messages[port] += 1;
        match message {
            Message::Sync(sync) => self.clock.take_sync(port, sync, at),
            Message::TimeFollowUp(follow_up) => {
                if let Some(mark) = self.clock.take_follow_up(port, follow_up) {
                    self.follow_mark(&mark, at, ledger);
                }
            }
            Message::Attitude(record) => match self.clock.remote.to_tai(record.t_us, at) {
                Some(epoch) => self.attitudes.take_record(record, epoch, at, ledger),
                None => ledger.note(Event::new(EventKind::NoTimeYet, at, None, Span::ZERO)),
            },
            Message::Jitter(burst) => self.mountings.take_burst(burst, &self.clock.remote, at, ledger),
            Message::JitterPair(pair) => self.mountings.take_pair(pair, &self.clock.remote, at, ledger),
            Message::Command(command) => return self.answer(command, at, ledger),
            Message::Wheels(wheels) => {
                let sent = at - self.params.settings.clock.constant_delay;
                self.mountings.take_wheels(wheels, sent, at, ledger);
            }
            Message::Table(cell) => self.session.tables.put(cell),
            Message::Heartbeat(heartbeat) => self.session.take_in(heartbeat, at, ledger),
            // Answers of a stimulator: our own, or another one's on the same bus.
            Message::Exposure(_) | Message::Status(_) | Message::Camera(_) | Message::Response(_) => {}
        }
        None
    }

    /// Returns the answer to a command; `None` for an APPLY that follows another too soon: noise takes a millisecond to
    /// be made, and a client without an answer asks again.
    fn answer(&mut self, command: &Command, at: Tai, ledger: &mut Ledger) -> Option<Message> {
        let is_apply = matches!(command.request, Request::Apply { .. });
        if is_apply && self.applied.is_some_and(|last| at - last < APPLY_PERIOD) {
            ledger.note(Event::new(EventKind::CommandDeferred, at, None, Span::ZERO));
            return None;
        }
        if is_apply {
            self.applied = Some(at);
        }
        let answer = self.session.answer(command, at, self.clock.remote.estimate().as_ref(), ledger);
        if let Some(Did::Applied(table)) = answer.did {
            let tables = &self.session.tables;
            let apply =
                |head: &mut Mounting| jitter_tables::apply(table, tables, head.sensor_from_body, &mut head.jitter);
            let applied = self.mountings.each(apply);
            let kind = if applied.is_ok() { EventKind::TableApplied } else { EventKind::SampleRefused };
            ledger.note(Event::new(kind, at, None, Span::ZERO));
        }
        Some(Message::Response(answer.response))
    }

    /// Accepts a pulse at a whole second of the flight computer's clock.
    pub fn accept_pulse(&mut self, at: Tai) {
        self.clock.take_pulse(at);
        self.follow_clock();
    }

    /// Follows the clock after a mark.
    fn follow_mark(&mut self, mark: &Mark, now: Tai, ledger: &mut Ledger) {
        if let Some(before) = &mark.stepped_from {
            self.follow_step(before, mark, now, ledger);
        }
        self.follow_clock();
    }

    /// Follows a step of the flight computer's clock at a mark. A clock that reads less than half of the expected value
    /// has restarted: attitudes, jitter and dated triggers of the previous session are then discarded. After any other
    /// step the attitudes received so far keep their instants.
    fn follow_step(&mut self, before: &ClockEstimate, mark: &Mark, now: Tai, ledger: &mut Ledger) {
        let expected_ns = before.to_remote_ns(mark.at);
        let step = Span::from_ns(mark.remote_ns.saturating_sub(expected_ns));
        self.attitudes.forget_tags();
        if mark.remote_ns < expected_ns / 2 {
            ledger.note(Event::new(EventKind::ClockRestarted, now, None, step));
            self.attitudes.forget();
            self.mountings.each(|head| head.jitter.clear_points());
            self.session.forget_dated_triggers(now, ledger);
        } else {
            ledger.note(Event::new(EventKind::ClockStepped, now, None, step));
            if let Some(estimate) = self.clock.remote.estimate() {
                self.session.step_triggers(&estimate, now, ledger);
            }
        }
    }

    /// Passes the clock's estimate to uploaded jitter and triggers, which run by the flight computer's clock.
    fn follow_clock(&mut self) {
        if let Some(estimate) = self.clock.remote.estimate() {
            self.mountings.each(|head| head.jitter.follow_clock(&estimate));
            self.session.triggers.each(|head| head.follow_clock(&estimate));
        }
    }

    /// Accepts the state of an external plant at one instant; `arrived` is its arrival time. Returns false when a part
    /// of it was refused, which the ledger counts. Jitter is taken as single samples: a stream of them has no period,
    /// and no frame waits for it. Does not allocate.
    pub fn take_plant(&mut self, sample: &PlantSample, arrived: Tai, ledger: &mut Ledger) -> bool {
        let at = sample.at;
        let attitude = sample.attitude.is_none_or(|attitude| self.attitudes.take_plant(at, &attitude, arrived, ledger));
        let heads = &mut self.mountings;
        let jitter =
            sample.jitter_rad.is_none_or(|body_rad| heads.each(|head| head.take_jitter(at, body_rad, arrived)));
        let observer = sample.observer.is_none_or(|state| heads.each(|head| head.take_observer(at, state)));
        for _ in [attitude, jitter, observer].into_iter().filter(|is_taken| !is_taken) {
            ledger.note(Event::new(EventKind::SampleRefused, arrived, None, arrived - at));
        }
        attitude && jitter && observer
    }

    /// Accepts a sample that did not come over a port, and counts it as a message of the first one.
    pub fn take_sample(&mut self, sample: &PlantSample, arrived: Tai, ledger: &mut Ledger) {
        self.messages[0] += 1;
        self.take_plant(sample, arrived, ledger);
    }

    fn accept_plain(&mut self, record: &PlainRecord, arrived: Tai, ledger: &mut Ledger) {
        if self.clock.is_repeated(record.time) {
            // Do not use it as a mark either: the clock of a sender that hangs would seem to step back again and again.
            ledger.note(Event::new(EventKind::SampleRefused, arrived, None, Span::ZERO));
            return;
        }
        let Some(at) = self.plain_instant(record.time, arrived, ledger) else {
            ledger.note(Event::new(EventKind::NoTimeYet, arrived, None, Span::ZERO));
            return;
        };
        let Some(sample) = plain_sample(record, at) else {
            ledger.note(Event::new(EventKind::SampleRefused, arrived, None, arrived - at));
            return;
        };
        self.take_plant(&sample, arrived, ledger);
    }

    /// Returns the instant of a record. `None` before a clock of any epoch is known.
    fn plain_instant(&mut self, time: PlainTime, arrived: Tai, ledger: &mut Ledger) -> Option<Tai> {
        match time {
            PlainTime::Arrival => Some(arrived - self.params.settings.clock.constant_delay),
            PlainTime::Tag(tag_ns) => {
                if let Some(mark) = self.clock.take_tag(tag_ns, arrived, ledger) {
                    self.follow_mark(&mark, arrived, ledger);
                }
                self.clock.remote.estimate().map(|estimate| estimate.to_tai(tag_ns))
            }
        }
    }
}

/// Returns a record as the sample of an instant; `None` for an invalid quaternion.
pub fn plain_sample(record: &PlainRecord, at: Tai) -> Option<PlantSample> {
    let attitude = record.attitude.as_ref().map(plant_attitude);
    let jitter_rad = record.jitter_rad.map(DVec3::from_array);
    let observer = record.observer.as_ref().map(observer_state);
    (attitude != Some(None)).then(|| PlantSample { attitude: attitude.flatten(), jitter_rad, observer, at })
}

/// Returns `None` for an invalid quaternion, which the codec has already refused.
fn plant_attitude(attitude: &PlainAttitude) -> Option<PlantAttitude> {
    Some(PlantAttitude {
        body_from_icrf: Rotation::from_wxyz(attitude.q_wxyz, NORM_TOLERANCE)?,
        rate_rad_s: DVec3::from_array(attitude.rate_rad_s),
        acceleration_rad_s2: DVec3::from_array(attitude.acceleration_rad_s2),
    })
}

fn observer_state(state: &PlainState) -> BarycentricState {
    BarycentricState {
        position_km: DVec3::from_array(state.position_km),
        velocity_km_s: DVec3::from_array(state.velocity_km_s),
    }
}

#[cfg(test)]
#[path = "receiver_tests.rs"]
mod tests;

#[cfg(test)]
#[path = "plain_intake_tests.rs"]
mod plain_tests;
