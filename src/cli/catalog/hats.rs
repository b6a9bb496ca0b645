//! HATS catalogs for `starloop catalog`: what an import reads, file by file, and `starloop catalog export`.
//!
//! What opens Parquet files is at the end, in two forms: with the feature `hats` and without it.

use crate::cli::catalog::for_trackers::{self, ForTracker};
use crate::cli::terminal::ProgressLine;
use anyhow::{Context, bail, ensure};
use clap::Args;
use imports::is_hats;
use imports::published::gaia::{Names, import as import_gaia};
use stars::layer::{Layer, Sorting};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Rows that HATS importers commonly put into a partition at most.
const MAX_ROWS: usize = 1_000_000;

/// Arguments of `starloop catalog export`.
#[derive(Debug, Args)]
#[command(
    after_help = "--hats writes a HATS catalog (Parquet files partitioned by HEALPix), which Python's hats and LSDB open. Columns: \
    _healpix_29, starloop_id, source_id, ra, dec (deg, ICRS), pmra, pmdec (mas/yr), parallax (mas), phot_g_mean_mag, bp_rp (mag); null \
    where the layer has none. starloop_id is a star's place in the layers, in the order they are named; source_id, its number in \
    its source catalog, is there when all layers have numbers.\n\nValues are those that the layers hold, in their steps. `starloop catalog import DIR` makes the same layers \
    of it again.\n\n--for writes one text file with the same stars as the frames, so that a tracker has the catalog of its sky."
)]
pub(crate) struct ExportArgs {
    /// Layers of one epoch, brightest first; with --for also packed catalogs, and none for the built-in one
    #[arg(required_unless_present = "program")]
    layers: Vec<PathBuf>,
    /// Folder of the catalog, which must not be there yet; it gets its name when it is whole
    #[arg(long, value_name = "DIR", required_unless_present = "program")]
    hats: Option<PathBuf>,
    #[command(flatten)]
    tracker: ForTracker,
    /// Name of the catalog; that of the folder when left out
    #[arg(long)]
    name: Option<String>,
    /// Most stars in a partition: denser parts of the sky are parted more finely
    #[arg(long, default_value_t = MAX_ROWS, value_parser = at_least_one)]
    max_rows: usize,
}

fn at_least_one(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|rows| *rows > 0).ok_or_else(|| "wanted a number of stars from 1 on".into())
}

/// Writes layers as a catalog and prints the counts.
pub(crate) fn export(args: &ExportArgs, out: &mut impl Write) -> anyhow::Result<()> {
    if let Some(program) = args.tracker.program {
        return for_trackers::export(&args.tracker, program, &args.layers);
    }
    let hats = args.hats.as_ref().context("--hats is missing; wanted a new folder, or --for PROGRAM")?;
    let name = args.name.as_deref().or_else(|| hats.file_name()?.to_str());
    let name = name.with_context(|| format!("{}: wanted a folder with a readable name", hats.display()))?;
    let is_name = |name: &str| !name.trim().is_empty() && !name.contains(char::is_control);
    ensure!(is_name(name), "--name: wanted one line, got {name:?}");
    let layers = args.layers.iter().map(|path| Layer::open(path)).collect::<Result<Vec<_>, _>>()?;
    let line = ProgressLine::new();
    let mut share = |share: f64| line.show(&format!("{}: {:.0} %", hats.display(), 100.0 * share));
    let written = parquet::export(&layers, hats, (name, args.max_rows), &mut share)?;
    line.clear();
    writeln!(out, "{}: {written}", hats.display())?;
    Ok(())
}

/// One file that an import takes in whole.
pub(crate) struct Input {
    /// By which it is known when an import goes on.
    pub(crate) name: String,
    pub(crate) path: PathBuf,
    pub(crate) names: Names,
    pub(crate) kind: Kind,
    /// Credits that its catalog asks for.
    pub(crate) credits: Option<String>,
}

/// How a file is read.
pub(crate) enum Kind {
    Csv,
    Parquet(parquet::Parquet),
}

impl Input {
    /// Takes it in; the number of rows.
    pub(crate) fn import(&self, sorting: &mut Sorting, reported: &mut dyn FnMut(u64)) -> anyhow::Result<u64> {
        match &self.kind {
            Kind::Csv => Ok(import_gaia(&self.path, &self.names, sorting, reported)?),
            Kind::Parquet(parquet) => parquet.import(self, sorting, reported),
        }
    }
}

/// Returns the files that are named, those of catalogs one by one. `epoch_yr` must be that of the catalogs that say
/// theirs.
pub(crate) fn inputs(paths: &[PathBuf], names: &Names, epoch_yr: f64) -> anyhow::Result<Vec<Input>> {
    let mut inputs = Vec::new();
    for path in paths {
        if is_hats(path) {
            inputs.extend(parquet::partitions(path, names, epoch_yr)?);
        } else if path.is_dir() {
            bail!("{}: wanted a HATS catalog, which has a file hats.properties, or the name of a file", path.display());
        } else {
            let is_parquet = path.extension().is_some_and(|kind| kind.eq_ignore_ascii_case("parquet"));
            let kind = if is_parquet { Kind::Parquet(parquet::Parquet::alone(path)?) } else { Kind::Csv };
            inputs.push(Input { name: name_of(path)?, path: path.clone(), names: names.clone(), kind, credits: None });
        }
    }
    let mut known: Vec<&str> = inputs.iter().map(|input| input.name.as_str()).collect();
    known.sort_unstable();
    if let Some(twice) = known.windows(2).find(|pair| pair[0] == pair[1]) {
        let name = twice[0];
        bail!("two files are called {name}: a resumed import knows files by their names; rename one");
    }
    Ok(inputs)
}

// How an import knows a file again: by its name and its fingerprint.

/// Bytes at each end of a file by which it is known again.
const END_BYTES: u64 = 64 << 10;

/// Returns the name of a file without its folder: it may be moved between two tries.
pub(crate) fn name_of(path: &Path) -> anyhow::Result<String> {
    let name = path.file_name().and_then(|name| name.to_str());
    name.map(str::to_owned).with_context(|| format!("{}: wanted a file with a readable name", path.display()))
}

/// Returns the fingerprint of a file: its length, and the checksum of its two ends.
pub(crate) fn mark(path: &Path) -> anyhow::Result<String> {
    let read = || {
        let mut file = std::fs::File::open(path)?;
        let bytes = file.metadata()?.len();
        let mut ends = Vec::new();
        (&mut file).take(END_BYTES).read_to_end(&mut ends)?;
        file.seek(SeekFrom::Start(bytes.saturating_sub(END_BYTES)))?;
        file.take(END_BYTES).read_to_end(&mut ends)?;
        std::io::Result::Ok(format!("{bytes} bytes, CRC-32 of its ends {:08x}", crc32fast::hash(&ends)))
    };
    read().with_context(|| format!("cannot read {}", path.display()))
}

/// Parquet files and HATS catalogs; in a program without the feature, the same names, which fail and say how to build one
/// with it.
#[cfg(feature = "hats")]
mod parquet {
    use super::{Input, Kind};
    use anyhow::bail;
    use imports::hats::{ExportReport, Exporting, HatsCatalog, Partition, Pixel, export as export_hats, import};
    use imports::published::gaia::Names;
    use stars::layer::{Layer, Sorting};
    use std::path::Path;

    /// A Parquet file, with the pixel of the partition when it is one.
    pub(crate) struct Parquet(Option<Pixel>);

    impl Parquet {
        /// Returns a file that belongs to no catalog.
        ///
        /// # Errors
        /// In a program without the feature.
        #[allow(clippy::unnecessary_wraps, reason = "the form without the feature fails")]
        pub(crate) fn alone(_path: &Path) -> anyhow::Result<Self> {
            Ok(Self(None))
        }

        /// Imports `input`; returns the number of rows.
        pub(crate) fn import(
            &self,
            input: &Input,
            sorting: &mut Sorting,
            progress: &mut dyn FnMut(u64),
        ) -> anyhow::Result<u64> {
            Ok(import(&input.path, self.0, &input.names, sorting, progress)?)
        }
    }

    /// Returns the files of the catalog in `folder`. `epoch_yr` must be the catalog's, where it states one.
    pub(crate) fn partitions(folder: &Path, names: &Names, epoch_yr: f64) -> anyhow::Result<Vec<Input>> {
        let catalog = HatsCatalog::open(folder)?;
        if let Some(said) = catalog.epoch_yr()?.filter(|said| *said != epoch_yr) {
            bail!("--epoch: wanted {said}, the epoch of {}, got {epoch_yr}", folder.display());
        }
        let mut names = names.clone();
        catalog.name_columns(&mut names)?;
        let input = |partition: &Partition| Input {
            name: partition.name.clone(),
            path: partition.path.clone(),
            names: names.clone(),
            kind: Kind::Parquet(Parquet(Some(partition.pixel))),
            credits: catalog.credits().map(str::to_owned),
        };
        Ok(catalog.partitions.iter().map(input).collect())
    }

    /// Writes layers as a catalog of a name and at most so many rows a partition; returns in words what was written.
    pub(crate) fn export(
        layers: &[Layer],
        folder: &Path,
        (name, max_rows): (&str, usize),
        share: &mut dyn FnMut(f64),
    ) -> anyhow::Result<String> {
        let what = Exporting { name: name.into(), max_rows };
        let ExportReport { stars, partitions, orders: [from, to], bytes } = export_hats(layers, folder, &what, share)?;
        Ok(format!("{stars} stars in {partitions} partitions of order {from} to {to}, {bytes} bytes"))
    }
}

#[cfg(not(feature = "hats"))]
mod parquet {
    use super::Input;
    use anyhow::{Error, Result, anyhow};
    use imports::published::gaia::Names;
    use stars::layer::{Layer, Sorting};
    use std::path::Path;

    /// A Parquet file, which this program cannot read.
    pub(crate) enum Parquet {}

    impl Parquet {
        /// Fails for every file.
        pub(crate) fn alone(path: &Path) -> Result<Self> {
            Err(missing(path))
        }

        /// Imports it.
        pub(crate) fn import(&self, _: &Input, _: &mut Sorting, _: &mut dyn FnMut(u64)) -> Result<u64> {
            match *self {}
        }
    }

    /// Fails for every catalog.
    pub(crate) fn partitions(folder: &Path, _: &Names, _: f64) -> Result<Vec<Input>> {
        Err(missing(folder))
    }

    /// Writes nothing and fails.
    pub(crate) fn export(_: &[Layer], folder: &Path, _: (&str, usize), _: &mut dyn FnMut(f64)) -> Result<String> {
        Err(missing(folder))
    }

    fn missing(path: &Path) -> Error {
        anyhow!(
            "{}: this program was built without HATS catalogs and Parquet files; install one with \
             `cargo install --locked --path . --features hats`",
            path.display()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::catalog::layers::{ImportArgs, import};
    use clap::Parser;

    #[derive(Debug, Parser)]
    enum Program {
        Import(ImportArgs),
        Export(ExportArgs),
    }

    /// Returns the output of `starloop catalog`, or its error.
    fn catalog(line: &[&str]) -> Result<String, String> {
        let mut out = Vec::new();
        let done = match Program::try_parse_from([&["x"], line].concat()).map_err(|error| error.to_string())? {
            Program::Import(args) => import(&args, &mut out),
            Program::Export(args) => export(&args, &mut out),
        };
        done.map(|()| String::from_utf8(out).unwrap()).map_err(|error| format!("{error:#}"))
    }

    #[cfg(feature = "hats")]
    #[test]
    fn layers_become_a_catalog_and_an_import_of_it_that_was_cut_short_goes_on() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let rows = (0..1000).map(|i| format!("{i},{}.5,{}.25,,,,{}.5,\n", i % 360, i % 80, 4 + i % 5));
        let head = "source_id,ra,dec,pmra,pmdec,parallax,phot_g_mean_mag,bp_rp\n";
        std::fs::write(path("stars.csv"), head.to_owned() + &rows.collect::<String>()).unwrap();
        catalog(&["import", &path("stars.csv"), "--out", &path("layers"), "--layers", "10"]).unwrap();
        let layer = path("layers/g10.starlayer");
        let reported = catalog(&["export", &layer, "--hats", &path("hats"), "--max-rows", "90"]).unwrap();
        assert!(
            reported.contains("hats: 1000 stars in ") && reported.contains(" partitions of order 0 to 2, "),
            "{reported}"
        );
        assert!(catalog(&["export", &layer, "--hats", &path("hats")]).unwrap_err().contains("there already"));

        let from_hats = ["import", &path("hats"), "--out", &path("again"), "--layers", "10"];
        let list = std::fs::read_to_string(path("hats/partition_info.csv")).unwrap();
        let (order, pixel) = list.lines().last().unwrap().split_once(',').unwrap();
        let last = path(&format!("hats/dataset/Norder={order}/Dir=0/Npix={pixel}.parquet"));
        let whole = std::fs::read(&last).unwrap();
        let mut broken = whole.clone();
        let end = whole.len() - 8;
        let footer = u32::from_le_bytes(whole[end..end + 4].try_into().unwrap()) as usize;
        broken[4..end - footer].fill(0xFF);
        std::fs::write(&last, broken).unwrap();
        let reported = catalog(&from_hats).unwrap_err();
        assert!(
            reported.contains(&format!("Npix={pixel}.parquet, column source_id")) || reported.contains("starloop_id"),
            "{reported}"
        );
        std::fs::write(&last, whole).unwrap();
        let progress = std::fs::read_to_string(path("again/import/progress.json")).unwrap();
        assert!(progress.contains("hats/dataset/Norder="), "whole partitions are written down: {progress}");
        let reported = catalog(&from_hats).unwrap();
        assert!(
            reported.contains("        1000 rows\n") && reported.contains("        1000 stars taken in\n"),
            "{reported}"
        );
        assert_eq!(std::fs::read(path("again/g10.starlayer")).unwrap(), std::fs::read(layer).unwrap());

        let reported = catalog(&["import", &path("hats"), "--out", &path("epoch"), "--epoch", "2000"]).unwrap_err();
        assert!(reported.contains("--epoch: wanted 2016, the epoch of") && reported.contains("got 2000"), "{reported}");
        let reported = catalog(&["import", &path("layers"), "--out", &path("no")]).unwrap_err();
        assert!(reported.contains("layers: wanted a HATS catalog, which has a file hats.properties"), "{reported}");
        let twice = catalog(&["import", &path("hats"), &path("hats"), "--out", &path("twice")]).unwrap_err();
        assert!(twice.contains("two files are called hats/dataset/"), "{twice}");
    }

    #[cfg(not(feature = "hats"))]
    #[test]
    fn program_without_hats_says_how_to_build_it_and_writes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        std::fs::write(path("stars.csv"), "source_id,ra,dec,phot_g_mean_mag\n1,10.5,20.5,6.5\n").unwrap();
        let no_colour = ["pmra=", "pmdec=", "parallax=", "bp_rp="].map(|column| ["--column", column]).concat();
        let (stars, layers) = (path("stars.csv"), path("layers"));
        catalog(&[&["import", &stars, "--out", &layers], &no_colour[..]].concat()).unwrap();
        let layer = path("layers/g10.starlayer");
        std::fs::create_dir(path("gaia")).unwrap();
        std::fs::write(path("gaia/hats.properties"), "").unwrap();
        for line in [
            &["export", &layer, "--hats", &path("out")],
            &["import", &path("gaia"), "--out", &path("out")],
            &["import", &path("stars.parquet"), "--out", &path("out")],
        ] {
            let error = catalog(line).unwrap_err();
            assert!(error.contains("built without HATS catalogs") && error.contains("--features hats"), "{error}");
            assert!(!folder.path().join("out").exists(), "{line:?}");
        }
        assert!(catalog(&["export", "no.starlayer", "--hats", "b"]).unwrap_err().contains("no.starlayer"), "control");
    }

    #[test]
    fn bad_arguments_are_named() {
        assert!(catalog(&["export", "a", "--hats", "b", "--max-rows", "0"]).unwrap_err().contains("from 1 on"));
        assert!(catalog(&["export", "no.starlayer", "--hats", "b"]).unwrap_err().contains("no.starlayer"));
        assert!(
            catalog(&["export", "a", "--hats", "b", "--name", "a\nb"]).unwrap_err().contains("--name: wanted one line")
        );
        assert!(catalog(&["export", "a", "--hats", ".."]).unwrap_err().contains("readable name"));
    }
}
