//! `[[tracker_out]]` of a bench -> trackers beside the sinks of their heads, each with its protocol and its line.
//!
//! In two steps, as a run is put together: taps around the sinks first, then, when the run connects and its clock runs,
//! the lines, the threads of the real clock, or the list that the virtual clock's loop steps.
//!
//! The built-in star trackers beside an external plant: a checked scenario -> a tracker for each head.

use crate::runtime::tracker_out::{
    OutShared, OutThread, Outlet, OutletError, TapParts, Telemeter, TelemeterParams, TrackerEyes, UdpParams,
    tracker_tap,
};
use crate::runtime::{Head, OutsideTracker};
use crate::wiring::error::Result;
use crate::wiring::run_clock::{RunClock, RunTimes};
use crate::wiring::vehicle_parts::{camera_orders, exposed_light, tracker_params};
use base::time::{Span, Tai};
use base::{clock::Clock, refused::Refused};
use config::{OutsideTrackers, Scenario, TrackerLine, TrackerOut, TrackerPdos, TrackerProtocol, TrackerSource};
use frames::camera_control::{CameraDesk, desk};
use frames::sink::NullSink;
use link::{gateway::GatewayParams, simulated::SimulatedBus, socketcan::Receives};
use stars::catalog::Catalog;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use telemetry::canopen::dictionary::{ORESAT, PdoMap, STARLOOP};
use telemetry::canopen::{CanOpenDevice, NodeParams};
use telemetry::{Device, Limits, Sense};
use telemetry::{ccsds::CcsdsDevice, json::JsonDevice, nos3::Nos3Device, sagitta::SagittaDevice};
use testbed::tracker::{GuideStars, StarNoise, Tracker, TrackerParams};
use testbed::tracker_model::{NoiseMethod, TrackerModel};

/// Streams of the seed: one for each tracker of a bench.
const TRACKER_SEED: u64 = 0x7374_0000;

/// A tracker that has its frames and no line yet.
pub(super) struct WaitingOut {
    settings: TrackerOut,
    parts: TapParts,
    shared: Arc<OutShared>,
    eyes: TrackerEyes,
    device: Box<dyn Device>,
    desk: Option<CameraDesk>,
    after_exposure: Span,
    seed: u64,
    folder: Option<PathBuf>,
}

/// The trackers of a run.
#[derive(Default)]
pub(super) struct TrackerOuts {
    /// Those that the virtual clock's loop steps.
    stepped: Vec<Telemeter>,
    notes: Vec<String>,
}

/// Returns why a bench's telemetry needs the real clock, if it does.
pub(super) fn needs_real_clock(outs: &[TrackerOut]) -> Option<&'static str> {
    let is_real = outs.iter().any(|out| !out.line.has_virtual_time());
    is_real
        .then_some("a [[tracker_out]] at a line whose client waits for no simulated time (udp, bus and file have none)")
}

/// Returns the position and description of each tracker of a bench whose telemetry is published.
pub fn described_lines(outs: &[TrackerOut]) -> impl Iterator<Item = (String, String)> {
    outs.iter().enumerate().map(|(number, out)| {
        let source = match out.source {
            TrackerSource::Pixels { most_stars } => format!("the tracker on pixels ({most_stars} stars)"),
            TrackerSource::Model(_) => "the tracker of given errors".to_owned(),
        };
        let rate = out.rate_hz.map_or_else(|| "with each frame".to_owned(), |hz| format!("at {hz} Hz"));
        let (protocol, line, delay_ms) = (out.protocol.name(), line_name(&out.line), out.delay.ms());
        let words = format!("{protocol} on {line}, {rate}, {delay_ms} ms after readout: {source} of head {}", out.head);
        (format!("tracker_out[{number}]"), words)
    })
}

fn line_name(line: &TrackerLine) -> String {
    match line {
        TrackerLine::Udp { to, .. } => format!("udp to {to}"),
        TrackerLine::Tcp { listen } => format!("tcp at {listen}"),
        TrackerLine::Serial { path, baud } => format!("serial {} at {baud} bit/s", path.display()),
        TrackerLine::Pty { path } => format!("pty {}", path.display()),
        TrackerLine::SocketCan { interface } => format!("socketcan {interface}"),
        TrackerLine::SlcanPty { path, .. } => format!("slcan on pty {}", path.display()),
        TrackerLine::SlcanTcp { listen, .. } => format!("slcan at {listen}"),
        TrackerLine::Bus => "the run's bus".to_owned(),
        TrackerLine::File { path } => format!("file {}", path.display()),
    }
}

/// Puts the trackers of a scenario beside the sinks of their heads; `folder` is the run's.
pub(super) fn tap_heads(
    scenario: &Scenario,
    heads: &mut [Head],
    start: Tai,
    folder: Option<&Path>,
) -> Result<Vec<WaitingOut>> {
    let bench = &scenario.bench;
    // With a display, each head is there twice: as its tracker sees it, and for the display.
    let copies = heads.len().checked_div(bench.head_count()).unwrap_or(1);
    let mut guides = Guides::default();
    let mut waiting = Vec::with_capacity(bench.tracker_outs.len());
    for (number, settings) in bench.tracker_outs.iter().enumerate() {
        let own = bench.of_head(settings.head);
        let Some(head) = heads.get_mut(settings.head * copies) else { continue };
        let place = format!("tracker_out[{number}]");
        let shared = Arc::new(OutShared::new(place, settings.protocol.name()));
        let camera = &head.engine.params.camera;
        let (size_px, readout) = (camera.output().size_px, Span::from_s(camera.readout_s));
        let seed = own.seed ^ (TRACKER_SEED + number as u64);
        let (eyes, size_px) = match settings.source {
            TrackerSource::Pixels { most_stars } => {
                let params = tracker_params(&own.camera, most_stars);
                let guide = guides.of(&params, start)?;
                (TrackerEyes::Pixels(Tracker::new(params, guide)), Some(size_px))
            }
            TrackerSource::Model(params) => {
                let stars = match params.noise_method {
                    NoiseMethod::Even => None,
                    NoiseMethod::Stars => {
                        let tracker = tracker_params(&own.camera, params.stars as usize);
                        let light = exposed_light(&own.camera, &tracker);
                        Some(StarNoise::new(&tracker, guides.of(&tracker, start)?, &light))
                    }
                };
                (TrackerEyes::Model(TrackerModel::new(params, stars, seed, start)), None)
            }
        };
        let exposure_s = head.engine.exposing.range().map(|range| range.exposure.map(Span::s));
        let desk = exposure_s.map(|_| {
            let (desk, end) = desk();
            head.engine.exposing.add_desk(end);
            desk
        });
        let device = device(settings, Limits { exposure_s }, own.camera.exposure.exposure_s);
        let sink = core::mem::replace(&mut head.sink, Box::new(NullSink::new()));
        let (tap, parts) = tracker_tap(sink, size_px, Arc::clone(&shared));
        head.sink = Box::new(tap);
        let after_exposure = readout + settings.delay;
        let (settings, folder) = (settings.clone(), folder.map(Path::to_path_buf));
        waiting.push(WaitingOut { settings, parts, shared, eyes, device, desk, after_exposure, seed, folder });
    }
    Ok(waiting)
}

/// Lists of guide stars, which equal trackers share.
#[derive(Default)]
struct Guides {
    made: Vec<(TrackerParams, Arc<GuideStars>)>,
}

impl Guides {
    fn of(&mut self, params: &TrackerParams, start: Tai) -> Result<Arc<GuideStars>> {
        if let Some((_, guide)) = self.made.iter().find(|(known, _)| known == params) {
            return Ok(Arc::clone(guide));
        }
        let catalog = Catalog::built_in().map_err(|why| Refused(format!("catalog: {why}")))?;
        let guide = Arc::new(GuideStars::new(&catalog, params, start)?);
        self.made.push((*params, Arc::clone(&guide)));
        Ok(guide)
    }
}

fn device(settings: &TrackerOut, limits: Limits, exposure_s: f64) -> Box<dyn Device> {
    let sense = if settings.is_conjugate { Sense::Conjugate } else { Sense::Starloop };
    match settings.protocol {
        TrackerProtocol::Json => Box::new(JsonDevice::new(settings.head, sense, limits)),
        TrackerProtocol::Nos3 => Box::new(Nos3Device::new(limits)),
        TrackerProtocol::Sagitta => Box::new(SagittaDevice::new(limits, exposure_s)),
        TrackerProtocol::CanOpen { node, heartbeat_ms, starts_operational, pdos } => {
            let params = NodeParams { node, heartbeat_ms, starts_operational, map: pdo_map(pdos) };
            Box::new(CanOpenDevice::new(params, sense, limits, exposure_s))
        }
        TrackerProtocol::Ccsds { apid } => Box::new(CcsdsDevice::new(apid, sense, limits)),
    }
}

pub(super) fn pdo_map(pdos: TrackerPdos) -> &'static PdoMap {
    match pdos {
        TrackerPdos::Starloop => &STARLOOP,
        TrackerPdos::OreSat => &ORESAT,
    }
}

impl TrackerOuts {
    /// Opens the lines of trackers, and lets them begin.
    pub(super) fn open(
        waiting: Vec<WaitingOut>,
        bus: Option<&SimulatedBus>,
        clock: &RunClock,
        times: RunTimes,
    ) -> Result<Self> {
        let mut outs = Self::default();
        for out in waiting {
            let place = out.shared.place.clone();
            let shared = Arc::clone(&out.shared);
            let outlet = outlet(&out, bus, clock).map_err(|error| anyhow::anyhow!("{place}: {error}"))?;
            write_eds(&out).map_err(|error| anyhow::anyhow!("{place}: {error}"))?;
            outs.notes.push(format!("{place}: {} on {}", shared.protocol, outlet.name()));
            shared.set_output(outlet.name().into());
            let telemeter = out.telemeter(outlet, &clock.shared(), times);
            match clock {
                RunClock::Real(_) => shared.set_thread(OutThread::start(telemeter, clock.shared())?),
                RunClock::Virtual(_) => outs.stepped.push(telemeter),
            }
        }
        Ok(outs)
    }

    /// Where trackers are, for people.
    pub(super) fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Does all that is due by `now` on the virtual clock; when the next thing is due, if anything is.
    pub(super) fn step(&mut self, now: Tai) -> Option<Tai> {
        self.stepped.iter_mut().for_each(|out| out.step(now));
        self.stepped.iter().filter_map(Telemeter::next_due).min()
    }

    /// Sends what waits on the virtual clock.
    pub(super) fn finish(&mut self) {
        self.stepped.iter_mut().for_each(Telemeter::finish);
    }
}

impl WaitingOut {
    fn telemeter(self, outlet: Outlet, clock: &Arc<dyn Clock>, times: RunTimes) -> Telemeter {
        let params = TelemeterParams {
            after_exposure: self.after_exposure,
            tag_error: self.settings.tag_error,
            period: self.settings.rate_hz.map(|hz| Span::from_s(1.0 / hz)),
            zero: times.zero,
            faults: self.settings.faults,
            seed: self.seed,
        };
        let parts = ((self.eyes, self.device), (self.parts, outlet));
        Telemeter::new(params, parts.0, parts.1, self.desk, (Arc::clone(clock), self.shared))
    }
}

/// Writes the EDS file of a CANopen node into the run's folder, where it has one, for its clients.
fn write_eds(out: &WaitingOut) -> std::io::Result<()> {
    let (TrackerProtocol::CanOpen { pdos, .. }, Some(folder)) = (out.settings.protocol, &out.folder) else {
        return Ok(());
    };
    std::fs::create_dir_all(folder)?;
    let map = pdo_map(pdos);
    std::fs::write(folder.join(map.file), map.text())
}

/// Refuses a path of a file that leads through a link out of its folder.
fn refuse_links(folder: &Path, path: &Path) -> Result<(), OutletError> {
    let parents: Vec<&Path> = path.ancestors().skip(1).filter(|parent| !parent.as_os_str().is_empty()).collect();
    let is_link = |parent: &&&Path| folder.join(parent).symlink_metadata().is_ok_and(|data| data.is_symlink());
    match parents.iter().find(is_link) {
        None => Ok(()),
        Some(_) => Err(OutletError::Unread {
            line: format!("file {}", folder.join(path).display()),
            why: "a folder of its path is a link; wanted folders below the run's",
        }),
    }
}

fn outlet(out: &WaitingOut, bus: Option<&SimulatedBus>, clock: &RunClock) -> Result<Outlet, OutletError> {
    let (is_real, clock) = (matches!(clock, RunClock::Real(_)), clock.shared());
    match &out.settings.line {
        TrackerLine::Udp { to, listen } => {
            let are_lines = out.settings.protocol == TrackerProtocol::Json;
            Outlet::udp(UdpParams { to: *to, listen: *listen, has_clients: is_real, are_lines })
        }
        TrackerLine::Tcp { listen } => Outlet::tcp(*listen, out.device.is_polled()),
        TrackerLine::Serial { path, baud } => Outlet::serial(path, *baud, &clock),
        TrackerLine::Pty { path } => Outlet::terminal(path),
        TrackerLine::SocketCan { interface } => {
            let node = if let TrackerProtocol::CanOpen { node, .. } = out.settings.protocol { node } else { 0 };
            Outlet::socketcan(interface, Receives::CanOpenNode(node), &clock)
        }
        TrackerLine::SlcanPty { path, bit_rate } => {
            let gateway = GatewayParams { slcan_pty: Some(path.clone()), ..GatewayParams::default() };
            Outlet::slcan(gateway, *bit_rate, &clock)
        }
        TrackerLine::SlcanTcp { listen, bit_rate } => {
            let gateway = GatewayParams { slcan_tcp: Some(*listen), ..GatewayParams::default() };
            Outlet::slcan(gateway, *bit_rate, &clock)
        }
        TrackerLine::Bus => bus.map(Outlet::bus).ok_or_else(|| OutletError::Unread {
            line: "the run's bus".into(),
            why: "the bench's link is not a simulated CAN bus",
        }),
        TrackerLine::File { path } => {
            let folder = out.folder.clone().unwrap_or_default();
            refuse_links(&folder, path)?;
            Outlet::file(&folder.join(path))
        }
    }
}

/// Returns the tracker of each head, if the scenario has any; equal trackers share one list of guide stars.
pub(super) fn outside_trackers(scenario: &Scenario, start: Tai) -> Result<Vec<Option<OutsideTracker>>> {
    let Some(OutsideTrackers { delay, tag_error, most_stars, commands }) = scenario.trackers else {
        return Ok(Vec::new());
    };
    let mut guides = Guides::default();
    let mut trackers = Vec::with_capacity(scenario.bench.head_count());
    for number in 0..scenario.bench.head_count() {
        let bench = scenario.bench.of_head(number);
        let params = tracker_params(&bench.camera, most_stars);
        let guide = guides.of(&params, start)?;
        let mut tracker = OutsideTracker::new(params, guide, delay, tag_error);
        tracker.set_orders(camera_orders(commands, &bench));
        trackers.push(Some(tracker));
    }
    Ok(trackers)
}
