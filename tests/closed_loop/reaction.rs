//! Tests an external controller and star tracker acting on an internal spacecraft: torques turn it according to
//! mechanics, wheels return the momentum they take, and attitudes from outside reach the estimator.

use base::{time::Span, units::ARCSEC};
use config::{Document, Scenario};
use frames::sink::NullSink;
use glam::{DMat3, DVec3};
use run::wiring::stepped::SteppedRun;
use std::path::Path;

/// Effect of flexible modes and disturbances relative to a torque of 10 mN m over seconds.
const MECHANICS: f64 = 0.05;

/// Returns a spacecraft at rest at its target, without flexible modes.
fn scenario() -> Scenario {
    let text = "camera = \"../cameras/small_tracker.toml\"\nspacecraft = \"../spacecraft/smallsat.toml\"\n\
                [timing]\nduration_s = 60.0\nframe_rate_hz = 5.0\n[render]\nbackend = \"cpu\"\n\
                [observer]\nkind = \"circular_orbit\"\naltitude_km = 550.0\ninclination_deg = 97.6\n\
                [plant]\nkind = \"vehicle\"\n[plant.pointing]\nra_deg = 84.0\ndec_deg = -1.2\n[plant.initial]\n\
                attitude = \"given\"\nra_deg = 84.0\ndec_deg = -1.2\n";
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/benches/reaction_test.toml");
    let mut scenario = Scenario::from_document(&Document::from_text(text, &path)).unwrap();
    scenario.vehicle_mut().unwrap().spacecraft.params.modes.clear();
    scenario
}

fn begun() -> SteppedRun {
    let mut run = SteppedRun::new(&scenario(), |_| Box::new(NullSink::new())).unwrap();
    step_to(&mut run, 0.0);
    run.with_vehicle_mut(|vehicle, now| vehicle.hand_over(true, now)).unwrap();
    run
}

fn step_to(run: &mut SteppedRun, s: f64) {
    run.advance_to(run.times().zero + Span::from_s(s), &mut |_, _, _| true).unwrap();
}

fn rate(run: &SteppedRun) -> DVec3 {
    run.with_vehicle(|vehicle| vehicle.plant.flown_truth(vehicle.plant.flown_until()).unwrap().rate_rad_s).unwrap()
}

fn inertia() -> DMat3 {
    scenario().vehicle().unwrap().spacecraft.params.inertia_kg_m2
}

#[test]
fn a_torque_from_outside_turns_the_body_by_its_impulse() {
    let turned = |torque_n_m: DVec3| {
        let mut run = begun();
        let before = rate(&run);
        // Between two integration steps, for a time that is not a multiple of them.
        let from = run.times().zero + Span::from_s(1.0037);
        run.with_vehicle_mut(|vehicle, now| vehicle.push(torque_n_m, from, Span::from_s(2.501), now)).unwrap().unwrap();
        step_to(&mut run, 4.0);
        rate(&run) - before
    };
    let torque = DVec3::new(0.02, -0.01, 0.015);
    let (turned, alone, wanted) = (turned(torque), turned(DVec3::ZERO), inertia().inverse() * torque * 2.501);
    let error = (turned - alone - wanted).length() / wanted.length();
    assert!(error < MECHANICS, "{turned} rad/s, wanted {wanted}");
    assert!(alone.length() < 0.05 * wanted.length(), "control: nothing turns it by itself: {alone}");
}

#[test]
fn wheels_driven_outside_give_the_body_what_they_take() {
    let mut run = begun();
    let (before, torque) = (rate(&run), 0.008);
    let speeds = |run: &SteppedRun| run.with_vehicle(|vehicle| vehicle.plant.wheel_speeds_rad_s().to_vec()).unwrap();
    let speeds_before = speeds(&run);
    let drive = |run: &mut SteppedRun, torques: &[f64], s: f64| {
        let at = run.times().zero + Span::from_s(s);
        run.with_vehicle_mut(|vehicle, now| vehicle.drive_wheels(torques, at, now)).unwrap()
    };
    // Announced in the wrong order: each starts at its own time.
    drive(&mut run, &[0.0; 4], 3.0).unwrap();
    drive(&mut run, &[torque, 0.0, 0.0, 0.0], 1.0).unwrap();
    step_to(&mut run, 5.0);
    let scenario = scenario();
    let wheel = &scenario.vehicle().unwrap().spacecraft.params.wheels[0];
    let wanted = inertia().inverse() * wheel.axis_body.normalize() * (-torque * 2.0);
    let error = (rate(&run) - before - wanted).length() / wanted.length();
    assert!(error < 3.0 * MECHANICS, "{} rad/s, wanted {wanted}", rate(&run) - before);
    let spun_up = speeds(&run)[0] - speeds_before[0];
    let wanted_up = torque * 2.0 / wheel.inertia_kg_m2;
    assert!((spun_up / wanted_up - 1.0).abs() < 3.0 * MECHANICS, "{spun_up} rad/s, wanted {wanted_up}");
    assert!((speeds(&run)[1] - speeds_before[1]).abs() < 0.2 * spun_up, "control: the second wheel coasts");
    for (torques, s, part) in [
        (vec![0.0; 3], 6.0, "wanted those of 4"),
        (vec![f64::NAN, 0.0, 0.0, 0.0], 6.0, "wanted a finite one"),
        (vec![0.0; 4], 4.0, "has passed 1 s ago"),
    ] {
        let error = drive(&mut run, &torques, s).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
    run.with_vehicle_mut(|vehicle, now| vehicle.hand_over(false, now)).unwrap();
    let error = drive(&mut run, &[0.0; 4], 6.0).unwrap_err().to_string();
    assert!(error.contains("wanted a hand-over"), "{error}");
}

/// Flies a proportional and differential law on the true attitude, ten times a second, against a constant torque.
fn flown_outside(has_control: bool) -> f64 {
    let mut run = begun();
    let target = run.with_vehicle(|vehicle| vehicle.target).unwrap();
    let (inertia, axes) = (inertia(), wheel_axes());
    let from = run.times().zero + Span::from_s(0.5);
    let torque = DVec3::new(1e-3, 0.0, 0.0);
    run.with_vehicle_mut(|vehicle, now| vehicle.push(torque, from, Span::from_s(60.0), now)).unwrap().unwrap();
    let mut error_rad = 0.0;
    for step in 1..=300 {
        step_to(&mut run, 0.1 * f64::from(step));
        let truth =
            run.with_vehicle(|vehicle| vehicle.plant.flown_truth(vehicle.plant.flown_until()).unwrap()).unwrap();
        let error = truth.body_from_icrf.rotation_vector_to(&target);
        error_rad = error.length();
        if has_control {
            let (w, damping) = (0.5, 0.8);
            let wanted = inertia * (error * (w * w) - truth.rate_rad_s * (2.0 * damping * w));
            // Four wheels on a pyramid: the transpose distributes a torque with this factor.
            let torques: Vec<f64> = axes.iter().map(|axis| -axis.dot(wanted) * 0.75).collect();
            run.with_vehicle_mut(|vehicle, now| vehicle.drive_wheels(&torques, now, now)).unwrap().unwrap();
        }
    }
    error_rad
}

fn wheel_axes() -> Vec<DVec3> {
    let scenario = scenario();
    scenario.vehicle().unwrap().spacecraft.params.wheels.iter().map(|wheel| wheel.axis_body.normalize()).collect()
}

#[test]
fn control_outside_flies_the_spacecraft_inside() {
    let (flown, adrift) = (flown_outside(true), flown_outside(false));
    // 1e-3 N m against 12 kg m^2 and 0.25 1/s^2: 69 arcsec; adrift for 30 s it is 2 degrees.
    assert!(flown < 100.0 * ARCSEC, "{} arcsec", flown / ARCSEC);
    assert!(adrift > 50.0 * flown, "control: without commands it drifts {} arcsec", adrift / ARCSEC);
}

/// Returns the error of the estimate after 20 s with attitudes of an external tracker that have this error, arcsec.
fn sighted_outside(offset: DVec3) -> (f64, bool) {
    let mut run = SteppedRun::new(&scenario(), |_| Box::new(NullSink::new())).unwrap();
    step_to(&mut run, 0.0);
    run.with_vehicle_mut(|vehicle, _| vehicle.hand_over_trackers(true)).unwrap();
    for step in 1..=100 {
        step_to(&mut run, 0.2 * f64::from(step));
        let (at, truth) = run
            .with_vehicle(|vehicle| {
                let at = vehicle.plant.flown_until().min(run.now());
                (at, vehicle.plant.flown_truth(at).unwrap().body_from_icrf)
            })
            .unwrap();
        let seen = truth.rotated_by(offset);
        let taken =
            run.with_vehicle_mut(|vehicle, now| vehicle.take_attitude(at, seen, DVec3::splat(5.0 * ARCSEC), now));
        taken.unwrap().unwrap();
    }
    run.with_vehicle(|vehicle| {
        let truth = vehicle.plant.flown_truth(vehicle.estimate_at()).unwrap().body_from_icrf;
        let error = vehicle.estimate().map(|estimate| truth.rotation_vector_to(&estimate).length() / ARCSEC);
        (error.unwrap(), vehicle.heads.reports().all(|report| report.last.is_none()))
    })
    .unwrap()
}

#[test]
fn attitudes_of_a_tracker_outside_reach_the_estimator() {
    let (error, is_blind) = sighted_outside(DVec3::ZERO);
    assert!(is_blind, "the trackers inside are off");
    assert!(error < 10.0, "{error} arcsec");
    let (error, _) = sighted_outside(DVec3::X * 300.0 * ARCSEC);
    assert!((error - 300.0).abs() < 10.0, "control: it believes what it is sent: {error} arcsec");
    let mut run = begun();
    let (zero, truth) = (run.times().zero, run.with_vehicle(|vehicle| vehicle.target).unwrap());
    for (at_s, sigma, part) in [(0.5, 1e-5, "time tag"), (-2.5, 1e-5, "time tag"), (0.0, 0.0, "sigma")] {
        let at = zero + Span::from_s(at_s);
        let refused = run.with_vehicle_mut(|vehicle, now| vehicle.take_attitude(at, truth, DVec3::splat(sigma), now));
        assert!(refused.unwrap().unwrap_err().to_string().contains(part), "{at_s} {sigma}");
    }
}
