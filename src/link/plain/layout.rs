//! Which numbers a plain message has, in which order, form and units.

use super::{FIELDS_MAX, PlainAttitude, PlainRecord, PlainReject, PlainState, PlainTime};
use base::axes::WRITTEN_NORM_TOLERANCE;
use core::fmt::Write;
use serde_json::{Map, Value};

/// Form of the numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// Packed IEEE 754 doubles, little-endian.
    F64Le,
    /// Packed IEEE 754 doubles, big-endian.
    F64Be,
    /// A JSON object with the names of the fields, or an array in the order of the layout.
    Json,
    /// Numbers between blanks or commas, in the order of the layout.
    Text,
    /// Lines of the simulator 42, of the spacecraft with this number.
    FortyTwo(u16),
}

/// Sense of the quaternion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QuaternionSense {
    /// Sense of starloop and SPICE: a body turned by +a about x has x = -sin(a/2).
    Starloop,
    /// Sense of most other programs: a body turned by +a about x has x = +sin(a/2).
    Conjugate,
}

/// Meaning of the time of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeMeaning {
    /// The sender's clock since any epoch, Unix time or another; its offset and drift are estimated. 0: the arrival.
    Tag,
    /// The time is ignored: values are valid when their message arrives.
    Arrival,
}

/// A layout that cannot be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum LayoutError {
    /// The name of the field is unknown.
    #[error("it is not the name of a field")]
    Unknown,
    /// A field is there twice.
    #[error("it has the field \"{0}\" twice")]
    Twice(&'static str),
    /// A vector is there in part.
    #[error("it lacks the field \"{0}\" of a vector")]
    Torn(&'static str),
    /// The layout has no value that a frame needs.
    #[error("it has neither an attitude nor jitter nor an observer")]
    Empty,
    /// The time is missing.
    #[error("it has no \"t\", which time = \"tag\" needs")]
    NoTime,
    /// Too many fields.
    #[error("it has more than {FIELDS_MAX} fields")]
    TooLong,
}

/// The layout of a message: its numbers, their order, form and units.
#[derive(Debug, Clone, PartialEq)]
pub struct PlainLayout {
    /// The numbers in their order.
    pub fields: Vec<Field>,
    /// Their form.
    pub encoding: Encoding,
    /// Sense of the quaternion.
    pub sense: QuaternionSense,
    /// Radians in a unit of angle of rate and acceleration: 1 or pi/180.
    pub angle_unit_rad: f64,
    /// Nanoseconds in a unit of time.
    pub time_unit_ns: f64,
    /// Meaning of the time.
    pub time: TimeMeaning,
}

impl Default for PlainLayout {
    /// Returns the default layout, eight little-endian doubles: seconds of any clock or 0, quaternion w x y z, rate in
    /// rad/s.
    fn default() -> Self {
        use Field::{Quaternion, Rate, Time};
        let quaternion = (0..4).map(Quaternion);
        let fields = [Time].into_iter().chain(quaternion).chain((0..3).map(Rate)).collect();
        Self {
            fields,
            encoding: Encoding::F64Le,
            sense: QuaternionSense::Starloop,
            angle_unit_rad: 1.0,
            time_unit_ns: 1e9,
            time: TimeMeaning::Tag,
        }
    }
}

/// The numbers of one message by their field.
#[derive(Debug, Clone, Copy)]
pub(super) struct Values {
    time: f64,
    q: [f64; 4],
    rate: [f64; 3],
    acceleration: [f64; 3],
    jitter: [f64; 3],
    position: [f64; 3],
    velocity: [f64; 3],
    pub(super) sequence: Option<f64>,
}

impl Values {
    pub(super) const NONE: Self = Self {
        time: 0.0,
        q: [0.0; 4],
        rate: [0.0; 3],
        acceleration: [0.0; 3],
        jitter: [0.0; 3],
        position: [0.0; 3],
        velocity: [0.0; 3],
        sequence: None,
    };

    pub(super) fn put(&mut self, field: Field, value: f64) {
        match field {
            Field::Time => self.time = value,
            Field::Quaternion(i) => self.q[i] = value,
            Field::Rate(i) => self.rate[i] = value,
            Field::Acceleration(i) => self.acceleration[i] = value,
            Field::Jitter(i) => self.jitter[i] = value,
            Field::Position(i) => self.position[i] = value,
            Field::Velocity(i) => self.velocity[i] = value,
            Field::Sequence => self.sequence = Some(value),
            Field::Skip => {}
        }
    }

    pub(super) fn get(&self, field: Field) -> f64 {
        match field {
            Field::Time => self.time,
            Field::Quaternion(i) => self.q[i],
            Field::Rate(i) => self.rate[i],
            Field::Acceleration(i) => self.acceleration[i],
            Field::Jitter(i) => self.jitter[i],
            Field::Position(i) => self.position[i],
            Field::Velocity(i) => self.velocity[i],
            Field::Sequence => self.sequence.unwrap_or(0.0),
            Field::Skip => 0.0,
        }
    }
}

const ARCSEC_RAD: f64 = core::f64::consts::PI / 648_000.0;

impl PlainLayout {
    /// Reads a list of names of fields.
    ///
    /// # Errors
    /// When a name is unknown or given twice, or the list is too long; with the place of the name in it.
    pub fn fields_of(names: &[String]) -> Result<Vec<Field>, (usize, LayoutError)> {
        let mut fields = Vec::new();
        for (place, name) in names.iter().enumerate() {
            let field = Field::of_name(name.trim()).ok_or((place, LayoutError::Unknown))?;
            if field != Field::Skip && fields.contains(&field) {
                return Err((place, LayoutError::Twice(field.name())));
            }
            if place >= FIELDS_MAX {
                return Err((place, LayoutError::TooLong));
            }
            fields.push(field);
        }
        Ok(fields)
    }

    /// Checks that vectors are whole and that something of use is in it.
    ///
    /// # Errors
    /// When a part is missing.
    pub fn check(&self) -> Result<(), LayoutError> {
        let torn = |fields: &[Field]| fields.iter().find(|field| !self.has(**field)).map(|field| field.name());
        let (q, w) = ([0, 1, 2, 3].map(Field::Quaternion), [0, 1, 2].map(Field::Rate));
        let a = [0, 1, 2].map(Field::Acceleration);
        let j = [0, 1, 2].map(Field::Jitter);
        let (r, v) = ([0, 1, 2].map(Field::Position), [0, 1, 2].map(Field::Velocity));
        let attitude: Vec<Field> = q.into_iter().chain(w).collect();
        let state: Vec<Field> = r.into_iter().chain(v).collect();
        for group in [&attitude[..], &a, &j, &state] {
            let has_any = group.iter().any(|field| self.has(*field));
            if let Some(name) = torn(group).filter(|_| has_any) {
                return Err(LayoutError::Torn(name));
            }
        }
        if self.has(a[0]) && !self.has(q[0]) {
            return Err(LayoutError::Torn("q_w"));
        }
        if ![q[0], j[0], r[0]].into_iter().any(|field| self.has(field)) {
            return Err(LayoutError::Empty);
        }
        if self.time != TimeMeaning::Arrival && !self.has(Field::Time) {
            return Err(LayoutError::NoTime);
        }
        Ok(())
    }

    fn has(&self, field: Field) -> bool {
        self.fields.contains(&field)
    }

    /// Returns bytes of each message, where all have the same; `None` for text.
    pub fn record_bytes(&self) -> Option<usize> {
        match self.encoding {
            Encoding::F64Le | Encoding::F64Be => Some(self.fields.len() * size_of::<f64>()),
            Encoding::Json | Encoding::Text | Encoding::FortyTwo(_) => None,
        }
    }

    /// Converts the values of a message to a record in starloop's units and conventions.
    pub(super) fn record(&self, values: &Values) -> Result<PlainRecord, PlainReject> {
        if self.fields.iter().any(|field| !values.get(*field).is_finite()) {
            return Err(PlainReject::NotFinite);
        }
        let attitude = self.has(Field::Quaternion(0)).then(|| self.attitude(values)).transpose()?;
        let jitter_rad = self.has(Field::Jitter(0)).then(|| values.jitter.map(|arcsec| arcsec * ARCSEC_RAD));
        let state = || PlainState { position_km: values.position, velocity_km_s: values.velocity };
        let observer = self.has(Field::Position(0)).then(state);
        Ok(PlainRecord { time: self.time_of(values.time)?, attitude, jitter_rad, observer })
    }

    fn attitude(&self, values: &Values) -> Result<PlainAttitude, PlainReject> {
        let norm = values.q.iter().map(|component| component * component).sum::<f64>().sqrt();
        if (norm - 1.0).abs() > WRITTEN_NORM_TOLERANCE {
            return Err(PlainReject::QuaternionNorm);
        }
        let radians = |vector: [f64; 3]| vector.map(|component| component * self.angle_unit_rad);
        Ok(PlainAttitude {
            q_wxyz: self.turned(values.q),
            rate_rad_s: radians(values.rate),
            acceleration_rad_s2: radians(values.acceleration),
        })
    }

    /// Converts the message's sense of the quaternion to starloop's, and back.
    fn turned(&self, [w, x, y, z]: [f64; 4]) -> [f64; 4] {
        match self.sense {
            QuaternionSense::Starloop => [w, x, y, z],
            QuaternionSense::Conjugate => [w, -x, -y, -z],
        }
    }

    #[allow(clippy::cast_possible_truncation, reason = "within the range of i64, as is checked")]
    fn time_of(&self, time: f64) -> Result<PlainTime, PlainReject> {
        const MOST_NS: f64 = 9.2e18;
        let ns = (time * self.time_unit_ns).round();
        // NaN is not a time either.
        let is_possible = ns.abs() <= MOST_NS;
        match self.time {
            TimeMeaning::Arrival => Ok(PlainTime::Arrival),
            TimeMeaning::Tag if !is_possible => Err(PlainReject::Time),
            TimeMeaning::Tag if time == 0.0 => Ok(PlainTime::Arrival),
            TimeMeaning::Tag => Ok(PlainTime::Tag(ns as i64)),
        }
    }

    /// Converts a record to the values of its message.
    pub(super) fn values(&self, record: &PlainRecord, sequence: u32) -> Values {
        let mut values = Values { sequence: Some(f64::from(sequence)), ..Values::NONE };
        values.time = match record.time {
            PlainTime::Arrival => 0.0,
            PlainTime::Tag(ns) => ns as f64 / self.time_unit_ns,
        };
        if let Some(attitude) = &record.attitude {
            let units = |vector: [f64; 3]| vector.map(|component| component / self.angle_unit_rad);
            values.q = self.turned(attitude.q_wxyz);
            values.rate = units(attitude.rate_rad_s);
            values.acceleration = units(attitude.acceleration_rad_s2);
        }
        if let Some(jitter_rad) = record.jitter_rad {
            values.jitter = jitter_rad.map(|rad| rad / ARCSEC_RAD);
        }
        if let Some(state) = &record.observer {
            (values.position, values.velocity) = (state.position_km, state.velocity_km_s);
        }
        values
    }
}

// The fields that a layout may name.

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

// Bytes of one message -> its values, by form; and back. Reading packed numbers allocates nothing.

/// Reads the values of a message of packed numbers, JSON or text.
pub(super) fn read(layout: &PlainLayout, bytes: &[u8]) -> Result<Values, PlainReject> {
    match layout.encoding {
        Encoding::F64Le => packed(layout, bytes, f64::from_le_bytes),
        Encoding::F64Be => packed(layout, bytes, f64::from_be_bytes),
        Encoding::Json => json(layout, bytes),
        Encoding::Text => text(layout, bytes),
        // Its lines have a reader of their own.
        Encoding::FortyTwo(_) => Err(PlainReject::Length),
    }
}

fn packed(layout: &PlainLayout, bytes: &[u8], number: fn([u8; 8]) -> f64) -> Result<Values, PlainReject> {
    let (words, rest) = bytes.as_chunks::<8>();
    if words.len() != layout.fields.len() || !rest.is_empty() {
        return Err(PlainReject::Length);
    }
    let mut values = Values::NONE;
    words.iter().zip(&layout.fields).for_each(|(word, field)| values.put(*field, number(*word)));
    Ok(values)
}

fn text(layout: &PlainLayout, bytes: &[u8]) -> Result<Values, PlainReject> {
    let text = core::str::from_utf8(bytes).map_err(|_| PlainReject::Text)?;
    let is_between = |c: char| c.is_ascii_whitespace() || matches!(c, ',' | ';');
    let mut words = text.split(is_between).filter(|word| !word.is_empty());
    let mut values = Values::NONE;
    for field in &layout.fields {
        let word = words.next().ok_or(PlainReject::Length)?;
        values.put(*field, word.parse().map_err(|_| PlainReject::Number)?);
    }
    if words.next().is_some() { Err(PlainReject::Length) } else { Ok(values) }
}

fn json(layout: &PlainLayout, bytes: &[u8]) -> Result<Values, PlainReject> {
    let value: Value = serde_json::from_slice(bytes).map_err(|_| PlainReject::Json)?;
    let mut values = Values::NONE;
    for (place, field) in layout.fields.iter().enumerate().filter(|(_, field)| **field != Field::Skip) {
        let found = match &value {
            Value::Array(row) if row.len() == layout.fields.len() => row.get(place),
            Value::Array(_) => return Err(PlainReject::Length),
            Value::Object(table) => match table.get(field.name()) {
                None => component(table, layout, *field)?,
                number => number,
            },
            Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => return Err(PlainReject::Json),
        };
        let number = found.ok_or(PlainReject::FieldMissing)?;
        values.put(*field, number.as_f64().ok_or(PlainReject::Number)?);
    }
    Ok(values)
}

/// Returns a component from a vector of its name, whose order is that of the layout: `"q": [w, x, y, z]`; a
/// longer one is another vector.
fn component<'v>(
    table: &'v Map<String, Value>,
    layout: &PlainLayout,
    field: Field,
) -> Result<Option<&'v Value>, PlainReject> {
    let vector = field.vector().and_then(|name| table.get(name)).and_then(Value::as_array);
    let Some(vector) = vector else { return Ok(None) };
    let of_vector = || layout.fields.iter().filter(|other| other.vector() == field.vector());
    if vector.len() > of_vector().count() {
        return Err(PlainReject::Length);
    }
    Ok(of_vector().position(|other| *other == field).and_then(|place| vector.get(place)))
}

/// Writes the message of values.
pub(super) fn write(layout: &PlainLayout, values: &Values) -> Vec<u8> {
    let numbers = layout.fields.iter().map(|field| values.get(*field));
    match layout.encoding {
        Encoding::F64Le => numbers.flat_map(f64::to_le_bytes).collect(),
        Encoding::F64Be => numbers.flat_map(f64::to_be_bytes).collect(),
        Encoding::Json => json_line(layout, values).into_bytes(),
        Encoding::Text => numbers.map(|number| number.to_string()).collect::<Vec<_>>().join(" ").into_bytes(),
        Encoding::FortyTwo(_) => Vec::new(),
    }
}

fn json_line(layout: &PlainLayout, values: &Values) -> String {
    let mut line = String::from("{");
    for field in layout.fields.iter().filter(|field| **field != Field::Skip) {
        let comma = if line.len() > 1 { "," } else { "" };
        let _ = write!(line, "{comma}\"{}\":{}", field.name(), values.get(*field)); // a String takes everything
    }
    line + "}"
}
