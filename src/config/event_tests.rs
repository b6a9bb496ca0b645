//! Every word takes its own keys, asks for those it needs, and refuses all others.

use super::*;
use crate::event_word::{Row, link_flag};
use firmware_protocol::can::CanId;
use frames::sink::FaultFlags;
use link::tap::LinkFault;

/// From one frame to the next.
const PERIOD: Span = Span::from_ms(100);

/// A value that is right for each key.
const VALUES: [(&str, &str); 39] = [
    ("for_s", "2.0"),
    ("ra_deg", "84.0"),
    ("dec_deg", "-1.0"),
    ("roll_deg", "5.0"),
    ("share", "0.3"),
    ("delay_ms", "20.0"),
    ("jitter_ms", "5.0"),
    ("can_id", "0x123"),
    ("period_ms", "0.5"),
    ("bytes", "5"),
    ("step_ms", "-20.0"),
    ("ppm", "50.0"),
    ("late_ms", "300.0"),
    ("e_per_s", "2e5"),
    ("rate_deg_h", "[5.0, 0.0, 0.0]"),
    ("head", "1"),
    ("wheel", "2"),
    ("number", "3"),
    ("bit", "9"),
    ("px", "[10, 20]"),
    ("count", "5"),
    ("from_e_per_s", "1e4"),
    ("to_e_per_s", "1e5"),
    ("sigma_px", "1.5"),
    ("throughput", "0.8"),
    ("to_throughput", "0.4"),
    ("by_k", "10.0"),
    ("full_wells", "2.0"),
    ("mag", "4.5"),
    ("column", "7"),
    ("row", "8"),
    ("response", "0.25"),
    ("high_s", "0.5"),
    ("low_s", "4.0"),
    ("dn", "4000"),
    ("per_cm2_s", "100.0"),
    ("energy_mev", "60.0"),
    ("incidence_deg", "45.0"),
    ("azimuth_deg", "30.0"),
];

/// Returns the event of a word with every key that it takes.
pub(crate) fn given_in_full(word: &str, row: &Row) -> Event {
    checked(word, &row.keys().concat()).expect(word)
}

fn checked(word: &str, names: &[&str]) -> Result<Event, String> {
    let line =
        |name: &&str| VALUES.iter().find(|(key, _)| key == name).map(|(key, value)| format!("{key} = {value}\n"));
    let lines: String = names.iter().filter_map(line).collect();
    let document = Document::from_text(&format!("at_s = 1.0\ndo = \"{word}\"\n{lines}"), Path::new("lab/event.toml"));
    let keys: EventKeys = document.read_as().map_err(|error| error.to_string())?;
    Event::check(&keys, 0, PERIOD, &mut Checker::new(&document)).map_err(|error| error.to_string())
}

#[test]
fn every_word_takes_its_keys_and_needs_those_it_says() {
    for (word, row) in ACTIONS {
        let [needed, _] = row.keys();
        checked(word, &needed).expect(word);
        let all = row.keys().concat();
        checked(word, &all).expect(word);
        for left_out in &needed {
            let rest: Vec<&str> = all.iter().copied().filter(|name| name != left_out).collect();
            let error = checked(word, &rest).expect_err(word);
            assert!(error.contains(&format!("event[0].{left_out} is missing")), "{word}: {error}");
        }
    }
}

#[test]
fn a_key_of_another_word_is_refused_and_says_whose_it_is() {
    for (word, row) in ACTIONS {
        let [needed, _] = row.keys();
        for (other, _) in VALUES.iter().filter(|(name, _)| !row.has_key(name)) {
            let error = checked(word, &[needed.as_slice(), &[*other]].concat()).expect_err(word);
            assert!(error.contains(&format!("event[0].{other} is given")), "{word}: {error}");
            assert!(error.contains("it belongs to do = \""), "{word}: {error}");
        }
    }
    let error = checked("frame_drop", &["for_s", "share"]).expect_err("share is of the bus");
    assert!(error.contains("\"bus_loss\"") && !error.contains("\"frame_drop\""), "{error}");
}

/// An optional key that nothing reads would pass the tests above.
#[test]
fn optional_keys_change_the_event() {
    for (word, row) in ACTIONS {
        let [needed, optional] = row.keys();
        for name in &optional {
            let with = checked(word, &[needed.as_slice(), &[*name]].concat()).expect(word);
            assert_ne!(with, checked(word, &needed).expect(word), "{word}: nothing reads {name}");
        }
    }
}

#[test]
fn the_list_of_keys_is_that_of_the_reader() {
    // serde lists every key it knows when it refuses one.
    let document = Document::from_text("no_such_key = 1\n", Path::new("lab/event.toml"));
    let error = document.read_as::<EventKeys>().expect_err("unknown").to_string();
    let (_, known) = error.split_once("known here: ").expect("a list");
    let known: Vec<&str> = known
        .split(", ")
        .filter(|name| !["at_s", "at_frame", "on_trigger", "for_frames", "do"].contains(name))
        .collect();
    let listed: Vec<&str> =
        EventKeys::default().given().iter().map(|(name, _)| *name).filter(|name| !OF_ALL.contains(name)).collect();
    assert_eq!(listed, known, "a new key is refused where it does not belong");
}

#[test]
fn help_has_a_line_for_every_word() {
    let help = Event::described_words();
    assert_eq!(help.lines().count(), ACTIONS.len());
    assert!(help.contains("\n  bus_delay            for_s, delay_ms, [jitter_ms]\n"), "{help}");
    assert!(help.contains("\n  safe\n"), "{help}");
}

#[test]
fn babble_and_clocks_have_edges() {
    let event = |lines: &str| {
        let document = Document::from_text(&format!("at_s = 1.0\nfor_s = 2.0\n{lines}"), Path::new("lab/event.toml"));
        let keys: EventKeys = document.read_as().map_err(|error| error.to_string())?;
        Event::check(&keys, 0, PERIOD, &mut Checker::new(&document)).map_err(|error| error.to_string())
    };
    let babble = |id: &str, period_ms: &str, bytes: &str| {
        event(&format!("do = \"bus_babble\"\ncan_id = {id}\nperiod_ms = {period_ms}\nbytes = {bytes}\n"))
    };
    let period = Span::from_ns(50_000);
    let wanted = |id: Option<CanId>| Action::Bus(LinkFault::Babble { id: id.unwrap(), period, bytes: 64 });
    assert_eq!(babble("0x7FF", "0.05", "64").unwrap().action, wanted(CanId::standard(0x7FF)));
    for (text, number) in [("000007FF", 0x7FF), ("18ff0123", 0x18FF_0123), ("1FFFFFFF", 0x1FFF_FFFF)] {
        let action = babble(&format!("\"{text}\""), "0.05", "64").unwrap().action;
        assert_eq!(action, wanted(CanId::extended(number)), "{text}");
    }
    for (id, period_ms, bytes, key) in [
        ("0x800", "1.0", "8", "can_id"),
        ("-1", "1.0", "8", "can_id"),
        ("0x18FF0123", "1.0", "8", "can_id"),
        ("\"7FF\"", "1.0", "8", "can_id"),
        ("\"0x000123\"", "1.0", "8", "can_id"),
        ("\"+0000123\"", "1.0", "8", "can_id"),
        ("\"20000000\"", "1.0", "8", "can_id"),
        ("1", "0.049", "8", "period_ms"),
        ("1", "1.0", "65", "bytes"),
    ] {
        let error = babble(id, period_ms, bytes).unwrap_err();
        assert!(error.contains(&format!("event[0].{key} is ")) && error.contains("wanted"), "{error}");
    }
    let long = babble("0x12345", "1.0", "8").unwrap_err();
    assert!(long.contains("event[0].can_id is 74565; wanted a whole number from 0 to 2047"), "{long}");
    assert!(long.contains("an identifier of 11 bits"), "{long}");
    for (word, key, most) in [("clock_step", "step_ms", 60_000.0), ("clock_drift", "ppm", 10_000.0)] {
        for sign in [1.0, -1.0] {
            let of = |value: f64| event(&format!("do = \"{word}\"\n{key} = {value:?}\n"));
            assert!(of(sign * most).is_ok(), "{word}");
            assert!(of(sign * most * 1.001).unwrap_err().contains(key), "{word}");
        }
    }
}

fn timed(lines: &str) -> Result<Event, String> {
    let document = Document::from_text(&format!("do = \"frame_blank\"\n{lines}"), Path::new("lab/event.toml"));
    let keys: EventKeys = document.read_as().map_err(|error| error.to_string())?;
    Event::check(&keys, 0, PERIOD, &mut Checker::new(&document)).map_err(|error| error.to_string())
}

#[test]
fn an_event_begins_by_time_by_frame_or_by_trigger() {
    let by_time = timed("at_s = 1.5\nfor_s = 2.0\n").unwrap();
    assert_eq!((by_time.at, by_time.on_trigger, by_time.lasts), (Span::from_ms(1500), None, Span::from_ms(2000)));
    let by_frame = timed("at_frame = 7\nfor_frames = 3\n").unwrap();
    assert_eq!((by_frame.at, by_frame.lasts), (Span::from_ns(700_000_001), Span::from_ms(300)));
    let by_trigger = timed("on_trigger = 4\nfor_s = 2.0\n").unwrap();
    assert_eq!((by_trigger.at, by_trigger.on_trigger), (Span::ZERO, Some(4)));
    assert_eq!(timed("on_trigger = 4\nat_s = 0.5\nfor_s = 2.0\n").unwrap().at, Span::from_ms(500), "after the trigger");
}

#[test]
fn contradicting_times_are_refused() {
    for (lines, wanted) in [
        ("for_s = 2.0\n", "event[0].at_s is missing; wanted a number, 0 or more: seconds after the first exposure"),
        ("at_s = 1.0\nat_frame = 7\nfor_s = 2.0\n", "event[0].at_s is given"),
        ("on_trigger = 1\nat_frame = 7\nfor_s = 2.0\n", "event[0].at_frame is given"),
        ("at_s = 1.0\nfor_s = 2.0\nfor_frames = 3\n", "event[0].for_s is given"),
        ("at_s = 1.0\nfor_frames = 0\n", "event[0].for_frames is 0"),
        ("at_s = 1.0\n", "event[0].for_s is missing"),
        ("on_trigger = 70000\nfor_s = 2.0\n", "event[0].on_trigger"),
        ("at_frame = -1\nfor_s = 2.0\n", "event[0].at_frame"),
    ] {
        let error = timed(lines).unwrap_err();
        assert!(error.contains(wanted), "{lines}: {error}");
    }
    let document = Document::from_text("do = \"safe\"\non_trigger = 1\n", Path::new("lab/event.toml"));
    let keys: EventKeys = document.read_as().unwrap();
    let error = Event::check(&keys, 0, PERIOD, &mut Checker::new(&document)).unwrap_err().to_string();
    assert!(error.contains("event[0].on_trigger is given"), "{error}");
}

#[test]
fn defects_and_storms_are_read_as_they_are_given() {
    use frames::sink::{CameraFault, DefectSpots, FaultPixels, FrameFault, ImageFault, PixelFault, ProtonStorm};
    let fault = |word: &str, lines: &str| {
        let text = format!("do = \"{word}\"\nat_s = 1.0\nfor_s = 2.0\n{lines}");
        let document = Document::from_text(&text, Path::new("lab/event.toml"));
        let keys: EventKeys = document.read_as().unwrap();
        let action = Event::check(&keys, 0, PERIOD, &mut Checker::new(&document)).unwrap().action;
        let Action::Frame { fault, .. } = action else { panic!("{action:?}") };
        fault
    };
    let none = FaultPixels { at: None, random: 0 };
    let column = DefectSpots { pixels: none, column: Some(7), row: None };
    let stuck = FrameFault::Camera(CameraFault::Pixels { spots: column, fault: PixelFault::Stuck { dn: 12 } });
    assert_eq!(fault("stuck_pixels", "dn = 12\ncolumn = 7\n"), stuck);
    let random = DefectSpots { pixels: FaultPixels { random: 1, ..none }, column: None, row: None };
    let hot = FrameFault::Camera(CameraFault::Pixels { spots: random, fault: PixelFault::Hot { e_per_s: 5.0 } });
    assert_eq!(fault("hot_pixels", "e_per_s = 5.0\n"), hot, "one pixel at random");
    let all = ProtonStorm { per_cm2_s: 9.0, energy_mev: 60.0, beam_deg: None };
    assert_eq!(
        fault("proton_storm", "per_cm2_s = 9.0\nenergy_mev = 60.0\n"),
        FrameFault::Image(ImageFault::Protons(all))
    );
    let beam = ProtonStorm { beam_deg: Some([30.0, 0.0]), ..all };
    let lines = "per_cm2_s = 9.0\nenergy_mev = 60.0\nincidence_deg = 30.0\n";
    assert_eq!(fault("proton_storm", lines), FrameFault::Image(ImageFault::Protons(beam)));
}

/// Words whose flag has another name, each with the reason. Flags are in telemetry and files: their names stay.
const FLAGS: [(&str, &str, &str); 15] = [
    ("bus_loss", "link_drop", "flags of the bus are named after the link that the stimulator sees"),
    ("bus_silence", "link_stale", "the stimulator sees an attitude that grows old"),
    ("bus_delay", "link_delay", "flags of the bus are named after the link"),
    ("bus_duplicate", "link_duplicate", "flags of the bus are named after the link"),
    ("bus_wrong_bits", "link_corrupt", "shares a bit with bus_truncate: both spoil the content of packets"),
    ("bus_reorder", "link_reorder", "flags of the bus are named after the link"),
    ("bus_truncate", "link_corrupt", "shares a bit with bus_wrong_bits"),
    ("bus_babble", "link_babble", "flags of the bus are named after the link"),
    ("bus_off", "link_off", "flags of the bus are named after the link"),
    ("frame_blank", "blank", "shares a bit with frames that are blank because no attitude is known"),
    ("stray_light_ramp", "stray_light", "shares a bit with stray_light: a ramp is stray light that changes"),
    ("defocus_step", "defocus", "the flag names the state, the word the change"),
    ("temperature_step", "temperature", "the flag names the state, the word the change"),
    ("missing_bright_stars", "missing_stars", "shares a bit with missing_stars: both leave stars out"),
    ("proton_storm", "proton_tracks", "the flag names what is in the image, the word its cause"),
];

/// Words that leave no flag: commands, and faults of what is not the frames or the link that feeds them.
const UNFLAGGED: [&str; 11] = [
    "slew",
    "safe",
    "resume",
    "bus_back_loss",
    "gyro_dropout",
    "gyro_stuck",
    "gyro_bias_jump",
    "gyro_spike",
    "wheel_failure",
    "tracker_off",
    "trigger",
];

fn flag(action: &Action) -> Option<FaultFlags> {
    match action {
        Action::Bus(fault) => Some(link_flag(fault)),
        Action::Frame { fault, .. } => Some(fault.flag()),
        Action::Slew(_)
        | Action::Safe
        | Action::Resume
        | Action::BusBackLoss { .. }
        | Action::Aboard(_)
        | Action::Trigger { .. } => None,
    }
}

#[test]
fn each_word_reads_as_an_action_that_is_named_by_the_same_word() {
    for (word, row) in ACTIONS {
        let action = given_in_full(word, row).action;
        assert_eq!(action.word(), *word);
        if let Action::Frame { fault, .. } = action {
            assert_eq!(fault.name(), *word, "frames name it as files do");
        }
    }
}

#[test]
fn flag_has_the_name_of_its_word_or_the_one_in_the_table() {
    for (word, row) in ACTIONS {
        let flags: Vec<_> = flag(&given_in_full(word, row).action).into_iter().flat_map(FaultFlags::names).collect();
        let in_table = FLAGS.iter().find(|(other, ..)| other == word).map(|(_, flag, _)| *flag);
        let wanted = if UNFLAGGED.contains(word) { None } else { Some(in_table.unwrap_or(word)) };
        assert_eq!(flags, Vec::from_iter(wanted), "{word}");
    }
    assert!(FLAGS.iter().all(|(word, flag, why)| word != flag && !why.is_empty()), "rows that say nothing");
}
