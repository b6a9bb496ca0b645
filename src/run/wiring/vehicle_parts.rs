//! A checked scenario -> the vehicle that flies it.
//!
//! Data that a flight computer and a tracker would find in data sheets come from the scenario's files; the limits of
//! the mode logic are set here, from the camera and the control's bandwidths.
//!
//! Random numbers from a seed, for starts and schedules.

use base::axes::{Icrf, Rotation, attitude_of_uniforms, sensor_from_ra_dec_roll};
use base::time::{Span, Tai};
use base::units::{ARCSEC, DEG};
use config::{Bench, Camera, JitterSource, Observer, OrbitSettings, Pointing, Scenario, TrackerCommands, Vehicle};
use frames::camera_control::{EXPOSURE_LEAST, longest_exposure_s};
use glam::{DMat3, DVec3};
use image::detector::readout::Levels;
use plan::optics::mtf::MtfChain;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use testbed::acs::{AcsParams, Gains, KeepOut, SafeParams, SlewLimits, StructuralFilter, Thresholds, UnloadParams};
use testbed::estimator::MekfParams;
use testbed::spacecraft::{CircularOrbitParams, SpacecraftParams};
use testbed::tracker::{CameraOrders, DetectorFigures, ExposedLight, Geometry, TrackerParams};
use testbed::vehicle::{HeadParams, VehicleParams};

/// Above this sigma an attitude counts as unknown.
const KNOWN_SIGMA_RAD: f64 = 0.5 * DEG;
/// Ground control leaves safe mode when the attitude has been known for this long.
const RESUME_AFTER: Span = Span::from_ms(20_000);
/// Ratio of the integral part's time constant to the loop's own.
const INTEGRAL_RATIO: f64 = 5.0;
/// Frequency of an Airy pattern's Gaussian core, sigma over wavelength times f-number.
const AIRY_SIGMA: f64 = 0.42;
/// Magnitude G of the faintest guide star of a star tracker.
const GUIDE_STAR_MAG: f64 = 7.0;

/// Longest exposure that a tracker commands, as a share of the frame period, unless the camera's own is longer.
const LONGEST_SHARE: f64 = 0.9;

/// Returns the vehicle that flies a scenario whose first exposure is at `first_exposure`.
pub fn vehicle_params(scenario: &Scenario, flown: &Vehicle, first_exposure: Tai) -> VehicleParams {
    let head = scenario.bench.sensor_from_body;
    let body = |pointing: &Pointing| head.inverse() * attitude(pointing);
    let spacecraft = spacecraft_params(scenario, &flown.spacecraft, first_exposure);
    let craft = &flown.spacecraft;
    let samples = scenario.bench.flight_computer.jitter_source == JitterSource::Samples;
    let hz = scenario.bench.flight_computer.jitter_sample_hz;
    VehicleParams {
        initial: flown.initial.as_ref().map_or_else(|| attitude_of_uniforms(uniforms(scenario.bench.seed)), body),
        initial_rate_rad_s: flown.initial_rate_rad_s,
        gyro: craft.gyro,
        sun_sensor_noise_rad: craft.sun_sensor_noise_rad,
        estimator: estimator_params(scenario, flown),
        attitude_known_sigma_rad: KNOWN_SIGMA_RAD,
        acs: acs_params(craft, &spacecraft),
        target: body(&flown.target),
        heads: head_params(scenario, flown),
        actuation_delay: flown.actuation_delay,
        tag_error: flown.tag_error,
        test_torques: flown.test_torques.clone(),
        vibration_period: samples.then(|| Span::from_s(1.0 / hz)),
        resume_after: Some(RESUME_AFTER),
        telemetry_every: flown.telemetry_every,
        seed: scenario.bench.seed,
        spacecraft,
    }
}

/// Returns the attitude of a head with this pointing.
pub fn attitude(pointing: &Pointing) -> Rotation<base::axes::Sensor, Icrf> {
    sensor_from_ra_dec_roll(pointing.ra_deg * DEG, pointing.dec_deg * DEG, pointing.roll_deg * DEG)
}

fn spacecraft_params(scenario: &Scenario, craft: &config::Spacecraft, epoch: Tai) -> SpacecraftParams {
    let mut params = craft.params.clone();
    if let Observer::Orbit(OrbitSettings::Circular {
        altitude_km,
        inclination_deg,
        raan_deg,
        argument_of_latitude_deg,
    }) = &scenario.bench.observer
    {
        params.orbit = CircularOrbitParams {
            epoch,
            altitude_m: altitude_km * 1e3,
            inclination_rad: inclination_deg * DEG,
            raan_rad: raan_deg * DEG,
            argument_of_latitude_rad: argument_of_latitude_deg * DEG,
        };
    }
    params
}

fn estimator_params(scenario: &Scenario, flown: &Vehicle) -> MekfParams {
    let (craft, bench) = (&flown.spacecraft, &scenario.bench);
    let cameras = core::iter::once(&bench.camera).chain(bench.extra_heads.iter().map(|head| &head.camera));
    let exposed_s = cameras.map(|camera| camera.exposure.exposure_s + camera.exposure.readout_s).fold(0.0, f64::max);
    // The oldest possible attitude: an exposure, its readout, the tracker's processing, and a margin for the bus.
    let history_s = exposed_s + flown.tracker_delay.s() + 2.0;
    let extra_hz: f64 = bench.extra_heads.iter().map(|head| head.frame_rate_hz).sum();
    let steps = history_s * (1.0 / craft.control.period.s() + (bench.timing.frame_rate_hz + extra_hz));
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few thousand at most")]
    let history_steps = (2.0 * steps) as usize + 64;
    MekfParams {
        gyro_arw_rad_sqrt_s: DVec3::splat(craft.gyro.angle_random_walk_rad_sqrt_s),
        gyro_rrw_rad_s_sqrt_s: DVec3::splat(craft.gyro.rate_random_walk_rad_s_sqrt_s),
        initial_attitude_sigma_rad: 1.0,
        initial_bias_sigma_rad_s: 10.0 * DEG / 3600.0,
        dropout_acceleration_rad_s2: 1e-4,
        gate_sigma: 6.0,
        lost_after: 10,
        history: Span::from_s(history_s),
        history_steps,
        converged_sigma_rad: 30.0 * ARCSEC,
    }
}

fn acs_params(craft: &config::Spacecraft, spacecraft: &SpacecraftParams) -> AcsParams {
    let control = &craft.control;
    let gains = |bandwidth_hz: f64, has_integral: bool| Gains {
        bandwidth_hz,
        damping: control.damping,
        integral_s: has_integral.then(|| INTEGRAL_RATIO / (core::f64::consts::TAU * bandwidth_hz)),
    };
    let slew_rate = control.slew_rate_rad_s;
    AcsParams {
        inertia_kg_m2: spacecraft.inertia_kg_m2,
        control_period: control.period,
        fine: gains(control.fine_bandwidth_hz, true),
        coarse: gains(control.coarse_bandwidth_hz, true),
        damping_bandwidth_hz: control.coarse_bandwidth_hz,
        safe: SafeParams {
            sun_axis_body: craft.sun_axis,
            gains: gains(control.coarse_bandwidth_hz, false),
            search_rate_rad_s: DVec3::new(0.0, 0.0, 0.2 * DEG),
        },
        largest_torque_n_m: largest_torque_n_m(spacecraft),
        integral_share: 0.5,
        slew: SlewLimits {
            largest_rate_rad_s: slew_rate,
            largest_acceleration_rad_s2: control.slew_acceleration_rad_s2,
        },
        filter: StructuralFilter::None,
        unload: UnloadParams { above_n_m_s: 0.3, below_n_m_s: 0.05 },
        thresholds: thresholds(slew_rate),
        exclusion: control.keep_out.map(|(boresight_body, half_angle_rad)| KeepOut {
            boresight_body,
            half_angle_rad,
            margin_rad: 2.0 * DEG,
        }),
    }
}

fn thresholds(slew_rate_rad_s: f64) -> Thresholds {
    Thresholds {
        rate_low_rad_s: 0.05 * DEG,
        rate_high_rad_s: (3.0 * slew_rate_rad_s).max(1.0 * DEG),
        rate_dwell: Span::from_ms(2000),
        fine_enter_rad: 120.0 * ARCSEC,
        fine_enter_rate_rad_s: 30.0 * ARCSEC,
        fine_enter_sigma_rad: 60.0 * ARCSEC,
        fine_enter_dwell: Span::from_ms(5000),
        fine_leave_rad: 600.0 * ARCSEC,
        fine_leave_sigma_rad: 240.0 * ARCSEC,
        fine_leave_dwell: Span::from_ms(2000),
        slew_above_rad: 1.0 * DEG,
        coarse_without_attitude: Span::from_ms(5000),
        safe_without_attitude: Span::from_ms(120_000),
        slew_settle: Span::from_ms(60_000),
    }
}

/// Returns the largest torque about each body axis that the wheels can give about all three at once: the smallest motor
/// over the largest sum of a row of the pseudo-inverse.
fn largest_torque_n_m(spacecraft: &SpacecraftParams) -> f64 {
    let axes = spacecraft.wheels.iter().map(|wheel| wheel.axis_body.normalize_or_zero());
    let square =
        axes.clone().fold(DMat3::ZERO, |sum, axis| sum + DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z));
    let inverse = if square.determinant().abs() > 1e-9 { square.inverse() } else { DMat3::IDENTITY };
    let longest = axes.map(|axis| (inverse * axis).abs().element_sum()).fold(0.0, f64::max);
    let weakest = spacecraft.wheels.iter().map(|wheel| wheel.largest_torque_n_m).fold(f64::INFINITY, f64::min);
    if longest > 0.0 && weakest.is_finite() { weakest / longest } else { 1e-3 }
}

fn head_params(scenario: &Scenario, flown: &Vehicle) -> Vec<HeadParams> {
    let head = |number: usize| {
        let bench = scenario.bench.of_head(number);
        let tracker = tracker_params(&bench.camera, flown.tracker_stars);
        let orders = camera_orders(flown.tracker_commands, &bench);
        HeadParams { sensor_from_body: bench.sensor_from_body, tracker, delay: flown.tracker_delay, orders }
    };
    (0..scenario.bench.head_count()).map(head).collect()
}

/// Returns the limits of a tracker's camera commands; `None` without commands. Its exposures keep the frame rate.
pub(super) fn camera_orders(commands: TrackerCommands, bench: &Bench) -> Option<CameraOrders> {
    let own_s = bench.camera.exposure.exposure_s;
    let period = Span::from_s(1.0 / bench.timing.frame_rate_hz);
    let longest_s = own_s.max((LONGEST_SHARE * period.s()).min(longest_exposure_s(own_s)));
    let exposure_s = commands.exposure.then_some([EXPOSURE_LEAST.s().min(own_s), longest_s]);
    commands.any().then_some(CameraOrders { windows: commands.windows, exposure_s, period })
}

/// Returns the light of stars, and the noise of pixels without any, of one exposure of this camera; its sky is left out.
pub fn exposed_light(camera: &Camera, params: &TrackerParams) -> ExposedLight {
    let exposure_s = camera.exposure.exposure_s;
    let pixels = camera.detector.params.spatial.binning.map_or(1.0, |binning| f64::from(binning.factor).powi(2));
    let dark_e = camera.detector.params.dark_e_per_s * exposure_s * pixels;
    let rounding_e2 = params.detector.gain_e_per_dn.powi(2) / 12.0;
    ExposedLight {
        zero_magnitude_e: camera.zero_point_e_per_s() * exposure_s,
        background_sigma_e: (params.detector.read_noise_e_rms.powi(2) + dark_e + rounding_e2).sqrt(),
        background_e: 0.0,
    }
}

/// Returns the parameters of a tracker behind this camera, as in its data sheet and calibration.
pub fn tracker_params(camera: &Camera, most_stars: usize) -> TrackerParams {
    let (detector, optics, d) = (&camera.detector, &camera.optics, &camera.distortion.coefficients);
    let focal_px = optics.focal_length_mm * 1e3 / detector.pixel_pitch_um;
    let output = detector.params.spatial.output([detector.width_px, detector.height_px].map(|side| side as usize));
    let binning = f64::from(output.binning);
    let geometry = Geometry {
        width_px: output.size_px[0],
        height_px: output.size_px[1],
        focal_px: [focal_px / binning; 2],
        principal_point_px: output.output_from_sensor(optics.principal_point_px),
        distortion: [d.k1, d.k2, d.p1, d.p2, d.k3],
    };
    let levels = Levels {
        gain_e_per_dn: detector.params.gain_e_per_dn,
        black_level_dn: detector.params.black_level_dn,
        // Noise as a calibration measures it: read noise and the fixed pattern that is not corrected aboard.
        read_noise_e_rms: detector
            .params
            .read_noise_e_rms
            .hypot(detector.params.amplifier_noise_e_rms)
            .hypot(detector.params.dsnu_e_rms),
        full_well_e: detector.params.full_well_e,
        largest_dn: f64::from(detector.params.largest_dn()),
        pixels: 1.0,
        temperature_c: detector.params.dark_law.operating_c,
    };
    let levels = detector.params.spatial.binning.map_or(levels, |binning| levels.binned(binning));
    let full_dn = levels.black_level_dn + levels.full_well_e / levels.gain_e_per_dn;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the converter's range")]
    let saturation_dn = (0.98 * full_dn).min(levels.largest_dn).clamp(0.0, 65535.0) as u16;
    let figures = DetectorFigures {
        gain_e_per_dn: levels.gain_e_per_dn,
        black_level_dn: levels.black_level_dn,
        read_noise_e_rms: levels.read_noise_e_rms,
        saturation_dn,
    };
    let psf_sigma_px = match &camera.psf {
        config::Psf::Gaussian { sigma_px } => *sigma_px,
        config::Psf::Airy { f_number, wavelength_nm, .. } => {
            AIRY_SIGMA * wavelength_nm * 1e-3 * f_number / detector.pixel_pitch_um
        }
        // An impossible chain was refused with its camera.
        config::Psf::Chain(chain) => {
            MtfChain::new(chain.params.clone()).map_or(AIRY_SIGMA, |chain| chain.core_sigma_px())
        }
        config::Psf::Made(psf) => psf.core_sigma_px(),
    };
    TrackerParams {
        prnu: detector.params.prnu / levels.pixels.sqrt(),
        limiting_mag: camera.radiometry.limiting_mag.map_or(GUIDE_STAR_MAG, |mag| mag.min(GUIDE_STAR_MAG)),
        exposure_s: camera.exposure.exposure_s,
        most_stars,
        ..TrackerParams::new(geometry, figures, (psf_sigma_px / binning).max(0.3))
    }
}

/// Returns `N` numbers, uniform in `0..1`.
pub fn uniforms<const N: usize>(seed: u64) -> [f64; N] {
    let mut dice = StdRng::seed_from_u64(seed);
    core::array::from_fn(|_| dice.random())
}
