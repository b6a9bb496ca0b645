//! `[[tracker_in]]` of a bench -> the lines on which star trackers outside answer, each with the reader of its protocol.

use crate::runtime::Head;
use crate::runtime::tracker_in::{TrackerIn, TrackerInParams};
use crate::runtime::tracker_out::{Outlet, OutletError};
use crate::wiring::{error::Result, run_clock::RunClock, tracker_outs::pdo_map};
use base::time::Span;
use config::{AnswerLine, Bench, TrackerIn as Settings, TrackerProtocol};
use frames::sink::{NullSink, Tee};
use link::{gateway::GatewayParams, simulated::SimulatedBus, socketcan::Receives};
use telemetry::reading::Reader;
use telemetry::{Sense, canopen::CanOpenReader, ccsds::CcsdsReader, json::JsonReader, sagitta::SagittaReader};

/// Returns the position and description of each tracker of a bench that answers from outside.
pub fn described_lines(trackers: &[Settings]) -> impl Iterator<Item = (String, String)> {
    trackers.iter().enumerate().map(|(number, tracker)| {
        let (protocol, line, late_ms) = (tracker.protocol.name(), line_name(&tracker.line), tracker.late_after.ms());
        let head = tracker.head;
        let words = format!("{protocol} on {line} answers to head {head}, late {late_ms} ms after mid-exposure");
        (format!("tracker_in[{number}]"), words)
    })
}

fn line_name(line: &AnswerLine) -> String {
    match line {
        AnswerLine::Udp { listen } => format!("udp at {listen}"),
        AnswerLine::Tcp { listen } => format!("tcp at {listen}"),
        AnswerLine::Serial { path, baud } => format!("serial {} at {baud} bit/s", path.display()),
        AnswerLine::SocketCan { interface } => format!("socketcan {interface}"),
        AnswerLine::SlcanTcp { listen, .. } => format!("slcan at {listen}"),
        AnswerLine::Bus => "the run's bus".to_owned(),
    }
}

/// Opens the lines of a bench's trackers outside.
pub(super) fn open_trackers(
    bench: &Bench,
    heads: &mut [Head],
    bus: Option<&SimulatedBus>,
    clock: &RunClock,
) -> Result<Vec<TrackerIn>> {
    // With a display, each head is there twice: as its tracker sees it, and for the display.
    let copies = heads.len().checked_div(bench.head_count()).unwrap_or(1);
    let mut trackers = Vec::with_capacity(bench.tracker_ins.len());
    for (place, settings) in bench.tracker_ins.iter().enumerate() {
        let Some(head) = heads.get_mut(settings.head * copies) else { continue };
        let place = format!("tracker_in[{place}]");
        let node = match settings.protocol {
            TrackerProtocol::CanOpen { node, .. } => Some(node),
            TrackerProtocol::Json
            | TrackerProtocol::Nos3
            | TrackerProtocol::Sagitta
            | TrackerProtocol::Ccsds { .. } => None,
        };
        let outlet = outlet(settings, node, bus, clock).map_err(|error| anyhow::anyhow!("{place}: {error}"))?;
        let engine = &head.engine.params;
        let params = TrackerInParams {
            place,
            protocol: settings.protocol.name(),
            head: settings.head,
            late_after: settings.late_after,
            sigma_rad: settings.sigma_rad,
            due_after: Span::from_ns(Span::from_s(engine.camera.readout_s).ns() - engine.ahead.ns()),
            node,
        };
        let tracker = TrackerIn::new(params, outlet, reader(settings), clock.shared().now());
        let sink = core::mem::replace(&mut head.sink, Box::new(NullSink::new()));
        head.sink = Box::new(Tee::new(sink, tracker.sink()));
        trackers.push(tracker);
    }
    Ok(trackers)
}

fn reader(settings: &Settings) -> Box<dyn Reader> {
    let sense = if settings.is_conjugate { Sense::Conjugate } else { Sense::Starloop };
    match settings.protocol {
        TrackerProtocol::Json | TrackerProtocol::Nos3 => Box::new(JsonReader::new(sense)),
        TrackerProtocol::Sagitta => Box::<SagittaReader>::default(),
        TrackerProtocol::CanOpen { node, pdos, .. } => Box::new(CanOpenReader::new(node, pdo_map(pdos), sense)),
        TrackerProtocol::Ccsds { .. } => Box::new(CcsdsReader::new(sense)),
    }
}

fn outlet(
    settings: &Settings,
    node: Option<u8>,
    bus: Option<&SimulatedBus>,
    clock: &RunClock,
) -> Result<Outlet, OutletError> {
    let clock = clock.shared();
    match &settings.line {
        AnswerLine::Udp { listen } => Outlet::answers(*listen, settings.protocol == TrackerProtocol::Json),
        AnswerLine::Tcp { listen } => Outlet::tcp(*listen, true),
        AnswerLine::Serial { path, baud } => Outlet::serial(path, *baud, &clock),
        AnswerLine::SocketCan { interface } => {
            Outlet::socketcan(interface, Receives::CanOpenMaster(node.unwrap_or_default()), &clock)
        }
        AnswerLine::SlcanTcp { listen, bit_rate } => {
            let gateway = GatewayParams { slcan_tcp: Some(*listen), ..GatewayParams::default() };
            Outlet::slcan(gateway, *bit_rate, &clock)
        }
        AnswerLine::Bus => bus.map(Outlet::bus).ok_or_else(|| OutletError::Unread {
            line: "the run's bus".into(),
            why: "the bench's link is not a simulated CAN bus",
        }),
    }
}
