//! Where a tracker's attitudes come from: the built-in tracker on pixels, or one of given errors on the truth.

use crate::runtime::tracker_out::tap::Seen;
use base::axes::{Icrf, Rotation, Sensor};
use base::time::Span;
use glam::{DQuat, DVec3};
use telemetry::{Mode, Report};
use testbed::tracker::{Exposed, Outcome, Tracker};
use testbed::tracker_model::TrackerModel;

/// Longest time between two attitudes from which a rate is taken.
const LONGEST_RATE_GAP: Span = Span::from_ms(2000);

/// A tracker.
#[derive(Debug)]
#[allow(clippy::large_enum_variant, reason = "one for each [[tracker_out]]")]
pub enum TrackerEyes {
    /// On pixels.
    Pixels(Tracker),
    /// Of given errors.
    Model(TrackerModel),
}

/// A tracker that makes reports.
#[derive(Debug)]
pub(super) struct Source {
    eyes: TrackerEyes,
    tag_error: Span,
    last: Option<(base::time::Tai, Rotation<Sensor, Icrf>)>,
}

impl Source {
    pub(super) fn new(eyes: TrackerEyes, tag_error: Span) -> Self {
        Self { eyes, tag_error, last: None }
    }

    /// Forgets the attitude.
    pub(super) fn forget(&mut self) {
        self.last = None;
        match &mut self.eyes {
            TrackerEyes::Pixels(tracker) => tracker.forget(),
            TrackerEyes::Model(model) => model.forget(),
        }
    }

    /// Measures a frame.
    pub(super) fn report(&mut self, seen: &Seen) -> Report {
        let outcome = self.measure(seen);
        let time_tag = seen.mid_exposure + self.tag_error;
        let mut report = Report { time_tag, ..unknown(seen, Mode::Acquisition) };
        let Outcome::Solved(solution) = outcome else {
            self.last = None;
            return report;
        };
        let attitude = solution.sensor_from_icrf;
        let near = self.last.filter(|(at, _)| time_tag - *at <= LONGEST_RATE_GAP && time_tag > *at);
        report.rate_rad_s =
            near.map(|(at, last)| (last.rotation_vector_to(&attitude) / (time_tag - at).s()).to_array());
        self.last = Some((time_tag, attitude));
        let variance = solution.covariance_rad2;
        let diagonal = DVec3::new(variance.x_axis.x, variance.y_axis.y, variance.z_axis.z);
        Report {
            attitude_wxyz: Some(attitude.wxyz()),
            sigma_rad: diagonal.to_array().map(f64::sqrt),
            stars: u16::try_from(solution.stars).unwrap_or(u16::MAX),
            mode: Mode::Tracking,
            background_dn: solution.background_dn,
            ..report
        }
    }

    fn measure(&mut self, seen: &Seen) -> Outcome {
        match &mut self.eyes {
            TrackerEyes::Pixels(tracker) => {
                tracker.expose(&Exposed { exposure_s: seen.exposure_s, regions: seen.regions });
                tracker.measure(&seen.image, seen.mid_exposure + self.tag_error, seen.observer_beta, None)
            }
            TrackerEyes::Model(model) => match seen.truth_wxyz {
                Some([w, x, y, z]) => {
                    let truth = Rotation::from_quat(DQuat::from_xyzw(x, y, z, w));
                    model.measure(seen.number, seen.mid_exposure, &truth, seen.rate_rad_s)
                }
                None => {
                    model.forget();
                    Outcome::NoSolution(testbed::tracker::Reason::TooFewStars)
                }
            },
        }
    }
}

/// Returns the report of a frame without an attitude.
pub(super) fn unknown(seen: &Seen, mode: Mode) -> Report {
    Report {
        frame: seen.number,
        time_tag: seen.mid_exposure,
        attitude_wxyz: None,
        rate_rad_s: None,
        sigma_rad: [0.0; 3],
        stars: 0,
        mode,
        exposure_s: seen.exposure_s,
        background_dn: f64::NAN,
        temperature_c: seen.temperature_c,
    }
}
