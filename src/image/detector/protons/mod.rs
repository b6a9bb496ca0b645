//! Protons through the sensitive layer: a flux -> tracks of charge in each frame.
//!
//! Number of a frame: Poisson with mean `rate * exposure_s`. An isotropic flux `F` (protons per cm^2 and s through a
//! sphere of unit cross-section) crosses a flat area `A` at the rate `F A / 2`, with angles to the normal by the cosine
//! law, `p(mu) = 2 mu`; a beam at an angle crosses it at `F A cos(angle)`. So `F` times volume is the path length per
//! second in both cases. Each track enters anywhere on the detector and runs `thickness / mu` through the layer.
//!
//! Charge: `electronic stopping power * density * path / 3.65 eV` ([`stopping_power`]; 3.65 eV per pair: Janesick 2001,
//! section 2.1), never more than the proton's energy, constant along the path, spread over [`track`]'s width. Its
//! spread has Bohr's variance, `4 pi N r^2 (m c^2)^2 Z/A rho x gamma^2 (1 - beta^2/2)`, drawn log-normal: the mean
//! stays and the long tail of Landau's law is there in kind. Charge is added after the shot noise: it is counted charge
//! already.
//!
//! Not modelled: delta electrons that leave the layer, nuclear reactions, protons through the edges of the detector
//! (the layer is thin), slowing down within the layer (below 3 MeV it is no longer small). Tests: below and in `track`.

pub mod stopping_power;
pub mod track;

pub use track::ProtonTrack;

use crate::detector::outliers::{Outlier, fold_equal, with_space};
use base::random::{Stage, attempt_counter, key, philox};
use base::refused::Refused;
use stopping_power::{DENSITY_G_CM3, DOMAIN_MEV, silicon_mev_cm2_g};

/// Energy of one electron-hole pair in silicon, eV.
pub const PAIR_EV: f64 = 3.65;
/// Rest energy of the proton, MeV.
const PROTON_MEV: f64 = 938.272_088;
/// `4 pi N_A r_e^2 (m_e c^2)^2`, MeV^2 cm^2/mol: Bohr's straggling.
const BOHR_MEV2_CM2_MOL: f64 = 0.156_915;
/// Protons of silicon per unit of its molar mass.
const Z_OVER_A: f64 = 14.0 / 28.085;
/// Cosines are not smaller: at the smallest one a track in 10 um is a centimetre long.
const LEAST_COSINE: f64 = 1e-3;

/// Directions of protons.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ProtonDirection {
    /// Everywhere alike.
    Isotropic,
    /// One direction.
    Beam {
        /// Angle to the detector's normal, deg, below 90.
        incidence_deg: f64,
        /// Direction on the image, deg from +x towards +y.
        azimuth_deg: f64,
    },
}

/// Protons that arrive at the detector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProtonFlux {
    /// Protons per cm^2 and second.
    pub per_cm2_s: f64,
    /// Kinetic energy, MeV.
    pub energy_mev: f64,
    /// Direction.
    pub direction: ProtonDirection,
}

/// Layer of the detector in which protons leave charge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensitiveLayer {
    /// Thickness, um.
    pub thickness_um: f64,
    /// Side of a pixel, um.
    pub pixel_pitch_um: f64,
    /// Width of a track, px: charge spreads over a square of this side about every point of the path.
    pub track_width_px: f64,
}

impl SensitiveLayer {
    /// 15 um of silicon under pixels of 5.5 um.
    pub const TYPICAL: Self = Self { thickness_um: 15.0, pixel_pitch_um: 5.5, track_width_px: 1.0 };
}

impl ProtonFlux {
    /// Returns the flux itself when it means something.
    ///
    /// # Errors
    /// The first value that is invalid.
    pub fn checked(self) -> Result<Self, Refused> {
        let error = |what, got, wanted| Err(Refused(format!("proton flux {what}: got {got}, wanted {wanted}")));
        if !(0.0..=1e9).contains(&self.per_cm2_s) {
            return error("per_cm2_s", self.per_cm2_s, "a number from 0 to 1e9");
        }
        if !(DOMAIN_MEV[0]..=DOMAIN_MEV[1]).contains(&self.energy_mev) {
            return error(
                "energy_mev",
                self.energy_mev,
                "a number from 1 to 10000, where stopping powers are tabulated",
            );
        }
        match self.direction {
            ProtonDirection::Beam { incidence_deg, .. } if !(0.0..=89.9).contains(&incidence_deg) => {
                error("incidence_deg", incidence_deg, "a number from 0 to 89.9")
            }
            ProtonDirection::Beam { azimuth_deg, .. } if !azimuth_deg.is_finite() => {
                error("azimuth_deg", azimuth_deg, "a finite number")
            }
            ProtonDirection::Isotropic | ProtonDirection::Beam { .. } => Ok(self),
        }
    }

    /// Protons per second through an area.
    pub fn rate_per_s(&self, area_cm2: f64) -> f64 {
        let share = match self.direction {
            ProtonDirection::Isotropic => 0.5,
            ProtonDirection::Beam { incidence_deg, .. } => libm::cos(incidence_deg.to_radians()),
        };
        self.per_cm2_s * area_cm2 * share
    }

    /// Returns the mean electrons of a path, and their standard deviation.
    pub fn deposit_e(&self, path_um: f64) -> [f64; 2] {
        let g_cm2 = DENSITY_G_CM3 * path_um * 1e-4;
        let mean_mev = (silicon_mev_cm2_g(self.energy_mev) * g_cm2).min(self.energy_mev);
        let gamma = 1.0 + self.energy_mev / PROTON_MEV;
        let beta2 = 1.0 - 1.0 / (gamma * gamma);
        let variance_mev2 = BOHR_MEV2_CM2_MOL * Z_OVER_A * g_cm2 * gamma * gamma * (1.0 - 0.5 * beta2);
        [mean_mev, variance_mev2.sqrt()].map(|mev| mev * 1e6 / PAIR_EV)
    }
}

/// The tracks of one frame after the other.
#[derive(Debug)]
pub struct Protons {
    size_px: [usize; 2],
    layer: SensitiveLayer,
    seed: u64,
    most_tracks: usize,
    tracks: Vec<ProtonTrack>,
    charge: Vec<Outlier>,
    left_out: u64,
}

impl Clone for Protons {
    fn clone(&self) -> Self {
        Self { tracks: with_space(&self.tracks), charge: with_space(&self.charge), ..*self }
    }
}

impl Protons {
    /// Returns a source with capacity for so many tracks and pixels with charge per frame.
    pub fn new(size_px: [usize; 2], layer: SensitiveLayer, seed: u64, most_tracks: usize, most_px: usize) -> Self {
        let (tracks, charge) = (Vec::with_capacity(most_tracks), Vec::with_capacity(most_px));
        Self { size_px, layer, seed, most_tracks, tracks, charge, left_out: 0 }
    }

    /// Tracks of the latest frame.
    pub fn tracks(&self) -> &[ProtonTrack] {
        &self.tracks
    }

    /// Protons that no longer fitted into their frames, since the start.
    pub fn left_out(&self) -> u64 {
        self.left_out
    }

    /// Returns the area of the detector, cm^2.
    pub fn area_cm2(&self) -> f64 {
        let pitch_cm = self.layer.pixel_pitch_um * 1e-4;
        self.size_px[0] as f64 * self.size_px[1] as f64 * pitch_cm * pitch_cm
    }

    /// Draws the tracks of frame `frame` from a flux; the charge by pixel, sorted. A flux that is refused is none.
    pub fn at_frame(&mut self, frame: u32, exposure_s: f64, flux: Option<ProtonFlux>) -> &[Outlier] {
        self.tracks.clear();
        self.charge.clear();
        let flux = flux.and_then(|flux| flux.checked().ok()).filter(|flux| flux.per_cm2_s > 0.0);
        let Some(flux) = flux else { return &[] };
        let rate_per_s = flux.rate_per_s(self.area_cm2());
        // Times between protons are exponential: as many as fit into the exposure are Poisson.
        let mut at_s = 0.0;
        for number in 0.. {
            let words = Uniforms::new(frame, number, self.seed);
            at_s -= libm::log(words.open(0)) / rate_per_s;
            if at_s > exposure_s {
                break;
            }
            if self.tracks.len() == self.most_tracks {
                // Counting the rest one by one would take as long as drawing them.
                self.left_out += expected_left(rate_per_s, exposure_s - at_s);
                break;
            }
            let track = self.track(&flux, &words);
            if track::spread(&track, self.layer.track_width_px, self.size_px, &mut self.charge) {
                self.tracks.push(track);
            } else {
                self.left_out += 1;
            }
        }
        self.charge.sort_unstable_by_key(|outlier| (outlier.pixel, outlier.charge_e.to_bits()));
        let kept = fold_equal(&mut self.charge);
        self.charge.truncate(kept);
        &self.charge
    }

    fn track(&self, flux: &ProtonFlux, words: &Uniforms) -> ProtonTrack {
        let [width, height] = self.size_px.map(|side| side as f64);
        let start_px = [words.open(1) * width - 0.5, words.open(2) * height - 0.5];
        let (cosine, azimuth_rad) = match flux.direction {
            ProtonDirection::Isotropic => (words.open(3).sqrt(), core::f64::consts::TAU * words.open(4)),
            ProtonDirection::Beam { incidence_deg, azimuth_deg } => {
                (libm::cos(incidence_deg.to_radians()), azimuth_deg.to_radians())
            }
        };
        let cosine = cosine.max(LEAST_COSINE);
        let path_um = self.layer.thickness_um / cosine;
        let length_px = path_um * (1.0 - cosine * cosine).sqrt() / self.layer.pixel_pitch_um;
        let electrons = log_normal(flux.deposit_e(path_um), words);
        let (dy, dx) = libm::sincos(azimuth_rad);
        let whole =
            ProtonTrack { start_px, end_px: [start_px[0] + length_px * dx, start_px[1] + length_px * dy], electrons };
        whole.clipped([width, height])
    }
}

/// Returns one more than the mean number in the time left: the proton at hand and those after it.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a rate is not negative; casts saturate")]
fn expected_left(rate_per_s: f64, left_s: f64) -> u64 {
    1 + (rate_per_s * left_s).round() as u64
}

/// Returns a log-normal deviate whose arithmetic mean and standard deviation are given, by Box and Muller.
fn log_normal([mean, sigma]: [f64; 2], words: &Uniforms) -> f64 {
    let variance = libm::log1p((sigma / mean) * (sigma / mean));
    let z = (-2.0 * libm::log(words.open(5))).sqrt() * libm::cos(core::f64::consts::TAU * words.open(6));
    mean * libm::exp(variance.sqrt() * z - 0.5 * variance)
}

/// Eight uniforms of one proton.
struct Uniforms([u32; 8]);

impl Uniforms {
    fn new(frame: u32, number: u32, seed: u64) -> Self {
        let [a, b, c, d] = philox(attempt_counter(frame, number, Stage::Protons, 0), key(seed));
        let [e, f, g, h] = philox(attempt_counter(frame, number, Stage::Protons, 1), key(seed));
        Self([a, b, c, d, e, f, g, h])
    }

    /// Returns a uniform in (0, 1).
    fn open(&self, which: usize) -> f64 {
        (f64::from(self.0[which]) + 0.5) / 4_294_967_296.0
    }
}

#[cfg(test)]
mod tests;
