//! The dense list of path nodes that serves as truth: other lists are compared with it. `delay_s` is the delay of the rows
//! after the frame's exposure.

use crate::exposure::line::{self, Merged};
use crate::exposure::nodes::{clamped, pair};
use crate::exposure::{motion::Motion, pixel_path::PixelPath, pose::PathNode};

/// Mean distance of dense nodes, share of the PSF's sigma. They come in Gauss-Legendre pairs: variance along a straight
/// piece is exact, and the characteristic function errs by `(k h)^4 / 270`.
const DENSE_STEP_SIGMA: f64 = 0.1;
/// Dense nodes per period of the fastest jitter line.
const DENSE_PER_PERIOD: f64 = 24.0;
/// Largest number of dense nodes of a path with jitter, when they are even.
pub const MOST_DENSE_NODES: usize = 4096;
/// Capacity of buffers for dense nodes: every stretch between two jitter samples may have a pair more.
pub const DENSE_RESERVED: usize = 2 * MOST_DENSE_NODES;

/// Appends the list with which the planner compares other lists; returns the rows that it merged. `reach_px`: length of
/// the jittered path on the detector, `radius_px`: furthest star from the principal point. `ends_s` gets the ends of a
/// path's stretches, in seconds since the exposure started.
pub fn append(
    motion: &Motion,
    sigma_px: f64,
    [reach_px, radius_px]: [f64; 2],
    delay_s: f64,
    ends_s: &mut Vec<f64>,
    out: &mut Vec<PathNode>,
) -> Merged {
    let step_px = DENSE_STEP_SIGMA * sigma_px;
    let exposure_s = motion.los.exposure_s;
    match &motion.image_path {
        None => {
            let by_period = motion.los.jitter.highest_line_hz() * exposure_s * DENSE_PER_PERIOD;
            let by_samples = 4.0 * motion.los.jitter.points.len() as f64;
            let wanted = (reach_px / step_px).max(by_period).max(by_samples);
            let panels = clamped(0.5 * wanted, 8, MOST_DENSE_NODES / 2) as f64;
            // Panels end at the samples, where the track has corners.
            for (from, share) in motion.stretches(delay_s) {
                let count = clamped(panels * share, 1, MOST_DENSE_NODES / 2);
                let step = share / count as f64;
                let taus = (0..count).flat_map(|panel| pair().map(|at| from + (panel as f64 + at) * step));
                out.extend(taus.map(|tau| PathNode { weight: 0.5 * step, pose: motion.pose_at(tau, delay_s) }));
            }
        }
        Some(PixelPath::Samples(points)) => {
            let weight = 1.0 / points.len() as f64;
            out.extend(points.iter().enumerate().map(|(i, point)| {
                let t_s = ((i as f64 + 0.5) * weight - 0.5) * exposure_s + delay_s;
                PathNode { weight, pose: motion.pose_on_path(t_s, point) }
            }));
        }
        Some(PixelPath::Line(points)) => {
            return line::along(motion, points, [step_px, radius_px], delay_s, ends_s, out);
        }
    }
    Merged::default()
}
