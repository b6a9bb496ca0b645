//! Rates beside differences of attitudes, velocities beside differences of positions: wrong files are refused, good ones
//! with thrusts, slews, spins, noise and coarse rows are not.

use super::*;

/// Returns a table of a motion with rates that `stated` makes of the true ones, deg/s.
fn table(states: &[AttitudeState], stated: impl Fn(DVec3) -> DVec3) -> String {
    let mut text = String::from("t_s,q_w,q_x,q_y,q_z,w_x_deg_s,w_y_deg_s,w_z_deg_s\n");
    for state in states {
        let [w, x, y, z] = state.body_from_icrf.wxyz();
        let rate = stated(state.rate_rad_s.unwrap_or_default().map(f64::to_degrees));
        let t_s = (state.t_ns - states[0].t_ns) as f64 * 1e-9;
        text += &format!("{t_s},{w},{x},{y},{z},{},{},{}\n", rate.x, rate.y, rate.z);
    }
    text
}

fn spin(rate_deg_s: f64) -> impl Fn(f64) -> (Rotation<Body, Icrf>, DVec3) {
    let rate = DVec3::new(0.1, -0.2, 0.97).normalize() * rate_deg_s.to_radians();
    move |t_s| (turned(DVec3::X * 0.3).rotated_by(rate * t_s), rate)
}

/// Returns a body that spins and swings.
fn swing(t_s: f64) -> (Rotation<Body, Icrf>, DVec3) {
    let angle = 0.4 * (1.1 * t_s).sin();
    let rate = Rotation::<Body, Icrf>::from_rotation_vector(DVec3::X * angle).apply(DVec3::Z * 0.3);
    (turned(DVec3::Z * 0.3 * t_s).rotated_by(DVec3::X * angle), rate + DVec3::X * 0.44 * (1.1 * t_s).cos())
}

/// Returns a slew about y of 0.6 rad from `from_s` on: it speeds up for half of `for_s`, then slows down.
fn slew(from_s: f64, for_s: f64) -> impl Fn(f64) -> (Rotation<Body, Icrf>, DVec3) {
    let a = 4.0 * 0.6 / (for_s * for_s);
    move |t_s| {
        let t = (t_s - from_s).clamp(0.0, for_s);
        let back = for_s - t;
        let (angle, rate) =
            if t < for_s / 2.0 { (a * t * t / 2.0, a * t) } else { (0.6 - a * back * back / 2.0, a * back) };
        (turned(DVec3::Y * angle), DVec3::Y * rate)
    }
}

/// Returns numbers that scatter about zero by about 1.
fn noise(seed: f64) -> DVec3 {
    let one = |n: f64| 2.0 * ((seed * 12.9898 + n * 78.233).sin() * 43_758.545).fract();
    DVec3::new(one(1.0), one(2.0), one(3.0))
}

#[test]
fn good_rates_are_read_without_a_warning() {
    let noisy = |t_s: f64| {
        let (body, rate) = spin(0.06)(t_s);
        (body.rotated_by(noise(t_s) * 5e-5), rate + noise(-t_s) * 1e-5)
    };
    for (name, states) in [
        ("a spin", sampled(16, 2.0, spin(24.0))),
        ("two rows of a spin", sampled(2, 2.0, spin(24.0))),
        ("rest", sampled(10, 1.0, spin(0.0))),
        ("a swing", sampled(60, 0.3, swing)),
        ("a swing of coarse rows", sampled(30, 2.0, swing)),
        ("a slew over many rows", sampled(60, 1.0, slew(10.3, 25.0))),
        ("a slew of two rows", sampled(30, 5.0, slew(52.0, 9.0))),
        ("a slew between two rows", sampled(12, 60.0, slew(190.0, 30.0))),
        ("measured rows", sampled(400, 0.1, noisy)),
    ] {
        let history = attitudes(&table(&states, |rate| rate));
        assert_eq!(history.warnings, Vec::<String>::new(), "{name}");
    }
}

#[test]
fn rates_of_another_unit_sign_or_order_are_refused() {
    let motions = [
        ("a spin", sampled(16, 2.0, spin(24.0))),
        ("two rows of a spin", sampled(2, 2.0, spin(24.0))),
        ("a swing", sampled(60, 0.3, swing)),
        ("a slew", sampled(30, 1.0, slew(0.0, 30.0))),
        ("rows close to each other", sampled(100, 0.01, spin(6.0))),
    ];
    for (name, states) in &motions {
        for (what, stated) in [
            ("rad/s", (|rate: DVec3| rate.map(f64::to_radians)) as fn(DVec3) -> DVec3),
            ("sign", |rate| -rate),
            ("axes", |rate| DVec3::new(rate.y, rate.z, rate.x)),
            ("half", |rate| rate * 0.5),
        ] {
            let error = read::attitudes("x.csv", &table(states, stated), None).expect_err(what).to_string();
            for part in ["the rates contradict the attitudes in", "from row 1 to row 2", "deg/s", "check their unit"] {
                assert!(
                    error.contains(part) || (name.contains("slew") && part.contains("row")),
                    "{name}, {what}: {error}"
                );
            }
        }
    }
    // The scalar taken for another component.
    let text = table(&motions[0].1, |rate| rate).replace("q_w,q_x,q_y,q_z", "q_x,q_y,q_z,q_w");
    assert!(read::attitudes("x.csv", &text, None).unwrap_err().to_string().contains("contradict"));
}

#[test]
fn rates_decide_how_far_a_spinner_turns_from_row_to_row() {
    // More than half a turn, a whole one, and three and a half.
    for (rate_deg_s, step_s) in [(18.29, 10.0), (24.0, 15.0), (-120.0, 10.5)] {
        let motion = spin(rate_deg_s);
        let history = attitudes(&table(&sampled(8, step_s, &motion), |rate| rate));
        assert_eq!(history.warnings, Vec::<String>::new());
        assert!(history.notes.iter().any(|note| note.contains("the rates say")), "{:?}", history.notes);
        for part in [0.1, 0.5, 3.7, 6.9] {
            let (wanted, rate) = motion(part * step_s);
            let got = history.at_ns((part * step_s * 1e9) as i64).unwrap();
            assert!(angle(&got.body_from_icrf, &wanted) < 1e-7, "{rate_deg_s} deg/s, {part} steps");
            assert!((got.rate_rad_s - rate).length() < 1e-8 && got.acceleration_rad_s2.length() < 1e-6);
        }
        let [limit, ..] = history.motion_limits();
        assert!((limit - rate_deg_s.abs().to_radians()).abs() < 1e-6, "{limit} rad/s");
    }
    // One that swings, too: the cubic beside the turn is as good as that of slow bodies.
    let quick = |t_s: f64| {
        let (body, rate) = swing(t_s);
        let spin = DVec3::Z * 20.0;
        let turn = Rotation::<Body, Icrf>::from_rotation_vector(spin * t_s);
        (body.rotated_by(spin * t_s), turn.apply(rate) + spin)
    };
    let history = attitudes(&table(&sampled(200, 0.2, quick), |rate| rate));
    let middle = history.at_ns(7_100_000_000).unwrap();
    assert!(angle(&middle.body_from_icrf, &quick(7.1).0) < 0.02, "{}", angle(&middle.body_from_icrf, &quick(7.1).0));
}

#[test]
fn a_few_contradicting_rows_are_a_warning_and_show_in_the_error() {
    let states = sampled(40, 1.0, spin(1.0));
    let mut text = table(&states, |rate| rate);
    let clean = attitudes(&text).interpolation_error_rad().unwrap();
    assert!(clean < 1e-9, "control: {clean}");
    let rows: Vec<String> = text
        .lines()
        .zip(0..)
        .map(|(line, number)| {
            let Some((values, _)) = line.rsplit_once(',').filter(|_| (10..14).contains(&number)) else {
                return line.into();
            };
            format!("{values},-0.97")
        })
        .collect();
    text = rows.join("\n");
    let history = attitudes(&text);
    assert!(history.warnings[0].contains("in 1 of 39 steps: from row 11"), "{:?}", history.warnings);
    let shown_deg = history.interpolation_error_rad().unwrap().to_degrees();
    assert!((0.1..1.0).contains(&shown_deg), "rates off by 2 deg/s for a step of 1 s: {shown_deg} deg");
}

/// Returns states of a flight about the Earth that begins at perigee, with a change of velocity at `burn_s`.
fn flight(count: u32, step_s: f64, eccentricity: f64, burn_s: f64) -> Vec<[f64; 7]> {
    const GM: f64 = 398_600.441_8;
    let mut position = DVec3::new(6930.0, 0.0, 0.0);
    let mut velocity = DVec3::new(0.0, 0.62, 0.785).normalize() * (GM * (1.0 + eccentricity) / 6930.0).sqrt();
    let pull = |position: DVec3| position * (-GM / position.length().powi(3));
    let mut states = Vec::new();
    for row in 0..count {
        states.push([f64::from(row) * step_s, position.x, position.y, position.z, velocity.x, velocity.y, velocity.z]);
        let (parts, dt) = (200, step_s / 200.0);
        for part in 0..parts {
            let t_s = f64::from(row) * step_s + f64::from(part) * dt;
            if (t_s..t_s + dt).contains(&burn_s) {
                velocity *= 1.02;
            }
            // Two half kicks about a drift: of second order, and reversible.
            velocity += pull(position) * (dt / 2.0);
            position += velocity * dt;
            velocity += pull(position) * (dt / 2.0);
        }
    }
    states
}

fn orbit_table(states: &[[f64; 7]], change: impl Fn(usize, [f64; 7]) -> [f64; 7]) -> String {
    let mut text = String::from("unix_s,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s\n");
    for (row, state) in states.iter().enumerate() {
        let [t, x, y, z, vx, vy, vz] = change(row, *state);
        text += &format!("{},{x:.6},{y:.6},{z:.6},{vx:.9},{vy:.9},{vz:.9}\n", 1_772_323_200.0 + t);
    }
    text
}

#[test]
fn good_velocities_are_read_without_a_warning() {
    const NEVER: f64 = -1.0;
    for (name, states) in [
        ("low", flight(60, 60.0, 0.01, NEVER)),
        ("coarse", flight(40, 400.0, 0.01, NEVER)),
        ("close rows", flight(40, 0.1, 0.01, NEVER)),
        ("two rows", flight(2, 60.0, 0.01, NEVER)),
        ("a long ellipse", flight(200, 300.0, 0.85, NEVER)),
        ("a thrust", flight(60, 60.0, 0.01, 1234.0)),
        ("a thrust at a row", flight(60, 60.0, 0.01, 1200.0)),
    ] {
        let history = orbit(&orbit_table(&states, |_, state| state));
        assert_eq!(history.warnings, Vec::<String>::new(), "{name}");
    }
}

#[test]
fn velocities_and_units_that_cannot_be_are_refused() {
    let states = flight(30, 60.0, 0.01, -1.0);
    let velocity =
        |by: f64| move |_: usize, [t, x, y, z, vx, vy, vz]: [f64; 7]| [t, x, y, z, by * vx, by * vy, by * vz];
    let turning = |_: usize, [t, x, y, z, vx, vy, vz]: [f64; 7]| [t, x, y, z, vx + 7.29e-5 * y, vy - 7.29e-5 * x, vz];
    let metres = |row: usize, only: Option<usize>, state: [f64; 7]| {
        let is_in = only.is_none_or(|only| only == row);
        core::array::from_fn(|n| if n > 0 && is_in { 1000.0 * state[n] } else { state[n] })
    };
    for (what, text, part) in [
        ("reversed", orbit_table(&states, velocity(-1.0)), "the velocities contradict the positions in 29 of 29 steps"),
        ("feet", orbit_table(&states, velocity(3.28)), "check their units"),
        ("turning axes", orbit_table(&states, turning), "their axes do not turn"),
        ("m/s", orbit_table(&states, velocity(1000.0)), "row 1 of segment 1"),
        ("metres", orbit_table(&states, |row, state| metres(row, None, state)), "row 1 of segment 1"),
        ("a row in metres", orbit_table(&states, |row, state| metres(row, Some(5), state)), "row 6 of segment 1"),
        ("light", orbit_table(&states, velocity(1e300)), "wanted at most 32"),
    ] {
        let error = read::orbit("x.csv", &text).expect_err(what).to_string();
        assert!(error.contains(part) && error.contains("wanted"), "{what}: {error}");
    }
}

#[test]
fn velocities_of_turning_axes_show_in_the_error_of_coarse_rows() {
    let states = flight(30, 60.0, 0.01, -1.0);
    let good = orbit(&orbit_table(&states, |_, state| state)).interpolation_error().unwrap();
    assert!(good[1] < 1e-3, "control: {good:?}");
    let off =
        |row: usize, [t, x, y, z, vx, vy, vz]: [f64; 7]| [t, x, y, z, vx, vy + if row == 9 { 0.3 } else { 0.0 }, vz];
    let history = orbit(&orbit_table(&states, off));
    let shown = history.interpolation_error().unwrap();
    assert!((0.1..0.6).contains(&shown[1]), "{shown:?} km, km/s");
}

#[test]
fn missing_rows_are_a_warning() {
    let states = sampled(60, 1.0, spin(1.0));
    let (mut with, mut without) = (states.clone(), states);
    with.drain(20..47);
    without.truncate(40);
    assert!(
        attitudes(&table(&with, |rate| rate)).warnings[0]
            .contains("after row 20 of segment 1: the next is 28 usual steps")
    );
    assert_eq!(attitudes(&table(&without, |rate| rate)).warnings, Vec::<String>::new());
}
