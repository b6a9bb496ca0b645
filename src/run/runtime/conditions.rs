//! Conditions of one exposure under commanded faults: light, optics, temperature, sources.
//!
//! In: the amounts of a frame's faults. Out: changed sources, and numbers for the planner and the detector. Without
//! faults the sources pass unchanged and nothing is computed. Nothing here allocates after construction. Dark current
//! follows temperature by the camera's own law (`image::detector::dark_current`).

use base::axes::{Icrf, Rotation, Sensor};
use base::random::{key, philox};
use base::region::Regions;
use frames::camera_control::CameraSettings;
use image::detector::protons::ProtonFlux;
use image::detector::{Background, DetectorConditions};
use plan::exposure::{Source, SourcePlace};
use plan::exposure::{target::FIRST_BODY_ID, track::StarPlace};
use sky::astrometry::CameraGeometry;

/// Capacity for sources reserved before the run.
const SOURCES_RESERVED: usize = 16_384;
/// Last counter word of the random numbers of faults; no detector stage uses it.
pub(super) const FAULT_STREAM: u32 = 0x6661_756c;
/// Largest number of false stars at one time.
pub const FALSE_STARS_MAX: usize = 4096;

/// Catalog stars that are not drawn.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Missing {
    /// Share of all stars that is missing.
    pub(super) share: f64,
    /// Random stream that selects them, together with the seed.
    pub(super) stream: u32,
    /// Number of the brightest stars on the detector that are missing as well.
    pub(super) brightest: usize,
}

/// The conditions of one frame.
#[derive(Debug)]
pub struct Conditions {
    /// Stray light in every pixel, e-/s.
    pub(super) stray_e_per_s: f64,
    /// Additional light in every pixel, e-.
    pub(super) flood_e: f64,
    /// Ratio of the sources' electrons to those of the camera's own exposure time.
    light_factor: f64,
    /// Factor of the image's numbers, and black level, DN.
    gain_and_black: (f64, f64),
    /// Parts of the image that are read out.
    regions: Regions,
    /// Share of the light of stars, targets and sky that comes through.
    pub(super) throughput: f64,
    /// Temperature above the camera's own, K.
    pub(super) warmer_k: f64,
    /// Proton flux that replaces the camera's own.
    pub(super) protons: Option<ProtonFlux>,
    /// Index of the optics: 0 for the camera's own.
    pub(super) optics: usize,
    /// Stars that are left out.
    pub(super) missing: Missing,
    /// Stars that are not in any catalog.
    pub(super) false_stars: Vec<Source>,
    sources: Vec<Source>,
    on_detector_e: Vec<f64>,
}

impl Conditions {
    /// Returns conditions without faults.
    pub fn new() -> Self {
        Self {
            stray_e_per_s: 0.0,
            flood_e: 0.0,
            light_factor: 1.0,
            gain_and_black: (1.0, 0.0),
            regions: Regions::WHOLE,
            throughput: 1.0,
            warmer_k: 0.0,
            protons: None,
            optics: 0,
            missing: Missing::default(),
            false_stars: Vec::new(),
            sources: Vec::new(),
            on_detector_e: Vec::new(),
        }
    }

    /// Reserves memory, before the run.
    pub(super) fn reserve(&mut self) {
        self.false_stars.reserve(FALSE_STARS_MAX);
        self.sources.reserve(SOURCES_RESERVED + FALSE_STARS_MAX);
        self.on_detector_e.reserve(SOURCES_RESERVED);
    }

    /// Sets how much longer than the camera's own the next exposure lasts, and its settings.
    pub(super) fn set_exposing(&mut self, light_factor: f64, settings: &CameraSettings) {
        self.light_factor = light_factor;
        self.gain_and_black = (settings.gain_factor(), settings.black_level_dn);
        self.regions = settings.regions;
    }

    /// Resets to conditions without faults.
    pub(super) fn reset(&mut self) {
        self.false_stars.clear();
        self.stray_e_per_s = 0.0;
        self.flood_e = 0.0;
        self.throughput = 1.0;
        self.warmer_k = 0.0;
        self.protons = None;
        self.optics = 0;
        self.missing = Missing::default();
    }

    /// Returns the conditions of the detector, with the background dimmed to the share that passes the optics.
    #[allow(clippy::cast_possible_truncation, reason = "electrons are single precision")]
    pub(super) fn of_detector(&self, exposure_s: f64, background: Background) -> DetectorConditions {
        let stray_light_e = (self.throughput * self.stray_e_per_s * exposure_s + self.flood_e) as f32;
        let background = self.dimmed(background).and_uniform(stray_light_e);
        let (gain_factor, black_level_dn) = self.gain_and_black;
        let (warmer_k, protons, black_level_dn) = (self.warmer_k, self.protons, Some(black_level_dn));
        let regions = self.regions;
        DetectorConditions { exposure_s, background, warmer_k, protons, gain_factor, black_level_dn, regions }
    }

    #[allow(clippy::cast_possible_truncation, reason = "electrons are single precision")]
    fn dimmed(&self, background: Background) -> Background {
        let share = self.throughput as f32;
        let Background { uniform_e, gradient_e, quadratic_e, sky_e } = background;
        Background {
            uniform_e: uniform_e * share,
            gradient_e: gradient_e.map(|e| e * share),
            quadratic_e: quadratic_e * share,
            sky_e: sky_e * share,
        }
    }

    fn leaves_sources(&self) -> bool {
        let all_light = self.throughput >= 1.0 && self.light_factor == 1.0;
        all_light && self.missing == Missing::default() && self.false_stars.is_empty()
    }

    /// Returns the sources as the camera sees them. Bodies are never among the missing stars.
    pub(super) fn seen<'a>(
        &'a mut self,
        sources: &'a [Source],
        camera: &CameraGeometry,
        sensor_from_icrf: &Rotation<Sensor, Icrf>,
        seed: u64,
    ) -> &'a [Source] {
        if self.leaves_sources() {
            return sources;
        }
        let Missing { share, stream, brightest } = self.missing;
        let on_detector = |source: &Source| {
            let place = match source.place {
                SourcePlace::Icrf(direction) => StarPlace::of_direction(camera, sensor_from_icrf.apply(direction)),
                SourcePlace::Pixel(px) => StarPlace::of_pixel(camera, px),
            };
            place.is_some_and(|StarPlace { mid_px: [x, y], .. }| {
                let inside = |v: f64, size: usize| v > -0.5 && v < size as f64 - 0.5;
                inside(x, camera.width_px()) && inside(y, camera.height_px())
            })
        };
        let is_body = |source: &Source| source.id >= FIRST_BODY_ID;
        let is_kept = |source: &Source| share <= 0.0 || is_body(source) || lot(source.id, stream, seed) >= share;
        let limit_e = if brightest == 0 {
            f64::INFINITY
        } else {
            self.on_detector_e.clear();
            self.on_detector_e
                .extend(sources.iter().filter(|s| !is_body(s) && on_detector(s)).map(|source| source.electrons));
            nth_brightest(&mut self.on_detector_e, brightest)
        };
        self.sources.clear();
        let seen = sources.iter().filter(|source| is_kept(source));
        let stays = |source: &&Source| source.electrons < limit_e || is_body(source) || !on_detector(source);
        self.sources.extend(seen.filter(stays));
        self.sources.extend_from_slice(&self.false_stars);
        for source in &mut self.sources {
            source.electrons *= self.throughput * self.light_factor;
        }
        &self.sources
    }
}

impl Default for Conditions {
    fn default() -> Self {
        Self::new()
    }
}

/// Returns a pseudo-random number in [0, 1) that is fixed for each source.
fn lot(id: u32, stream: u32, seed: u64) -> f64 {
    f64::from(philox([id, stream, 1, FAULT_STREAM], key(seed))[0]) / 4_294_967_296.0
}

/// Returns the electrons of the star of this rank, brightest first; 0 when there are fewer stars.
fn nth_brightest(electrons: &mut [f64], rank: usize) -> f64 {
    if rank > electrons.len() {
        return 0.0;
    }
    *electrons.select_nth_unstable_by(rank - 1, |a, b| b.total_cmp(a)).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use sky::astrometry::{BrownConrady, CameraParameters};

    fn camera() -> CameraGeometry {
        CameraGeometry::new(CameraParameters {
            width_px: 100,
            height_px: 80,
            focal_px: [1000.0; 2],
            principal_point_px: [49.5, 39.5],
            distortion: BrownConrady::default(),
        })
        .unwrap()
    }

    fn star(id: u32, electrons: f64, x: f64) -> Source {
        Source { id, electrons, mag: 5.0, place: SourcePlace::Pixel([x, 40.0]) }
    }

    fn seen(conditions: &mut Conditions, sources: &[Source]) -> Vec<(u32, f64)> {
        let seen = conditions.seen(sources, &camera(), &Rotation::IDENTITY, 7);
        seen.iter().map(|source| (source.id, source.electrons)).collect()
    }

    #[test]
    fn conditions_without_faults_change_and_copy_nothing() {
        let sources = [star(1, 10.0, 5.0), star(2, 20.0, 6.0)];
        let mut conditions = Conditions::new();
        let untouched = conditions.seen(&sources, &camera(), &Rotation::IDENTITY, 7);
        assert!(core::ptr::eq(untouched, &sources[..]));
    }

    #[test]
    fn the_brightest_on_the_detector_are_missing_and_no_other() {
        let sources = [star(1, 10.0, 5.0), star(2, 99.0, 300.0), star(3, 30.0, 6.0), star(4, 20.0, 7.0)];
        let mut conditions = Conditions::new();
        conditions.missing.brightest = 2;
        assert_eq!(seen(&mut conditions, &sources), [(1, 10.0), (2, 99.0)], "the second is not on the detector");
        conditions.missing.brightest = 9;
        assert_eq!(seen(&mut conditions, &sources), [(2, 99.0)], "more than there are");
    }

    #[test]
    fn a_share_is_missing_and_it_is_the_same_one_in_every_frame() {
        let sources: Vec<Source> = (0..4000).map(|id| star(id, 10.0, 5.0)).collect();
        let mut conditions = Conditions::new();
        conditions.missing = Missing { share: 0.3, stream: 1, brightest: 0 };
        let first = seen(&mut conditions, &sources);
        assert_eq!(first, seen(&mut conditions, &sources));
        // Five sigma of a binomial.
        assert!((first.len() as f64 - 2800.0).abs() < 5.0 * (4000.0_f64 * 0.3 * 0.7).sqrt(), "{}", first.len());
        conditions.missing.stream = 2;
        assert_ne!(first, seen(&mut conditions, &sources), "another fault leaves out others");
    }

    #[test]
    fn dirt_dims_everything_and_false_stars_are_added() {
        let mut conditions = Conditions::new();
        conditions.throughput = 0.5;
        conditions.false_stars.push(star(77, 8.0, 9.0));
        assert_eq!(seen(&mut conditions, &[star(1, 10.0, 5.0)]), [(1, 5.0), (77, 4.0)]);
        conditions.reset();
        assert_eq!(seen(&mut conditions, &[star(1, 10.0, 5.0)]), [(1, 10.0)]);
    }
}
