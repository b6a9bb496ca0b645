//! Frames and answers matched, and the error of one attitude.
//!
//! The truth of frames and the log of a tracker -> errors, frame by frame.
//!
//! A row of the log belongs to the frame that it names, else to the frame whose mid-exposure is nearest to its time
//! tag, within half of the time between frames. Its error is that against the true attitude at the time that it states:
//! a wrong time tag shows as an error along the motion.

use base::units::ARCSEC;
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap};

base::words! {
    /// Purpose of a case, which decides its metrics; its words are those of files.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Use {
        /// Any run: everything that it allows.
        Run = "run",
        /// Inertial attitudes, several frames each: temporal noise, bias.
        Inertial = "inertial",
        /// The sky over the whole field, several frames each: spatial errors of long and short period together.
        FovGrid = "fov_grid",
        /// Shifts by parts of a pixel, several frames each: spatial errors of the period of a pixel.
        PixelGrid = "pixel_grid",
        /// Constant rates: date error, noise, tracking.
        Slew = "slew",
        /// Attitudes without knowledge: acquisition.
        LostInSpace = "lost_in_space",
        /// A long time: drift.
        Drift = "drift",
        /// A mounting that drifts with the orbit: thermo-elastic error.
        ThermoElastic = "thermo_elastic",
        /// A sine of the line of sight: how much of it the output follows.
        Bandwidth = "bandwidth",
        /// Something that disturbs: noise, tracking, loss and recovery against its size.
        Stress = "stress",
    }
}

impl Use {
    /// Purposes of cases that have metrics of their own.
    pub const EACH_FOR_ITSELF: &[Self] = &[Self::Run, Self::Slew, Self::Stress];

    /// Returns its name for people.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Run => "run",
            Self::Inertial => "inertial attitudes",
            Self::FovGrid => "grid over the field",
            Self::PixelGrid => "shifts by parts of a pixel",
            Self::Slew => "slew",
            Self::LostInSpace => "lost in space",
            Self::Drift => "drift",
            Self::ThermoElastic => "thermo-elastic drift",
            Self::Bandwidth => "sine of the line of sight",
            Self::Stress => "disturbance",
        }
    }
}

/// The truth of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruthRow {
    /// Number of the frame.
    pub frame: u32,
    /// Middle of its exposure, TAI, ns.
    pub mid_ns: i64,
    /// Length of its exposure, s.
    pub exposure_s: f64,
    /// True attitude then, `sensor_from_icrf`.
    pub attitude: DQuat,
    /// True rate then, sensor axes, rad/s.
    pub rate_rad_s: DVec3,
    /// Frames of one number show one attitude.
    pub group: u32,
    /// A commanded fault was active.
    pub has_fault: bool,
}

/// Answer of a tracker to one frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LogRow {
    /// Number of the frame, where it is known.
    pub frame: Option<u32>,
    /// The time at which the attitude is said to hold, TAI, ns.
    pub at_ns: Option<i64>,
    /// The attitude, `sensor_from_icrf`; `None`: no solution.
    pub attitude: Option<DQuat>,
    /// When the attitude was there, TAI, ns.
    pub available_ns: Option<i64>,
    /// Stars that were used.
    pub stars: Option<u32>,
}

/// A case: truth, log, and under which conditions.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// Its name.
    pub name: String,
    /// Purpose, which decides its metrics.
    pub purpose: Use,
    /// Numbers that describe it, such as `rate_deg_s`.
    pub conditions: BTreeMap<String, f64>,
    /// Frames, by number.
    pub truth: Vec<TruthRow>,
    /// The tracker's log.
    pub log: Vec<LogRow>,
}

/// From which errors on a solution is a false one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FalseLimit {
    /// Across the boresight, arcsec.
    pub directional_arcsec: f64,
    /// About it, arcsec.
    pub rotational_arcsec: f64,
}

/// Result for one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fate {
    /// A right attitude with this error, rad.
    Right(DVec3),
    /// An attitude that is far from the truth.
    False(DVec3),
    /// None.
    Nothing,
}

/// One frame with what the tracker made of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judged {
    /// The frame.
    pub truth: TruthRow,
    /// Result for it.
    pub fate: Fate,
    /// Time tag less mid-exposure, s; `None` without a tag.
    pub tag_error_s: Option<f64>,
    /// Attitude there less the start of the exposure, s; `None` where the log does not say when.
    pub latency_s: Option<f64>,
}

impl Judged {
    /// Returns the error of a right attitude, rad.
    pub fn error_rad(&self) -> Option<DVec3> {
        match self.fate {
            Fate::Right(error) => Some(error),
            Fate::False(_) | Fate::Nothing => None,
        }
    }

    /// Returns the error of an attitude, right or false, rad.
    pub fn any_error_rad(&self) -> Option<DVec3> {
        match self.fate {
            Fate::Right(error) | Fate::False(error) => Some(error),
            Fate::Nothing => None,
        }
    }

    /// Returns true for a right attitude.
    pub fn is_right(&self) -> bool {
        self.error_rad().is_some()
    }
}

/// A case after the comparison.
#[derive(Debug, Clone, PartialEq)]
pub struct JudgedCase {
    /// Its name.
    pub name: String,
    /// Purpose, which decides its metrics.
    pub purpose: Use,
    /// Numbers that describe it.
    pub conditions: BTreeMap<String, f64>,
    /// Frames in order of time.
    pub frames: Vec<Judged>,
    /// Rows of the log that belong to no frame.
    pub stray_rows: usize,
}

impl Case {
    /// Returns the comparison of every frame.
    pub fn judged(&self, limit: &FalseLimit) -> JudgedCase {
        let places: HashMap<u32, usize> = self.truth.iter().enumerate().map(|(i, row)| (row.frame, i)).collect();
        let half_ns = half_period_ns(&self.truth);
        let mut found: Vec<Option<&LogRow>> = vec![None; self.truth.len()];
        let mut stray_rows = 0;
        for row in &self.log {
            let place = match (row.frame, row.at_ns) {
                (Some(frame), _) => places.get(&frame).copied(),
                (None, Some(at_ns)) => nearest(&self.truth, at_ns, half_ns),
                (None, None) => None,
            };
            match place {
                Some(place) => {
                    // The first attitude of a frame counts: a tracker cannot take back what it has said.
                    let slot = &mut found[place];
                    if slot.is_none_or(|known| known.attitude.is_none()) {
                        *slot = Some(row);
                    }
                }
                None => stray_rows += 1,
            }
        }
        let frames = self.truth.iter().zip(found).map(|(truth, row)| judged(truth, row, limit)).collect();
        JudgedCase {
            name: self.name.clone(),
            purpose: self.purpose,
            conditions: self.conditions.clone(),
            frames,
            stray_rows,
        }
    }
}

fn judged(truth: &TruthRow, row: Option<&LogRow>, limit: &FalseLimit) -> Judged {
    let tag_error_s = row.and_then(|row| row.at_ns).map(|at_ns| seconds(at_ns - truth.mid_ns));
    let exposure_start_ns = truth.mid_ns - nanoseconds(0.5 * truth.exposure_s);
    let latency_s = row.and_then(|row| row.available_ns).map(|at_ns| seconds(at_ns - exposure_start_ns));
    let fate = row.and_then(|row| row.attitude).map_or(Fate::Nothing, |measured| {
        let stated = turned(truth.attitude, truth.rate_rad_s * tag_error_s.unwrap_or(0.0));
        let error = attitude_error(measured, stated);
        let is_false = directional(error) > limit.directional_arcsec * ARCSEC
            || error.z.abs() > limit.rotational_arcsec * ARCSEC
            || !error.is_finite();
        if is_false { Fate::False(error) } else { Fate::Right(error) }
    });
    Judged { truth: *truth, fate, tag_error_s, latency_s }
}

/// Half of the least time between frames.
fn half_period_ns(truth: &[TruthRow]) -> i64 {
    let least = truth.windows(2).map(|pair| pair[1].mid_ns - pair[0].mid_ns).filter(|gap| *gap > 0).min();
    least.map_or(i64::MAX, |gap| gap / 2)
}

fn nearest(truth: &[TruthRow], at_ns: i64, within_ns: i64) -> Option<usize> {
    let after = truth.partition_point(|row| row.mid_ns < at_ns);
    let sides = [after.checked_sub(1), (after < truth.len()).then_some(after)];
    let place = sides.into_iter().flatten().min_by_key(|place| (truth[*place].mid_ns - at_ns).abs())?;
    ((truth[place].mid_ns - at_ns).abs() <= within_ns).then_some(place)
}

fn seconds(ns: i64) -> f64 {
    ns as f64 * 1e-9
}

#[allow(clippy::cast_possible_truncation, reason = "an exposure is far below 292 years")]
fn nanoseconds(s: f64) -> i64 {
    (s * 1e9) as i64
}

// The error of one attitude: a small turn of the measured frame from the true one, in sensor axes.
//
// Quaternions are this program's: `v_sensor = q v_icrf q*`, so a frame that turned by +a about its x axis has x = -sin(a/2).

/// Returns the turn from the true frame to the measured one, rad, sensor axes: -2 times the vector part of `q_meas
/// q_true*` where it is small, and the whole rotation vector where it is not.
pub fn attitude_error(measured: DQuat, truth: DQuat) -> DVec3 {
    let difference = measured * truth.conjugate();
    let difference = if difference.w < 0.0 { -difference } else { difference };
    let vector = difference.xyz();
    let sine = vector.length();
    if sine < 1e-9 {
        return -2.0 * vector;
    }
    vector * (-2.0 * sine.atan2(difference.w) / sine)
}

/// Returns the attitude of a frame that has turned by `turn_rad`, a rotation vector in its own axes.
pub fn turned(attitude: DQuat, turn_rad: DVec3) -> DQuat {
    (DQuat::from_scaled_axis(-turn_rad) * attitude).normalize()
}

/// Returns the error of directions, across the boresight.
pub fn directional(error_rad: DVec3) -> f64 {
    error_rad.x.hypot(error_rad.y)
}

#[cfg(test)]
mod record_tests {
    use super::*;

    const LIMIT: FalseLimit = FalseLimit { directional_arcsec: 300.0, rotational_arcsec: 3000.0 };

    fn truth(frame: u32, rate_rad_s: DVec3) -> TruthRow {
        let t_s = f64::from(frame) * 0.1;
        let attitude = turned(DQuat::from_rotation_x(0.3), rate_rad_s * t_s);
        TruthRow {
            frame,
            mid_ns: i64::from(frame) * 100_000_000,
            exposure_s: 0.05,
            attitude,
            rate_rad_s,
            group: 0,
            has_fault: false,
        }
    }

    fn case(log: Vec<LogRow>, rate_rad_s: DVec3) -> Case {
        let truth = (0..5).map(|frame| truth(frame, rate_rad_s)).collect();
        Case { name: "x".into(), purpose: Use::Run, conditions: BTreeMap::new(), truth, log }
    }

    #[test]
    fn rows_find_their_frames_by_number_or_time() {
        let of = |frame: Option<u32>, at_ns: Option<i64>| {
            let row = LogRow { frame, at_ns, attitude: Some(truth(3, DVec3::ZERO).attitude), ..LogRow::default() };
            let judged = case(vec![row], DVec3::ZERO).judged(&LIMIT);
            (judged.frames.iter().position(Judged::is_right), judged.stray_rows)
        };
        assert_eq!(of(Some(3), None), (Some(3), 0));
        assert_eq!(of(None, Some(310_000_000)), (Some(3), 0), "10 ms off");
        assert_eq!(of(Some(2), Some(310_000_000)), (Some(2), 0), "the number counts more");
        assert_eq!(of(Some(9), None), (None, 1));
        assert_eq!(of(None, Some(470_000_000)), (None, 1), "too late for any");
        assert_eq!(of(None, None), (None, 1));
    }

    #[test]
    fn a_late_time_tag_is_an_error_along_the_motion() {
        let rate = DVec3::new(0.0, 0.01, 0.002);
        let row = LogRow {
            frame: Some(2),
            at_ns: Some(200_000_000 + 3_000_000),
            attitude: Some(truth(2, rate).attitude),
            available_ns: Some(250_000_000),
            stars: None,
        };
        let judged = case(vec![row], rate).judged(&LIMIT).frames[2];
        let error = judged.error_rad().unwrap();
        assert!((error + rate * 3e-3).length() < 1e-9, "{error}: it shows where the frame was 3 ms ago");
        assert!((judged.tag_error_s.unwrap() - 3e-3).abs() < 1e-12);
        assert!((judged.latency_s.unwrap() - 0.075).abs() < 1e-12, "from the start of the exposure");
    }

    #[test]
    fn far_attitudes_are_false_and_the_first_counts() {
        let right = truth(1, DVec3::ZERO).attitude;
        let row = |attitude| LogRow { frame: Some(1), attitude, ..LogRow::default() };
        let fate = |rows: Vec<LogRow>| case(rows, DVec3::ZERO).judged(&LIMIT).frames[1].fate;
        let off = turned(right, DVec3::X * 301.0 * ARCSEC);
        assert!(matches!(fate(vec![row(Some(off))]), Fate::False(_)));
        assert!(matches!(fate(vec![row(Some(turned(right, DVec3::X * 299.0 * ARCSEC)))]), Fate::Right(_)));
        assert!(matches!(fate(vec![row(Some(turned(right, DVec3::Z * 3001.0 * ARCSEC)))]), Fate::False(_)));
        assert!(matches!(fate(vec![row(Some(off)), row(Some(right))]), Fate::False(_)), "it cannot be taken back");
        assert!(matches!(fate(vec![row(None), row(Some(right))]), Fate::Right(_)));
        assert!(matches!(fate(vec![]), Fate::Nothing));
        assert!(
            matches!(fate(vec![row(Some(right.conjugate()))]), Fate::False(_)),
            "the conjugate is another attitude"
        );
    }
}

#[cfg(test)]
mod attitude_error_tests {
    use super::*;

    #[test]
    fn a_frame_turned_by_a_has_the_error_a() {
        let truth = DQuat::from_xyzw(0.1, -0.4, 0.3, 0.86).normalize();
        for turn in [DVec3::X * 1e-4, DVec3::new(-2e-5, 3e-6, 1e-3), DVec3::Z * 2.5, DVec3::Y * 1e-12] {
            let error = attitude_error(turned(truth, turn), truth);
            assert!((error - turn).length() < 1e-15 + 1e-14 * turn.length(), "{error} {turn}");
            assert_eq!(attitude_error(-turned(truth, turn), truth), error, "q and -q are one attitude");
        }
    }

    #[test]
    fn it_is_the_sense_of_the_programs_quaternion() {
        // Written from the convention: a frame turned by +a about x sees the fixed direction y at cos a in y and -sin a
        // in z.
        let a = 0.02_f64;
        let measured = turned(DQuat::IDENTITY, DVec3::X * a);
        let seen = measured * DVec3::Y;
        assert!((seen - DVec3::new(0.0, a.cos(), -a.sin())).length() < 1e-15, "{seen}");
        assert!((measured.x + (0.5 * a).sin()).abs() < 1e-16, "x is -sin(a/2)");
    }
}
