//! Builds the chosen methods' nodes, and assigns a list to each star.

use crate::exposure::motion::{Motion, Shutter};
use crate::exposure::plan::{Cell, Drawing, ExposurePlan, NodeList};
use crate::exposure::pose::{PathNode, Pose, mean_pose};
use crate::exposure::probes::{Probes, SIDE};
use crate::exposure::track::{StarPlace, StarTrack};
use crate::exposure::{
    mean_field::Correction, method::Method, place::for_each_star, share::Share, source::PlannedStar,
};
use crate::{exposure::nodes, optics::PsfField};
use base::drawn::Degradation;
use sky::astrometry::CameraGeometry;
use std::sync::Arc;

/// Buffers kept from frame to frame.
#[derive(Debug, Default)]
pub struct Buffers {
    /// Lists by cell, for all zonal classes.
    used: Vec<u32>,
    corners: Vec<u32>,
    /// For each class, the way its stars get their lists.
    gives: Vec<Give>,
}

/// Selects the list of a star.
#[derive(Debug, Clone)]
enum Give {
    /// By the band of its row, and in a field of PSFs by its cell.
    Band { first: usize, per_band: usize, bands: usize, height_px: f64, field: Option<Arc<PsfField>> },
    /// By its cell; the cells' lists start at `first` of the buffer.
    Cell { first: usize, grid: Grid },
}

impl Give {
    /// Returns the list that all stars get; `None` where their places decide.
    fn only_list(&self) -> Option<u32> {
        match self {
            Self::Band { first, bands: 1, field: None, .. } => Some(list_number(*first)),
            Self::Band { .. } | Self::Cell { .. } => None,
        }
    }

    #[inline]
    fn list(&self, star: &PlannedStar, camera: &CameraGeometry, used: &[u32]) -> u32 {
        match self {
            Self::Cell { first, grid } => used.get(first + grid.cell_index(star)).copied().unwrap_or(UNUSED),
            Self::Band { first, per_band, bands, height_px, field } => {
                let in_band =
                    |field: &Arc<PsfField>| field.nodes().len() + Grid::of_field(camera, field).cell_index(star);
                let in_band = field.as_ref().map_or(0, in_band);
                let band = if *bands == 1 { 0 } else { band_of(star.mean_px[1], *height_px, *bands) };
                list_number(first + band * per_band + in_band)
            }
        }
    }
}

/// Marks a cell without a list.
const UNUSED: u32 = u32::MAX;

/// Fills nodes and lists of every class of stars; [`give`] gives each star its list.
pub fn fill(plan: &mut ExposurePlan, probes: &Probes, camera: &CameraGeometry, buffers: &mut Buffers) {
    plan.nodes.clear();
    plan.lists.clear();
    buffers.gives.clear();
    buffers.used.clear();
    for class in 0..plan.classes.len() {
        let (method, bands) = (plan.classes[class].chosen.method, plan.classes[class].bands);
        let first = plan.lists.len();
        let is_whole = plan.classes[class].is_whole;
        if let Method::ZonalPsf { zones, .. } = method
            && !is_whole
        {
            fill_zones(plan, probes, camera, class, zones, buffers);
        } else {
            let bands = bands.max(1);
            // A whole star is blended where it is drawn.
            let field = plan.psf.as_field().filter(|_| !is_whole).cloned();
            let drawing = if is_whole { Drawing::Whole } else { drawing_of(method, probes) };
            for band in 0..bands {
                let own = plan.lists.len();
                push_band(plan, probes, camera, (method, drawing), [band, bands]);
                if let Some(field) = &field {
                    push_field(plan, field, camera, own);
                }
            }
            let per_band = (plan.lists.len() - first) / bands;
            let height_px = camera.height_px() as f64;
            buffers.gives.push(Give::Band { first, per_band, bands, height_px, field });
        }
    }
}

/// Replaces the last list, `own`, by one for every node of the field, and adds a blend for every cell.
fn push_field(plan: &mut ExposurePlan, field: &PsfField, camera: &CameraGeometry, own: usize) {
    let Some(list) = plan.lists.pop() else { return };
    for node in 0..field.nodes().len() {
        plan.lists.push(NodeList { psf_px: field.place_px(node), ..list.clone() });
    }
    let grid = Grid::of_field(camera, field);
    for cell in 0..grid.cells[0] * grid.cells[1] {
        let at = [cell % grid.cells[0], cell / grid.cells[0]];
        let corners = [[0, 0], [1, 0], [0, 1], [1, 1]]
            .map(|[right, down]| list_number(own + grid.corner_index([at[0] + right, at[1] + down])));
        let drawing = Drawing::Blend(grid.cell(at, corners));
        plan.lists.push(NodeList { drawing, ..list.clone() });
    }
}

/// Returns whether stars that do not move have what [`give`] gives them since they were placed: the first list, which is
/// the only one, and their electrons on the detector.
pub fn are_given(plan: &ExposurePlan) -> bool {
    let is_only_once = matches!(plan.lists[..], [NodeList { drawing: Drawing::Once, .. }]);
    is_only_once && plan.whole.from_e == f64::INFINITY && plan.degradation == Degradation::Full
}

/// Assigns every star its list, and its electrons on the detector.
pub fn give(plan: &mut ExposurePlan, share: &Share, buffers: &Buffers) {
    let Buffers { used, gives, .. } = buffers;
    let ExposurePlan { stars, nodes, lists, classes, extent_px, camera, whole, .. } = plan;
    let whole_from_e = &whole.from_e;
    let (Some((last, brighter)), extent_px) = (gives.split_last(), *extent_px) else { return };
    let clear = share.clear_of_edges(extent_px);
    let only = last.only_list().filter(|_| brighter.is_empty());
    let list_of = |star: &PlannedStar| {
        let class = brighter.iter().zip(&*classes).find(|(_, class)| star.electrons >= class.faintest_e);
        class.map_or(last, |(give, _)| give).list(star, camera, used)
    };
    let light_near_edge = |star: &PlannedStar, list: u32| {
        let nodes = lists.get(list as usize).map_or(&nodes[..0], |list| &nodes[list.nodes.clone()]);
        share.on_detector(star, camera, nodes, extent_px)
    };
    for_each_star(stars, |star| {
        let list = only.unwrap_or_else(|| list_of(star));
        let clear = clear.as_ref().and_then(|clear| clear.light_at(star.mean_px));
        let light = clear.unwrap_or_else(|| light_near_edge(star, list));
        (star.list, star.electrons_on_detector) = (list, star.drawn_e * light);
        if star.electrons >= *whole_from_e {
            star.electrons_on_detector *= share.whole_gain(star);
        }
    });
}

/// Adds one list of a method that is not zonal: `[band, bands]` of the rows.
fn push_band(
    plan: &mut ExposurePlan,
    probes: &Probes,
    camera: &CameraGeometry,
    (method, drawing): (Method, Drawing),
    [band, bands]: [usize; 2],
) {
    let height = camera.height_px();
    let delay_s = band_delay_s(plan.shutter, height, [band, bands]);
    let first = plan.nodes.len();
    fill_nodes(&plan.motion, method, delay_s, probes, &mut plan.nodes);
    push_list(plan, probes, first, drawing);
}

/// Returns how ordinary stars are drawn by a method that is not zonal.
fn drawing_of(method: Method, probes: &Probes) -> Drawing {
    match method {
        Method::Static => Drawing::Once,
        Method::Gaussian | Method::EffectivePsf { .. } => {
            probes.centre().map_or(Drawing::Nodes, |centre| Drawing::Kernel(centre.track))
        }
        Method::GaussLegendre { .. }
        | Method::Segments { .. }
        | Method::Corners { .. }
        | Method::Samples { .. }
        | Method::ZonalPsf { .. } => Drawing::Nodes,
    }
}

/// Returns the delay of a band's middle after the frame's exposure, s; `[band, bands]` of `height` rows.
pub(super) fn band_delay_s(shutter: Shutter, height: usize, [band, bands]: [usize; 2]) -> f64 {
    let middle_px = (band as f64 + 0.5) / bands as f64 * (height as f64 - 1.0);
    shutter.delay_s(middle_px, height)
}

fn push_list(plan: &mut ExposurePlan, probes: &Probes, first: usize, drawing: Drawing) {
    let range = first..plan.nodes.len();
    let nodes = &mut plan.nodes[range.clone()];
    // A shift that all nodes share is already in the star's mean place; in single precision it would cost digits.
    let shared = mean_pose(nodes).only_shift();
    for node in &mut *nodes {
        node.pose = node.pose.plus(-1.0, &shared);
    }
    let mean = mean_pose(nodes);
    let is_by_nodes = matches!(drawing, Drawing::Nodes | Drawing::Whole);
    let correction = if is_by_nodes { correction(nodes, &mean, probes) } else { Correction::none() };
    plan.lists.push(NodeList { nodes: range, mean, correction, drawing, psf_px: [0.0; 2] });
}

/// Returns the mean displacement at the probes minus that of the mean pose.
pub(super) fn correction(nodes: &[PathNode], mean: &Pose, probes: &Probes) -> Correction {
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
    // Other rows use nodes only for shapes: any mean near the list's own is sufficient.
    let mean = if delay_s == 0.0 { probes.mean() } else { motion.pose_at(0.0, delay_s) };
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
        Method::Corners { per_stretch, .. } => nodes::between_corners(motion, per_stretch, delay_s, &mean, out),
        Method::EffectivePsf { nodes, .. } | Method::ZonalPsf { nodes, .. } if motion.is_smooth() => {
            nodes::gauss_legendre_in_time(motion, nodes, delay_s, out);
        }
        Method::EffectivePsf { nodes, stretches } | Method::ZonalPsf { nodes, stretches, .. } if stretches > 0 => {
            nodes::between_corners(motion, nodes / stretches, delay_s, &mean, out);
        }
        Method::EffectivePsf { nodes, .. } | Method::Samples { nodes } | Method::ZonalPsf { nodes, .. } => {
            nodes::samples(motion, nodes, delay_s, &mean, out);
        }
    }
}

/// Returns the band that contains row `y_px`.
pub(super) fn band_of(y_px: f64, height: f64, bands: usize) -> usize {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the bands")]
    let band = ((y_px + 0.5) / height * bands as f64).clamp(0.0, bands as f64 - 1.0) as usize;
    band
}

/// Positions of a class's stars on the grid of a zonal method.
#[derive(Debug, Clone, Copy)]
struct Grid {
    cells: [usize; 2],
    size_px: [f64; 2],
}

impl Grid {
    fn new(camera: &CameraGeometry, zones: [u16; 2]) -> Self {
        Self { cells: zones.map(usize::from), size_px: [camera.width_px() as f64, camera.height_px() as f64] }
    }

    /// Returns the cells of a field of PSFs.
    fn of_field(camera: &CameraGeometry, field: &PsfField) -> Self {
        Self { cells: field.cells(), size_px: [camera.width_px() as f64, camera.height_px() as f64] }
    }

    /// Returns the number of a star's cell.
    fn cell_index(&self, star: &PlannedStar) -> usize {
        self.index(self.cell_of(star))
    }

    /// Returns a cell between the lists of its corners.
    fn cell(&self, [column, row]: [usize; 2], corners: [u32; 4]) -> Cell {
        let (origin_px, end_px) = (self.corner_px([column, row]), self.corner_px([column + 1, row + 1]));
        Cell { corners, origin_px, size_px: [end_px[0] - origin_px[0], end_px[1] - origin_px[1]] }
    }

    /// Returns the cell of a star: column and row.
    fn cell_of(&self, star: &PlannedStar) -> [usize; 2] {
        core::array::from_fn(|i| band_of(star.mean_px[i], self.size_px[i], self.cells[i]))
    }

    fn index(&self, [column, row]: [usize; 2]) -> usize {
        row * self.cells[0] + column
    }

    /// Returns the top left corner of a cell, px; the last corners are at the detector's far edges.
    fn corner_px(&self, at: [usize; 2]) -> [f64; 2] {
        core::array::from_fn(|i| at[i] as f64 / self.cells[i] as f64 * self.size_px[i] - 0.5)
    }

    /// Returns the index of a corner of the cells.
    fn corner_index(&self, [column, row]: [usize; 2]) -> usize {
        row * (self.cells[0] + 1) + column
    }
}

/// Adds a kernel for every corner of a cell that contains a star of the class, and a blend for every such cell.
fn fill_zones(
    plan: &mut ExposurePlan,
    probes: &Probes,
    camera: &CameraGeometry,
    class: usize,
    zones: [u16; 2],
    buffers: &mut Buffers,
) {
    let grid = Grid::new(camera, zones);
    let Buffers { used, corners, gives } = buffers;
    let first_cell = used.len();
    used.resize(first_cell + grid.cells[0] * grid.cells[1], UNUSED);
    corners.clear();
    corners.resize((grid.cells[0] + 1) * (grid.cells[1] + 1), UNUSED);
    gives.push(Give::Cell { first: first_cell, grid });
    let used = &mut used[first_cell..];
    let is_member = plan.is_member(class);
    let mut missing = used.len();
    for star in plan.stars.iter().filter(|star| is_member(star)) {
        let cell = &mut used[grid.cell_index(star)];
        missing -= usize::from(*cell == UNUSED);
        *cell = 0;
        if missing == 0 {
            break;
        }
    }
    let (method, first_list) = (plan.classes[class].chosen.method, plan.lists.len());
    for row in 0..grid.cells[1] {
        for column in 0..grid.cells[0] {
            let cell = grid.index([column, row]);
            if used[cell] != UNUSED {
                used[cell] = push_cell(plan, probes, &grid, corners, (method, first_list), [column, row]);
            }
        }
    }
}

/// Adds the blend of one cell, and those of its kernels that do not exist yet.
fn push_cell(
    plan: &mut ExposurePlan,
    probes: &Probes,
    grid: &Grid,
    corners: &mut [u32],
    (method, first_list): (Method, usize),
    [column, row]: [usize; 2],
) -> u32 {
    let lists = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[right, down]| {
        let at = [column + right, row + down];
        let corner = &mut corners[grid.corner_index(at)];
        if *corner == UNUSED {
            *corner = push_kernel(plan, probes, grid.corner_px(at), method, first_list);
        }
        *corner
    });
    let Some(first) = plan.lists.get(lists[0] as usize) else { return UNUSED };
    let drawing = Drawing::Blend(grid.cell([column, row], lists));
    plan.lists.push(NodeList { drawing, ..first.clone() });
    list_number(plan.lists.len() - 1)
}

/// Adds a kernel made at `px`.
fn push_kernel(plan: &mut ExposurePlan, probes: &Probes, px: [f64; 2], method: Method, first_list: usize) -> u32 {
    let camera = &probes.camera;
    // Kept on the pixel grid, within the lens's domain; half a pixel is negligible for a zone.
    let last = [camera.width_px(), camera.height_px()].map(|side| side as f64 - 1.0);
    let place = StarPlace::of_pixel(camera, [px[0].clamp(0.0, last[0]), px[1].clamp(0.0, last[1])]);
    let track = place.map(|place| StarTrack::new(camera, place)).or(probes.centre().map(|probe| probe.track));
    let Some(track) = track else { return UNUSED };
    let global = plan.shutter == Shutter::Global;
    // With a global shutter all kernels share one list of poses.
    let own = plan.lists.get(first_list..).unwrap_or_default();
    let shared = own.iter().rev().find(|list| global && matches!(list.drawing, Drawing::Kernel(_)));
    let (nodes, mean) = if let Some(list) = shared {
        (list.nodes.clone(), list.mean)
    } else {
        let first = plan.nodes.len();
        let delay_s = plan.shutter.delay_s(px[1], camera.height_px());
        fill_nodes(&plan.motion, method, delay_s, probes, &mut plan.nodes);
        (first..plan.nodes.len(), mean_pose(&plan.nodes[first..]))
    };
    let drawing = Drawing::Kernel(track);
    plan.lists.push(NodeList { nodes, mean, correction: Correction::none(), drawing, psf_px: px });
    list_number(plan.lists.len() - 1)
}

fn list_number(list: usize) -> u32 {
    u32::try_from(list).unwrap_or(UNUSED)
}
