//! A calibrated display -> the camera that the renderer draws with, and the conversion of its frames to greys.
//!
//! In: a run's parameters with the tracker's camera, and `[sink] kind = "display"` with a calibration file. Out: the
//! same run, drawn for the display: directions go to display pixels by the calibrated map, so that stars are placed by
//! moving their centroids; a frame is one refresh, with the motion in it integrated. Pixel values are codes of
//! luminance ([`outputs::display::luminance_code`]), with 65535 the largest luminance of the display. Metadata of
//! frames (attitude, right ascension, rates) refer to the tracker: the rotation into the drawn axes is undone
//! ([`RunParams::drawn_from_sensor`]). Without a calibration frames go to the display unchanged, and the program prints
//! this.
//!
//! **When.** P is the time of a refresh, L the latency from submit to light in the middle of the display (the bench's
//! own, else the calibration's, scanned on from the marker's row). A display that holds its light emits a frame
//! submitted at s over [s + L, s + L + P], one that flashes over [s + L, s + L + `duty` P]: that interval is the
//! exposure that is drawn, so its start needs s = start - L. Submits come once a refresh, at an unknown phase, because
//! the bench clock and the monitor's are independent: of all refreshes a frame gets the nearest one, s = start - L + u
//! with u uniform in [-P/2, P/2], 0 on average (`outputs::display::screen::presenter` holds it back until then, so that
//! u does not depend on how fast it was drawn; P/sqrt(12) rms). It must be there at the earliest of these, start - L -
//! P/2, and C (`COMPOSING`) before it for copies and greys, and is given P to be drawn in: it is begun 3/2 P + C + L
//! before the start, so `ahead` = exposure + 3/2 P + C + L. Shown as soon as drawn, light would come P/2 less the
//! drawing time too soon; begun a refresh later, by the drawing time too late.
//!
//! Limits: stars are Gaussians of [`SPOT_SIGMA_PX`] on the display, whatever the tracker's own PSF is, which comes on
//! top; the sky's background is not shown, as a display's black is brighter; light by `[band]` or a grey mapping is
//! refused, and so are scripted targets, whose places are pixels of the tracker (targets on the sky are shown). Rows
//! above and below the middle light up to half the scan sooner and later than drawn. Shot noise of what is drawn stays
//! below 2.5e-5 of the full luminance. Tests: `tests/closed_loop/display.rs` over a simulated flight computer.

use crate::{runtime::params::RunParams, wiring::sink_setting::SinkSetting};
use anyhow::{Context, Result, bail};
use base::refused::Refused;
use base::time::{Span, Tai};
use config::{Bench, DisplaySettings, Sink};
use image::detector::{DetectorParams, Nonlinearity, Patterns};
use outputs::display::beat::{Beat, BeatInput};
use outputs::display::calibration::{Calibration, DisplayIdentity, Light, TrackerIdentity};
use outputs::display::luminance_code::{KNOTS, luminance};
use outputs::display::{Display, GreyMaker, GreyTable, Params, SUBMITS, drive::Dither, grey::Row};
use plan::exposure::Shutter;
use plan::optics::{BackgroundLight, Illumination, PsfModel, Radiometry, StarLight};
use scene::camera::CameraParams;
use std::{path::Path, sync::Arc};

/// Standard deviation of a star on the display, px: wide enough for centroids that move evenly, narrow enough to be a
/// point for most trackers.
pub const SPOT_SIGMA_PX: f64 = 0.7;
/// Electrons for one step of luminance: shot noise is 1.5 steps at the full luminance and 0.15 at a hundredth of it.
const E_PER_STEP: f64 = 3e4;
/// Time to pass a frame to the presenter and compute the greys of a full screen; at most half a refresh.
const COMPOSING: Span = Span::from_ms(8);
/// Largest difference of the rates of two crystal clocks, ppm.
pub const CLOCKS_PPM: f64 = 100.0;
/// Shortest flash that is drawn, as a share of a refresh: motion within a hundredth of a refresh is invisible.
const LEAST_DUTY: f64 = 0.01;
/// Largest difference between the tracker's zero point and the calibration's: a millimagnitude.
const SAME_ZERO_POINT: f64 = 1e-3;
/// Row at which timing is exact, as a share of all rows.
const MIDDLE_ROW: f64 = 0.5;

/// Returns the display of a bench that is drawn for one: its first sink, calibrated.
pub fn calibrated_display(bench: &Bench) -> Option<&DisplaySettings> {
    match bench.sinks.first().map(|settings| &settings.sink) {
        Some(Sink::Display(settings)) if settings.calibration.is_some() => Some(settings),
        _ => None,
    }
}

/// Reads the calibration of a display and checks it against all known data of the display.
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
        Ok::<_, Refused>(calibration)
    };
    read().with_context(|| format!("calibration {}", path.display()))
}

/// Changes a run to be drawn for the display of its bench, if it has one, and then returns the calibration that it is
/// drawn with. `now` is the date, to detect calibrations that are too old.
///
/// # Errors
/// When the calibration is refused or lacks data, or the bench requests something that a display cannot show.
pub fn take_display(params: &mut RunParams, bench: &Bench, now: Tai) -> Result<Option<Calibration>> {
    let Some(settings) = calibrated_display(bench) else { return Ok(None) };
    if !params.targets.is_empty() {
        bail!(
            "[[target]]: got {} on a bench that is drawn for a display; wanted none: their scripts are pixels of the tracker, \
             which the display does not have; leave them out, or record the tracker's own frames",
            params.targets.len()
        );
    }
    Dither::over(settings.dither).context("sink.dither")?;
    let tracker = TrackerIdentity::of(&params.camera.name, &params.camera.geometry);
    let calibration = calibration(settings, &tracker, now)?;
    let calibrated = calibration.calibrated()?;
    let Some(light) = &calibration.light else {
        bail!(
            "the calibration has no fluxes: fit it with measurements that include fluxes, so that magnitudes can be shown"
        )
    };
    same_zero_point(light, &params.camera)?;
    let turn = calibrated.geometry.drawn_from_sensor();
    for line in &mut params.attitude.jitter_lines {
        line.amplitude_rad = turn.apply(line.amplitude_rad);
    }
    params.attitude.sensor_from_body = turn * params.attitude.sensor_from_body;
    params.drawn_from_sensor = Some(turn);
    let refresh = params.frame_period;
    let exposure = Span::from_s(refresh.s() * settings.duty.map_or(1.0, |duty| duty.max(LEAST_DUTY)));
    if let Some(record) = &mut params.attitude.jitter_record {
        record.sensor_from_record = turn.quat() * record.sensor_from_record;
        record.exposure_s = exposure.s();
    }
    let latency = latency(settings, Some(&calibration)).unwrap_or(Span::ZERO);
    let half = Span::from_ns(refresh.ns() / 2);
    params.ahead = exposure + refresh + half + COMPOSING.min(half) + latency;
    let steps_per_e = f64::from(u16::MAX) / (light.full_px_e_per_s * exposure.s());
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
        pixel_pitch_um: camera.pixel_pitch_um,
        focal_length_mm: camera.focal_length_mm,
        limiting_mag: camera.limiting_mag,
        exposure_s: exposure.s(),
        readout_s: refresh.s(),
    };
    Ok(Some(calibration))
}

/// Refuses a tracker whose electrons per magnitude differ from those of the one that calibrated the display.
fn same_zero_point(light: &Light, camera: &CameraParams) -> Result<()> {
    // A camera without a zero point is refused with a reason later, when its light is scaled.
    let Some(got) = camera.radiometry.zero_point_e_per_s() else { return Ok(()) };
    let wanted = light.zero_point_e_per_s;
    if (got / wanted - 1.0).abs() <= SAME_ZERO_POINT {
        return Ok(());
    }
    bail!(
        "camera \"{}\" makes {got:.4e} e-/s of magnitude 0, and the display was calibrated with {wanted:.4e}: wanted the same \
         within {SAME_ZERO_POINT}, as stars would be {:+.3} mag off; calibrate again with this camera file",
        camera.name,
        -2.5 * (got / wanted).log10()
    )
}

/// Returns the beat of the tracker's shutter with the refresh of the bench's display, if it has one.
///
/// # Errors
/// When a number is out of range.
pub fn beat(bench: &Bench) -> Result<Option<Beat>> {
    let Some(settings) = calibrated_display(bench) else { return Ok(None) };
    let input = BeatInput {
        exposure_s: bench.camera.exposure.exposure_s,
        frame_period_s: 1.0 / settings.tracker_hz,
        refresh_hz: bench.timing.frame_rate_hz,
        // Unknown duty: assume a flash, which beats most.
        duty: settings.duty.unwrap_or(0.0),
        drift_ppm: CLOCKS_PPM,
    };
    Ok(Some(input.beat()?))
}

/// Returns the time from submit to light in the middle of the display: the bench's own value before the calibration's.
pub fn latency(settings: &DisplaySettings, calibration: Option<&Calibration>) -> Option<Span> {
    let measured = || calibration?.latency.as_ref().map(|latency| latency.at_row(MIDDLE_ROW));
    settings.params.latency.or_else(measured)
}

/// Returns the same light scaled by a factor.
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

/// Opens a display for the frames of a run, and returns notes about it. `directory` receives its submit times.
///
/// # Errors
/// When the display does not exist, or the settings do not fit together.
pub fn open_display(
    settings: &DisplaySettings,
    setting: &SinkSetting<'_>,
    directory: Option<&Path>,
) -> Result<(Display, Vec<String>)> {
    let calibration = settings.calibration.as_ref().and(setting.calibration);
    let latency = latency(settings, calibration);
    let refresh = calibration.map(|_| setting.frame_period);
    let params = Params { latency, refresh, ..settings.params.clone() };
    let maker = match calibration {
        Some(calibration) => calibrated_greys(settings, calibration)?,
        None if settings.calibration.is_some() => bail!("its calibration was not read: frames are not drawn for it"),
        None => plain_greys(&params, setting.camera.output_bits(), setting.calibration.is_some()),
    };
    let image_px = setting.camera.output().size_px.map(|side| u32::try_from(side).unwrap_or(u32::MAX));
    let mut display = Display::open(&params, image_px, maker, Arc::clone(setting.clock))?;
    if let Some(directory) = directory {
        std::fs::create_dir_all(directory).with_context(|| format!("cannot make {}", directory.display()))?;
        display.keep_submits(&directory.join(SUBMITS))?;
    }
    let notes = [
        settings.calibration.is_none().then_some(NO_CALIBRATION),
        latency.is_none().then_some(NO_LATENCY),
        directory.is_none().then_some("submit times of the display are not kept: --out DIR keeps them"),
    ];
    Ok((display, notes.into_iter().flatten().map(str::to_owned).collect()))
}

/// Note for a display without a calibration.
pub const NO_CALIBRATION: &str = "the display has no calibration: greys are taken for luminances and pixels for \
     directions, which is right for no monitor; see `starloop calibrate display --help`";
/// Note for a display with unknown latency.
pub const NO_LATENCY: &str = "the latency of the display is not known, and taken for 0: light comes one to several \
     refreshes later than drawn; measure it (`starloop display flip --help`) or give latency_ms";

/// Returns the conversion from luminances to greys by a calibration.
fn calibrated_greys(settings: &DisplaySettings, calibration: &Calibration) -> Result<GreyMaker> {
    let dither = Dither::over(settings.dither)?;
    let drive = calibration.calibrated()?.drive(dither);
    let make = move |luminances: &[u16], greys: &mut [u16], row: Row| drive.row(luminances, row.y, row.refresh, greys);
    Ok(GreyMaker::by_row(settings.params.bits.count(), dither.cycle() > 1, make))
}

/// Returns greys in proportion to values of `bits` bits, or to luminance codes where frames are drawn for another
/// display.
fn plain_greys(params: &Params, bits: u32, are_codes: bool) -> GreyMaker {
    let table = GreyTable::linear(params.bits.count());
    let shift = 16 - bits.min(16);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "luminances are 0..1")]
    let light = move |number: u16| match are_codes {
        true => (luminance(number) * f64::from(u16::MAX)).round() as u16,
        false => number << shift,
    };
    let make = move |numbers: &[u16], greys: &mut [u16], _: Row| {
        for (grey, number) in greys.iter_mut().zip(numbers) {
            *grey = table.nearest(light(*number));
        }
        0
    };
    GreyMaker::by_row(params.bits.count(), false, make)
}
