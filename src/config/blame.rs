//! The part of a TOML text that an error is about, and the text without it.

use crate::error::ConfigError;
use core::ops::Range;
use toml::de::{DeTable, DeValue};

/// Returns the text with what `error` is about blanked out, line numbers kept; `None` when that cannot be found, or
/// when the rest is not TOML. `name` is how messages call the document.
pub(super) fn without_the_blamed(text: &str, name: &str, error: &ConfigError) -> Option<String> {
    let parsed = DeTable::parse(text).ok()?;
    let root = parsed.get_ref();
    let range = match error {
        ConfigError::Invalid { place, key, .. } if place.starts_with(name) => range_of_blamed(root, key)?,
        ConfigError::UnknownKey { place, .. } | ConfigError::Syntax { place, .. } => {
            let line: usize = place.strip_prefix(name)?.strip_prefix(':')?.parse().ok()?;
            range_on_line(root, text, line)?
        }
        ConfigError::Invalid { .. }
        | ConfigError::Read { .. }
        | ConfigError::WrongKind { .. }
        | ConfigError::Several { .. } => return None,
    };
    let blanked = blanked(text, with_its_table(text, range))?;
    DeTable::parse(&blanked).is_ok().then_some(blanked)
}

/// Returns the bytes of a key, with its whole table where the table has no meaning without it.
fn range_of_blamed(root: &DeTable<'_>, key: &str) -> Option<Range<usize>> {
    let chooses = key.ends_with(".kind") || key.ends_with(".model");
    let own = range_of_key(root, key);
    let table = key.rsplit_once('.').map(|(table, _)| table).filter(|table| !table.ends_with(']'));
    own.clone().filter(|_| !chooses).or_else(|| range_of_key(root, table?)).or(own)
}

/// Returns the bytes of a key such as `link.bit_rate` or `event[1].for_s`, with its value.
fn range_of_key(root: &DeTable<'_>, key: &str) -> Option<Range<usize>> {
    let mut table = root;
    let mut steps = key.split('.').peekable();
    while let Some(step) = steps.next() {
        let (name, place) = match step.split_once('[') {
            Some((name, rest)) => (name, rest.trim_end_matches(']').parse::<usize>().ok()),
            None => (step, None),
        };
        let (spanned, value) = table.get_key_value(name)?;
        if steps.peek().is_none() {
            return Some(spanned.span().start..value.span().end);
        }
        let value = match (value.get_ref(), place) {
            (DeValue::Array(items), Some(place)) => items.get(place)?.get_ref(),
            (value, _) => value,
        };
        let DeValue::Table(inner) = value else { return None };
        table = inner;
    }
    None
}

/// Returns the innermost key that begins on a line, with its value.
fn range_on_line(table: &DeTable<'_>, text: &str, line: usize) -> Option<Range<usize>> {
    let line_of = |offset: usize| 1 + text.bytes().take(offset).filter(|byte| *byte == b'\n').count();
    table.iter().find_map(|(key, value)| {
        let in_table = |value: &DeValue<'_>| {
            if let DeValue::Table(inner) = value { range_on_line(inner, text, line) } else { None }
        };
        let inner = if let DeValue::Array(items) = value.get_ref() {
            items.iter().find_map(|item| in_table(item.get_ref()))
        } else {
            in_table(value.get_ref())
        };
        let is_here = line_of(key.span().start) == line || line_of(value.span().start) == line;
        inner.or_else(|| is_here.then(|| key.span().start..value.span().end))
    })
}

/// Extends a table's header to all lines below it, up to the next header.
fn with_its_table(text: &str, range: Range<usize>) -> Range<usize> {
    let line_start = text[..range.start].rfind('\n').map_or(0, |end| end + 1);
    if !text[line_start..].trim_start().starts_with('[') {
        return range;
    }
    let mut end = line_start;
    for (number, line) in text[line_start..].split_inclusive('\n').enumerate() {
        if number > 0 && line.trim_start().starts_with('[') {
            break;
        }
        end += line.len();
    }
    line_start..end
}

/// Returns the text with blanks in place of a range; `None` when the range does not end at whole characters.
fn blanked(text: &str, range: Range<usize>) -> Option<String> {
    let inside = text.get(range.clone())?;
    let blanks: String = inside.chars().map(|c| if c == '\n' { '\n' } else { ' ' }).collect();
    Some(format!("{}{blanks}{}", &text[..range.start], &text[range.end..]))
}
