//! Facts about a frame's line of sight: which part of it was extrapolated, the error of the quadratic, missing jitter.
//!
//! In: the report of the path. Out: fields of the frame's metadata, and events where attitudes or jitter samples were
//! missing. Tests: `tests/closed_loop/attitude.rs`, `tests/closed_loop/late_jitter.rs`.

use crate::runtime::ledger::{Event, EventKind, Ledger};
use crate::runtime::slot::Slot;
use base::{time::Span, units::ARCSEC};
use frames::sink::FrameMeta;
use plan::attitude::{PathOrigin, PathReport};

/// Metadata of a frame's line of sight; the default is that of a frame without one.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PathFacts {
    end_horizon: Span,
    outside: Span,
    is_partly_extrapolated: bool,
    residual_rad: f64,
    jitter_missing: Span,
}

impl PathFacts {
    /// Reads the facts from a report. A path that was predicted or held as a whole is marked by its origin instead.
    pub(super) fn of(report: &PathReport, origin: PathOrigin) -> Self {
        Self {
            end_horizon: report.end_horizon,
            outside: report.outside,
            is_partly_extrapolated: origin == PathOrigin::Interpolated && report.is_partly_extrapolated(),
            residual_rad: report.residual_rad,
            jitter_missing: report.jitter.missing,
        }
    }

    /// Adds missing attitudes and samples to the ledger.
    pub(super) fn note(&self, slot: Slot, ledger: &mut Ledger) {
        let mut note = |kind, span| ledger.note(Event::new(kind, slot.release, Some(slot.number), span));
        if self.is_partly_extrapolated {
            note(EventKind::PartlyExtrapolated, self.outside);
        }
        if self.jitter_missing > Span::ZERO {
            note(EventKind::JitterMissing, self.jitter_missing);
        }
    }

    /// Writes the facts into a frame's metadata.
    pub(super) fn describe(&self, meta: &mut FrameMeta) {
        meta.end_horizon = self.end_horizon;
        meta.is_partly_extrapolated = self.is_partly_extrapolated;
        meta.residual_arcsec = self.residual_rad / ARCSEC;
        meta.jitter_missing = self.jitter_missing;
    }
}
