//! Sample stars at the corners, the edges' middles and the centre of the detector, with their true paths.
//!
//! In: motion, camera. Out: for nine probes the mean, the moments and the trace of the exact path, integrated over a
//! dense list of poses; for four more, between them, the mean. The nodes of a method are compared with these before any
//! pixel is drawn. Limits: the motion between probes must be smooth in the field (perspective, a lens).

use crate::exposure::line::Merged;
use crate::exposure::moments::{Moments, TracePoint, trace};
use crate::exposure::motion::{Motion, Shutter};
use crate::exposure::pose::{PathNode, PixelPath, Pose, mean_pose};
use crate::exposure::track::{StarPlace, StarTrack};
use crate::exposure::{line, nodes};
use core::ops::Range;
use glam::{DQuat, DVec3};
use sky::astrometry::CameraGeometry;

/// Number of probes along each side of the detector.
pub const SIDE: usize = 3;
/// Rotation by which a probe's response is measured, rad.
const SMALL_RAD: f64 = 1e-7;
/// Number of additional nodes of the dense list of a smooth path compared with a method.
const DENSER: usize = 8;
/// Steps of a row of a path in time, whose length is measured and which is merged with its neighbours.
const ROW_STEPS: usize = 3;
/// Upper bound of arc over chord of a smooth path.
const ARC: f64 = 1.05;

/// One probe.
#[derive(Debug, Clone)]
pub struct Probe {
    /// Its place.
    pub track: StarTrack,
    /// Movement per rotation about each sensor axis, px/rad.
    px_per_rad: [f64; 3],
    /// True path about its mean.
    pub trace: Vec<TracePoint>,
    /// True mean displacement, px.
    pub mean_px: [f64; 2],
    /// Its moments.
    pub moments: Moments,
}

/// All probes of one camera.
#[derive(Debug)]
pub struct Probes {
    /// The camera.
    pub camera: CameraGeometry,
    shutter: Shutter,
    /// Probes row by row from the top left corner.
    pub probes: Vec<Probe>,
    checks: Vec<Probe>,
    dense: Vec<PathNode>,
    /// Ends of the stretches of a commanded path in time, s since the exposure started.
    ends_s: Vec<f64>,
    rows: [Row; SIDE],
    /// Upper bound of the path's length on the detector, px.
    pub reach_px: f64,
    /// Largest distance of a star from its mean position along the path, px.
    pub extent_px: f64,
    /// Narrower side of the box about the path of the star in the middle of the detector, px.
    pub narrow_px: f64,
}

/// Dense nodes of one row of probes.
#[derive(Debug, Clone, Default)]
struct Row {
    nodes: Range<usize>,
    ends: Range<usize>,
    mean: Pose,
    merged: Merged,
}

impl Probes {
    /// Returns the probes on `camera`'s detector.
    pub fn new(camera: &CameraGeometry, shutter: Shutter) -> Self {
        let size = [camera.width_px(), camera.height_px()].map(|side| side as f64 - 1.0);
        let place = |at: [f64; 2]| Probe::new(camera, [at[0] * size[0], at[1] * size[1]]);
        let grid = |i: usize| i as f64 / (SIDE - 1) as f64;
        let probes = (0..SIDE * SIDE).filter_map(|i| place([grid(i % SIDE), grid(i / SIDE)])).collect();
        let checks = [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]].into_iter().filter_map(place).collect();
        let lists = if shutter == Shutter::Global { 1 } else { SIDE };
        Self {
            camera: *camera,
            shutter,
            probes,
            checks,
            dense: Vec::with_capacity(lists * line::DENSE_RESERVED),
            ends_s: Vec::with_capacity(line::DENSE_RESERVED),
            rows: Default::default(),
            reach_px: 0.0,
            extent_px: 0.0,
            narrow_px: 0.0,
        }
    }

    /// Returns the probe in the middle of the detector.
    pub fn centre(&self) -> Option<&Probe> {
        self.probes.get(self.centre_index())
    }

    /// Returns the index of that probe.
    pub fn centre_index(&self) -> usize {
        self.probes.len() / 2
    }

    /// Returns the probe whose path spreads most.
    pub fn widest_index(&self) -> usize {
        let spread = |i: &usize| self.probes[*i].moments.covariance_px2[0] + self.probes[*i].moments.covariance_px2[2];
        (0..self.probes.len()).max_by(|a, b| spread(a).total_cmp(&spread(b))).unwrap_or(0)
    }

    /// Returns the mean pose of the middle row's exposure.
    pub fn mean(&self) -> Pose {
        self.rows[SIDE / 2].mean
    }

    /// Returns the dense nodes of the middle row's exposure.
    pub fn dense(&self) -> &[PathNode] {
        &self.dense[self.rows[SIDE / 2].nodes.clone()]
    }

    /// Computes the true paths of all probes.
    pub fn measure(&mut self, motion: &Motion, sigma_px: f64) {
        let radius_px = furthest_corner_px(&self.camera);
        let shared_px = motion.image_path.as_ref().map(|path| path.length_px(radius_px));
        self.reach_px = self.probes.iter().map(|probe| probe.path_length_px(motion, shared_px)).fold(0.0, f64::max);
        self.dense.clear();
        self.ends_s.clear();
        for row in 0..SIDE {
            if row > 0 && self.shutter == Shutter::Global {
                self.rows[row] = self.rows[0].clone();
                continue;
            }
            let delay_s = self.delay_s(row);
            let (first, first_end) = (self.dense.len(), self.ends_s.len());
            let lengths_px = [self.reach_px, radius_px];
            let merged = dense_nodes(motion, sigma_px, lengths_px, delay_s, &mut self.ends_s, &mut self.dense);
            let nodes = first..self.dense.len();
            let mean = mean_pose(&self.dense[nodes.clone()]);
            self.rows[row] = Row { mean, nodes, ends: first_end..self.ends_s.len(), merged };
        }
        let Self { camera, probes, dense, rows, extent_px, .. } = self;
        *extent_px = 0.0;
        for (i, probe) in probes.iter_mut().enumerate() {
            probe.follow(camera, &dense[rows[(i / SIDE).min(SIDE - 1)].nodes.clone()]);
            *extent_px = probe.trace.iter().fold(*extent_px, |far, [_, x, y]| far.max(x.abs()).max(y.abs()));
        }
        self.narrow_px = self.centre().map_or(0.0, Probe::narrow_px);
    }

    /// Returns a bound of the covariance that the dense nodes lack because rows of a path were merged, px^2.
    pub fn merged_px2(&self) -> f64 {
        self.rows.iter().map(|row| row.merged.covariance_px2).fold(0.0, f64::max)
    }

    /// Returns the ends of the stretches of a commanded path in time for a row of probes, s since the exposure started,
    /// and the factor by which merged rows make the path through them too short.
    pub(super) fn path_ends(&self, row: usize) -> (&[f64], f64) {
        let Row { ends, merged: Merged { length_px: [whole, short], .. }, .. } = &self.rows[row];
        (&self.ends_s[ends.clone()], if *short > 0.0 { whole / short } else { 1.0 })
    }

    /// Returns the steps that measuring took (see `cost`): the rows of a path in time, the dense nodes, each probe at each of
    /// them twice (its place and the length of its path), and the checks.
    pub(super) fn steps(&self, motion: &Motion) -> usize {
        let nodes: usize = self.rows.iter().map(|row| row.nodes.len()).sum();
        let rows = if self.shutter == Shutter::Global { 1 } else { SIDE };
        let own = if rows > 1 { self.checks.len() * motion.pose_steps() } else { 0 };
        let of_rows = match &motion.image_path {
            Some(PixelPath::Line(points)) => rows * points.len() * ROW_STEPS,
            Some(PixelPath::Samples(_)) | None => 0,
        };
        of_rows
            + self.dense.len() * motion.pose_steps()
            + nodes * 2 * SIDE
            + self.dense.len() / rows * (self.checks.len() + own)
    }

    /// Returns the delay of a row of probes, s.
    pub fn delay_s(&self, row: usize) -> f64 {
        let height = self.camera.height_px();
        self.shutter.delay_s(row as f64 / (SIDE - 1) as f64 * (height as f64 - 1.0), height)
    }

    /// Appends dense nodes of the exposure of rows that are `delay_s` late.
    pub fn true_nodes(&self, motion: &Motion, sigma_px: f64, delay_s: f64, out: &mut Vec<PathNode>) {
        let lengths_px = [self.reach_px, furthest_corner_px(&self.camera)];
        dense_nodes(motion, sigma_px, lengths_px, delay_s, &mut Vec::new(), out);
    }

    /// Returns the largest distance of a mean position computed by `mean_px` from the true one, between the probes, px.
    /// `own` is a buffer for the nodes of a row.
    #[must_use]
    pub fn mean_error_px(
        &self,
        motion: &Motion,
        sigma_px: f64,
        own: &mut Vec<PathNode>,
        mean_px: impl Fn(&StarTrack) -> [f64; 2],
    ) -> f64 {
        let radius_px = furthest_corner_px(&self.camera);
        let height = self.camera.height_px();
        let mut worst = 0.0_f64;
        for check in &self.checks {
            let track = &check.track;
            let nodes = if self.shutter == Shutter::Global {
                self.dense()
            } else {
                own.clear();
                let row_px = mean_px(track)[1] + track.place.mid_px[1];
                let (lengths_px, delay_s) = ([self.reach_px, radius_px], self.shutter.delay_s(row_px, height));
                dense_nodes(motion, sigma_px, lengths_px, delay_s, &mut Vec::new(), own);
                &*own
            };
            let truth = nodes.iter().fold([0.0; 2], |[x, y], node| {
                let [dx, dy] = track.exact_px(&self.camera, &node.pose);
                [x + node.weight * dx, y + node.weight * dy]
            });
            let [x, y] = mean_px(track);
            worst = worst.max((x - truth[0]).hypot(y - truth[1]));
        }
        worst
    }
}

impl Probe {
    fn new(camera: &CameraGeometry, px: [f64; 2]) -> Option<Self> {
        let track = StarTrack::new(camera, StarPlace::of_pixel(camera, px)?);
        let px_per_rad = DVec3::AXES.map(|axis| {
            let turn = Pose::new(DQuat::from_scaled_axis(axis * SMALL_RAD), 0.0, [0.0; 2]);
            let [x, y] = track.displacement_px(&turn);
            x.hypot(y) / SMALL_RAD
        });
        let trace = Vec::with_capacity(line::DENSE_RESERVED);
        Some(Self { track, px_per_rad, trace, mean_px: [0.0; 2], moments: Moments::default() })
    }

    fn follow(&mut self, camera: &CameraGeometry, nodes: &[PathNode]) {
        let track = &self.track;
        let points = nodes.iter().map(|node| {
            let [x, y] = track.exact_px(camera, &node.pose);
            [node.weight, x, y]
        });
        self.mean_px = trace(points, &mut self.trace);
        self.moments = Moments::of(&self.trace);
    }

    /// Returns the narrower side of the box about its path, px.
    fn narrow_px(&self) -> f64 {
        let side = |axis: usize| {
            let [low, high] = self
                .trace
                .iter()
                .fold([0.0_f64; 2], |[low, high], place| [low.min(place[axis]), high.max(place[axis])]);
            high - low
        };
        side(1).min(side(2))
    }

    /// Returns an upper bound of the length of the star's path on the detector, px; `shared_px`: that of a commanded path.
    fn path_length_px(&self, motion: &Motion, shared_px: Option<f64>) -> f64 {
        let moved = |v: DVec3| v.abs().dot(self.px_per_rad.into());
        let half_s = 0.5 * motion.los.exposure_s;
        let (start, end) = (motion.smooth_rotation_rad(-half_s), motion.smooth_rotation_rad(half_s));
        let smooth = ARC * (self.chord_px(start) + self.chord_px(end));
        let shared = match shared_px {
            Some(shared_px) => shared_px,
            None => {
                let jitter = &motion.los.jitter;
                let cycles = |hz: f64| hz * motion.los.exposure_s;
                // Arc of a sinusoid: 4 A per cycle; less than a cycle may still be crossed once: 2 A.
                let lines: f64 =
                    jitter.lines.iter().map(|l| moved(l.amplitude_rad) * 4.0 * cycles(l.frequency_hz).max(0.5)).sum();
                let points: f64 = jitter.points.windows(2).map(|p| moved(p[1].rotation_rad - p[0].rotation_rad)).sum();
                lines + points
            }
        };
        smooth + shared
    }

    fn chord_px(&self, rotation_rad: DVec3) -> f64 {
        let [x, y] = self.track.displacement_px(&Pose::new(DQuat::from_scaled_axis(-rotation_rad), 0.0, [0.0; 2]));
        x.hypot(y)
    }
}

/// Appends the dense list of one row's exposure; see [`line::append`].
fn dense_nodes(
    motion: &Motion,
    sigma_px: f64,
    [reach_px, radius_px]: [f64; 2],
    delay_s: f64,
    ends_s: &mut Vec<f64>,
    out: &mut Vec<PathNode>,
) -> Merged {
    if motion.is_still() {
        nodes::single(&Pose::STILL, out);
    } else if motion.is_smooth() {
        nodes::gauss_legendre_in_time(motion, gauss_legendre_count(reach_px, sigma_px) + DENSER, delay_s, out);
    } else {
        return line::append(motion, sigma_px, [reach_px, radius_px], delay_s, ends_s, out);
    }
    Merged::default()
}

/// Returns the distance of the furthest pixel from the principal point, px.
pub fn furthest_corner_px(camera: &CameraGeometry) -> f64 {
    let [cx, cy] = camera.parameters().principal_point_px;
    let furthest = |c: f64, size: usize| c.abs().max((size as f64 - 1.0 - c).abs());
    furthest(cx, camera.width_px()).hypot(furthest(cy, camera.height_px()))
}

/// Returns the number of Gauss-Legendre nodes for a smooth path of `reach_px`: 1.5 per sigma, plus two for the ends, of
/// the path or of every panel of a long one.
pub fn gauss_legendre_count(reach_px: f64, sigma_px: f64) -> usize {
    let wanted = (1.5 * reach_px / sigma_px + 2.0).ceil();
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to MOST_SMOOTH_NODES")]
    let count = wanted.clamp(2.0, nodes::MOST_SMOOTH_NODES as f64) as usize;
    if count <= nodes::ONE_RULE_NODES - DENSER {
        return count;
    }
    let panels = count.div_ceil(nodes::PANEL_NODES - 2);
    (panels * nodes::PANEL_NODES).min(nodes::MOST_SMOOTH_NODES)
}
