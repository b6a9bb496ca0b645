//! Cubic B-spline interpolation on a regular grid: prefilter and weights.
//!
//! The prefilter turns samples into spline coefficients (recursive filter, pole `sqrt(3) - 2`, zero beyond the ends);
//! the four weights evaluate the spline between grid points. Error `h^4 |f''''| / 384` at most, nine times smaller
//! than Lagrange's cubic. Source: Unser, Aldroubi and Eden, IEEE Trans. Signal Processing 41 (1993), 821.

/// Samples -> spline coefficients, in place. The samples are taken to vanish beyond both ends.
#[inline(always)]
pub fn prefilter(samples: &mut [f32]) {
    const POLE: f32 = -0.267_949_2;
    let mut before = 0.0;
    for value in samples.iter_mut() {
        before = *value + POLE * before;
        *value = before;
    }
    // The causal pass goes on ringing beyond the last sample; its anticausal sum there is geometric.
    let mut after = -before * POLE * POLE / (1.0 - POLE * POLE) / POLE;
    for value in samples.iter_mut().rev() {
        after = POLE * (after - *value);
        *value = after;
    }
    for value in samples {
        *value *= 6.0;
    }
}

/// Returns weights of the coefficients at offsets -1, 0, 1, 2 for a point a share `t` in [0, 1) past offset 0.
#[inline(always)]
pub fn weights(t: f32) -> [f32; 4] {
    let r = 1.0 - t;
    let sixth = 1.0 / 6.0;
    let (t3, r3) = (t * t * t, r * r * r);
    let w1 = sixth * (4.0 - 3.0 * t * t * (2.0 - t));
    let w2 = sixth * (4.0 - 3.0 * r * r * (2.0 - r));
    [sixth * r3, w1, w2, sixth * t3]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bump(x: f32) -> f32 {
        (-0.5 * x * x).exp()
    }

    #[test]
    fn reproduces_samples_and_interpolates_a_gaussian_to_fourth_order() {
        for (step, bound) in [(0.5_f32, 6e-4_f32), (0.25, 4e-5), (0.125, 3e-6)] {
            let half = (7.0 / step) as i32;
            let mut grid: Vec<f32> = (-half..=half).map(|i| bump(i as f32 * step)).collect();
            prefilter(&mut grid);
            let value = |x: f32| {
                let s = x / step + half as f32;
                let j = s.floor();
                let w = weights(s - j);
                let first = j as usize - 1;
                (0..4).map(|m| w[m] * grid[first + m]).sum::<f32>()
            };
            let mut worst = 0.0_f32;
            for k in -400..400 {
                let x = k as f32 * 0.01;
                worst = worst.max((value(x) - bump(x)).abs());
            }
            // h^4 * 3 / 384 and the f32 floor.
            assert!(worst < bound, "step {step}: {worst:e}");
            assert!(worst > bound / 20.0, "step {step}: the bound is not idle: {worst:e}");
        }
    }

    #[test]
    fn weights_sum_to_one() {
        for t in [0.0_f32, 0.25, 0.5, 0.999] {
            let sum: f32 = weights(t).iter().sum();
            assert!((sum - 1.0).abs() < 3e-7, "t {t}: {sum}");
        }
    }
}
