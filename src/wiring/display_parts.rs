//! A calibrated display -> the camera that the renderer draws with, and what makes greys of its frames.
//!
//! In: a run's parameters with the tracker's camera, and `[sink] kind = "display"` with a calibration file. Out: the same
//! run, drawn for the display: directions go to display pixels by the calibrated map, so that stars are placed by moving
//! their centroids; a frame is one refresh, with the motion in it integrated; it is begun so early that its light leaves
//! the display when the attitude in it holds: drawing (one refresh) and latency before the refresh begins. Pixel values are
//! codes of luminance ([`crate::display::luminance_code`]), 65535 the most that the display has. Without a calibration frames go to the display as they are, and the
//! program says so.
//!
//! Limits: stars are Gaussians of [`SPOT_SIGMA_PX`] on the display, whatever the tracker's own PSF is, which comes on top;
//! the sky's background is not shown, as a display's black is brighter; light by `[band]` or a grey mapping is refused.
//! Shot noise of what is drawn stays below [`NOISE_LUMINANCE`] of the full luminance. Tests: below, and
//! `tests/closed_loop/display.rs` over a simulated flight computer.

use crate::base::time::{Span, Tai};
use crate::config::{Bench, DisplaySettings, Sink};
use crate::detector::{DetectorParams, Nonlinearity, Patterns};
use crate::display::beat::{Beat, BeatInput};
use crate::display::calibration::{Calibration, DisplayIdentity, TrackerIdentity};
use crate::display::dither::Dither;
use crate::display::grey::Row;
use crate::display::luminance_code::KNOTS;
use crate::display::{GreyMaker, GreyTable, Params};
use crate::exposure::Shutter;
use crate::optics::{BackgroundLight, Illumination, PsfModel, Radiometry, StarLight};
use crate::runtime::params::{CameraParams, RunParams};
use anyhow::{Context, Result, bail};

/// Standard deviation of a star on the display, px: wide enough for centroids that move evenly, narrow enough to be a
/// point for most trackers.
pub const SPOT_SIGMA_PX: f64 = 0.7;
/// Electrons that stand for one step of luminance: shot noise at the full one is 1.5 steps, at a hundredth 0.15.
const E_PER_STEP: f64 = 3e4;
/// By how much two crystals may differ, ppm.
const CLOCKS_PPM: f64 = 100.0;
/// Largest noise of a luminance, share of the full one.
pub const NOISE_LUMINANCE: f64 = 2.5e-5;

/// The display of a bench that is drawn for one: its first sink, calibrated.
#[must_use]
pub fn calibrated_display(bench: &Bench) -> Option<&DisplaySettings> {
    match bench.sinks.first().map(|settings| &settings.sink) {
        Some(Sink::Display(settings)) if settings.calibration.is_some() => Some(settings),
        _ => None,
    }
}

/// Reads the calibration of a display and holds it against everything that is known of it.
///
/// # Errors
/// When it is damaged, stale, or of another display or tracker.
pub fn calibration(settings: &DisplaySettings, tracker: &TrackerIdentity, now: Tai) -> Result<Calibration> {
    let path = settings.calibration.as_deref().context("a display without a calibration")?;
    let read = || {
        let calibration = Calibration::read(path)?;
        let [width_px, height_px] = match settings.params.window_px {
            Some(window_px) => window_px.map(|side| side as usize),
            None => calibration.display.size_px(),
        };
        let name = settings.name.clone().unwrap_or_else(|| calibration.display.name.clone());
        let bits = settings.params.bits.count();
        calibration.admit(&DisplayIdentity { name, width_px, height_px, bits }, Some(tracker), now)?;
        Ok::<_, crate::display::calibration::CalibrationError>(calibration)
    };
    read().with_context(|| format!("calibration {}", path.display()))
}

/// Makes a run one that is drawn for the display of its bench, if it has one. `now`: the date, for calibrations that are
/// too old.
///
/// # Errors
/// When the calibration is refused, or says too little.
pub fn take_display(params: &mut RunParams, bench: &Bench, now: Tai) -> Result<()> {
    let Some(settings) = calibrated_display(bench) else { return Ok(()) };
    Dither::over(settings.dither).context("sink.dither")?;
    let tracker = TrackerIdentity::of(&params.camera.name, &params.camera.geometry);
    let calibration = calibration(settings, &tracker, now)?;
    let calibrated = calibration.calibrated()?;
    let Some(light) = &calibration.light else {
        bail!("the calibration has no fluxes: fit it with measurements that tell them, so that magnitudes can be shown")
    };
    let turn = calibrated.geometry.drawn_from_sensor();
    for line in &mut params.attitude.jitter_lines {
        line.amplitude_rad = turn.apply(line.amplitude_rad);
    }
    params.attitude.sensor_from_body = turn * params.attitude.sensor_from_body;
    let refresh = params.frame_period;
    params.ahead = refresh + refresh + latency(settings, &calibration);
    let steps_per_e = f64::from(u16::MAX) / (light.full_px_e_per_s * refresh.s());
    let coded = KNOTS.map(|[luminance, code]| [luminance * f64::from(u16::MAX) * E_PER_STEP, code * E_PER_STEP]);
    let camera = &mut params.camera;
    *camera = CameraParams {
        name: camera.name.clone(),
        geometry: *calibrated.geometry.camera(),
        shutter: Shutter::Global,
        psf: PsfModel::gaussian(SPOT_SIGMA_PX),
        sampling: camera.sampling,
        illumination: Illumination::EVEN,
        background: BackgroundLight::default(),
        radiometry: brighter(&camera.radiometry, steps_per_e * E_PER_STEP)?,
        detector: DetectorParams {
            gain_e_per_dn: E_PER_STEP,
            full_well_e: E_PER_STEP * f64::from(u16::MAX),
            nonlinearity: Nonlinearity::through(&coded)?,
            ..DetectorParams::QUIET
        },
        patterns: Patterns::default(),
        limiting_mag: camera.limiting_mag,
        exposure_s: refresh.s(),
        readout_s: refresh.s(),
    };
    Ok(())
}

/// What the tracker's shutter makes of the refresh of the bench's display, if it has one.
///
/// # Errors
/// When a number is out of range.
pub fn beat(bench: &Bench) -> Result<Option<Beat>> {
    let Some(settings) = calibrated_display(bench) else { return Ok(None) };
    let input = BeatInput {
        exposure_s: bench.camera.exposure.exposure_s,
        frame_period_s: 1.0 / settings.tracker_hz,
        refresh_hz: bench.timing.frame_rate_hz,
        duty: settings.duty,
        drift_ppm: CLOCKS_PPM,
    };
    Ok(Some(input.beat()?))
}

/// Submit to light: the bench's own figure before the calibration's; none known: zero.
fn latency(settings: &DisplaySettings, calibration: &Calibration) -> Span {
    let measured = calibration.latency.as_ref().map(|latency| Span::from_ns(latency.median_ns));
    settings.params.latency.or(measured).unwrap_or(Span::ZERO)
}

/// The same light, so many times brighter.
fn brighter(light: &StarLight, times: f64) -> Result<StarLight> {
    let scaled = |radiometry: &Radiometry| Radiometry {
        zero_magnitude_photons_per_s_m2: radiometry.zero_magnitude_photons_per_s_m2 * times,
        ..*radiometry
    };
    Ok(match light {
        StarLight::Parametric(radiometry) => StarLight::Parametric(scaled(radiometry)),
        StarLight::ParametricV(radiometry) => StarLight::ParametricV(scaled(radiometry)),
        StarLight::Band(_) | StarLight::Grey(_) => {
            bail!("a calibrated display wants a tracker whose [radiometry] is a few numbers, got another model")
        }
    })
}

/// What a display is opened with, and what makes its greys. `bits`: of the numbers that come, where it is not calibrated.
///
/// # Errors
/// When the calibration cannot be read.
pub fn display_parts(settings: &DisplaySettings, image_px: [usize; 2], bits: u32) -> Result<(Params, GreyMaker)> {
    let image_px = image_px.map(|side| u32::try_from(side).unwrap_or(u32::MAX));
    let params = Params { image_px, ..settings.params.clone() };
    let Some(path) = &settings.calibration else {
        let table = GreyTable::linear(params.bits.count());
        let shift = 16 - bits.min(16);
        let make = move |numbers: &[u16], greys: &mut [u16], _: Row| {
            for (grey, number) in greys.iter_mut().zip(numbers) {
                *grey = table.nearest(number << shift);
            }
            0
        };
        return Ok((params.clone(), GreyMaker::by_row(params.bits.count(), false, make)));
    };
    let calibration = Calibration::read(path)?;
    let dither = Dither::over(settings.dither)?;
    let drive = calibration.calibrated()?.drive(dither);
    let make = move |luminances: &[u16], greys: &mut [u16], row: Row| drive.row(luminances, row.y, row.refresh, greys);
    let latency = Some(latency(settings, &calibration)).filter(|latency| *latency > Span::ZERO);
    let params = Params { latency, ..params };
    let bits = params.bits.count();
    Ok((params, GreyMaker::by_row(bits, dither.cycle() > 1, make)))
}
