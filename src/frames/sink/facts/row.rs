//! One row of the table: a fact, and by which names the outputs have it.

use super::value::{Fact, FactSource, Form, Kind};

/// A fact, its meaning, and its places in the outputs; an empty list: that output does not have it.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    /// Name, as fields of the program are named.
    pub name: &'static str,
    /// Unit of the value; empty for none. Outputs with another one say so in their names.
    pub unit: &'static str,
    /// Kind of the value.
    pub kind: Kind,
    /// Meaning of the value.
    pub about: &'static str,
    /// Reads it.
    pub value: for<'a> fn(&FactSource<'a>) -> Fact<'a>,
    /// Cards of FITS files, one per element, or several of a fact of one element.
    pub fits: &'static [Card],
    /// Part of the header that has them.
    pub part: Part,
    /// Columns of `frames.csv`, one per element, or several of a fact of one element.
    pub csv: &'static [Column],
    /// Place in the 256 bytes before a frame in shared memory.
    pub memory: Option<Place>,
    /// Features of the network camera's chunk data, one per element.
    pub chunk: &'static [Feature],
    /// Keys of `frame` in the live view's `/state.json`.
    pub live: &'static [Key],
    /// Keys in the control socket's answer about a frame.
    pub control: &'static [Key],
    /// Keys in the object `meta` of that answer.
    pub control_meta: &'static [Key],
}

/// A FITS card: keyword, form, comment. The element is counted by the cards before it in the row. A list of faults has
/// three cards for each fault, one of regions a card for each, with its number behind the keyword.
#[derive(Debug, Clone, Copy)]
pub struct Card(pub &'static str, pub Form, pub &'static str);

/// A column of `frames.csv`: name and form.
#[derive(Debug, Clone, Copy)]
pub struct Column(pub &'static str, pub Form);

/// A key of a JSON object: name and form.
#[derive(Debug, Clone, Copy)]
pub struct Key(pub &'static str, pub Form);

/// A place in a slot's head: first byte, storage of each element, form.
#[derive(Debug, Clone, Copy)]
pub struct Place(pub usize, pub Stored, pub Form);

/// Storage of an element in a slot's head; a number that is too large becomes the largest one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stored {
    /// 4 bytes.
    U32,
    /// 8 bytes.
    U64,
    /// 8 bytes, signed.
    I64,
    /// 8 bytes, double precision.
    F64,
}

impl Stored {
    /// Returns the bytes of one element.
    pub const fn bytes(self) -> usize {
        match self {
            Self::U32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    /// Returns its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::U32 => "u32",
            Self::U64 => "u64",
            Self::I64 => "i64",
            Self::F64 => "f64",
        }
    }
}

/// A feature of the chunk data. Its place counts features from 0, without gaps: a new one takes the next number.
#[derive(Debug, Clone, Copy)]
pub struct Feature {
    /// Number among all features.
    pub place: usize,
    /// Name for clients.
    pub name: &'static str,
    /// Storage form.
    pub kind: FeatureKind,
    /// Form of the value.
    pub form: Form,
    /// Unit; empty for none.
    pub unit: &'static str,
    /// Meaning of the key.
    pub about: &'static str,
}

/// Storage form of a feature.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FeatureKind {
    /// Whole number, signed, 8 bytes.
    Integer,
    /// Whole number without sign, 8 bytes; clients show it as GenICam's signed integer of the same bits.
    Bits,
    /// Number, double precision.
    Float,
    /// Text, padded with zeros.
    Text,
}

/// Part of a FITS header, in the order of the header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// Identity of the camera.
    Camera,
    /// Identity of the frame.
    Frame,
    /// Times.
    Time,
    /// Attitude and motion.
    Attitude,
    /// Making of the frame.
    Making,
    /// Pixels and focal length; the map to the sky comes after it.
    Optics,
    /// The detector's numbers and the image's: only in files of DN.
    Detector,
}

impl Part {
    /// Every part that files of electrons have as well.
    pub const OF_EVERY_FILE: [Self; 6] =
        [Self::Camera, Self::Frame, Self::Time, Self::Attitude, Self::Making, Self::Optics];
}

/// Returns a row that no output has yet.
pub(super) const fn row(
    name: &'static str,
    kind: Kind,
    unit: &'static str,
    about: &'static str,
    value: for<'a> fn(&FactSource<'a>) -> Fact<'a>,
) -> Row {
    let (fits, part, csv, memory, chunk) = (&[], Part::Making, &[], None, &[]);
    let (live, control, control_meta) = (&[], &[], &[]);
    Row { name, unit, kind, about, value, fits, part, csv, memory, chunk, live, control, control_meta }
}

/// Returns a feature of the chunk data.
pub(super) const fn feature(
    place: usize,
    name: &'static str,
    kind: FeatureKind,
    form: Form,
    unit: &'static str,
    about: &'static str,
) -> Feature {
    Feature { place, name, kind, form, unit, about }
}

impl Row {
    /// Returns the row with cards in FITS files.
    pub(super) const fn fits(self, part: Part, fits: &'static [Card]) -> Self {
        Self { part, fits, ..self }
    }

    /// Returns the row with columns in the frame log.
    pub(super) const fn csv(self, csv: &'static [Column]) -> Self {
        Self { csv, ..self }
    }

    /// Returns the row with a place in shared memory.
    pub(super) const fn memory(self, first_byte: usize, stored: Stored, form: Form) -> Self {
        Self { memory: Some(Place(first_byte, stored, form)), ..self }
    }

    /// Returns the row with features in the chunk data.
    pub(super) const fn chunk(self, chunk: &'static [Feature]) -> Self {
        Self { chunk, ..self }
    }

    /// Returns the row with keys in the live view.
    pub(super) const fn live(self, live: &'static [Key]) -> Self {
        Self { live, ..self }
    }

    /// Returns the row with keys in the control socket's answer.
    pub(super) const fn control(self, control: &'static [Key]) -> Self {
        Self { control, ..self }
    }

    /// Returns the row with keys in `meta` of that answer.
    pub(super) const fn control_meta(self, control_meta: &'static [Key]) -> Self {
        Self { control_meta, ..self }
    }
}
