//! Pairs of ends on one clock.

use base::clock::{Clock, Monotonic};
use base::time::Span;
use starloop_link::conformance::Ends;
use starloop_link::simulated::{BusParams, BusTiming, simulated_pair};
use starloop_link::{LinkError, WireFormat};
use std::sync::Arc;

pub(crate) const FORMATS: [WireFormat; 3] = [WireFormat::CanClassic, WireFormat::CanFd, WireFormat::Serial];

pub(crate) fn clock() -> Arc<dyn Clock> {
    Arc::new(Monotonic::start())
}

pub(crate) fn simulated(format: WireFormat, clock: &Arc<dyn Clock>) -> Result<Ends, LinkError> {
    let timing = match format {
        WireFormat::CanClassic => BusTiming::CanClassic { bit_rate_bps: 1_000_000 },
        WireFormat::CanFd => BusTiming::CanFd { arbitration_bps: 1_000_000, data_bps: 8_000_000 },
        WireFormat::Serial => BusTiming::Serial { baud: 3_000_000 },
        WireFormat::Plain => BusTiming::Datagram { bit_rate_bps: 100_000_000 },
    };
    let params = BusParams { name: "simulated".into(), timing, latency: Span::ZERO, queue_packets: 2048 };
    let (near, far) = simulated_pair(params, clock);
    Ok((Box::new(near), Box::new(far)))
}
