//! The built-in bench on the virtual clock, with changes; every frame it sends is stored.

use base::clock::{Clock, Virtual};
use base::time::Tai;
use config::{Bench, StartTime};
use frames::report::{FrameEnd, RunLimits};
use frames::sink::{FrameMeta, SentFrame, Sink, SinkError, SinkSummary};
use link::{Port, WireFormat, simulated::simulated_pair};
use run::runtime::virtual_time::{VirtualLoop, World};
use run::runtime::{FrameEngine, Head, PortReading, RunOutcome, RunRecord, error::FarEndError};
use run::{runtime::real_head::Setting, runtime::real_time};
use run::{runtime::receiver::Receiver, wiring::bench_parts};
use std::sync::{Arc, Mutex};
use testbed::flight_computer::{FlightComputer, FlightComputerParams};

/// Results of one run.
pub(crate) struct Run {
    pub(crate) outcome: RunOutcome,
    pub(crate) frames: Vec<Kept>,
    pub(crate) computer: FlightComputer,
}

/// One frame as the sink received it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Kept {
    pub(crate) meta: FrameMeta,
    pub(crate) stars: usize,
    pub(crate) dn_sum: u64,
}

/// A sink that stores its frames, and fails after `space` frames.
struct Keeper {
    frames: Arc<Mutex<Vec<Kept>>>,
    space: usize,
}

impl Sink for Keeper {
    fn name(&self) -> &'static str {
        "keeper"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        let mut frames = self.frames.lock().unwrap();
        if frames.len() == self.space {
            return Err(SinkError::Finished { sink: "keeper", frame: frame.meta.number });
        }
        let dn_sum = frame.image.pixels().iter().enumerate().map(|(i, dn)| (i as u64 + 1) * u64::from(*dn)).sum();
        frames.push(Kept { meta: frame.meta.clone(), stars: frame.truth.len(), dn_sum });
        Ok(())
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        let frames = self.frames.lock().unwrap().len() as u64;
        Ok(SinkSummary { sink: "keeper", frames, refused: 0, bytes: 0, run_crc32: 0, output: None })
    }
}

/// Returns the built-in bench, `seconds` long.
pub(crate) fn built_in(seconds: f64) -> Bench {
    let mut bench = Bench::built_in().unwrap();
    bench.timing.duration_s = seconds;
    bench.render.backend = config::Backend::Cpu;
    bench
}

/// Returns the same bench over another wire, at a rate that carries it.
pub(crate) fn over(wire: WireFormat, seconds: f64) -> Bench {
    let mut bench = built_in(seconds);
    bench.link.wire = wire;
    bench.link.bit_rate = if wire == WireFormat::Serial { 921_600.0 } else { 500_000.0 };
    bench
}

/// Returns when the bench's clock starts.
pub(crate) fn start(bench: &Bench) -> Tai {
    match bench.timing.start {
        StartTime::At(at) => at,
        StartTime::Now | StartTime::Plant => panic!("the built-in bench starts at a fixed time"),
    }
}

/// Runs a bench.
pub(crate) fn run(bench: &Bench) -> Run {
    run_changed(bench, |_| {}, usize::MAX)
}

/// A completed flight: the outcome, and the final state of the two ends.
pub(crate) struct Flight {
    pub(crate) outcome: RunOutcome,
    pub(crate) computer: FlightComputer,
    pub(crate) receiver: Receiver,
}

/// Flies a bench with a changed flight computer into `sink`. `beside` may send more at the computer's end of the cable
/// after each of its steps, and returns when it next needs to.
pub(crate) fn fly(
    bench: &Bench,
    change: impl FnOnce(&mut FlightComputerParams),
    sink: Box<dyn Sink>,
    beside: &mut dyn FnMut(Tai, &FlightComputer, &mut Port) -> Option<Tai>,
) -> Flight {
    let start = start(bench);
    let params = bench_parts::run_params(bench, start).unwrap();
    let mut computer_params = bench_parts::flight_computer(bench, start);
    change(&mut computer_params);
    let mut computer = FlightComputer::new(computer_params);
    let mut head = Head::new(FrameEngine::new(params.clone()).unwrap(), sink);
    let mut receiver = Receiver::new(params.attitude).unwrap();
    let clock = Arc::new(Virtual::new(start));
    let shared: Arc<dyn Clock> = clock.clone();
    let (bus, format) = bench_parts::bus(bench);
    let (near, far) = simulated_pair(bus, &shared);
    let ids = bench.link.ids;
    let (mut near, mut far) = (Port::new(Box::new(near), format, ids), Port::new(Box::new(far), format, ids));
    let mut far_end = |now: Tai| {
        computer.step(now, &mut far)?;
        let due = computer.next_due();
        Ok(beside(now, &computer, &mut far).map_or(due, |wanted| due.min(wanted)))
    };
    let outcome = fly_head(&mut head, &mut receiver, &mut near, &clock, &mut far_end, &mut |_, _| true);
    Flight { outcome, computer, receiver }
}

/// Runs a bench with a changed flight computer and a sink with space for this many frames.
pub(crate) fn run_changed(bench: &Bench, change: impl FnOnce(&mut FlightComputerParams), space: usize) -> Run {
    let frames = Arc::new(Mutex::new(Vec::new()));
    let sink = Box::new(Keeper { frames: Arc::clone(&frames), space });
    let Flight { outcome, computer, .. } = fly(bench, change, sink, &mut |_, _, _| None);
    let frames = frames.lock().unwrap().clone();
    Run { outcome, frames, computer }
}

/// Runs every slot of one head on the virtual clock. `far_end` steps the other end of the cable to an instant and returns
/// when it next has work; `progress` is called after each frame, and returns whether to go on.
pub(crate) fn fly_head(
    head: &mut Head,
    receiver: &mut Receiver,
    port: &mut Port,
    clock: &Arc<Virtual>,
    far_end: &mut dyn FnMut(Tai) -> Result<Tai, FarEndError>,
    progress: &mut dyn FnMut(&SentFrame, &RunRecord) -> bool,
) -> RunOutcome {
    let progress = &mut |_head: usize, frame: &mut SentFrame, record: &RunRecord| progress(frame, record);
    let (heads, mut going) = (core::slice::from_mut(head), VirtualLoop::new(Arc::clone(clock)));
    let mut world = World { port, receiver, far_end, progress };
    let error = going.finish(heads, &mut world).err();
    let ports = vec![PortReading::of(world.port, 0)];
    let outcome = going.end(heads, ports, FrameEnd::Dropped);
    RunOutcome { error: error.or(outcome.error), ..outcome }
}

/// Runs every slot of one head on the bench clock, without other sources than a port. `progress` is called after each
/// frame and must not block.
pub(crate) fn fly_real_head(
    head: &mut Head,
    receiver: &mut Receiver,
    port: Port,
    clock: &Arc<dyn Clock>,
    progress: &mut dyn FnMut(&SentFrame, &RunRecord),
) -> RunOutcome {
    let (limits, stop) = (RunLimits::default(), Arc::default());
    let setting = Setting { clock, stop: &stop, hygiene: None, ring_frames: 0, limits, orders: None };
    let heads = core::slice::from_mut(head);
    real_time::run_in(&setting, heads, receiver, port.into(), &mut |_head, frame, record| progress(frame, record))
}
