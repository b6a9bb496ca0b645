use super::*;
use base::axes::{Icrf, Rotation, Sensor, sensor_from_ra_dec_roll};
use base::units::{ARCSEC, DEG, SPEED_OF_LIGHT_KM_S};
use plan::{exposure::Shutter, optics::Radiometry};
use sky::astrometry::{BrownConrady, CameraParameters};
use sky::orbit::{CircularOrbit, TleOrbit};
use sky::{earth, observer::Observer};

/// Resolution of SGP4's time, seconds since 1970 in f64: 2.4e-7 s, at 10 km/s, twice.
const TIME_STEP_KM: f64 = 5e-6;

/// The elements of the crossing bench.
const CROSSING: &str = "1 90001U 26001A   26060.00000000  .00000100  00000-0  50000-4 0  9993\n\
                        2 90001  66.0000 311.3900 0010000   0.0000  84.6000 14.27740000  1006";

fn start() -> Tai {
    Tai::from_rfc3339("2026-03-01T00:00:01Z").expect("a valid instant")
}

fn observer() -> Observer {
    Observer::Circular(CircularOrbit::new(550.0, 97.6, 184.0, 114.2, start()).expect("a valid orbit"))
}

fn geometry() -> CameraGeometry {
    let parameters = CameraParameters {
        width_px: 1936,
        height_px: 1216,
        focal_px: [50.0 / 5.86e-3; 2],
        principal_point_px: [967.5, 607.5],
        distortion: BrownConrady::default(),
    };
    CameraGeometry::new(parameters).expect("a camera")
}

fn light() -> StarLight {
    let radiometry = Radiometry {
        zero_magnitude_photons_per_s_m2: 3.2e10,
        aperture_mm: 25.0,
        obscuration: 0.0,
        transmission: 0.85,
        quantum_efficiency: 0.5,
        color_c1: 0.05,
        color_c2: 0.0,
    };
    StarLight::Parametric(radiometry)
}

fn targets_of(observer: Observer, targets: Vec<SkyTarget>) -> SkyTargets {
    SkyTargets::with_optics(geometry(), Shutter::Global, light(), ObserverTrack::new(observer, start()), targets)
}

fn target(orbit: Orbit) -> SkyTarget {
    let brightness = Brightness::Sphere { diameter_m: 1.5, diffuse: 0.2, specular: 0.0 };
    let (begin, end) = (start() - Span::from_s(1e6), start() + Span::from_s(1e9));
    SkyTarget { id: 7, orbit, brightness, bp_rp: 0.82, begin, end }
}

fn crossing() -> SkyTarget {
    target(Orbit::Sgp4(Box::new(TleOrbit::parse(CROSSING).expect("sound elements"))))
}

fn looking(sensor_from_icrf: Rotation<Sensor, Icrf>, mid: Tai, exposure_s: f64) -> LosPath {
    LosPath::commanded(sensor_from_icrf, mid - Span::from_s(0.5 * exposure_s), exposure_s)
}

fn at_the_crossing(exposure_s: f64) -> LosPath {
    let boresight = sensor_from_ra_dec_roll(115.4 * DEG, 30.6 * DEG, 0.0);
    looking(boresight, start() + Span::from_s(5.0), exposure_s)
}

fn path_of(target: &Target) -> &SkyPath {
    match &target.way {
        TargetWay::Sky(path) => path,
        TargetWay::Script(_) => panic!("a way on the sky"),
    }
}

/// Returns the apparent direction by definition: light time by iteration between barycentric places, each from the
/// Earth's own series; then aberration by components.
fn apparent(orbit: &Orbit, observer: &Observer, at: Tai) -> DVec3 {
    let observer = earth::barycentric_state(at) + observer.relative_state(at).expect("an orbit about the Earth");
    let mut from = DVec3::X;
    let mut light_time_s = 0.0;
    for _ in 0..6 {
        let then = at - Span::from_s(light_time_s);
        // The Earth's place moves in a straight line during the light time.
        let earth = earth::barycentric_state(at);
        let earth_km = earth.position_km - earth.velocity_km_s * light_time_s;
        from = earth_km + orbit.geocentric_state(then).expect("an orbit").position_km - observer.position_km;
        light_time_s = from.length() / SPEED_OF_LIGHT_KM_S;
    }
    // Along the velocity and across it, by addition of velocities.
    let (u, b) = (from.normalize(), observer.velocity_km_s / SPEED_OF_LIGHT_KM_S);
    let forward = b.normalize();
    let along = forward * u.dot(forward);
    ((along + b) + (u - along) * (1.0 - b.length_squared()).sqrt()) / (1.0 + u.dot(b))
}

#[test]
fn ways_follow_the_apparent_places_within_their_bound() {
    for exposure_s in [0.2, 4.0] {
        let los = at_the_crossing(exposure_s);
        let mut targets = targets_of(observer(), vec![crossing()]);
        assert_eq!(targets.find_in_view(&los).expect("a sky"), 0);
        let [target] = targets.in_view() else { panic!("one target: {:?}", targets.in_view()) };
        let range_km = targets.facts()[0].range_km;
        assert!((400.0..700.0).contains(&range_km), "{range_km}");
        let bound_rad =
            (SkyPath::bound_km(0.5 * exposure_s, [Fall { gm_km3_s2: EARTH_GM_KM3_S2, radius_km: 6_900.0 }; 2])
                + TIME_STEP_KM)
                / 400.0;
        let mut worst = 0.0_f64;
        for step in -10..=10 {
            let t_s = f64::from(step) / 20.0 * exposure_s;
            let wanted = apparent(&crossing().orbit, &observer(), los.mid_exposure() + Span::from_s(t_s));
            worst = worst.max(path_of(target).apparent_icrf(t_s).distance(wanted));
        }
        println!("{exposure_s} s: {:.4} mas of {:.4}", worst / ARCSEC * 1e3, bound_rad / ARCSEC * 1e3);
        // The Earth's velocity by days and directly: 0.02 mas.
        assert!(worst < bound_rad + 0.1e-3 * ARCSEC, "{exposure_s} s: {worst:e} {bound_rad:e}");
        assert!(!targets.is_coarse, "{exposure_s} s");
    }
}

#[test]
fn trajectory_too_long_for_a_cubic_is_reported() {
    let mut targets = targets_of(observer(), vec![crossing()]);
    targets.find_in_view(&at_the_crossing(20.0)).expect("a sky");
    assert!(!targets.in_view().is_empty() && !targets.is_coarse, "20 s: within a hundredth of a pixel");
    targets.find_in_view(&at_the_crossing(400.0)).expect("a sky");
    assert!(!targets.in_view().is_empty() && targets.is_coarse, "400 s are not");
}

#[test]
fn only_what_comes_near_the_field_is_taken() {
    let mut targets = targets_of(observer(), vec![crossing(), SkyTarget { id: 8, ..crossing() }]);
    targets.find_in_view(&at_the_crossing(0.2)).expect("a sky");
    assert_eq!(targets.in_view().iter().map(|target| target.id).collect::<Vec<_>>(), [7, 8]);
    let away = looking(sensor_from_ra_dec_roll(135.4 * DEG, 30.6 * DEG, 0.0), start() + Span::from_s(5.0), 0.2);
    targets.find_in_view(&away).expect("a sky");
    assert!(targets.in_view().is_empty(), "17 deg away");
    // An exposure in which it arrives includes it.
    let los = looking(sensor_from_ra_dec_roll(135.4 * DEG, 30.6 * DEG, 0.0), start() + Span::from_s(5.0), 60.0);
    targets.find_in_view(&los).expect("a sky");
    assert!(!targets.in_view().is_empty(), "half a minute at a degree per second");
    let los = at_the_crossing(0.2);
    let late = SkyTarget { begin: los.mid_exposure(), ..crossing() };
    let mut targets = targets_of(observer(), vec![late]);
    targets.find_in_view(&los).expect("a sky");
    assert_eq!(targets.in_view()[0].begin, los.mid_exposure());
}

#[test]
fn hidden_targets_are_left_out_and_the_others_stay() {
    let twin = SkyTarget { id: 77, ..crossing() };
    let mut targets = targets_of(observer(), vec![crossing(), twin]);
    targets.find_in_view(&at_the_crossing(0.2)).expect("a sky");
    let ids = |targets: &SkyTargets| targets.in_view().iter().map(|target| target.id).collect::<Vec<_>>();
    assert_eq!(ids(&targets), [crossing().id, 77]);
    targets.leave_out(|_| false);
    assert_eq!(ids(&targets).len(), 2, "control: nothing is hidden");
    targets.leave_out(|seen| seen.id == crossing().id);
    assert_eq!((ids(&targets), targets.facts().len()), (vec![77], 1));
    assert_eq!(targets.facts()[0].id, 77);
}

#[test]
fn brightness_is_that_of_range_and_phase() {
    let mut targets = targets_of(observer(), vec![crossing()]);
    let los = at_the_crossing(0.2);
    targets.find_in_view(&los).expect("a sky");
    let (target, facts) = (&targets.in_view()[0], targets.facts()[0]);
    // By hand: (0.75 m / 530 km)^2 x 0.2 x 2/3 (sin p + (pi - p) cos p) / pi of a Sun of -26.90 at 0.991 au.
    let (range_km, phase) = (facts.range_km, facts.phase_rad);
    assert!((range_km - 529.7).abs() < 0.5 && (phase / DEG - 48.74).abs() < 0.05, "{facts:?}");
    let sphere = 2.0 / 3.0 * (phase.sin() + (PI - phase) * phase.cos()) / PI;
    let share = 0.2 * (0.75e-3 / range_km).powi(2) * sphere / (0.991_f64).powi(2);
    let mag = -26.90 - 2.5 * share.log10();
    assert!((facts.mag_g - mag).abs() < 0.005 && facts.sunlight >= 1.0, "{} {mag}", facts.mag_g);
    let electrons = light().electrons(facts.mag_g, 0.82, 1.0);
    assert!((target.e_per_s_at(0.0) / electrons - 1.0).abs() < 1e-3, "{} {electrons}", target.e_per_s_at(0.0));
    // It recedes and dims.
    let light = target.light.expect("sunlight");
    assert!(light.shares[0] >= 1.0 && light.shares[16] < 1.0 && light.shares[16] > 0.99, "{light:?}");
}

/// Returns a target behind the Earth for the moving observer, and the instant when it sets.
fn setting() -> (SkyTarget, Tai) {
    let high = target(Orbit::Circular(CircularOrbit::new(35_786.0, 0.0, 0.0, 100.0, start()).expect("a valid orbit")));
    let targets = targets_of(observer(), vec![high.clone()]);
    let clearance = |s: f64| targets.facts_at(0, start() + Span::from_s(s)).expect("a sky").clearance_km;
    let mut second = 0.0;
    while !(clearance(second) > 0.0 && clearance(second + 10.0) <= 0.0) {
        second += 10.0;
        assert!(second < 12_000.0, "one orbit has a set");
    }
    let (mut above, mut below) = (second, second + 10.0);
    for _ in 0..40 {
        let middle = 0.5 * (above + below);
        *(if clearance(middle) > 0.0 { &mut above } else { &mut below }) = middle;
    }
    (high, start() + Span::from_s(above))
}

#[test]
fn light_ends_where_a_target_sets_behind_the_limb() {
    let (target, sets) = setting();
    let mut targets = targets_of(observer(), vec![target.clone()]);
    let towards = targets.facts_at(0, sets).expect("a sky").apparent_icrf;
    let [ra, dec] = [towards.y.atan2(towards.x), towards.z.asin()];
    let at = |mid: Tai| looking(sensor_from_ra_dec_roll(ra, dec, 0.0), mid, 2.0);
    targets.find_in_view(&at(sets - Span::from_s(0.3))).expect("a sky");
    let [cut] = targets.in_view() else { panic!("it is there until it sets") };
    // Clearance changes by some 2 km/s: places within metres are milliseconds.
    assert!((cut.end - sets).s().abs() < 2e-3, "{} s", (cut.end - sets).s());
    assert_eq!(cut.begin, target.begin, "there from the beginning");
    targets.find_in_view(&at(sets + Span::from_s(1.1))).expect("a sky");
    assert!(targets.in_view().is_empty(), "behind the Earth");
    targets.find_in_view(&at(sets - Span::from_s(1.1))).expect("a sky");
    assert_eq!(targets.in_view()[0].end, target.end, "above the limb all the time");
}

#[test]
fn a_target_that_enters_the_shadow_fades() {
    // From the geocentre, which sees through the Earth: a low orbit in the equatorial plane, near an equinox.
    let low = target(Orbit::Circular(CircularOrbit::new(700.0, 0.0, 0.0, 0.0, start()).expect("a valid orbit")));
    let mut targets = targets_of(Observer::Geocentre, vec![low]);
    let lit = |s: f64| targets.facts_at(0, start() + Span::from_s(s)).expect("a sky").sunlight;
    let mut second = 0.0;
    while !(lit(second) >= 1.0 && lit(second + 20.0) <= 0.0) {
        second += 10.0;
        assert!(second < 6_000.0, "one orbit has an entry");
    }
    let mut half = second;
    while lit(half) > 0.5 {
        half += 0.1;
    }
    let mid = start() + Span::from_s(half);
    let look = |targets: &mut SkyTargets, mid: Tai| {
        let towards = targets.facts_at(0, mid).expect("a sky").apparent_icrf;
        let boresight = sensor_from_ra_dec_roll(towards.y.atan2(towards.x), towards.z.asin(), 0.0);
        targets.find_in_view(&looking(boresight, mid, 16.0)).expect("a sky");
        targets.in_view().first().copied()
    };
    let fading = look(&mut targets, mid).expect("half of its light");
    let curve = fading.light.expect("sunlight").shares;
    assert!(curve[0] > 0.99 && curve[16] < 1e-12 && (curve[8] - 0.5).abs() < 0.03, "{curve:?}");
    // Until the limb reaches the Sun it brightens by its phase.
    assert!(curve[3..].windows(2).all(|pair| pair[1] <= pair[0]), "it only fades: {curve:?}");
    assert_eq!(look(&mut targets, mid + Span::from_s(20.0)), None, "in the umbra");
    assert!(targets.facts_at(0, mid + Span::from_s(20.0)).expect("a sky").mag_g.is_infinite());
}

#[test]
fn a_decayed_target_is_lost_once_and_the_others_stay() {
    // The decay case of the published set, three days after its epoch in 2006 (AIAA 2006-6753, object 28350).
    let decays = "1 28350U 04020A   06167.21788666  .16154492  76267-5  18678-3 0  8894\n\
                  2 28350  64.9977 345.6130 0024870 260.7578  99.9590 16.47856722116490";
    let decaying = target(Orbit::Sgp4(Box::new(TleOrbit::parse(decays).expect("sound elements"))));
    let mut targets = targets_of(observer(), vec![decaying, SkyTarget { id: 9, ..crossing() }]);
    let los = at_the_crossing(0.2);
    assert_eq!(targets.find_in_view(&los).expect("a sky"), 1);
    assert_eq!(targets.in_view().iter().map(|target| target.id).collect::<Vec<_>>(), [9]);
    assert_eq!(targets.find_in_view(&los).expect("a sky"), 0, "reported once");
}

#[test]
fn a_frame_depends_on_its_time_only() {
    let mut once = targets_of(observer(), vec![crossing()]);
    once.find_in_view(&at_the_crossing(0.2)).expect("a sky");
    let mut again = targets_of(observer(), vec![crossing()]);
    for s in [1.0, 90_000.0, 4.0] {
        again.find_in_view(&looking(Rotation::IDENTITY, start() + Span::from_s(s), 0.2)).expect("a sky");
    }
    again.find_in_view(&at_the_crossing(0.2)).expect("a sky");
    assert_eq!(once.in_view(), again.in_view());
}
