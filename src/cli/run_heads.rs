//! The camera heads of a bench that is run: what draws the frames of each, and what takes them.

use crate::cli::calibrate::costs_here;
use crate::cli::check_attitude::slew_scale;
use crate::cli::run::{ClockKind, RunArgs, stamp};
use anyhow::{Context, Result};
use base::clock::{Clock, Monotonic};
use base::time::Tai;
use config::Bench;
use frames::sink::{SentFrame, Sink};
use outputs::display::calibration::Calibration;
use run::runtime::receiver::Receiver;
use run::runtime::{FrameEngine, real_time, virtual_time};
use run::wiring::bench_parts;
use run::wiring::display_parts::take_display;
use run::wiring::sinks::{SinkSetting, make_sinks, run_directory};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// One head: it draws what it has heard.
pub(super) struct BenchHead {
    pub(super) engine: FrameEngine,
    pub(super) receiver: Receiver,
    /// By which it is drawn for a display, if it is.
    calibration: Option<Calibration>,
}

impl BenchHead {
    /// With what takes its frames in a thread of its own.
    pub(super) fn on_real_clock(&mut self, sink: Box<dyn Sink>) -> real_time::Head<'_> {
        real_time::Head { engine: &mut self.engine, receiver: &mut self.receiver, sink, faults: None }
    }

    /// With what takes its frames when they are read out.
    pub(super) fn on_virtual_clock<'a>(&'a mut self, sink: &'a mut dyn Sink) -> virtual_time::Head<'a> {
        virtual_time::Head { engine: &mut self.engine, receiver: &mut self.receiver, sink, faults: None }
    }
}

/// The heads of a bench whose clock reads `start` when it begins; at least one.
pub(super) fn bench_heads(arguments: &RunArgs, bench: &Bench, start: Tai) -> Result<Vec<BenchHead>> {
    let (mut measured, mut shared) = (None, None);
    let mut heads = Vec::with_capacity(1 + bench.extra_heads.len());
    for (number, mounting) in bench.heads().into_iter().enumerate() {
        let own = bench_parts::bench_of_head(bench, number, mounting);
        let mut params = bench_parts::run_params(&own, start)?;
        let calibration = take_display(&mut params, &own, Monotonic::start().now())?;
        let imager = bench_parts::imager(&params)?;
        // The virtual clock never sees what this machine measured: its runs repeat everywhere.
        if arguments.clock == ClockKind::Real {
            let costs = *measured.get_or_insert_with(|| costs_here(&imager, arguments.built_in_costs).measured);
            bench_parts::take_real_clock(&mut params, &own, costs);
        }
        let receiver = Receiver::new(params.attitude.clone())?.with_session(bench_parts::session_params(&own));
        let (sky, almanac) = match &shared {
            Some(shared) => shared,
            None => &*shared.insert((params.open_sky()?, params.almanac())),
        };
        let mut engine = FrameEngine::with_sky(params, imager, sky, almanac)?;
        engine.expect_motion(slew_scale(bench));
        heads.push(BenchHead { engine, receiver, calibration });
    }
    Ok(heads)
}

/// What takes frames.
pub(super) struct Sinks {
    /// Of each head.
    pub(super) of_heads: Vec<Box<dyn Sink>>,
    /// Of the run, when files are kept.
    pub(super) directory: Option<PathBuf>,
}

/// What takes the frames of each head.
pub(super) fn sinks(arguments: &RunArgs, bench: &Bench, heads: &[BenchHead], clock: &Arc<dyn Clock>) -> Result<Sinks> {
    let settings = arguments.sinks(bench);
    let directory = run_directory(&settings, arguments.out.as_deref(), &stamp(Monotonic::start().now()));
    if let Some(out) = &arguments.out {
        std::fs::create_dir_all(out).with_context(|| format!("--out: cannot make {}", out.display()))?;
    }
    let is_real = arguments.clock == ClockKind::Real;
    let made = heads.iter().enumerate().map(|(number, BenchHead { engine, calibration, .. })| {
        let head = (heads.len() > 1).then_some(number);
        let params = engine.params();
        let camera = &params.camera;
        let [width, height] = camera.output().size_px;
        let prototype = SentFrame::with_capacity(width, height, real_time::STARS_AT_FIRST, camera.name.clone());
        let directory = directory.as_deref().map(|run| directory_of_head(run, head));
        let (directory, prototype, frame_period) = (directory.as_deref(), &prototype, params.frame_period);
        let calibration = calibration.as_ref();
        let setting = SinkSetting { directory, prototype, head, is_real, camera, frame_period, clock, calibration };
        make_sinks(&settings, &setting).with_context(|| head.map_or("the sinks".into(), |head| format!("head {head}")))
    });
    Ok(Sinks { of_heads: made.collect::<Result<_>>()?, directory })
}

/// Where the files of one head lie: several have a directory each.
pub(super) fn directory_of_head(run: &Path, head: Option<usize>) -> PathBuf {
    head.map_or_else(|| run.to_path_buf(), |head| run.join(format!("head{head}")))
}
