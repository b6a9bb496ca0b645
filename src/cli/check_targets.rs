//! `starloop check`, targets on the sky: when each crosses the field, how far it is then, how fast it goes and how
//! bright it is.
//!
//! Input: a bench, whose simulated flight computer points the camera. Output: a table of passes: one line per target
//! and time it is in the field, at the instant when it is nearest to the boresight; a target that stays outside is
//! listed with its smallest distance. Steps of a frame, of long runs 4000 in all: a shorter pass may go unseen.

use crate::cli::check_observer::write_age;
use base::{refused::Refused, time::Tai, units::ARCSEC};
use core::fmt::{Error, Write};
use glam::DVec3;
use run::runtime::RunParams;
use scene::sky_targets::{SkyTargets, TargetFacts};
use sky::astrometry::CameraGeometry;
use sky::observer::{Observer, ObserverTrack};
use sky::target::{Orbit, Sunlight};
use testbed::flight_computer::FlightComputer;

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
///
/// # Errors
/// When the text cannot grow.
pub(super) fn write_targets(text: &mut String, params: &RunParams, computer: &FlightComputer) -> Result<(), Error> {
    if params.sky_targets.is_empty() {
        return Ok(());
    }
    let (camera, targets) = (&params.camera, params.sky_targets.clone());
    let observer = ObserverTrack::with_almanac(params.observer.clone(), params.almanac());
    let followed = SkyTargets::new(camera, observer, targets);
    writeln!(text, "targets on the sky: seconds after the first exposure; rates with respect to the stars")?;
    writeln!(
        text,
        "  target      from s    to s    at s  off axis deg   range km    km/s  deg/s    px/s  phase deg     G  light"
    )?;
    for place in 0..params.sky_targets.len() {
        write_target(text, params, computer, &followed, place)?;
    }
    text.write_char('\n')
}

fn write_target(
    text: &mut String,
    params: &RunParams,
    computer: &FlightComputer,
    targets: &SkyTargets,
    place: usize,
) -> Result<(), Error> {
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
        write!(text, "  {name:<10} {from_s:>7.1} {to_s:>7.1} ")?;
        write_moment(text, params, &pass.nearest)?;
    }
    write_observer_error(text, params, &name, &passes)?;
    if let (true, Some(nearest)) = (passes.is_empty(), nearest) {
        write!(text, "  {name:<10} {:>15} ", "never in field")?;
        write_moment(text, params, &nearest)?;
    }
    if let Orbit::Sgp4(orbit) = &params.sky_targets[place].orbit {
        write_age(text, &format!("target {name}"), orbit, params.first_exposure)?;
    }
    match lost {
        Some(error) => writeln!(text, "  WARNING      target {name} is missing from then on: {error}"),
        None => Ok(()),
    }
}

/// Warns of an observer whose file of states errs by more than the accuracy of the run, seen from the target.
fn write_observer_error(text: &mut String, params: &RunParams, name: &str, passes: &[Pass]) -> Result<(), Error> {
    let Observer::Table(history) = &params.observer else { return Ok(()) };
    let nearest_km = passes.iter().map(|pass| pass.nearest.facts.range_km).reduce(f64::min);
    let (Some([km, _]), Some(range_km)) = (history.interpolation_error(), nearest_km) else { return Ok(()) };
    let (arcsec, most) = (km / range_km / ARCSEC, params.budget.los_arcsec);
    if arcsec <= most {
        return Ok(());
    }
    writeln!(
        text,
        "  {name:<10}  WARNING the observer's places err by up to {km:.1e} km: {arcsec:.1e} arcsec at {range_km:.1} km, more than \
         accuracy.los_arcsec = {most}"
    )
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
    params.exposure_start(number) + base::time::Span::from_s(0.5 * params.camera.exposure_s)
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

fn write_moment(text: &mut String, params: &RunParams, moment: &Moment) -> Result<(), Error> {
    let Moment { facts, off_axis_rad, rate_px_s, number } = moment;
    let light = if facts.clearance_km < 0.0 { "behind the Earth" } else { Sunlight::of_share(facts.sunlight).name() };
    writeln!(
        text,
        "{:>7.1} {:>13.3} {:>10.1} {:>7.3} {:>6.3} {rate_px_s:>7.1} {:>10.1} {:>5.2}  {light}",
        after_first_s(params, *number),
        off_axis_rad.to_degrees(),
        facts.range_km,
        facts.range_rate_km_s,
        facts.rate_rad_s.to_degrees(),
        facts.phase_rad.to_degrees(),
        facts.mag_g,
    )
}

fn name_of(orbit: &Orbit) -> String {
    match orbit {
        Orbit::Sgp4(orbit) => orbit.norad_id.to_string(),
        Orbit::Circular(_) => "circular".into(),
        Orbit::TwoBody(_) => "two_body".into(),
    }
}
