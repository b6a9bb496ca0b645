//! `starloop fmu`: a run file as an FMI 3.0 co-simulation unit, for simulators that import such units.

use anyhow::{Context, Result, bail};
use clap::Args;
use config::{Bench, Document};
use fmu::archive::write_unit;
use std::path::{Path, PathBuf};

/// File name of the library, as Cargo builds it.
const LIBRARY: &str = "libstarloop_fmu_library.so";

/// Command line of `fmu`.
#[derive(Debug, Args)]
#[command(after_help = "\
Inputs: attitude, rate, acceleration, jitter, position and velocity, triggers. Outputs: frames, true attitude, star tracker.\n\
Frames and tables go to the folder that the parameter output_dir names, through the sinks of the run file.\n\n\
Examples:\n  cargo build --release -p starloop_fmu_library\n  starloop fmu configs/benches/loopback.toml --out bench.fmu\n  \
fmpy validate bench.fmu\n  fmpy simulate bench.fmu --interface-type CoSimulation --stop-time 1")]
pub struct FmuArgs {
    /// Bench file (TOML); without one: the built-in loopback bench
    bench: Option<PathBuf>,
    /// Unit to write; without it: the name of the bench with the ending .fmu, in this folder
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Library that goes into the unit; without it: libstarloop_fmu_library.so beside this program or in
    /// ../lib/starloop
    #[arg(long, value_name = "FILE")]
    library: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// When the run file is refused, the library is missing, or the unit cannot be written.
pub fn run(arguments: &FmuArgs) -> Result<()> {
    let document = match &arguments.bench {
        Some(path) => Document::open(path)?,
        None => Bench::built_in_document()?,
    };
    let library = match &arguments.library {
        Some(path) => path.clone(),
        None => library_beside_program()?,
    };
    let stem = document.name();
    let stem = Path::new(&stem).file_stem().context("a run file without a name")?;
    let out = arguments.out.clone().unwrap_or_else(|| Path::new(stem).with_extension("fmu"));
    let bytes = write_unit(&document, &library, &out)?;
    println!("{}: {:.1} MB, FMI 3.0 co-simulation; check it with `fmpy validate`", out.display(), bytes as f64 * 1e-6);
    Ok(())
}

/// Returns where the library is, looked for near this program.
fn library_beside_program() -> Result<PathBuf> {
    let program = std::env::current_exe().context("the place of this program")?;
    let folder = program.parent().context("the folder of this program")?;
    // Installed, built by itself, or built with the tests.
    let places = ["", "../lib/starloop", "deps"].map(|place| folder.join(place).join(LIBRARY));
    let found = places.iter().find(|place| place.is_file());
    match found {
        Some(place) => Ok(place.clone()),
        None => bail!(
            "{LIBRARY}: not found in {} or {}; build it with `cargo build --release -p starloop_fmu_library`, or name it \
             with --library",
            folder.display(),
            folder.join("../lib/starloop").display()
        ),
    }
}
