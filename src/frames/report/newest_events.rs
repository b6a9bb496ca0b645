//! The newest events of a run, as plain values of fixed size.
//!
//! In: events, oldest first, from the run's ledger. Out: the last [`NEWEST_MAX`] of them. No allocation, no text. Test:
//! below.

use base::time::{Span, Tai};

/// Number of events that are reported with their times.
pub const NEWEST_MAX: usize = 24;

/// One event of the ledger.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NewestEvent {
    /// Name of its kind.
    pub kind: &'static str,
    /// Name of the fault or thread; empty in events of other kinds.
    pub what: &'static str,
    /// Instant of the event.
    pub at: Tai,
    /// Frame in which it happened.
    pub frame: Option<u32>,
    /// Duration; its meaning depends on the kind.
    pub span: Span,
}

/// The newest events, in the order in which they happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NewestEvents {
    list: [NewestEvent; NEWEST_MAX],
    count: usize,
}

impl NewestEvents {
    /// No event.
    pub const NONE: Self = Self {
        list: [NewestEvent { kind: "", what: "", at: Tai::from_ns(0), frame: None, span: Span::ZERO }; NEWEST_MAX],
        count: 0,
    };

    /// Returns the events, oldest first.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = &NewestEvent> {
        let split = if self.count > NEWEST_MAX { self.count % NEWEST_MAX } else { 0 };
        let (newer, older) = self.list[..self.count.min(NEWEST_MAX)].split_at(split);
        older.iter().chain(newer)
    }
}

impl FromIterator<NewestEvent> for NewestEvents {
    fn from_iter<I: IntoIterator<Item = NewestEvent>>(events: I) -> Self {
        events.into_iter().fold(Self::NONE, |mut newest, event| {
            newest.list[newest.count % NEWEST_MAX] = event;
            newest.count += 1;
            newest
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_ones_are_reported_in_their_order() {
        let event = |frame: u32| NewestEvent { frame: Some(frame), ..NewestEvents::NONE.list[0] };
        for count in [0, 1, NEWEST_MAX, NEWEST_MAX + 1, 2 * NEWEST_MAX, 3 * NEWEST_MAX - 1] {
            let newest: NewestEvents = (0..count as u32).map(event).collect();
            let frames: Vec<u32> = newest.iter().filter_map(|event| event.frame).collect();
            let wanted: Vec<u32> = (count.saturating_sub(NEWEST_MAX) as u32..count as u32).collect();
            assert_eq!(frames, wanted, "{count} events");
        }
    }
}
