//! A power spectral density and a seed -> lines that sum to Gaussian noise of that density.
//!
//! Input: breakpoints of a one-sided density per axis, straight in log-log between them; zero outside, and zero in a
//! piece with a zero at one end. Output: [`LINES_PER_AXIS`] sinusoids per axis.
//!
//! *Method.* Spectral representation (Shinozuka and Deodatis, "Simulation of stochastic processes by spectral
//! representation", Applied Mechanics Reviews 44, 1991): the band is cut into strata; each has one sinusoid with the
//! stratum's whole power `P`, of amplitude `sqrt(2 P)`, a random phase, and a random frequency with the density as its
//! law. So the mean over seeds is the density itself, the variance over a long time is exactly its integral, and
//! because the frequencies have no common period the sum does not repeat. Strata are equal in the mean of power and of
//! the logarithm of frequency: half of the lines go where the power is, and no octave is left empty.
//!
//! *Limits.* Over a time shorter than 1/stratum a stratum's line looks like a line. The kurtosis is `3 - 1.5 sum P^2 /
//! (sum P)^2`: 2.95 for a flat density, 2.8 when half of the power is in a few strata. Frequencies and phases come from
//! `base::random`, logarithms from `libm`: the same on every machine. Tests: `tests/physics/bus_jitter.rs`.

use crate::attitude::{error::JitterReject, los::JitterLine};
use base::bisection::bisected;
use base::random::{Stage, key, philox};
use core::f64::consts::TAU;
use glam::DVec3;

/// Sinusoids per axis.
pub const LINES_PER_AXIS: usize = 32;
/// Largest number of breakpoints.
pub const PSD_POINTS_MAX: usize = 32;
/// Number of halvings to find a stratum's edge: to 1e-15 of the band.
const HALVINGS: u32 = 52;

/// A breakpoint of a power spectral density.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PsdPoint {
    /// Frequency, Hz; above zero, rising from point to point.
    pub frequency_hz: f64,
    /// One-sided density per axis, rad^2/Hz, not negative.
    pub density: DVec3,
}

/// One piece between two breakpoints: `S = s (f / low)^slope`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece {
    low_hz: f64,
    pub(super) high_hz: f64,
    density: f64,
    slope: f64,
}

impl Piece {
    pub(super) fn between(a: (f64, f64), b: (f64, f64)) -> Self {
        let is_empty = a.1 <= 0.0 || b.1 <= 0.0;
        let slope = if is_empty { 0.0 } else { libm::log(b.1 / a.1) / libm::log(b.0 / a.0) };
        Self { low_hz: a.0, high_hz: b.0, density: if is_empty { 0.0 } else { a.1 }, slope }
    }

    /// Returns the integral of the density from the low end to `frequency_hz`.
    pub(super) fn power_to(&self, frequency_hz: f64) -> f64 {
        let octaves = libm::log(frequency_hz.clamp(self.low_hz, self.high_hz) / self.low_hz);
        let steps = (self.slope + 1.0) * octaves;
        // expm1(x) / x is 1 where the density falls as 1/f.
        let ratio = if steps.abs() < 1e-12 { 1.0 } else { libm::expm1(steps) / steps };
        self.density * self.low_hz * octaves * ratio
    }

    /// Returns the frequency up to which the power is this.
    fn frequency_of(&self, power: f64) -> f64 {
        if self.density <= 0.0 {
            return self.low_hz;
        }
        let share = power / (self.density * self.low_hz);
        let steps = (self.slope + 1.0) * share;
        let octaves = if steps.abs() < 1e-12 { share } else { libm::log1p(steps.max(-1.0)) / (self.slope + 1.0) };
        (self.low_hz * libm::exp(octaves)).clamp(self.low_hz, self.high_hz)
    }
}

/// Pieces of one axis.
struct Band<'a> {
    points: &'a [PsdPoint],
    axis: usize,
}

impl Band<'_> {
    fn pieces(&self) -> impl Iterator<Item = Piece> + '_ {
        let end = |point: &PsdPoint| (point.frequency_hz, point.density[self.axis]);
        self.points.windows(2).map(move |pair| Piece::between(end(&pair[0]), end(&pair[1])))
    }

    fn power_to(&self, frequency_hz: f64) -> f64 {
        self.pieces().map(|piece| piece.power_to(frequency_hz)).sum()
    }

    fn frequency_of(&self, power: f64) -> f64 {
        let mut left = power;
        let mut last_hz = 0.0;
        for piece in self.pieces() {
            let whole = piece.power_to(piece.high_hz);
            if whole > 0.0 {
                last_hz = piece.frequency_of(left.min(whole));
                if left <= whole {
                    return last_hz;
                }
            }
            left -= whole;
        }
        last_hz
    }

    /// Returns the frequency below which a share of the strata lies: mean of the shares of power and of log frequency.
    fn edge(&self, share: f64, total: f64) -> f64 {
        let (Some(first), Some(last)) = (self.points.first(), self.points.last()) else {
            return 0.0;
        };
        let octaves = libm::log(last.frequency_hz / first.frequency_hz);
        let at = bisected([0.0, octaves], HALVINGS, |middle| {
            let power = self.power_to(first.frequency_hz * libm::exp(middle));
            0.5 * (power / total + middle / octaves) < share
        });
        first.frequency_hz * libm::exp(at)
    }
}

/// Returns the power of a density per axis, rad^2: the variance of the noise.
pub fn psd_variance(points: &[PsdPoint]) -> DVec3 {
    let power = |axis| Band { points, axis }.pieces().map(|piece| piece.power_to(piece.high_hz)).sum();
    DVec3::from_array([0, 1, 2].map(power))
}

/// Checks a density.
///
/// # Errors
/// The first point that is invalid, or the number of points when there are too many.
pub(super) fn check(points: &[PsdPoint]) -> Result<(), JitterReject> {
    if points.len() > PSD_POINTS_MAX {
        return Err(JitterReject::TooMany { got: points.len(), most: PSD_POINTS_MAX });
    }
    check_rows(points)
}

/// Checks each point of a density.
///
/// # Errors
/// The first point that is invalid.
pub(super) fn check_rows(points: &[PsdPoint]) -> Result<(), JitterReject> {
    for (row, point) in points.iter().enumerate() {
        let is_legal =
            point.frequency_hz.is_finite() && point.density.is_finite() && point.density.min_element() >= 0.0;
        if !is_legal || point.frequency_hz <= 0.0 {
            return Err(JitterReject::Illegal { row });
        }
        if row > 0 && point.frequency_hz <= points[row - 1].frequency_hz {
            return Err(JitterReject::NotRising { row });
        }
    }
    Ok(())
}

/// Adds the lines of a checked density to `lines`.
pub(super) fn realise(points: &[PsdPoint], seed: u64, lines: &mut Vec<JitterLine>) {
    for axis in 0..3 {
        let band = Band { points, axis };
        let total: f64 = band.pieces().map(|piece| piece.power_to(piece.high_hz)).sum();
        if total <= 0.0 {
            continue;
        }
        let mut below = 0.0;
        for place in 0..LINES_PER_AXIS {
            let is_last = place + 1 == LINES_PER_AXIS;
            let share = (place + 1) as f64 / LINES_PER_AXIS as f64;
            let upto = if is_last { total } else { band.power_to(band.edge(share, total)).clamp(below, total) };
            let power = upto - below;
            if power > 0.0 {
                let [at, phase] = uniforms(seed, axis, place);
                let mut amplitude_rad = DVec3::ZERO;
                amplitude_rad[axis] = (2.0 * power).sqrt();
                let frequency_hz = band.frequency_of(below + at * power);
                lines.push(JitterLine { frequency_hz, amplitude_rad, phase_rad: TAU * phase });
            }
            below = upto;
        }
    }
}

fn uniforms(seed: u64, axis: usize, place: usize) -> [f64; 2] {
    let word = |i: usize| u32::try_from(i).unwrap_or(u32::MAX);
    let [a, b, ..] = philox([word(place), word(axis), Stage::Jitter as u32, 0], key(seed));
    [a, b].map(|word| (f64::from(word) + 0.5) / 4_294_967_296.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(frequency_hz: f64, density: f64) -> PsdPoint {
        PsdPoint { frequency_hz, density: DVec3::new(density, 0.0, 2.0 * density) }
    }

    #[test]
    fn power_is_the_integral_of_straight_lines_in_log_log() {
        // Flat, then falling as f^-2, then as 1/f; by hand: 9 s, s 10^2 (1/10 - 1/100), s 10^-2 100 ln 10.
        let s = 3e-12;
        let points = [point(1.0, s), point(10.0, s), point(100.0, s * 1e-2), point(1000.0, s * 1e-3)];
        let by_hand = s * (9.0 + 100.0 * 0.09 + 10.0_f64.ln());
        let variance = psd_variance(&points);
        assert!((variance.x / by_hand - 1.0).abs() < 1e-12, "{variance}");
        assert_eq!((variance.y, variance.z / variance.x), (0.0, 2.0));
    }

    #[test]
    fn a_piece_with_an_end_of_zero_is_empty() {
        let points = [point(1.0, 0.0), point(2.0, 1.0), point(3.0, 1.0), point(4.0, 0.0), point(9.0, 0.0)];
        assert!((psd_variance(&points).x - 1.0).abs() < 1e-12, "only from 2 to 3 Hz");
        let mut lines = Vec::new();
        realise(&points, 1, &mut lines);
        let is_inside = |line: &JitterLine| (2.0..=3.0).contains(&line.frequency_hz);
        assert!(!lines.is_empty() && lines.iter().all(is_inside), "{lines:?}");
    }

    #[test]
    fn frequency_and_power_are_inverse() {
        for slope_end in [1.0, 0.1, 0.01, 30.0] {
            let points = [point(2.0, 1.0), point(20.0, slope_end), point(50.0, 0.5)];
            let band = Band { points: &points, axis: 0 };
            let total = band.power_to(50.0);
            for share in [1e-6, 0.2, 0.5, 0.9, 0.999_999] {
                let frequency_hz = band.frequency_of(share * total);
                let found = band.power_to(frequency_hz) / total;
                assert!((found - share).abs() < 1e-9, "{found} for {share} at {frequency_hz} Hz");
            }
        }
    }

    #[test]
    fn lines_have_the_whole_power_and_the_same_bits_for_a_seed() {
        let points = [point(0.5, 1e-10), point(5.0, 4e-12), point(300.0, 1e-15)];
        let lines = |seed| {
            let mut lines = Vec::new();
            realise(&points, seed, &mut lines);
            lines
        };
        let power: DVec3 = lines(9).iter().map(|line| 0.5 * line.amplitude_rad * line.amplitude_rad).sum();
        let wanted = psd_variance(&points);
        assert!((power - wanted).abs().max_element() < 1e-9 * wanted.max_element(), "{power} for {wanted}");
        assert_eq!(lines(9), lines(9));
        assert_ne!(lines(9), lines(10));
        assert_eq!(lines(9).len(), 2 * LINES_PER_AXIS, "two axes have power");
    }

    #[test]
    fn invalid_density_is_refused() {
        assert_eq!(check(&[point(1.0, 1.0), point(1.0, 1.0)]), Err(JitterReject::NotRising { row: 1 }));
        assert_eq!(check(&[point(0.0, 1.0)]), Err(JitterReject::Illegal { row: 0 }));
        assert_eq!(check(&[point(1.0, 1.0), point(2.0, -1.0)]), Err(JitterReject::Illegal { row: 1 }));
        assert_eq!(check(&[point(1.0, f64::NAN)]), Err(JitterReject::Illegal { row: 0 }));
        let many: Vec<PsdPoint> = (1..=33).map(|i| point(f64::from(i), 1.0)).collect();
        assert_eq!(check(&many), Err(JitterReject::TooMany { got: 33, most: 32 }));
        assert_eq!(check(&many[1..]), Ok(()));
    }
}
