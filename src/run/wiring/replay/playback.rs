//! A capture -> frames, through the same port, receiver and engine as in the run.

use super::{CapturedFate, FRAMES_FILE, FrameRow, ReplayError, RowReader, Session, completeness};
use crate::runtime::receiver::Receiver;
use crate::runtime::{FrameEngine, Ledger, RunParams};
use crate::wiring::bench_parts;
use crate::wiring::ports::identifiers;
use base::time::{Span, Tai};
use config::{Bench, Wire};
use core::ops::Range;
use firmware_protocol::Message;
use frames::sink::crc32::pixel_crc32;
use frames::sink::{SentFrame, Sink};
use link::capture::{CaptureReader, Direction};
use link::{Link, LinkCounters, LinkError, Packet, Port, Stamped};
use std::fs::File;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// An image that is not the captured one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Difference {
    /// Frame number.
    pub frame: u32,
    /// Checksum in the capture.
    pub wanted: u32,
    /// Checksum of the replay.
    pub got: u32,
}

/// What a replay came to.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReplayOutcome {
    /// Frames drawn.
    pub drawn: u64,
    /// Frames compared with the capture.
    pub compared: u64,
    /// Of those, the ones that are not bit-identical.
    pub differing: u64,
    /// The first of them.
    pub first: Option<Difference>,
    /// Packets that have no form here.
    pub skipped_packets: u64,
    /// What makes the result doubtful, a sentence each.
    pub doubts: Vec<String>,
}

/// Draws the frames of a captured run again and compares each with the captured one; `sink` gets those in `frames`.
///
/// # Errors
/// When a file of the capture cannot be used, or drawing failed.
pub fn replay_session(
    directory: &Path,
    frames: Option<Range<u32>>,
    sink: Option<&mut dyn Sink>,
) -> Result<ReplayOutcome, ReplayError> {
    let session = Session::read(directory)?;
    completeness::check(directory, &session)?;
    let bench = session.bench()?;
    let mut params = run_params(&bench, session.start())?;
    if session.is_real {
        bench_parts::take_real_clock(&mut params, &bench, session.cost()?);
    }
    let mut rows = RowReader::open(&directory.join(FRAMES_FILE))?;
    let source = Source { bus: &directory.join(&session.bus), takes_sent: false };
    let mut replay = Replay::new(&bench, params, &source, frames.unwrap_or(0..u32::MAX), sink)?;
    if session.is_real {
        replay.engine.follow_load();
    }
    replay.outcome.doubts = session.doubts();
    replay.doubt_another_machine(&session);
    while let Some(row) = rows.read()? {
        replay.row(&row)?;
    }
    if rows.is_cut_off() {
        replay.doubt("frames.csv is cut off: the frames before are replayed".into());
    }
    replay.finish()
}

/// Draws what a bench would have made of a capture (candump log or pcapng) for which there is nothing to compare. The
/// bench's clock starts with the first packet; frames end with the bench's duration or the last packet.
///
/// # Errors
/// When the capture cannot be read, the bench cannot be made, or drawing failed.
pub fn replay_bus(
    bus: &Path,
    bench: &Bench,
    frames: Option<Range<u32>>,
    sink: Option<&mut dyn Sink>,
) -> Result<ReplayOutcome, ReplayError> {
    // On a serial line both directions would be one stream of bytes.
    let source = Source { bus, takes_sent: bench.link.wire != Wire::Serial };
    let first = source.open()?.read().map_err(|error| source.refuse(error))?;
    let first =
        first.ok_or_else(|| ReplayError::Parts(format!("{}: holds no packet that could be used", bus.display())))?;
    let params = run_params(bench, first.at)?;
    let all = params.frames;
    let mut replay = Replay::new(bench, params, &source, frames.unwrap_or(0..u32::MAX), sink)?;
    let mut next = replay.next_message()?;
    for number in 0..all {
        let release = replay.engine.slot(number).release;
        while let Some(message) = next.filter(|message| message.at <= release) {
            replay.receiver.accept(&message, &mut replay.ledger);
            next = replay.next_message()?;
        }
        if next.is_none() && replay.last_at() < release {
            break;
        }
        if replay.frames.contains(&number) {
            replay.draw(number)?;
        }
    }
    replay.finish()
}

fn run_params(bench: &Bench, start: Tai) -> Result<RunParams, ReplayError> {
    bench_parts::run_params(bench, start).map_err(|error| ReplayError::Parts(format!("{error:#}")))
}

/// Where packets come from.
struct Source<'a> {
    bus: &'a Path,
    /// Whether packets count that the capturing side sent: who that was, a capture of someone else's does not say.
    takes_sent: bool,
}

impl Source<'_> {
    fn open(&self) -> Result<CaptureReader<File>, ReplayError> {
        let refuse = |source| ReplayError::File { path: self.bus.into(), doing: "read the packets", source };
        let file = File::open(self.bus).map_err(refuse)?;
        CaptureReader::new(file).map_err(|error| self.refuse(error))
    }

    fn refuse(&self, source: link::capture::CaptureError) -> ReplayError {
        ReplayError::Capture { path: self.bus.into(), source }
    }
}

/// What a playback has come to; shared by the link and the replay.
#[derive(Default)]
struct Played {
    damage: Option<String>,
    skipped: u64,
    last_at: Option<Tai>,
}

/// A link that gives what was captured, one packet after the other, whatever the time.
struct PlaybackLink {
    reader: CaptureReader<File>,
    takes_sent: bool,
    counters: LinkCounters,
    played: Arc<Mutex<Played>>,
}

impl Link for PlaybackLink {
    fn receive(&mut self, _until: Tai) -> Result<Option<Stamped<Packet>>, LinkError> {
        let mut played = self.played.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            match self.reader.read() {
                Ok(Some(captured)) if captured.direction == Direction::Received || self.takes_sent => {
                    self.counters.received += 1;
                    played.last_at = played.last_at.max(Some(captured.at));
                    return Ok(Some(Stamped { at: captured.at, value: captured.packet }));
                }
                Ok(Some(_sent)) => {}
                Ok(None) => {
                    played.skipped = self.reader.skipped();
                    return Ok(None);
                }
                Err(error) => played.damage = Some(error.to_string()),
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

/// A replay under way.
struct Replay<'a> {
    engine: FrameEngine,
    receiver: Receiver,
    port: Port,
    ledger: Ledger,
    frame: SentFrame,
    frames: Range<u32>,
    sink: Option<&'a mut dyn Sink>,
    played: Arc<Mutex<Played>>,
    /// Checksum of the last frame that went out in time.
    previous: Option<u32>,
    has_run_out: bool,
    outcome: ReplayOutcome,
}

impl<'a> Replay<'a> {
    fn new(
        bench: &Bench,
        params: RunParams,
        source: &Source<'_>,
        frames: Range<u32>,
        sink: Option<&'a mut dyn Sink>,
    ) -> Result<Self, ReplayError> {
        let played = Arc::<Mutex<Played>>::default();
        let link = PlaybackLink {
            reader: source.open()?,
            takes_sent: source.takes_sent,
            counters: LinkCounters::default(),
            played: Arc::clone(&played),
        };
        let (_, format) = bench_parts::bus(bench);
        let ids = identifiers(&bench.link).map_err(|error| ReplayError::Parts(format!("{error:#}")))?;
        let receiver = Receiver::new(params.attitude.clone())?.with_session(bench_parts::session_params(bench));
        let mut engine = FrameEngine::new(params)?;
        let camera = &engine.params().camera;
        let size = camera.output().size_px;
        let mut frame = SentFrame::with_capacity(size[0], size[1], 0, camera.name.clone());
        engine.warm_up(&mut frame)?;
        Ok(Self {
            engine,
            receiver,
            port: Port::new(Box::new(link), format, ids),
            ledger: Ledger::default(),
            frame,
            frames,
            sink,
            played,
            previous: None,
            has_run_out: false,
            outcome: ReplayOutcome::default(),
        })
    }

    fn doubt(&mut self, why: String) {
        self.outcome.doubts.push(why);
    }

    /// Bits repeat on the same version and vector level only.
    fn doubt_another_machine(&mut self, session: &Session) {
        let here = env!("CARGO_PKG_VERSION");
        if session.starloop_version != here {
            self.doubt(format!("captured by starloop {}, this is {here}: images may differ", session.starloop_version));
        }
        let level = |adapter: &str| adapter.split_once("vector level ").map(|(_, level)| level.to_owned());
        let (was, is) = (level(&session.adapter), level(&self.engine.imager().description()));
        if was != is {
            let name = |level: Option<String>| level.unwrap_or_else(|| "none".into());
            self.doubt(format!(
                "captured at vector level {}, here it is {}: last bits may differ",
                name(was),
                name(is)
            ));
        } else if was.is_none() && session.adapter != self.engine.imager().description() {
            self.doubt(format!("captured on {}: images may differ by 1 DN here", session.adapter));
        }
    }

    fn next_message(&mut self) -> Result<Option<Stamped<Message>>, ReplayError> {
        Ok(self.port.receive(Tai::from_ns(i64::MAX)).map_err(crate::runtime::RunError::from)?)
    }

    fn last_at(&self) -> Tai {
        let played = self.played.lock().unwrap_or_else(PoisonError::into_inner);
        played.last_at.unwrap_or(Tai::from_ns(i64::MIN))
    }

    /// Draws what a row says was drawn, and compares what it says went out.
    fn row(&mut self, row: &FrameRow) -> Result<(), ReplayError> {
        let mut own = None;
        if let Some((messages, load)) = row.drawn {
            self.receive_up_to(messages, row.frame)?;
            if self.frames.contains(&row.frame) {
                self.engine.assume_load(load);
                own = self.draw(row.frame)?;
            }
        }
        let (wanted, got) = match row.fate {
            CapturedFate::Sent => {
                self.previous = own;
                (row.crc32, own)
            }
            CapturedFate::Late => (row.crc32, own),
            CapturedFate::Held => (row.crc32, self.previous.filter(|_| self.frames.contains(&row.frame))),
            CapturedFate::Dropped => (None, None),
        };
        if let (Some(wanted), Some(got)) = (wanted, got) {
            self.compare(Difference { frame: row.frame, wanted, got });
        }
        Ok(())
    }

    fn compare(&mut self, pair: Difference) {
        self.outcome.compared += 1;
        if pair.wanted != pair.got {
            self.outcome.differing += 1;
            self.outcome.first = self.outcome.first.or(Some(pair));
        }
    }

    fn receive_up_to(&mut self, messages: u64, frame: u32) -> Result<(), ReplayError> {
        while self.receiver.messages() < messages && !self.has_run_out {
            match self.next_message()? {
                Some(message) => drop(self.receiver.accept(&message, &mut self.ledger)),
                None => {
                    self.has_run_out = true;
                    let had = self.receiver.messages();
                    self.doubt(format!("frame {frame} was drawn after {messages} messages; the capture holds {had}"));
                }
            }
        }
        Ok(())
    }

    /// Draws a frame and hands it on; its checksum.
    fn draw(&mut self, number: u32) -> Result<Option<u32>, ReplayError> {
        let slot = self.engine.slot(number);
        self.receiver.fire_triggers(slot, &mut self.ledger, &mut |_fired| {});
        if self.engine.expose(slot, &mut self.receiver, &mut self.ledger, &mut self.frame)?.is_none() {
            self.doubt(format!("frame {number} was drawn, and has no attitude here"));
            return Ok(None);
        }
        self.frame.meta.lateness = Span::ZERO;
        self.outcome.drawn += 1;
        if let Some(sink) = &mut self.sink {
            sink.send(&self.frame)?;
        }
        Ok(Some(pixel_crc32(&self.frame.image)))
    }

    fn finish(mut self) -> Result<ReplayOutcome, ReplayError> {
        if let Some(sink) = &mut self.sink {
            sink.finish()?;
        }
        // What follows the last frame is read too: damage is told wherever it is.
        while !self.has_run_out {
            self.has_run_out = self.next_message()?.is_none();
        }
        let played = self.played.lock().unwrap_or_else(PoisonError::into_inner);
        self.outcome.skipped_packets = played.skipped;
        self.outcome.doubts.extend(played.damage.clone());
        Ok(self.outcome.clone())
    }
}
