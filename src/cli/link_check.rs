//! `starloop link-check`: checks a link of this machine against the promises of links, or sends back at one end of it
//! what arrives, or shows the pulses of a PPS source.

use crate::cli::{EXIT_DONE, EXIT_NOT_MET, report_json::print_json};
use anyhow::{Context, Result};
use base::clock::{Clock, Monotonic, PairedReading};
use base::time::{Span, Tai};
use clap::{Args, ValueEnum};
use firmware_protocol::can::IdMap;
use link::conformance::{Check, Ends, check_filters, check_link};
use link::serial::{PseudoTerminal, SerialLink, SerialParams};
use link::simulated::{BusParams, BusTiming, simulated_pair};
use link::socketcan::{Receives, SocketCanLink, SocketCanParams};
use link::{Link, LinkCounters, LinkError, WireFormat, pps::Pps};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// While echoing, counters are printed this often at most, with the age of the last packet when it was read.
const LOOK: Span = Span::from_ms(20);

/// A PPS source is looked at this often.
const PULSE_LOOK: Span = Span::from_ms(100);

/// Command line of `link-check`.
#[derive(Debug, Args)]
pub struct LinkCheckArgs {
    /// Kind of link
    #[arg(long, value_enum, default_value_t = Kind::Simulated)]
    kind: Kind,
    /// CAN interface, such as vcan0
    #[arg(long, value_name = "NAME", required_if_eq("kind", "socketcan"))]
    interface: Option<String>,
    /// CAN FD instead of classic CAN (socketcan, simulated)
    #[arg(long)]
    fd: bool,
    /// Serial port; without it a pseudo terminal of its own
    #[arg(long, value_name = "PATH", conflicts_with = "pty", requires = "other_end")]
    port: Option<PathBuf>,
    /// A pseudo terminal of its own
    #[arg(long)]
    pty: bool,
    /// Interface or port at the other end of the cable (default: the same interface)
    #[arg(long, value_name = "NAME", group = "other_end")]
    peer: Option<String>,
    /// Baud rate of serial ports
    #[arg(long, default_value_t = 115_200)]
    baud: u32,
    /// No checks: send back whatever arrives and print the counters when they change
    #[arg(long, conflicts_with = "peer", group = "other_end")]
    echo: bool,
    /// No checks: show the pulses of a source, such as /sys/class/pps/pps0
    #[arg(long, value_name = "PATH", conflicts_with_all = ["kind", "echo", "peer"])]
    pps: Option<PathBuf>,
    /// With --echo and --pps: seconds until the end
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    duration: f64,
    /// Print the checks as one line of JSON
    #[arg(long, conflicts_with_all = ["echo", "pps"])]
    json: bool,
}

base::words! {
    #[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
    enum Kind {
        /// The bus in memory
        Simulated = "simulated",
        /// CAN through the kernel
        Socketcan = "socketcan",
        /// A serial port
        Serial = "serial",
    }
}

/// Runs the command: exit status 4 when a promise is broken.
///
/// # Errors
/// When the link cannot be opened.
pub fn run(arguments: &LinkCheckArgs) -> Result<u8> {
    let clock: Arc<dyn Clock> = Arc::new(Monotonic::start());
    if let Some(path) = &arguments.pps {
        return pulses(path, arguments.duration, &*clock).map(|()| EXIT_DONE);
    }
    if arguments.echo {
        return echo(arguments, &clock).map(|()| EXIT_DONE);
    }
    // A link that cannot be opened is an error, not a broken promise.
    drop(arguments.ends(&clock)?);
    let mut checks = Vec::new();
    let broken = arguments.check(&clock, &mut checks).err();
    if arguments.json {
        let kept = checks.iter().map(|check| serde_json::json!({ "promise": check.promise, "seen": check.seen }));
        let kept = kept.collect::<Vec<_>>();
        print_json("link-check", serde_json::json!({ "kind": arguments.kind.name(), "kept": kept, "broken": broken }))?;
    } else if let Some(broken) = &broken {
        println!("BROKEN  {broken}");
    }
    Ok(if broken.is_some() { EXIT_NOT_MET } else { EXIT_DONE })
}

impl LinkCheckArgs {
    fn format(&self) -> WireFormat {
        match (self.kind, self.fd) {
            (Kind::Serial, _) => WireFormat::Serial,
            (_, true) => WireFormat::CanFd,
            (_, false) => WireFormat::CanClassic,
        }
    }

    /// Runs the checks and keeps those that hold; prints each of them, unless the report is JSON.
    fn check(&self, clock: &Arc<dyn Clock>, kept: &mut Vec<Check>) -> Result<(), String> {
        let mut keep = |check: Check| {
            if !self.json {
                print_check(&check);
            }
            kept.push(check);
        };
        let report = check_link(&format!("{:?}", self.kind), self.format(), clock, || self.ends(clock))?;
        report.checks.into_iter().for_each(&mut keep);
        if self.kind == Kind::Socketcan {
            keep(check_filters(clock, |ids, receives| self.can(self.interface.as_deref(), ids, receives, clock))?);
        }
        Ok(())
    }

    fn ends(&self, clock: &Arc<dyn Clock>) -> Result<Ends, LinkError> {
        match self.kind {
            Kind::Simulated => Ok(self.simulated(clock)),
            Kind::Socketcan => {
                let ids = IdMap::default();
                let near = self.can(self.interface.as_deref(), ids, Receives::Everything, clock)?;
                let peer = self.peer.as_deref().or(self.interface.as_deref());
                Ok((near, self.can(peer, ids, Receives::Everything, clock)?))
            }
            Kind::Serial => self.serial(clock),
        }
    }

    fn simulated(&self, clock: &Arc<dyn Clock>) -> Ends {
        let timing = match self.format() {
            WireFormat::CanFd => BusTiming::CanFd { arbitration_bps: 1_000_000, data_bps: 8_000_000 },
            WireFormat::CanClassic | WireFormat::Serial | WireFormat::Plain => {
                BusTiming::CanClassic { bit_rate_bps: 1_000_000 }
            }
        };
        let params = BusParams { name: "simulated".into(), timing, latency: Span::ZERO, queue_packets: 2048 };
        let (near, far) = simulated_pair(params, clock);
        (Box::new(near), Box::new(far))
    }

    fn can(
        &self,
        interface: Option<&str>,
        ids: IdMap,
        receives: Receives,
        clock: &Arc<dyn Clock>,
    ) -> Result<Box<dyn Link>, LinkError> {
        let interface = interface.unwrap_or_default().to_owned();
        let params = SocketCanParams { interface, ids, receives, fd: self.fd, bit_rate_switch: true };
        Ok(Box::new(SocketCanLink::open(params, clock)?))
    }

    /// Returns two ports with a cable between them, or a pseudo terminal.
    fn serial(&self, clock: &Arc<dyn Clock>) -> Result<Ends, LinkError> {
        let open = |path| SerialLink::open(SerialParams::new(path, self.baud), clock).map(Box::new);
        match (&self.port, &self.peer) {
            (Some(port), Some(peer)) => Ok((open(port.clone())?, open(peer.into())?)),
            _ => {
                let terminal = PseudoTerminal::open()?;
                let near = open(terminal.path().to_owned())?;
                Ok((near, Box::new(SerialLink::of_terminal(terminal, self.baud, clock))))
            }
        }
    }

    /// Returns the one end that echoes, and what others open to talk to it.
    fn one_end(&self, clock: &Arc<dyn Clock>) -> Result<(Box<dyn Link>, String), LinkError> {
        match (self.kind, &self.port) {
            (Kind::Serial, Some(port)) => {
                let params = SerialParams::new(port, self.baud);
                Ok((Box::new(SerialLink::open(params, clock)?), port.display().to_string()))
            }
            (Kind::Serial, None) => {
                let terminal = PseudoTerminal::open()?;
                let path = terminal.path().display().to_string();
                Ok((Box::new(SerialLink::of_terminal(terminal, self.baud, clock)), path))
            }
            _ => {
                let name = self.interface.as_deref();
                Ok((
                    self.can(name, IdMap::default(), Receives::Everything, clock)?,
                    name.unwrap_or_default().to_owned(),
                ))
            }
        }
    }
}

fn echo(arguments: &LinkCheckArgs, clock: &Arc<dyn Clock>) -> Result<()> {
    anyhow::ensure!(
        arguments.kind != Kind::Simulated,
        "other programs cannot reach a simulated bus; choose another --kind"
    );
    let (mut link, name) = arguments.one_end(clock)?;
    println!("ready {name}");
    let end = clock.now() + Span::from_s(arguments.duration);
    let (mut reported, mut print_at, mut age) = (LinkCounters::default(), clock.now(), Span::ZERO);
    while clock.now() < end {
        if let Some(packet) = link.receive(end.min(clock.now() + LOOK)).context("echo")? {
            age = clock.now() - packet.at;
            link.send(&packet.value).context("echo")?;
        }
        if link.counters() != reported && clock.now() >= print_at {
            reported = link.counters();
            print_at = clock.now() + LOOK;
            println!("{} age_us={:.1}", line(&reported), age.ns() as f64 / 1e3);
        }
    }
    Ok(())
}

/// Returns one line per pulse: where it is on the bench clock, how old it was when read, how far from the one before
/// it.
fn pulses(path: &Path, duration_s: f64, clock: &dyn Clock) -> Result<()> {
    let mut pps = Pps::open(path, PairedReading::take(clock))?;
    println!("ready {}", path.display());
    let end = clock.now() + Span::from_s(duration_s);
    let mut last: Option<Tai> = None;
    while clock.now() < end {
        clock.sleep_until(end.min(clock.now() + PULSE_LOOK));
        let now = PairedReading::take(clock);
        if let Some(at) = pps.poll(now) {
            let (age_us, after_ms) = ((now.bench - at).ns() as f64 / 1e3, last.map_or(0.0, |last| (at - last).ms()));
            println!("pulse at={at} age_us={age_us:.1} after_ms={after_ms:.3}");
            last = Some(at);
        }
    }
    let c = pps.counters();
    println!("pulses={} missed={} refused={} unreadable={}", c.pulses, c.missed, c.refused, c.unreadable);
    Ok(())
}

fn line(c: &LinkCounters) -> String {
    format!(
        "received={} sent={} overflows={} unsent={} errors={} bus_off={} restarted={} unstamped={} lost={} regained={}",
        c.received, c.sent, c.overflows, c.unsent, c.errors, c.bus_off, c.restarted, c.unstamped, c.lost, c.regained
    )
}

fn print_check(check: &Check) {
    println!("held  {:<62}{}", check.promise, check.seen);
}
