//! `starloop check`, displays: their times, and the stars that a calibrated one cannot show.
//!
//! `starloop check`, displays: when their light leaves against when it was drawn for, and what is not known of them.
//!
//! Input: a bench and the run that was made of it. Output: text. The numbers are those of `run::wiring::display_parts`.

use crate::cli::facts::Facts;
use anyhow::Result;
use base::{time::Span, units::ARCSEC};
use config::{Bench, DisplaySettings, Sink};
use outputs::display::calibration::{Calibrated, Calibration};
use outputs::display::{DisplayError, MonitorChoice, MonitorFacts, monitors};
use outputs::display::{calibration::report::peak_share, latency::LatencySource, monitor::choose};
use plan::exposure::ExposurePlan;
use run::wiring::display_parts::{CLOCKS_PPM, NO_CALIBRATION, NO_LATENCY, beat, calibrated_display, latency};
use run::{runtime::RunParams, wiring::bench_parts::script_scale};

/// Writes what there is to say of the displays of a bench.
///
/// # Errors
/// When a number of the beat is out of range.
pub(super) fn write_display(
    facts: &mut Facts,
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
        write_size(facts, display, params);
        if display.calibration.is_none() {
            facts.warning(NO_CALIBRATION);
            if params.ahead == Span::ZERO {
                facts.warning(
                    "timing.ahead_ms is 0: frames are begun when their exposures have ended, and their light \
                     leaves later still",
                );
            }
        }
        if latency(display, calibration.filter(|_| display.calibration.is_some())).is_none() {
            facts.warning(NO_LATENCY);
        }
    }
    if let Some(calibration) = calibration {
        write_times(facts, bench, params, calibration);
    }
    if let Some(beat) = beat(bench)? {
        if beat.is_seen() {
            facts.warning(beat.advice());
        } else {
            facts.fact("shutter", beat.advice());
        }
    }
    Ok(())
}

/// Warns of a monitor that cannot be opened here, or is of another size than the frames: a run refuses it.
fn write_size(facts: &mut Facts, display: &DisplaySettings, params: &RunParams) {
    if display.params.window_px.is_some() {
        return;
    }
    let frame_px = params.camera.output().size_px.map(|side| u32::try_from(side).unwrap_or(u32::MAX));
    let fits = monitors().and_then(|found| fits(&found, &display.params.monitor, frame_px));
    if let Err(error) = fits {
        facts.warning(error);
    }
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
fn write_times(facts: &mut Facts, bench: &Bench, params: &RunParams, calibration: &Calibration) {
    let Some(settings) = calibrated_display(bench) else { return };
    let refresh_s = params.frame_period.s();
    let source = match (settings.params.latency, &calibration.latency) {
        (Some(_), _) => "given by latency_ms",
        (None, Some(latency)) if latency.source == LatencySource::Measured => "measured by the calibration",
        (None, Some(_)) => "given to the calibration",
        (None, None) => "not known",
    };
    let latency_ms = latency(settings, Some(calibration)).unwrap_or(Span::ZERO).ms();
    let before_ms = params.ahead.ms() - 1e3 * params.camera.exposure_s;
    facts.named("display time").line(format_args!(
        "a frame is begun {before_ms:.2} ms before its light: 1.5 refreshes of {:.2} ms, up to 8 ms for greys, \
         latency {latency_ms:.2} ms ({source})",
        1e3 * refresh_s
    ));
    let half_s = 0.5 * refresh_s;
    let off_arcsec = half_s * script_scale(bench).rate_rad_s / ARCSEC;
    facts.more(format_args!(
        "light leaves within +-{:.2} ms of when it was drawn for, {:.2} ms rms: up to {off_arcsec:.2} arcsec in \
         the slew",
        1e3 * half_s,
        1e3 * refresh_s / 12_f64.sqrt()
    ));
    let slip_s = refresh_s / (CLOCKS_PPM * 1e-6);
    facts.more(format_args!(
        "the bench's clock is not the monitor's: {CLOCKS_PPM} ppm between them show a frame twice, or pass one \
         over, every {slip_s:.0} s"
    ));
}

// `starloop check`, a calibrated display: the stars of a frame that it cannot show as they are.
//
// Input: the run as it is drawn for the display, and its calibration. Output: text. Stars brighter than the display
// are counted as if at rest in the middle of a pixel; stars beyond the outermost dots are where the map is
// extrapolated.

/// Limits of a display: its calibration, and the brightest star that it can show.
pub(super) struct DisplayLimits {
    calibrated: Calibrated,
    /// Electrons, as the run counts them, of a pixel of full grey.
    full_px_e: f64,
    /// Largest share of a star in one pixel.
    peak_share: f64,
    /// The brightest star that is nowhere clipped.
    brightest_mag: f64,
}

/// Returns the limits of the display that `params` are drawn for, if its calibration has fluxes.
///
/// # Errors
/// When a number of the calibration is out of range.
pub(super) fn display_limits(calibration: &Calibration, params: &RunParams) -> Result<Option<DisplayLimits>> {
    let Some(light) = &calibration.light else { return Ok(None) };
    Ok(Some(DisplayLimits {
        calibrated: calibration.calibrated()?,
        full_px_e: params.camera.detector.full_well_e,
        peak_share: peak_share(light.spot_sigma_px),
        brightest_mag: light.brightest_mag,
    }))
}

/// Returns stars of one planned frame that are too bright, or where the map is a guess.
pub(super) fn write_frame_stars(facts: &mut Facts, limits: &DisplayLimits, plan: &ExposurePlan) {
    let DisplayLimits { calibrated, full_px_e, peak_share, brightest_mag } = limits;
    let size_px = [plan.camera.width_px(), plan.camera.height_px()].map(|side| side as f64 - 0.5);
    let is_shown = |[x, y]: [f64; 2]| x > -0.5 && y > -0.5 && x < size_px[0] && y < size_px[1];
    let (mut shown, mut bright, mut beyond) = (0_u32, 0_u32, 0_u32);
    for star in plan.stars.iter().filter(|star| is_shown(star.mean_px)) {
        let px = calibrated.geometry.shown(star.mean_px);
        shown += 1;
        bright += u32::from(star.electrons * peak_share > full_px_e * calibrated.flat.at(px));
        beyond += u32::from(!calibrated.geometry.covered().contains(px));
    }
    let words = format!(
        "{shown} stars on the display: {bright} too bright for it (clipped; up to {brightest_mag:.2} mag fit \
         anywhere), {beyond} beyond the calibrated dots, where the map is a guess"
    );
    if bright + beyond > 0 {
        facts.warning(words);
    } else {
        facts.fact("display", words);
    }
}

#[cfg(all(test, feature = "display"))]
mod display_tests {
    use super::*;
    use base::time::Tai;
    use config::Document;
    use run::wiring::bench_parts::run_params;
    use std::path::Path;

    fn reported(text: &str) -> String {
        let bench = Bench::from_document(&Document::from_text(text, Path::new("b.toml"))).unwrap();
        let params = run_params(&bench, Tai::from_ns(0)).unwrap();
        let mut facts = Facts::indented();
        write_display(&mut facts, &bench, &params, None).unwrap();
        facts.text()
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
