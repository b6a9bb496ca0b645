//! The numbers of a run under way, as one plain value, which a live view shows beside the frame.
//!
//! In: counts and tallies of the run's record, copied by the frame thread after a frame: no allocation, no text. All
//! are counts since the start, so a value that is lost on the way costs nothing but its age. Size: about 16 KiB.
//! Limits: [`PORTS_MAX`] ports and [`NAMES_MAX`] names each, [`EVENTS_MAX`] kinds of events; what does not fit is
//! counted. Tests: below.

use crate::report::{
    account::FrameAccount, newest_events::NewestEvents, stages::Stage, summary::FrameCounts, time_tally::TimeTally,
    verdict::RunWord,
};

/// Number of ports whose counts are reported.
pub const PORTS_MAX: usize = 4;
/// Named counts in one list of a port.
pub const NAMES_MAX: usize = 48;
/// Kinds of events.
pub const EVENTS_MAX: usize = 72;

/// Counts with names, in the order they were given; a list of fixed length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NamedCounts<const MOST: usize = NAMES_MAX> {
    list: [(&'static str, u64); MOST],
    len: usize,
    left_out: usize,
}

impl<const MOST: usize> NamedCounts<MOST> {
    /// No names.
    pub const NONE: Self = Self { list: [("", 0); MOST], len: 0, left_out: 0 };

    /// Adds a count.
    pub fn push(&mut self, name: &'static str, count: u64) {
        match self.list.get_mut(self.len) {
            Some(place) => {
                *place = (name, count);
                self.len += 1;
            }
            None => self.left_out += 1,
        }
    }

    /// Names and counts.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, u64)> + '_ {
        self.list[..self.len].iter().copied()
    }

    /// Returns the number of names that did not fit.
    pub fn left_out(&self) -> usize {
        self.left_out
    }
}

impl<const MOST: usize> FromIterator<(&'static str, u64)> for NamedCounts<MOST> {
    fn from_iter<I: IntoIterator<Item = (&'static str, u64)>>(counts: I) -> Self {
        let mut all = Self::NONE;
        counts.into_iter().for_each(|(name, count)| all.push(name, count));
        all
    }
}

/// Counts of one port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PortCounts {
    /// Packets, and errors of the link.
    pub counters: NamedCounts,
    /// Messages refused, by reason.
    pub rejects: NamedCounts,
}

impl PortCounts {
    /// A port that has counted nothing.
    pub const NONE: Self = Self { counters: NamedCounts::NONE, rejects: NamedCounts::NONE };
}

/// A run so far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RunNumbers {
    /// Frames in the whole run; `None` when it has no end.
    pub frames_in_run: Option<u64>,
    /// Frames by outcome.
    pub frames: FrameCounts,
    /// Frames by their ends.
    pub account: FrameAccount,
    /// First word of the verdict so far.
    pub word: RunWord,
    /// Wall time per stage, in the order of [`Stage::ALL`].
    pub stages: [TimeTally; Stage::COUNT],
    /// Events of the ledger by kind, zeros included.
    pub events: NamedCounts<EVENTS_MAX>,
    /// The newest events, with their times.
    pub newest: NewestEvents,
    /// Counts per port; those beyond `port_count` are empty.
    pub ports: [PortCounts; PORTS_MAX],
    /// Ports there are.
    pub port_count: usize,
}

impl RunNumbers {
    /// A run in which nothing has happened.
    pub const NONE: Self = Self {
        frames_in_run: None,
        frames: FrameCounts {
            scheduled: 0,
            rendered: 0,
            delivered: 0,
            late: 0,
            held: 0,
            dropped: 0,
            extrapolated: 0,
            partly_extrapolated: 0,
            jitter_missing: 0,
            blank: 0,
        },
        account: FrameAccount::NONE,
        word: RunWord::Ok,
        stages: [TimeTally::EMPTY; Stage::COUNT],
        events: NamedCounts::NONE,
        newest: NewestEvents::NONE,
        ports: [PortCounts::NONE; PORTS_MAX],
        port_count: 0,
    };

    /// Takes in the counts of one port more; beyond [`PORTS_MAX`] ports are only counted.
    pub fn push_port(&mut self, port: PortCounts) {
        if let Some(place) = self.ports.get_mut(self.port_count) {
            *place = port;
        }
        self.port_count += 1;
    }

    /// Returns the number of ports that are not reported.
    pub fn ports_left_out(&self) -> usize {
        self.port_count.saturating_sub(PORTS_MAX)
    }

    /// Returns the ports that are reported.
    pub fn ports(&self) -> &[PortCounts] {
        &self.ports[..self.port_count.min(PORTS_MAX)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_keep_their_order_and_none_is_lost_unseen() {
        let mut counts: NamedCounts = [("sent", 2), ("received", 0)].into_iter().collect();
        assert_eq!(counts.iter().collect::<Vec<_>>(), [("sent", 2), ("received", 0)]);
        (2..NAMES_MAX + 3).for_each(|_| counts.push("more", 1));
        assert_eq!((counts.iter().count(), counts.left_out()), (NAMES_MAX, 3));
    }

    #[test]
    fn ports_beyond_the_capacity_are_left_out() {
        let mut numbers = RunNumbers::NONE;
        (0..PORTS_MAX).for_each(|_| numbers.push_port(PortCounts::NONE));
        assert_eq!((numbers.ports().len(), numbers.ports_left_out()), (PORTS_MAX, 0));
        (0..2).for_each(|_| numbers.push_port(PortCounts::NONE));
        assert_eq!((numbers.ports().len(), numbers.ports_left_out()), (PORTS_MAX, 2));
        assert!(size_of::<RunNumbers>() < 18 * 1024, "{} bytes", size_of::<RunNumbers>());
    }
}
