//! Header cards: 80 ASCII characters each, `KEYWORD = value / comment`.
//!
//! Numbers end in column 30 (fixed format) unless all their digits need more; then they run on, which the standard
//! allows for every keyword that is not mandatory. Text starts in column 11. What does not fit is cut, what is not
//! printable ASCII becomes `?`, a number that is not finite becomes an undefined value: FITS has no NaN in headers.

use std::borrow::Cow;

/// Characters in one card.
pub const CARD_BYTES: usize = 80;
/// Columns before the value.
const VALUE_COLUMN: usize = 10;
/// Column where fixed-format values end.
const FIXED_END: usize = 30;

/// One header record.
pub type Card = [u8; CARD_BYTES];

/// The value of a keyword.
#[derive(Debug, Clone, PartialEq)]
pub enum Value<'a> {
    /// A keyword without a value.
    Undefined,
    /// `T` or `F`.
    Logical(bool),
    /// An integer; wide enough for every 64-bit type.
    Integer(i128),
    /// A real number, written with the fewest digits that read back exactly.
    Real(f64),
    /// Text.
    Text(Cow<'a, str>),
}

impl From<bool> for Value<'_> {
    fn from(value: bool) -> Self {
        Self::Logical(value)
    }
}
impl From<u32> for Value<'_> {
    fn from(value: u32) -> Self {
        Self::Integer(value.into())
    }
}
impl From<u64> for Value<'_> {
    fn from(value: u64) -> Self {
        Self::Integer(value.into())
    }
}
impl From<i64> for Value<'_> {
    fn from(value: i64) -> Self {
        Self::Integer(value.into())
    }
}
impl From<usize> for Value<'_> {
    fn from(value: usize) -> Self {
        Self::Integer(value as i128)
    }
}
impl From<f64> for Value<'_> {
    fn from(value: f64) -> Self {
        Self::Real(value)
    }
}
impl<'a> From<&'a str> for Value<'a> {
    fn from(value: &'a str) -> Self {
        Self::Text(value.into())
    }
}
impl From<String> for Value<'_> {
    fn from(value: String) -> Self {
        Self::Text(value.into())
    }
}

/// Formats one card.
pub fn format_card(keyword: &str, value: &Value<'_>, comment: &str) -> Card {
    let mut text = keyword_text(keyword);
    text.push_str("= ");
    match value {
        Value::Undefined => text.push_str(&" ".repeat(FIXED_END - VALUE_COLUMN)),
        Value::Logical(v) => text.push_str(&format!("{:>20}", if *v { "T" } else { "F" })),
        Value::Integer(v) => text.push_str(&format!("{v:>20}")),
        Value::Real(v) => text.push_str(&format!("{:>20}", real_text(*v))),
        Value::Text(v) => text.push_str(&format!("{:<20}", quoted(v))),
    }
    if !comment.is_empty() && text.len() + 4 <= CARD_BYTES {
        text.push_str(" / ");
        text.push_str(&printable(comment));
    }
    padded(&text)
}

/// Formats one `COMMENT` card.
pub fn format_comment(comment: &str) -> Card {
    padded(&format!("COMMENT {}", printable(comment)))
}

/// Returns the card that ends every header.
pub fn end_card() -> Card {
    padded("END")
}

/// Returns the eight characters of `A-Z 0-9 - _`.
fn keyword_text(keyword: &str) -> String {
    let allowed = |c: char| {
        let c = c.to_ascii_uppercase();
        if c.is_ascii_uppercase() || c.is_ascii_digit() || c == '-' { c } else { '_' }
    };
    format!("{:<8}", keyword.chars().take(8).map(allowed).collect::<String>())
}

/// Returns the shortest digits that read back exactly, with a decimal point and `E`; empty when not finite.
fn real_text(value: f64) -> String {
    if !value.is_finite() {
        return String::new();
    }
    let shortest = format!("{value:?}");
    let (mantissa, exponent) = shortest.split_once('e').unwrap_or((&shortest, ""));
    let point = if mantissa.contains('.') { "" } else { ".0" };
    let e = if exponent.is_empty() { "" } else { "E" };
    format!("{mantissa}{point}{e}{exponent}")
}

/// Returns the text in quotes, inner quotes doubled, at least eight characters wide, cut to the card.
fn quoted(text: &str) -> String {
    let space = CARD_BYTES - VALUE_COLUMN - 2;
    let mut inside = String::new();
    for c in printable(text).chars() {
        let repeat = if c == '\'' { 2 } else { 1 };
        if inside.len() + repeat > space {
            break;
        }
        inside.extend(std::iter::repeat_n(c, repeat));
    }
    format!("'{inside:<8}'")
}

fn printable(text: &str) -> String {
    text.chars().map(|c| if c == ' ' || c.is_ascii_graphic() { c } else { '?' }).collect()
}

fn padded(ascii: &str) -> Card {
    let mut card = [b' '; CARD_BYTES];
    card.iter_mut().zip(ascii.bytes()).for_each(|(to, from)| *to = from);
    card
}

/// Reads the value of a card; `None` when it has none (`COMMENT`, `END`) or it is not in FITS form.
pub fn parse_value(card: &Card) -> Option<Value<'static>> {
    let text = core::str::from_utf8(card).ok()?;
    if !text.is_ascii() || &text[8..VALUE_COLUMN] != "= " {
        return None;
    }
    let field = text[VALUE_COLUMN..].trim_start();
    if let Some(inside) = field.strip_prefix('\'') {
        return parse_quoted(inside);
    }
    let field = field.split('/').next().unwrap_or("").trim();
    match field {
        "" => Some(Value::Undefined),
        "T" => Some(Value::Logical(true)),
        "F" => Some(Value::Logical(false)),
        _ => field.parse().map(Value::Integer).or_else(|_| field.replace('D', "E").parse().map(Value::Real)).ok(),
    }
}

fn parse_quoted(inside: &str) -> Option<Value<'static>> {
    let mut text = String::new();
    let mut characters = inside.chars().peekable();
    loop {
        match characters.next()? {
            '\'' if characters.next_if_eq(&'\'').is_some() => text.push('\''),
            '\'' => return Some(Value::Text(text.trim_end().to_owned().into())),
            c => text.push(c),
        }
    }
}

/// The cards of a header, without the mandatory first ones and without `END`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Header {
    cards: Vec<Card>,
}

impl Header {
    /// Adds a keyword (at most eight characters of `A-Z 0-9 - _`).
    pub fn push<'a>(&mut self, keyword: &str, value: impl Into<Value<'a>>, comment: &str) {
        self.cards.push(format_card(keyword, &value.into(), comment));
    }

    /// Adds a comment of at most 72 characters.
    pub fn comment(&mut self, text: &str) {
        self.cards.push(format_comment(text));
    }

    /// Adds a card unchanged.
    pub fn push_card(&mut self, card: Card) {
        self.cards.push(card);
    }

    /// Returns the cards in order.
    pub fn cards(&self) -> &[Card] {
        &self.cards
    }

    /// Returns the value of the first card with this keyword.
    pub fn get(&self, keyword: &str) -> Option<Value<'static>> {
        let wanted = keyword_text(keyword);
        self.cards.iter().find(|card| card.starts_with(wanted.as_bytes())).and_then(parse_value)
    }

    /// Returns a number, integer or real.
    pub fn real(&self, keyword: &str) -> Option<f64> {
        match self.get(keyword)? {
            Value::Real(v) => Some(v),
            Value::Integer(v) => Some(v as f64),
            Value::Undefined | Value::Logical(_) | Value::Text(_) => None,
        }
    }

    /// Returns an integer.
    pub fn integer(&self, keyword: &str) -> Option<i128> {
        if let Value::Integer(v) = self.get(keyword)? { Some(v) } else { None }
    }

    /// Returns a text.
    pub fn text(&self, keyword: &str) -> Option<String> {
        if let Value::Text(v) = self.get(keyword)? { Some(v.into_owned()) } else { None }
    }
}

// Checksums of a FITS file: `DATASUM` and `CHECKSUM`.
//
// Source: FITS standard 4.0, section 4.4.2.7 and appendix J (Seaman, Pence and Rots): the ones' complement sum of all
// 32-bit words; the header's is written as 16 characters that make the sum of the whole file minus zero.

/// Characters of `CHECKSUM` while the sum is taken.
pub(super) const NO_CHECKSUM: &str = "0000000000000000";

/// A ones' complement sum of big-endian 32-bit words; every call but the last takes whole words.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sum32(u64);

impl Sum32 {
    /// Adds bytes; missing bytes of the last word count as zero.
    pub(super) fn add(&mut self, bytes: &[u8]) {
        let (words, rest) = bytes.as_chunks::<4>();
        self.0 += words.iter().map(|word| u64::from(u32::from_be_bytes(*word))).sum::<u64>();
        let mut last = [0; 4];
        last[..rest.len()].copy_from_slice(rest);
        self.0 += u64::from(u32::from_be_bytes(last));
        self.0 = u64::from(self.value());
    }

    /// Returns the sum with its carries added.
    pub(super) fn value(self) -> u32 {
        let mut sum = self.0;
        while sum > u64::from(u32::MAX) {
            sum = (sum & u64::from(u32::MAX)) + (sum >> 32);
        }
        u32::try_from(sum).unwrap_or(u32::MAX)
    }
}

/// Returns the characters of the complement of `sum`: letters and digits, four for each byte, turned by one place, as
/// the value of a card begins in the last byte of a word.
pub(super) fn encoded(sum: u32) -> String {
    let mut text = [0_u8; 16];
    for (place, byte) in (!sum).to_be_bytes().into_iter().enumerate() {
        let mut four = [byte / 4 + b'0'; 4];
        four[0] += byte % 4;
        while four.iter().any(|c| !c.is_ascii_alphanumeric()) {
            for pair in [0, 2] {
                if !(four[pair].is_ascii_alphanumeric() && four[pair + 1].is_ascii_alphanumeric()) {
                    four[pair] += 1;
                    four[pair + 1] -= 1;
                }
            }
        }
        (0..4).for_each(|i| text[4 * i + place] = four[i]);
    }
    text.rotate_right(1);
    text.iter().map(|c| char::from(*c)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn line(keyword: &str, value: impl Into<Value<'static>>, comment: &str) -> String {
        String::from_utf8(format_card(keyword, &value.into(), comment).to_vec()).unwrap().trim_end().into()
    }

    #[test]
    fn fixed_format_columns() {
        assert_eq!(line("SIMPLE", true, "conforms"), "SIMPLE  =                    T / conforms");
        assert_eq!(line("NAXIS1", 1024_u32, ""), "NAXIS1  =                 1024");
        assert_eq!(line("SEED", u64::MAX, "seed"), "SEED    = 18446744073709551615 / seed");
        assert_eq!(line("GAIN", 2.0, "[e-/DN]"), "GAIN    =                  2.0 / [e-/DN]");
        assert_eq!(line("TINY", 1e-7, ""), "TINY    =               1.0E-7");
        assert_eq!(line("ORIGIN", "it's", "x"), "ORIGIN  = 'it''s   '           / x");
        assert_eq!(line("NONE", f64::NAN, "x"), "NONE    =                      / x");
    }

    #[test]
    fn text_that_is_too_long_is_cut_between_characters() {
        for length in 60..80 {
            let card = format_card("LONG", &Value::from("'".repeat(length)), "never fits");
            let Some(Value::Text(text)) = parse_value(&card) else { panic!("{card:?}") };
            assert_eq!(text, "'".repeat(34), "68 columns hold 34 doubled quotes");
        }
    }

    #[test]
    fn damaged_cards_have_no_value() {
        for text in ["COMMENT no value", "END", "OPEN    = 'no end", "WORD    = hello", ""] {
            assert_eq!(parse_value(&padded(text)), None, "{text}");
        }
    }

    fn any_value() -> impl Strategy<Value = Value<'static>> {
        prop_oneof![
            Just(Value::Undefined),
            any::<bool>().prop_map(Value::Logical),
            any::<i128>().prop_map(Value::Integer),
            any::<f64>().prop_map(Value::Real),
            any::<String>().prop_map(Value::from),
        ]
    }

    proptest! {
        #[test]
        fn every_card_is_80_printable_characters(key in any::<String>(), value in any_value(), comment in any::<String>()) {
            let card = format_card(&key, &value, &comment);
            prop_assert!(card.iter().all(|b| (b' '..=b'~').contains(b)), "{:?}", card);
            prop_assert!(format_comment(&comment).iter().all(|b| (b' '..=b'~').contains(b)));
            prop_assert!(parse_value(&card).is_some(), "{:?}", String::from_utf8_lossy(&card));
        }

        #[test]
        fn numbers_read_back_exactly(seed in any::<u64>(), real in any::<f64>().prop_filter("finite", |v| v.is_finite())) {
            prop_assert_eq!(parse_value(&format_card("A", &seed.into(), "c")), Some(Value::Integer(seed.into())));
            prop_assert_eq!(parse_value(&format_card("A", &real.into(), "c/d")), Some(Value::Real(real)));
        }

        #[test]
        fn short_text_reads_back(text in "[ -~]{0,33}[!-~]") {
            let card = format_card("A", &text.as_str().into(), "a comment with 'quotes' / slashes");
            prop_assert_eq!(parse_value(&card), Some(Value::Text(text.into())));
        }

        #[test]
        fn reading_any_bytes_never_panics(bytes in proptest::collection::vec(any::<u8>(), CARD_BYTES)) {
            let mut card = [0; CARD_BYTES];
            card.copy_from_slice(&bytes);
            let _ = parse_value(&card); // any result is right, but no panic
            card[8..10].copy_from_slice(b"= ");
            let _ = parse_value(&card); // any result is right, but no panic
        }
    }
}

#[cfg(test)]
mod checksum_tests {
    use super::*;

    #[test]
    fn sums_carry_around() {
        let mut sum = Sum32::default();
        sum.add(&[0xFF, 0xFF, 0xFF, 0xFF, 0, 0, 0, 1]);
        assert_eq!(sum.value(), 1, "ones' complement: minus zero and one are one");
        sum.add(&[0x80]);
        assert_eq!(sum.value(), 0x8000_0001, "a part of a word counts from its high end");
    }

    #[test]
    fn the_standards_example_is_encoded_as_printed() {
        // FITS standard 4.0, appendix J: the checksum 868229149 is encoded as hcHjjc9ghcEghc9g.
        assert_eq!(encoded(868_229_149), "hcHjjc9ghcEghc9g");
        assert_eq!(encoded(u32::MAX), NO_CHECKSUM, "the sum minus zero");
    }
}
