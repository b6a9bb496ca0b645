//! Columns and rows: fixed patterns by their variances, row noise by its spectrum.

use crate::flats::{Flats, column_means, mean, row_means, variance, variance_error};
use crate::noise::STANDARD_ERRORS;
use image::detector::{DetectorParams, LinePattern, RowNoise};

/// Returns the fine steps about a high black level: numbers are electrons within 0.03 e-.
fn fine() -> DetectorParams {
    DetectorParams { gain_e_per_dn: 0.1, black_level_dn: 30_000.0, ..DetectorParams::QUIET }
}

#[test]
fn columns_and_rows_have_their_offsets_and_keep_them() {
    const SIZE: [usize; 2] = [2048, 1024];
    let line_pattern = LinePattern { column_e_rms: 8.0, column_gain_rms: 0.0, row_e_rms: 5.0 };
    let mut flats = Flats::new(DetectorParams { line_pattern, read_noise_e_rms: 4.0, ..fine() }, SIZE);
    let [one, two] = [1, 2].map(|frame| flats.frame_e(0.0, frame, 0.1));
    let white = 16.0 + 0.01 / 12.0;
    let columns = column_means(&one, SIZE[0]);
    let error = variance_error(variance(&columns), 64.0 + white / SIZE[1] as f64, SIZE[0]);
    assert!(error.abs() < STANDARD_ERRORS, "columns: off by {error}");
    let rows = row_means(&one, SIZE[0]);
    let error = variance_error(variance(&rows), 25.0 + white / SIZE[0] as f64, SIZE[1]);
    assert!(error.abs() < STANDARD_ERRORS, "rows: off by {error}");
    assert!(variance_error(variance(&rows), 36.0, SIZE[1]).abs() > STANDARD_ERRORS, "6 e- would be seen");
    // The difference of two frames is white, with twice the noise of one.
    let change: Vec<f64> = one.iter().zip(&two).map(|(a, b)| a - b).collect();
    let error = variance_error(variance(&column_means(&change, SIZE[0])), 2.0 * white / SIZE[1] as f64, SIZE[0]);
    assert!(error.abs() < STANDARD_ERRORS, "columns changed: off by {error}");
    let error = variance_error(variance(&change), 2.0 * white, change.len());
    assert!(error.abs() < STANDARD_ERRORS, "temporal: off by {error}");
}

#[test]
fn column_gains_spread_with_the_signal() {
    const SIZE: [usize; 2] = [2048, 512];
    let line_pattern = LinePattern { column_gain_rms: 0.01, ..LinePattern::OFF };
    let params = DetectorParams { line_pattern, black_level_dn: 100.0, ..DetectorParams::QUIET };
    for electrons in [1000.0, 20_000.0] {
        let found = Flats::new(params, SIZE).frame_e(electrons, 1, 0.1);
        let wanted = (0.01 * electrons).powi(2) + electrons / SIZE[1] as f64;
        let error = variance_error(variance(&column_means(&found, SIZE[0])), wanted, SIZE[0]);
        assert!(error.abs() < STANDARD_ERRORS, "{electrons} e-: off by {error}");
    }
}

/// Transforms a power of two of complex numbers in place: Cooley and Tukey (1965).
fn transform(values: &mut [[f64; 2]]) {
    let n = values.len();
    if n == 1 {
        return;
    }
    let mut even: Vec<[f64; 2]> = values.iter().copied().step_by(2).collect();
    let mut odd: Vec<[f64; 2]> = values.iter().copied().skip(1).step_by(2).collect();
    transform(&mut even);
    transform(&mut odd);
    for k in 0..n / 2 {
        let (sin, cos) = (-core::f64::consts::TAU * k as f64 / n as f64).sin_cos();
        let [re, im] = odd[k];
        let turned = [re * cos - im * sin, re * sin + im * cos];
        values[k] = [even[k][0] + turned[0], even[k][1] + turned[1]];
        values[k + n / 2] = [even[k][0] - turned[0], even[k][1] - turned[1]];
    }
}

const ROWS: usize = 4096;
const FRAMES: u32 = 150;

/// Returns the one-sided density of the rows' means, cycles per row `k / ROWS`, with Hann's window, over many frames.
fn density_of_rows(row_noise: RowNoise) -> Vec<f64> {
    const WIDTH: usize = 2;
    let mut flats = Flats::new(DetectorParams { row_noise, ..fine() }, [WIDTH, ROWS]);
    let window = |i: usize| 1.0 - (core::f64::consts::TAU * i as f64 / ROWS as f64).cos();
    let power: f64 = (0..ROWS).map(|i| window(i).powi(2)).sum();
    let mut density = vec![0.0; ROWS / 2];
    for frame in 0..FRAMES {
        let image = flats.frame_e(0.0, frame, 0.1);
        assert!(image.chunks_exact(WIDTH).all(|row| row[0] == row[1]), "a row shares its noise");
        let rows = row_means(&image, WIDTH);
        let level = mean(&rows);
        let mut spectrum: Vec<[f64; 2]> =
            rows.iter().enumerate().map(|(i, e)| [(e - level) * window(i), 0.0]).collect();
        transform(&mut spectrum);
        for (sum, [re, im]) in density.iter_mut().zip(spectrum) {
            *sum += 2.0 * (re * re + im * im) / power / f64::from(FRAMES);
        }
    }
    density
}

/// Returns the largest distance of octaves' means from `2 sigma^2 (1 + corner / f)`, in units of the allowed one.
fn worst_octave(density: &[f64], sigma_e: f64, corner: f64) -> f64 {
    let mut worst = 0.0_f64;
    let mut from = 8;
    while from < ROWS / 2 {
        let bins = from..(2 * from).min(ROWS / 2);
        let law = |k: usize| 2.0 * sigma_e * sigma_e * (1.0 + corner * ROWS as f64 / k as f64);
        let ratio = mean(&bins.clone().map(|k| density[k] / law(k)).collect::<Vec<_>>());
        // A periodogram's bins have their mean as standard deviation; Hann's window correlates neighbours: two of three
        // count. The model: 1.5 % of the 1/f part to 0.1 cycles per row, 10 % beyond.
        let statistics = STANDARD_ERRORS / (f64::from(FRAMES) * bins.len() as f64 / 2.0).sqrt();
        let flicker_share = 1.0 - 2.0 * sigma_e * sigma_e / law(from);
        let model = flicker_share * if 2 * from <= ROWS / 10 { 0.015 } else { 0.10 };
        // Hann's window over 1/f at the lowest bins: (width of the kernel / f)^2.
        let leakage = 1.0 / (from * from) as f64;
        worst = worst.max((ratio - 1.0).abs() / (statistics + model + leakage));
        from *= 2;
    }
    worst
}

#[test]
fn row_noise_is_white_plus_one_over_f() {
    let density = density_of_rows(RowNoise { e_rms: 20.0, corner_cycles_per_row: 0.05 });
    let found = worst_octave(&density, 20.0, 0.05);
    println!("worst octave: {found:.2} of what is allowed");
    assert!(found < 1.0, "{found}");
    // Negative controls: white noise is not 1/f, nor 1/f with another corner, nor another level.
    assert!(worst_octave(&density, 20.0, 0.0) > 1.0, "1/f would be seen");
    assert!(worst_octave(&density, 20.0, 0.06) > 1.0, "another corner would be seen");
    assert!(worst_octave(&density, 21.0, 0.05) > 1.0, "another level would be seen");
}

#[test]
fn white_row_noise_is_white_and_adds_to_the_pixels_own() {
    const SIZE: [usize; 2] = [1024, 4096];
    let row_noise = RowNoise { e_rms: 6.0, corner_cycles_per_row: 0.0 };
    let params = DetectorParams { row_noise, read_noise_e_rms: 3.0, amplifier_noise_e_rms: 4.0, ..fine() };
    let found = Flats::new(params, SIZE).frame_e(0.0, 9, 0.1);
    let white = 25.0 + 0.01 / 12.0;
    let rows = row_means(&found, SIZE[0]);
    let error = variance_error(variance(&rows), 36.0 + white / SIZE[0] as f64, SIZE[1]);
    assert!(error.abs() < STANDARD_ERRORS, "rows: off by {error}");
    // Within the rows read and amplifier noise are left, in quadrature: 3 and 4 make 5.
    let within: Vec<f64> =
        found.chunks_exact(SIZE[0]).zip(&rows).flat_map(|(row, mean)| row.iter().map(move |e| e - mean)).collect();
    let error = variance_error(variance(&within), white * (1.0 - 1.0 / SIZE[0] as f64), within.len());
    assert!(error.abs() < STANDARD_ERRORS, "within rows: off by {error}");
}
