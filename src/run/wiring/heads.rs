//! Makes the camera heads of a run, each with its engine, its sink and its faults, and their receiver.
//!
//! In: a scenario and the options of a run. Out: heads, and the trackers' ends of their taps where a spacecraft is
//! flown. Heads share the stars and the almanac. With a calibrated display and a spacecraft inside, each frame is drawn
//! twice: for the display, and as the spacecraft's own tracker sees it.

use crate::runtime::receiver::Receiver;
use crate::runtime::{FrameEngine, Head, Imager, RunParams};
use crate::wiring::display_parts::{calibrated_display, take_display};
use crate::wiring::{bench_parts, bench_parts::script_scale, faults::HeadSize};
use anyhow::{Context, Result};
use base::clock::{Clock, Monotonic};
use base::time::Tai;
use config::{Bench, Plant, Scenario};
use frames::sink::{NullSink, Sink, TapEnd, Tee, tap};
use plan::exposure::cost::CostModel;
use sky::almanac::Almanac;
use stars::Sky;

/// Capacity for frames on their way to a tracker.
const TAP_FRAMES: usize = 8;

/// Returns the sizes of detector and images of a head.
pub(super) fn size_of(head: &Head) -> HeadSize {
    let camera = &head.engine.params.camera;
    HeadSize { size_px: camera.sensor_px(), output_px: camera.output().size_px }
}

/// Returns the receiver of all heads of a run.
pub(super) fn make_receiver(scenario: &Scenario, heads: &[Head]) -> Result<Receiver> {
    let mut params = heads.iter().map(|head| &head.engine.params.attitude);
    let first = params.next().context("a run without a head")?;
    let mut receiver = Receiver::new(first.clone())?.with_session(scenario.bench.session);
    params.try_for_each(|next| receiver.add_head(next))?;
    scenario
        .events
        .iter()
        .filter_map(|event| event.on_trigger)
        .for_each(|number| receiver.session.expect_trigger(number));
    Ok(receiver)
}

/// Returns the costs that were measured on this machine for an imager.
pub type CostsHere<'a> = &'a mut dyn FnMut(&Imager) -> Option<CostModel>;

/// Parameters for making all heads.
pub(super) struct HeadSetting<'a> {
    pub(super) scenario: &'a Scenario,
    /// Start of the run's clock.
    pub(super) start: Tai,
    /// On the real clock, the costs that were measured on this machine.
    pub(super) costs: Option<CostsHere<'a>>,
}

/// Makes the heads of a run, without their sinks.
pub(super) fn make_heads(setting: HeadSetting<'_>) -> Result<Vec<Head>> {
    let HeadSetting { scenario, start, mut costs } = setting;
    let (bench, is_flown) = (&scenario.bench, scenario.vehicle().is_some());
    let draws_twice = is_flown && calibrated_display(bench).is_some();
    let mut prepared = Vec::new();
    for number in 0..bench.head_count() {
        let own = bench_of(scenario, number);
        let mut params = bench_parts::run_params(&own, start)?;
        let for_tracker = draws_twice.then(|| params.clone());
        let calibration = take_display(&mut params, &own, Monotonic::start().now())?;
        // First, because EXPOSURE, which dates the internal tracker's frames, belongs to the first head.
        prepared.extend(for_tracker.map(|params| (own.clone(), params, None, true)));
        prepared.push((own, params, calibration, is_flown && !draws_twice));
    }
    let count = u32::try_from(prepared.len())?;
    let mut shared = Shared::new(prepared.iter().map(|(_, params, ..)| params));
    let mut measured: Option<Option<CostModel>> = None;
    let mut heads = Vec::with_capacity(prepared.len());
    for (own, mut params, calibration, has_tracker) in prepared {
        params.heads = count;
        let imager = bench_parts::imager(&params)?;
        // The virtual clock never uses measurements of this machine, so that its runs repeat everywhere.
        if let Some(costs) = &mut costs {
            let cost = *measured.get_or_insert_with(|| costs(&imager));
            bench_parts::take_real_clock(&mut params, &own, cost);
        }
        let mut engine = shared.engine(params, imager)?.of_head(heads.len());
        if scenario.plant == Plant::FlightComputer {
            engine.pointing.motion = Some(script_scale(bench));
        }
        let (tracker, sink) = with_tap(&engine, has_tracker);
        let (mounting, is_shown) = (own.sensor_from_body, !(draws_twice && has_tracker));
        heads.push(Head { mounting, is_shown, calibration, tracker, ..Head::new(engine, sink) });
    }
    Ok(heads)
}

/// Returns the bench of one head; the jitter of a flown vehicle comes over the bus.
fn bench_of(scenario: &Scenario, number: usize) -> Bench {
    let mut own = scenario.bench.of_head(number);
    if scenario.vehicle().is_some() {
        own.flight_computer.jitter_lines.clear();
    }
    own
}

/// Returns the tracker's end of a tap, and the sink that feeds it, if the head has a tracker.
fn with_tap(engine: &FrameEngine, has_tracker: bool) -> (Option<TapEnd>, Box<dyn Sink>) {
    if !has_tracker {
        return (None, Box::new(NullSink::new()));
    }
    let (sender, end) = tap(engine.params.camera.output().size_px, TAP_FRAMES);
    (Some(end), Box::new(sender))
}

/// Adds a sink for a head's frames before its tracker.
pub(super) fn take_sink(head: &mut Head, sink: Box<dyn Sink>) {
    let own = core::mem::replace(&mut head.sink, Box::new(NullSink::new()));
    head.sink = if head.tracker.is_some() { Box::new(Tee::new(sink, own)) } else { sink };
}

/// Data shared by the heads.
struct Shared {
    almanac: Almanac,
    /// Stars by the limiting magnitude with which they were opened.
    skies: Vec<(f32, Sky)>,
}

impl Shared {
    /// Returns shared data with an almanac over the exposures of all heads.
    fn new<'a>(params: impl Iterator<Item = &'a RunParams>) -> Self {
        let spans = params.map(|params| (params.first_exposure, params.exposure_start(params.frames)));
        let whole = spans.reduce(|whole, own| (whole.0.min(own.0), whole.1.max(own.1)));
        let (from, until) = whole.unwrap_or((Tai::from_ns(0), Tai::from_ns(0)));
        Self { almanac: Almanac::over(from, until), skies: Vec::new() }
    }

    fn engine(&mut self, params: RunParams, imager: Imager) -> Result<FrameEngine> {
        let limiting_mag = params.camera.limiting_mag;
        let place = match self.skies.iter().position(|(mag, _)| mag.total_cmp(&limiting_mag).is_eq()) {
            Some(place) => place,
            None => {
                self.skies.push((limiting_mag, params.open_sky()?));
                self.skies.len() - 1
            }
        };
        Ok(FrameEngine::with_sky(params, imager, &self.skies[place].1, &self.almanac)?)
    }
}
