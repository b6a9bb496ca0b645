//! Field point -> relative illumination of the image plane, 0 to 1.
//!
//! `I = s v(t) cos^4 w`, with `t = tan w` the length of the star's tangents (X/Z, Y/Z) and `w` the field angle:
//!
//! * `s`, the unblocked share of the aperture: spider, filter frame. Central obscuration is not included: it belongs to
//!   the clear aperture of [`crate::optics::Radiometry`].
//! * `cos^4 w`: projected pupil, projected pixel, squared distance (Born & Wolf, Principles of Optics, 7th ed., 4.8.1).
//! * `v`, vignetting: the beam that passes the entrance window (radius R1) and the entrance pupil (R2) is what two circles
//!   share. At a field angle their centres are `d = L tan w` apart, L the distance of window and pupil along the axis.
//!   Shared area, for |R1 - R2| < d < R1 + R2:
//!   `A = R1^2 acos((d^2 + R1^2 - R2^2) / (2 d R1)) + R2^2 acos((d^2 + R2^2 - R1^2) / (2 d R2)) - K / 2`,
//!   `K^2 = (R1 + R2 + d) (R1 + R2 - d) (d + R1 - R2) (d - R1 + R2)`; below, the smaller circle; above, 0.
//!   `v = A / A(0)`, so 1 on the axis.
//!
//! Slope: `dA/dd` is minus the common chord, `K / d <= 2 min(R1, R2)`, so `|dv/dt| <= 2 L / (pi min(R1, R2))`, and `|d
//! cos^4 / dt| <= 1.036` (at t = 1/sqrt 5); [`Illumination::steepest_per_tangent`] is their sum. A star keeps the value
//! of its mid-exposure position: over a path of `p` px the error is at most `p / 2 / focal_px` times that slope, and
//! far less on a path that is symmetric about its middle. Sources are multiplied once, where they are placed, so that
//! the reference and the fast backends draw the same electrons by definition.
//!
//! The slope is continuous except for R1 = R2, on the axis. Limits: circles, no pupil aberration; the beam is not
//! traced. Tests below: area by counting, slope compared with differences, both sides of every limit.

use core::f64::consts::PI;
use glam::DVec2;

/// Largest |d cos^4 w / d tan w|: 4 t (1 + t^2)^-3 at t = 5^-1/2, rounded up.
const COS4_SLOPE: f64 = 1.036;

/// Relative illumination of an image plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Illumination {
    /// Vignetting by two circles; `None`: off.
    pub vignetting: Option<Vignetting>,
    /// True when the cosine's fourth power is applied.
    pub cos4: bool,
    /// Share of the aperture that is not blocked, 0 < s <= 1; 1: off.
    pub unblocked: f64,
}

/// Entrance window and entrance pupil.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vignetting {
    /// Radius of the entrance window, mm.
    pub window_radius_mm: f64,
    /// Radius of the entrance pupil, mm.
    pub pupil_radius_mm: f64,
    /// Distance between both along the axis, mm.
    pub distance_mm: f64,
}

impl Default for Illumination {
    fn default() -> Self {
        Self::EVEN
    }
}

impl Illumination {
    /// Uniform illumination.
    pub const EVEN: Self = Self { vignetting: None, cos4: false, unblocked: 1.0 };

    /// Returns true when it changes nothing.
    pub fn is_even(&self) -> bool {
        *self == Self::EVEN
    }

    /// Returns the relative illumination at a field point, given by the tangents (X/Z, Y/Z) of its direction without
    /// distortion.
    #[inline]
    pub fn at(&self, tangent: DVec2) -> f64 {
        if self.is_even() {
            return 1.0;
        }
        let t2 = tangent.length_squared();
        let cos4 = if self.cos4 { 1.0 / ((1.0 + t2) * (1.0 + t2)) } else { 1.0 };
        let vignetting = self.vignetting.map_or(1.0, |stops| stops.at(t2.sqrt()));
        self.unblocked * vignetting * cos4
    }

    /// Returns the bound of the change of [`Self::at`] per unit of tangent, anywhere.
    pub fn steepest_per_tangent(&self) -> f64 {
        let cos4 = if self.cos4 { COS4_SLOPE } else { 0.0 };
        self.unblocked * (cos4 + self.vignetting.map_or(0.0, |stops| stops.steepest_per_tangent()))
    }
}

impl Vignetting {
    /// Returns the share of the beam on the axis that is transmitted at `tan w`.
    fn at(&self, tangent: f64) -> f64 {
        let Self { window_radius_mm: a, pupil_radius_mm: b, distance_mm } = *self;
        let smaller = a.min(b);
        (overlap(a, b, distance_mm * tangent) / (PI * smaller * smaller)).clamp(0.0, 1.0)
    }

    fn steepest_per_tangent(&self) -> f64 {
        2.0 * self.distance_mm / (PI * self.window_radius_mm.min(self.pupil_radius_mm))
    }

    /// Returns `tan w` from which the field darkens, and from which it is dark.
    pub fn edges(&self) -> [f64; 2] {
        let Self { window_radius_mm: a, pupil_radius_mm: b, distance_mm } = *self;
        [(a - b).abs() / distance_mm, (a + b) / distance_mm]
    }
}

/// Returns the common area of circles of radius `a` and `b` with centres `d` apart.
fn overlap(a: f64, b: f64, d: f64) -> f64 {
    let smaller = a.min(b);
    if d <= (a - b).abs() {
        return PI * smaller * smaller;
    }
    if d >= a + b {
        return 0.0;
    }
    // Sector of radius `r` minus its triangle, as angles: rounding may make the cosine exceed 1.
    let half_angle = |r: f64, other: f64| ((d * d + r * r - other * other) / (2.0 * d * r)).clamp(-1.0, 1.0).acos();
    let kite = (a + b + d) * (a + b - d) * (d + a - b) * (d - a + b);
    a * a * half_angle(a, b) + b * b * half_angle(b, a) - 0.5 * kite.max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const STOPS: Vignetting = Vignetting { window_radius_mm: 14.0, pupil_radius_mm: 10.0, distance_mm: 60.0 };
    const ALL: Illumination = Illumination { vignetting: Some(STOPS), cos4: true, unblocked: 0.9 };

    /// Returns the shared area by counting cells of a fine grid.
    fn counted(a: f64, b: f64, d: f64) -> f64 {
        const N: i32 = 1500;
        let step = 2.0 * b / f64::from(N);
        let inside = |i: i32, j: i32| {
            let (x, y) = ((f64::from(i) + 0.5) * step - b, (f64::from(j) + 0.5) * step - b);
            x * x + y * y < b * b && (x - d).powi(2) + y * y < a * a
        };
        let cells: usize = (0..N).map(|j| (0..N).filter(|&i| inside(i, j)).count()).sum();
        cells as f64 * step * step
    }

    #[test]
    fn shared_area_is_what_counting_finds() {
        for (a, b, d) in
            [(14.0, 10.0, 3.9), (14.0, 10.0, 8.0), (10.0, 14.0, 8.0), (10.0, 10.0, 5.0), (14.0, 10.0, 23.0)]
        {
            let (got, wanted) = (overlap(a, b, d), counted(a, b, d));
            // Cells cut by a border: about 4 N of the N^2 inside, with random errors: far below 1e-4 of the circle.
            assert!((got - wanted).abs() < 1e-4 * PI * b * b, "({a}, {b}, {d}): {got} {wanted}");
        }
        assert!((overlap(14.0, 10.0, 8.0) - counted(14.0, 10.0, 8.1)).abs() > 1.0, "control: a tenth of a mm shows");
    }

    #[test]
    fn edges_have_two_sides() {
        let [darkens, dark] = STOPS.edges();
        assert_eq!([darkens, dark], [4.0 / 60.0, 24.0 / 60.0]);
        let v = |t: f64| Illumination { vignetting: Some(STOPS), ..Illumination::EVEN }.at(DVec2::new(0.6, 0.8) * t);
        assert_eq!(v(0.999 * darkens), 1.0);
        assert!(v(1.01 * darkens) < 1.0 && v(1.01 * darkens) > 0.999, "{}", v(1.01 * darkens));
        assert!(v(0.99 * dark) > 0.0 && v(0.99 * dark) < 1e-2);
        assert_eq!(v(1.001 * dark), 0.0);
        // Equal circles a half radius apart share 0.68504 of one (2/pi acos(1/4) - sqrt(15)/(8 pi)).
        let equal = Vignetting { window_radius_mm: 10.0, pupil_radius_mm: 10.0, distance_mm: 50.0 };
        let by_hand = 2.0 / PI * 0.25_f64.acos() - 15_f64.sqrt() / (8.0 * PI);
        assert!((equal.at(0.1) - by_hand).abs() < 1e-14 && (by_hand - 0.685_04).abs() < 1e-5, "{by_hand}");
    }

    #[test]
    fn factors_multiply_and_each_can_be_off() {
        let at = DVec2::new(0.2, -0.1);
        let only = |vignetting, cos4, unblocked| Illumination { vignetting, cos4, unblocked }.at(at);
        let w = at.length().atan();
        assert!((only(None, true, 1.0) - w.cos().powi(4)).abs() < 1e-15);
        assert_eq!(only(None, false, 0.9), 0.9);
        let product = only(None, true, 1.0) * only(Some(STOPS), false, 1.0) * 0.9;
        assert!((ALL.at(at) - product).abs() < 1e-15);
        assert_eq!(Illumination::EVEN.at(DVec2::new(3.0, 4.0)), 1.0, "off");
        assert!(ALL.at(DVec2::ZERO) == 0.9 && Illumination::EVEN.is_even() && !ALL.is_even());
    }

    #[test]
    fn the_slope_is_bounded_and_continuous() {
        let bound = ALL.steepest_per_tangent();
        let slope = |t: f64| (ALL.at(DVec2::X * (t + 1e-6)) - ALL.at(DVec2::X * (t - 1e-6))) / 2e-6;
        let slopes: Vec<f64> = (1..4400).map(|i| slope(f64::from(i) * 1e-4)).collect();
        let steepest = slopes.iter().fold(0.0_f64, |most, s| most.max(s.abs()));
        assert!(steepest <= bound && steepest > 0.3 * bound, "{steepest} of {bound}");
        // Continuous: at the two edges the chord grows like a square root, 0.09 of the bound within a step of 1e-4.
        let jump = slopes.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
        assert!(jump < 0.15 * bound, "{jump} of {bound}");
        assert!(slopes.iter().all(|s| *s <= 1e-9), "never brighter further out");
    }
}
