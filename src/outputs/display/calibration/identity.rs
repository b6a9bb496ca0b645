//! The identity of a calibration: a display in its mode, a tracker by its geometry.

use crate::display::calibration::error;
use base::refused::Refused;
use frames::sink::crc32::Crc32;
use serde::{Deserialize, Serialize};
use sky::astrometry::{CameraGeometry, Distortion};

/// A display in one of its modes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DisplayIdentity {
    /// Model and serial number, or any other name that identifies the unit.
    pub name: String,
    /// Columns.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
    /// Bits of a grey.
    pub bits: u32,
}

impl DisplayIdentity {
    /// Returns columns and rows.
    pub fn size_px(&self) -> [usize; 2] {
        [self.width_px, self.height_px]
    }

    /// Returns the brightest grey.
    pub fn full_grey(&self) -> u16 {
        u16::try_from((1_u32 << self.bits.min(16)) - 1).unwrap_or(u16::MAX)
    }
}

/// The tracker that looked.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrackerIdentity {
    /// Name of its camera file.
    pub name: String,
    /// Columns.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
    /// CRC-32 of its focal lengths, principal point and distortion: pixels of another geometry mean other directions.
    pub geometry_crc32: String,
}

impl TrackerIdentity {
    /// Returns the identity of a camera.
    pub fn of(name: &str, camera: &CameraGeometry) -> Self {
        let p = camera.parameters();
        let mut numbers = [p.focal_px, p.principal_point_px].concat();
        match camera.distortion() {
            Distortion::BrownConrady(d) => numbers.extend([d.k1, d.k2, d.k3, d.p1, d.p2]),
            Distortion::Polynomial(polynomial) => numbers.extend(polynomial.coefficients()),
        }
        let mut crc = Crc32::default();
        numbers.iter().for_each(|number| crc.update(&number.to_le_bytes()));
        let geometry_crc32 = format!("{:08x}", crc.value());
        Self { name: name.into(), width_px: camera.width_px(), height_px: camera.height_px(), geometry_crc32 }
    }
}

/// Returns the first thing in which two lists of named texts differ.
fn difference(
    measured_utc: &str,
    wanted: &[(&'static str, String)],
    got: &[(&'static str, String)],
) -> Result<(), Refused> {
    match wanted.iter().zip(got).find(|((_, wanted), (_, got))| wanted != got) {
        None => Ok(()),
        Some(((what, wanted), (_, got))) => {
            let (wanted, got) = (wanted.clone(), got.clone());
            Err(error::mismatch(measured_utc, what, wanted, got))
        }
    }
}

/// Refuses a calibration of another display.
pub(super) fn same_display(
    measured_utc: &str,
    used: &DisplayIdentity,
    calibrated: &DisplayIdentity,
) -> Result<(), Refused> {
    let reported = |d: &DisplayIdentity| {
        [
            ("display", d.name.clone()),
            ("resolution", format!("{} x {} px", d.width_px, d.height_px)),
            ("depth of greys", format!("{} bits", d.bits)),
        ]
    };
    difference(measured_utc, &reported(used), &reported(calibrated))
}

/// Refuses a calibration by another tracker.
pub(super) fn same_tracker(
    measured_utc: &str,
    used: &TrackerIdentity,
    calibrated: &TrackerIdentity,
) -> Result<(), Refused> {
    let reported = |t: &TrackerIdentity| {
        [
            ("tracker camera", t.name.clone()),
            ("detector size", format!("{} x {} px", t.width_px, t.height_px)),
            ("tracker geometry (focal length, principal point, distortion)", t.geometry_crc32.clone()),
        ]
    };
    difference(measured_utc, &reported(used), &reported(calibrated))
}
