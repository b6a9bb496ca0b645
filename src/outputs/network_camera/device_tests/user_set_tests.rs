//! User sets, test patterns, temperature, reset, and the registers of the PTP clock.

use super::*;
use crate::network_camera::ptp::{FAULTY, PtpData, SLAVE};
use crate::network_camera::test_pattern::TestPattern;

#[test]
fn settings_are_saved_and_loaded_and_the_first_set_stays_the_benchs() {
    let mut bench = bench();
    bench.control();
    let settings = [
        (own::WIDTH, 9),
        (own::OFFSET_X, 20),
        (own::PIXEL_FORMAT, 0x0108_0001),
        (own::TEST_PATTERN, 3),
        (own::CHUNK_MODE, 1),
    ];
    let values = |bench: &mut Bench| settings.map(|(address, _)| bench.read(A, address).unwrap());
    let own_values = values(&mut bench);
    settings.iter().for_each(|(address, value)| assert_eq!(bench.write(A, *address, *value), OK));
    let (wanted, payload) = (values(&mut bench), bench.read(A, own::PAYLOAD_SIZE));
    assert_eq!(bench.write(A, own::USER_SET_SAVE, 1), 0x8004, "the bench's set");
    assert_eq!(bench.write(A, own::USER_SET_SELECTOR, 2), OK);
    assert_eq!(bench.write(A, own::USER_SET_SAVE, 1), OK);
    assert_eq!(bench.write(A, own::USER_SET_SELECTOR, 0), OK);
    assert_eq!(bench.write(A, own::USER_SET_LOAD, 1), OK);
    assert_eq!(values(&mut bench), own_values);
    assert_ne!(own_values, wanted, "control");
    assert_eq!(bench.write(A, own::USER_SET_SELECTOR, 3), OK);
    assert_eq!((bench.write(A, own::USER_SET_LOAD, 1), values(&mut bench)), (OK, own_values), "never saved");
    assert_eq!(bench.write(A, own::USER_SET_SELECTOR, 2), OK);
    assert_eq!((bench.write(A, own::USER_SET_LOAD, 1), values(&mut bench)), (OK, wanted));
    assert_eq!(bench.read(A, own::PAYLOAD_SIZE), payload);
    assert_eq!(bench.write(A, own::USER_SET_SELECTOR, 4), 0x8002);
    assert_eq!(bench.write(A, own::ACQUISITION_START, 1), OK);
    assert_eq!(bench.write(A, own::USER_SET_LOAD, 1), 0x8007, "not while frames are acquired");
}

#[test]
fn reset_loads_the_default_set_and_ends_control() {
    let mut bench = bench();
    bench.stream();
    for (address, value) in [(own::TEST_PATTERN, 2), (own::USER_SET_SELECTOR, 1), (own::USER_SET_SAVE, 1)] {
        assert_eq!(bench.write(A, address, value), OK);
    }
    for (default, pattern) in [(1, 2), (0, 0)] {
        bench.stream();
        assert_eq!(bench.write(A, own::TEST_PATTERN, 5), OK);
        assert_eq!(bench.write(A, own::USER_SET_DEFAULT, default), OK);
        assert_eq!(bench.write(A, own::DEVICE_RESET, 1), OK);
        assert_eq!((bench.read(B, at::CONTROL), bench.read(B, own::TEST_PATTERN)), (Ok(0), Ok(pattern)));
        assert_eq!(bench.device.stream().destination, None);
    }
    assert_eq!(bench.write(B, at::CONTROL, 2), OK, "control is free");
}

#[test]
fn pattern_changes_while_frames_are_acquired() {
    let mut bench = bench();
    bench.stream();
    for (number, (_, pattern)) in (0..).zip(TestPattern::NAMED) {
        assert_eq!(bench.write(A, own::TEST_PATTERN, number), OK);
        assert_eq!(bench.device.stream().pattern, pattern);
        assert_eq!(bench.device.camera.shared.settings().pattern, pattern, "published to the stream");
    }
    assert_eq!(bench.write(A, own::TEST_PATTERN, 8), 0x8002);
}

#[test]
fn temperature_is_that_of_the_newest_frame() {
    let mut bench = bench();
    let temperature = |bench: &mut Bench| f64::from_be_bytes(bench.memory(own::TEMPERATURE, 8).try_into().unwrap());
    assert!((temperature(&mut bench) - 20.0).abs() < f64::EPSILON, "of the configuration");
    bench.device.camera.shared.set_temperature_c(-12.5);
    assert!((temperature(&mut bench) + 12.5).abs() < f64::EPSILON);
    bench.control();
    assert_eq!(bench.write(A, own::TEMPERATURE, 0), 0x8004);
}

#[test]
fn clock_is_asked_while_it_is_enabled_and_its_numbers_are_latched() {
    let mut bench = bench();
    bench.control();
    assert_eq!((bench.read(A, own::PTP_STATUS), bench.device.camera.wants_ptp()), (Ok(3), false), "disabled");
    assert_eq!(bench.write(A, own::PTP_ENABLE, 1), OK);
    assert_eq!(
        (bench.read(A, own::PTP_STATUS), bench.device.camera.wants_ptp()),
        (Ok(1), true),
        "nothing is known yet"
    );
    assert_eq!(bench.read(A, at::GVCP_CONFIGURATION), Ok(0x8_0000));
    let data = PtpData { offset_ns: -7, delay_ns: 900, clock_id: 0x0102_0304_0506_0708, ..PtpData::in_state(SLAVE) };
    bench.device.camera.note_ptp(data);
    let long = |bench: &mut Bench, address| i64::from_be_bytes(bench.memory(address, 8).try_into().unwrap());
    assert_eq!(
        (bench.read(A, own::PTP_STATUS), bench.read(A, own::PTP_SERVO), bench.read(A, at::PTP_STATUS)),
        (Ok(9), Ok(1), Ok(9))
    );
    assert_eq!(long(&mut bench, own::PTP_OFFSET), 0, "before the latch");
    assert_eq!(bench.write(A, own::PTP_LATCH, 1), OK);
    bench.device.camera.note_ptp(PtpData::in_state(FAULTY));
    assert_eq!([own::PTP_OFFSET, own::PTP_DELAY].map(|address| long(&mut bench, address)), [-7, 900]);
    assert_eq!(long(&mut bench, own::PTP_CLOCK_ID), 0x0102_0304_0506_0708);
    assert_eq!((bench.read(A, own::PTP_STATUS), bench.read(A, own::PTP_SERVO)), (Ok(2), Ok(0)), "of now");
    assert_eq!(bench.write(A, at::GVCP_CONFIGURATION, 0), OK);
    assert_eq!(
        (bench.read(A, own::PTP_ENABLE), bench.device.camera.wants_ptp()),
        (Ok(0), false),
        "by the other register"
    );
    assert_eq!(bench.write(A, own::PTP_ENABLE, 2), 0x8002);
}
