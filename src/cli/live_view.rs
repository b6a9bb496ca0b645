//! `--monitor`: the live view beside the sink of a run.

use anyhow::{Context, Result};
use base::clock::{Clock, Monotonic};
use frames::sink::{Sink, Tee};
use outputs::live::{HeadParams, LiveView, Numbers, Params};
use run::runtime::FrameEngine;
use std::net::SocketAddr;
use std::sync::Arc;

/// Starts the view and puts it beside `sink`. Frames are told to it by the sinks' thread, numbers by the frame thread.
///
/// # Errors
/// When nobody can listen at the address.
pub(super) fn beside(
    sink: Box<dyn Sink>,
    (address, names): (SocketAddr, &[String]),
    bench: &str,
    engine: &FrameEngine,
) -> Result<(Box<dyn Sink>, LiveView, Numbers)> {
    // The view tells people when a frame came: its clock is the machine's, also on a simulated bench.
    let clock: Arc<dyn Clock> = Arc::new(Monotonic::start());
    let (view, mut shown, numbers) =
        LiveView::start(Params { names: names.to_vec(), ..params(address, bench, engine) }, clock)
            .context("--monitor")?;
    eprintln!("live view: http://{}/", view.address());
    if view.is_exposed() {
        let address = view.address();
        eprintln!("starloop: the live view at {address} can be reached from other machines, and asks for no password");
    }
    Ok((Box::new(Tee::new(sink, Box::new(shown.remove(0)))), view, numbers))
}

fn params(address: SocketAddr, bench: &str, engine: &FrameEngine) -> Params {
    let run = engine.params();
    let camera = &run.camera;
    let output = camera.output();
    let half_tangent = |axis: usize| {
        let sensor_px = output.size_px[axis] as f64 * f64::from(output.binning);
        sensor_px * camera.geometry.ifov_rad()[axis] / 2.0
    };
    let head = HeadParams {
        name: "head 0".into(),
        camera: Arc::clone(&camera.name),
        size_px: output.size_px,
        field_deg: [0, 1].map(|axis| 2.0 * half_tangent(axis).atan().to_degrees()),
        frame_period_s: run.frame_period.s(),
        readout_s: camera.readout_s,
    };
    Params { address, names: Vec::new(), bench: bench.into(), heads: vec![head] }
}
