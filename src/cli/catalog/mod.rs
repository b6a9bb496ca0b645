//! `starloop catalog`: pack a CSV, import a published catalog into layers, show what they hold, query a cone.

mod for_trackers;
mod hats;
mod layers;
mod map;
mod synthetic;

use crate::cli::catalog::hats::{ExportArgs, export};
use crate::cli::catalog::layers::{ImportArgs, VerifyArgs, import, layer_info, verify};
use crate::cli::catalog::map::{MapArgs, map};
use crate::cli::catalog::synthetic::{SynthesizeArgs, synthesize};
use crate::cli::named::{declination_deg, right_ascension_deg};
use crate::cli::report_json::json_line;
use anyhow::{Context, ensure};
use base::input_file::{DATA_BYTES, InputFile};
use base::source::{CatalogSource, direction_from_ra_dec, ra_dec_rad};
use base::units::{DEG, MAS};
use base::{streams::Output, time::Tai};
use clap::{Args, Subcommand};
use frames::sink::write_file_atomically;
use glam::DVec3;
use sky::astrometry::{at_epoch, years_since};
use stars::catalog::{BANDS, Catalog, pack};
use stars::layer::{FASTEST_MAS_YR, Layer, is_layer};
use stars::{credits, healpix::chord_squared};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

/// Magnitude limit that lets every star pass.
const EVERY_STAR: f32 = 99.0;
/// Largest cone, deg: the whole sky.
const WHOLE_SKY_DEG: f64 = 180.0;

/// Arguments of `starloop catalog`.
#[derive(Debug, Args)]
pub struct CatalogArgs {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Pack a CSV of stars into one file, to look at; `import` makes the layers that are drawn
    Pack(PackArgs),
    /// Import a catalog, published or your own, into layers on disk: stars of any number, in bounded memory
    Import(ImportArgs),
    /// Make layers of stars that are not real, in the numbers of the real sky: for benches and deep scenes
    Synthesize(SynthesizeArgs),
    /// Write stars as a star tracker's program reads them, or layers as a HATS catalog (with the feature hats)
    Export(ExportArgs),
    /// Read packed catalogs and layers to their end and hold every part against its checksum
    Verify(VerifyArgs),
    /// Show what a packed catalog or a layer holds: stars, epoch, bands, magnitudes, credits, checksum
    Info(InfoArgs),
    /// Draw where on the sky the stars of catalogs and layers are
    Map(MapArgs),
    /// List the stars of a cone as CSV
    Query(QueryArgs),
}

#[derive(Debug, Args)]
struct PackArgs {
    /// CSV with columns source_id, ra_deg, dec_deg, pmra_masyr, pmdec_masyr, parallax_mas, g_mag, bp_rp; `-` is stdin
    input: PathBuf,
    /// Packed file to write
    #[arg(long)]
    out: PathBuf,
    /// Epoch of the positions, Julian year
    #[arg(long, default_value_t = 2016.0)]
    epoch: f64,
    /// Credits that the data ask for, carried in the file; those of Gaia, Hipparcos and Tycho-2, as far as stars come
    /// from them, when left out
    #[arg(long)]
    credits: Option<String>,
}

#[derive(Debug, Args)]
struct InfoArgs {
    /// Packed catalog or layer; the built-in catalog when left out
    file: Option<PathBuf>,
    /// Print the report as one line of JSON
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
struct QueryArgs {
    /// Right ascension of the cone's axis, deg, -360..360 (ICRS)
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, value_parser = right_ascension_deg)]
    ra: f64,
    /// Declination of the cone's axis, deg, -90..90 (ICRS)
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, value_parser = declination_deg)]
    dec: f64,
    /// Radius of the cone, deg, up to 180
    #[arg(long, value_name = "DEG")]
    radius: f64,
    /// Faintest Gaia G magnitude listed
    #[arg(long, default_value_t = EVERY_STAR, allow_negative_numbers = true)]
    mag: f32,
    /// Time of the positions, RFC 3339; the catalog's epoch when left out
    #[arg(long, visible_alias = "time")]
    at: Option<String>,
    /// Packed catalog or layer; the built-in catalog when left out
    #[arg(long, visible_alias = "layer")]
    catalog: Option<PathBuf>,
}

/// Runs `starloop catalog`.
///
/// # Errors
/// When a file cannot be read or written, is not a catalog, or an argument is out of range.
pub fn run(args: CatalogArgs) -> anyhow::Result<()> {
    let mut stdout = Output;
    match args.action {
        Action::Pack(args) => pack_file(&args, &mut stdout),
        Action::Import(args) => import(&args, &mut stdout),
        Action::Synthesize(args) => synthesize(&args, &mut stdout),
        Action::Export(args) => export(&args, &mut stdout),
        Action::Verify(args) => verify(&args, &mut stdout),
        Action::Info(InfoArgs { file: Some(path), json }) if is_layer(&path) => layer_info(&path, json, &mut stdout),
        Action::Info(args) => info(&open(args.file.as_deref())?, args.json, &mut stdout),
        Action::Map(args) => map(&args, &mut stdout),
        Action::Query(args) => query(&args, &mut stdout),
    }
}

fn open(file: Option<&Path>) -> anyhow::Result<Catalog> {
    match file {
        Some(path) => Catalog::open(path).with_context(|| format!("cannot use catalog {}", path.display())),
        None => Ok(Catalog::built_in()?),
    }
}

fn pack_file(args: &PackArgs, out: &mut impl Write) -> anyhow::Result<()> {
    ensure!((1900.0..=2100.0).contains(&args.epoch), "--epoch: wanted a Julian year in 1900..2100, got {}", args.epoch);
    let input: Box<dyn Read> = if args.input == Path::new("-") {
        Box::new(std::io::stdin().lock())
    } else {
        let file = InputFile::open(&args.input, DATA_BYTES);
        Box::new(file.with_context(|| format!("cannot read {}", args.input.display()))?)
    };
    let packed = pack(input, args.epoch, args.credits.as_deref());
    let (bytes, report) = packed.with_context(|| args.input.display().to_string())?;
    ensure!(report.stars > 0, "{}: has no star; wanted one row at least below the header", args.input.display());
    write_file_atomically(&args.out, |file| file.write_all(&bytes))?;
    writeln!(out, "{}: {} stars, {} bytes", args.out.display(), report.stars, bytes.len())?;
    writeln!(out, "  without proper motion  {}", report.without_proper_motion)?;
    writeln!(out, "  without parallax       {}", report.without_parallax)?;
    writeln!(out, "  negative parallax -> 0 {}", report.negative_parallaxes)?;
    writeln!(out, "  colours clamped        {}", report.clamped_colours)?;
    Ok(())
}

fn info(catalog: &Catalog, is_json: bool, out: &mut impl Write) -> anyhow::Result<()> {
    let (stars, facts) = (catalog.sources(), catalog.index());
    if is_json {
        let report = serde_json::json!({
            "kind": "packed catalog", "stars": stars.len(), "epoch_yr": facts.epoch_yr, "bands": BANDS,
            "without_proper_motion": count(stars, |s| s.proper_motion.is_none()),
            "without_parallax": count(stars, |s| s.parallax_mas.is_none()),
            "fastest_arcsec_yr": facts.fastest_mas_yr / 1000.0,
            "faintest_mag_g": stars.iter().map(|s| s.mag_g).fold(f32::NEG_INFINITY, f32::max),
            "crc32": format!("{:08x}", facts.crc32), "credits": credits::shown(&facts.credits),
        });
        writeln!(out, "{}", json_line("catalog-info", report)?)?;
        return Ok(());
    }
    writeln!(out, "stars    {}", stars.len())?;
    writeln!(out, "epoch    J{:.1}, ICRS", facts.epoch_yr)?;
    writeln!(out, "bands    {BANDS}")?;
    writeln!(
        out,
        "blank    {} proper motions, {} parallaxes",
        count(stars, |s| s.proper_motion.is_none()),
        count(stars, |s| s.parallax_mas.is_none())
    )?;
    writeln!(out, "fastest  {:.2} arcsec/yr", facts.fastest_mas_yr / 1000.0)?;
    writeln!(out, "crc32    {:08x}", facts.crc32)?;
    writeln!(out, "credits  {}", credits::shown(&facts.credits))?;
    writeln!(out, "G magnitude   stars   brighter than the upper end")?;
    let faintest = stars.iter().map(|s| s.mag_g).fold(f32::NEG_INFINITY, f32::max);
    let mut low = -2.0_f32;
    while low < faintest {
        let high = low + 1.0;
        let within = count(stars, |s| s.mag_g >= low && s.mag_g < high);
        writeln!(out, "{low:>4} .. {high:<4} {within:>7}   {:>7}", count(stars, |s| s.mag_g < high))?;
        low = high;
    }
    Ok(())
}

fn count(stars: &[CatalogSource], is: impl Fn(&CatalogSource) -> bool) -> usize {
    stars.iter().filter(|star| is(star)).count()
}

fn query(args: &QueryArgs, out: &mut impl Write) -> anyhow::Result<()> {
    let radii = 0.0..=WHOLE_SKY_DEG;
    ensure!(radii.contains(&args.radius), "--radius: wanted 0 to {WHOLE_SKY_DEG} degrees, got {}", args.radius);
    ensure!(args.mag.is_finite(), "--mag: wanted a magnitude, got {}", args.mag);
    let at = args.at.as_deref().map(Tai::from_rfc3339).transpose().context("--at")?;
    let axis = direction_from_ra_dec(args.ra * DEG, args.dec * DEG);
    let mut found = Vec::new();
    let years_from = |epoch_yr: f64| at.map_or(0.0, |at| years_since(epoch_yr, at));
    let radius_rad = |years: f64, fastest_mas_yr: f64| args.radius * DEG + years.abs() * fastest_mas_yr * MAS;
    let years = match args.catalog.as_deref().filter(|path| is_layer(path)) {
        Some(path) => {
            let layer = Layer::open(path)?;
            let years = years_from(layer.index().epoch_yr);
            layer.cone(axis, radius_rad(years, FASTEST_MAS_YR), args.mag, &mut found)?;
            years
        }
        None => {
            let catalog = open(args.catalog.as_deref())?;
            let years = years_from(catalog.index().epoch_yr);
            catalog.cone(axis, radius_rad(years, catalog.index().fastest_mas_yr), args.mag, &mut found);
            years
        }
    };
    write_csv(&found, axis, args.radius * DEG, years, out)
}

fn write_csv(
    found: &[CatalogSource],
    axis: DVec3,
    radius_rad: f64,
    years: f64,
    out: &mut impl Write,
) -> anyhow::Result<()> {
    writeln!(out, "id,ra_deg,dec_deg,pm_ra_cosdec_mas_yr,pm_dec_mas_yr,parallax_mas,mag_g,bp_rp,source_id")?;
    for star in found {
        let direction = at_epoch(star.direction_icrf, star.proper_motion, years);
        if direction.distance_squared(axis) > chord_squared(radius_rad) {
            continue;
        }
        let [ra_deg, dec_deg] = ra_dec_rad(direction).map(|rad| rad / DEG);
        let motion =
            star.proper_motion.map_or(",".into(), |m| format!("{},{}", m.pm_ra_cosdec_mas_yr, m.pm_dec_mas_yr));
        let parallax = star.parallax_mas.map_or(String::new(), |p| format!("{p:.2}"));
        let name = star.source_id.map_or(String::new(), |name| name.to_string());
        write!(out, "{},{ra_deg:.7},{dec_deg:.7},{motion},{parallax},", star.id)?;
        writeln!(out, "{:.3},{:.3},{name}", star.mag_g, star.bp_rp)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Debug, Parser)]
    struct Program {
        #[command(flatten)]
        catalog: CatalogArgs,
    }

    const CSV: &str = "source_id,ra_deg,dec_deg,pmra_masyr,pmdec_masyr,parallax_mas,g_mag,bp_rp\n\
        1,10.0,-20.0,1000.0,0.0,,4.0,1.0\n2,10.5,-20.0,,,3.2,5.0,1.0\n3,50.0,-20.0,,,,5.0,1.0\n";

    fn parse(line: &[&str]) -> CatalogArgs {
        Program::try_parse_from([&["x"], line].concat()).expect("a valid command line").catalog
    }

    fn query_text(line: &[&str]) -> anyhow::Result<String> {
        let Action::Query(args) = parse(&[&["query"], line].concat()).action else { panic!("a query") };
        let mut out = Vec::new();
        query(&args, &mut out)?;
        Ok(String::from_utf8(out)?)
    }

    #[test]
    fn packs_shows_and_queries() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (csv, packed) = (folder.path().join("in.csv"), folder.path().join("out.starcat"));
        std::fs::write(&csv, CSV).expect("writable");
        let (csv, packed) = (csv.to_str().expect("UTF-8"), packed.to_str().expect("UTF-8"));
        run(parse(&["pack", csv, "--out", packed, "--epoch", "2000", "--credits", "me"])).expect("packs");

        let mut text = Vec::new();
        info(&open(Some(Path::new(packed))).expect("opens"), false, &mut text).expect("writes");
        let text = String::from_utf8(text).expect("UTF-8");
        assert!(text.contains("stars    3") && text.contains("J2000.0") && text.contains("credits  me"), "{text}");
        assert!(text.contains("blank    2 proper motions, 2 parallaxes"), "{text}");

        let cone = ["--ra", "10", "--dec", "-20", "--radius", "1", "--catalog", packed];
        let all = query_text(&cone).expect("a valid query");
        assert_eq!(all.lines().count(), 3, "header and two stars: {all}");
        let bright = query_text(&[&cone[..], &["--mag", "4.5"]].concat()).expect("a valid query");
        assert_eq!(bright.lines().count(), 2, "{bright}");
        assert!(all.contains(",1.000,1\n"), "the number of one's own star comes back: {all}");
        let west = query_text(&["--ra", "-350", "--dec", "-20", "--radius", "1", "--catalog", packed]);
        assert_eq!(west.expect("a valid query"), all, "-350 degrees is 10");
        let later = query_text(&[&cone[..], &["--at", "2100-01-01T12:00:00Z"]].concat()).expect("a valid query");
        // 1000 mas/yr for 100 years is 100 arcsec: 0.029560 deg of right ascension at dec -20.
        assert!(later.contains(",10.0295603,") || later.contains(",10.029560"), "{later}");
    }

    #[test]
    fn bad_arguments_are_named() {
        let refuse = |line: &[&str]| format!("{:#}", query_text(line).expect_err("a bad argument"));
        let unread = |line: &[&str]| {
            Program::try_parse_from([&["x", "query"], line].concat()).expect_err("a bad angle").to_string()
        };
        let ra = unread(&["--ra", "400", "--dec", "0", "--radius", "1"]);
        assert!(ra.contains("--ra <DEG>") && ra.contains("wanted decimal degrees from -360 to 360"), "{ra}");
        let hours = unread(&["--ra", "5h30m", "--dec", "0", "--radius", "1"]);
        assert!(hours.contains("not hours: 5h30m is 82.5"), "{hours}");
        assert!(unread(&["--ra", "1", "--dec", "NaN", "--radius", "1"]).contains("--dec <DEG>"));
        let at = refuse(&["--ra", "1", "--dec", "0", "--radius", "1", "--at", "noon"]);
        assert!(at.contains("--at") && at.contains("RFC 3339"), "{at}");
        let file = refuse(&["--ra", "1", "--dec", "0", "--radius", "1", "--catalog", "no/such.starcat"]);
        assert!(file.contains("no/such.starcat"), "{file}");
    }
}
