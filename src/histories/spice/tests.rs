//! Kernels made byte by byte: what is read, and what is refused. `hil_scripts/tests/test_spice.py` has those of CSPICE.

use super::*;
use base::{axes::Rotation, time::Tai};
use glam::DVec3;

const LSK: &str = "KPL/LSK\n\\begindata\nDELTET/K = 1.657D-3\nDELTET/EB=1.671D-2\nDELTET/M = ( 6.239996D0 1.99096871D-7 )\n\
                   DELTET/DELTA_AT = ( 10, @1972-JAN-1\n 37, @2017-JAN-1 )\n\\begintext\n";
/// TT, one tick a hundredth of a second, from 1000 s after J2000.
const SCLK: &str = "KPL/SCLK\n\\begindata\nSCLK_KERNEL_ID = ( @2026-01-01/00:00:00 )\nSCLK_DATA_TYPE_7 = ( 1 )\n\
                    SCLK01_TIME_SYSTEM_7 = ( 2 )\nSCLK01_MODULI_7 = ( 4294967296 100 )\n\
                    SCLK01_COEFFICIENTS_7 = ( 0.0E+00 1.0D+03\n 1.0E+00 )\nSCLK01_COEFFICIENTS_7 += ( 1.0E6 2.0D4 1.0 )\n\\begintext\n";

/// Returns a file of segments: two doubles and four integers of each summary, and words.
fn daf(kind: &str, segments: &[Segment], is_little: bool) -> Vec<u8> {
    let mut file = vec![0_u8; 3 * 1024];
    let integer = |value: i32| if is_little { value.to_le_bytes() } else { value.to_be_bytes() };
    let double = |value: f64| if is_little { value.to_le_bytes() } else { value.to_be_bytes() };
    file[..8].copy_from_slice(format!("{kind:<8}").as_bytes());
    for (offset, value) in [(8, 2), (12, 6), (76, 2), (80, 2)] {
        file[offset..offset + 4].copy_from_slice(&integer(value));
    }
    file[88..96].copy_from_slice(if is_little { b"LTL-IEEE" } else { b"BIG-IEEE" });
    file[1024 + 16..1024 + 24].copy_from_slice(&double(segments.len() as f64));
    for (place, (doubles, integers, words)) in segments.iter().enumerate() {
        let begin = i32::try_from(file.len() / 8 + 1).unwrap();
        let end = begin + i32::try_from(words.len()).unwrap() - 1;
        let mut at = 1024 + 24 + 40 * place;
        for value in doubles {
            file[at..at + 8].copy_from_slice(&double(*value));
            at += 8;
        }
        for value in integers.iter().chain(&[begin, end]) {
            file[at..at + 4].copy_from_slice(&integer(*value));
            at += 4;
        }
        file.extend(words.iter().flat_map(|word| double(*word)));
    }
    file
}

fn quaternion(angle_rad: f64) -> [f64; 4] {
    Rotation::<base::axes::Body, base::axes::Icrf>::IDENTITY.rotated_by(DVec3::Z * angle_rad).wxyz()
}

/// Doubles and whole numbers of a segment's summary, and its words.
type Segment = ([f64; 2], [i32; 4], Vec<f64>);

/// Returns four rows a second apart at 0.1 rad/s about Z; the last two are another interval.
fn type_3() -> Segment {
    let mut words: Vec<f64> = (0..4).flat_map(|i| quaternion(0.1 * f64::from(i))).collect();
    words.extend([0.0, 100.0, 200.0, 300.0, 0.0, 200.0, 2.0, 4.0]);
    ([0.0, 300.0], [-7, 1, 3, 0], words)
}

/// Returns one interval of two seconds at 0.1 rad/s about Z.
fn type_2() -> Segment {
    let mut words = quaternion(0.4).to_vec();
    words.extend([0.0, 0.0, 0.1, 0.01, 400.0, 600.0]);
    ([400.0, 600.0], [-7, 1, 2, 1], words)
}

fn read(bytes: &[u8], texts: &[&str]) -> Result<AttitudeHistory, String> {
    let texts: Vec<_> = texts.iter().map(|text| KernelFile { file: "a.t", bytes: text.as_bytes() }).collect();
    attitudes(KernelFile { file: "a.bc", bytes }, &texts, None).map_err(|error| error.to_string())
}

/// Returns TAI of seconds after the clock's zero.
fn at(t_s: f64) -> i64 {
    let zero = Tai::from_tt_ns((10_957 * 86_400 + 43_200 + 1000) * 1_000_000_000);
    (zero + base::time::Span::from_s(t_s)).ns()
}

#[test]
fn attitudes_are_read_in_either_byte_order_and_gaps_stay_gaps() {
    for is_little in [true, false] {
        let history = read(&daf("DAF/CK", &[type_2(), type_3()], is_little), &[SCLK, LSK]).unwrap();
        assert_eq!((history.rows(), history.segments().len()), (6, 3));
        for (t_s, angle_rad) in [(0.0, 0.0), (0.25, 0.025), (1.0, 0.1), (2.5, 0.25), (4.0, 0.4), (5.0, 0.5), (6.0, 0.6)]
        {
            let motion = history.at_ns(at(t_s)).unwrap_or_else(|| panic!("{t_s} s"));
            let wanted = Rotation::IDENTITY.rotated_by(DVec3::Z * angle_rad);
            assert!(motion.body_from_icrf.rotation_vector_to(&wanted).length() < 1e-9, "{t_s} s");
            let conjugated = Rotation::IDENTITY.rotated_by(DVec3::Z * -angle_rad);
            let is_control = angle_rad == 0.0 || motion.body_from_icrf.rotation_vector_to(&conjugated).length() > 0.01;
            assert!(is_control, "negative control");
        }
        for t_s in [-0.1, 1.5, 3.5, 6.1] {
            assert!(history.at_ns(at(t_s)).is_none(), "{t_s} s");
        }
    }
}

#[test]
fn an_orbit_is_read() {
    // A straight flight: exact for any polynomial.
    let mut words: Vec<f64> = (0..5).flat_map(|i| [7000.0 + f64::from(i) * 70.0, 1.0, 2.0, 7.0, 0.0, 0.0]).collect();
    words.extend((0..5).map(|i| 1000.0 + 10.0 * f64::from(i)));
    words.extend([1.0, 5.0]);
    let file = daf("DAF/SPK", &[([1000.0, 1040.0], [-7, 399, 1, 13], words.clone())], true);
    let read = |bytes: &[u8]| orbit(KernelFile { file: "o.bsp", bytes }, &[], None).map_err(|error| error.to_string());
    let orbit = read(&file).unwrap();
    // TDB is within 2 ms of TT.
    let state = orbit.at_ns(at(15.0)).unwrap();
    assert!((state.position_km - DVec3::new(7105.0, 1.0, 2.0)).length() < 0.02, "{state:?}");
    assert!(state.velocity_km_s.abs_diff_eq(DVec3::X * 7.0, 1e-6) && orbit.centre == crate::orbit::Centre::Earth);
    for (integers, part) in [([-7, 3, 1, 13], "centre 3"), ([-7, 399, 13, 13], "frame 13"), ([-7, 399, 1, 5], "type 5")]
    {
        let error = read(&daf("DAF/SPK", &[([1000.0, 1040.0], integers, words.clone())], true)).unwrap_err();
        assert!(error.starts_with("o.bsp: ") && error.contains(part), "{error}");
    }
}

#[test]
fn a_chebyshev_record_is_its_polynomial() {
    // x = 7000 + 350 u + 10 (2 u^2 - 1) over 100 s, u from -1 to 1.
    let mut words = vec![1050.0, 50.0, 7000.0, 350.0, 10.0];
    words.extend([0.0; 6]);
    words.extend([1000.0, 100.0, 11.0, 1.0]);
    let file = daf("DAF/SPK", &[([1000.0, 1100.0], [-7, 399, 1, 2], words)], true);
    let orbit = orbit(KernelFile { file: "o.bsp", bytes: &file }, &[], None).unwrap();
    let state = orbit.at_ns(at(75.0)).unwrap();
    // u = 0.5, du/dt = 1/50; TDB - TT is below 2 ms.
    assert!((state.position_km.x - 7170.0).abs() < 0.02 && (state.velocity_km_s.x - 7.4).abs() < 1e-4, "{state:?}");
}

#[test]
fn unreadable_kernels_are_refused_with_a_reason() {
    let good = daf("DAF/CK", &[type_3()], true);
    let changed = |place: usize, value: f64| {
        let mut file = good.clone();
        file[place..place + 8].copy_from_slice(&value.to_le_bytes());
        file
    };
    let with = |change: fn(&mut Segment)| {
        let mut segment = type_3();
        change(&mut segment);
        daf("DAF/CK", &[segment], true)
    };
    for (file, part) in [
        (b"DAFETF NAIF DAF ENCODED".to_vec(), "transfer file"),
        (b"KPL/CK".to_vec(), "it begins with"),
        (good[..90].to_vec(), "byte order"),
        (good[..1050].to_vec(), "list of segments is broken"),
        (good[..good.len() - 8].to_vec(), "inside the file"),
        (changed(1024, 2.0), "list of segments is broken"),
        (changed(1024 + 16, 1e6), "list of segments is broken"),
        (changed(1024 + 16, 0.0), "no segment"),
        (with(|s| s.1[1] = 13), "frame 13"),
        (with(|s| s.1[2] = 1), "type 1"),
        (with(|s| s.2[0] = 2.0), "a unit one, within 0.001"),
        (with(|s| *s.2.last_mut().unwrap() = 5.0), "counts of a segment"),
        (with(|s| *s.2.last_mut().unwrap() = f64::NAN), "counts of a segment"),
        (with(|s| s.2[16] = -5.0), "rows before the first interval"),
        (with(|s| [16, 20].into_iter().for_each(|place| s.2[place] = -5.0)), "before its clock begins"),
    ] {
        let error = read(&file, &[SCLK]).expect_err(part);
        assert!(error.starts_with("a.bc: ") && error.contains(part), "{part}: {error}");
    }
    let packed = [KernelFile { file: "a.tsc.gz", bytes: b"\x1f\x8b\x08\0" }];
    let error = attitudes(KernelFile { file: "a.bc", bytes: &good }, &packed, None).unwrap_err().to_string();
    assert!(error.contains("a.tsc.gz: it is packed by gzip"), "{error}");
    for s_per_tick in [1e279, f64::INFINITY, 0.021, 0.004] {
        let mut segment = type_2();
        segment.2[7] = s_per_tick;
        let error = read(&daf("DAF/CK", &[segment], true), &[SCLK]).expect_err("another clock");
        assert!(error.contains("by its own rate of the clock, and 2 s"), "{s_per_tick}: {error}");
    }
    for (texts, part) in [
        (vec![], "no text kernel: no SCLK_DATA_TYPE_7"),
        (vec![LSK], "a.t: no SCLK_DATA_TYPE_7"),
        (vec!["hello"], "not a text kernel"),
        (vec!["KPL/SCLK\n\\begindata\n5 6\n"], "a.t:3"),
        (vec!["KPL/SCLK\n\\begindata\nSCLK_DATA_TYPE_7 = 2\n"], "a.t:3: another type than 1"),
    ] {
        let error = read(&good, &texts).expect_err(part);
        assert!(error.contains(part), "{part}: {error}");
    }
    let two = daf("DAF/CK", &[type_3(), ([0.0, 1.0], [-8, 1, 3, 0], type_3().2)], true);
    let error = read(&two, &[SCLK]).expect_err("two instruments");
    assert!(error.contains("[-8, -7]"), "{error}");
}

#[test]
fn a_record_of_type_2_turns_by_its_own_rate() {
    // 24 deg/s for 60 s: four whole turns.
    let with = |rate_rad_s: f64, s_per_tick: f64| {
        let mut words = quaternion(0.4).to_vec();
        words.extend([0.0, 0.0, rate_rad_s, s_per_tick, 0.0, 6000.0]);
        read(&daf("DAF/CK", &[([0.0, 6000.0], [-7, 1, 2, 1], words)], true), &[SCLK])
    };
    let rate_rad_s = 24_f64.to_radians();
    let history = with(rate_rad_s, 0.01).unwrap();
    for t_s in [0.0, 10.0, 37.5, 60.0] {
        let motion = history.at_ns(at(t_s)).unwrap();
        let wanted = Rotation::IDENTITY.rotated_by(DVec3::Z * (0.4 + rate_rad_s * t_s));
        assert!(motion.body_from_icrf.rotation_vector_to(&wanted).length() < 1e-9, "{t_s} s");
        assert!((motion.rate_rad_s - DVec3::Z * rate_rad_s).length() < 1e-12);
    }
    assert!((history.motion_limits()[0] - rate_rad_s).abs() < 1e-12);
    // A clock's rate of 0 is one by which nothing turns.
    let still = with(rate_rad_s, 0.0).unwrap().at_ns(at(30.0)).unwrap();
    assert!(still.body_from_icrf.rotation_vector_to(&Rotation::IDENTITY.rotated_by(DVec3::Z * 0.4)).length() < 1e-9);
    // Voyager's kernels: no turn, and 1 s a tick, whatever the clock says.
    for s_per_tick in [1.0, 1e-6, f64::INFINITY] {
        let still = with(0.0, s_per_tick).unwrap().at_ns(at(30.0)).unwrap();
        let wanted = Rotation::IDENTITY.rotated_by(DVec3::Z * 0.4);
        assert!(still.body_from_icrf.rotation_vector_to(&wanted).length() < 1e-9, "{s_per_tick}");
    }
    assert!(with(rate_rad_s, 0.03).unwrap_err().contains("by its own rate of the clock"), "control");
}

#[test]
fn the_segment_that_is_later_in_the_file_counts() {
    let rows = |angle_rad: f64, from: f64, until: f64| -> Segment {
        let mut words: Vec<f64> = [angle_rad; 2].into_iter().flat_map(quaternion).collect();
        words.extend([from, until, from, 1.0, 2.0]);
        ([from, until], [-7, 1, 3, 0], words)
    };
    let [long, short] = [rows(0.1, 0.0, 10_000.0), rows(0.2, 3000.0, 7000.0)];
    let angles = |segments: &[Segment]| {
        let history = read(&daf("DAF/CK", segments, true), &[SCLK]).unwrap();
        [20.0, 50.0, 80.0].map(|t_s| {
            let z = history.at_ns(at(t_s)).unwrap().body_from_icrf;
            (Rotation::IDENTITY.rotation_vector_to(&z).z * 10.0).round()
        })
    };
    assert_eq!(angles(&[long.clone(), short.clone()]), [1.0, 2.0, 1.0]);
    let rows = read(&daf("DAF/CK", &[long.clone(), short.clone()], true), &[SCLK]).unwrap().rows();
    assert_eq!(rows, 4, "each row once");
    assert_eq!(angles(&[short, long]), [1.0, 1.0, 1.0], "control: the order counts");
    let flight = |x_km: f64, from_s: f64, until_s: f64| -> Segment {
        let mut words = vec![x_km, 0.0, 0.0, 0.0, 0.0, 0.0, x_km, 0.0, 0.0, 0.0, 0.0, 0.0];
        words.extend([from_s, until_s, 1.0, 2.0]);
        ([from_s, until_s], [-7, 399, 1, 13], words)
    };
    let file = daf("DAF/SPK", &[flight(7000.0, 1000.0, 1100.0), flight(8000.0, 1030.0, 1070.0)], true);
    let orbit = orbit(KernelFile { file: "o.bsp", bytes: &file }, &[], None).unwrap();
    let x_km = [20.0, 50.0, 80.0].map(|t_s| orbit.at_ns(at(t_s)).unwrap().position_km.x.round());
    assert_eq!(x_km, [7000.0, 8000.0, 7000.0]);
}

#[test]
fn rounded_quaternions_are_read_and_made_unit_ones() {
    let mut segment = type_3();
    segment.2.iter_mut().take(16).for_each(|number| *number = (*number * 1e4).round() * 1e-4);
    let history = read(&daf("DAF/CK", &[segment], true), &[SCLK]).unwrap();
    let turned = history.at_ns(at(1.0)).unwrap().body_from_icrf;
    assert!((turned.quat().length() - 1.0).abs() < 1e-15);
    assert!(turned.rotation_vector_to(&Rotation::IDENTITY.rotated_by(DVec3::Z * 0.1)).length() < 2e-4);
}

#[test]
fn constant_frames_are_those_of_cspice() {
    /// `spiceypy.pxform("J2000", name, 0)`, CSPICE N0067: first and second row.
    const ROWS: [(i32, [[f64; 3]; 2]); 3] = [
        (
            2,
            [
                [0.9999257079523629, 0.01117893812642769, 0.0048590038414544285],
                [-0.011178938137770135, 0.9999375133499887, -2.7157926258510777e-05],
            ],
        ),
        (
            16,
            [[0.673257747460025, 0.739407874914146, 0.0], [-0.5896308378262533, 0.536880310821634, 0.6034028562547383]],
        ),
        (17, [[1.0, 0.0, 0.0], [0.0, 0.9174820620691818, 0.3977771559319137]]),
    ];
    let source = Source { file: "a.bc", text: "" };
    for (number, rows) in ROWS {
        let axes = axes_from_icrf(number, &source).unwrap().unwrap();
        for (row, axis) in rows.into_iter().zip([DVec3::X, DVec3::Y]) {
            let got = axes.conjugate() * axis;
            assert!((got - DVec3::from_array(row)).length() < 1e-15, "frame {number}: {got}");
        }
        let mut segment = type_3();
        segment.1[1] = number;
        let first = read(&daf("DAF/CK", &[segment], true), &[SCLK]).unwrap().at_ns(at(0.0)).unwrap();
        assert!(first.body_from_icrf.quat().dot(axes).abs() > 1.0 - 1e-15, "the first attitude is that of the frame");
    }
    assert_eq!(axes_from_icrf(1, &source).unwrap(), None);
}

#[test]
fn one_record_out_of_order_is_searched_as_cspice_does() {
    let rows: Vec<[f64; 3]> = (0..8).map(|i| [1e4 * f64::from(i), 1000.0 + 100.0 * f64::from(i), 1.0]).collect();
    let text = |falls: &[usize]| {
        let mut rows = rows.clone();
        falls.iter().for_each(|place| rows[*place][0] -= 1.5e4);
        let rows: String = rows.iter().map(|[a, b, c]| format!("{a} {b} {c}\n")).collect();
        format!(
            "\\begindata\nSCLK_DATA_TYPE_7 = 1\nSCLK01_TIME_SYSTEM_7 = 2\nSCLK01_MODULI_7 = ( 1 100 )\nSCLK01_COEFFICIENTS_7 = ( {rows} )\n"
        )
    };
    let [plain, one, two] =
        [&[][..], &[5], &[3, 6]].map(|falls| read(&daf("DAF/CK", &[type_3()], true), &[&text(falls)]));
    let notes = |history: Result<AttitudeHistory, String>| history.unwrap().notes;
    assert!(notes(plain).is_empty());
    assert!(notes(one)[0].contains("1 records of the clock are out of order"));
    assert!(two.unwrap_err().contains("a.t:5: ticks that do not rise"));
    let row = |i: i32| {
        let fall = if [20, 50, 80].contains(&i) { 1.5e4 } else { 0.0 };
        format!("{} {} 1\n", 1e4 * f64::from(i) - fall, 1000.0 + 100.0 * f64::from(i))
    };
    let rows: String = (0..103).map(row).collect();
    let clock = format!(
        "\\begindata\nSCLK_DATA_TYPE_7 = 1\nSCLK01_TIME_SYSTEM_7 = 2\nSCLK01_MODULI_7 = ( 1 100 )\nSCLK01_COEFFICIENTS_7 = ( {rows} )\n"
    );
    let three = read(&daf("DAF/CK", &[type_3()], true), &[&clock]);
    assert!(notes(three)[0].contains("3 records of the clock are out of order"));
}

#[test]
fn a_record_of_a_high_degree_is_evaluated_as_it_is() {
    // x = 7000 + T27(u), over 6000 s: T27(cos a) = cos 27 a.
    let mut words = vec![4000.0, 3000.0, 7000.0];
    words.extend([0.0; 26]);
    words.push(1.0);
    words.extend([0.0; 56]);
    words.extend([1000.0, 6000.0, 86.0, 1.0]);
    let file = daf("DAF/SPK", &[([1000.0, 7000.0], [-7, 399, 1, 2], words)], true);
    let orbit = orbit(KernelFile { file: "o.bsp", bytes: &file }, &[], None).unwrap();
    let zero_s = 0.5e-9 * (orbit.span_ns()[0] + orbit.span_ns()[1]) as f64;
    for step in -49..50 {
        let u = f64::from(step) / 50.0;
        let t_ns = ((zero_s + 3000.0 * u) * 1e9) as i64;
        let state = orbit.at_ns(t_ns).unwrap();
        let (angle, sin) = (u.acos(), (1.0 - u * u).sqrt());
        let off_km = state.position_km.x - 7000.0 - (27.0 * angle).cos();
        let off_km_s = state.velocity_km_s.x - 27.0 * (27.0 * angle).sin() / sin / 3000.0;
        assert!(off_km.abs() < 1e-6 && off_km_s.abs() < 1e-6, "{u}: {off_km} km, {off_km_s} km/s");
    }
    assert_eq!(orbit.interpolation_error(), Some([0.0; 2]));
}

#[test]
fn windows_that_are_too_wide_are_refused_with_their_rows() {
    let with = |kind: i32, number: f64| {
        let mut words: Vec<f64> =
            (0..40).flat_map(|i| [7000.0 + 70.0 * f64::from(i), 1.0, 2.0, 7.0, 0.0, 0.0]).collect();
        words.extend((0..40).map(|i| 1000.0 + 10.0 * f64::from(i)));
        words.extend([number, 40.0]);
        let file = daf("DAF/SPK", &[([1000.0, 1390.0], [-7, 399, 1, kind], words)], true);
        orbit(KernelFile { file: "o.bsp", bytes: &file }, &[], None).map_err(|error| error.to_string())
    };
    assert_eq!(
        with(13, 9.0).unwrap().segments()[0].method().to_string(),
        "Hermite of degree 19 (positions and velocities)"
    );
    assert!(with(13, 14.0).unwrap_err().contains("windows of 15 rows; wanted at most 14 (degree 27)"));
    assert!(with(9, 27.0).is_ok());
    assert!(with(9, 28.0).unwrap_err().contains("degree 28; wanted at most 27"));
}

#[test]
fn any_of_many_numbers_is_found_and_a_message_names_some() {
    let kernel = KernelFile { file: "many.bsp", bytes: &[] };
    let numbers: Vec<i32> = (0..30).collect();
    assert_eq!(chosen(&numbers, Some(27), "target", &kernel.source()).unwrap(), 27);
    let refused = chosen(&numbers, Some(99), "target", &kernel.source()).unwrap_err().to_string();
    assert!(refused.contains("target 99 is not in it") && refused.contains("19] and others"), "{refused}");
}
