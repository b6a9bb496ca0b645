//! A file or a folder for each command; parses the command line, assembles the crates, prints.

#[macro_use]
mod print;
mod advice;
pub mod budget;
mod budget_report;
pub mod bus;
pub mod calibrate;
mod calibrate_display;
pub mod camera;
pub mod campaign;
pub mod catalog;
pub mod chart;
pub mod check;
pub mod compare;
#[cfg(feature = "data_sets")]
pub mod data_set;
pub mod display;
mod display_measurements;
pub mod doctor;
pub mod exit_statuses;
pub mod export;
mod facts;
pub mod fly;
mod frame_plan;
pub mod help;
mod junit;
pub mod keys;
pub mod link_check;
pub mod named;
mod provenance;
pub mod psf;
pub mod render;
pub mod replay;
pub mod report;
pub mod report_json;
pub mod run;
mod signals;
pub mod snr;
pub mod study;
mod terminal;
pub mod verify;
pub mod version;

use anyhow::Context;
use base::streams;
use clap::{CommandFactory, Parser, Subcommand};
use std::process::ExitCode;

/// Exit status: done.
pub const EXIT_DONE: u8 = 0;
/// Exit status: could not do what was asked (a file, a device, a link).
pub const EXIT_FAILED: u8 = 1;
/// Exit status: wrong command line.
pub const EXIT_USAGE: u8 = 2;
/// Exit status: a run was over its timing budget.
pub const EXIT_OVER_BUDGET: u8 = 3;
/// Exit status: it ran, but an expectation or an invariant of the scenario, or a study's prediction, did not hold.
pub const EXIT_NOT_MET: u8 = 4;
/// Exit status: it reached its end, but something was lost: frames, a file, a capture, a thread. One line on standard
/// error says what, also when the command is quiet. It comes before every other status except [`EXIT_FAILED`].
pub const EXIT_LOST: u8 = 5;
/// Exit status: a run reached its end, but frames are missing, late, blank or lit by a held attitude, a link was lost, or
/// input contradicts itself. The first line of its output says what.
pub const EXIT_INCOMPLETE: u8 = 6;
/// Exit status: stopped by Ctrl-C (SIGINT); everything finished by then is written. SIGTERM gives 143, SIGHUP 129: 128
/// and the signal's number.
pub const EXIT_INTERRUPTED: u8 = 130;

#[derive(Debug, Parser)]
#[command(
    name = "starloop",
    version = version::SHORT,
    about = "Hardware-in-the-loop star-sensor stimulator: bus attitude in, star-sensor frames out, on a deadline",
    after_help = exit_statuses::help_text() + "\n\nStart with `starloop run`: a simulated flight computer slews over a \
                  simulated bus, and ten seconds of frames are recorded. No hardware, no GPU needed. `starloop doctor` \
                  looks for hardware.",
    long_version = version::long()
)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run a bench or a scenario: attitude from its link, frames into its sink, on a deadline
    Run(run::args::RunArgs),
    /// Run a bench on the real clock and compare the time of every stage with its budget
    Budget(budget::BudgetArgs),
    /// Draw the frames of a captured run again and compare them bit by bit, or those of a capture of the bus
    Replay(replay::ReplayArgs),
    /// Render one image for a given attitude and time
    Render(Box<render::RenderArgs>),
    /// Draw a data set: many images with labels, from distributions
    Dataset(data_set::DataSetArgs),
    /// Check a bench or a scenario: conventions, defaults, events, the plan with its predicted error and cost
    Check(check::CheckArgs),
    /// Measure what frames cost on this machine, for runs on the real clock and `check`; calibrate a display
    Calibrate(calibrate::CalibrateArgs),
    /// List this machine's monitors, or show images on one (in a build with the feature display)
    Display(display::DisplayArgs),
    /// Host a simulated CAN bus that programs join over slcan (TCP, PTY) and socketcand
    Bus(bus::BusArgs),
    /// Fly many simulated hours of random faults and check that the loop rides them through
    Campaign(campaign::CampaignArgs),
    /// Measure error and time of every method: CSV tables and SVG charts
    Chart(chart::ChartArgs),
    /// Compare a camera's own frames with its file: photon transfer (EMVA 1288) and errors by brightness
    Verify(verify::VerifyArgs),
    /// Compare real night-sky images with drawn ones: attitude, fitted camera, residuals star by star
    Compare(compare::CompareArgs),
    /// Compute the range of a camera's stars: SNR against magnitude, limiting and saturation magnitudes
    Snr(snr::SnrArgs),
    /// Write a camera's geometry in the form that a star tracker's program reads
    Camera(camera::CameraArgs),
    /// Inject latency and jitter into the closed loop and compare it with linear theory: CSV table and SVG charts
    Study(study::StudyArgs),
    /// Hold a bus or serial port of this machine to what links promise, or echo what arrives on it
    LinkCheck(link_check::LinkCheckArgs),
    /// Describe a camera's star: MTF of every link, width, encircled energy, what star colours change; and plot them
    Psf(psf::PsfArgs),
    /// Fly a test plan of star trackers case by case, and write one report
    Fly(fly::FlyArgs),
    /// Judge a tracker's log by the truth of a run: metrics of ECSS-E-ST-60-20C with confidence, requirements, verdict
    Report(report::ReportArgs),
    /// Write attitudes, the observer's orbit and places of stars as AEM, OEM, STK files, CSV
    Export(export::ExportArgs),
    /// Write a bench as an FMI 3.0 or 2.0 co-simulation unit, for simulators that import such units
    Fmu(export::FmuArgs),
    /// Print every key of the configuration files with unit, range, default and meaning, as Markdown
    Keys(keys::KeysArgs),
    /// Print the JSON Schema of a kind of configuration files
    Schema(keys::SchemaArgs),
    /// Print a configuration file in which every key is explained and commented out
    Init(keys::InitArgs),
    /// Pack, describe or query a star catalog
    Catalog(catalog::CatalogArgs),
    /// Look for what this machine has for a bench: CAN, serial ports, GPU, display, real-time rights, clocks, Python
    Doctor(doctor::DoctorArgs),
    /// Print the completions of a shell: bash, zsh or fish
    Completions(help::CompletionsArgs),
    /// Write the manual pages of all commands
    Man(help::ManArgs),
}

/// Returns an error and its causes, without those that an error before them already contains.
fn chain(error: &anyhow::Error) -> String {
    let mut reported = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if !reported.contains(&cause) {
            reported = if reported.is_empty() { cause } else { format!("{reported}: {cause}") };
        }
    }
    reported
}

/// Returns whether an error is about a value of the command line: its message begins with the option, and no file or
/// device is its cause.
fn is_wrong_command_line(error: &anyhow::Error) -> bool {
    error.to_string().starts_with("--") && !error.chain().any(|cause| cause.is::<std::io::Error>())
}

/// Prints without our macros (those of libraries) panic when a standard stream cannot be written: the program ends as
/// by
/// [`print`](streams::print), without a backtrace.
fn end_on_a_failed_print() {
    let report = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        let text = panic.payload().downcast_ref::<String>().map_or("", String::as_str);
        if text.starts_with("failed printing to std") {
            let is_closed = text.contains("Broken pipe");
            std::process::exit(i32::from(if is_closed { streams::EXIT_BROKEN_PIPE } else { EXIT_FAILED }));
        }
        report(panic);
    }));
}

/// Returns the whole command line, with groups and examples in its help.
pub fn command() -> clap::Command {
    let plain = advice::with_negative_numbers(Arguments::command());
    help::with_groups(help::with_examples(plain))
}

/// Most threads that draw.
const THREADS_MOST: usize = 1024;

/// Runs the command line; errors are printed with their causes.
pub fn main() -> ExitCode {
    end_on_a_failed_print();
    let arguments = match advice::parsed::<Arguments>(command()) {
        Ok(arguments) => arguments,
        Err(status) => return ExitCode::from(status),
    };
    // A run starts its own: on the real clock they have its priority and processors.
    let is_run = matches!(arguments.command, Command::Run(_) | Command::Budget(_));
    let threads = if is_run { Ok(()) } else { start_threads() };
    let status = match threads.and_then(|()| signals::catch()).and_then(|()| run_command(arguments.command)) {
        Ok(status) => status,
        // Output that failed is reported below, with the stream.
        Err(error) if streams::output_has_failed() && error.root_cause().is::<std::io::Error>() => EXIT_DONE,
        Err(error) => {
            eprintln!("starloop: {}", terminal::plain_text(&chain(&error)));
            if is_wrong_command_line(&error) { EXIT_USAGE } else { EXIT_FAILED }
        }
    };
    ExitCode::from(streams::status_of_streams(status))
}

/// Advice where the threads that draw do not start.
pub(crate) const NO_THREADS: &str =
    "the threads that draw do not start; give the program more memory (ulimit -v), or set RAYON_NUM_THREADS=1";

/// Starts the threads that draw, while there is memory for them: later their absence would be a panic. The calling thread is the
/// first of them, and need not wake another one to begin.
pub(crate) fn start_threads() -> anyhow::Result<()> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(thread_count());
    pool.use_current_thread().build_global().context(NO_THREADS)
}

/// Returns the number of threads that draw, 0 for as many as `RAYON_NUM_THREADS` or the processors. Very many take minutes
/// before the first line, so `RAYON_NUM_THREADS` is bounded.
pub(crate) fn thread_count() -> usize {
    let asked = std::env::var("RAYON_NUM_THREADS").ok().and_then(|text| text.trim().parse::<usize>().ok());
    let bounded = asked.filter(|asked| *asked > THREADS_MOST);
    if let Some(asked) = bounded {
        eprintln!("starloop: RAYON_NUM_THREADS: got {asked}, wanted {THREADS_MOST} at most, which are used");
    }
    bounded.map_or(0, |_| THREADS_MOST)
}

/// Runs one command; the exit status.
fn run_command(command: Command) -> anyhow::Result<u8> {
    match command {
        Command::Run(arguments) => run::run(&arguments),
        Command::Budget(arguments) => budget::run(&arguments),
        Command::Replay(arguments) => replay::run(&arguments),
        Command::Render(arguments) => render::run(&arguments).map(|()| EXIT_DONE),
        Command::Dataset(arguments) => data_set::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::Calibrate(arguments) => calibrate::run(&arguments).map(|()| EXIT_DONE),
        Command::Display(arguments) => display::run(&arguments).map(|()| EXIT_DONE),
        Command::Bus(arguments) => bus::run(&arguments),
        Command::Campaign(arguments) => campaign::run(&arguments),
        Command::Chart(arguments) => chart::run(&arguments).map(|()| EXIT_DONE),
        Command::Verify(arguments) => verify::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Snr(arguments) => snr::run(&arguments).map(|()| EXIT_DONE),
        Command::Camera(arguments) => camera::run(&arguments).map(|()| EXIT_DONE),
        Command::Study(arguments) => study::run(&arguments),
        Command::LinkCheck(arguments) => link_check::run(&arguments),
        Command::Psf(arguments) => psf::run(&arguments).map(|()| EXIT_DONE),
        Command::Fly(arguments) => fly::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Export(arguments) => export::run(&arguments).map(|()| EXIT_DONE),
        Command::Fmu(arguments) => export::run_fmu(&arguments).map(|()| EXIT_DONE),
        Command::Keys(arguments) => keys::run(&arguments).map(|()| EXIT_DONE),
        Command::Schema(arguments) => keys::run_schema(&arguments).map(|()| EXIT_DONE),
        Command::Init(arguments) => keys::run_init(&arguments).map(|()| EXIT_DONE),
        Command::Catalog(arguments) => catalog::run(arguments).map(|()| EXIT_DONE),
        Command::Doctor(arguments) => doctor::run(&arguments).map(|()| EXIT_DONE),
        Command::Completions(arguments) => help::run_completions(&arguments).map(|()| EXIT_DONE),
        Command::Man(arguments) => help::run_man(&arguments).map(|()| EXIT_DONE),
    }
}

/// `starloop dataset` in a program built without the feature `data_sets`: it fails and says how to build one with it.
#[cfg(not(feature = "data_sets"))]
pub mod data_set {
    use anyhow::{Result, bail};
    use clap::Args;

    /// Command line of `dataset`: anything.
    #[derive(Debug, Args)]
    pub struct DataSetArgs {
        /// Whatever a program with data sets takes
        #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
        words: Vec<String>,
    }

    /// Fails.
    ///
    /// # Errors
    /// Always.
    pub fn run(_: &DataSetArgs) -> Result<u8> {
        bail!(
            "dataset: this program was built without data sets; install one with \
             `cargo install --locked --path . --features data_sets`"
        )
    }
}
