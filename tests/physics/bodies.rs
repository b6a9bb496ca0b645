//! Sun, Moon, Earth and planets: where others see them, how bright, as discs, and what they hide.
//!
//! Vectors: `bodies_vectors.csv`, made by `hil_scripts/generate/body_vectors.py` with skyfield and DE421.

use crate::scene;
use ::scene::sky_bodies::{BodyCamera, MOON_NUMBER, SeenBody, SkyBodies, seen_from};
use ::scene::truth::fill_truth;
use base::axes::{Icrf, Rotation, Sensor};
use base::time::{Span, Tai};
use base::units::{ARCSEC, DEG};
use frames::sink::TruthKind;
use glam::{DQuat, DVec3};
use image::detector::window::OutputGeometry;
use plan::exposure::target::FIRST_BODY_ID;
use plan::exposure::{Source, SourcePlace};
use plan::optics::{PsfModel, Radiometry, StarLight};
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};
use sky::magnitude::{Lighting, SUN_G_LESS_V};
use sky::observer::{BarycentricState, Observer, ObserverTrack};
use sky::{bodies::Standpoint, orbit::CircularOrbit};

/// Required error of a place.
const PLACE_ARCSEC: f64 = 1.0;
/// Mars without its turning and seasons, Uranus without its latitudes.
const MAGNITUDE: f64 = 0.13;

const VECTORS: &str = include_str!("bodies_vectors.csv");

/// State of the vectors' satellite.
const SATELLITE: BarycentricState =
    BarycentricState { position_km: DVec3::new(5_000.0, 3_000.0, -3_500.0), velocity_km_s: DVec3::new(3.0, -6.0, 3.5) };

struct Row {
    at: Tai,
    is_satellite: bool,
    body: String,
    apparent: DVec3,
    distance_km: f64,
    v_mag: f64,
    phase_deg: f64,
    bright_limb_deg: f64,
}

fn rows() -> Vec<Row> {
    let read = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |i: usize| fields[i].parse::<f64>().expect("a number");
        Row {
            at: instant(fields[0]),
            is_satellite: fields[1] == "satellite",
            body: fields[2].to_owned(),
            apparent: DVec3::new(number(3), number(4), number(5)),
            distance_km: number(6),
            v_mag: number(7),
            phase_deg: number(8),
            bright_limb_deg: number(9),
        }
    };
    VECTORS.lines().skip(2).map(read).collect()
}

fn instant(text: &str) -> Tai {
    Tai::from_rfc3339(text).expect("an instant")
}

fn standpoint(row: &Row) -> Standpoint {
    let earth = ObserverTrack::new(Observer::Geocentre, row.at).standpoint(row.at).expect("a sky");
    if !row.is_satellite {
        return earth;
    }
    Standpoint {
        observer: earth.observer + SATELLITE,
        from_sun_km: earth.from_sun_km + SATELLITE.position_km,
        from_earth: SATELLITE,
        from_moon: earth.from_moon + SATELLITE,
        ..earth
    }
}

fn seen(standpoint: &Standpoint, body: &str) -> SeenBody {
    let is_it = |seen: &SeenBody| seen.name.to_lowercase() == body;
    seen_from(standpoint).into_iter().find(is_it).expect("a body of that name")
}

/// Returns the worst error over all rows of bodies that `wants`, arcsec; `edit` breaks something.
fn worst_arcsec(wants: impl Fn(&Row) -> bool, edit: impl Fn(&mut Standpoint)) -> f64 {
    let all = rows();
    assert_eq!(all.len(), 108);
    let sun = |row: &Row| {
        let is_sun = |other: &&Row| other.at == row.at && other.is_satellite == row.is_satellite && other.body == "sun";
        all.iter().find(is_sun).expect("the Sun").apparent
    };
    let error = |row: &Row| {
        let mut from = standpoint(row);
        edit(&mut from);
        seen(&from, &row.body).apparent_icrf.angle_between(row.apparent) / ARCSEC
    };
    // Nearer to the Sun its deflection of light, which is left out, is more than 0.1 arcsec.
    let is_far = |row: &&Row| row.body == "sun" || sun(row).angle_between(row.apparent) > 5.0 * DEG;
    all.iter().filter(|row| wants(row)).filter(is_far).map(error).fold(0.0, f64::max)
}

#[test]
fn apparent_places_agree_with_an_independent_library() {
    for body in ["sun", "moon", "mercury", "venus", "mars", "jupiter", "saturn", "uranus", "neptune"] {
        let worst = worst_arcsec(|row| row.body == body, |_| ());
        println!("{body}: {worst:.3} arcsec");
        assert!(worst < 0.3 * PLACE_ARCSEC, "{body}: {worst}");
    }
}

#[test]
fn leaving_out_light_time_or_aberration_is_noticed() {
    let still = worst_arcsec(|row| row.body == "jupiter", |from| from.observer.velocity_km_s = DVec3::ZERO);
    assert!(still > 5.0 * PLACE_ARCSEC, "aberration: {still}");
    let moon = worst_arcsec(
        |row| row.body == "moon" && row.is_satellite,
        |from| {
            from.from_moon.velocity_km_s -= SATELLITE.velocity_km_s;
        },
    );
    assert!(moon > 2.0 * PLACE_ARCSEC, "the satellite's own: {moon}");
    // Five minutes earlier or later: half of a light time.
    let late = worst_arcsec(
        |row| row.body == "mars",
        |from| {
            let later = ObserverTrack::new(Observer::Geocentre, from.at).standpoint(from.at + Span::from_s(300.0));
            from.planets_from_sun_km = later.expect("a sky").planets_from_sun_km;
        },
    );
    assert!(late > 2.0 * PLACE_ARCSEC, "light time: {late}");
    let parallax = worst_arcsec(
        |row| row.body == "moon" && row.is_satellite,
        |from| {
            from.from_moon.position_km -= SATELLITE.position_km;
        },
    );
    assert!(parallax > 1_000.0 * PLACE_ARCSEC, "parallax: {parallax}");
}

#[test]
fn distances_and_magnitudes_agree() {
    let mut worst = 0.0_f64;
    for row in rows() {
        let from = standpoint(&row);
        let seen = seen(&from, &row.body);
        // The Moon's is that of one instant; theirs is from where the Earth is to where the Moon was: 1.3 s of 30 km/s.
        let slack_km = if row.body == "moon" { 41.0 } else { 1e-6 * row.distance_km + 700.0 };
        assert!((seen.range_km - row.distance_km).abs() < slack_km, "{}: {}", row.body, seen.range_km);
        if row.v_mag.is_finite() {
            let off = seen.mag_g.expect("a magnitude") - SUN_G_LESS_V - row.v_mag;
            worst = worst.max(off.abs());
            assert!(off.abs() < MAGNITUDE, "{} {}: {off}", row.body, row.at.to_rfc3339());
        }
    }
    assert!(worst > 1e-3, "control: something is left out");
}

fn lit(from_sun_au: DVec3, from_observer_au: DVec3) -> Lighting {
    let au_km = base::units::AU_KM;
    Lighting { from_sun_km: from_sun_au * au_km, from_observer_km: from_observer_au * au_km }
}

#[test]
fn the_full_moon_is_as_bright_as_published() {
    // -12.74 at 384,400 km and 1 au (Allen); quarters 2.6 mag fainter by the same phase law: 2.34 + 0.26.
    let moon = |phase_deg: f64| {
        let (s, c) = phase_deg.to_radians().sin_cos();
        let observer = DVec3::X * (384_400.0 / base::units::AU_KM);
        sky::magnitude::moon_v(&lit(DVec3::new(c, s, 0.0), observer))
    };
    assert!((moon(0.0) + 12.74).abs() < 1e-9, "{}", moon(0.0));
    assert!((moon(90.0) + 12.74 - 2.6024).abs() < 1e-3, "{}", moon(90.0));
}

fn light() -> StarLight {
    StarLight::Parametric(Radiometry {
        zero_magnitude_photons_per_s_m2: 3e10,
        aperture_mm: 20.0,
        obscuration: 0.0,
        transmission: 0.8,
        quantum_efficiency: 0.5,
        color_c1: 0.0,
        color_c2: 0.0,
    })
}

fn camera(size: usize, focal_px: f64) -> BodyCamera {
    let middle = 0.5 * (size as f64 - 1.0);
    let geometry = CameraGeometry::new(CameraParameters {
        width_px: size,
        height_px: size,
        focal_px: [focal_px; 2],
        principal_point_px: [middle; 2],
        distortion: BrownConrady::default(),
    })
    .expect("a camera");
    BodyCamera { geometry, light: light(), exposure_s: 0.1, limiting_mag: 8.0 }
}

/// Returns the north up, the boresight there.
fn pointed(boresight: DVec3) -> Rotation<Sensor, Icrf> {
    let ra = boresight.y.atan2(boresight.x);
    let dec = boresight.z.clamp(-1.0, 1.0).asin();
    base::axes::sensor_from_ra_dec_roll(ra, dec, 0.0)
}

fn pixel(source: &Source) -> [f64; 2] {
    match source.place {
        SourcePlace::Pixel(px) => px,
        SourcePlace::Icrf(_) => panic!("a disc's sources have places on the detector"),
    }
}

/// Returns sum, middle, and farthest place from a point.
fn moments(sources: &[Source], about: [f64; 2]) -> (f64, [f64; 2], f64) {
    let (mut sum, mut first, mut far) = (0.0, [0.0; 2], 0.0_f64);
    for source in sources {
        let [x, y] = pixel(source);
        sum += source.electrons;
        first = [first[0] + source.electrons * x, first[1] + source.electrons * y];
        far = far.max((x - about[0]).hypot(y - about[1]));
    }
    (sum, first.map(|v| v / sum), far)
}

#[test]
fn the_moon_has_its_size_its_light_and_its_bright_limb() {
    let mut checked = 0;
    for row in rows().iter().filter(|row| row.body == "moon" && !row.is_satellite && row.phase_deg < 150.0) {
        // 20 arcsec a pixel: the Moon is 93 px across.
        let camera = camera(256, 10_000.0);
        let mut bodies = SkyBodies::through(camera.clone(), ObserverTrack::new(Observer::Geocentre, row.at));
        let sources = bodies.seen(&[], &pointed(row.apparent), row.at).expect("a sky").to_vec();
        let sources: Vec<Source> =
            sources.into_iter().filter(|source| source.id == FIRST_BODY_ID + MOON_NUMBER).collect();
        let [x, y] = [127.5, 127.5];
        let (sum, middle, far) = moments(&sources, [x, y]);
        let moon = seen(&standpoint(row), "moon");
        let wanted = camera.light.electrons(moon.mag_g.unwrap(), 0.82, 0.1);
        assert!((sum / wanted - 1.0).abs() < 1e-9, "{}: {}", row.phase_deg, sum / wanted);
        let radius_px = 10_000.0 * (1_737.4 / row.distance_km).asin().tan();
        assert!((far - radius_px).abs() < 0.75, "{far} {radius_px}");
        // Image up is north and east is left: x to the right is west.
        let angle = f64::atan2(x - middle[0], y - middle[1]).to_degrees().rem_euclid(360.0);
        let off = (angle - row.bright_limb_deg + 180.0).rem_euclid(360.0) - 180.0;
        let leaning = (middle[0] - x).hypot(middle[1] - y);
        assert!(row.phase_deg < 20.0 || off.abs() < 0.5, "{} deg: {angle} {}", row.phase_deg, row.bright_limb_deg);
        assert!(leaning < radius_px);
        let lit = 0.5 * (1.0 + row.phase_deg.to_radians().cos());
        assert!((moon.lit_share - lit).abs() < 1e-3, "{} {lit}", moon.lit_share);
        // Sources behind it are hidden, lit or not; those before it, or beside it, are not.
        let hides = |direction, range_km| bodies.before.moon_hides(direction, range_km);
        assert!(hides(row.apparent, f64::INFINITY) && !hides(row.apparent, 40_000.0));
        assert!(!hides(pointed(row.apparent).inverse().apply(DVec3::new(0.01, 0.0, 1.0).normalize()), f64::INFINITY));
        checked += 1;
    }
    assert!(checked >= 5, "{checked} Moons");
}

#[test]
fn the_lit_part_of_the_disc_is_the_phase() {
    for row in rows().iter().filter(|row| row.body == "moon" && !row.is_satellite) {
        let mut bodies = SkyBodies::through(camera(256, 20_000.0), ObserverTrack::new(Observer::Geocentre, row.at));
        let sources = bodies.seen(&[], &pointed(row.apparent), row.at).expect("a sky").to_vec();
        let moon = sources.iter().filter(|source| source.id == FIRST_BODY_ID + MOON_NUMBER);
        // Cells of half a pixel, all of them lit: those cut by limb and terminator count as whole.
        let step_px = bodies.counts().coarsest_px;
        let area_px = moon.count() as f64 * step_px * step_px;
        let radius_px = 20_000.0 * (1_737.4 / row.distance_km).asin().tan();
        let wanted = core::f64::consts::PI * radius_px * radius_px * 0.5 * (1.0 + row.phase_deg.to_radians().cos());
        let border_px = core::f64::consts::PI * radius_px * step_px * 2.0;
        assert!((area_px - wanted).abs() < border_px, "{}: {area_px} {wanted}", row.phase_deg);
    }
}

/// Polar radius of WGS 84, km.
const POLAR_KM: f64 = 6_356.752_314_245;

/// Returns a direction and a line meet the WGS 84 ellipsoid: roots of its quadratic equation, in axes of the Earth.
fn is_behind_earth(standpoint: &Standpoint, apparent: DVec3, polar_km: f64) -> bool {
    let (a, b) = (6_378.137_f64, polar_km);
    let turn = DQuat::from_rotation_arc(standpoint.earth_axis, DVec3::Z);
    // The inverse of aberration, in full.
    let beta = standpoint.from_earth.velocity_km_s / 299_792.458;
    let gamma = 1.0 / (1.0 - beta.length_squared()).sqrt();
    let along = apparent.dot(-beta);
    let natural = (apparent / gamma - beta + -beta * (gamma / (gamma + 1.0) * along)) / (1.0 + along);
    let (o, u) = (turn * standpoint.from_earth.position_km, turn * natural.normalize());
    let (wa, wb) = (1.0 / (a * a), 1.0 / (b * b));
    let quadratic = wa * (u.x * u.x + u.y * u.y) + wb * u.z * u.z;
    let linear = wa * (o.x * u.x + o.y * u.y) + wb * o.z * u.z;
    let constant = wa * (o.x * o.x + o.y * o.y) + wb * o.z * o.z - 1.0;
    let root = linear * linear - quadratic * constant;
    root > 0.0 && -linear - root.sqrt() > 0.0
}

fn low_orbit(at: Tai) -> Observer {
    Observer::Circular(CircularOrbit::new(550.0, 97.6, 40.0, 25.0, at).expect("an orbit"))
}

/// Towards the limb ahead, so that stars rise or set across the field.
fn towards_limb(observer: &Observer, at: Tai, sign: f64) -> DVec3 {
    let state =
        ObserverTrack::new(observer.clone(), at).geocentric_state(at).expect("an orbit").expect("near the Earth");
    let (down, ahead) = (-state.position_km.normalize(), state.velocity_km_s.normalize() * sign);
    let limb = (6_378.137 / state.position_km.length()).asin();
    down * limb.cos() + ahead * limb.sin()
}

fn star(id: u32, direction: DVec3) -> Source {
    Source { id, electrons: 1e4, mag: 5.0, place: SourcePlace::Icrf(direction) }
}

#[test]
fn hidden_stars_are_exactly_those_behind_the_limb() {
    let at = instant("2026-03-01T00:00:00Z");
    let observer = low_orbit(at);
    let boresight = towards_limb(&observer, at, 1.0);
    let camera = camera(512, 1_500.0);
    let attitude = pointed(boresight);
    let to_icrf = attitude.inverse();
    let stars: Vec<Source> = (0..40_000_u32)
        .map(|id| {
            let [x, y] = [f64::from(id % 200), f64::from(id / 200)].map(|v| v * 511.0 / 199.0);
            star(id, to_icrf.apply(camera.geometry.unproject([x, y]).expect("imaged")))
        })
        .collect();
    let mut bodies = SkyBodies::through(camera, ObserverTrack::new(observer.clone(), at));
    let left: Vec<u32> = bodies
        .seen(&stars, &attitude, at)
        .expect("a sky")
        .iter()
        .map(|s| s.id)
        .filter(|id| *id < FIRST_BODY_ID)
        .collect();
    let standpoint = ObserverTrack::new(observer, at).standpoint(at).expect("a sky");
    let direction = |star: &Source| match star.place {
        SourcePlace::Icrf(direction) => direction,
        SourcePlace::Pixel(_) => panic!("stars have directions"),
    };
    let wanted: Vec<u32> = stars
        .iter()
        .filter(|star| !is_behind_earth(&standpoint, direction(star), POLAR_KM))
        .map(|star| star.id)
        .collect();
    assert_eq!(left, wanted);
    assert!(wanted.len() > 10_000 && wanted.len() < 30_000, "the limb crosses the field: {}", wanted.len());
    assert_eq!(bodies.counts().occulted, stars.len() - wanted.len());
    let control = stars.iter().filter(|star| !is_behind_earth(&standpoint, direction(star), 6_378.137)).count();
    assert!(control != wanted.len(), "control: a sphere hides others");
}

#[test]
fn a_star_sets_in_the_frame_in_which_it_should() {
    let start = instant("2026-03-01T00:00:00Z");
    let observer = low_orbit(start);
    // Behind the satellite the limb sinks away from where it has been: stars set there.
    let back = towards_limb(&observer, start, -1.0);
    let up = ObserverTrack::new(observer.clone(), start)
        .geocentric_state(start)
        .expect("an orbit")
        .expect("near the Earth")
        .position_km
        .normalize();
    let direction = (back + up * 0.02).normalize();
    let attitude = pointed(direction);
    let at = |s: f64| start + Span::from_s(s);
    let track = ObserverTrack::new(observer.clone(), start);
    let is_up = |s: f64| !is_behind_earth(&track.standpoint(at(s)).expect("a sky"), direction, POLAR_KM);
    let (mut up_s, mut down_s) = (0.0, 60.0);
    assert!(is_up(up_s) && !is_up(down_s), "it sets in the first minute");
    while down_s - up_s > 1e-4 {
        let middle = 0.5 * (up_s + down_s);
        if is_up(middle) { up_s = middle } else { down_s = middle }
    }
    let mut bodies = SkyBodies::through(camera(32, 1_500.0), ObserverTrack::new(observer, start));
    let mut last_seen = None;
    // Frames of 10 Hz, three seconds about the setting.
    for frame in -15..15 {
        let s = 0.1 * (f64::from(frame) + (10.0 * up_s).floor());
        let sources = bodies.seen(&[star(7, direction)], &attitude, at(s)).expect("a sky");
        if sources.iter().any(|source| source.id == 7) {
            last_seen = Some(s);
        }
    }
    let last_seen = last_seen.expect("it was up");
    assert!(last_seen <= up_s && up_s - last_seen < 0.1 + 1e-3, "{last_seen} {up_s}");
}

#[test]
fn a_planet_has_the_light_of_its_magnitude_where_it_is_seen() {
    for row in rows().iter().filter(|row| !row.is_satellite && row.v_mag < 7.0) {
        // 100 arcsec a pixel: points and the tiniest discs; 2 arcsec a pixel: discs of up to 30 px.
        for focal_px in [2_000.0, 100_000.0] {
            let camera = camera(128, focal_px);
            let mut bodies = SkyBodies::through(camera.clone(), ObserverTrack::new(Observer::Geocentre, row.at));
            let attitude = pointed(row.apparent);
            let sources = bodies.seen(&[], &attitude, row.at).expect("a sky").to_vec();
            let planet = seen(&standpoint(row), &row.body);
            let own: Vec<&Source> =
                sources.iter().filter(|source| source.id == FIRST_BODY_ID + planet.number).collect();
            let sum: f64 = own.iter().map(|source| source.electrons).sum();
            let wanted = camera.light.electrons(planet.mag_g.unwrap(), 0.82, 0.1);
            assert!((sum / wanted - 1.0).abs() < 1e-9, "{} at {focal_px}: {}", row.body, sum / wanted);
            for source in own {
                let [x, y] = match source.place {
                    SourcePlace::Pixel(px) => px,
                    SourcePlace::Icrf(v) => camera.geometry.project(attitude.apply(v)).expect("imaged"),
                };
                let radius_px = planet.radius_rad * focal_px;
                let far = (x - 63.5).hypot(y - 63.5);
                let slack_px = 0.5 * ARCSEC * focal_px + 0.01;
                assert!(far < radius_px + slack_px, "{}: {far} of {radius_px}", row.body);
            }
        }
    }
}

#[test]
fn a_far_earth_shines_as_a_lambert_sphere() {
    let at = instant("2026-07-01T00:00:00Z");
    let observer = Observer::Circular(CircularOrbit::new(300_000.0, 10.0, 100.0, 0.0, at).expect("an orbit"));
    let from = ObserverTrack::new(observer.clone(), at).standpoint(at).expect("a sky");
    let earth = seen(&from, "earth");
    // 1.2 deg of radius, 62 px.
    let camera = camera(256, 3_000.0);
    let mut bodies = SkyBodies::through(camera.clone(), ObserverTrack::new(observer, at));
    let sources = bodies.seen(&[], &pointed(earth.apparent_icrf), at).expect("a sky").to_vec();
    let sum: f64 = sources.iter().filter(|s| s.id == FIRST_BODY_ID + 3).map(|source| source.electrons).sum();
    let phase = (2.0 * earth.lit_share - 1.0).acos();
    let pi = core::f64::consts::PI;
    let sun_au = (from.from_sun_km - from.from_earth.position_km).length() / base::units::AU_KM;
    let sun_e = camera.light.electrons(-26.90, 0.82, 0.1) / (sun_au * sun_au);
    let lambert = 2.0 / (3.0 * pi) * (phase.sin() + (pi - phase) * phase.cos());
    let wanted = sun_e * 0.306 * earth.radius_rad.sin().powi(2) * lambert;
    // Flattening takes 0.3 % of the disc, the near sphere's horizon as much.
    assert!((sum / wanted - 1.0).abs() < 0.03, "{}", sum / wanted);
    assert!(phase > 0.2 && phase < 2.9, "control: not a trivial phase: {phase}");
    // Beside the field it is not drawn, unless the exposure sweeps as far.
    let dir = earth.apparent_icrf;
    let aside = pointed(DQuat::from_axis_angle(dir.any_orthonormal_vector(), 310.0 / 3_000.0) * dir);
    let mut cells = |sweep_px: f64| {
        bodies.expect_sweep(sweep_px / 3_000.0);
        bodies.seen(&[], &aside, at).expect("a sky").iter().filter(|s| s.id == FIRST_BODY_ID + 3).count()
    };
    assert!(cells(0.0) == 0 && cells(250.0) > 100, "{} {}", cells(0.0), cells(250.0));
}

#[test]
fn the_sun_is_reported_and_never_drawn() {
    let at = instant("2026-07-01T00:00:00Z");
    let from = ObserverTrack::new(Observer::Geocentre, at).standpoint(at).expect("a sky");
    let sun = seen(&from, "sun");
    let mut bodies = SkyBodies::through(camera(128, 1_000.0), ObserverTrack::new(Observer::Geocentre, at));
    let drawn = bodies.seen(&[], &pointed(sun.apparent_icrf), at).expect("a sky").iter().any(|s| s.id == FIRST_BODY_ID);
    assert!(bodies.counts().has_sun && !drawn);
    bodies.seen(&[], &pointed(-sun.apparent_icrf), at).expect("a sky");
    assert!(!bodies.counts().has_sun);
}

#[test]
fn no_one_is_at_the_barycentre_and_nothing_changes_without_bodies_in_the_field() {
    let at = instant("2026-07-01T00:00:00Z");
    let mut bodies = SkyBodies::through(camera(128, 1_000.0), ObserverTrack::new(Observer::Barycentre, at));
    assert!(bodies.seen(&[], &pointed(DVec3::X), at).is_err());
    let mut bodies = SkyBodies::through(camera(128, 1_000.0), ObserverTrack::new(Observer::Geocentre, at));
    let stars = [star(1, DVec3::Z), star(2, DVec3::new(0.01, 0.0, 1.0).normalize())];
    assert_eq!(bodies.seen(&stars, &pointed(DVec3::Z), at).expect("a sky"), stars);
}

#[test]
fn the_truth_has_a_row_for_each_body_and_the_picture_its_light() {
    // The bench "moon": a crescent with Jupiter 4 deg below it.
    let at = instant("2026-04-22T20:00:01Z");
    let from = ObserverTrack::new(Observer::Geocentre, at).standpoint(at).expect("a sky");
    let moon = seen(&from, "moon");
    let attitude = pointed(moon.apparent_icrf);
    let size = 128;
    let camera = BodyCamera { geometry: scene::camera(size), ..camera(size, scene::FOCAL_PX) };
    let mut bodies = SkyBodies::through(camera, ObserverTrack::new(Observer::Geocentre, at));
    let stars = [scene::star(7, 2e4, [20.0, 30.0])];
    let sources = bodies.seen(&stars, &attitude, at).expect("a sky");
    let mut planner = scene::planner(size, &PsfModel::gaussian(0.7), "static", scene::los(), None);
    let plan = planner.plan(sources).clone();
    let mut rows = Vec::new();
    fill_truth(&plan, &OutputGeometry::whole([size, size]), None, &mut rows);
    let kinds: Vec<_> = rows.iter().map(|row| (row.id, row.kind)).collect();
    assert_eq!(kinds, [(7, TruthKind::Star), (FIRST_BODY_ID + MOON_NUMBER, TruthKind::Moon)]);
    let [star, crescent] = [rows[0], rows[1]];
    // The crescent is lit from the west, which is right.
    assert!((crescent.x_px - 63.5).abs() < 14.0 && crescent.x_px > 66.0, "{}", crescent.x_px);
    let drawn = scene::draw_cpu(&plan);
    assert!((drawn.sum() / (star.electrons + crescent.electrons) - 1.0).abs() < 1e-3, "{}", drawn.sum());
    let (_, [x, y]) = drawn.moments(&scene::everything(size));
    assert!((x - crescent.x_px).hypot(y - crescent.y_px) < 0.01, "{x} {y}: the star is nothing beside it");
}
