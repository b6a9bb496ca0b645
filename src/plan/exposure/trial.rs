//! Tries methods on a few stars of the frame itself, for frames in which no bound is inside the budget.
//!
//! Bounds add up all possible errors anywhere in the field, so they cannot distinguish a streak with a small error from
//! a row of dots. Here the brightest star of each zone of the detector is drawn twice in f64, in windows of 5 x 5
//! pixels along its path: at the nodes of a method as backends draw them, and along its exact path, every row of a
//! rolling shutter at its own time. In: plan, probes, method. Out: the differences as centroid (px) and pixel error
//! (sigma). They are samples, not bounds; the chooser multiplies them by [`SAFETY`]. A PSF that is not a Gaussian is
//! replaced by a Gaussian of its core. Test: `tests/physics/streaks`.

use crate::exposure::lists::{band_delay_s, band_of, correction, fill_nodes};
use crate::exposure::pose::{PathNode, Pose, mean_pose};
use crate::exposure::{
    line::DENSE_RESERVED, mean_field::Correction, method::Method, motion::Shutter, plan::ExposurePlan, probes::Probes,
    source::PlannedStar, track::StarTrack,
};
use crate::optics::gaussian::EdgeTable;

/// Safety factor of a tried error: other stars and other windows may have larger errors.
const SAFETY: f64 = 2.0;
/// Smallest reported error, for other stars and windows than those tried, px and sigma.
const FLOOR: TriedError = TriedError { centroid_px: 3e-4, pixel_sigma: 5e-3 };
/// Number of zones along each side of the detector; the brightest star of each is tried.
const ZONES: usize = 3;
/// Number of windows along a star's path.
const WINDOWS: usize = 5;
/// Number of pixels along a side of a window.
const SIDE: usize = 5;
/// Number of pixels from the middle of a window to its edge.
const HALF: i32 = 2;
/// Largest distance from a pixel's edge at which a star is drawn in a window, sigma (beyond: 1e-9 of its light).
const REACH_SIGMA: f64 = 6.0;
/// Smallest light of a window with a centroid, as a share of the light of the star's brightest window: a tracker uses
/// the brightest part of a star, not the ends of its streak.
const CENTROID_LIGHT: f64 = 0.8;
/// Mean distance of a path's nodes above which they appear as dots, sigma.
const DOTS_SIGMA: f64 = 1.5;
/// Edges of pixels whose light is found in the time of a step.
const EDGES_PER_STEP: usize = 2;
/// Instants far from a window that take a step together.
const FAR_PER_STEP: usize = 8;

/// Light of a star in the pixels of a window, shares of its electrons.
type Shares = [[f64; SIDE]; SIDE];

/// One instant of a star: weight and place, px.
type Lit = [f64; 3];

/// Errors of a method on the stars it was tried on.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct TriedError {
    /// Centroid in a 5 x 5 window, px.
    pub(super) centroid_px: f64,
    /// Largest pixel error in units of that pixel's noise.
    pub(super) pixel_sigma: f64,
}

/// Noise with which a window's errors are compared.
#[derive(Debug, Clone, Copy)]
pub(super) struct Noise {
    pub(super) full_well_e: f64,
    pub(super) read_noise_e_rms: f64,
    pub(super) sigma_px: f64,
}

/// A place on the detector and the true light there.
#[derive(Debug, Clone, Copy)]
struct Window {
    first_px: [i32; 2],
    truth: Shares,
}

/// A star on which methods are tried.
#[derive(Debug, Clone, Copy)]
struct Tried {
    star: PlannedStar,
    track: StarTrack,
    windows: [Option<Window>; WINDOWS],
}

/// The list of a method for one band of rows: all stars of the band share it.
#[derive(Debug, Clone, Copy)]
struct Listed {
    method: Method,
    band: usize,
    mean: Pose,
    correction: Correction,
}

/// The stars on which methods are tried; keeps its buffers.
#[derive(Debug)]
pub(super) struct Trial {
    stars: Vec<Tried>,
    nodes: Vec<PathNode>,
    /// The list that `nodes` holds, if it is one of a method.
    listed: Option<Listed>,
    lit: Vec<Lit>,
    edges: EdgeTable,
    /// Steps since the stars were selected (see `cost`).
    pub(super) steps: usize,
}

impl Trial {
    /// Returns a trial whose buffers hold the longest list of a path with jitter.
    pub(super) fn new() -> Self {
        Self {
            stars: Vec::with_capacity(ZONES * ZONES),
            nodes: Vec::with_capacity(DENSE_RESERVED),
            listed: None,
            lit: Vec::with_capacity(DENSE_RESERVED),
            edges: EdgeTable::filled(),
            steps: 0,
        }
    }

    /// Selects the brightest stars of the zones, at most `most` of them, and follows their true paths.
    pub(super) fn prepare(&mut self, plan: &ExposurePlan, probes: &Probes, sigma_px: f64, most: usize) {
        self.stars.clear();
        self.steps = 0;
        self.listed = None;
        let mut brightest = brightest_of_zones(plan);
        brightest.sort_by(|a, b| brightness(b).total_cmp(&brightness(a)));
        for star in brightest.into_iter().flatten().take(most) {
            let mut tried = Tried { star, track: StarTrack::new(&plan.camera, star.place), windows: [None; WINDOWS] };
            self.place_windows(plan, probes, sigma_px, &mut tried);
            self.stars.push(tried);
        }
    }

    /// Places windows at even steps of the part of the true path that lies on the detector.
    fn place_windows(&mut self, plan: &ExposurePlan, probes: &Probes, sigma_px: f64, tried: &mut Tried) {
        let row_px = tried.star.mean_px[1];
        self.follow(plan, probes, sigma_px, &tried.track, row_px);
        let on = |lit: &&Lit| is_on(plan, [lit[1], lit[2]]);
        let count = self.lit.iter().filter(on).count();
        let places: [Option<[i32; 2]>; WINDOWS] = core::array::from_fn(|k| {
            let lit = self.lit.iter().filter(on).nth(k * count.saturating_sub(1) / (WINDOWS - 1))?;
            Some(window_about([lit[1], lit[2]]))
        });
        for (i, first_px) in places.into_iter().enumerate() {
            if let Some(first_px) = first_px.filter(|_| !places[..i].contains(&first_px)) {
                // Under a global shutter the path is that of every row, and followed already.
                let truth = match plan.shutter {
                    Shutter::Global => light_of((&self.lit, &self.edges), first_px, sigma_px, &mut self.steps),
                    Shutter::Rolling { .. } => self.true_light(plan, probes, sigma_px, &tried.track, first_px),
                };
                tried.windows[i] = Some(Window { first_px, truth });
            }
        }
    }

    /// Computes the true path of a star while the row at `row_px` is exposed.
    fn follow(&mut self, plan: &ExposurePlan, probes: &Probes, sigma_px: f64, track: &StarTrack, row_px: f64) {
        let seen = |node: &PathNode| track.seen_px(&plan.camera, &node.pose).map(|[x, y]| [node.weight, x, y]);
        self.lit.clear();
        if plan.shutter == Shutter::Global {
            // The nodes of all rows are known.
            return self.lit.extend(probes.dense().iter().filter_map(seen));
        }
        let delay_s = plan.shutter.delay_s(row_px, plan.camera.height_px());
        self.listed = None;
        self.nodes.clear();
        probes.true_nodes(&plan.motion, sigma_px, delay_s, &mut self.nodes);
        self.steps += self.nodes.len() * (1 + plan.motion.pose_steps());
        self.lit.extend(self.nodes.iter().filter_map(seen));
    }

    /// Computes the true light of a star in a window.
    fn true_light(
        &mut self,
        plan: &ExposurePlan,
        probes: &Probes,
        sigma_px: f64,
        track: &StarTrack,
        first_px: [i32; 2],
    ) -> Shares {
        if plan.shutter == Shutter::Global {
            self.follow(plan, probes, sigma_px, track, 0.0);
            return light_of((&self.lit, &self.edges), first_px, sigma_px, &mut self.steps);
        }
        core::array::from_fn(|row| {
            let [left_px, top_px] = first_px;
            let row_px = top_px + row as i32;
            self.follow(plan, probes, sigma_px, track, f64::from(row_px));
            let [light] = light_of((&self.lit, &self.edges), [left_px, row_px], sigma_px, &mut self.steps);
            light
        })
    }

    /// Returns the error of `method`; `None` as soon as `is_hopeless` returns true for the errors found so far.
    pub(super) fn error(
        &mut self,
        plan: &ExposurePlan,
        probes: &Probes,
        (method, bands): (Method, usize),
        noise: Noise,
        is_hopeless: impl Fn(&TriedError) -> bool,
    ) -> Option<TriedError> {
        let mut worst = TriedError::default();
        let stars = core::mem::take(&mut self.stars);
        for tried in &stars {
            self.draw(plan, probes, (method, bands), tried);
            let shows_dots = method.nodes() as f64 * DOTS_SIGMA * noise.sigma_px < probes.reach_px;
            let windows = || tried.windows.iter().flatten();
            let brightest = windows().map(|window| sum(&window.truth)).fold(0.0, f64::max);
            for window in windows() {
                let drawn = light_of((&self.lit, &self.edges), window.first_px, noise.sigma_px, &mut self.steps);
                let has_centroid = sum(&window.truth) >= CENTROID_LIGHT * brightest;
                worst = worst.worst(window_error(plan, &tried.star, window, &drawn, noise, has_centroid));
                if is_hopeless(&worst) {
                    self.stars = stars;
                    return None;
                }
            }
            let dot = self.lit.iter().find(|lit| is_on(plan, [lit[1], lit[2]])).copied();
            if let Some([_, x, y]) = dot.filter(|_| shows_dots) {
                // The path may pass between the windows that were placed on it.
                let first_px = window_about([x, y]);
                let drawn = light_of((&self.lit, &self.edges), first_px, noise.sigma_px, &mut self.steps);
                let truth = self.true_light(plan, probes, noise.sigma_px, &tried.track, first_px);
                let window = Window { first_px, truth };
                worst = worst.worst(window_error(plan, &tried.star, &window, &drawn, noise, false));
            }
        }
        self.stars = stars;
        Some(worst)
    }

    /// Computes the places at which backends draw a star, instant by instant.
    fn draw(&mut self, plan: &ExposurePlan, probes: &Probes, (method, bands): (Method, usize), tried: &Tried) {
        let (star, track, height) = (&tried.star, &tried.track, plan.camera.height_px());
        let [mx, my] = star.mean_px;
        let gain = star.drawn_e / star.electrons.max(f64::MIN_POSITIVE);
        self.lit.clear();
        if method == Method::Static {
            self.lit.push([gain, mx, my]);
            return;
        }
        let Listed { mean, correction, .. } =
            self.list(plan, probes, method, [band_of(my, height as f64, bands), bands]);
        if let (true, Some(centre)) = (method.kernels() > 0, probes.centre()) {
            let place = |node: &PathNode| centre.track.exact_px(&plan.camera, &node.pose);
            let mean = self.nodes.iter().fold([0.0; 2], |[x, y], node| {
                let [dx, dy] = place(node);
                [x + node.weight * dx, y + node.weight * dy]
            });
            self.lit.extend(self.nodes.iter().map(|node| {
                let [dx, dy] = place(node);
                [gain * node.weight, mx + dx - mean[0], my + dy - mean[1]]
            }));
            return;
        }
        let ([dx, dy], [cx, cy]) = (track.displacement_px(&mean), correction.at(star.place.mid_px));
        let (x, y) = (mx - dx - cx, my - dy - cy);
        self.lit.extend(self.nodes.iter().map(|node| {
            let [dx, dy] = track.displacement_px(&node.pose);
            [gain * node.weight, x + dx, y + dy]
        }));
    }

    /// Fills `nodes` with the list of a method for a band of rows, unless they are that list.
    fn list(&mut self, plan: &ExposurePlan, probes: &Probes, method: Method, [band, bands]: [usize; 2]) -> Listed {
        if let Some(listed) = self.listed.filter(|listed| listed.method == method && listed.band == band) {
            return listed;
        }
        let delay_s = band_delay_s(plan.shutter, plan.camera.height_px(), [band, bands]);
        self.nodes.clear();
        fill_nodes(&plan.motion, method, delay_s, probes, &mut self.nodes);
        self.steps += self.nodes.len() * (1 + plan.motion.pose_steps());
        let mean = mean_pose(&self.nodes);
        // A kernel is drawn about the mean of the centre's path.
        let own = method.kernels() == 0;
        let correction = if own { correction(&self.nodes, &mean, probes) } else { Correction::none() };
        *self.listed.insert(Listed { method, band, mean, correction })
    }
}

impl TriedError {
    /// Returns the errors for the report, increased by the safety factor.
    pub(super) fn reported(self) -> Self {
        Self {
            centroid_px: SAFETY * self.centroid_px + FLOOR.centroid_px,
            pixel_sigma: SAFETY * self.pixel_sigma + FLOOR.pixel_sigma,
        }
    }

    fn worst(self, other: Self) -> Self {
        Self {
            centroid_px: self.centroid_px.max(other.centroid_px),
            pixel_sigma: self.pixel_sigma.max(other.pixel_sigma),
        }
    }
}

fn brightness(star: &Option<PlannedStar>) -> f64 {
    star.map_or(0.0, |star| star.electrons)
}

/// Returns the brightest star of every zone of the detector.
fn brightest_of_zones(plan: &ExposurePlan) -> [Option<PlannedStar>; ZONES * ZONES] {
    let size = [plan.camera.width_px(), plan.camera.height_px()];
    let mut brightest = [None; ZONES * ZONES];
    // The nodes of targets are appended after the stars later.
    for star in &plan.stars {
        let [column, row] = core::array::from_fn(|i| band_of(star.mean_px[i], size[i] as f64, ZONES));
        let held = &mut brightest[row * ZONES + column];
        if brightness(held) < star.electrons {
            *held = Some(*star);
        }
    }
    brightest
}

fn is_on(plan: &ExposurePlan, [x, y]: [f64; 2]) -> bool {
    let inside = |v: f64, size: usize| v > -0.5 && v < size as f64 - 0.5;
    inside(x, plan.camera.width_px()) && inside(y, plan.camera.height_px())
}

/// Returns the first pixel of the window about a place.
fn window_about(px: [f64; 2]) -> [i32; 2] {
    #[allow(clippy::cast_possible_truncation, reason = "a place on the detector")]
    px.map(|v| (v + 0.5).floor() as i32 - HALF)
}

fn sum(shares: &Shares) -> f64 {
    shares.iter().flatten().sum()
}

/// Returns the light of all instants in so many rows of a window, from its first pixel on.
fn light_of<const ROWS: usize>(
    (lit, edges): (&[Lit], &EdgeTable),
    first_px: [i32; 2],
    sigma_px: f64,
    steps: &mut usize,
) -> [[f64; SIDE]; ROWS] {
    let mut near = 0;
    let mut out = [[0.0; SIDE]; ROWS];
    let [left, top] = first_px.map(|v| f64::from(v) - 0.5);
    let (reach, per_px) = (REACH_SIGMA * sigma_px, 1.0 / sigma_px);
    let is_near = |v: f64, start: f64, pixels: usize| v > start - reach && v < start + pixels as f64 + reach;
    for [weight, x, y] in lit {
        if is_near(*x, left, SIDE) && is_near(*y, top, ROWS) {
            near += 1;
            let (across, down) = (cells::<SIDE>(edges, left - x, per_px), cells::<ROWS>(edges, top - y, per_px));
            for (row, gain) in out.iter_mut().zip(down) {
                for (pixel, share) in row.iter_mut().zip(across) {
                    *pixel += weight * gain * share;
                }
            }
        }
    }
    *steps += lit.len() / FAR_PER_STEP + near * (SIDE + ROWS + 2) / EDGES_PER_STEP;
    out
}

/// Returns the shares of a star's light in neighbouring pixels, the first beginning `from` px from it, along an axis.
#[inline(always)]
fn cells<const N: usize>(edges: &EdgeTable, from: f64, per_px: f64) -> [f64; N] {
    let mut below = edges.below(from * per_px);
    core::array::from_fn(|i| {
        let before = core::mem::replace(&mut below, edges.below((from + (i + 1) as f64) * per_px));
        below - before
    })
}

/// Computes the errors of one window.
fn window_error(
    plan: &ExposurePlan,
    star: &PlannedStar,
    window: &Window,
    drawn: &Shares,
    noise: Noise,
    has_centroid: bool,
) -> TriedError {
    let Window { first_px, truth } = window;
    let mut pixel_sigma = 0.0_f64;
    let mut is_whole = true;
    for (y, (drawn, truth)) in (first_px[1]..).zip(drawn.iter().zip(truth)) {
        for (x, (drawn, truth)) in (first_px[0]..).zip(drawn.iter().zip(truth)) {
            if !is_on(plan, [f64::from(x), f64::from(y)]) {
                is_whole = false;
                continue;
            }
            let held_e = |share: f64| (share * star.electrons).min(noise.full_well_e);
            let (drawn_e, true_e) = (held_e(*drawn), held_e(*truth));
            let noise_e = true_e.max(0.0).sqrt().hypot(noise.read_noise_e_rms).max(1.0);
            pixel_sigma = pixel_sigma.max((drawn_e - true_e).abs() / noise_e);
        }
    }
    let centroid_px = if is_whole && has_centroid {
        let ([a, b], [c, d]) = (centroid(drawn), centroid(truth));
        let apart = (a - c).hypot(b - d);
        // Without light the centroid is undefined: use the largest distance in the window.
        if apart.is_finite() { apart } else { SIDE as f64 }
    } else {
        0.0
    };
    TriedError { centroid_px, pixel_sigma }
}

/// Returns the centroid of a window, px from its first pixel.
fn centroid(shares: &Shares) -> [f64; 2] {
    let mut moments = [0.0; 3];
    for (y, row) in (0_u8..).zip(shares) {
        for (x, share) in (0_u8..).zip(row) {
            moments[0] += share;
            moments[1] += share * f64::from(x);
            moments[2] += share * f64::from(y);
        }
    }
    [moments[1] / moments[0], moments[2] / moments[0]]
}
