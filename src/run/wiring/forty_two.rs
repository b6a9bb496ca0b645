//! The simulator 42 as the plant and the clock of a virtual run: its own handshake is the lockstep.
//!
//! 42 writes the lines of one instant over TCP and waits for its answer. In: the bench of a run on the virtual clock
//! whose link reads 42. Out: a run that takes the attitude of each message at the message's own instant, draws what is
//! due up to it, and answers only then. The first message is the start of the run's clock. A message that is refused is
//! counted as `sample_refused` and answered, so that 42 goes on. Tests: `hil_scripts/tests/test_plain_links.py`.

use crate::runtime::{PlantSample, RunRecord, plain_sample};
use crate::wiring::{assemble::Run, error::LoopError, run_end::RunEnd, stepped::SteppedRun, verdict::CutShort};
use anyhow::{Context, Result, anyhow, bail};
use base::patience::Patience;
use base::time::{Span, Tai};
use config::{Carrier, Scenario, StartTime};
use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use frames::sink::SentFrame;
use link::DATAGRAM_MAX;
use link::plain::{ACKNOWLEDGE, PlainCodec, PlainRecord, PlainTime, is_end_of_message};
use std::io::{BufRead, BufReader, ErrorKind, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};

/// How often a wait looks for Ctrl-C.
const LOOK: Duration = Duration::from_millis(100);
/// Silence after which the other end counts as gone.
const PATIENCE: Span = Span::from_ms(60_000);

/// 42 at the other end of a connection.
pub struct FortyTwo {
    address: SocketAddr,
    reader: BufReader<TcpStream>,
    codec: PlainCodec,
    line: Vec<u8>,
    /// The message that was read to find the start, until the run takes it.
    first: Option<PlainRecord>,
    start_ns: i64,
}

/// Connects to 42, or waits for it, and reads its first message; the run then has no cable, and with
/// `start_utc = "plant"` begins at that message's date. `None` when `stop` is set meanwhile.
///
/// # Errors
/// When 42 cannot be reached, or sends nothing that is a message.
pub fn meet(scenario: &mut Scenario, stop: &AtomicBool) -> Result<Option<FortyTwo>> {
    let bench = &mut scenario.bench;
    let Carrier::Tcp { address, connects } = bench.link.carrier else { bail!("42 is reached over TCP") };
    let layout = bench.link.plain.as_ref().context("a link without a layout")?.layout.clone();
    let stream = if connects { connected(address, stop)? } else { accepted(address, stop)? };
    let Some(stream) = stream else { return Ok(None) };
    stream.set_nonblocking(false)?;
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(LOOK))?;
    let (reader, codec) = (BufReader::new(stream), PlainCodec::new(layout));
    let mut forty_two = FortyTwo { address, reader, codec, line: Vec::new(), first: None, start_ns: 0 };
    let first = match forty_two.next(stop)? {
        Got::Record(record) => record,
        Got::Refused => {
            let quote = forty_two.codec.first_refused().map(|refused| refused.to_string()).unwrap_or_default();
            bail!("42 at {address}: got {quote}; wanted TIME, SC[n].qn and SC[n].wn of link.spacecraft_number");
        }
        Got::Nothing if stop.load(Ordering::Relaxed) => return Ok(None),
        Got::Nothing => bail!("42 at {address} closed the connection, or was silent, before its first message"),
    };
    forty_two.start_ns = tag_ns(&first)?;
    forty_two.first = Some(first);
    if bench.timing.start == StartTime::Plant {
        bench.timing.start = StartTime::At(Tai::from_unix_ns(forty_two.start_ns));
    }
    scenario.step_by_plant();
    Ok(Some(forty_two))
}

fn connected(address: SocketAddr, stop: &AtomicBool) -> Result<Option<TcpStream>> {
    let (mut patience, mut tries) = (Patience::new(PATIENCE), 0_u32);
    while !stop.load(Ordering::Relaxed) {
        tries += 1;
        match TcpStream::connect_timeout(&address, Duration::from_secs(1)) {
            Ok(stream) => return Ok(Some(stream)),
            Err(error) if patience.is_over() => {
                return Err(anyhow!(
                    "tcp: {address}: {tries} tries to connect failed: {error}; start 42 as the server"
                ));
            }
            Err(_not_yet) => {
                if tries == 1 {
                    eprintln!("link: waiting for 42 at tcp {address}");
                }
                std::thread::sleep(LOOK);
            }
        }
    }
    Ok(None)
}

fn accepted(address: SocketAddr, stop: &AtomicBool) -> Result<Option<TcpStream>> {
    let listener = TcpListener::bind(address).with_context(|| format!("cannot listen at tcp {address}"))?;
    listener.set_nonblocking(true)?;
    eprintln!("link: tcp at {}; waiting for 42", listener.local_addr()?);
    while !stop.load(Ordering::Relaxed) {
        match listener.accept() {
            Ok((stream, _)) => return Ok(Some(stream)),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
                std::thread::sleep(LOOK);
            }
            Err(error) => return Err(error).with_context(|| format!("tcp at {address}")),
        }
    }
    Ok(None)
}

/// Result of waiting for a message.
enum Got {
    Record(PlainRecord),
    /// A message that was refused, and counted.
    Refused,
    /// The end of the connection, silence, or Ctrl-C.
    Nothing,
}

impl FortyTwo {
    /// Returns the instant of the first message, UTC in words, for a bench whose sky is of another date.
    pub fn start(&self) -> Tai {
        Tai::from_unix_ns(self.start_ns)
    }

    /// Flies the run by 42's messages until its end, the end of the connection, or until `stop` is set.
    ///
    /// # Errors
    /// When the run cannot start; the result states why a started run ended early.
    pub fn drive(
        mut self,
        run: Run,
        stop: &AtomicBool,
        progress: &mut dyn FnMut(usize, &SentFrame, &RunRecord),
    ) -> Result<RunEnd> {
        let mut going = SteppedRun::of(run)?;
        let flown = self.fly(&mut going, stop, progress);
        let is_gone = matches!(flown, Ok(false)) && !stop.load(Ordering::Relaxed);
        if let Some(refused) = self.codec.first_refused() {
            eprintln!("starloop: 42 at {}: the first refused line: {refused}", self.address);
        }
        let mut end = going.end(flown.err().map(LoopError::Parts));
        end.cut_short = is_gone.then_some(CutShort::PlantGone);
        Ok(end)
    }

    /// Returns whether the run has come to its end.
    fn fly(
        &mut self,
        going: &mut SteppedRun,
        stop: &AtomicBool,
        progress: &mut dyn FnMut(usize, &SentFrame, &RunRecord),
    ) -> Result<bool> {
        let start = going.times().start;
        while !going.is_finished() {
            let got = self.first.take().map_or_else(|| self.next(stop), |first| Ok(Got::Record(first)))?;
            match got {
                Got::Nothing => return Ok(false),
                Got::Refused => going.note_refused_sample(),
                Got::Record(record) => {
                    let at = start + Span::from_ns(tag_ns(&record)?.saturating_sub(self.start_ns));
                    let samples: Vec<PlantSample> = plain_sample(&record, at).into_iter().collect();
                    going.take_plant(&samples)?;
                    going.advance_to(at, &mut |head, frame, record| {
                        progress(head, frame, record);
                        !stop.load(Ordering::Relaxed)
                    })?;
                }
            }
            self.answer()?;
        }
        Ok(true)
    }

    /// Reads up to the end of a message.
    fn next(&mut self, stop: &AtomicBool) -> Result<Got> {
        loop {
            if !self.read_line(stop)? {
                return Ok(Got::Nothing);
            }
            let record = self.codec.read(&self.line);
            let is_end = is_end_of_message(&self.line);
            self.line.clear();
            match record {
                Some(record) => return Ok(Got::Record(record)),
                None if is_end => return Ok(Got::Refused),
                None => {}
            }
        }
    }

    /// Reads a line; false at the end of the connection, after long silence, or when `stop` is set.
    fn read_line(&mut self, stop: &AtomicBool) -> Result<bool> {
        let mut patience = Patience::new(PATIENCE);
        while !patience.is_over() && !stop.load(Ordering::Relaxed) {
            let waiting = match self.reader.fill_buf() {
                Ok([]) => return Ok(false),
                Ok(waiting) => waiting,
                Err(error) if is_quiet(error.kind()) => continue,
                Err(error) if error.kind() == ErrorKind::ConnectionReset => return Ok(false),
                Err(error) => return Err(error).with_context(|| format!("42 at {}", self.address)),
            };
            let end = waiting.iter().position(|byte| *byte == b'\n');
            let taken = end.map_or(waiting.len(), |end| end + 1);
            self.line.extend_from_slice(&waiting[..taken]);
            self.reader.consume(taken);
            if self.line.len() > DATAGRAM_MAX {
                bail!("42 at {}: got a line of more than {DATAGRAM_MAX} bytes, wanted lines of 42", self.address);
            }
            if end.is_some() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Answers a message; a connection that is gone shows when it is read next.
    fn answer(&mut self) -> Result<()> {
        match self.reader.get_mut().write_all(ACKNOWLEDGE) {
            Err(error) if !matches!(error.kind(), ErrorKind::BrokenPipe | ErrorKind::ConnectionReset) => {
                Err(error).with_context(|| format!("42 at {}", self.address))
            }
            _ => Ok(()),
        }
    }
}

fn is_quiet(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}

/// Returns 42's own time of a message, Unix time in ns.
fn tag_ns(record: &PlainRecord) -> Result<i64> {
    match record.time {
        PlainTime::Tag(tag_ns) => Ok(tag_ns),
        PlainTime::Arrival => bail!("link.time: got \"arrival\"; wanted \"tag\" on the virtual clock"),
    }
}
