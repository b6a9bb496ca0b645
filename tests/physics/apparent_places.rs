//! Apparent places and pixels computed a second time, from other data and by other formulae, against the production
//! path (built-in catalog, cone, `ApparentPlaces`, `CameraGeometry`).
//!
//! | | production | here |
//! |---|---|---|
//! | stars | packed catalog, J2016.0 (Gaia DR3, Hipparcos) | Hipparcos new reduction, J1991.25 |
//! | Earth | VSOP87E | Keplerian Sun (Meeus ch. 25), reflex of the Sun from Jupiter and Saturn |
//! | aberration | Lorentz transformation | second-order series in v/c, as an angle |
//! | projection | quaternion, X/Z, Brown-Conrady | spherical standard coordinates, same lens in vector form |
//!
//! Only time (`Tai`) is shared. [`apparent_icrf`] and [`project`] serve other tests of this folder.

use base::{axes::sensor_from_ra_dec_roll, time::Tai};
use core::f64::consts::PI;
use glam::DVec3;
use sky::astrometry::{ApparentPlaces, BrownConrady, CameraGeometry, CameraParameters, Vantage, cone_margin_rad};
use stars::catalog::Catalog;

const DEG: f64 = PI / 180.0;
const ARCSEC: f64 = DEG / 3600.0;
const MAS: f64 = ARCSEC / 1000.0;
/// Aberration: light covers one au in 499.004784 s (IAU 1976), so c is this many au per day.
const LIGHT_AU_PER_DAY: f64 = 86_400.0 / 499.004_784;

/// One pixel of the camera for which the places must agree, arcsec.
const PIXEL_ARCSEC: f64 = 70.0;
/// Agreement asked of every star, px: the centroid noise of an excellent tracker. Binaries need it: their photocentres
/// have moved against Hipparcos' straight lines (measured: 0.68 arcsec for HIP 62572, 0.49 for mu Orionis).
const AGREEMENT_PX: f64 = 0.02;
/// The same as an angle.
const AGREEMENT_ARCSEC: f64 = AGREEMENT_PX * PIXEL_ARCSEC;
/// Agreement asked of the median star, arcsec: both data sets carry errors of 0.5 mas/yr for 35 years or less, the two
/// Earths differ by 10 to 20 mas (measured: 0.02 to 0.045).
const MEDIAN_ARCSEC: f64 = 0.1;
/// A production source this near an independent place is the same star: no pair in the lists is closer.
const SAME_STAR_ARCSEC: f64 = 15.0;
/// Faintest G looked for; the lists end at Hp 5.5.
const LIMITING_MAG: f32 = 6.5;

/// One star, independently: Hipparcos, the new reduction (van Leeuwen 2007, VizieR I/311), ICRS, epoch J1991.25.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Star {
    /// Hipparcos number.
    pub(crate) hip: u32,
    /// Right ascension, rad.
    pub(crate) ra_rad: f64,
    /// Declination, rad.
    pub(crate) dec_rad: f64,
    /// Proper motion in right ascension with cos(dec), mas/yr.
    pub(crate) pm_ra_cosdec_mas_yr: f64,
    /// Proper motion in declination, mas/yr.
    pub(crate) pm_dec_mas_yr: f64,
    /// Parallax, mas.
    pub(crate) parallax_mas: f64,
}

const fn star(hip: u32, v: [f64; 5]) -> Star {
    let [ra_rad, dec_rad, pm_ra_cosdec_mas_yr, pm_dec_mas_yr, parallax_mas] = v;
    Star { hip, ra_rad, dec_rad, pm_ra_cosdec_mas_yr, pm_dec_mas_yr, parallax_mas }
}

/// Stars around Orion: ra rad, dec rad, pm ra cos dec, pm dec (mas/yr), parallax (mas).
#[rustfmt::skip]
pub(crate) const ORION: [Star; 25] = [
    star(24436, [1.3724302998, -0.1431456148, 1.31, 0.5, 3.78]), // Rigel
    star(27989, [1.5497279598, 0.1292771753, 27.54, 11.3, 6.55]), // Betelgeuse
    star(25336, [1.4186521954, 0.1108237749, -8.11, -12.88, 12.92]), // Bellatrix
    star(26311, [1.4670083233, -0.0209774132, 1.44, -0.78, 1.65]), // Alnilam
    star(26727, [1.4868405212, -0.0339043911, 3.19, 2.03, 4.43]), // Alnitak
    star(27366, [1.5173738329, -0.1687663889, 1.46, -1.28, 5.04]), // Saiph
    star(25930, [1.4486523477, -0.0052201652, 0.64, -0.69, 4.71]), // Mintaka
    star(26241, [1.4636026456, -0.1031472111, 1.42, -0.46, 1.4]), // iota Ori
    star(23875, [1.3432514979, -0.0887720313, -82.82, -75.39, 36.5]), // beta Eri
    star(22449, [1.2646465369, 0.1214966851, 464.06, 11.21, 123.94]), // pi3 Ori
    star(25281, [1.415797791, -0.0418379705, -0.71, -3.46, 3.34]), // eta Ori
    star(26207, [1.4623152277, 0.1733838532, -0.34, -2.94, 2.97]), // lambda Ori
    star(24674, [1.3858204357, -0.1194570697, -17.61, -9.24, 6.6]), // tau Ori
    star(22549, [1.2706263129, 0.0978274735, -2.21, 0.85, 3.1]), // pi4 Ori
    star(22797, [1.283914792, 0.0425977554, 0.55, 0.61, 2.43]), // pi5 Ori
    star(22109, [1.2457390124, -0.0568039198, 15.94, -14.52, 6.25]), // mu Eri
    star(29651, [1.6356161402, -0.1095146552, -4.69, -19.3, 6.55]), // gamma Mon
    star(28614, [1.5811948901, 0.1683783322, 10.43, -39.09, 21.05]), // mu Ori
    star(23972, [1.348905565, -0.1527874491, 0.25, -1.97, 4.02]), // lambda Eri
    star(26366, [1.4700276123, 0.162165732, 97.24, -305.57, 27.76]), // phi2 Ori
    star(25247, [1.4134866308, -0.1362745288, -14.82, -45.02, 20.73]), // 29 Ori
    star(26176, [1.4609306049, 0.1656245106, 0.27, -2.26, 3.0]), // phi1 Ori
    star(22509, [1.2680342178, 0.1553387203, 1.41, -29.91, 14.53]), // pi2 Ori
    star(22701, [1.2779941042, -0.0951685423, -17.86, 25.57, 13.88]),
    star(26594, [1.4799770884, 0.0719331608, 0.84, 0.0, 2.36]), // omega Ori
];

/// Stars around the north celestial pole, likewise.
#[rustfmt::skip]
pub(crate) const NORTH: [Star; 15] = [
    star(11767, [0.6622851337, 1.5579531082, 44.48, -11.85, 7.54]), // Polaris
    star(85822, [4.5911538344, 1.5112165367, 10.17, 53.97, 18.95]), // delta UMi
    star(82080, [4.3893692379, 1.4318201239, 19.47, 2.61, 10.73]), // epsilon UMi
    star(5372, [0.2999173329, 1.5054707132, 80.65, -11.54, 11.64]),
    star(47193, [2.5180266593, 1.4194138111, -16.62, -16.41, 3.28]),
    star(113116, [5.996979257, 1.4721174825, 98.64, 23.89, 9.17]),
    star(36547, [1.9681845373, 1.4383532148, -3.94, -42.11, 6.53]),
    star(112519, [5.9667678285, 1.4513061239, 24.6, 47.08, 10.41]),
    star(37391, [2.0093896571, 1.5187882427, -53.74, -27.63, 7.16]),
    star(19461, [1.0910333169, 1.4084575655, -10.44, 2.47, 8.59]),
    star(23265, [1.3105035085, 1.417102999, 1.24, 27.9, 8.49]),
    star(109693, [5.8170496515, 1.5028656151, 51.08, 40.19, 12.71]),
    star(51502, [2.7536220793, 1.44091832, -83.79, 20.1, 46.51]),
    star(62572, [3.3563990155, 1.4558290249, -41.33, 14.63, 5.59]),
    star(20860, [1.1703374566, 1.462721399, -4.14, 11.5, 4.31]),
];

/// Returns the scalar product; sums and products by hand, so that nothing of the production path's algebra is shared.
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
fn sum(a: [f64; 3], b: [f64; 3], scale: f64) -> [f64; 3] {
    [0, 1, 2].map(|i| a[i] + scale * b[i])
}
fn unit(a: [f64; 3]) -> [f64; 3] {
    a.map(|c| c / dot(a, a).sqrt())
}
fn ecliptic_to_equatorial([x, y, z]: [f64; 3]) -> [f64; 3] {
    let (s, c) = (23.439_291_1 * DEG).sin_cos();
    [x, c * y - s * z, s * y + c * z]
}

/// Returns the ecliptic position of a planet about the Sun, J2000, au: mean elements of Standish (Explanatory
/// Supplement, 1992, table 5.8.1): a au, e, mean longitude deg, its rate deg/century, perihelion deg. Inclinations (2
/// deg) left out.
fn planet_au(t: f64, [a, e, longitude_deg, rate_deg, perihelion_deg]: [f64; 5]) -> [f64; 3] {
    let mean = (longitude_deg + rate_deg * t - perihelion_deg) * DEG;
    let eccentric = (0..20).fold(mean, |angle, _| mean + e * angle.sin());
    let (x, y) = (a * (eccentric.cos() - e), a * (1.0 - e * e).sqrt() * eccentric.sin());
    let (s, c) = (perihelion_deg * DEG).sin_cos();
    [c * x - s * y, s * x + c * y, 0.0]
}

/// Returns the barycentric position of the Earth, J2000 equator, au; `t` Julian centuries from J2000. Sun: Meeus,
/// Astronomical Algorithms, 2nd ed., ch. 25 (0.01 deg). The Moon's 12 m/s on the Earth is left out: 9 mas of
/// aberration.
fn earth_au(t: f64) -> [f64; 3] {
    let longitude_deg = 280.466_46 + t * (36_000.769_83 + t * 0.000_303_2);
    let anomaly = (357.529_11 + t * (35_999.050_29 - t * 0.000_153_7)) * DEG;
    let e = 0.016_708_634 - t * 0.000_042_037;
    let centre_deg = (1.914_602 - t * 0.004_817) * anomaly.sin()
        + (0.019_993 - t * 0.000_101) * (2.0 * anomaly).sin()
        + 0.000_289 * (3.0 * anomaly).sin();
    let distance = 1.000_001_018 * (1.0 - e * e) / (1.0 + e * (anomaly + centre_deg * DEG).cos());
    // From the equinox of date to that of J2000: 0.01397 deg per year.
    let (s, c) = ((longitude_deg + centre_deg - 1.397 * t) * DEG).sin_cos();
    let jupiter = planet_au(t, [5.202_887, 0.048_386, 34.396_44, 3_034.746_13, 14.728_48]);
    let saturn = planet_au(t, [9.536_676, 0.053_862, 49.954_24, 1_222.493_62, 92.598_88]);
    let heliocentric = [-distance * c, -distance * s, 0.0];
    ecliptic_to_equatorial(sum(sum(heliocentric, jupiter, -1.0 / 1_047.35), saturn, -1.0 / 3_497.9))
}

/// Returns the barycentric velocity of the Earth in units of the speed of light, by differences over 0.02 day.
fn earth_velocity_c(t: f64) -> [f64; 3] {
    const HALF_STEP_D: f64 = 0.01;
    let half = HALF_STEP_D / 36_525.0;
    sum(earth_au(t + half), earth_au(t - half), -1.0).map(|au| au / (2.0 * HALF_STEP_D) / LIGHT_AU_PER_DAY)
}

/// Part of the computation to leave out, for the negative controls.
#[derive(Debug, Clone, Copy, PartialEq)]
enum LeaveOut {
    Nothing,
    Aberration,
    ProperMotion,
    Parallax,
}

/// Returns the direction in which an observer at the geocentre sees the star at `at`: unit vector, ICRF.
pub(crate) fn apparent_icrf(star: &Star, at: Tai) -> [f64; 3] {
    apparent(star, at, LeaveOut::Nothing)
}

/// Offsets east and north from the catalog place (proper motion; parallax by the formulae in right ascension and
/// declination), laid on the tangent plane; then aberration as the angle b sin(a) - b^2 sin(2a) / 4 towards the apex
/// (Explanatory Supplement, 1992, eq. 3.252-2).
fn apparent(star: &Star, at: Tai, leave_out: LeaveOut) -> [f64; 3] {
    let t = at.days_tdb_since_j2000() / 36_525.0;
    let years = if leave_out == LeaveOut::ProperMotion { 0.0 } else { 100.0 * t + 8.75 };
    let parallax_mas = if leave_out == LeaveOut::Parallax { 0.0 } else { star.parallax_mas };
    let ((sin_ra, cos_ra), (sin_dec, cos_dec)) = (star.ra_rad.sin_cos(), star.dec_rad.sin_cos());
    let [x, y, z] = earth_au(t);
    let east_mas = star.pm_ra_cosdec_mas_yr * years + parallax_mas * (x * sin_ra - y * cos_ra);
    let north_mas =
        star.pm_dec_mas_yr * years + parallax_mas * (x * cos_ra * sin_dec + y * sin_ra * sin_dec - z * cos_dec);
    let place = [cos_dec * cos_ra, cos_dec * sin_ra, sin_dec];
    let eastwards = sum(place, [-sin_ra, cos_ra, 0.0], east_mas * MAS);
    let natural = unit(sum(eastwards, [-sin_dec * cos_ra, -sin_dec * sin_ra, cos_dec], north_mas * MAS));
    if leave_out == LeaveOut::Aberration { natural } else { aberrated(natural, earth_velocity_c(t)) }
}

fn aberrated(natural: [f64; 3], velocity_c: [f64; 3]) -> [f64; 3] {
    let b = dot(velocity_c, velocity_c).sqrt();
    let across = sum(velocity_c, natural, -dot(velocity_c, natural));
    let angle = dot(across, across).sqrt().atan2(dot(velocity_c, natural));
    let towards_apex = b * angle.sin() - b * b / 4.0 * (2.0 * angle).sin();
    sum(natural.map(|c| c * towards_apex.cos()), unit(across), towards_apex.sin())
}

/// A camera and where it points, in plain numbers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pointing {
    /// Right ascension, declination of the boresight and position angle of the image's up direction, rad.
    pub(crate) ra_dec_roll_rad: [f64; 3],
    /// Focal length over pixel pitch, px.
    pub(crate) focal_px: f64,
    /// Where the boresight falls, px.
    pub(crate) principal_point_px: [f64; 2],
    /// k1, k2, k3 of the lens.
    pub(crate) radial: [f64; 3],
    /// p1, p2 of the lens.
    pub(crate) tangential: [f64; 2],
}

/// Returns the pixel of a direction; `None` behind the camera. Standard coordinates (Smart, Spherical Astronomy, ch.
/// 12), turned by the roll, through the lens r (1 + k . powers) + (p r^2 + 2 (p . r) r) with p = (p2, p1).
pub(crate) fn project(direction: [f64; 3], pointing: &Pointing) -> Option<[f64; 2]> {
    let [ra0, dec0, roll] = pointing.ra_dec_roll_rad;
    let [x, y, z] = unit(direction);
    let (hour, dec) = (y.atan2(x) - ra0, z.asin());
    let depth = dec.sin() * dec0.sin() + dec.cos() * dec0.cos() * hour.cos();
    if depth <= 0.0 {
        return None;
    }
    let east = dec.cos() * hour.sin() / depth;
    let north = (dec.sin() * dec0.cos() - dec.cos() * dec0.sin() * hour.cos()) / depth;
    let right = -east * roll.cos() + north * roll.sin();
    let down = -east * roll.sin() - north * roll.cos();
    let r2 = right * right + down * down;
    let [p1, p2] = pointing.tangential;
    let [k1, k2, k3] = pointing.radial;
    let scale = 1.0 + k1 * r2 + k2 * r2.powi(2) + k3 * r2.powi(3) + 2.0 * (p2 * right + p1 * down);
    let [cx, cy] = pointing.principal_point_px;
    Some([cx + pointing.focal_px * (right * scale + p2 * r2), cy + pointing.focal_px * (down * scale + p1 * r2)])
}

/// Returns the apparent directions of the production path within 40 degrees of an axis.
fn production(axis: [f64; 3], at: Tai) -> Vec<DVec3> {
    let catalog = Catalog::built_in().expect("the built-in catalog");
    let vantage = Vantage::from(sky::earth::barycentric_state(at));
    let mut sources = Vec::new();
    let radius_rad =
        40.0 * DEG + cone_margin_rad(catalog.index().epoch_yr, catalog.index().fastest_mas_yr, at, &vantage);
    catalog.cone(DVec3::from_array(axis), radius_rad, LIMITING_MAG, &mut sources);
    let places = ApparentPlaces::new(catalog.index().epoch_yr, at, &vantage);
    sources.iter().map(|star| places.of(star)).collect()
}

/// Returns the angle between two unit vectors, arcsec.
fn apart_arcsec(a: [f64; 3], b: [f64; 3]) -> f64 {
    let d = sum(a, b, -1.0);
    2.0 * (dot(d, d).sqrt() / 2.0).asin() / ARCSEC
}

/// Returns the distance of each star from the nearest production source, arcsec, with the star.
fn distances(stars: &[Star], at: Tai, leave_out: LeaveOut) -> Vec<(f64, Star)> {
    let found = production(apparent_icrf(&stars[0], at), at);
    assert!(!found.is_empty(), "the cone must hold stars");
    let nearest =
        |place: [f64; 3]| found.iter().map(|seen| apart_arcsec(seen.to_array(), place)).fold(f64::MAX, f64::min);
    stars.iter().map(|star| (nearest(apparent(star, at, leave_out)), *star)).collect()
}

fn dates() -> [Tai; 4] {
    ["2020-12-21T00:00:00Z", "2026-03-01T12:00:00Z", "2026-08-25T03:00:00Z", "2031-05-30T18:00:00Z"]
        .map(|text| Tai::from_rfc3339(text).expect("a valid instant"))
}

#[test]
fn production_directions_agree_with_the_independent_ones() {
    for stars in [&ORION[..], &NORTH[..]] {
        for at in dates() {
            let mut found = distances(stars, at, LeaveOut::Nothing);
            found.sort_by(|a, b| a.0.total_cmp(&b.0));
            let ((median, _), (worst, which)) = (found[found.len() / 2], found[found.len() - 1]);
            println!("{at}: median {median:.3}, worst {worst:.3} arcsec (HIP {})", which.hip);
            assert!(median < MEDIAN_ARCSEC, "median {median:.3} arcsec at {at}");
            assert!(worst < AGREEMENT_ARCSEC, "HIP {} is {worst:.3} arcsec off at {at}", which.hip);
        }
    }
}

#[test]
fn leaving_out_aberration_or_proper_motion_is_noticed() {
    for at in dates() {
        for (found, star) in distances(&ORION, at, LeaveOut::Aberration) {
            assert!(found > AGREEMENT_ARCSEC, "HIP {} without aberration: {found:.3} arcsec", star.hip);
        }
        let fast = ORION.iter().filter(|star| star.pm_ra_cosdec_mas_yr.hypot(star.pm_dec_mas_yr) > 300.0);
        let fast: Vec<Star> = fast.copied().collect();
        assert_eq!(fast.len(), 2, "pi3 and phi2 Orionis");
        for (found, star) in distances(&fast, at, LeaveOut::ProperMotion) {
            assert!(found > AGREEMENT_ARCSEC, "HIP {} without proper motion: {found:.3} arcsec", star.hip);
        }
    }
}

#[test]
fn the_comparison_sees_a_parallax() {
    // pi3 Orionis, 124 mas: leaving it out must worsen the agreement by about that much on some date.
    let pi3: Vec<Star> = ORION.iter().filter(|star| star.hip == 22_449).copied().collect();
    let worst = |leave_out| dates().map(|at| distances(&pi3, at, leave_out)[0].0).into_iter().fold(0.0, f64::max);
    let (with, without) = (worst(LeaveOut::Nothing), worst(LeaveOut::Parallax));
    assert!(without > with + 0.05, "with {with:.3}, without {without:.3} arcsec");
}

fn pointings() -> [Pointing; 3] {
    let lens = Pointing {
        ra_dec_roll_rad: [83.0 * DEG, 0.5 * DEG, 0.0],
        focal_px: 1.0 / (PIXEL_ARCSEC * ARCSEC),
        principal_point_px: [511.5, 509.25],
        radial: [-0.08, 0.02, -0.003],
        tangential: [3e-4, -2e-4],
    };
    [
        lens,
        Pointing { ra_dec_roll_rad: [80.0 * DEG, -2.0 * DEG, 137.0 * DEG], ..lens },
        Pointing { ra_dec_roll_rad: [200.0 * DEG, 88.0 * DEG, -61.0 * DEG], ..lens },
    ]
}

fn camera(pointing: &Pointing) -> CameraGeometry {
    let ([k1, k2, k3], [p1, p2]) = (pointing.radial, pointing.tangential);
    let parameters = CameraParameters {
        width_px: 1024,
        height_px: 1024,
        focal_px: [pointing.focal_px; 2],
        principal_point_px: pointing.principal_point_px,
        distortion: BrownConrady { k1, k2, k3, p1, p2 },
    };
    CameraGeometry::new(parameters).expect("a valid camera")
}

/// Returns the largest pixel distance between both paths over the stars in view of `seen_by`, and how many there were.
fn worst_px(pointing: &Pointing, seen_by: &Pointing, at: Tai) -> (f64, usize) {
    let [ra, dec, roll] = pointing.ra_dec_roll_rad;
    let (attitude, camera) = (sensor_from_ra_dec_roll(ra, dec, roll), camera(pointing));
    let boresight = attitude.inverse().apply(DVec3::Z).to_array();
    let found = production(boresight, at);
    let mut seen = (0.0_f64, 0);
    for star in ORION.iter().chain(&NORTH) {
        let place = apparent_icrf(star, at);
        let Some([x, y]) = project(place, seen_by).filter(|px| px.iter().all(|c| (0.0..=1023.0).contains(c))) else {
            continue;
        };
        let same = found.iter().min_by(|a, b| {
            let apart = |seen: &DVec3| apart_arcsec(seen.to_array(), place);
            apart(a).total_cmp(&apart(b))
        });
        let same = *same.expect("a source in the cone");
        assert!(apart_arcsec(same.to_array(), place) < SAME_STAR_ARCSEC, "HIP {} is not in the cone", star.hip);
        let [px, py] = camera.project(attitude.apply(same)).expect("in front of the camera");
        seen = (seen.0.max((px - x).hypot(py - y)), seen.1 + 1);
    }
    seen
}

#[test]
fn production_pixels_agree_with_the_independent_ones() {
    for pointing in pointings() {
        for at in dates() {
            let (worst, seen) = worst_px(&pointing, &pointing, at);
            println!("{:?} {at}: worst of {seen} stars {worst:.5} px", pointing.ra_dec_roll_rad.map(|a| a / DEG));
            assert!(seen >= 8, "{seen} stars are in view");
            assert!(worst < AGREEMENT_PX, "{worst} px");
        }
    }
}

#[test]
fn a_wrong_lens_or_roll_is_noticed() {
    let [pointing, ..] = pointings();
    let at = dates()[1];
    let [ra, dec, _] = pointing.ra_dec_roll_rad;
    let wrong = [
        Pointing { tangential: [0.0; 2], ..pointing },
        Pointing { radial: [-0.08, 0.0, 0.0], ..pointing },
        Pointing { ra_dec_roll_rad: [ra, dec, 60.0 * ARCSEC], ..pointing },
        Pointing { principal_point_px: [511.5, 509.3], ..pointing },
    ];
    for seen_by in wrong {
        let (worst, _) = worst_px(&pointing, &seen_by, at);
        assert!(worst > AGREEMENT_PX, "{seen_by:?}: {worst} px");
    }
}
