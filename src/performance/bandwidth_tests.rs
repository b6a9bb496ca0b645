use super::*;
use crate::attitude_error::turned;
use crate::synthetic::{Dice, Frame, judged};
use base::units::ARCSEC;
use core::f64::consts::PI;

const EXPOSURE_S: f64 = 0.1;
const FRAME_S: f64 = 0.2;

fn sinc(x: f64) -> f64 {
    (PI * x).sin() / (PI * x)
}

/// A tracker behind an exposure: `response` of the sine and noise, at each frequency.
fn flown(response: impl Fn(f64) -> f64, noise: f64, frequencies: &[f64]) -> Vec<JudgedCase> {
    let mut dice = Dice::new(6);
    let axis = DVec3::new(0.8, 0.6, 0.0);
    let amplitude = 60.0;
    let of = |hz: &f64| {
        let sine = |i: u32| amplitude * (TAU * hz * FRAME_S * f64::from(i)).sin();
        let frames: Vec<Frame> = (0..80)
            .map(|i| {
                let error = axis * sine(i) * (response(*hz) - 1.0) + noise * dice.normals();
                Frame::still(FRAME_S * f64::from(i), 0, error)
            })
            .collect();
        let mut case = judged(Use::Bandwidth, &frames);
        // The truth moves; errors are as they were.
        let still = case.frames[0].truth.attitude;
        for (i, frame) in (0..).zip(&mut case.frames) {
            frame.truth.attitude = turned(still, axis * (sine(i) * ARCSEC));
        }
        case.name = format!("sine {hz}");
        case.conditions.insert(SINE.into(), *hz);
        case
    };
    frequencies.iter().map(of).collect()
}

const FREQUENCIES: [f64; 8] = [6.3, 1.1, 2.3, 3.1, 3.9, 4.3, 4.7, 5.3];

fn found(cases: &[JudgedCase]) -> Metric {
    bandwidth(cases, 0.99).pop().unwrap()
}

#[test]
fn an_exposure_alone_gives_its_sinc() {
    let cases = flown(|hz| sinc(hz * EXPOSURE_S), 1.0, &FREQUENCIES);
    let metric = found(&cases);
    assert!((metric.low..=metric.high.unwrap()).contains(&(0.443 / EXPOSURE_S)), "{metric:?}");
    assert!((metric.value - 4.43).abs() < 0.1, "{metric:?}");
    for case in &cases {
        let (ratio, wanted) = (ratio_of_case(case, 0.999).unwrap(), sinc(case.conditions[SINE] * EXPOSURE_S));
        assert!((ratio.low..=ratio.high.unwrap()).contains(&wanted), "{wanted}: {ratio:?}");
    }
    // Controls: an exposure of half the length, and a tracker that follows everything.
    let shorter = found(&flown(|hz| sinc(0.5 * hz * EXPOSURE_S), 1.0, &FREQUENCIES));
    assert!(shorter.value == 6.3 && shorter.high.is_none(), "{shorter:?}");
    assert!(found(&flown(|_| 1.0, 1.0, &FREQUENCIES)).high.is_none());
}

/// Error of straight lines between the frequencies, which remains without noise.
#[test]
fn a_straight_line_between_frequencies_is_good_to_a_hundredth() {
    let metric = found(&flown(|hz| sinc(hz * EXPOSURE_S), 1e-6, &FREQUENCIES));
    assert!((metric.value - 4.4295).abs() < 0.01, "{metric:?}");
    let coarse = found(&flown(|hz| sinc(hz * EXPOSURE_S), 1e-6, &[1.1, 8.1]));
    assert!((coarse.value - 4.4295).abs() > 0.1, "beyond it, on a coarse grid: {coarse:?}");
}

#[test]
fn a_sine_that_is_folded_onto_nothing_is_left_out() {
    // Multiples of half of the frame rate of 5 Hz.
    assert!(ratio_of_case(&flown(|_| 1.0, 1.0, &[5.0])[0], 0.95).is_none());
    assert!(ratio_of_case(&flown(|_| 1.0, 1.0, &[2.5])[0], 0.95).is_none());
    let mut other = flown(|_| 1.0, 1.0, &[2.3]);
    assert!(ratio_of_case(&other[0], 0.95).is_some());
    other[0].purpose = Use::Stress;
    assert!(ratio_of_case(&other[0], 0.95).is_none(), "flown for something else");
}

#[test]
fn a_curve_that_begins_below_has_no_lower_end() {
    let metric = found(&flown(|_| 0.5, 0.5, &[1.1, 2.3, 3.1]));
    assert!(metric.low == 0.0 && metric.value == 1.1, "{metric:?}");
}
