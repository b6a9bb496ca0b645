//! `starloop campaign`: many simulated hours of random faults, checked throughout.

use crate::base::clock::Stopwatch;
use crate::cli::{EXIT_DONE, EXIT_NOT_MET};
use crate::config::{Document, Scenario};
use crate::wiring::campaign::{Episode, run_episode};
use crate::wiring::closed_loop::LoopError;
use anyhow::{Context, Result, bail};
use clap::Args;
use core::sync::atomic::{AtomicU64, Ordering};
use rayon::prelude::*;
use std::io::Write;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Mutex;

/// The scenario flown when none is named.
const BUILT_IN_SCENARIO: &str = "scenarios/campaign.toml";

/// Command line of `campaign`.
#[derive(Debug, Args)]
pub struct CampaignArgs {
    /// Scenario file (TOML) that every episode flies; without one: the built-in campaign scenario
    scenario: Option<PathBuf>,
    /// Simulated hours, all episodes together
    #[arg(long, default_value_t = 1.0, value_name = "H")]
    hours: f64,
    /// Seed of the first episode; the next ones count up
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only the N-th of M equal parts, as 2/4: the parts may run on different machines
    #[arg(long, value_name = "N/M", default_value = "1/1")]
    shard: Shard,
    /// Write one line of JSON per episode here (a new file)
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// A part of a campaign.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Shard {
    number: u64,
    of: u64,
}

impl FromStr for Shard {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let wanted = || format!("got \"{text}\", wanted N/M with 1 <= N <= M, such as 2/4");
        let (number, of) = text.split_once('/').ok_or_else(wanted)?;
        let (number, of) = (number.parse().map_err(|_| wanted())?, of.parse().map_err(|_| wanted())?);
        if number >= 1 && number <= of { Ok(Self { number, of }) } else { Err(wanted()) }
    }
}

/// Runs the command; the exit status.
///
/// # Errors
/// With what could not be done.
pub fn run(arguments: &CampaignArgs) -> Result<u8> {
    let scenario = match &arguments.scenario {
        Some(path) => Scenario::load(path)?,
        None => Scenario::from_document(&Document::built_in(BUILT_IN_SCENARIO)?)?,
    };
    if !(arguments.hours.is_finite() && arguments.hours > 0.0 && arguments.hours <= 1e6) {
        bail!("--hours: got {}, wanted hours above 0, up to a million", arguments.hours);
    }
    let episode_s = scenario.bench.timing.duration_s;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked: at most 1e10")]
    let episodes = (arguments.hours * 3600.0 / episode_s).ceil() as u64;
    let Shard { number, of } = arguments.shard;
    let seeds: Vec<u64> = (0..episodes).filter(|i| i % of == number - 1).map(|i| arguments.seed + i).collect();
    eprintln!(
        "campaign \"{}\": {} episodes of {episode_s} s, seeds {} to {}",
        scenario.name,
        seeds.len(),
        seeds.first().copied().unwrap_or(0),
        seeds.last().copied().unwrap_or(0)
    );
    let results = fly(&scenario, &seeds, arguments)?;
    Ok(report(&results, episode_s, arguments))
}

type Flown = (u64, Result<Episode, LoopError>);

fn fly(scenario: &Scenario, seeds: &[u64], arguments: &CampaignArgs) -> Result<(Vec<Flown>, f64)> {
    let out = arguments
        .out
        .as_ref()
        .map(|path| std::fs::File::create_new(path).with_context(|| format!("cannot make {}", path.display())));
    let out = Mutex::new(out.transpose()?);
    let done = AtomicU64::new(0);
    let mut wall = Stopwatch::start();
    let fly_one = |seed: &u64| -> Result<Flown> {
        let flown = run_episode(scenario, *seed);
        let count = done.fetch_add(1, Ordering::Relaxed) + 1;
        let verdict = match &flown {
            Ok(episode) if episode.violations == 0 => "held".to_owned(),
            Ok(episode) => format!("{} VIOLATIONS", episode.violations),
            Err(error) => format!("FAILED: {error}"),
        };
        eprintln!("  {count}/{} seed {seed}: {verdict}", seeds.len());
        if let (Ok(episode), Some(file)) =
            (&flown, out.lock().unwrap_or_else(std::sync::PoisonError::into_inner).as_mut())
        {
            writeln!(file, "{}", serde_json::to_string(episode)?)?;
        }
        Ok((*seed, flown))
    };
    let mut results = seeds.par_iter().map(fly_one).collect::<Result<Vec<_>>>()?;
    results.sort_by_key(|(seed, _)| *seed);
    Ok((results, wall.lap().s()))
}

fn report((results, wall_s): &(Vec<Flown>, f64), episode_s: f64, arguments: &CampaignArgs) -> u8 {
    let (mut failed, mut faults, mut hits, mut frames) = (0, 0, 0, 0);
    let built_in = || format!("configs/{BUILT_IN_SCENARIO}");
    let file = arguments.scenario.as_ref().map_or_else(built_in, |path| path.display().to_string());
    for (seed, flown) in results {
        let lines = match flown {
            Ok(episode) => {
                faults += episode.events;
                hits += episode.hits;
                frames += episode.frames;
                if episode.violations == 0 {
                    continue;
                }
                episode.violation_lines.clone()
            }
            Err(error) => vec![error.to_string()],
        };
        failed += 1;
        println!("seed {seed} broke an invariant:");
        lines.iter().for_each(|line| println!("  {line}"));
        println!("  replay: starloop run {file} --clock virtual --random-faults --seed {seed} --out DIR");
    }
    let hours = results.len() as f64 * episode_s / 3600.0;
    println!(
        "{} of {} episodes held: {hours:.1} simulated hours in {wall_s:.0} s, {frames} frames, {faults} events, {hits} hits",
        results.len() - failed,
        results.len()
    );
    if failed == 0 { EXIT_DONE } else { EXIT_NOT_MET }
}
