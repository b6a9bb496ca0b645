//! Every rule of cameras and benches, broken once: key, value and words of the refusal.

use super::{MINIMAL_CAMERA, assert_refused, bench, camera, camera_with};

#[test]
fn each_camera_rule_has_a_failing_example() {
    assert_refused(camera(""), "detector.width_px is missing", &["wanted a whole number from 1 to 16384"]);
    let no_height = MINIMAL_CAMERA.replace("height_px = 480\n", "");
    assert_refused(camera(&no_height), "detector.height_px is missing", &["cam.toml:1", "from 1 to 16384"]);
    let no_optics = "[detector]\nwidth_px = 64\nheight_px = 64\n";
    let give = "give the focal length in millimetres";
    assert_refused(camera(no_optics), "optics.focal_length_mm is missing", &[give]);
    let moffat = camera_with("psf", "model = \"moffat\"\nsigma_px = 0.7");
    assert_refused(moffat, "psf.fwhm_px is missing", &["wanted no psf.sigma_px here"]);
    let measured = camera_with("psf", "model = \"measured\"");
    assert_refused(measured, "psf.samples_per_px is missing", &["wanted"]);
    let no_focal = MINIMAL_CAMERA.replace("focal_length_mm = 25", "");
    assert_refused(camera(&no_focal), "optics.focal_length_mm", &["missing", "cam.toml:4"]);
    for bad in ["0", "-3.5", "nan", "inf"] {
        let text = MINIMAL_CAMERA.replace("= 25", &format!("= {bad}"));
        assert_refused(camera(&text), "optics.focal_length_mm", &["cam.toml:5", "from 0.1 to 1000000", "millimetres"]);
    }
    let zero_width = MINIMAL_CAMERA.replace("= 640", "= 0");
    assert_refused(camera(&zero_width), "detector.width_px", &["cam.toml:2", "is 0", "1 to 16384"]);
    for (section, line, parts) in [
        ("detector", "bits = 17", ["1 to 16", "converter"]),
        ("detector", "black_level_dn = 4095", ["0 to 4094", "range for signal"]),
        ("detector", "full_well_e = 0", ["above 0", "data sheet"]),
        ("detector", "gain_e_per_dn = -1", ["above 0", "2^bits"]),
        ("detector", "pixel_pitch_um = nan", ["from 0.1 to", "micrometres"]),
        ("detector", "read_noise_e_rms = -1", ["a number from 0 to", "turns it off"]),
        ("detector", "dark_e_per_s = -1", ["a number from 0 to", "turns it off"]),
        ("detector", "dark_temperature_c = -300", ["-273.15", "Celsius"]),
        ("detector", "prnu = 5", ["0 to 0.5", "1 % is 0.01"]),
        ("detector", "dsnu_e_rms = inf", ["0 or more", "turns it off"]),
        (
            "detector",
            "poisson = \"cornish\"",
            ["\"inversion\", \"cornish-fisher\", \"ptrs\"", "did you mean \"cornish-fisher\""],
        ),
        ("detector", "quantum_efficiency = 45", ["up to 1", "45 % is 0.45"]),
        ("optics", "aperture_mm = 0", ["from 0.1 to", "millimetres"]),
        ("optics", "obscuration = 1", ["0 to 0.95", "ratio"]),
        ("optics", "transmission = 80", ["up to 1", "80 % is 0.8"]),
        ("optics", "principal_point_px = [9999.0, 0.0]", ["1280", "centre"]),
        ("distortion", "k1 = nan", ["-100", "coefficient"]),
        ("psf", "sigma_px = 0", ["from 0.05 to 20", "standard deviation"]),
        ("psf", "model = \"halo\"\nsigma_px = 2.0\nhalo_sigma_px = 1.0", ["is 1", "core"]),
        ("psf", "model = \"gausian\"", ["did you mean \"gaussian\"?", "\"airy\""]),
        ("psf", "f_number = 2", ["belongs to", "airy"]),
        ("psf", "model = \"airy\"\nsigma_px = 1", ["belongs to", "gaussian"]),
        ("psf", "model = \"airy\"\nwavelength_nm = 0.6", ["100 to", "nanometres"]),
        ("psf", "model = \"airy\"\nf_number = 0", ["0.3", "aperture"]),
        ("psf", "model = \"airy\"\nobscuration = -1", ["0.95", "ratio"]),
        ("radiometry", "zero_magnitude_photons_per_s_m2 = 0", ["above 0", "3e10"]),
        ("radiometry", "color_c1 = 50", ["-5 to 5", "BP-RP"]),
        ("radiometry", "color_c2 = nan", ["-5 to 5", "BP-RP"]),
        ("radiometry", "limiting_mag = 99", ["-2 to 25", "render"]),
        ("exposure", "exposure_s = 0", ["above 0", "seconds"]),
        ("exposure", "exposure_s = 5000", ["up to 3600", "100 ms is 0.1"]),
        ("exposure", "rolling_line_us = 2000000", ["is 2000000", "wanted a number from 0 to 1000000"]),
        ("exposure", "readout_s = -1", ["0 to", "seconds"]),
    ] {
        let key = line.lines().last().and_then(|line| line.split(' ').next()).expect("a key");
        assert_refused(camera_with(section, line), &format!("{section}.{key}"), &parts);
    }
}

#[test]
fn each_bench_rule_has_a_failing_example() {
    for (text, key, parts) in [
        ("seed = -1", "seed is -1", ["0 or more", "bench.toml:1"]),
        ("[timing]\nframe_rate_hz = 0", "timing.frame_rate_hz is 0", ["wanted a number above 0", "bench.toml:2"]),
        (
            "[timing]\nframe_rate_hz = 30",
            "timing.frame_rate_hz is 30; wanted at most 10",
            ["one exposure", "lower the frame rate, or shorten exposure.exposure_s"],
        ),
        ("[timing]\nduration_s = nan", "timing.duration_s is NaN", ["above 0", "seconds"]),
        ("[timing]\nduration_s = inf", "timing.duration_s is inf", ["above 0", "bench.toml:2"]),
        ("[timing]\ndegrade_to = \"motion\"", "timing.degrade_to", ["\"motion-out\"", "no sensor would see"]),
        (
            "[timing]\ndeadline_policy = \"skip\"",
            "timing.deadline_policy is \"skip\"",
            ["\"drop\", \"hold\", \"late\"", "leaves a gap"],
        ),
        ("[timing]\nstart_utc = \"noon\"", "timing.start_utc is \"noon\"", ["RFC 3339", "2026-03-01T12:00:00Z"]),
        ("[link]\nkind = \"telepathy\"", "link.kind", ["\"simulated\"", "bench.toml:2"]),
        ("[link]\nwire = \"can\"", "link.wire", ["\"can_fd\"", "bench.toml:2"]),
        ("[link]\nlatency_us = -1", "link.latency_us", ["0 to", "microseconds"]),
        ("[link]\nbit_rate = 0", "link.bit_rate", ["1000 to", "bits per second"]),
        ("[link]\ndata_bit_rate = 100", "link.data_bit_rate", ["500000", "not below"]),
        ("[link]\nwire = \"serial\"\ndata_bit_rate = 1e6", "link.data_bit_rate", ["belongs to", "can_fd"]),
        ("[link]\nqueue = 0", "link.queue", ["whole number", "wait"]),
        ("[mounting]\nsensor_from_body = [nan, 0, 0, 0]", "mounting.sensor_from_body", ["unit quaternion", "NaN"]),
        ("[mounting]\nsensor_from_body = [2, 0, 0, 0]", "mounting.sensor_from_body", ["unit quaternion", "scalar"]),
        ("[observer]\nkind = \"mars\"", "observer.kind", ["\"geocentre\"", "altitude_km"]),
        ("[observer]\naltitude_km = 500", "observer.altitude_km is given", ["belongs to", "circular_orbit"]),
        ("[observer]\nline1 = \"1\"", "observer.line1", ["belongs to", "tle"]),
        (
            "[observer]\nkind = \"circular_orbit\"\naltitude_km = 5",
            "observer.altitude_km is 5",
            ["from 100 to 400000", "550"],
        ),
        ("[observer]\nkind = \"circular_orbit\"\nraan_deg = inf", "observer.raan_deg", ["-360", "degrees"]),
        ("[observer]\nkind = \"tle\"", "observer.line1", ["missing", "checksum"]),
        (
            "[sky]\nlayers = [\"g.starlayer\"]\nmemory_mb = 0",
            "sky.memory_mb is 0",
            ["wanted a whole number from 1 to 65536", "bench.toml:3"],
        ),
        (
            "[timing]\nduration_s = 5\n[[target]]\nposition_px = [100, 100]\nmag = 4\nstart_s = 60",
            "target[0].start_s is 60",
            ["bench.toml:6", "it would never be seen"],
        ),
    ] {
        assert_refused(bench(text), key, &parts);
    }
}

#[test]
fn each_rule_of_motion_and_accuracy_has_a_failing_example() {
    for (text, key, parts) in [
        ("[flight_computer]\nattitude_hz = 0", "flight_computer.attitude_hz", ["up to 100", "per second"]),
        ("[flight_computer]\nattitude_hz = 62.5", "flight_computer.attitude_hz", ["whole number", "62.5"]),
        (
            "[link]\nwire = \"can_classic\"\n[flight_computer]\njitter_source = \"samples\"\njitter_sample_hz = 500",
            "flight_computer.jitter_sample_hz",
            ["1000 on classic CAN", "CAN FD"],
        ),
        (
            "[flight_computer]\nattitude_hz = 400",
            "flight_computer.attitude_hz is 400",
            ["up to 100", "protocol carries"],
        ),
        ("[flight_computer]\ndec_deg = 91", "flight_computer.dec_deg is 91", ["from -90 to 90", "degrees"]),
        ("[flight_computer]\nra_deg = nan", "flight_computer.ra_deg", ["-360", "not hours"]),
        (
            "[flight_computer]\nra_deg = 5500",
            "flight_computer.ra_deg is 5500",
            ["wanted a number from -360 to 360", "degrees, not hours: 5h 30m is 82.5"],
        ),
        ("[flight_computer.slew]\nangle_deg = 1", "flight_computer.slew.axis", ["missing", "body axes"]),
        (
            "[flight_computer.slew]\naxis = [0, 0, 0]",
            "bench.toml:2: flight_computer.slew.axis is",
            ["three finite numbers that are not all 0", "a direction in body axes"],
        ),
        (
            "[flight_computer.slew]\naxis = [1, 0, 0]",
            "flight_computer.slew.angle_deg is missing",
            ["wanted", "degrees to turn"],
        ),
        (
            "[timing]\nduration_s = 10\n[flight_computer.slew]\naxis = [0, 1, 0]\nstart_s = 50\nangle_deg = 3\nduration_s = 5",
            "flight_computer.slew.start_s is 50",
            ["a time before the run ends, at 10 s", "bench.toml:5"],
        ),
        (
            "[flight_computer.slew]\naxis = [0, 1, 0]\nstart_s = -95\nangle_deg = 3\nduration_s = 100",
            "flight_computer.slew.start_s is -95",
            ["wanted a number, 0 or more", "bench.toml:3"],
        ),
        (
            "[flight_computer.slew]\naxis = [0, 1, 0]\nangle_deg = 180\nduration_s = 0.1",
            "flight_computer.slew.duration_s is 0.1",
            ["a turn of at most 1000 deg/s", "bench.toml:4"],
        ),
        ("[attitude]\nstale_policy = \"panic\"", "attitude.stale_policy", ["\"blank\"", "shows no stars"]),
        ("[attitude]\nstale_after_ms = 5", "attitude.stale_after_ms", ["more than 10", "lost message"]),
        (
            "[attitude]\nstale_after_ms = 5e6",
            "attitude.stale_after_ms is 5000000",
            ["from 0 to 3600000", "bench.toml:2"],
        ),
        ("[attitude]\nmax_horizon_ms = -1", "attitude.max_horizon_ms", ["0 to", "milliseconds"]),
        ("[attitude]\nclock_window_s = 0.5", "attitude.clock_window_s", ["2 to 600", "time marks"]),
        ("[attitude]\nclock_step_ms = 0", "attitude.clock_step_ms", ["1 to 60000", "step"]),
        ("[attitude]\nclock_max_drift_ppm = 1e6", "attitude.clock_max_drift_ppm", ["1 to 10000", "drift"]),
        ("[attitude]\nclock_allan_1s = 0", "attitude.clock_allan_1s", ["to 0.00001", "oscillator"]),
        ("[attitude]\npps_sigma_us = 0", "attitude.pps_sigma_us", ["to 1000", "pulses"]),
        ("[accuracy]\ncentroid_px = 0", "accuracy.centroid_px is 0", ["above 0", "0.002"]),
        ("[render]\nbackend = \"cuda\"", "render.backend is \"cuda\"", ["\"gpu\", \"cpu\", \"reference\"", "auto"]),
        (
            "[render]\nmethod = \"effective\"",
            "render.method is \"effective\"",
            ["auto, static, gauss-legendre", "samples"],
        ),
    ] {
        assert_refused(bench(text), key, &parts);
    }
}
