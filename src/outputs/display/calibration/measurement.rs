//! The measurements of each image: rows of a table, from any program that measures.
//!
//! CSV columns: `pattern` (its name), `x_px`, `y_px` (tracker px, first pixel's centre 0, 0), `flux` (of a dot, above
//! its surroundings, electrons per second), `luminance` (of a level, any unit that is the same for all levels), `dot`
//! (its number, where the measuring program knows it; else it is read from the codes), `saturated` (`true` where the
//! camera was at its end: it is then left out). Columns may be missing, values empty.

use super::pattern::Pattern;
use base::refused::Refused;
use serde::{Deserialize, Serialize};
use std::io::{Read, Write};
use std::path::Path;

/// Most rows of one table.
const MOST_ROWS: usize = 1_000_000;

/// One thing that was seen of one pattern.
#[derive(Debug, Clone, PartialEq)]
pub struct Sight {
    /// The pattern shown.
    pub pattern: Pattern,
    /// Place, tracker px.
    pub tracker_px: Option<[f64; 2]>,
    /// Light of a dot above its surroundings, electrons per second.
    pub flux: Option<f64>,
    /// Level, any unit.
    pub luminance: Option<f64>,
    /// The dot's number, where known.
    pub dot: Option<usize>,
    /// Whether the camera was saturated there.
    pub is_saturated: bool,
}

#[derive(Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
struct Row {
    pattern: String,
    x_px: Option<f64>,
    y_px: Option<f64>,
    flux: Option<f64>,
    luminance: Option<f64>,
    dot: Option<usize>,
    saturated: Option<bool>,
}

/// Reads a table.
///
/// # Errors
/// The line that is not a measurement, and the reason.
pub fn read_csv(input: impl Read, path: &Path) -> Result<Vec<Sight>, Refused> {
    let refuse = |line: u64, reason: String| {
        Refused(format!(
            "{path}, line {line}: {reason}; wanted the columns pattern,x_px,y_px,flux,luminance,dot,saturated (pattern and what was measured of it; the others may be missing or empty)",
            path = path.display()
        ))
    };
    let mut sights = Vec::new();
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(input);
    for (row, line) in reader.deserialize::<Row>().zip(2_u64..) {
        let row = row.map_err(|error| refuse(error.position().map_or(line, csv::Position::line), error.to_string()))?;
        let pattern = Pattern::of_name(&row.pattern);
        let pattern = pattern.ok_or_else(|| refuse(line, format!("no pattern is called `{}`", row.pattern)))?;
        let numbers = [row.x_px, row.y_px, row.flux, row.luminance];
        if numbers.iter().flatten().any(|number| !number.is_finite()) {
            return Err(refuse(line, "a number that is not finite".into()));
        }
        if sights.len() == MOST_ROWS {
            return Err(refuse(line, format!("more than {MOST_ROWS} rows")));
        }
        let tracker_px = row.x_px.zip(row.y_px).map(|(x, y)| [x, y]);
        let is_saturated = row.saturated.unwrap_or(false);
        sights.push(Sight {
            pattern,
            tracker_px,
            flux: row.flux,
            luminance: row.luminance,
            dot: row.dot,
            is_saturated,
        });
    }
    Ok(sights)
}

/// Writes a table that [`read_csv`] reads.
///
/// # Errors
/// When the output fails.
pub fn write_csv(out: impl Write, sights: &[Sight]) -> std::io::Result<()> {
    let mut writer = csv::Writer::from_writer(out);
    for sight in sights {
        writer.serialize(Row {
            pattern: sight.pattern.name(),
            x_px: sight.tracker_px.map(|px| px[0]),
            y_px: sight.tracker_px.map(|px| px[1]),
            flux: sight.flux,
            luminance: sight.luminance,
            dot: sight.dot,
            saturated: sight.is_saturated.then_some(true),
        })?;
    }
    writer.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Sight>, String> {
        read_csv(text.as_bytes(), Path::new("m.csv")).map_err(|error| error.to_string())
    }

    #[test]
    fn tables_read_back_and_columns_may_be_missing() {
        let sights = read("pattern,x_px,y_px,flux\ndots,1.5,2.5,300\nlevel_7,,,\n").unwrap();
        assert_eq!((sights[0].tracker_px, sights[0].flux, sights[0].dot), (Some([1.5, 2.5]), Some(300.0), None));
        assert_eq!((sights[1].pattern, sights[1].tracker_px), (Pattern::Level(7), None));
        let flagged = read("pattern,flux,saturated\ndots,1,true\ndots,1,false\ndots,1,\n").unwrap();
        assert_eq!(flagged.iter().map(|sight| sight.is_saturated).collect::<Vec<_>>(), [true, false, false]);
        let sights = [sights, flagged].concat();
        let mut text = Vec::new();
        write_csv(&mut text, &sights).unwrap();
        assert_eq!(read(std::str::from_utf8(&text).unwrap()).unwrap(), sights);
    }

    #[test]
    fn a_row_that_is_none_is_reported_by_line() {
        for (text, reported) in [
            ("pattern,luminance\nlevel_1,2\nlevle_2,3\n", "line 3: no pattern is called `levle_2`"),
            ("pattern,luminance\nlevel_1,bright\n", "line 2"),
            ("pattern,luminance\nlevel_1,NaN\n", "not finite"),
            ("pattern,brightness\nlevel_1,2\n", "brightness"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(reported) && error.contains("m.csv"), "{error}");
        }
    }
}
