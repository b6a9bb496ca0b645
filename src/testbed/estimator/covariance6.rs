//! The 6 x 6 covariance of attitude error and gyro-bias error, kept as three 3 x 3 blocks.
//!
//! Attitude error `a`: rotation vector from the estimate to the truth, rad, body axes. Bias error `b`: truth minus
//! estimate, rad/s, body axes. Symmetric, so the fourth block is a transpose. Test below: the same steps with plain
//! 6 x 6 arrays.

use glam::{DMat3, DVec3};

/// Covariance of (attitude error, bias error).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Covariance6 {
    /// Attitude with attitude, rad^2.
    pub attitude: DMat3,
    /// Attitude (rows) with bias (columns), rad^2/s.
    pub cross: DMat3,
    /// Bias with bias, rad^2/s^2.
    pub bias: DMat3,
}

/// How errors move over one gyro step: `a' = attitude a + cross b`, `b' = b`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turn {
    /// Attitude error to attitude error.
    pub attitude: DMat3,
    /// Bias error to attitude error, s.
    pub cross: DMat3,
}

/// Kalman gain of an attitude measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gain {
    /// Innovation to attitude.
    pub attitude: DMat3,
    /// Innovation to bias, 1/s.
    pub bias: DMat3,
}

impl Covariance6 {
    /// Returns the independent attitude and bias errors.
    pub fn independent(attitude: DMat3, bias: DMat3) -> Self {
        Self { attitude, cross: DMat3::ZERO, bias }
    }

    /// Returns `turn P turn' + noise`.
    pub fn propagated(&self, turn: &Turn, noise: &Self) -> Self {
        let (f, g) = (turn.attitude, turn.cross);
        let moved = f * self.cross + g * self.bias;
        let attitude = (f * self.attitude + g * self.cross.transpose()) * f.transpose() + moved * g.transpose();
        Self {
            attitude: symmetric(attitude + noise.attitude),
            cross: moved + noise.cross,
            bias: self.bias + noise.bias,
        }
    }

    /// Returns the gain for an innovation whose covariance has the inverse `inverse_innovation`.
    pub fn gain(&self, inverse_innovation: &DMat3) -> Gain {
        Gain { attitude: self.attitude * *inverse_innovation, bias: self.cross.transpose() * *inverse_innovation }
    }

    /// Returns the covariance after a measurement with noise `r`, used with `gain`: Joseph's form, which stays positive
    /// for any gain (Bucy and Joseph 1968; Markley and Crassidis 2014, eq. 12.83).
    pub fn updated(&self, gain: &Gain, r: &DMat3) -> Self {
        let left = DMat3::IDENTITY - gain.attitude;
        let (ka, kb) = (gain.attitude, gain.bias);
        let kept = self.cross.transpose() - kb * self.attitude;
        let bias = self.bias - kb * self.cross - kept * kb.transpose() + kb * *r * kb.transpose();
        Self {
            attitude: symmetric(left * self.attitude * left.transpose() + ka * *r * ka.transpose()),
            cross: left * kept.transpose() + ka * *r * kb.transpose(),
            bias: symmetric(bias),
        }
    }

    /// Returns the standard deviations of the attitude error, rad, body axes.
    pub fn attitude_sigma_rad(&self) -> DVec3 {
        root_of_diagonal(&self.attitude)
    }

    /// Returns the standard deviations of the bias error, rad/s, body axes.
    #[cfg(test)]
    pub fn bias_sigma_rad_s(&self) -> DVec3 {
        root_of_diagonal(&self.bias)
    }
}

fn root_of_diagonal(m: &DMat3) -> DVec3 {
    DVec3::new(m.x_axis.x, m.y_axis.y, m.z_axis.z).max(DVec3::ZERO).map(f64::sqrt)
}

fn symmetric(m: DMat3) -> DMat3 {
    (m + m.transpose()) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;

    type Plain = [[f64; 6]; 6];

    /// A few ulp of sums of 12 products of order 10.
    const ROUNDING: f64 = 1e-12;

    fn plain(aa: DMat3, ab: DMat3, ba: DMat3, bb: DMat3) -> Plain {
        core::array::from_fn(|i| {
            core::array::from_fn(|j| {
                let block = [[aa, ab], [ba, bb]][i / 3][j / 3];
                block.col(j % 3)[i % 3]
            })
        })
    }

    fn product(a: &Plain, b: &Plain) -> Plain {
        core::array::from_fn(|i| core::array::from_fn(|j| (0..6).map(|k| a[i][k] * b[k][j]).sum()))
    }

    fn transpose(a: &Plain) -> Plain {
        core::array::from_fn(|i| core::array::from_fn(|j| a[j][i]))
    }

    fn sum(a: &Plain, b: &Plain) -> Plain {
        core::array::from_fn(|i| core::array::from_fn(|j| a[i][j] + b[i][j]))
    }

    fn distance(p: &Covariance6, wanted: &Plain) -> f64 {
        let got = plain(p.attitude, p.cross, p.cross.transpose(), p.bias);
        (0..36).map(|k| (got[k / 6][k % 6] - wanted[k / 6][k % 6]).abs()).fold(0.0, f64::max)
    }

    fn matrix(seed: f64) -> DMat3 {
        DMat3::from_cols_array(&core::array::from_fn(|k| (seed + 1.7 * k as f64).sin()))
    }

    fn example() -> Covariance6 {
        let (a, b, c) = (matrix(1.0), matrix(2.0), matrix(3.0));
        let bias = b * b.transpose() + c * c.transpose();
        Covariance6 { attitude: a * a.transpose() + DMat3::IDENTITY, cross: a * b.transpose(), bias }
    }

    #[test]
    fn steps_are_those_of_plain_6_x_6_arithmetic() {
        let p = example();
        let p6 = plain(p.attitude, p.cross, p.cross.transpose(), p.bias);
        let turn = Turn { attitude: matrix(4.0), cross: matrix(5.0) };
        let f6 = plain(turn.attitude, turn.cross, DMat3::ZERO, DMat3::IDENTITY);
        let wanted = sum(&product(&product(&f6, &p6), &transpose(&f6)), &p6);
        let got = p.propagated(&turn, &p);
        assert!(distance(&got, &wanted) < ROUNDING, "propagated: {}", distance(&got, &wanted));

        let gain = Gain { attitude: matrix(6.0), bias: matrix(7.0) };
        let r = DMat3::from_diagonal(DVec3::new(0.1, 0.2, 0.3));
        let i6 = plain(DMat3::IDENTITY - gain.attitude, DMat3::ZERO, -gain.bias, DMat3::IDENTITY);
        let k6 = plain(gain.attitude, DMat3::ZERO, gain.bias, DMat3::ZERO);
        let r6 = plain(r, DMat3::ZERO, DMat3::ZERO, DMat3::ZERO);
        let kept = product(&product(&i6, &p6), &transpose(&i6));
        let wanted = sum(&kept, &product(&product(&k6, &r6), &transpose(&k6)));
        let mut got = p.updated(&gain, &r);
        assert!(distance(&got, &wanted) < ROUNDING, "updated: {}", distance(&got, &wanted));
        got.cross.x_axis.y += 1e-9;
        assert!(distance(&got, &wanted) > ROUNDING, "a changed element must show");
    }

    #[test]
    fn the_optimal_gain_takes_variance_away() {
        let p = example();
        let r = DMat3::from_diagonal(DVec3::new(0.1, 0.2, 0.3));
        let updated = p.updated(&p.gain(&(p.attitude + r).inverse()), &r);
        let short = (DMat3::IDENTITY - p.attitude * (p.attitude + r).inverse()) * p.attitude;
        assert!((updated.attitude - short).abs_diff_eq(DMat3::ZERO, ROUNDING), "{updated:?} for {short}");
        assert!(updated.bias_sigma_rad_s().cmplt(p.bias_sigma_rad_s()).all(), "bias learns from attitude");
    }
}
