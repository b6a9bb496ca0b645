//! Tests that a session of any run file comes back bit by bit, that the first form is read, and that damage is refused.

use super::*;
use crate::wiring::fault_schedule::{ScheduleLimits, fault_schedule};
use base::time::Span;
use config::{Action, Bench, Plant};
use testbed::vehicle::VehicleFault;

/// Returns a session of a run file with this duration.
fn session_of(document: &Document, scenario: &Scenario, settings: &[String], cost: Option<CostModel>) -> Session {
    let params = SessionParams {
        document,
        settings,
        scenario,
        start: Tai::from_ns(1_790_000_000_123_456_789),
        is_real: cost.is_some(),
        backend: "cpu",
        adapter: "2 threads, vector level V3".into(),
        cost,
    };
    Session::new(&params, CaptureFormat::Pcapng).unwrap()
}

/// Rates of a gyro are stored in other units.
fn is_exact(event: &Event) -> bool {
    !matches!(event.action, Action::Aboard(VehicleFault::GyroBiasJump(_) | VehicleFault::GyroSpike(_)))
}

/// Writes a session and reads it again.
fn again(session: &Session) -> Session {
    let folder = tempfile::tempdir().unwrap();
    session.write(folder.path()).unwrap();
    let read = Session::read(folder.path()).unwrap();
    assert_eq!(&read, session);
    read
}

#[test]
fn a_session_comes_back_bit_by_bit() {
    let document = Bench::built_in_document().unwrap();
    let settings = ["timing.frame_rate_hz=12.5".to_owned(), "camera.exposure.exposure_s=0.03".to_owned()];
    let parsed = settings.iter().map(|text| Setting::parse(text).unwrap()).collect();
    let mut scenario = Scenario::from_document(&document.clone().with_settings(parsed)).unwrap();
    let bench = &mut scenario.bench;
    bench.timing.duration_s = 0.1 + 0.2;
    bench.seed = u64::MAX;
    bench.noise_seed_given = Some(u64::MAX - 1);
    bench.render.backend = Backend::Cpu;
    let cost = CostModel { pixel_ns: 1.0 / 3.0, threads: f64::MIN_POSITIVE, ..CostModel::CPU };
    let read = again(&session_of(&document, &scenario, &settings, Some(cost)));
    assert_eq!(read.cost().unwrap(), Some(cost));
    assert_eq!(read.start(), Tai::from_ns(1_790_000_000_123_456_789));
    assert_eq!(read.doubts().len(), 1, "it has not ended");
    let (again, bench) = (read.scenario().unwrap().bench, scenario.bench);
    assert_eq!(again.noise_seed(), u64::MAX - 1);
    assert_eq!((again.camera, again.timing, again.seed), (bench.camera, bench.timing, bench.seed));
    assert_eq!((again.name, again.link, again.attitude), (bench.name, bench.link, bench.attitude));
}

#[test]
fn scenario_over_a_bench_comes_back_with_its_vehicle_and_all_events() {
    let document = Document::open(Path::new("scenarios/imaging_faults.toml")).unwrap();
    let cut = Setting::parse("duration_s=205.5").unwrap();
    let mut scenario = Scenario::from_document(&document.clone().with_settings(vec![cut])).unwrap();
    scenario.bench.render.backend = Backend::Cpu;
    assert!(scenario.events_left_out > 0, "cut short");
    let mut session = session_of(&document, &scenario, &[], None);
    let wanted = again(&session).scenario().unwrap();
    assert!(wanted.vehicle().is_some() && wanted.events == scenario.events, "{:?}", wanted.events);

    assert!(session.added.is_empty(), "{:?}", session.added);

    // Random faults are events too.
    let limits = ScheduleLimits { from_s: 10.0 / 3.0, until_s: 3000.0, wheels: 4 };
    let random: Vec<Event> = fault_schedule(7, &limits).into_iter().filter(is_exact).collect();
    scenario.events.extend(random.iter().copied());
    scenario.events.sort_by_key(|event| event.at);
    let mut with_faults = session_of(&document, &scenario, &[], None);
    assert!(random.len() > 1 && with_faults.added.len() == random.len(), "{random:?}");
    assert_eq!(again(&with_faults).scenario().unwrap().events, scenario.events);
    with_faults.added.pop();
    assert_ne!(again(&with_faults).scenario().unwrap().events, scenario.events, "control");

    let safe = Event { at: Span::from_ms(1), on_trigger: None, lasts: Span::ZERO, action: Action::Safe };
    session.injected.push(Injected::new(&safe, Span::from_s(1.0 / 3.0)));
    assert_eq!(again(&session).injected, session.injected);
}

#[test]
fn a_virtual_run_with_42_comes_back_as_one_that_its_plant_steps() {
    let document = Document::open(Path::new("benches/forty_two.toml")).unwrap();
    let mut scenario = Scenario::from_document(&document).unwrap();
    scenario.bench.render.backend = Backend::Cpu;
    scenario.step_by_plant();
    let session = session_of(&document, &scenario, &[], None);
    let read = again(&session).scenario().unwrap();
    assert!(read.bench.is_lockstep() && read.plant == Plant::Outside);
    assert_eq!(read.bench.timing.start, StartTime::At(session.start()), "the date of 42's first message");
    let real = Session { is_real: true, ..session };
    assert!(!again(&real).scenario().unwrap().bench.is_lockstep(), "control: its packets were captured");
}

#[test]
fn session_of_the_first_form_is_read() {
    let document = Bench::built_in_document().unwrap();
    let mut scenario = Scenario::from_document(&document).unwrap();
    scenario.bench.timing.duration_s = 2.0;
    scenario.bench.render.backend = Backend::Cpu;
    let session = session_of(&document, &scenario, &[], None);
    let mut first: serde_json::Value = serde_json::to_value(&session).unwrap();
    let keys = first.as_object_mut().unwrap();
    let run_file = keys.remove("run_file").unwrap();
    keys.insert("bench".into(), run_file);
    keys.insert("form".into(), 1.into());
    assert!(keys.remove("added").is_some() && keys.remove("injected").is_some(), "they are of the second");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(SESSION_FILE);
    std::fs::write(&path, first.to_string()).unwrap();
    assert_eq!(Session::read(folder.path()).unwrap().scenario().unwrap(), session.scenario().unwrap());
    first["form"] = 3.into();
    std::fs::write(&path, first.to_string()).unwrap();
    let error = Session::read(folder.path()).unwrap_err().to_string();
    assert!(error.contains("form 3, wanted 1 or 2"), "{error}");
}

#[test]
fn another_form_and_damage_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let error = Session::read(folder.path()).unwrap_err().to_string();
    assert!(error.contains("session.json: cannot read"), "{error}");
    for (text, why) in [("", "EOF"), ("{}", "missing field"), ("[1", "wanted the session"), ("\u{1}", "expected")] {
        std::fs::write(folder.path().join(SESSION_FILE), text).unwrap();
        let error = Session::read(folder.path()).unwrap_err().to_string();
        assert!(error.contains(why) && error.contains("session.json"), "{text}: {error}");
    }
}
