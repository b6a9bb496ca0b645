//! One tracker with its protocol and its line, stepped by whoever has a clock.
//!
//! A report is ready so long after the end of readout as the tracker thinks. It goes out then, or with the next beat of
//! a rate of its own, which sends the newest attitude again until a newer one comes.
//!
//! The thread of a tracker on the real clock.

use crate::runtime::error::{Result, RunError};
use crate::runtime::tracker_out::damage::{Damages, Fate};
use crate::runtime::tracker_out::outlet::{Outlet, OutletError};
use crate::runtime::tracker_out::shared::{OutCounts, OutShared, OutThread};
use crate::runtime::tracker_out::source::{Source, TrackerEyes, unknown};
use crate::runtime::tracker_out::tap::{Seen, TapParts};
use base::clock::Clock;
use base::time::{Span, Tai};
use config::TrackerOutFault;
use crossbeam_channel::RecvTimeoutError;
use frames::camera_control::{CameraCommand, CameraDesk, CommandSource, Commanded};
use frames::sink::crc32::Crc32;
use std::{collections::VecDeque, net::SocketAddr, sync::Arc, time::Duration};
use telemetry::{Device, Mode, Order, Report, Wire};

/// Reports and packets that may wait; more are lost and counted.
const WAITING_MAX: usize = 1024;
/// Packets of clients that are taken in one step: the others wait for the next.
const COMMANDS_PER_STEP: usize = 64;
/// Answers to one datagram with a command that was obeyed: as many as the longest dialogue of a protocol has. Any other
/// datagram gets one: its sender has proven nothing, and its address may be forged.
const ANSWERS_PER_DATAGRAM: usize = 4;
/// Answers to datagrams in a second; more commands are obeyed without one, and counted as refused.
const ANSWERS_PER_S: u32 = 500;

/// Timing of a tracker.
#[derive(Debug, Clone, PartialEq)]
pub struct TelemeterParams {
    /// From the end of the exposure to the packet: readout and thinking.
    pub after_exposure: Span,
    /// Error of the time tags.
    pub tag_error: Span,
    /// From one packet to the next; `None`: one with each frame.
    pub period: Option<Span>,
    /// First exposure of the run: where a rate of its own begins, and the times of faults count from.
    pub zero: Tai,
    /// Faults.
    pub faults: Vec<TrackerOutFault>,
    /// Seed of the faults.
    pub seed: u64,
}

/// A tracker at work.
pub struct Telemeter {
    params: TelemeterParams,
    source: Source,
    device: Box<dyn Device>,
    outlet: Outlet,
    frames: TapParts,
    desk: Option<CameraDesk>,
    clock: Arc<dyn Clock>,
    shared: Arc<OutShared>,
    damages: Damages,
    waiting: VecDeque<(Tai, Report)>,
    late: VecDeque<(Tai, Wire)>,
    newest: Option<Report>,
    next_beat: Option<Tai>,
    is_operating: bool,
    counts: OutCounts,
    crc: Crc32,
    out: Vec<Wire>,
    orders: Vec<Order>,
    answers: Answers,
    /// Answers that were left out.
    unanswered: u64,
}

/// Answers to datagrams in the present second.
#[derive(Default)]
struct Answers {
    second: Option<(Tai, u32)>,
}

impl Answers {
    /// Returns how many of so many answers to a datagram may go out at `now`, and counts them.
    fn allow(&mut self, wanted: usize, has_obeyed: bool, now: Tai) -> usize {
        let wanted = wanted.min(if has_obeyed { ANSWERS_PER_DATAGRAM } else { 1 });
        let (since, sent) = self.second.filter(|(since, _)| now - *since < Span::from_ms(1000)).unwrap_or((now, 0));
        let allowed = u32::try_from(wanted).unwrap_or(u32::MAX).min(ANSWERS_PER_S.saturating_sub(sent));
        self.second = Some((since, sent + allowed));
        allowed as usize
    }
}

impl Telemeter {
    /// Returns a tracker that is switched on now.
    pub fn new(
        params: TelemeterParams,
        (eyes, device): (TrackerEyes, Box<dyn Device>),
        (frames, outlet): (TapParts, Outlet),
        desk: Option<CameraDesk>,
        (clock, shared): (Arc<dyn Clock>, Arc<OutShared>),
    ) -> Self {
        let source = Source::new(eyes, params.tag_error);
        let damages = Damages::new(params.faults.clone(), params.zero, params.seed);
        let next_beat = params.period.map(|_| params.zero);
        let mut telemeter = Self {
            params,
            source,
            device,
            outlet,
            frames,
            desk,
            clock,
            shared,
            damages,
            waiting: VecDeque::new(),
            late: VecDeque::new(),
            newest: None,
            next_beat,
            is_operating: true,
            counts: OutCounts::default(),
            crc: Crc32::default(),
            out: Vec::new(),
            orders: Vec::new(),
            answers: Answers::default(),
            unanswered: 0,
        };
        let now = telemeter.clock.now();
        telemeter.device.start(now, &mut telemeter.out);
        telemeter.send_out(now, None);
        telemeter
    }

    /// Returns the queue of frames, for whoever waits for the next.
    pub fn frames(&self) -> &crossbeam_channel::Receiver<Seen> {
        &self.frames.full
    }

    /// Measures a frame.
    pub fn take(&mut self, seen: Seen) {
        let report = if self.is_operating { self.source.report(&seen) } else { unknown(&seen, Mode::Standby) };
        let ready = (seen.exposure_end() + self.params.after_exposure).max(self.clock.now());
        if self.waiting.len() >= WAITING_MAX {
            self.waiting.pop_front();
            self.lose("more than a thousand reports waited");
        }
        self.waiting.push_back((ready, report));
        let _the_other_end_may_be_gone = self.frames.empty.try_send(seen);
    }

    /// Does everything that is due by `now`: measures frames that have come, sends, obeys clients. Commands never delay
    /// a report.
    pub fn step(&mut self, now: Tai) {
        while let Ok(seen) = self.frames.full.try_recv() {
            self.take(seen);
        }
        self.act_until(now);
        self.listen(now);
        self.act_until(now);
        self.publish();
    }

    fn act_until(&mut self, now: Tai) {
        while let Some(due) = self.next_due().filter(|due| *due <= now) {
            self.act(due);
        }
    }

    /// When it next has something to do without being asked.
    pub fn next_due(&self) -> Option<Tai> {
        let ready = self.waiting.front().map(|(at, _)| *at);
        let late = self.late.iter().map(|(at, _)| *at).min();
        [ready, late, self.next_beat, self.device.next_due()].into_iter().flatten().min()
    }

    /// True when its line brings commands of clients, which come at any time.
    pub fn has_clients(&self) -> bool {
        self.outlet.has_clients()
    }

    /// Sends all that waits, each at its own time, and closes the line.
    pub fn finish(&mut self) {
        while let Ok(seen) = self.frames.full.try_recv() {
            self.take(seen);
        }
        let last = self.waiting.back().map(|(at, _)| *at);
        while let Some(due) = self.next_due().filter(|due| last.is_some_and(|last| *due <= last)) {
            if self.clock.is_real() {
                self.clock.sleep_until(due);
            }
            self.act(due);
        }
        let late: Vec<(Tai, Wire)> = self.late.drain(..).collect();
        late.into_iter().for_each(|(at, wire)| self.send(&wire, at, None));
        if let Err(error) = self.outlet.finish() {
            self.counts.first_error.get_or_insert_with(|| error.to_string());
        }
        self.publish();
    }

    /// Does what is due at an instant. On the real clock packets say when they go out.
    fn act(&mut self, due: Tai) {
        let now = if self.clock.is_real() { self.clock.now() } else { due };
        let beats = self.next_beat.is_some_and(|at| at <= due);
        while let Some((_, report)) = self.waiting.front().filter(|(at, _)| *at <= due).copied() {
            self.waiting.pop_front();
            self.newest = Some(report);
            if self.params.period.is_none() {
                self.report(now);
            }
        }
        if beats {
            self.next_beat = self.next_beat.zip(self.params.period).map(|(at, period)| at + period);
            if self.newest.is_some() {
                self.report(now);
            }
        }
        while let Some(place) = self.late.iter().position(|(at, _)| *at <= due) {
            if let Some((_, wire)) = self.late.remove(place) {
                self.send(&wire, now, None);
            }
        }
        self.device.step(due, &mut self.out);
        self.send_out(now, None);
    }

    fn report(&mut self, now: Tai) {
        let Some(newest) = self.newest else { return };
        let report = self.damages.of_report(&newest, now);
        self.counts.reports += 1;
        self.counts.attitudes += u64::from(report.attitude_wxyz.is_some());
        self.device.report(&report, now, &mut self.out);
        self.send_out(now, None);
    }

    /// Sends what the device has put out, to whoever asked for it where somebody did.
    fn send_out(&mut self, now: Tai, asked_by: Option<SocketAddr>) {
        for wire in core::mem::take(&mut self.out) {
            match self.damages.of_packet(wire, now) {
                Fate::Now(wire) => self.send(&wire, now, asked_by),
                Fate::Later(wire, by) if self.late.len() < WAITING_MAX => self.late.push_back((now + by, wire)),
                Fate::Later(..) => self.lose("more than a thousand packets were to be late"),
                Fate::Gone => {}
            }
        }
    }

    fn send(&mut self, wire: &Wire, at: Tai, asked_by: Option<SocketAddr>) {
        match self.outlet.send(wire, at, asked_by) {
            Ok(()) => {
                self.counts.packets += 1;
                self.counts.bytes += wire.data().len() as u64;
                self.crc.update(&at.ns().to_le_bytes());
                self.crc.update(wire.data());
            }
            Err(OutletError::Unread { .. }) => {
                self.counts.unread += 1;
            }
            Err(error @ (OutletError::System { .. } | OutletError::Link(_))) => self.lose(&error.to_string()),
        }
    }

    fn lose(&mut self, why: &str) {
        self.counts.lost += 1;
        self.counts.first_error.get_or_insert_with(|| why.into());
    }

    /// Takes what clients have sent, until a report is due.
    fn listen(&mut self, now: Tai) {
        self.outlet.welcome(now);
        for _ in 0..COMMANDS_PER_STEP {
            if self.clock.is_real() && self.next_due().is_some_and(|due| due <= self.clock.now()) {
                return;
            }
            let Some((wire, from)) = self.outlet.receive() else { return };
            let obeyed = self.device.answered().commands;
            self.device.take(&wire, now, &mut self.out, &mut self.orders);
            let has_obeyed = self.device.answered().commands > obeyed;
            if has_obeyed {
                self.outlet.keep_client();
            }
            if from.is_some() {
                let allowed = self.answers.allow(self.out.len(), has_obeyed, now);
                self.unanswered += self.out.len().saturating_sub(allowed) as u64;
                self.out.truncate(allowed);
            }
            for order in core::mem::take(&mut self.orders) {
                self.obey(order, now);
            }
            self.send_out(now, from);
        }
    }

    fn obey(&mut self, order: Order, now: Tai) {
        match order {
            Order::Operate => self.is_operating = true,
            Order::Pause => {
                self.is_operating = false;
                self.source.forget();
            }
            Order::Reset => {
                self.is_operating = true;
                self.source.forget();
                self.waiting.clear();
                self.newest = None;
            }
            Order::Exposure(exposure) => {
                let command = CameraCommand::Exposure(exposure);
                let commanded = Commanded { command, at: now, from: CommandSource::Tracker };
                if !self.desk.as_ref().is_some_and(|desk| desk.put(commanded)) {
                    self.lose("the camera's queue of commands was full");
                }
            }
        }
    }

    fn publish(&mut self) {
        let answered = self.device.answered();
        (self.counts.commands, self.counts.refused) = (answered.commands, answered.refused + self.unanswered);
        (self.counts.faults, self.counts.crc32) = (self.damages.hits, self.crc.value());
        self.shared.publish(&self.counts);
    }
}

/// A line with clients is looked at this often.
const LISTEN_EVERY: Span = Span::from_ms(2);
/// The thread looks after itself at least this often.
const LONGEST_WAIT: Span = Span::from_ms(100);

impl OutThread {
    /// Starts the thread of a tracker; it ends when the sending end of its frames is gone.
    ///
    /// # Errors
    /// When the system has no thread for it.
    pub fn start(mut telemeter: Telemeter, clock: Arc<dyn Clock>) -> Result<Self> {
        let run = move || {
            let most = if telemeter.has_clients() { LISTEN_EVERY } else { LONGEST_WAIT };
            loop {
                telemeter.step(clock.now());
                let now = clock.now();
                let wait = telemeter.next_due().map_or(most, |due| (due - now).min(most));
                let wait = Duration::from_nanos(u64::try_from(wait.ns()).unwrap_or(0));
                match telemeter.frames().recv_timeout(wait) {
                    Ok(seen) => telemeter.take(seen),
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => return telemeter.finish(),
                }
            }
        };
        let thread = std::thread::Builder::new().name("tracker out".into()).spawn(run);
        thread.map(Self).map_err(|source| RunError::Thread { name: "tracker out", source })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_are_bounded_by_the_second() {
        let (mut answers, start) = (Answers::default(), Tai::from_ns(0));
        let sent = |answers: &mut Answers, now| (0..1000).map(|_| answers.allow(3, true, now)).sum::<usize>();
        assert_eq!(sent(&mut answers, start), ANSWERS_PER_S as usize);
        assert_eq!(sent(&mut answers, start + Span::from_ms(999)), 0);
        assert_eq!(sent(&mut answers, start + Span::from_ms(1000)), ANSWERS_PER_S as usize);
        assert_eq!(Answers::default().allow(3, true, start), 3, "control");
    }

    #[test]
    fn a_datagram_in_which_nothing_is_obeyed_gets_one_answer() {
        let allowed = |wanted, has_obeyed| Answers::default().allow(wanted, has_obeyed, Tai::from_ns(0));
        assert_eq!((allowed(1000, false), allowed(1, false), allowed(0, false)), (1, 1, 0));
        assert_eq!((allowed(1000, true), allowed(3, true)), (ANSWERS_PER_DATAGRAM, 3), "control");
    }
}
