//! `starloop catalog synthesize`: layers of stars that are not real, in the numbers of the real sky.

use crate::cli::catalog_layers::{ProgressLine, refuse_layers_that_are_there, tell_layer};
use crate::sky::synthetic::{Population, credits};
use anyhow::ensure;
use clap::Args;
use std::io::Write;
use std::path::PathBuf;

/// Most stars of a population: as many as Gaia has, and some; 32 GB.
const MOST_STARS: f64 = 2e9;

/// Arguments of `starloop catalog synthesize`.
#[derive(Debug, Args)]
#[command(
    after_help = "Numbers by direction and magnitude follow counts in Gaia DR3, extrapolated from G = 20.7 to 22. Colours, \
    parallaxes and proper motions are plausible, not measured; there are no clusters, dust lanes or doubles. The layers' \
    credits say so."
)]
pub(super) struct SynthesizeArgs {
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
    #[arg(long, value_delimiter = ',', default_values_t = [10.0, 14.0, 18.0])]
    layers: Vec<f32>,
    /// Write layers in the place of those that are in --out already
    #[arg(long)]
    replace: bool,
}

/// Writes the layers and tells what they hold.
pub(super) fn synthesize(args: &SynthesizeArgs, out: &mut impl Write) -> anyhow::Result<()> {
    if let Some(stars) = args.stars {
        ensure!((1.0..=MOST_STARS).contains(&stars), "--stars: wanted 1..{MOST_STARS}, got {stars}");
    }
    let mut limits: Vec<f32> = args.layers.iter().copied().filter(|limit| *limit < args.mag).collect();
    limits.push(args.mag);
    let population = Population::new(&limits, args.stars, args.seed);
    let population = population.map_err(|why| anyhow::anyhow!("--mag, --layers: {why}"))?;
    refuse_layers_that_are_there(&args.out, &limits, args.replace)?;
    let line = ProgressLine::new();
    let reports = population.write(&args.out, &mut |share| line.show(&format!("drawing: {:.0} %", 100.0 * share)))?;
    line.clear();
    writeln!(out, "{}", credits(args.seed))?;
    reports.iter().try_for_each(|report| tell_layer(report, out))?;
    let stars: u64 = reports.iter().map(|report| report.stars).sum();
    writeln!(out, "{stars} stars, {:.0} expected", population.expected())?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::catalog_layers::layer_info;
    use clap::Parser;

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
        let told = synthesized(&line).unwrap();
        assert!(told.contains("seed 5: not real stars") && told.contains("g9.starlayer"), "{told}");
        assert!(told.contains(" stars, 20000 expected") && !told.contains("g10"), "{told}");
        let mut info = Vec::new();
        layer_info(&out.join("g9.starlayer"), &mut info).unwrap();
        assert!(String::from_utf8(info).unwrap().contains("credits  synthetic population, seed 5: not real stars"));
        let again = synthesized(&line).unwrap_err().to_string();
        assert!(again.contains("g6.starlayer already"), "{again}");
        synthesized(&[&line[..], &["--replace"]].concat()).unwrap();
    }

    #[test]
    fn bad_arguments_are_named() {
        let refused = |extra: &[&str]| synthesized(&[&["--out", "/no/such"], extra].concat()).unwrap_err().to_string();
        assert!(refused(&["--mag", "22.5"]).contains("--mag, --layers: wanted rising magnitudes in 0..22"));
        assert!(refused(&["--layers", "14,10"]).contains("got [14.0, 10.0, 15.0]"));
        assert!(refused(&["--stars", "0"]).contains("--stars: wanted 1..2000000000, got 0"));
        assert!(refused(&["--stars", "NaN"]).contains("got NaN"));
    }
}
