//! `--bright` of `starloop catalog import`: Hipparcos and Tycho-2 files, the last input of an import.

use crate::cli::catalog_file::{mark, name_of};
use crate::cli::progress::ProgressLine;
use anyhow::ensure;
use imports::published::{add_bright, bright::BrightStars};
use stars::layer::Sorting;
use std::path::PathBuf;

/// The name of all of them together among an import's inputs.
pub(super) const INPUT: &str = "bright stars";

/// The bright files of an import.
pub(super) struct BrightInput<'a> {
    files: &'a [PathBuf],
    epoch_yr: f64,
    mark: String,
    is_taken_in: bool,
}

impl<'a> BrightInput<'a> {
    /// Files for stars of `epoch_yr`.
    pub(super) fn new(files: &'a [PathBuf], epoch_yr: f64, sorting: &Sorting) -> anyhow::Result<Self> {
        let mark_of = |path: &PathBuf| Ok(format!("{} of {}", name_of(path)?, mark(path)?));
        let marks = files.iter().map(mark_of).collect::<anyhow::Result<Vec<_>>>()?;
        let mark = format!("[{}] at J{epoch_yr}", marks.join("; "));
        let is_taken_in = sorting.has(INPUT, &mark)?;
        Ok(Self { files, epoch_yr, mark, is_taken_in })
    }

    /// Refuses more files: the bright stars are matched with all that was taken in before.
    pub(super) fn refuse_more(&self, name: &str) -> anyhow::Result<()> {
        ensure!(!self.is_taken_in, "{name}: the bright stars were matched before it came; start over with all files");
        Ok(())
    }

    /// Adds the stars that are missing.
    pub(super) fn take_in(&self, sorting: &mut Sorting, line: &ProgressLine) -> anyhow::Result<()> {
        if self.files.is_empty() {
            return Ok(());
        }
        if self.is_taken_in {
            eprintln!("{INPUT}: taken in before");
            return Ok(());
        }
        let mut bright = BrightStars::default();
        for (number, path) in self.files.iter().enumerate() {
            line.show(&format!("bright file {} of {}: {}", number + 1, self.files.len(), path.display()));
            bright.read(path)?;
        }
        line.show("bright stars: looking for them among those taken in");
        add_bright(bright, self.epoch_yr, sorting)?;
        Ok(sorting.checkpoint(INPUT, &self.mark)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Vega as `suppl_1.dat` has it.
    const VEGA: &str = "3105 02070 1|H|279.23410832|+38.78299311|  201.0|  287.5|  0.5|  0.5|  0.6|  0.6|H|      |     | \
        0.087|0.002|999| | 91262 \n";

    #[test]
    fn bright_stars_come_last_and_once() {
        let folder = tempfile::tempdir().unwrap();
        let (work, file) = (folder.path().join("work"), folder.path().join("suppl_1.dat"));
        std::fs::write(&file, VEGA).unwrap();
        let files = [file];
        let start = || Sorting::start(&work, &[10.0]).unwrap();
        let line = ProgressLine::new();
        let mut sorting = start();
        let bright = BrightInput::new(&files, 2016.0, &sorting).unwrap();
        bright.refuse_more("more.csv").unwrap();
        bright.take_in(&mut sorting, &line).unwrap();
        assert_eq!(sorting.counts().stars, 1);
        let mut sorting = start();
        let bright = BrightInput::new(&files, 2016.0, &sorting).unwrap();
        assert!(bright.refuse_more("more.csv").unwrap_err().to_string().contains("more.csv: the bright stars were"));
        bright.take_in(&mut sorting, &line).unwrap();
        assert_eq!(sorting.counts().stars, 1, "once");
        // The same file by another name: no star twice.
        let (copy, work) = (folder.path().join("copy.dat"), folder.path().join("twice"));
        std::fs::write(&copy, VEGA).unwrap();
        let twice = [files[0].clone(), copy];
        let mut both = Sorting::start(&work, &[10.0]).unwrap();
        BrightInput::new(&twice, 2016.0, &both).unwrap().take_in(&mut both, &line).unwrap();
        assert_eq!(both.counts().stars, 1, "once of two files");
        assert!(both.reported().any(|reported| reported == ("bright stars that came twice, taken once", 1)));
        let other = BrightInput::new(&[], 2016.0, &sorting).err().expect("refused").to_string();
        assert!(other.contains("\"bright stars\" was taken in as [suppl_1.dat"), "{other}");
    }
}
