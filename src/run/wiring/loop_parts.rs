//! The stimulator's part of a closed loop, and the bus between its ends; the same on both clocks.

use crate::runtime::error::RunError;
use crate::runtime::frame_faults::FrameFaults;
use crate::runtime::imager::Imager;
use crate::runtime::receiver::Receiver;
use crate::runtime::{FrameEngine, RunParams};
use crate::wiring::bench_parts;
use crate::wiring::closed_loop::LoopError;
use crate::wiring::ports::identifiers;
use base::axes::{Body, Rotation, Sensor};
use base::clock::Clock;
use base::time::Tai;
use config::Scenario;
use frames::sink::{Sink, TapEnd, Tee, tap};
use link::Port;
use link::simulated::simulated_pair;
use link::tap::{FaultControl, FaultyLink};
use sky::almanac::Almanac;
use stars::Sky;
use std::sync::Arc;

/// Frames on their way to a tracker.
const TAP_FRAMES: usize = 8;
/// Streams of the seed, so that faults, frames and sensors do not share numbers.
const BUS_SEED: u64 = 0x6275_7300;

/// One head of the stimulator.
pub(super) struct LoopHead {
    pub(super) engine: FrameEngine,
    pub(super) receiver: Receiver,
    pub(super) sink: Box<dyn Sink>,
    pub(super) faults: FrameFaults,
}

impl LoopHead {
    /// Columns and rows of its detector.
    pub(super) fn size_px(&self) -> [usize; 2] {
        let geometry = &self.engine.params().camera.geometry;
        [geometry.width_px(), geometry.height_px()]
    }

    /// Columns and rows of its images.
    pub(super) fn output_px(&self) -> [usize; 2] {
        self.engine.params().camera.output().size_px
    }
}

/// The stimulator's part of one head, and the tracker's end of its tap. The first head makes what all of them share.
pub(super) fn loop_head(
    scenario: &Scenario,
    number: usize,
    mounting: &Rotation<Sensor, Body>,
    start: Tai,
    sink: Box<dyn Sink>,
    shared: &mut Option<(Sky, Almanac)>,
    change: impl FnOnce(&mut RunParams),
) -> Result<(LoopHead, TapEnd), LoopError> {
    let mut bench = bench_parts::bench_of_head(&scenario.bench, number, *mounting);
    // The jitter of a flown vehicle comes over the bus.
    bench.flight_computer.jitter_lines.clear();
    let mut params = bench_parts::run_params(&bench, start).map_err(|error| LoopError::Parts(format!("{error:#}")))?;
    change(&mut params);
    let size = params.camera.output().size_px;
    let mut receiver = Receiver::new(params.attitude.clone())?.with_session(bench_parts::session_params(&bench));
    scenario.events.iter().filter_map(|event| event.on_trigger).for_each(|number| receiver.expect_trigger(number));
    let engine = engine(params, shared)?;
    let (sender, end) = tap(size, TAP_FRAMES);
    let sink = Box::new(Tee::new(sink, Box::new(sender)));
    Ok((LoopHead { engine, receiver, sink, faults: FrameFaults::default() }, end))
}

fn engine(params: RunParams, shared: &mut Option<(Sky, Almanac)>) -> Result<FrameEngine, RunError> {
    let imager = Imager::of_detector(params.backend, params.camera.make_detector(params.seeds())?)?;
    let (sky, almanac) = match shared {
        Some(shared) => &*shared,
        None => &*shared.insert((params.open_sky()?, params.almanac())),
    };
    FrameEngine::with_sky(params, imager, sky, almanac)
}

/// Both ends of the bus, each behind its faults.
pub(super) fn ports(
    scenario: &Scenario,
    shared: &Arc<dyn Clock>,
    to_stimulator: &FaultControl,
    to_computer: &FaultControl,
) -> Result<(Port, Port), LoopError> {
    let (params, format) = bench_parts::bus(&scenario.bench);
    let (near, far) = simulated_pair(params, shared);
    let seed = scenario.bench.seed ^ BUS_SEED;
    let near = FaultyLink::new(Box::new(near), Arc::clone(shared), to_stimulator.clone(), seed).babbling_as(format);
    let far = FaultyLink::new(Box::new(far), Arc::clone(shared), to_computer.clone(), seed.wrapping_add(1))
        .babbling_as(format);
    let ids = identifiers(&scenario.bench.link).map_err(|error| LoopError::Parts(format!("{error:#}")))?;
    Ok((Port::new(Box::new(near), format, ids), Port::new(Box::new(far), format, ids)))
}
