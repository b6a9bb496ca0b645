//! Tests of slots under commands: each rule with a case in which it does not act.

use super::*;
use frames::camera_control::{
    CommandSource, ExposureMode, Region, Regions, TriggerOverlap, TriggerSource, TriggerSources,
};

const MS: i64 = 1_000_000;

fn at_ms(ms: f64) -> Tai {
    Tai::from_ns((ms * 1e6).round() as i64)
}

fn ms(ms: f64) -> Span {
    Span::from_ns((ms * 1e6).round() as i64)
}

/// Returns parameters of 10 Hz with 20 ms of exposure and 30 ms of readout, from 1,000 ms on, for a second.
fn params() -> ShutterParams {
    let settings = CameraSettings { exposure: ms(20.0), gain_db: 0.0, black_level_dn: 64.0, regions: Regions::WHOLE };
    ShutterParams {
        first_exposure: at_ms(1000.0),
        period: ms(100.0),
        readout: ms(30.0),
        size_px: [64, 48],
        ahead: Span::ZERO,
        end: at_ms(2000.0),
        settings,
    }
}

fn range() -> CameraRange {
    CameraRange {
        exposure: [ms(0.01), ms(1000.0)],
        gain_db: [0.0, 48.0],
        black_level_dn: [0.0, 500.0],
        frame_rate_max_hz: 1.0 / 0.03,
        delay_max: ms(1000.0),
        size_px: [64, 48],
    }
}

fn shutter() -> Shutter {
    Shutter::new(params(), Some(range()))
}

fn command(shutter: &mut Shutter, at: f64, command: CameraCommand) {
    shutter.take(&Commanded { command, at: at_ms(at), from: CommandSource::Control }).unwrap();
}

fn trigger(shutter: &mut Shutter, at: f64) {
    command(shutter, at, CameraCommand::Trigger { source: TriggerSource::Bus, is_rising: true });
}

/// Returns the start and length of the next exposure, ms, and advances past it.
fn next(shutter: &mut Shutter) -> Option<(f64, f64)> {
    let slot = shutter.next().slot()?;
    shutter.advance();
    let as_ms = |ns: i64| ns as f64 / MS as f64;
    Some((as_ms(slot.exposure_start.ns()), as_ms((slot.exposure_end - slot.exposure_start).ns())))
}

fn rest(shutter: &mut Shutter) -> Vec<f64> {
    core::iter::from_fn(|| next(shutter)).map(|(start, _)| start).collect()
}

#[test]
fn without_commands_slots_are_those_of_the_frame_rate() {
    let mut shutter = shutter();
    for number in 0..10 {
        let slot = shutter.next().slot().unwrap();
        assert_eq!(slot, shutter.nominal(number));
        assert_eq!(slot.due, slot.exposure_end + ms(30.0));
        shutter.advance();
    }
    assert_eq!(shutter.next(), NextSlot::Over);
}

#[test]
fn frames_begun_ahead_and_exposures_without_a_gap_move_no_slot() {
    let whole = CameraSettings { exposure: ms(100.0) + Span::from_ns(1), ..params().settings };
    let too_long = CameraSettings { exposure: ms(100.0) + Span::from_ns(2000), ..whole };
    let starts = |settings, ahead| {
        let params = ShutterParams { ahead, settings, readout: Span::ZERO, ..params() };
        rest(&mut Shutter::new(params, None))
    };
    let nominal: Vec<f64> = (0..10).map(|number| 1000.0 + 100.0 * f64::from(number)).collect();
    assert_eq!(starts(whole, Span::ZERO), nominal);
    assert_eq!(starts(whole, ms(150.0)), nominal);
    assert_ne!(starts(too_long, Span::ZERO), nominal, "longer than the period by more than rounding");
}

#[test]
fn a_setting_acts_from_the_first_exposure_that_starts_at_or_after_it() {
    let mut shutter = shutter();
    command(&mut shutter, 1100.0, CameraCommand::Exposure(ms(50.0)));
    assert_eq!(next(&mut shutter), Some((1000.0, 20.0)));
    assert_eq!(next(&mut shutter), Some((1100.0, 50.0)), "at its own instant");
    command(&mut shutter, 1200.001, CameraCommand::GainDb(6.0));
    assert_eq!(shutter.settings().gain_db, 0.0, "the third has started by then");
    assert_eq!(next(&mut shutter), Some((1200.0, 50.0)));
    assert_eq!(shutter.settings().gain_db, 6.0);
}

#[test]
fn settings_come_together_and_in_the_order_of_their_instants() {
    let mut shutter = shutter();
    command(&mut shutter, 1010.0, CameraCommand::GainDb(12.0));
    command(&mut shutter, 1005.0, CameraCommand::GainDb(6.0));
    let regions = Regions::of(&[Region { left_px: 1, top_px: 2, width_px: 3, height_px: 4 }]).unwrap();
    command(&mut shutter, 1010.0, CameraCommand::Regions(regions));
    next(&mut shutter);
    assert_eq!((shutter.settings().gain_db, shutter.settings().regions), (12.0, regions));
}

#[test]
fn exposures_longer_than_the_period_follow_each_other() {
    let mut shutter = shutter();
    command(&mut shutter, 1000.0, CameraCommand::Exposure(ms(250.0)));
    assert_eq!(rest(&mut shutter), [1000.0, 1250.0, 1500.0, 1750.0]);
}

#[test]
fn a_readout_is_not_met_by_the_next_one() {
    let mut shutter = shutter();
    command(&mut shutter, 1000.0, CameraCommand::Exposure(ms(95.0)));
    command(&mut shutter, 1001.0, CameraCommand::Exposure(ms(1.0)));
    assert_eq!(next(&mut shutter), Some((1000.0, 95.0)));
    // The first is read out until 1,125 ms: 1 ms of exposure begins at 1,124.
    assert_eq!(next(&mut shutter), Some((1124.0, 1.0)));
}

#[test]
fn the_frame_rate_can_change_and_be_left_to_exposure_and_readout() {
    let mut shutter = shutter();
    command(&mut shutter, 1000.0, CameraCommand::Period(Some(ms(200.0))));
    next(&mut shutter);
    assert_eq!(next(&mut shutter), Some((1200.0, 20.0)));
    command(&mut shutter, 1210.0, CameraCommand::Period(None));
    // Readouts of 30 ms touch: exposure to exposure is 30 ms.
    assert_eq!(next(&mut shutter), Some((1230.0, 20.0)));
    assert_eq!(next(&mut shutter), Some((1260.0, 20.0)));
}

fn triggered(overlap: TriggerOverlap) -> Shutter {
    let mut shutter = shutter();
    command(&mut shutter, 0.0, CameraCommand::Triggered(true));
    command(&mut shutter, 0.0, CameraCommand::Overlap(overlap));
    assert_eq!(shutter.next(), NextSlot::Waiting(at_ms(2000.0)));
    shutter
}

#[test]
fn a_trigger_starts_an_exposure_after_the_delay() {
    let mut shutter = triggered(TriggerOverlap::ReadOut);
    command(&mut shutter, 0.0, CameraCommand::Delay(ms(3.0)));
    trigger(&mut shutter, 1234.5);
    let slot = shutter.next().slot().unwrap();
    assert_eq!((slot.exposure_start, slot.trigger_delay()), (at_ms(1237.5), ms(3.0)));
    assert_eq!(slot.started, Started::Trigger { source: TriggerSource::Bus, at: at_ms(1234.5) });
    shutter.advance();
    assert_eq!(shutter.take_seen().accepted, 1);
    assert_eq!(shutter.next(), NextSlot::Waiting(at_ms(2000.0)));
    assert!(!shutter.next().is_over(at_ms(1999.0)) && shutter.next().is_over(at_ms(2000.0)));
}

#[test]
fn triggers_that_come_too_early_are_missed_by_overlap() {
    // The first exposure is 1,100 to 1,120 ms, its readout lasts until 1,150.
    let cases = [
        (TriggerOverlap::Off, 1149.0, None),
        (TriggerOverlap::Off, 1150.0, Some(1150.0)),
        (TriggerOverlap::ReadOut, 1119.0, None),
        (TriggerOverlap::ReadOut, 1140.0, Some(1140.0)),
        // Its readout cannot start before the previous one ends.
        (TriggerOverlap::ReadOut, 1121.0, Some(1130.0)),
        (TriggerOverlap::PreviousFrame, 1110.0, Some(1130.0)),
        (TriggerOverlap::PreviousFrame, 1145.0, Some(1145.0)),
    ];
    for (overlap, second, starts) in cases {
        let mut shutter = triggered(overlap);
        trigger(&mut shutter, 1100.0);
        trigger(&mut shutter, second);
        assert_eq!(next(&mut shutter), Some((1100.0, 20.0)));
        assert_eq!(next(&mut shutter).map(|(start, _)| start), starts, "{overlap:?} at {second}");
        let seen = shutter.take_seen();
        assert_eq!((seen.accepted, seen.missed), (1 + u32::from(starts.is_some()), u32::from(starts.is_none())));
    }
}

#[test]
fn other_sources_and_free_running_ignore_triggers() {
    let mut shutter = triggered(TriggerOverlap::ReadOut);
    command(&mut shutter, 0.0, CameraCommand::Sources(TriggerSources::only(TriggerSource::Action)));
    trigger(&mut shutter, 1100.0);
    assert_eq!((next(&mut shutter), shutter.take_seen().ignored), (None, 1));
    command(&mut shutter, 1300.0, CameraCommand::Triggered(false));
    assert_eq!(next(&mut shutter), Some((1300.0, 20.0)), "free running from the command on");
    assert_eq!(next(&mut shutter), Some((1400.0, 20.0)));
}

#[test]
fn a_burst_has_its_frames_at_the_frame_rate() {
    let mut shutter = triggered(TriggerOverlap::ReadOut);
    command(&mut shutter, 0.0, CameraCommand::Burst(3));
    trigger(&mut shutter, 1050.0);
    trigger(&mut shutter, 1200.0);
    assert_eq!(rest(&mut shutter), [1050.0, 1150.0, 1250.0]);
    assert_eq!(shutter.take_seen().missed, 1, "a trigger within a burst");
}

#[test]
fn the_width_of_a_trigger_is_the_exposure() {
    let mut shutter = triggered(TriggerOverlap::ReadOut);
    command(&mut shutter, 0.0, CameraCommand::Mode(ExposureMode::TriggerWidth));
    trigger(&mut shutter, 1100.0);
    assert_eq!(shutter.next().slot().map(|slot| slot.exposure_end), None, "it would last beyond the run");
    let falling = CameraCommand::Trigger { source: TriggerSource::Bus, is_rising: false };
    command(&mut shutter, 1145.25, falling);
    assert_eq!(next(&mut shutter), Some((1100.0, 45.25)));
    assert_eq!(next(&mut shutter), None);
}

#[test]
fn impossible_command_is_refused() {
    let mut shutter = shutter();
    let take = |shutter: &mut Shutter, command| {
        shutter.take(&Commanded { command, at: at_ms(0.0), from: CommandSource::Control })
    };
    assert_eq!(take(&mut shutter, CameraCommand::GainDb(49.0)), Err(SettingRefusal::OutOfRange));
    for _ in 0..PLACES {
        let later = Commanded { command: CameraCommand::Burst(1), at: at_ms(9000.0), from: CommandSource::Control };
        shutter.take(&later).unwrap();
    }
    assert_eq!(take(&mut shutter, CameraCommand::Burst(1)), Err(SettingRefusal::TooMany));
    let mut display = Shutter::new(params(), None);
    assert_eq!(take(&mut display, CameraCommand::Burst(1)), Err(SettingRefusal::Unsupported));
}

#[test]
fn regions_are_read_out_as_fast_as_their_rows() {
    let region = |top_px| Region { left_px: 5, top_px, width_px: 8, height_px: 6 };
    let regions = Regions::of(&[region(0), region(4), region(40)]).unwrap();
    let mut shutter = shutter();
    let faster = CameraCommand::Period(Some(ms(20.0)));
    let take = |shutter: &mut Shutter, command| {
        shutter.take(&Commanded { command, at: at_ms(0.0), from: CommandSource::Control })
    };
    assert_eq!(take(&mut shutter, faster), Err(SettingRefusal::OutOfRange), "all rows take 30 ms");
    command(&mut shutter, 1000.0, CameraCommand::Exposure(ms(5.0)));
    command(&mut shutter, 1000.0, CameraCommand::Period(None));
    command(&mut shutter, 1000.0, CameraCommand::Regions(regions));
    for number in 0..3 {
        let slot = shutter.next().slot().unwrap();
        // 16 of 48 rows in 10 ms.
        assert_eq!(slot.due, slot.exposure_end + ms(10.0));
        assert_eq!(next(&mut shutter), Some((1000.0 + 10.0 * f64::from(number), 5.0)));
    }
    assert_eq!(take(&mut shutter, faster), Ok(()));
    // The whole image again: its readout has its full length again.
    command(&mut shutter, 1025.0, CameraCommand::Regions(Regions::WHOLE));
    assert_eq!(rest(&mut shutter)[..4], [1040.0, 1070.0, 1100.0, 1130.0]);
}

#[test]
fn a_setting_without_an_exposure_in_the_run_waits_for_the_next_command() {
    let mut shutter = shutter();
    assert_eq!(next(&mut shutter), Some((1000.0, 20.0)));
    command(&mut shutter, 1050.0, CameraCommand::Period(Some(ms(100_000.0))));
    assert_eq!(shutter.next(), NextSlot::Waiting(at_ms(2000.0)), "the end of the run, not this instant");
    assert!(!shutter.next().is_over(at_ms(1999.0)) && shutter.next().is_over(at_ms(2000.0)));
    for number in 0..3 * PLACES as u32 {
        command(&mut shutter, 1060.0, CameraCommand::Burst(1 + number));
    }
    command(&mut shutter, 1500.0, CameraCommand::Period(Some(ms(100.0))));
    assert_eq!(rest(&mut shutter), [1500.0, 1600.0, 1700.0, 1800.0, 1900.0], "on from the command");
    let mut alone = Shutter::new(ShutterParams { end: at_ms(1050.0), ..params() }, Some(range()));
    assert_eq!((next(&mut alone), alone.next()), (Some((1000.0, 20.0)), NextSlot::Over), "control: no client");
}

#[test]
fn a_command_starts_no_exposure_before_its_own_instant() {
    let mut shutter = shutter();
    command(&mut shutter, 0.0, CameraCommand::Period(Some(ms(900.0))));
    assert_eq!(next(&mut shutter), Some((1000.0, 20.0)));
    command(&mut shutter, 1650.0, CameraCommand::Period(Some(ms(100.0))));
    assert_eq!(rest(&mut shutter), [1650.0, 1750.0, 1850.0, 1950.0]);
    // The readout of 1,000 ms lasts until 1,050: a longer exposure could have started at once.
    let mut shutter = self::shutter();
    command(&mut shutter, 0.0, CameraCommand::Period(None));
    command(&mut shutter, 0.0, CameraCommand::Exposure(ms(1.0)));
    assert_eq!(next(&mut shutter), Some((1000.0, 1.0)));
    command(&mut shutter, 1025.0, CameraCommand::Exposure(ms(25.0)));
    assert_eq!(next(&mut shutter), Some((1025.0, 25.0)));
}

#[test]
fn the_first_trigger_after_a_free_run_is_taken_during_its_last_exposure() {
    for overlap in [TriggerOverlap::Off, TriggerOverlap::ReadOut] {
        let mut shutter = shutter();
        command(&mut shutter, 0.0, CameraCommand::Overlap(overlap));
        command(&mut shutter, 1005.0, CameraCommand::Triggered(true));
        trigger(&mut shutter, 1006.0);
        trigger(&mut shutter, 1007.0);
        assert!(!shutter.awaits_trigger(at_ms(1008.0)));
        assert_eq!(next(&mut shutter), Some((1000.0, 20.0)), "the free run's last");
        // Its readout lasts until 1,050 ms.
        assert!(!shutter.awaits_trigger(at_ms(1029.0)), "one waits");
        assert_eq!(next(&mut shutter), Some((1030.0, 20.0)));
        let read_ms = if overlap == TriggerOverlap::Off { 1080.0 } else { 1050.0 };
        assert_eq!([read_ms - 0.1, read_ms].map(|ms| shutter.awaits_trigger(at_ms(ms))), [false, true], "{overlap:?}");
        trigger(&mut shutter, 1045.0);
        assert_eq!(next(&mut shutter), None, "control: too early after a triggered exposure");
        command(&mut shutter, 1100.0, CameraCommand::Triggered(false));
        assert!(!shutter.awaits_trigger(at_ms(1100.0)), "control: free running");
        command(&mut shutter, 1100.0, CameraCommand::Triggered(true));
        assert_eq!(shutter.next(), NextSlot::Waiting(at_ms(2000.0)));
        assert_eq!((shutter.seen.accepted, shutter.seen.missed), (1, 2), "{overlap:?}");
    }
}

#[test]
fn a_frame_of_few_rows_is_due_when_it_can_be_drawn_and_read_out_as_fast_as_its_rows() {
    let regions = Regions::of(&[Region { left_px: 0, top_px: 0, width_px: 4, height_px: 4 }]).unwrap();
    let mut shutter = shutter();
    command(&mut shutter, 0.0, CameraCommand::Exposure(ms(1.0)));
    command(&mut shutter, 0.0, CameraCommand::Period(None));
    command(&mut shutter, 0.0, CameraCommand::Regions(regions));
    for number in 0..3 {
        let slot = shutter.next().slot().unwrap();
        assert_eq!(slot.due, slot.exposure_end + ms(10.0));
        // 4 of 48 rows are read out in 2.5 ms.
        assert_eq!(next(&mut shutter), Some((1000.0 + 2.5 * f64::from(number), 1.0)));
    }
    let quick = ShutterParams { readout: ms(3.0), ..params() };
    let slot = Shutter::new(quick, Some(range())).slot(
        0,
        at_ms(1000.0),
        &CameraSettings { regions, ..quick.settings },
        Started::Rate,
    );
    assert_eq!(slot.due, slot.exposure_end + ms(3.0), "no later than the whole image");
}

#[test]
fn own_exposures_are_as_many_as_the_shutter_makes() {
    for (period, exposure, readout, lasts) in [
        (100.0, 20.0, 30.0, 1000.0),
        (100.0, 99.999_5, 0.0, 1000.0),
        (100.0, 100.0, 100.0, 1000.0),
        (16.666_667, 100.0, 5.0, 2000.0),
        (16.666_667, 3.0, 40.0, 2000.0),
        (100.0, 20.0, 30.0, 100.0),
        (100.0, 20.0, 30.0, 950.0),
        (100.0, 20.0, 30.0, 10.0),
        (100.0, 60.0, 50.0, 1050.0),
    ] {
        let settings = CameraSettings { exposure: ms(exposure), ..params().settings };
        let end = at_ms(1000.0 + lasts);
        let params = ShutterParams { period: ms(period), readout: ms(readout), end, settings, ..params() };
        let mut walked = Shutter::new(params, Some(range()));
        let own = walked.own_exposures();
        let count = core::iter::from_fn(|| next(&mut walked)).count() as u64;
        assert_eq!(own, count, "{period} ms, {exposure} ms, {readout} ms for {lasts} ms");
    }
}
