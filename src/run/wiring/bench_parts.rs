//! A checked bench file -> the parameters of a run, of its simulated bus and of its simulated flight computer.
//!
//! The motion of a bench's script or file, as a scale for bounds of prediction.

use crate::runtime::{Imager, RunParams};
use crate::wiring::sensitivity::{Conditions, Sensitivity, bound_by_catalog};
use crate::{runtime::params::AttitudeParams, wiring::camera_parts::camera_params};
use anyhow::{Context, Result, bail};
use base::axes::{Body, Icrf, Rotation, sensor_from_ra_dec_roll};
use base::time::{Span, Tai};
use base::{refused::Refused, units::DEG};
use config::{
    AttitudeSettings, Bench, JitterAxes, JitterSource, Motion, OrbitSettings, OrbitStart, Plant, TargetCourse,
    TargetLight, TargetSettings,
};
use core::f64::consts::PI;
use glam::{DQuat, DVec3};
use link::WireFormat;
use link::simulated::{BusParams, BusTiming};
use plan::attitude::{JitterLine, MotionScale, RecordedJitter, RemoteClockLimits};
use plan::exposure::{Target, TargetWay};
use plan::exposure::{cost::CostModel, target::FIRST_TARGET_ID};
use plan::optics::snr::electrons_for_snr;
use scene::{camera::CameraParams, sky_targets::SkyTarget};
use sky::orbit::{CentralBody, CircularOrbit, TleOrbit, TwoBodyOrbit};
use sky::{observer::Observer, target::Orbit};
use std::sync::Arc;
use testbed::flight_computer::{
    Faults, FlightComputerParams, JitterStream, Profile, RampShape, Slew, SlewProfile, SteadyMotion,
};

/// Time before the first exposure, in which the bus carries its first time marks and attitudes.
const LEAD: Span = Span::from_ms(1000);

/// Returns parameters whose first exposure begins at an instant.
///
/// # Errors
/// As [`run_params`].
pub fn params_from(bench: &Bench, first_exposure: Tai) -> Result<RunParams> {
    run_params(bench, first_exposure - bench.timing.phase - LEAD)
}

/// Returns the parameters of a run on the virtual clock that starts when the clock reads `start`.
///
/// # Errors
/// When the camera or the observer's orbit cannot be used.
pub fn run_params(bench: &Bench, start: Tai) -> Result<RunParams> {
    let mut camera = camera_params(&bench.camera)?;
    bound_by_catalog(&mut camera, bench)?;
    let first_exposure = start + LEAD + bench.timing.phase;
    let params = RunParams {
        attitude: AttitudeParams {
            jitter_record: jitter_record(bench, first_exposure, camera.exposure_s)?,
            ..attitude_params(bench, start)
        },
        targets: scripted(bench, &camera, first_exposure)?,
        sky_targets: on_sky(bench, &camera, first_exposure)?,
        target_overlap: bench.target_overlap,
        observer: observer(&bench.observer, first_exposure)?,
        light_deflection: bench.light_deflection,
        bodies: bodies(bench, &camera)?,
        layers: bench.layers.clone(),
        star_memory_mb: bench.star_memory_mb,
        budget: bench.accuracy,
        backend: bench.render.backend,
        method: bench.render.method,
        cost: None,
        degrade: bench.timing.degrade.applies(false),
        last_degradation: bench.timing.degrade_to,
        seed: bench.seed,
        noise_seed: bench.noise_seed(),
        first_exposure,
        ahead: Span::from_s(bench.timing.ahead_ms * 1e-3),
        drawn_from_sensor: None,
        frame_period: Span::from_s(1.0 / bench.timing.frame_rate_hz),
        heads: u32::try_from(bench.head_count()).context("extra_head: more than 2^32 heads")?,
        frames: u32::try_from(bench.timing.frames()).context("timing.duration_s: more than 2^32 frames")?,
        deadline_policy: bench.timing.deadline_policy,
        camera,
    };
    check_observer_covers(&params)?;
    Ok(params)
}

/// Refuses an observer file that does not cover an exposure of the run: a gap would lack parallax and aberration.
fn check_observer_covers(params: &RunParams) -> Result<()> {
    let Observer::Table(history) = &params.observer else { return Ok(()) };
    let exposure = Span::from_s(params.camera.exposure_s);
    let has = |at: Tai| history.at_ns(at.ns()).is_some();
    let is_missing = |number: &u32| {
        let start = params.exposure_start(*number);
        !has(start) || !has(start + exposure)
    };
    let missing = (0..params.frames).filter(is_missing).count();
    if missing == 0 {
        return Ok(());
    }
    let [first, last] = history.span_ns().map(Tai::from_ns);
    let end = params.exposure_start(params.frames.saturating_sub(1)) + exposure;
    bail!(
        "observer.file: got states from {first} to {last}, which lack {missing} of {} exposures; wanted all from {} to {end}: set \
         timing.start_utc or timing.duration_s, or give a longer file without gaps",
        params.frames,
        params.exposure_start(0)
    )
}

/// Returns the targets on the sky, ready to be followed.
fn on_sky(bench: &Bench, camera: &CameraParams, first_exposure: Tai) -> Result<Vec<SkyTarget>> {
    let is_on_sky = |target: &TargetSettings| matches!(target.course, TargetCourse::Orbit(_));
    if bench.targets.iter().any(is_on_sky) && camera.radiometry.zero_point_e_per_s().is_none() {
        bail!(
            "bench \"{}\" has a [[target]] in orbit, and camera \"{}\" a grey mapping: its light changes within an exposure, which \
             wants electrons per second; give the camera a zero point, or leave the target out",
            bench.name,
            camera.name
        );
    }
    let mut found = Vec::new();
    for ((place, id), settings) in (0..).zip(FIRST_TARGET_ID..).zip(&bench.targets) {
        let (TargetCourse::Orbit(orbit), TargetLight::Reflected { brightness, bp_rp }) =
            (&settings.course, &settings.light)
        else {
            continue;
        };
        let [begin, end] = seen(settings, first_exposure);
        let orbit = orbit_of(orbit, first_exposure).with_context(|| format!("target[{place}]"))?;
        orbit.check_at(begin).with_context(|| format!("target[{place}]"))?;
        found.push(SkyTarget { id, orbit, brightness: brightness.clone(), bp_rp: *bp_rp, begin, end });
    }
    Ok(found)
}

/// Returns the orbit that these settings describe; `epoch` is the first exposure.
fn orbit_of(settings: &OrbitSettings, epoch: Tai) -> Result<Orbit, Refused> {
    Ok(match settings {
        OrbitSettings::Mean { text, norad_id, max_age_days } => {
            Orbit::Sgp4(Box::new(TleOrbit::read(text, *norad_id, epoch)?.within_days(*max_age_days)))
        }
        OrbitSettings::Circular { altitude_km, inclination_deg, raan_deg, argument_of_latitude_deg } => {
            let [inclination, raan, latitude] = [*inclination_deg, *raan_deg, *argument_of_latitude_deg];
            Orbit::Circular(CircularOrbit::new(*altitude_km, inclination, raan, latitude, epoch)?)
        }
        OrbitSettings::TwoBody { about, epoch: given, start } => {
            let (epoch, gm_km3_s2) = (given.unwrap_or(epoch), about.gm_km3_s2());
            Orbit::TwoBody(match start {
                OrbitStart::State { position_km, velocity_km_s } => {
                    let [position_km, velocity_km_s] = [*position_km, *velocity_km_s].map(DVec3::from_array);
                    TwoBodyOrbit::from_state(epoch, position_km, velocity_km_s, gm_km3_s2)?
                }
                OrbitStart::Elements(elements) => TwoBodyOrbit::from_elements(epoch, elements, gm_km3_s2)?,
            })
        }
    })
}

/// Returns the first and last instant at which a target is visible.
fn seen(settings: &TargetSettings, first_exposure: Tai) -> [Tai; 2] {
    let begin = first_exposure + Span::from_s(settings.start_s);
    // Limited to a century: spans end at 292 years.
    [begin, begin + Span::from_s(settings.for_s.min(3e9))]
}

/// Returns true when bodies are drawn: their light needs electrons that follow the exposure.
fn bodies(bench: &Bench, camera: &CameraParams) -> Result<bool> {
    if bench.bodies && camera.radiometry.zero_point_e_per_s().is_none() {
        bail!(
            "bench \"{}\" has sky.bodies = true, and camera \"{}\" a grey mapping: a disc's light is spread over its pixels, which \
             wants electrons per second; give the camera a zero point, or leave the bodies out",
            bench.name,
            camera.name
        );
    }
    Ok(bench.bodies)
}

/// Returns the scripted targets of a bench with their light in electrons and their times in TAI.
///
/// # Errors
/// When the camera cannot draw targets.
pub fn scripted(bench: &Bench, camera: &CameraParams, first_exposure: Tai) -> Result<Vec<Target>> {
    if !bench.targets.is_empty() && camera.psf.as_field().is_some() {
        bail!(
            "bench \"{}\" has [[target]], and camera \"{}\" a PSF that changes over the field: targets are drawn with one PSF; \
             choose a camera with one, or leave the targets out",
            bench.name,
            camera.name
        );
    }
    let is_by_snr = |target: &TargetSettings| matches!(target.light, TargetLight::Snr(_));
    // Computes the PSF once for all targets, and only when one needs it.
    let sensitivity = (bench.targets.iter().any(is_by_snr)).then(|| Sensitivity::new(camera, &Conditions::default()));
    let electrons_of = |snr: f64| {
        let noise = sensitivity.as_ref().map(|Sensitivity { window, pixel, .. }| window.noise(pixel));
        noise.map_or(f64::NAN, |noise| electrons_for_snr(snr, &noise))
    };
    let target = |(id, settings): (u32, &TargetSettings)| {
        let TargetCourse::Script(path) = settings.course else { return None };
        let (mag, e_per_s) = match settings.light {
            TargetLight::Snr(snr) => (f64::NAN, electrons_of(snr) / camera.exposure_s),
            TargetLight::Electrons(electrons) => (f64::NAN, electrons / camera.exposure_s),
            TargetLight::Reflected { .. } => return None,
            TargetLight::Mag { mag, bp_rp } => (
                camera.radiometry.mag_instrument(mag, bp_rp),
                camera.radiometry.electrons(mag, bp_rp, camera.exposure_s) / camera.exposure_s,
            ),
        };
        let [begin, end] = seen(settings, first_exposure);
        #[allow(clippy::cast_possible_truncation, reason = "magnitudes are single precision")]
        let mag = mag as f32;
        Some(Target { id, mag, e_per_s, begin, end, way: TargetWay::Script(path), light: None })
    };
    Ok((FIRST_TARGET_ID..).zip(&bench.targets).filter_map(target).collect())
}

/// Returns the imager of a run.
///
/// # Errors
/// When the backend is unavailable.
pub fn imager(params: &RunParams) -> Result<Imager> {
    Ok(Imager::of_detector(params.backend, params.camera.make_detector(params.seeds())?)?)
}

/// Applies the differences of the real clock: costs are those of this machine, frames may be degraded to be in time,
/// and a stopped stream of attitudes leaves frames out unless the bench sets another policy.
pub fn take_real_clock(params: &mut RunParams, bench: &Bench, measured: Option<CostModel>) {
    params.cost = measured;
    params.degrade = bench.timing.degrade.applies(true);
    params.attitude.settings.estimate.policy = bench.attitude.policy_on_real_clock;
}

fn attitude_params(bench: &Bench, boot: Tai) -> AttitudeParams {
    let settings = &bench.attitude;
    let mount =
        |line: JitterLine| JitterLine { amplitude_rad: bench.sensor_from_body.apply(line.amplitude_rad), ..line };
    let known_lines = bench.flight_computer.jitter_source == JitterSource::Lines;
    let lines = bench.flight_computer.known_lines().filter(|_| known_lines);
    // The simulated bus has a known latency: it represents the calibrated constant delay of a real one.
    let latency = Span::from_s(bench.link.latency_us * 1e-6);
    let constant_delay = settings.clock.constant_delay.max(latency);
    AttitudeParams {
        settings: AttitudeSettings { clock: RemoteClockLimits { constant_delay, ..settings.clock }, ..*settings },
        jitter_lines: lines.map(mount).collect(),
        jitter_epoch: boot,
        jitter_record: None,
        sensor_from_body: bench.sensor_from_body,
    }
}

/// Returns the record that the bench names, rotated to this head.
fn jitter_record(bench: &Bench, first_exposure: Tai, exposure_s: f64) -> Result<Option<RecordedJitter>> {
    let Some(input) = &bench.jitter else { return Ok(None) };
    let sensor_from_record = match input.axes {
        JitterAxes::Sensor => DQuat::IDENTITY,
        JitterAxes::Body => bench.sensor_from_body.quat(),
    };
    let record = input.record(bench.seed).with_context(|| format!("[jitter] {}", input.path))?;
    let start = first_exposure + Span::from_s(input.start_s);
    Ok(Some(RecordedJitter { record, start, sensor_from_record, exposure_s }))
}

fn observer(observer: &config::Observer, epoch: Tai) -> Result<Observer> {
    Ok(match observer {
        config::Observer::Geocentre => Observer::Geocentre,
        config::Observer::Table(history) => Observer::Table(Arc::clone(history)),
        config::Observer::Tle { line1, line2, max_age_days } => {
            let orbit = TleOrbit::parse(&format!("{line1}\n{line2}")).context("[observer]")?;
            Observer::Tle(Box::new(orbit.within_days(*max_age_days)))
        }
        config::Observer::Orbit(settings) => {
            let (place, about) = match settings {
                OrbitSettings::Mean { .. } => ("observer.file", CentralBody::Earth),
                OrbitSettings::Circular { .. } => ("[observer]", CentralBody::Earth),
                OrbitSettings::TwoBody { about, .. } => ("[observer]", *about),
            };
            match orbit_of(settings, epoch).context(place)? {
                Orbit::Sgp4(orbit) => Observer::Tle(orbit),
                Orbit::Circular(orbit) => Observer::Circular(orbit),
                Orbit::TwoBody(orbit) => Observer::TwoBody { about, orbit },
            }
        }
    })
}

/// Returns the bus between the simulated flight computer and the stimulator, and the format of its messages.
pub fn bus(bench: &Bench) -> (BusParams, WireFormat) {
    (bus_of(&bench.link), bench.link.wire)
}

/// Returns the simulated bus of a link.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the config's bit rates are checked")]
pub fn bus_of(link: &config::Link) -> BusParams {
    let bit_rate_bps = link.bit_rate as u32;
    let timing = match link.wire {
        WireFormat::CanFd => BusTiming::CanFd { arbitration_bps: bit_rate_bps, data_bps: link.data_bit_rate as u32 },
        WireFormat::CanClassic => BusTiming::CanClassic { bit_rate_bps },
        WireFormat::Serial => BusTiming::Serial { baud: bit_rate_bps },
        WireFormat::Plain => BusTiming::Datagram { bit_rate_bps },
    };
    let latency = Span::from_s(link.latency_us * 1e-6);
    BusParams { name: "simulated".into(), timing, latency, queue_packets: link.queue as usize }
}

/// Returns the simulated flight computer of a plant whose first exposure is at `zero`; without its own plant it keeps
/// its attitude or slews as the bench demands.
pub fn flight_computer_of(plant: &Plant, bench: &Bench, boot: Tai, zero: Tai) -> FlightComputerParams {
    let params = flight_computer(bench, boot);
    match plant {
        Plant::File(file) => FlightComputerParams { profile: Profile::File(file.profile(zero)), ..params },
        Plant::Outside | Plant::FlightComputer | Plant::Vehicle(_) => params,
    }
}

/// Returns the simulated flight computer that boots at `boot`.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the config's rates are checked")]
pub fn flight_computer(bench: &Bench, boot: Tai) -> FlightComputerParams {
    let settings = &bench.flight_computer;
    let [ra, dec, roll] = [settings.ra_deg, settings.dec_deg, settings.roll_deg].map(f64::to_radians);
    let initial: Rotation<Body, Icrf> = bench.sensor_from_body.inverse() * sensor_from_ra_dec_roll(ra, dec, roll);
    let profile = profile(bench, initial, boot + LEAD);
    let jitter = match (settings.jitter_source, bench.link.wire) {
        (JitterSource::Lines, _) => JitterStream::OFF,
        (JitterSource::Samples, WireFormat::CanClassic) => JitterStream::PAIRS,
        (JitterSource::Samples, _) => JitterStream::bursts(settings.jitter_sample_hz as u32),
    };
    FlightComputerParams {
        boot,
        clock_drift_ppm: settings.clock_drift_ppm,
        stream_start: boot,
        attitude_hz: settings.attitude_hz as u32,
        profile,
        attitude_noise_arcsec: 0.0,
        gyro_noise_rad_s: 0.0,
        seed: bench.seed,
        jitter_lines: settings.jitter_lines.clone(),
        jitter,
        faults: Faults::default(),
    }
}

/// Returns the scripted motion that starts at `start` from `initial`.
fn profile(bench: &Bench, initial: Rotation<Body, Icrf>, start: Tai) -> Profile {
    let settings = &bench.flight_computer;
    if let Some(Motion::Steady { rate_deg_s, swings }) = &settings.motion {
        let rate_rad_s = DVec3::from_array(rate_deg_s.map(f64::to_radians));
        return Profile::Steady(SteadyMotion { initial, zero: start, rate_rad_s, swings: swings.clone() });
    }
    let path = settings.motion.as_ref().and_then(|motion| motion.path(bench.sensor_from_body));
    if let Some(Ok(path)) = path {
        return Profile::Waypoints(path, start);
    }
    let Some(slew) = &settings.slew else { return SlewProfile::hold(initial).into() };
    let turn = Slew {
        axis_body: DVec3::from_array(slew.axis),
        angle_rad: slew.angle_deg.to_radians(),
        // Each of the two versine ramps has a mean of half the peak.
        peak_rate_rad_s: 2.0 * slew.angle_deg.to_radians().abs() / slew.duration_s,
        ramp_s: 0.5 * slew.duration_s,
        shape: RampShape::Versine,
    };
    SlewProfile::slew(initial, start + Span::from_s(slew.start_s), &turn).into()
}

/// Returns the motion in the attitude records of a plant, as far as it is known before a run; for a file, from the
/// differences of its rows.
pub fn motion_scale(plant: &Plant, bench: &Bench) -> MotionScale {
    match plant {
        Plant::File(file) => {
            let [rate_rad_s, acceleration_rad_s2, jerk_rad_s3] = file.history.motion_limits();
            MotionScale { rate_rad_s, acceleration_rad_s2, jerk_rad_s3, sinusoids: Vec::new() }
        }
        Plant::Outside | Plant::FlightComputer | Plant::Vehicle(_) => script_scale(bench),
    }
}

/// Returns the peak of the scripted motion; a slew has ramps of half its length, `rate = peak (1 - cos(pi t / ramp)) /
/// 2`.
pub fn script_scale(bench: &Bench) -> MotionScale {
    if let Some(motion) = &bench.flight_computer.motion {
        return motion.scale();
    }
    let Some(slew) = &bench.flight_computer.slew else { return MotionScale::default() };
    let (peak_rad_s, ramp_s) = (2.0 * slew.angle_deg.abs() * DEG / slew.duration_s, 0.5 * slew.duration_s);
    MotionScale {
        rate_rad_s: peak_rad_s,
        acceleration_rad_s2: 0.5 * peak_rad_s * PI / ramp_s,
        jerk_rad_s3: 0.5 * peak_rad_s * (PI / ramp_s).powi(2),
        sinusoids: Vec::new(),
    }
}
