//! Inertial axes of files: ICRF and GCRF, which are parallel, and EME2000, which is turned by the frame bias.
//!
//! EME2000 (STK: J2000) is the mean equator and equinox of J2000.0. Its bias from the axes of ICRF is 17 mas in x, 7
//! mas in y and 15 mas in right ascension (IERS Conventions 2010, section 5.4.4), and it is applied. Test: ERFA's
//! matrix.

use base::{axes::Rotation, units::MAS};
use glam::{DMat3, DQuat, DVec3};

/// Inertial axes of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ReferenceAxes {
    Icrf,
    Eme2000,
}

/// Axes as messages list them.
pub(crate) const WANTED_AXES: &str = "inertial axes of ICRF, GCRF, EME2000 (J2000)";
/// Note for files in EME2000.
pub(crate) const BIAS_NOTE: &str = "axes are EME2000: turned by the frame bias of IERS 2010 (23 mas)";

/// Pole offsets and right ascension of the bias, mas (IERS Conventions 2010, eq. 5.21 and 5.33).
const XI_MAS: f64 = -16.617_0;
const ETA_MAS: f64 = -6.819_2;
const RIGHT_ASCENSION_MAS: f64 = -14.60;

impl ReferenceAxes {
    /// Returns the axes of this name; capitals do not matter.
    pub(crate) fn of_name(name: &str) -> Option<Self> {
        let name = name.to_ascii_uppercase();
        let is_icrf = ["ICRF", "GCRF"].iter().any(|stem| {
            name.strip_prefix(stem)
                .is_some_and(|number| number.len() <= 1 && number.bytes().all(|b| b.is_ascii_digit()))
        });
        match name.as_str() {
            "EME2000" | "J2000" => Some(Self::Eme2000),
            _ if is_icrf => Some(Self::Icrf),
            _ => None,
        }
    }

    /// Returns the passive rotation from ICRF axes into these.
    pub(crate) fn rotation_from_icrf(self) -> DQuat {
        match self {
            Self::Icrf => DQuat::IDENTITY,
            Self::Eme2000 => bias(),
        }
    }

    /// Rewrites a vector of these axes into ICRF axes.
    pub(crate) fn to_icrf(self, vector: DVec3) -> DVec3 {
        match self {
            Self::Icrf => vector,
            Self::Eme2000 => bias().conjugate() * vector,
        }
    }

    /// Returns what must be said of axes that are not ICRF.
    pub(crate) fn note(self) -> Option<&'static str> {
        match self {
            Self::Icrf => None,
            Self::Eme2000 => Some(BIAS_NOTE),
        }
    }
}

/// Returns the passive rotation from ICRF into EME2000 axes.
fn bias() -> DQuat {
    let [xi, eta, ra] = [XI_MAS * MAS, ETA_MAS * MAS, RIGHT_ASCENSION_MAS * MAS];
    // Rows are the EME2000 axes, to first order; `from_axes` makes it a rotation (second order: 1e-15).
    let rows = DMat3::from_cols(DVec3::new(1.0, ra, -xi), DVec3::new(-ra, 1.0, -eta), DVec3::new(xi, eta, 1.0));
    Rotation::<(), ()>::from_axes(rows.x_axis, rows.y_axis, rows.z_axis).quat()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The pole offsets are quoted to 0.1 microarcsecond, 5e-13 rad.
    const QUOTED_RAD: f64 = 1e-12;

    #[test]
    fn the_bias_is_that_of_erfa() {
        /// erfa.bp00(2451545.0, 0.0)[0] (pyerfa 2.0.1.5).
        const RB: [[f64; 3]; 3] = [
            [0.999_999_999_999_994_2, -7.078_279_744_199_198e-8, 8.056_217_146_976_134e-8],
            [7.078_279_477_857_338e-8, 0.999_999_999_999_996_9, 3.306_041_454_222_136_4e-8],
            [-8.056_217_380_986_972e-8, -3.306_040_883_980_552e-8, 0.999_999_999_999_996_2],
        ];
        let eme2000_from_icrf = ReferenceAxes::Eme2000.rotation_from_icrf();
        for (column, axis) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
            let wanted = DVec3::new(RB[0][column], RB[1][column], RB[2][column]);
            let got = eme2000_from_icrf * axis;
            assert!((got - wanted).length() < QUOTED_RAD, "column {column}: {}", got - wanted);
            assert!((got - axis).length() > 5e-8, "control: no bias at all differs");
            assert!((ReferenceAxes::Eme2000.to_icrf(got) - axis).length() < 1e-15);
        }
    }

    #[test]
    fn names_are_known() {
        for name in ["ICRF", "icrf2", "GCRF", "gcrf3"] {
            assert_eq!(ReferenceAxes::of_name(name), Some(ReferenceAxes::Icrf), "{name}");
        }
        assert_eq!(ReferenceAxes::of_name("J2000"), Some(ReferenceAxes::Eme2000));
        for name in ["TEME", "ITRF2014", "ICRF12", "", "SC_BODY_1"] {
            assert_eq!(ReferenceAxes::of_name(name), None, "{name}");
        }
    }
}
