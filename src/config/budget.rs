//! `[budget]`: how long each stage of a frame may take, and what real-time threads ask of the system.
//!
//! Times are 99 % quantiles in ms on the real clock; each key is optional. `total_ms` defaults to the camera's readout time,
//! `missed_frames` to 0; `starloop budget` adds a limit for drawing from the planner's time. What is measured: see the
//! stages of a run's summary.

use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use serde::Deserialize;

/// Records kept: 400 s at 10 Hz, 2.5 MiB.
const DEFAULT_RING: u32 = 4096;
/// Low: the kernel's own threads come first.
const DEFAULT_PRIORITY: u32 = 10;
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
    /// Priority of the drawing threads; those of sink, frame and link stand above it.
    pub priority: u8,
    /// Processors the threads stay on; empty: any.
    pub affinity: Vec<usize>,
    /// Frames whose times are kept one by one.
    pub ring_frames: u32,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BudgetKeys {
    wake_ms: Option<f64>,
    receive_ms: Option<f64>,
    bus_age_ms: Option<f64>,
    arrival_age_ms: Option<f64>,
    correlation_ms: Option<f64>,
    attitude_ms: Option<f64>,
    sky_ms: Option<f64>,
    plan_ms: Option<f64>,
    upload_ms: Option<f64>,
    render_ms: Option<f64>,
    detector_ms: Option<f64>,
    readback_ms: Option<f64>,
    handover_ms: Option<f64>,
    queue_ms: Option<f64>,
    sink_ms: Option<f64>,
    total_ms: Option<f64>,
    latency_ms: Option<f64>,
    missed_frames: Option<i64>,
    realtime: Option<bool>,
    priority: Option<i64>,
    affinity: Option<Vec<i64>>,
    ring_frames: Option<i64>,
}

impl BudgetKeys {
    /// Stages by their names, and what was given for them.
    fn stages(&self) -> [(&'static str, Option<f64>); 15] {
        [
            ("wake", self.wake_ms),
            ("receive", self.receive_ms),
            ("bus_age", self.bus_age_ms),
            ("arrival_age", self.arrival_age_ms),
            ("correlation", self.correlation_ms),
            ("attitude", self.attitude_ms),
            ("sky", self.sky_ms),
            ("plan", self.plan_ms),
            ("upload", self.upload_ms),
            ("render", self.render_ms),
            ("detector", self.detector_ms),
            ("readback", self.readback_ms),
            ("handover", self.handover_ms),
            ("queue", self.queue_ms),
            ("sink", self.sink_ms),
        ]
    }
}

/// The total's name among the stages of a summary.
const TOTAL: &str = "release_to_delivered";

impl Budget {
    pub(super) fn check(keys: &BudgetKeys, readout_s: f64, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        const ADVICE: &str = "milliseconds that 99 % of the frames may take; leave the key out where any time will do";
        let rule = Rule::Positive;
        let mut stage_p99_ms = Vec::new();
        for (name, given) in keys.stages() {
            if let Some(ms) = given {
                stage_p99_ms.push((name, check.meets(&format!("budget.{name}_ms"), ms, rule, ADVICE)?));
            }
        }
        let total_ms = match keys.total_ms {
            Some(ms) => check.meets("budget.total_ms", ms, rule, ADVICE)?,
            None => check.given_or("budget.total_ms", None, readout_s * 1e3),
        };
        stage_p99_ms.push((TOTAL, total_ms));
        let latency_p99_ms =
            keys.latency_ms.map(|ms| check.meets("budget.latency_ms", ms, rule, ADVICE)).transpose()?;
        let missed = "slots that may be late, held, dropped or without attitude; 0 for a bench that must be in time";
        let missed_frames = check.whole("budget.missed_frames", keys.missed_frames, Some(0), 0..=u32::MAX, missed)?;
        let low = "1 is lowest; the sink, frame and link threads get 1, 2 and 3 more, the kernel's own threads have 99";
        let priority = check.whole("budget.priority", keys.priority, Some(DEFAULT_PRIORITY), 1..=90, low)?;
        let ring = "frames whose times are kept for frames_timing.csv and worst.svg; about 600 bytes each";
        Ok(Self {
            stage_p99_ms,
            latency_p99_ms,
            missed_frames,
            realtime: check.given_or("budget.realtime", keys.realtime, true),
            priority: u8::try_from(priority).unwrap_or(u8::MAX),
            affinity: affinity(keys.affinity.as_deref(), check)?,
            ring_frames: check.whole(
                "budget.ring_frames",
                keys.ring_frames,
                Some(DEFAULT_RING),
                1..=1_000_000,
                ring,
            )?,
        })
    }
}

fn affinity(given: Option<&[i64]>, check: &Checker<'_>) -> Result<Vec<usize>, ConfigError> {
    let number = |processor: &i64| {
        let in_range = usize::try_from(*processor).ok().filter(|_| *processor <= LAST_PROCESSOR);
        in_range.ok_or_else(|| {
            let wanted = format!("processor numbers from 0 to {LAST_PROCESSOR}");
            check.invalid("budget.affinity", processor, wanted, "as the system counts them; leave it out for any")
        })
    };
    given.unwrap_or_default().iter().map(number).collect()
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
            assert!(bench.defaulted.iter().any(|default| default.key == key), "{key} is told");
        }
    }

    #[test]
    fn what_is_given_is_kept() {
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
    fn what_is_wrong_is_refused_by_name() {
        for (text, key, says) in [
            ("render_ms = 0", "budget.render_ms", "above 0"),
            ("sink_ms = -1.0", "budget.sink_ms", "is -1"),
            ("total_ms = nan", "budget.total_ms", "NaN"),
            ("latency_ms = inf", "budget.latency_ms", "inf"),
            ("missed_frames = -1", "budget.missed_frames", "is -1"),
            ("priority = 99", "budget.priority", "from 1 to 90"),
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
