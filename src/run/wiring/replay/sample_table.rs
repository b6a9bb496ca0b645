//! `samples.csv`: the samples that a captured run took from a plant in lockstep, writer and reader.
//!
//! Columns: the part of a sample, its instant (TAI ns since 1970), on the real clock its arrival, and its numbers in
//! the fewest digits that give the same bits again. One row per part: `attitude` has w x y z, rate, acceleration
//! (rad/s, rad/s^2, body axes); `observer` position and velocity (km, km/s); `jitter` a rotation vector (rad, body
//! axes). Rows are in the order in which samples were sent; in lockstep each acts at its own instant, on the real clock
//! at its arrival. Limits: [`SAMPLES_MAX`] rows. Tests: below, `tests/closed_loop/lockstep.rs`.

use super::{ReplayError, Result, table_lines::TableLines};
use crate::runtime::{PlantAttitude, PlantSample};
use base::{axes::Rotation, refused::Refused, time::Tai};
use glam::DVec3;
use sky::observer::BarycentricState;
use std::io::{BufRead, BufReader, BufWriter, Write};
use std::{fs::File, path::Path};

/// Name of the file.
pub(super) const SAMPLES_FILE: &str = "samples.csv";
/// First line, in lockstep.
const HEADER: &str = "part,at_tai_ns,numbers";
/// First line, on the real clock.
const HEADER_REAL: &str = "part,at_tai_ns,arrived_tai_ns,numbers";
/// Largest number of rows that are read: a day of 100 Hz, about 2 GB of memory in a replay.
const SAMPLES_MAX: u64 = 10_000_000;
const DOING: &str = "read the samples";
/// Longest row, bytes.
const ROW_MAX: (u64, &str) = (512, "longer than 512 bytes");
/// Largest difference from 1 of a quaternion's norm: captured quaternions were normalised.
const NORM_TOLERANCE: f64 = 1e-9;

/// The table during a run.
pub(super) struct SampleWriter {
    out: BufWriter<File>,
    is_real: bool,
    rows: u64,
    error: Option<String>,
}

impl SampleWriter {
    /// Starts the file; on the real clock every row has its arrival.
    pub(super) fn create(directory: &Path, is_real: bool) -> Result<Self> {
        let path = directory.join(SAMPLES_FILE);
        let refuse = ReplayError::file(&path, "write the samples");
        let mut out = BufWriter::new(File::create_new(&path).map_err(refuse)?);
        writeln!(out, "{}", if is_real { HEADER_REAL } else { HEADER }).and_then(|()| out.flush()).map_err(refuse)?;
        Ok(Self { out, is_real, rows: 0, error: None })
    }

    /// Writes a list that the run has taken at this instant. After an error nothing more is written; the session
    /// reports it.
    pub(super) fn write(&mut self, samples: &[PlantSample], arrived: Tai) {
        if self.error.is_some() {
            return;
        }
        let (mut text, mut rows) = (String::new(), 0);
        for sample in samples {
            rows += write_rows(sample, self.is_real.then_some(arrived), &mut text);
        }
        match self.out.write_all(text.as_bytes()).and_then(|()| self.out.flush()) {
            Ok(()) => self.rows += rows,
            Err(error) => self.error = Some(format!("{SAMPLES_FILE}: {error}")),
        }
    }

    /// Returns the number of rows, and why writing ended early, if it did.
    pub(super) fn finish(&mut self) -> (u64, Option<String>) {
        (self.rows, self.error.take())
    }
}

/// Writes the rows of one sample; returns their number.
fn write_rows(sample: &PlantSample, arrived: Option<Tai>, text: &mut String) -> u64 {
    let mut rows = 0;
    let mut row = |part: &str, numbers: &[f64]| {
        rows += 1;
        text.push_str(part);
        for instant in core::iter::once(sample.at).chain(arrived) {
            text.push_str(&format!(",{}", instant.ns()));
        }
        numbers.iter().for_each(|number| text.push_str(&format!(",{number:?}")));
        text.push('\n');
    };
    if let Some(BarycentricState { position_km, velocity_km_s }) = sample.observer {
        row("observer", &joined(&[position_km, velocity_km_s]));
    }
    if let Some(PlantAttitude { body_from_icrf, rate_rad_s, acceleration_rad_s2 }) = sample.attitude {
        let q = body_from_icrf.quat();
        let numbers = [&[q.w, q.x, q.y, q.z][..], &joined(&[rate_rad_s, acceleration_rad_s2])].concat();
        row("attitude", &numbers);
    }
    if let Some(rotation_rad) = sample.jitter_rad {
        row("jitter", &rotation_rad.to_array());
    }
    rows
}

fn joined(vectors: &[DVec3]) -> Vec<f64> {
    vectors.iter().flat_map(DVec3::to_array).collect()
}

/// A sample of a captured run, with one part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CapturedSample {
    /// The sample.
    pub sample: PlantSample,
    /// Time at which the run took it; in lockstep its own instant.
    pub arrived: Tai,
}

/// Reads the rows one by one.
pub struct SampleReader<R> {
    lines: TableLines<R>,
    /// True when rows have their arrival.
    is_real: bool,
}

impl SampleReader<BufReader<File>> {
    /// Opens the file and checks its first line.
    ///
    /// # Errors
    /// When it cannot be read, or is not a table of samples.
    pub fn open(path: &Path) -> Result<Self> {
        Self::of(TableLines::open(path, DOING, ROW_MAX)?)
    }
}

impl<R: BufRead> SampleReader<R> {
    /// Reads from `source`; errors name `path`.
    ///
    /// # Errors
    /// When its first line is not that of a table of samples.
    pub fn new(source: R, path: &Path) -> Result<Self> {
        Self::of(TableLines::new(source, path, DOING, ROW_MAX))
    }

    fn of(mut lines: TableLines<R>) -> Result<Self> {
        let text = lines.read()?.unwrap_or_default();
        let is_real = text == HEADER_REAL;
        if is_real || text == HEADER {
            return Ok(Self { lines, is_real });
        }
        Err(lines.refuse("wanted part,at_tai_ns,numbers, or arrived_tai_ns beside at_tai_ns", &text))
    }

    /// Returns true when the last line was cut off, as by a power cut; it is left out.
    pub fn is_cut_off(&self) -> bool {
        self.lines.is_cut_off()
    }

    /// Returns the next sample; `None` at the end.
    ///
    /// # Errors
    /// When the line is not a valid row, or there are too many.
    pub fn read(&mut self) -> Result<Option<CapturedSample>> {
        let Some(text) = self.lines.read()? else { return Ok(None) };
        if self.lines.line() > SAMPLES_MAX + 1 {
            return Err(self.lines.refuse("more rows than the 10,000,000 that are read", &text));
        }
        parse(&text, self.is_real).map(Some).map_err(|why| self.lines.refuse(why, &text))
    }
}

/// Reads a row without its line's end.
fn parse(text: &str, is_real: bool) -> Result<CapturedSample, &'static str> {
    let mut fields = text.split(',');
    let part = fields.next().unwrap_or_default();
    let at_ns = fields.next().and_then(|field| field.parse().ok()).ok_or("at_tai_ns: wanted a whole number")?;
    let mut arrived = || fields.next().and_then(|field| field.parse().ok());
    let arrived_ns = if is_real { arrived().ok_or("arrived_tai_ns: wanted a whole number")? } else { at_ns };
    let sample = sample_of(part, PlantSample::at(Tai::from_ns(at_ns)), fields)?;
    Ok(CapturedSample { sample, arrived: Tai::from_ns(arrived_ns) })
}

/// Reads the numbers of a part.
fn sample_of<'t>(
    part: &str,
    sample: PlantSample,
    fields: impl Iterator<Item = &'t str>,
) -> Result<PlantSample, &'static str> {
    let finite = |field: &str| field.parse().ok().filter(|number: &f64| number.is_finite());
    let numbers: Option<Vec<f64>> = fields.map(finite).collect();
    let numbers = numbers.ok_or("numbers: wanted finite numbers")?;
    match (part, numbers.as_slice()) {
        ("attitude", &[w, x, y, z, rx, ry, rz, ax, ay, az]) => {
            let unit = "attitude: wanted a quaternion of norm 1";
            let body_from_icrf = Rotation::from_unit_wxyz([w, x, y, z], NORM_TOLERANCE).ok_or(unit)?;
            let (rate_rad_s, acceleration_rad_s2) = (DVec3::new(rx, ry, rz), DVec3::new(ax, ay, az));
            let attitude = Some(PlantAttitude { body_from_icrf, rate_rad_s, acceleration_rad_s2 });
            Ok(PlantSample { attitude, ..sample })
        }
        ("observer", &[x, y, z, vx, vy, vz]) => {
            let state = BarycentricState { position_km: DVec3::new(x, y, z), velocity_km_s: DVec3::new(vx, vy, vz) };
            Ok(PlantSample { observer: Some(state), ..sample })
        }
        ("jitter", &[x, y, z]) => Ok(PlantSample { jitter_rad: Some(DVec3::new(x, y, z)), ..sample }),
        _ => Err("wanted attitude and 10 numbers, observer and 6, or jitter and 3, after the instant"),
    }
}

/// Returns the sort key by which a run in lockstep takes parts of samples: by instant, then in the order of
/// [`write_rows`].
fn key(CapturedSample { sample, .. }: &CapturedSample) -> (Tai, bool, bool) {
    (sample.at, sample.observer.is_none(), sample.attitude.is_none())
}

/// The samples of a captured run.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Samples {
    /// Samples in the order in which they act.
    pub(super) samples: Vec<CapturedSample>,
    /// True when the last row was cut off and is left out.
    pub(super) is_cut_off: bool,
}

/// Reads the samples of a captured run.
pub(super) fn read_all(directory: &Path) -> Result<Samples> {
    let path = directory.join(SAMPLES_FILE);
    let mut reader = SampleReader::open(&path)?;
    let mut samples = Vec::new();
    while let Some(sample) = reader.read()? {
        samples.push(sample);
    }
    if reader.is_real {
        return Ok(Samples { samples, is_cut_off: reader.is_cut_off() });
    }
    samples.sort_by_key(key);
    let twice = samples.iter().zip(samples.iter().skip(1)).find(|(one, next)| key(one) == key(next));
    if let Some((first, _)) = twice {
        let (why, text) = ("a part of this instant is there twice; wanted it once", first.sample.at.to_rfc3339());
        return Err(Refused(format!("{}:0: {why}; got \"{text}\"", path.display())).into());
    }
    Ok(Samples { samples, is_cut_off: reader.is_cut_off() })
}

/// Counts the rows of a captured run.
pub(super) fn count(path: &Path) -> Result<u64> {
    let mut reader = SampleReader::open(path)?;
    let mut rows = 0;
    while reader.read()?.is_some() {
        rows += 1;
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> PlantSample {
        let body_from_icrf = Rotation::from_rotation_vector(DVec3::new(0.1, -0.2, 1.0 / 3.0));
        let (rate_rad_s, acceleration_rad_s2) = (DVec3::new(1e-300, -0.0, 0.1 + 0.2), DVec3::new(1.0, 2e9, -3.5));
        PlantSample {
            at: Tai::from_ns(1_772_366_401_000_000_007),
            attitude: Some(PlantAttitude { body_from_icrf, rate_rad_s, acceleration_rad_s2 }),
            jitter_rad: Some(DVec3::new(1e-7, -3e-9, 0.7)),
            observer: Some(BarycentricState { position_km: DVec3::X * 7e3 / 3.0, velocity_km_s: DVec3::Y * 7.1 }),
        }
    }

    #[test]
    fn sample_comes_back_bit_by_bit() {
        let directory = tempfile::tempdir().unwrap();
        let mut writer = SampleWriter::create(directory.path(), false).unwrap();
        writer.write(&[sample()], Tai::from_ns(1));
        assert_eq!(writer.finish(), (3, None));
        let Samples { samples: read, is_cut_off } = read_all(directory.path()).unwrap();
        let parts = |sample: &PlantSample| {
            let wanted = PlantSample::at(sample.at);
            let observer = PlantSample { observer: sample.observer, ..wanted };
            let attitude = PlantSample { attitude: sample.attitude, ..wanted };
            let all = [observer, attitude, PlantSample { jitter_rad: sample.jitter_rad, ..wanted }];
            all.map(|sample| CapturedSample { sample, arrived: sample.at }).to_vec()
        };
        assert_eq!((read, is_cut_off), (parts(&sample()), false));
        let bits =
            |captured: &PlantSample| captured.attitude.unwrap().body_from_icrf.quat().to_array().map(f64::to_bits);
        let path = directory.path().join(SAMPLES_FILE);
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(bits(&read_all(directory.path()).unwrap().samples[1].sample), bits(&sample()));
        std::fs::write(&path, text.replace("1772366401000000007", "1772366401000000008")).unwrap();
        assert_ne!(read_all(directory.path()).unwrap().samples, parts(&sample()), "control");
        std::fs::write(&path, format!("{text}{}", text.lines().nth(1).unwrap())).unwrap();
        assert!(read_all(directory.path()).unwrap().is_cut_off, "a row without its end");
        std::fs::write(&path, format!("{text}{}\n", text.lines().nth(1).unwrap())).unwrap();
        assert!(read_all(directory.path()).unwrap_err().to_string().contains("twice"));
    }

    #[test]
    fn on_the_real_clock_samples_come_back_in_the_order_and_at_the_instants_in_which_they_arrived() {
        let directory = tempfile::tempdir().unwrap();
        let mut writer = SampleWriter::create(directory.path(), true).unwrap();
        let later = PlantSample { jitter_rad: Some(DVec3::X), ..PlantSample::at(Tai::from_ns(9)) };
        let earlier = PlantSample { at: Tai::from_ns(7), ..later };
        writer.write(&[later], Tai::from_ns(10));
        writer.write(&[earlier, earlier], Tai::from_ns(11));
        assert_eq!(writer.finish(), (3, None));
        let captured = |sample, arrived_ns| CapturedSample { sample, arrived: Tai::from_ns(arrived_ns) };
        let wanted = [captured(later, 10), captured(earlier, 11), captured(earlier, 11)];
        assert_eq!(read_all(directory.path()).unwrap().samples, wanted);
        let path = directory.path().join(SAMPLES_FILE);
        std::fs::write(&path, std::fs::read_to_string(&path).unwrap().replace("7,11,", "7,,")).unwrap();
        assert!(read_all(directory.path()).unwrap_err().to_string().contains("arrived_tai_ns"), "control");
    }

    #[test]
    fn bad_rows_are_refused_with_line_and_reason() {
        for (row, part) in [
            ("attitude,5,1,0,0,0,0,0,0,0,0", "attitude and 10 numbers"),
            ("attitude,5,1,0,0,0.1,0,0,0,0,0,0", "norm 1"),
            ("observer,now,1,0,0,0,0,0", "at_tai_ns"),
            ("jitter,5,1,nan,0", "finite"),
            ("elsewhere,5,1,2,0", "wanted attitude"),
        ] {
            let text = format!("{HEADER}\njitter,4,1,2,3\n{row}\n");
            let mut reader = SampleReader::new(text.as_bytes(), Path::new(SAMPLES_FILE)).unwrap();
            assert!(reader.read().unwrap().is_some(), "control");
            let error = reader.read().unwrap_err().to_string();
            assert!(error.contains(part) && error.contains("samples.csv:3"), "{row}: {error}");
        }
    }
}
