//! The filter against a simulated body, gyro and tracker written here afresh.

use super::*;
use base::axes::{Body, Icrf, Rotation};
use base::time::{Span, Tai};
use base::units::{ARCSEC, DEG};
use core::f64::consts::{PI, TAU};
use glam::{DMat3, DVec3};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

const GYRO_STEP: Span = Span::from_ms(50);
const NEA_RAD: f64 = 10.0 * ARCSEC;
const ARW: f64 = 5e-6;
const RRW: f64 = 2e-6;

fn params() -> MekfParams {
    MekfParams {
        gyro_arw_rad_sqrt_s: DVec3::splat(ARW),
        gyro_rrw_rad_s_sqrt_s: DVec3::splat(RRW),
        initial_attitude_sigma_rad: PI,
        initial_bias_sigma_rad_s: 1e-4,
        dropout_acceleration_rad_s2: 1e-3,
        gate_sigma: 5.0,
        lost_after: 5,
        history: Span::from_ms(2000),
        history_steps: 200,
        converged_sigma_rad: 20.0 * ARCSEC,
    }
}

fn noise_covariance() -> DMat3 {
    DMat3::IDENTITY * (NEA_RAD * NEA_RAD)
}

fn start() -> Tai {
    Tai::from_ns(1_000_000_000_000)
}

fn filter() -> Mekf {
    Mekf::new(params(), start()).expect("settings in range")
}

/// A body that turns with a slowly changing rate, its gyro with a walking bias, its tracker with noise.
struct World {
    noise: StdRng,
    at: Tai,
    attitude: Rotation<Body, Icrf>,
    bias: DVec3,
    arw: f64,
    steps: u32,
}

impl World {
    fn new(seed: u64) -> Self {
        let mut world = Self {
            noise: StdRng::seed_from_u64(seed),
            at: start(),
            attitude: Rotation::from_rotation_vector(DVec3::new(0.3, -1.1, 2.0)),
            bias: DVec3::ZERO,
            arw: ARW,
            steps: 0,
        };
        world.bias = world.gaussian() * params().initial_bias_sigma_rad_s;
        world
    }

    /// Returns three numbers of standard deviation 1 (Box and Muller 1958).
    fn gaussian(&mut self) -> DVec3 {
        let mut one = || {
            let (u, v): (f64, f64) = (self.noise.random(), self.noise.random());
            (-2.0 * (1.0 - u).ln()).sqrt() * (TAU * v).cos()
        };
        DVec3::new(one(), one(), one())
    }

    /// Returns one gyro sample. The walk of the bias within the step reaches the angle with half its weight, and a
    /// third of its variance in all: `b0 + walk / 2 + walk' / sqrt(12)`.
    fn step(&mut self) -> DVec3 {
        let (dt, k) = (GYRO_STEP.s(), f64::from(self.steps));
        let rate = DVec3::new(0.5 * (0.02 * k).sin(), 0.3, -0.4 * (0.03 * k).cos()) * DEG;
        self.attitude = self.attitude.rotated_by(rate * dt);
        let (walk, rest) = (self.gaussian() * RRW * dt.sqrt(), self.gaussian() * RRW * dt.sqrt() / 12_f64.sqrt());
        let sample = rate + self.bias + walk / 2.0 + rest + self.gaussian() * self.arw / dt.sqrt();
        self.bias += walk;
        self.at = self.at + GYRO_STEP;
        self.steps += 1;
        sample
    }

    fn tracker(&mut self) -> Rotation<Body, Icrf> {
        let noise = self.gaussian() * NEA_RAD;
        self.attitude.rotated_by(noise)
    }

    /// Returns the squared error of attitude and bias together, weighed with the filter's own covariance (chi-square,
    /// 6).
    fn nees(&self, filter: &Mekf) -> f64 {
        let estimate = filter.attitude(self.at).expect("started");
        let (a, b) = (estimate.rotation_vector_to(&self.attitude), self.bias - filter.bias_rad_s());
        let p = filter.covariance();
        let inverse = p.attitude.inverse();
        let rest = p.bias - p.cross.transpose() * inverse * p.cross;
        let conditional = b - p.cross.transpose() * (inverse * a);
        a.dot(inverse * a) + conditional.dot(rest.inverse() * conditional)
    }
}

/// Runs `steps` gyro samples with an attitude every second one.
fn run(world: &mut World, filter: &mut Mekf, steps: u32) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for k in 0..steps {
        let sample = world.step();
        filter.propagate(world.at, Some(sample));
        if k % 2 == 1 {
            let measured = world.tracker();
            if let Measured::Used { normalised_innovation } = filter.measure(world.at, &measured, &noise_covariance()) {
                sum += normalised_innovation;
                count += 1.0;
            }
        }
    }
    sum / count
}

const RUNS: u32 = 200;
const RUN_STEPS: u32 = 400;

/// Returns the mean of the squared weighed errors at the end, and of the squared weighed innovations, over `RUNS` runs
/// whose gyro has `arw_factor` times the noise the filter believes in.
fn consistency(arw_factor: f64) -> (f64, f64) {
    let (mut nees, mut nis) = (0.0, 0.0);
    for seed in 0..RUNS {
        let (mut world, mut filter) = (World::new(u64::from(seed)), filter());
        world.arw *= arw_factor;
        nis += run(&mut world, &mut filter, RUN_STEPS) / f64::from(RUNS);
        nees += world.nees(&filter) / f64::from(RUNS);
    }
    (nees, nis)
}

/// Returns the five standard errors of a mean of chi-square numbers (variance 2 n): false alarm below 1e-6 for a fresh
/// seed.
fn five_sigma(degrees: f64, draws: f64) -> f64 {
    5.0 * (2.0 * degrees / draws).sqrt()
}

#[test]
fn errors_are_as_large_as_the_filter_says() {
    let (nees, nis) = consistency(1.0);
    let runs = f64::from(RUNS);
    assert!((nees - 6.0).abs() < five_sigma(6.0, runs), "NEES {nees}");
    let innovations = runs * f64::from(RUN_STEPS / 2 - 1);
    assert!((nis - 3.0).abs() < five_sigma(3.0, innovations), "NIS {nis}");
}

#[test]
fn a_wrong_gyro_noise_shows() {
    let (nees, nis) = consistency(3.0);
    assert!(nees - 6.0 > five_sigma(6.0, f64::from(RUNS)), "NEES {nees}");
    assert!(nis - 3.0 > five_sigma(3.0, f64::from(RUNS * (RUN_STEPS / 2 - 1))), "NIS {nis}");
}

/// The filter's 0.05 s steps and the closed form's one 0.1 s step differ by nothing for a body at rest but the
/// convergence left after 100 s.
const STEADY_RELATIVE: f64 = 1e-3;

#[test]
fn the_steady_state_is_farrenkopfs() {
    let mut filter = filter();
    let mut at = start();
    filter.start_from(at, &Rotation::IDENTITY, &noise_covariance());
    let wanted = Farrenkopf::new(NEA_RAD, 0.1, &GyroNoise { arw_rad_sqrt_s: ARW, rrw_rad_s_sqrt_s: RRW });
    let mut before = 0.0;
    for k in 0..2000 {
        at = at + GYRO_STEP;
        filter.propagate(at, Some(DVec3::ZERO));
        if k % 2 == 1 {
            before = filter.sigma_rad().x;
            filter.measure(at, &Rotation::IDENTITY, &noise_covariance());
        }
    }
    let bias = filter.covariance().bias_sigma_rad_s().x;
    for (name, got, wanted) in [
        ("before", before, wanted.sigma_before_rad),
        ("after", filter.sigma_rad().x, wanted.sigma_after_rad),
        ("bias after", bias, wanted.bias_sigma_after_rad_s),
    ] {
        assert!((got / wanted - 1.0).abs() < STEADY_RELATIVE, "{name}: {got} for {wanted}");
    }
    let other = Farrenkopf::new(NEA_RAD, 0.1, &GyroNoise { arw_rad_sqrt_s: 1.1 * ARW, rrw_rad_s_sqrt_s: RRW });
    assert!((before / other.sigma_before_rad - 1.0).abs() > STEADY_RELATIVE, "another gyro must differ");
}

/// f64 rounding of quaternion products over a hundred steps, rad.
const SAME_RAD: f64 = 1e-13;

/// Feeds the same world to a filter; each attitude is given `late_steps` gyro samples after its time.
fn with_delay(late_steps: usize, shift: Span) -> Mekf {
    let (mut world, mut filter) = (World::new(5), filter());
    filter.start_from(start(), &world.attitude.clone(), &noise_covariance());
    let mut under_way = Vec::new();
    for k in 0..200_u32 {
        let sample = world.step();
        filter.propagate(world.at, Some(sample));
        if k % 4 == 3 && k < 180 {
            under_way.push((k as usize + late_steps, world.at + shift, world.tracker()));
        }
        while let Some((due, at, attitude)) = under_way.first().copied().filter(|&(due, ..)| due <= k as usize) {
            let measured = filter.measure(at, &attitude, &noise_covariance());
            assert!(matches!(measured, Measured::Used { .. }), "due {due}: {measured:?}");
            under_way.remove(0);
        }
    }
    filter
}

fn assert_same(a: &Mekf, b: &Mekf, tolerance_rad: f64) {
    let apart = a.attitude(a.at()).unwrap().rotation_vector_to(&b.attitude(b.at()).unwrap()).length();
    assert!(apart <= tolerance_rad, "attitudes {apart} rad apart");
    let bias = (a.bias_rad_s() - b.bias_rad_s()).length();
    assert!(bias <= tolerance_rad, "biases {bias} rad/s apart");
    let sigma = ((a.sigma_rad() - b.sigma_rad()) / a.sigma_rad()).length();
    assert!(sigma <= 1e-9, "sigmas {sigma} apart");
}

#[test]
fn late_attitudes_end_where_timely_ones_do() {
    assert_same(&with_delay(0, Span::ZERO), &with_delay(7, Span::ZERO), SAME_RAD);
    // Inside gyro samples: the split step composes to the whole one up to second order of its noise terms.
    let inside = Span::from_ms(-17);
    assert_same(&with_delay(0, inside), &with_delay(9, inside), SAME_RAD);
    let (mut none, some) = (with_delay(0, Span::ZERO), with_delay(0, inside));
    let at = none.at();
    let apart = none.attitude(at).unwrap().rotation_vector_to(&some.attitude(at).unwrap()).length();
    assert!(apart > SAME_RAD, "a wrong time tag of 17 ms must show: {apart}");
    assert_eq!(none.measure(at + Span::from_ms(1), &Rotation::IDENTITY, &noise_covariance()), Measured::Ahead);
    let old = at - Span::from_ms(2001);
    assert_eq!(none.measure(old, &Rotation::IDENTITY, &noise_covariance()), Measured::TooOld);
}

#[test]
fn a_split_gyro_sample_is_the_whole_one() {
    let (mut whole, mut split) = (filter(), filter());
    let rate = DVec3::new(0.01, -0.02, 0.005);
    for filter in [&mut whole, &mut split] {
        filter.start_from(start(), &Rotation::IDENTITY, &noise_covariance());
    }
    whole.propagate(start() + GYRO_STEP, Some(rate));
    split.propagate(start() + Span::from_ms(20), Some(rate));
    split.propagate(start() + GYRO_STEP, Some(rate));
    assert_same(&whole, &split, SAME_RAD);
}

#[test]
fn the_order_of_two_heads_does_not_matter() {
    let run = |swapped: bool, same_time: bool| {
        let (mut world, mut filter) = (World::new(9), filter());
        filter.start_from(start(), &world.attitude.clone(), &noise_covariance());
        for _ in 0..100 {
            let sample = world.step();
            filter.propagate(world.at, Some(sample));
            let (one, two) = (world.tracker(), world.tracker());
            let narrow = DMat3::from_diagonal(DVec3::new(1.0, 1.0, 64.0)) * NEA_RAD * NEA_RAD;
            let second_at = if same_time { world.at } else { world.at - Span::from_ms(13) };
            let heads = [(world.at, one, noise_covariance()), (second_at, two, narrow)];
            let order = if swapped { [1, 0] } else { [0, 1] };
            for (at, attitude, covariance) in order.map(|k| heads[k]) {
                assert!(matches!(filter.measure(at, &attitude, &covariance), Measured::Used { .. }), "gate");
            }
        }
        filter
    };
    assert_same(&run(false, false), &run(true, false), 0.0);
    // At one and the same time the second order of the correction (1e-4 rad squared) depends on the order.
    assert_same(&run(false, true), &run(true, true), 1e-8);
}

#[test]
fn the_bias_becomes_known() {
    let (mut world, mut filter) = (World::new(3), filter());
    world.bias = DVec3::new(3e-4, -2e-4, 1e-4);
    run(&mut world, &mut filter, 1200);
    let error = world.bias - filter.bias_rad_s();
    let sigma = filter.covariance().bias_sigma_rad_s();
    assert!((error / sigma).abs().max_element() < 5.0, "error {error} with sigma {sigma}");
    assert!(sigma.max_element() < 0.1 * world.bias.length(), "bias must be known to a tenth: {sigma}");
    assert!(filter.is_converged(), "sigma {}", filter.sigma_rad());
    let rate_error = (filter.rate_rad_s() - DVec3::new(0.0, 0.3, 0.0) * DEG).y.abs();
    assert!(rate_error < 5.0 * (ARW / GYRO_STEP.s().sqrt()), "rate error {rate_error}");
}

#[test]
fn outliers_are_gated_and_many_of_them_mean_lost() {
    let (mut world, mut filter) = (World::new(4), filter());
    run(&mut world, &mut filter, 200);
    let before = filter.attitude(filter.at());
    let far = world.attitude.rotated_by(DVec3::new(0.0, 0.01, 0.0));
    for k in 0..6 {
        assert!(!filter.is_lost(), "not lost after {k}");
        let measured = filter.measure(world.at, &far, &noise_covariance());
        assert!(matches!(measured, Measured::Gated { normalised_innovation } if normalised_innovation > 25.0));
    }
    assert_eq!(filter.attitude(filter.at()), before, "a gated attitude changes nothing");
    assert!(filter.is_lost() && !filter.is_converged(), "six in a row");
    assert_eq!(filter.measure(world.at, &far, &noise_covariance()), Measured::Started);
    assert_eq!((filter.counts.starts, filter.counts.gated), (2, 6), "both counted");
    assert!(!filter.is_lost(), "found again");
}

#[test]
fn a_start_at_the_wrong_end_of_the_sky_is_recovered_from() {
    let turned = |world: &World| world.attitude.rotated_by(DVec3::new(0.0, PI, 0.0));
    // Overconfident: gated until lost, then restarted.
    let (mut world, mut sure) = (World::new(6), filter());
    let wrong = turned(&world);
    assert!(sure.start_from(start(), &wrong, &noise_covariance()), "start");
    run(&mut world, &mut sure, 400);
    assert_eq!(sure.counts.starts, 2, "{:?}", sure.counts);
    assert!(world.nees(&sure) < 60.0, "NEES {}", world.nees(&sure));
    // Known to be unsure: the first attitude turns it by 180 degrees at once.
    let (mut world, mut unsure) = (World::new(6), filter());
    let wrong = turned(&world);
    assert!(unsure.start_from(start(), &wrong, &(DMat3::IDENTITY * 10.0)), "start");
    run(&mut world, &mut unsure, 400);
    assert_eq!((unsure.counts.starts, unsure.counts.gated), (1, 0), "{:?}", unsure.counts);
    assert!(world.nees(&unsure) < 60.0, "NEES {}", world.nees(&unsure));
}

#[test]
fn a_silent_gyro_widens_the_sigma_until_attitudes_come() {
    let (mut world, mut filter) = (World::new(7), filter());
    run(&mut world, &mut filter, 400);
    let (before, rate) = (filter.sigma_rad().x, filter.rate_rad_s());
    let silent_at = world.at;
    for _ in 0..20 {
        world.step();
        filter.propagate(world.at, None);
    }
    assert_eq!(filter.rate_rad_s(), rate, "the last rate goes on");
    assert_eq!(filter.counts.gyro_dropouts, 20);
    let wanted = params().dropout_acceleration_rad_s2 * (world.at - silent_at).s().powi(2) / 2.0;
    let got = (filter.sigma_rad().x.powi(2) - before * before).sqrt();
    assert!((got / wanted - 1.0).abs() < 0.05, "sigma {got} for {wanted}: the filter's own drift is small beside it");
    let measured = world.tracker();
    let used = filter.measure(world.at, &measured, &noise_covariance());
    assert!(matches!(used, Measured::Used { .. }), "{used:?}");
    run(&mut world, &mut filter, 400);
    assert!(filter.is_converged() && world.nees(&filter) < 60.0, "NEES {}", world.nees(&filter));
}

#[test]
fn a_late_attitude_within_a_silence_is_as_good_as_a_timely_one() {
    let run = |late: bool| {
        let (mut world, mut filter) = (World::new(8), filter());
        filter.start_from(start(), &world.attitude.clone(), &noise_covariance());
        let mut kept = None;
        for k in 0..40 {
            let sample = world.step();
            filter.propagate(world.at, (!(10..30).contains(&k)).then_some(sample));
            if k == 17 {
                kept = Some((world.at, world.tracker()));
            }
            if let (Some((at, attitude)), true) = (kept, k == if late { 23 } else { 17 }) {
                filter.measure(at, &attitude, &noise_covariance());
            }
        }
        filter
    };
    assert_same(&run(false), &run(true), SAME_RAD);
}

#[test]
fn unusable_numbers_are_refused() {
    let mut filter = filter();
    filter.propagate(start() + GYRO_STEP, Some(DVec3::NAN));
    assert!(filter.rate_rad_s().is_finite() && filter.counts.gyro_dropouts == 1, "NaN is not used as a sample");
    filter.propagate(start(), Some(DVec3::ONE));
    assert_eq!(filter.at(), start() + GYRO_STEP, "time does not run back");
    for bad in [DMat3::ZERO, DMat3::NAN, -DMat3::IDENTITY] {
        assert_eq!(filter.measure(start(), &Rotation::IDENTITY, &bad), Measured::Unusable);
    }
    assert_eq!(filter.attitude(start()), None, "nothing known yet");
    let error = MekfParams { gate_sigma: 0.0, ..params() }.check().unwrap_err().to_string();
    assert!(error.contains("gate_sigma is 0"), "{error}");
}
