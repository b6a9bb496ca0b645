//! The command line of `run` and the file that it names -> the scenario that is run.

use crate::cli::run_args::RunArgs;
use anyhow::{Context, Result, bail};
use batch::campaign::{check_time_for_faults, episode_scenario};
use config::{Bench, Document, Scenario, Setting};

/// The run and its file.
pub(super) struct RunInput {
    /// With the values that the command line sets.
    pub(super) document: Document,
    pub(super) scenario: Scenario,
}

/// Reads the file, or the bench of the binary, with the command line's changes.
pub(super) fn input(arguments: &RunArgs) -> Result<RunInput> {
    let document = match &arguments.bench {
        Some(path) => Document::open(path)?,
        None => Bench::built_in_document()?,
    };
    let settings = arguments.settings.iter().map(|text| Setting::parse(text)).collect::<Result<_, _>>()?;
    let document = document.with_settings(settings);
    let mut scenario = match duration_s(arguments)? {
        Some(duration_s) => Scenario::from_document_lasting(document.clone(), duration_s)?,
        None => Scenario::from_document(&document)?,
    };
    change_bench(&mut scenario.bench, arguments);
    if arguments.random_faults {
        if scenario.vehicle().is_none() {
            bail!("--random-faults: got a bench; wanted a run with a spacecraft, which such faults could upset");
        }
        check_time_for_faults(&scenario).context("--random-faults")?;
        scenario = episode_scenario(&scenario, scenario.bench.seed);
    }
    Ok(RunInput { document, scenario })
}

fn change_bench(bench: &mut Bench, arguments: &RunArgs) {
    if let Some(backend) = arguments.backend {
        bench.render.backend = backend.configured();
    }
    bench.seed = arguments.seed.unwrap_or(bench.seed);
    bench.noise_seed_given = arguments.noise_seed.or(bench.noise_seed_given);
}

/// Returns the duration given by `--duration`.
fn duration_s(arguments: &RunArgs) -> Result<Option<f64>> {
    match arguments.duration {
        Some(duration_s) if !(duration_s.is_finite() && duration_s > 0.0) => {
            bail!("--duration: got {duration_s}, wanted seconds above 0")
        }
        given => Ok(given),
    }
}
