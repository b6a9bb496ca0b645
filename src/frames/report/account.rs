//! The end of each frame that a bench promised: every frame has one, and the counts add up.
//!
//! In: the end of each slot, as it is decided. Out: counts with their first and last instants. No allocation, so that
//! the frame thread can count. Tests: below, and `tests/closed_loop/verdicts.rs`.

use base::time::Tai;
use serde::ser::{Serialize, SerializeMap, Serializer};

base::words! {
    /// The end of a frame, by its name in files.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum FrameEnd {
        /// It went out on time, lit by an attitude that was neither held nor missing.
        OnTime = "on_time",
        /// It went out after its deadline, or an older image went out in its place.
        Late = "late",
        /// It did not go out.
        Dropped = "dropped",
        /// It is blank because nothing has arrived yet to light it: no attitude, or no RUN.
        BlankAtStart = "blank_at_start",
        /// It is blank because the attitudes stopped, or a peer of another version stopped the session.
        Blank = "blank",
        /// It shows the last attitude: no newer one came in time.
        AttitudeHeld = "attitude_held",
        /// A fault or a client that the bench obeys wanted it so: dropped, delayed, blank or not exposed.
        Commanded = "commanded",
        /// The bench promised it, and it was never exposed.
        NotExposed = "not_exposed",
    }
}

impl FrameEnd {
    /// Returns the words that follow a count.
    pub const fn words(self) -> &'static str {
        match self {
            Self::OnTime => "on time",
            Self::BlankAtStart => "blank at the start",
            Self::AttitudeHeld => "with a held attitude",
            Self::Commanded => "missing as commanded",
            Self::NotExposed => "not exposed",
            Self::Late | Self::Dropped | Self::Blank => self.name(),
        }
    }
}

/// A count with its first and last instants.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tally {
    /// Number of frames.
    pub count: u64,
    /// First and last instant; `None` where no frame has one.
    pub span: Option<(Tai, Tai)>,
}

/// Frames of a run, counted by their ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameAccount {
    tallies: [Tally; FrameEnd::ALL.len()],
}

impl FrameAccount {
    /// Nothing counted.
    pub const NONE: Self = Self { tallies: [Tally { count: 0, span: None }; FrameEnd::ALL.len()] };

    /// Counts a frame; `at` is the start of its exposure.
    pub fn add(&mut self, end: FrameEnd, at: Tai) {
        let tally = &mut self.tallies[end as usize];
        tally.count += 1;
        tally.span = Some(tally.span.map_or((at, at), |(first, last)| (first.min(at), last.max(at))));
    }

    /// Counts frames that have no instant.
    pub fn add_many(&mut self, end: FrameEnd, count: u64) {
        self.tallies[end as usize].count += count;
    }

    /// Returns the frames with this end.
    pub fn of(&self, end: FrameEnd) -> Tally {
        self.tallies[end as usize]
    }

    /// Returns the number of all frames: those that the bench promised, once its run has ended.
    pub fn scheduled(&self) -> u64 {
        self.tallies.iter().map(|tally| tally.count).sum()
    }
}

/// Writes `scheduled` and the count of each end.
impl Serialize for FrameAccount {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(FrameEnd::ALL.len() + 1))?;
        map.serialize_entry("scheduled", &self.scheduled())?;
        for end in FrameEnd::ALL {
            map.serialize_entry(end.name(), &self.of(end).count)?;
        }
        map.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_add_up_and_know_their_first_and_last_instant() {
        let mut account = FrameAccount::NONE;
        for (i, end) in FrameEnd::ALL.into_iter().enumerate() {
            account.add(end, Tai::from_ns(i as i64));
        }
        account.add(FrameEnd::Blank, Tai::from_ns(90));
        account.add(FrameEnd::Blank, Tai::from_ns(70));
        account.add_many(FrameEnd::NotExposed, 5);
        assert_eq!(account.scheduled(), 8 + 2 + 5);
        let blank = account.of(FrameEnd::Blank);
        assert_eq!(blank, Tally { count: 3, span: Some((Tai::from_ns(4), Tai::from_ns(90))) });
        let json = serde_json::to_value(account).unwrap();
        let sum: u64 = FrameEnd::ALL.iter().map(|end| json[end.name()].as_u64().unwrap()).sum();
        assert_eq!(json["scheduled"], sum, "what is written adds up too");
    }
}
