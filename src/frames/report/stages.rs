//! Where the time of one frame goes: named stages, in the order a frame meets them.

use crate::report::histogram::{Quantiles, StageHistogram};
use crate::report::time_tally::TimeTally;
use base::time::Span;

base::words! {
    /// A stage of one frame.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
    pub enum Stage {
        /// Waiting for the frame's slot.
        Wait = "wait",
        /// Release of the slot to the moment the frame thread ran: the system's delay, or the frames before.
        Wake = "wake",
        /// Reading the messages of the bus, and waiting for jitter samples that are under way.
        Receive = "receive",
        /// No work: epoch of the newest attitude to the release.
        BusAge = "bus_age",
        /// No work: arrival of the newest attitude to the release.
        ArrivalAge = "arrival_age",
        /// No work: how unsteady the time correlation is (largest less smallest delay in its window).
        Correlation = "correlation",
        /// No work: trigger to the start of its exposure.
        Trigger = "trigger",
        /// Attitude history to line-of-sight path.
        Attitude = "attitude",
        /// Catalog and ephemerides to sources in view.
        Sky = "sky",
        /// Sources and path to an exposure plan.
        Plan = "plan",
        /// Plan to a device: buffers written, work recorded and submitted. Absent where memory is shared.
        Upload = "upload",
        /// Plan to electrons. On a device: waiting for drawing and detector together, which it does in one go.
        Render = "render",
        /// Electrons to DN. Absent on a device (see `render`).
        Detector = "detector",
        /// DN from the device to memory. Absent where memory is shared.
        Readback = "readback",
        /// Finished image to the sink's queue: the action of the policy, and the copy that may be sent again.
        Handover = "handover",
        /// Waiting for the sink thread.
        Queue = "queue",
        /// Sending.
        Sink = "sink",
        /// Release of the frame's slot to delivery: everything but the wait.
        ReleaseToDelivered = "release_to_delivered",
    }
}

impl Stage {
    /// Number of stages.
    pub const COUNT: usize = Self::ALL.len();

    /// The stages a frame goes through one after another, from its release to its delivery.
    pub const OF_A_FRAME: [Self; 12] = [
        Self::Wake,
        Self::Receive,
        Self::Attitude,
        Self::Sky,
        Self::Plan,
        Self::Upload,
        Self::Render,
        Self::Detector,
        Self::Readback,
        Self::Handover,
        Self::Queue,
        Self::Sink,
    ];

    /// Returns the stage of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|stage| stage.name() == name)
    }
}

/// Times of one frame, by stage; plain data, no allocation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StageTimes {
    spans: [Option<Span>; Stage::COUNT],
}

impl StageTimes {
    /// Sets the time of a stage.
    pub fn set(&mut self, stage: Stage, time: Span) {
        self.spans[stage as usize] = Some(time);
    }

    /// Takes over every stage that `other` has.
    pub fn merge(&mut self, other: &Self) {
        for (span, newer) in self.spans.iter_mut().zip(other.spans) {
            *span = newer.or(*span);
        }
    }

    /// Returns the time of a stage; `None` when the frame did not go through it.
    pub fn get(&self, stage: Stage) -> Option<Span> {
        self.spans[stage as usize]
    }
}

/// Times of every stage over a run.
#[derive(Debug, Clone)]
pub struct StageHistograms {
    histograms: [StageHistogram; Stage::COUNT],
}

impl Default for StageHistograms {
    fn default() -> Self {
        Self { histograms: core::array::from_fn(|_| StageHistogram::default()) }
    }
}

impl StageHistograms {
    /// Records one frame; stages it did not go through are left out. Takes no memory.
    pub fn record(&mut self, times: &StageTimes) {
        for (histogram, span) in self.histograms.iter_mut().zip(times.spans) {
            if let Some(span) = span {
                histogram.record(span);
            }
        }
    }

    /// Records the time of one stage alone (one that another thread measures).
    pub fn record_stage(&mut self, stage: Stage, time: Span) {
        self.histograms[stage as usize].record(time);
    }

    /// Returns the summary of one stage so far.
    pub fn of(&self, stage: Stage) -> Quantiles {
        self.histograms[stage as usize].quantiles()
    }

    /// Returns every stage so far in few bins, in the order of [`Stage::ALL`]: a copy, without allocation.
    pub fn tallies(&self) -> [TimeTally; Stage::COUNT] {
        core::array::from_fn(|i| *self.histograms[i].tally())
    }

    /// Returns the median of one stage so far, ms.
    pub fn median_ms(&self, stage: Stage) -> f64 {
        self.histograms[stage as usize].median_ms()
    }

    /// Returns the summary of every stage so far, in the order of [`Stage::ALL`].
    pub fn quantiles(&self) -> [Quantiles; Stage::COUNT] {
        Stage::ALL.map(|stage| self.of(stage))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_are_in_order_with_names_of_their_own() {
        for (i, stage) in Stage::ALL.into_iter().enumerate() {
            assert_eq!(stage as usize, i, "{}", stage.name());
            assert!(Stage::ALL.iter().filter(|other| other.name() == stage.name()).count() == 1, "{}", stage.name());
        }
    }

    #[test]
    fn a_stage_is_recorded_under_its_own_name_and_only_when_it_ran() {
        let mut histograms = StageHistograms::default();
        let mut times = StageTimes::default();
        times.set(Stage::Render, Span::from_ms(7));
        histograms.record(&times);
        times.set(Stage::Sink, Span::from_ms(2));
        histograms.record(&times);
        assert_eq!(histograms.of(Stage::Render).count, 2);
        assert_eq!(histograms.of(Stage::Render).max_ms, 7.0);
        assert_eq!(histograms.of(Stage::Sink).count, 1);
        assert_eq!(histograms.of(Stage::Detector).count, 0, "never ran");
        assert_eq!(times.get(Stage::Detector), None);
    }
}
