//! The records of the last frames; counts of all of them.
//!
//! In: one record per slot and camera head, in order of their numbers, completed later by what the sink thread
//! measured. Counts and latencies survive when records are overwritten. All memory is taken at the start.

use crate::report::frame_record::{Fate, FrameRecord, MissCause};
use crate::report::histogram::{Quantiles, StageHistogram};
use serde::Serialize;
use std::collections::BTreeMap;

/// Times from the attitude on the bus to the frame that shows it.
#[derive(Debug, Clone, Default)]
struct LatencyHistograms {
    epoch_to_submitted: StageHistogram,
    submitted_to_delivered: StageHistogram,
    epoch_to_delivered: StageHistogram,
    mid_exposure_to_delivered: StageHistogram,
}

/// Latency of delivered frames. Commanded, submitted and delivered are kept apart.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Latency {
    /// Epoch of the newest attitude in the image to its being handed to the sink.
    pub epoch_to_submitted: Quantiles,
    /// Handed to the sink to sent.
    pub submitted_to_delivered: Quantiles,
    /// Epoch of the newest attitude in the image to sent: end to end.
    pub epoch_to_delivered: Quantiles,
    /// Middle of the exposure to sent.
    pub mid_exposure_to_delivered: Quantiles,
}

impl Latency {
    /// Returns the quantiles with their names, in order.
    pub fn named(&self) -> [(&'static str, &Quantiles); 4] {
        [
            ("epoch_to_submitted", &self.epoch_to_submitted),
            ("submitted_to_delivered", &self.submitted_to_delivered),
            ("epoch_to_delivered", &self.epoch_to_delivered),
            ("mid_exposure_to_delivered", &self.mid_exposure_to_delivered),
        ]
    }
}

/// The last frames.
#[derive(Debug, Clone, Default)]
pub struct FrameRing {
    records: Vec<FrameRecord>,
    capacity: usize,
    heads: usize,
    total: u64,
    fates: [u64; Fate::ALL.len()],
    causes: [u64; MissCause::COUNT],
    latency: LatencyHistograms,
}

impl FrameRing {
    /// Returns a ring for the last `frames` frames of each of `heads`; it keeps counts alone when `frames` is 0.
    pub fn with_capacity(frames: usize, heads: usize) -> Self {
        let capacity = frames * heads;
        Self { records: Vec::with_capacity(capacity), capacity, heads, ..Self::default() }
    }

    /// Counts a slot and keeps its record. Slot numbers must rise by one.
    pub fn push(&mut self, record: FrameRecord) {
        self.total += 1;
        self.fates[record.fate as usize] += 1;
        if let Some(cause) = record.cause {
            self.causes[cause.index()] += 1;
        }
        if self.records.len() < self.capacity {
            self.records.push(record);
        } else if let Some(place) = self.place(&record) {
            self.records[place] = record;
        }
    }

    /// Counts the latency of a delivered frame and replaces its record if the ring still has it.
    pub fn complete(&mut self, record: FrameRecord) {
        self.count_latency(&record);
        let place = self.place(&record);
        if let Some(kept) = place.and_then(|place| self.records.get_mut(place))
            && (kept.number, kept.head) == (record.number, record.head)
        {
            *kept = record;
        }
    }

    fn place(&self, record: &FrameRecord) -> Option<usize> {
        (usize::try_from(record.number).ok()? * self.heads + record.head).checked_rem(self.capacity)
    }

    fn count_latency(&mut self, record: &FrameRecord) {
        let (Some(submitted), Some(delivered)) = (record.submitted, record.delivered) else { return };
        self.latency.submitted_to_delivered.record(delivered - submitted);
        // Frames for a display are delivered before their exposure: they have no latency to count.
        if delivered >= record.mid_exposure {
            self.latency.mid_exposure_to_delivered.record(delivered - record.mid_exposure);
        }
        if let Some(epoch) = record.commanded {
            self.latency.epoch_to_submitted.record(submitted - epoch);
            self.latency.epoch_to_delivered.record(delivered - epoch);
        }
    }

    /// Slots so far.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// Slots with this fate.
    pub fn count(&self, fate: Fate) -> u64 {
        self.fates[fate as usize]
    }

    /// Slots missed.
    pub fn missed(&self) -> u64 {
        self.causes.iter().sum()
    }

    /// Slots missed by cause, those that occurred.
    pub fn misses(&self) -> BTreeMap<String, u64> {
        let counts = MissCause::all().zip(self.causes).filter(|(_, count)| *count > 0);
        counts.map(|(cause, count)| (cause.name().to_owned(), count)).collect()
    }

    /// Returns the latency of the frames delivered so far.
    pub fn latency(&self) -> Latency {
        let of = &self.latency;
        Latency {
            epoch_to_submitted: of.epoch_to_submitted.quantiles(),
            submitted_to_delivered: of.submitted_to_delivered.quantiles(),
            epoch_to_delivered: of.epoch_to_delivered.quantiles(),
            mid_exposure_to_delivered: of.mid_exposure_to_delivered.quantiles(),
        }
    }

    /// Returns the records kept, earliest first.
    pub fn last(&self) -> impl Iterator<Item = &FrameRecord> {
        let oldest =
            (0..self.records.len()).min_by_key(|i| (self.records[*i].number, self.records[*i].head)).unwrap_or(0);
        let (newer, older) = self.records.split_at(oldest);
        older.iter().chain(newer)
    }

    /// Returns the `count` records with the greatest lateness, worst first.
    pub fn worst(&self, count: usize) -> Vec<FrameRecord> {
        let mut records: Vec<FrameRecord> = self.last().copied().collect();
        records.sort_by_key(|record| core::cmp::Reverse((record.is_missed(), record.lateness)));
        records.truncate(count);
        records
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::frame_record::sample_record;
    use base::time::{Span, Tai};

    #[test]
    fn counts_survive_and_the_last_stay_in_order() {
        let mut ring = FrameRing::with_capacity(8, 1);
        for number in 0..21 {
            let missed = number % 4 == 1;
            let cause = missed.then_some(MissCause::SinkBusy);
            let fate = if missed { Fate::Dropped } else { Fate::Sent };
            ring.push(FrameRecord { fate, cause, ..sample_record(number) });
        }
        assert_eq!((ring.total(), ring.count(Fate::Sent), ring.count(Fate::Dropped)), (21, 16, 5));
        assert_eq!((ring.missed(), ring.misses()["sink busy"]), (5, 5));
        let numbers: Vec<u32> = ring.last().map(|record| record.number).collect();
        assert_eq!(numbers, (13..21).collect::<Vec<_>>());
    }

    #[test]
    fn a_frame_completed_after_it_was_overwritten_still_counts() {
        let mut ring = FrameRing::with_capacity(2, 1);
        (0..3).for_each(|number| ring.push(FrameRecord { delivered: None, ..sample_record(number) }));
        assert_eq!(ring.latency().epoch_to_delivered.count, 0, "nothing is delivered yet");
        (0..3).for_each(|number| ring.complete(sample_record(number)));
        assert_eq!(ring.latency().epoch_to_delivered.count, 3);
        assert!(ring.last().all(|record| record.delivered.is_some()) && ring.last().count() == 2);
        assert_eq!(ring.total(), 3, "completing adds no slot");
    }

    #[test]
    fn heads_have_places_of_their_own() {
        let mut ring = FrameRing::with_capacity(2, 3);
        let of = |number, head| FrameRecord { head, ..sample_record(number) };
        for number in 0..5 {
            (0..3).for_each(|head| ring.push(FrameRecord { delivered: None, ..of(number, head) }));
        }
        ring.complete(of(3, 1));
        let kept =
            |ring: &FrameRing| ring.last().map(|r| (r.number, r.head, r.delivered.is_some())).collect::<Vec<_>>();
        let wanted = [(3, 0, false), (3, 1, true), (3, 2, false), (4, 0, false), (4, 1, false), (4, 2, false)];
        assert_eq!(kept(&ring), wanted);
        ring.complete(of(2, 1));
        assert_eq!(kept(&ring), wanted, "its place is another frame's by now");
    }

    #[test]
    fn latencies_are_kept_apart() {
        let mut ring = FrameRing::with_capacity(0, 1);
        let at = |ms| Some(Tai::from_ns(0) + Span::from_ms(ms));
        let mid_exposure = Tai::from_ns(0) + Span::from_ms(50);
        let record =
            FrameRecord { commanded: at(40), submitted: at(130), delivered: at(150), mid_exposure, ..sample_record(0) };
        ring.push(record);
        ring.complete(record);
        ring.complete(FrameRecord { commanded: None, ..record });
        ring.complete(FrameRecord { mid_exposure: Tai::from_ns(0) + Span::from_ms(200), commanded: None, ..record });
        let latency = ring.latency();
        let found = latency.named().map(|(_, q)| (q.max_ms, q.count));
        assert_eq!(found, [(90.0, 1), (20.0, 3), (110.0, 1), (100.0, 2)]);
        assert_eq!(ring.last().count(), 0, "counts alone");
    }

    #[test]
    fn the_worst_are_the_missed_and_the_latest() {
        let mut ring = FrameRing::with_capacity(8, 1);
        for (number, ms) in (0..).zip([-5, 3, -20, 9]) {
            ring.push(FrameRecord { lateness: Span::from_ms(ms), ..sample_record(number) });
        }
        let cause = Some(MissCause::SinkBusy);
        ring.push(FrameRecord { lateness: Span::from_ms(-90), cause, ..sample_record(4) });
        let numbers: Vec<u32> = ring.worst(3).iter().map(|record| record.number).collect();
        assert_eq!(numbers, [4, 3, 1]);
    }
}
