//! Which table a plan is drawn from, and the tables themselves, kept from frame to frame.
//!
//! A Gaussian narrow enough for the backend's analytic form needs none; another PSF needs its own table, built once;
//! an effective PSF is rebuilt for every plan. Held by the agreement tests of both backends.

use crate::exposure::{ExposurePlan, Method};
use crate::optics::PsfModel;
use crate::render::table::PsfTable;

/// The tables of one backend.
#[derive(Debug)]
pub struct PlanTables {
    analytic_half_px: usize,
    base: Option<(PsfModel, PsfTable)>,
    effective: PsfTable,
}

/// What [`PlanTables::prepare`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Prepared {
    /// The plan is drawn analytically.
    Analytic,
    /// The table of the PSF itself; built anew or still the one before.
    Base {
        /// Built anew.
        rebuilt: bool,
    },
    /// The table of the PSF convolved with the plan's path.
    Effective,
}

impl PlanTables {
    /// For a backend that draws Gaussians of up to this half-width analytically.
    #[must_use]
    pub fn new(analytic_half_px: usize) -> Self {
        Self { analytic_half_px, base: None, effective: PsfTable::default() }
    }

    /// Builds or rebuilds the table this plan needs.
    pub fn prepare(&mut self, plan: &ExposurePlan) -> Prepared {
        let effective = is_effective(plan);
        if !effective && self.is_analytic(plan) {
            return Prepared::Analytic;
        }
        // The effective PSF of a Gaussian is made of Gaussians.
        let needs_base = !effective || !is_gaussian(plan);
        let fresh = |(psf, table): &(PsfModel, PsfTable)| *psf == plan.psf && table.half_px == plan.half_px;
        let rebuilt = needs_base && !self.base.as_ref().is_some_and(fresh);
        if rebuilt {
            self.base = Some((plan.psf.clone(), PsfTable::of_psf(&plan.psf, plan.half_px)));
        }
        if !effective {
            return Prepared::Base { rebuilt };
        }
        match &self.base {
            Some((_, base)) if needs_base => self.effective.rebuild_effective(plan, base),
            _ => self.effective.rebuild_effective(plan, &PsfTable::default()),
        }
        Prepared::Effective
    }

    /// The table to draw a prepared plan from, or `None` when it is drawn analytically.
    #[must_use]
    pub fn of(&self, plan: &ExposurePlan) -> Option<&PsfTable> {
        if is_effective(plan) {
            Some(&self.effective)
        } else if self.is_analytic(plan) {
            None
        } else {
            self.base.as_ref().map(|(_, table)| table)
        }
    }

    fn is_analytic(&self, plan: &ExposurePlan) -> bool {
        is_gaussian(plan) && plan.half_px <= self.analytic_half_px
    }
}

fn is_gaussian(plan: &ExposurePlan) -> bool {
    matches!(plan.psf, PsfModel::Gaussian { .. })
}

fn is_effective(plan: &ExposurePlan) -> bool {
    matches!(plan.chosen.method, Method::EffectivePsf { .. })
}
