//! The map's fit on dots made by formula: fields wide and narrow, noise, outliers, too little.

use super::*;
use base::random::philox;

const SIZE_PX: [usize; 2] = [1920, 1080];

/// Returns dots of a tilted and rolled camera with radial distortion and noise of a uniform law (half its width given),
/// display px.
fn dots(focal_px: f64, radial: f64, noise_px: f64) -> Vec<SeenDot> {
    let turn = DMat3::from_rotation_z(-1.2) * DMat3::from_rotation_x(0.01) * DMat3::from_rotation_y(0.02);
    let dot = |number: usize| {
        let display_px = [20.0 + 99.0 * (number % 20) as f64, 20.0 + 94.0 * (number / 20) as f64];
        let words = philox([number as u32, 1, 2, 3], [4, 5]);
        let noise = |word: u32| noise_px * (2.0 * f64::from(word) / f64::from(u32::MAX) - 1.0);
        let moved = DVec2::new(display_px[0] + noise(words[0]), display_px[1] + noise(words[1]));
        let ideal = (moved - DVec2::new(970.0, 530.0)) / focal_px;
        let bent = ideal * (1.0 + radial * (focal_px / 2000.0).powi(2) * ideal.length_squared());
        SeenDot { number: number + 1, v_sensor: turn * bent.extend(1.0), display_px }
    };
    (0..240).map(dot).collect()
}

#[test]
fn fields_of_half_a_degree_to_fifty_degrees_are_mapped() {
    for focal_px in [2000.0, 20_000.0, 200_000.0] {
        // At half a degree twice this distortion has terms above 1e6 in degree 5, which no camera accepts.
        let exact = dots(focal_px, -0.02, 0.0);
        let fit = fit_map(&exact, SIZE_PX).unwrap();
        assert!(fit.rms_px < 2e-3, "focal {focal_px}: {} px", fit.rms_px);
        let noisy = fit_map(&dots(focal_px, -0.02, 0.05), SIZE_PX).unwrap();
        // The map against the exact dots, not against those it was fitted to.
        let off =
            |dot: &SeenDot| DVec2::from(noisy.geometry.project(dot.v_sensor).unwrap()).distance(dot.display_px.into());
        let error_px = rms(exact.iter().map(off));
        println!(
            "focal {focal_px}: degree {}, {error_px:.4} px off, {:.4} reported",
            noisy.parameters.degree, noisy.map_error_px
        );
        assert!(error_px < 0.02 && error_px < 2.0 * noisy.map_error_px, "{error_px} for {}", noisy.map_error_px);
    }
}

#[test]
fn pure_homography_is_fitted_with_a_low_degree() {
    let fit = fit_map(&dots(3000.0, 0.0, 0.02), SIZE_PX).unwrap();
    assert!(fit.parameters.degree <= 2, "degree {}", fit.parameters.degree);
    let bent = fit_map(&dots(3000.0, -0.2, 0.02), SIZE_PX).unwrap();
    assert!(bent.parameters.degree >= 3, "degree {}", bent.parameters.degree);
}

#[test]
fn one_fifth_of_wrong_dots_is_accepted_and_more_refused() {
    let spoil = |share: usize| {
        let mut dots = dots(2000.0, -0.05, 0.02);
        dots.iter_mut()
            .filter(|dot| dot.number % 10 < share)
            .for_each(|dot| dot.display_px[0] += 40.0 + dot.number as f64);
        dots
    };
    let fit = fit_map(&spoil(2), SIZE_PX).unwrap();
    assert!(fit.rms_px < 0.03, "{} px", fit.rms_px);
    assert_eq!(fit.is_used.iter().filter(|used| !**used).count(), 48);
    let reported = fit_map(&spoil(4), SIZE_PX).unwrap_err().to_string();
    assert!(reported.contains("three of four"), "{reported}");
}

#[test]
fn too_little_is_refused() {
    let all = dots(2000.0, 0.0, 0.0);
    assert!(fit_map(&all[..11], SIZE_PX).unwrap_err().to_string().contains(", got 11 ("));
    let line: Vec<SeenDot> = all.iter().copied().filter(|dot| dot.display_px[1] == 20.0).collect();
    assert!(fit_map(&line, SIZE_PX).unwrap_err().to_string().contains("not on one line"));
    let mut behind = all.clone();
    behind[3].v_sensor.z = -1.0;
    assert!(fit_map(&behind, SIZE_PX).unwrap_err().to_string().contains(", 1 outside the tracker's field"));
    let same = vec![all[0]; 40];
    assert!(fit_map(&same, SIZE_PX).is_err(), "forty times the same dot");
}
