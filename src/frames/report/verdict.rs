//! The verdict of a run: one word, and every reason for it, with counts.
//!
//! | word | meaning |
//! |---|---|
//! | `ok` | every frame that the bench promised went out on time, lit by an attitude that was neither held nor missing; no link and no data was lost; all expectations are met |
//! | `LATE` | every frame went out, but some after their deadline |
//! | `INCOMPLETE` | frames are missing, blank or lit by a held attitude; a link was lost; part of the input or of a frame is missing, or contradicts itself |
//! | `LOST` | a sink, a file, a capture or a thread lost data |
//! | `FAILED` | an expectation or an invariant is not met, or an error ended the run |
//!
//! Faults that the bench or its client commands are counted, and do not change the word. Limits of `[expect]` allow
//! some frames; those that were used are named. Tests: below, and `tests/closed_loop/verdicts.rs`.

use crate::report::account::{FrameAccount, FrameEnd};
use base::time::Tai;
use core::fmt;
use serde::{Serialize, Serializer};

base::words! {
    /// First word of a run's verdict; a later one is worse.
    #[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
    pub enum RunWord {
        /// Nothing is missing, late, blank, contradictory or lost.
        #[default]
        Ok = "ok",
        /// Frames went out after their deadline.
        Late = "LATE",
        /// Something is missing or contradicts itself.
        Incomplete = "INCOMPLETE",
        /// Data was lost after it was made.
        Lost = "LOST",
        /// Not what was expected, or ended by an error.
        Failed = "FAILED",
    }
}

impl fmt::Display for RunWord {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(self.name())
    }
}

impl Serialize for RunWord {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

/// One reason why a run is not `ok`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Reason {
    /// The word that it leads to.
    pub word: RunWord,
    /// Name of the end or of the event, as in files.
    pub kind: &'static str,
    /// Number of frames or events.
    pub count: u64,
    /// The reason in words.
    pub text: String,
}

/// A verdict with its reasons.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct RunVerdict {
    /// The word.
    #[serde(rename = "verdict")]
    pub word: RunWord,
    /// Every reason, the worst first.
    pub reasons: Vec<Reason>,
    /// Limits of `[expect]` that were used, in words.
    pub limits_used: Vec<String>,
}

/// Limits of `[expect]` on what may be missing, all heads together; `None` allows nothing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RunLimits {
    /// Late frames.
    pub late: Option<u32>,
    /// Dropped frames.
    pub dropped: Option<u32>,
    /// Frames that are blank before the first attitude or RUN; `None`: [`Self::blank`] counts them too.
    pub blank_at_start: Option<u32>,
    /// Blank frames.
    pub blank: Option<u32>,
    /// Frames with a held attitude.
    pub attitude_held: Option<u32>,
    /// Frames that are never exposed.
    pub not_exposed: Option<u32>,
    /// Losses of a link.
    pub links_lost: Option<u32>,
    /// Times that packets were lost on a link.
    pub packets_lost: Option<u32>,
    /// Frames without a part of their jitter samples.
    pub jitter_missing: Option<u32>,
    /// Late answers of star trackers outside.
    pub answers_late: Option<u32>,
    /// Frames that star trackers outside do not answer.
    pub answers_missing: Option<u32>,
}

impl RunLimits {
    /// Limits that allow anything, as for a run of random faults.
    pub const ANYTHING: Self = Self {
        late: Some(u32::MAX),
        dropped: Some(u32::MAX),
        blank_at_start: Some(u32::MAX),
        blank: Some(u32::MAX),
        attitude_held: Some(u32::MAX),
        not_exposed: Some(u32::MAX),
        links_lost: Some(u32::MAX),
        packets_lost: Some(u32::MAX),
        jitter_missing: Some(u32::MAX),
        answers_late: Some(u32::MAX),
        answers_missing: Some(u32::MAX),
    };

    /// Returns the word that an end leads to, the key of its limit, and the limit; `None` for ends that change no word.
    fn of(&self, end: FrameEnd) -> Option<(RunWord, &'static str, u32)> {
        let (word, key, limit) = match end {
            FrameEnd::OnTime | FrameEnd::Commanded => return None,
            FrameEnd::Late => (RunWord::Late, "late_frames_at_most", self.late),
            FrameEnd::Dropped => (RunWord::Incomplete, "dropped_frames_at_most", self.dropped),
            FrameEnd::BlankAtStart if self.blank_at_start.is_none() => {
                (RunWord::Incomplete, "blank_frames_at_most", self.blank)
            }
            FrameEnd::BlankAtStart => (RunWord::Incomplete, "blank_frames_at_start_at_most", self.blank_at_start),
            FrameEnd::Blank => (RunWord::Incomplete, "blank_frames_at_most", self.blank),
            FrameEnd::AttitudeHeld => (RunWord::Incomplete, "held_attitude_frames_at_most", self.attitude_held),
            FrameEnd::NotExposed => (RunWord::Incomplete, "not_exposed_frames_at_most", self.not_exposed),
        };
        Some((word, key, limit.unwrap_or(0)))
    }
}

impl RunLimits {
    /// Returns the word that an account leads to.
    pub fn word(&self, account: &FrameAccount) -> RunWord {
        let word_of = |end| self.of(end).filter(|(_, _, limit)| account.of(end).count > u64::from(*limit));
        let words = FrameEnd::ALL.into_iter().filter_map(|end| word_of(end).map(|(word, ..)| word));
        words.max().unwrap_or(RunWord::Ok)
    }
}

impl RunVerdict {
    /// Returns the verdict on the frames alone: `zero` is the first exposure, `cause` says why frames ended as they did,
    /// or returns an empty text.
    pub fn of_frames(
        account: &FrameAccount,
        limits: &RunLimits,
        zero: Tai,
        cause: &dyn Fn(FrameEnd) -> String,
    ) -> Self {
        let mut verdict = Self::default();
        for end in FrameEnd::ALL {
            let tally = account.of(end);
            let Some((word, key, limit)) = limits.of(end).filter(|_| tally.count > 0) else { continue };
            if tally.count <= u64::from(limit) {
                verdict.use_limit(&format!("{} {}", tally.count, end.words()), key, limit);
                continue;
            }
            let mut text = format!("{} {}", tally.count, end.words());
            let cause = cause(end);
            if !cause.is_empty() {
                text += &format!(": {cause}");
            }
            if let Some((first, last)) = tally.span {
                text += &spell((first - zero).s(), (last - zero).s());
            }
            if limit > 0 {
                text += &format!(" ({key} = {limit})");
            }
            verdict.add(Reason { word, kind: end.name(), count: tally.count, text });
        }
        verdict
    }

    /// Notes that a limit was used.
    pub fn use_limit(&mut self, what: &str, key: &str, limit: u32) {
        self.limits_used.push(match limit {
            u32::MAX => format!("{what} (any number)"),
            limit => format!("{what} ({key} = {limit})"),
        });
    }

    /// Adds a reason; the worst come first.
    pub fn add(&mut self, reason: Reason) {
        self.word = self.word.max(reason.word);
        let place = self.reasons.partition_point(|other| other.word >= reason.word);
        self.reasons.insert(place, reason);
    }

    /// Returns the reasons on one line.
    pub fn reasons_line(&self) -> String {
        let texts: Vec<&str> = self.reasons.iter().map(|reason| reason.text.as_str()).collect();
        texts.join("; ")
    }
}

/// Returns when something was so, such as ` from 3.2 s to 10.1 s`.
fn spell(first_s: f64, last_s: f64) -> String {
    if last_s - first_s < 0.05 {
        format!(" at {first_s:.1} s")
    } else {
        format!(" from {first_s:.1} s to {last_s:.1} s")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn account(ends: &[(FrameEnd, i64)]) -> FrameAccount {
        let mut account = FrameAccount::NONE;
        ends.iter().for_each(|(end, at_ms)| account.add(*end, Tai::from_ns(at_ms * 1_000_000)));
        account
    }

    fn judge(account: &FrameAccount, limits: &RunLimits) -> RunVerdict {
        let cause = |end| if end == FrameEnd::Blank { "no attitude".into() } else { String::new() };
        RunVerdict::of_frames(account, limits, Tai::from_ns(0), &cause)
    }

    #[test]
    fn only_frames_on_time_and_as_commanded_are_ok() {
        let limits = RunLimits::default();
        for end in FrameEnd::ALL {
            let verdict = judge(&account(&[(FrameEnd::OnTime, 0), (end, 100)]), &limits);
            let wanted = match end {
                FrameEnd::OnTime | FrameEnd::Commanded => RunWord::Ok,
                FrameEnd::Late => RunWord::Late,
                FrameEnd::Dropped
                | FrameEnd::BlankAtStart
                | FrameEnd::Blank
                | FrameEnd::AttitudeHeld
                | FrameEnd::NotExposed => RunWord::Incomplete,
            };
            assert_eq!((verdict.word, limits.word(&account(&[(end, 0)]))), (wanted, wanted), "{end:?}");
            assert_eq!(verdict.reasons.len(), usize::from(wanted != RunWord::Ok), "{end:?}");
        }
    }

    #[test]
    fn reasons_have_count_cause_and_time_and_the_worst_come_first() {
        let frames = account(&[(FrameEnd::Late, 500), (FrameEnd::Blank, 3200), (FrameEnd::Blank, 10_100)]);
        let mut verdict = judge(&frames, &RunLimits::default());
        verdict.add(Reason { word: RunWord::Lost, kind: "sink", count: 1, text: "1 lost by a sink".into() });
        assert_eq!(verdict.word, RunWord::Lost);
        let wanted = "1 lost by a sink; 2 blank: no attitude from 3.2 s to 10.1 s; 1 late at 0.5 s";
        assert_eq!(verdict.reasons_line(), wanted);
        assert_eq!(serde_json::to_value(&verdict).unwrap()["verdict"], "LOST");
    }

    #[test]
    fn limits_that_were_used_are_named_and_one_frame_more_is_a_reason() {
        let frames = account(&[(FrameEnd::Blank, 0), (FrameEnd::Blank, 100)]);
        let allowed = judge(&frames, &RunLimits { blank: Some(2), ..RunLimits::default() });
        assert_eq!(
            (allowed.word, allowed.limits_used.as_slice()),
            (RunWord::Ok, &["2 blank (blank_frames_at_most = 2)".to_string()][..])
        );
        let refused = judge(&frames, &RunLimits { blank: Some(1), ..RunLimits::default() });
        assert_eq!(refused.reasons_line(), "2 blank: no attitude from 0.0 s to 0.1 s (blank_frames_at_most = 1)");
    }
}
