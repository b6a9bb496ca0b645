//! The command line of `starloop run`.

use crate::cli::named::one_of;
use clap::{Args, ValueEnum};
use config::{Backend, Bench};
use frames::sink::RecorderOptions;
use link::{capture::CaptureFormat, gateway::TcpAddress};
use run::wiring::control::ControlAddress;
pub(crate) use run::wiring::run_clock::RunClockKind as ClockKind;
use std::path::PathBuf;

/// Command line of `run`.
#[derive(Debug, Default, Args)]
pub struct RunArgs {
    /// Bench or scenario file (TOML); without one: the built-in loopback bench
    pub(crate) bench: Option<PathBuf>,
    /// Which clock: `real` is the bench, `virtual` runs as fast as the machine allows and repeats bit for bit
    #[arg(long, value_parser = one_of(CLOCKS), default_value = "real")]
    pub(crate) clock: ClockKind,
    /// Run for this many seconds instead of the bench's duration
    #[arg(long, value_name = "S")]
    pub(crate) duration: Option<f64>,
    /// Draw with this backend instead of the bench's
    #[arg(long, value_parser = one_of(BACKENDS))]
    pub(crate) backend: Option<Backend>,
    /// Seed of the run instead of the bench's: the sensor's patterns, and all that has no seed of its own
    #[arg(long)]
    pub(crate) seed: Option<u64>,
    /// Seed of the exposures' noise instead of the bench's (default: that of the run)
    #[arg(long)]
    pub(crate) noise_seed: Option<u64>,
    /// Where frames go instead of the bench's sinks
    #[arg(long, value_enum)]
    pub(crate) sink: Option<SinkKind>,
    /// Directory to record into (one without a recording); without it a directory named by the time of the run
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Predict with the built-in costs, whatever `starloop calibrate` has measured (real clock)
    #[arg(long)]
    pub(crate) built_in_costs: bool,
    /// Write budget.json, frames_timing.csv, junit.xml and worst.svg into this directory (on the real clock)
    #[arg(long, value_name = "DIR")]
    pub(crate) report: Option<PathBuf>,
    /// Write verdict, expectations and invariants as JUnit XML, on either clock
    #[arg(long, value_name = "FILE.xml")]
    pub(crate) junit: Option<PathBuf>,
    /// Add the random faults of a campaign's episode with this seed (a run with a spacecraft)
    #[arg(long)]
    pub(crate) random_faults: bool,
    /// Print the report as one line of JSON instead of a table
    #[arg(long)]
    pub(crate) json: bool,
    /// Print everything that is known of the run after the verdict, not only what matters most
    #[arg(long)]
    pub(crate) details: bool,
    /// Change a value of the file before it is checked, such as control.delay_ms=300, or of a file that it names, such
    /// as bench.timing.frame_rate_hz=5; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) settings: Vec<String>,
    /// Let a program outside look at the run, inject events and, on the virtual clock, advance it: JSON lines over TCP;
    /// loopback only, port 0 takes a free one. Prints a token that the program must send first
    #[arg(long, value_name = "ADDRESS")]
    pub(crate) control: Option<ControlAddress>,
    /// Capture the buses and what each frame was drawn from into this directory, for `starloop replay`
    #[arg(long, value_name = "DIR")]
    pub(crate) capture: Option<PathBuf>,
    /// Form of the captured packets: pcapng holds CAN and serial, candump is text and holds CAN only
    #[arg(long, value_parser = one_of(CAPTURES), default_value = "pcapng")]
    pub(crate) capture_format: CaptureFormat,
    /// Serve a page with the newest frames and the run's numbers, and /metrics for Prometheus: a port on loopback, or
    /// ADDRESS:PORT; port 0 takes a free one
    #[arg(long, value_name = "ADDRESS")]
    pub(crate) monitor: Option<TcpAddress>,
    /// Name of this machine under which browsers and Prometheus ask for --monitor, such as lab-pc; addresses and
    /// localhost need none; may be repeated
    #[arg(long = "monitor-name", value_name = "NAME", requires = "monitor")]
    pub(crate) monitor_names: Vec<String>,
    /// Print nothing but errors
    #[arg(long)]
    pub(crate) quiet: bool,
}

impl RunArgs {
    /// Returns the sinks of the run: the bench's, or the one that the command line names in their place.
    pub(crate) fn sinks(&self, bench: &Bench) -> Vec<config::SinkSettings> {
        let is_recorder = |settings: &&config::SinkSettings| matches!(settings.sink, config::Sink::Recorder { .. });
        match self.sink {
            None => bench.sinks.clone(),
            Some(SinkKind::Null) => vec![config::SinkSettings { sink: config::Sink::Null, queue_frames: 1 }],
            Some(SinkKind::Recorder) => vec![bench.sinks.iter().find(is_recorder).cloned().unwrap_or_else(|| {
                let directory = Some(format!("out/{}", bench.name).into());
                let options = RecorderOptions { png_every: 10, ..RecorderOptions::default() };
                let sink = config::Sink::Recorder { directory, options };
                config::SinkSettings { sink, queue_frames: 8 }
            })],
        }
    }
}

/// Clocks, by name.
const CLOCKS: &[(&str, &str, ClockKind)] =
    &[("real", "Wall time", ClockKind::Real), ("virtual", "Simulated time", ClockKind::Virtual)];

/// Forms of captured packets, by name.
const CAPTURES: &[(&str, &str, CaptureFormat)] = &[
    ("pcapng", "Packets for Wireshark and tshark, exact to the bit", CaptureFormat::Pcapng),
    ("candump", "Text for can-utils and python-can", CaptureFormat::Candump),
];

/// Backends: their words, what they are.
pub(crate) const BACKENDS: &[(&str, &str, Backend)] = &[
    ("auto", "A hardware GPU when there is one, else the CPU", Backend::Auto),
    ("gpu", "The GPU (software Vulkan counts), or an error", Backend::Gpu),
    ("cpu", "All CPU cores", Backend::Cpu),
    ("reference", "f64, slow, the truth", Backend::Reference),
];

/// A sink, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum SinkKind {
    /// FITS, truth tables and PNG files
    Recorder,
    /// Nothing is kept: timing only
    Null,
}
