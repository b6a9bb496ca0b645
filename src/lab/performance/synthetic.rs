//! Made-up cases with known errors, for tests.

use crate::record::{Case, FalseLimit, JudgedCase, LogRow, TruthRow, Use, turned};
use base::units::ARCSEC;
use glam::{DQuat, DVec3};
use std::collections::BTreeMap;

/// Limits wide enough for all errors of these cases.
pub(crate) const LIMIT: FalseLimit = FalseLimit { directional_arcsec: 600.0, rotational_arcsec: 6000.0 };

/// Numbers that a seed decides (splitmix64).
pub(crate) struct Dice(u64);

impl Dice {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (core::f64::consts::TAU * self.uniform()).cos()
    }

    pub(crate) fn normals(&mut self) -> DVec3 {
        DVec3::new(self.normal(), self.normal(), self.normal())
    }
}

/// One frame of a made-up case.
pub(crate) struct Frame {
    pub(crate) t_s: f64,
    pub(crate) group: u32,
    pub(crate) rate_rad_s: DVec3,
    /// Error of the attitude, arcsec; `None`: no attitude.
    pub(crate) error_arcsec: Option<DVec3>,
    /// Time tag less mid-exposure, s.
    pub(crate) tag_s: f64,
}

impl Frame {
    pub(crate) fn still(t_s: f64, group: u32, error_arcsec: DVec3) -> Self {
        Self { t_s, group, rate_rad_s: DVec3::ZERO, error_arcsec: Some(error_arcsec), tag_s: 0.0 }
    }
}

/// Returns a case of these frames, compared.
pub(crate) fn judged(purpose: Use, frames: &[Frame]) -> JudgedCase {
    case(purpose, frames).judged(&LIMIT)
}

/// Returns a case of these frames.
pub(crate) fn case(purpose: Use, frames: &[Frame]) -> Case {
    let attitude = |frame: &Frame| {
        let start = DQuat::from_euler(glam::EulerRot::ZYX, 0.4 * f64::from(frame.group), 0.2, -0.7);
        turned(start, frame.rate_rad_s * frame.t_s)
    };
    let truth = |(number, frame): (usize, &Frame)| TruthRow {
        frame: u32::try_from(number).unwrap(),
        mid_ns: ns(frame.t_s),
        exposure_s: 0.1,
        attitude: attitude(frame),
        rate_rad_s: frame.rate_rad_s,
        group: frame.group,
        has_fault: false,
    };
    let row = |(number, frame): (usize, &Frame)| LogRow {
        frame: Some(u32::try_from(number).unwrap()),
        at_ns: Some(ns(frame.t_s + frame.tag_s)),
        attitude: frame.error_arcsec.map(|error| turned(attitude(frame), error * ARCSEC)),
        available_ns: Some(ns(frame.t_s + 0.25)),
        stars: Some(20),
    };
    Case {
        name: format!("{purpose:?}"),
        purpose,
        conditions: BTreeMap::new(),
        truth: frames.iter().enumerate().map(truth).collect(),
        log: frames.iter().enumerate().map(row).collect(),
    }
}

#[allow(clippy::cast_possible_truncation, reason = "short times")]
fn ns(t_s: f64) -> i64 {
    // Far from zero, as real times are.
    1_772_323_237_000_000_000 + (t_s * 1e9).round() as i64
}
