//! `starloop check`, the sky: where the observer is, which targets cross the field, which bodies are near it.
//!
//! Where the observer is at the first exposure, how fast, and what that does to the stars.

use crate::cli::facts::Facts;
use anyhow::Result;
use base::refused::Refused;
use base::time::{Span, Tai};
use base::units::{ARCSEC, DAY_S, SPEED_OF_LIGHT_KM_S};
use glam::DVec3;
use histories::OrbitHistory;
use plan::exposure::ExposurePlan;
use run::runtime::RunParams;
use scene::sky_targets::{SkyTargets, TargetFacts};
use scene::{camera::CameraParams, discs, sky_bodies::SkyBodies};
use sky::astrometry::{CameraGeometry, PROVEN_YEARS, Vantage};
use sky::observer::{Observer, ObserverTrack};
use sky::orbit::{CentralBody, TleOrbit, USUAL_DAYS};
use sky::target::{Orbit, Sunlight};
use testbed::flight_computer::FlightComputer;

/// Distance of the Moon at its furthest, km.
const MOON_KM: f64 = 406_700.0;

/// Writes place, speed, size of the aberration; a warning outside the years for which places are proven.
pub(super) fn write_observer(facts: &mut Facts, params: &RunParams) -> Result<()> {
    let at = params.first_exposure;
    let track = ObserverTrack::new(params.observer.clone(), at);
    let vantage = Vantage::of(&track, at, params.light_deflection)?;
    let speed_km_s = vantage.observer.velocity_km_s.length();
    let aberration_arcsec = speed_km_s / SPEED_OF_LIGHT_KM_S / ARCSEC;
    let bent = if vantage.heliocentric_km.is_some() { "bent by the Sun" } else { "not bent" };
    facts.named("observer").line(format_args!(
        "{}; {speed_km_s:.3} km/s about the barycentre: aberration up to {aberration_arcsec:.2} arcsec; light is \
         {bent}",
        place(&params.observer, at)?
    ));
    write_doubts(facts, &params.observer, at)?;
    if let Observer::Table(history) = &params.observer {
        for warning in &history.warnings {
            facts.warning(format_args!("observer.file: {warning}"));
        }
    }
    write_error(facts, params);
    let last = at + Span::from_s(params.frame_period.s() * f64::from(params.frames));
    if [at, last].into_iter().any(|at| !is_proven(at)) {
        let [first_yr, last_yr] = PROVEN_YEARS;
        facts.warning(format_args!(
            "apparent places are proven to 1 mas from {first_yr} to {last_yr}: some frames are outside those years"
        ));
    }
    Ok(())
}

/// Writes what speaks against the observer's orbit at its first exposure: elements that are old, and a place or speed that
/// few orbits about the Earth have.
fn write_doubts(facts: &mut Facts, observer: &Observer, at: Tai) -> Result<()> {
    if let Observer::Tle(orbit) = observer {
        write_age(facts, "observer", orbit, at);
    }
    let (true, Some(about @ CentralBody::Earth)) = (matches!(observer, Observer::Table(_)), observer.about()) else {
        return Ok(());
    };
    let state = observer.relative_state(at)?;
    let (distance_km, speed_km_s) = (state.position_km.length(), state.velocity_km_s.length());
    let escape_km_s = (2.0 * about.gm_km3_s2() / distance_km).sqrt();
    if distance_km > MOON_KM {
        facts.warning(format_args!(
            "the observer is {distance_km:.0} km from {about}: wanted less than {MOON_KM:.0} km, beyond which is the \
             Moon: check unit and centre of the file"
        ));
    }
    if speed_km_s > escape_km_s {
        facts.warning(format_args!(
            "the observer has {speed_km_s:.3} km/s: {about} holds at {distance_km:.0} km what has less than \
             {escape_km_s:.3} km/s: check units and centre of the file"
        ));
    }
    Ok(())
}

/// Warns of a file of states whose error between rows, as aberration, is over the accuracy of the run.
fn write_error(facts: &mut Facts, params: &RunParams) {
    let Observer::Table(history) = &params.observer else { return };
    let Some([_, km_s]) = history.interpolation_error() else { return };
    let (arcsec, most) = (km_s / SPEED_OF_LIGHT_KM_S / ARCSEC, params.budget.los_arcsec);
    if arcsec > most {
        facts.warning(format_args!(
            "the observer's states err by up to {arcsec:.1e} arcsec of aberration, more than accuracy.los_arcsec = \
             {most}: give denser rows, or velocities with them"
        ));
    }
}

/// Writes a warning about elements that are older than they should be.
pub(super) fn write_age(facts: &mut Facts, what: &str, orbit: &TleOrbit, at: Tai) {
    let days = orbit.days_from_epoch(at);
    if days.abs() <= USUAL_DAYS {
        return;
    }
    let [error_km, error_km_s] = orbit.usual_error(at);
    let arcsec = error_km_s / SPEED_OF_LIGHT_KM_S / ARCSEC;
    facts.warning(format_args!(
        "the elements of {what} are used {days:.1} days from their epoch: SGP4 errs there by some {error_km:.0} \
         km and {error_km_s:.3} km/s in a low orbit, {arcsec:.3} arcsec of aberration; wanted {USUAL_DAYS} days \
         at most"
    ));
}

/// Returns the description of a file of states, and its error between rows.
fn table(history: &OrbitHistory) -> String {
    let method = history.segments().first().map_or_else(String::new, |segment| segment.method().to_string());
    let bound = history.interpolation_error().map_or_else(
        || "too few rows to see how far it errs".to_owned(),
        |[km, km_s]| {
            if km <= 0.0 && km_s <= 0.0 {
                return "exact between rows".to_owned();
            }
            let arcsec = km_s / SPEED_OF_LIGHT_KM_S / ARCSEC;
            format!("errs by less than {km:.1e} km and {km_s:.1e} km/s, {arcsec:.1e} arcsec of aberration")
        },
    );
    let notes: String = history.notes.iter().map(|note| format!("; {note}")).collect();
    format!("{}, {} rows, {method}: {bound}{notes}", history.format, history.rows())
}

fn is_proven(at: Tai) -> bool {
    (PROVEN_YEARS[0]..=PROVEN_YEARS[1]).contains(&(2000.0 + at.years_since_j2000()))
}

fn place(observer: &Observer, at: Tai) -> Result<String> {
    let Some(about) = observer.about() else { return Ok("at rest at the barycentre".into()) };
    let state = observer.relative_state(at)?;
    let days_old = match observer {
        Observer::Geocentre => return Ok("at the centre of the Earth".into()),
        Observer::Tle(orbit) => format!(", elements {:.1} days old", orbit.days_from_epoch(at)),
        Observer::TwoBody { orbit, .. } => format!(", state {:.1} days old", (at - orbit.epoch()).s() / DAY_S),
        Observer::Table(history) => format!(", {}", table(history)),
        Observer::Circular(_) | Observer::Barycentre => String::new(),
    };
    let (distance_km, speed_km_s) = (state.position_km.length(), state.velocity_km_s.length());
    Ok(format!("{distance_km:.0} km from the centre of {about}, {speed_km_s:.3} km/s{days_old}"))
}

// `starloop check`, targets on the sky: when each crosses the field, how far it is then, how fast it goes and how
// bright it is.
//
// Input: a bench, whose simulated flight computer points the camera. Output: a table of passes: one line per target
// and time it is in the field, at the instant when it is nearest to the boresight; a target that stays outside is
// listed with its smallest distance. Steps of a frame, of long runs 4000 in all: a shorter pass may go unseen.

/// Most instants of a run that are looked at.
const MOST_STEPS: u32 = 4_000;

/// A target at one instant.
#[derive(Clone, Copy)]
struct Moment {
    number: u32,
    facts: TargetFacts,
    off_axis_rad: f64,
    /// Rate with respect to the stars on the detector, px/s.
    rate_px_s: f64,
}

/// A time in the field.
struct Pass {
    first: u32,
    last: u32,
    nearest: Moment,
}

/// Writes the section about targets on the sky; nothing without any.
pub(super) fn write_targets(facts: &mut Facts, params: &RunParams, computer: &FlightComputer) {
    if params.sky_targets.is_empty() {
        return;
    }
    let (camera, targets) = (&params.camera, params.sky_targets.clone());
    let observer = ObserverTrack::with_almanac(params.observer.clone(), params.almanac());
    let followed = SkyTargets::new(camera, observer, targets);
    facts.line("targets on the sky: seconds after the first exposure; rates with respect to the stars");
    facts.line(
        "  target      from s    to s    at s  off axis deg   range km    km/s  deg/s    px/s  phase deg     G  \
         light",
    );
    for place in 0..params.sky_targets.len() {
        write_target(facts, params, computer, &followed, place);
    }
    facts.line("");
}

fn write_target(facts: &mut Facts, params: &RunParams, computer: &FlightComputer, targets: &SkyTargets, place: usize) {
    let name = name_of(&params.sky_targets[place].orbit);
    let mut lost = None;
    let (mut passes, mut nearest, mut open): (Vec<Pass>, Option<Moment>, bool) = (Vec::new(), None, false);
    for number in steps(params.frames) {
        let moment = match moment(params, computer, targets, place, number) {
            Ok(moment) => moment,
            Err(error) => {
                lost = Some(error);
                break;
            }
        };
        if nearest.is_none_or(|nearest| moment.off_axis_rad < nearest.off_axis_rad) {
            nearest = Some(moment);
        }
        let is_in = is_in_field(params, computer, &moment);
        match passes.last_mut() {
            Some(pass) if open && is_in => pass.take(moment),
            _ if is_in => passes.push(Pass { first: number, last: number, nearest: moment }),
            _ => {}
        }
        open = is_in;
    }
    for pass in &passes {
        let [from_s, to_s] = [pass.first, pass.last].map(|number| after_first_s(params, number));
        write_moment(facts, params, &format!("  {name:<10} {from_s:>7.1} {to_s:>7.1} "), &pass.nearest);
    }
    write_observer_error(facts, params, &name, &passes);
    if let (true, Some(nearest)) = (passes.is_empty(), nearest) {
        write_moment(facts, params, &format!("  {name:<10} {:>15} ", "never in field"), &nearest);
    }
    if let Orbit::Sgp4(orbit) = &params.sky_targets[place].orbit {
        write_age(facts, &format!("target {name}"), orbit, params.first_exposure);
    }
    if let Some(error) = lost {
        facts.warning(format_args!("target {name} is missing from then on: {error}"));
    }
}

/// Warns of an observer whose file of states errs by more than the accuracy of the run, seen from the target.
fn write_observer_error(facts: &mut Facts, params: &RunParams, name: &str, passes: &[Pass]) {
    let Observer::Table(history) = &params.observer else { return };
    let nearest_km = passes.iter().map(|pass| pass.nearest.facts.range_km).reduce(f64::min);
    let (Some([km, _]), Some(range_km)) = (history.interpolation_error(), nearest_km) else { return };
    let (arcsec, most) = (km / range_km / ARCSEC, params.budget.los_arcsec);
    if arcsec <= most {
        return;
    }
    facts.warning(format_args!(
        "target {name}: the observer's places err by up to {km:.1e} km: {arcsec:.1e} arcsec at {range_km:.1} km, more \
         than accuracy.los_arcsec = {most}"
    ));
}

impl Pass {
    fn take(&mut self, moment: Moment) {
        self.last = moment.number;
        if moment.off_axis_rad < self.nearest.off_axis_rad {
            self.nearest = moment;
        }
    }
}

fn steps(frames: u32) -> impl Iterator<Item = u32> {
    let step = frames.div_ceil(MOST_STEPS).max(1) as usize;
    (0..frames).step_by(step)
}

fn mid_exposure(params: &RunParams, number: u32) -> Tai {
    params.exposure_start(number) + Span::from_s(0.5 * params.camera.exposure_s)
}

fn after_first_s(params: &RunParams, number: u32) -> f64 {
    (params.exposure_start(number) - params.first_exposure).s()
}

fn moment(
    params: &RunParams,
    computer: &FlightComputer,
    targets: &SkyTargets,
    place: usize,
    number: u32,
) -> Result<Moment, Refused> {
    let at = mid_exposure(params, number);
    let facts = targets.facts_at(place, at)?;
    let sensor = in_sensor(params, computer, at, facts.apparent_icrf);
    let focal_px = params.camera.geometry.parameters().focal_px[0];
    Ok(Moment { number, facts, off_axis_rad: sensor.angle_between(DVec3::Z), rate_px_s: facts.rate_rad_s * focal_px })
}

fn in_sensor(params: &RunParams, computer: &FlightComputer, at: Tai, icrf: DVec3) -> DVec3 {
    // Without an attitude the target is placed behind the camera: in no field.
    let Some(truth) = computer.truth(at) else { return DVec3::NEG_Z };
    (params.attitude.sensor_from_body * truth.body_from_icrf).apply(icrf)
}

fn is_in_field(params: &RunParams, computer: &FlightComputer, moment: &Moment) -> bool {
    let camera: &CameraGeometry = &params.camera.geometry;
    let at = mid_exposure(params, moment.number);
    let target = &params.sky_targets;
    let is_there = target.iter().any(|target| target.id == moment.facts.id && (target.begin..target.end).contains(&at));
    let inside = |v: f64, size: usize| (-0.5..size as f64 - 0.5).contains(&v);
    let px = camera.project(in_sensor(params, computer, at, moment.facts.apparent_icrf));
    is_there && px.is_some_and(|[x, y]| inside(x, camera.width_px()) && inside(y, camera.height_px()))
}

fn write_moment(facts: &mut Facts, params: &RunParams, begin: &str, moment: &Moment) {
    let Moment { facts: target, off_axis_rad, rate_px_s, number } = moment;
    let light = if target.clearance_km < 0.0 { "behind the Earth" } else { Sunlight::of_share(target.sunlight).name() };
    facts.line(format_args!(
        "{begin}{:>7.1} {:>13.3} {:>10.1} {:>7.3} {:>6.3} {rate_px_s:>7.1} {:>10.1} {:>5.2}  {light}",
        after_first_s(params, *number),
        off_axis_rad.to_degrees(),
        target.range_km,
        target.range_rate_km_s,
        target.rate_rad_s.to_degrees(),
        target.phase_rad.to_degrees(),
        target.mag_g
    ));
}

fn name_of(orbit: &Orbit) -> String {
    match orbit {
        Orbit::Sgp4(orbit) => orbit.norad_id.to_string(),
        Orbit::Circular(_) => "circular".into(),
        Orbit::TwoBody(_) => "two_body".into(),
    }
}

// Which of Sun, Moon, Earth and planets are in the field of a planned frame, or near it.

/// Bodies whose limb is nearer to the field than this are reported, deg.
const NEAR_DEG: f64 = 10.0;

/// Bodies of one planned frame; nothing when none is near.
pub(super) fn write_frame_bodies(
    facts: &mut Facts,
    bodies: &SkyBodies,
    camera: &CameraParams,
    plan: &ExposurePlan,
) -> Result<()> {
    let los = &plan.motion.los;
    let boresight = los.mid_sensor_from_icrf.inverse().apply(DVec3::Z);
    let field_deg = camera.geometry.half_diagonal_rad().to_degrees();
    let [ifov_x, ifov_y] = camera.geometry.ifov_rad();
    for body in bodies.all(los.mid_exposure())? {
        let off_deg = body.apparent_icrf.angle_between(boresight).to_degrees();
        let limb_deg = off_deg - body.radius_rad.to_degrees();
        if limb_deg > field_deg + NEAR_DEG {
            continue;
        }
        let place = if limb_deg < field_deg { "in the field" } else { "near it" };
        let light = match body.mag_g {
            Some(mag_g) if mag_g > f64::from(camera.limiting_mag) => format!("G {mag_g:.2}, too faint to be drawn"),
            Some(mag_g) => format!("G {mag_g:.2}"),
            None => "sunlit".into(),
        };
        let across_px = 2.0 * body.radius_rad.tan() / ifov_x.min(ifov_y);
        facts.named("body").line(format_args!(
            "{} {place}: middle {off_deg:.3} deg off the axis, limb {limb_deg:.3} deg; {light}, {:.0} % lit, \
             {across_px:.3} px across",
            body.name,
            100.0 * body.lit_share
        ));
    }
    let counts = bodies.counts();
    if counts.occulted > 0 {
        facts.more(format_args!("{} stars hidden by Earth or Moon", counts.occulted));
    }
    if counts.disc_sources > 0 {
        let step_px = counts.coarsest_px;
        let sigma_px = plan.psf.core_sigma_px();
        facts.more(format_args!(
            "discs drawn by {} sources in cells of up to {step_px:.3} px: edges within {:.1e} of their level",
            counts.disc_sources,
            discs::edge_error(step_px, sigma_px)
        ));
        if step_px > 1.0 {
            facts.warning(format_args!(
                "a disc has more pixels than sources are kept for ({:.0}): its light shows as dots, {:.0} % of \
                 its level",
                discs::MOST_CELLS,
                100.0 * discs::ripple(step_px, sigma_px)
            ));
        }
    }
    if counts.has_sun {
        facts.warning("the Sun is in the field: it is not drawn, and no tracker survives it");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::time::Tai;

    #[test]
    fn years_are_printed_on_both_sides() {
        let at = |text: &str| Tai::from_rfc3339(text).unwrap();
        for (text, proven) in [
            ("1990-12-30T00:00:00Z", false),
            ("1991-01-02T00:00:00Z", true),
            ("2050-12-30T00:00:00Z", true),
            ("2051-01-02T00:00:00Z", false),
        ] {
            assert_eq!(is_proven(at(text)), proven, "{text}");
        }
    }

    #[test]
    fn places_are_reported() {
        let at = Tai::from_rfc3339("2026-03-01T00:00:00Z").unwrap();
        assert_eq!(place(&Observer::Barycentre, at).unwrap(), "at rest at the barycentre");
        assert_eq!(place(&Observer::Geocentre, at).unwrap(), "at the centre of the Earth");
        let orbit = sky::orbit::CircularOrbit::new(500.0, 97.4, 30.0, 10.0, at).unwrap();
        let reported = place(&Observer::Circular(orbit), at).unwrap();
        assert_eq!(reported, "6878 km from the centre of the Earth, 7.613 km/s");
    }

    fn doubts(observer: &Observer, at: Tai) -> String {
        let mut facts = Facts::indented();
        write_doubts(&mut facts, observer, at).unwrap();
        facts.text()
    }

    /// Rows on a circular orbit about the Earth, 6 minutes at least, so many seconds apart.
    fn warned(step_s: f64) -> String {
        let mut rows = String::from("unix_s,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s\n");
        for step in 0..=(400.0 / step_s).ceil().max(6.0) as u32 {
            let t_s = f64::from(step) * step_s;
            let (sin, cos) = (1.078e-3 * t_s).sin_cos();
            rows += &format!(
                "{},{},{},0,{},{},0\n",
                1_772_323_200.0 + t_s,
                7000.0 * cos,
                7000.0 * sin,
                -7.546 * sin,
                7.546 * cos
            );
        }
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("o.csv"), rows).unwrap();
        let text = "[observer]\nkind = \"file\"\nfile = \"o.csv\"\n";
        let document = config::Document::from_text(text, &folder.path().join("lab.toml"));
        let bench = config::Bench::from_document(&document).unwrap();
        let params =
            run::wiring::bench_parts::run_params(&bench, Tai::from_rfc3339("2026-03-01T00:00:00Z").unwrap()).unwrap();
        let mut facts = Facts::indented();
        write_error(&mut facts, &params);
        facts.text()
    }

    #[test]
    fn old_elements_are_warned_of_with_their_error() {
        let lines = "1 00005U 58002B   00179.78495062  .00000023  00000-0  28098-4 0  4753\n\
            2 00005  34.2682 348.7242 1859667 331.7664  19.3264 10.82419157413667";
        let observer = Observer::Tle(Box::new(TleOrbit::parse(lines).unwrap()));
        let at = |text: &str| Tai::from_rfc3339(text).unwrap();
        assert_eq!(doubts(&observer, at("2000-07-04T00:00:00Z")), "", "within a week");
        let reported = doubts(&observer, at("2000-07-07T18:50:20Z"));
        for part in
            ["  WARNING      the elements of observer are used 10.0 days", "30 km and 0.024 km/s", "0.016 arcsec"]
        {
            assert!(reported.contains(part), "no \"{part}\" in {reported}");
        }
    }

    #[test]
    fn a_file_beyond_the_moon_or_faster_than_escape_is_warned_of() {
        let table = |x_km: f64, vy_km_s: f64| {
            let row = |t: f64| format!("{},{x_km},{},0,0,{vy_km_s},0\n", 1_772_323_200.0 + t, vy_km_s * t);
            let text = format!("unix_s,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s\n{}{}", row(0.0), row(1.0));
            let history = histories::read::orbit("rows.csv", &text).unwrap();
            let at = Tai::from_ns(history.span_ns()[0]);
            doubts(&Observer::Table(std::sync::Arc::new(history)), at)
        };
        assert_eq!(table(7_000.0, 7.5), "");
        assert_eq!(table(400_000.0, 1.0), "");
        let far = table(500_000.0, 1.0);
        assert!(far.contains("WARNING") && far.contains("500000 km") && far.contains("406700"), "{far}");
        let fast = table(7_000.0, 11.0);
        assert!(fast.contains("WARNING") && fast.contains("11.000 km/s") && fast.contains("10.672"), "{fast}");
    }

    #[test]
    fn the_error_of_sparse_states_is_a_warning_and_that_of_dense_ones_is_not() {
        assert_eq!(warned(10.0), "");
        let text = warned(1500.0);
        assert!(text.contains("WARNING") && text.contains("accuracy.los_arcsec"), "{text}");
    }

    #[test]
    fn a_file_is_reported_with_its_error() {
        let mut rows = String::from("unix_s,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s\n");
        for step in 0..5 {
            let (sin, cos) = (1.1e-3 * 60.0 * f64::from(step)).sin_cos();
            let (x, y, v) = (7000.0 * cos, 7000.0 * sin, 7.7);
            rows += &format!("{},{x},{y},0,{},{},0\n", 1_772_323_200 + 60 * step, -v * sin, v * cos);
        }
        let history = histories::read::orbit("rows.csv", &rows).unwrap();
        let at = Tai::from_ns(history.span_ns()[0]);
        let reported = place(&Observer::Table(std::sync::Arc::new(history)), at).unwrap();
        for part in
            ["7000 km from the centre of the Earth", "5 rows", "Hermite of degree 3", "errs by less than 5.", "e-3 km"]
        {
            assert!(reported.contains(part), "no \"{part}\" in {reported}");
        }
    }
}
