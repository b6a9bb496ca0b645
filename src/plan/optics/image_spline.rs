//! The cubic B-spline through the samples of an image, in f64.
//!
//! In: samples. Out: values between them. Natural ends: the second derivative vanishes there, so nothing is
//! extrapolated beyond the samples. Error of a smooth image: `h^4 |f''''| / 384` along each axis. Source: Unser,
//! Aldroubi and Eden, IEEE Trans. Signal Processing 41 (1993), 821. Checked by the tests of `psf_grid` and `measured`.

/// The cubic B-spline with natural ends through an image, by sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Spline {
    /// Coefficients, with one more than the samples on every side.
    coefficients: Vec<f64>,
    columns: usize,
    rows: usize,
}

impl Spline {
    /// Returns the spline through samples, row by row, `columns` in each.
    pub fn new(samples: &[f64], columns: usize) -> Self {
        let rows = samples.len() / columns;
        let stride = columns + 2;
        let mut out = vec![0.0; stride * (rows + 2)];
        for (row, line) in samples.chunks_exact(columns).enumerate() {
            natural(line.iter().copied(), &mut out[(row + 1) * stride..(row + 2) * stride]);
        }
        let mut column = vec![0.0; rows + 2];
        for x in 0..stride {
            natural((1..=rows).map(|y| out[y * stride + x]), &mut column);
            for (y, value) in column.iter().enumerate() {
                out[y * stride + x] = *value;
            }
        }
        Self { coefficients: out, columns, rows }
    }

    /// Returns the coefficients row by row, with one more on every side than there are samples.
    pub fn coefficients(&self) -> &[f64] {
        &self.coefficients
    }

    /// Returns its value at a place counted in samples from the first; 0 outside.
    pub fn at(&self, x: f64, y: f64) -> f64 {
        // Negated, so that NaN counts as outside.
        let inside = |v: f64, n: usize| v >= 0.0 && v <= n as f64 - 1.0;
        if !inside(x, self.columns) || !inside(y, self.rows) {
            return 0.0;
        }
        let ((first_x, wx), (first_y, wy)) = (taps(x, self.columns), taps(y, self.rows));
        let stride = self.columns + 2;
        let mut sum = 0.0;
        for (m, wy) in wy.iter().enumerate() {
            let at = (first_y + m) * stride + first_x;
            let row = &self.coefficients[at..at + 4];
            sum += wy * row.iter().zip(wx).map(|(c, wx)| c * wx).sum::<f64>();
        }
        sum
    }
}

/// Returns the first of four coefficients along an axis of `n` samples, and their weights.
fn taps(at: f64, n: usize) -> (usize, [f64; 4]) {
    // The last interval includes its end.
    let j = at.floor().clamp(0.0, n as f64 - 2.0);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the samples")]
    (j as usize, weights(at - j))
}

/// Solves one axis by elimination: `(c[i - 1] + 4 c[i] + c[i + 1]) / 6 = f[i]` with a vanishing second derivative at
/// both ends, where therefore `c = f`.
fn natural(samples: impl Iterator<Item = f64>, out: &mut [f64]) {
    let last = out.len() - 2;
    for (c, f) in out[1..=last].iter_mut().zip(samples) {
        *c = f;
    }
    let mut gains = vec![0.0; last];
    for i in 2..last {
        let below = 1.0 / (4.0 - gains[i - 1]);
        gains[i] = below;
        out[i] = (6.0 * out[i] - out[i - 1]) * below;
    }
    for i in (2..last).rev() {
        out[i] -= gains[i] * out[i + 1];
    }
    out[0] = 2.0 * out[1] - out[2];
    out[last + 1] = 2.0 * out[last] - out[last - 1];
}

/// Returns the weights of the coefficients at offsets -1, 0, 1, 2 for a point at a share `t` in [0, 1] after offset 0.
fn weights(t: f64) -> [f64; 4] {
    let r = 1.0 - t;
    [r * r * r / 6.0, (4.0 - 3.0 * t * t * (2.0 - t)) / 6.0, (4.0 - 3.0 * r * r * (2.0 - r)) / 6.0, t * t * t / 6.0]
}
