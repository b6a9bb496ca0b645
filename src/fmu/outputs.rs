//! Outputs of an instance, head by head: what of frames and of star trackers the importer reads.

use base::time::Tai;
use frames::sink::{SentFrame, TruthKind};
use run::runtime::TrackerOutput;
use testbed::tracker::Outcome;

/// Outputs of one head.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct HeadOutputs {
    pub(crate) frames: u64,
    pub(crate) mid_exposure_s: [f64; 1],
    pub(crate) truth: [f64; 4],
    pub(crate) stars: i32,
    pub(crate) tracker_q: [f64; 4],
    pub(crate) tracker_valid: bool,
    pub(crate) tracker_stars: i32,
    pub(crate) tracker_time_s: [f64; 1],
}

impl HeadOutputs {
    /// Takes in a frame that went out.
    pub(crate) fn take(&mut self, frame: &SentFrame, zero: Tai) {
        let meta = &frame.meta;
        self.frames += 1;
        self.mid_exposure_s = [(meta.mid_exposure - zero).s()];
        self.truth = meta.attitude_wxyz;
        self.stars =
            i32::try_from(frame.truth.iter().filter(|star| star.kind == TruthKind::Star).count()).unwrap_or(i32::MAX);
    }

    /// Takes in what the head's tracker said last.
    pub(crate) fn take_tracker(&mut self, output: &TrackerOutput, zero: Tai) {
        self.tracker_time_s = [(output.mid_exposure - zero).s()];
        match output.outcome {
            Outcome::Solved(solution) => {
                self.tracker_valid = true;
                self.tracker_q = solution.sensor_from_icrf.wxyz();
                self.tracker_stars = i32::try_from(solution.stars).unwrap_or(i32::MAX);
            }
            Outcome::NoSolution(_) => (self.tracker_valid, self.tracker_stars) = (false, 0),
        }
    }
}
