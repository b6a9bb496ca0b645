//! `starloop run`: a bench from its first frame to its summary.

use crate::cli::budget::budget_report;
use crate::cli::budget_files;
use crate::cli::bus::{announce_gateways, gateway_rows};
use crate::cli::monitor::Monitor;
use crate::cli::run_end::Finished;
use crate::cli::run_heads::{BenchHead, Sinks, bench_heads, sinks};
use crate::cli::run_input::{bench, document, scenario};
use crate::cli::wcs_warning::warn_of_wcs;
use crate::cli::{live_view, run_scenario, signals};
use anyhow::{Context, Result, bail};
use base::clock::{Clock, Monotonic, Stopwatch, Virtual};
use base::time::Tai;
use clap::{Args, ValueEnum};
use config::{self, Bench, Scenario, StartTime};
use core::sync::atomic::{AtomicBool, Ordering};
use crossbeam_channel::Sender;
use frames::report::{GatewayRow, HygieneLine, Progress};
use frames::sink::{SentFrame, Sink};
use link::capture::CaptureFormat;
use link::gateway::{Gateways, TcpAddress};
use link::{Link, Port};
use outputs::live::Numbers;
use run::runtime::hygiene::Role;
use run::runtime::real_time::Sources;
use run::runtime::{FrameEngine, Hygiene, HygieneParams, RunError, RunOutcome, RunRecord, real_time, virtual_time};
use run::wiring::bench_parts;
use run::wiring::control::ControlAddress;
use run::wiring::display_parts::{calibrated_display, hold_cards};
use run::wiring::memory::{RunForm, RunMemory};
use run::wiring::ports::{Ports, needs_real_clock, open_ports};
use run::wiring::replay::{Recording, SessionParams};
use std::path::PathBuf;
use std::sync::Arc;
use testbed::flight_computer::{FlightComputer, FlightError, run_until};

/// Command line of `run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// Bench or scenario file (TOML); without one: the built-in loopback bench
    pub(super) bench: Option<PathBuf>,
    /// Which clock: `real` is the bench, `virtual` runs as fast as the machine allows and repeats bit for bit
    #[arg(long, value_enum, default_value_t = ClockKind::Real)]
    pub(super) clock: ClockKind,
    /// Run for this many seconds instead of the bench's duration
    #[arg(long, value_name = "S")]
    pub(super) duration: Option<f64>,
    /// Draw with this backend instead of the bench's
    #[arg(long, value_enum)]
    pub(super) backend: Option<BackendName>,
    /// Seed of the run instead of the bench's: the sensor's patterns, and all that has no seed of its own
    #[arg(long)]
    pub(super) seed: Option<u64>,
    /// Seed of the exposures' noise instead of the bench's (default: that of the run)
    #[arg(long)]
    pub(super) noise_seed: Option<u64>,
    /// Where frames go instead of the bench's sinks
    #[arg(long, value_enum)]
    pub(super) sink: Option<SinkKind>,
    /// Directory to record into (one without a recording); without it a directory named by the time of the run
    #[arg(long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
    /// Predict with the built-in costs, whatever `starloop calibrate` has measured (real clock)
    #[arg(long)]
    pub(super) built_in_costs: bool,
    /// Write budget.json, frames_timing.csv, junit.xml and worst.svg into this directory (a bench on the real clock)
    #[arg(long, value_name = "DIR")]
    pub(super) report: Option<PathBuf>,
    /// Add the random faults of a campaign's episode with this seed to a scenario
    #[arg(long)]
    pub(super) random_faults: bool,
    /// Print a scenario's report as one line of JSON instead of a table
    #[arg(long)]
    pub(super) json: bool,
    /// Change a value of the file before it is checked, such as control.delay_ms=300, or of a file that it names, such as
    /// bench.timing.frame_rate_hz=5; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(super) settings: Vec<String>,
    /// Let a program outside advance the clock of a scenario: JSON lines over TCP; loopback only, port 0 takes a free one.
    /// Prints a token that the program must send first
    #[arg(long, value_name = "ADDRESS")]
    pub(super) control: Option<ControlAddress>,
    /// Capture the bus and what each frame was drawn from into this directory, for `starloop replay` (a bench)
    #[arg(long, value_name = "DIR")]
    pub(super) capture: Option<PathBuf>,
    /// Form of the captured packets: pcapng holds CAN and serial, candump is text and holds CAN only
    #[arg(long, value_enum, default_value_t = CaptureFormatName::Pcapng)]
    pub(super) capture_format: CaptureFormatName,
    /// Serve a page with the newest frame and the run's numbers, and /metrics for Prometheus: a port on loopback, or
    /// ADDRESS:PORT; port 0 takes a free one (a bench)
    #[arg(long, value_name = "ADDRESS")]
    pub(super) monitor: Option<TcpAddress>,
    /// Name of this machine under which browsers and Prometheus ask for --monitor, such as lab-pc; addresses and localhost
    /// need none; may be repeated
    #[arg(long = "monitor-name", value_name = "NAME", requires = "monitor")]
    pub(super) monitor_names: Vec<String>,
    /// Print nothing but errors
    #[arg(long)]
    pub(super) quiet: bool,
}

impl RunArgs {
    /// The sinks of the run: the bench's, or the one that the command line names in their place.
    pub(super) fn sinks(&self, bench: &Bench) -> Vec<config::SinkSettings> {
        let is_recorder = |settings: &&config::SinkSettings| matches!(settings.sink, config::Sink::Recorder { .. });
        match self.sink {
            None => bench.sinks.clone(),
            Some(SinkKind::Null) => vec![config::SinkSettings { sink: config::Sink::Null, queue_frames: 1 }],
            Some(SinkKind::Recorder) => vec![bench.sinks.iter().find(is_recorder).cloned().unwrap_or_else(|| {
                let directory = Some(format!("out/{}", bench.name).into());
                let sink = config::Sink::Recorder { directory, fits: true, ser: false, png_every: 10 };
                config::SinkSettings { sink, queue_frames: 8 }
            })],
        }
    }
}

/// A clock, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum ClockKind {
    /// Wall time.
    Real,
    /// Simulated time.
    Virtual,
}

/// A form of captured packets, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum CaptureFormatName {
    /// Packets for Wireshark and tshark, exact to the bit
    Pcapng,
    /// Text for can-utils and python-can
    Candump,
}

/// A backend, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BackendName {
    /// A hardware GPU when there is one, else the CPU
    Auto,
    /// The GPU (software Vulkan counts), or an error
    Gpu,
    /// All CPU cores
    Cpu,
    /// f64, slow, the truth
    Reference,
}

/// A sink, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum SinkKind {
    /// FITS, truth tables and PNG files
    Recorder,
    /// Nothing is kept: timing only
    Null,
}

impl BackendName {
    /// The config's word for it.
    #[must_use]
    pub fn configured(self) -> config::Backend {
        match self {
            Self::Auto => config::Backend::Auto,
            Self::Gpu => config::Backend::Gpu,
            Self::Cpu => config::Backend::Cpu,
            Self::Reference => config::Backend::Reference,
        }
    }
}

/// Runs the command; the exit status.
///
/// # Errors
/// With what could not be done, and why.
pub fn run(arguments: &RunArgs) -> Result<u8> {
    if arguments.report.is_some() && arguments.clock == ClockKind::Virtual {
        bail!("--report: got the virtual clock, on which nothing takes time; wanted --clock real");
    }
    if let Some(scenario) = scenario(arguments)? {
        if arguments.capture.is_some() {
            bail!("--capture: got a scenario; wanted a bench, such as the one it names");
        }
        if arguments.monitor.is_some() {
            bail!("--monitor: got a scenario; wanted a bench, such as the one it names");
        }
        return run_as_scenario(&scenario, arguments);
    }
    if arguments.control.is_some() {
        bail!("--control steps a scenario, and this is a bench: name a scenario file and add --clock virtual");
    }
    if arguments.json {
        bail!("--json: got a bench; wanted a scenario file: the results of a bench are in summary.json in --out DIR");
    }
    if arguments.random_faults {
        bail!("--random-faults: got a bench; wanted a scenario file: nothing flies in a bench that faults could upset");
    }
    let mut finished = perform(arguments)?;
    finished.write_summary(arguments)?;
    if let Some(directory) = &arguments.report {
        let report = budget_report(&finished, 0)?;
        budget_files::write(directory, &report, &finished.outcome.record.ring)?;
    }
    // Last: output that cannot be written ends the program.
    finished.print_table(arguments);
    finished.status()
}

fn run_as_scenario(scenario: &Scenario, arguments: &RunArgs) -> Result<u8> {
    if arguments.clock == ClockKind::Real && arguments.control.is_some() {
        bail!("--control: got the real clock, which nobody can hold; wanted --clock virtual");
    }
    if arguments.report.is_some() {
        bail!(
            "--report: got a scenario; wanted a bench, such as the one it names: --out DIR keeps a scenario's report"
        );
    }
    if scenario.events_left_out > 0 {
        let all = scenario.events_left_out + scenario.events.len();
        eprintln!("starloop: {} of {all} events come after the end of this run: left out", scenario.events_left_out);
    }
    let stop = signals::stop();
    match arguments.clock {
        ClockKind::Real => run_scenario::run_on_real_clock(scenario, arguments, &stop),
        ClockKind::Virtual => run_scenario::run(scenario, arguments, &stop),
    }
}

/// Runs a bench from its first frame to its last.
///
/// # Errors
/// When the run could not begin.
pub(super) fn perform(arguments: &RunArgs) -> Result<Finished> {
    // First: from here on a signal ends the run in order, however much of it is made.
    let stop = signals::stop();
    let bench = bench(arguments)?;
    let form = RunForm { is_real: arguments.clock == ClockKind::Real, has_view: arguments.monitor.is_some() };
    RunMemory::of(&bench, &arguments.sinks(&bench), form).check()?;
    let start = match bench.timing.start {
        StartTime::At(at) => at,
        StartTime::Now => Monotonic::start().now(),
    };
    // First: whoever draws first starts the drawing threads.
    let hygiene = (arguments.clock == ClockKind::Real).then(|| prepared_hygiene(&bench, !arguments.quiet));
    if arguments.capture.is_some() && calibrated_display(&bench).is_some() {
        bail!("--capture: got a bench that is drawn for a display; wanted one with another sink first");
    }
    if arguments.capture.is_some() && !bench.extra_heads.is_empty() {
        bail!("--capture: got a bench with [[extra_head]]; wanted one head: a replay draws its frames");
    }
    let cards = hold_cards(&arguments.sinks(&bench));
    let mut heads = bench_heads(arguments, &bench, start)?;
    drop(cards);
    let clock = RunClock::new(arguments.clock, start);
    let Sinks { of_heads: mut sinks, directory } = sinks(arguments, &bench, &heads, &clock.shared())?;
    let engine = &mut heads.first_mut().context("a bench without a head")?.engine;
    let mut sink = sinks.remove(0);
    let recording = recording(arguments, &bench, start, engine)?;
    if let Some(recording) = &recording {
        sink = recording.tap_frames(engine, sink)?;
    }
    let say = !arguments.quiet;
    if say {
        announce(&bench, engine);
    }
    let mut view = None;
    let mut numbers = None;
    if let Some(address) = arguments.monitor {
        let (both, started, told) =
            live_view::beside(sink, (address.socket(), &arguments.monitor_names), &bench.name, engine)?;
        (sink, view, numbers) = (both, Some(started), Some(told));
    }
    sinks.insert(0, sink);
    let mut wall = Stopwatch::start();
    let monitor = Monitor::start(say)?;
    let setup = Setup {
        bench: &bench,
        start,
        stop: &stop,
        updates: &monitor.updates,
        numbers,
        frames: heads.iter().map(|head| u64::from(head.engine.params().frames)).sum(),
        hygiene: hygiene.as_ref(),
        recording: recording.as_ref(),
    };
    let (mut outcome, gateways) = match &clock {
        RunClock::Real(clock) => setup.real(clock, &mut heads, sinks)?,
        RunClock::Virtual(clock) => (setup.simulated(clock, &mut heads, sinks)?, Vec::new()),
    };
    // After a failure they stay away: a run that broke down must not look like one that is over.
    if let (Some(numbers), None) = (&setup.numbers, &outcome.error) {
        numbers.tell_last(&outcome.record.numbers(Some(setup.frames)));
    }
    let missing = recording.map(|recording| missing_in_capture(recording, &outcome)).unwrap_or_default();
    let wall_s = wall.lap().s();
    let was_interrupted = stop.load(Ordering::SeqCst);
    let ended = clock.shared().now();
    if view.is_some_and(|view| !view.finish()) {
        outcome.note_lost_thread("live view", ended);
    }
    if !monitor.finish() {
        outcome.note_lost_thread("monitor", ended);
    }
    let mut losses = outcome.losses();
    missing.iter().for_each(|what| losses.note_capture(what));
    let hygiene = hygiene.map(|hygiene| hygiene.lines()).unwrap_or_default();
    Ok(Finished { bench, start, heads, outcome, gateways, losses, hygiene, wall_s, was_interrupted, directory })
}

/// Ends a capture; returns what it lacks, a sentence each.
fn missing_in_capture(recording: Recording, outcome: &RunOutcome) -> Vec<String> {
    let lost = outcome.ports.iter().map(|port| port.queue_overflows).sum();
    match recording.finish(lost) {
        Ok(session) => session.doubts(),
        Err(error) => vec![error.to_string()],
    }
}

/// What the bench asks of the system, with what cannot be had told at once.
pub(super) fn prepared_hygiene(bench: &Bench, say: bool) -> Arc<Hygiene> {
    let config::Budget { realtime, priority, affinity, .. } = bench.budget.clone();
    let tell: fn(&HygieneLine) = |line| {
        if !line.got {
            eprintln!("starloop: not had: {}: {}", line.what, line.detail);
        }
    };
    let hygiene = Hygiene::new(HygieneParams { realtime, priority, affinity });
    let hygiene = Arc::new(if say { hygiene.announcing(tell) } else { hygiene });
    hygiene.prepare();
    hygiene
}

/// The capture that is asked for.
fn recording(arguments: &RunArgs, bench: &Bench, start: Tai, engine: &FrameEngine) -> Result<Option<Recording>> {
    let Some(directory) = &arguments.capture else { return Ok(None) };
    let format = match arguments.capture_format {
        CaptureFormatName::Pcapng => CaptureFormat::Pcapng,
        CaptureFormatName::Candump => CaptureFormat::Candump,
    };
    if format == CaptureFormat::Candump && bench.link.wire == config::Wire::Serial {
        bail!("--capture-format candump: got a serial bench; wanted pcapng: a candump log holds CAN only");
    }
    if !bench.extra_links.is_empty() || bench.link.pps.is_some() {
        bail!("--capture: got a bench with [[extra_link]] or pps; wanted one link without pulses: one bus is captured");
    }
    let params = SessionParams {
        document: &document(arguments)?,
        settings: &arguments.settings,
        bench,
        start,
        is_real: arguments.clock == ClockKind::Real,
        backend: engine.imager().name(),
        adapter: engine.imager().description(),
        cost: engine.params().cost,
    };
    Ok(Some(Recording::start(directory, format, &params).context("--capture")?))
}

/// `20261120T123456.789Z`: a directory name that sorts by time.
pub(super) fn stamp(at: Tai) -> String {
    let text = at.to_rfc3339();
    let seconds = text.split('.').next().unwrap_or_default();
    let milliseconds = text.split('.').nth(1).and_then(|fraction| fraction.get(..3)).unwrap_or("000");
    format!("{}.{milliseconds}Z", seconds.replace(['-', ':'], ""))
}

fn announce(bench: &Bench, engine: &FrameEngine) {
    if let Some(note) = engine.imager().note() {
        eprintln!("{note}");
    }
    engine.wcs_error_px().into_iter().for_each(warn_of_wcs);
    eprintln!(
        "bench \"{}\": {} frames at {} Hz, camera \"{}\"{}, {} backend ({})",
        bench.name,
        engine.params().frames,
        bench.timing.frame_rate_hz,
        engine.params().camera.name,
        if bench.defaulted.iter().any(|value| value.key == "camera") {
            " (built in: the bench names none)"
        } else {
            ""
        },
        engine.imager().name(),
        engine.imager().description(),
    );
}

/// The clock of a run, which its sinks read too.
enum RunClock {
    Real(Arc<Monotonic>),
    Virtual(Arc<Virtual>),
}

impl RunClock {
    fn new(kind: ClockKind, start: Tai) -> Self {
        match kind {
            ClockKind::Real => Self::Real(Arc::new(Monotonic::start_at(start))),
            ClockKind::Virtual => Self::Virtual(Arc::new(Virtual::new(start))),
        }
    }

    fn shared(&self) -> Arc<dyn Clock> {
        match self {
            Self::Real(clock) => clock.clone(),
            Self::Virtual(clock) => clock.clone(),
        }
    }
}

struct Setup<'a> {
    bench: &'a Bench,
    start: Tai,
    stop: &'a Arc<AtomicBool>,
    updates: &'a Sender<Progress>,
    numbers: Option<Numbers>,
    /// In the whole run, all heads together.
    frames: u64,
    hygiene: Option<&'a Arc<Hygiene>>,
    recording: Option<&'a Recording>,
}

impl Setup<'_> {
    fn real(
        &self,
        clock: &Arc<Monotonic>,
        heads: &mut [BenchHead],
        sinks: Vec<Box<dyn Sink>>,
    ) -> Result<(RunOutcome, Vec<GatewayRow>)> {
        // Sinks have had the time they took to begin.
        clock.restart_at(self.start);
        let clock: Arc<dyn Clock> = clock.clone();
        let Ports { near, far, pulses, mut gateways } = open_ports(self.bench, &clock, &mut |link| self.tapped(link))?;
        announce_gateways(&gateways);
        let over = Arc::new(AtomicBool::new(false));
        let begin = |far| {
            let computer = FlightComputer::new(bench_parts::flight_computer(self.bench, self.start));
            far_end(computer, far, Arc::clone(&clock), Arc::clone(&over), self.hygiene.map(Arc::clone))
        };
        let thread = far.map(begin).transpose()?;
        let mut send = self.sender();
        let ring_frames = usize::try_from(self.bench.budget.ring_frames)?;
        let setting = real_time::Setting { clock: &clock, stop: self.stop, hygiene: self.hygiene, ring_frames };
        let heads = heads.iter_mut().zip(sinks).map(|(head, sink)| head.on_real_clock(sink)).collect();
        let mut outcome = real_time::run_in(&setting, heads, Sources { ports: near, pulses }, &mut send);
        over.store(true, Ordering::SeqCst);
        let ended = clock.now();
        match thread.map(std::thread::JoinHandle::join) {
            None | Some(Ok(Ok(()))) => {}
            Some(Ok(Err(error))) => {
                outcome.error.get_or_insert(RunError::FarEnd(error.into()));
            }
            Some(Err(_panicked)) => outcome.note_lost_thread("flight computer", ended),
        }
        let rows = gateway_rows(&gateways);
        let lost_in_gateways: u64 = gateways.iter_mut().map(Gateways::finish).sum();
        for _ in 0..lost_in_gateways {
            outcome.note_lost_thread("gateway", ended);
        }
        Ok((outcome, rows))
    }

    fn simulated(
        &self,
        clock: &Arc<Virtual>,
        heads: &mut [BenchHead],
        mut sinks: Vec<Box<dyn Sink>>,
    ) -> Result<RunOutcome> {
        let shared: Arc<dyn Clock> = clock.clone();
        if let Some(what) = needs_real_clock(self.bench) {
            bail!("--clock virtual: got a bench with {what}, which has a time of its own; wanted --clock real");
        }
        let Ports { mut near, far, .. } = open_ports(self.bench, &shared, &mut |link| self.tapped(link))?;
        let (Some(near), Some(mut far)) = (near.first_mut(), far) else { bail!("the bench has no two ends") };
        let mut computer = FlightComputer::new(bench_parts::flight_computer(self.bench, self.start));
        let mut far_end = |now: Tai| {
            computer.step(now, &mut far)?;
            Ok(computer.next_due())
        };
        let mut send = self.sender();
        let mut progress = |head: usize, frame: &SentFrame, record: &RunRecord| {
            send(head, frame, record);
            !self.stop.load(Ordering::Relaxed)
        };
        let heads = heads.iter_mut().zip(&mut sinks).map(|(head, sink)| head.on_virtual_clock(&mut **sink)).collect();
        let mut world = virtual_time::World { port: near, far_end: &mut far_end, progress: &mut progress };
        Ok(virtual_time::run_in(clock, heads, &mut world))
    }

    /// What a link of the stimulator is behind, when the run is captured.
    fn tapped(&self, link: Box<dyn Link>) -> Box<dyn Link> {
        match self.recording {
            Some(recording) => recording.tap(link),
            None => link,
        }
    }

    /// Hands the monitor a frame's progress, where the first head points; drops it when the monitor is busy.
    fn sender(&self) -> impl FnMut(usize, &SentFrame, &RunRecord) + use<> {
        let frames = self.frames;
        let updates = self.updates.clone();
        let numbers = self.numbers.clone();
        let mut since_first: Option<(Stopwatch, f64)> = None;
        // Every head counts, the first one shows where it points.
        let mut first_head = None;
        move |head, frame, record| {
            if head == 0 {
                let meta = &frame.meta;
                first_head = Some(([meta.ra_deg, meta.dec_deg, meta.roll_deg], frame.truth.len(), meta.method));
            }
            let Some(([ra_deg, dec_deg, roll_deg], stars, method)) = first_head else { return };
            let (watch, elapsed_s) = since_first.get_or_insert_with(|| (Stopwatch::start(), 0.0));
            *elapsed_s += watch.lap().s();
            let done = record.frames.rendered;
            let update = Progress {
                frame: done,
                frames: Some(frames),
                fps: done.saturating_sub(1) as f64 / f64::max(*elapsed_s, 1e-3),
                p99_ms: record.p99_ms(),
                late: record.frames.late,
                dropped: record.frames.dropped,
                ra_deg,
                dec_deg,
                roll_deg,
                stars,
                method,
            };
            let _monitor_is_busy = updates.try_send(update);
            if let Some(numbers) = &numbers {
                numbers.tell(&record.numbers(Some(frames)));
            }
        }
    }
}

/// The simulated flight computer in a thread of its own.
fn far_end(
    mut computer: FlightComputer,
    mut port: Port,
    clock: Arc<dyn Clock>,
    over: Arc<AtomicBool>,
    hygiene: Option<Arc<Hygiene>>,
) -> Result<std::thread::JoinHandle<Result<(), FlightError>>> {
    std::thread::Builder::new()
        .name("flight computer".into())
        .spawn(move || {
            if let Some(hygiene) = hygiene {
                hygiene.enter(Role::FarEnd);
            }
            run_until(&over, &*clock, &mut computer, &mut port)
        })
        .context("cannot start the flight computer's thread")
}

#[cfg(test)]
#[path = "run_tests.rs"]
mod tests;
