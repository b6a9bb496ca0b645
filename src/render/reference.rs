//! The f64 reference: integrates the exact motion with the exact PSF. Slow; the truth in the house.
//!
//! Time: composite Gauss-Legendre, panels short against the PSF and against the fastest jitter, broken where the
//! path has corners; every node projects every star anew (no list of poses, no derivative), and under a rolling shutter
//! every row has instants of its own. Error: 1e-9 of the flux per
//! pixel and better for a Gaussian (tests against independent truth in `tests/physics`). An Airy pattern costs about
//! 0.2 s per star and node.

use crate::base::image::Image;
use crate::exposure::nodes::for_each_segment;
use crate::exposure::track::turned;
use crate::exposure::{ExposurePlan, Motion, PixelPath, PixelPoint, PlannedStar, Shutter};
use crate::gpu::Electrons;
use crate::optics::PsfModel;
use crate::optics::gaussian;
use crate::optics::quadrature::gauss_legendre;
use crate::render::{Backend, RenderError};
use rayon::prelude::*;

/// Nodes per panel.
const PANEL_NODES: usize = 8;
/// Panels per period of the fastest jitter line.
const PANELS_PER_PERIOD: f64 = 6.0;
/// A panel moves a star by at most this many sigma.
const PANEL_SIGMA: f64 = 1.0;
/// Rows that a rolling shutter may move a star by, beyond its own path, px.
const ROLLING_SLACK_PX: f64 = 8.0;
/// Light the reference may lose beyond its footprint (Gaussian).
const LOST_FLUX: f64 = 1e-13;

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
    /// For a detector of this size.
    #[must_use]
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

    fn render(&mut self, plan: &ExposurePlan) -> Result<(), RenderError> {
        let half = plan.half_px.max(plan.psf.half_px(LOST_FLUX));
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
    /// All rows see the same instants.
    fn render_at_once(&mut self, plan: &ExposurePlan, half: usize) {
        let instants = instants(&plan.motion, plan, 0.0);
        let places: Vec<Vec<[f64; 2]>> =
            plan.stars.par_iter().map(|star| instants.iter().map(|at| place(plan, star, at)).collect()).collect();
        let width = self.image.width();
        self.image.pixels_mut().par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
            row.fill(0.0);
            for (star, places) in plan.stars.iter().zip(&places) {
                for (at, px) in instants.iter().zip(places) {
                    add_star(plan, star, half, row, y, *px, star.electrons * at.weight);
                }
            }
        });
    }

    /// Each row has its own exposure.
    fn render_by_row(&mut self, plan: &ExposurePlan, half: usize) {
        let (width, height) = (self.image.width(), self.image.height());
        let reach = half as f64 + 2.0 * plan.extent_px + ROLLING_SLACK_PX;
        self.image.pixels_mut().par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
            row.fill(0.0);
            let near: Vec<_> = plan.stars.iter().filter(|star| (star.mean_px[1] - y as f64).abs() <= reach).collect();
            if near.is_empty() {
                return;
            }
            for at in instants(&plan.motion, plan, plan.shutter.delay_s(y as f64, height)) {
                for star in &near {
                    add_star(plan, star, half, row, y, place(plan, star, &at), star.electrons * at.weight);
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
    let PsfModel::Field(field) = &plan.psf else { return add_row(&plan.psf, half, row, y, px, electrons) };
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
    let scale = match psf {
        PsfModel::Gaussian { sigma_px } => electrons * gaussian::cell(dy, *sigma_px),
        _ => electrons,
    };
    for (x, pixel) in row.iter_mut().enumerate().take(end).skip(first) {
        let dx = x as f64 - px[0];
        *pixel += scale
            * match psf {
                PsfModel::Gaussian { sigma_px } => gaussian::cell(dx, *sigma_px),
                psf => psf.pixel(dx, dy),
            };
    }
}

/// Exact place of a star at one instant, px (NaN when it has left the camera's domain).
fn place(plan: &ExposurePlan, star: &PlannedStar, at: &Instant) -> [f64; 2] {
    let motion = &plan.motion;
    let smooth = motion.smooth_rotation_rad(at.t_s);
    let moves = smooth != glam::DVec3::ZERO || (motion.image_path.is_none() && !motion.los.jitter.is_still());
    let px = if moves {
        let mut direction = turned(star.place.mid_sensor(), smooth);
        if motion.image_path.is_none() {
            direction = turned(direction, motion.los.jitter_rotation_rad(at.t_s));
        }
        plan.camera.project(direction).unwrap_or([f64::NAN; 2])
    } else {
        star.place.mid_px
    };
    let Some(path) = at.path else { return px };
    let [cx, cy] = plan.camera.parameters().principal_point_px;
    let (sin, cos) = path.roll_rad.sin_cos();
    let (rx, ry) = (px[0] - cx, px[1] - cy);
    [cx + cos * rx - sin * ry + path.dx_px, cy + sin * rx + cos * ry + path.dy_px]
}

/// The instants of an exposure that is `delay_s` late, with weights that sum to 1.
fn instants(motion: &Motion, plan: &ExposurePlan, delay_s: f64) -> Vec<Instant> {
    let sigma_px = plan.psf.core_sigma_px();
    let exposure_s = motion.los.exposure_s;
    let radius_px = (plan.camera.width_px() as f64).hypot(plan.camera.height_px() as f64);
    let mut out = Vec::new();
    match &motion.image_path {
        Some(PixelPath::Samples(points)) => {
            let weight = 1.0 / points.len() as f64;
            let t_s = |i: usize| ((i as f64 + 0.5) * weight - 0.5) * exposure_s + delay_s;
            out.extend(points.iter().enumerate().map(|(i, p)| Instant { weight, t_s: t_s(i), path: Some(*p) }));
        }
        Some(PixelPath::Line(points)) => {
            let smooth_px = smooth_length_px(plan);
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
            let sigmas = (plan.reach_px / sigma_px).max(periods * PANELS_PER_PERIOD * PANEL_SIGMA);
            let mut corners = vec![-0.5];
            let mid = motion.los.mid_exposure();
            corners.extend(motion.los.jitter.points.iter().map(|p| ((p.at - mid).s() - delay_s) / exposure_s));
            corners.retain(|tau| (-0.5..0.5).contains(tau));
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

/// Length of the smooth part of the longest path, px: chords from the middle to both ends, and a little for the arc.
fn smooth_length_px(plan: &ExposurePlan) -> f64 {
    let half_s = 0.5 * plan.motion.los.exposure_s;
    let chord = |star: &PlannedStar, t_s: f64| {
        let moved = turned(star.place.mid_sensor(), plan.motion.smooth_rotation_rad(t_s));
        let [x, y] = plan.camera.project(moved).unwrap_or(star.place.mid_px);
        (x - star.place.mid_px[0]).hypot(y - star.place.mid_px[1])
    };
    plan.stars.iter().map(|star| 1.2 * (chord(star, -half_s) + chord(star, half_s))).fold(0.0, f64::max)
}

/// Composite Gauss-Legendre over `start .. start + share`, a panel per [`PANEL_SIGMA`] of motion.
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
