//! Frames that the gateways of a run forwarded, lost and refused: rows of the run summary, and their lines in its
//! table.

use crate::report::plain_names::plain_names;
use serde::Serialize;
use std::collections::BTreeMap;

/// Counts of one gateway.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct GatewayRow {
    /// Its kind.
    pub gateway: String,
    /// Address at which it listened.
    pub address: String,
    /// Clients served.
    pub clients: u64,
    /// Clients turned away because all seats were taken.
    pub refused: u64,
    /// Clients dropped because they did not read.
    pub stalled: u64,
    /// Frames from clients.
    pub from_clients: u64,
    /// Frames to clients.
    pub to_clients: u64,
    /// Frames of the bus that a client read too slowly for.
    pub dropped: u64,
    /// FD frames that the protocol cannot carry.
    pub withheld: u64,
    /// Lines and connections refused, by reason.
    pub rejects: BTreeMap<String, u64>,
}

/// The columns of the table beside the name.
pub(super) const HEADINGS: [&str; 6] = ["clients", "refused", "stalled", "from them", "to them", "dropped"];

impl GatewayRow {
    /// Returns the cells under [`HEADINGS`].
    pub(super) fn cells(&self) -> [String; 6] {
        [self.clients, self.refused, self.stalled, self.from_clients, self.to_clients, self.dropped]
            .map(|count| count.to_string())
    }

    /// Returns the lines below its row: where it listened, and a line for each reason.
    pub(super) fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!("  at {}", self.address)];
        if self.withheld > 0 {
            lines.push(format!("  {} FD frames withheld", self.withheld));
        }
        let rejects = plain_names(&self.rejects);
        lines.extend(rejects.iter().map(|(reason, count)| format!("  refused {count} times: {reason}")));
        lines
    }
}

/// Returns a gateway with something in every field.
#[cfg(test)]
pub(super) fn sample_gateway_row() -> GatewayRow {
    GatewayRow {
        gateway: "socketcand".into(),
        address: "127.0.0.1:29536".into(),
        clients: 2,
        refused: 51,
        stalled: 1,
        from_clients: 1234,
        to_clients: 5678,
        dropped: 9,
        withheld: 12,
        rejects: BTreeMap::from([("http_request".into(), 3)]),
    }
}
