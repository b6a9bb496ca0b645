//! Text of a kernel -> its numbers by name.
//!
//! Data are between `\begindata` and `\begintext`: `NAME = value`, `NAME = ( values )` and `NAME += ( values )`;
//! exponents may be `D`. A date (`@2004-AUG-03/12:00:00`) is the number of its seconds after J2000, without leap seconds.
//! Texts in quotes are kept as no numbers. As CSPICE does, a kernel is read without its word `KPL/...`, with any ends of
//! lines, a byte order mark, and remarks that are not UTF-8.

use crate::epoch::{MONTHS, days_since_1970};
use crate::error::{HistoryError, Source};
use std::{borrow::Cow, collections::HashMap};

/// Largest kernel that is taken.
const BYTES_MAX: usize = 64 << 20;
/// Names of a meta-kernel, which lists other kernels.
const OF_META_KERNELS: [&str; 3] = ["KERNELS_TO_LOAD", "PATH_VALUES", "PATH_SYMBOLS"];

/// Numbers of one name.
pub(super) struct Values {
    pub(super) numbers: Vec<f64>,
    /// The line that they begin in, from 1.
    pub(super) line: usize,
}

/// Numbers of one kernel.
pub(super) struct TextKernel {
    pub(super) file: String,
    values: HashMap<String, Values>,
}

impl TextKernel {
    /// Reads a kernel.
    pub(super) fn read(bytes: &[u8], source: &Source<'_>) -> Result<Self, HistoryError> {
        if bytes.len() > BYTES_MAX {
            return Err(source.whole(format!("{} bytes; wanted a text kernel of at most {BYTES_MAX}", bytes.len())));
        }
        if let Some(why) = crate::read::packed(bytes) {
            return Err(source.whole(why));
        }
        let text: Cow<'_, str> = match core::str::from_utf8(bytes) {
            Ok(text) => text.trim_start_matches('\u{feff}').into(),
            Err(_) => bytes.iter().map(|byte| char::from(*byte)).collect::<String>().into(),
        };
        let old_ends = if text.contains('\n') { '\n' } else { '\r' };
        let (mut is_data, mut has_data, mut name) = (false, false, None);
        let mut kernel = Self { file: source.file.to_owned(), values: HashMap::new() };
        for (line, number) in text.split(old_ends).zip(1..) {
            match line.trim() {
                "\\begindata" => (is_data, has_data) = (true, true),
                "\\begintext" => is_data = false,
                data if is_data => kernel
                    .take_line(data, number, &mut name)
                    .map_err(|(got, wanted)| source.at_line(number, &got, wanted))?,
                _ => {}
            }
        }
        if has_data {
            return Ok(kernel);
        }
        Err(source.whole("it is not a text kernel; wanted one with a line \\begindata, and NAME = value after it"))
    }

    /// Takes one line of data; `name` is that of the values that may go on in the next one. An error is what was got and
    /// what was wanted.
    fn take_line(
        &mut self,
        line: &str,
        number: usize,
        name: &mut Option<String>,
    ) -> Result<(), (String, &'static str)> {
        const WANTED: &str = "NAME = value or NAME = ( values )";
        let mut rest = line;
        if let Some((before, after)) = line.split_once('=').filter(|(before, _)| !before.contains('\'')) {
            let adds = before.ends_with('+');
            let key = before.trim_end_matches('+').trim();
            if key.is_empty() || key.contains(char::is_whitespace) {
                return Err((line.to_owned(), WANTED));
            }
            if OF_META_KERNELS.contains(&key) {
                return Err((line.to_owned(), "no meta-kernel: name the text kernels that it lists, each for itself"));
            }
            let new = || Values { numbers: Vec::new(), line: number };
            let values = self.values.entry(key.to_owned()).or_insert_with(new);
            if !adds {
                *values = new();
            }
            *name = Some(key.to_owned());
            rest = after;
        }
        let words = rest.split(|c: char| c.is_whitespace() || matches!(c, ',' | '(' | ')')).filter(|w| !w.is_empty());
        for word in words {
            let Some(key) = name.as_ref() else { return Err((word.to_owned(), WANTED)) };
            let value = match word.strip_prefix('@') {
                Some(date) => seconds_of(date).unwrap_or(f64::NAN),
                None if word.starts_with('\'') || word.ends_with('\'') => f64::NAN,
                // Words within quotes may be any text.
                None => word.replace(['D', 'd'], "E").parse().unwrap_or(f64::NAN),
            };
            if let Some(values) = self.values.get_mut(key) {
                values.numbers.push(value);
            }
        }
        Ok(())
    }

    /// Returns the values of a name.
    pub(super) fn values(&self, name: &str) -> Option<&Values> {
        self.values.get(name)
    }
}

/// Returns the values of a name in the last kernel that has it, with the file.
pub(super) fn find<'k>(texts: &'k [TextKernel], name: &str) -> Option<(&'k Values, &'k str)> {
    texts.iter().rev().find_map(|kernel| kernel.values(name).map(|values| (values, kernel.file.as_str())))
}

/// Returns the seconds after 2000-01-01T12:00:00 of a date: year, month and day, the year first or last and the month as a
/// number or a name, and perhaps a time of day.
fn seconds_of(date: &str) -> Option<f64> {
    let (day, time) = if date.contains(':') { split_time(date) } else { (date, "") };
    let parts: Vec<&str> = day.split(['-', '/']).filter(|part| !part.is_empty()).collect();
    let &[first, month, last] = parts.as_slice() else { return None };
    let rest: Vec<&str> = time.split(':').filter(|_| !time.is_empty()).collect();
    let number = |text: &str| text.parse::<i64>().ok().filter(|_| text.len() <= 4 && !text.starts_with('+'));
    let (year, day) = if first.len() > 2 { (first, last) } else { (last, first) };
    let (year, day) = (number(year)?, number(day)?);
    let name = month.get(..3).unwrap_or(month).to_ascii_lowercase();
    let named = MONTHS.iter().position(|known| *known == name).and_then(|place| i64::try_from(place + 1).ok());
    let month = named.or_else(|| number(month)).filter(|month| (1..=12).contains(month))?;
    let mut of_day_s = 0.0;
    for (text, unit_s) in rest.iter().zip([3600.0, 60.0, 1.0]) {
        of_day_s += unit_s * text.parse::<f64>().ok().filter(|value| (0.0..61.0).contains(value))?;
    }
    let is_date = (1..=31).contains(&day) && rest.len() <= 3;
    is_date.then(|| ((days_since_1970(year, month, day) - 10_957) as f64 - 0.5) * 86_400.0 + of_day_s)
}

/// Returns the day and the time of day of a date that has both: they are parted before the hour.
fn split_time(date: &str) -> (&str, &str) {
    let hour_end = date.find(':').unwrap_or(date.len());
    let hour = date[..hour_end].rfind(|c: char| !c.is_ascii_digit()).map_or(0, |at| at + 1);
    (date[..hour].trim_end_matches(['-', '/', 'T']), &date[hour..])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_seconds_after_j2000() {
        for (date, wanted_s) in [
            ("2000-JAN-1/12:00:00", 0.0),
            ("03-AUG-2004-06:00:00", 144_784_800.0),
            ("3-August-2004-06:00:00.000", 144_784_800.0),
            ("2004-08-03T06:00", 144_784_800.0),
            ("1972-JAN-1", -883_656_000.0),
            ("2017-JAN-01", 536_500_800.0),
            ("2000-FEB-29/00:00:00.25", 5_054_400.25),
            ("03-OCT-2004-00:00:00", 150_033_600.0),
        ] {
            assert_eq!(seconds_of(date), Some(wanted_s), "{date}");
        }
        for date in
            ["", "2004", "2004-08", "2004-XYZ-03", "2004-13-03", "2004-08-03-99:00:00", "1-2-3-4-5-6-7", "12:00"]
        {
            assert_eq!(seconds_of(date), None, "{date}");
        }
    }

    #[test]
    fn kernels_are_read_in_every_form_that_cspice_reads() {
        let plain = "KPL/SCLK\n\\begindata\nA_7 = ( 1 2.5D1\n 3 )\nA_7 += 4\n\\begintext\nthe end\n";
        let forms: [Vec<u8>; 6] = [
            plain.into(),
            plain.replace("KPL/SCLK\n", "").into(),
            plain.replace('\n', "\r\n").into(),
            plain.replace('\n', "\r").into(),
            format!("\u{feff}{plain}").into(),
            [plain.as_bytes(), b"\\begintext\nGr\xfc\xdfe\n"].concat(),
        ];
        for bytes in forms {
            let source = Source { file: "a.tsc", text: "" };
            let kernel = TextKernel::read(&bytes, &source).unwrap();
            let values = kernel.values("A_7").unwrap();
            assert_eq!(values.numbers, [1.0, 25.0, 3.0, 4.0], "{:?}", String::from_utf8_lossy(&bytes));
        }
    }

    #[test]
    fn meta_kernels_are_refused_with_their_line() {
        let text = "KPL/MK\n\\begindata\nPATH_VALUES = ( 'data' )\nKERNELS_TO_LOAD = ( '$A/a.tsc' )\n";
        let error = TextKernel::read(text.as_bytes(), &Source { file: "m.tm", text: "" }).err().unwrap().to_string();
        assert!(error.starts_with("m.tm:3:") && error.contains("no meta-kernel"), "{error}");
    }
}
