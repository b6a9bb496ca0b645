//! A capture -> the messages of its links, each through its own port, the earliest first.

use super::{ReplayError, Result};
use crate::{runtime::RunError, wiring::ports::port_over};
use base::time::{Span, Tai};
use config::{Bench, Link as LinkSettings};
use link::capture::{CaptureError, CaptureReader, CapturedPacket, Direction};
use link::{Input, Link, LinkCounters, LinkError, Packet, Port, Stamped, WireFormat};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::{fs::File, path::Path};

/// Source of packets.
pub(super) struct Source<'a> {
    pub(super) bus: &'a Path,
    /// True when packets sent by the capturing side count: captures of other programs do not state who sent them.
    pub(super) takes_sent: bool,
}

impl Source<'_> {
    fn open(&self) -> Result<CaptureReader<File>> {
        let file = File::open(self.bus).map_err(ReplayError::file(self.bus, "read the packets"))?;
        CaptureReader::new(file).map_err(|error| self.refuse(error))
    }

    fn refuse(&self, error: CaptureError) -> ReplayError {
        ReplayError::at(self.bus, error)
    }

    /// Returns the time of the first packet.
    pub(super) fn first_at(&self) -> Result<Tai> {
        let first = self.open()?.read().map_err(|error| self.refuse(error))?;
        let none = || ReplayError::at(self.bus, "holds no packet that could be used");
        Ok(first.ok_or_else(none)?.at)
    }
}

/// State of a playback, shared by a link and its reader.
#[derive(Default)]
struct Played {
    damage: Option<String>,
    skipped: u64,
    last_at: Option<Tai>,
}

/// A link that returns its captured packets one after the other, independent of time.
struct PlaybackLink {
    reader: CaptureReader<File>,
    takes_sent: bool,
    /// Interface whose packets it returns; `None`: all.
    interface: Option<u8>,
    counters: LinkCounters,
    played: Arc<Mutex<Played>>,
}

impl PlaybackLink {
    fn is_own(&self, captured: &CapturedPacket) -> bool {
        let is_taken = captured.direction == Direction::Received || self.takes_sent;
        is_taken && self.interface.is_none_or(|interface| interface == captured.interface)
    }
}

fn lock(played: &Mutex<Played>) -> MutexGuard<'_, Played> {
    played.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Link for PlaybackLink {
    fn receive(&mut self, _until: Tai) -> Result<Option<Stamped<Packet>>, LinkError> {
        loop {
            match self.reader.read() {
                Ok(Some(captured)) if self.is_own(&captured) => {
                    self.counters.received += 1;
                    let mut played = lock(&self.played);
                    played.last_at = played.last_at.max(Some(captured.at));
                    return Ok(Some(Stamped { at: captured.at, value: captured.packet }));
                }
                Ok(Some(_sent_or_of_another_link)) => {}
                Ok(None) => {
                    lock(&self.played).skipped = self.reader.skipped();
                    return Ok(None);
                }
                Err(error) => lock(&self.played).damage = Some(error.to_string()),
            }
        }
    }

    fn send(&mut self, _packet: &Packet) -> Result<Tai, LinkError> {
        self.counters.sent += 1;
        Ok(Tai::from_ns(0))
    }

    fn counters(&self) -> LinkCounters {
        self.counters
    }
}

/// One link of a capture.
struct CapturedLink {
    port: Port,
    played: Arc<Mutex<Played>>,
    /// Delay that the port subtracts from the arrival stamps.
    delay: Span,
    /// The message that was read last, if it has not been taken.
    next: Option<Stamped<Input>>,
    is_over: bool,
}

impl CapturedLink {
    fn open(bench: &Bench, settings: &LinkSettings, interface: Option<u8>, source: &Source<'_>) -> Result<Self> {
        let played = Arc::<Mutex<Played>>::default();
        let link = PlaybackLink {
            reader: source.open()?,
            // On a serial line both directions would form one stream of bytes; on a plain link sent packets have no
            // use.
            takes_sent: source.takes_sent && !matches!(settings.wire, WireFormat::Serial | WireFormat::Plain),
            interface,
            counters: LinkCounters::default(),
            played: Arc::clone(&played),
        };
        let delay = Span::from_s((settings.latency_us - bench.link.latency_us) * 1e-6);
        let port = port_over(Box::new(link), settings);
        let port = port.less_delay(delay);
        Ok(Self { port, played, delay, next: None, is_over: false })
    }

    /// Returns when the next message arrived; `None` at the end.
    fn arrival(&mut self) -> Result<Option<Tai>> {
        if self.next.is_none() && !self.is_over {
            self.next = self.port.receive_any(Tai::from_ns(i64::MAX)).map_err(RunError::from)?;
            self.is_over = self.next.is_none();
        }
        Ok(self.next.map(|message| message.at + self.delay))
    }
}

/// The links of a bench as they were captured.
pub(super) struct CapturedLinks {
    links: Vec<CapturedLink>,
}

impl CapturedLinks {
    /// Opens the capture for each link of the bench. A bench with one link takes the packets of all interfaces, because
    /// a capture by another program may give that link any number.
    pub(super) fn open(bench: &Bench, source: &Source<'_>) -> Result<Self> {
        let has_several = !bench.extra_links.is_empty();
        let settings = core::iter::once(&bench.link).chain(&bench.extra_links).zip(0..=u8::MAX);
        let link = |(settings, number)| CapturedLink::open(bench, settings, has_several.then_some(number), source);
        Ok(Self { links: settings.map(link).collect::<Result<_, _>>()? })
    }

    /// Takes the earliest message that arrived up to `until` among the selected links, with the number of its link.
    pub(super) fn take(
        &mut self,
        until: Tai,
        is_wanted: impl Fn(usize) -> bool,
    ) -> Result<Option<(usize, Stamped<Input>)>> {
        let mut earliest: Option<(Tai, usize)> = None;
        for (number, link) in self.links.iter_mut().enumerate().filter(|(number, _)| is_wanted(*number)) {
            let Some(at) = link.arrival()?.filter(|at| *at <= until) else { continue };
            if earliest.is_none_or(|(before, _)| at < before) {
                earliest = Some((at, number));
            }
        }
        let taken = earliest.and_then(|(_, number)| Some((number, self.links.get_mut(number)?.next.take()?)));
        Ok(taken)
    }

    /// Returns true when no link has a message left.
    pub(super) fn are_over(&self) -> bool {
        self.links.iter().all(|link| link.is_over)
    }

    /// Returns the time of the last packet so far.
    pub(super) fn last_at(&self) -> Option<Tai> {
        self.links.iter().filter_map(|link| lock(&link.played).last_at).max()
    }

    /// Reads the rest, so that damage anywhere is reported. Returns the number of unsupported packets, and the damage.
    pub(super) fn finish(mut self) -> Result<(u64, Option<String>)> {
        while self.take(Tai::from_ns(i64::MAX), |_| true)?.is_some() {}
        // Every link has read the whole file.
        let Some(first) = self.links.first() else { return Ok((0, None)) };
        let played = lock(&first.played);
        Ok((played.skipped, played.damage.clone()))
    }
}
