use super::*;
use crate::synthetic::{Dice, Frame, judged};
use base::units::DEG;
use glam::DQuat;

fn find<'a>(metrics: &'a [Metric], id: &str) -> &'a Metric {
    metrics.iter().find(|metric| metric.id == id).unwrap_or_else(|| panic!("{id} in {metrics:?}"))
}

fn holds(metrics: &[Metric], id: &str, truth: f64) -> bool {
    let metric = find(metrics, id);
    (metric.low..=metric.high.unwrap()).contains(&truth)
}

/// Slews at several rates; the attitude is that of `late_s` before the stated time; `tag_s` of that is in the tag.
fn slews(late_s: f64, tag_s: f64) -> JudgedCase {
    let mut dice = Dice::new(9);
    let mut frames = Vec::new();
    for (group, rate_deg_s) in [-1.0, -0.3, 0.0, 0.5, 1.0].into_iter().enumerate() {
        let rate_rad_s = DVec3::new(0.3, 1.0, 0.2) * rate_deg_s * DEG;
        for i in 0..60 {
            let lag = rate_rad_s * (late_s - tag_s) / ARCSEC;
            let error = DVec3::new(3.0, -8.0, 0.0) - lag + 2.0 * dice.normals();
            let t_s = group as f64 * 100.0 + 0.1 * f64::from(i);
            frames.push(Frame { t_s, group: group as u32, rate_rad_s, error_arcsec: Some(error), tag_s });
        }
    }
    judged(Use::Slew, &frames)
}

#[test]
fn a_date_error_comes_back_from_tags_and_from_attitudes_alike() {
    for (late_s, tag_s) in [(0.004, 0.0), (0.004, 0.004), (-0.003, 0.0)] {
        let found = date_error(&[slews(late_s, tag_s)], 0.99);
        assert!(holds(&found, "measurement_date_error", 1e3 * late_s), "{late_s} {tag_s}: {found:?}");
        assert!(!holds(&found, "measurement_date_error", -1e3 * late_s), "the sign counts");
        assert!((find(&found, "time_tag_error").value - 1e3 * tag_s).abs() < 1e-3);
    }
}

#[test]
fn without_motion_nothing_is_said_of_dates() {
    let frames: Vec<Frame> = (0..50).map(|i| Frame::still(f64::from(i), 0, DVec3::ONE)).collect();
    let found = date_error(&[judged(Use::Run, &frames)], 0.95);
    assert!(found.iter().all(|metric| metric.id != "measurement_date_error"), "{found:?}");
}

#[test]
fn a_tracker_that_knows_no_aberration_is_found() {
    let mut dice = Dice::new(4);
    let noise: Vec<DVec3> = (0..200).map(|_| 3.0 * dice.normals()).collect();
    let plain: Vec<Frame> =
        noise.iter().enumerate().map(|(i, noise)| Frame::still(10.0 * i as f64, i as u32, *noise)).collect();
    let mut case = judged(Use::LostInSpace, &plain);
    assert!(holds(&aberration_residual(std::slice::from_ref(&case), 0.99), "aberration_residual", 0.0));
    // Written afresh: the frame that sees apparent directions s + beta across s where the catalog's are.
    for frame in &mut case.frames {
        let beta = earth_beta(Tai::from_ns(frame.truth.mid_ns));
        let attitude = frame.truth.attitude;
        let boresight = attitude.conjugate() * DVec3::Z;
        let apparent = (boresight + beta).normalize();
        let turn = DQuat::from_rotation_arc(attitude * boresight, attitude * apparent);
        let measured = turn * attitude;
        let error = crate::attitude_error::attitude_error(measured, attitude);
        let noise = frame.error_rad().unwrap();
        frame.fate = crate::record::Fate::Right(error + noise);
    }
    let found = aberration_residual(&[case], 0.99);
    assert!(holds(&found, "aberration_residual", 20.5), "{found:?}");
    assert!(!holds(&found, "aberration_residual", 0.0) && !holds(&found, "aberration_residual", -20.5));
}

#[test]
fn drift_comes_back_with_its_mean_error() {
    let mut dice = Dice::new(8);
    let frame = |i: u32| {
        let t_s = f64::from(i);
        Frame::still(t_s, 0, DVec3::new(12.0, 0.0, -60.0) * t_s / 3600.0 + 1.5 * dice.normals())
    };
    let frames: Vec<Frame> = (0..3600).map(frame).collect();
    let found = drift(&[judged(Use::Drift, &frames)], 0.99);
    assert!(
        holds(&found, "drift.x", 12.0) && holds(&found, "drift.y", 0.0) && holds(&found, "drift.rotational", -60.0),
        "{found:?}"
    );
    assert!(!holds(&found, "drift.x", -12.0) && !holds(&found, "drift.y", 12.0));
    // From the middle of the first quarter to that of the last: three quarters of the time.
    assert!((find(&found, "mean_drift_error.x").value - 9.0).abs() < 0.5);
}
