//! A file of rows in any order -> its rows in the order of a layer, in bounded memory.
//!
//! As many rows as the budget holds are sorted at a time; when there are more, each such run is written beside the
//! file, and the runs are merged, at most [`FAN_IN`] at once. Memory does not depend on where the stars are: all of
//! them may be in one place. The order is total, so the bytes of a layer depend neither on the order of the input nor
//! on the budget. A star whose row comes twice (the same number, place and magnitude) is given once and counted. Tests:
//! below, `tests/allocations/imports.rs` (bytes held).

use super::star::{IDENTITY_BYTES, ROW_BYTES, WaitingRow};
use crate::layer::error;
use base::refused::Refused;
use core::cmp::Reverse;
use std::collections::BinaryHeap;
use std::fs::{self, File, OpenOptions};
use std::io::{BufReader, BufWriter, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

/// Runs that are merged at once.
const FAN_IN: usize = 64;
/// Buffer of each file that is read or written, bytes.
const BUFFER_BYTES: usize = 64 << 10;

/// A row with what it is sorted by: tile, magnitude, number, and all of its bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Sorted {
    tile: u64,
    g: u16,
    number: i64,
    bytes: [u8; ROW_BYTES],
}

/// Bytes of a row while it is sorted in memory.
pub(super) const SORTED_BYTES: usize = size_of::<Sorted>();

impl Sorted {
    fn new(bytes: [u8; ROW_BYTES], order: u8) -> Self {
        let row = WaitingRow::from_bytes(&bytes);
        Self { tile: row.tile(order), g: row.g, number: row.source_id, bytes }
    }

    fn is_same_star(&self, other: &Self) -> bool {
        self.bytes[..IDENTITY_BYTES] == other.bytes[..IDENTITY_BYTES]
    }
}

/// Shows the rows of a file of rows, as they come.
pub(super) fn each_row(path: &Path, look: &mut dyn FnMut(&WaitingRow)) -> Result<(), Refused> {
    let mut rows = Rows::open(path)?;
    while let Some(bytes) = rows.next()? {
        look(&WaitingRow::from_bytes(&bytes));
    }
    Ok(())
}

/// Takes a file's rows in the order of a layer.
pub(super) struct RunSort {
    /// HEALPix order of the layer's tiles.
    pub(super) order: u8,
    /// Most rows in memory.
    pub(super) most_rows: usize,
}

impl RunSort {
    /// Shows each star of the file of rows `path` once, by tile, brightest first; how many rows were of a star that was
    /// there before.
    pub(super) fn each_star(
        &self,
        path: &Path,
        take: &mut dyn FnMut(u64, &WaitingRow) -> Result<(), Refused>,
    ) -> Result<u64, Refused> {
        let mut doubled = 0;
        let mut before: Option<Sorted> = None;
        let mut take_once = |row: Sorted| {
            if before.as_ref().is_some_and(|before| before.is_same_star(&row)) {
                doubled += 1;
                return Ok(());
            }
            before = Some(row);
            take(row.tile, &WaitingRow::from_bytes(&row.bytes))
        };
        let mut runs = Runs { path, files: Vec::new(), made: 0 };
        let mut rows = Rows::open(path)?;
        let mut sorted = self.buffer(path, rows.left)?;
        loop {
            self.fill(&mut rows, &mut sorted)?;
            if rows.left == 0 && runs.files.is_empty() {
                sorted.drain(..).try_for_each(&mut take_once)?;
                return Ok(doubled);
            }
            if sorted.is_empty() {
                break;
            }
            runs.write(|out| sorted.drain(..).try_for_each(|row| out.write_all(&row.bytes)))?;
        }
        drop(sorted);
        while runs.files.len() > FAN_IN {
            let first: Vec<PathBuf> = runs.files.drain(..FAN_IN).collect();
            let mut merge = Merge::open(&first, self.order)?;
            runs.write_rows(&mut merge)?;
            remove(&first)?;
        }
        let mut merge = Merge::open(&runs.files, self.order)?;
        while let Some(row) = merge.next()? {
            take_once(row)?;
        }
        remove(&runs.files)?;
        Ok(doubled)
    }

    /// Returns the memory for as many of `rows` rows as are sorted at a time.
    fn buffer(&self, path: &Path, rows: u64) -> Result<Vec<Sorted>, Refused> {
        let rows = usize::try_from(rows).unwrap_or(usize::MAX).min(self.most_rows.max(1));
        let mut sorted = Vec::new();
        let bytes = rows.saturating_mul(SORTED_BYTES);
        sorted.try_reserve_exact(rows).map_err(|_| error::memory(path, bytes))?;
        Ok(sorted)
    }

    /// Reads as many rows as there is memory for, and sorts them.
    fn fill(&self, rows: &mut Rows<'_>, sorted: &mut Vec<Sorted>) -> Result<(), Refused> {
        while sorted.len() < sorted.capacity().min(self.most_rows.max(1)) {
            let Some(bytes) = rows.next()? else { break };
            sorted.push(Sorted::new(bytes, self.order));
        }
        sorted.sort_unstable();
        Ok(())
    }
}

/// Rows of a file, one after the other.
struct Rows<'a> {
    path: &'a Path,
    file: BufReader<File>,
    /// Rows to come.
    left: u64,
}

impl<'a> Rows<'a> {
    fn open(path: &'a Path) -> Result<Self, Refused> {
        let file = File::open(path).map_err(Refused::file("cannot read", path))?;
        let bytes = file.metadata().map_err(Refused::file("cannot read", path))?.len();
        if !bytes.is_multiple_of(ROW_BYTES as u64) {
            return Err(error::work(path, format!("{bytes} bytes are not whole rows")));
        }
        Ok(Self { path, file: BufReader::with_capacity(BUFFER_BYTES, file), left: bytes / ROW_BYTES as u64 })
    }

    fn next(&mut self) -> Result<Option<[u8; ROW_BYTES]>, Refused> {
        if self.left == 0 {
            return Ok(None);
        }
        let mut bytes = [0; ROW_BYTES];
        self.file.read_exact(&mut bytes).map_err(Refused::file("cannot read", self.path))?;
        self.left -= 1;
        Ok(Some(bytes))
    }
}

/// Sorted runs beside a file of rows.
struct Runs<'a> {
    path: &'a Path,
    files: Vec<PathBuf>,
    made: usize,
}

impl Runs<'_> {
    /// Writes a run. Its name ends as those of files of rows do: what is left of it after a crash is removed with them.
    fn write(&mut self, write: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<(), Refused> {
        let path = self.path.with_extension(format!("run{}.rows", self.made));
        let written = new_file(&path).and_then(|file| {
            let mut out = BufWriter::with_capacity(BUFFER_BYTES, file);
            write(&mut out)?;
            out.flush()
        });
        self.made += 1;
        self.files.push(path.clone());
        written.map_err(Refused::file("cannot write", &path))
    }

    fn write_rows(&mut self, merge: &mut Merge<'_>) -> Result<(), Refused> {
        let mut failed = None;
        self.write(|out| {
            loop {
                match merge.next() {
                    Ok(Some(row)) => out.write_all(&row.bytes)?,
                    Ok(None) => return Ok(()),
                    Err(error) => {
                        failed = Some(error);
                        return Ok(());
                    }
                }
            }
        })?;
        failed.map_or(Ok(()), Err)
    }
}

/// Returns a new file in the place of one that a killed import may have left; no link is followed.
pub(super) fn new_file(path: &Path) -> std::io::Result<File> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
        Ok(()) | Err(_) => {}
    }
    OpenOptions::new().read(true).write(true).create_new(true).open(path)
}

fn remove(paths: &[PathBuf]) -> Result<(), Refused> {
    paths.iter().try_for_each(|path| fs::remove_file(path).map_err(Refused::file("cannot remove", path)))
}

/// Several sorted runs as one.
struct Merge<'a> {
    order: u8,
    runs: Vec<Rows<'a>>,
    /// The next row of each run.
    next: BinaryHeap<Reverse<(Sorted, usize)>>,
}

impl<'a> Merge<'a> {
    fn open(paths: &'a [PathBuf], order: u8) -> Result<Self, Refused> {
        let runs = paths.iter().map(|path| Rows::open(path)).collect::<Result<Vec<_>, _>>()?;
        let mut merge = Self { order, runs, next: BinaryHeap::with_capacity(paths.len()) };
        (0..paths.len()).try_for_each(|run| merge.fetch(run))?;
        Ok(merge)
    }

    fn fetch(&mut self, run: usize) -> Result<(), Refused> {
        if let Some(bytes) = self.runs[run].next()? {
            self.next.push(Reverse((Sorted::new(bytes, self.order), run)));
        }
        Ok(())
    }

    fn next(&mut self) -> Result<Option<Sorted>, Refused> {
        let Some(Reverse((row, run))) = self.next.pop() else { return Ok(None) };
        self.fetch(run)?;
        Ok(Some(row))
    }
}

#[cfg(test)]
mod tests {
    use super::super::star::{NewStar, StarCounts};
    use super::*;
    use rand::rngs::StdRng;
    use rand::{RngExt, SeedableRng};

    /// Returns rows; every tenth comes twice.
    fn rows(count: usize) -> Vec<u8> {
        let mut rng = StdRng::seed_from_u64(1);
        let mut bytes = Vec::new();
        for number in 0..count {
            let star = NewStar {
                source_id: number as i64,
                ra_rad: rng.random_range(1.0..1.01),
                dec_rad: 0.3,
                motion_mas_yr: None,
                parallax_mas: None,
                mag_g: f64::from(rng.random_range(9..13_u8)),
                bp_rp: None,
            };
            let row = WaitingRow::new(&star, &mut StarCounts::default()).unwrap().to_bytes();
            (0..if number % 10 == 0 { 2 } else { 1 }).for_each(|_| bytes.extend(row));
        }
        bytes
    }

    #[test]
    fn rows_come_in_one_order_whatever_the_memory() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("layer0_part0000.rows");
        fs::write(&path, rows(5000)).unwrap();
        let sorted = |most_rows: usize| {
            let mut stars = Vec::new();
            let sort = RunSort { order: 8, most_rows };
            let mut take = |tile, row: &WaitingRow| {
                stars.push((tile, row.to_bytes()));
                Ok(())
            };
            let doubled = sort.each_star(&path, &mut take).unwrap();
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "{most_rows}: no run is left");
            (doubled, stars)
        };
        let at_once = sorted(1 << 20);
        assert_eq!((at_once.0, at_once.1.len()), (500, 5000));
        assert!(at_once.1.is_sorted_by_key(|(tile, row)| (*tile, WaitingRow::from_bytes(row).g)));
        // 30 rows at a time make 184 runs, more than are merged at once.
        for most_rows in [0, 30, 700, 5499, 5500] {
            let most_rows = if most_rows == 0 { 40 } else { most_rows };
            assert!(sorted(most_rows) == at_once, "{most_rows} rows at a time");
        }
    }

    #[test]
    fn rows_that_are_cut_are_reported() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("layer0_part0000.rows");
        fs::write(&path, &rows(3)[1..]).unwrap();
        let sort = RunSort { order: 8, most_rows: 10 };
        let reported = sort.each_star(&path, &mut |_, _| Ok(())).unwrap_err().to_string();
        assert!(reported.contains("are not whole rows"), "{reported}");
    }
}
