//! `starloop catalog synthesize`: layers of stars that are not real, in the numbers of the real sky.

use crate::cli::catalog::layers::{print_layer, refuse_layers_that_are_there};
use crate::cli::named::{declination_deg, right_ascension_deg};
use crate::cli::{named, terminal::ProgressLine};
use anyhow::ensure;
use base::{source::direction_from_ra_dec, units::DEG};
use clap::Args;
use glam::DVec3;
use imports::synthetic::{Population, credits};
use std::{io::Write, path::PathBuf};

/// Most stars of a population: as many as Gaia has, and some; 32 GB.
const MOST_STARS: f64 = 2e9;

/// Arguments of `starloop catalog synthesize`.
#[derive(Debug, Args)]
#[command(
    after_help = "Numbers by direction and magnitude follow counts in Gaia DR3, extrapolated from G = 20.7 to 22. Colours, \
    parallaxes and proper motions are plausible, not measured; clusters, dust lanes and doubles are left out. The \
    layers' credits say so."
)]
pub(crate) struct SynthesizeArgs {
    /// Folder for the layers, gNN.starlayer each
    #[arg(long)]
    out: PathBuf,
    /// Faint end of the stars, G magnitude, up to 22
    #[arg(long, default_value_t = 15.0)]
    mag: f32,
    /// How many stars in all, on average; as many as were measured when left out (37 million to 15 mag)
    #[arg(long)]
    stars: Option<f64>,
    /// Which sky: the same number gives the same stars
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Magnitudes at which layers end before the last, rising; those that are not brighter than --mag are left out
    #[arg(long, value_delimiter = ',', default_value = "10,14,18")]
    layers: Vec<f32>,
    /// Only stars near a direction, degrees: the rest of the sky stays empty
    #[arg(long, value_name = "RA,DEC,RADIUS", allow_hyphen_values = true, value_parser = region)]
    around: Option<Region>,
    /// Write layers in the place of those that are in --out already
    #[arg(long)]
    replace: bool,
}

/// Writes the layers and prints their contents.
pub(crate) fn synthesize(args: &SynthesizeArgs, out: &mut impl Write) -> anyhow::Result<()> {
    if let Some(stars) = args.stars {
        ensure!((1.0..=MOST_STARS).contains(&stars), "--stars: wanted 1..{MOST_STARS}, got {stars}");
    }
    let mut limits: Vec<f32> = args.layers.iter().copied().filter(|limit| *limit < args.mag).collect();
    limits.push(args.mag);
    let population = Population::new(&limits, args.stars, args.seed);
    let mut population = population.map_err(|why| anyhow::anyhow!("--mag, --layers: {why}"))?;
    if let Some(Region { axis, radius_rad }) = args.around {
        population = population.around(axis, radius_rad);
    }
    named::make_folder("--out", &args.out)?;
    refuse_layers_that_are_there(&args.out, &limits, args.replace)?;
    let line = ProgressLine::new();
    let reports = population.write(&args.out, &mut |share| line.show(&format!("drawing: {:.0} %", 100.0 * share)))?;
    line.clear();
    writeln!(out, "{}", credits(args.seed))?;
    reports.iter().try_for_each(|report| print_layer(report, out))?;
    let stars: u64 = reports.iter().map(|report| report.stars).sum();
    match args.around {
        None => writeln!(out, "{stars} stars, {:.0} expected", population.expected())?,
        Some(_) => writeln!(out, "{stars} stars of {:.0} all over the sky", population.expected())?,
    }
    Ok(())
}

/// A part of the sky.
#[derive(Debug, Clone, Copy)]
struct Region {
    /// Its middle.
    axis: DVec3,
    /// Its radius, rad.
    radius_rad: f64,
}

/// Reads a right ascension, a declination and a radius, degrees.
fn region(text: &str) -> Result<Region, String> {
    let parts: Vec<&str> = text.split(',').collect();
    let &[ra, dec, radius] = parts.as_slice() else { return Err("wanted RA,DEC,RADIUS in degrees".into()) };
    let ra_deg = right_ascension_deg(ra).map_err(|wanted| format!("right ascension: {wanted}"))?;
    let dec_deg = declination_deg(dec).map_err(|wanted| format!("declination: {wanted}"))?;
    let radius_deg = radius.trim().parse::<f64>().ok().filter(|radius_deg| (0.0..=180.0).contains(radius_deg));
    let radius_deg = radius_deg.ok_or("radius: wanted 0 to 180 degrees")?;
    Ok(Region { axis: direction_from_ra_dec(ra_deg * DEG, dec_deg * DEG), radius_rad: radius_deg * DEG })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::catalog::layers::layer_info;
    use clap::Parser;
    use stars::layer::Layer;

    #[derive(Debug, Parser)]
    struct Program {
        #[command(flatten)]
        synthesize: SynthesizeArgs,
    }

    fn synthesized(line: &[&str]) -> anyhow::Result<String> {
        let args = Program::try_parse_from([&["x"], line].concat()).expect("a valid command line").synthesize;
        let mut out = Vec::new();
        synthesize(&args, &mut out)?;
        Ok(String::from_utf8(out)?)
    }

    #[test]
    fn layers_say_that_they_are_not_real() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("sky");
        let line =
            ["--out", out.to_str().unwrap(), "--mag", "9", "--layers", "6,10", "--stars", "20000", "--seed", "5"];
        let reported = synthesized(&line).unwrap();
        assert!(reported.contains("seed 5: not real stars") && reported.contains("g9.starlayer"), "{reported}");
        assert!(reported.contains(" stars, 20000 expected") && !reported.contains("g10"), "{reported}");
        let mut info = Vec::new();
        layer_info(&out.join("g9.starlayer"), false, &mut info).unwrap();
        assert!(String::from_utf8(info).unwrap().contains("credits  synthetic population, seed 5: not real stars"));
        let again = synthesized(&line).unwrap_err().to_string();
        assert!(again.contains("g6.starlayer already"), "{again}");
        synthesized(&[&line[..], &["--replace"]].concat()).unwrap();
    }

    #[test]
    fn a_part_of_the_sky_has_the_stars_that_the_whole_has_there() {
        let folder = tempfile::tempdir().unwrap();
        let stars_near = |extra: &[&str], name: &str| {
            let out = folder.path().join(name);
            let line = ["--out", out.to_str().unwrap(), "--mag", "9", "--layers", "9", "--seed", "5"];
            let reported = synthesized(&[&line[..], extra].concat()).unwrap();
            let layer = Layer::open(&out.join("g9.starlayer")).unwrap();
            let (axis, mut near) = (direction_from_ra_dec(266.0 * DEG, -29.0 * DEG), Vec::new());
            layer.cone(axis, 5.0 * DEG, 99.0, &mut near).unwrap();
            let directions: Vec<DVec3> = near.iter().map(|star| star.direction_icrf).collect();
            (directions, layer.index().stars(), reported)
        };
        let (whole, all, _) = stars_near(&[], "whole");
        let (part, fewer, reported) = stars_near(&["--around", "266,-29,5"], "part");
        assert!(whole.len() > 100 && whole == part, "{} {}", whole.len(), part.len());
        assert!(fewer < all / 50 && reported.contains("all over the sky"), "{fewer} {all} {reported}");
    }

    #[test]
    fn bad_arguments_are_named() {
        let refused = |extra: &[&str]| synthesized(&[&["--out", "/no/such"], extra].concat()).unwrap_err().to_string();
        assert!(refused(&["--mag", "22.5"]).contains("--mag, --layers: wanted rising magnitudes in 0..22"));
        assert!(refused(&["--layers", "14,10"]).contains("got [14.0, 10.0, 15.0]"));
        assert!(refused(&["--stars", "0"]).contains("--stars: wanted 1..2000000000, got 0"));
        assert!(refused(&["--stars", "NaN"]).contains("got NaN"));
        for (text, wanted) in [
            ("10,-95,3", "declination: wanted decimal degrees from -90 to 90"),
            ("370,-5,3", "right ascension: wanted decimal degrees from -360 to 360"),
            ("10,-5,200", "radius: wanted 0 to 180 degrees"),
            ("10,-5", "wanted RA,DEC,RADIUS in degrees"),
        ] {
            assert_eq!(region(text).unwrap_err(), wanted, "{text}");
        }
        assert!(region("-10, -5, 3").is_ok(), "a sign in front does not make an option");
    }
}
