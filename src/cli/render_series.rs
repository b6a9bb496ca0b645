//! The attitudes of `starloop render --attitudes`: those of a whole file, one for each image, and the names of the images.

use crate::cli::attitude_file::{KernelArgs, attitudes};
use anyhow::{Context, Result, bail};
use base::axes::Rotation;
use base::time::{Span, Tai};
use histories::{AttitudeHistory, AttitudeMotion, AttitudeSegment, Times};
use plan::attitude::LosPath;
use std::path::{Path, PathBuf};

/// Most images of one file.
const MOST_IMAGES: usize = 100_000;

/// Attitudes of the sensor, at the middle of each exposure.
pub(super) struct Series {
    history: AttitudeHistory,
    /// Of the zero of the file's times.
    zero: Tai,
    /// Middles of exposures, on the count of the file, ns.
    mids_ns: Vec<i64>,
}

impl Series {
    /// Reads a file; an image for every row, or every `every_s` seconds. Times from a zero of the file's own count from
    /// `zero`.
    pub(super) fn read(path: &Path, kernels: &KernelArgs, zero: Tai, every_s: Option<f64>) -> Result<Self> {
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
    pub(super) fn len(&self) -> usize {
        self.mids_ns.len()
    }

    /// Returns the first and the last middle of an exposure.
    pub(super) fn span(&self) -> [Tai; 2] {
        let [first, last] = [self.mids_ns.first(), self.mids_ns.last()];
        [first, last].map(|ns| self.at(ns.copied().unwrap_or_default()))
    }

    fn at(&self, t_ns: i64) -> Tai {
        self.zero + Span::from_ns(t_ns)
    }

    /// Returns the line of sight of one image, and the middle of its exposure.
    pub(super) fn los(&self, number: usize, exposure_s: f64) -> Result<(LosPath, Tai)> {
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
pub(super) fn numbered(out: &Path, number: usize) -> Result<PathBuf> {
    let [stem, ending] = [out.file_stem(), out.extension()].map(|part| part.and_then(|part| part.to_str()));
    let (stem, ending) = stem.zip(ending).with_context(|| format!("--out {}: wanted a name", out.display()))?;
    Ok(out.with_file_name(format!("{stem}_{number:06}.{ending}")))
}

#[cfg(test)]
mod tests {
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
