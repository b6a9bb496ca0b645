//! `starloop bus`: a simulated CAN bus with gateways, so that programs without CAN in their kernel can talk.

use crate::cli::{EXIT_DONE, EXIT_LOST, report_json::json_line, run::end::say_losses, signals};
use anyhow::{Context, Result, bail};
use base::clock::{Clock, Monotonic, Stopwatch};
use base::{streams::Output, time::Span};
use clap::{Args, ValueEnum};
use frames::report::Losses;
use link::gateway::{GatewayCounters, GatewayKind, GatewayParams, Gateways, TcpAddress};
use link::simulated::{BusModel, BusParams, BusStatistics, BusTiming, SimulatedBus, Stuffing};
use run::wiring::cable::{gateway_name, gateway_notes};
use serde::Serialize;
use std::io::{IsTerminal, Write};
use std::{path::PathBuf, sync::Arc, time::Duration};

/// Command line of `bus`.
#[derive(Debug, Args)]
pub struct BusArgs {
    /// Serve slcan over TCP here: a port of 127.0.0.1 (0 takes a free one), or ADDRESS:PORT
    #[arg(long, value_name = "PORT")]
    slcan_tcp: Option<TcpAddress>,
    /// Serve slcan over a pseudo-terminal: a symbolic link to it is made here, and removed at the end
    #[arg(long, value_name = "PATH")]
    slcan_pty: Option<PathBuf>,
    /// Serve socketcand here: a port of 127.0.0.1 (0 takes a free one), or ADDRESS:PORT
    #[arg(long, value_name = "PORT")]
    socketcand: Option<TcpAddress>,
    /// Name of the bus for socketcand's clients
    #[arg(long, value_name = "NAME", default_value = "can0")]
    name: String,
    /// Kind of wire
    #[arg(long, value_enum, default_value_t = Wire::CanFd)]
    wire: Wire,
    /// Bit rate, of the arbitration on CAN FD, bit/s
    #[arg(long, value_name = "N", default_value_t = 500_000, value_parser = clap::value_parser!(u32).range(1000..=100_000_000))]
    bit_rate: u32,
    /// Bit rate of the data phase of CAN FD, bit/s
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1000..=100_000_000))]
    data_bit_rate: Option<u32>,
    /// Give frames the stuff bits that their bits ask for, instead of the most that they can have
    #[arg(long)]
    exact_stuffing: bool,
    /// End after this many seconds instead of at Ctrl-C
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
    /// Print addresses and summary as lines of JSON
    #[arg(long)]
    json: bool,
}

/// A wire, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
enum Wire {
    /// CAN up to 8 bytes
    CanClassic,
    /// CAN FD with bit rate switching, and classic frames
    CanFd,
}

/// Bit rate of the data phase when none is given, bit/s.
const USUAL_DATA_BPS: u32 = 2_000_000;
/// Packets that the end of a client holds.
const QUEUE_PACKETS: usize = 4096;

/// Where one gateway is found, as JSON.
#[derive(Debug, Serialize)]
struct AddressLine {
    gateway: GatewayKind,
    address: String,
}

/// Counters of one gateway, as JSON.
#[derive(Debug, Serialize)]
struct GatewayLine {
    gateway: GatewayKind,
    #[serde(flatten)]
    counters: GatewayCounters,
}

/// Counters of the bus and its gateways, as JSON.
#[derive(Debug, Serialize)]
struct Summary {
    duration_s: f64,
    load: f64,
    frames: u64,
    error_frames: u64,
    gateways: Vec<GatewayLine>,
}

/// Runs the command; the exit status.
///
/// # Errors
/// With what could not be done, and why.
pub fn run(arguments: &BusArgs) -> Result<u8> {
    let params = arguments.gateways()?;
    let clock: Arc<dyn Clock> = Arc::new(Monotonic::start());
    let bus = arguments.bus(&clock)?;
    // From here on a signal ends the bus in order: its link is removed.
    let stop = signals::stop();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let mut gateways = Gateways::start(&bus, &params, &clock)?;
    let exposed = gateway_notes(&gateways).into_iter().filter(|note| note.starts_with("starloop: "));
    exposed.for_each(|note| eprintln!("{note}"));
    arguments.announce(&gateways)?;
    let mut wall = Stopwatch::start();
    let was_stopped = runtime.block_on(async {
        tokio::select! {
            () = signals::stopped(&stop) => true,
            () = passed(arguments.duration) => false,
            () = watch(&bus, &gateways) => false,
        }
    });
    if std::io::stderr().is_terminal() {
        eprintln!();
    }
    let summary = summary(wall.lap(), &bus.statistics(), &gateways);
    let mut losses = Losses::default();
    (0..gateways.finish()).for_each(|_| losses.note_thread("gateway"));
    drop(gateways);
    arguments.print_line(&summary)?;
    if say_losses(&losses) {
        return Ok(EXIT_LOST);
    }
    // Without a duration, a signal is how it ends.
    Ok(if was_stopped && arguments.duration.is_some() { signals::exit_status() } else { EXIT_DONE })
}

impl BusArgs {
    fn gateways(&self) -> Result<GatewayParams> {
        let [slcan_tcp, socketcand] =
            [self.slcan_tcp, self.socketcand].map(|gateway_port| gateway_port.map(TcpAddress::socket));
        let slcan_pty = self.slcan_pty.clone();
        if slcan_tcp.is_none() && slcan_pty.is_none() && socketcand.is_none() {
            bail!(
                "--slcan-tcp, --slcan-pty and --socketcand are missing; wanted one of them: no program could join this bus"
            );
        }
        Ok(GatewayParams { slcan_tcp, slcan_pty, socketcand, bus_name: self.name.clone(), ..GatewayParams::default() })
    }

    fn bus(&self, clock: &Arc<dyn Clock>) -> Result<SimulatedBus> {
        let timing = match (self.wire, self.data_bit_rate) {
            (Wire::CanClassic, Some(_)) => bail!("--data-bit-rate belongs to --wire can_fd"),
            (Wire::CanClassic, None) => BusTiming::CanClassic { bit_rate_bps: self.bit_rate },
            (Wire::CanFd, data_bps) => {
                let data_bps = data_bps.unwrap_or(USUAL_DATA_BPS.max(self.bit_rate));
                if data_bps < self.bit_rate {
                    bail!("--data-bit-rate: got {data_bps}, wanted no less than --bit-rate ({})", self.bit_rate);
                }
                BusTiming::CanFd { arbitration_bps: self.bit_rate, data_bps }
            }
        };
        if self.duration.is_some_and(|duration_s| !(duration_s > 0.0 && duration_s.is_finite())) {
            bail!("--duration: wanted seconds above 0");
        }
        let stuffing = if self.exact_stuffing { Stuffing::Exact } else { Stuffing::Worst };
        let params = BusParams { name: self.name.clone(), timing, latency: Span::ZERO, queue_packets: QUEUE_PACKETS };
        Ok(SimulatedBus::with_model(params, BusModel { stuffing, ..BusModel::default() }, clock))
    }

    fn announce(&self, gateways: &Gateways) -> Result<()> {
        let mut out = Output;
        for (gateway, address) in gateways.addresses() {
            if self.json {
                let line = AddressLine { gateway, address: address.to_string() };
                writeln!(out, "{}", json_line("bus", &line)?)?;
            } else {
                writeln!(out, "{:<12} {address}", gateway_name(gateway))?;
            }
        }
        out.flush().context("cannot print the addresses")
    }

    fn print_line(&self, summary: &Summary) -> Result<()> {
        let mut out = Output;
        if self.json {
            writeln!(out, "{}", json_line("bus", summary)?)?;
            return Ok(());
        }
        let Summary { duration_s, load, frames, error_frames, gateways } = summary;
        let load_percent = 100.0 * load;
        writeln!(out, "{duration_s:.1} s: {frames} frames, load {load_percent:.1} %, {error_frames} error frames")?;
        for GatewayLine { gateway, counters } in gateways {
            writeln!(out, "{:<12} {}", gateway_name(*gateway), sentence(counters))?;
        }
        Ok(())
    }
}

fn sentence(counters: &GatewayCounters) -> String {
    let GatewayCounters {
        clients, refused, stalled, from_clients, to_clients, dropped, withheld, lost_threads, ..
    } = counters;
    let mut text = format!("{clients} clients; {from_clients} frames from them, {to_clients} to them");
    let losses = [
        (*dropped, "frames dropped"),
        (*withheld, "FD frames withheld"),
        (*refused, "clients refused"),
        (*stalled, "clients that did not read"),
        (*lost_threads, "threads lost"),
    ];
    for (count, what) in losses.iter().filter(|(count, _)| *count > 0) {
        text += &format!("; {count} {what}");
    }
    for (reason, count) in &counters.rejects {
        text += &format!("; {count} times {}", reason.replace('_', " "));
    }
    text
}

fn summary(wall: Span, statistics: &BusStatistics, gateways: &Gateways) -> Summary {
    let lines = gateways.counters().into_iter().map(|(gateway, counters)| GatewayLine { gateway, counters });
    Summary {
        duration_s: wall.s(),
        load: statistics.load(),
        frames: statistics.frames,
        error_frames: statistics.error_frames,
        gateways: lines.collect(),
    }
}

async fn passed(duration_s: Option<f64>) {
    match duration_s.and_then(|duration_s| Duration::try_from_secs_f64(duration_s).ok()) {
        Some(duration) => tokio::time::sleep(duration).await,
        None => core::future::pending().await,
    }
}

/// Prints one line per second on a terminal; never ends.
async fn watch(bus: &SimulatedBus, gateways: &Gateways) {
    if !std::io::stderr().is_terminal() {
        return core::future::pending().await;
    }
    let mut before = bus.statistics();
    let mut second = tokio::time::interval(Duration::from_secs(1));
    loop {
        second.tick().await;
        let now = bus.statistics();
        let counters = gateways.counters();
        let sum = |of: fn(&GatewayCounters) -> u64| counters.iter().map(|(_, counters)| of(counters)).sum::<u64>();
        let (connected, dropped, rejected) = (sum(|c| c.connected), sum(|c| c.dropped), sum(GatewayCounters::rejected));
        let (load_percent, rate) = (100.0 * now.load_since(&before), now.frames - before.frames);
        let line = format!(
            "load {load_percent:5.1} %  {rate} frames/s  {} frames  {connected} clients  {dropped} dropped  {rejected} rejected",
            now.frames
        );
        eprint!("\r{line:<110}");
        before = now;
    }
}
