//! A fact of a frame, where it comes from, and the forms in which outputs write it.

use crate::sink::frame::{FrameMeta, SentFrame};
use crate::sink::frame_fault::{ActiveFaults, FaultFlags};
use base::time::{Span, Tai};
use base::{region::Regions, units::DAY_S};
use std::borrow::Cow;

/// Modified Julian date of 1970-01-01T00:00:00.
const UNIX_EPOCH_MJD: f64 = 40_587.0;

/// Sources from which facts are read.
#[derive(Debug, Clone, Copy)]
pub struct FactSource<'a> {
    /// Metadata of the frame.
    pub meta: &'a FrameMeta,
    /// The frame itself; `None` where only its metadata is known.
    pub frame: Option<&'a SentFrame>,
    /// CRC-32 of its pixels; `None` where it has not been computed.
    pub pixel_crc32: Option<u32>,
}

impl<'a> FactSource<'a> {
    /// Returns the facts of a frame without its pixels.
    pub const fn of_meta(meta: &'a FrameMeta) -> Self {
        Self { meta, frame: None, pixel_crc32: None }
    }

    /// Returns the facts of a whole frame, with the checksum of its pixels where it is known.
    pub const fn of_frame(frame: &'a SentFrame, pixel_crc32: Option<u32>) -> Self {
        Self { meta: &frame.meta, frame: Some(frame), pixel_crc32 }
    }
}

/// A fact of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fact<'a> {
    /// This frame does not have it.
    Absent,
    /// Yes or no.
    Flag(bool),
    /// A small number.
    U32(u32),
    /// A large number.
    U64(u64),
    /// A number of objects.
    Count(usize),
    /// A real number.
    Real(f64),
    /// Several real numbers.
    Reals(&'a [f64]),
    /// Several small numbers.
    Wholes(&'a [u32]),
    /// A word.
    Text(&'a str),
    /// An instant.
    Time(Tai),
    /// A duration.
    Span(Span),
    /// A set of commanded faults.
    Faults(FaultFlags),
    /// Faults with their numbers.
    Active(&'a ActiveFaults),
    /// Parts of the image.
    Regions(&'a Regions),
}

/// Kind of a fact, for people.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Yes or no.
    Flag,
    /// 32 bits.
    U32,
    /// 64 bits.
    U64,
    /// A number of objects.
    Count,
    /// Double precision.
    Real,
    /// So many real numbers.
    Reals(usize),
    /// So many 32-bit numbers.
    Wholes(usize),
    /// A word.
    Text,
    /// An instant.
    Time,
    /// A duration.
    Span,
    /// A set of commanded faults.
    Faults,
    /// Faults with their numbers.
    Active,
    /// Parts of the image.
    Regions,
}

impl Kind {
    /// Returns its name for people.
    pub fn name(self) -> String {
        let name = match self {
            Self::Flag => "bool",
            Self::U32 => "u32",
            Self::U64 => "u64",
            Self::Count => "count",
            Self::Real => "f64",
            Self::Reals(count) => return format!("f64[{count}]"),
            Self::Wholes(count) => return format!("u32[{count}]"),
            Self::Text => "text",
            Self::Time => "time",
            Self::Span => "span",
            Self::Faults => "set of faults",
            Self::Active => "list of faults",
            Self::Regions => "list of regions",
        };
        name.into()
    }

    /// Returns true when a fact is of this kind, or absent.
    pub fn fits(self, fact: Fact<'_>) -> bool {
        match fact {
            Fact::Absent => true,
            Fact::Flag(_) => self == Self::Flag,
            Fact::U32(_) => self == Self::U32,
            Fact::U64(_) => self == Self::U64,
            Fact::Count(_) => self == Self::Count,
            Fact::Real(_) => self == Self::Real,
            Fact::Reals(all) => self == Self::Reals(all.len()),
            Fact::Wholes(all) => self == Self::Wholes(all.len()),
            Fact::Text(_) => self == Self::Text,
            Fact::Time(_) => self == Self::Time,
            Fact::Span(_) => self == Self::Span,
            Fact::Faults(_) => self == Self::Faults,
            Fact::Active(_) => self == Self::Active,
            Fact::Regions(_) => self == Self::Regions,
        }
    }
}

/// Form in which an output writes a fact.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// The value unchanged: times as UTC text, spans in seconds, sets of faults and lists of faults as text.
    Plain,
    /// The number itself; left out when it is not finite.
    Finite,
    /// An instant as modified Julian date, UTC, days.
    Mjd,
    /// An instant (TAI since 1970) or a duration in nanoseconds.
    Ns,
    /// A duration in milliseconds.
    Ms,
    /// A duration, or a real number of seconds, in microseconds.
    Us,
    /// A set of faults as bits.
    Bits,
    /// A set of faults as a list of names, where the output has lists; else as text.
    Names,
    /// The number of faults or regions.
    Number,
    /// Eight hexadecimal digits.
    Hex,
}

/// One element of a fact as an output writes it.
#[derive(Debug, Clone, PartialEq)]
pub enum Scalar<'a> {
    /// No value is written.
    Absent,
    /// Yes or no.
    Flag(bool),
    /// A whole number.
    Whole(i128),
    /// A real number.
    Real(f64),
    /// Text.
    Text(Cow<'a, str>),
}

impl Scalar<'_> {
    /// Returns the whole number; 0 of everything else.
    pub fn whole(&self) -> i128 {
        match self {
            Self::Whole(number) => *number,
            Self::Flag(is_so) => i128::from(*is_so),
            Self::Absent | Self::Real(_) | Self::Text(_) => 0,
        }
    }

    /// Returns the real number; no number of everything else.
    pub fn real(&self) -> f64 {
        match self {
            Self::Real(number) => *number,
            Self::Absent | Self::Flag(_) | Self::Whole(_) | Self::Text(_) => f64::NAN,
        }
    }

    /// Returns the text; an empty one of everything else.
    pub fn text(&self) -> &str {
        match self {
            Self::Text(text) => text,
            Self::Absent | Self::Flag(_) | Self::Whole(_) | Self::Real(_) => "",
        }
    }
}

impl<'a> Fact<'a> {
    /// Returns how many elements it has: of a list its length, 0 when it is absent, else 1.
    pub const fn elements(self) -> usize {
        match self {
            Self::Absent => 0,
            Self::Reals(all) => all.len(),
            Self::Wholes(all) => all.len(),
            Self::Flag(_)
            | Self::U32(_)
            | Self::U64(_)
            | Self::Count(_)
            | Self::Real(_)
            | Self::Text(_)
            | Self::Time(_)
            | Self::Span(_)
            | Self::Faults(_)
            | Self::Active(_)
            | Self::Regions(_) => 1,
        }
    }

    /// Returns one element in a form; a fact other than a list has the same element everywhere. A form that does not go
    /// with the fact leaves it unchanged.
    pub fn element(self, place: usize, form: Form) -> Scalar<'a> {
        match self {
            Self::Absent => Scalar::Absent,
            Self::Flag(is_so) => Scalar::Flag(is_so),
            Self::U32(number) if form == Form::Hex => Scalar::Text(format!("{number:08x}").into()),
            Self::U32(number) => Scalar::Whole(number.into()),
            Self::U64(number) => Scalar::Whole(number.into()),
            Self::Count(count) => whole(count),
            Self::Real(value) => real(value, form),
            Self::Reals(all) => all.get(place).map_or(Scalar::Absent, |value| real(*value, form)),
            Self::Wholes(all) => all.get(place).map_or(Scalar::Absent, |value| Scalar::Whole((*value).into())),
            Self::Text(text) => Scalar::Text(text.into()),
            Self::Time(at) => time(at, form),
            Self::Span(span) => duration(span, form),
            Self::Faults(faults) if form == Form::Bits => Scalar::Whole(faults.bits().into()),
            Self::Faults(faults) => Scalar::Text(faults.to_string().into()),
            Self::Active(active) if form == Form::Number => whole(active.count()),
            Self::Active(active) => Scalar::Text(active.to_string().into()),
            Self::Regions(regions) if regions.is_whole() => Scalar::Absent,
            Self::Regions(regions) if form == Form::Number => whole(regions.as_slice().len()),
            Self::Regions(regions) => Scalar::Text(regions.to_string().into()),
        }
    }
}

fn whole<'a>(count: usize) -> Scalar<'a> {
    Scalar::Whole(i128::try_from(count).unwrap_or(i128::MAX))
}

fn real<'a>(value: f64, form: Form) -> Scalar<'a> {
    if form == Form::Finite && !value.is_finite() {
        return Scalar::Absent;
    }
    Scalar::Real(if form == Form::Us { value * 1e6 } else { value })
}

fn time<'a>(at: Tai, form: Form) -> Scalar<'a> {
    match form {
        Form::Mjd => Scalar::Real(UNIX_EPOCH_MJD + at.unix_s() / DAY_S),
        Form::Ns => Scalar::Whole(at.ns().into()),
        Form::Plain | Form::Finite | Form::Ms | Form::Us | Form::Bits | Form::Names | Form::Number | Form::Hex => {
            Scalar::Text(at.to_rfc3339().into())
        }
    }
}

fn duration<'a>(span: Span, form: Form) -> Scalar<'a> {
    match form {
        Form::Ns => Scalar::Whole(span.ns().into()),
        Form::Ms => Scalar::Real(span.ms()),
        Form::Us => Scalar::Real(span.ns() as f64 * 1e-3),
        Form::Plain | Form::Finite | Form::Mjd | Form::Bits | Form::Names | Form::Number | Form::Hex => {
            Scalar::Real(span.s())
        }
    }
}
