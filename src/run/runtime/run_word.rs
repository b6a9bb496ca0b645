//! The first word of a run's verdict while it goes on: no allocation, no text, for whoever watches.
//!
//! In: the record so far, with the limits of `[expect]`. Out: a word that is never better than the final one, except that
//! what the bench promised and has not come up yet is not missing. Tests: `tests/closed_loop/verdicts.rs`.

use crate::runtime::ledger::{EventKind, Ledger};
use frames::report::{FrameAccount, RunLimits, RunWord};

/// An event that means that something is missing.
#[derive(Debug, Clone, Copy)]
pub struct Missing {
    /// Its kind.
    pub kind: EventKind,
    /// Words that follow its count.
    pub words: &'static str,
    /// Key of its limit; empty where nothing is allowed.
    pub key: &'static str,
    /// Most such events.
    pub limit: Option<u32>,
}

/// Returns every kind of event that means that something is missing, with its limit.
pub fn missing(limits: &RunLimits) -> [Missing; 11] {
    let never = |kind, words| Missing { kind, words, key: "", limit: None };
    [
        Missing {
            kind: EventKind::JitterMissing,
            words: "frames without a part of their jitter samples",
            key: "jitter_missing_frames_at_most",
            limit: limits.jitter_missing,
        },
        Missing {
            kind: EventKind::LinkOverflow,
            words: "times packets were lost on a link or could not be sent",
            key: "packets_lost_at_most",
            limit: limits.packets_lost,
        },
        never(EventKind::QueueOverflow, "times messages were lost in a full queue"),
        never(EventKind::TriggerEdgeLost, "times edges of trigger lines were lost"),
        never(EventKind::RatesContradict, "rates that contradict the attitudes"),
        never(EventKind::ClockRunsOff, "times the sender's clock ran off: it does not keep real time"),
        never(EventKind::StarsLate, "frames without stars that were read too late"),
        never(EventKind::StarsCrowdedOut, "frames without their faintest stars: more stars than memory"),
        never(EventKind::TargetLost, "targets lost: their orbits could not be followed"),
        never(EventKind::ProtonsLeftOut, "frames with more proton hits than are drawn"),
        never(EventKind::DefectLeftOut, "commanded defects that were not shown: the list was full"),
    ]
}

/// Returns the word so far.
pub(super) fn word_so_far(limits: &RunLimits, ledger: &Ledger, account: &FrameAccount) -> RunWord {
    let is_above = |kind, limit: Option<u32>| ledger.count(kind) > u64::from(limit.unwrap_or(0));
    let lost = [EventKind::SinkDropped, EventKind::SinkRefused, EventKind::SinkLost, EventKind::ThreadLost];
    if lost.iter().any(|kind| ledger.count(*kind) > 0) {
        return RunWord::Lost;
    }
    let is_incomplete = is_above(EventKind::LinkLost, limits.links_lost)
        || missing(limits).iter().any(|missing| is_above(missing.kind, missing.limit));
    let word = if is_incomplete { RunWord::Incomplete } else { RunWord::Ok };
    word.max(limits.word(account))
}
