//! Luminance <-> the sixteen bits that a frame has for it: fine steps for faint light, coarse ones for bright.
//!
//! The greys of a display lie dense near black: grey 1 of 256 has 5e-6 of the full luminance at a gamma of 2.2, and
//! dithering shows parts of that. In even steps, sixteen bits would round such light to nothing before it is dithered,
//! and take faint stars off the screen. So a code is straight pieces of luminance through [`KNOTS`], each with an
//! eighth of the steps per luminance of the one before; four pieces, as a detector's response has
//! `image::detector::Nonlinearity`, so that frames are born with them on every backend.
//!
//! Rounding to codes: at most [`LEAST_STEP`] / 2 below 1/512 of full, at most 3.5e-4 of the luminance above. Light of
//! 1e-5 of full is right to 1 %. Limit: 1 is the full luminance, and nothing is brighter. Tests below; a faint star's
//! light in `drive`; through renderer and detector in `tests/closed_loop/display`.

/// Luminance, of the full one, and its code: ends of the pieces.
pub const KNOTS: [[f64; 2]; 4] = [[1.0 / 512.0, 18_079.0], [1.0 / 64.0, 33_898.0], [0.125, 49_717.0], [1.0, 65_535.0]];
/// Finest step between codes, of the full luminance.
pub const LEAST_STEP: f64 = KNOTS[0][0] / KNOTS[0][1];

/// Returns where a value lies between knots: from axis `from` to the other one.
fn along(value: f64, from: usize) -> f64 {
    let mut before = [0.0; 2];
    for knot in KNOTS {
        if value <= knot[from] {
            let share = (value - before[from]) / (knot[from] - before[from]);
            return before[1 - from] + share * (knot[1 - from] - before[1 - from]);
        }
        before = knot;
    }
    before[1 - from]
}

/// Returns the luminance of a code, 0 to 1.
pub fn luminance(code: u16) -> f64 {
    along(f64::from(code), 1)
}

/// Returns the nearest code of a luminance; beyond 0 to 1, and for a value that is not a number, the ends.
pub fn code(luminance: f64) -> u16 {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 65535")]
    let code = along(luminance.clamp(0.0, 1.0), 0).round() as u16;
    code
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_reads_back_and_rises() {
        for at in 0..=u16::MAX {
            assert_eq!(code(luminance(at)), at);
            assert!(at == 0 || luminance(at) > luminance(at - 1), "code {at}");
        }
        assert_eq!((luminance(0), luminance(u16::MAX)), (0.0, 1.0));
        assert_eq!((code(-1.0), code(7.0)), (0, u16::MAX), "beyond the ends");
    }

    #[test]
    fn rounding_is_as_small_as_said() {
        // Luminances from 1e-8 of full in steps of 1 %.
        let mut wanted = 1e-8;
        while wanted < 1.0 {
            let off = (luminance(code(wanted)) - wanted).abs();
            assert!(off <= (0.5 * LEAST_STEP).max(3.5e-4 * wanted), "{off} at {wanted}");
            wanted *= 1.01;
        }
        assert!((luminance(code(1e-5)) / 1e-5 - 1.0).abs() < 0.01, "1 % at 1e-5");
        let even = |l: f64| (l * 65_535.0).round() / 65_535.0;
        assert!((even(1e-5) - 1e-5).abs() > 0.3e-5, "even steps do not: the comparison can fail");
    }

    #[test]
    fn a_knot_has_two_sides() {
        for [at, code_at] in KNOTS {
            assert!((luminance(code_at as u16) - at).abs() < 1e-15);
            assert!(luminance(code_at as u16 - 1) < at);
        }
    }
}
