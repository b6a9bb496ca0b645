//! The form in which a tracker answers: the convention of its roll, and the turn from its axes to the sensor's.
//!
//! | roll | its angle is | programs and where they say so |
//! |---|---|---|
//! | `up` | from north to image up, positive through east | starloop; LOST: `SphericalToQuaternion` in `src/attitude-utils.cpp`, with image up +z and left +y in `src/camera.cpp` |
//! | `north` | from image up to north, positive counter-clockwise in the image: the opposite of `up` | tetra3 and cedar-solve: `Roll` in `solve_from_centroids` of `tetra3.py` |
//! | `down` | from north to image down (+y), positive through east: 180 deg more than `up` | `orientation` of astrometry.net (`tan_get_orientation` in `util/sip.c`) where rows count from the top, as in this program's images; openstartracker: `print_ori` in `beast/beast.h`; tetra3rs: `roll_deg` in `python/src/solve_result.rs` |

use anyhow::{Error, Result, bail};
use base::axes::{Rotation, Sensor, WRITTEN_NORM_TOLERANCE, sensor_from_ra_dec_roll};
use core::{fmt, str::FromStr};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// Direction that an angle called roll belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "&'static str")]
pub enum Roll {
    /// Position angle of image up.
    Up,
    /// Angle of north from image up, counter-clockwise.
    North,
    /// Position angle of image down.
    Down,
}

impl Roll {
    /// Conventions by their own words and by the programs that have them.
    pub const WORDS: [(&'static str, Self); 10] = [
        ("up", Self::Up),
        ("starloop", Self::Up),
        ("lost", Self::Up),
        ("north", Self::North),
        ("tetra3", Self::North),
        ("cedar-solve", Self::North),
        ("down", Self::Down),
        ("astrometry", Self::Down),
        ("openstartracker", Self::Down),
        ("tetra3rs", Self::Down),
    ];

    /// Returns the attitude `sensor_from_icrf` of three angles in degrees.
    ///
    /// # Errors
    /// When one is out of range.
    pub fn attitude(self, [ra_deg, dec_deg, roll_deg]: [f64; 3]) -> Result<DQuat> {
        if !(-90.0..=90.0).contains(&dec_deg) {
            bail!("got a declination of {dec_deg}, wanted -90 to 90 deg");
        }
        if let Some(angle) = [ra_deg, roll_deg].into_iter().find(|angle| !(-360.0..=360.0).contains(angle)) {
            bail!("got {angle}, wanted a right ascension and a roll of -360 to 360 deg");
        }
        let up_deg = match self {
            Self::Up => roll_deg,
            Self::North => -roll_deg,
            Self::Down => roll_deg - 180.0,
        };
        Ok(sensor_from_ra_dec_roll(ra_deg.to_radians(), dec_deg.to_radians(), up_deg.to_radians()).quat())
    }
}

impl FromStr for Roll {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match Self::WORDS.iter().find(|(word, _)| *word == text) {
            Some((_, roll)) => Ok(*roll),
            None => bail!("roll: got \"{text}\", wanted {}", Self::WORDS.map(|(word, _)| word).join(", ")),
        }
    }
}

impl TryFrom<String> for Roll {
    type Error = Error;

    fn try_from(text: String) -> Result<Self> {
        text.parse()
    }
}

impl From<Roll> for &'static str {
    fn from(roll: Roll) -> Self {
        Roll::WORDS.iter().find(|(_, known)| *known == roll).map_or("", |(word, _)| word)
    }
}

/// The constant turn from a tracker's axes to the sensor's, `sensor_from_tracker`.
///
/// As a text: four numbers w, x, y, z, or the tracker's axes along the sensor's, such as `-y -z x` for a tracker whose +x
/// is the boresight, +y image left and +z image up.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "WrittenAxes", into = "[f64; 4]")]
pub struct Axes(DQuat);

#[derive(Deserialize)]
#[serde(untagged, expecting = "wanted axes such as \"-y -z x\", or a list of four numbers w, x, y, z")]
enum WrittenAxes {
    Text(String),
    Numbers([f64; 4]),
}

/// The words of an axis map.
const AXIS_WORDS: [(&str, DVec3); 6] = [
    ("x", DVec3::X),
    ("-x", DVec3::NEG_X),
    ("y", DVec3::Y),
    ("-y", DVec3::NEG_Y),
    ("z", DVec3::Z),
    ("-z", DVec3::NEG_Z),
];

impl Axes {
    /// Returns the turn of a quaternion.
    pub fn of(sensor_from_tracker: DQuat) -> Self {
        Self(sensor_from_tracker)
    }

    /// Returns the quaternion `sensor_from_tracker`.
    pub fn quat(self) -> DQuat {
        self.0
    }

    /// Returns its components, scalar first and not negative.
    pub fn wxyz(self) -> [f64; 4] {
        Rotation::<Sensor, Sensor>::from_quat(self.0).wxyz()
    }

    /// Returns every map of axes that is right-handed, with its words.
    pub fn maps() -> impl Iterator<Item = (String, Self)> {
        let pairs = AXIS_WORDS.into_iter().flat_map(|one| AXIS_WORDS.into_iter().map(move |other| (one, other)));
        pairs.filter_map(|((right, x), (down, y))| {
            let (boresight, z) = AXIS_WORDS.into_iter().find(|(_, axis)| *axis == x.cross(y))?;
            Some((format!("{right} {down} {boresight}"), Self::of_map([x, y, z])))
        })
    }

    fn of_map([right, down, boresight]: [DVec3; 3]) -> Self {
        Self(Rotation::<Sensor, Sensor>::from_axes(right, down, boresight).quat())
    }

    fn of_numbers(wxyz: [f64; 4]) -> Result<Self> {
        match Rotation::<Sensor, Sensor>::from_wxyz(wxyz, WRITTEN_NORM_TOLERANCE) {
            Some(turn) => Ok(Self(turn.quat())),
            None => {
                bail!("axes: got {wxyz:?}, wanted a quaternion w, x, y, z of norm 1 within {WRITTEN_NORM_TOLERANCE}")
            }
        }
    }
}

impl FromStr for Axes {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let words: Vec<&str> = text.split([' ', ',', '[', ']']).filter(|word| !word.is_empty()).collect();
        let numbers: Vec<f64> = words.iter().filter_map(|word| word.parse().ok()).collect();
        if let (Ok(wxyz), 4) = (<[f64; 4]>::try_from(numbers), words.len()) {
            return Self::of_numbers(wxyz);
        }
        let axis = |word: &&str| AXIS_WORDS.iter().find(|(name, _)| name == word).map(|(_, axis)| *axis);
        let axes: Vec<DVec3> = words.iter().filter_map(axis).collect();
        let Ok(axes) = <[DVec3; 3]>::try_from(axes) else {
            bail!(
                "axes: got \"{text}\", wanted the tracker's axes along image right, image down and the boresight, such as \
                 \"-y -z x\", or four numbers w, x, y, z"
            );
        };
        if axes[0].cross(axes[1]) != axes[2] {
            bail!(
                "axes: got \"{text}\", wanted right-handed ones: the third is the product of the first and the second"
            );
        }
        Ok(Self::of_map(axes))
    }
}

impl TryFrom<WrittenAxes> for Axes {
    type Error = Error;

    fn try_from(written: WrittenAxes) -> Result<Self> {
        match written {
            WrittenAxes::Text(text) => text.parse(),
            WrittenAxes::Numbers(wxyz) => Self::of_numbers(wxyz),
        }
    }
}

impl From<Axes> for [f64; 4] {
    fn from(axes: Axes) -> Self {
        axes.wxyz()
    }
}

impl fmt::Display for Axes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [w, x, y, z] = self.wxyz();
        write!(f, "[{w:.9}, {x:.9}, {y:.9}, {z:.9}]")
    }
}

/// Statements about a log, in it or beside it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct LogForm {
    /// Convention of the roll of right ascension, declination and roll.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roll: Option<Roll>,
    /// From the tracker's axes to the sensor's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axes: Option<Axes>,
    /// Attitudes stay in the tracker's own axes, for finding the turn.
    #[serde(skip)]
    pub is_unturned: bool,
}

impl LogForm {
    /// Returns these statements, each in place of another's.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self { roll: self.roll.or(other.roll), axes: self.axes.or(other.axes), is_unturned: self.is_unturned }
    }

    /// Adds the remarks in front of a log.
    ///
    /// # Errors
    /// When a remark cannot be read, or says another thing than what is stated beside the log.
    pub(crate) fn with_remarks(self, text: &str) -> Result<Self> {
        // Files of attitudes name the reference of their attitudes so.
        let axes = remark(text, "axes").filter(|axes| *axes != "ICRF");
        let of_log = Self {
            roll: remark(text, "roll").map(str::parse).transpose()?,
            axes: axes.map(str::parse).transpose()?,
            is_unturned: false,
        };
        let is_other = |one: Option<Roll>, other: Option<Roll>| one.is_some() && other.is_some() && one != other;
        if is_other(self.roll, of_log.roll) {
            bail!("# roll: another one than is stated beside the log; leave one of them out");
        }
        if let (Some(one), Some(other)) = (self.axes, of_log.axes)
            && one.quat().dot(other.quat()).abs() < 1.0 - 1e-9
        {
            bail!("# axes: other ones than are stated beside the log; leave one of them out");
        }
        Ok(self.or(of_log))
    }

    /// Returns an attitude in the sensor's axes.
    pub(crate) fn turned(&self, tracker_from_icrf: DQuat) -> DQuat {
        match self.axes {
            Some(axes) if !self.is_unturned => (axes.quat() * tracker_from_icrf).normalize(),
            Some(_) | None => tracker_from_icrf,
        }
    }
}

/// Returns the value of a remark `# key: value` in front of the rows of a log; of several, the last one's.
pub(crate) fn remark<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    let before = text.lines().map(str::trim).take_while(|line| line.is_empty() || line.starts_with('#'));
    let value = |line: &'a str| line.trim_start_matches(['#', ' ']).strip_prefix(key)?.strip_prefix(':').map(str::trim);
    before.filter_map(value).last()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::attitude_error;

    const ANGLES: [f64; 3] = [83.8, -5.4, 37.0];

    /// Image up, image left and the boresight of an attitude, ICRF axes.
    fn directions(attitude: DQuat) -> [DVec3; 3] {
        [DVec3::NEG_Y, DVec3::NEG_X, DVec3::Z].map(|axis| attitude.conjugate() * axis)
    }

    /// North, and east of it, at a direction.
    fn compass(boresight: DVec3) -> [DVec3; 2] {
        let east = DVec3::Z.cross(boresight).normalize();
        [boresight.cross(east), east]
    }

    #[test]
    fn rolls_are_the_angles_that_their_programs_compute() {
        let [ra, dec, roll] = ANGLES.map(f64::to_radians);
        // LOST: the conjugate of turns about z by ra, y by -dec, x by -roll; +x boresight, +y left, +z up.
        let turns = DQuat::from_rotation_z(ra) * DQuat::from_rotation_y(-dec) * DQuat::from_rotation_x(-roll);
        let lost = "-y -z x".parse::<Axes>().unwrap().quat() * turns.conjugate();
        let ours = Roll::Up.attitude(ANGLES).unwrap();
        assert!(attitude_error(lost, ours).length() < 1e-12);
        // tetra3: atan2 of the north parts of image left and image up.
        let [up, left, boresight] = directions(Roll::North.attitude(ANGLES).unwrap());
        assert!((left.z.atan2(up.z) - roll).abs() < 1e-12);
        assert!((boresight.z.asin() - dec).abs() < 1e-12);
        // openstartracker: -atan2 of the north parts of image right and image down.
        let [up, left, boresight] = directions(Roll::Down.attitude(ANGLES).unwrap());
        assert!((-(-left.z).atan2(-up.z) - roll).abs() < 1e-12);
        // tetra3rs and astrometry.net: the position angle of image down.
        let [north, east] = compass(boresight);
        assert!(((-up).dot(east).atan2((-up).dot(north)) - roll).abs() < 1e-12);
        let others = [Roll::North, Roll::Down].map(|other| other.attitude(ANGLES).unwrap());
        assert!(others.iter().all(|other| attitude_error(*other, ours).length() > 1.0), "they differ");
    }

    #[test]
    fn an_axis_map_names_the_trackers_axes_along_the_sensors() {
        let axes: Axes = "-y -z x".parse().unwrap();
        assert!((axes.quat() * DVec3::X - DVec3::Z).length() < 1e-15, "the tracker's x is the boresight");
        assert!((axes.quat() * DVec3::Y - DVec3::NEG_X).length() < 1e-15, "its y is image left");
        let numbers = axes.to_string().parse::<Axes>().unwrap();
        assert!(attitude_error(numbers.quat(), axes.quat()).length() < 1e-8, "{axes}");
        assert_eq!(Axes::maps().count(), 24);
        for (words, map) in Axes::maps() {
            assert_eq!(words.parse::<Axes>().unwrap(), map, "{words}");
        }
    }

    #[test]
    fn axes_and_rolls_that_cannot_be_are_refused() {
        let refused = |text: &str| text.parse::<Axes>().unwrap_err().to_string();
        assert!(refused("x y -z").contains("right-handed"));
        assert!(refused("x y").contains("wanted the tracker's axes along"));
        assert!(refused("1 1 0 0").contains("norm 1"));
        assert!(refused("1 x 0 0").contains("wanted the tracker's axes along"));
        assert!("tetra".parse::<Roll>().unwrap_err().to_string().contains("wanted up, starloop, lost"));
        let angle = |angles| Roll::Up.attitude(angles).unwrap_err().to_string();
        assert!(angle([10.0, 91.0, 0.0]).contains("declination of 91"));
        assert!(angle([361.0, 0.0, 0.0]).contains("got 361"));
    }

    #[test]
    fn remarks_and_statements_beside_a_log_are_one() {
        let log = "# my tracker: v2\n# roll: tetra3\n# axes: y z x\nframe,ra\n";
        let form = LogForm::default().with_remarks(log).unwrap();
        assert_eq!((form.roll, form.axes), (Some(Roll::North), Some("y z x".parse().unwrap())));
        let stated = |roll, axes: &str| LogForm { roll, axes: Some(axes.parse().unwrap()), is_unturned: false };
        assert!(stated(Some(Roll::North), "y z x").with_remarks(log).is_ok());
        assert!(stated(Some(Roll::Up), "y z x").with_remarks(log).unwrap_err().to_string().contains("# roll"));
        assert!(stated(None, "x y z").with_remarks(log).unwrap_err().to_string().contains("# axes"));
        assert_eq!(remark("frame\n# roll: up\n", "roll"), None, "behind the header");
        let of_attitudes = "# sense: body_from_icrf\n# axes: ICRF\ntai_ns,q_w\n";
        assert_eq!(LogForm::default().with_remarks(of_attitudes).unwrap(), LogForm::default(), "a file of attitudes");
        assert!(LogForm::default().with_remarks(&of_attitudes.replace("ICRF", "TEME")).is_err(), "control");
    }
}
