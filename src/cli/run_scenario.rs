//! `starloop run SCENARIO`: the closed loop, on the virtual clock or on the bench's.

use crate::cli::calibrate::costs_here;
use crate::cli::run::{ClockKind, RunArgs, prepared_hygiene, stamp};
use crate::cli::run_end::say_losses;
use crate::cli::run_heads::directory_of_head;
use crate::cli::scenario_plot::TelemetryPlot;
use crate::cli::scenario_report::{ScenarioReport, table};
use crate::cli::{EXIT_DONE, EXIT_FAILED, EXIT_LOST, EXIT_NOT_MET, signals};
use anyhow::{Context, Result, bail};
use base::clock::{Clock, Monotonic, Stopwatch, Virtual};
use base::time::{Span, Tai};
use base::units::ARCSEC;
use config::{Scenario, StartTime};
use core::sync::atomic::{AtomicBool, Ordering};
use frames::sink::{NullSink, SentFrame, Sink, replace_own_file};
use run::runtime::real_time::STARS_AT_FIRST;
use run::runtime::{RunParams, RunRecord};
use run::wiring::assessment::mode_name;
use run::wiring::bench_parts;
use run::wiring::camera_parts::camera_params;
use run::wiring::closed_loop::ClosedLoop;
use run::wiring::control::{ControlAddress, ControlListener, ControlSession, SessionEnd, Stage};
use run::wiring::display_parts::calibrated_display;
use run::wiring::loop_outcome::LoopView;
use run::wiring::memory::{RunForm, RunMemory};
use run::wiring::real_loop::{RealSetting, run_real};
use run::wiring::sinks::{SinkSetting, make_sinks, run_directory};
use scene::camera::CameraParams;
use std::io::{BufWriter, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use testbed::vehicle::TelemetryRow;

/// Runs a scenario; the exit status.
///
/// # Errors
/// With what could not be done.
pub fn run(scenario: &Scenario, arguments: &RunArgs, stop: &Arc<AtomicBool>) -> Result<u8> {
    // An address that cannot be had is told before anything is made.
    let listener = arguments.control.map(listen).transpose()?;
    check_memory(scenario, arguments)?;
    let directory = directory(scenario, arguments)?;
    let mut wall = Stopwatch::start();
    let camera = camera_params(&scenario.bench.camera)?;
    let frame = prototype(&camera);
    let mut failed = None;
    let clock = ClosedLoop::clock_of(scenario)?;
    let shared: Arc<dyn Clock> = Arc::<Virtual>::clone(&clock);
    let mut going = ClosedLoop::on_clock(scenario, clock, |head| {
        sink(scenario, arguments, directory.as_deref(), head, (&frame, &camera, &shared)).unwrap_or_else(|error| {
            failed = Some(error);
            Box::new(NullSink::new())
        })
    })?;
    if let Some(error) = failed {
        return Err(error);
    }
    let telemetry = directory.as_deref().map(|directory| telemetry_file(directory, going.zero())).transpose()?;
    let telemetry = telemetry.map(|(file, on_row)| {
        going.on_row(on_row);
        file
    });
    let say = !arguments.quiet;
    announce(scenario, say, "simulated");
    let (client, ended) = match listener {
        Some(listener) => serve(listener, scenario, (&mut going, directory.as_deref()), stop),
        None => (None, run_through(&mut going, say, stop)),
    };
    let wall_s = wall.lap().s();
    ended.with_context(|| format!("seed {} repeats it", scenario.bench.seed))?;
    if let Some(written) = telemetry {
        written.finish(&title(scenario))?;
    }
    let now_s = (going.now() - going.zero()).s();
    let outcome = going.finish()?;
    let refusals = client.as_ref().map(|(session, _)| session.refusals());
    let report = ScenarioReport::of(scenario, &outcome.view(), wall_s).with_sinks(&outcome.sink_lines);
    let mut report = report.with_control(refusals);
    let status = tell(&mut report, arguments, directory.as_deref(), stop)?;
    if stop.load(Ordering::SeqCst) {
        return Ok(status);
    }
    match client {
        Some((session, SessionEnd::Finish(id))) => session.close(id, serde_json::to_value(&report)?, status),
        Some((_, SessionEnd::Gone)) => {
            eprintln!("starloop: the control client went away at {now_s} s; what was finished by then is written");
            return Ok(EXIT_FAILED);
        }
        Some((_, SessionEnd::Interrupted)) | None => {}
    }
    Ok(status)
}

/// Runs a scenario on the real clock; the exit status.
///
/// # Errors
/// With what could not be done.
pub fn run_on_real_clock(scenario: &Scenario, arguments: &RunArgs, stop: &Arc<AtomicBool>) -> Result<u8> {
    let say = !arguments.quiet;
    check_memory(scenario, arguments)?;
    let hygiene = prepared_hygiene(&scenario.bench, say);
    let directory = directory(scenario, arguments)?;
    announce(scenario, say, "real");
    let StartTime::At(start) = scenario.bench.timing.start else {
        bail!("a scenario needs a start_utc: \"now\" does not repeat");
    };
    let params = bench_parts::run_params(&scenario.bench, start)?;
    let clock = Arc::new(Monotonic::start_at(start));
    let shared: Arc<dyn Clock> = Arc::<Monotonic>::clone(&clock);
    let frame = (&prototype(&params.camera), &params.camera, &shared);
    let of_head = |head| sink(scenario, arguments, directory.as_deref(), head, frame);
    let sinks = (0..scenario.heads.len()).map(of_head).collect::<Result<Vec<_>>>()?;
    let measured = costs_here(&bench_parts::imager(&params)?, arguments.built_in_costs).measured;
    let telemetry =
        directory.as_deref().map(|directory| telemetry_file(directory, params.first_exposure)).transpose()?;
    let nobody: RowSink = Box::new(|_| {});
    let (written, on_row) = telemetry.map_or((None, nobody), |(file, on_row)| (Some(file), on_row));
    let ring_frames = usize::try_from(scenario.bench.budget.ring_frames)?;
    let setting = RealSetting { clock: &clock, stop, hygiene: Some(&hygiene), ring_frames };
    let mut progress = Progress::new(say && std::io::stderr().is_terminal(), params.first_exposure);
    let mut wall = Stopwatch::start();
    let change = |params: &mut RunParams| bench_parts::take_real_clock(params, &scenario.bench, measured);
    let mut show = |frame: &SentFrame, record: &RunRecord| progress.show(frame, record);
    let outcome = run_real(scenario, sinks, &setting, change, on_row, &mut show)?;
    progress.finish();
    if let Some(written) = written {
        written.finish(&title(scenario))?;
    }
    let mut report = ScenarioReport::of(scenario, &outcome.view(), wall.lap().s()).with_sinks(&outcome.sink_lines);
    tell(&mut report, arguments, directory.as_deref(), stop)
}

/// Refuses a scenario whose memory is not there, before any of it is taken.
fn check_memory(scenario: &Scenario, arguments: &RunArgs) -> Result<()> {
    let (bench, heads) = (&scenario.bench, scenario.heads.len());
    let form = RunForm { is_real: arguments.clock == ClockKind::Real, has_view: false };
    Ok(RunMemory::of_heads(bench, heads, &arguments.sinks(bench), form).check()?)
}

fn announce(scenario: &Scenario, say: bool, kind: &str) {
    if say {
        let seconds = scenario.bench.timing.duration_s;
        eprintln!("scenario \"{}\": {seconds} s of {kind} time, seed {}", scenario.name, scenario.bench.seed);
    }
}

/// Writes and prints the report; the exit status.
fn tell(report: &mut ScenarioReport, arguments: &RunArgs, directory: Option<&Path>, stop: &AtomicBool) -> Result<u8> {
    if let Some(directory) = directory {
        let json = serde_json::to_string_pretty(&report)?;
        let path = directory.join("scenario.json");
        if let Err(error) = replace_own_file(&path, |out| out.write_all(json.as_bytes())) {
            report.losses.note_file("scenario.json", error);
        }
    }
    if arguments.json {
        println!("{}", serde_json::to_string(&report)?);
    } else if !arguments.quiet {
        print!("{}", table(report));
    }
    let was_lost = say_losses(&report.losses);
    let was_interrupted = stop.load(Ordering::SeqCst);
    if !report.passed && !was_interrupted {
        eprintln!("starloop: scenario \"{}\" did not hold; seed {} repeats it", report.scenario, report.seed);
    }
    Ok(match (was_lost, was_interrupted, report.passed) {
        (true, _, _) => EXIT_LOST,
        (false, true, _) => signals::exit_status(),
        (false, false, false) => EXIT_NOT_MET,
        (false, false, true) => EXIT_DONE,
    })
}

/// From the first frame to the last.
fn run_through(going: &mut ClosedLoop, say: bool, stop: &AtomicBool) -> Result<()> {
    let mut progress = Progress::new(say && std::io::stderr().is_terminal(), going.zero());
    let ended = going.run_to_end(&mut |_, frame, record| {
        progress.show(frame, record);
        !stop.load(Ordering::Relaxed)
    });
    progress.finish();
    Ok(ended?)
}

/// Prints where and with which token, also when quiet: a port that the system chose is known nowhere else.
fn listen(address: ControlAddress) -> Result<ControlListener> {
    let listener = ControlListener::bind(address)?;
    eprintln!("{}", listener.announcement());
    Ok(listener)
}

/// In steps, as a client asks; the client with what ended its session, when one came.
fn serve(
    listener: ControlListener,
    scenario: &Scenario,
    (going, output): (&mut ClosedLoop, Option<&Path>),
    stop: &AtomicBool,
) -> (Option<(ControlSession, SessionEnd)>, Result<()>) {
    let Some(mut session) = listener.accept(scenario, output, stop) else { return (None, Ok(())) };
    let refusals = session.refusals().clone();
    let (mut watch, mut wall_s) = (Stopwatch::start(), 0.0);
    let mut report = |view: &LoopView<'_>| {
        wall_s += watch.lap().s();
        let report = ScenarioReport::of(scenario, view, wall_s).with_control(Some(&refusals));
        serde_json::to_value(report).unwrap_or_default()
    };
    match session.serve(&mut Stage { scenario, going, report: &mut report, stop }) {
        Ok(end) => (Some((session, end)), Ok(())),
        Err(error) => (None, Err(error.into())),
    }
}

/// Where files go: only when the command line or the bench wants any.
fn directory(scenario: &Scenario, arguments: &RunArgs) -> Result<Option<PathBuf>> {
    let sinks = arguments.sinks(&scenario.bench);
    let directory = match (&arguments.out, run_directory(&sinks, None, "")) {
        (Some(out), _) => out.clone(),
        (None, Some(_)) => {
            let now = Monotonic::start();
            PathBuf::from("out").join(&scenario.name).join(stamp(now.now()))
        }
        (None, None) => return Ok(None),
    };
    std::fs::create_dir_all(&directory).with_context(|| format!("cannot make {}", directory.display()))?;
    Ok(Some(directory))
}

/// What takes the frames of one head.
fn sink(
    scenario: &Scenario,
    arguments: &RunArgs,
    directory: Option<&Path>,
    head: usize,
    (prototype, camera, clock): (&SentFrame, &CameraParams, &Arc<dyn Clock>),
) -> Result<Box<dyn Sink>> {
    if calibrated_display(&scenario.bench).is_some() {
        bail!(
            "got a scenario on a bench that is drawn for a display; wanted a bench: a tracker in front of it flies it"
        );
    }
    let head = (scenario.heads.len() > 1).then_some(head);
    let directory = directory.map(|run| directory_of_head(run, head));
    let is_real = arguments.clock == ClockKind::Real;
    let frame_period = Span::from_s(1.0 / scenario.bench.timing.frame_rate_hz);
    let directory = directory.as_deref();
    let calibration = None;
    let setting = SinkSetting { directory, prototype, head, is_real, camera, frame_period, clock, calibration };
    let made = make_sinks(&arguments.sinks(&scenario.bench), &setting);
    made.with_context(|| head.map_or_else(|| "the sinks".into(), |head| format!("head {head}")))
}

/// A frame of the scenario's camera, empty.
fn prototype(camera: &CameraParams) -> SentFrame {
    let [width, height] = camera.output().size_px;
    SentFrame::with_capacity(width, height, STARS_AT_FIRST, camera.name.clone())
}

fn title(scenario: &Scenario) -> String {
    format!("{}: seed {}", scenario.name, scenario.bench.seed)
}

/// The telemetry file while it is written.
struct TelemetryFile {
    rows: Arc<Mutex<Rows>>,
    path: PathBuf,
}

/// Where rows go, and the first error of one.
struct Rows {
    out: csv::Writer<Box<dyn Write + Send>>,
    failure: Option<csv::Error>,
    plot: TelemetryPlot,
}

impl TelemetryFile {
    /// Writes what is still buffered, and the picture beside it.
    fn finish(self, title: &str) -> Result<()> {
        let mut rows = self.rows.lock().unwrap_or_else(PoisonError::into_inner);
        let written = rows.failure.take().map_or(Ok(()), Err);
        let written = written.and_then(|()| rows.out.flush().map_err(csv::Error::from));
        written.with_context(|| format!("cannot write {}", self.path.display()))?;
        let svg = rows.plot.svg(title);
        replace_own_file(&self.path.with_extension("svg"), |out| out.write_all(svg.as_bytes()))?;
        Ok(())
    }
}

/// Takes rows of telemetry.
type RowSink = Box<dyn FnMut(&TelemetryRow) + Send>;

fn telemetry_file(directory: &Path, zero: Tai) -> Result<(TelemetryFile, RowSink)> {
    let path = directory.join("telemetry.csv");
    let file = std::fs::File::create_new(&path).with_context(|| format!("cannot make {}", path.display()))?;
    telemetry_into(Box::new(BufWriter::new(file)), path, zero)
}

fn telemetry_into(out: Box<dyn Write + Send>, path: PathBuf, zero: Tai) -> Result<(TelemetryFile, RowSink)> {
    let mut out = csv::Writer::from_writer(out);
    out.write_record(COLUMNS)?;
    let rows = Arc::new(Mutex::new(Rows { out, failure: None, plot: TelemetryPlot::new(zero) }));
    let shared = Arc::clone(&rows);
    let on_row = move |row: &TelemetryRow| {
        let mut rows = shared.lock().unwrap_or_else(PoisonError::into_inner);
        rows.plot.take(row);
        if let Err(error) = rows.out.write_record(cells(row, zero)) {
            rows.failure.get_or_insert(error);
        }
    };
    Ok((TelemetryFile { rows, path }, Box::new(on_row)))
}

/// Columns of `telemetry.csv`; angles are rotation vectors in body axes.
const COLUMNS: [&str; 26] = [
    "t_s",
    "mode",
    "pointing_x_arcsec",
    "pointing_y_arcsec",
    "pointing_z_arcsec",
    "knowledge_x_arcsec",
    "knowledge_y_arcsec",
    "knowledge_z_arcsec",
    "sigma_arcsec",
    "rate_x_arcsec_s",
    "rate_y_arcsec_s",
    "rate_z_arcsec_s",
    "bias_error_x_arcsec_s",
    "bias_error_y_arcsec_s",
    "bias_error_z_arcsec_s",
    "torque_x_n_m",
    "torque_y_n_m",
    "torque_z_n_m",
    "vibration_arcsec",
    "wheel_speed_rad_s",
    "wheel_momentum_n_m_s",
    "heads_solved",
    "no_solution",
    "stars",
    "sun_angle_deg",
    "utc",
];

fn cells(row: &TelemetryRow, zero: Tai) -> Vec<String> {
    let mut cells = vec![format!("{:.3}", (row.at - zero).s()), mode_name(row.mode).to_owned()];
    let arcsec = |v: glam::DVec3| v.to_array().map(|x| format!("{:.6}", x / ARCSEC));
    cells.extend(arcsec(row.pointing_error_rad));
    cells.extend(row.knowledge_error_rad.map_or([const { String::new() }; 3], arcsec));
    cells.push(format!("{:.6}", row.sigma_rad / ARCSEC));
    cells.extend(arcsec(row.rate_rad_s));
    cells.extend(arcsec(row.bias_error_rad_s));
    cells.extend(row.torque_n_m.to_array().map(|x| format!("{x:.9}")));
    cells.push(format!("{:.6}", row.vibration_rad / ARCSEC));
    cells.push(format!("{:.6}", row.wheel_speed_rad_s));
    cells.push(format!("{:.9}", row.wheel_momentum_n_m_s));
    cells.push(row.heads_solved.to_string());
    cells.push(row.no_solution.map_or_else(String::new, |reason| format!("{reason:?}")));
    cells.push(row.stars.to_string());
    cells.push(row.sun_angle_rad.map_or_else(String::new, |angle| format!("{:.6}", angle.to_degrees())));
    cells.push(row.at.to_rfc3339());
    cells
}

/// One line that is drawn over.
struct Progress {
    is_on: bool,
    zero: Tai,
    watch: Stopwatch,
    since_drawn_s: f64,
    wall_s: f64,
    drawn: bool,
}

impl Progress {
    fn new(is_on: bool, zero: Tai) -> Self {
        Self { is_on, zero, watch: Stopwatch::start(), since_drawn_s: 0.0, wall_s: 0.0, drawn: false }
    }

    fn show(&mut self, frame: &SentFrame, record: &RunRecord) {
        const REDRAW_S: f64 = 0.2;
        if !self.is_on {
            return;
        }
        let lap_s = self.watch.lap().s();
        (self.since_drawn_s, self.wall_s) = (self.since_drawn_s + lap_s, self.wall_s + lap_s);
        if self.since_drawn_s < REDRAW_S {
            return;
        }
        (self.since_drawn_s, self.drawn) = (0.0, true);
        let t_s = (frame.meta.mid_exposure - self.zero).s();
        let [ra, dec, roll] = [frame.meta.ra_deg, frame.meta.dec_deg, frame.meta.roll_deg];
        let text = format!(
            "{t_s:9.1} s ({:5.1} times real time)  frame {}  RA {ra:8.4} Dec {dec:+8.4} roll {roll:+9.4}",
            t_s / self.wall_s.max(1e-3),
            record.frames.delivered,
        );
        eprint!("\r{text:<110}");
    }

    fn finish(&self) {
        if self.drawn {
            eprintln!();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disk with no room left.
    struct Full;

    impl Write for Full {
        fn write(&mut self, _: &[u8]) -> std::io::Result<usize> {
            Err(std::io::ErrorKind::StorageFull.into())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn telemetry_that_only_the_last_flush_writes_is_written_or_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("telemetry.csv");
        let into = |out: Box<dyn Write + Send>| telemetry_into(out, path.clone(), Tai::from_ns(0)).unwrap();
        let (file, _on_row) = into(Box::new(Full));
        let error = format!("{:#}", file.finish("a flight").unwrap_err());
        assert!(error.contains(&format!("cannot write {}", path.display())), "{error}");
        let (file, _on_row) = into(Box::new(std::io::sink()));
        file.finish("a flight").unwrap();
        assert!(folder.path().join("telemetry.svg").exists(), "and the picture");
    }
}
