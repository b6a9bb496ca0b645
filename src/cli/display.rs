//! `starloop display`: the monitors there are, and images on one of them: a look at a marker, a pattern, a grey ramp.
//! What measures the latency is a file of its own.

use crate::cli::{named::one_of, report_json::print_json};
use anyhow::{Context, Result, bail};
use base::clock::{Clock, Monotonic};
use base::input_file::{DATA_BYTES, InputFile, read_bytes};
use base::{image::DnImage, time::Span};
use clap::{Args, Subcommand};
use crossbeam_channel::{Receiver, RecvTimeoutError, bounded};
use frames::sink::{SentFrame, Sink, write_file_atomically};
use outputs::display::latency::{APART_S, Flip, Latency, flips_of};
use outputs::display::monitor::choose;
use outputs::display::{
    Bits, Corner, Display, GreyMaker, GreyTable, Marker, MonitorChoice, MonitorFacts, Params, SubmitRow, monitors,
};
use serde::{Deserialize, de::DeserializeOwned};
use std::io::{BufRead, Write};
use std::path::{Path, PathBuf};
use std::{sync::Arc, time::Duration};

/// Time between checks for a closed window.
const LOOK: Duration = Duration::from_millis(20);
/// Longest wait for a frame's submit time, looks: two seconds.
const LONGEST_LOOKS: u32 = 100;

/// Command line of `display`.
#[derive(Debug, Args)]
pub struct DisplayArgs {
    #[command(subcommand)]
    command: DisplayCommand,
}

#[derive(Debug, Subcommand)]
enum DisplayCommand {
    /// List the monitors by the names that benches use
    Monitors(MonitorsArgs),
    /// Show images, one after the other; Enter shows the next, Esc in the window ends it
    Show(ShowArgs),
    /// Turn the marker patch over, slowly, and keep the submit times, while a photodiode on it is logged
    Flip(FlipArgs),
    /// Compute the latency from submit to light, by submit times and the photodiode's
    Latency(LatencyArgs),
}

/// Command line of `display monitors`.
#[derive(Debug, Args)]
struct MonitorsArgs {
    /// Print the list as one line of JSON
    #[arg(long)]
    json: bool,
}

/// Command line of `display show`.
#[derive(Debug, Args)]
#[command(
    after_help = "Images are grey PNGs, taken as luminances: 65535 (or 255) is the full luminance of the display. \
                        Greys go to the monitor in proportion to luminance, or by --gamma; nothing is scaled, so images \
                        must have the size of the monitor or of the window."
)]
struct ShowArgs {
    /// Grey PNG files of 16 or 8 bits, all of one size
    #[arg(required = true)]
    images: Vec<PathBuf>,
    /// The monitor: a name or a number of `starloop display monitors` [default: the primary one]
    #[arg(long)]
    monitor: Option<String>,
    /// A window of the images' size in place of a full screen
    #[arg(long)]
    window: bool,
    /// Bits of a grey: 8 or 10
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u32).range(8..=10))]
    bits: u32,
    /// Response of the display: its luminance is this power of the grey
    #[arg(long, default_value_t = 1.0)]
    gamma: f64,
    /// Side of the photodiode's patch, px; 0: none
    #[arg(long, default_value_t = 0)]
    marker_px: u32,
    /// Where the patch is
    #[arg(long, value_parser = one_of(CORNERS), default_value = "top-left")]
    marker_corner: Corner,
}

/// Runs the command.
///
/// # Errors
/// When the X server cannot be reached, an image cannot be shown, or the window is closed.
pub fn run(arguments: &DisplayArgs) -> Result<()> {
    match &arguments.command {
        DisplayCommand::Monitors(MonitorsArgs { json: true }) => {
            let monitor = |monitor: &MonitorFacts| {
                serde_json::json!({
                    "name": monitor.name, "size_px": monitor.size_px, "origin_px": monitor.origin_px,
                    "refresh_mhz": monitor.refresh_mhz, "is_primary": monitor.is_primary,
                })
            };
            let found = monitors()?.iter().map(monitor).collect::<Vec<_>>();
            print_json("display-monitors", serde_json::json!({ "monitors": found }))
        }
        DisplayCommand::Monitors(_) => {
            monitors()?.iter().enumerate().for_each(|(index, monitor)| println!("{index}: {monitor}"));
            Ok(())
        }
        DisplayCommand::Show(arguments) => show(arguments),
        DisplayCommand::Flip(arguments) => flip(arguments),
        DisplayCommand::Latency(arguments) => latency(arguments),
    }
}

fn show(arguments: &ShowArgs) -> Result<()> {
    let images = arguments.images.iter().map(|path| read(path)).collect::<Result<Vec<DnImage>>>()?;
    let Some(first) = images.first() else { bail!("no image") };
    let image_px = [u32::try_from(first.width())?, u32::try_from(first.height())?];
    let params = params(arguments, image_px)?;
    let table = GreyTable::by_gamma(params.bits.count(), arguments.gamma)?;
    let clock: Arc<dyn Clock> = Arc::new(Monotonic::start());
    let mut display = Display::open(&params, image_px, GreyMaker::nearest(&table), clock)?;
    println!("{}", display.description());
    let (submits, lines) = (display.submits(), lines()?);
    let mut frame = SentFrame::with_capacity(first.width(), first.height(), 0, "images".into());
    for (number, (path, image)) in (1..).zip(arguments.images.iter().zip(&images)) {
        frame.meta.number = number;
        frame.image.clone_from(image);
        display.send(&frame)?;
        match wait(&display, &submits, Some(LONGEST_LOOKS))? {
            Some(submitted) => println!("{}: submitted {}", path.display(), submitted.submit.to_rfc3339()),
            None => println!("{}: not seen, the monitor is away or does not refresh", path.display()),
        }
        std::io::stdout().flush()?;
        if wait(&display, &lines, None)?.is_none() {
            break;
        }
    }
    display.finish()?;
    println!("{}", display.counts());
    Ok(())
}

fn params(arguments: &ShowArgs, image_px: [u32; 2]) -> Result<Params> {
    let monitor = monitor_choice(arguments.monitor.as_deref());
    let bits = match arguments.bits {
        8 => Bits::Eight,
        10 => Bits::Ten,
        other => bail!("--bits {other}; wanted 8 or 10"),
    };
    let corner = arguments.marker_corner;
    let marker = (arguments.marker_px > 0).then_some(Marker { size_px: arguments.marker_px, corner });
    let window_px = arguments.window.then_some(image_px);
    Ok(Params { monitor, window_px, bits, marker, ..Params::full_screen() })
}

/// Returns the next item; `None` when there will be none, or none came in so many looks.
///
/// # Errors
/// When the window is closed meanwhile.
fn wait<T>(display: &Display, items: &Receiver<T>, looks: Option<u32>) -> Result<Option<T>> {
    let mut looked = 0;
    while looks.is_none_or(|most| looked < most) {
        match items.recv_timeout(LOOK) {
            Ok(item) => return Ok(Some(item)),
            Err(RecvTimeoutError::Disconnected) => return Ok(None),
            Err(RecvTimeoutError::Timeout) => {}
        }
        if let Some(end) = display.ended() {
            return Err(end.clone().into());
        }
        looked += 1;
    }
    Ok(None)
}

/// Returns one item for each line of the standard input.
fn lines() -> Result<Receiver<()>> {
    let (sender, receiver) = bounded(1);
    let read = move || {
        for line in std::io::stdin().lock().lines() {
            if line.is_err() || sender.send(()).is_err() {
                break;
            }
        }
    };
    std::thread::Builder::new().name("lines".into()).spawn(read).context("thread \"lines\"")?;
    Ok(receiver)
}

/// Returns a grey PNG as luminances.
pub(super) fn read(path: &Path) -> Result<DnImage> {
    let place = || format!("image {}", path.display());
    let bytes = std::io::Cursor::new(read_bytes(path, DATA_BYTES).with_context(place)?);
    let mut reader = png::Decoder::new(bytes).read_info().with_context(place)?;
    let size = reader.output_buffer_size().with_context(place)?;
    let mut bytes = vec![0; size];
    let info = reader.next_frame(&mut bytes).with_context(place)?;
    let mut image = DnImage::new(info.width as usize, info.height as usize);
    let luminances: Vec<u16> = match (info.color_type, info.bit_depth) {
        (png::ColorType::Grayscale, png::BitDepth::Sixteen) => {
            bytes.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect()
        }
        (png::ColorType::Grayscale, png::BitDepth::Eight) => bytes.iter().map(|grey| u16::from(*grey) * 257).collect(),
        (color, depth) => bail!("{}: got {color:?} of {depth:?} bits, wanted grey of 16 or 8 bits", place()),
    };
    image.pixels_mut().copy_from_slice(&luminances[..info.width as usize * info.height as usize]);
    Ok(image)
}

// `starloop display flip` and `latency`: from the marker patch and a photodiode to the latency of a display.
//
// `flip` shows black frames whose marker turns over, slowly enough that an edge belongs to one flip, and keeps their
// submit times; meanwhile a photodiode on the patch is logged by the user's own means. `latency` holds the two tables
// against one another. Both must be stamped by one clock: this machine's, or one that is kept with it (PTP, NTP).

/// Shortest time between flips: they stay [`APART_S`] apart when one is a refresh late.
const SHORTEST_PERIOD_S: f64 = 1.2 * APART_S;
/// The row that a bench's latency is for, of all rows.
const MIDDLE_ROW: f64 = 0.5;

/// Corners, by name.
pub(super) const CORNERS: &[(&str, &str, Corner)] = &[
    ("top-left", "Where pixel (0, 0) is", Corner::TopLeft),
    ("top-right", "The end of the first row", Corner::TopRight),
    ("bottom-left", "The beginning of the last row", Corner::BottomLeft),
    ("bottom-right", "The last pixel", Corner::BottomRight),
];

/// Returns the row of the patch over the number of rows.
pub(super) fn row_share(corner: Corner) -> f64 {
    match corner {
        Corner::TopLeft | Corner::TopRight => 0.0,
        Corner::BottomLeft | Corner::BottomRight => 1.0,
    }
}

/// Returns the monitor that a command line names.
pub(super) fn monitor_choice(word: Option<&str>) -> MonitorChoice {
    match word {
        None => MonitorChoice::Primary,
        Some(word) => word.parse().map_or_else(|_| MonitorChoice::Named(word.to_owned()), MonitorChoice::Index),
    }
}

/// Command line of `display flip`.
#[derive(Debug, Args)]
pub(super) struct FlipArgs {
    /// Where submit times go: a new file (CSV)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The monitor: a name or a number of `starloop display monitors` [default: the primary one]
    #[arg(long)]
    monitor: Option<String>,
    /// Side of the photodiode's patch, px
    #[arg(long, value_name = "PX", default_value_t = 64)]
    marker_px: u32,
    /// Where the patch is
    #[arg(long, value_parser = one_of(CORNERS), default_value = "top-left")]
    marker_corner: Corner,
    /// Seconds between flips, 0.12 or more: longer than any latency
    #[arg(long, value_name = "S", default_value_t = 0.25)]
    period: f64,
    /// Number of flips
    #[arg(long, default_value_t = 200, value_parser = clap::value_parser!(u32).range(10..=100_000))]
    count: u32,
}

/// Command line of `display latency`.
#[derive(Debug, Args)]
pub(super) struct LatencyArgs {
    /// Submit times: the file of `starloop display flip`
    submits: PathBuf,
    /// Times at which the photodiode saw the patch turn over (CSV with a column edge_s: seconds since 1970, UTC, as
    /// `date +%s.%N` and time.time() count them)
    #[arg(long, value_name = "FILE")]
    edges: PathBuf,
    /// Where the patch was
    #[arg(long, value_parser = one_of(CORNERS), default_value = "top-left")]
    marker_corner: Corner,
    /// From the first row's light to the last row's, milliseconds, of panels that light row by row: about a refresh; 0
    /// when all rows light at once, or when it is not known
    #[arg(long, value_name = "MS", default_value_t = 0.0)]
    scan_ms: f64,
    /// Write submit_s,edge_s of each flip, for `starloop calibrate display fit --latency`
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// Flips the marker.
///
/// # Errors
/// When the monitor does not exist, the window is closed, or submit times cannot be written.
pub(super) fn flip(arguments: &FlipArgs) -> Result<()> {
    if !(SHORTEST_PERIOD_S..=60.0).contains(&arguments.period) {
        bail!(
            "--period: wanted {SHORTEST_PERIOD_S} to 60 s, so that an edge belongs to one flip, got {}",
            arguments.period
        );
    }
    let monitor = monitor_choice(arguments.monitor.as_deref());
    let all = monitors()?;
    let image_px = all[choose(&all, &monitor)?].size_px;
    let marker = Some(Marker { size_px: arguments.marker_px, corner: arguments.marker_corner });
    let params = Params { monitor, marker, ..Params::full_screen() };
    let clock: Arc<dyn Clock> = Arc::new(Monotonic::start());
    let maker = GreyMaker::nearest(&GreyTable::linear(Bits::Eight.count()));
    let mut display = Display::open(&params, image_px, maker, Arc::clone(&clock))?;
    display.keep_submits(&arguments.out)?;
    println!("{}", display.description());
    let [width, height] = image_px.map(|side| side as usize);
    let mut frame = SentFrame::with_capacity(width, height, 0, "marker".into());
    let first = clock.now();
    for number in 1..=arguments.count {
        clock.sleep_until(first + Span::from_s(arguments.period * f64::from(number)));
        frame.meta.number = number;
        display.send(&frame)?;
    }
    display.finish()?;
    println!("{} flips: submit times written to {}", display.counts().presented, arguments.out.display());
    Ok(())
}

/// Holds submit times against edges.
///
/// # Errors
/// When a table cannot be read, or says too little.
pub(super) fn latency(arguments: &LatencyArgs) -> Result<()> {
    if !(0.0..=1000.0).contains(&arguments.scan_ms) {
        bail!("--scan-ms: wanted 0 to 1000, got {}", arguments.scan_ms);
    }
    let submits: Vec<f64> = rows(&arguments.submits)?.iter().map(SubmitRow::submit_unix_s).collect();
    let edges: Vec<f64> = rows(&arguments.edges)?.iter().map(|edge: &Edge| edge.edge_s).collect();
    let flips = flips_of(&submits, &edges)?;
    let scan = Span::from_s(1e-3 * arguments.scan_ms);
    let latency = Latency::of_flips(&flips, row_share(arguments.marker_corner), scan)?;
    println!("{}", latency.reported());
    println!(
        "latency_ms = {:.3}   # for the bench's [sink]: in the middle of the display",
        latency.at_row(MIDDLE_ROW).ms()
    );
    arguments.out.as_deref().map_or(Ok(()), |path| write(path, &flips))
}

/// When the photodiode saw the patch turn over.
#[derive(Debug, Deserialize)]
struct Edge {
    edge_s: f64,
}

fn rows<T: DeserializeOwned>(path: &Path) -> Result<Vec<T>> {
    let place = || path.display().to_string();
    let file = InputFile::open(path, DATA_BYTES).with_context(place)?;
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(file);
    reader.deserialize().collect::<Result<_, _>>().with_context(place)
}

fn write(path: &Path, flips: &[Flip]) -> Result<()> {
    let mut out = csv::Writer::from_writer(Vec::new());
    for flip in flips {
        out.serialize(flip)?;
    }
    let table = out.into_inner().map_err(|error| error.into_error())?;
    write_file_atomically(path, |file| file.write_all(&table))?;
    println!("{} flips written to {}", flips.len(), path.display());
    Ok(())
}
