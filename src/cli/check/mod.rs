//! `starloop check`: is this bench or scenario sound, what does it mean, what will be drawn and at what error and cost.

mod attitude;
mod attitude_file;
mod bodies;
pub(super) mod camera;
mod display;
mod judged;
mod plans;
mod scenario;

use crate::cli::calibrate::{Costs, costs_here};
use crate::cli::named::{drawn_mag, drawn_text, radiometry_text};
use crate::cli::{EXIT_DONE, EXIT_NOT_MET, facts::Facts, frame_plan::FramePlans};
use anyhow::Result;
use attitude::{write_attitude, write_jitter};
use base::accuracy::AccuracyBudget;
use base::clock::{Clock, Monotonic};
use base::time::{Span, Tai};
use camera::Sight;
use clap::Args;
use config::{Backend, Bench, DeadlinePolicy, Document, Event, Plant, Scenario, Setting, Sink, StartTime};
use display::{DisplayLimits, display_limits};
use image::detector::cost::effect_costs;
use judged::judged;
use outputs::display::calibration::Calibration;
use plans::Planned;
use run::runtime::{Imager, RunParams};
use run::wiring::memory::{RunForm, RunMemory};
use run::wiring::{bench_parts, tracker_ins, tracker_outs};
use run::{wiring::bench_parts::motion_scale, wiring::display_parts::take_display, wiring::sinks::described_lines};
use serde_json::json;
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
        && let Some(facts) = judged(&document, path)?
    {
        facts.print("check", arguments.json)?;
        return Ok(EXIT_DONE);
    }
    let settings = arguments.settings.iter().map(|text| Setting::parse(text)).collect::<Result<_, _>>()?;
    let document = document.with_settings(settings);
    let scenario = Scenario::from_document(&document)?;
    let mut facts = checked(&scenario, arguments.built_in_costs)?;
    if !arguments.json {
        print!("{}", facts.verdict(&name(&scenario)));
    }
    let warnings: Vec<String> = facts.warnings().into_iter().map(str::to_owned).collect();
    let status = if arguments.strict && !warnings.is_empty() { EXIT_NOT_MET } else { EXIT_DONE };
    facts.value("warnings", warnings);
    facts.print("check", arguments.json)?;
    Ok(status)
}

/// Returns how the verdict calls the file.
fn name(scenario: &Scenario) -> String {
    let kind = if scenario.vehicle().is_some() { "scenario" } else { "bench" };
    format!("{kind} \"{}\"", scenario.name)
}

/// Returns everything there is to say about the file.
fn checked(scenario: &Scenario, only_built_in: bool) -> Result<Facts> {
    let of_bench = report(&scenario.bench, &scenario.plant, only_built_in)?;
    let is_plain = scenario.vehicle().is_none() && scenario.events.is_empty();
    if is_plain {
        return Ok(of_bench);
    }
    let mut facts = scenario::report(scenario)?;
    facts.line("");
    facts.append(of_bench);
    Ok(facts)
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
    let prepared = run_params_of(&bench).ok()?;
    let facts = report_of(&bench, &scenario.plant, (prepared, imager), only_built_in).ok()?;
    let warnings = facts.warnings();
    (!warnings.is_empty()).then(|| format!("WARNING: {}: {}", name(scenario), warnings.join("; ")))
}

/// Returns the whole report.
fn report(bench: &Bench, plant: &Plant, only_built_in: bool) -> Result<Facts> {
    // The check itself makes one detector.
    RunMemory::of_image(&bench.camera, bench.render.backend == Backend::Reference, None).check()?;
    let prepared = run_params_of(bench)?;
    let imager = bench_parts::imager(&prepared.params)?;
    report_of(bench, plant, (prepared, &imager), only_built_in)
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
        StartTime::Now | StartTime::Plant => Tai::from_rfc3339("2026-01-01T00:00:00Z")?,
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
) -> Result<Facts> {
    let Prepared { mut params, start, calibration } = prepared;
    let limits = calibration.as_ref().map(|calibration| display_limits(calibration, &params)).transpose()?.flatten();
    let costs = costs_here(imager, only_built_in);
    bench_parts::take_real_clock(&mut params, bench, costs.measured);
    let mut facts = Facts::indented();
    let sky = params.open_sky()?;
    let sight = Sight::of(bench, plant, &params);
    describe(&mut facts, bench, &params, (imager, &sky, &sight), &costs)?;
    write_memory(&mut facts, bench);
    display::write_display(&mut facts, bench, &params, calibration.as_ref())?;
    write_defaults(&mut facts, bench);
    facts.line("");
    facts.line(CONVENTIONS);
    attitude_file::write_files(&mut facts, bench, plant, &params);
    write_attitude(&mut facts, bench, &params, motion_scale(plant, bench));
    write_jitter(&mut facts, bench, &params);
    let computer = || FlightComputer::new(bench_parts::flight_computer_of(plant, bench, start, params.first_exposure));
    bodies::write_targets(&mut facts, &params, &computer());
    plans(&mut facts, bench, computer(), (&params, limits.as_ref(), &sight), (imager, &sky))?;
    Ok(facts)
}

fn describe(
    facts: &mut Facts,
    bench: &Bench,
    params: &RunParams,
    (imager, sky, sight): (&Imager, &Sky, &Sight),
    costs: &Costs,
) -> Result<()> {
    let camera = &bench.camera;
    let [fov_x, fov_y] = camera.fov_deg();
    facts.line(format_args!("bench \"{}\"", bench.name));
    facts.value("bench", bench.name.as_str());
    facts.value(
        "camera",
        json!({
            "name": camera.name,
            "width_px": camera.detector.width_px,
            "height_px": camera.detector.height_px,
            "fov_deg": [fov_x, fov_y],
            "arcsec_per_px": camera.ifov_arcsec(),
            "limiting_mag_g": drawn_mag(camera, params.camera.limiting_mag),
        }),
    );
    facts.named("camera").line(format_args!(
        "\"{}\": {} x {} px, {fov_x:.2} x {fov_y:.2} deg, {:.2} arcsec/px",
        camera.name,
        camera.detector.width_px,
        camera.detector.height_px,
        camera.ifov_arcsec()
    ));
    facts.fact("radiometry", radiometry_text(camera));
    let zero_point = camera.star_light().zero_point_e_per_s();
    let light =
        zero_point.map_or_else(|| "no zero point".into(), |e_per_s| format!("{e_per_s:.3e} e-/s at magnitude 0"));
    facts.fact("light", format_args!("{light}, {}", drawn_text(camera, params.camera.limiting_mag)));
    sight.write(facts, bench, params, sky);
    camera::write_cameras(facts, bench);
    bodies::write_observer(facts, params)?;
    camera::write_light(facts, &params.camera);
    write_stars(facts, params, sky);
    describe_frames(facts, bench, params, imager);
    facts.fact("costs", &costs.origin);
    facts.value("costs", costs.origin.as_str());
    describe_detector(facts, params, imager);
    Ok(())
}

/// Writes when frames are exposed and due, what draws them, and where they go.
fn describe_frames(facts: &mut Facts, bench: &Bench, params: &RunParams, imager: &Imager) {
    let exposed = &params.camera;
    let after_s = exposed.readout_s - params.ahead.s();
    let due = if params.ahead == Span::ZERO {
        format!("{after_s} s after it ends")
    } else if after_s >= -exposed.exposure_s {
        format!("{:.4} s after it begins", after_s + exposed.exposure_s)
    } else {
        format!("{:.4} s before it begins", -after_s - exposed.exposure_s)
    };
    facts.named("frames").line(format_args!(
        "{} at {} Hz, exposure {} s, due {due}, late ones {}",
        params.frames,
        bench.timing.frame_rate_hz,
        exposed.exposure_s,
        late_frames(params.deadline_policy)
    ));
    facts.value("frames", params.frames);
    facts.value("frame_rate_hz", bench.timing.frame_rate_hz);
    facts.value("exposure_s", exposed.exposure_s);
    facts.value("readout_s", exposed.readout_s);
    facts.value("heads", bench.head_count());
    facts.value("backend", imager.name());
    facts.value("adapter", imager.description());
    facts.fact("backend", format_args!("{} ({})", imager.name(), imager.description()));
    if let Some(note) = &imager.note {
        facts.more(note);
    }
    if !bench.extra_heads.is_empty() {
        let mountings: Vec<String> = bench.mountings().iter().map(|head| format!("{:.4?}", head.wxyz())).collect();
        facts.named("heads").line(format_args!(
            "{}, drawn in turn, sensor_from_body {}",
            mountings.len(),
            mountings.join(" ")
        ));
    }
    for (place, words) in described_lines(&bench.sinks) {
        facts.fact(place, words);
    }
    for (place, words) in tracker_outs::described_lines(&bench.tracker_outs) {
        facts.fact(place, words);
    }
    for (place, words) in tracker_ins::described_lines(&bench.tracker_ins) {
        facts.fact(place, words);
    }
}

/// Writes the time of the detector, and the budget of accuracy.
fn describe_detector(facts: &mut Facts, params: &RunParams, imager: &Imager) {
    let camera_params = &params.camera;
    let effects: Vec<String> =
        effect_costs(&camera_params.detector, &camera_params.patterns, camera_params.geometry.width_px())
            .map(|effect| format!("{} {:+.0} %", effect.name, 100.0 * effect.share))
            .collect();
    if !effects.is_empty() {
        let readout_ms = camera_params.predicted_readout_ms(&params.cost.unwrap_or(imager.cost));
        facts.fact("detector", format_args!("{readout_ms:.2} ms predicted, with {}", effects.join(", ")));
    }
    let AccuracyBudget { centroid_px, flux_rel, pixel_sigma, los_arcsec, .. } = params.budget;
    facts.named("budget").line(format_args!(
        "centroid {centroid_px} px, flux {flux_rel}, pixel {pixel_sigma} sigma, line of sight {los_arcsec} arcsec"
    ));
    facts.value(
        "budget",
        json!({
            "centroid_px": centroid_px, "flux_rel": flux_rel, "pixel_sigma": pixel_sigma, "los_arcsec": los_arcsec,
        }),
    );
}

/// Writes the memory that a run takes, on the real clock where its sinks have queues, and whether there is as much
/// here.
fn write_memory(facts: &mut Facts, bench: &Bench) {
    let memory = RunMemory::of(bench, &bench.sinks, RunForm { is_real: true, has_view: false });
    facts.fact("memory", memory.in_words());
    if let Err(error) = memory.check() {
        facts.warning(error);
    }
}

/// Returns the stars that layers have, and whether bright ones are missing.
fn write_stars(facts: &mut Facts, params: &RunParams, sky: &Sky) {
    let Sky { layers, most_stars } = sky;
    let [from, faintest] = layers.magnitudes();
    if !layers.is_in_memory() {
        let stars: u64 = layers.layers().map(StarIndex::stars).sum();
        facts.named("stars").line(format_args!(
            "{stars} in {} layers to G = {faintest}, at most {most_stars} of them in memory ({} MiB)",
            layers.layers().len(),
            params.star_memory_mb
        ));
        if from > f32::NEG_INFINITY {
            facts
                .warning(format_args!("stars brighter than G = {from} are missing from the frames: no layer has them"));
        }
    }
}

fn write_defaults(facts: &mut Facts, bench: &Bench) {
    facts.value("defaults", json!([]));
    for (what, list) in [("bench", &bench.defaulted), ("camera", &bench.camera.defaulted)] {
        for default in list {
            facts.fact("default", format_args!("{what}: {} = {}", default.key, default.value));
            facts.element("defaults", json!({ "file": what, "key": default.key, "value": default.value }));
        }
    }
}

/// Plans of the first, a middle and the last frame, from the simulated flight computer's own truth.
fn plans(
    facts: &mut Facts,
    bench: &Bench,
    computer: FlightComputer,
    (params, limits, sight): (&RunParams, Option<&DisplayLimits>, &Sight),
    (imager, sky): (&Imager, &Sky),
) -> Result<()> {
    let planned = Planned::new(bench, params, imager);
    plans::write_sampling(facts, params);
    plans::write_degradations(facts, &planned);
    facts.value("plans", json!([]));
    let mut frames = FramePlans::new(computer, params, sky);
    let last = params.frames.saturating_sub(1);
    let mut numbers = vec![0, last / 2, last];
    numbers.dedup();
    for number in numbers {
        if !frames.has_attitude(number) {
            facts.line(format_args!("frame {number} has no attitude: nothing is planned for it"));
            continue;
        }
        let mut planner = frames.planner(planned.cost, planned.limit_ms);
        if imager.is_exact() {
            planner = planner.exact();
        }
        let plan = frames.plan(number, &mut planner)?;
        plans::write_plan(facts, number, plan, &planned);
        sight.write_frame(facts, number, plan);
        camera::write_frame_light(facts, &frames.scene.light, &params.camera, plan)?;
        if let Some(bodies) = &frames.scene.bodies {
            bodies::write_frame_bodies(facts, bodies, &params.camera, plan)?;
        }
        if let Some(limits) = limits {
            display::write_frame_stars(facts, limits, plan);
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
        Ok(super::report(bench, &Plant::FlightComputer, only_built_in)?.text())
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
            let facts = checked(&scenario, true).unwrap();
            (facts.text(), facts.verdict(&name(&scenario)))
        };
        let (text, verdict) = of("scenarios/three_heads.toml");
        assert_eq!(verdict, "scenario \"three heads\" is sound\n");
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
        let error = format!("{:#}", checked(&scenario, true).unwrap_err());
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
            let mut facts = Facts::indented();
            write_memory(&mut facts, bench);
            facts.text()
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
