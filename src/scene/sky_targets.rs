//! Orbits, observer, line of sight -> the targets on the sky that one exposure may see.
//!
//! In: targets about the Earth, the observer's orbit, the exposure. Out: [`Target`]s whose trajectories are the cubics
//! through four positions of the exposure ([`SkyPath`], with its bound), whose light is sampled at 17 instants, and the
//! facts about each ([`TargetFacts`]). Cost: two evaluations of every orbit per frame, eight more of those that are
//! near the field; nothing is allocated after start. Light time is `sky::target`'s, aberration by the observer's motion
//! that of stars.
//!
//! A target behind the Earth's limb is not drawn; if it sets or rises within the exposure its light ends at that
//! instant (one edge per exposure: a target that is hidden for less than an exposure in its middle is drawn
//! throughout). A target in the umbra is not drawn either. A target that SGP4 can no longer follow is lost for the rest
//! of the run, and counted once. Tests: below; `hil_scripts/tests/test_targets.py` against another program.

use crate::camera::{self, CameraParams};
use base::time::{Span, Tai};
use base::{bisection::halved, refused::Refused};
use core::f64::consts::PI;
use glam::DVec3;
use plan::exposure::sky_path::{Cubic, Fall, PATH_INSTANTS};
use plan::exposure::{LightCurve, Shutter, SkyPath, Target, TargetWay};
use plan::{attitude::LosPath, exposure::target::LIGHT_SAMPLES, optics::StarLight};
use sky::astrometry::{CameraGeometry, aberrated};
use sky::observer::{BarycentricState, ObserverTrack};
use sky::orbit::{CentralBody, EARTH_GM_KM3_S2};
use sky::target::{Brightness, Orbit, Sighting, limb_clearance_km, sunlight};

/// Distance outside the field up to which directions are followed, px: footprints and jitter.
const MARGIN_PX: f64 = 128.0;
/// Largest error of a trajectory before the frame is reported as over its budget, px.
pub const WAY_BUDGET_PX: f64 = 0.01;
/// Number of halvings of an exposure to find when a target sets: nanoseconds of a minute.
const LIMB_HALVINGS: u32 = 36;

/// One target on the sky.
#[derive(Debug, Clone)]
pub struct SkyTarget {
    /// Identifier in truth tables.
    pub id: u32,
    /// Its orbit.
    pub orbit: Orbit,
    /// Its brightness.
    pub brightness: Brightness,
    /// Its colour, Gaia BP-RP.
    pub bp_rp: f64,
    /// Time from which it exists.
    pub begin: Tai,
    /// Time from which it no longer exists.
    pub end: Tai,
}

/// Facts about a target at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetFacts {
    /// Its identifier.
    pub id: u32,
    /// Apparent direction, ICRF axes.
    pub apparent_icrf: DVec3,
    /// Distance, km.
    pub range_km: f64,
    /// Rate of change of the distance, km/s.
    pub range_rate_km_s: f64,
    /// Angular rate of the direction relative to the stars, rad/s.
    pub rate_rad_s: f64,
    /// Angle at the target between Sun and observer, rad.
    pub phase_rad: f64,
    /// Visible share of the Sun at the target.
    pub sunlight: f64,
    /// Magnitude in that light, Gaia G; infinite in the umbra.
    pub mag_g: f64,
    /// Height of the line of sight above the Earth's limb, km; negative behind it.
    pub clearance_km: f64,
}

/// Observer and Sun at one instant, from the geocentre.
#[derive(Debug, Clone, Copy)]
struct Vantage {
    at: Tai,
    observer: BarycentricState,
    /// Barycentric velocity of the geocentre, km/s.
    earth_km_s: DVec3,
    sun_km: DVec3,
}

/// The targets on the sky followed by one camera.
#[derive(Debug, Clone)]
pub struct SkyTargets {
    targets: Vec<SkyTarget>,
    is_lost: Vec<bool>,
    observer: ObserverTrack,
    camera: CameraGeometry,
    /// Time from the first row's exposure to the last one's, s.
    rows_s: f64,
    light: StarLight,
    in_view: Vec<Target>,
    facts: Vec<TargetFacts>,
    /// True when the error of a trajectory may exceed [`WAY_BUDGET_PX`].
    pub is_coarse: bool,
}

impl SkyTargets {
    /// Returns `targets` seen through a camera by this observer.
    pub fn new(camera: &CameraParams, observer: ObserverTrack, targets: Vec<SkyTarget>) -> Self {
        Self::with_optics(camera.geometry, camera.shutter, camera.radiometry.clone(), observer, targets)
    }

    /// Returns the same from the needed parameters of a camera.
    fn with_optics(
        camera: CameraGeometry,
        shutter: Shutter,
        light: StarLight,
        observer: ObserverTrack,
        targets: Vec<SkyTarget>,
    ) -> Self {
        Self {
            is_lost: vec![false; targets.len()],
            in_view: Vec::with_capacity(targets.len()),
            facts: Vec::with_capacity(targets.len()),
            observer,
            camera,
            rows_s: shutter.line_s() * (camera.height_px() as f64 - 1.0),
            light,
            targets,
            is_coarse: false,
        }
    }

    /// Returns the targets.
    pub fn targets(&self) -> &[SkyTarget] {
        &self.targets
    }

    /// Finds the targets that an exposure may see; returns how many were lost since the last call.
    ///
    /// # Errors
    /// When the observer's own orbit cannot be computed at that time.
    pub fn find_in_view(&mut self, los: &LosPath) -> Result<u32, Refused> {
        self.forget();
        if self.targets.is_empty() {
            return Ok(0);
        }
        let half_s = 0.5 * (los.exposure_s + self.rows_s);
        let vantage = self.vantage(los.mid_exposure()).map_err(camera::observer)?;
        let exposure = self.exposure(vantage, half_s).map_err(camera::observer)?;
        let mut lost = 0;
        for place in 0..self.targets.len() {
            if self.is_lost[place] {
                continue;
            }
            if self.take(place, &exposure, los).is_err() {
                self.is_lost[place] = true;
                lost += 1;
            }
        }
        Ok(lost)
    }

    /// Leaves out targets for which `is_hidden` is true at mid-exposure.
    pub fn leave_out(&mut self, is_hidden: impl Fn(&TargetFacts) -> bool) {
        for place in (0..self.facts.len()).rev() {
            if is_hidden(&self.facts[place]) {
                self.facts.remove(place);
                self.in_view.remove(place);
            }
        }
    }

    /// Clears the targets in view.
    pub fn forget(&mut self) {
        self.in_view.clear();
        self.facts.clear();
        self.is_coarse = false;
    }

    /// Returns the targets of the latest exposure.
    pub fn in_view(&self) -> &[Target] {
        &self.in_view
    }

    /// Returns the facts at mid-exposure, in the same order.
    pub fn facts(&self) -> &[TargetFacts] {
        &self.facts
    }

    /// Returns its observer, so that callers can add states from outside.
    pub fn observer_mut(&mut self) -> &mut ObserverTrack {
        &mut self.observer
    }

    /// Returns the facts about target `place` at `at`, for any position.
    ///
    /// # Errors
    /// When its orbit, or the observer's, cannot be computed.
    pub fn facts_at(&self, place: usize, at: Tai) -> Result<TargetFacts, Refused> {
        let vantage = self.vantage(at)?;
        let sighting = sight(&self.targets[place].orbit, &vantage)?;
        Ok(self.facts_of(&self.targets[place], &sighting, &vantage))
    }

    fn vantage(&self, at: Tai) -> Result<Vantage, Refused> {
        let observer = self.observer.geocentric_state(at)?.ok_or_else(|| {
            Refused(
                "Sun, Moon and Earth: wanted an observer near the Earth, got one at rest at the barycentre".to_owned(),
            )
        })?;
        let earth_km_s = self.observer.barycentric_state(at)?.velocity_km_s - observer.velocity_km_s;
        let sun_km = self.observer.bodies(at)?.sun_km + observer.position_km;
        Ok(Vantage { at, observer, earth_km_s, sun_km })
    }

    fn exposure(&self, vantage: Vantage, half_s: f64) -> Result<Exposure, Refused> {
        let mut observers = [BarycentricState::default(); PATH_INSTANTS];
        let mut fall = Fall::NONE;
        for (state, t_s) in observers.iter_mut().zip(SkyPath::instants_s(half_s)) {
            let at = vantage.at + Span::from_s(t_s);
            *state = self.observer.geocentric_state(at)?.ok_or_else(|| {
                Refused(
                    "Sun, Moon and Earth: wanted an observer near the Earth, got one at rest at the barycentre"
                        .to_owned(),
                )
            })?;
            fall = nearer(fall, fall_of(&self.observer, state, at)?);
        }
        let observer_km = Cubic::through(observers.map(|state| state.position_km), half_s);
        Ok(Exposure { vantage, half_s, observers, observer_km, fall })
    }

    fn facts_of(&self, target: &SkyTarget, sighting: &Sighting, vantage: &Vantage) -> TargetFacts {
        let target_km = sighting.target.position_km;
        let range_km = sighting.range_km();
        let phase_rad = sighting.phase_rad(vantage.sun_km);
        let sunlight = sunlight(target_km, vantage.sun_km);
        let full = target.brightness.mag_g(range_km, phase_rad, vantage.sun_km.distance(target_km));
        let velocity = vantage.earth_km_s + vantage.observer.velocity_km_s;
        TargetFacts {
            id: target.id,
            apparent_icrf: aberrated(sighting.from_observer_km.normalize(), velocity),
            range_km,
            range_rate_km_s: sighting.range_rate_km_s(),
            rate_rad_s: sighting.rate_rad_s(),
            phase_rad,
            sunlight,
            mag_g: full - 2.5 * sunlight.log10(),
            clearance_km: limb_clearance_km(vantage.observer.position_km, target_km),
        }
    }

    /// Adds a target if it may be visible.
    fn take(&mut self, place: usize, exposure: &Exposure, los: &LosPath) -> Result<(), Refused> {
        let target = &self.targets[place];
        let facts = self.facts_of(target, &sight(&target.orbit, &exposure.vantage)?, &exposure.vantage);
        if !self.is_near(&facts, exposure, los) {
            return Ok(());
        }
        let way = exposure.way(&target.orbit)?;
        let Some([begin, end]) = exposure.seen(&way, [target.begin, target.end]) else { return Ok(()) };
        let Some((e_per_s, light)) = self.light_curve(target, &way, exposure) else { return Ok(()) };
        let [ifov_x, ifov_y] = self.camera.ifov_rad();
        self.is_coarse |= way.bound_km > WAY_BUDGET_PX * ifov_x.min(ifov_y) * facts.range_km;
        #[allow(clippy::cast_possible_truncation, reason = "magnitudes are single precision")]
        let mag = self.light.mag_instrument(facts.mag_g, target.bp_rp) as f32;
        let (id, way) = (target.id, TargetWay::Sky(way.path));
        self.in_view.push(Target { id, mag, e_per_s, begin, end, way, light: Some(light) });
        self.facts.push(facts);
        Ok(())
    }

    /// Returns true when a target may come into the field while the camera and it move.
    fn is_near(&self, facts: &TargetFacts, exposure: &Exposure, los: &LosPath) -> bool {
        let [ifov_x, ifov_y] = self.camera.ifov_rad();
        let boresight = los.mid_sensor_from_icrf.inverse().apply(DVec3::Z);
        // A pass may speed up, at most to the speed at the nearest possible point.
        let moves_km = (facts.range_rate_km_s.hypot(facts.rate_rad_s * facts.range_km)) * exposure.half_s;
        let own_rad = if moves_km < 0.5 * facts.range_km { 2.0 * moves_km / facts.range_km } else { PI };
        let sweep_rad = los.rate_rad_s.length() * 2.0 * exposure.half_s;
        let reach_rad = self.camera.half_diagonal_rad() + MARGIN_PX * ifov_x.max(ifov_y) + own_rad + sweep_rad;
        facts.apparent_icrf.angle_between(boresight) < reach_rad
    }

    /// Returns its largest light, e-/s, and shares of that; `None` when it is dark all the time.
    fn light_curve(&self, target: &SkyTarget, way: &Way, exposure: &Exposure) -> Option<(f64, LightCurve)> {
        let sun_km = exposure.vantage.sun_km;
        let e_per_s = LightCurve::instants_s(exposure.half_s).map(|t_s| {
            let (from_km, target_km) = (way.path.from_observer_km(t_s), exposure.target_km(way, t_s));
            let phase_rad = (sun_km - target_km).angle_between(-from_km);
            let mag_g = target.brightness.mag_g(from_km.length(), phase_rad, sun_km.distance(target_km));
            sunlight(target_km, sun_km) * self.light.electrons(mag_g, target.bp_rp, 1.0)
        });
        let most = e_per_s.into_iter().fold(0.0, f64::max);
        let shares: [f64; LIGHT_SAMPLES] = e_per_s.map(|e_per_s| e_per_s / most);
        (most > 0.0).then_some((most, LightCurve { half_s: exposure.half_s, shares }))
    }
}

/// Returns the gravity that acts on the observer: its central body and the distance from its centre.
fn fall_of(observer: &ObserverTrack, geocentric: &BarycentricState, at: Tai) -> Result<Fall, Refused> {
    let radius_km = match observer.about() {
        None => 0.0,
        Some(CentralBody::Earth) => geocentric.position_km.length(),
        Some(CentralBody::Moon | CentralBody::Sun) => observer.relative_state(at)?.position_km.length(),
    };
    let gm_km3_s2 = observer.about().map_or(0.0, CentralBody::gm_km3_s2);
    // At the geocentre gravity vanishes.
    Ok(if radius_km > 1.0 { Fall { gm_km3_s2, radius_km } } else { Fall::NONE })
}

/// Returns the gravity at the smaller of two distances from the same body.
fn nearer(a: Fall, b: Fall) -> Fall {
    if a == Fall::NONE || b.radius_km < a.radius_km { b } else { a }
}

fn sight(orbit: &Orbit, vantage: &Vantage) -> Result<Sighting, Refused> {
    Sighting::of(orbit, &vantage.observer, vantage.earth_km_s, vantage.at)
}

/// The observer over one exposure.
#[derive(Debug, Clone, Copy)]
struct Exposure {
    vantage: Vantage,
    half_s: f64,
    observers: [BarycentricState; PATH_INSTANTS],
    observer_km: Cubic,
    fall: Fall,
}

/// A target over one exposure.
#[derive(Debug, Clone, Copy)]
struct Way {
    path: SkyPath,
    bound_km: f64,
    light_time_s: f64,
}

impl Exposure {
    fn way(&self, orbit: &Orbit) -> Result<Way, Refused> {
        let Vantage { at, earth_km_s, .. } = self.vantage;
        let (mut places, mut light_time_s) = ([DVec3::ZERO; PATH_INSTANTS], 0.0);
        let mut radius_km = f64::INFINITY;
        for (i, t_s) in SkyPath::instants_s(self.half_s).into_iter().enumerate() {
            let sighting = Sighting::of(orbit, &self.observers[i], earth_km_s, at + Span::from_s(t_s))?;
            places[i] = sighting.from_observer_km;
            light_time_s += sighting.light_time_s / PATH_INSTANTS as f64;
            radius_km = radius_km.min(sighting.target.position_km.length());
        }
        let falls = [Fall { gm_km3_s2: EARTH_GM_KM3_S2, radius_km }, self.fall];
        let [first, .., last] = self.observers.map(|state| state.velocity_km_s + earth_km_s);
        let path = SkyPath::through(places, self.half_s, [first, last]);
        Ok(Way { path, bound_km: SkyPath::bound_km(self.half_s, falls), light_time_s })
    }

    /// Returns the position of the target from the geocentre when the light left, km.
    fn target_km(&self, way: &Way, t_s: f64) -> DVec3 {
        let earth_moved_km = self.vantage.earth_km_s * way.light_time_s;
        way.path.from_observer_km(t_s) + earth_moved_km + self.observer_km.at(t_s)
    }

    /// Returns when a target is above the limb, within the time of its existence.
    fn seen(&self, way: &Way, [begin, end]: [Tai; 2]) -> Option<[Tai; 2]> {
        let is_above = |t_s: f64| limb_clearance_km(self.observer_km.at(t_s), self.target_km(way, t_s)) > 0.0;
        let (first, last) = (-self.half_s, self.half_s);
        let at = |t_s: f64| self.vantage.at + Span::from_s(t_s);
        match (is_above(first), is_above(last)) {
            (true, true) => Some([begin, end]),
            (false, false) => None,
            (rises_not, _) => {
                // Above the limb at one end, below it at the other.
                let ends = if rises_not { [first, last] } else { [last, first] };
                let [above, _] = halved(ends, LIMB_HALVINGS, is_above);
                Some(if rises_not { [begin, end.min(at(above))] } else { [begin.max(at(above)), end] })
            }
        }
    }
}

#[cfg(test)]
#[path = "sky_targets_tests.rs"]
mod tests;
