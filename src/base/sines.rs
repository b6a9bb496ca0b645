//! Sines of angles in turns, several at once.

/// Constant whose addition and subtraction rounds to whole numbers.
const ROUND: f64 = 6_755_399_441_055_744.0;
/// Taylor coefficients of `sin x / x - 1` in `x^2`, highest first.
const SINE_SERIES: [f64; 9] = [
    -1.0 / 121_645_100_408_832_000.0,
    1.0 / 355_687_428_096_000.0,
    -1.0 / 1_307_674_368_000.0,
    1.0 / 6_227_020_800.0,
    -1.0 / 39_916_800.0,
    1.0 / 362_880.0,
    -1.0 / 5040.0,
    1.0 / 120.0,
    -1.0 / 6.0,
];

/// Returns `sin(2 pi turns)` to 3e-16, for up to 1e15 turns: additions and products only, so the same bits on every
/// machine, and fast (a frame may need 200 lines at 4000 instants). Whole turns are removed exactly; the rest within a
/// quarter turn either way uses Taylor's series, whose first omitted term is `(pi/2)^21 / 21!` = 3e-16. Beyond, it is the sine of
/// some angle.
#[inline(always)]
pub fn sines_of_turns<const N: usize>(turns: [f64; N]) -> [f64; N] {
    let mut x = [0.0; N];
    let mut series = [0.0; N];
    for i in 0..N {
        let rest = (turns[i] - ((turns[i] + ROUND) - ROUND)).clamp(-0.5, 0.5);
        x[i] = core::f64::consts::TAU * rest.abs().min(0.5 - rest.abs()).copysign(rest);
    }
    for coefficient in SINE_SERIES {
        for i in 0..N {
            series[i] = series[i] * (x[i] * x[i]) + coefficient;
        }
    }
    core::array::from_fn(|i| x[i] + x[i] * (x[i] * x[i] * series[i]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;

    /// Tolerance: truncation 3e-16, rounding of `2 pi x` and of the sum: 2e-16 each.
    const SINE: f64 = 8e-16;

    fn sine_of_turns(turns: f64) -> f64 {
        sines_of_turns([turns])[0]
    }

    #[test]
    fn the_sine_is_that_of_the_library() {
        for i in -40_000..=40_000 {
            let turns = f64::from(i) / 16_384.0;
            let wanted = (TAU * turns.fract()).sin();
            // The library's own argument is rounded: 4e-16 at most for less than a turn.
            assert!((sine_of_turns(turns) - wanted).abs() < SINE + 5e-16, "{turns}");
        }
        assert_eq!([0.0, 0.5, -0.5, 1.0, 7.0].map(sine_of_turns), [0.0; 5], "exact at half turns");
        assert_eq!([0.25, 1.25, -0.75].map(sine_of_turns).map(|s| (s - 1.0).abs() < SINE), [true; 3]);
        let far = 123_456_789_012.0;
        assert!((sine_of_turns(far + 0.125) - 0.5_f64.sqrt()).abs() < 1e-4, "1e11 turns keep 1e-5 of one");
        assert!([1e17, -1e300].map(sine_of_turns).iter().all(|sine| sine.abs() <= 1.0), "of some angle");
    }
}
