//! Layers of published catalogs, and the bright stars that are added to them.
//!
//! `starloop catalog import` and `verify`: published catalogs -> layers on disk, and whether they are whole.

use crate::cli::catalog::hats::{Input, inputs, mark, name_of};
use crate::cli::{named, report_json::json_line, terminal::ProgressLine};
use anyhow::{Context, bail, ensure};
use clap::Args;
use imports::published::gaia::{EPOCH_YR, Names};
use imports::published::{add_bright, bright::BrightStars};
use stars::layer::{LEAST_MEMORY_BYTES, Layer, LayerReport, MEMORY_BYTES, Sorting, is_layer, layer_name};
use stars::{catalog::Catalog, credits};
use std::path::{Path, PathBuf};
use std::{collections::BTreeMap, io::Write};

const MIB: usize = 1 << 20;

/// Arguments of `starloop catalog import`.
#[derive(Debug, Args)]
#[command(
    after_help = "Reads Gaia's bulk files (GaiaSource_*.csv.gz) and any CSV with Gaia's column names: source_id, ra, dec, \
    pmra, pmdec, parallax, phot_g_mean_mag, and bp_rp or phot_bp_mean_mag and phot_rp_mean_mag, and ref_epoch where there is one, or the names that `pack` takes (ra_deg, g_mag and so on); --column says where a \
    file has another name, or that it has none. Stars of --bright are matched with theirs by place \
    and magnitude: none comes twice.\n\nA build with \
    the feature hats reads Parquet files of the same columns too, and HATS catalogs (folders with \
    hats.properties, as hats-import makes them): each partition is there and listed, has the rows it should, and they lie \
    in its pixel, or the import ends. The catalog says what its columns of right ascension and declination are \
    called.\n\nAn import that was cut short goes on after its last whole file, or partition, when it is started again \
    with the same --out, the same files, --epoch and --column."
)]
pub(crate) struct ImportArgs {
    /// Files to import, .csv, .csv.gz or .parquet, and folders of HATS catalogs
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Folder for the layers, gNN.starlayer each
    #[arg(long)]
    out: PathBuf,
    /// Faint ends of the layers, G magnitudes, rising; fainter stars are left out and counted
    #[arg(long, value_delimiter = ',', default_value = "10,14,18,22")]
    layers: Vec<f32>,
    /// Folder of its own for what is sorted, some 36 bytes a star, removed at the end; one within --out when left out
    #[arg(long)]
    work: Option<PathBuf>,
    /// Write layers in the place of those that are in --out already
    #[arg(long)]
    replace: bool,
    /// Epoch of the layers and of the positions, Julian year; rows that state another in ref_epoch are moved to it by
    /// their proper motions
    #[arg(long, default_value_t = EPOCH_YR)]
    epoch: f64,
    /// Column names of the files where they are not Gaia's, such as phot_g_mean_mag=G; pmra= says that a file has no
    /// such column; may be repeated
    #[arg(long = "column", value_name = "GAIA=HERE")]
    columns: Vec<String>,
    /// Hipparcos (hip2.dat) or Tycho-2 (tyc2.dat.NN, suppl_1.dat), packed or not: stars that the files lack are added
    /// from it; may be repeated
    #[arg(long, value_name = "FILE")]
    bright: Vec<PathBuf>,
    /// Memory for the import, MiB: with less it takes longer
    #[arg(long, value_name = "MB", default_value_t = (MEMORY_BYTES / MIB) as u32, value_parser = clap::value_parser!(u32).range((LEAST_MEMORY_BYTES / MIB) as i64..=65_536))]
    memory_mb: u32,
    /// Leave out the stars' numbers in their source catalogs: 16 bytes a star instead of 24, and truth tables without
    /// them
    #[arg(long)]
    no_source_ids: bool,
    /// Credits that the data ask for, carried in the layers; when left out those of Gaia, Hipparcos and Tycho-2, as far
    /// as stars come from them, and those that a HATS catalog names
    #[arg(long)]
    credits: Option<String>,
}

/// Arguments of `starloop catalog verify`.
#[derive(Debug, Args)]
pub(crate) struct VerifyArgs {
    /// Packed catalogs and layers
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Print the report as one line of JSON
    #[arg(long)]
    json: bool,
}

/// Imports files into layers and prints what became of their rows.
pub(crate) fn import(args: &ImportArgs, out: &mut impl Write) -> anyhow::Result<()> {
    ensure!((1900.0..=2100.0).contains(&args.epoch), "--epoch: wanted a Julian year in 1900..2100, got {}", args.epoch);
    let are_rising = args.layers.is_sorted_by(|a, b| a < b);
    ensure!(are_rising && !args.layers.is_empty(), "--layers: wanted rising magnitudes, got {:?}", args.layers);
    let names = names(&args.columns)?.at_epoch(args.epoch);
    let work = args.work.clone().unwrap_or_else(|| args.out.join("import"));
    let inputs = inputs(&args.files, &names, args.epoch)?;
    // Nothing is made before it is known that there is something to do.
    for path in inputs.iter().map(|input| &input.path).chain(&args.bright) {
        std::fs::metadata(path).with_context(|| format!("cannot read {}{}", path.display(), list_hint(path, args)))?;
    }
    let replace = args.replace || Sorting::is_finishing(&work, &args.out);
    refuse_layers_that_are_there(&args.out, &args.layers, replace)?;
    named::make_folder("--out", &args.out)?;
    let mut sorting = Sorting::start(&work, &args.layers)?.with_memory(args.memory_mb as usize * MIB);
    if args.no_source_ids {
        sorting.leave_numbers_out();
    }
    let line = ProgressLine::new();
    let bright = BrightInput::new(&args.bright, args.epoch, &sorting)?;
    let named: Vec<&str> = inputs.iter().map(|input| input.name.as_str()).chain([INPUT]).collect();
    sorting.hold_to(&options(args), &named)?;
    for (number, input) in inputs.iter().enumerate() {
        let (name, mark) = (&input.name, mark(&input.path)?);
        if sorting.has(name, &mark)? {
            eprintln!("{name}: taken in before");
            continue;
        }
        bright.refuse_more(name)?;
        let of = inputs.len();
        let mut reported = |rows| line.show(&format!("file {} of {of}: {name}, {rows} rows", number + 1));
        let rows = input.import(&mut sorting, &mut reported)?;
        sorting.announce("rows", rows);
        sorting.checkpoint(name, &mark)?;
    }
    bright.take_in(&mut sorting, &line)?;
    let counts = sorting.counts();
    let reported: Vec<(String, u64)> = sorting.reported().map(|(what, count)| (what.to_owned(), count)).collect();
    let mut share = |share: f64| line.show(&format!("sorting: {:.0} %", 100.0 * share));
    let credits = args.credits.clone().unwrap_or_else(|| credits_asked_for(&sorting.credits(), &inputs));
    let reports = sorting.finish(&args.out, args.epoch, &credits, &mut share)?;
    line.clear();
    for (what, count) in &reported {
        writeln!(out, "{count:>12} {what}")?;
    }
    for (count, what) in [
        (counts.stars, "stars taken in"),
        (counts.too_faint, "stars fainter than the last layer, left out"),
        (counts.without_motion, "without a proper motion"),
        (counts.without_parallax, "without a parallax"),
        (counts.without_colour, "without a colour, drawn with BP - RP = 0.9"),
        (counts.negative_parallaxes, "negative parallaxes, stored as zero"),
        (counts.clamped_colours, "colours beyond -0.5..5, clamped"),
        (reports.iter().map(|report| report.doubled).sum(), "stars that came twice, taken once"),
    ] {
        writeln!(out, "{count:>12} {what}")?;
    }
    if let Some(number) = reports.iter().find_map(|report| report.doubled_number) {
        writeln!(out, "source_id {number} is on two rows with different values: the brighter one was taken")?;
    }
    reports.iter().try_for_each(|report| print_layer(report, out))
}

/// Credits of the catalogs that name theirs, each once, and of the stars' origins as far as these do not have them.
fn credits_asked_for(of_origins: &str, inputs: &[Input]) -> String {
    let mut credits: Vec<&str> = Vec::new();
    for text in inputs.iter().filter_map(|input| input.credits.as_deref()).chain([of_origins]) {
        if !text.is_empty() && !credits.iter().any(|known| known.contains(text)) {
            credits.push(text);
        }
    }
    credits.join(" ")
}

/// Returns a hint for a file whose name is a number: part of a list with blanks in the place of commas.
fn list_hint(path: &Path, args: &ImportArgs) -> String {
    let is_number = path.to_str().is_some_and(|name| name.parse::<f32>().is_ok());
    if !is_number {
        return String::new();
    }
    let layers = args.layers.iter().map(f32::to_string).chain([path.display().to_string()]).collect::<Vec<_>>();
    format!(" (a list has commas and no blanks, such as --layers {})", layers.join(","))
}

/// Layers are replaced only when that was asked for.
pub(crate) fn refuse_layers_that_are_there(out: &Path, limits_mag: &[f32], replace: bool) -> anyhow::Result<()> {
    let mut names = limits_mag.iter().map(|limit| layer_name(*limit));
    if let Some(name) = names.find(|name| out.join(name).exists()).filter(|_| !replace) {
        bail!("{} has {name} already: name all files of a catalog in one import, or add --replace", out.display());
    }
    Ok(())
}

pub(crate) fn print_layer(report: &LayerReport, out: &mut impl Write) -> anyhow::Result<()> {
    let LayerReport { path, stars, order, bytes, .. } = report;
    writeln!(out, "{}: {stars} stars, tiles of order {order}, {bytes} bytes", path.display())?;
    Ok(())
}

/// Returns the options of reading files: a resumed import compares them, and refuses other options.
fn options(args: &ImportArgs) -> String {
    let renamed = args.columns.iter().filter_map(|column| column.split_once('='));
    // As it comes out in the end, whatever the order of the arguments.
    let renamed: BTreeMap<&str, &str> = renamed.collect();
    let columns: Vec<String> = renamed.iter().map(|(archive, here)| format!("{archive}={here}")).collect();
    let columns = if columns.is_empty() { "Gaia's columns".into() } else { columns.join(", ") };
    format!("epoch J{} and {columns}", args.epoch)
}

/// Reads column names such as `phot_g_mean_mag=G`.
fn names(columns: &[String]) -> anyhow::Result<Names> {
    let mut names = Names::default();
    for column in columns {
        let Some((archive, here)) = column.split_once('=') else {
            bail!("--column: wanted GAIA=HERE, such as phot_g_mean_mag=G, got \"{column}\"");
        };
        ensure!(
            !here.is_empty() || Names::may_be_missing(archive) || !Names::all().contains(&archive),
            "--column: {archive} must be in the file: wanted its name there after the ="
        );
        ensure!(
            names.rename(archive, here),
            "--column: wanted one of {} before the =, got \"{archive}\"",
            Names::all().join(", ")
        );
    }
    Ok(names)
}

/// Reads catalogs and layers to their end.
pub(crate) fn verify(args: &VerifyArgs, out: &mut impl Write) -> anyhow::Result<()> {
    let line = ProgressLine::new();
    let mut whole = Vec::new();
    for path in &args.files {
        let stars = if is_layer(path) {
            let layer = Layer::open(path)?;
            layer.verify(&mut |share| line.show(&format!("{}: {:.0} %", path.display(), 100.0 * share)))?;
            line.clear();
            layer.index().stars()
        } else {
            let catalog = Catalog::open(path).with_context(|| path.display().to_string())?;
            catalog.sources().len() as u64
        };
        if args.json {
            whole.push(serde_json::json!({ "file": path, "stars": stars }));
        } else {
            writeln!(out, "{}: whole, {stars} stars", path.display())?;
        }
    }
    if args.json {
        writeln!(out, "{}", json_line("catalog-verify", serde_json::json!({ "whole": whole }))?)?;
    }
    Ok(())
}

/// Prints the contents of a layer.
pub(crate) fn layer_info(path: &Path, is_json: bool, out: &mut impl Write) -> anyhow::Result<()> {
    let layer = Layer::open(path)?;
    let facts = layer.index();
    let [from, below] = facts.magnitudes;
    let (mut most, mut filled) = (0, 0);
    for stars in facts.stars_of_tiles() {
        most = most.max(stars);
        filled += u64::from(stars > 0);
    }
    if is_json {
        let report = serde_json::json!({
            "kind": "layer", "stars": facts.stars(), "epoch_yr": facts.epoch_yr,
            "brightest_mag_g": Some(from).filter(|mag| mag.is_finite()), "faintest_mag_g": below,
            "order": facts.order, "tiles_with_stars": filled, "most_stars_in_a_tile": most,
            "crc32": format!("{:08x}", facts.crc32), "credits": credits::shown(&facts.credits),
        });
        writeln!(out, "{}", json_line("catalog-info", report)?)?;
        return Ok(());
    }
    writeln!(out, "stars    {}", facts.stars())?;
    writeln!(out, "epoch    J{:.1}, ICRS", facts.epoch_yr)?;
    if from.is_finite() {
        writeln!(out, "G        {from} to {below}")?;
    } else {
        writeln!(out, "G        to {below}")?;
    }
    writeln!(out, "tiles    order {}, {filled} with stars, at most {most} in one", facts.order)?;
    writeln!(out, "crc32    {:08x}", facts.crc32)?;
    writeln!(out, "credits  {}", credits::shown(&facts.credits))?;
    Ok(())
}

// `--bright` of `starloop catalog import`: Hipparcos and Tycho-2 files, the last input of an import.

/// The name of all of them together among an import's inputs.
pub(crate) const INPUT: &str = "bright stars";

/// The bright files of an import.
pub(crate) struct BrightInput<'a> {
    files: &'a [PathBuf],
    epoch_yr: f64,
    mark: String,
    is_taken_in: bool,
}

impl<'a> BrightInput<'a> {
    /// Files for stars of `epoch_yr`.
    pub(crate) fn new(files: &'a [PathBuf], epoch_yr: f64, sorting: &Sorting) -> anyhow::Result<Self> {
        let mark_of = |path: &PathBuf| Ok(format!("{} of {}", name_of(path)?, mark(path)?));
        let marks = files.iter().map(mark_of).collect::<anyhow::Result<Vec<_>>>()?;
        let mark = format!("[{}] at J{epoch_yr}", marks.join("; "));
        let is_taken_in = sorting.has(INPUT, &mark)?;
        Ok(Self { files, epoch_yr, mark, is_taken_in })
    }

    /// Refuses more files: the bright stars are matched with all that was taken in before.
    pub(crate) fn refuse_more(&self, name: &str) -> anyhow::Result<()> {
        ensure!(!self.is_taken_in, "{name}: the bright stars were matched before it came; start over with all files");
        Ok(())
    }

    /// Adds the stars that are missing.
    pub(crate) fn take_in(&self, sorting: &mut Sorting, line: &ProgressLine) -> anyhow::Result<()> {
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
mod catalog_layers_tests {
    use super::*;
    use clap::Parser;

    #[derive(Debug, Parser)]
    struct Program {
        #[command(flatten)]
        import: ImportArgs,
    }

    const CSV: &str = "source_id,ra,dec,pmra,pmdec,parallax,G,bp_rp\n1,10.0,-20.0,5.0,0.0,,9.0,1.0\n\
        2,10.5,-20.0,,,3.2,13.0,\n3,50.0,-20.0,,,,,1.0\n4,51.0,-20.0,,,,23.0,1.0\n";

    fn arguments(line: &[&str]) -> ImportArgs {
        Program::try_parse_from([&["x"], line].concat()).expect("a valid command line").import
    }

    fn imported(line: &[&str]) -> anyhow::Result<String> {
        let mut out = Vec::new();
        import(&arguments(line), &mut out)?;
        Ok(String::from_utf8(out)?)
    }

    #[test]
    fn imports_reports_and_verifies() {
        let folder = tempfile::tempdir().unwrap();
        let csv = folder.path().join("stars.csv");
        std::fs::write(&csv, CSV).unwrap();
        let (csv, out) = (csv.to_str().unwrap(), folder.path().join("layers"));
        let line = [csv, "--out", out.to_str().unwrap(), "--column", "phot_g_mean_mag=G", "--credits", "me"];
        let reported = imported(&line).unwrap();
        for wanted in [
            "           4 rows\n",
            "           1 rows without a G magnitude, left out\n",
            "           2 stars taken in\n",
            "           1 stars fainter than the last layer, left out\n",
            "           1 without a colour",
            "g10.starlayer: 1 stars",
            "g14.starlayer: 1 stars",
            "g22.starlayer: 0 stars",
        ] {
            assert!(reported.contains(wanted), "{wanted:?} in {reported}");
        }
        let layer = out.join("g10.starlayer");
        let mut text = Vec::new();
        layer_info(&layer, false, &mut text).unwrap();
        let text = String::from_utf8(text).unwrap();
        assert!(text.contains("stars    1\n") && text.contains("J2016.0") && text.contains("credits  me"), "{text}");
        let mut whole = Vec::new();
        verify(&VerifyArgs { files: vec![layer.clone()], json: false }, &mut whole).unwrap();
        assert!(String::from_utf8(whole).unwrap().contains("whole, 1 stars"));
        let mut bytes = std::fs::read(&layer).unwrap();
        let last = bytes.len() - 1;
        bytes[last] ^= 1;
        std::fs::write(&layer, bytes).unwrap();
        let error = verify(&VerifyArgs { files: vec![layer], json: false }, &mut Vec::new()).unwrap_err().to_string();
        assert!(error.contains("damaged: numbers of the stars"), "control: {error}");
    }

    #[test]
    fn own_stars_keep_their_numbers_and_credit_no_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let own = "source_id,ra,dec,phot_g_mean_mag\n41,10.0,-20.0,9.0\n-7,10.5,-20.0,9.5\n";
        let gaia = "source_id,ra,dec,phot_g_mean_mag\n4472832130942575872,269.448503,4.739420,8.2\n";
        let info = |csv: &str, name: &str, more: &[&str]| {
            std::fs::write(path("stars.csv"), csv).unwrap();
            let none = ["pmra=", "pmdec=", "parallax=", "bp_rp="].map(|column| ["--column", column]);
            let line = [path("stars.csv"), "--out".into(), path(name), "--layers".into(), "10".into()];
            let line: Vec<&str> = line.iter().map(String::as_str).chain(none.as_flattened().iter().copied()).collect();
            imported(&[&line[..], more].concat()).unwrap();
            let (layer, mut text) = (folder.path().join(name).join("g10.starlayer"), Vec::new());
            layer_info(&layer, false, &mut text).unwrap();
            let layer = Layer::open(&layer).unwrap();
            let mut stars = Vec::new();
            layer.cone(glam::DVec3::Z, 4.0, 99.0, &mut stars).unwrap();
            let names: Vec<_> = stars.iter().map(|star| star.source_id.map(|name| name.to_string())).collect();
            (String::from_utf8(text).unwrap(), names)
        };
        let (text, mut names) = info(own, "own", &[]);
        names.sort();
        assert_eq!(names, [Some("-7".to_owned()), Some("41".to_owned())]);
        assert!(text.contains("credits  none: no star is known to come from a published catalog"), "{text}");
        let (text, names) = info(gaia, "gaia", &[]);
        assert_eq!(names, [Some("Gaia DR3 4472832130942575872".to_owned())]);
        assert!(text.contains("European Space Agency (ESA) mission Gaia") && !text.contains("Hipparcos"), "{text}");
        assert_eq!(info(gaia, "without", &["--no-source-ids"]).1, [None]);
        let to_pack = gaia.replace("ra,dec,phot_g_mean_mag", "ra_deg,dec_deg,g_mag");
        assert_eq!(info(&to_pack, "to_pack", &[]).1, names, "columns as `pack` names them");
    }

    #[test]
    fn a_file_that_is_wrong_leaves_no_layer_and_the_next_try_goes_on() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let (good, bad, out) = (path("good.csv"), path("bad.csv"), path("layers"));
        let text = CSV.replace(",G,", ",phot_g_mean_mag,");
        std::fs::write(&good, &text).unwrap();
        std::fs::write(&bad, text.replace("\n1,", "\n101,").replace("\n2,10.5", "\n102,1o.5")).unwrap();
        let error = imported(&[&good, &bad, "--out", &out]).unwrap_err().to_string();
        assert!(error.contains("bad.csv, line 3, column ra"), "{error}");
        assert!(!folder.path().join("layers/g10.starlayer").exists());
        std::fs::write(&bad, text.replace("\n1,", "\n101,").replace("\n2,", "\n102,")).unwrap();
        let twice = imported(&[&good, &good, "--out", &out]).unwrap_err().to_string();
        assert!(twice.contains("two files are called good.csv"), "{twice}");
        let reported = imported(&[&good, &bad, "--out", &out]).unwrap();
        let again = imported(&[&good, "--out", &out]).unwrap_err().to_string();
        assert!(again.contains("has g10.starlayer already") && again.contains("--replace"), "{again}");
        let of_others = folder.path().to_str().unwrap();
        let mine = imported(&[&good, "--out", &out, "--replace", "--work", of_others]).unwrap_err().to_string();
        assert!(mine.contains("folder of its own") && folder.path().join("good.csv").exists(), "{mine}");
        assert!(imported(&[&good, "--out", &out, "--replace"]).unwrap().contains("           4 rows\n"));
        assert!(
            reported.contains("           8 rows\n") && reported.contains("           4 stars taken in\n"),
            "{reported}"
        );
    }

    #[test]
    fn an_import_goes_on_only_as_it_began() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let (good, bad, out) = (path("good.csv"), path("bad.csv"), path("layers"));
        std::fs::write(&good, CSV).unwrap();
        std::fs::write(&bad, CSV.replace("\n2,10.5", "\n2,1o.5")).unwrap();
        let g = ["--column", "phot_g_mean_mag=G"];
        let with = |files: &[&str], more: &[&str]| {
            imported(&[files, &["--out", &out], more].concat()).map_err(|error| format!("{error:#}"))
        };
        assert!(with(&[&good, &bad], &g).unwrap_err().contains("bad.csv, line 3"));
        let reported = with(&[&bad], &g).unwrap_err();
        assert!(reported.contains("took in \"good.csv\", which is not named now"), "{reported}");
        let reported = with(&[&good], &[g[0], g[1], "--epoch", "2000"]).unwrap_err();
        assert!(
            reported.contains("epoch J2016 and phot_g_mean_mag=G was cut") && reported.contains("wanted epoch J2000"),
            "{reported}"
        );
        let reported = with(&[&good], &[]).unwrap_err();
        assert!(reported.contains("wanted epoch J2016 and Gaia's columns"), "{reported}");
        assert!(with(&[&good], &["--column", "phot_g_mean_mag=mag", g[0], g[1]]).unwrap().contains("   4 rows\n"));
    }

    #[test]
    fn an_import_cut_short_while_layers_are_written_goes_on() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let (csv, out) = (path("stars.csv"), path("layers"));
        std::fs::write(&csv, CSV).unwrap();
        let line = [&csv, "--out", &out, "--column", "phot_g_mean_mag=G"];
        std::fs::create_dir_all(path("layers/g14.part")).unwrap();
        let error = format!("{:#}", imported(&line).unwrap_err());
        assert!(error.contains("g14.part"), "{error}");
        // As when it is cut short after the first of its layers got its name.
        std::fs::remove_dir(path("layers/g14.part")).unwrap();
        assert!(!folder.path().join("layers/g10.part").exists(), "a failure leaves no half layer");
        std::fs::write(path("layers/g10.starlayer"), "as if whole").unwrap();
        let reported = imported(&line).unwrap();
        assert!(
            reported.contains("g10.starlayer: 1 stars") && reported.contains("g14.starlayer: 1 stars"),
            "{reported}"
        );
        let again = imported(&line).unwrap_err().to_string();
        assert!(again.contains("has g10.starlayer already"), "control: {again}");
        assert!(!folder.path().join("layers/import").exists(), "a refused import leaves nothing");
    }

    #[test]
    fn bad_arguments_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("layers");
        let refused = |extra: &[&str]| {
            let line = [&["no.csv", "--out", out.to_str().unwrap()], extra].concat();
            format!("{:#}", imported(&line).unwrap_err())
        };
        assert!(refused(&["--layers", "14,10"]).contains("--layers: wanted rising"));
        assert!(refused(&["--epoch", "1800"]).contains("--epoch"));
        assert!(refused(&["--column", "G"]).contains("wanted GAIA=HERE"));
        assert!(refused(&["--column", "mag=G"]).contains("wanted one of source_id"));
        assert!(refused(&["--column", "ra="]).contains("--column: ra must be in the file"));
        assert!(refused(&["--memory-mb", "1"]).contains("no.csv"), "control");
        assert!(refused(&[]).contains("no.csv"));
        let listed = format!("{:#}", imported(&["10", "--layers", "8", "--out", out.to_str().unwrap()]).unwrap_err());
        assert!(listed.contains("cannot read 10 (a list has commas and no blanks, such as --layers 8,10)"), "{listed}");
        assert!(!out.exists(), "nothing was made");
    }
}

#[cfg(test)]
mod catalog_bright_tests {
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
