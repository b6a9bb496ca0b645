//! The links of a checked bench -> the stimulator's ports, and the far end's where it is simulated too.

use crate::base::clock::Clock;
use crate::config::{Bench, Carrier, Link};
use crate::link::{Link as LinkEnd, Port};
use crate::link::simulated::simulated_pair;
use crate::wiring::bench_parts;
use anyhow::{Context, Result, bail};
use firmware_protocol::can::IdMap;
use std::sync::Arc;

/// The ports of a run.
pub struct Ports {
    /// The stimulator's: the bench's link, then its extra links.
    pub near: Vec<Port>,
    /// The simulated flight computer's; `None` for one that is no part of this program.
    pub far: Option<Port>,
}

/// What stands between a link of the stimulator and its port.
pub type Tap<'a> = &'a mut dyn FnMut(Box<dyn LinkEnd>) -> Box<dyn LinkEnd>;

/// Opens every link of a bench; `tap` stands before the first one's port.
///
/// # Errors
/// When a link cannot be opened, with what to try.
pub fn open_ports(bench: &Bench, clock: &Arc<dyn Clock>, tap: Tap<'_>) -> Result<Ports> {
    let wants_far = !bench.flight_computer.is_external;
    let (first, far) = open(&bench.link, wants_far, clock, tap).context("[link]")?;
    let mut near = vec![first];
    for (i, link) in bench.extra_links.iter().enumerate() {
        let (port, _) = open(link, false, clock, &mut |link| link).with_context(|| format!("[[extra_link]] {i}"))?;
        near.push(port);
    }
    Ok(Ports { near, far })
}

fn open(link: &Link, wants_far: bool, clock: &Arc<dyn Clock>, tap: Tap<'_>) -> Result<(Port, Option<Port>)> {
    let ids = identifiers(link)?;
    let (params, format) = bench_parts::bus_of(link);
    match &link.carrier {
        Carrier::Simulated(_) => {
            let (near, far) = simulated_pair(params, clock);
            let far = wants_far.then(|| Port::new(Box::new(far), format, ids));
            Ok((Port::new(tap(Box::new(near)), format, ids), far))
        }
        Carrier::SocketCan { .. } | Carrier::SerialPort(_) => bail!("not yet"),
    }
}

/// The identifiers of a link's node.
///
/// # Errors
/// Never for a checked link.
pub fn identifiers(link: &Link) -> Result<IdMap> {
    IdMap::new(link.id_base, link.node).context("CAN identifiers: node or base out of range")
}

/// Why a bench cannot be run on the virtual clock, if it cannot.
#[must_use]
pub fn needs_real_clock(bench: &Bench) -> Option<&'static str> {
    let has_doors = |link: &Link| matches!(&link.carrier, Carrier::Simulated(doors) if *doors != Default::default());
    let is_real = |link: &Link| !matches!(link.carrier, Carrier::Simulated(_));
    let any = |is: &dyn Fn(&Link) -> bool| core::iter::once(&bench.link).chain(&bench.extra_links).any(is);
    if any(&is_real) {
        Some("a real bus")
    } else if any(&has_doors) {
        Some("gateways")
    } else if bench.flight_computer.is_external {
        Some("an external flight computer")
    } else {
        None
    }
}
