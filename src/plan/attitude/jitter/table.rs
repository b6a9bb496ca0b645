//! Text of a jitter record, or of its density, as CSV -> samples or breakpoints in rad.
//!
//! The first line that is not a comment names the columns, units included: `t_s,x_arcsec,y_arcsec` or
//! `frequency_hz,x_urad2_hz,y_urad2_hz`; `z` is optional, as is one of `x` and `y`. `#` starts a comment. *Limits.*
//! Equal steps of time, to a tenth of one; [`RECORD_SAMPLES_MAX`] rows of a series, [`DENSITY_ROWS_MAX`] of a density.
//! Every refusal states the line and the reason. Fuzzed: `tests/fuzz/targets/jitter_table.rs`.

use crate::attitude::jitter::record::{JitterRecord, RECORD_SAMPLES_MAX, RecordEnd};
use crate::attitude::jitter::{psd::PsdPoint, spectrum::DENSITY_ROWS_MAX};
use base::units::{ARCSEC, DEG};
use glam::DVec3;

/// Largest rotation that is accepted as jitter, rad: 10 degrees.
const MOST_RAD: f64 = 10.0 * DEG;
/// Largest number of columns of a table.
const COLUMNS_MAX: usize = 4;
/// Characters of a refused line that a message shows.
const SHOWN: usize = 60;
/// Largest deviation of a row's time from equal steps, in steps.
const STEP_TOLERANCE: f64 = 0.1;

/// Error in a table of jitter.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("line {line}: \"{got}\"; wanted {wanted}")]
pub struct JitterTableError {
    /// Line, from 1.
    pub line: usize,
    /// Text found.
    pub got: String,
    /// Text wanted.
    pub wanted: String,
}

impl JitterTableError {
    fn new(line: usize, got: &str, wanted: impl Into<String>) -> Self {
        let shown: String = got.chars().take(SHOWN).collect();
        Self { line, got: shown.escape_debug().to_string(), wanted: wanted.into() }
    }
}

/// A column of a table: its axis, `None` for the first quantity; and its unit in SI.
type Column = (Option<usize>, f64);

/// Names of a first column, and their units.
type Firsts = &'static [(&'static str, f64)];

const TIMES: Firsts = &[("t_s", 1.0), ("time_s", 1.0), ("t_ms", 1e-3), ("t_us", 1e-6)];
const FREQUENCIES: Firsts = &[("frequency_hz", 1.0), ("f_hz", 1.0)];
/// Units of angles.
const ANGLES: [(&str, f64); 5] =
    [("arcsec", ARCSEC), ("mas", 1e-3 * ARCSEC), ("urad", 1e-6), ("deg", DEG), ("rad", 1.0)];

/// Reads a measured series.
///
/// # Errors
/// The first invalid line.
pub fn read_series(text: &str, end: RecordEnd) -> Result<JitterRecord, JitterTableError> {
    let (mut times, mut samples) = (Vec::new(), Vec::new());
    let mut line_of_first = 1;
    for_each_row(text, TIMES, "", RECORD_SAMPLES_MAX, |line, t_s, rotation_rad, row| {
        if rotation_rad.length() > MOST_RAD {
            return Err(JitterTableError::new(line, row, "rotations of up to 10 degrees"));
        }
        if times.is_empty() {
            line_of_first = line;
        }
        times.push((line, t_s));
        samples.push(rotation_rad);
        Ok(())
    })?;
    let [(_, first_s), .., (last, last_s)] = times.as_slice() else {
        return Err(JitterTableError::new(line_of_first, "", "two rows or more below the names of the columns"));
    };
    let period_s = (last_s - first_s) / (times.len() - 1) as f64;
    let is_off = |(place, (_, t_s)): &(usize, &(usize, f64))| {
        let wanted_s = first_s + *place as f64 * period_s;
        (*t_s - wanted_s).abs() > STEP_TOLERANCE * period_s || !period_s.is_finite() || period_s <= 0.0
    };
    if let Some((_, (line, t_s))) = times.iter().enumerate().find(is_off) {
        let wanted = format!("times in equal steps, {period_s} s by the first row and the last: resample it");
        return Err(JitterTableError::new(*line, &format!("{t_s} s"), wanted));
    }
    JitterRecord::new(period_s, samples, end)
        .map_err(|error| JitterTableError::new(*last, "", format!("a record: {error}")))
}

/// Reads a one-sided density.
///
/// # Errors
/// The first invalid line.
pub fn read_density(text: &str) -> Result<Vec<PsdPoint>, JitterTableError> {
    let mut points: Vec<PsdPoint> = Vec::new();
    for_each_row(text, FREQUENCIES, "2_hz", DENSITY_ROWS_MAX, |line, frequency_hz, density, row| {
        let is_rising = points.last().is_none_or(|before| frequency_hz > before.frequency_hz);
        if frequency_hz <= 0.0 || !is_rising {
            return Err(JitterTableError::new(line, row, "frequencies above zero that rise from row to row"));
        }
        if density.min_element() < 0.0 || density.max_element() > MOST_RAD * MOST_RAD {
            return Err(JitterTableError::new(line, row, "densities of zero or more"));
        }
        points.push(PsdPoint { frequency_hz, density });
        Ok(())
    })?;
    if points.len() < 2 {
        return Err(JitterTableError::new(1, "", "two rows or more below the names of the columns"));
    }
    Ok(points)
}

/// Reads the columns' names and then passes line, first quantity and vector of every row to `take`.
fn for_each_row(
    text: &str,
    firsts: Firsts,
    power: &str,
    rows_max: usize,
    mut take: impl FnMut(usize, f64, DVec3, &str) -> Result<(), JitterTableError>,
) -> Result<(), JitterTableError> {
    let mut lines = text
        .trim_start_matches('\u{feff}')
        .lines()
        .zip(1..)
        .map(|(line, number)| (number, line.split('#').next().unwrap_or_default().trim()))
        .filter(|(_, line)| !line.is_empty());
    let Some((header_line, header)) = lines.next() else {
        return Err(JitterTableError::new(1, "", "names of columns, such as t_s,x_arcsec,y_arcsec"));
    };
    let columns = columns(header_line, header, firsts, power)?;
    for (count, (line, row)) in lines.enumerate() {
        if count >= rows_max {
            return Err(JitterTableError::new(line, row, format!("at most {rows_max} rows")));
        }
        let (mut first, mut vector, mut cells) = (0.0, DVec3::ZERO, row.split(','));
        for (axis, unit) in &columns {
            let number =
                cells.next().and_then(|cell| cell.trim().parse::<f64>().ok()).filter(|value| value.is_finite());
            let Some(value) = number.map(|value| value * unit) else {
                return Err(JitterTableError::new(line, row, format!("{} finite numbers by commas", columns.len())));
            };
            match axis {
                None => first = value,
                Some(axis) => vector[*axis] = value,
            }
        }
        if cells.next().is_some() {
            return Err(JitterTableError::new(line, row, format!("{} numbers, as many as columns", columns.len())));
        }
        take(line, first, vector, row)?;
    }
    Ok(())
}

/// Returns the columns named by the header.
fn columns(line: usize, header: &str, firsts: Firsts, power: &str) -> Result<Vec<Column>, JitterTableError> {
    let wanted = || {
        let first: Vec<&str> = firsts.iter().map(|(name, _)| *name).collect();
        let units = ANGLES.map(|(unit, _)| format!("{unit}{power}"));
        format!("{} first, then x_, y_ and z_ each once with a unit of {}", first.join(" or "), units.join(", "))
    };
    let refused = || JitterTableError::new(line, header, wanted());
    let mut columns: Vec<Column> = Vec::with_capacity(COLUMNS_MAX);
    for (place, name) in header.split(',').map(str::trim).enumerate() {
        let column = if place == 0 {
            firsts.iter().find(|(known, _)| *known == name).map(|(_, unit)| (None, *unit))
        } else {
            axis_column(name, power)
        };
        let column = column.filter(|(axis, _)| columns.iter().all(|(other, _)| other != axis)).ok_or_else(refused)?;
        columns.push(column);
    }
    if columns.len() < 2 { Err(refused()) } else { Ok(columns) }
}

fn axis_column(name: &str, power: &str) -> Option<Column> {
    let (axis, unit) = name.split_once('_')?;
    let axis = ["x", "y", "z"].iter().position(|known| *known == axis)?;
    let unit = unit.strip_suffix(power)?;
    let (_, scale) = ANGLES.into_iter().find(|(known, _)| *known == unit)?;
    Some((Some(axis), if power.is_empty() { scale } else { scale * scale }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_series_is_read_with_its_units() {
        let text = "# shaker, run 3\nt_ms, y_urad, x_arcsec\n5.0, 2.0, 1.0\n5.5, 4.0, 0.5 # later\n\n6.0,-2,0\n";
        let record = read_series(text, RecordEnd::Repeat).unwrap();
        assert!((record.period_s() - 5e-4).abs() < 1e-15 && record.samples().len() == 3);
        assert!((record.samples()[1] - DVec3::new(0.5 * ARCSEC, 4e-6, 0.0)).length() < 1e-18);
    }

    #[test]
    fn a_density_is_read_with_its_units() {
        let text = "frequency_hz,x_arcsec2_hz,z_urad2_hz\n1,2,3\n10,1e-3,0\n";
        let points = read_density(text).unwrap();
        assert!((points[0].density.x / (2.0 * ARCSEC * ARCSEC) - 1.0).abs() < 1e-12);
        assert!((points[0].density.z / 3e-12 - 1.0).abs() < 1e-12 && points[1].frequency_hz > 9.9);
    }

    #[test]
    fn invalid_series_is_refused_with_its_line() {
        for (text, line, part) in [
            ("", 1, "names of columns"),
            ("t_s,x\n0,1\n1,2\n", 1, "arcsec, mas"),
            ("x_arcsec,t_s\n", 1, "t_s or time_s"),
            ("t_s,x_arcsec,x_mas\n", 1, "each once"),
            ("t_s,x_arcsec\n0,1\n", 2, "two rows"),
            ("t_s,x_arcsec\n0,1\n1,nan\n", 3, "finite"),
            ("t_s,x_arcsec\n0,1\n1,2,3\n", 3, "as many"),
            ("t_s,x_arcsec\n0,1\n1,2\n2.5,3\n", 3, "equal steps"),
            ("t_s,x_arcsec\n0,1\n0,2\n", 2, "equal steps"),
            ("t_s,x_deg\n0,1\n1,11\n", 3, "10 degrees"),
            ("t_s,x_deg\n0,1\n5000,1\n", 3, "1000 s"),
        ] {
            let error = read_series(text, RecordEnd::Still).unwrap_err();
            assert!(error.line == line && error.wanted.contains(part), "{text:?}: {error}");
        }
    }

    #[test]
    fn invalid_density_is_refused_with_its_line() {
        for (text, line, part) in [
            ("t_s,x_arcsec\n0,1\n", 1, "frequency_hz"),
            ("f_hz,x_arcsec\n0,1\n", 1, "arcsec2_hz"),
            ("f_hz,x_arcsec2_hz\n0,1\n", 2, "above zero"),
            ("f_hz,x_arcsec2_hz\n2,1\n1,1\n", 3, "rise"),
            ("f_hz,x_arcsec2_hz\n2,-1\n", 2, "zero or more"),
            ("f_hz,x_arcsec2_hz\n2,1\n", 1, "two rows"),
        ] {
            let error = read_density(text).unwrap_err();
            assert!(error.line == line && error.wanted.contains(part), "{text:?}: {error}");
        }
    }
}
