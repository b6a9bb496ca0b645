//! A bounded ring of values in order of epoch, with the rules of admission that attitude and jitter share.
//!
//! Input: `(epoch, value, received_at)`. Assumes messages arrive nearly in order: an insert that is `k` places out of
//! order moves `k` values.

use crate::attitude::error::HistoryReject;
use base::time::{Span, Tai};
use std::collections::VecDeque;

/// Capacity and time limits of a history.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HistoryLimits {
    /// Largest number of samples; the oldest is removed first. At least 2.
    pub capacity: usize,
    /// Oldest epoch accepted, before the receive time.
    pub max_age: Span,
    /// Latest epoch accepted, after the receive time (clock error plus deliberate lead).
    pub max_lead: Span,
}

impl Default for HistoryLimits {
    /// Returns 1024 samples (10 s at 100 Hz), at most 1 s old, at most 100 ms ahead.
    fn default() -> Self {
        Self { capacity: 1024, max_age: Span::from_ms(1000), max_lead: Span::from_ms(100) }
    }
}

/// Counts of accepted samples, and of refused ones by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct HistoryCounts {
    /// Accepted (in order or not).
    pub accepted: u64,
    /// Accepted, but older than the newest stored one at that time.
    pub out_of_order: u64,
    /// Refused: [`HistoryReject::DuplicateEpoch`].
    pub duplicate_epoch: u64,
    /// Refused: [`HistoryReject::Stale`].
    pub stale: u64,
    /// Refused: [`HistoryReject::Future`].
    pub future: u64,
    /// Refused: [`HistoryReject::NotFinite`].
    pub not_finite: u64,
    /// Refused: [`HistoryReject::TooFast`].
    pub too_fast: u64,
    /// Refused: [`HistoryReject::OlderThanHistory`].
    pub older_than_history: u64,
}

impl HistoryCounts {
    /// Returns the number of all refusals.
    pub fn refused(&self) -> u64 {
        self.duplicate_epoch + self.stale + self.future + self.not_finite + self.too_fast + self.older_than_history
    }

    pub(super) fn count(&mut self, reject: HistoryReject) -> HistoryReject {
        let counter = match reject {
            HistoryReject::DuplicateEpoch => &mut self.duplicate_epoch,
            HistoryReject::Stale => &mut self.stale,
            HistoryReject::Future => &mut self.future,
            HistoryReject::NotFinite => &mut self.not_finite,
            HistoryReject::TooFast => &mut self.too_fast,
            HistoryReject::OlderThanHistory => &mut self.older_than_history,
        };
        *counter += 1;
        reject
    }
}

/// Values in strictly ascending order of epoch, at most the capacity.
#[derive(Debug, Clone)]
pub(super) struct EpochRing<T> {
    slots: VecDeque<(Tai, T)>,
    limits: HistoryLimits,
}

impl<T: Copy> EpochRing<T> {
    pub(super) fn new(limits: HistoryLimits) -> Self {
        let limits = HistoryLimits { capacity: limits.capacity.max(2), ..limits };
        Self { slots: VecDeque::with_capacity(limits.capacity), limits }
    }

    /// Returns the place at which a value of this epoch would be inserted.
    pub(super) fn admit(&self, at: Tai, received_at: Tai) -> Result<usize, HistoryReject> {
        if at < received_at - self.limits.max_age {
            return Err(HistoryReject::Stale);
        }
        if at > received_at + self.limits.max_lead {
            return Err(HistoryReject::Future);
        }
        let place = self.slots.partition_point(|(epoch, _)| *epoch < at);
        if self.slots.get(place).is_some_and(|(epoch, _)| *epoch == at) {
            return Err(HistoryReject::DuplicateEpoch);
        }
        if place == 0 && self.slots.len() >= self.limits.capacity {
            return Err(HistoryReject::OlderThanHistory);
        }
        Ok(place)
    }

    /// Inserts at a place that [`Self::admit`] returned; returns true when the value is now the newest.
    pub(super) fn insert(&mut self, place: usize, at: Tai, value: T) -> bool {
        let is_newest = place == self.slots.len();
        let full = self.slots.len() >= self.limits.capacity;
        if full {
            self.slots.pop_front();
        }
        self.slots.insert(if full { place.saturating_sub(1) } else { place }, (at, value));
        is_newest
    }

    pub(super) fn clear(&mut self) {
        self.slots.clear();
    }

    pub(super) fn len(&self) -> usize {
        self.slots.len()
    }

    pub(super) fn get(&self, place: usize) -> Option<&T> {
        self.slots.get(place).map(|(_, value)| value)
    }

    pub(super) fn oldest(&self) -> Option<&T> {
        self.slots.front().map(|(_, value)| value)
    }

    pub(super) fn newest(&self) -> Option<&T> {
        self.slots.back().map(|(_, value)| value)
    }

    /// Returns the number of values with an epoch of `at` or earlier, which is also the place of the first later one.
    pub(super) fn count_until(&self, at: Tai) -> usize {
        self.slots.partition_point(|(epoch, _)| *epoch <= at)
    }

    pub(super) fn iter(&self) -> impl DoubleEndedIterator<Item = &T> {
        self.slots.iter().map(|(_, value)| value)
    }

    #[cfg(test)]
    pub(super) fn slots_allocated(&self) -> usize {
        self.slots.capacity()
    }
}
