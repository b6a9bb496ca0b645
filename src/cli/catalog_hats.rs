//! HATS catalogs for `starloop catalog`: what an import reads, file by file, and `starloop catalog export`.
//!
//! What opens Parquet files is in `with_hats`, and in `without_hats` for a program built without the feature `hats`.

#[cfg(feature = "hats")]
use crate::cli::with_hats as hats;
#[cfg(not(feature = "hats"))]
use crate::cli::without_hats as hats;
use crate::cli::{catalog_file::name_of, progress::ProgressLine};
use anyhow::{Context, bail, ensure};
use clap::Args;
use imports::is_hats;
use imports::published::gaia::{Names, import as import_gaia};
use stars::layer::{Layer, Sorting};
use std::{io::Write, path::PathBuf};

/// Rows that HATS importers commonly put into a partition at most.
const MAX_ROWS: usize = 1_000_000;

/// Arguments of `starloop catalog export`.
#[derive(Debug, Args)]
#[command(
    after_help = "Writes a HATS catalog (Parquet files partitioned by HEALPix), which Python's hats and LSDB open. Columns: \
    _healpix_29, starloop_id, source_id, ra, dec (deg, ICRS), pmra, pmdec (mas/yr), parallax (mas), phot_g_mean_mag, bp_rp (mag); null \
    where the layer has none. starloop_id is a star's place in the layers, in the order they are named; source_id, its number in \
    its source catalog, is there when all layers have numbers.\n\nValues are those that the layers hold, in their steps. `starloop catalog import DIR` makes the same layers \
    of it again."
)]
pub(super) struct ExportArgs {
    /// Layers of one epoch, brightest first
    #[arg(required = true)]
    layers: Vec<PathBuf>,
    /// Folder of the catalog, which must not be there yet; it gets its name when it is whole
    #[arg(long, value_name = "DIR")]
    hats: PathBuf,
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
pub(super) fn export(args: &ExportArgs, out: &mut impl Write) -> anyhow::Result<()> {
    let name = args.name.as_deref().or_else(|| args.hats.file_name()?.to_str());
    let name = name.with_context(|| format!("{}: wanted a folder with a readable name", args.hats.display()))?;
    let is_name = |name: &str| !name.trim().is_empty() && !name.contains(char::is_control);
    ensure!(is_name(name), "--name: wanted one line, got {name:?}");
    let layers = args.layers.iter().map(|path| Layer::open(path)).collect::<Result<Vec<_>, _>>()?;
    let line = ProgressLine::new();
    let mut share = |share: f64| line.show(&format!("{}: {:.0} %", args.hats.display(), 100.0 * share));
    let written = hats::export(&layers, &args.hats, (name, args.max_rows), &mut share)?;
    line.clear();
    writeln!(out, "{}: {written}", args.hats.display())?;
    Ok(())
}

/// One file that an import takes in whole.
pub(super) struct Input {
    /// By which it is known when an import goes on.
    pub(super) name: String,
    pub(super) path: PathBuf,
    pub(super) names: Names,
    pub(super) kind: Kind,
    /// Credits that its catalog asks for.
    pub(super) credits: Option<String>,
}

/// How a file is read.
pub(super) enum Kind {
    Csv,
    Parquet(hats::Parquet),
}

impl Input {
    /// Takes it in; the number of rows.
    pub(super) fn import(&self, sorting: &mut Sorting, reported: &mut dyn FnMut(u64)) -> anyhow::Result<u64> {
        match &self.kind {
            Kind::Csv => Ok(import_gaia(&self.path, &self.names, sorting, reported)?),
            Kind::Parquet(parquet) => parquet.import(self, sorting, reported),
        }
    }
}

/// Returns the files that are named, those of catalogs one by one. `epoch_yr` must be that of the catalogs that say
/// theirs.
pub(super) fn inputs(paths: &[PathBuf], names: &Names, epoch_yr: f64) -> anyhow::Result<Vec<Input>> {
    let mut inputs = Vec::new();
    for path in paths {
        if is_hats(path) {
            inputs.extend(hats::partitions(path, names, epoch_yr)?);
        } else if path.is_dir() {
            bail!("{}: wanted a HATS catalog, which has a file hats.properties, or the name of a file", path.display());
        } else {
            let is_parquet = path.extension().is_some_and(|kind| kind.eq_ignore_ascii_case("parquet"));
            let kind = if is_parquet { Kind::Parquet(hats::Parquet::alone(path)?) } else { Kind::Csv };
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::catalog_layers::{ImportArgs, import};
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
