//! The chosen methods' nodes, and which star is drawn with which list.

use crate::astrometry::CameraGeometry;
use crate::exposure::correction::Correction;
use crate::exposure::method::Method;
use crate::exposure::motion::{Motion, Shutter};
use crate::exposure::nodes;
use crate::exposure::place::for_each_star;
use crate::exposure::plan::{Drawing, ExposurePlan, NodeList, PlannedStar};
use crate::exposure::pose::{PathNode, Pose, mean_pose};
use crate::exposure::probes::{Probes, SIDE};
use crate::exposure::track::{StarPlace, StarTrack};

/// Buffers kept from frame to frame.
#[derive(Debug, Default)]
pub struct Buffers {
    used: Vec<u32>,
}

/// No list.
const UNUSED: u32 = u32::MAX;

/// Fills nodes and lists of every class of stars, and gives each star its list.
pub fn fill(plan: &mut ExposurePlan, probes: &Probes, camera: &CameraGeometry, buffers: &mut Buffers) {
    plan.nodes.clear();
    plan.lists.clear();
    for class in 0..plan.classes.len() {
        let (method, bands) = (plan.classes[class].chosen.method, plan.classes[class].bands);
        let first = plan.lists.len();
        match method {
            Method::ZonalPsf { zones, .. } => fill_zones(plan, probes, camera, class, zones, buffers),
            _ => {
                let bands = bands.max(1);
                for band in 0..bands {
                    push_band(plan, probes, camera, method, [band, bands]);
                }
                // Stars come with the first list.
                if first == 0 && bands == 1 && plan.classes.len() == 1 {
                    continue;
                }
                let height = camera.height_px() as f64;
                assign(plan, class, |star| first as u32 + band_of(star.mean_px[1], height, bands) as u32);
            }
        }
    }
}

/// Gives the stars of a class the lists that `list` says.
fn assign(plan: &mut ExposurePlan, class: usize, list: impl Fn(&PlannedStar) -> u32 + Sync) {
    let only = plan.classes.len() == 1;
    let (above, faintest) = plan.brightness_of(class);
    for_each_star(&mut plan.stars, |star| {
        if only || (star.electrons < above && star.electrons >= faintest) {
            star.list = list(star);
        }
    });
}

/// One list of a method that is not zonal: `[band, bands]` of the rows.
fn push_band(
    plan: &mut ExposurePlan,
    probes: &Probes,
    camera: &CameraGeometry,
    method: Method,
    [band, bands]: [usize; 2],
) {
    let height = camera.height_px();
    let middle_px = (band as f64 + 0.5) / bands as f64 * (height as f64 - 1.0);
    let delay_s = plan.shutter.delay_s(middle_px, height);
    let first = plan.nodes.len();
    fill_nodes(&plan.motion, method, delay_s, probes, &mut plan.nodes);
    let drawing = match (method, probes.centre()) {
        (Method::Static, _) => Drawing::Once,
        (Method::Gaussian | Method::EffectivePsf { .. }, Some(centre)) => Drawing::Kernel(centre.track),
        _ => Drawing::Nodes,
    };
    push_list(plan, probes, first, drawing);
}

fn push_list(plan: &mut ExposurePlan, probes: &Probes, first: usize, drawing: Drawing) {
    let range = first..plan.nodes.len();
    let nodes = &plan.nodes[range.clone()];
    let mean = mean_pose(nodes);
    let correction = if drawing == Drawing::Nodes { correction(nodes, &mean, probes) } else { Correction::none() };
    plan.lists.push(NodeList { nodes: range, mean, correction, drawing });
}

/// What the mean displacement at the probes is more than that of the mean pose.
fn correction(nodes: &[PathNode], mean: &Pose, probes: &Probes) -> Correction {
    let camera = &probes.camera;
    let mut off = [[0.0; 2]; SIDE * SIDE];
    for (off, probe) in off.iter_mut().zip(&probes.probes) {
        let [x, y] = probe.track.displacement_px(mean);
        *off = nodes.iter().fold([-x, -y], |[x, y], node| {
            let [dx, dy] = probe.track.displacement_px(&node.pose);
            [x + node.weight * dx, y + node.weight * dy]
        });
    }
    Correction::through([camera.width_px(), camera.height_px()].map(|side| (side as f64 - 1.0).max(1.0)), off)
}

/// Appends the nodes of `method` for rows that are exposed `delay_s` late.
pub fn fill_nodes(motion: &Motion, method: Method, delay_s: f64, probes: &Probes, out: &mut Vec<PathNode>) {
    let own;
    let mean = if delay_s == 0.0 {
        probes.mean()
    } else {
        // Off the middle only shapes are drawn from nodes: any mean near the list's own will do.
        own = motion.pose_at(0.0, delay_s);
        own
    };
    match method {
        Method::Static => nodes::single(&mean, out),
        Method::Gaussian => {
            let covariance = probes.centre().map_or([0.0; 3], |centre| centre.moments.covariance_px2);
            nodes::gaussian(covariance, &mean, out);
        }
        Method::GaussLegendre { nodes } => nodes::gauss_legendre_in_time(motion, nodes, delay_s, out),
        Method::Segments { segments, per_segment } => {
            nodes::segments(motion, segments, per_segment, delay_s, &mean, out);
        }
        Method::EffectivePsf { nodes } | Method::ZonalPsf { nodes, .. } if motion.is_smooth() => {
            nodes::gauss_legendre_in_time(motion, nodes, delay_s, out);
        }
        Method::EffectivePsf { nodes } | Method::Samples { nodes } | Method::ZonalPsf { nodes, .. } => {
            nodes::samples(motion, nodes, delay_s, &mean, out);
        }
    }
}

/// The band that holds row `y_px`.
fn band_of(y_px: f64, height: f64, bands: usize) -> usize {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the bands")]
    let band = ((y_px + 0.5) / height * bands as f64).clamp(0.0, bands as f64 - 1.0) as usize;
    band
}

/// A kernel for every zone that holds a star of the class.
fn fill_zones(
    plan: &mut ExposurePlan,
    probes: &Probes,
    camera: &CameraGeometry,
    class: usize,
    zones: [u16; 2],
    buffers: &mut Buffers,
) {
    let [columns, rows] = zones.map(usize::from);
    let [width, height] = [camera.width_px(), camera.height_px()];
    let zone_of = |star: &PlannedStar| {
        band_of(star.mean_px[1], height as f64, rows) * columns + band_of(star.mean_px[0], width as f64, columns)
    };
    let used = &mut buffers.used;
    used.clear();
    used.resize(columns * rows, UNUSED);
    let only = plan.classes.len() == 1;
    let (above, faintest) = plan.brightness_of(class);
    for star in plan.stars.iter().filter(|star| only || (star.electrons < above && star.electrons >= faintest)) {
        used[zone_of(star)] = 0;
    }
    let method = plan.classes[class].chosen.method;
    let mut shared = None;
    for row in 0..rows {
        let at = |i: usize, n: usize, side: usize| (i as f64 + 0.5) / n as f64 * side as f64 - 0.5;
        let y_px = at(row, rows, height);
        let delay_s = plan.shutter.delay_s(y_px, height);
        let mut row_nodes = None;
        for column in 0..columns {
            let zone = row * columns + column;
            if used[zone] == UNUSED {
                continue;
            }
            let known = if plan.shutter == Shutter::Global { &mut shared } else { &mut row_nodes };
            let (nodes, mean): (_, Pose) = known
                .get_or_insert_with(|| {
                    let first = plan.nodes.len();
                    fill_nodes(&plan.motion, method, delay_s, probes, &mut plan.nodes);
                    let nodes = first..plan.nodes.len();
                    let mean = mean_pose(&plan.nodes[nodes.clone()]);
                    (nodes, mean)
                })
                .clone();
            let Some(place) = StarPlace::of_pixel(camera, [at(column, columns, width), y_px]) else { continue };
            used[zone] = u32::try_from(plan.lists.len()).unwrap_or(UNUSED);
            let drawing = Drawing::Kernel(StarTrack::new(camera, place));
            plan.lists.push(NodeList { nodes, mean, correction: Correction::none(), drawing });
        }
    }
    let used = core::mem::take(&mut buffers.used);
    assign(plan, class, |star| used[zone_of(star)]);
    buffers.used = used;
}
