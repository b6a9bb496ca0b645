//! The cable of a run: the stimulator's ports, the simulated far end's, pulses and gateways, with faults and capture
//! between.
//!
//! A capture contains what the stimulator's ports receive: faults act before it.

use crate::wiring::ports::{Cable, End, open_ports};
use crate::wiring::{bench_parts, error::Result, replay::Recording, run_clock::RunClock};
use config::{Action, Plant, Scenario};
use frames::report::GatewayRow;
use link::Link;
use link::gateway::{GatewayAddress, GatewayCounters, GatewayKind, Gateways};
use link::tap::{FaultControl, FaultyLink};

/// Stream of the seed for faults of the bus, so that faults, frames and sensors do not share numbers.
const BUS_SEED: u64 = 0x6275_7300;

/// Parameters for opening a cable.
pub(super) struct CableSetting<'a> {
    pub(super) scenario: &'a Scenario,
    pub(super) clock: &'a RunClock,
    /// Faults towards the stimulator, and towards the flight computer.
    pub(super) faults: &'a [FaultControl; 2],
    pub(super) recording: Option<&'a Recording>,
    /// True when faults may come during the run.
    pub(super) is_steered: bool,
}

impl Cable {
    /// Opens every link of a run.
    pub(super) fn open(setting: &CableSetting<'_>) -> Result<Self> {
        let bench = &setting.scenario.bench;
        let mut tap = |end, link| setting.tapped(end, link);
        Ok(open_ports(bench, &setting.clock.shared(), &mut tap)?)
    }

    /// Returns the counters of the gateways, for the summary of a run.
    pub(super) fn gateway_rows(&self) -> Vec<GatewayRow> {
        gateway_rows(&self.gateways)
    }

    /// Closes the gateways; returns the number of their threads that ended early.
    pub(super) fn close(&mut self) -> u64 {
        self.gateways.iter_mut().map(Gateways::finish).sum()
    }

    /// Returns where to reach the gateways and plain links, and whether other machines can reach them.
    pub(super) fn notes(&self) -> Vec<String> {
        self.notes.iter().cloned().chain(self.gateways.iter().flat_map(gateway_notes)).collect()
    }
}

impl CableSetting<'_> {
    /// Inserts faults and the capture between a link and its port, where the run may need them.
    fn tapped(&self, end: End, link: Box<dyn Link>) -> Box<dyn Link> {
        let [to_stimulator, to_computer] = self.faults;
        let seed = self.scenario.bench.seed ^ BUS_SEED;
        match end {
            End::Near(0) if self.may_be_faulty() => {
                let faulty = self.faulty(link, to_stimulator, seed);
                // An external flight computer receives packets outside this program: faults towards it must act when
                // sending.
                let is_outside = self.scenario.plant == Plant::Outside;
                let faulty = if is_outside { faulty.losing_sent(to_computer.clone()) } else { faulty };
                self.captured(0, Box::new(faulty))
            }
            End::Near(number) => self.captured(number, link),
            End::Far if self.may_be_faulty() => Box::new(self.faulty(link, to_computer, seed.wrapping_add(1))),
            End::Far => link,
        }
    }

    fn faulty(&self, link: Box<dyn Link>, control: &FaultControl, seed: u64) -> FaultyLink {
        let (_, format) = bench_parts::bus(&self.scenario.bench);
        FaultyLink::new(link, self.clock.shared(), control.clone(), seed).babbling_as(format)
    }

    fn captured(&self, number: usize, link: Box<dyn Link>) -> Box<dyn Link> {
        match self.recording {
            Some(recording) => recording.tap(link, number),
            None => link,
        }
    }

    fn may_be_faulty(&self) -> bool {
        let is_of_bus = |action: &Action| matches!(action, Action::Bus(_) | Action::BusBackLoss { .. });
        let has_faults = self.scenario.events.iter().any(|event| is_of_bus(&event.action));
        has_faults || self.is_steered || self.scenario.vehicle().is_some()
    }
}

/// Returns where external programs reach a bus, and which of its gateways other machines can reach.
pub fn gateway_notes(gateways: &Gateways) -> Vec<String> {
    let addresses = gateways.addresses();
    let place =
        |(kind, address): &(GatewayKind, GatewayAddress)| format!("gateway: {} at {address}", gateway_name(*kind));
    let exposed = addresses.iter().filter(|(_, address)| address.is_exposed()).map(|(kind, address)| {
        let name = gateway_name(*kind);
        format!("starloop: {name} at {address} can be reached from other machines, and asks for no password")
    });
    addresses.iter().map(place).chain(exposed).collect()
}

/// Returns the counters of gateways, for a summary.
pub fn gateway_rows(gateways: &[Gateways]) -> Vec<GatewayRow> {
    let row = |((kind, address), (_, counters)): ((GatewayKind, GatewayAddress), (GatewayKind, GatewayCounters))| {
        let rejects = counters.rejects.iter().map(|(reason, count)| ((*reason).to_owned(), *count));
        GatewayRow {
            gateway: gateway_name(kind).into(),
            address: address.to_string(),
            clients: counters.clients,
            refused: counters.refused,
            stalled: counters.stalled,
            from_clients: counters.from_clients,
            to_clients: counters.to_clients,
            dropped: counters.dropped,
            withheld: counters.withheld,
            rejects: rejects.collect(),
        }
    };
    gateways.iter().flat_map(|of_link| of_link.addresses().into_iter().zip(of_link.counters())).map(row).collect()
}

/// Returns the name of a gateway kind for reports.
pub fn gateway_name(kind: GatewayKind) -> &'static str {
    match kind {
        GatewayKind::SlcanTcp => "slcan (TCP)",
        GatewayKind::SlcanPty => "slcan (PTY)",
        GatewayKind::Socketcand => "socketcand",
    }
}
