//! The end of a flight, on either clock: from what is left of it to its results.

use crate::runtime::{RunOutcome, note_lost_reader};
use crate::wiring::run_end::{Flown, RunEnd};
use crate::wiring::verdict::{CutShort, Promise};
use crate::wiring::{
    assemble::Run, error::LoopError, far_side::FarSide, faults::lock, ports::Cable, run_clock::RunClock,
};
use base::time::Tai;
use frames::report::Losses;

/// How a flight on either clock came down.
pub(super) struct Landing {
    /// The result of its loop.
    pub(super) outcome: RunOutcome,
    pub(super) far: FarSide,
    /// See [`RunEnd`].
    pub(super) promise: Promise,
    /// See [`RunEnd`].
    pub(super) cut_short: Option<CutShort>,
    /// See [`RunEnd`].
    pub(super) was_over: bool,
    /// When it ended.
    pub(super) now: Tai,
    /// See [`RunEnd`].
    pub(super) simulated_s: f64,
    /// The first error beside its loop.
    pub(super) error: Option<LoopError>,
}

impl Run {
    /// Sums up telemetry, faults and invariants of a flight, and closes everything that is open.
    pub(super) fn end(self, landing: Landing) -> RunEnd {
        let Self { times, heads, receiver, desk, taps, mut cable, hygiene, clock, .. } = self;
        let Landing { outcome, mut far, promise, cut_short, was_over, now, simulated_s, error } = landing;
        let RunOutcome { mut record, ports, summaries, sinks: sink_lines, lost_threads, error: of_loop } = outcome;
        let trackers = far.take_trackers().into_iter();
        let (answers, late): (Vec<_>, Vec<_>) = trackers.map(|tracker| tracker.finish(now)).unzip();
        late.into_iter().flatten().for_each(|(event, times)| record.ledger.note_many(event, times));
        let of_frames = heads.iter().map(|head| &head.faults).collect();
        let faults = lock(&desk).lines(of_frames, &|number| far.hits_aboard(number));
        let flown = Flown::of(far.vehicle(), &far.witness.assessment, &heads[0].engine.params);
        let assessment = far.witness.finish(&record, &faults, now);
        let gateways = cable.as_ref().map(Cable::gateway_rows).unwrap_or_default();
        let mut losses = Losses::of_sinks(&sink_lines);
        gateways.iter().for_each(|row| losses.note_gateway(&row.gateway, row.dropped, row.to_clients));
        note_lost_reader(&mut losses, &record.ledger);
        let hygiene = hygiene.filter(|_| matches!(clock, RunClock::Real(_)));
        let mut end = RunEnd {
            times,
            heads,
            receiver,
            record,
            ports,
            summaries,
            sink_lines,
            gateways,
            answers,
            losses,
            hygiene: hygiene.map(|hygiene| hygiene.lines()).unwrap_or_default(),
            assessment,
            faults,
            flown,
            simulated_s,
            promise,
            was_over,
            cut_short,
            error: error.or(of_loop.map(LoopError::from)),
        };
        lost_threads.into_iter().for_each(|name| end.note_lost_thread(name, now));
        (0..cable.as_mut().map_or(0, Cable::close)).for_each(|_| end.note_lost_thread("gateway", now));
        taps.finish(&mut end, now);
        end
    }
}
