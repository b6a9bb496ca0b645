//! Plans of single frames, and by how much one exceeds the accuracy budget.
//!
//! The plan of one frame of a bench, without drawing it: from the simulated flight computer's own truth.

use anyhow::{Context, Result};
use base::{accuracy::AccuracyBudget, axes::Rotation, time::Span};
use plan::exposure::plan::{MOTION_SHARE, Verdict};
use plan::exposure::{ExposurePlan, Planner};
use plan::{attitude::LosPath, exposure::cost::CostModel};
use run::runtime::RunParams;
use scene::Scene;
use stars::Sky;
use testbed::flight_computer::FlightComputer;

/// Everything but the planner.
pub(super) struct FramePlans<'a> {
    params: &'a RunParams,
    computer: FlightComputer,
    /// All that shines into the frames.
    pub(super) scene: Scene,
}

impl<'a> FramePlans<'a> {
    /// Plans the frames of a run whose attitude this flight computer sends.
    pub(super) fn new(computer: FlightComputer, params: &'a RunParams, sky: &Sky) -> Self {
        Self { params, computer, scene: Scene::new(&params.scene(&params.almanac()), sky) }
    }

    /// Returns a planner that weighs every method; with a limit, one that also takes degradation levels.
    pub(super) fn planner(&self, cost: CostModel, limit_ms: Option<f64>) -> Planner {
        let RunParams { camera, budget, method, .. } = self.params;
        let los = LosPath::commanded(Rotation::IDENTITY, self.params.first_exposure, camera.exposure_s);
        let mut planner = Planner::new(camera.instrument(), *budget, cost, *method, los).thorough();
        planner.set_targets(self.params.targets.clone());
        match limit_ms {
            Some(limit_ms) => planner.within_ms(limit_ms).down_to(self.params.last_degradation),
            None => planner,
        }
    }

    /// Returns whether frame `number` has an attitude.
    pub(super) fn has_attitude(&self, number: u32) -> bool {
        let half = Span::from_s(0.5 * self.params.camera.exposure_s);
        self.computer.truth(self.params.exposure_start(number) + half).is_some()
    }

    /// Plans frame `number`.
    ///
    /// # Errors
    /// When the observer's orbit cannot be computed.
    pub(super) fn plan<'p>(&mut self, number: u32, planner: &'p mut Planner) -> Result<&'p ExposurePlan> {
        let attitude = &self.params.attitude;
        let los = &mut planner.motion_mut().los;
        los.exposure_start = self.params.exposure_start(number);
        let at = los.mid_exposure();
        let truth = self.computer.truth(at).with_context(|| format!("frame {number}: no attitude at {at}"))?;
        let mount = attitude.sensor_from_body;
        los.mid_sensor_from_icrf = mount * truth.body_from_icrf;
        los.rate_rad_s = mount.apply(truth.rate_rad_s);
        los.acceleration_rad_s2 = mount.apply(truth.acceleration_rad_s2);
        los.jitter.lines.clone_from(&attitude.jitter_lines);
        los.jitter.lines_epoch = attitude.jitter_epoch;
        let los = &planner.latest().motion.los;
        self.scene.find(los, true)?;
        planner.set_targets_on_sky(self.scene.targets.in_view());
        Ok(planner.plan(self.scene.sources()))
    }
}

// Writes in words by how much a plan exceeds the accuracy budget, with the share of the budget that applies.

/// Returns every error of `plan` that is over `budget` (or over the share of it that motion may use); `None` without
/// such errors.
pub(super) fn over_budget_text(plan: &ExposurePlan, budget: &AccuracyBudget) -> Option<String> {
    let chosen = &plan.chosen;
    if chosen.verdict.is_met() {
        return None;
    }
    if !chosen.verdict.is_drawable() {
        return Some("outside its domain: nothing is promised of this frame".into());
    }
    let mut over = Vec::new();
    if chosen.verdict == Verdict::CentroidOverBudget {
        let (px, share_px) = (chosen.centroid_px, MOTION_SHARE * budget.centroid_px);
        let budget_px = budget.centroid_px;
        over.push(format!("centroids may be off by {px:.1e} px (motion may use {share_px:.1e} of {budget_px:.1e} px)"));
    }
    if chosen.pixel_sigma > budget.pixel_sigma {
        let (sigma, most) = (chosen.pixel_sigma, budget.pixel_sigma);
        over.push(format!("pixels may be off by {sigma:.1e} sigma of their noise (budget {most} sigma)"));
    }
    if chosen.flux_rel > budget.flux_rel {
        let (flux, most, half_px) = (chosen.flux_rel, budget.flux_rel, plan.half_px);
        let why = if plan.psf.lost_flux(half_px) > most {
            format!("the PSF's wings are cut {half_px} px from the star")
        } else {
            "a rolling shutter with fast motion".into()
        };
        over.push(format!("{flux:.1e} of a star's light may be missing (budget {most:.1e}; {why})"));
    }
    Some(format!("over the accuracy budget: {}", over.join("; ")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::{axes::Rotation, time::Tai};
    use config::Bench;
    use glam::DVec3;
    use plan::exposure::{Instrument, MethodChoice, Planner, Source, SourcePlace};
    use plan::{attitude::LosPath, exposure::cost::CostModel, optics::PsfModel};
    use run::wiring::camera_parts::camera_params;

    /// Returns words about a star of 1e4 e- in the middle of the built-in bench's camera.
    fn words(sigma_px: f64, method: &str, rate_rad_s: f64) -> Option<String> {
        let own = camera_params(&Bench::built_in().unwrap().camera).unwrap().instrument();
        let instrument = Instrument { psf: PsfModel::gaussian(sigma_px), ..own };
        let budget = AccuracyBudget::default();
        let choice: MethodChoice = method.parse().unwrap();
        let mut los = LosPath::commanded(Rotation::IDENTITY, Tai::from_ns(0), 0.1);
        los.rate_rad_s = DVec3::X * rate_rad_s;
        let middle = [instrument.camera.width_px(), instrument.camera.height_px()].map(|side| 0.5 * side as f64);
        let star = Source { id: 1, electrons: 1e4, mag: 3.0, place: SourcePlace::Pixel(middle) };
        let mut planner = Planner::new(instrument, budget, CostModel::CPU, choice, los);
        over_budget_text(planner.plan(&[star]), &budget)
    }

    #[test]
    fn only_errors_over_the_budget_are_named_with_their_share() {
        assert_eq!(words(0.8, "auto", 0.0), None, "inside the budget there is nothing to say");
        let wings = words(20.0, "auto", 0.0).unwrap();
        assert!(wings.contains("light may be missing (budget 1.0e-3; the PSF's wings are cut 48 px"), "{wings}");
        assert!(!wings.contains("centroids") && !wings.contains("pixels may"), "{wings}");
        let dots = words(0.8, "static", 0.05).unwrap();
        assert!(dots.contains("centroids may be off by"), "{dots}");
        assert!(dots.contains("(motion may use 1.0e-3 of 2.0e-3 px)"), "{dots}");
        assert!(!dots.contains("light may be missing"), "{dots}");
    }
}
