//! A display, a collimator and a star tracker's camera: greys in, frames out. Shares no code with what calibrates them.
//!
//! Light of a grey: an offset power law above a black level, times a vignetting that falls with the square of the
//! distance from a place. Display px -> a plane tilted about two axes -> the collimator's own distortion (radial and
//! decentring) -> a roll and an offset -> directions in the tracker's sensor axes -> the tracker's pinhole with radial
//! distortion. Each lit pixel is a Gaussian integrated over the tracker's pixels; what all pixels share (the black
//! level, a flat) is a smooth level, by the display's pixels per tracker pixel. Then shot noise, dark current, read
//! noise, rounding. The map is given from display to tracker; the way back is found by Newton steps on differences.
//! Limits: no diffraction rings, no moire of pixel grids. Tests below; used by `tests/physics/display_calibration` and
//! `starloop calibrate display simulate`.

use crate::noise::Gaussian;
use base::image::{DnImage, Image};
use glam::{DMat3, DVec2, DVec3};

/// Reach of a spot, standard deviations: 6e-7 of its light lies beyond.
const REACH_SIGMA: f64 = 5.0;
/// Step of differences, display px.
const STEP_PX: f64 = 0.01;
const NEWTON_STEPS: usize = 30;
/// Where Newton's steps end, tracker px.
const CLOSE_PX: f64 = 1e-9;
/// Shot noise needs no normal numbers below this, electrons.
const NO_LIGHT_E: f64 = 1e-9;

/// The truth about one bench.
#[derive(Debug, Clone, PartialEq)]
pub struct BenchTruth {
    /// Columns and rows of the display.
    pub display_px: [usize; 2],
    /// Bits of a grey.
    pub bits: u32,
    /// Exponent of the response.
    pub gamma: f64,
    /// Grey, relative to full, at which the offset power law begins: 0 for a plain power.
    pub toe: f64,
    /// Luminance of grey 0 over full.
    pub black_share: f64,
    /// Fall of the light at one half-diagonal from the brightest place.
    pub vignetting: f64,
    /// Brightest place, display px.
    pub brightest_px: [f64; 2],
    /// Focal length of the collimator, display px.
    pub focal_px: f64,
    /// Where the collimator's axis meets the display, display px.
    pub axis_px: [f64; 2],
    /// Tilt of the display about its column and row axes, rad.
    pub tilt_rad: [f64; 2],
    /// Radial distortion of the collimator, second and fourth order.
    pub radial: [f64; 2],
    /// Decentring distortion.
    pub decentring: [f64; 2],
    /// Roll of the tracker, rad, and its offset about the other two axes.
    pub roll_rad: f64,
    /// Offset of the tracker's boresight, rad.
    pub offset_rad: [f64; 2],
    /// Whether a mirror is between display and tracker.
    pub mirrored: bool,
    /// Columns and rows of the tracker.
    pub tracker_px: [usize; 2],
    /// Its focal length, tracker px.
    pub tracker_focal_px: f64,
    /// Its principal point, tracker px.
    pub tracker_centre_px: [f64; 2],
    /// Its radial distortion.
    pub tracker_radial: f64,
    /// Standard deviation of its spots, tracker px.
    pub psf_sigma_px: f64,
    /// Electrons of one full display pixel in one frame, at the brightest place, black level included.
    pub full_px_e: f64,
    /// Dark signal, electrons per frame.
    pub dark_e: f64,
    /// Read noise, electrons rms.
    pub read_noise_e: f64,
    /// Electrons per digital number.
    pub gain_e_per_dn: f64,
    /// Digital number of no charge.
    pub black_level_dn: f64,
    /// Seed of all noise.
    pub seed: u64,
}

impl BenchTruth {
    /// Returns a bench with every error at once: a tilted, rolled display behind a distorting collimator, off-centre
    /// vignetting, a response that does not follow a power law, black that is not dark.
    pub fn crooked() -> Self {
        Self {
            display_px: [640, 480],
            bits: 8,
            gamma: 2.2,
            toe: 0.055,
            black_share: 2e-3,
            vignetting: 0.25,
            brightest_px: [350.0, 220.0],
            focal_px: 2000.0,
            axis_px: [326.0, 231.0],
            tilt_rad: [0.02, -0.035],
            radial: [-0.12, 0.3],
            decentring: [2e-3, -1e-3],
            roll_rad: 0.14,
            offset_rad: [4e-3, -7e-3],
            mirrored: false,
            tracker_px: [704, 560],
            tracker_focal_px: 1800.0,
            tracker_centre_px: [353.3, 277.8],
            tracker_radial: -0.05,
            psf_sigma_px: 0.9,
            full_px_e: 6000.0,
            dark_e: 20.0,
            read_noise_e: 8.0,
            gain_e_per_dn: 2.0,
            black_level_dn: 100.0,
            seed: 1,
        }
    }

    /// Returns the light of a grey relative to full, black level included.
    pub fn light(&self, grey: u16) -> f64 {
        let v = f64::from(grey) / f64::from((1_u32 << self.bits) - 1);
        let knee = (1.0 + self.toe) * self.toe / (self.gamma - 1.0).max(0.1);
        let power = |v: f64| ((v + self.toe) / (1.0 + self.toe)).powf(self.gamma);
        // Straight below the knee, as in common display standards, meeting the power law there.
        let curve = if self.toe > 0.0 && v < knee { power(knee) * v / knee } else { power(v) };
        self.black_share + (1.0 - self.black_share) * curve
    }

    /// Returns the light of a place relative to the brightest.
    pub fn vignette(&self, px: DVec2) -> f64 {
        let half_diagonal = 0.5 * (self.display_px[0] as f64).hypot(self.display_px[1] as f64);
        let r = px.distance(DVec2::from(self.brightest_px)) / half_diagonal;
        1.0 - self.vignetting * r * r
    }

    /// Returns the direction in the tracker's sensor axes of a display pixel.
    pub fn direction(&self, px: DVec2) -> DVec3 {
        let shown = (px - DVec2::from(self.axis_px)) / self.focal_px;
        let shown = if self.mirrored { DVec2::new(-shown.x, shown.y) } else { shown };
        let tilt = DMat3::from_rotation_y(self.tilt_rad[0]) * DMat3::from_rotation_x(self.tilt_rad[1]);
        let plane = tilt * shown.extend(0.0) + DVec3::Z;
        let ideal = plane.truncate() / plane.z;
        let r2 = ideal.length_squared();
        let [a, b] = self.decentring;
        let shift = DVec2::new(
            a * (3.0 * ideal.x * ideal.x + ideal.y * ideal.y) + 2.0 * b * ideal.x * ideal.y,
            b * (ideal.x * ideal.x + 3.0 * ideal.y * ideal.y) + 2.0 * a * ideal.x * ideal.y,
        );
        let bent = ideal * (1.0 + r2 * (self.radial[0] + r2 * self.radial[1])) + shift;
        let turn = DMat3::from_rotation_x(self.offset_rad[1])
            * DMat3::from_rotation_y(self.offset_rad[0])
            * DMat3::from_rotation_z(self.roll_rad);
        (turn * bent.extend(1.0)).normalize()
    }

    /// Returns the tracker pixel of a direction in its sensor axes.
    pub fn tracker_place(&self, v_sensor: DVec3) -> DVec2 {
        let tangent = v_sensor.truncate() / v_sensor.z;
        let bent = tangent * (1.0 + self.tracker_radial * tangent.length_squared());
        DVec2::from(self.tracker_centre_px) + bent * self.tracker_focal_px
    }

    /// Returns the tracker pixel of a display pixel.
    pub fn seen_at(&self, display: DVec2) -> DVec2 {
        self.tracker_place(self.direction(display))
    }

    /// Returns the display pixel that a tracker pixel sees, and the display pixels per tracker pixel there; `None`
    /// where Newton's steps do not end.
    pub fn display_place(&self, tracker: DVec2) -> Option<(DVec2, f64)> {
        self.display_place_from(tracker, DVec2::from(self.axis_px))
    }

    /// Returns the same, from a first guess.
    fn display_place_from(&self, tracker: DVec2, guess: DVec2) -> Option<(DVec2, f64)> {
        let mut display = guess;
        for _ in 0..NEWTON_STEPS {
            let off = tracker - self.seen_at(display);
            let (slope_x, slope_y) = self.slopes(display);
            let determinant = slope_x.perp_dot(slope_y);
            if off.length() < CLOSE_PX {
                return Some((display, 1.0 / determinant.abs()));
            }
            display += DVec2::new(off.perp_dot(slope_y), slope_x.perp_dot(off)) / determinant;
        }
        None
    }

    fn slopes(&self, display: DVec2) -> (DVec2, DVec2) {
        let along = |step: DVec2| (self.seen_at(display + step) - self.seen_at(display - step)) / (2.0 * STEP_PX);
        (along(DVec2::X * STEP_PX), along(DVec2::Y * STEP_PX))
    }
}

/// A bench at work.
#[derive(Debug)]
pub struct DisplayBench {
    /// The truth.
    pub truth: BenchTruth,
    noise: Gaussian,
    /// Electrons of every tracker pixel when all of the display is full.
    full_level_e: Vec<f64>,
}

impl DisplayBench {
    /// Sets it up.
    pub fn new(truth: BenchTruth) -> Self {
        let [width, height] = truth.tracker_px;
        let [columns, rows] = truth.display_px.map(|side| side as f64 - 0.5);
        let places = (0..height).flat_map(|y| (0..width).map(move |x| DVec2::new(x as f64, y as f64)));
        let mut guess = DVec2::from(truth.axis_px);
        let level = |tracker| {
            let Some((px, density)) = truth.display_place_from(tracker, guess) else { return 0.0 };
            // The next pixel is a neighbour, but for the ends of rows.
            guess = px;
            let is_lit = px.x > -0.5 && px.y > -0.5 && px.x < columns && px.y < rows;
            if is_lit { truth.full_px_e * truth.vignette(px) * density } else { 0.0 }
        };
        let full_level_e = places.map(level).collect();
        Self { noise: Gaussian::new(truth.seed), truth, full_level_e }
    }

    /// Returns one frame of greys; `None`: the display is off.
    pub fn frame(&mut self, greys: Option<&Image<u16>>) -> DnImage {
        let electrons = greys.map_or_else(|| vec![0.0; self.full_level_e.len()], |greys| self.mean_e(greys));
        let [width, height] = self.truth.tracker_px;
        let mut frame = DnImage::new(width, height);
        for (dn, mean_e) in frame.pixels_mut().iter_mut().zip(electrons) {
            let mean_e = mean_e + self.truth.dark_e;
            let sigma = (mean_e.max(NO_LIGHT_E) + self.truth.read_noise_e.powi(2)).sqrt();
            let read = (mean_e + sigma * self.noise.unit()) / self.truth.gain_e_per_dn + self.truth.black_level_dn;
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a converter ends at its ends")]
            let read = read.round().clamp(0.0, 65_535.0) as u16;
            *dn = read;
        }
        frame
    }

    /// Returns the mean electrons of the display's light, without noise.
    pub fn mean_e(&self, greys: &Image<u16>) -> Vec<f64> {
        let shared = greys.pixels().iter().copied().min().unwrap_or(0);
        let level = self.truth.light(shared);
        let mut electrons: Vec<f64> = self.full_level_e.iter().map(|e| e * level).collect();
        let width = greys.width();
        for (at, grey) in greys.pixels().iter().enumerate().filter(|(_, grey)| **grey > shared) {
            let px = DVec2::new((at % width) as f64, (at / width) as f64);
            let light_e = self.truth.full_px_e * self.truth.vignette(px) * (self.truth.light(*grey) - level);
            self.add_spot(&mut electrons, self.truth.seen_at(px), light_e);
        }
        electrons
    }

    fn add_spot(&self, electrons: &mut [f64], at: DVec2, light_e: f64) {
        let [width, height] = self.truth.tracker_px;
        let (first_x, shares_x) = self.shares(at.x, width);
        let (first_y, shares_y) = self.shares(at.y, height);
        for (y, share_y) in shares_y.iter().enumerate() {
            let first = (first_y + y) * width + first_x;
            let row = &mut electrons[first..first + shares_x.len()];
            row.iter_mut().zip(&shares_x).for_each(|(e, share_x)| *e += light_e * share_x * share_y);
        }
    }

    /// Returns the first pixel of a spot along one side, and the share of its light in each.
    fn shares(&self, at: f64, side: usize) -> (usize, Vec<f64>) {
        let reach = REACH_SIGMA * self.truth.psf_sigma_px + 1.0;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the image")]
        let [first, end] = [at - reach, at + reach].map(|edge| edge.round().clamp(0.0, side as f64) as usize);
        let below = |edge: f64| 0.5 * libm::erfc((at - edge) / (core::f64::consts::SQRT_2 * self.truth.psf_sigma_px));
        let share = |i: usize| below(i as f64 + 0.5) - below(i as f64 - 0.5);
        (first, (first..end).map(share).collect())
    }

    /// Flips of a latency marker, `submit_s,edge_s`: a delay from a whole number of refreshes and some jitter.
    pub fn flips_csv(&mut self, flips: u32, latency_s: f64, jitter_s: f64) -> String {
        let mut text = "submit_s,edge_s\n".to_owned();
        for flip in 0..flips {
            let submit_s = 0.25 * f64::from(flip);
            let edge_s = submit_s + latency_s + jitter_s * self.noise.unit();
            text += &format!("{submit_s:.9},{edge_s:.9}\n");
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_and_back_is_where_it_began() {
        let truth = BenchTruth::crooked();
        for px in [[0.0, 0.0], [639.0, 0.0], [320.0, 240.0], [639.0, 479.0]] {
            let (back, density) = truth.display_place(truth.seen_at(DVec2::from(px))).unwrap();
            assert!(back.distance(DVec2::from(px)) < 1e-6, "{back} for {px:?}");
            assert!((0.9..1.6).contains(&density), "{density} display px per tracker px");
        }
    }

    #[test]
    fn light_rises_and_joins_at_the_knee() {
        let truth = BenchTruth::crooked();
        assert!((truth.light(0) - truth.black_share).abs() < 1e-12 && (truth.light(255) - 1.0).abs() < 1e-12);
        assert!((1..=255).all(|grey| truth.light(grey) > truth.light(grey - 1)));
        assert!((1..255).all(|grey| truth.light(grey + 1) - truth.light(grey) < 0.011), "no jump");
    }

    #[test]
    fn a_lit_pixel_is_a_spot_with_its_light_where_it_should_be() {
        let truth = BenchTruth { black_share: 0.0, ..BenchTruth::crooked() };
        let bench = DisplayBench::new(truth.clone());
        let mut greys = Image::new(640, 480);
        greys.pixels_mut()[200 * 640 + 400] = 255;
        let electrons = bench.mean_e(&greys);
        let sum: f64 = electrons.iter().sum();
        let px = DVec2::new(400.0, 200.0);
        assert!((sum / (truth.full_px_e * truth.vignette(px)) - 1.0).abs() < 1e-5, "{sum}");
        let places = electrons.iter().enumerate().map(|(i, e)| DVec2::new((i % 704) as f64, (i / 704) as f64) * *e);
        let centroid = places.sum::<DVec2>() / sum;
        assert!(centroid.distance(truth.seen_at(px)) < 1e-4, "{centroid}");
    }

    #[test]
    fn a_flat_is_the_sum_of_its_pixels() {
        let truth = BenchTruth { black_share: 0.0, ..BenchTruth::crooked() };
        let bench = DisplayBench::new(truth);
        let mut flat = Image::new(640, 480);
        flat.pixels_mut().fill(255);
        let smooth = bench.mean_e(&flat);
        // One pixel darker by nearly all: then all others are spots.
        flat.pixels_mut()[0] = 0;
        let spots = bench.mean_e(&flat);
        let at = 270 * 704 + 350;
        assert!((spots[at] / smooth[at] - 1.0).abs() < 0.01, "{} and {}", spots[at], smooth[at]);
    }
}
