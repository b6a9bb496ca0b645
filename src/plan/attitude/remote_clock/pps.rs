//! Pulse per second: edges at whole seconds of the remote clock, with no bus between.
//!
//! Input: local times of edges. Output: a separate offset and drift, which need no hull (a pulse is not queued) and
//! include the bus's constant delay. The time marks determine the second of an edge: they must be right to a quarter of
//! a second. An edge far from its predicted place is left out; three in a row restart the estimate.

use super::kalman::{Trust, TwoState};
use base::{time::Tai, units::NS_PER_S};

/// Largest distance of an edge from a whole second, ns.
const MOST_ERROR_NS: i64 = NS_PER_S / 4;
/// Deviations beyond which an edge is odd, and the smallest such distance, ns.
const ODD_SIGMAS: f64 = 6.0;
const ODD_LEAST_NS: f64 = 20_000.0;
/// Number of odd edges in a row that restart the estimate.
const ODD_FOR_RESTART: u32 = 3;
/// Number of edges needed for an estimate.
const EDGES_FOR_USE: u32 = 2;
/// Holdover time: the estimate expires after this long without an edge, s.
const SILENT_MOST_S: f64 = 10.0;

/// Result for an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObservedPps {
    /// Used.
    Used,
    /// Left out: far from its predicted place.
    Odd,
    /// Left out: more than a quarter of a second from any whole second, according to the time marks.
    Ambiguous,
    /// Left out: no time mark yet determines its second.
    NoTimeYet,
}

/// State of the pulses.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pulses {
    state: Option<TwoState>,
    edges: u32,
    odd_in_a_row: u32,
    sigma_ns: f64,
    walk: f64,
    rate_sigma: f64,
}

impl Pulses {
    pub(super) fn new(sigma_ns: f64, walk: f64, rate_sigma: f64) -> Self {
        Self { state: None, edges: 0, odd_in_a_row: 0, sigma_ns, walk, rate_sigma }
    }

    pub(super) fn clear(&mut self) {
        *self = Self::new(self.sigma_ns, self.walk, self.rate_sigma);
    }

    /// Adds an edge whose remote time according to the marks is `near_remote_ns`.
    pub(super) fn observe(&mut self, local: Tai, near_remote_ns: i64) -> ObservedPps {
        let second_ns = near_remote_ns.saturating_add(NS_PER_S / 2).div_euclid(NS_PER_S).saturating_mul(NS_PER_S);
        if near_remote_ns.saturating_sub(second_ns).saturating_abs() > MOST_ERROR_NS {
            return ObservedPps::Ambiguous;
        }
        let offset_ns = local.ns().saturating_sub(second_ns);
        let Some(state) = self.state else {
            self.begin(second_ns, offset_ns);
            return ObservedPps::Used;
        };
        let there = state.at(second_ns, self.walk);
        let odd_ns = ODD_LEAST_NS + ODD_SIGMAS * there.offset_sigma_ns();
        if there.above_ns(offset_ns).abs() > odd_ns {
            self.odd_in_a_row += 1;
            if self.odd_in_a_row < ODD_FOR_RESTART {
                return ObservedPps::Odd;
            }
            self.begin(second_ns, offset_ns);
            return ObservedPps::Used;
        }
        self.odd_in_a_row = 0;
        self.edges = self.edges.saturating_add(1);
        self.state = Some(there.with_offset(offset_ns, 0.0, self.sigma_ns * self.sigma_ns, Trust::Measurement));
        ObservedPps::Used
    }

    fn begin(&mut self, second_ns: i64, offset_ns: i64) {
        self.state = Some(TwoState::new(second_ns, offset_ns, self.sigma_ns, self.rate_sigma));
        self.edges = 1;
        self.odd_in_a_row = 0;
    }

    /// Returns the offset and drift at a remote time, while edges come.
    pub(super) fn at(&self, remote_ns: i64) -> Option<TwoState> {
        let state = self.state.filter(|_| self.edges >= EDGES_FOR_USE)?;
        let silent_s = remote_ns.saturating_sub(state.at_remote_ns) as f64 * 1e-9;
        (silent_s <= SILENT_MOST_S).then(|| state.at(remote_ns, self.walk))
    }
}
