//! A simulated flight computer: an attitude, jitter and a clock of its own -> messages on a port, each when due.
//!
//! The attitude is scripted (an analytic function of time, so its truth is known to f64) or flown by a `Vehicle`, which
//! takes its control steps here, in order of time with the messages. Deterministic: what is sent depends on the
//! parameters and the order of steps only.
//!
//! `tests.rs` holds the wire round trip (0.02 arcsec), the time marks, jitter, faults and determinism.

mod motion;
mod schedule;
mod slew;
mod talk;
#[cfg(test)]
mod tests;

pub use motion::{AtWaypoints, SteadyMotion, Swing, Waypoint, WaypointError, WaypointMotion};
pub use schedule::{JitterLineParams, JitterStream, RemoteClock};
pub use slew::{FileProfile, Profile, RampShape, Slew, SlewProfile, body_from_ra_dec_roll};
pub use talk::{CameraAnswers, Received, TriggerAnswers};

use crate::noise::Gaussian;
use crate::vehicle::Vehicle;
use base::time::{Span, Tai};
use base::{refused::Refused, units::ARCSEC};
use firmware_protocol::message::{
    AttitudeFlags, AttitudeRecord, CameraSetting, CameraTrigger, Heartbeat, JitterBurst, JitterPair, NodeState,
    Request, Scet, Sync, TimeFollowUp, Trigger,
};
use firmware_protocol::ticks::ticks_diff;
use firmware_protocol::{Message, version};
use glam::DVec3;
use histories::AttitudeMotion;
use link::{Departure, LinkError, Port, Stamped};
use schedule::{Schedule, Stream};
use talk::Talk;

/// Parameters of the flight computer.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightComputerParams {
    /// Zero of its clock.
    pub boot: Tai,
    /// Error of its clock's rate, parts per million; positive runs fast.
    pub clock_drift_ppm: f64,
    /// When it begins to send; not before `boot`.
    pub stream_start: Tai,
    /// Attitude records per second.
    pub attitude_hz: u32,
    /// Attitude over time, when no vehicle flies it.
    pub profile: Profile,
    /// Noise of the sent attitude, per axis, 1 sigma, arcsec.
    pub attitude_noise_arcsec: f64,
    /// Noise of the sent rate, per axis, 1 sigma, rad/s.
    pub gyro_noise_rad_s: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// Jitter on top of the attitude: never in the attitude or rate that is sent.
    pub jitter_lines: Vec<JitterLineParams>,
    /// How the jitter is sent.
    pub jitter: JitterStream,
    /// Injected faults.
    pub faults: Faults,
}

/// Faults that the flight computer injects on purpose.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Faults {
    /// No attitude and no jitter from here on; time marks and heartbeat go on.
    pub stop_stream_at: Option<Tai>,
    /// One attitude record is sent broken.
    pub corrupt_record: Option<CorruptRecord>,
}

/// A broken attitude record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CorruptRecord {
    /// Which one, counted from boot; its sequence number is this modulo 256.
    pub record: u64,
    /// How it is broken.
    pub corruption: Corruption,
}

/// How a quaternion is broken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Corruption {
    /// The scalar is NaN.
    NotANumber,
    /// The norm is 1.01.
    NotUnit,
}

/// A time mark that was sent and whose follow-up was not.
#[derive(Debug, Clone, Copy)]
struct SentSync {
    counter: u8,
    /// When it left, as the port reported at once.
    left_at: Tai,
    /// Number of its packet, to ask when it actually left.
    packet: u64,
}

/// Why a flight computer cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum FlightError {
    /// the port refused a message or failed
    #[error(transparent)]
    Link(#[from] LinkError),
    /// the vehicle cannot be flown on
    #[error("vehicle: {0}")]
    Vehicle(#[from] Refused),
}

/// The simulated flight computer.
pub struct FlightComputer {
    params: FlightComputerParams,
    /// The vehicle, when one is flown.
    pub vehicle: Option<Box<Vehicle>>,
    /// Its clock.
    pub clock: RemoteClock,
    schedule: Schedule,
    talk: Talk,
    noise: Gaussian,
    sent_sync: Option<SentSync>,
    /// The messages received from the stimulator so far.
    pub received: Received,
}

impl FlightComputer {
    /// Returns a flight computer that has sent nothing.
    pub fn new(params: FlightComputerParams) -> Self {
        let clock = RemoteClock::new(params.boot, params.clock_drift_ppm);
        let start_us = clock.elapsed_us(params.stream_start);
        let schedule = Schedule::new(start_us, params.attitude_hz, params.jitter);
        let (talk, noise) = (Talk::new(start_us + talk::BEGIN_US), Gaussian::new(params.seed));
        Self { params, vehicle: None, clock, schedule, talk, noise, sent_sync: None, received: Received::default() }
    }

    /// Returns the same with a vehicle that flies the attitude. Jitter on the bus is the vehicle's micro-vibration.
    pub fn flying(params: FlightComputerParams, vehicle: Vehicle) -> Self {
        Self { vehicle: Some(Box::new(vehicle)), ..Self::new(params) }
    }

    /// Returns when the next message, or the vehicle's next control step, is due.
    pub fn next_due(&self) -> Tai {
        let message = self.clock.at_us(self.schedule.next().1.min(self.talk.next_us()));
        self.vehicle.as_ref().map_or(message, |vehicle| vehicle.next_due().min(message))
    }

    /// Returns whether the stimulator has accepted its RUN.
    pub fn is_running(&self) -> bool {
        self.talk.is_running()
    }

    /// Fires a trigger of the stimulator: sends it from `now` on, after RUN, until it is answered; it acts at `at`, or
    /// on arrival.
    ///
    /// # Errors
    /// When too many are waiting to be sent, or the instant is too far away: time tags wrap.
    pub fn send_trigger(&mut self, number: u16, at: Option<Tai>, now: Tai) -> Result<(), Refused> {
        let at_us = self.instant_us(at, now)?;
        self.say(Request::Trigger(Trigger { number, at_us }), now)
    }

    /// Changes a setting of the stimulator's camera: sends it from `now` on, after RUN, until it is answered.
    ///
    /// # Errors
    /// When too many commands are waiting to be sent.
    pub fn set_camera(&mut self, setting: CameraSetting, now: Tai) -> Result<(), Refused> {
        self.say(Request::Camera(setting), now)
    }

    /// Starts an exposure of a camera head at `at`, or as soon as the command has come.
    ///
    /// # Errors
    /// As [`Self::send_trigger`].
    pub fn trigger_camera(&mut self, head: u8, at: Option<Tai>, now: Tai) -> Result<(), Refused> {
        let at_us = self.instant_us(at, now)?;
        self.say(Request::CameraTrigger(CameraTrigger { head, at_us }), now)
    }

    /// Returns an instant as a command carries it.
    fn instant_us(&self, at: Option<Tai>, now: Tai) -> Result<u32, Refused> {
        match at.map(|at| at.max(now) - at.min(now)).filter(|away| *away > TRIGGER_MOST_AWAY) {
            Some(away) => Err(Refused(format!(
                "the trigger is to act {:.1} s from now; wanted within an hour: time tags on the bus wrap",
                away.s()
            ))),
            // Zero says at once; the microsecond after it is as good.
            None => Ok(at.map_or(0, |at| wrapped(self.clock.elapsed_us(at)).max(1))),
        }
    }

    fn say(&mut self, request: Request, now: Tai) -> Result<(), Refused> {
        let is_kept = self.talk.say(request, self.clock.elapsed_us(now));
        let most = talk::WAITING_MAX;
        let full = || Refused(format!("{most} commands wait for their answers already; wanted fewer at a time"));
        is_kept.then_some(()).ok_or_else(full)
    }

    /// Returns the answers of the stimulator to camera commands.
    pub fn camera_answers(&self) -> CameraAnswers {
        self.talk.camera
    }

    /// Returns the answers of the stimulator to triggers.
    pub fn trigger_answers(&self) -> TriggerAnswers {
        self.talk.answers
    }

    /// Returns the scripted attitude at `at`, without noise and jitter; `None` where a file has none.
    pub fn truth(&self, at: Tai) -> Option<AttitudeMotion> {
        self.params.profile.at(at)
    }

    /// Returns the scripted jitter at `at`: rotation vector of the body away from the smooth attitude, body axes, rad.
    pub fn jitter_truth(&self, at: Tai) -> DVec3 {
        let t_s = (at - self.params.boot).s();
        self.params.jitter_lines.iter().map(|line| line.rotation_rad(t_s)).sum()
    }

    /// Reads what has come in, and does everything due by `now`, in order of time.
    ///
    /// # Errors
    /// When the port refuses a message or fails, or the vehicle cannot be flown on.
    pub fn step(&mut self, now: Tai, port: &mut Port) -> Result<(), FlightError> {
        self.listen(now, port)?;
        if let Some(command) = self.talk.take(self.clock.elapsed_us(now)) {
            port.send(&Message::Command(command))?;
        }
        loop {
            let message_due = self.clock.at_us(self.schedule.next().1);
            match self.vehicle.as_mut() {
                Some(vehicle) if vehicle.next_due() <= message_due.min(now) => vehicle.act()?,
                _ if message_due <= now => self.send_next(port)?,
                _ => return Ok(()),
            }
        }
    }

    /// Reads what has come in by `now`. Whoever hands frames to the vehicle does this first: their time tags are
    /// messages.
    ///
    /// # Errors
    /// When the port failed.
    pub fn listen(&mut self, now: Tai, port: &mut Port) -> Result<(), FlightError> {
        while let Some(message) = port.receive(now)? {
            self.tag_frame(&message);
            if let Message::Response(response) = &message.value {
                self.talk.take_in(response, self.clock.elapsed_us(message.at));
            }
            self.received.count(message);
        }
        Ok(())
    }

    /// Passes the exposure time of an EXPOSURE message to the vehicle's trackers.
    fn tag_frame(&mut self, message: &Stamped<Message>) {
        if let (Some(vehicle), Message::Exposure(exposure)) = (self.vehicle.as_mut(), &message.value) {
            let now_us = self.clock.elapsed_us(message.at);
            // The tag has the low 32 bits of its microseconds: the nearest such instant is meant.
            let back_us = i64::from(ticks_diff(wrapped(now_us), exposure.mid_exposure_us));
            let mid_us = now_us.saturating_add_signed(-back_us);
            vehicle.tag_frame(exposure.frame, self.clock.at_us(mid_us));
        }
    }

    fn send_next(&mut self, port: &mut Port) -> Result<(), FlightError> {
        let (stream, due_us, count) = self.schedule.take();
        match stream {
            Stream::Sync => self.send_sync(count, port)?,
            Stream::FollowUp => self.send_follow_up(port)?,
            Stream::Heartbeat => {
                let heartbeat = Heartbeat { state: NodeState::Running, major: version::MAJOR };
                port.send(&Message::Heartbeat(heartbeat))?;
            }
            Stream::Attitude | Stream::Jitter if self.is_stopped(due_us) => {}
            Stream::Attitude => {
                if let Some(record) = self.attitude_record(due_us, count)? {
                    port.send(&Message::Attitude(record))?;
                }
            }
            Stream::Jitter => {
                if let Some(message) = self.jitter_message(count)? {
                    port.send(&message)?;
                }
            }
        }
        Ok(())
    }

    fn is_stopped(&self, due_us: u64) -> bool {
        self.params.faults.stop_stream_at.is_some_and(|stop| self.clock.at_us(due_us) >= stop)
    }

    fn send_sync(&mut self, count: u64, port: &mut Port) -> Result<(), LinkError> {
        let counter = low_byte(count);
        let left_at = port.send(&Message::Sync(Sync { counter }))?;
        self.sent_sync = Some(SentSync { counter, left_at, packet: port.packets_sent().saturating_sub(1) });
        Ok(())
    }

    /// Sends when the last SYNC actually left, which is after it was due when the bus was busy. For one that has not
    /// left by now nothing is sent: a wrong time would be worse than none.
    fn send_follow_up(&mut self, port: &mut Port) -> Result<(), LinkError> {
        let Some(SentSync { counter, left_at, packet }) = self.sent_sync.take() else { return Ok(()) };
        let left_at = match port.departure(packet) {
            Departure::AsReported => left_at,
            Departure::At(left_at) => left_at,
            Departure::Waiting | Departure::Never => return Ok(()),
        };
        let scet = Scet::from_ns(self.clock.elapsed_ns(left_at));
        port.send(&Message::TimeFollowUp(TimeFollowUp { scet, counter })).map(|_| ())
    }

    /// Returns the record of an instant; `None` where a file has no attitude.
    fn attitude_record(&mut self, due_us: u64, count: u64) -> Result<Option<AttitudeRecord>, FlightError> {
        let at = self.clock.at_us(due_us);
        let truth = match self.vehicle.as_mut() {
            Some(vehicle) => Some(vehicle.plant.truth(at)?),
            None => self.truth(at),
        };
        let Some(truth) = truth else { return Ok(None) };
        let turned = self.noise.vector(self.params.attitude_noise_arcsec * ARCSEC);
        let rate = truth.rate_rad_s + self.noise.vector(self.params.gyro_noise_rad_s);
        let mut q_wxyz = truth.body_from_icrf.rotated_by(turned).wxyz().map(single);
        if let Some(fault) = self.params.faults.corrupt_record.filter(|fault| fault.record == count) {
            fault.corruption.apply(&mut q_wxyz);
        }
        Ok(Some(AttitudeRecord {
            t_us: wrapped(due_us),
            seq: low_byte(count),
            flags: AttitudeFlags::ALL,
            q_wxyz,
            rate_rad_s: rate.to_array().map(single),
            acceleration_rad_s2: truth.acceleration_rad_s2.to_array().map(single),
        }))
    }

    /// Returns samples `count * n ..` of the jitter, n per message.
    fn jitter_message(&mut self, count: u64) -> Result<Option<Message>, FlightError> {
        let JitterStream { samples, period_us } = self.params.jitter;
        let first_us = count * samples as u64 * u64::from(period_us);
        let mut samples_arcsec = [[0.0; 2]; JitterStream::BURST_SAMPLES];
        for (place, sample) in samples_arcsec.iter_mut().enumerate().take(samples) {
            *sample = self.jitter_sample_arcsec(first_us + place as u64 * u64::from(period_us))?;
        }
        if self.params.jitter == JitterStream::PAIRS {
            let slot = low_byte(first_us / (2 * u64::from(period_us)));
            let samples_arcsec = [samples_arcsec[0], samples_arcsec[1]];
            return Ok(Some(Message::JitterPair(JitterPair { slot, samples_arcsec })));
        }
        Ok(JitterBurst::new(wrapped(first_us), period_us, low_byte(count), &samples_arcsec).map(Message::Jitter))
    }

    fn jitter_sample_arcsec(&mut self, t_us: u64) -> Result<[f32; 2], FlightError> {
        let at = self.clock.at_us(t_us);
        let rotation_rad = match self.vehicle.as_mut() {
            Some(vehicle) => vehicle.plant.vibration(at)?,
            None => self.jitter_truth(at),
        };
        let rotation_arcsec = rotation_rad / ARCSEC;
        Ok([single(rotation_arcsec.x), single(rotation_arcsec.y)])
    }
}

impl Corruption {
    fn apply(self, q_wxyz: &mut [f32; 4]) {
        match self {
            Self::NotANumber => q_wxyz[0] = f32::NAN,
            Self::NotUnit => *q_wxyz = q_wxyz.map(|value| value * 1.01),
        }
    }
}

/// Instants of triggers further away than this would be taken for others.
const TRIGGER_MOST_AWAY: Span = Span::from_ms(3_600_000);

#[allow(clippy::cast_possible_truncation, reason = "the wire has f32: 0.02 arcsec")]
fn single(value: f64) -> f32 {
    value as f32
}

#[allow(clippy::cast_possible_truncation, reason = "time tags and counters wrap by definition")]
fn wrapped(t_us: u64) -> u32 {
    t_us as u32
}

#[allow(clippy::cast_possible_truncation, reason = "sequence numbers wrap by definition")]
fn low_byte(count: u64) -> u8 {
    count as u8
}
