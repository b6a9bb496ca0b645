//! Tests that every run works with everything: plants, clocks, heads, taps and links, each with each.
//!
//! A combination runs, or is refused in one sentence for a reason of physics: a bus or a flight computer outside this
//! program has its own time, so the virtual clock cannot control it. The refusals are the list of
//! `src/guide/how_a_run_works.md`.

use config::{Document, Scenario};
use frames::sink::{NullSink, Sink};
use link::{capture::CaptureFormat, serial::PseudoTerminal};
use run::wiring::assemble::{Outputs, Run, RunOptions};
use run::wiring::taps::{CaptureOptions, LiveOptions};
use run::{
    wiring::control::NewestFrames, wiring::run_clock::RunClockKind, wiring::run_end::RunEnd, wiring::steering::Steering,
};
use std::io::{Read, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::{fs::File, os::fd::OwnedFd, path::Path, sync::Arc};

/// Plant that moves the spacecraft.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Who {
    Outside,
    FlightComputer,
    File,
    Vehicle,
}

/// Medium of the bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Bus {
    Simulated,
    Gateways,
    SerialPty,
}

const WHO: [Who; 4] = [Who::Outside, Who::FlightComputer, Who::File, Who::Vehicle];
const BUSES: [Bus; 3] = [Bus::Simulated, Bus::Gateways, Bus::SerialPty];
const CLOCKS: [RunClockKind; 2] = [RunClockKind::Virtual, RunClockKind::Real];

/// Length of a run, s: some frames of each head.
const DURATION_S: f64 = 0.6;

/// Two pseudo terminals whose ends are connected, as a null modem connects two serial ports.
struct NullModem {
    paths: [String; 2],
    over: Arc<AtomicBool>,
    threads: Vec<std::thread::JoinHandle<()>>,
    /// Kept open: without an opener a master reads errors, not silence.
    _ports: [OwnedFd; 2],
}

impl NullModem {
    fn open() -> Self {
        let ends = || PseudoTerminal::open().unwrap().into_ends();
        let ((a, a_port, a_path), (b, b_port, b_path)) = (ends(), ends());
        let (a, b) = (File::from(a), File::from(b));
        let over = Arc::new(AtomicBool::new(false));
        let pairs = [(a.try_clone().unwrap(), b.try_clone().unwrap()), (b, a)];
        let threads = pairs.map(|(from, to)| carry(from, to, Arc::clone(&over)));
        let paths = [a_path, b_path].map(|path| path.display().to_string());
        Self { paths, over, threads: threads.into(), _ports: [a_port, b_port] }
    }
}

/// Copies bytes one way until `over` is set.
fn carry(mut from: File, mut to: File, over: Arc<AtomicBool>) -> std::thread::JoinHandle<()> {
    let forward = move || {
        let mut bytes = [0; 4096];
        while !over.load(Ordering::Relaxed) {
            match from.read(&mut bytes) {
                Ok(count) if count > 0 => to.write_all(&bytes[..count]).unwrap_or_default(),
                _ => std::thread::sleep(std::time::Duration::from_millis(1)),
            }
        }
    };
    std::thread::Builder::new().name("null modem".into()).spawn(forward).unwrap()
}

impl Drop for NullModem {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        self.threads.drain(..).for_each(|thread| thread.join().unwrap());
    }
}

/// Returns the run file of one combination, in the place of the shipped benches.
fn document(who: Who, bus: Bus, heads: usize, (modem, folder): (&NullModem, &Path)) -> Document {
    let history = folder.join("attitude.csv");
    std::fs::write(&history, "0.0, 1, 0, 0, 0\n1.0, 0.9999619, 0.0087265, 0, 0\n").unwrap();
    let replayed = format!("[plant]\nkind = \"file\"\nattitude = \"{}\"\n", history.display());
    let [port, far_port] = &modem.paths;
    let far_port = if who == Who::Outside { String::new() } else { format!("far_port = \"{far_port}\"\n") };
    let link = match bus {
        Bus::Simulated => "[link]\nkind = \"simulated\"\n".to_owned(),
        Bus::Gateways => "[link]\nkind = \"simulated\"\nslcan_tcp = 0\n".to_owned(),
        Bus::SerialPty => format!("[link]\nkind = \"serial\"\nport = \"{port}\"\n{far_port}"),
    };
    let (spacecraft, plant) = match who {
        Who::Outside => ("", "[plant]\nkind = \"outside\"\n"),
        Who::FlightComputer => ("", "[plant]\nkind = \"flight_computer\"\n"),
        Who::File => ("", replayed.as_str()),
        Who::Vehicle => (
            "spacecraft = \"../spacecraft/smallsat.toml\"\n",
            "[plant]\nkind = \"vehicle\"\n[plant.pointing]\nra_deg = 84.0\ndec_deg = -1.2\n[plant.initial]\n\
             attitude = \"given\"\nra_deg = 84.0\ndec_deg = -1.2\n",
        ),
    };
    // The trackers of a vehicle date their frames by the first head's EXPOSURE: its heads share one timing.
    let timing = if who == Who::Vehicle { "" } else { "frame_rate_hz = 5.0\nphase_ms = 30.0\n" };
    let head = format!("[[extra_head]]\nsensor_from_body = [0.0, 1.0, 0.0, 0.0]\n{timing}");
    let text = format!(
        "camera = \"../cameras/small_tracker.toml\"\n{spacecraft}{plant}{link}\
         [timing]\nduration_s = {DURATION_S}\nframe_rate_hz = 10.0\n\
         [observer]\nkind = \"circular_orbit\"\naltitude_km = 550.0\ninclination_deg = 97.6\n\
         [attitude]\nstale_policy = \"blank\"\n[budget]\nrealtime = false\n[render]\nbackend = \"cpu\"\n\
         [[event]]\nat_frame = 2\nfor_frames = 2\ndo = \"frame_bit_flip\"\nbit = 3\ncount = 5\n\
         [expect]\ndropped_frames_at_most = 1000\n{}",
        head.repeat(heads - 1)
    );
    Document::from_text(&text, &Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/benches/matrix.toml"))
}

/// Flies one combination with every tap.
fn fly(document: &Document, clock: RunClockKind, folder: &Path) -> Result<RunEnd, String> {
    let scenario = Scenario::from_document(document).map_err(|error| error.to_string())?;
    let mut sink = |_: usize| Box::new(NullSink::new()) as Box<dyn Sink>;
    let newest = NewestFrames::new(scenario.bench.head_count(), Some(folder));
    let options = RunOptions {
        capture: Some(CaptureOptions {
            directory: folder.join("capture"),
            format: CaptureFormat::Pcapng,
            document,
            settings: &[],
        }),
        live: Some(LiveOptions { address: ([127, 0, 0, 1], 0).into(), names: Vec::new() }),
        steering: (clock == RunClockKind::Real).then(|| Steering::new(newest)),
        clock,
        ..RunOptions::stepped(Outputs::Made(&mut sink))
    };
    let run = Run::assemble(&scenario, options).map_err(|error| format!("{error:#}"))?;
    let mut seen = vec![0_u64; scenario.bench.head_count()];
    let end = run.fly(&Arc::new(AtomicBool::new(false)), &mut |head, _, _| seen[head] += 1);
    let end = end.map_err(|error| format!("{error:#}"))?;
    assert!(end.error.is_none(), "{:?}", end.error.as_ref().map(ToString::to_string));
    if clock == RunClockKind::Real && seen.contains(&0) {
        println!("UNJUDGED: this machine is too busy to draw in time: {seen:?} frames of each head");
    } else {
        assert!(!seen.contains(&0), "every head draws: {seen:?}");
    }
    Ok(end)
}

/// Returns the physical reason for which a combination cannot run, if there is one.
fn refusal(who: Who, bus: Bus, clock: RunClockKind) -> Option<&'static str> {
    match (who, bus, clock) {
        // An external plant needs an entry to the bus.
        (Who::Outside, Bus::Simulated, _) => Some("slcan_tcp, slcan_pty or socketcand"),
        (_, Bus::SerialPty, RunClockKind::Virtual) => Some("a real bus, which has a time of its own"),
        (_, Bus::Gateways, RunClockKind::Virtual) => Some("gateways, which has a time of its own"),
        (Who::Outside | Who::FlightComputer | Who::File | Who::Vehicle, _, _) => None,
    }
}

#[test]
fn every_plant_runs_on_every_bus_and_clock_with_every_tap() {
    let mut flown = 0;
    for who in WHO {
        for bus in BUSES {
            for clock in CLOCKS {
                for heads in [1, 3] {
                    let case = format!("{who:?}, {bus:?}, {clock:?}, {heads} heads");
                    let (folder, modem) = (tempfile::tempdir().unwrap(), NullModem::open());
                    let flight = fly(&document(who, bus, heads, (&modem, folder.path())), clock, folder.path());
                    let Some(reason) = refusal(who, bus, clock) else {
                        let end = flight.unwrap_or_else(|error| panic!("{case}: {error}"));
                        let of_a_head = if who == Who::Vehicle { 6 } else { 3 };
                        judge(&case, &end, 6 + of_a_head * (heads as u64 - 1), folder.path());
                        flown += 1;
                        continue;
                    };
                    let error = flight.err().unwrap_or_else(|| panic!("{case}: wanted a refusal"));
                    assert!(error.contains(reason), "{case}: {error}");
                }
            }
        }
    }
    assert_eq!(flown, 28, "and the others are refused: control of the test itself");
}

fn judge(case: &str, end: &RunEnd, scheduled: u64, folder: &Path) {
    let frames = end.record.frames;
    assert_eq!(frames.scheduled, scheduled, "{case}: {frames:?}");
    assert_eq!(frames.delivered + frames.dropped, frames.scheduled, "{case}: {frames:?}");
    assert!(end.losses.is_empty(), "{case}: {}", end.losses);
    assert_eq!(end.faults.len(), 1, "{case}");
    assert_eq!(end.assessment.violations().1, Vec::<String>::new(), "{case}");
    assert!(end.holds(), "{case}");
    for file in ["session.json", "bus.pcapng", "frames.csv"] {
        assert!(folder.join("capture").join(file).exists(), "{case}: {file}");
    }
}
