//! A camera that clients command: commands to the frame loop, and refusals.

use super::{super::registers::SOURCES, *};
use base::{bayer::BayerPattern, clock::Virtual};
use frames::camera_control::{
    AutoMode, CameraCommand, CameraEvent, CameraEventKind, CameraRange, CameraSettings, CommandSource, Commanded,
    DeskEnd, ExposureMode, Regions, StartSettings, TriggerOverlap, TriggerSource, TriggerSources, desk,
};
use frames::sink::crc32::Crc32;
use std::sync::Arc;

/// The time of the bench, which is not that of the machine.
pub(super) const BENCH: Tai = Tai::from_ns(5_000_000_000);

pub(super) fn commanded() -> (Bench, DeskEnd) {
    let (mut bench, end) = without_control();
    bench.control();
    (bench, end)
}

/// Returns the same camera before any client has control.
pub(super) fn without_control() -> (Bench, DeskEnd) {
    made(StartSettings::free_running(Span::from_ms(200)), false)
}

fn commanded_by(start: StartSettings, has_line: bool) -> (Bench, DeskEnd) {
    let (mut bench, end) = made(start, has_line);
    bench.control();
    (bench, end)
}

fn made(start: StartSettings, has_line: bool) -> (Bench, DeskEnd) {
    let (commands, end) = params(start, has_line);
    (Bench::with(&Params::default(), Some(commands)), end)
}

fn params(start: StartSettings, has_line: bool) -> (CommandParams, DeskEnd) {
    let (desk, end) = desk();
    let range = CameraRange {
        exposure: [Span::from_ns(20_000), Span::from_ms(500)],
        gain_db: [0.0, 24.0],
        black_level_dn: [0.0, 511.0],
        frame_rate_max_hz: 100.0,
        delay_max: Span::from_ms(1000),
        size_px: [31, 17],
    };
    let settings =
        CameraSettings { exposure: Span::from_ms(100), gain_db: 0.0, black_level_dn: 64.0, regions: Regions::WHOLE };
    let clock = Arc::new(Virtual::new(BENCH));
    (CommandParams { desk, range, settings, start, has_line, clock }, end)
}

impl Bench {
    pub(super) fn write_number(&mut self, address: u32, number: f64) -> u16 {
        let payload = [&address.to_be_bytes()[..], &number.to_be_bytes()].concat();
        self.ask(A, 0x86, &payload).unwrap().0
    }

    pub(super) fn number(&mut self, address: u32) -> f64 {
        f64::from_be_bytes(self.memory(address, 8).try_into().unwrap())
    }
}

#[test]
fn xml_that_clients_read_is_byte_for_byte_the_frozen_one() {
    let coloured = |commands| {
        let sensor = SensorParams { colours: Some(BayerPattern::Rggb), ..sensor() };
        Bench::of(&Params::default(), &sensor, commands)
    };
    let start = StartSettings::free_running(Span::from_ms(200));
    let commands = || params(start, true).0;
    let (mut found, mut frozen) = (Vec::new(), Vec::new());
    for (name, mut bench, bytes, crc32) in [
        ("read", bench(), 60_140, 0x9D16_EAE0_u32),
        ("read, colours", coloured(None), 60_172, 0x11DC_0AC4),
        ("commanded", without_control().0, 71_400, 0xFD02_7258),
        ("commanded, line", made(start, true).0, 71_400, 0x5ADC_DF61),
        ("commanded, line, colours", coloured(Some(commands())), 71_432, 0x9817_6456),
    ] {
        let (_, mut text) = bench.xml(at::SECOND_URL);
        let sum = |text: &[u8]| {
            let mut crc = Crc32::default();
            crc.update(text);
            crc.value()
        };
        found.push((name, text.len(), format!("{:08X}", sum(&text))));
        frozen.push((name, bytes, format!("{crc32:08X}")));
        let before = sum(&text);
        text[900] ^= 1;
        assert_ne!(sum(&text), before, "control: one bit");
    }
    assert_eq!(found, frozen, "a client finds other features");
}

pub(super) fn taken(end: &DeskEnd) -> Vec<CameraCommand> {
    let all: Vec<Commanded> = end.commands().collect();
    assert!(all.iter().all(|one| one.from == CommandSource::NetworkCamera && one.at == BENCH), "{all:?}");
    all.into_iter().map(|one| one.command).collect()
}

#[test]
fn the_trigger_source_reads_as_the_line_that_a_camera_is_armed_for() {
    let free = StartSettings::free_running(Span::from_ms(200));
    let armed = StartSettings { is_triggered: true, ..free };
    for (start, has_line, wanted) in [
        (armed, true, TriggerSource::Line),
        (armed, false, TriggerSource::Software),
        (free, true, TriggerSource::Software),
        (StartSettings { sources: TriggerSources::only(TriggerSource::Bus), ..armed }, true, TriggerSource::Bus),
    ] {
        let (mut bench, _end) = commanded_by(start, has_line);
        let register = bench.memory(own::TRIGGER_SOURCE, 4);
        let number = u32::from_be_bytes(register.try_into().unwrap()) as usize;
        assert_eq!(SOURCES[number], wanted, "line: {has_line}, {start:?}");
    }
}

#[test]
fn numbers_become_commands_and_read_back() {
    let (mut bench, end) = commanded();
    assert_eq!((bench.number(own::EXPOSURE_TIME), bench.number(own::FRAME_RATE)), (100_000.0, 5.0));
    for (address, number, command) in [
        (own::EXPOSURE_TIME, 50_000.0, CameraCommand::Exposure(Span::from_ms(50))),
        (own::GAIN, 6.0, CameraCommand::GainDb(6.0)),
        (own::BLACK_LEVEL, 100.0, CameraCommand::BlackLevelDn(100.0)),
        (own::TRIGGER_DELAY, 1_500.0, CameraCommand::Delay(Span::from_ns(1_500_000))),
        (own::FRAME_RATE, 20.0, CameraCommand::Period(Some(Span::from_ms(50)))),
    ] {
        assert_eq!(bench.write_number(address, number), OK, "{command:?}");
        assert_eq!((taken(&end), bench.number(address)), (vec![command], number));
    }
}

#[test]
fn numbers_outside_the_range_are_refused_and_change_nothing() {
    let (mut bench, end) = commanded();
    for (address, number) in [
        (own::EXPOSURE_TIME, 19.9),
        (own::EXPOSURE_TIME, 500_001.0),
        (own::EXPOSURE_TIME, f64::NAN),
        (own::GAIN, -0.1),
        (own::GAIN, 24.1),
        (own::BLACK_LEVEL, f64::INFINITY),
        (own::TRIGGER_DELAY, -1.0),
        (own::FRAME_RATE, 101.0),
        (own::FRAME_RATE, 0.0),
    ] {
        let before = bench.number(address);
        assert_eq!(bench.write_number(address, number), 0x8002, "{address:x} {number}");
        assert!(bench.number(address) == before && taken(&end).is_empty(), "{address:x} {number}");
    }
}

#[test]
fn words_become_commands_and_others_are_refused() {
    let (mut bench, end) = commanded();
    for (address, value, command) in [
        (own::TRIGGER_MODE, 1, Some(CameraCommand::Triggered(true))),
        (own::TRIGGER_MODE, 2, None),
        (own::TRIGGER_SOURCE, 3, Some(CameraCommand::Sources(TriggerSources::only(TriggerSource::Bus)))),
        (own::TRIGGER_SOURCE, 5, None),
        (own::TRIGGER_OVERLAP, 2, Some(CameraCommand::Overlap(TriggerOverlap::PreviousFrame))),
        (own::TRIGGER_OVERLAP, 3, None),
        (own::BURST, 4, Some(CameraCommand::Burst(4))),
        (own::BURST, 0, None),
        (own::FRAME_RATE_ENABLE, 0, Some(CameraCommand::Period(None))),
        (own::FRAME_RATE_ENABLE, 1, Some(CameraCommand::Period(Some(Span::from_ms(200))))),
        (own::EXPOSURE_MODE, 0, Some(CameraCommand::Mode(ExposureMode::Timed))),
        (own::EXPOSURE_MODE, 1, None),
        (own::GAIN_AUTO, 1, Some(CameraCommand::AutoGain(AutoMode::Once))),
        (own::EXPOSURE_AUTO, 2, Some(CameraCommand::AutoExposure(AutoMode::Continuous))),
        (own::EXPOSURE_AUTO, 3, None),
    ] {
        let status = if command.is_some() { OK } else { 0x8002 };
        assert_eq!(bench.write(A, address, value), status, "{address:x} {value}");
        assert_eq!(taken(&end), Vec::from_iter(command), "{address:x} {value}");
    }
    assert_eq!(bench.write_number(own::EXPOSURE_TIME, 1000.0), 0x8004, "the camera chooses it");
}

#[test]
fn triggers_of_the_chosen_source_start_exposures() {
    let (mut bench, end) = commanded();
    bench.write(A, own::TRIGGER_SOURCE, 0);
    bench.write(A, own::TRIGGER_MODE, 1);
    assert_eq!(taken(&end).len(), 2);
    assert_eq!(bench.write(A, own::TRIGGER_SOFTWARE, 1), OK);
    assert_eq!(taken(&end), [], "before the start of the acquisition");
    bench.stream();
    assert!(bench.device.wanted().by().is_some(), "frames are sent as they come");
    assert_eq!(bench.write(A, own::TRIGGER_SOFTWARE, 1), OK);
    assert_eq!(taken(&end), [CameraCommand::Trigger { source: TriggerSource::Software, is_rising: true }]);
    assert_eq!(bench.write(A, own::TRIGGER_SOURCE, 1), OK);
    assert_eq!((taken(&end).len(), bench.write(A, own::TRIGGER_SOFTWARE, 1)), (1, OK));
    assert_eq!(taken(&end), [], "another source");
    assert_eq!(bench.device.counters().triggers, 1);
}

#[test]
fn the_acquisition_status_says_when_a_trigger_would_be_taken() {
    let (mut bench, end) = commanded();
    let states = |bench: &mut Bench| {
        [0, 1].map(|selected| {
            assert_eq!(bench.write(A, own::STATUS_SELECTOR, selected), OK);
            bench.read(A, own::STATUS).unwrap() == 1
        })
    };
    let report =
        |is_awaited| end.report(CameraEvent { kind: CameraEventKind::TriggerAwaited(is_awaited), at: BENCH, frame: 1 });
    bench.write(A, own::TRIGGER_MODE, 1);
    assert!(report(true));
    assert_eq!(states(&mut bench), [false, false], "before the start of the acquisition");
    bench.stream();
    assert_eq!(states(&mut bench), [true, true]);
    assert_eq!(bench.write(A, own::TRIGGER_SOFTWARE, 1), OK);
    assert_eq!(states(&mut bench), [false, true], "one waits for its exposure");
    assert!(report(true));
    assert_eq!(states(&mut bench), [true, true]);
    assert!(report(false));
    assert_eq!(states(&mut bench), [false, true]);
    assert_eq!((bench.write(A, own::STATUS_SELECTOR, 2), bench.write(A, own::STATUS, 1)), (0x8002, 0x8004));
    bench.write(A, own::ACQUISITION_STOP, 1);
    assert!(report(true));
    assert_eq!(states(&mut bench), [false, false]);
}

#[test]
fn a_camera_that_is_only_read_waits_for_as_many_triggers_as_its_acquisition_has_frames() {
    let mut bench = bench();
    bench.control();
    for (address, value) in [(own::ACQUISITION_MODE, 1), (own::TRIGGER_MODE, 1), (own::ACQUISITION_START, 1)] {
        assert_eq!((bench.read(A, own::STATUS), bench.write(A, address, value)), (Ok(0), OK));
    }
    assert_eq!(bench.read(A, own::STATUS), Ok(1));
    assert_eq!((bench.write(A, own::TRIGGER_SOFTWARE, 1), bench.read(A, own::STATUS)), (OK, Ok(0)));
}

#[test]
fn scheduled_actions_act_at_their_instant_and_late_ones_are_refused() {
    let (mut bench, end) = commanded();
    bench.write(A, at::ACTION_GROUP_MASK, 1);
    bench.write(A, own::TRIGGER_SOURCE, 1);
    bench.write(A, own::TRIGGER_MODE, 1);
    bench.stream();
    taken(&end);
    let ask = |bench: &mut Bench, at: Tai| {
        bench.id += 1;
        let (high, low) = (u32::try_from(at.ns() >> 32).unwrap(), u32::try_from(at.ns() & 0xFFFF_FFFF).unwrap());
        let mut bytes = bench.datagram(0x100, &[0, 0, 1, high, low].map(u32::to_be_bytes).concat());
        bytes[1] = 0x81;
        bench.device.answer(B, &bytes, bench.now, &mut bench.answer);
        bench.reported(0x100).unwrap().0
    };
    let later = BENCH + Span::from_ms(700);
    assert_eq!(ask(&mut bench, later), OK);
    let all: Vec<Commanded> = end.commands().collect();
    assert_eq!(all.len(), 1);
    assert_eq!(all[0].at, later);
    assert_eq!(all[0].command, CameraCommand::Trigger { source: TriggerSource::Action, is_rising: true });
    assert_eq!(ask(&mut bench, BENCH + Span::from_ns(-1)), 0x8016);
    assert_eq!(end.commands().count(), 0);
    let statuses: Vec<u16> = (0..300).map(|_| ask(&mut bench, later)).collect();
    assert_eq!((statuses[255], statuses[256]), (OK, 0x8015), "the queue is full");
}

#[test]
fn the_description_of_a_commanded_camera_has_its_limits_and_registers() {
    let (mut bench, _end) = commanded();
    let (_, bytes) = bench.xml(at::SECOND_URL);
    let text = String::from_utf8(bytes).unwrap();
    every_address_is_there(&mut bench, &text);
    assert!(text.contains("<Max>500000</Max>") && text.contains("<Unit>dB</Unit>") && text.contains("Name=\"Bus\""));
}

#[test]
fn settings_of_a_camera_that_is_only_read_stay_write_protected() {
    let mut bench = bench();
    bench.control();
    assert_eq!(bench.write_number(own::EXPOSURE_TIME, 50_000.0), 0x8004);
    assert_eq!(bench.write(A, own::EXPOSURE_AUTO, 1), 0x8004);
}

#[test]
fn automatic_settings_are_read_back() {
    let (mut bench, end) = commanded();
    assert_eq!(bench.write(A, own::EXPOSURE_AUTO, 1), 0);
    assert_eq!(bench.write(A, own::GAIN_AUTO, 2), 0);
    let report = |kind| assert!(end.report(CameraEvent { kind, at: BENCH, frame: 1 }));
    report(CameraEventKind::ExposureChosen(Span::from_ns(12_345_678)));
    report(CameraEventKind::GainChosen(7.5));
    assert_eq!((bench.number(own::EXPOSURE_TIME), bench.number(own::GAIN)), (12_345.678, 7.5));
    assert_eq!((bench.read(A, own::EXPOSURE_AUTO), bench.read(A, own::GAIN_AUTO)), (Ok(1), Ok(2)), "control: not done");
    report(CameraEventKind::ExposureAutoDone);
    assert_eq!((bench.read(A, own::EXPOSURE_AUTO), bench.read(A, own::GAIN_AUTO)), (Ok(0), Ok(2)));
    assert_eq!(bench.write_number(own::EXPOSURE_TIME, 50_000.0), 0, "the client's again");
}
