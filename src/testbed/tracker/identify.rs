//! Spots without any idea of the attitude -> which stars they are: lost in space.
//!
//! The pyramid of Mortari, Samaan, Bruccoleri & Junkins, "The pyramid star identification technique", Navigation 51
//! (2004), 171: triangles of bright spots are compared with all triangles of pattern stars whose three angles agree,
//! in an order that does not dwell on one (perhaps false) spot. Differs: in place of one fourth star, all spots confirm
//! a triangle. The attitude it gives says where every pattern star must be; `k` spots more than the triangle's three
//! find one within the tolerance by chance with a probability of at most `C(n, k) p^k`, where `n` spots are left and
//! `p` is the share of the image within the tolerance of any pattern star. That bound, times the number of triangles
//! confirmed so far, must be below [`TrackerParams::false_match_probability`]. Mirrored triangles are refused by
//! their sense of turn. Limit: fewer than about six spots are never enough. Tests: `random_attitudes_are_found`,
//! `mirrored_skies_and_noise_are_refused`.

use super::adjust::{Adjusted, MatchedStar, adjust};
use super::centroid::Spot;
use super::geometry::{Observation, davenport};
use super::guide::{Expected, GuideStars, angle_of_chord, apparent};
use super::params::{Reason, TrackerParams};
use base::axes::{Icrf, Rotation, Sensor};
use core::f64::consts::PI;
use glam::{DVec2, DVec3};

/// Brightest spots whose triangles are tried.
const MOST_CORNERS: usize = 18;
/// Most triangles tried: bounds the time of a frame that cannot be solved.
const MOST_TRIANGLES: usize = 800;
/// Shortest side and least height of a triangle, px: below, its attitude means nothing.
const LEAST_SIDE_PX: f64 = 12.0;
/// Standard deviations allowed to an angle or a place.
const TOLERANCE_SIGMA: f64 = 4.0;
/// Error of a place beyond its covariance (neighbours, calibration), px.
const PLACE_FLOOR_PX: f64 = 0.10;
/// Largest tolerance of a confirmation, px.
const WIDEST_PX: f64 = 3.0;
/// Share of the spots, or of the pattern stars in the field if those are fewer, that must be confirmed.
const LEAST_SHARE: f64 = 0.3;
/// A chance below this is reported as ambiguous rather than as no match.
const AMBIGUOUS: f64 = 1e-2;
/// Floor of the covariance in the first adjustment, px.
const FIRST_FLOOR_PX: f64 = 0.05;
/// End of a chain.
const NONE: u32 = u32::MAX;

/// A spot with the direction it is seen in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sighting {
    pub(super) spot: Spot,
    /// Unit direction, sensor axes.
    pub(super) direction: DVec3,
}

/// Identifies sightings; keeps its buffers.
#[derive(Debug, Clone)]
pub(super) struct Identifier {
    /// Per pattern star: the head of its chain in `links`.
    first: Vec<u32>,
    /// Partner star and next link.
    links: Vec<[u32; 2]>,
    /// Stars whose chains must be emptied.
    touched: Vec<u32>,
    hypotheses: Vec<[u32; 3]>,
    expected: Vec<Expected>,
    taken: Vec<bool>,
}

/// State and counters of the search.
struct Search<'a> {
    params: &'a TrackerParams,
    guide: &'a GuideStars,
    beta: DVec3,
    sightings: &'a [Sighting],
    confirmations: u32,
    least_chance: f64,
}

/// Three sightings, by their place in the list.
type Triangle = [usize; 3];

impl Identifier {
    pub(super) fn new(guide: &GuideStars) -> Self {
        Self {
            first: vec![NONE; guide.pattern_stars()],
            links: Vec::with_capacity(8192),
            touched: Vec::with_capacity(8192),
            hypotheses: Vec::with_capacity(1024),
            expected: Vec::with_capacity(256),
            taken: Vec::with_capacity(256),
        }
    }

    /// Identifies sightings (brightest first); on success `matches` holds every confirmed star.
    pub(super) fn identify(
        &mut self,
        params: &TrackerParams,
        guide: &GuideStars,
        beta: DVec3,
        sightings: &[Sighting],
        matches: &mut Vec<MatchedStar>,
    ) -> Result<Adjusted, Reason> {
        matches.clear();
        if sightings.len() < 4 {
            return Err(Reason::TooFewStars);
        }
        let mut search = Search { params, guide, beta, sightings, confirmations: 0, least_chance: 1.0 };
        let count = sightings.len().min(MOST_CORNERS);
        let mut tried = 0;
        for step in 1..count - 1 {
            for next in 1..count - step {
                for i in 0..count - step - next {
                    let triangle = [i, i + step, i + step + next];
                    if !search.is_useful(triangle) {
                        continue;
                    }
                    if let Some(found) = self.try_triangle(&mut search, triangle, matches) {
                        return Ok(found);
                    }
                    tried += 1;
                    if tried == MOST_TRIANGLES {
                        return Err(search.verdict());
                    }
                }
            }
        }
        Err(search.verdict())
    }

    fn try_triangle(
        &mut self,
        search: &mut Search<'_>,
        triangle: Triangle,
        matches: &mut Vec<MatchedStar>,
    ) -> Option<Adjusted> {
        self.find_hypotheses(search, triangle);
        for at in 0..self.hypotheses.len() {
            let attitude = search.attitude_of(triangle, self.hypotheses[at]);
            if let Some(found) = self.confirm(search, triangle, &attitude, matches) {
                return Some(found);
            }
        }
        None
    }

    /// Finds all triples of pattern stars with the triangle's three angles and its sense of turn.
    fn find_hypotheses(&mut self, search: &Search<'_>, [i, j, k]: Triangle) {
        self.hypotheses.clear();
        let pairs = &search.guide.pairs;
        let (ij, ij_tolerance) = search.side(i, j);
        let (ik, ik_tolerance) = search.side(i, k);
        let (jk, jk_tolerance) = search.side(j, k);
        self.chain(pairs.within(ik, ik_tolerance));
        let (low, high) = (chord(jk - jk_tolerance), chord(jk + jk_tolerance));
        let turn = search.turn([i, j, k].map(|at| search.sightings[at].direction));
        let stars = &search.guide.pattern_directions;
        for &[one, other] in pairs.within(ij, ij_tolerance) {
            for (a, b) in [(one, other), (other, one)] {
                let mut link = self.first[a as usize];
                while link != NONE {
                    let [c, next] = self.links[link as usize];
                    let side2 = stars[b as usize].distance_squared(stars[c as usize]);
                    let found = [a, b, c];
                    if (low * low..=high * high).contains(&side2)
                        && search.turn(found.map(|star| stars[star as usize])) == turn
                    {
                        self.hypotheses.push(found);
                    }
                    link = next;
                }
            }
        }
        for star in self.touched.drain(..) {
            self.first[star as usize] = NONE;
        }
    }

    /// Links both stars of each pair to each other.
    fn chain(&mut self, pairs: &[[u32; 2]]) {
        self.links.clear();
        for &[one, other] in pairs {
            for (from, to) in [(one, other), (other, one)] {
                let link = u32::try_from(self.links.len()).unwrap_or(NONE);
                self.links.push([to, self.first[from as usize]]);
                self.first[from as usize] = link;
                self.touched.push(from);
            }
        }
    }

    /// Looks for all spots where the attitude puts the pattern stars; accepts when chance is excluded.
    fn confirm(
        &mut self,
        search: &mut Search<'_>,
        triangle: Triangle,
        attitude: &Rotation<Sensor, Icrf>,
        matches: &mut Vec<MatchedStar>,
    ) -> Option<Adjusted> {
        search.confirmations += 1;
        let (params, guide) = (search.params, search.guide);
        let tolerance_px = search.reach_px(triangle);
        let among = guide.pattern_stars();
        guide.in_field(among, 2 * params.most_stars, attitude, search.beta, &params.geometry, &mut self.expected);
        self.pair_up(search.sightings, tolerance_px, matches);
        let chance = search.chance(matches.len(), self.expected.len(), tolerance_px);
        let share = matches.len() as f64 / search.sightings.len().min(self.expected.len()).max(1) as f64;
        if matches.len() < 4 || share < LEAST_SHARE {
            return None;
        }
        search.least_chance = search.least_chance.min(chance);
        if chance > params.false_match_probability {
            return None;
        }
        let rough = adjust(&params.geometry, attitude, matches, FIRST_FLOOR_PX)?;
        // Fainter stars too, now that the attitude says where.
        let most = 2 * params.most_stars;
        guide.in_field(usize::MAX, most, &rough.attitude, search.beta, &params.geometry, &mut self.expected);
        self.pair_up(search.sightings, 1.0, matches);
        let found = adjust(&params.geometry, &rough.attitude, matches, params.centroid_floor_px)?;
        let chance = search.chance(found.used, self.expected.len(), 1.0);
        (chance <= params.false_match_probability).then_some(found)
    }

    /// Pairs each sighting with the nearest expected star not yet taken.
    fn pair_up(&mut self, sightings: &[Sighting], tolerance_px: f64, matches: &mut Vec<MatchedStar>) {
        matches.clear();
        self.taken.clear();
        self.taken.resize(self.expected.len(), false);
        for sighting in sightings {
            let mut nearest = (tolerance_px * tolerance_px, None);
            for (at, expected) in self.expected.iter().enumerate() {
                let distance2 = expected.place_px.distance_squared(sighting.spot.place_px);
                if distance2 < nearest.0 && !self.taken[at] {
                    nearest = (distance2, Some(at));
                }
            }
            let Some(at) = nearest.1 else { continue };
            self.taken[at] = true;
            let Expected { star, apparent_icrf, place_px } = self.expected[at];
            let residual_px = sighting.spot.place_px - place_px;
            matches.push(MatchedStar { star, apparent_icrf, spot: sighting.spot, residual_px, used: true });
        }
    }
}

impl Search<'_> {
    /// Returns the angle between two sightings and its tolerance, rad.
    fn side(&self, one: usize, other: usize) -> (f64, f64) {
        let (a, b) = (&self.sightings[one], &self.sightings[other]);
        let chord = a.direction.distance(b.direction);
        let place_px = TOLERANCE_SIGMA * a.spot.sigma_px().hypot(b.spot.sigma_px()) + PLACE_FLOOR_PX;
        let aberration = (self.beta - self.guide.pattern_beta).length() * chord;
        (angle_of_chord(chord), place_px * self.params.geometry.ifov_rad() + aberration)
    }

    /// Returns whether three directions turn to the right.
    fn turn(&self, [a, b, c]: [DVec3; 3]) -> bool {
        a.dot(b.cross(c)) > 0.0
    }

    /// Returns whether a triangle's sides and height are long enough to give an attitude.
    fn is_useful(&self, triangle: Triangle) -> bool {
        let [a, b, c] = triangle.map(|at| self.sightings[at].spot.place_px);
        let sides = [a.distance(b), b.distance(c), c.distance(a)];
        let longest = sides.into_iter().fold(0.0, f64::max);
        let height = (b - a).perp_dot(c - a).abs() / longest;
        sides.into_iter().all(|side| side > LEAST_SIDE_PX) && height > LEAST_SIDE_PX
    }

    fn attitude_of(&self, triangle: Triangle, stars: [u32; 3]) -> Rotation<Sensor, Icrf> {
        davenport(triangle.into_iter().zip(stars).map(|(at, star)| Observation {
            measured: self.sightings[at].direction,
            reference: apparent(self.guide.stars[star as usize].direction_icrf, self.beta),
            weight: 1.0,
        }))
    }

    /// Returns how far from its true place a triangle's attitude may put a star at the far end of the image, px.
    fn reach_px(&self, triangle: Triangle) -> f64 {
        let places: [DVec2; 3] = triangle.map(|at| self.sightings[at].spot.place_px);
        let longest =
            places[0].distance(places[1]).max(places[1].distance(places[2])).max(places[2].distance(places[0]));
        let sigma_px = triangle.into_iter().map(|at| self.sightings[at].spot.sigma_px()).fold(PLACE_FLOOR_PX, f64::max);
        let lever = 1.0 + 0.5 * self.params.geometry.diagonal_px() / longest;
        (TOLERANCE_SIGMA * sigma_px * lever).clamp(0.5, WIDEST_PX)
    }

    /// Returns the bound on the probability that so many confirmations are chance.
    fn chance(&self, matched: usize, expected: usize, tolerance_px: f64) -> f64 {
        let geometry = &self.params.geometry;
        let image_px2 = (geometry.width_px * geometry.height_px) as f64;
        let p = (expected as f64 * PI * tolerance_px * tolerance_px / image_px2).min(1.0);
        let spots = self.sightings.len() - 3;
        let more = matched.saturating_sub(3);
        let ways: f64 = (0..more).map(|i| (spots - i) as f64 / (i + 1) as f64).product();
        (f64::from(self.confirmations) * ways * p.powf(more as f64)).min(1.0)
    }

    fn verdict(&self) -> Reason {
        if self.least_chance < AMBIGUOUS { Reason::Ambiguous } else { Reason::NoMatch }
    }
}

/// Returns the chord of an angle, rad; zero below zero.
fn chord(angle_rad: f64) -> f64 {
    2.0 * (0.5 * angle_rad.max(0.0)).sin()
}
