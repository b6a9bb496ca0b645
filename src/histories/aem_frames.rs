//! The two frames of a segment of an AEM, and the direction of its quaternions -> attitudes and rates as this program has
//! them.

use crate::reference_axes::{ReferenceAxes, WANTED_AXES};
use crate::{error::HistoryError, metadata::Metadata};
use glam::{DQuat, DVec3};

/// Beginnings of frame names that are neither inertial nor those of a spacecraft.
const NOT_A_BODY: [&str; 20] = [
    "ITRF", "TEME", "TOD", "MOD", "TNW", "RTN", "RSW", "LVLH", "QSW", "NTW", "PQW", "VNC", "GTOD", "TIRS", "CIRS",
    "GRC", "EFG", "WGS84", "DTRF", "FIXED",
];

/// The frames of a segment, and the direction of its quaternions.
pub(crate) struct Frames<'m> {
    pub(crate) axes: ReferenceAxes,
    pub(crate) body: &'m str,
    /// Attitudes turn the inertial axes into those of the body.
    pub(crate) is_to_body: bool,
}

impl<'m> Frames<'m> {
    /// Reads the frames of a segment; `is_first` is version 1.
    pub(crate) fn read(metadata: &Metadata<'m>, is_first: bool) -> Result<Self, HistoryError> {
        let [a, b] = [metadata.needed("REF_FRAME_A")?, metadata.needed("REF_FRAME_B")?];
        let [axes_a, axes_b] = [a, b].map(|entry| ReferenceAxes::of_name(entry.value));
        let (axes, body, a_is_inertial) = match (axes_a, axes_b) {
            (Some(axes), None) => (axes, b, true),
            (None, Some(axes)) => (axes, a, false),
            (Some(_), Some(_)) => return Err(metadata.refuse(b, "a spacecraft frame, such as SC_BODY_1")),
            (None, None) => return Err(metadata.refuse(a, &format!("one frame with {WANTED_AXES}"))),
        };
        let name = body.value.to_ascii_uppercase();
        if body.value.is_empty() || NOT_A_BODY.iter().any(|known| name.starts_with(known)) {
            return Err(metadata.refuse(body, "a spacecraft frame, such as SC_BODY_1"));
        }
        let is_a_to_b = if is_first { direction(metadata)? } else { true };
        Ok(Self { axes, body: body.value, is_to_body: is_a_to_b == a_is_inertial })
    }

    /// Returns this program's quaternion for one of the file.
    pub(crate) fn body_from_axes(&self, quaternion: DQuat) -> DQuat {
        if self.is_to_body { quaternion.conjugate() } else { quaternion }
    }

    /// Returns a rate of the frame B with respect to A, in the axes of one of them, as a rate of the body in its own
    /// axes.
    pub(crate) fn body_rate(&self, rate_rad_s: DVec3, is_in_body: bool, body_from_axes: DQuat) -> DVec3 {
        let in_body = if is_in_body { rate_rad_s } else { body_from_axes * rate_rad_s };
        if self.is_to_body { in_body } else { -in_body }
    }
}

/// Returns whether version 1 goes from A to B.
fn direction(metadata: &Metadata<'_>) -> Result<bool, HistoryError> {
    let entry = metadata.needed("ATTITUDE_DIR")?;
    match entry.value {
        "A2B" => Ok(true),
        "B2A" => Ok(false),
        _ => Err(metadata.refuse(entry, "A2B or B2A")),
    }
}
