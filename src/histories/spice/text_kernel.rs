//! Text of a kernel -> its numbers by name.
//!
//! Data are between `\begindata` and `\begintext`: `NAME = value`, `NAME = ( values )` and `NAME += ( values )`;
//! exponents may be `D`. Texts in quotes and dates (`@`) are kept as no numbers.

use crate::error::{HistoryError, Source};
use std::collections::HashMap;

/// Largest kernel that is taken.
const BYTES_MAX: usize = 64 << 20;

/// Numbers of one kernel.
pub(super) struct TextKernel {
    numbers: HashMap<String, Vec<f64>>,
}

impl TextKernel {
    /// Reads a kernel.
    pub(super) fn read(bytes: &[u8], source: &Source<'_>) -> Result<Self, HistoryError> {
        let text = core::str::from_utf8(bytes).ok().filter(|text| text.trim_start().starts_with("KPL/"));
        let Some(text) = text.filter(|text| text.len() <= BYTES_MAX) else {
            let wanted = format!("wanted a text kernel that begins with KPL/, of at most {BYTES_MAX} bytes");
            return Err(source.whole(format!("it is not a text kernel; {wanted}")));
        };
        let (mut kernel, mut is_data, mut name) = (Self { numbers: HashMap::new() }, false, None);
        for (line, number) in text.lines().zip(1..) {
            match line.trim() {
                "\\begindata" => is_data = true,
                "\\begintext" => is_data = false,
                data if is_data => kernel
                    .take_line(data, &mut name)
                    .map_err(|got| source.at_line(number, &got, "NAME = value or NAME = ( values )"))?,
                _ => {}
            }
        }
        Ok(kernel)
    }

    /// Takes one line of data; `name` is that of the values that may go on in the next one.
    fn take_line(&mut self, line: &str, name: &mut Option<String>) -> Result<(), String> {
        let mut rest = line;
        if let Some((before, after)) = line.split_once('=').filter(|(before, _)| !before.contains('\'')) {
            let adds = before.ends_with('+');
            let key = before.trim_end_matches('+').trim();
            if key.is_empty() || key.contains(char::is_whitespace) {
                return Err(line.to_owned());
            }
            let values = self.numbers.entry(key.to_owned()).or_default();
            if !adds {
                values.clear();
            }
            *name = Some(key.to_owned());
            rest = after;
        }
        let words = rest.split(|c: char| c.is_whitespace() || matches!(c, ',' | '(' | ')')).filter(|w| !w.is_empty());
        for word in words {
            let Some(key) = name.as_ref() else { return Err(word.to_owned()) };
            let value = if word.starts_with(['\'', '@']) || word.ends_with('\'') {
                f64::NAN
            } else {
                // Words within quotes may be any text.
                word.replace(['D', 'd'], "E").parse().unwrap_or(f64::NAN)
            };
            if let Some(values) = self.numbers.get_mut(key) {
                values.push(value);
            }
        }
        Ok(())
    }

    /// Returns the numbers of a name.
    pub(super) fn numbers(&self, name: &str) -> Option<&[f64]> {
        self.numbers.get(name).map(Vec::as_slice)
    }
}
