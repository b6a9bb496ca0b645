//! `[budget]`: how long each stage of a frame may take, and what real-time threads ask of the system.
//!
//! Times are 99 % quantiles in ms on the real clock; each key is optional. `total_ms` defaults to the camera's readout
//! time, `missed_frames` to 0; `starloop budget` adds a limit for drawing from the planner's time. What is measured:
//! see the stages of a run's summary.

use crate::key::{Given, section, taken};
use crate::key_type::{Any, Raw, Shape, Whole};
use crate::{check::Checker, error::Result};

/// Records kept: 400 s at 10 Hz, 2.5 MiB.
const DEFAULT_RING: i64 = 4096;
/// Highest processor number that is asked for.
const LAST_PROCESSOR: i64 = 1023;

/// Timing budget, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Budget {
    /// 99 % quantile of a stage by its name in summaries, ms, those that were given and the total.
    pub stage_p99_ms: Vec<(&'static str, f64)>,
    /// 99 % quantile from the epoch of an image's newest attitude to its delivery, ms.
    pub latency_p99_ms: Option<f64>,
    /// Slots that may be missed in a run.
    pub missed_frames: u32,
    /// Whether threads ask for real-time scheduling and locked memory.
    pub realtime: bool,
    /// Priority of the drawing threads; those of sink, frame and link have higher ones.
    pub priority: u8,
    /// Processors the threads stay on; empty: any.
    pub affinity: Vec<usize>,
    /// Frames whose times are kept one by one.
    pub ring_frames: u32,
}

section! {
    /// How long the stages of a frame may take on the real clock, and what its threads ask of the system.
    BudgetKeys at "budget" {
        /// From the slot's release to the frame thread's first step.
        wake_ms: f64 = Optional, Positive, QUANTILE;
        /// Taking messages in.
        receive_ms: f64 = Optional, Positive, QUANTILE;
        /// Age of the newest attitude when it arrives.
        bus_age_ms: f64 = Optional, Positive, QUANTILE;
        /// Time since the newest attitude arrived.
        arrival_age_ms: f64 = Optional, Positive, QUANTILE;
        /// Time correlation.
        correlation_ms: f64 = Optional, Positive, QUANTILE;
        /// From a trigger to the start of its exposure.
        trigger_ms: f64 = Optional, Positive, QUANTILE;
        /// The line-of-sight path.
        attitude_ms: f64 = Optional, Positive, QUANTILE;
        /// Stars, bodies and targets of the exposure.
        sky_ms: f64 = Optional, Positive, QUANTILE;
        /// Planning.
        plan_ms: f64 = Optional, Positive, QUANTILE;
        /// To the GPU.
        upload_ms: f64 = Optional, Positive, QUANTILE;
        /// Drawing.
        render_ms: f64 = Optional, Positive, QUANTILE;
        /// Detector and converter.
        detector_ms: f64 = Optional, Positive, QUANTILE;
        /// From the GPU.
        readback_ms: f64 = Optional, Positive, QUANTILE;
        /// To the sinks' thread.
        handover_ms: f64 = Optional, Positive, QUANTILE;
        /// Waiting for the sinks.
        queue_ms: f64 = Optional, Positive, QUANTILE;
        /// The slowest sink.
        sink_ms: f64 = Optional, Positive, QUANTILE;
        /// The whole frame, from its release to its delivery.
        total_ms: f64 = Computed("exposure.readout_s of the camera"), Positive, QUANTILE;
        /// From the epoch of an image's newest attitude to its delivery.
        latency_ms: f64 = Optional, Positive, QUANTILE;
        /// Slots that may be late, held, dropped or without attitude; 0 for a bench that must be in time.
        missed_frames: Whole = 0, 0..=i64::from(u32::MAX);
        /// Threads ask for real-time scheduling and locked memory.
        realtime: bool = true, Any;
        /// Priority of the drawing threads, 1 is lowest; the sink, frame and link threads get 1, 2 and 3 more.
        priority: Whole<u8> = 10, 1..=90;
        /// Processors that the threads stay on, as the system counts them; leave it out for any.
        affinity: Raw<Vec<i64>> = Optional, Shape::list(Shape::Whole(0..=LAST_PROCESSOR));
        /// Frames whose times are kept for frames_timing.csv and worst.svg; about 600 bytes each.
        ring_frames: Whole = DEFAULT_RING, 1..=1_000_000;
    }
}

const QUANTILE: &str = "milliseconds that 99 % of the frames may take; leave the key out where any time will do";

impl BudgetKeys {
    /// Returns limits of the stages, in the order of a frame.
    fn stages(&self) -> [Given<'_, f64>; 16] {
        [
            self.wake_ms(),
            self.receive_ms(),
            self.bus_age_ms(),
            self.arrival_age_ms(),
            self.correlation_ms(),
            self.trigger_ms(),
            self.attitude_ms(),
            self.sky_ms(),
            self.plan_ms(),
            self.upload_ms(),
            self.render_ms(),
            self.detector_ms(),
            self.readback_ms(),
            self.handover_ms(),
            self.queue_ms(),
            self.sink_ms(),
        ]
    }
}

/// The total's name among the stages of a summary.
const TOTAL: &str = "release_to_delivered";

impl Budget {
    pub(super) fn check(keys: &BudgetKeys, readout_s: f64, check: &mut Checker<'_>) -> Result<Self> {
        let mut stage_p99_ms = Vec::new();
        for stage in keys.stages() {
            let name = stage.name.trim_end_matches("_ms");
            stage_p99_ms.extend(stage.optional(check)?.map(|ms| (name, ms)));
        }
        stage_p99_ms.push((TOTAL, keys.total_ms().or(readout_s * 1e3).check(check)?));
        let latency_p99_ms = keys.latency_ms().optional(check)?;
        taken!(check, keys => missed_frames, priority, realtime);
        let affinity = affinity(&keys.affinity(), check)?;
        let ring_frames = keys.ring_frames().check(check)?;
        Ok(Self { stage_p99_ms, latency_p99_ms, missed_frames, realtime, priority, affinity, ring_frames })
    }
}

fn affinity(given: &Given<'_, Raw<Vec<i64>>>, check: &Checker<'_>) -> Result<Vec<usize>> {
    let number = |processor: &i64| {
        let in_range = usize::try_from(*processor).ok().filter(|_| *processor <= LAST_PROCESSOR);
        in_range.ok_or_else(|| given.invalid(processor, format!("processor numbers from 0 to {LAST_PROCESSOR}"), check))
    };
    given.raw().map_or(&[][..], Vec::as_slice).iter().map(number).collect()
}

#[cfg(test)]
mod tests {
    use crate::{Bench, ConfigError, Document};
    use std::path::Path;

    fn bench(section: &str) -> Result<Bench, ConfigError> {
        let text = format!("[budget]\n{section}\n");
        Bench::from_document(&Document::from_text(&text, Path::new("lab/bench.toml")))
    }

    #[test]
    fn without_keys_the_whole_frame_has_the_readout_time_and_none_may_be_missed() {
        let bench = bench("").expect("all optional");
        let readout_ms = bench.camera.exposure.readout_s * 1e3;
        assert_eq!(bench.budget.stage_p99_ms, [("release_to_delivered", readout_ms)]);
        assert_eq!((bench.budget.latency_p99_ms, bench.budget.missed_frames), (None, 0));
        assert_eq!((bench.budget.realtime, bench.budget.ring_frames), (true, 4096));
        for key in ["budget.total_ms", "budget.missed_frames", "budget.realtime", "budget.priority"] {
            assert!(bench.defaulted.iter().any(|default| default.key == key), "{key} is listed");
        }
    }

    #[test]
    fn given_values_are_kept() {
        let text = "render_ms = 12.5\nbus_age_ms = 30\ntotal_ms = 70\nlatency_ms = 200\nmissed_frames = 2\n\
                    realtime = false\npriority = 40\naffinity = [0, 2]\nring_frames = 10";
        let budget = bench(text).expect("sound").budget;
        assert_eq!(
            budget.stage_p99_ms,
            [("bus_age", 30.0), ("render", 12.5), ("release_to_delivered", 70.0)],
            "in the order of the stages"
        );
        assert_eq!((budget.latency_p99_ms, budget.missed_frames, budget.realtime), (Some(200.0), 2, false));
        assert_eq!((budget.priority, budget.affinity, budget.ring_frames), (40, vec![0, 2], 10));
    }

    #[test]
    fn wrong_values_are_refused_by_name() {
        for (text, key, says) in [
            ("render_ms = 0", "budget.render_ms", "above 0"),
            ("sink_ms = -1.0", "budget.sink_ms", "is -1"),
            ("total_ms = nan", "budget.total_ms", "NaN"),
            ("total_ms = 0.0", "budget.total_ms is 0", "wanted a number above 0"),
            ("latency_ms = inf", "budget.latency_ms", "inf"),
            ("missed_frames = -1", "budget.missed_frames", "is -1"),
            ("priority = 99", "budget.priority is 99", "from 1 to 90"),
            ("ring_frames = 0", "budget.ring_frames", "from 1"),
            ("affinity = [0, -3]", "budget.affinity", "is -3"),
            ("affinity = [4096]", "budget.affinity", "0 to 1023"),
            ("rendr_ms = 3", "rendr_ms", "render_ms"),
        ] {
            let error = bench(text).expect_err(text).to_string();
            assert!(error.contains("lab/bench.toml:2"), "{text}: names the line: {error}");
            assert!(error.contains(key) && error.contains(says), "{text}: {error}");
        }
    }
}
