//! Input files of `render`: numbers from the command line, tables from CSV files. Errors say file, row, wanted, got.

use crate::cli::named::{KernelArgs, attitudes};
use anyhow::{Context, Result, bail};
use base::input_file::{DATA_BYTES, InputFile};
use base::time::{Span, Tai};
use base::{axes::Rotation, units::ARCSEC};
use batch::still::MOST_ELECTRONS;
use histories::{AttitudeHistory, AttitudeMotion, AttitudeSegment, Times};
use plan::attitude::LosPath;
use plan::exposure::{PixelPath, PixelPoint, Source, SourcePlace};
use std::path::{Path, PathBuf};

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

// The attitudes of `starloop render --attitudes`: those of a whole file, one for each image, and the names of the images.

/// Most images of one file.
const MOST_IMAGES: usize = 100_000;

/// Attitudes of the sensor, at the middle of each exposure.
pub(crate) struct Series {
    history: AttitudeHistory,
    /// Of the zero of the file's times.
    zero: Tai,
    /// Middles of exposures, on the count of the file, ns.
    mids_ns: Vec<i64>,
}

impl Series {
    /// Reads a file; an image for every row, or every `every_s` seconds. Times from a zero of the file's own count from
    /// `zero`.
    pub(crate) fn read(path: &Path, kernels: &KernelArgs, zero: Tai, every_s: Option<f64>) -> Result<Self> {
        let history = attitudes(path, kernels)?;
        let mids_ns: Vec<i64> = match every_s {
            None => {
                let usable = history.segments().iter().flat_map(AttitudeSegment::usable_states);
                usable.map(|state| state.t_ns).take(MOST_IMAGES + 1).collect()
            }
            Some(every_s) => {
                let [first, last] = history.span_ns();
                let step_ns = Span::from_s(every_s).ns().max(1);
                let steps = (0..=MOST_IMAGES as i64).map(|step| first.saturating_add(step_ns.saturating_mul(step)));
                steps.take_while(|t_ns| *t_ns <= last).filter(|t_ns| history.at_ns(*t_ns).is_some()).collect()
            }
        };
        if mids_ns.len() > MOST_IMAGES {
            bail!("{}: more than {MOST_IMAGES} images; wanted fewer: give --every S", path.display());
        }
        for note in &history.notes {
            eprintln!("{}: {note}", path.display());
        }
        for warning in &history.warnings {
            eprintln!("{}: WARNING: {warning}", path.display());
        }
        let zero = if history.times == Times::Absolute { Tai::from_ns(0) } else { zero };
        Ok(Self { history, zero, mids_ns })
    }

    /// Returns the number of images.
    pub(crate) fn len(&self) -> usize {
        self.mids_ns.len()
    }

    /// Returns the first and the last middle of an exposure.
    pub(crate) fn span(&self) -> [Tai; 2] {
        let [first, last] = [self.mids_ns.first(), self.mids_ns.last()];
        [first, last].map(|ns| self.at(ns.copied().unwrap_or_default()))
    }

    fn at(&self, t_ns: i64) -> Tai {
        self.zero + Span::from_ns(t_ns)
    }

    /// Returns the line of sight of one image, and the middle of its exposure.
    pub(crate) fn los(&self, number: usize, exposure_s: f64) -> Result<(LosPath, Tai)> {
        let t_ns = *self.mids_ns.get(number).context("no such image")?;
        let AttitudeMotion { body_from_icrf, rate_rad_s, acceleration_rad_s2 } =
            self.history.at_ns(t_ns).context("no attitude then")?;
        let at = self.at(t_ns);
        // The file's body is the sensor: an image has no spacecraft.
        let sensor_from_icrf = Rotation::from_quat(body_from_icrf.quat());
        let mut los = LosPath::commanded(sensor_from_icrf, at - Span::from_s(0.5 * exposure_s), exposure_s);
        (los.rate_rad_s, los.acceleration_rad_s2) = (rate_rad_s, acceleration_rad_s2);
        Ok((los, at))
    }
}

/// Returns the path of one image of a series: `name_000012.fits` for `name.fits`.
pub(crate) fn numbered(out: &Path, number: usize) -> Result<PathBuf> {
    let [stem, ending] = [out.file_stem(), out.extension()].map(|part| part.and_then(|part| part.to_str()));
    let (stem, ending) = stem.zip(ending).with_context(|| format!("--out {}: wanted a name", out.display()))?;
    Ok(out.with_file_name(format!("{stem}_{number:06}.{ending}")))
}

#[cfg(test)]
mod render_input_tests {
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

#[cfg(test)]
mod render_series_tests {
    use super::*;

    #[test]
    fn images_are_those_of_rows_or_steps_and_never_in_gaps() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.csv");
        std::fs::write(&path, "t_s,w,x,y,z,segment\n0,1,0,0,0,1\n1,1,0,0,0,1\n3,1,0,0,0,2\n4,1,0,0,0,2\n").unwrap();
        let zero = Tai::from_rfc3339("2026-03-01T00:00:00Z").unwrap();
        let series = Series::read(&path, &KernelArgs::default(), zero, None).unwrap();
        assert_eq!((series.len(), series.span()), (4, [zero, zero + Span::from_s(4.0)]));
        let steps = Series::read(&path, &KernelArgs::default(), zero, Some(0.5)).unwrap();
        assert_eq!(steps.len(), 6, "none at 1.5, 2 and 2.5 s");
        let (los, at) = steps.los(5, 0.2).unwrap();
        assert_eq!(at, zero + Span::from_s(4.0));
        assert_eq!(los.exposure_start, at - Span::from_s(0.1));
        let name = numbered(Path::new("a/slew.fits"), 12).unwrap();
        assert_eq!(name, Path::new("a/slew_000012.fits"));
    }
}
