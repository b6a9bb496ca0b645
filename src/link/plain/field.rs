//! The fields that a layout may name.

/// One number of a plain message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Field {
    /// Time.
    Time,
    /// Component of the quaternion, counted w x y z.
    Quaternion(usize),
    /// Component of the angular rate, body axes.
    Rate(usize),
    /// Component of the angular acceleration, body axes.
    Acceleration(usize),
    /// Component of the line of sight's rotation vector, body axes, arcsec.
    Jitter(usize),
    /// Component of the observer's position, km.
    Position(usize),
    /// Component of the observer's velocity, km/s.
    Velocity(usize),
    /// Number of the message.
    Sequence,
    /// A number that is left unread.
    Skip,
}

/// Every field with its name.
pub const FIELD_NAMES: [(&str, Field); 22] = [
    ("t", Field::Time),
    ("q_w", Field::Quaternion(0)),
    ("q_x", Field::Quaternion(1)),
    ("q_y", Field::Quaternion(2)),
    ("q_z", Field::Quaternion(3)),
    ("w_x", Field::Rate(0)),
    ("w_y", Field::Rate(1)),
    ("w_z", Field::Rate(2)),
    ("a_x", Field::Acceleration(0)),
    ("a_y", Field::Acceleration(1)),
    ("a_z", Field::Acceleration(2)),
    ("j_x", Field::Jitter(0)),
    ("j_y", Field::Jitter(1)),
    ("j_z", Field::Jitter(2)),
    ("r_x", Field::Position(0)),
    ("r_y", Field::Position(1)),
    ("r_z", Field::Position(2)),
    ("v_x", Field::Velocity(0)),
    ("v_y", Field::Velocity(1)),
    ("v_z", Field::Velocity(2)),
    ("seq", Field::Sequence),
    ("skip", Field::Skip),
];

impl Field {
    /// Returns the field of a name.
    pub fn of_name(name: &str) -> Option<Self> {
        FIELD_NAMES.iter().find(|(known, _)| *known == name).map(|(_, field)| *field)
    }

    /// Returns its name.
    pub fn name(self) -> &'static str {
        FIELD_NAMES.iter().find(|(_, field)| *field == self).map_or("", |(name, _)| name)
    }

    /// Returns the name of the vector that it is a component of, as JSON may have it; `None` for a number of its own.
    pub(super) fn vector(self) -> Option<&'static str> {
        self.name().split_once('_').map(|(vector, _)| vector)
    }
}
