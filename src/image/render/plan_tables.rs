//! Which tables a plan is drawn from, and the tables themselves, kept from frame to frame.
//!
//! A Gaussian narrow enough for the backend's analytic form needs none; another PSF needs its own table, built once;
//! kernels are rebuilt for every plan, side by side. Tests: the agreement tests of both backends.

use crate::render::table::{Form, PsfTable};
use plan::exposure::cost::{kernel_bytes, kernel_half_px};
use plan::exposure::plan::{RESERVED_KERNEL_NODES, RESERVED_KERNEL_PX};
use plan::exposure::{Drawing, ExposurePlan, PsfSampling};
use plan::{exposure::method::Method, exposure::sampling::oversampling, optics::PsfModel};
use rayon::prelude::*;

/// Kernels for which memory is reserved: one for each class of brightness, and one more.
const RESERVED_KERNELS: usize = 4;
/// Memory reserved for kernels, at most: those of a very wide PSF take theirs when they come.
const RESERVED_BYTES: usize = 64 << 20;

/// The tables of one backend.
#[derive(Debug)]
pub struct PlanTables {
    analytic_half_px: usize,
    form: Form,
    /// The PSF whose tables there are: one, or one for every node of its field.
    psf: Option<PsfModel>,
    bases: Vec<PsfTable>,
    /// Grids for whole stars, where these reach further than the tables.
    wholes: Vec<PsfTable>,
    kernels: Vec<PsfTable>,
    /// Kernels of the latest plan, by list, and the lists they are of.
    kernel_of_list: Vec<Option<usize>>,
    list_of_kernel: Vec<usize>,
}

/// Result of [`PlanTables::prepare`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Prepared {
    /// Whether the table of the PSF itself was built again.
    pub base_rebuilt: bool,
    /// Kernels that were built.
    pub kernels: usize,
}

impl PlanTables {
    /// Returns tables for a backend that draws Gaussians of up to this half-width analytically, and others from this
    /// form.
    pub fn new(analytic_half_px: usize, form: Form) -> Self {
        Self {
            analytic_half_px,
            form,
            psf: None,
            bases: Vec::new(),
            wholes: Vec::new(),
            kernels: Vec::new(),
            kernel_of_list: Vec::new(),
            list_of_kernel: Vec::new(),
        }
    }

    /// Builds or rebuilds the tables this plan needs.
    pub fn prepare(&mut self, plan: &ExposurePlan) -> Prepared {
        self.kernel_of_list.clear();
        self.list_of_kernel.clear();
        for (i, list) in plan.lists.iter().enumerate() {
            let is_kernel = matches!(list.drawing, Drawing::Kernel(_));
            self.kernel_of_list.push(is_kernel.then_some(self.list_of_kernel.len()));
            if is_kernel {
                self.list_of_kernel.push(i);
            }
        }
        let kernels = self.list_of_kernel.len();
        let is_drawn = plan.lists.iter().any(|list| matches!(list.drawing, Drawing::Once | Drawing::Nodes));
        // The kernel of a Gaussian is made of Gaussians.
        // Whole stars need tables too; their wider ones are made with the first frame, before any is seen.
        let is_whole =
            plan.whole.half_px > plan.half_px || plan.lists.iter().any(|list| list.drawing == Drawing::Whole);
        let needs_base =
            (is_drawn && !self.is_analytic(plan)) || ((kernels > 0 || is_whole) && !plan.psf.is_gaussian());
        let base_rebuilt = needs_base && self.rebuild_base(plan);
        self.reserve_kernels(plan);
        if kernels > 0 {
            self.build_kernels(plan, kernels);
        }
        Prepared { base_rebuilt, kernels }
    }

    fn rebuild_base(&mut self, plan: &ExposurePlan) -> bool {
        let s = grid_points(plan);
        let fits = |table: &PsfTable| table.half_px == [plan.half_px; 2] && table.oversampling == s;
        let rebuilt = self.psf.as_ref() != Some(&plan.psf) || !self.bases.iter().all(fits);
        if rebuilt {
            self.psf = Some(plan.psf.clone());
            let of_psf = |psf| PsfTable::of_psf(psf, plan.half_px, s, self.form);
            self.bases = plan.psf.nodes().iter().map(of_psf).collect();
            let wholes = if plan.whole.half_px > plan.half_px { plan.psf.nodes() } else { &[] };
            let whole_of_psf = |psf| PsfTable::of_psf(psf, plan.whole.half_px, s, Form::Grid);
            self.wholes = wholes.iter().map(whole_of_psf).collect();
        }
        rebuilt
    }

    /// Reserves memory for the kernels that a later frame may need, with the first one.
    fn reserve_kernels(&mut self, plan: &ExposurePlan) {
        if self.kernels.capacity() > 0 {
            return;
        }
        self.kernels.reserve(RESERVED_KERNELS);
        self.kernel_of_list.reserve(RESERVED_KERNELS);
        self.list_of_kernel.reserve(RESERVED_KERNELS);
        let nodes = if plan.psf.is_gaussian() { RESERVED_KERNEL_NODES } else { 0 };
        let one = Method::EffectivePsf { nodes, stretches: 0 };
        let bytes = kernel_bytes(one, &plan.psf, plan.half_px, RESERVED_KERNEL_PX);
        let (half_px, s) = (kernel_half_px(plan.half_px, RESERVED_KERNEL_PX), grid_points(plan));
        for _ in 0..(RESERVED_BYTES / bytes).min(RESERVED_KERNELS) {
            let mut table = PsfTable::empty(self.form);
            table.reserve_kernel([half_px; 2], s, nodes);
            self.kernels.push(table);
        }
    }

    fn build_kernels(&mut self, plan: &ExposurePlan, kernels: usize) {
        if self.kernels.len() < kernels {
            let form = self.form;
            self.kernels.resize_with(kernels.next_power_of_two(), || PsfTable::empty(form));
        }
        let half_px = kernel_reach(plan).map(|reach| kernel_half_px(plan.half_px, reach));
        let s = grid_points(plan);
        let bases = &self.bases;
        let lists = &self.list_of_kernel;
        let build = |(i, table): (usize, &mut PsfTable)| {
            let list = &plan.lists[lists[i]];
            if let Drawing::Kernel(at) = &list.drawing {
                let path = plan.kernel_trace(plan.nodes_of(list), at);
                table.rebuild_kernel(&plan.psf, half_px, s, path, plan.psf.around(list.psf_px), bases);
            }
        };
        if kernels == 1 {
            self.kernels.iter_mut().take(1).enumerate().for_each(build);
        } else {
            self.kernels[..kernels].par_iter_mut().enumerate().for_each(build);
        }
        // Zones that get their first star later find the memory reserved.
        if let Some((first, spare)) = self.kernels.split_first_mut() {
            spare.iter_mut().skip(kernels - 1).for_each(|table| table.reserve_as(first));
        }
    }

    /// Tables of the PSF itself, when stars that are not drawn from a kernel need them: one, or one for every node of a
    /// field.
    pub fn bases(&self, plan: &ExposurePlan) -> &[PsfTable] {
        if self.is_analytic(plan) { &[] } else { &self.bases }
    }

    /// Returns the table from which whole stars are drawn by the PSF of this number; `None` for a Gaussian.
    pub(super) fn whole_of(&self, plan: &ExposurePlan, psf: usize) -> Option<&PsfTable> {
        let tables = if plan.whole.half_px > plan.half_px { &self.wholes } else { &self.bases };
        tables.get(psf).filter(|_| !plan.psf.is_gaussian())
    }

    /// Returns the index of the table of the PSF that a list is drawn with.
    pub fn psf_of(&self, plan: &ExposurePlan, list: usize) -> usize {
        let psfs = plan.lists.get(list).map(|list| plan.psf.around(list.psf_px));
        psfs.and_then(|psfs| psfs.into_iter().max_by(|a, b| a.1.total_cmp(&b.1))).map_or(0, |(psf, _)| psf)
    }

    /// Kernels of the latest plan.
    pub fn kernels(&self) -> &[PsfTable] {
        &self.kernels[..self.list_of_kernel.len()]
    }

    /// Returns the index of a list's kernel.
    pub fn kernel_of(&self, list: usize) -> Option<usize> {
        self.kernel_of_list.get(list).copied().flatten()
    }

    /// Returns whether stars without a kernel are drawn analytically.
    pub fn is_analytic(&self, plan: &ExposurePlan) -> bool {
        let tabled = matches!(plan.sampling, PsfSampling::Table { .. });
        plan.psf.is_gaussian() && plan.half_px <= self.analytic_half_px && !tabled
    }
}

/// Returns the furthest any kernel's path leads from its mean along x and y, px.
fn kernel_reach(plan: &ExposurePlan) -> [f64; 2] {
    let mut reach = [0.0_f64; 2];
    for list in &plan.lists {
        if let Drawing::Kernel(at) = &list.drawing {
            for [_, x, y] in plan.kernel_trace(plan.nodes_of(list), at) {
                reach = [reach[0].max(x.abs()), reach[1].max(y.abs())];
            }
        }
    }
    reach
}

/// Returns the grid points per pixel of the plan's tables.
fn grid_points(plan: &ExposurePlan) -> usize {
    match plan.sampling {
        PsfSampling::Table { oversampling } => oversampling,
        PsfSampling::Auto | PsfSampling::Supersampled { .. } | PsfSampling::Point | PsfSampling::Bicubic => {
            oversampling(&plan.psf)
        }
    }
}
