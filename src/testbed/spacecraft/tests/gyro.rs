//! Gyro errors: Allan variance, scale, counts, limits, faults.

use super::*;

const DT: Span = Span::from_ms(100);

fn params() -> GyroParams {
    GyroParams { largest_rate_rad_s: 1.0, ..GyroParams::default() }
}

fn still(gyro: &mut Gyro) -> GyroReading {
    gyro.measure(&Rotation::IDENTITY, &Rotation::IDENTITY, DT)
}

/// Returns the allan variance over clusters of `m` readings, mean of three axes; and the number of clusters.
fn allan(readings: &[DVec3], m: usize) -> (f64, f64) {
    let means: Vec<DVec3> = readings.chunks_exact(m).map(|chunk| chunk.iter().sum::<DVec3>() / m as f64).collect();
    let differences = means.windows(2).map(|pair| (pair[1] - pair[0]).length_squared());
    (differences.sum::<f64>() / (6.0 * (means.len() - 1) as f64), means.len() as f64)
}

fn readings(params: &GyroParams, count: usize) -> Vec<DVec3> {
    let mut gyro = Gyro::new(params, 11).expect("sound parameters");
    (0..count).map(|_| still(&mut gyro).rate_rad_s).collect()
}

/// Returns the relative sigma of the variance of `3 K` differences, neighbours correlated by -1/2 (white) or 1/4
/// (walk): at most `sqrt(3 / (3 K))`. 4.5 sigma: false alarm 7e-6, a dozen tests with fixed seeds.
fn bound(clusters: f64) -> f64 {
    4.5 / clusters.sqrt()
}

#[test]
fn angle_random_walk_falls_by_one_over_tau() {
    // IEEE Std 952-1997, annex C: N^2 / tau, slope -1/2 of the deviation.
    let n = 1e-5;
    let readings = readings(&GyroParams { angle_random_walk_rad_sqrt_s: n, ..params() }, 200_000);
    for m in [1, 10, 100, 1000] {
        let tau_s = m as f64 * DT.s();
        let (variance, clusters) = allan(&readings, m);
        let ratio = variance / (n * n / tau_s);
        assert!((ratio - 1.0).abs() < bound(clusters), "tau {tau_s} s: {ratio}");
        let wrong = variance / (n * n * tau_s / 3.0);
        assert!(m == 10 && tau_s == 1.0 || (wrong - 1.0).abs() > bound(clusters), "negative control, tau {tau_s} s");
    }
}

#[test]
fn rate_random_walk_rises_by_tau() {
    // K^2 tau / 3, slope +1/2 of the deviation.
    let k = 1e-7;
    let readings = readings(&GyroParams { rate_random_walk_rad_s_sqrt_s: k, ..params() }, 200_000);
    for m in [1, 10, 100, 1000] {
        let tau_s = m as f64 * DT.s();
        let (variance, clusters) = allan(&readings, m);
        let ratio = variance / (k * k * tau_s / 3.0);
        assert!((ratio - 1.0).abs() < bound(clusters), "tau {tau_s} s: {ratio}");
    }
}

#[test]
fn a_known_turn_is_read_through_scale_misalignment_and_bias() {
    let rate = DVec3::new(0.1, -0.2, 0.05);
    let now = Rotation::IDENTITY.rotated_by(rate * DT.s());
    let mut exact = Gyro::new(&params(), 1).expect("sound parameters");
    let got = exact.measure(&Rotation::IDENTITY, &now, DT);
    assert!((got.rate_rad_s - rate).length() < 1e-14 && got.valid, "{got:?}");
    let (scale, turn, bias) = (DVec3::new(1e-3, 0.0, -1e-3), DVec3::Z * 1e-4, DVec3::new(0.0, 1e-5, 2e-5));
    let wrong = GyroParams { scale_factor_error: scale, misalignment_rad: turn, initial_bias_rad_s: bias, ..params() };
    let got = Gyro::new(&wrong, 1).expect("sound parameters").measure(&Rotation::IDENTITY, &now, DT).rate_rad_s;
    // First order: axes turned by v see w - v x w. Second orders: 1e-4 of 1e-3 of 0.2 rad/s.
    let wanted = rate + scale * rate - turn.cross(rate) + bias;
    assert!((got - wanted).length() < 5e-8, "{got} for {wanted}");
    assert!((got - (rate + scale * rate + turn.cross(rate) + bias)).length() > 1e-5, "negative control: sign");
}

#[test]
fn counts_lose_no_angle() {
    let quantum = 1e-5;
    let mut gyro = Gyro::new(&GyroParams { quantum_rad: quantum, ..params() }, 1).expect("sound parameters");
    let (step, mut attitude, mut sum) = (DVec3::new(3.3e-6, -7.7e-6, 1.2e-5), Rotation::IDENTITY, DVec3::ZERO);
    for _ in 0..1000 {
        let next = attitude.rotated_by(step);
        let angle = gyro.measure(&attitude, &next, DT).rate_rad_s * DT.s();
        let counts = angle / quantum;
        assert!((counts - counts.round()).length() < 1e-9, "whole counts: {counts}");
        (attitude, sum) = (next, sum + angle);
    }
    assert!((sum - step * 1000.0).abs().max_element() <= 0.5 * quantum + 1e-12, "{sum}");
}

#[test]
fn beyond_the_largest_rate_it_clips_and_says_so() {
    let mut gyro = Gyro::new(&params(), 1).expect("sound parameters");
    let fast = Rotation::IDENTITY.rotated_by(DVec3::X * 0.15);
    let got = gyro.measure(&Rotation::IDENTITY, &fast, DT);
    assert_eq!(got, GyroReading { rate_rad_s: DVec3::X, valid: false });
    assert!(!gyro.measure(&Rotation::IDENTITY, &fast, Span::ZERO).valid, "no interval");
}

#[test]
fn faults_come_and_go_and_leave_the_noise_as_it_was() {
    let noisy = GyroParams { angle_random_walk_rad_sqrt_s: 1e-5, rate_random_walk_rad_s_sqrt_s: 1e-7, ..params() };
    let [mut sound, mut faulty] = [0, 1].map(|_| Gyro::new(&noisy, 9).expect("sound parameters"));
    let first = still(&mut faulty);
    assert_eq!(still(&mut sound), first);
    faulty.inject(GyroFault::Stuck);
    assert_eq!(still(&mut faulty), first);
    assert_ne!(still(&mut sound), first);
    faulty.clear_faults();
    faulty.inject(GyroFault::Dropout);
    assert!(!still(&mut faulty).valid && still(&mut sound).valid);
    faulty.clear_faults();
    assert_eq!(still(&mut faulty), still(&mut sound), "as without a fault");
    faulty.inject(GyroFault::Spike(DVec3::Y * 0.1));
    let difference = still(&mut faulty).rate_rad_s - still(&mut sound).rate_rad_s;
    assert!((difference - DVec3::Y * 0.1).length() < 1e-15);
    assert_eq!(still(&mut faulty), still(&mut sound), "one reading only");
    faulty.inject(GyroFault::BiasJump(DVec3::X * 0.01));
    faulty.clear_faults();
    let difference = still(&mut faulty).rate_rad_s - still(&mut sound).rate_rad_s;
    assert!((difference - DVec3::X * 0.01).length() < 1e-15, "for good");
    assert!((faulty.bias_rad_s() - sound.bias_rad_s() - DVec3::X * 0.01).length() < 1e-15);
}

#[test]
fn senseless_parameters_are_refused() {
    let refused = |bad: GyroParams| Gyro::new(&bad, 1).expect_err("refused").to_string();
    assert!(refused(GyroParams::default()).contains("largest_rate_rad_s = 0"));
    assert!(refused(GyroParams { quantum_rad: -1.0, ..params() }).contains("quantum_rad = -1"));
    assert!(refused(GyroParams { initial_bias_rad_s: DVec3::NAN, ..params() }).contains("initial_bias"));
}
