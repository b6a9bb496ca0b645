//! `starloop check`: is this bench or scenario sound, what does it mean, what will be drawn and at what error and cost.

use crate::cli::calibrate::{Costs, costs_here};
use crate::cli::check_display_stars::{self, DisplayLimits, display_limits};
use crate::cli::check_plan::{self, Planned};
use crate::cli::check_verdict::{verdict, warnings};
use crate::cli::radiometry_reported::{drawn_text, radiometry_text};
use crate::cli::{
    EXIT_DONE, EXIT_NOT_MET, check_bodies, check_camera, check_display, check_files, check_light, check_observer,
    check_scenario, check_targets,
};
use crate::cli::{
    check_json::CheckFacts, check_judged::judged, check_sight::Sight, frame_plan::FramePlans, report_json::print_json,
};
use anyhow::Result;
use base::clock::{Clock, Monotonic};
use base::time::{Span, Tai};
use clap::Args;
use config::{Backend, Bench, DeadlinePolicy, Document, Event, FileKind, Plant, Scenario, Setting, Sink, StartTime};
use core::fmt::Write;
use image::detector::cost::effect_costs;
use outputs::display::calibration::Calibration;
use run::runtime::{Imager, RunParams};
use run::wiring::memory::{RunForm, RunMemory};
use run::wiring::{bench_parts, tracker_outs};
use run::{wiring::bench_parts::motion_scale, wiring::display_parts::take_display, wiring::sinks::described_lines};
use stars::{Sky, StarIndex};
use std::path::PathBuf;
use testbed::flight_computer::FlightComputer;

/// Command line of `check`.
#[derive(Debug, Args)]
#[command(after_help = event_help())]
pub struct CheckArgs {
    /// Bench, scenario, test plan, requirements or data set (TOML); without one: the built-in loopback bench
    bench: Option<PathBuf>,
    /// Predict with the built-in costs, whatever `starloop calibrate` has measured
    #[arg(long)]
    built_in_costs: bool,
    /// Change a value of the file before it is checked, as for `starloop run`, such as timing.frame_rate_hz=5; may be
    /// repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,
    /// Print the facts as one line of JSON: the bench, its camera, defaults, warnings, the plans of three frames
    #[arg(long)]
    json: bool,
    /// End with status 4 when the file has a warning
    #[arg(long)]
    strict: bool,
}

/// Returns the keys of `[[event]]`, from the list that files are checked by.
fn event_help() -> String {
    format!(
        "An [[event]] of a scenario has at_s, seconds after the first exposure, do, one of these words, and the word's \
         keys; those in brackets may be left out:\n\n{}",
        Event::described_words()
    )
}

/// Runs the command; the exit status.
///
/// # Errors
/// With what is wrong with the bench or the scenario.
pub fn run(arguments: &CheckArgs) -> Result<u8> {
    let document = match &arguments.bench {
        Some(path) => Document::open(path)?,
        None => Bench::built_in_document()?,
    };
    if let (Some(path), true) = (&arguments.bench, arguments.settings.is_empty())
        && let Some(text) = judged(&document, path)?
    {
        if arguments.json {
            let kind = FileKind::of(&document).name();
            print_json("check", serde_json::json!({ "kind": kind, "verdict": text.lines().next() }))?;
        } else {
            print!("{text}");
        }
        return Ok(status(arguments, &warnings(&text)));
    }
    let settings = arguments.settings.iter().map(|text| Setting::parse(text)).collect::<Result<_, _>>()?;
    let document = document.with_settings(settings);
    let mut facts = CheckFacts::default();
    let scenario = Scenario::from_document(&document)?;
    let text = checked(&scenario, arguments.built_in_costs, &mut facts)?;
    let warnings = warnings(&text);
    if arguments.json {
        print_json("check", facts.with_warnings(&warnings))?;
    } else {
        print!("{}{text}", verdict(&name(&scenario), &warnings));
    }
    Ok(status(arguments, &warnings))
}

/// Returns the exit status beside these warnings.
fn status(arguments: &CheckArgs, warnings: &[&str]) -> u8 {
    if arguments.strict && !warnings.is_empty() { EXIT_NOT_MET } else { EXIT_DONE }
}

/// Returns how the verdict calls the file.
fn name(scenario: &Scenario) -> String {
    let kind = if scenario.vehicle().is_some() { "scenario" } else { "bench" };
    format!("{kind} \"{}\"", scenario.name)
}

/// Returns everything there is to say about the file.
fn checked(scenario: &Scenario, only_built_in: bool, facts: &mut CheckFacts) -> Result<String> {
    let bench = report(&scenario.bench, &scenario.plant, only_built_in, facts)?;
    let is_plain = scenario.vehicle().is_none() && scenario.events.is_empty();
    Ok(if is_plain { bench } else { check_scenario::report(scenario)? + "\n" + &bench })
}

/// The conventions every number in files and on the wire follows.
const CONVENTIONS: &str = "\
conventions
  axes         ICRF; body; sensor: +Z boresight, +X image right (columns), +Y image down (rows)
  quaternion   Hamilton, scalar first (w x y z), passive: v_sensor = q v_icrf q*
  rate         of the sensor with respect to ICRF, in sensor axes; a later attitude is exp(-w dt / 2) q
  roll         position angle of the image's up direction, east of north; 0: north up, east left
  pixels       x right, y down; the centre of the first pixel is (0, 0); FITS row 0 is the top row
  time         frames carry mid-exposure; UTC in text, TAI inside; microseconds (32 bits) on the wire
  truth        x, y: mean place over the exposure; electrons: what lands on the detector
";

/// Returns the warnings about a run that `imager` draws, in one line; `None` without any. What cannot be checked is for the
/// run to refuse.
pub(super) fn warning_line(scenario: &Scenario, imager: &Imager, only_built_in: bool) -> Option<String> {
    let mut bench = scenario.bench.clone();
    // A run opens its displays, and prints what is not known of them.
    bench.sinks.retain(|settings| !matches!(settings.sink, Sink::Display(_)));
    let mut facts = CheckFacts::default();
    let prepared = run_params_of(&bench).ok()?;
    let text = report_of(&bench, &scenario.plant, (prepared, imager), only_built_in, &mut facts).ok()?;
    let warnings = warnings(&text);
    (!warnings.is_empty()).then(|| format!("WARNING: {}: {}", name(scenario), warnings.join("; ")))
}

/// Returns the whole report.
fn report(bench: &Bench, plant: &Plant, only_built_in: bool, facts: &mut CheckFacts) -> Result<String> {
    // The check itself makes one detector.
    RunMemory::of_image(&bench.camera, bench.render.backend == Backend::Reference, None).check()?;
    let prepared = run_params_of(bench)?;
    let imager = bench_parts::imager(&prepared.params)?;
    report_of(bench, plant, (prepared, &imager), only_built_in, facts)
}

/// A run as a bench makes it, drawn for its display where that is calibrated.
struct Prepared {
    params: RunParams,
    start: Tai,
    calibration: Option<Calibration>,
}

fn run_params_of(bench: &Bench) -> Result<Prepared> {
    let start = match bench.timing.start {
        StartTime::At(at) => at,
        StartTime::Now => Tai::from_rfc3339("2026-01-01T00:00:00Z")?,
    };
    let mut params = bench_parts::run_params(bench, start)?;
    let calibration = take_display(&mut params, bench, Monotonic::start().now())?;
    Ok(Prepared { params, start, calibration })
}

fn report_of(
    bench: &Bench,
    plant: &Plant,
    (prepared, imager): (Prepared, &Imager),
    only_built_in: bool,
    facts: &mut CheckFacts,
) -> Result<String> {
    let Prepared { mut params, start, calibration } = prepared;
    let limits = calibration.as_ref().map(|calibration| display_limits(calibration, &params)).transpose()?.flatten();
    let costs = costs_here(imager, only_built_in);
    bench_parts::take_real_clock(&mut params, bench, costs.measured);
    let mut text = String::new();
    let sky = params.open_sky()?;
    let sight = Sight::of(bench, plant, &params);
    describe(&mut text, bench, &params, (imager, &sky, &sight), &costs)?;
    facts.describe(bench, &params, imager, &costs.origin);
    write_memory(&mut text, bench)?;
    check_display::write_display(&mut text, bench, &params, calibration.as_ref())?;
    write_defaults(&mut text, bench)?;
    text.push('\n');
    text.push_str(CONVENTIONS);
    text.push('\n');
    check_files::write_files(&mut text, bench, plant, &params)?;
    crate::cli::check_attitude::write_attitude(&mut text, bench, &params, motion_scale(plant, bench))?;
    crate::cli::check_jitter::write_jitter(&mut text, bench, &params)?;
    let computer = || FlightComputer::new(bench_parts::flight_computer_of(plant, bench, start, params.first_exposure));
    check_targets::write_targets(&mut text, &params, &computer())?;
    plans(&mut text, bench, computer(), (&params, limits.as_ref(), &sight), (imager, &sky), facts)?;
    Ok(text)
}

fn describe(
    text: &mut String,
    bench: &Bench,
    params: &RunParams,
    (imager, sky, sight): (&Imager, &Sky, &Sight),
    costs: &Costs,
) -> Result<()> {
    let camera = &bench.camera;
    let [fov_x, fov_y] = camera.fov_deg();
    writeln!(text, "bench \"{}\"", bench.name)?;
    writeln!(
        text,
        "  camera       \"{}\": {} x {} px, {fov_x:.2} x {fov_y:.2} deg, {:.2} arcsec/px",
        camera.name,
        camera.detector.width_px,
        camera.detector.height_px,
        camera.ifov_arcsec()
    )?;
    writeln!(text, "  radiometry   {}", radiometry_text(camera))?;
    let zero_point = camera.star_light().zero_point_e_per_s();
    let light =
        zero_point.map_or_else(|| "no zero point".into(), |e_per_s| format!("{e_per_s:.3e} e-/s at magnitude 0"));
    writeln!(text, "  light        {light}, {}", drawn_text(camera, params.camera.limiting_mag))?;
    sight.write(text, bench, params, sky)?;
    check_camera::write_cameras(text, bench)?;
    check_observer::write_observer(text, params)?;
    check_light::write_light(text, &params.camera)?;
    write_stars(text, params, sky)?;
    let exposed = &params.camera;
    let after_s = exposed.readout_s - params.ahead.s();
    let due = if params.ahead == Span::ZERO {
        format!("{after_s} s after it ends")
    } else if after_s >= -exposed.exposure_s {
        format!("{:.4} s after it begins", after_s + exposed.exposure_s)
    } else {
        format!("{:.4} s before it begins", -after_s - exposed.exposure_s)
    };
    writeln!(
        text,
        "  frames       {} at {} Hz, exposure {} s, due {due}, late ones {}",
        params.frames,
        bench.timing.frame_rate_hz,
        exposed.exposure_s,
        late_frames(params.deadline_policy)
    )?;
    writeln!(text, "  backend      {} ({})", imager.name(), imager.description())?;
    if let Some(note) = imager.note() {
        writeln!(text, "               {note}")?;
    }
    if !bench.extra_heads.is_empty() {
        let mountings: Vec<String> = bench.mountings().iter().map(|head| format!("{:.4?}", head.wxyz())).collect();
        writeln!(text, "  heads        {}, drawn in turn, sensor_from_body {}", mountings.len(), mountings.join(" "))?;
    }
    for (place, words) in described_lines(&bench.sinks) {
        writeln!(text, "  {place:<12} {words}")?;
    }
    for (place, words) in tracker_outs::described_lines(&bench.tracker_outs) {
        writeln!(text, "  {place:<12} {words}")?;
    }
    writeln!(text, "  costs        {}", costs.origin)?;
    let camera_params = &params.camera;
    let effects: Vec<String> =
        effect_costs(&camera_params.detector, &camera_params.patterns, camera_params.geometry.width_px())
            .map(|effect| format!("{} {:+.0} %", effect.name, 100.0 * effect.share))
            .collect();
    if !effects.is_empty() {
        let readout_ms = camera_params.predicted_readout_ms(&params.cost.unwrap_or_else(|| imager.cost()));
        writeln!(text, "  detector     {readout_ms:.2} ms predicted, with {}", effects.join(", "))?;
    }
    let budget = &params.budget;
    writeln!(
        text,
        "  budget       centroid {} px, flux {}, pixel {} sigma, line of sight {} arcsec",
        budget.centroid_px, budget.flux_rel, budget.pixel_sigma, budget.los_arcsec
    )?;
    Ok(())
}

/// Writes the memory that a run takes, on the real clock where its sinks have queues, and whether there is as much
/// here.
fn write_memory(text: &mut String, bench: &Bench) -> Result<()> {
    let memory = RunMemory::of(bench, &bench.sinks, RunForm { is_real: true, has_view: false });
    writeln!(text, "  memory       {}", memory.in_words())?;
    if let Err(error) = memory.check() {
        writeln!(text, "  WARNING      {error}")?;
    }
    Ok(())
}

/// Returns the stars that layers have, and whether bright ones are missing.
fn write_stars(text: &mut String, params: &RunParams, sky: &Sky) -> Result<()> {
    let Sky { layers, most_stars } = sky;
    let [from, faintest] = layers.magnitudes();
    if !layers.is_in_memory() {
        let stars: u64 = layers.layers().map(StarIndex::stars).sum();
        writeln!(
            text,
            "  stars        {stars} in {} layers to G = {faintest}, at most {most_stars} of them in memory ({} MiB)",
            layers.layers().len(),
            params.star_memory_mb
        )?;
        if from > f32::NEG_INFINITY {
            writeln!(
                text,
                "  WARNING      stars brighter than G = {from} are missing from the frames: no layer has them"
            )?;
        }
    }
    Ok(())
}

fn write_defaults(text: &mut String, bench: &Bench) -> Result<()> {
    for (what, list) in [("bench", &bench.defaulted), ("camera", &bench.camera.defaulted)] {
        for default in list {
            writeln!(text, "  default      {what}: {} = {}", default.key, default.value)?;
        }
    }
    Ok(())
}

/// Plans of the first, a middle and the last frame, from the simulated flight computer's own truth.
fn plans(
    text: &mut String,
    bench: &Bench,
    computer: FlightComputer,
    (params, limits, sight): (&RunParams, Option<&DisplayLimits>, &Sight),
    (imager, sky): (&Imager, &Sky),
    facts: &mut CheckFacts,
) -> Result<()> {
    let planned = Planned::new(bench, params, imager);
    check_plan::write_sampling(text, params)?;
    check_plan::write_degradations(text, &planned)?;
    let mut frames = FramePlans::new(computer, params, sky);
    let last = params.frames.saturating_sub(1);
    let mut numbers = vec![0, last / 2, last];
    numbers.dedup();
    for number in numbers {
        if !frames.has_attitude(number) {
            writeln!(text, "frame {number} has no attitude: nothing is planned for it")?;
            continue;
        }
        let mut planner = frames.planner(planned.cost, planned.limit_ms);
        if imager.is_exact() {
            planner = planner.exact();
        }
        let plan = frames.plan(number, &mut planner)?;
        check_plan::write_plan(text, number, plan, &planned)?;
        facts.plan(number, plan);
        sight.write_frame(text, number, plan)?;
        check_light::write_frame(text, &frames.scene().light, &params.camera, plan)?;
        if let Some(bodies) = &frames.scene().bodies {
            check_bodies::write_frame(text, bodies, &params.camera, plan)?;
        }
        if let Some(limits) = limits {
            check_display_stars::write_frame(text, limits, plan)?;
        }
    }
    Ok(())
}

/// Returns what happens to frames that are not ready in time, in words.
fn late_frames(policy: DeadlinePolicy) -> &'static str {
    match policy {
        DeadlinePolicy::Hold => "are replaced by the one before",
        DeadlinePolicy::Drop => "are not sent",
        DeadlinePolicy::Late => "are sent late",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(bench: &Bench, only_built_in: bool) -> Result<String> {
        super::report(bench, &Plant::FlightComputer, only_built_in, &mut CheckFacts::default())
    }

    #[test]
    fn the_built_in_bench_is_explained() {
        let text = report(&Bench::built_in().unwrap(), true).unwrap();
        for word in [
            "bench \"",
            "sink         recorder: FITS, ",
            "memory       ",
            "passive",
            "plan of frame 0",
            "fits",
            "> ",
            "bright-stars-only",
            "supersampled:5",
            "degradation levels",
        ] {
            assert!(text.contains(word), "no \"{word}\" in:\n{text}");
        }
    }

    #[test]
    fn a_scenario_is_explained_with_its_bench() {
        let of = |file: &str| {
            let scenario = Scenario::from_document(&Document::built_in(file).unwrap()).unwrap();
            (checked(&scenario, true, &mut CheckFacts::default()).unwrap(), name(&scenario))
        };
        let (text, name) = of("scenarios/three_heads.toml");
        assert_eq!(verdict(&name, &warnings(&text)), "scenario \"three heads\" is sound\n");
        for word in [
            "scenario \"three heads\"\n",
            "bench \"closed loop",
            "3, sensor_from_body",
            "    150.0      60.0  stray_light          5000000 e-/s, head 0",
            "    180.0      60.0  tracker_off          head 1",
            "pointing error in the window: at most 5 arcsec rms",
            "mode at the end: fine_pointing",
            "default      scenario: tracker.stars = 40",
            "plan of frame 0",
        ] {
            assert!(text.contains(word), "no \"{word}\" in:\n{text}");
        }
        assert!(of("scenarios/acquisition.toml").0.contains("random"), "attitude at the start");
    }

    #[test]
    fn a_scenario_that_cannot_be_flown_is_refused() {
        let event = "event=[{ at_s = 1.0, do = \"frame_bit_flip\", bit = 1, px = [200, 10], for_s = 1.0 }]";
        let binning = "bench.camera.detector.binning.factor=2";
        let settings = [event, binning].map(|text| Setting::parse(text).unwrap()).to_vec();
        let document = Document::built_in("scenarios/campaign.toml").unwrap().with_settings(settings);
        let scenario = Scenario::from_document(&document).unwrap();
        let error = format!("{:#}", checked(&scenario, true, &mut CheckFacts::default()).unwrap_err());
        assert!(error.contains("frame_bit_flip") && error.contains("px = [200, 10]"), "{error}");
    }

    #[test]
    fn bright_layers_that_are_left_out_are_reported() {
        let folder = tempfile::tempdir().unwrap();
        let sorting = stars::layer::Sorting::start(&folder.path().join("work"), &[4.5, 7.0]).unwrap();
        let reports = sorting.finish(folder.path(), 2016.0, "whom it concerns", &mut |_| {}).unwrap();
        let mut bench = Bench::built_in().unwrap();
        bench.layers = reports.into_iter().map(|report| report.path).collect();
        let report = |bench: &Bench, only_built_in| report(bench, only_built_in);
        let warning = "WARNING      stars brighter than G = 4.5 are missing from the frames";
        assert!(!report(&bench, true).unwrap().contains("stars brighter than"), "control: with all layers");
        bench.layers.remove(0);
        let text = report(&bench, true).unwrap();
        assert!(text.contains(warning), "no \"{warning}\" in:\n{text}");
    }

    #[test]
    fn memory_of_a_run_is_added_up_and_one_that_does_not_fit_is_a_warning() {
        let mut bench = Bench::built_in().unwrap();
        let memory = |bench: &Bench| {
            let mut text = String::new();
            write_memory(&mut text, bench).unwrap();
            text
        };
        let text = memory(&bench);
        assert!(text.starts_with("  memory       ") && text.contains(" MiB: ") && !text.contains("WARNING"), "{text}");
        (bench.camera.detector.width_px, bench.camera.detector.height_px) = (16_384, 1024);
        bench.extra_heads = vec![bench.first_head(); 2];
        let text = memory(&bench);
        assert!(text.contains("(16384 x 1024 px, heads: 3)"), "{text}");
        // No machine has memory for so many frames: 100 PiB.
        bench.sinks[0].queue_frames = u32::MAX;
        let text = memory(&bench);
        assert!(text.contains("\n  WARNING      this run needs") && text.contains("sink.queue = 4294967295"), "{text}");
    }

    #[test]
    fn help_lists_the_keys_of_every_event() {
        let help = event_help();
        assert!(help.contains("\n  stray_light          for_s, e_per_s, [head]\n"), "{help}");
    }
}
