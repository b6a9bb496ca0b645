//! Values of a segment's metadata, with errors that name their line.

use crate::epoch::{TimeSystem, WANTED_EPOCH, WANTED_SYSTEM};
use crate::error::{HistoryError, Source};
use crate::message::{Entry, Row, Segment};
use crate::{attitude_methods::MOST_DEGREE, findings, segments::Unfit};
use base::time::Tai;

/// The interpolation that a segment asks for.
pub(crate) struct Wanted<'m> {
    /// In capitals.
    pub(crate) name: String,
    pub(crate) degree: Option<usize>,
    pub(crate) entry: &'m Entry<'m>,
}

/// Keywords of a segment that AEM and OEM share.
const KEYS: [&str; 14] = [
    "OBJECT_NAME",
    "OBJECT_ID",
    "CENTER_NAME",
    "TIME_SYSTEM",
    "START_TIME",
    "STOP_TIME",
    "USEABLE_START_TIME",
    "USEABLE_STOP_TIME",
    "USABLE_START_TIME",
    "USABLE_STOP_TIME",
    "INTERPOLATION",
    "INTERPOLATION_METHOD",
    "INTERPOLATION_DEGREE",
    "COMMENT",
];

/// The metadata of one segment.
#[derive(Clone, Copy)]
pub(crate) struct Metadata<'m> {
    pub(crate) source: Source<'m>,
    pub(crate) segment: &'m Segment<'m>,
}

impl<'m> Metadata<'m> {
    pub(crate) fn find(&self, key: &str) -> Option<&'m Entry<'m>> {
        self.segment.metadata.iter().find(|entry| entry.key == key)
    }

    pub(crate) fn value(&self, key: &str) -> Option<&'m str> {
        self.find(key).map(|entry| entry.value)
    }

    pub(crate) fn needed(&self, key: &str) -> Result<&'m Entry<'m>, HistoryError> {
        self.find(key).ok_or_else(|| self.source.refuse(self.segment.offset, "a segment without it", key))
    }

    pub(crate) fn refuse(&self, entry: &Entry<'_>, wanted: &str) -> HistoryError {
        self.source.refuse(entry.offset, &format!("{} = {}", entry.key, entry.value), wanted)
    }

    /// Returns the error of an interpolation that is not followed, with the degree that the file gives.
    pub(crate) fn refuse_method(&self, entry: &Entry<'_>, degree: Option<usize>, wanted: &str) -> HistoryError {
        let degree = degree.map_or_else(|| "without a degree".to_owned(), |degree| format!("of degree {degree}"));
        self.source.refuse(entry.offset, &format!("{} = {} {degree}", entry.key, entry.value), wanted)
    }

    /// Returns the error of rows that make no segment.
    pub(crate) fn unfit(&self, unfit: &Unfit) -> HistoryError {
        let row = match unfit {
            Unfit::Rows { row: Some(row), .. } => self.segment.rows.get(row - 1),
            Unfit::Rows { row: None, .. } | Unfit::NotUsable => None,
        };
        self.source.because(row.map_or(self.segment.offset, |row| row.offset), &unfit.to_string())
    }

    /// Reads a value that is one of these words.
    pub(crate) fn choice<T>(&self, key: &str, words: [(&str, T); 2], wanted: &str) -> Result<T, HistoryError> {
        let entry = self.needed(key)?;
        let found = words.into_iter().find(|(word, _)| *word == entry.value);
        found.map(|(_, value)| value).ok_or_else(|| self.refuse(entry, wanted))
    }

    /// Reads the time system.
    pub(crate) fn time_system(&self) -> Result<TimeSystem, HistoryError> {
        let entry = self.needed("TIME_SYSTEM")?;
        TimeSystem::of_name(entry.value).ok_or_else(|| self.refuse(entry, WANTED_SYSTEM))
    }

    /// Reads the optional beginning and end of what may be used.
    pub(crate) fn usable_ns(&self, system: TimeSystem) -> Result<[Option<i64>; 2], HistoryError> {
        let time = |key: &str| {
            let Some(entry) = self.find(key) else { return Ok(None) };
            system.read(entry.value).map(|at| Some(at.ns())).ok_or_else(|| self.refuse(entry, WANTED_EPOCH))
        };
        // Version 1 spells them so; newer messages may not.
        let begin = time("USEABLE_START_TIME")?.or(time("USABLE_START_TIME")?);
        Ok([begin, time("USEABLE_STOP_TIME")?.or(time("USABLE_STOP_TIME")?)])
    }

    /// Refuses rows outside START_TIME and STOP_TIME: one of them is wrong. Returns a warning of rows that begin much later
    /// or end much earlier.
    pub(crate) fn check_times(&self, system: TimeSystem, rows_ns: &[i64]) -> Result<Option<String>, HistoryError> {
        let mut stated = [Tai::from_ns(0); 2];
        let ends = [rows_ns.first(), rows_ns.last()].map(|t_ns| Tai::from_ns(t_ns.copied().unwrap_or_default()));
        for (place, key) in ["START_TIME", "STOP_TIME"].into_iter().enumerate() {
            let entry = self.needed(key)?;
            let at = system.read(entry.value).ok_or_else(|| self.refuse(entry, WANTED_EPOCH))?;
            if if place == 0 { at > ends[0] } else { at < ends[1] } {
                return Err(self.refuse(entry, "a time that lets every row of the segment be inside"));
            }
            stated[place] = at;
        }
        let line = self.source.line(self.segment.offset);
        Ok(findings::shorter(&format!("the rows of the segment in line {line}"), rows_ns, stated))
    }

    /// Returns a warning of the keywords that its message does not have; one of a unit is refused.
    pub(crate) fn unknown_keys(&self, known: &[&str]) -> Result<Option<String>, HistoryError> {
        let is_known =
            |entry: &&Entry<'_>| known.iter().chain(&KEYS).any(|known| entry.key.eq_ignore_ascii_case(known));
        let mut unknown = self.segment.metadata.iter().filter(|entry| !is_known(entry)).peekable();
        let Some(first) = unknown.peek() else { return Ok(None) };
        let words = format!("{} = {}", first.key, first.value);
        let line = self.source.line(first.offset);
        if let Some(unit) = unknown.find(|entry| entry.key.to_ascii_uppercase().contains("UNIT")) {
            return Err(
                self.refuse(unit, "no such keyword: the units of the message are kilometres, seconds and degrees")
            );
        }
        Ok(Some(format!("{words} (line {line}) is a keyword that this message does not have: it is not used")))
    }

    /// Reads the optional name and degree of the interpolation, the name in capitals.
    pub(crate) fn interpolation(&self) -> Result<Option<Wanted<'m>>, HistoryError> {
        let Some(method) = self.find("INTERPOLATION_METHOD").or_else(|| self.find("INTERPOLATION")) else {
            return match self.find("INTERPOLATION_DEGREE") {
                None => Ok(None),
                Some(entry) => {
                    Err(self.refuse(entry, "the method too: INTERPOLATION (OEM) or INTERPOLATION_METHOD (AEM)"))
                }
            };
        };
        let degree = match self.find("INTERPOLATION_DEGREE") {
            None => None,
            Some(entry) => {
                let degree = entry.value.parse::<usize>().ok().filter(|degree| (1..=MOST_DEGREE).contains(degree));
                let wanted = format!("a degree of 1 to {MOST_DEGREE}");
                Some(degree.ok_or_else(|| self.refuse(entry, &wanted))?)
            }
        };
        Ok(Some(Wanted { name: method.value.to_ascii_uppercase(), degree, entry: method }))
    }
}

/// Adds what is not yet in the notes.
pub(crate) fn note<'s>(notes: &mut Vec<String>, said: impl IntoIterator<Item = &'s str>) {
    for sentence in said {
        if !notes.iter().any(|known| known == sentence) {
            notes.push(sentence.into());
        }
    }
}

/// Reads a row of an epoch and `N` to `most` finite numbers; returns how many numbers there are.
pub(crate) fn numbers<const N: usize>(
    source: &Source<'_>,
    row: &Row<'_>,
    system: TimeSystem,
    counts: &[usize],
) -> Result<(Tai, [f64; N]), HistoryError> {
    let mut words = row.text.split_whitespace();
    let epoch = words.next().unwrap_or_default();
    let at = system.read(epoch).ok_or_else(|| source.refuse(row.offset, epoch, WANTED_EPOCH))?;
    let mut values = [0.0; N];
    let mut count = 0;
    for word in words {
        let number = word.parse().ok().filter(|number: &f64| number.is_finite());
        let number = number.ok_or_else(|| source.refuse(row.offset, word, "a finite number"))?;
        if let Some(value) = values.get_mut(count) {
            *value = number;
        }
        count += 1;
    }
    if !counts.contains(&count) {
        let wanted: Vec<String> = counts.iter().map(ToString::to_string).collect();
        let wanted = format!("a time and {} numbers", wanted.join(" or "));
        return Err(source.refuse(row.offset, &format!("a time and {count} numbers"), &wanted));
    }
    Ok((at, values))
}
