//! Defocus: the exact transfer function of a defocused pupil, and the geometric blur disc that approximates it.
//!
//! Frequency -> factor. A focus error `d` (image plane to focus) is a wavefront error of `W20 = d / (8 N^2 lambda)`
//! waves at the edge of the pupil (Born and Wolf, 8.8, for pupils slow against f/1).
//! * **exact**: autocorrelation of the annular pupil with the phase `2 pi W20 rho^2` (Hopkins, Proc. R. Soc. A 231, 91,
//!   1955). Along the shift `s = 2 v` the phases differ by `4 pi W20 s x`; the chord across the common area is known, so
//!   one integral over `x` is left, between the points where circles meet, by Gauss-Legendre rules in the angle that
//!   takes the square roots out of the ends. Error below 1e-11 up to [`LARGEST_W20_WAVES`]. It *includes diffraction*.
//! * **geometric**: transform of the blur disc, for a clear pupil `2 J1(x) / x`, `x = pi d f / N = 8 pi W20 v`; with an
//!   obscuration the disc is a ring. It multiplies the diffraction term. Rays know no wavelength: the product is right
//!   without defocus and with very much, and off by up to 0.29 in between. Domain: up to [`GEOMETRIC_SMALL_WAVES`] or
//!   from [`GEOMETRIC_LARGE_WAVES`], where it errs by at most [`GEOMETRIC_ERROR`]; the rest is refused.
//!
//! The tests compare the exact form with a pupil summed on a grid, and the approximation with it on both sides of its
//! domain's limit.

use crate::optics::quadrature::{Node, gauss_legendre};
use core::f64::consts::PI;

/// Largest wavefront error of the exact form, waves: 16 rings in the middle of the star; beyond, the image is the
/// pupil's shadow, for which a measured PSF is better.
pub const LARGEST_W20_WAVES: f64 = 16.0;
/// Largest wavefront error of the lower domain of the geometric form, waves.
pub const GEOMETRIC_SMALL_WAVES: f64 = 0.1;
/// Smallest wavefront error of the upper domain of the geometric form, waves.
pub const GEOMETRIC_LARGE_WAVES: f64 = 5.0;
/// Largest error of diffraction times the geometric form in its domain, at any frequency, obscuration up to 0.7.
pub const GEOMETRIC_ERROR: f64 = 0.1;

/// Returns the wavefront error at the edge of the pupil, waves, of a focus error in um at a wavelength in nm.
pub fn w20_waves(defocus_um: f64, f_number: f64, wavelength_nm: f64) -> f64 {
    defocus_um * 1e3 / (8.0 * f_number * f_number * wavelength_nm)
}

/// Returns the geometric form at the share `v` of the diffraction cutoff; multiplies the diffraction term.
///
/// `None`: outside its domain.
pub fn geometric(v: f64, w20_waves: f64, obscuration: f64) -> Option<f64> {
    holds_geometrically(w20_waves).then(|| blur_disc(v, w20_waves, obscuration))
}

/// Returns true when a wavefront error is in the domain of the geometric form.
pub fn holds_geometrically(w20_waves: f64) -> bool {
    w20_waves.abs() <= GEOMETRIC_SMALL_WAVES || w20_waves.abs() >= GEOMETRIC_LARGE_WAVES
}

/// Returns the transform of a uniform disc (or ring) of any size.
pub(super) fn blur_disc(v: f64, w20_waves: f64, e: f64) -> f64 {
    let x = 8.0 * PI * w20_waves.abs() * v;
    (jinc(x) - e * e * jinc(e * x)) / (1.0 - e * e)
}

/// Returns `2 J1(x) / x`, 1 at 0.
fn jinc(x: f64) -> f64 {
    if x < 1e-6 { 1.0 - x * x / 8.0 } else { 2.0 * libm::j1(x) / x }
}

/// The exact transfer function of one wavefront error and obscuration, diffraction included.
#[derive(Debug, Clone)]
pub struct DefocusedPupil {
    w20_waves: f64,
    obscuration: f64,
    nodes: Vec<Node>,
}

impl DefocusedPupil {
    /// Returns the pupil; `None` for more than [`LARGEST_W20_WAVES`].
    pub fn new(w20_waves: f64, obscuration: f64) -> Option<Self> {
        let size = w20_waves.abs();
        // Up to W20 oscillations of the integrand on a piece, half of them in its middle third; 24 nodes are needed in
        // addition.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 16")]
        let extra = (6.0 * size).ceil().max(0.0) as usize;
        let nodes = (size <= LARGEST_W20_WAVES).then(|| gauss_legendre(24 + extra))?;
        Some(Self { w20_waves, obscuration, nodes })
    }

    /// Returns the factor at the share `v` of the diffraction cutoff.
    pub fn mtf(&self, v: f64) -> f64 {
        let (v, e) = (v.abs(), self.obscuration);
        if v >= 1.0 {
            return 0.0;
        }
        // Half the shift; edges of pieces on one side of the middle, the integrand being even.
        let end = 1.0 - v;
        let blocked_out = if v > 0.0 { (1.0 - e * e) / (4.0 * v) } else { f64::INFINITY };
        let mut edges = [0.0, (v - e).max(0.0), v + e, blocked_out, end].map(|x: f64| x.min(end));
        edges.sort_by(f64::total_cmp);
        let sum: f64 = edges.windows(2).map(|edge| self.piece(v, edge[0], edge[1])).sum();
        4.0 * sum / (PI * (1.0 - e * e))
    }

    /// Returns the integral of the chord above the axis times the phase over `from..to`.
    fn piece(&self, v: f64, from: f64, to: f64) -> f64 {
        if to - from < 1e-15 {
            return 0.0;
        }
        let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
        let rate = 8.0 * PI * self.w20_waves * v;
        let mut sum = 0.0;
        for node in &self.nodes {
            // x = middle + half sin(angle): at both ends the angle turns a square root into a smooth function.
            let (sin, cos) = (PI * node.x).sin_cos();
            let x = middle + half * sin;
            sum += node.weight * cos * self.half_chord(v, x) * (rate * x).cos();
        }
        sum * half * PI
    }

    /// Returns the height above the axis of the area common to both pupils, `x` from the middle between them.
    fn half_chord(&self, v: f64, x: f64) -> f64 {
        let (far, near) = (x + v, x - v);
        let outer = (1.0 - far * far).max(0.0).sqrt();
        let inner = (self.obscuration * self.obscuration - near * near).max(0.0).sqrt();
        (outer - inner).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::mtf::diffraction;

    /// Returns the real part of the pupil's autocorrelation, summed over a grid, without chords or symmetry.
    fn summed(v: f64, w20: f64, e: f64) -> f64 {
        let n = 1000;
        let at = |i: i32| (f64::from(i) + 0.5) / f64::from(n) * 4.0 - 2.0;
        let inside = |x: f64, y: f64| (e * e..1.0).contains(&(x * x + y * y));
        let (mut both, mut one) = (0.0, 0.0);
        for j in 0..n {
            for i in 0..n {
                let (x, y) = (at(i), at(j));
                one += f64::from(u8::from(inside(x, y)));
                if inside(x - v, y) && inside(x + v, y) {
                    let phase = |x: f64| 2.0 * PI * w20 * (x * x + y * y);
                    both += (phase(x + v) - phase(x - v)).cos();
                }
            }
        }
        both / one
    }

    #[test]
    fn the_exact_form_is_the_autocorrelation_of_the_pupil() {
        const GRID: f64 = 1e-3;
        for (w20, e) in [(0.3, 0.0), (1.7, 0.0), (0.6, 0.35), (2.2, 0.35)] {
            let pupil = DefocusedPupil::new(w20, e).unwrap();
            for v in [0.06, 0.21, 0.37, 0.55, 0.83] {
                let (exact, grid) = (pupil.mtf(v), summed(v, w20, e));
                assert!((exact - grid).abs() < GRID, "W20 {w20}, e {e}, v {v}: {exact} against {grid}");
            }
        }
        let wrong = DefocusedPupil::new(0.62, 0.35).unwrap().mtf(0.37) - summed(0.37, 0.6, 0.35);
        assert!(wrong.abs() > GRID, "0.02 waves more must show: {wrong}");
    }

    #[test]
    fn in_focus_it_is_diffraction_and_its_quadrature_has_converged() {
        for e in [0.0, 0.2, 0.5, 0.9] {
            let pupil = DefocusedPupil::new(0.0, e).unwrap();
            for i in 0..=100 {
                let v = f64::from(i) / 100.0;
                let (ours, closed) = (pupil.mtf(v), diffraction::at_share_of_cutoff(v, e));
                assert!((ours - closed).abs() < 1e-11, "e {e}, v {v}: {ours} against {closed}");
            }
        }
        for w20 in [1.0, 5.0, LARGEST_W20_WAVES] {
            let pupil = DefocusedPupil::new(w20, 0.3).unwrap();
            let finer = DefocusedPupil { nodes: gauss_legendre(2 * pupil.nodes.len()), ..pupil.clone() };
            for i in 0..100 {
                let v = f64::from(i) / 100.0;
                assert!((pupil.mtf(v) - finer.mtf(v)).abs() < 1e-12, "W20 {w20}, v {v}");
            }
        }
        assert!(DefocusedPupil::new(16.1, 0.0).is_none() && DefocusedPupil::new(f64::NAN, 0.0).is_none(), "edges");
    }

    /// Returns the largest difference of the approximation from the truth, over all frequencies.
    fn geometric_error(w20: f64, e: f64) -> f64 {
        let pupil = DefocusedPupil::new(w20, e).unwrap();
        let error = |v: f64| diffraction::at_share_of_cutoff(v, e) * blur_disc(v, w20, e) - pupil.mtf(v);
        (1..400).map(|i| error(f64::from(i) / 400.0).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn the_geometric_form_holds_in_its_domain_and_not_beside_it() {
        for e in [0.0, 0.2, 0.35, 0.5, 0.7] {
            for w20 in [0.03, GEOMETRIC_SMALL_WAVES, GEOMETRIC_LARGE_WAVES, 8.0, 16.0] {
                let error = geometric_error(w20, e);
                assert!(error <= GEOMETRIC_ERROR, "W20 {w20}, e {e}: {error}");
            }
            for w20 in [0.15, 0.3, 1.0] {
                assert!(geometric_error(w20, e) > GEOMETRIC_ERROR, "W20 {w20}, e {e}: it would hold here");
            }
        }
        assert!(geometric(0.3, -0.1, 0.0).is_some() && geometric(0.3, 5.0, 0.0).is_some(), "inside");
        assert!(geometric(0.3, 0.1001, 0.0).is_none() && geometric(0.3, -4.999, 0.0).is_none(), "outside");
        assert!(geometric(0.3, f64::NAN, 0.0).is_none(), "no number");
    }

    #[test]
    fn a_blur_disc_is_the_transform_of_its_rays() {
        // Rays fill a ring uniformly; x / 2 pi cycles cross its radius.
        let (w20, v, e) = (0.08_f64, 0.4, 0.3_f64);
        let cycles = 4.0 * w20 * v;
        let n = 4000;
        let ring = |i: i32| {
            let x = (f64::from(i) + 0.5) / f64::from(n) * 2.0 - 1.0;
            let chord = (1.0 - x * x).sqrt() - (e * e - x * x).max(0.0).sqrt();
            [chord, chord * (2.0 * PI * cycles * x).cos()]
        };
        let [all, wave] = (0..n).map(ring).fold([0.0, 0.0], |sum, term| [sum[0] + term[0], sum[1] + term[1]]);
        assert!((blur_disc(v, w20, e) - wave / all).abs() < 1e-5, "{} {}", blur_disc(v, w20, e), wave / all);
        // 800 um at f/8 and 620 nm: 2.52 waves, a disc of 100 um.
        assert!((w20_waves(800.0, 8.0, 620.0) - 2.520_161).abs() < 1e-6, "by hand");
    }
}
