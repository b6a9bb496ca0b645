//! `starloop campaign`: many simulated hours of random faults, checked throughout.

use crate::cli::junit::{self, Case, Outcome};
use crate::cli::{EXIT_DONE, EXIT_NOT_MET, report_json::print_json};
use anyhow::{Context, Result, bail};
use base::clock::Stopwatch;
use batch::campaign::{Episode, check_time_for_faults, random_faults, run_episode};
use clap::Args;
use config::{Document, Scenario};
use core::sync::atomic::{AtomicU64, Ordering};
use rayon::prelude::*;
use run::wiring::{error::LoopError, memory::RunMemory};
use std::{io::Write, path::PathBuf, str::FromStr, sync::Mutex};

/// Error of the JUnit file while a campaign flies.
const NO_END: &str = "the campaign did not reach its end";
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
    /// Write one line of JSON per episode here (a new file); of one that failed: seed and error
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write each invariant of each episode as JUnit XML
    #[arg(long, value_name = "FILE.xml")]
    junit: Option<PathBuf>,
    /// Print the report as one line of JSON
    #[arg(long)]
    json: bool,
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
    let file = arguments.scenario.as_ref().map_or_else(|| BUILT_IN_SCENARIO.into(), |path| path.display().to_string());
    if scenario.vehicle().is_none() {
        bail!("{file}: has no spacecraft; wanted a scenario, whose spacecraft is flown inside: spacecraft = \"FILE\"");
    }
    check_time_for_faults(&scenario).with_context(|| file.clone())?;
    let episode_s = scenario.bench.timing.duration_s;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked: at most 1e10")]
    let episodes = ((arguments.hours * 3600.0 / episode_s).ceil() as u64).max(1);
    if arguments.hours * 3600.0 < episode_s {
        eprintln!("--hours {}: one episode of this scenario takes {episode_s} s, and is flown whole", arguments.hours);
    }
    let seeds = seeds(arguments.seed, episodes, arguments.shard)?;
    // A run that is hardly long enough may draw none at all: that would be no campaign.
    if seeds.iter().all(|seed| random_faults(&scenario, *seed).is_empty()) {
        bail!("duration_s is {episode_s}; wanted a longer run: no fault is drawn in it from any of these seeds");
    }
    let (heads, threads) = (scenario.bench.head_count(), rayon::current_num_threads());
    RunMemory::of_loops(&scenario.bench, heads, seeds.len(), threads).check()?;
    eprintln!(
        "campaign \"{}\": {} episodes of {episode_s} s, seeds {} to {}",
        scenario.name,
        seeds.len(),
        seeds.first().copied().unwrap_or(0),
        seeds.last().copied().unwrap_or(0)
    );
    // A file that cannot be written is known before the hours of flight, not after them.
    let unfinished = Case { class: "campaign".into(), name: "flown".into(), outcome: Outcome::Error(NO_END.into()) };
    let document = junit::document(&scenario.name, None, &[unfinished]);
    arguments.junit.iter().try_for_each(|path| junit::save(path, &document))?;
    let results = fly(&scenario, &seeds, arguments)?;
    let document = to_junit(&scenario.name, &results.0, results.1);
    let saved = arguments.junit.iter().try_for_each(|path| junit::save(path, &document));
    let status = report(&results, episode_s, arguments)?;
    saved.map(|()| status)
}

/// Returns the JUnit document: a test case for each invariant of each episode, and an error for one that gave no results.
fn to_junit(name: &str, results: &[Flown], wall_s: f64) -> String {
    let cases = |(seed, flown): &Flown| {
        let class = format!("seed {seed}");
        match flown {
            Ok(episode) => episode.invariants.iter().map(|one| Case::of_invariant(&class, one)).collect::<Vec<_>>(),
            Err(error) => vec![Case { class, name: "flown".into(), outcome: Outcome::Error(error.to_string()) }],
        }
    };
    junit::document(name, Some(wall_s), &results.iter().flat_map(cases).collect::<Vec<_>>())
}

/// Seeds of the episodes of one part.
fn seeds(first: u64, episodes: u64, Shard { number, of }: Shard) -> Result<Vec<u64>> {
    if first.checked_add(episodes - 1).is_none() {
        let most = u64::MAX - (episodes - 1);
        bail!("--seed: got {first}, wanted at most {most}: the seeds of {episodes} episodes count up from it");
    }
    let seeds: Vec<u64> = (0..episodes).filter(|i| i % of == number - 1).map(|i| first + i).collect();
    if seeds.is_empty() {
        bail!("--shard: got {number}/{of}, wanted at most {episodes} parts: there are {episodes} episodes in all");
    }
    Ok(seeds)
}

/// The line of `--out` for an episode that gave no results.
#[derive(serde::Serialize)]
struct FailedEpisode {
    seed: u64,
    error: String,
}

fn line((seed, flown): &Flown) -> Result<String> {
    Ok(match flown {
        Ok(episode) => serde_json::to_string(episode)?,
        Err(error) => serde_json::to_string(&FailedEpisode { seed: *seed, error: error.to_string() })?,
    })
}

type Flown = (u64, Result<Episode, LoopError>);

fn fly(scenario: &Scenario, seeds: &[u64], arguments: &CampaignArgs) -> Result<(Vec<Flown>, f64)> {
    let out = arguments.out.as_ref().map(|path| {
        std::fs::File::create_new(path)
            .with_context(|| format!("cannot make {}, which must be a new file", path.display()))
    });
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
        let flown = (*seed, flown);
        if let Some(file) = out.lock().unwrap_or_else(std::sync::PoisonError::into_inner).as_mut() {
            writeln!(file, "{}", line(&flown)?).context("--out")?;
        }
        Ok(flown)
    };
    let mut results = seeds.par_iter().map(fly_one).collect::<Result<Vec<_>>>()?;
    results.sort_by_key(|(seed, _)| *seed);
    Ok((results, wall.lap().s()))
}

fn report((results, wall_s): &(Vec<Flown>, f64), episode_s: f64, arguments: &CampaignArgs) -> Result<u8> {
    let (mut failed, mut faults, mut hits, mut frames) = (0, 0, 0, 0);
    let built_in = || format!("configs/{BUILT_IN_SCENARIO}");
    let file = arguments.scenario.as_ref().map_or_else(built_in, |path| path.display().to_string());
    let mut broken = Vec::new();
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
        if arguments.json {
            broken.push(serde_json::json!({ "seed": seed, "lines": lines }));
            continue;
        }
        println!("seed {seed} broke an invariant:");
        lines.iter().for_each(|line| println!("  {line}"));
        println!("  replay: starloop run {file} --clock virtual --random-faults --seed {seed} --out DIR");
    }
    let hours = results.len() as f64 * episode_s / 3600.0;
    let held = results.len() - failed;
    if arguments.json {
        print_json(
            "campaign",
            serde_json::json!({
                "scenario": file, "episodes": results.len(), "held": held, "simulated_hours": hours, "wall_s": wall_s,
                "frames": frames, "events": faults, "hits": hits, "broken": broken,
            }),
        )?;
        return Ok(if failed == 0 { EXIT_DONE } else { EXIT_NOT_MET });
    }
    println!(
        "{} of {} episodes held: {hours:.1} simulated hours in {wall_s:.0} s, {frames} frames, {faults} events, {hits} hits",
        held,
        results.len()
    );
    Ok(if failed == 0 { EXIT_DONE } else { EXIT_NOT_MET })
}

#[cfg(test)]
mod tests {
    use super::*;
    use config::Setting;

    const WHOLE: Shard = Shard { number: 1, of: 1 };

    #[test]
    fn parts_are_disjoint_and_together_the_whole() {
        let of = |number| seeds(10, 5, Shard { number, of: 2 }).unwrap();
        assert_eq!((of(1), of(2)), (vec![10, 12, 14], vec![11, 13]));
    }

    #[test]
    fn a_part_without_episodes_is_refused() {
        let error = seeds(1, 2, Shard { number: 3, of: 4 }).unwrap_err().to_string();
        assert!(error.contains("--shard: got 3/4") && error.contains("there are 2 episodes"), "{error}");
        assert_eq!(seeds(1, 3, Shard { number: 3, of: 4 }).unwrap(), [3]);
    }

    #[test]
    fn seeds_that_cannot_count_up_are_refused() {
        let error = seeds(u64::MAX - 1, 3, WHOLE).unwrap_err().to_string();
        assert!(error.contains(&format!("wanted at most {}", u64::MAX - 2)), "{error}");
        assert_eq!(seeds(u64::MAX - 1, 2, WHOLE).unwrap(), [u64::MAX - 1, u64::MAX]);
    }

    #[test]
    fn an_episode_that_failed_has_its_line_and_a_campaign_without_faults_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let mut arguments = CampaignArgs {
            scenario: None,
            hours: 1.0,
            seed: 7,
            shard: WHOLE,
            out: Some(folder.path().join("a.jsonl")),
            junit: None,
            json: false,
        };
        // A pixel of the detector that binned images do not have: known only when the loop is made.
        let event = "event=[{ at_s = 1.0, do = \"frame_bit_flip\", bit = 1, px = [200, 10], for_s = 1.0 }]";
        let binning = "bench.camera.detector.binning.factor=2";
        let settings = [event, binning].map(|text| Setting::parse(text).unwrap()).to_vec();
        let document = Document::built_in(BUILT_IN_SCENARIO).unwrap().with_settings(settings);
        let (flown, _) = fly(&Scenario::from_document(&document).unwrap(), &[7], &arguments).unwrap();
        assert!(flown[0].1.is_err());
        let document = to_junit("a", &flown, 1.0);
        assert!(
            document.contains("tests=\"1\" failures=\"0\" errors=\"1\"") && document.contains("classname=\"seed 7\"")
        );
        let lines = std::fs::read_to_string(folder.path().join("a.jsonl")).unwrap();
        let line: serde_json::Value = serde_json::from_str(lines.trim()).unwrap();
        assert_eq!(line["seed"], 7);
        assert!(line["error"].as_str().unwrap().contains("images have 128 x 128 pixels"), "{line}");
        let short = concat!(env!("CARGO_MANIFEST_DIR"), "/configs/scenarios/bus_dropouts.toml");
        arguments.scenario = Some(short.into());
        let error = format!("{:#}", run(&arguments).unwrap_err());
        assert!(error.contains("bus_dropouts.toml") && error.contains("wanted more than 1200"), "{error}");
    }
}
