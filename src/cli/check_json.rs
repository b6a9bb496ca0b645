//! `starloop check --json`: the facts of a bench and of its plans.

use crate::cli::radiometry_reported::drawn_mag;
use base::accuracy::AccuracyBudget;
use config::Bench;
use plan::exposure::ExposurePlan;
use run::runtime::{Imager, RunParams};
use serde_json::{Value, json};

/// Facts of a bench, gathered beside the text.
#[derive(Debug, Default)]
pub(super) struct CheckFacts {
    bench: Value,
    plans: Vec<Value>,
}

impl CheckFacts {
    /// Takes what is known of the bench before anything is planned.
    pub(super) fn describe(&mut self, bench: &Bench, params: &RunParams, imager: &Imager, costs: &str) {
        let camera = &bench.camera;
        let AccuracyBudget { centroid_px, flux_rel, pixel_sigma, los_arcsec, .. } = params.budget;
        let default = |of: &str, list: &[config::Defaulted]| {
            let rows = list.iter().map(|row| json!({ "file": of, "key": row.key, "value": row.value }));
            rows.collect::<Vec<_>>()
        };
        let defaults = [default("bench", &bench.defaulted), default("camera", &bench.camera.defaulted)].concat();
        self.bench = json!({
            "bench": bench.name,
            "camera": {
                "name": camera.name,
                "width_px": camera.detector.width_px,
                "height_px": camera.detector.height_px,
                "fov_deg": camera.fov_deg(),
                "arcsec_per_px": camera.ifov_arcsec(),
                "limiting_mag_g": drawn_mag(camera, params.camera.limiting_mag),
            },
            "frames": params.frames,
            "frame_rate_hz": bench.timing.frame_rate_hz,
            "exposure_s": params.camera.exposure_s,
            "readout_s": params.camera.readout_s,
            "heads": bench.head_count(),
            "backend": imager.name(),
            "adapter": imager.description(),
            "costs": costs,
            "budget": {
                "centroid_px": centroid_px, "flux_rel": flux_rel, "pixel_sigma": pixel_sigma, "los_arcsec": los_arcsec,
            },
            "defaults": defaults,
        });
    }

    /// Takes the plan of a frame.
    pub(super) fn plan(&mut self, number: u32, plan: &ExposurePlan) {
        let chosen = &plan.chosen;
        self.plans.push(json!({
            "frame": number,
            "stars": plan.stars.len(),
            "rate_deg_s": plan.motion.los.rate_rad_s.length().to_degrees(),
            "path_px": plan.reach_px,
            "method": chosen.method.to_string(),
            "centroid_px": chosen.centroid_px,
            "flux_rel": chosen.flux_rel,
            "pixel_sigma": chosen.pixel_sigma,
            "drawing_ms": chosen.cost_ms,
            "level": plan.degradation.to_string(),
        }));
    }

    /// Returns everything, with the warnings of the report.
    pub(super) fn with_warnings(self, warnings: &[&str]) -> Value {
        let mut all = self.bench;
        if let Some(fields) = all.as_object_mut() {
            fields.insert("plans".into(), self.plans.into());
            fields.insert("warnings".into(), warnings.into());
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plans_and_warnings_are_beside_the_bench() {
        let mut facts = CheckFacts { bench: json!({ "bench": "a" }), plans: Vec::new() };
        facts.plans.push(json!({ "frame": 0 }));
        let all = facts.with_warnings(&["too dark", "late"]);
        assert_eq!(all["warnings"], json!(["too dark", "late"]));
        assert_eq!((&all["bench"], &all["plans"][0]["frame"]), (&json!("a"), &json!(0)));
    }
}
