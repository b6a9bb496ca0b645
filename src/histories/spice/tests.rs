//! Kernels made byte by byte: what is read, and what is refused. `hil_scripts/test_spice.py` has those of CSPICE.

use super::*;
use base::axes::Rotation;
use base::time::Tai;
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
    for (integers, part) in [([-7, 3, 1, 13], "centre 3"), ([-7, 399, 17, 13], "frame 17"), ([-7, 399, 1, 5], "type 5")]
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
        (with(|s| s.1[1] = 17), "frame 17"),
        (with(|s| s.1[2] = 1), "type 1"),
        (with(|s| s.2[0] = 2.0), "unit one"),
        (with(|s| *s.2.last_mut().unwrap() = 5.0), "counts of a segment"),
        (with(|s| *s.2.last_mut().unwrap() = f64::NAN), "counts of a segment"),
        (with(|s| s.2[16] = -5.0), "rows before the first interval"),
        (with(|s| [16, 20].into_iter().for_each(|place| s.2[place] = -5.0)), "before its clock begins"),
    ] {
        let error = read(&file, &[SCLK]).expect_err(part);
        assert!(error.starts_with("a.bc: ") && error.contains(part), "{part}: {error}");
    }
    for s_per_tick in [1e279, f64::INFINITY, 0.021, 0.004] {
        let mut segment = type_2();
        segment.2[7] = s_per_tick;
        let error = read(&daf("DAF/CK", &[segment], true), &[SCLK]).expect_err("another clock");
        assert!(error.contains("by its own rate of the clock, and 2 s"), "{s_per_tick}: {error}");
    }
    for (texts, part) in [
        (vec![], "SCLK_DATA_TYPE_7"),
        (vec!["hello"], "not a text kernel"),
        (vec!["KPL/SCLK\n\\begindata\n5 6\n"], "a.t:3"),
        (vec!["KPL/SCLK\n\\begindata\nSCLK_DATA_TYPE_7 = 2\n"], "is not 1"),
    ] {
        let error = read(&good, &texts).expect_err(part);
        assert!(error.contains(part), "{part}: {error}");
    }
    let two = daf("DAF/CK", &[type_3(), ([0.0, 1.0], [-8, 1, 3, 0], type_3().2)], true);
    let error = read(&two, &[SCLK]).expect_err("two instruments");
    assert!(error.contains("[-8, -7]"), "{error}");
}
