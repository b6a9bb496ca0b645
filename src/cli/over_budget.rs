//! Writes in words by how much a plan exceeds the accuracy budget, with the share of the budget that applies.

use base::accuracy::AccuracyBudget;
use plan::exposure::ExposurePlan;
use plan::exposure::plan::{MOTION_SHARE, Verdict};

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
