//! Random scenes for the planner's property test: cameras, shutters, motions, methods, and stars over five decades.

use crate::scene::{Dice, EXPOSURE_S, instrument, los, planner_of, star};
use base::time::Tai;
use glam::DVec3;
use plan::attitude::{JitterLine, JitterPoint, LosPath};
use plan::exposure::{ExposurePlan, Instrument, PixelPath, PixelPoint, Shutter, Source};
use plan::optics::PsfModel;
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};

/// Detector, px.
pub(crate) const SIZE: usize = 64;
/// Methods asked for by name; of three scenes, two leave the choice to the planner.
const METHODS: [&str; 14] = [
    "static",
    "gaussian",
    "gauss-legendre",
    "gauss-legendre:6",
    "segments",
    "segments:8",
    "segments:200",
    "samples",
    "samples:32",
    "samples:256",
    "effective-psf",
    "effective-psf:128",
    "zonal-psf",
    "zonal-psf:64",
];
/// Stars of a scene, electrons: five decades.
const ELECTRONS: [f64; 2] = [2.0, 2e5];

/// One scene.
#[derive(Debug, Clone)]
pub(crate) struct Scene {
    pub(crate) instrument: Instrument,
    pub(crate) los: LosPath,
    pub(crate) path: Option<PixelPath>,
    pub(crate) stars: Vec<Source>,
    pub(crate) method: &'static str,
    /// Kind of motion.
    kind: u32,
    sigma_px: f64,
}

/// Returns the scene of a number: the same on every machine.
pub(crate) fn scene(number: u32) -> Scene {
    let mut dice = Dice::new(number);
    let dice = &mut dice;
    let focal_px = pick(dice, &[2900.0, 2900.0, 900.0, 150.0]);
    let sigma_px = if dice.unit() < 0.15 { 0.3 } else { dice.between(0.3, 1.5) };
    let shutter = if dice.unit() < 0.15 {
        Shutter::Rolling { line_s: 10.0_f64.powf(dice.between(-7.0, -4.0)) }
    } else {
        Shutter::Global
    };
    let instrument = Instrument { shutter, ..instrument(camera(dice, focal_px), &PsfModel::gaussian(sigma_px)) };
    let (kind, mut los, mut path) = (number % 6, los(), None);
    if kind == 0 || dice.unit() < 0.3 {
        let most = if kind == 0 { 6.0 } else { 2.0 };
        // Up to a degree per second about the line of sight, and ten in one scene out of ten.
        let roll = if dice.unit() < 0.1 { 0.015 } else { 0.001 };
        let mut px = || dice.between(-most, most);
        los.rate_rad_s = rate(focal_px, px(), px(), roll * px());
        los.acceleration_rad_s2 = rate(focal_px, px(), px(), 0.0) * (0.2 / EXPOSURE_S);
    }
    match kind {
        0 => {}
        1 => los.jitter.lines = vec![line_of_jitter(dice, focal_px)],
        2 => los.jitter.lines = (0..3).map(|_| line_of_jitter(dice, focal_px)).collect(),
        3 => los.jitter.points = walk(dice, focal_px),
        4 => {
            let rows = rows(dice, 2 + number / 6 % 23, true);
            path = Some(PixelPath::line(rows, EXPOSURE_S).expect("a path"));
        }
        _ => {
            let rows = rows(dice, 1 + number / 6 % 131, false);
            path = Some(PixelPath::samples(rows).expect("a path"));
        }
    }
    let method = if dice.unit() < 0.67 { "auto" } else { pick(dice, &METHODS) };
    Scene { instrument, los, path, stars: stars(dice), method, kind, sigma_px }
}

impl Scene {
    pub(crate) fn plan(&self) -> ExposurePlan {
        let (los, path) = (self.los.clone(), self.path.clone());
        planner_of(self.instrument.clone(), self.method, los, path).plan(&self.stars).clone()
    }

    /// Describes the scene in a few words, for a report.
    pub(crate) fn words(&self) -> String {
        let parameters = self.instrument.camera.parameters();
        format!(
            "kind {} sigma {:.2} focal {} {:?} {} {:?}",
            self.kind,
            self.sigma_px,
            parameters.focal_px[0],
            self.instrument.shutter,
            if self.instrument.camera.is_distorted() { "lens" } else { "pinhole" },
            self.method
        )
    }
}

fn pick<T: Copy>(dice: &mut Dice, from: &[T]) -> T {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below the length of a short list")]
    let i = (dice.unit() * from.len() as f64) as usize;
    from[i]
}

/// Draws a camera. A wide field has short focal lengths; one camera in four is a corner of a larger detector, one in
/// four has a lens.
fn camera(dice: &mut Dice, focal_px: f64) -> CameraGeometry {
    let middle = 0.5 * (SIZE as f64 - 1.0);
    let off = if dice.unit() < 0.25 { 0.3 * focal_px } else { 0.0 };
    let mut around = |most: f64| if dice.unit() < 0.25 { dice.between(-most, most) } else { 0.0 };
    let (k1, k2, p1) = (around(0.2), around(0.05), around(0.01));
    let parameters = CameraParameters {
        width_px: SIZE,
        height_px: SIZE,
        focal_px: [focal_px; 2],
        principal_point_px: [middle - off, middle - 0.5 * off],
        distortion: BrownConrady { k1, k2, p1, ..BrownConrady::default() },
    };
    CameraGeometry::new(parameters).expect("a camera")
}

/// Returns one star near each corner: their light does not meet.
fn stars(dice: &mut Dice) -> Vec<Source> {
    let decades = (ELECTRONS[1] / ELECTRONS[0]).log10();
    let corners = [[12.0, 12.0], [51.0, 13.0], [13.0, 50.0], [50.0, 51.0]];
    (0..)
        .zip(corners)
        .map(|(id, [x, y])| {
            let electrons = ELECTRONS[0] * 10.0_f64.powf(dice.between(0.0, decades));
            star(id, electrons, [x + dice.between(-2.0, 2.0), y + dice.between(-2.0, 2.0)])
        })
        .collect()
}

/// Returns the rate that moves the middle of the image by (`x`, `y`) px during the exposure and turns it by `roll_rad`.
fn rate(focal_px: f64, x: f64, y: f64, roll_rad: f64) -> DVec3 {
    DVec3::new(y / focal_px, -x / focal_px, roll_rad) / EXPOSURE_S
}

fn line_of_jitter(dice: &mut Dice, focal_px: f64) -> JitterLine {
    let amplitude_px = 2.5 * dice.unit().powi(2) + 0.02;
    let (sin, cos) = dice.between(0.0, core::f64::consts::TAU).sin_cos();
    // Roll jitter is small, but for one line in ten.
    let most = if dice.unit() < 0.1 { 0.03 } else { 2e-5 };
    let roll = dice.between(-most, most);
    JitterLine {
        frequency_hz: dice.between(1.0, 300.0),
        amplitude_rad: DVec3::new(sin * amplitude_px / focal_px, cos * amplitude_px / focal_px, roll),
        phase_rad: dice.between(0.0, core::f64::consts::TAU),
    }
}

/// Returns a millisecond random walk that covers the exposure.
fn walk(dice: &mut Dice, focal_px: f64) -> Vec<JitterPoint> {
    let step_rad = dice.between(0.05, 0.5) / focal_px;
    let mut rotation_rad = DVec3::ZERO;
    (-1..=102)
        .map(|ms| {
            rotation_rad += step_rad * DVec3::new(dice.between(-1.0, 1.0), dice.between(-1.0, 1.0), 0.0);
            JitterPoint { at: Tai::from_ns(ms * 1_000_000), rotation_rad }
        })
        .collect()
}

fn rows(dice: &mut Dice, count: u32, timed: bool) -> Vec<PixelPoint> {
    let size = dice.between(0.1, 4.0);
    let roll = if dice.unit() < 0.5 { 0.0 } else { dice.between(0.0, 0.08) };
    (0..count)
        .map(|i| {
            let t_s = if timed { EXPOSURE_S * f64::from(i) / f64::from(count.max(2) - 1) } else { 0.0 };
            let mut around = |most: f64| dice.between(-most, most);
            PixelPoint { t_s, dx_px: around(size), dy_px: around(size), roll_rad: around(roll) }
        })
        .collect()
}
