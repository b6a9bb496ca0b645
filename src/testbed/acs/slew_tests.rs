//! Turns against their limits, their closed-form durations and finite differences.

use super::slew::{Leg, SlewLimits, SlewPath};
use base::axes::{Body, Icrf, Rotation};
use base::units::DEG;
use glam::DVec3;

const LIMITS: SlewLimits = SlewLimits { largest_rate_rad_s: 0.02, largest_acceleration_rad_s2: 0.002 };
/// Rounding of quaternions and sums, rad.
const ROUNDING_RAD: f64 = 1e-12;

fn start() -> Rotation<Body, Icrf> {
    Rotation::from_rotation_vector(DVec3::new(0.4, 1.0, -0.2))
}

#[test]
fn a_turn_ends_where_and_when_it_should() {
    // w (tr + tc) = angle, with tr = 2 w / A: short turns peak below the largest rate.
    for (angle, duration_s) in [(90.0 * DEG, 90.0 * DEG / 0.02 + 20.0), (1.0 * DEG, 2.0 * (2.0 * DEG / 0.002).sqrt())] {
        let leg = Leg::turn(start(), DVec3::new(1.0, 2.0, 2.0) / 3.0 * angle, &LIMITS);
        assert!((leg.duration_s() - duration_s).abs() < 1e-9, "{} for {duration_s}", leg.duration_s());
        for end in [leg.reference(duration_s + 1.0), leg.reference(duration_s - 1e-9)] {
            let turned = start().rotation_vector_to(&end.body_from_icrf);
            assert!((turned.length() - angle).abs() < ROUNDING_RAD, "{turned}");
            assert!(end.rate_rad_s.length() < 1e-12 && end.acceleration_rad_s2.length() < 1e-12, "{end:?}");
        }
    }
}

#[test]
fn rate_and_acceleration_are_derivatives_and_keep_their_limits() {
    for angle in [0.3 * DEG, 10.0 * DEG, 170.0 * DEG] {
        let leg = Leg::turn(start(), DVec3::new(0.0, 0.6, 0.8) * angle, &LIMITS);
        let (mut fastest, mut hardest) = (0.0_f64, 0.0_f64);
        let h = 1e-3;
        for k in 1..1000 {
            let t = leg.duration_s() * f64::from(k) / 1000.0;
            let [before, now, after] = [t - h, t, t + h].map(|t| leg.reference(t));
            let rate = before.body_from_icrf.rotation_vector_to(&after.body_from_icrf) / (2.0 * h);
            // Central differences: h^2 / 6 times the next-but-one derivative (below 0.01 rad/s^3 and rad/s^4).
            assert!((rate - now.rate_rad_s).length() < 1e-8, "rate at {t}: {rate} for {}", now.rate_rad_s);
            let acceleration = (after.rate_rad_s - before.rate_rad_s) / (2.0 * h);
            assert!((acceleration - now.acceleration_rad_s2).length() < 1e-8, "acceleration at {t}: {acceleration}");
            fastest = fastest.max(now.rate_rad_s.length());
            hardest = hardest.max(now.acceleration_rad_s2.length());
        }
        assert!(fastest <= 0.02 * (1.0 + 1e-12) && hardest <= 0.002 * (1.0 + 1e-12), "{fastest} {hardest}");
        assert!(hardest > 0.0019, "the limit must be used: {hardest}");
    }
}

#[test]
fn chained_turns_join_at_rest() {
    let one = Leg::turn(start(), DVec3::X * 0.3, &LIMITS);
    let two = Leg::turn(one.end(), DVec3::Z * 0.2, &LIMITS);
    let path = SlewPath::new(&[one, two]).expect("two turns");
    assert!((path.duration_s() - one.duration_s() - two.duration_s()).abs() < 1e-12, "durations add");
    for (t, wanted) in [(-1.0, start()), (one.duration_s(), one.end()), (1e9, two.end())] {
        let apart = path.reference(t).body_from_icrf.rotation_vector_to(&wanted).length();
        assert!(apart < ROUNDING_RAD, "at {t}: {apart}");
    }
    assert_eq!(path.end(), two.end());
    assert_eq!(SlewPath::new(&[]), None, "no turn");
    assert_eq!(SlewPath::new(&[one; 4]), None, "too many turns");
    let nothing = Leg::turn(start(), DVec3::ZERO, &LIMITS);
    assert!(nothing.duration_s() == 0.0 && nothing.reference(1.0).body_from_icrf == start(), "no turn, no time");
}
