//! Several regions: packets, refusals, and the readout of a commanded camera.

use super::commanded_tests::{commanded, taken};
use super::*;
use base::time::Span;
use frames::camera_control::{CameraCommand, Region, Regions};

const SMALL: Region = Region { left_px: 4, top_px: 2, width_px: 6, height_px: 3 };

/// Places the selected region.
fn place(bench: &mut Bench, region: Region) {
    let Region { left_px, top_px, width_px, height_px } = region;
    for (address, value) in
        [(own::WIDTH, width_px), (own::HEIGHT, height_px), (own::OFFSET_X, left_px), (own::OFFSET_Y, top_px)]
    {
        assert_eq!(bench.write(A, address, value), OK, "{address:x}");
    }
}

#[test]
fn regions_have_sizes_of_their_own_and_the_payload_is_that_of_all() {
    let mut bench = bench();
    bench.control();
    place(&mut bench, SMALL);
    assert_eq!(bench.write(A, own::REGION_MODE, 0), 0x8002, "the first is always on");
    assert_eq!(bench.write(A, own::REGION_SELECTOR, 31), OK);
    assert_eq!((bench.read(A, own::REGION_MODE), bench.read(A, own::WIDTH)), (Ok(0), Ok(31)));
    let other = Region { left_px: 20, height_px: 5, width_px: 8, ..SMALL };
    place(&mut bench, other);
    assert_eq!(bench.read(A, own::PAYLOAD_SIZE), Ok(6 * 3 * 2), "it is off");
    assert_eq!(bench.write(A, own::REGION_MODE, 1), OK);
    assert_eq!(bench.read(A, own::PAYLOAD_SIZE), Ok(8 * 8 * 2), "as wide as the widest");
    assert_eq!(bench.device.stream().regions.as_slice(), [SMALL, other]);
    assert_eq!(bench.write(A, own::REGION_SELECTOR, 0), OK);
    assert_eq!((bench.read(A, own::REGION_MODE), bench.read(A, own::WIDTH)), (Ok(1), Ok(6)));
    assert_eq!(bench.write(A, own::REGION_SELECTOR, 32), 0x8002);
    bench.stream();
    assert_eq!(bench.write(A, own::REGION_SELECTOR, 31), OK, "looking is free");
    assert_eq!(bench.write(A, own::REGION_MODE, 0), 0x8007, "not while frames are acquired");
    assert_eq!(bench.write(A, own::WIDTH, 3), 0x8007);
}

#[test]
fn more_pixels_than_the_sensor_has_are_refused_at_the_start() {
    let mut bench = bench();
    bench.control();
    assert_eq!(bench.write(A, own::REGION_SELECTOR, 1), OK);
    assert_eq!(bench.write(A, own::REGION_MODE, 1), OK);
    assert_eq!(bench.write(A, own::ACQUISITION_START, 1), 0x8002, "the whole image twice");
    assert_eq!(bench.device.wanted().take(), None);
    assert_eq!(bench.write(A, own::REGION_MODE, 0), OK);
    assert_eq!(bench.write(A, own::ACQUISITION_START, 1), OK);
}

#[test]
fn a_commanded_camera_reads_out_changed_regions() {
    let (mut bench, end) = commanded();
    bench.stream();
    assert_eq!(taken(&end), [], "the whole image, as it was");
    for region in [SMALL, Region { left_px: 0, top_px: 0, width_px: 31, height_px: 17 }] {
        assert_eq!(bench.write(A, own::ACQUISITION_STOP, 1), OK);
        if region != SMALL {
            assert_eq!((bench.write(A, own::OFFSET_X, 0), bench.write(A, own::OFFSET_Y, 0)), (OK, OK));
        }
        place(&mut bench, region);
        assert_eq!(taken(&end), [], "nothing before the start");
        for _ in 0..2 {
            bench.stream();
        }
        let wanted = if region == SMALL { Regions::of(&[SMALL]).unwrap() } else { Regions::WHOLE };
        assert_eq!(taken(&end), [CameraCommand::Regions(wanted)], "once");
    }
}

#[test]
fn fewer_rows_make_higher_rates_possible_and_more_rows_lower_the_rate() {
    const SHORT: Region = Region { left_px: 0, top_px: 0, width_px: 31, height_px: 5 };
    let (mut bench, end) = commanded();
    assert_eq!((bench.number(own::FRAME_RATE_MOST), bench.write_number(own::FRAME_RATE, 200.0)), (100.0, 0x8002));
    place(&mut bench, SHORT);
    assert_eq!(bench.number(own::FRAME_RATE_MOST), 340.0, "5 of 17 rows");
    assert_eq!(bench.write_number(own::FRAME_RATE, 341.0), 0x8002);
    assert_eq!(bench.write_number(own::FRAME_RATE, 250.0), OK);
    assert_eq!(taken(&end), [], "the camera still reads out the whole image");
    bench.stream();
    let regions = Regions::of(&[SHORT]).unwrap();
    assert_eq!(taken(&end), [CameraCommand::Regions(regions), CameraCommand::Period(Some(Span::from_ms(4)))]);
    assert_eq!(bench.write_number(own::FRAME_RATE, 200.0), OK);
    assert_eq!(taken(&end), [CameraCommand::Period(Some(Span::from_ms(5)))], "at once, for the same regions");
    assert_eq!(bench.write(A, own::ACQUISITION_STOP, 1), OK);
    assert_eq!(bench.write(A, own::HEIGHT, 17), OK);
    assert_eq!([own::FRAME_RATE_MOST, own::FRAME_RATE].map(|rate| bench.number(rate)), [100.0, 100.0], "clipped");
    bench.stream();
    assert_eq!(taken(&end), [CameraCommand::Regions(Regions::WHOLE), CameraCommand::Period(Some(Span::from_ms(10)))]);
}

#[test]
fn rate_of_a_user_set_is_that_of_its_regions() {
    let (mut bench, end) = commanded();
    place(&mut bench, SMALL);
    assert_eq!(bench.write_number(own::FRAME_RATE, 500.0), OK);
    assert_eq!((bench.write(A, own::USER_SET_SELECTOR, 1), bench.write(A, own::USER_SET_SAVE, 1)), (OK, OK));
    for (number, rate_hz, rows) in [(0, 5.0, 17), (1, 500.0, 3)] {
        assert_eq!((bench.write(A, own::USER_SET_SELECTOR, number), bench.write(A, own::USER_SET_LOAD, 1)), (OK, OK));
        assert_eq!((bench.number(own::FRAME_RATE), bench.read(A, own::HEIGHT)), (rate_hz, Ok(rows)));
    }
    taken(&end);
    bench.stream();
    let regions = Regions::of(&[SMALL]).unwrap();
    assert_eq!(taken(&end), [CameraCommand::Regions(regions), CameraCommand::Period(Some(Span::from_ms(2)))]);
}
