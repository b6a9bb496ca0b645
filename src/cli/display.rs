//! `starloop display`: the monitors there are, and images on one of them: a look at a marker, a pattern, a grey ramp.
//! What measures the latency is a file of its own.

use crate::cli::display_latency::{CornerWord, FlipArgs, LatencyArgs, flip, latency, monitor_choice};
use crate::cli::report_json::print_json;
use anyhow::{Context, Result, bail};
use base::clock::{Clock, Monotonic};
use base::image::DnImage;
use base::input_file::{DATA_BYTES, read_bytes};
use clap::{Args, Subcommand};
use crossbeam_channel::{Receiver, RecvTimeoutError, bounded};
use frames::sink::{SentFrame, Sink};
use outputs::display::{Bits, Display, GreyMaker, GreyTable, Marker, MonitorFacts, Params, monitors};
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
    #[arg(long, value_enum, default_value_t = CornerWord::TopLeft)]
    marker_corner: CornerWord,
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
    let corner = arguments.marker_corner.corner();
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
