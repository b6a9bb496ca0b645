use super::*;
use crate::{Bench, Document};

fn bench(text: &str) -> Result<Bench, String> {
    Bench::from_document(&Document::from_text(text, std::path::Path::new("bench.toml")))
        .map_err(|error| error.to_string())
}

fn motion(text: &str) -> Motion {
    bench(&format!("[flight_computer.motion]\n{text}")).unwrap().flight_computer.motion.unwrap()
}

#[test]
fn each_kind_is_read_with_its_scale() {
    let turning = motion("kind = \"constant_rate\"\nrate_deg_s = [0.0, 3.0, 4.0]");
    assert!((turning.scale().rate_rad_s - 5.0 * DEG).abs() < 1e-12 && turning.first_s().is_none());
    let row = "[[flight_computer.motion.sinusoid]]\naxis = [0.0, 2.0, 0.0]\namplitude_deg = 1.0\nfrequency_hz = 0.5\n";
    let Motion::Steady { swings, .. } = motion(&format!("kind = \"sinusoidal\"\n{row}{row}")) else {
        panic!("no steady motion")
    };
    assert_eq!((swings.len(), swings[0].axis_body), (2, DVec3::Y));
    let path = motion(&format!("kind = \"waypoints\"\n{}", waypoints(&[(-2.0, 10.0), (2.0, 14.0)])));
    // From rest to rest in 4 s: 15/8 of the mean rate at its fastest.
    let [rate, wanted] = [path.scale().rate_rad_s, 1.875 * DEG];
    assert!(rate >= wanted && rate < 1.05 * wanted, "{rate} for {wanted}");
    assert_eq!(path.first_s(), Some(-2.0));
}

fn waypoints(rows: &[(f64, f64)]) -> String {
    let row = |(t_s, ra_deg): &(f64, f64)| {
        format!("[[flight_computer.motion.waypoint]]\nt_s = {t_s:?}\nra_deg = {ra_deg:?}\ndec_deg = 0.0\n")
    };
    rows.iter().map(row).collect()
}

#[test]
fn impossible_motion_is_refused() {
    let sinusoid = |amplitude_deg: f64, frequency_hz: f64| {
        let row = "[[flight_computer.motion.sinusoid]]\naxis = [1.0, 0.0, 0.0]\n";
        format!("kind = \"sinusoidal\"\n{row}amplitude_deg = {amplitude_deg:?}\nfrequency_hz = {frequency_hz:?}\n")
    };
    for (text, parts) in [
        ("rate_deg_s = [0.0, 0.0, 1.0]".into(), ["flight_computer.motion.kind", "missing"]),
        ("kind = \"constant_rate\"".into(), ["rate_deg_s", "missing"]),
        ("kind = \"constant_rate\"\nrate_deg_s = [900.0, 900.0, 0.0]".into(), ["1272.8 deg/s", "1000 deg/s"]),
        ("kind = \"sinusoidal\"".into(), ["sinusoid", "1 to"]),
        (sinusoid(0.01, 50.0), ["half of flight_computer.attitude_hz", "jitter_line"]),
        (sinusoid(30.0, 40.0), ["deg/s^2", "slow it down"]),
        (format!("kind = \"waypoints\"\n{}", waypoints(&[(0.0, 1.0)])), ["waypoint", "2 to"]),
        (format!("kind = \"waypoints\"\n{}", waypoints(&[(1.0, 1.0), (1.0, 2.0)])), ["waypoint[1].t_s is 1", "rising"]),
        (
            format!("kind = \"waypoints\"\n{}", waypoints(&[(0.0, 0.0), (1.0, 180.0)])),
            ["waypoint[1].t_s", "half a turn"],
        ),
        (format!("kind = \"waypoints\"\n{}", waypoints(&[(0.0, 0.0), (0.05, 90.0)])), ["deg/s", "1000 deg/s"]),
        (
            format!("kind = \"waypoints\"\nrate_deg_s = [0.0, 0.0, 1.0]\n{}", waypoints(&[(0.0, 0.0), (9.0, 9.0)])),
            ["rate_deg_s", "constant_rate"],
        ),
        (format!("kind = \"waypoints\"\n{}", waypoints(&[(1e6, 0.0), (1e6 + 9.0, 9.0)])), ["waypoint[0].t_s", "never"]),
    ] {
        let error = bench(&format!("[flight_computer.motion]\n{text}")).unwrap_err();
        assert!(parts.iter().all(|part| error.contains(part)), "{text}\n{error}");
    }
    let slow = "[flight_computer]\nattitude_hz = 1.0\n[flight_computer.motion]\nkind = \"constant_rate\"\n";
    let error = bench(&format!("{slow}rate_deg_s = [0.0, 90.0, 0.0]")).unwrap_err();
    assert!(error.contains("a radian from one message to the next"), "{error}");
}

#[test]
fn a_motion_is_alone_with_the_simulated_flight_computer() {
    let motion = "[flight_computer.motion]\nkind = \"constant_rate\"\nrate_deg_s = [0.0, 0.0, 1.0]\n";
    let slew = "[flight_computer.slew]\naxis = [1.0, 0.0, 0.0]\nangle_deg = 1.0\nduration_s = 1.0\n";
    let path = format!("[flight_computer.motion]\nkind = \"waypoints\"\n{}", waypoints(&[(0.0, 0.0), (9.0, 9.0)]));
    for (text, part) in [
        (format!("{motion}{slew}"), "flight_computer.slew"),
        (format!("[flight_computer]\nkind = \"external\"\n[link]\nslcan_pty = true\n{motion}"), "simulated"),
        (format!("[flight_computer]\nra_deg = 3.0\n{path}"), "flight_computer.ra_deg"),
        (format!("[plant]\nkind = \"file\"\nattitude = \"x.csv\"\n{motion}"), "plant"),
    ] {
        let error = bench(&text).unwrap_err();
        assert!(error.contains(part), "{text}\n{error}");
    }
}
