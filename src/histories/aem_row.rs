//! Reads the frames and the rows of a segment of an AEM: ATTITUDE_TYPE and its companions -> an attitude, and perhaps a rate, of numbers.
//!
//! | type | numbers of a row | read as |
//! |---|---|---|
//! | QUATERNION, /DERIVATIVE, /ANGVEL | four, and four or three beside them | attitude and rate |
//! | EULER_ANGLE, /DERIVATIVE, /ANGVEL | three angles by EULER_ROT_SEQ, and three beside them; deg, deg/s | attitude and rate |
//! | SPIN, SPIN/NUTATION, SPIN/NUTATION_MOM | SPIN_ALPHA, SPIN_DELTA, SPIN_ANGLE, and others; deg | attitude |
//!
//! Euler angles turn axes, the first one first, about axes that those before have turned. A spin axis is the body's z: its
//! attitude is the turns 90 deg + alpha about z, 90 deg - delta about x and the spin angle about z (CCSDS 504.0-B-2, annex on
//! spin; Orekit reads it so). The speeds of spin and nutation are left out: the attitudes have them. Version 1 names its
//! angles X, Y and Z and lets programs differ on their order, so that only the sequence 123 is certain; its rates
//! (/RATE) are left out, because it does not fix what they are. Tests: `tests::files`, `hil_scripts/tests/test_histories.py`.
//! The frames and the direction of the quaternions say how attitudes and rates become this program's.

use crate::attitude_methods::{AttitudeState, MOST_TURN_RAD, rate_of_derivative, s_between};
use crate::reference_axes::{ReferenceAxes, WANTED_AXES};
use crate::{error::HistoryError, message::Row, metadata::Metadata};
use base::axes::{Rotation, WRITTEN_NORM_TOLERANCE};
use glam::{DQuat, DVec3};

/// Most numbers of a row.
pub(crate) const MOST_NUMBERS: usize = 8;
/// Attitude types as messages list them.
const WANTED_TYPE: &str = "QUATERNION, QUATERNION/DERIVATIVE, QUATERNION/ANGVEL, EULER_ANGLE, EULER_ANGLE/DERIVATIVE, \
                           EULER_ANGLE/ANGVEL, SPIN, SPIN/NUTATION or SPIN/NUTATION_MOM (of version 1 QUATERNION, \
                           QUATERNION/DERIVATIVE, QUATERNION/RATE, EULER_ANGLE, EULER_ANGLE/RATE, SPIN or SPIN/NUTATION)";

/// Form of the first numbers of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Form {
    /// A quaternion; true: its scalar first.
    Quaternion(bool),
    /// Angles of turns about these axes.
    Angles([DVec3; 3]),
    /// Direction of the body's z axis, and a turn about it.
    Spin,
}

/// Form of the numbers after them.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Beside {
    Nothing,
    /// Derivatives of the numbers before.
    Derivative,
    /// Body rates in deg/s; true: in the axes of the body.
    Rate(bool),
    /// So many numbers that are not used.
    Unused(usize),
}

/// Content of the rows of a segment.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RowKind {
    form: Form,
    beside: Beside,
}

impl RowKind {
    /// Reads the metadata of a segment; `is_first` is version 1, `is_named` is XML, which names its components.
    pub(crate) fn read(
        metadata: &Metadata<'_>,
        frames: &Frames<'_>,
        is_first: bool,
        is_named: bool,
    ) -> Result<Self, HistoryError> {
        let entry = metadata.needed("ATTITUDE_TYPE")?;
        let kind = entry.value.to_ascii_uppercase().replace('_', "/");
        let (form, beside) = match (kind.as_str(), is_first) {
            ("QUATERNION", _) => (None, Beside::Nothing),
            ("QUATERNION/DERIVATIVE", _) => (None, Beside::Derivative),
            ("QUATERNION/RATE", true) => (None, Beside::Unused(3)),
            ("QUATERNION/ANGVEL", false) => (None, Beside::Rate(is_rate_in_body(metadata, frames)?)),
            ("EULER/ANGLE", _) => (Some(angles(metadata, is_first)?), Beside::Nothing),
            ("EULER/ANGLE/RATE", true) => (Some(angles(metadata, is_first)?), Beside::Unused(3)),
            ("EULER/ANGLE/DERIVATIVE", false) => (Some(angles(metadata, is_first)?), Beside::Derivative),
            ("EULER/ANGLE/ANGVEL", false) => {
                (Some(angles(metadata, is_first)?), Beside::Rate(is_rate_in_body(metadata, frames)?))
            }
            ("SPIN", _) => (Some(Form::Spin), Beside::Unused(1)),
            ("SPIN/NUTATION", _) | ("SPIN/NUTATION/MOM", false) => (Some(Form::Spin), Beside::Unused(4)),
            _ => return Err(metadata.refuse(entry, WANTED_TYPE)),
        };
        let form = match form {
            Some(form) => form,
            None => Form::Quaternion(is_first && !is_named && is_scalar_first(metadata)?),
        };
        Ok(Self { form, beside })
    }

    /// Returns how many numbers a row has.
    pub(crate) fn count(self) -> usize {
        let numbers = match self.form {
            Form::Quaternion(_) => 4,
            Form::Angles(_) | Form::Spin => 3,
        };
        numbers
            + match self.beside {
                Beside::Nothing => 0,
                Beside::Derivative => numbers,
                Beside::Rate(_) => 3,
                Beside::Unused(count) => count,
            }
    }

    /// Returns whether rows have rates that are used.
    pub(crate) fn has_rates(self) -> bool {
        matches!(self.beside, Beside::Derivative | Beside::Rate(_))
    }

    /// Returns what `check` says of what is left out.
    pub(crate) fn note(self) -> Option<&'static str> {
        match (self.form, self.beside) {
            (Form::Spin, _) => Some("speeds of spin and nutation are left out: the attitudes of the rows have them"),
            (_, Beside::Unused(_)) => Some("the rates of version 1 are left out: it does not fix what they are"),
            (_, Beside::Nothing | Beside::Derivative | Beside::Rate(_)) => None,
        }
    }

    /// Returns the state of a row; `None` for a quaternion whose norm is not 1.
    pub(crate) fn state(self, t_ns: i64, values: [f64; MOST_NUMBERS], frames: &Frames<'_>) -> Option<AttitudeState> {
        let [a, b, c, ..] = values;
        let turn = match self.form {
            Form::Quaternion(scalar_first) => quaternion(&values[..4], scalar_first),
            Form::Angles(axes) => turn_of(axes, [a, b, c].map(f64::to_radians)),
            Form::Spin => turn_of(SPIN_AXES, [90.0 + a, 90.0 - b, c].map(f64::to_radians)),
        };
        let body_from_axes = frames.body_from_axes(turn);
        let norm = body_from_axes.length();
        if (norm - 1.0).abs() > WRITTEN_NORM_TOLERANCE || !norm.is_finite() {
            return None;
        }
        let vector =
            |place: usize| DVec3::new(values[place], values[place + 1], values[place + 2]).map(f64::to_radians);
        let rate_rad_s = match (self.beside, self.form) {
            (Beside::Nothing | Beside::Unused(_), _) | (Beside::Derivative, Form::Spin) => None,
            (Beside::Derivative, Form::Quaternion(scalar_first)) => {
                let derivative = frames.body_from_axes(quaternion(&values[4..], scalar_first));
                Some(rate_of_derivative(body_from_axes, derivative))
            }
            (Beside::Derivative, Form::Angles(axes)) => {
                let rate = rate_of(axes, [a, b, c].map(f64::to_radians), vector(3).to_array());
                Some(frames.body_rate(rate, frames.is_to_body, body_from_axes.normalize()))
            }
            (Beside::Rate(is_in_body), form) => {
                let place = if matches!(form, Form::Quaternion(_)) { 4 } else { 3 };
                Some(frames.body_rate(vector(place), is_in_body, body_from_axes.normalize()))
            }
        };
        let body_from_icrf = Rotation::from_quat(body_from_axes.normalize() * frames.axes.rotation_from_icrf());
        Some(AttitudeState { t_ns, body_from_icrf, rate_rad_s })
    }

    /// Refuses rows of a spinning body between which it turns too far to be followed by attitudes alone.
    pub(crate) fn check_steps(
        self,
        metadata: &Metadata<'_>,
        rows: &[(i64, [f64; MOST_NUMBERS])],
        texts: &[Row<'_>],
    ) -> Result<(), HistoryError> {
        if self.form != Form::Spin {
            return Ok(());
        }
        let turn_rad = |pair: &[(i64, [f64; MOST_NUMBERS])]| {
            let [_, _, _, speed_deg_s, ..] = pair[0].1;
            speed_deg_s.to_radians().abs() * s_between(pair[0].0, pair[1].0)
        };
        let Some(place) = rows.windows(2).position(|pair| turn_rad(pair) > MOST_TURN_RAD) else { return Ok(()) };
        let got = format!("a spin of {:.0} deg to the next row", turn_rad(&rows[place..place + 2]).to_degrees());
        let wanted = format!("at most {:.0} deg between rows: write denser rows", MOST_TURN_RAD.to_degrees());
        Err(metadata.source.refuse(texts.get(place).map_or(0, |row| row.offset), &got, &wanted))
    }
}

/// Turns of a spinning body: about z, x and z.
const SPIN_AXES: [DVec3; 3] = [DVec3::Z, DVec3::X, DVec3::Z];

fn quaternion(numbers: &[f64], scalar_first: bool) -> DQuat {
    match *numbers {
        [a, b, c, d] if scalar_first => DQuat::from_xyzw(b, c, d, a),
        [a, b, c, d] => DQuat::from_xyzw(a, b, c, d),
        _ => DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0),
    }
}

/// Returns the quaternion, as CCSDS has it, of turns about these axes, the first one first.
fn turn_of(axes: [DVec3; 3], angles_rad: [f64; 3]) -> DQuat {
    let turns = axes.into_iter().zip(angles_rad);
    turns.fold(DQuat::IDENTITY, |before, (axis, angle_rad)| before * DQuat::from_axis_angle(axis, angle_rad))
}

/// Returns the rate of the axes that are turned so, in these axes, rad/s.
fn rate_of(axes: [DVec3; 3], angles_rad: [f64; 3], rates_rad_s: [f64; 3]) -> DVec3 {
    let turns = axes.into_iter().zip(angles_rad).zip(rates_rad_s);
    turns.fold(DVec3::ZERO, |before, ((axis, angle_rad), rate_rad_s)| {
        DQuat::from_axis_angle(axis, -angle_rad) * before + axis * rate_rad_s
    })
}

/// Returns the axes of EULER_ROT_SEQ: letters in version 2, digits in version 1.
fn angles(metadata: &Metadata<'_>, is_first: bool) -> Result<Form, HistoryError> {
    let entry = metadata.needed("EULER_ROT_SEQ")?;
    let axis = |letter: char| match letter.to_ascii_uppercase() {
        'X' | '1' => Some(DVec3::X),
        'Y' | '2' => Some(DVec3::Y),
        'Z' | '3' => Some(DVec3::Z),
        _ => None,
    };
    let axes: Option<Vec<DVec3>> = entry.value.chars().map(axis).collect();
    let Some(&[a, b, c]) = axes.as_deref().filter(|axes| axes.windows(2).all(|pair| pair[0] != pair[1])) else {
        return Err(metadata.refuse(entry, "three axes such as ZXZ, where neighbours differ"));
    };
    if is_first && [a, b, c] != [DVec3::X, DVec3::Y, DVec3::Z] {
        let wanted = "123: version 1 names its angles X, Y and Z, and programs differ on the order of other sequences; write \
                      version 2, or quaternions";
        return Err(metadata.refuse(entry, wanted));
    }
    Ok(Form::Angles([a, b, c]))
}

fn is_scalar_first(metadata: &Metadata<'_>) -> Result<bool, HistoryError> {
    let wanted = "FIRST or LAST: where the scalar is";
    metadata.choice("QUATERNION_TYPE", [("FIRST", true), ("LAST", false)], wanted)
}

/// Returns whether ANGVEL_FRAME is that of the body.
fn is_rate_in_body(metadata: &Metadata<'_>, frames: &Frames<'_>) -> Result<bool, HistoryError> {
    let axes = metadata.needed("ANGVEL_FRAME")?;
    let [a, b] = [metadata.value("REF_FRAME_A"), metadata.value("REF_FRAME_B")];
    match axes.value {
        "REF_FRAME_A" => Ok(a == Some(frames.body)),
        "REF_FRAME_B" => Ok(b == Some(frames.body)),
        name if name == frames.body => Ok(true),
        name if Some(name) == a || Some(name) == b => Ok(false),
        _ => Err(metadata.refuse(axes, "REF_FRAME_A or REF_FRAME_B, or the name of one of them")),
    }
}

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
        let words = [("A2B", true), ("B2A", false)];
        let is_a_to_b = !is_first || metadata.choice("ATTITUDE_DIR", words, "A2B or B2A")?;
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
