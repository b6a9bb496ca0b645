//! Apparent places against ERFA, 1991 to 2050, from the geocentre, low and eccentric Earth orbits, the Moon's distance,
//! an orbit about the Moon and one about the Sun; stars all over the sky, at both poles, fast and near ones, and 2 to
//! 20 degrees from the Sun.
//!
//! `apparent_vectors.csv` is made by `hil_scripts/generate/apparent_vectors.py`: stars by `erfa.pmpx`, `ldsun` and `ab`; Earth,
//! Sun and Moon by JPL's DE421; orbits by formulae written there, and by the Python package `sgp4` with skyfield's
//! axes. Only the numbers of the cases are shared.

use base::source::{CatalogSource, ProperMotion, direction_from_ra_dec};
use base::time::{Span, Tai};
use glam::DVec3;
use sky::astrometry::{ApparentPlaces, Vantage};
use sky::observer::{Observer, ObserverTrack};
use sky::orbit::{CentralBody, CircularOrbit, KeplerElements, TleOrbit, TwoBodyOrbit};
use std::sync::OnceLock;

const VECTORS: &str = include_str!("apparent_vectors.csv");
const DEG: f64 = core::f64::consts::PI / 180.0;
const MAS: f64 = DEG / 3_600e3;
/// Error promised by the module.
const AGREEMENT_MAS: f64 = 1.0;

struct Case {
    at: Tai,
    observer: &'static str,
    star: &'static str,
    source: CatalogSource,
    /// The observer as the program has it, with the Sun that bends light.
    vantage: Vantage,
    /// Apparent direction with the deflection of light by the Sun, and without.
    seen: [DVec3; 2],
}

#[allow(clippy::cast_possible_truncation, reason = "catalogs are single precision")]
fn case(line: &'static str) -> Case {
    let fields: Vec<&'static str> = line.split(',').collect();
    let [at, observer, star] = [fields[0], fields[1], fields[2]];
    let numbers: Vec<f64> = fields[3..].iter().map(|field| field.parse().unwrap()).collect();
    let proper_motion =
        ProperMotion { pm_ra_cosdec_mas_yr: numbers[2] as f32, pm_dec_mas_yr: numbers[3] as f32, radial_mas_yr: 0.0 };
    let source = CatalogSource {
        id: 0,
        source_id: None,
        direction_icrf: direction_from_ra_dec(numbers[0] * DEG, numbers[1] * DEG),
        proper_motion: Some(proper_motion),
        parallax_mas: Some(numbers[4] as f32),
        mag_g: 0.0,
        bp_rp: 0.0,
    };
    let seen = [DVec3::from_slice(&numbers[5..]), DVec3::from_slice(&numbers[8..])];
    let at = Tai::from_rfc3339(at).unwrap();
    Case { at, observer, star, source, vantage: vantage(observer, at), seen }
}

fn cases() -> &'static [Case] {
    static CASES: OnceLock<Vec<Case>> = OnceLock::new();
    CASES.get_or_init(|| VECTORS.lines().filter(|line| !line.starts_with('#')).skip(1).map(case).collect())
}

fn vantage(observer_name: &str, at: Tai) -> Vantage {
    Vantage::of(&ObserverTrack::new(observer(observer_name, at), at), at, true).unwrap()
}

/// Returns the observers of the script; orbits are at their elements on the first of January.
fn observer(name: &str, at: Tai) -> Observer {
    let epoch = Tai::from_rfc3339(&format!("{}-01-01T00:00:00Z", &at.to_rfc3339()[..4])).unwrap();
    let conic = |about: CentralBody, [a, e, i, node, periapsis, mean]: [f64; 6]| {
        let elements = KeplerElements {
            semi_major_axis_km: a,
            eccentricity: e,
            inclination_rad: i * DEG,
            raan_rad: node * DEG,
            argument_of_periapsis_rad: periapsis * DEG,
            mean_anomaly_rad: mean * DEG,
        };
        let orbit = TwoBodyOrbit::from_elements(epoch, &elements, about.gm_km3_s2()).unwrap();
        Observer::TwoBody { about, orbit }
    };
    let tle = |lines: &str| Observer::Tle(Box::new(TleOrbit::parse(lines).unwrap().within_days(36_525.0)));
    match name {
        "geocentre" => Observer::Geocentre,
        "low" => Observer::Circular(CircularOrbit::new(550.0, 97.6, 30.0, 10.0, epoch).unwrap()),
        "lunar distance" => conic(CentralBody::Earth, [384_400.0, 0.3, 20.0, 80.0, 10.0, 50.0]),
        "about the moon" => conic(CentralBody::Moon, [37_000.0, 0.9, 88.0, 12.0, 86.0, 180.0]),
        "about the sun" => conic(CentralBody::Sun, [1.9e8, 0.35, 25.0, 140.0, 240.0, 30.0]),
        "vanguard" => tle("1 00005U 58002B   00179.78495062  .00000023  00000-0  28098-4 0  4753\n\
             2 00005  34.2682 348.7242 1859667 331.7664  19.3264 10.82419157413667"),
        "iss" => tle("1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\n\
             2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537"),
        other => panic!("no observer {other}"),
    }
}

/// Returns the difference of a case, mas, with (0) and without (1) deflection, after `edit` of what goes in.
fn off_mas(case: &Case, edit: &dyn Fn(&mut CatalogSource, &mut Vantage)) -> [f64; 2] {
    let off = |vantage: Vantage, wanted: DVec3| {
        let (mut source, mut vantage) = (case.source, vantage);
        edit(&mut source, &mut vantage);
        ApparentPlaces::new(2016.0, case.at, &vantage).of(&source).distance(wanted) / MAS
    };
    [off(case.vantage, case.seen[0]), off(case.vantage.observer.into(), case.seen[1])]
}

#[test]
fn apparent_places_agree_with_erfa_to_a_milliarcsecond() {
    let mut worst = std::collections::BTreeMap::<&str, (f64, String)>::new();
    let mut count = 0;
    for case in cases() {
        count += 1;
        let [bent, unbent] = off_mas(case, &|_, _| ());
        let entry = worst.entry(case.observer).or_insert((0.0, String::new()));
        if bent.max(unbent) > entry.0 {
            *entry = (bent.max(unbent), format!("{} on {}", case.star, case.at));
        }
    }
    for (observer, (off, of)) in &worst {
        println!("{observer}: worst {off:.3} mas ({of})");
    }
    assert!(count >= 60 && worst.len() == 7, "{count} cases, {} observers", worst.len());
    let farthest = worst.values().map(|(off, _)| *off).fold(0.0, f64::max);
    println!("worst of {count} cases: {farthest:.3} mas");
    assert!(farthest < AGREEMENT_MAS, "{farthest} mas");
}

/// Returns the worst difference with deflection over the cases of an observer.
fn worst_mas(observer: &str, edit: &dyn Fn(&mut CatalogSource, &mut Vantage)) -> f64 {
    cases().iter().filter(|case| case.observer == observer).map(|case| off_mas(case, edit)[0]).fold(0.0, f64::max)
}

#[test]
fn every_effect_left_out_is_seen() {
    let geocentre = |edit: &dyn Fn(&mut CatalogSource, &mut Vantage)| worst_mas("geocentre", edit);
    assert!(geocentre(&|source, _| source.proper_motion = None) > 1e4, "space motion");
    assert!(geocentre(&|source, _| source.parallax_mas = None) > 500.0, "parallax");
    assert!(geocentre(&|_, vantage| vantage.heliocentric_km = None) > 90.0, "deflection, 5 degrees from the Sun");
    assert!(geocentre(&|_, vantage| vantage.observer.velocity_km_s = DVec3::ZERO) > 1e4, "aberration");
    let one_m_per_s = DVec3::new(1e-3, 1e-3, 1e-3);
    assert!(geocentre(&|_, vantage| vantage.observer.velocity_km_s += one_m_per_s) > AGREEMENT_MAS, "1.7 m/s");
    // The Earth's own velocity instead of the observer's.
    for (name, at_least_mas) in [("low", 4e3), ("vanguard", 3e3), ("iss", 4e3), ("lunar distance", 400.0)] {
        let slip = |case: &Case| {
            let earth = sky::earth::barycentric_state(case.at);
            off_mas(case, &|_, vantage| vantage.observer.velocity_km_s = earth.velocity_km_s)[0]
        };
        let off = cases().iter().filter(|case| case.observer == name).map(slip).fold(0.0, f64::max);
        assert!(off > at_least_mas, "{name}: {off} mas");
    }
}

/// A wrong scale of time is a wrong place of the observer: an orbit 1 s from where it is has turned by 1 mrad.
#[test]
fn a_wrong_leap_second_is_seen() {
    let worst = cases().iter().filter(|case| case.observer == "low").map(|case| {
        let late = vantage("low", case.at + Span::from_s(1.0));
        off_mas(case, &|_, vantage| *vantage = late)[0]
    });
    assert!(worst.fold(0.0, f64::max) > 4.0 * AGREEMENT_MAS, "1 s of a low orbit is 5 mas");
}
