//! The f64 reference: integrates the exact motion with the exact PSF. Slow; the truth that the others are compared
//! with.
//!
//! Time: composite Gauss-Legendre, panels short against the PSF and against the fastest jitter, split at the corners of
//! the path; every node projects every star again (no list of poses, no derivative), and under a rolling shutter every
//! row has instants of its own. Error: 1e-9 of the flux per pixel and better for a Gaussian (tests against independent
//! truth in `tests/physics`). An Airy pattern costs about 0.2 s per star and node. A PSF other than a Gaussian is cut
//! [`LARGEST_HALF_PX`](plan::optics::psf::LARGEST_HALF_PX) from a star: the light of its wings beyond that is lost here
//! too.

use crate::{gpu::Electrons, render::Backend};
use base::{image::Image, refused::Refused};
use plan::exposure::track::{StarPlace, turned};
use plan::exposure::{ExposurePlan, Motion, PixelPath, PixelPoint, PlannedStar, PlannedTarget, Shutter};
use plan::exposure::{line::for_each_segment, target_plan::seen_after_mid_s};
use plan::optics::quadrature::gauss_legendre;
use plan::optics::{PsfForm, PsfModel, gaussian};
use rayon::prelude::*;

/// Nodes per panel.
const PANEL_NODES: usize = 8;
/// Panels per period of the fastest jitter line.
const PANELS_PER_PERIOD: f64 = 6.0;
/// A panel moves a star by at most this many sigma.
const PANEL_SIGMA: f64 = 1.0;
/// Rows that a rolling shutter may move a star by, beyond its own path, px.
const ROLLING_SLACK_PX: f64 = 8.0;

/// One instant of the exposure.
#[derive(Debug, Clone, Copy)]
struct Instant {
    weight: f64,
    /// Since the frame's mid-exposure, s.
    t_s: f64,
    path: Option<PixelPoint>,
}

/// The reference backend.
#[derive(Debug)]
pub struct Reference {
    image: Image<f64>,
}

impl Reference {
    /// Returns a renderer for a detector of this size.
    pub fn new(width_px: usize, height_px: usize) -> Self {
        Self { image: Image::new(width_px, height_px) }
    }
}

impl Backend for Reference {
    fn name(&self) -> &'static str {
        "reference"
    }

    fn description(&self) -> String {
        format!("f64 reference, {} threads", rayon::current_num_threads())
    }

    fn render(&mut self, plan: &ExposurePlan) -> Result<(), Refused> {
        let half = plan.half_px.max(plan.psf.whole_half_px());
        match plan.shutter {
            Shutter::Global => self.render_at_once(plan, half),
            Shutter::Rolling { .. } => self.render_by_row(plan, half),
        }
        Ok(())
    }

    fn electrons(&self) -> Electrons<'_> {
        Electrons::Precise(&self.image)
    }
}

impl Reference {
    /// Draws the plan with the same instants for all rows.
    fn render_at_once(&mut self, plan: &ExposurePlan, half: usize) {
        let instants = instants(&plan.motion, plan, 0.0);
        let stars = plan.sky_stars();
        let places: Vec<Vec<[f64; 2]>> =
            stars.par_iter().map(|star| instants.iter().map(|at| place(plan, &star.place, at)).collect()).collect();
        let ways: Vec<Vec<Lit>> = plan.targets.iter().map(|target| target_way(plan, target, 0.0)).collect();
        let width = self.image.width();
        self.image.pixels_mut().par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
            row.fill(0.0);
            for (star, places) in stars.iter().zip(&places) {
                for (at, px) in instants.iter().zip(places) {
                    add_star(plan, star, half, row, y, *px, star.electrons * at.weight);
                }
            }
            for (px, electrons) in ways.iter().flatten() {
                add_row(&plan.psf, half, row, y, *px, *electrons);
            }
        });
    }

    /// Draws the plan with each row's own exposure.
    fn render_by_row(&mut self, plan: &ExposurePlan, half: usize) {
        let (width, height) = (self.image.width(), self.image.height());
        let reach = half as f64 + 2.0 * plan.extent_px + ROLLING_SLACK_PX;
        self.image.pixels_mut().par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
            row.fill(0.0);
            let near = |star: &&PlannedStar| (star.mean_px[1] - y as f64).abs() <= reach;
            let near: Vec<_> = plan.sky_stars().iter().filter(near).collect();
            let delay_s = plan.shutter.delay_s(y as f64, height);
            for (px, electrons) in plan.targets.iter().flat_map(|target| target_way(plan, target, delay_s)) {
                add_row(&plan.psf, half, row, y, px, electrons);
            }
            if near.is_empty() {
                return;
            }
            for at in instants(&plan.motion, plan, delay_s) {
                for star in &near {
                    add_star(plan, star, half, row, y, place(plan, &star.place, &at), star.electrons * at.weight);
                }
            }
        });
    }
}

/// Adds one star at one instant to row `y`; in a field of PSFs, by those about its mean place.
fn add_star(
    plan: &ExposurePlan,
    star: &PlannedStar,
    half: usize,
    row: &mut [f64],
    y: usize,
    px: [f64; 2],
    electrons: f64,
) {
    let Some(field) = plan.psf.as_field() else { return add_row(&plan.psf, half, row, y, px, electrons) };
    for (node, share) in field.around(star.mean_px) {
        if share > 0.0 {
            add_row(&field.nodes()[node], half, row, y, px, share * electrons);
        }
    }
}

/// Adds one star of one PSF at one instant to row `y`.
fn add_row(psf: &PsfModel, half: usize, row: &mut [f64], y: usize, px: [f64; 2], electrons: f64) {
    let dy = y as f64 - px[1];
    let reach = half as f64 + 0.5;
    if dy.abs() > reach || !px.iter().all(|v| v.is_finite()) {
        return;
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the row")]
    let clamp = |x: f64| x.clamp(0.0, row.len() as f64) as usize;
    let (first, end) = (clamp((px[0] - reach).ceil()), clamp((px[0] + reach).floor() + 1.0));
    let sigma_px = if let PsfForm::Gaussian(sigma_px) = psf.form() { Some(sigma_px) } else { None };
    let scale = sigma_px.map_or(electrons, |sigma_px| electrons * gaussian::cell(dy, sigma_px));
    for (x, pixel) in row.iter_mut().enumerate().take(end).skip(first) {
        let dx = x as f64 - px[0];
        *pixel += scale * sigma_px.map_or_else(|| psf.pixel(dx, dy), |sigma_px| gaussian::cell(dx, sigma_px));
    }
}

/// Light at a place: px, e-.
type Lit = ([f64; 2], f64);

/// Returns a target's light along its way while rows that are `delay_s` late see it: its own way and the camera's exact
/// motion.
fn target_way(plan: &ExposurePlan, planned: &PlannedTarget, delay_s: f64) -> Vec<Lit> {
    let (target, motion) = (&planned.target, &plan.motion);
    let Some([from_s, to_s]) = seen_after_mid_s(target, motion, delay_s) else { return Vec::new() };
    let (camera, los) = (&plan.camera, &motion.los);
    let own_px = target.length_px(camera, los, [from_s, to_s]);
    let ends = [from_s, to_s].map(|t_s| target.own_px(camera, los, t_s));
    if !ends.into_iter().all(|px| px.is_some_and(|px| px.into_iter().all(f64::is_finite))) {
        return Vec::new();
    }
    let instants = instants_along(motion, plan, delay_s, own_px, [from_s, to_s]);
    let lit = |at: &Instant| {
        let start = target.own_place(camera, los, at.t_s)?;
        Some((place(plan, &start, at), target.e_per_s_at(at.t_s) * los.exposure_s * at.weight))
    };
    instants.iter().filter(|at| (from_s..=to_s).contains(&at.t_s)).filter_map(lit).collect()
}

/// Returns the exact place of a star at one instant, px (NaN when it has left the camera's domain).
fn place(plan: &ExposurePlan, star: &StarPlace, at: &Instant) -> [f64; 2] {
    let motion = &plan.motion;
    let smooth = motion.smooth_rotation_rad(at.t_s);
    let moves = smooth != glam::DVec3::ZERO || (motion.image_path.is_none() && !motion.los.jitter.is_still());
    let px = if moves {
        let mut direction = turned(star.mid_sensor(), smooth);
        if motion.image_path.is_none() {
            direction = turned(direction, motion.los.jitter_rotation_rad(at.t_s));
        }
        plan.camera.project(direction).unwrap_or([f64::NAN; 2])
    } else {
        star.mid_px
    };
    let Some(path) = at.path else { return px };
    let [cx, cy] = plan.camera.parameters().principal_point_px;
    let (sin, cos) = path.roll_rad.sin_cos();
    let (rx, ry) = (px[0] - cx, px[1] - cy);
    [cx + cos * rx - sin * ry + path.dx_px, cy + sin * rx + cos * ry + path.dy_px]
}

/// Returns the instants of an exposure that is `delay_s` late, with weights that sum to 1.
fn instants(motion: &Motion, plan: &ExposurePlan, delay_s: f64) -> Vec<Instant> {
    instants_along(motion, plan, delay_s, 0.0, [f64::NEG_INFINITY, f64::INFINITY])
}

/// Returns the instants for something that moves `own_px` by itself while it is seen, s after mid-exposure.
fn instants_along(motion: &Motion, plan: &ExposurePlan, delay_s: f64, own_px: f64, seen_s: [f64; 2]) -> Vec<Instant> {
    let sigma_px = plan.psf.core_sigma_px();
    let exposure_s = motion.los.exposure_s;
    let radius_px = (plan.camera.width_px() as f64).hypot(plan.camera.height_px() as f64);
    let mut out = Vec::new();
    match &motion.image_path {
        Some(PixelPath::Samples(points)) => {
            let weight = 1.0 / points.len() as f64;
            for (i, point) in points.iter().enumerate() {
                let mut add = |weight, tau: f64| {
                    out.push(Instant { weight, t_s: tau * exposure_s + delay_s, path: Some(*point) });
                };
                // Own motion continues while the path is at rest.
                if own_px > 0.0 {
                    panels(i as f64 * weight - 0.5, weight, own_px * weight / sigma_px, add);
                } else {
                    add(weight, (i as f64 + 0.5) * weight - 0.5);
                }
            }
        }
        Some(PixelPath::Line(points)) => {
            let smooth_px = smooth_length_px(plan) + own_px;
            for_each_segment(points, exposure_s, delay_s, |a, b| {
                let share = (b.t_s - a.t_s) / exposure_s;
                let length_px = a.distance_px(b, radius_px) + share * smooth_px;
                panels(0.0, share, length_px / sigma_px, |weight, at| {
                    let path = a.towards(b, (at / share).clamp(0.0, 1.0));
                    out.push(Instant { weight, t_s: path.t_s - 0.5 * exposure_s, path: Some(path) });
                });
            });
        }
        None => {
            let periods = motion.los.jitter.highest_line_hz() * exposure_s;
            let sigmas = ((plan.reach_px + own_px) / sigma_px).max(periods * PANELS_PER_PERIOD * PANEL_SIGMA);
            let mut corners = vec![-0.5];
            let mid = motion.los.mid_exposure();
            corners.extend(motion.los.jitter.points.iter().map(|p| ((p.at - mid).s() - delay_s) / exposure_s));
            corners.extend(seen_s.map(|t_s| (t_s - delay_s) / exposure_s));
            corners.retain(|tau| (-0.5..0.5).contains(tau));
            corners.sort_by(f64::total_cmp);
            corners.push(0.5);
            for pair in corners.windows(2) {
                let share = pair[1] - pair[0];
                panels(pair[0], share, sigmas * share, |weight, tau| {
                    out.push(Instant { weight, t_s: tau * exposure_s + delay_s, path: None });
                });
            }
        }
    }
    out
}

/// Returns the length of the smooth part of the longest path, px: chords from the middle to both ends, and a little for
/// the arc.
fn smooth_length_px(plan: &ExposurePlan) -> f64 {
    let half_s = 0.5 * plan.motion.los.exposure_s;
    let chord = |star: &PlannedStar, t_s: f64| {
        let moved = turned(star.place.mid_sensor(), plan.motion.smooth_rotation_rad(t_s));
        let [x, y] = plan.camera.project(moved).unwrap_or(star.place.mid_px);
        (x - star.place.mid_px[0]).hypot(y - star.place.mid_px[1])
    };
    plan.sky_stars().iter().map(|star| 1.2 * (chord(star, -half_s) + chord(star, half_s))).fold(0.0, f64::max)
}

/// Visits composite Gauss-Legendre nodes over `start .. start + share`, a panel per [`PANEL_SIGMA`] of motion.
fn panels(start: f64, share: f64, sigmas: f64, mut visit: impl FnMut(f64, f64)) {
    if share <= 0.0 {
        return;
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 1..=1e6")]
    let count = (sigmas / PANEL_SIGMA).ceil().clamp(1.0, 1e6) as usize;
    // A short panel of a finely given path needs no eight nodes.
    let nodes = gauss_legendre(if sigmas < 0.02 {
        2
    } else if sigmas < 0.2 {
        4
    } else {
        PANEL_NODES
    });
    let width = share / count as f64;
    for panel in 0..count {
        let middle = start + (panel as f64 + 0.5) * width;
        for node in &nodes {
            visit(node.weight * width, middle + node.x * width);
        }
    }
}
