//! The result of one sink among several: a line of the run summary.
//!
//! Every frame that was given to the sinks is counted in each line once: taken, refused or dropped.

use base::time::Span;
use serde::{Serialize, Serializer};
use std::collections::BTreeMap;

/// One sink of a run that is over.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct SinkLine {
    /// Place in the bench that names it: `sink`, `extra_sink[0]`, ...
    pub place: String,
    /// The sink's name.
    #[serde(rename = "sink")]
    pub kind: &'static str,
    /// Frames it took.
    pub frames: u64,
    /// Frames it got no chance to take: it was too slow, or its thread was lost.
    pub dropped: u64,
    /// Frames it failed on.
    pub refused: u64,
    /// Bytes it brought out.
    pub bytes: u64,
    /// CRC-32 over the frames it took; `None` when it could not finish.
    #[serde(serialize_with = "hexadecimal")]
    pub run_crc32: Option<u32>,
    /// Folder, file or address of the frames.
    pub output: Option<String>,
    /// Its first failure in words; of a frame, or of its end.
    pub first_error: Option<String>,
    /// True when it broke down (a panic) or was given up because it blocked, and took nothing from then on.
    pub is_lost: bool,
    /// Handed to the sinks to taken by this one, wall time, mean; zero when nothing waits between the two.
    #[serde(rename = "mean_delay_ms", serialize_with = "in_ms")]
    pub mean_delay: Span,
    /// The longest of these.
    #[serde(rename = "longest_delay_ms", serialize_with = "in_ms")]
    pub longest_delay: Span,
    /// Numbers of its own; reports leave out those that are 0.
    #[serde(serialize_with = "above_zero")]
    pub counts: Vec<(&'static str, u64)>,
}

impl SinkLine {
    /// Returns true if a frame was refused, or the sink failed in another way: a drop alone does not count.
    pub fn has_failed(&self) -> bool {
        self.first_error.is_some() || self.is_lost || self.refused > 0
    }

    /// Returns its own numbers above 0 by name.
    pub fn named_counts(&self) -> BTreeMap<String, u64> {
        let counts = self.counts.iter().filter(|(_, count)| *count > 0);
        counts.map(|(name, count)| ((*name).to_owned(), *count)).collect()
    }
}

fn hexadecimal<S: Serializer>(crc32: &Option<u32>, to: S) -> Result<S::Ok, S::Error> {
    crc32.map(|crc32| format!("{crc32:08x}")).serialize(to)
}

fn in_ms<S: Serializer>(span: &Span, to: S) -> Result<S::Ok, S::Error> {
    span.ms().serialize(to)
}

fn above_zero<S: Serializer>(counts: &[(&'static str, u64)], to: S) -> Result<S::Ok, S::Error> {
    to.collect_map(counts.iter().filter(|(_, count)| *count > 0).copied().collect::<BTreeMap<_, _>>())
}
