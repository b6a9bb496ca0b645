//! Values of an instance: inputs and parameters, which the importer sets, as a sample of the plant; and outputs, head by head,
//! of frames and of star trackers.

use crate::error::FmuError;
use crate::variables::reference;
use base::axes::{Rotation, WRITTEN_NORM_TOLERANCE};
use base::{refused::Refused, time::Tai, units::METRE_KM};
use frames::sink::{SentFrame, TruthKind};
use glam::DVec3;
use run::runtime::{PlantAttitude, PlantSample, TrackerOutput};
use sky::observer::BarycentricState;
use testbed::tracker::Outcome;

/// Inputs and parameters.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Inputs {
    pub(crate) output_dir: String,
    pub(crate) q: [f64; 4],
    pub(crate) rate: [f64; 3],
    pub(crate) acceleration: [f64; 3],
    pub(crate) jitter: [f64; 3],
    pub(crate) position: [f64; 3],
    pub(crate) velocity: [f64; 3],
    pub(crate) has_observer: bool,
    pub(crate) trigger: u16,
    pub(crate) trigger_count: u32,
}

impl Default for Inputs {
    fn default() -> Self {
        Self {
            output_dir: "starloop_fmu".into(),
            q: [1.0, 0.0, 0.0, 0.0],
            rate: [0.0; 3],
            acceleration: [0.0; 3],
            jitter: [0.0; 3],
            position: [0.0; 3],
            velocity: [0.0; 3],
            has_observer: false,
            trigger: 0,
            trigger_count: 0,
        }
    }
}

impl Inputs {
    /// Returns the sample of an instant; without `has_jitter` no jitter is given.
    pub(crate) fn sample(&self, at: Tai, has_jitter: bool) -> Result<PlantSample, FmuError> {
        Ok(PlantSample {
            at,
            attitude: Some(self.attitude()?),
            jitter_rad: has_jitter.then(|| DVec3::from_array(self.jitter)),
            observer: self.has_observer.then(|| self.observer()),
        })
    }

    fn attitude(&self) -> Result<PlantAttitude, FmuError> {
        let Inputs { q, rate, acceleration, .. } = self;
        let body_from_icrf = Rotation::from_wxyz(*q, WRITTEN_NORM_TOLERANCE).ok_or_else(|| {
            FmuError::from(Refused(format!(
                "variable q_body_from_icrf: wanted a unit quaternion w x y z (norm within 0.001 of 1), got {q:?}"
            )))
        })?;
        let (rate_rad_s, acceleration_rad_s2) = (DVec3::from_array(*rate), DVec3::from_array(*acceleration));
        Ok(PlantAttitude { body_from_icrf, rate_rad_s, acceleration_rad_s2 })
    }

    fn observer(&self) -> BarycentricState {
        BarycentricState {
            position_km: DVec3::from_array(self.position) * METRE_KM,
            velocity_km_s: DVec3::from_array(self.velocity) * METRE_KM,
        }
    }
}

/// A variable's value.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Value<'a> {
    Reals(&'a [f64]),
    Whole(i64),
    Boolean(bool),
    Text(&'a str),
}

/// Where the value of an input or parameter goes.
#[derive(Debug)]
pub(crate) enum Place<'a> {
    Reals(&'a mut [f64]),
    Short(&'a mut u16),
    Long(&'a mut u32),
    Boolean(&'a mut bool),
    Text(&'a mut String),
}

/// Returns a count as a whole number of a variable.
pub(crate) fn whole(count: impl TryInto<i64>) -> i64 {
    count.try_into().unwrap_or(i64::MAX)
}

/// Outputs of one head.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct HeadOutputs {
    frames: i64,
    mid_exposure_s: [f64; 1],
    truth: [f64; 4],
    true_jitter: [f64; 3],
    stars: i64,
    tracker_q: [f64; 4],
    tracker_valid: bool,
    tracker_stars: i64,
    tracker_time_s: [f64; 1],
}

impl HeadOutputs {
    /// Returns the value of a variable of a head; `None` for a reference that belongs to none.
    pub(crate) fn value(&self, within: u32) -> Option<Value<'_>> {
        Some(match within {
            reference::FRAMES => Value::Whole(self.frames),
            reference::MID_EXPOSURE => Value::Reals(&self.mid_exposure_s),
            reference::TRUTH => Value::Reals(&self.truth),
            reference::TRUE_JITTER => Value::Reals(&self.true_jitter),
            reference::STARS => Value::Whole(self.stars),
            reference::TRACKER_Q => Value::Reals(&self.tracker_q),
            reference::TRACKER_VALID => Value::Boolean(self.tracker_valid),
            reference::TRACKER_STARS => Value::Whole(self.tracker_stars),
            reference::TRACKER_TIME => Value::Reals(&self.tracker_time_s),
            _no_such => return None,
        })
    }

    /// Takes in a frame that went out.
    pub(crate) fn take(&mut self, frame: &SentFrame, zero: Tai) {
        let meta = &frame.meta;
        self.frames += 1;
        self.mid_exposure_s = [(meta.mid_exposure - zero).s()];
        self.truth = meta.attitude_wxyz;
        self.true_jitter = meta.jitter_rad;
        self.stars = whole(frame.truth.iter().filter(|star| star.kind == TruthKind::Star).count());
    }

    /// Takes in what the head's tracker said last.
    pub(crate) fn take_tracker(&mut self, output: &TrackerOutput, zero: Tai) {
        self.tracker_time_s = [(output.mid_exposure - zero).s()];
        match output.outcome {
            Outcome::Solved(solution) => {
                self.tracker_valid = true;
                self.tracker_q = solution.sensor_from_icrf.wxyz();
                self.tracker_stars = whole(solution.stars);
            }
            Outcome::NoSolution(_) => (self.tracker_valid, self.tracker_stars) = (false, 0),
        }
    }
}
