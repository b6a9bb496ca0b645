//! Measured over predicted drawing time: how much slower the machine is than the costs say, frame by frame.
//!
//! In: predicted and measured time of a frame (drawing and detector). Out: a ratio, 1 without load, by which the
//! planner's time is divided, on the real clock only. It rises at once: after one slow frame the next one is planned
//! for a machine that slow. It falls exponentially, with a time constant of [`RECOVERY_FRAMES`], so that an
//! intermittent load does not make frames late each time it returns. *Limits.* Never below 1: a fast machine does not
//! reduce the margin; `starloop calibrate` does. Half a millisecond is added to both times, so that fixed costs of
//! small frames do not count as load. *Validation.* the tests below, and `tests/closed_loop/budget.rs`.
//!
//! The time in which a frame must be drawn ([`Pace`]): what the readout of its regions leaves on a machine that slow.

use crate::runtime::{imager::Imager, params::RunParams};
use base::{region::Regions, time::Span};
use plan::exposure::cost::CostModel;

/// Frames after which the rest of a past load has decayed to 1/e (37 %).
pub const RECOVERY_FRAMES: f64 = 10.0;
/// Highest ratio: one frame that took seconds must not degrade the following minutes.
pub const MOST: f64 = 10.0;
/// Added to both times, ms.
const SLACK_MS: f64 = 0.5;
/// Ratio above which the machine is called overloaded.
const OVERLOADED: f64 = 2.0;
/// Ratio below which an overload has ended.
const GONE: f64 = 1.5;

/// The ratio, and the last reported state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoadEstimate {
    /// Ratio of measured to predicted time, from 1 to [`MOST`].
    pub ratio: f64,
    is_overloaded: bool,
}

/// A change that is reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LoadChange {
    /// Drawing takes much longer than predicted.
    Overloaded,
    /// Drawing time is back to normal.
    Gone,
}

/// The time that frames of a head take, and the time that there is for them.
pub struct Pace {
    cost: CostModel,
    is_on_device: bool,
    may_degrade: bool,
    /// Load estimate, on the real clock only.
    load: Option<LoadEstimate>,
}

impl Pace {
    pub(super) fn new(params: &RunParams, imager: &Imager) -> Self {
        // The reference is the truth, however long it takes.
        let may_degrade = params.degrade && !imager.is_exact();
        let cost = params.cost.unwrap_or(imager.cost);
        Self { cost, is_on_device: imager.is_on_device(), may_degrade, load: None }
    }

    /// Makes the planner's time follow the measured load from here on: for runs on the real clock. Frames that may not
    /// be degraded are drawn as before.
    pub fn follow_load(&mut self) {
        self.load = self.may_degrade.then(LoadEstimate::default);
    }

    /// Overrides the measured load for the next frame (used by replay). No effect when load tracking is off.
    pub fn assume_load(&mut self, ratio: f64) {
        self.load = self.load.map(|_| LoadEstimate::with_ratio(ratio));
    }

    /// Returns the ratio of measured to predicted drawing time; 1 where load is not tracked.
    pub fn load(&self) -> f64 {
        self.load.map_or(1.0, |load| load.ratio)
    }

    /// Updates the load with the predicted time of a plan of these regions and the measured time; returns a change.
    pub(super) fn learn(
        &mut self,
        plan_ms: f64,
        drawn: Span,
        params: &RunParams,
        regions: &Regions,
    ) -> Option<LoadChange> {
        let predicted_ms = plan_ms + self.detector_ms(params, regions);
        self.load.as_mut()?.observe(predicted_ms, drawn.ms())
    }

    /// Returns the predicted time of the detector for a frame of these regions, ms; a GPU always reads out the whole
    /// image.
    fn detector_ms(&self, params: &RunParams, regions: &Regions) -> f64 {
        let share = if self.is_on_device { 1.0 } else { params.camera.readout_share(regions) };
        params.camera.predicted_readout_ms(&self.cost) * share
    }

    /// Returns the time in which a frame of these regions must be drawn under the load, ms.
    fn drawing_budget_ms(&self, params: &RunParams, regions: &Regions) -> f64 {
        let size_px = params.camera.output().size_px;
        let rows_share = regions.rows(size_px) as f64 / size_px[1].max(1) as f64;
        params.drawing_budget_of_ms([rows_share, self.detector_ms(params, regions)], self.load())
    }

    /// Returns half of the time that a frame of these regions leaves, if it takes as long as one that was planned to take
    /// `latest_ms`.
    pub(super) fn half_spare(&self, latest_ms: f64, params: &RunParams, regions: &Regions) -> Span {
        let load = self.load();
        let spare_ms = (self.drawing_budget_ms(params, regions) - latest_ms) * load;
        let frame_ms = (latest_ms + self.detector_ms(params, regions)) * load * f64::from(params.heads);
        let half_ms = 0.5 * spare_ms.min(params.frame_period.ms() - frame_ms).max(0.0);
        Span::from_s(half_ms * 1e-3)
    }

    /// Returns the planner's time for a frame of these regions, ms, which on the real clock may wait first; `None` for
    /// frames that may not be degraded.
    pub(super) fn planner_ms(&self, params: &RunParams, regions: &Regions, wait: impl Fn() -> Span) -> Option<f64> {
        let wait_ms = || if self.load.is_some() { wait().ms() / self.load() } else { 0.0 };
        self.may_degrade.then(|| self.drawing_budget_ms(params, regions) - wait_ms())
    }
}

/// Returns the ratio of measured to predicted time of one frame, from 1 to [`MOST`]; `None` unless both times are
/// finite numbers.
pub fn ratio_of(predicted_ms: f64, measured_ms: f64) -> Option<f64> {
    let seen = (measured_ms + SLACK_MS) / (predicted_ms + SLACK_MS);
    (seen.is_finite() && predicted_ms >= 0.0).then(|| seen.clamp(1.0, MOST))
}

impl Default for LoadEstimate {
    /// Returns an estimate without load.
    fn default() -> Self {
        Self { ratio: 1.0, is_overloaded: false }
    }
}

impl LoadEstimate {
    /// Returns an estimate with a recorded ratio.
    pub fn with_ratio(ratio: f64) -> Self {
        Self { ratio: ratio.clamp(1.0, MOST), ..Self::default() }
    }

    /// Updates the estimate with a frame's times, ms; returns a change of load. Times that are not finite are ignored.
    pub fn observe(&mut self, predicted_ms: f64, measured_ms: f64) -> Option<LoadChange> {
        let seen = ratio_of(predicted_ms, measured_ms)?;
        self.ratio =
            if seen >= self.ratio { seen } else { seen + (self.ratio - seen) * (-1.0 / RECOVERY_FRAMES).exp() };
        let was_overloaded = self.is_overloaded;
        self.is_overloaded = self.ratio > if was_overloaded { GONE } else { OVERLOADED };
        match (was_overloaded, self.is_overloaded) {
            (false, true) => Some(LoadChange::Overloaded),
            (true, false) => Some(LoadChange::Gone),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the ratios after each (predicted, measured).
    fn ratios(load: &mut LoadEstimate, frames: impl IntoIterator<Item = (f64, f64)>) -> Vec<f64> {
        let mut observe = |(predicted_ms, measured_ms)| {
            load.observe(predicted_ms, measured_ms);
            load.ratio
        };
        frames.into_iter().map(&mut observe).collect()
    }

    #[test]
    fn one_slow_frame_is_enough_and_the_load_is_forgotten_slowly() {
        let mut load = LoadEstimate::default();
        assert_eq!(ratios(&mut load, [(19.5, 19.5), (19.5, 12.0)]), [1.0, 1.0], "a fast frame does not count as load");
        assert_eq!(ratios(&mut load, [(19.5, 59.5)]), [3.0], "at once");
        let falling = ratios(&mut load, [(19.5, 19.5); 40]);
        assert!(falling.windows(2).all(|pair| pair[1] < pair[0]), "{falling:?}");
        // After one time constant 1/e of the excess is left, by definition.
        let left = (falling[9] - 1.0) / 2.0;
        assert!((left - (-1.0_f64).exp()).abs() < 1e-12, "{left}");
        assert!(falling[0] > 2.5 && falling[39] < 1.05, "{falling:?}");
    }

    #[test]
    fn a_steady_load_stays_and_a_smaller_one_is_reached_from_above() {
        let mut load = LoadEstimate::default();
        assert!(ratios(&mut load, [(9.5, 39.5); 5]).iter().all(|ratio| *ratio == 4.0));
        let towards = *ratios(&mut load, [(9.5, 19.5); 100]).last().unwrap();
        assert!((towards - 2.0).abs() < 1e-3, "{towards}");
    }

    #[test]
    fn changes_are_reported_once_and_not_for_every_flicker() {
        let mut load = LoadEstimate::default();
        let mut reported = Vec::new();
        let series = [1.0, 3.0, 1.0, 3.0, 1.0, 3.0].into_iter().chain([1.0; 60]).chain([3.0]);
        for (i, ratio) in series.enumerate() {
            reported.extend(load.observe(19.5, 20.0 * ratio - 0.5).map(|change| (i, change)));
        }
        assert_eq!(
            reported.iter().map(|(_, change)| *change).collect::<Vec<_>>(),
            [LoadChange::Overloaded, LoadChange::Gone, LoadChange::Overloaded]
        );
        assert_eq!((reported[0].0, reported[2].0), (1, 66), "at once");
    }

    #[test]
    fn small_frames_and_invalid_times_do_not_count_as_load() {
        let mut load = LoadEstimate::default();
        load.observe(0.0, 0.2);
        assert!(load.ratio < 1.5, "0.2 ms of fixed costs: {}", load.ratio);
        let before = load;
        for (predicted_ms, measured_ms) in [(f64::NAN, 1.0), (1.0, f64::NAN), (-0.5, 1.0), (1.0, f64::INFINITY)] {
            load.observe(predicted_ms, measured_ms);
        }
        assert_eq!(load, before);
        load.observe(0.1, 60_000.0);
        assert_eq!(load.ratio, MOST, "one extremely slow frame");
    }
}
