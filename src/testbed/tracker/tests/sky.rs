//! Frames of the sky through the whole tracker.

use super::super::{Mode, Outcome, Solution, Tracker};
use super::draw::{Camera, Painter, Shot, random_attitude};
use super::*;
use crate::base::units::ARCSEC;
use rand::SeedableRng;
use rand::rngs::StdRng;

#[test]
#[ignore = "survey"]
fn survey() {
    for (name, camera, frames) in
        [("wide", Camera::wide(), 100), ("coarse", Camera::coarse(), 100), ("narrow", Camera::narrow(), 100)]
    {
        #[allow(clippy::disallowed_methods, reason = "survey")]
        let start = std::time::Instant::now();
        let guide = guide_of(&camera);
        println!(
            "{name}: guide {} pattern {} pairs {} in {:?}",
            guide.stars().len(),
            guide.pattern_stars(),
            guide.pattern_pairs(),
            start.elapsed()
        );
        let mut painter = Painter::new(camera, catalog(), noon(), 1);
        let mut random = StdRng::seed_from_u64(2);
        let mut tracker = Tracker::new(camera.params, guide.clone());
        for (label, missing, false_stars, hot) in [("clean", 0.0, 0, 0), ("dirty", 0.2, 5, 30)] {
            let (mut solved, mut wrong, mut chi, mut xyz, mut stars, mut worst, mut total, mut longest_fail) =
                (0, 0, 0.0, DVec3::ZERO, 0, 0.0_f64, 0.0, 0.0_f64);
            let mut normal = 0.0;
            let mut tt = 0.0;
            let mut tn = 0;
            let mut worst_t = 0.0_f64;
            let mut pred = DVec3::ZERO;
            for _ in 0..frames {
                let attitude = random_attitude(&mut random);
                let shot = Shot { missing, false_stars, hot_pixels: hot, ..Shot::still(attitude, noon(), beta()) };
                let image = painter.shoot(&shot);
                tracker.forget();
                #[allow(clippy::disallowed_methods, reason = "survey")]
                let start = std::time::Instant::now();
                let outcome = tracker.measure(&image, noon(), beta(), None);
                let took = start.elapsed().as_secs_f64();
                total += took;
                worst = worst.max(took);
                match outcome {
                    Outcome::Solved(s) => {
                        solved += 1;
                        let e = s.sensor_from_icrf.rotation_vector_to(&attitude);
                        if e.length() > 100.0 * ARCSEC {
                            wrong += 1;
                            println!("WRONG {} {:?}", e.length() / ARCSEC, s);
                        }
                        chi += s.chi_square_per_dof;
                        xyz += e * e;
                        stars += s.stars;
                        pred += DVec3::new(
                            s.covariance_rad2.x_axis.x,
                            s.covariance_rad2.y_axis.y,
                            s.covariance_rad2.z_axis.z,
                        );
                        normal += e.dot(s.covariance_rad2.inverse() * e);
                        for _ in 0..3 {
                            #[allow(clippy::disallowed_methods, reason = "survey")]
                            let start = std::time::Instant::now();
                            let o = tracker.measure(&image, noon(), beta(), None);
                            let took = start.elapsed().as_secs_f64();
                            if let Outcome::Solved(Solution { mode: Mode::Tracking, .. }) = o {
                                tt += took;
                                tn += 1;
                                worst_t = worst_t.max(took);
                            } else {
                                println!("tracking {o:?}");
                            }
                        }
                    }
                    Outcome::NoSolution(reason) => {
                        println!("{reason:?} {:.1} ms", took * 1e3);
                        longest_fail = longest_fail.max(took);
                    }
                }
            }
            let n = f64::from(solved);
            println!(
                "{name} {label}: {solved}/{frames} wrong {wrong}; chi2 {:.3}; nees/3 {:.3}; rms arcsec {:.3} pred {:.3}; stars {:.1}; LIS mean {:.2} ms worst {:.2} fail {:.2}; track mean {:.3} ms worst {:.3} n {tn}",
                chi / n,
                normal / n / 3.0,
                (xyz / n).map(f64::sqrt) / ARCSEC,
                (pred / n).map(f64::sqrt) / ARCSEC,
                f64::from(stars) / n,
                total / f64::from(frames) * 1e3,
                worst * 1e3,
                longest_fail * 1e3,
                tt / f64::from(tn.max(1)) * 1e3,
                worst_t * 1e3
            );
        }
    }
}
