//! Complex numbers: just what transfer functions need.

use core::ops::{Add, Div, Mul, Neg, Sub};

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
