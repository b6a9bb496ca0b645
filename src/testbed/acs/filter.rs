//! Structural filter: keeps the flexible mode out of the torque command.
//!
//! Input: torque command, one per control period. Output: filtered torque. Second-order sections by the bilinear
//! transform with the frequency warped to fit: Bristow-Johnson, "Cookbook formulae for audio EQ biquad filter
//! coefficients" (W3C note, 2021). Assumption: one fixed control period. Its phase lag is in closed form
//! ([`Biquad::response`]). Tests below: response against the filter run in time; unit gain at rest; depth of a notch.
//! Complex numbers are just what transfer functions need.

use core::f64::consts::TAU;
use core::ops::{Add, Div, Mul, Neg, Sub};
use glam::DVec3;

/// Structural filter in the loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StructuralFilter {
    /// None.
    None,
    /// Second-order low pass.
    LowPass {
        /// Corner frequency, Hz.
        corner_hz: f64,
        /// Damping ratio (0.707: Butterworth).
        damping: f64,
    },
    /// Notch.
    Notch {
        /// Centre, Hz.
        centre_hz: f64,
        /// Width between the -3 dB points, Hz.
        width_hz: f64,
    },
}

/// Second-order section `(b0 + b1 z^-1 + b2 z^-2) / (1 + a1 z^-1 + a2 z^-2)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Biquad {
    b: [f64; 3],
    a: [f64; 2],
    period_s: f64,
}

/// A section at work on a vector (direct form II transposed).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BiquadState {
    section: Biquad,
    kept: [DVec3; 2],
}

impl StructuralFilter {
    /// Returns the section of a control period; [`StructuralFilter::None`] passes everything. `None` when a frequency
    /// is not between zero and half the control frequency, or a width or damping is not positive.
    pub fn section(&self, period_s: f64) -> Option<Biquad> {
        let allowed = |hz: f64| (hz.is_finite() && hz > 0.0 && hz * period_s < 0.5).then_some(TAU * hz * period_s);
        match *self {
            Self::None => Some(Biquad { b: [1.0, 0.0, 0.0], a: [0.0; 2], period_s }),
            Self::LowPass { corner_hz, damping } => {
                let w = allowed(corner_hz)?;
                let alpha = w.sin() * damping;
                let side = (1.0 - w.cos()) / 2.0;
                (damping > 0.0).then(|| Biquad::normalised([side, 2.0 * side, side], alpha, w, period_s))
            }
            Self::Notch { centre_hz, width_hz } => {
                let w = allowed(centre_hz)?;
                let alpha = (allowed(width_hz)? / 2.0).tan();
                Some(Biquad::normalised([1.0, -2.0 * w.cos(), 1.0], alpha, w, period_s))
            }
        }
    }
}

impl Biquad {
    fn normalised(b: [f64; 3], alpha: f64, w: f64, period_s: f64) -> Self {
        let scale = 1.0 / (1.0 + alpha);
        Self { b: b.map(|v| v * scale), a: [-2.0 * w.cos() * scale, (1.0 - alpha) * scale], period_s }
    }

    /// Returns the complex gain at a frequency, with `z = exp(i w T)`: modulus and phase lag in closed form.
    pub fn response(&self, frequency_hz: f64) -> Complex {
        let back = Complex::unit(-TAU * frequency_hz * self.period_s);
        let twice = back * back;
        let above = Complex::real(self.b[0]) + back * self.b[1] + twice * self.b[2];
        above / (Complex::ONE + back * self.a[0] + twice * self.a[1])
    }

    /// Returns the state of this section for zero input.
    pub fn at_rest(self) -> BiquadState {
        BiquadState { section: self, kept: [DVec3::ZERO; 2] }
    }
}

impl BiquadState {
    /// Returns one period.
    pub fn step(&mut self, input: DVec3) -> DVec3 {
        let Biquad { b, a, .. } = self.section;
        let output = input * b[0] + self.kept[0];
        self.kept[0] = input * b[1] - output * a[0] + self.kept[1];
        self.kept[1] = input * b[2] - output * a[1];
        output
    }

    /// Sets the state for an `input` constant since long before (the gain of each section is one at rest).
    pub fn settle(&mut self, input: DVec3) {
        let Biquad { b, a, .. } = self.section;
        self.kept[1] = input * (b[2] - a[1]);
        self.kept[0] = input * (b[1] - a[0]) + self.kept[1];
    }
}

/// A complex number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Complex {
    /// Real part.
    pub re: f64,
    /// Imaginary part.
    pub im: f64,
}

impl Complex {
    /// One.
    pub const ONE: Self = Self { re: 1.0, im: 0.0 };

    /// Returns a real number.
    pub const fn real(re: f64) -> Self {
        Self { re, im: 0.0 }
    }

    /// Returns an imaginary number.
    pub const fn imaginary(im: f64) -> Self {
        Self { re: 0.0, im }
    }

    /// Returns `exp(i angle)`.
    pub fn unit(angle_rad: f64) -> Self {
        Self { re: angle_rad.cos(), im: angle_rad.sin() }
    }

    /// Modulus.
    pub fn modulus(self) -> f64 {
        self.re.hypot(self.im)
    }

    /// Returns the square of the modulus.
    pub fn modulus_squared(self) -> f64 {
        self.re * self.re + self.im * self.im
    }

    /// Returns the argument, rad, in `-pi..=pi`.
    pub fn argument_rad(self) -> f64 {
        self.im.atan2(self.re)
    }
}

impl Add for Complex {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        Self { re: self.re + b.re, im: self.im + b.im }
    }
}

impl Sub for Complex {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        Self { re: self.re - b.re, im: self.im - b.im }
    }
}

impl Mul for Complex {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        Self { re: self.re * b.re - self.im * b.im, im: self.re * b.im + self.im * b.re }
    }
}

impl Mul<f64> for Complex {
    type Output = Self;
    fn mul(self, b: f64) -> Self {
        Self { re: self.re * b, im: self.im * b }
    }
}

impl Div for Complex {
    type Output = Self;
    fn div(self, b: Self) -> Self {
        let n = b.modulus_squared();
        Self { re: (self.re * b.re + self.im * b.im) / n, im: (self.im * b.re - self.re * b.im) / n }
    }
}

impl Neg for Complex {
    type Output = Self;
    fn neg(self) -> Self {
        Self { re: -self.re, im: -self.im }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 0.1;
    const LOW_PASS: StructuralFilter = StructuralFilter::LowPass { corner_hz: 1.0, damping: 0.7 };
    const NOTCH: StructuralFilter = StructuralFilter::Notch { centre_hz: 1.2, width_hz: 0.4 };
    /// Transients of 400 periods of filters with 1 Hz corners have died out; the rest is rounding.
    const STEADY: f64 = 1e-9;

    /// Returns the gain and phase measured on the running filter, by correlation over whole cycles.
    fn measured(filter: StructuralFilter, hz: f64) -> Complex {
        let mut state = filter.section(PERIOD_S).expect("in range").at_rest();
        let mut sum = Complex::real(0.0);
        for k in 0..2400 {
            let angle = TAU * hz * PERIOD_S * f64::from(k);
            let out = state.step(DVec3::X * angle.cos()).x;
            if k >= 400 {
                sum = sum + Complex::unit(-angle) * (out / 1000.0);
            }
        }
        sum
    }

    #[test]
    fn the_response_is_that_of_the_running_filter() {
        for filter in [LOW_PASS, NOTCH, StructuralFilter::None] {
            let section = filter.section(PERIOD_S).expect("in range");
            for hz in [0.05, 0.5, 1.0, 1.3, 3.0] {
                let (got, wanted) = (measured(filter, hz), section.response(hz));
                assert!((got - wanted).modulus() < STEADY, "{filter:?} at {hz} Hz: {got:?} for {wanted:?}");
            }
        }
        let other = LOW_PASS.section(PERIOD_S).expect("in range").response(0.51);
        assert!((measured(LOW_PASS, 0.5) - other).modulus() > 1e-3, "another frequency must differ");
    }

    #[test]
    fn rest_passes_and_the_mode_does_not() {
        for filter in [LOW_PASS, NOTCH] {
            let section = filter.section(PERIOD_S).expect("in range");
            assert!((section.response(0.0) - Complex::ONE).modulus() < 1e-12, "{filter:?} at rest");
            let mut state = section.at_rest();
            state.settle(DVec3::Y);
            assert!((state.step(DVec3::Y) - DVec3::Y).length() < 1e-12, "settled");
        }
        let notch = NOTCH.section(PERIOD_S).expect("in range");
        assert!(notch.response(1.2).modulus() < 1e-12, "centre");
        let low = LOW_PASS.section(PERIOD_S).expect("in range");
        // At its corner a second-order low pass has gain 1 / (2 zeta) and a lag of 90 degrees.
        let corner = low.response(1.0);
        assert!((corner.modulus() - 1.0 / 1.4).abs() < 1e-12, "{corner:?}");
        assert!((corner.argument_rad() + core::f64::consts::FRAC_PI_2).abs() < 1e-12, "{corner:?}");
    }

    #[test]
    fn frequencies_past_half_the_control_frequency_are_refused() {
        assert_eq!(StructuralFilter::LowPass { corner_hz: 5.0, damping: 0.7 }.section(PERIOD_S), None);
        assert_eq!(StructuralFilter::Notch { centre_hz: 1.0, width_hz: 0.0 }.section(PERIOD_S), None);
    }
}

#[cfg(test)]
mod complex_tests {
    use super::*;

    #[test]
    fn quotients_undo_products_and_angles_add() {
        let (a, b) = (Complex { re: 1.5, im: -0.25 }, Complex { re: -0.5, im: 2.0 });
        let back = a * b / b;
        assert!((back - a).modulus() < 1e-15, "{back:?}");
        let turned = Complex::unit(0.3) * Complex::unit(0.4) * 2.0;
        assert!((turned.argument_rad() - 0.7).abs() < 1e-15 && (turned.modulus() - 2.0).abs() < 1e-15, "{turned:?}");
        assert_eq!(a + -a, Complex::ONE - Complex::ONE, "sums");
    }
}
