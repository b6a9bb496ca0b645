//! Diffraction at a circular pupil, clear or with a central obscuration.
//!
//! Frequency -> factor: the normalised autocorrelation of the pupil (Goodman, Introduction to Fourier Optics, 3rd ed.,
//! 6.3), for an annulus `[a(1, 1) - 2 a(1, e) + a(e, e)] / (pi (1 - e^2))` with `a(R, r)` the area common to two
//! circles `2 v` apart; written out, O'Neill's closed form (J. Opt. Soc. Am. 46, 285, 1956). `v = f lambda N` is the
//! share of the cutoff `1 / (lambda N)`, `e` the linear obscuration, `0 <= e < 1`. Without obscuration it is `2/pi
//! [acos v - v sqrt(1 - v^2)]`. The tests compare it with a sum over a gridded pupil and with both written forms.

use core::f64::consts::PI;

/// Returns the factor at `frequency` (cycles/px); `lambda_n_px` is wavelength times F-number over pixel pitch.
pub fn mtf(frequency: f64, lambda_n_px: f64, obscuration: f64) -> f64 {
    at_share_of_cutoff(frequency.abs() * lambda_n_px, obscuration)
}

/// Returns the cutoff frequency, cycles/px.
pub fn cutoff(lambda_n_px: f64) -> f64 {
    1.0 / lambda_n_px
}

/// Returns the factor at the share `v` of the cutoff.
pub(super) fn at_share_of_cutoff(v: f64, e: f64) -> f64 {
    if v >= 1.0 {
        return 0.0;
    }
    let apart = 2.0 * v;
    let outer = common_area(1.0, 1.0, apart);
    if e <= 0.0 {
        return outer / PI;
    }
    let common = outer - 2.0 * common_area(1.0, e, apart) + common_area(e, e, apart);
    (common / (PI * (1.0 - e * e))).max(0.0)
}

/// Returns the slope at frequency 0 against the share of the cutoff: the cone that makes the PSF's wings fall as
/// `r^-3`.
///
/// `a(R, R)` loses `2 R` per unit of distance, the inner circle nothing: `-(4 + 4 e) / (pi (1 - e^2))`.
pub fn slope_at_zero(obscuration: f64) -> f64 {
    -4.0 / (PI * (1.0 - obscuration))
}

/// Returns the common area of circles of radius `big >= small` with centres `apart`.
fn common_area(big: f64, small: f64, apart: f64) -> f64 {
    if apart >= big + small {
        return 0.0;
    }
    if apart <= big - small {
        return PI * small * small;
    }
    // Two circular segments on the common chord, `x` from the big circle's centre.
    let x = (apart * apart + big * big - small * small) / (2.0 * apart);
    segment(big, x) + segment(small, apart - x)
}

/// Returns the area of a circle beyond a chord at distance `x` from its centre (negative: the larger part).
fn segment(radius: f64, x: f64) -> f64 {
    let share = (x / radius).clamp(-1.0, 1.0);
    radius * radius * (share.acos() - share * (1.0 - share * share).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the share of the pupil that a copy of it, moved by `2 v` radii, covers: midpoints of a fine grid.
    fn counted(v: f64, e: f64) -> f64 {
        let n = 1200;
        let at = |i: i32| (f64::from(i) + 0.5) / f64::from(n) * 4.0 - 2.0;
        let is_open = |x: f64, y: f64| (e * e..1.0).contains(&(x * x + y * y));
        let (mut both, mut one) = (0_u32, 0_u32);
        for j in 0..n {
            for i in 0..n {
                let (x, y) = (at(i), at(j));
                one += u32::from(is_open(x, y));
                both += u32::from(is_open(x - v, y) && is_open(x + v, y));
            }
        }
        f64::from(both) / f64::from(one)
    }

    /// Returns O'Neill's three parts as printed.
    fn oneill(v: f64, e: f64) -> f64 {
        let clear = |v: f64| if v < 1.0 { 2.0 / PI * (v.acos() - v * (1.0 - v * v).sqrt()) } else { 0.0 };
        let a = clear(v);
        let b = e * e * clear(v / e);
        let c = if v <= (1.0 - e) / 2.0 {
            -2.0 * e * e
        } else if v < (1.0 + e) / 2.0 {
            let phi = ((1.0 + e * e - 4.0 * v * v) / (2.0 * e)).acos();
            -2.0 * e * e + 2.0 * e / PI * phi.sin() + (1.0 + e * e) / PI * phi
                - 2.0 * (1.0 - e * e) / PI * ((1.0 + e) / (1.0 - e) * (phi / 2.0).tan()).atan()
        } else {
            0.0
        };
        (a + b + c) / (1.0 - e * e)
    }

    #[test]
    fn it_is_the_autocorrelation_of_the_pupil() {
        // The grid counts areas to the length of the edges times a cell, averaged over many crossings.
        const GRID: f64 = 8e-4;
        for e in [0.0, 0.3, 0.7] {
            for v in [0.05, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95] {
                let (exact, grid) = (at_share_of_cutoff(v, e), counted(v, e));
                assert!((exact - grid).abs() < GRID, "e {e}, v {v}: {exact} against {grid}");
            }
        }
        let wrong = (at_share_of_cutoff(0.35, 0.31) - counted(0.35, 0.3)).abs();
        assert!(wrong > GRID, "an obscuration off by 0.01 must show: {wrong}");
    }

    #[test]
    fn it_is_oneills_form() {
        for e in [0.1, 0.3, 0.5, 0.9] {
            for i in 0..100 {
                let v = f64::from(i) / 100.0 + 0.003;
                let (ours, printed) = (at_share_of_cutoff(v, e), oneill(v, e));
                assert!((ours - printed).abs() < 1e-14 / (1.0 - e), "e {e}, v {v}: {ours} against {printed}");
            }
        }
    }

    #[test]
    fn it_begins_at_one_with_its_slope_and_ends_at_the_cutoff() {
        for e in [0.0, 0.3, 0.8] {
            assert!((mtf(0.0, 0.5, e) - 1.0).abs() < 1e-15, "at 0, e {e}");
            let step = 1e-6;
            let slope = (at_share_of_cutoff(step, e) - 1.0) / step;
            assert!((slope / slope_at_zero(e) - 1.0).abs() < 1e-5, "e {e}: {slope} against {}", slope_at_zero(e));
            let edge = cutoff(0.5);
            assert!(mtf(edge * 0.999, 0.5, e) > 0.0 && mtf(edge, 0.5, e) == 0.0, "both sides of the cutoff, e {e}");
        }
    }
}
