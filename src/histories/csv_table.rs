//! Tables of text: remarks after `#`, a header that names columns, rows split by comma, semicolon, tab or blanks.

use crate::epoch::{TimeSystem, WANTED_EPOCH};
use crate::error::{HistoryError, Source};
use base::time::{Span, Tai};
use base::units::NS_PER_S;

/// A table that is taken apart line by line.
pub(crate) struct Table<'a> {
    pub(crate) source: Source<'a>,
    /// `# key: value` of remarks before the first row.
    remarks: Vec<(&'a str, &'a str, usize)>,
    /// Names of columns, and the line they are in; `None` where the first line is a row.
    header: Option<(Vec<&'a str>, usize)>,
}

/// Time column of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum TimeColumn {
    /// Seconds from a zero that the file does not name.
    Seconds,
    /// Nanoseconds of TAI since 1970.
    TaiNs,
    /// Seconds of Unix time.
    UnixS,
    /// A date in this system.
    Date(TimeSystem),
}

/// Names of time columns, those that say more first.
const TIME_COLUMNS: [(&str, TimeColumn); 15] = [
    ("tai_ns", TimeColumn::TaiNs),
    ("mid_exposure_tai_ns", TimeColumn::TaiNs),
    ("utc", TimeColumn::Date(TimeSystem::Utc)),
    ("mid_exposure_utc", TimeColumn::Date(TimeSystem::Utc)),
    ("tai", TimeColumn::Date(TimeSystem::Tai)),
    ("tt", TimeColumn::Date(TimeSystem::Tt)),
    ("tdb", TimeColumn::Date(TimeSystem::Tdb)),
    ("gps", TimeColumn::Date(TimeSystem::Gps)),
    ("unix_s", TimeColumn::UnixS),
    ("t_s", TimeColumn::Seconds),
    ("time_s", TimeColumn::Seconds),
    ("t", TimeColumn::Seconds),
    ("time", TimeColumn::Seconds),
    ("seconds", TimeColumn::Seconds),
    ("s", TimeColumn::Seconds),
];
/// Columns of time as messages list them.
pub(crate) const WANTED_TIME: &str = "a column of time: t_s, utc, tai, tt, tdb, gps, unix_s or tai_ns";

impl<'a> Table<'a> {
    /// Reads remarks and header.
    pub(crate) fn new(source: Source<'a>) -> Self {
        let (mut remarks, mut header) = (Vec::new(), None);
        for (line, number) in source.text.trim_start_matches('\u{feff}').lines().zip(1..) {
            let line = line.trim();
            if let Some(remark) = line.strip_prefix('#') {
                let parts = remark.split_once(':').or_else(|| remark.split_once('='));
                remarks.extend(parts.map(|(key, value)| (key.trim(), value.trim(), number)));
            } else if !line.is_empty() {
                let is_header = line.starts_with(|c: char| c.is_ascii_alphabetic() || c == '"');
                header = is_header.then(|| (split(without_remark(line)), number));
                break;
            }
        }
        Self { source, remarks, header }
    }

    /// Returns the value of a remark, and its line.
    pub(crate) fn remark(&self, key: &str) -> Option<(&'a str, usize)> {
        let found = self.remarks.iter().find(|(known, _, _)| known.eq_ignore_ascii_case(key));
        found.map(|(_, value, line)| (*value, *line))
    }

    /// Returns the names of columns.
    pub(crate) fn columns(&self) -> Option<&[&'a str]> {
        self.header.as_ref().map(|(columns, _)| columns.as_slice())
    }

    /// Returns the place of a column that has one of these names.
    pub(crate) fn column(&self, names: &[&str]) -> Option<usize> {
        let columns = self.columns()?;
        names.iter().find_map(|name| columns.iter().position(|column| column.eq_ignore_ascii_case(name)))
    }

    /// Returns the columns of these groups of names; an error where one is missing.
    pub(crate) fn columns_of<const N: usize>(&self, names: [&str; N]) -> Result<[usize; N], HistoryError> {
        let mut places = [0; N];
        for (place, name) in places.iter_mut().zip(names) {
            *place = self.column(&[name]).ok_or_else(|| self.without(&format!("a column {name}")))?;
        }
        Ok(places)
    }

    /// Returns the error of a header that lacks something.
    pub(crate) fn without(&self, wanted: &str) -> HistoryError {
        let (columns, line) = self.header.as_ref().map_or((String::new(), 1), |(names, line)| (names.join(","), *line));
        self.source.at_line(line, &columns, wanted)
    }

    /// Refuses a header that has a name twice: one of the columns would be passed over.
    fn check_names(&self) -> Result<(), HistoryError> {
        let Some((names, line)) = &self.header else { return Ok(()) };
        let is_second = |(place, name): &(usize, &&str)| {
            !name.is_empty() && names[..*place].iter().any(|known| known.eq_ignore_ascii_case(name))
        };
        let Some((_, name)) = names.iter().enumerate().find(is_second) else { return Ok(()) };
        Err(self.refuse(*line, name, "each name of a column once"))
    }

    /// Returns the time column that says most.
    pub(crate) fn time_column(&self) -> Result<(TimeColumn, usize), HistoryError> {
        self.check_names()?;
        let found = TIME_COLUMNS.iter().find_map(|(name, kind)| Some((*kind, self.column(&[name])?)));
        found.ok_or_else(|| self.without(WANTED_TIME))
    }

    /// Returns the rows, each with its line, split.
    pub(crate) fn rows(&self) -> impl Iterator<Item = (usize, Vec<&'a str>)> + use<'_, 'a> {
        let after = self.header.as_ref().map_or(0, |(_, line)| *line);
        let lines = self.source.text.trim_start_matches('\u{feff}').lines().zip(1..);
        let lines = lines.filter(move |(_, number)| *number > after);
        let lines = lines.map(|(line, number)| (number, without_remark(line)));
        lines.filter(|(_, line)| !line.is_empty()).map(|(number, line)| (number, split(line)))
    }

    /// Reads the rows by segments: where the column `segment` changes, a new one begins.
    pub(crate) fn segments<S>(
        &self,
        count: usize,
        read: impl Fn(usize, &[&'a str]) -> Result<S, HistoryError>,
    ) -> Result<Vec<Vec<S>>, HistoryError> {
        let segment = self.column(&["segment"]);
        let mut parts: Vec<(Option<&str>, Vec<S>)> = Vec::new();
        for (line, row) in self.rows() {
            if row.len() != count {
                return Err(self.refuse(line, &format!("{} values", row.len()), &format!("{count} values in a row")));
            }
            let part = segment.and_then(|place| row.get(place).copied());
            let state = read(line, &row)?;
            match parts.last_mut().filter(|(last, _)| *last == part) {
                Some((_, states)) => states.push(state),
                None => parts.push((part, vec![state])),
            }
        }
        Ok(parts.into_iter().map(|(_, states)| states).collect())
    }

    /// Returns the error of a row.
    pub(crate) fn refuse(&self, line: usize, got: &str, wanted: &str) -> HistoryError {
        self.source.at_line(line, got, wanted)
    }

    /// Reads a finite number of a row.
    pub(crate) fn number(&self, line: usize, row: &[&str], place: usize) -> Result<f64, HistoryError> {
        let word = row.get(place).copied().unwrap_or_default();
        let number = word.parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| self.refuse(line, word, &format!("a finite number in column {}", place + 1)))
    }

    /// Reads the time of a row: nanoseconds of TAI, or since the zero of the file.
    pub(crate) fn time_ns(
        &self,
        line: usize,
        row: &[&str],
        (kind, place): (TimeColumn, usize),
    ) -> Result<i64, HistoryError> {
        let word = row.get(place).copied().unwrap_or_default();
        match kind {
            TimeColumn::Seconds => {
                let t_s = self.number(line, row, place)?;
                let is_counted = t_s.abs() < MOST_S;
                is_counted.then(|| Span::from_s(t_s).ns()).ok_or_else(|| self.refuse(line, word, WANTED_S))
            }
            TimeColumn::TaiNs => {
                let t_ns = word.parse().ok().filter(|t_ns| COUNTED_NS.contains(t_ns));
                t_ns.ok_or_else(|| self.refuse(line, word, "nanoseconds of TAI since 1970, years 1682 to 2258"))
            }
            TimeColumn::UnixS => {
                unix_ns(word).map(|ns| Tai::from_unix_ns(ns).ns()).ok_or_else(|| self.refuse(line, word, WANTED_S))
            }
            TimeColumn::Date(system) => {
                system.read(word).map(Tai::ns).ok_or_else(|| self.refuse(line, word, WANTED_EPOCH))
            }
        }
    }
}

/// Nanoseconds since 1970 whose dates can be written and read in every time system.
pub(crate) const COUNTED_NS: core::ops::Range<i64> = -9_100_000_000_000_000_000..9_100_000_000_000_000_000;
/// Longest time from a zero, s: 158 years.
const MOST_S: f64 = 5e9;
const WANTED_S: &str = "seconds, fewer than 5e9";

/// Returns nanoseconds of decimal seconds, exact.
fn unix_ns(word: &str) -> Option<i64> {
    let (whole, decimals) = word.split_once('.').unwrap_or((word, ""));
    let s = whole.parse::<i64>().ok().filter(|s| (0..5_000_000_000).contains(s))?;
    let is_number = decimals.bytes().all(|byte| byte.is_ascii_digit());
    let nine: String = decimals.chars().chain("000000000".chars()).take(9).collect();
    is_number.then(|| nine.parse::<i64>().ok())?.map(|ns| s * NS_PER_S + ns)
}

/// Returns a line up to its remark: a `#` at its start, or behind a blank or a separator. Within a word it is text.
fn without_remark(line: &str) -> &str {
    let begins = |at: usize| line[..at].ends_with([' ', '\t', ',', ';']) || at == 0;
    let end = line.match_indices('#').map(|(at, _)| at).find(|at| begins(*at));
    line[..end.unwrap_or(line.len())].trim()
}

/// Splits at commas, or at semicolons, tabs or blanks where there is none of those before.
fn split(line: &str) -> Vec<&str> {
    match [',', ';', '\t'].into_iter().find(|separator| line.contains(*separator)) {
        Some(separator) => line.split(separator).map(|word| word.trim().trim_matches('"')).collect(),
        None => line.split_whitespace().map(|word| word.trim_matches('"')).collect(),
    }
}
