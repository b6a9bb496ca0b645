//! The planner: the cheapest method whose error bounds fit the budget.
//!
//! In: motion, sources, instrument. Out: [`ExposurePlan`]. After the first frames it allocates nothing. Limits: one
//! method for all stars of a frame; jitter enters through the projection's derivative. Bounds are held against the
//! reference by `tests/physics`.

use crate::astrometry::CameraGeometry;
use crate::attitude::LosPath;
use crate::base::accuracy::AccuracyBudget;
use crate::exposure::cost::CostModel;
use crate::exposure::features::{Features, PathNode};
use crate::exposure::method::{Method, MethodChoice, MethodName};
use crate::exposure::moments::{Moments, mean_features};
use crate::exposure::motion::Motion;
use crate::exposure::nodes;
use crate::exposure::pixel_path::PixelPath;
use crate::exposure::plan::{Assessment, ExposurePlan, LONGEST_KERNEL_PX, PlannedStar, Verdict};
use crate::exposure::share::Share;
use crate::exposure::spectrum::{self, Sensitivity, Spectrum};
use crate::exposure::track::StarTrack;
use crate::optics::PsfModel;
use glam::DVec3;

/// The instrument as the planner sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct Instrument {
    /// Projection and distortion.
    pub camera: CameraGeometry,
    /// PSF.
    pub psf: PsfModel,
    /// Electrons at which a pixel saturates: errors above it cannot be seen.
    pub full_well_e: f64,
    /// Noise floor of a pixel, e-.
    pub read_noise_e_rms: f64,
}

/// A source to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Source {
    /// Identifier.
    pub id: u32,
    /// Electrons into the whole image plane during the exposure.
    pub electrons: f64,
    /// Magnitude in the instrument's band, for the truth table (NaN: not a star of a catalog).
    pub mag: f32,
    /// Where it is.
    pub place: SourcePlace,
}

/// Where a source is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SourcePlace {
    /// Apparent direction, ICRF axes, unit.
    Icrf(DVec3),
    /// Place on the detector at mid-exposure, px.
    Pixel([f64; 2]),
}

/// Share of the budget's flux error that footprint truncation may use.
const TRUNCATION_SHARE: f64 = 0.05;
/// Share of the budget's centroid error that motion may use (the rest: PSF table, f32).
const MOTION_SHARE: f64 = 0.5;
/// Interpolation error of a tabulated PSF relative to its peak (`render::table` chooses its step for this).
pub const TABLE_ERROR: f64 = 3e-5;
/// Centroid error a table of that quality leaves, px (measured at most 3e-5 for sigma 0.3 to 1.2).
const TABLE_CENTROID_PX: f64 = 1e-4;
/// Rounding of single-precision drawing, px.
const F32_CENTROID_PX: f64 = 1e-6;
/// Bias of the single-precision error function in a star's sum.
const F32_FLUX: f64 = 1e-6;
/// Rounding of one addition in single precision; sums over nodes wander as the root of their number.
const F32_ROUNDING: f64 = 6e-8;
/// Side of the window in which a tracker measures, px.
const WINDOW_PX: f64 = 5.0;
/// Share of the budget's centroid error left to the number of nodes.
const NODE_SHARE: f64 = 0.4;
/// Share of the budget's pixel error left to the number of nodes.
const NODE_PIXEL_SHARE: f64 = 0.8;
/// Mean of a smooth displacement over the exposure, share of its largest: a mean is what moves a centroid.
const MEAN_SMOOTH: f64 = 0.5;
/// Steepest slope of a Gaussian, peaks per sigma: `exp(-1/2)`.
const STEEPEST: f64 = 0.607;
/// Side of the square that holds a star's core, sigma.
const CORE_SIGMAS: f64 = 2.5;
/// Part of the pixel budget that nodes get even where the model of motion has used it up.
const LEAST_LEFT: f64 = 0.3;
/// Most nodes the planner gives to a commanded path.
const MOST_NODES: usize = 16_384;
/// Most nodes it gives to jitter, on the frame path.
const MOST_JITTER_NODES: usize = 1024;
/// Stars a frame's buffers hold from the start.
const STARS_RESERVED: usize = 16_384;

/// Chooses methods; owns the buffers of the plan.
#[derive(Debug)]
pub struct Planner {
    instrument: Instrument,
    budget: AccuracyBudget,
    cost: CostModel,
    choice: MethodChoice,
    plan: ExposurePlan,
    dense: Vec<PathNode>,
    trial: Vec<PathNode>,
    probes: Vec<StarTrack>,
    truths: Vec<Moments>,
    sensitivity: Sensitivity,
    watched: [Watched; 2],
    share: Share,
}

/// A probe whose characteristic function is followed.
#[derive(Debug, Clone, Copy)]
struct Watched {
    probe: usize,
    truth: Spectrum,
}

impl Planner {
    /// A planner for one instrument, budget and backend.
    #[must_use]
    pub fn new(
        instrument: Instrument,
        budget: AccuracyBudget,
        cost: CostModel,
        choice: MethodChoice,
        los: LosPath,
    ) -> Self {
        let half_px = instrument.psf.half_px(budget.flux_rel * TRUNCATION_SHARE);
        let plan = ExposurePlan {
            camera: instrument.camera,
            psf: instrument.psf.clone(),
            half_px,
            chosen: Assessment {
                method: Method::Static,
                centroid_px: 0.0,
                flux_rel: 0.0,
                pixel_sigma: 0.0,
                cost_ms: 0.0,
                verdict: Verdict::Fits,
            },
            assessed: Vec::with_capacity(MethodName::ALL.len()),
            nodes: Vec::with_capacity(nodes::MOST_DENSE_NODES),
            mean: [0.0; 6],
            centre_response: [[0.0; 6]; 2],
            reach_px: 0.0,
            extent_px: 0.0,
            stars: Vec::with_capacity(STARS_RESERVED),
            motion: Motion { los, image_path: None },
        };
        let sensitivity = Sensitivity::new(instrument.psf.core_sigma_px());
        let share = Share::new(&instrument.psf, half_px, [instrument.camera.width_px(), instrument.camera.height_px()]);
        Self {
            instrument,
            budget,
            cost,
            choice,
            plan,
            dense: Vec::with_capacity(nodes::MOST_DENSE_NODES),
            trial: Vec::with_capacity(nodes::MOST_DENSE_NODES),
            probes: Vec::with_capacity(8),
            truths: Vec::with_capacity(8),
            sensitivity,
            watched: [Watched { probe: 0, truth: spectrum::NOTHING }; 2],
            share,
        }
    }

    /// The motion of the next exposure, to be filled in before [`Self::plan`].
    pub fn motion_mut(&mut self) -> &mut Motion {
        &mut self.plan.motion
    }

    /// The latest plan.
    #[must_use]
    pub fn latest(&self) -> &ExposurePlan {
        &self.plan
    }

    /// Plans one exposure.
    pub fn plan(&mut self, sources: &[Source]) -> &ExposurePlan {
        self.place_probes();
        self.measure_path();
        self.place_stars(sources);
        self.choose();
        self.fill_nodes();
        self.share_light();
        &self.plan
    }

    /// Tracks of stars at the centre and the corners of the detector: they stand for all.
    fn place_probes(&mut self) {
        let camera = &self.instrument.camera;
        let (right, bottom) = (camera.width_px() as f64 - 1.0, camera.height_px() as f64 - 1.0);
        let places = [[0.5 * right, 0.5 * bottom], [0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]];
        self.probes.clear();
        for place in places {
            let track = camera.unproject(place).and_then(|s| StarTrack::new(camera, &self.plan.motion, s));
            self.probes.extend(track);
        }
        self.plan.centre_response = self.probes.first().map_or([[0.0; 6]; 2], |probe| probe.response);
    }

    /// Length of the path, the dense nodes, the mean features and the probes' moments.
    fn measure_path(&mut self) {
        let motion = &self.plan.motion;
        let camera = &self.instrument.camera;
        let radius_px = furthest_corner_px(camera);
        let reach_px = self.probes.iter().map(|probe| path_length_px(motion, probe, radius_px)).fold(0.0, f64::max);
        let sigma_px = self.instrument.psf.core_sigma_px();
        if motion.is_smooth() {
            nodes::gauss_legendre_in_time(motion, gauss_legendre_count(reach_px, sigma_px) + 8, &mut self.dense);
        } else {
            nodes::dense(motion, sigma_px, reach_px, radius_px, &mut self.dense);
        }
        self.plan.reach_px = reach_px;
        self.plan.mean = mean_features(&self.dense);
        self.plan.extent_px = extent_px(&self.probes, &self.dense, &self.plan.mean);
        self.truths.clear();
        self.truths.extend(self.probes.iter().map(|probe| Moments::of(probe, &self.dense)));
        let spread = |i: &usize| self.truths[*i].covariance_px2[0] + self.truths[*i].covariance_px2[2];
        let widest = (0..self.truths.len()).max_by(|a, b| spread(a).total_cmp(&spread(b))).unwrap_or(0);
        for (watched, probe) in self.watched.iter_mut().zip([0, widest]) {
            let Some(track) = self.probes.get(probe) else { continue };
            *watched = Watched { probe, truth: self.sensitivity.spectrum(track, &self.dense) };
        }
    }

    /// Tracks of all sources that can leave light on the detector.
    fn place_stars(&mut self, sources: &[Source]) {
        let Self { plan, instrument, .. } = self;
        let camera = &instrument.camera;
        let margin = plan.half_px as f64 + 1.0 + plan.extent_px;
        let inside = |v: f64, size: usize| v > -margin && v < size as f64 - 1.0 + margin;
        plan.stars.clear();
        for source in sources {
            let mid_sensor = match source.place {
                SourcePlace::Icrf(direction) => Some(plan.motion.los.mid_sensor_from_icrf.apply(direction)),
                SourcePlace::Pixel(px) => camera.unproject(px),
            };
            let Some(mid_sensor) = mid_sensor else { continue };
            let Some(mut track) = StarTrack::new(camera, &plan.motion, mid_sensor) else { continue };
            if let SourcePlace::Pixel(px) = source.place {
                track.mid_px = px;
            }
            let shift = track.displacement_px(&plan.mean);
            let mean_px = [track.mid_px[0] + shift[0], track.mid_px[1] + shift[1]];
            if inside(mean_px[0], camera.width_px()) && inside(mean_px[1], camera.height_px()) {
                let electrons = source.electrons;
                let star = PlannedStar {
                    id: source.id,
                    mag: source.mag,
                    electrons,
                    electrons_on_detector: 0.0,
                    mid_sensor,
                    track,
                    mean_px,
                };
                plan.stars.push(star);
            }
        }
    }

    /// Weighs every method and takes the cheapest that fits, or the one the user fixed.
    fn choose(&mut self) {
        self.plan.assessed.clear();
        for name in MethodName::ALL {
            let assessment = self.assess(name);
            self.plan.assessed.push(assessment);
        }
        self.plan.assessed.sort_by(|a, b| a.cost_ms.total_cmp(&b.cost_ms));
        let assessed = &self.plan.assessed;
        let chosen = match self.choice {
            MethodChoice::Auto => assessed.iter().find(|a| a.verdict.is_met()).or_else(|| {
                let usable =
                    assessed.iter().filter(|a| !matches!(a.verdict, Verdict::NeedsSmoothMotion | Verdict::PathTooLong));
                usable.min_by(|a, b| a.centroid_px.total_cmp(&b.centroid_px))
            }),
            MethodChoice::Fixed(name, _) => assessed.iter().find(|a| a.method.name() == name),
        };
        if let Some(chosen) = chosen {
            self.plan.chosen = *chosen;
        }
    }

    fn assess(&mut self, name: MethodName) -> Assessment {
        let fixed = match self.choice {
            MethodChoice::Fixed(fixed, nodes) if fixed == name => nodes,
            _ => None,
        };
        match name {
            MethodName::Static => {
                nodes::single(&self.plan.mean, &mut self.trial);
                self.verdict(Method::Static, self.probes.len())
            }
            MethodName::GaussLegendre if !self.plan.motion.is_smooth() && fixed.is_none() => {
                let method = Method::GaussLegendre { nodes: 0 };
                let cost_ms = f64::INFINITY;
                let verdict = Verdict::NeedsSmoothMotion;
                Assessment {
                    method,
                    centroid_px: f64::NAN,
                    flux_rel: f64::NAN,
                    pixel_sigma: f64::NAN,
                    cost_ms,
                    verdict,
                }
            }
            MethodName::GaussLegendre => {
                let sigma_px = self.instrument.psf.core_sigma_px();
                let count = fixed.unwrap_or_else(|| gauss_legendre_count(self.plan.reach_px, sigma_px));
                nodes::gauss_legendre_in_time(&self.plan.motion, count, &mut self.trial);
                self.verdict(Method::GaussLegendre { nodes: count }, self.probes.len())
            }
            MethodName::Samples => self.smallest_sampling(fixed, self.probes.len(), |nodes| Method::Samples { nodes }),
            MethodName::EffectivePsf => {
                let nodes = self.smallest_sampling(fixed, 1, |nodes| Method::EffectivePsf { nodes }).method.nodes();
                nodes::samples(&self.plan.motion, nodes, &self.plan.mean, &mut self.trial);
                self.verdict(Method::EffectivePsf { nodes }, self.probes.len())
            }
        }
    }

    /// The fewest samples that fit for the first `probes` probes.
    fn smallest_sampling(&mut self, fixed: Option<usize>, probes: usize, method: fn(usize) -> Method) -> Assessment {
        let own = match &self.plan.motion.image_path {
            Some(PixelPath::Samples(points)) => points.len(),
            Some(PixelPath::Line(_)) => MOST_NODES,
            None => MOST_JITTER_NODES,
        };
        let mut count = fixed.unwrap_or(2).min(if fixed.is_some() { usize::MAX } else { own });
        // What the model of motion takes of the pixel budget is not there for nodes.
        let model_peak = STEEPEST * self.model_error_px() / self.instrument.psf.core_sigma_px() + self.dense_error();
        let left = self.budget.pixel_sigma - self.pixel_sigma(model_peak.min(1.0));
        let node_pixel_sigma = NODE_PIXEL_SHARE * left.max(LEAST_LEFT * self.budget.pixel_sigma);
        loop {
            nodes::samples(&self.plan.motion, count, &self.plan.mean, &mut self.trial);
            // Errors that no number of nodes cures do not ask for more of them: each path is held against its own truth.
            let (node_px, node_peak) = self.node_error(Method::Samples { nodes: count }, probes);
            let enough = node_px <= NODE_SHARE * self.budget.centroid_px
                && self.pixel_sigma(node_peak.min(1.0)) <= node_pixel_sigma;
            if enough || fixed.is_some() || count >= own {
                return self.verdict(method(count), probes);
            }
            count = (2 * count).min(own);
        }
    }

    /// Centroid (px) and peak error of the nodes in `trial` over the first `probes` probes: what more nodes can cure.
    fn node_error(&self, method: Method, probes: usize) -> (f64, f64) {
        let sigma_px = self.instrument.psf.core_sigma_px();
        let (mut centroid_px, mut peak) = self.long_path_error(method);
        for (i, (probe, truth)) in self.probes.iter().zip(&self.truths).take(probes).enumerate() {
            let centre_shape = matches!(method, Method::EffectivePsf { .. }) && i > 0;
            let mut drawn = Moments::of(if centre_shape { &self.probes[0] } else { probe }, &self.trial);
            if centre_shape {
                drawn.mean_px = truth.mean_px; // each star is drawn about its own mean
            }
            centroid_px = centroid_px.max(drawn.centroid_error_px(truth, sigma_px));
            peak = peak.max(drawn.peak_error(truth, sigma_px));
        }
        (centroid_px, peak)
    }

    /// Largest pixel error in units of its own noise when it is `peak` of the brightest star's peak.
    fn pixel_sigma(&self, peak: f64) -> f64 {
        let psf = &self.instrument.psf;
        let brightest_e = (self.brightest_e() * psf.peak()).min(self.instrument.full_well_e);
        // Errors are largest on the flanks: a quarter of the smeared peak's light is there at least.
        let light_e = 0.25 * brightest_e * self.light_share(CORE_SIGMAS * psf.core_sigma_px());
        let noise_e = light_e.sqrt().hypot(self.instrument.read_noise_e_rms).max(1.0);
        peak * brightest_e / noise_e
    }

    /// Error bounds of the nodes in `trial`, over the first `probes` probes.
    fn verdict(&self, method: Method, probes: usize) -> Assessment {
        let psf = &self.instrument.psf;
        let sigma_px = psf.core_sigma_px();
        let tabulated = matches!(method, Method::EffectivePsf { .. }) || !matches!(psf, PsfModel::Gaussian { .. });
        let (node_px, node_peak) = self.node_error(method, probes);
        let (model_px, dense) = (self.model_error_px(), self.dense_error());
        let (drawn_px, drawn_peak) = if tabulated { (TABLE_CENTROID_PX, TABLE_ERROR) } else { (F32_CENTROID_PX, 0.0) };
        // Without a probe nothing is known of the motion, and nothing is promised.
        let unknown_px = if self.probes.is_empty() { f64::INFINITY } else { 0.0 };
        let centroid_px = node_px + model_px + dense * sigma_px + self.rim_error_px() + drawn_px + unknown_px;
        let peak = node_peak + STEEPEST * model_px / sigma_px + dense;
        let pixel_sigma = self.pixel_sigma(peak.min(1.0) + drawn_peak);
        let flux_rel = psf.lost_flux(self.plan.half_px) + F32_FLUX + F32_ROUNDING * (method.nodes() as f64).sqrt();
        let cost_ms = self.cost.predict_ms(method, psf, self.plan.stars.len(), self.plan.half_px, self.plan.extent_px);
        let verdict = if matches!(method, Method::GaussLegendre { .. }) && !self.plan.motion.is_smooth() {
            Verdict::NeedsSmoothMotion
        } else if matches!(method, Method::EffectivePsf { .. }) && self.plan.extent_px > LONGEST_KERNEL_PX {
            Verdict::PathTooLong
        } else if centroid_px > MOTION_SHARE * self.budget.centroid_px {
            Verdict::CentroidOverBudget
        } else if pixel_sigma > self.budget.pixel_sigma {
            Verdict::PixelOverBudget
        } else if flux_rel > self.budget.flux_rel {
            Verdict::FluxOverBudget
        } else {
            Verdict::Fits
        };
        Assessment { method, centroid_px, flux_rel, pixel_sigma, cost_ms, verdict }
    }

    /// Centroid (px) and peak error of the nodes in `trial` by characteristic functions, for the watched probes.
    fn long_path_error(&self, method: Method) -> (f64, f64) {
        let shared = matches!(method, Method::EffectivePsf { .. });
        let own = self.watched[0].probe == self.watched[1].probe;
        let (mut centroid_px, mut peak) = (0.0_f64, 0.0_f64);
        for watched in &self.watched[..if own { 1 } else { 2 }] {
            let Some(track) = self.probes.get(if shared { 0 } else { watched.probe }) else { continue };
            let drawn = self.sensitivity.spectrum(track, &self.trial);
            let (moment, of_peak) = self.sensitivity.error(&drawn, &watched.truth);
            centroid_px = centroid_px.max(moment / self.light_share(WINDOW_PX));
            peak = peak.max(of_peak);
        }
        (centroid_px, peak)
    }

    /// Least share of a star's light in the brightest square of `side_px`: along a path of `reach_px`, or all over the
    /// square that holds the path.
    fn light_share(&self, side_px: f64) -> f64 {
        let along = side_px / (side_px + self.plan.reach_px);
        let square = (side_px / (side_px + 2.0 * self.plan.extent_px)).powi(2);
        along.max(square)
    }

    /// Centroid error of light that the footprint drops, px: none while the footprint's rim stays outside the window.
    fn rim_error_px(&self) -> f64 {
        let rim_px = self.plan.half_px as f64 - 0.5 - self.plan.extent_px;
        if rim_px > 0.5 * WINDOW_PX + 0.5 { 0.0 } else { 0.5 * self.instrument.psf.lost_flux(self.plan.half_px) }
    }

    /// Electrons of the brightest star in the plan.
    fn brightest_e(&self) -> f64 {
        self.plan.stars.iter().map(|star| star.electrons).fold(0.0, f64::max)
    }

    /// What the linear model of motion leaves out, px; every method draws with it.
    ///
    /// Smooth: cubic term beside the parabola through three projections, `f |w T|^3 / (8 * 9 sqrt 3)` times the 3 of
    /// the tangent's third derivative and 1.5 for the field's edge, at the largest rate of the exposure; a rotation that
    /// accelerates has cubic and quartic terms already in
    /// second order, `f w T a T^2 / 2` (times `6 / 124.7`) and `f (a T^2)^2 / 8` (times `1 / 64`). Jitter:
    /// second order in its own angle and its product with the smooth rotation (`z` about the line of sight, `J` and
    /// `S` px across it, field radius `r`): `z_j (J + S) + z_s J + z_j^2 r / 2`, and the tangent's curvature
    /// `2 r (J + S) J / f^2` with the mean of `S`. Image path: it rolls the smooth displacement too, `roll (S + z_s r)`.
    fn model_error_px(&self) -> f64 {
        let motion = &self.plan.motion;
        let los = &motion.los;
        let [fx, fy] = self.instrument.camera.parameters().focal_px;
        let focal_px = fx.max(fy);
        let radius_px = furthest_corner_px(&self.instrument.camera);
        let half_s = 0.5 * los.exposure_s;
        let turn_rad = 2.0 * half_s * (los.rate_rad_s.length() + half_s * los.acceleration_rad_s2.length());
        let (turn, bend) =
            (los.rate_rad_s.length() * los.exposure_s, los.acceleration_rad_s2.length() * 4.0 * half_s * half_s);
        let cubic_px = 4.5 * focal_px * turn_rad.powi(3) / 124.7 + focal_px * bend * (0.03 * turn + 0.002 * bend);
        let smooth = los.rate_rad_s.abs() * half_s + los.acceleration_rad_s2.abs() * (0.5 * half_s * half_s);
        let (smooth_px, smooth_roll) = (focal_px * smooth.x.hypot(smooth.y), smooth.z);
        let second_px = match &motion.image_path {
            Some(path) => {
                let roll = path.points().iter().fold(0.0_f64, |most, point| most.max(point.roll_rad.abs()));
                roll * MEAN_SMOOTH * (smooth_px + smooth_roll * radius_px)
            }
            None => {
                let lines = los.jitter.lines.iter().fold(DVec3::ZERO, |sum, line| sum + line.amplitude_rad.abs());
                let points = los.jitter.points.iter().fold(DVec3::ZERO, |most, p| most.max(p.rotation_rad.abs()));
                let jitter = lines + points;
                let jitter_px = focal_px * jitter.x.hypot(jitter.y);
                jitter.z * (jitter_px + MEAN_SMOOTH * smooth_px + 0.5 * jitter.z * radius_px)
                    + MEAN_SMOOTH * smooth_roll * jitter_px
                    + 2.0 * radius_px * (jitter_px + MEAN_SMOOTH * smooth_px) * jitter_px / (focal_px * focal_px)
            }
        };
        cubic_px + second_px
    }

    /// What the planner's own list of nodes leaves out, relative to its PSF: pairs `h` apart on average and up to
    /// `pi / 2` times further where a sinusoid is fast err by `(h / sigma)^4 / 270`.
    fn dense_error(&self) -> f64 {
        let motion = &self.plan.motion;
        if motion.is_smooth() || matches!(motion.image_path, Some(PixelPath::Samples(_))) {
            return 0.0;
        }
        let step_px = core::f64::consts::FRAC_PI_2 * self.plan.reach_px / self.dense.len() as f64;
        (step_px / self.instrument.psf.core_sigma_px()).powi(4) / 270.0
    }

    /// Nodes of the chosen method, into the plan.
    fn fill_nodes(&mut self) {
        let plan = &mut self.plan;
        match plan.chosen.method {
            Method::Static => nodes::single(&plan.mean, &mut plan.nodes),
            Method::GaussLegendre { nodes } => nodes::gauss_legendre_in_time(&plan.motion, nodes, &mut plan.nodes),
            Method::EffectivePsf { nodes } | Method::Samples { nodes } => {
                nodes::samples(&plan.motion, nodes, &plan.mean, &mut plan.nodes);
            }
        }
    }

    fn share_light(&mut self) {
        let Self { plan, share, .. } = self;
        for star in &mut plan.stars {
            star.electrons_on_detector = star.electrons * share.on_detector(star, &plan.nodes, plan.extent_px);
        }
    }
}

/// Distance of the furthest pixel from the principal point, px.
fn furthest_corner_px(camera: &CameraGeometry) -> f64 {
    let [cx, cy] = camera.parameters().principal_point_px;
    let furthest = |c: f64, size: usize| c.abs().max((size as f64 - 1.0 - c).abs());
    furthest(cx, camera.width_px()).hypot(furthest(cy, camera.height_px()))
}

/// Gauss-Legendre nodes for a smooth path of `reach_px`: 1.5 per sigma, and two for the ends.
fn gauss_legendre_count(reach_px: f64, sigma_px: f64) -> usize {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 2..=512")]
    let count = (1.5 * reach_px / sigma_px + 2.0).ceil().clamp(2.0, 512.0) as usize;
    count
}

/// Furthest any probe is led from its mean position, px.
fn extent_px(probes: &[StarTrack], nodes: &[PathNode], mean: &Features) -> f64 {
    let mut extent: f64 = 0.0;
    for probe in probes {
        let [mx, my] = probe.displacement_px(mean);
        for node in nodes {
            let [x, y] = probe.displacement_px(&node.phi);
            extent = extent.max((x - mx).abs()).max((y - my).abs());
        }
    }
    extent
}

/// Upper bound of the length of a star's path on the detector, px.
fn path_length_px(motion: &Motion, probe: &StarTrack, radius_px: f64) -> f64 {
    let along = |i: usize| probe.response[0][i].hypot(probe.response[1][i]);
    let smooth = along(0) + 0.5 * along(1);
    let shared = match &motion.image_path {
        Some(path) => path.points().windows(2).map(|pair| pair[0].distance_px(&pair[1], radius_px)).sum(),
        None => {
            let jitter = &motion.los.jitter;
            let cycles = |hz: f64| hz * motion.los.exposure_s;
            let moved = |v: DVec3| along(2) * v.x.abs() + along(3) * v.y.abs() + along(4) * v.z.abs();
            // A sinusoid's arc: 4 A per cycle; less than a cycle may still be crossed once: 2 A.
            let lines: f64 =
                jitter.lines.iter().map(|l| moved(l.amplitude_rad) * 4.0 * cycles(l.frequency_hz).max(0.5)).sum();
            let points: f64 = jitter.points.windows(2).map(|p| moved(p[1].rotation_rad - p[0].rotation_rad)).sum();
            lines + points
        }
    };
    smooth + shared
}
