//! The command line of `run` and the file that it names -> the bench or scenario that is run.

use crate::cli::run::RunArgs;
use anyhow::{Context, Result, bail};
use batch::campaign::{check_room_for_faults, episode_scenario};
use config::{Bench, Document, Scenario, Setting, is_scenario};

/// The scenario with the command line's changes, when the file is one.
pub(super) fn scenario(arguments: &RunArgs) -> Result<Option<Scenario>> {
    if arguments.bench.is_none() {
        return Ok(None);
    }
    let document = document(arguments)?;
    if !is_scenario(&document) {
        return Ok(None);
    }
    let mut settings = settings(arguments)?;
    // Set before anything is checked: events and expectations are held to it.
    if let Some(duration_s) = duration_s(arguments)? {
        settings.push(Setting::parse(&format!("duration_s={duration_s:?}"))?);
    }
    let mut scenario = Scenario::from_document(&document.with_settings(settings))?;
    change_bench(&mut scenario.bench, arguments)?;
    if arguments.random_faults {
        check_room_for_faults(&scenario).context("--random-faults")?;
        scenario = episode_scenario(&scenario, scenario.bench.seed);
    }
    Ok(Some(scenario))
}

/// The file, or the bench of the binary, with the values that the command line sets.
pub(super) fn document(arguments: &RunArgs) -> Result<Document> {
    let document = match &arguments.bench {
        Some(path) => Document::open(path)?,
        None => Bench::built_in_document()?,
    };
    Ok(document.with_settings(settings(arguments)?))
}

fn settings(arguments: &RunArgs) -> Result<Vec<Setting>> {
    Ok(arguments.settings.iter().map(|text| Setting::parse(text)).collect::<Result<_, _>>()?)
}

/// The bench with the command line's changes.
pub(super) fn bench(arguments: &RunArgs) -> Result<Bench> {
    let mut bench = Bench::from_document(&document(arguments)?)?;
    change_bench(&mut bench, arguments)?;
    Ok(bench)
}

fn change_bench(bench: &mut Bench, arguments: &RunArgs) -> Result<()> {
    bench.timing.duration_s = duration_s(arguments)?.unwrap_or(bench.timing.duration_s);
    if let Some(backend) = arguments.backend {
        bench.render.backend = backend.configured();
    }
    bench.seed = arguments.seed.unwrap_or(bench.seed);
    bench.noise_seed_given = arguments.noise_seed.or(bench.noise_seed_given);
    Ok(())
}

/// What `--duration` asks for.
fn duration_s(arguments: &RunArgs) -> Result<Option<f64>> {
    match arguments.duration {
        Some(duration_s) if !(duration_s.is_finite() && duration_s > 0.0) => {
            bail!("--duration: got {duration_s}, wanted seconds above 0")
        }
        given => Ok(given),
    }
}
