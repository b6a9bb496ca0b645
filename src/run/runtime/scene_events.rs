//! Adds missing parts of an exposure's scene to the ledger.

use crate::runtime::ledger::{Event, EventKind, Ledger};
use crate::runtime::slot::Slot;
use base::time::Span;
use scene::SceneReport;

/// Adds an event for each part that a scene lacks, and for each fact that the user must know.
pub(super) fn note(report: &SceneReport, slot: Slot, ledger: &mut Ledger) {
    let SceneReport { is_excluded, shortfall, lost_reader, bodies, lost_targets, evaluated_series, background: _ } =
        *report;
    for (kind, happened) in [
        (EventKind::StarsLate, shortfall.late_tiles > 0),
        (EventKind::StarReaderLost, lost_reader),
        (EventKind::StarsCrowdedOut, shortfall.crowded_out_stars > 0),
        (EventKind::InsideExclusion, is_excluded),
        (EventKind::SunInField, bodies.has_sun),
        (EventKind::CoarseDisc, bodies.coarsest_px > 1.0),
        (EventKind::SeriesOnFrameThread, evaluated_series),
    ] {
        if happened {
            ledger.note(Event::new(kind, slot.release, Some(slot.number), Span::ZERO));
        }
    }
    for _ in 0..lost_targets {
        ledger.note(Event::new(EventKind::TargetLost, slot.release, Some(slot.number), Span::ZERO));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::runtime::slot::Started;
    use base::time::Tai;
    use image::detector::Background;
    use scene::sky_bodies::BodyCounts;
    use stars::tiles::Shortfall;

    #[test]
    fn lost_reader_and_late_series_are_events_with_names_of_their_own() {
        let at = Tai::from_ns(0);
        let slot =
            Slot { number: 3, exposure_start: at, exposure_end: at, release: at, due: at, started: Started::Rate };
        let report = SceneReport {
            background: Background::default(),
            is_excluded: false,
            shortfall: Shortfall { late_tiles: 1, late_stars: 1, crowded_out_stars: 0 },
            lost_reader: true,
            bodies: BodyCounts::default(),
            lost_targets: 0,
            evaluated_series: false,
        };
        let mut ledger = Ledger::default();
        note(&SceneReport { evaluated_series: true, ..report }, slot, &mut ledger);
        assert_eq!(ledger.count(EventKind::SeriesOnFrameThread), 1);
        let mut ledger = Ledger::default();
        note(&report, slot, &mut ledger);
        note(&SceneReport { lost_reader: false, ..report }, slot, &mut ledger);
        let count = |kind| ledger.count(kind);
        assert_eq!((count(EventKind::StarReaderLost), count(EventKind::StarsLate)), (1, 2));
        assert_eq!(count(EventKind::SeriesOnFrameThread), 0);
    }
}
