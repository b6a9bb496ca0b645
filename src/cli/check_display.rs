//! `starloop check`, displays: when their light leaves against when it was drawn for, and what is not known of them.
//!
//! Input: a bench and the run that was made of it. Output: text. The numbers are those of `run::wiring::display_parts`.

use anyhow::Result;
use base::{time::Span, units::ARCSEC};
use config::{Bench, DisplaySettings, Sink};
use core::fmt::Write;
use outputs::display::{DisplayError, MonitorChoice, MonitorFacts, monitors};
use outputs::display::{calibration::Calibration, latency::LatencySource, monitor::choose};
use run::wiring::display_parts::{CLOCKS_PPM, NO_CALIBRATION, NO_LATENCY, beat, calibrated_display, latency};
use run::{runtime::RunParams, wiring::motion::script_scale};

/// Writes what there is to say of the displays of a bench.
///
/// # Errors
/// When the text cannot grow, or a number of the beat is out of range.
pub(super) fn write_display(
    text: &mut String,
    bench: &Bench,
    params: &RunParams,
    calibration: Option<&Calibration>,
) -> Result<()> {
    let displays = bench.sinks.iter().filter_map(|settings| match &settings.sink {
        Sink::Display(display) => Some(display),
        Sink::Recorder { .. }
        | Sink::SharedMemory { .. }
        | Sink::Iceoryx { .. }
        | Sink::NetworkCamera(_)
        | Sink::Null => None,
    });
    for display in displays {
        write_size(text, display, params)?;
        if display.calibration.is_none() {
            writeln!(text, "  WARNING      {NO_CALIBRATION}")?;
            if params.ahead == Span::ZERO {
                writeln!(
                    text,
                    "  WARNING      timing.ahead_ms is 0: frames are begun when their exposures have ended, and their \
                     light leaves later still"
                )?;
            }
        }
        if latency(display, calibration.filter(|_| display.calibration.is_some())).is_none() {
            writeln!(text, "  WARNING      {NO_LATENCY}")?;
        }
    }
    if let Some(calibration) = calibration {
        write_times(text, bench, params, calibration)?;
    }
    if let Some(beat) = beat(bench)? {
        let word = if beat.is_seen() { "WARNING" } else { "shutter" };
        writeln!(text, "  {word:<12} {}", beat.advice())?;
    }
    Ok(())
}

/// Warns of a monitor that cannot be opened here, or is of another size than the frames: a run refuses it.
fn write_size(text: &mut String, display: &DisplaySettings, params: &RunParams) -> Result<()> {
    if display.params.window_px.is_some() {
        return Ok(());
    }
    let frame_px = params.camera.output().size_px.map(|side| u32::try_from(side).unwrap_or(u32::MAX));
    let fits = monitors().and_then(|found| fits(&found, &display.params.monitor, frame_px));
    if let Err(error) = fits {
        writeln!(text, "  WARNING      {error}")?;
    }
    Ok(())
}

/// Refuses a monitor that is not there, or does not show frames of this size pixel by pixel.
fn fits(found: &[MonitorFacts], choice: &MonitorChoice, image_px: [u32; 2]) -> Result<(), DisplayError> {
    let monitor = &found[choose(found, choice)?];
    if monitor.size_px == image_px {
        return Ok(());
    }
    Err(DisplayError::Size { image_px, place: format!("monitor {}", monitor.name), area_px: monitor.size_px })
}

/// Returns when frames are begun, when their light leaves, and how well that is known.
fn write_times(text: &mut String, bench: &Bench, params: &RunParams, calibration: &Calibration) -> Result<()> {
    let Some(settings) = calibrated_display(bench) else { return Ok(()) };
    let refresh_s = params.frame_period.s();
    let source = match (settings.params.latency, &calibration.latency) {
        (Some(_), _) => "given by latency_ms",
        (None, Some(latency)) if latency.source == LatencySource::Measured => "measured by the calibration",
        (None, Some(_)) => "given to the calibration",
        (None, None) => "not known",
    };
    let latency_ms = latency(settings, Some(calibration)).unwrap_or(Span::ZERO).ms();
    let before_ms = params.ahead.ms() - 1e3 * params.camera.exposure_s;
    writeln!(
        text,
        "  display time a frame is begun {before_ms:.2} ms before its light: 1.5 refreshes of {:.2} ms, up to 8 ms \
         for greys, latency {latency_ms:.2} ms ({source})",
        1e3 * refresh_s
    )?;
    let half_s = 0.5 * refresh_s;
    let off_arcsec = half_s * script_scale(bench).rate_rad_s / ARCSEC;
    writeln!(
        text,
        "               light leaves within +-{:.2} ms of when it was drawn for, {:.2} ms rms: up to {off_arcsec:.2} arcsec \
         in the slew",
        1e3 * half_s,
        1e3 * refresh_s / 12_f64.sqrt()
    )?;
    let slip_s = refresh_s / (CLOCKS_PPM * 1e-6);
    writeln!(
        text,
        "               the bench's clock is not the monitor's: {CLOCKS_PPM} ppm between them show a frame twice, or pass \
         one over, every {slip_s:.0} s"
    )?;
    Ok(())
}

#[cfg(all(test, feature = "display"))]
mod tests {
    use super::*;
    use base::time::Tai;
    use config::Document;
    use run::wiring::bench_parts::run_params;
    use std::path::Path;

    fn reported(text: &str) -> String {
        let bench = Bench::from_document(&Document::from_text(text, Path::new("b.toml"))).unwrap();
        let params = run_params(&bench, Tai::from_ns(0)).unwrap();
        let mut reported = String::new();
        write_display(&mut reported, &bench, &params, None).unwrap();
        reported
    }

    #[test]
    fn unknown_facts_of_a_display_are_listed() {
        let all = reported("[sink]\nkind = \"display\"\n");
        assert!(all.contains("no calibration") && all.contains("ahead_ms is 0") && all.contains("latency"), "{all}");
        let one = reported("[timing]\nahead_ms = 150.0\n[sink]\nkind = \"display\"\nlatency_ms = 20.0\n");
        assert!(one.contains("no calibration") && !one.contains("ahead_ms") && !one.contains("not known"), "{one}");
        assert_eq!(reported(""), "", "a bench without a display");
    }
}

#[cfg(test)]
mod size_tests {
    use super::*;

    #[test]
    fn a_monitor_of_another_size_or_that_is_missing_is_refused() {
        let monitor = |name: &str, size_px| MonitorFacts {
            name: name.into(),
            size_px,
            origin_px: [0, 0],
            refresh_mhz: None,
            is_primary: false,
        };
        let found = [monitor("DP-1", [1920, 1080]), monitor("DP-2", [1024, 1024])];
        let of = |name: &str| fits(&found, &MonitorChoice::Named(name.into()), [1024, 1024]);
        assert_eq!(of("DP-2"), Ok(()));
        let [size, missing] = ["DP-1", "DP-3"].map(|name| of(name).unwrap_err().to_string());
        assert!(size.contains("1024 x 1024") && size.contains("1920 x 1080") && size.contains("DP-1"), "{size}");
        assert!(missing.contains("DP-3"), "{missing}");
    }
}
