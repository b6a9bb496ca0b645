//! `[jitter]`: a measured series of jitter, or its density, that is added to the line of sight of every head.
//!
//! It is added where frames are made, whatever the source of the motion, and never travels over the bus. A density
//! becomes a series by the bench's seed. `src/guide/motion_and_jitter.md` says how it is resampled. Tests: below.

use crate::key::{Section, section, taken};
use crate::{check::Checker, error::Result, key_type::Word};
use base::refused::Refused;
use plan::attitude::{JitterRecord, PsdPoint, RecordEnd, read_density, read_series};
use std::sync::Arc;

/// Axes of a record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JitterAxes {
    /// Those of each head's sensor.
    Sensor,
    /// Those of the body.
    Body,
}

/// Jitter from a file, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct JitterInput {
    /// File as it is named.
    pub path: String,
    /// Its contents.
    pub source: JitterFile,
    /// Axes of the record.
    pub axes: JitterAxes,
    /// Instant of its first sample, s after the first exposure.
    pub start_s: f64,
}

/// Contents of a file of jitter.
#[derive(Debug, Clone, PartialEq)]
pub enum JitterFile {
    /// A measured series.
    Series(Arc<JitterRecord>),
    /// A power spectral density, from which a series of this length is made.
    Density {
        /// Its rows.
        points: Vec<PsdPoint>,
        /// Length of the series, s.
        duration_s: f64,
    },
}

section! {
    /// A measured series of jitter, or its density, that is added to the line of sight of every head.
    JitterKeys at "jitter" {
        /// CSV file of a measured series: equal steps of t_s and rotations, such as x_arcsec and y_arcsec.
        series: String = Optional, "path";
        /// CSV file of a one-sided density: frequency_hz and columns such as x_arcsec2_hz; the seed makes a series of
        /// it.
        density: String = Optional, "path", "give series or density, not both";
        /// Sensor: axes of each head's image, x right and y down; body: axes of the body.
        axes: Word<JitterAxes> = "sensor", [("sensor", JitterAxes::Sensor), ("body", JitterAxes::Body)];
        /// Seconds from the first exposure to the first sample; below 0 the run begins within the record.
        start_s: f64 = Silent(0.0), Within(-1e6, 1e6);
        /// After the last sample: refuse a record that is shorter than the run, repeat it, or go on still with an
        /// event.
        at_end: Word<AtEnd> = "refuse", [
            ("refuse", AtEnd::Refuse), ("repeat", AtEnd::Go(RecordEnd::Repeat)), ("still", AtEnd::Go(RecordEnd::Still)),
        ];
        /// Factor on every sample.
        scale: f64 = Silent(1.0), Within(-1e6, 1e6);
    }
}

/// Jitter after the last sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum AtEnd {
    Refuse,
    Go(RecordEnd),
}

/// Time beside the frames that a series covers: rows of a rolling shutter.
const SPARE_S: f64 = 2.0;

impl JitterInput {
    /// Checks the jitter of a run that is `duration_s` long.
    pub(super) fn check(keys: &JitterKeys, duration_s: f64, check: &mut Checker<'_>) -> Result<Option<Self>> {
        let (series, density) = (keys.series(), keys.density());
        if series.is_given() && density.is_given() {
            return Err(density.invalid("given", "no jitter.series beside it", check));
        }
        if !series.is_given() && !density.is_given() {
            keys.refuse(&["axes", "start_s", "at_end", "scale"], "jitter.series or jitter.density", check)?;
            return Ok(None);
        }
        taken!(check, keys => axes, scale);
        if density.is_given() {
            keys.refuse(&["start_s", "at_end"], "jitter.series", check)?;
            return Self::of_density(keys, duration_s, (axes, scale), check).map(Some);
        }
        taken!(check, keys => start_s, at_end);
        let end = match at_end {
            AtEnd::Refuse => RecordEnd::Still,
            AtEnd::Go(end) => end,
        };
        let (path, text) = text_of(keys, "series", check)?;
        let record = read_series(&text, end).map_err(|error| {
            check.invalid(
                "jitter.series",
                format!("{path}:{error}"),
                "a series",
                "the guide's motion_and_jitter.md has one",
            )
        })?;
        let record = scaled(&record, scale).ok_or_else(|| keys.scale().invalid(scale, "finite samples", check))?;
        let covers = start_s <= 0.0 && start_s + record.duration_s() >= duration_s;
        if at_end == AtEnd::Refuse && !covers {
            let got = format!("{path}: from {start_s} s to {} s", start_s + record.duration_s());
            let advice = "at_end = \"repeat\" repeats it, at_end = \"still\" goes on without; or a longer record";
            return Err(check.invalid("jitter.series", got, format!("0 s to {duration_s} s, the whole run"), advice));
        }
        Ok(Some(Self { path, source: JitterFile::Series(Arc::new(record)), axes, start_s }))
    }

    /// Returns the series of a run with this seed.
    ///
    /// # Errors
    /// Never for what was checked.
    pub fn record(&self, seed: u64) -> Result<Arc<JitterRecord>, Refused> {
        match &self.source {
            JitterFile::Series(record) => Ok(Arc::clone(record)),
            JitterFile::Density { points, duration_s } => {
                JitterRecord::of_density(points, seed, *duration_s).map(Arc::new)
            }
        }
    }

    fn of_density(
        keys: &JitterKeys,
        duration_s: f64,
        (axes, scale): (JitterAxes, f64),
        check: &mut Checker<'_>,
    ) -> Result<Self> {
        let (path, text) = text_of(keys, "density", check)?;
        let refused = |error: String| {
            let advice = "the guide's motion_and_jitter.md has one";
            check.invalid("jitter.density", format!("{path}:{error}"), "a density", advice)
        };
        let mut points = read_density(&text).map_err(|error| refused(error.to_string()))?;
        points.iter_mut().for_each(|point| point.density *= scale * scale);
        JitterRecord::of_density(&points, 0, 0.0).map_err(|error| refused(format!(" {error}")))?;
        let source = JitterFile::Density { points, duration_s: duration_s + 2.0 * SPARE_S };
        Ok(Self { path, source, axes, start_s: -SPARE_S })
    }
}

/// Returns the file that a key names, and its text.
fn text_of(keys: &JitterKeys, name: &str, check: &Checker<'_>) -> Result<(String, String)> {
    let given = if name == "series" { keys.series() } else { keys.density() };
    let path = given.raw().cloned().unwrap_or_default();
    let bytes = check.document.bytes_of(&given.key(), &path)?;
    let text = String::from_utf8(bytes);
    text.map(|text| (path.clone(), text)).map_err(|_bytes| given.invalid(&path, "a text file in UTF-8", check))
}

fn scaled(record: &JitterRecord, scale: f64) -> Option<JitterRecord> {
    let samples = record.samples().iter().map(|sample| *sample * scale).collect();
    JitterRecord::new(record.period_s(), samples, record.end()).ok()
}

#[cfg(test)]
mod tests {
    use crate::{Bench, Document, JitterAxes};
    use base::units::ARCSEC;
    use plan::attitude::RecordEnd;

    fn bench(rows: &str, keys: &str) -> Result<Bench, String> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("j.csv"), rows).unwrap();
        let text = format!("[timing]\nduration_s = 2.0\n[jitter]\n{keys}");
        let document = Document::from_text(&text, &folder.path().join("lab.toml"));
        Bench::from_document(&document).map_err(|error| error.to_string())
    }

    fn series(seconds: u32) -> String {
        let rows = (0..=10 * seconds).map(|i| format!("{},{}\n", f64::from(i) / 10.0, i % 3));
        rows.fold("t_s,x_arcsec\n".to_owned(), |text, row| text + &row)
    }

    #[test]
    fn a_series_and_a_density_are_read() {
        let keys = "series = \"j.csv\"\nscale = 2.0\naxes = \"body\"\n";
        let input = bench(&series(2), keys).unwrap().jitter.unwrap();
        let record = input.record(1).unwrap();
        assert_eq!((input.axes, record.end(), record.samples().len()), (JitterAxes::Body, RecordEnd::Still, 21));
        assert!((record.samples()[2].x - 4.0 * ARCSEC).abs() < 1e-15);
        let density = "frequency_hz,x_arcsec2_hz\n1,1\n100,0.1\n";
        let input = bench(density, "density = \"j.csv\"\n").unwrap().jitter.unwrap();
        let [record, other] = [1, 2].map(|seed| input.record(seed).unwrap());
        assert!(record.duration_s() >= 6.0 && input.start_s <= -1.0 && record != other, "the seed makes the series");
        assert!(Bench::built_in().unwrap().jitter.is_none());
    }

    #[test]
    fn a_record_that_is_shorter_than_the_run_is_refused_unless_it_says_what_follows() {
        let error = bench(&series(1), "series = \"j.csv\"\n").unwrap_err();
        assert!(error.contains("0 s to 2 s") && error.contains("at_end = \"repeat\""), "{error}");
        let error = bench(&series(5), "series = \"j.csv\"\nstart_s = 0.5\n").unwrap_err();
        assert!(error.contains("from 0.5 s"), "{error}");
        for (word, end) in [("repeat", RecordEnd::Repeat), ("still", RecordEnd::Still)] {
            let input =
                bench(&series(1), &format!("series = \"j.csv\"\nat_end = \"{word}\"\n")).unwrap().jitter.unwrap();
            assert_eq!(input.record(1).unwrap().end(), end);
        }
        assert!(bench(&series(5), "series = \"j.csv\"\nstart_s = -1.0\n").is_ok());
    }

    #[test]
    fn bad_jitter_is_refused_with_its_line() {
        for (rows, keys, part) in [
            ("t_s,x\n", "series = \"j.csv\"\n", "j.csv:line 1"),
            ("t_s,x_arcsec\n0,1\n1,x\n", "series = \"j.csv\"\n", "j.csv:line 3"),
            ("f_hz,x_arcsec2_hz\n2,1\n1,1\n", "density = \"j.csv\"\n", "j.csv:line 3"),
            (
                "",
                "series = \"j.csv\"\ndensity = \"j.csv\"\n",
                "jitter.density is given; wanted no jitter.series beside it: give series or density, not both",
            ),
            ("", "scale = 2.0\n", "no jitter.scale here: it belongs to jitter.series or jitter.density"),
            ("", "series = \"none.csv\"\n", "none.csv"),
            ("f_hz,x_arcsec2_hz\n1,1\n2,1\n", "density = \"j.csv\"\nat_end = \"repeat\"\n", "jitter.at_end"),
        ] {
            let error = bench(rows, keys).unwrap_err();
            assert!(error.contains(part), "{keys}\n{error}");
        }
    }
}
