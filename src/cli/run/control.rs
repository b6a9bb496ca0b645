//! `--control`: a run that a program outside steps (virtual clock) or steers (real clock).

use crate::cli::run::report::ScenarioReport;
use anyhow::{Context, Result};
use base::clock::Stopwatch;
use config::Scenario;
use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use frames::sink::SentFrame;
use run::wiring::control::{
    ControlAddress, ControlListener, ControlRefusals, ControlSession, NewestFrames, SessionEnd, Stage, Steered,
};
use run::wiring::run_end::{LoopView, RunEnd};
use run::{runtime::RunRecord, wiring::assemble::Run, wiring::steering::Steering, wiring::stepped::SteppedRun};
use serde_json::Value;
use std::{path::Path, sync::Arc};

/// After the run has ended, a client that has not sent `finish` is waited for so long.
const FINISH_WITHIN: Duration = Duration::from_secs(5);
/// How often that is looked at.
const LOOK: Duration = Duration::from_millis(20);

/// A run that ended, and the client that steered it, when one came.
pub(crate) struct Controlled {
    pub(crate) end: RunEnd,
    pub(crate) client: Option<Client>,
}

/// The client of a run that has ended.
pub(crate) struct Client {
    session: ControlSession,
    end: SessionEnd,
}

impl Client {
    /// Returns whether it ended the run.
    pub(crate) fn asked_to_finish(&self) -> bool {
        matches!(self.end, SessionEnd::Finish(_))
    }

    /// Returns whether it went away before.
    pub(crate) fn is_gone(&self) -> bool {
        self.end == SessionEnd::Gone
    }

    /// Connections that the socket refused, by reason.
    pub(crate) fn refusals(&self) -> &ControlRefusals {
        self.session.refusals()
    }

    /// Sends the last reply to one that waits for it.
    pub(crate) fn close(self, report: Value, status: u8) {
        if let SessionEnd::Finish(id) = self.end {
            self.session.close(id, report, status);
        }
    }
}

/// Listens; prints where and with which token, also when quiet: a port that the system chose is known nowhere else.
pub(crate) fn listen(address: ControlAddress) -> Result<ControlListener> {
    let listener = ControlListener::bind(address)?;
    eprintln!("{}", listener.announcement());
    Ok(listener)
}

/// Makes what a run on the real clock is steered by.
pub(crate) fn steering(scenario: &Scenario, output: Option<&Path>) -> Steering {
    Steering::new(NewestFrames::new(scenario.bench.head_count(), output))
}

/// Runs on the virtual clock, in steps as a client asks.
pub(crate) fn control_stepped(
    listener: ControlListener,
    run: Run,
    output: Option<&Path>,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(usize, &SentFrame, &RunRecord),
) -> Result<Controlled> {
    let scenario = run.scenario.clone();
    let mut going = SteppedRun::of(run)?;
    let Some(mut session) = listener.accept(stop) else {
        return Ok(Controlled { end: going.end(None), client: None });
    };
    let refusals = session.refusals().clone();
    let watch = Stopwatch::start();
    let mut report = |view: &LoopView<'_>| {
        let report = ScenarioReport::of(&scenario, view, watch.elapsed().s(), Some(&refusals));
        serde_json::to_value(report).unwrap_or_default()
    };
    let newest = &mut NewestFrames::new(scenario.bench.head_count(), output);
    let served = session.serve(&mut Stage {
        scenario: &scenario,
        going: &mut going,
        newest,
        report: &mut report,
        progress,
        stop,
    });
    let (client, error) = match served {
        Ok(end @ SessionEnd::Finish(_)) => {
            let error = going.finish_early(&mut |head, frame, record| {
                progress(head, frame, record);
                true
            });
            (Client { session, end }, error.err())
        }
        Ok(end) => (Client { session, end }, None),
        Err(error) => (Client { session, end: SessionEnd::Interrupted }, Some(error)),
    };
    Ok(Controlled { end: going.end(error), client: Some(client) })
}

/// Runs on the real clock beside a client.
pub(crate) fn control_steered(
    listener: ControlListener,
    run: Run,
    steering: Steering,
    stop: &Arc<AtomicBool>,
    progress: &mut dyn FnMut(usize, &SentFrame, &RunRecord),
) -> Result<Controlled> {
    let (scenario, over) = (run.scenario.clone(), Arc::new(AtomicBool::new(false)));
    let is_admitted = Arc::new(AtomicBool::new(false));
    let has_client = Arc::clone(&is_admitted);
    let (end_run, is_over) = (Arc::clone(stop), Arc::clone(&over));
    let serve = move || {
        let mut session = listener.accept(&is_over)?;
        has_client.store(true, Ordering::SeqCst);
        let mut steered = Steered { scenario: &scenario, steering: &steering, over: &is_over };
        let end = session.serve_steered(&mut steered);
        if matches!(end, SessionEnd::Finish(_)) {
            end_run.store(true, Ordering::SeqCst);
        }
        Some(Client { session, end })
    };
    let thread = std::thread::Builder::new().name("control".into()).spawn(serve);
    let thread = thread.context("cannot start the control thread")?;
    let end = run.fly(stop, progress);
    let mut waited = Duration::ZERO;
    let waits = is_admitted.load(Ordering::SeqCst) && end.is_ok();
    while waits && !thread.is_finished() && waited < FINISH_WITHIN && !stop.load(Ordering::SeqCst) {
        std::thread::sleep(LOOK);
        waited += LOOK;
    }
    over.store(true, Ordering::SeqCst);
    let (mut end, joined) = (end?, thread.join());
    if joined.is_err() {
        end.note_lost_thread("control", end.times.end);
    }
    Ok(Controlled { end, client: joined.ok().flatten() })
}
