//! Input files of `render`: numbers from the command line, tables from CSV files. Errors say file, row, wanted, got.

use anyhow::{Context, Result, bail};
use base::input_file::{DATA_BYTES, InputFile};
use base::units::ARCSEC;
use batch::still::MOST_ELECTRONS;
use plan::exposure::{PixelPath, PixelPoint, Source, SourcePlace};
use std::path::Path;

/// Returns three comma-separated numbers.
///
/// # Errors
/// When there are not exactly three finite numbers.
pub fn three(text: &str) -> Result<[f64; 3], String> {
    numbers(text)
}

/// Returns four comma-separated numbers.
///
/// # Errors
/// When there are not exactly four finite numbers.
pub fn four(text: &str) -> Result<[f64; 4], String> {
    numbers(text)
}

fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let refuse = || format!("got \"{text}\", wanted {N} finite numbers separated by commas");
    let parsed: Vec<f64> =
        text.split(',').map(|part| part.trim().parse::<f64>()).collect::<Result<_, _>>().map_err(|_| refuse())?;
    let numbers: [f64; N] = parsed.try_into().map_err(|_| refuse())?;
    if numbers.iter().all(|number| number.is_finite()) { Ok(numbers) } else { Err(refuse()) }
}

/// Reads rows of named columns; the file may hold others, in any order.
fn read_columns<const N: usize>(path: &Path, columns: [&str; N]) -> Result<Vec<[f64; N]>> {
    let mut reader = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(InputFile::open(path, DATA_BYTES).with_context(|| format!("cannot read {}", path.display()))?);
    let header = reader.headers().with_context(|| format!("{}: the header line", path.display()))?.clone();
    let mut places = [0; N];
    for (place, column) in places.iter_mut().zip(columns) {
        *place = header.iter().position(|name| name == column).with_context(|| {
            let got = header.iter().collect::<Vec<_>>().join(",");
            format!("{}: no column \"{column}\"; wanted {}, got {got}", path.display(), columns.join(","))
        })?;
    }
    let mut rows = Vec::new();
    for (i, record) in reader.records().enumerate() {
        let row = i + 1;
        let record = record.with_context(|| format!("{}: row {row}", path.display()))?;
        let mut values = [0.0; N];
        for ((value, place), column) in values.iter_mut().zip(places).zip(columns) {
            let text = record.get(place).unwrap_or_default();
            *value = text.parse().ok().filter(|value: &f64| value.is_finite()).with_context(|| {
                format!("{}: row {row}, column {column}: got \"{text}\", wanted a finite number", path.display())
            })?;
        }
        rows.push(values);
    }
    Ok(rows)
}

/// Furthest place of a source from the first pixel, px.
const FURTHEST_PX: f64 = 1e6;

/// Returns a table `x_px,y_px,electrons`.
///
/// # Errors
/// When the file is not such a table, or a source is negative.
pub fn read_sources(path: &Path) -> Result<Vec<Source>> {
    let rows = read_columns(path, ["x_px", "y_px", "electrons"])?;
    for (i, [x, y, electrons]) in rows.iter().enumerate() {
        let row = i + 1;
        if !(0.0..=MOST_ELECTRONS).contains(electrons) {
            bail!("{}: row {row}, column electrons: got {electrons}, wanted 0 to {MOST_ELECTRONS:e}", path.display());
        }
        if x.abs().max(y.abs()) > FURTHEST_PX {
            bail!("{}: row {row}: got a place of ({x}, {y}) px, wanted at most {FURTHEST_PX:e}", path.display());
        }
    }
    let source = |(i, [x, y, electrons]): (usize, [f64; 3])| -> Result<Source> {
        let id = u32::try_from(i).with_context(|| format!("{}: more than 2^32 rows", path.display()))?;
        Ok(Source { id, electrons, mag: f32::NAN, place: SourcePlace::Pixel([x, y]) })
    };
    rows.into_iter().enumerate().map(source).collect()
}

/// Returns a path `t_s,dx_px,dy_px,roll_arcsec`, linear between rows.
///
/// # Errors
/// When the file is not such a table or its times do not fit the exposure.
pub fn read_los(path: &Path, exposure_s: f64) -> Result<PixelPath> {
    let rows = read_columns(path, ["t_s", "dx_px", "dy_px", "roll_arcsec"])?;
    let points = rows.into_iter().map(|[t_s, dx_px, dy_px, roll]| point(t_s, dx_px, dy_px, roll)).collect();
    PixelPath::line(points, exposure_s).with_context(|| path.display().to_string())
}

/// Returns the equally weighted positions `dx_px,dy_px,roll_arcsec`.
///
/// # Errors
/// When the file is not such a table.
pub fn read_los_samples(path: &Path) -> Result<PixelPath> {
    let rows = read_columns(path, ["dx_px", "dy_px", "roll_arcsec"])?;
    let points = rows.into_iter().map(|[dx_px, dy_px, roll]| point(0.0, dx_px, dy_px, roll)).collect();
    PixelPath::samples(points).with_context(|| path.display().to_string())
}

fn point(t_s: f64, dx_px: f64, dy_px: f64, roll_arcsec: f64) -> PixelPoint {
    PixelPoint { t_s, dx_px, dy_px, roll_rad: roll_arcsec * ARCSEC }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(text: &str) -> tempfile::NamedTempFile {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        file
    }

    #[test]
    fn columns_are_found_by_name() {
        let table = file("# a comment\nelectrons, y_px, x_px\n100, 2, 1\n");
        let sources = read_sources(table.path()).unwrap();
        assert_eq!(sources[0].place, SourcePlace::Pixel([1.0, 2.0]));
        assert_eq!(sources[0].electrons, 100.0);
    }

    #[test]
    fn refusals_say_where_and_what() {
        let wrong = |text: &str| format!("{:#}", read_sources(file(text).path()).unwrap_err());
        assert!(wrong("x_px,electrons\n1,2\n").contains("no column \"y_px\""), "missing column");
        let error = wrong("x_px,y_px,electrons\n1,2,3\n1,nan,3\n");
        assert!(error.contains("row 2, column y_px: got \"nan\""), "{error}");
        assert!(wrong("x_px,y_px,electrons\n1,2,-3\n").contains("wanted 0 to 1e12"), "negative");
        assert!(three("1,2").unwrap_err().contains("wanted 3 finite numbers"), "too few");
        assert!(four("1,2,3,inf").is_err(), "infinite");
    }
}
