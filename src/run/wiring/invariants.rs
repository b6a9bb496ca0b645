//! The invariants of a run: their names, how often each was checked, and how often it was broken.

use serde::Serialize;

/// Number of broken checks kept in words; further ones are only counted.
const LINES_KEPT: usize = 32;

/// A promise that every run is held to, whatever its file expects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Invariant {
    /// A frame with an interpolated attitude shows the true one.
    FramesShowTheTruth,
    /// Attitudes of frames are unit quaternions.
    UnitAttitudes,
    /// Every fault that acts long enough hits something.
    FaultsHit,
    /// Every scheduled frame goes out or is dropped.
    FramesAreCounted,
    /// The loop points again in time after a fault.
    RecoversFromFaults,
    /// An episode of a campaign ends on target.
    EndsOnTarget,
    /// An episode of a campaign ends in fine pointing.
    EndsInFinePointing,
}

impl Invariant {
    /// Those of every run; a campaign checks [`Self::OF_EPISODE`] as well.
    pub const OF_RUN: [Self; 5] = [
        Self::FramesShowTheTruth,
        Self::UnitAttitudes,
        Self::FaultsHit,
        Self::FramesAreCounted,
        Self::RecoversFromFaults,
    ];
    /// Those of an episode's end.
    pub const OF_EPISODE: [Self; 2] = [Self::EndsOnTarget, Self::EndsInFinePointing];

    /// Returns its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::FramesShowTheTruth => "frames show the true attitude or say that they do not",
            Self::UnitAttitudes => "attitudes of frames are unit quaternions",
            Self::FaultsHit => "each fault hits something",
            Self::FramesAreCounted => "each scheduled frame is delivered or dropped",
            Self::RecoversFromFaults => "on target again in time after each fault",
            Self::EndsOnTarget => "on target at the end",
            Self::EndsInFinePointing => "fine pointing at the end",
        }
    }
}

/// Result of one invariant, for reports.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct InvariantLine {
    /// Its name.
    pub name: &'static str,
    /// Number of checks; 0 where there was nothing to check.
    pub checks: u64,
    /// Number of checks that it did not pass.
    pub violations: u64,
    /// The first of these in words.
    pub first: Option<String>,
}

/// Results of the invariants so far.
#[derive(Debug, Default)]
pub struct Invariants {
    counts: [Count; Invariant::OF_RUN.len() + Invariant::OF_EPISODE.len()],
    lines: Vec<String>,
}

#[derive(Debug, Default)]
struct Count {
    checks: u64,
    violations: u64,
    first: Option<String>,
}

impl Invariants {
    /// Counts one check; `what` says in words how it is broken.
    pub fn check(&mut self, invariant: Invariant, holds: bool, what: impl FnOnce() -> String) {
        let count = &mut self.counts[invariant as usize];
        count.checks += 1;
        if holds {
            return;
        }
        count.violations += 1;
        if count.first.is_none() || self.lines.len() < LINES_KEPT {
            let line = what();
            count.first.get_or_insert_with(|| line.clone());
            if self.lines.len() < LINES_KEPT {
                self.lines.push(line);
            }
        }
    }

    /// Returns the number of broken checks, and the first few in words.
    pub fn violations(&self) -> (u64, &[String]) {
        (self.counts.iter().map(|count| count.violations).sum(), &self.lines)
    }

    /// Returns the results of these invariants.
    pub fn results(&self, of: &[Invariant]) -> Vec<InvariantLine> {
        let line = |invariant: &Invariant| {
            let Count { checks, violations, first } = &self.counts[*invariant as usize];
            InvariantLine { name: invariant.name(), checks: *checks, violations: *violations, first: first.clone() }
        };
        of.iter().map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_invariant_is_counted_by_itself_and_keeps_its_first_words() {
        let mut invariants = Invariants::default();
        for number in 0..50 {
            invariants.check(Invariant::FramesShowTheTruth, false, || format!("frame {number}"));
        }
        invariants.check(Invariant::FaultsHit, true, || unreachable!("it holds"));
        invariants.check(Invariant::EndsOnTarget, false, || "away".into());
        let (count, lines) = invariants.violations();
        assert_eq!((count, lines.len(), lines[0].as_str()), (51, LINES_KEPT, "frame 0"));
        let of = |one: Invariant| invariants.results(&[one]).remove(0);
        let frames = of(Invariant::FramesShowTheTruth);
        assert_eq!((frames.checks, frames.violations, frames.first.as_deref()), (50, 50, Some("frame 0")));
        let faults = of(Invariant::FaultsHit);
        assert_eq!((faults.checks, faults.violations, faults.first), (1, 0, None), "control: it holds");
        assert_eq!(of(Invariant::EndsOnTarget).first.as_deref(), Some("away"), "kept behind many others");
        assert_eq!(of(Invariant::RecoversFromFaults).checks, 0, "nothing to check");
    }

    #[test]
    fn names_and_places_are_one_for_each_invariant() {
        let all = [&Invariant::OF_RUN[..], &Invariant::OF_EPISODE].concat();
        for (place, invariant) in all.iter().enumerate() {
            assert_eq!(*invariant as usize, place, "{invariant:?}");
            assert_eq!(all.iter().filter(|other| other.name() == invariant.name()).count(), 1, "{invariant:?}");
        }
    }
}
