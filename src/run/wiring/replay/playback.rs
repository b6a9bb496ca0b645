//! A capture -> frames, through the same ports, receivers, engines and faults as in the run, head by head.

use super::head_playback::{Difference, HeadOutcome, HeadPlayback, Replayed};
use super::{FRAMES_FILE, RowReader, Session, completeness, sample_table};
use super::{Result, captured_links::Source, rows::RowsOfHead};
use crate::runtime::Head;
use base::refused::Refused;
use config::Scenario;
use core::ops::Range;
use frames::sink::{Sink, SinkError};
use std::path::Path;

/// Result of a replay.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReplayOutcome {
    /// Result of each head that was drawn.
    pub heads: Vec<HeadOutcome>,
    /// Unsupported packets.
    pub skipped_packets: u64,
    /// Reasons to doubt the result, a sentence each.
    pub doubts: Vec<String>,
}

impl ReplayOutcome {
    /// Returns the number of frames that were drawn.
    pub fn drawn(&self) -> u64 {
        self.heads.iter().map(|head| head.drawn).sum()
    }

    /// Returns the number of frames that were compared with the capture.
    pub fn compared(&self) -> u64 {
        self.heads.iter().map(|head| head.compared).sum()
    }

    /// Returns the number of frames that went out and could not be compared.
    pub fn uncompared(&self) -> u64 {
        self.heads.iter().map(|head| head.uncompared).sum()
    }

    /// Returns the number of compared frames that are not bit-identical.
    pub fn differing(&self) -> u64 {
        self.heads.iter().map(|head| head.differing).sum()
    }

    /// Returns the earliest frame that is not bit-identical.
    pub fn first(&self) -> Option<Difference> {
        self.heads.iter().filter_map(|head| head.first).min_by_key(|first| (first.frame, first.head))
    }

    fn add(&mut self, playback: HeadPlayback) -> Result<()> {
        let (head, skipped, doubts) = playback.finish()?;
        self.heads.push(head);
        self.skipped_packets = skipped;
        doubts.into_iter().for_each(|doubt| self.doubt(doubt));
        Ok(())
    }

    /// Adds a doubt once: all heads receive the same packets.
    fn doubt(&mut self, why: String) {
        if !self.doubts.contains(&why) {
            self.doubts.push(why);
        }
    }
}

/// Parts of a run to replay.
#[derive(Debug, Clone, Default)]
pub struct ReplayOptions {
    /// Frames to replay; `None`: all.
    pub frames: Option<Range<u32>>,
    /// Head to replay; `None`: all.
    pub head: Option<usize>,
}

impl ReplayOptions {
    /// Returns the selected heads with their numbers; the others are dropped.
    fn wanted(&self, heads: Vec<Head>) -> Result<Vec<(usize, Head)>> {
        let count = heads.len();
        match self.head.filter(|head| *head >= count) {
            Some(head) => {
                let wanted = format!("wanted a number from 0 to {}", count - 1);
                Err(Refused(format!("--head {head}: the run has {count}; {wanted}")).into())
            }
            None => {
                let is_wanted = |number: usize| self.head.is_none_or(|head| head == number);
                Ok(heads.into_iter().enumerate().filter(|(number, _)| is_wanted(*number)).collect())
            }
        }
    }

    fn frames(&self) -> Range<u32> {
        self.frames.clone().unwrap_or(0..u32::MAX)
    }
}

/// Returns the sink for the frames of a head, if they are wanted; its argument is the head's number if there are
/// several.
pub type SinkOfHead<'a> = &'a mut dyn FnMut(Option<usize>) -> Result<Option<Box<dyn Sink>>, SinkError>;

/// Draws the frames of a captured run again and compares each with the captured one.
///
/// # Errors
/// When a file of the capture cannot be used, or drawing fails.
pub fn replay_session(directory: &Path, options: &ReplayOptions, sink: SinkOfHead<'_>) -> Result<ReplayOutcome> {
    let session = Session::read(directory)?;
    completeness::check(directory, &session)?;
    session.check_data()?;
    let scenario = session.scenario()?;
    let source = Source { bus: &directory.join(&session.bus), takes_sent: false };
    let real = if session.is_real { Some(session.cost()?) } else { None };
    let (start, frames) = (session.start(), options.frames());
    let (replayed, heads) = Replayed::with_heads(&scenario, start, &source, real, frames)?;
    let mut outcome = ReplayOutcome { doubts: session.doubts(), ..ReplayOutcome::default() };
    let samples = if scenario.bench.is_lockstep() { sample_table::read_all(directory)? } else { Default::default() };
    if samples.is_cut_off {
        outcome.doubt("samples.csv is cut off: the samples before are used".into());
    }
    let (has_several, count) = (heads.len() > 1, heads.len());
    for (number, head) in options.wanted(heads)? {
        let mut playback = HeadPlayback::new(&replayed, (number, head), sink(has_several.then_some(number))?)?;
        playback.take_samples(&samples.samples);
        doubts_of_machine(&session, &playback).into_iter().for_each(|doubt| outcome.doubt(doubt));
        for injected in &session.injected {
            let (came, event) = injected.event()?;
            playback.inject(came, event);
        }
        let mut rows = RowsOfHead::new(RowReader::open(&directory.join(FRAMES_FILE))?, number, count);
        while let Some(row) = rows.read()? {
            playback.row(&row)?;
        }
        if rows.is_cut_off() {
            outcome.doubt("frames.csv is cut off: the frames before are replayed".into());
        }
        outcome.add(playback)?;
    }
    Ok(outcome)
}

/// Draws the frames that a run file makes of a capture (candump log or pcapng) without frames to compare. The clock of
/// the run starts with the first packet; frames end with the run's duration or the last packet.
///
/// # Errors
/// When the capture cannot be read, the run's parts cannot be made, or drawing failed.
pub fn replay_bus(
    bus: &Path,
    scenario: &Scenario,
    options: &ReplayOptions,
    sink: SinkOfHead<'_>,
) -> Result<ReplayOutcome> {
    let source = Source { bus, takes_sent: true };
    let (start, frames) = (source.first_at()?, options.frames());
    let (replayed, heads) = Replayed::with_heads(scenario, start, &source, None, frames)?;
    let mut outcome = ReplayOutcome::default();
    let has_several = heads.len() > 1;
    for (number, head) in options.wanted(heads)? {
        let mut playback = HeadPlayback::new(&replayed, (number, head), sink(has_several.then_some(number))?)?;
        for number in 0..playback.frame_count() {
            if !playback.draw_at_release(number)? {
                break;
            }
        }
        outcome.add(playback)?;
    }
    Ok(outcome)
}

/// Returns doubts about the machine: bits repeat on the same version and vector level only.
fn doubts_of_machine(session: &Session, playback: &HeadPlayback) -> Vec<String> {
    let mut doubts = Vec::new();
    let here = env!("CARGO_PKG_VERSION");
    if session.starloop_version != here {
        doubts.push(format!("captured by starloop {}, this is {here}: images may differ", session.starloop_version));
    }
    let level = |adapter: &str| adapter.split_once("vector level ").map(|(_, level)| level.to_owned());
    let adapter = playback.imager().description();
    let (was, is) = (level(&session.adapter), level(&adapter));
    if was != is {
        let name = |level: Option<String>| level.unwrap_or_else(|| "none".into());
        doubts.push(format!("captured at vector level {}, here it is {}: last bits may differ", name(was), name(is)));
    } else if was.is_none() && session.adapter != adapter {
        doubts.push(format!("captured on {}: images may differ by 1 DN here", session.adapter));
    }
    doubts
}
