//! The types of values that keys may have, each with its limit.

use crate::{check::Rule, error::with_what_was_meant};
use core::{fmt, marker::PhantomData, ops::RangeInclusive};

/// A type of values.
pub(super) trait KeyType {
    /// As serde reads it.
    type Raw: Clone;
    /// As a declaration says it.
    type Default: Clone + fmt::Display + Into<toml::Value>;
    /// Type of the limit of a value.
    type Limit;
    /// As the program takes it.
    type Checked;

    /// Returns a default as if it were given.
    fn raw(default: &Self::Default) -> Self::Raw;

    /// Returns the value, when it is within the limit.
    fn read(raw: &Self::Raw, limit: &Self::Limit) -> Result<Self::Checked, Refusal>;

    /// Returns the limit as messages say it.
    fn wanted(limit: &Self::Limit) -> String;

    /// Returns the limit as reference and schema say it.
    fn shape(limit: &Self::Limit) -> Shape;
}

/// A value outside its limit.
#[derive(Debug)]
pub(super) struct Refusal {
    pub(super) got: String,
    pub(super) wanted: String,
}

impl Refusal {
    fn new(got: impl fmt::Display, wanted: String) -> Self {
        Self { got: got.to_string(), wanted }
    }
}

/// The form of a value.
#[derive(Debug, Clone)]
pub(super) enum Shape {
    /// A number.
    Number(Rule),
    /// A whole number.
    Whole(RangeInclusive<i64>),
    /// One of a few words.
    Words(Vec<&'static str>),
    /// A text: what it says.
    Text(&'static str),
    /// True or false.
    Flag,
    /// A list of so many.
    Row(usize, Box<Shape>),
    /// A list of any length.
    List(Box<Shape>),
    /// One of two forms.
    Either(Box<[Shape; 2]>),
    /// A table: what it has.
    Table(&'static str),
}

impl Shape {
    /// Returns a list of so many numbers.
    pub(super) fn numbers(count: usize) -> Self {
        Self::Row(count, Box::new(Self::Number(Rule::Finite)))
    }

    /// Returns a list of pairs of numbers.
    pub(super) fn pairs() -> Self {
        Self::list(Self::numbers(2))
    }

    /// Returns a list.
    pub(super) fn list(of: Self) -> Self {
        Self::List(Box::new(of))
    }

    /// Returns one of two forms.
    pub(super) fn either(one: Self, other: Self) -> Self {
        Self::Either(Box::new([one, other]))
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(rule) => {
                write!(f, "{}", rule.to_string().trim_start_matches("a finite ").trim_start_matches("a "))
            }
            Self::Whole(range) => write!(f, "{}", Whole::<u32>::wanted(range).trim_start_matches("a ")),
            Self::Words(words) => write!(f, "\"{}\"", words.join("\", \"")),
            Self::Text(what) => f.write_str(what),
            Self::Table(what) => write!(f, "table: {what}"),
            Self::Flag => f.write_str("true or false"),
            Self::Row(count, of) => write!(f, "list of {count}: {of}"),
            Self::List(of) => write!(f, "list of: {of}"),
            Self::Either(forms) => write!(f, "{}; or {}", forms[0], forms[1]),
        }
    }
}

impl KeyType for f64 {
    type Raw = f64;
    type Default = f64;
    type Limit = Rule;
    type Checked = f64;

    fn raw(default: &f64) -> f64 {
        *default
    }

    fn read(raw: &f64, limit: &Rule) -> Result<f64, Refusal> {
        if limit.is_met_by(*raw) { Ok(*raw) } else { Err(Refusal::new(raw, limit.to_string())) }
    }

    fn wanted(limit: &Rule) -> String {
        limit.to_string()
    }

    fn shape(limit: &Rule) -> Shape {
        Shape::Number(*limit)
    }
}

/// A whole number that `N` holds.
#[derive(Debug)]
pub(super) struct Whole<N = u32>(PhantomData<N>);

impl<N: TryFrom<i64>> KeyType for Whole<N> {
    type Raw = i64;
    type Default = i64;
    type Limit = RangeInclusive<i64>;
    type Checked = N;

    fn raw(default: &i64) -> i64 {
        *default
    }

    fn read(raw: &i64, limit: &RangeInclusive<i64>) -> Result<N, Refusal> {
        let fits = Some(*raw).filter(|raw| limit.contains(raw)).and_then(|raw| N::try_from(raw).ok());
        fits.ok_or_else(|| Refusal::new(raw, Self::wanted(limit)))
    }

    fn wanted(limit: &RangeInclusive<i64>) -> String {
        match (limit.start(), limit.end()) {
            (least, &i64::MAX) => format!("a whole number, {least} or more"),
            (least, most) => format!("a whole number from {least} to {most}"),
        }
    }

    fn shape(limit: &RangeInclusive<i64>) -> Shape {
        Shape::Whole(limit.clone())
    }
}

/// One of a few words, each for a value of type `T`.
#[derive(Debug)]
pub(super) struct Word<T>(PhantomData<T>);

/// Words with what they mean.
pub(super) type Words<T> = Vec<(&'static str, T)>;

impl<T: Copy> KeyType for Word<T> {
    type Raw = String;
    type Default = &'static str;
    type Limit = Words<T>;
    type Checked = T;

    fn raw(default: &&'static str) -> String {
        (*default).into()
    }

    fn read(raw: &String, words: &Words<T>) -> Result<T, Refusal> {
        let found = words.iter().find(|(known, _)| known == raw).map(|(_, meant)| *meant);
        found.ok_or_else(|| Refusal {
            got: with_what_was_meant(raw, words.iter().map(|(word, _)| *word)),
            wanted: Self::wanted(words),
        })
    }

    fn wanted(words: &Words<T>) -> String {
        let words: Vec<&str> = words.iter().map(|(word, _)| *word).collect();
        format!("one of \"{}\"", words.join("\", \""))
    }

    fn shape(words: &Words<T>) -> Shape {
        Shape::Words(words.iter().map(|(word, _)| *word).collect())
    }
}

/// A text, as a default.
#[derive(Debug, Clone)]
pub(super) struct TextDefault(String);

impl fmt::Display for TextDefault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl<S: Into<String>> From<S> for TextDefault {
    fn from(text: S) -> Self {
        Self(text.into())
    }
}

impl From<TextDefault> for toml::Value {
    fn from(text: TextDefault) -> Self {
        Self::String(text.0)
    }
}

impl KeyType for String {
    type Raw = String;
    type Default = TextDefault;
    /// Kind of text, such as a path.
    type Limit = &'static str;
    type Checked = String;

    fn raw(default: &TextDefault) -> String {
        default.0.clone()
    }

    fn read(raw: &String, _: &&'static str) -> Result<String, Refusal> {
        Ok(raw.clone())
    }

    fn wanted(limit: &&'static str) -> String {
        format!("a {limit}")
    }

    fn shape(limit: &&'static str) -> Shape {
        Shape::Text(limit)
    }
}

/// True or false need no limit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Any;

impl KeyType for bool {
    type Raw = bool;
    type Default = bool;
    type Limit = Any;
    type Checked = bool;

    fn raw(default: &bool) -> bool {
        *default
    }

    fn read(raw: &bool, _: &Any) -> Result<bool, Refusal> {
        Ok(*raw)
    }

    fn wanted(_: &Any) -> String {
        "true or false".into()
    }

    fn shape(_: &Any) -> Shape {
        Shape::Flag
    }
}

/// So many numbers, as a default.
#[derive(Debug, Clone, Copy)]
pub(super) struct Numbers<const N: usize>(pub(super) [f64; N]);

impl<const N: usize> fmt::Display for Numbers<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "[{}]", self.0.map(|number| number.to_string()).join(", "))
    }
}

impl<const N: usize> From<Numbers<N>> for toml::Value {
    fn from(numbers: Numbers<N>) -> Self {
        Self::Array(numbers.0.map(Self::Float).into())
    }
}

/// Each number is within the limit.
impl<const N: usize> KeyType for [f64; N] {
    type Raw = [f64; N];
    type Default = Numbers<N>;
    type Limit = Rule;
    type Checked = [f64; N];

    fn raw(default: &Numbers<N>) -> [f64; N] {
        default.0
    }

    fn read(raw: &[f64; N], limit: &Rule) -> Result<[f64; N], Refusal> {
        raw.iter().try_for_each(|number| f64::read(number, limit).map(drop))?;
        Ok(*raw)
    }

    fn wanted(_: &Rule) -> String {
        let count = ["no", "one", "two", "three", "four"].get(N).copied().unwrap_or("so many");
        format!("{count} finite numbers")
    }

    fn shape(limit: &Rule) -> Shape {
        Shape::Row(N, Box::new(Shape::Number(*limit)))
    }
}

/// Anything else that serde reads; the section's code checks it.
#[derive(Debug)]
pub(super) struct Raw<T>(PhantomData<T>);

impl<T: Clone> KeyType for Raw<T> {
    type Raw = T;
    type Default = Undefaulted;
    type Limit = Shape;
    type Checked = T;

    fn raw(default: &Undefaulted) -> T {
        match *default {}
    }

    fn read(raw: &T, _: &Shape) -> Result<T, Refusal> {
        Ok(raw.clone())
    }

    fn wanted(_: &Shape) -> String {
        "a value".into()
    }

    fn shape(limit: &Shape) -> Shape {
        limit.clone()
    }
}

/// A default that cannot be.
#[derive(Debug, Clone, Copy)]
pub(super) enum Undefaulted {}

impl fmt::Display for Undefaulted {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {}
    }
}

impl From<Undefaulted> for toml::Value {
    fn from(never: Undefaulted) -> Self {
        match never {}
    }
}
