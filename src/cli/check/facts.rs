//! The facts that `starloop check` reports, gathered once: lines for people, an object for programs, and the verdict on both.
//!
//! Every line of the report with the word WARNING is one warning, whichever section says it: a bench with any is not
//! called sound. What several frames share is counted once.

use crate::cli::lines::{Lines, WARNING};
use crate::cli::named::drawn_mag;
use base::accuracy::AccuracyBudget;
use config::Bench;
use plan::exposure::ExposurePlan;
use run::runtime::{Imager, RunParams};
use serde_json::{Value, json};

/// The facts of a file.
#[derive(Debug)]
pub(super) struct Facts {
    pub(super) lines: Lines,
    bench: Value,
    plans: Vec<Value>,
}

impl Default for Facts {
    fn default() -> Self {
        Self { lines: Lines::indented(), bench: Value::Null, plans: Vec::new() }
    }
}

impl Facts {
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
    pub(super) fn with_warnings(&self, warnings: &[&str]) -> Value {
        let mut all = self.bench.clone();
        if let Some(fields) = all.as_object_mut() {
            fields.insert("plans".into(), self.plans.clone().into());
            fields.insert("warnings".into(), warnings.into());
        }
        all
    }
}

/// Returns the warnings of a report in order, without the word, each once.
pub(super) fn warnings(report: &str) -> Vec<&str> {
    let mut found: Vec<&str> = Vec::new();
    for (_, words) in report.lines().filter_map(|line| line.split_once(WARNING)) {
        let words = words.trim_start_matches([':', ' ']).trim_end();
        if !found.contains(&words) {
            found.push(words);
        }
    }
    found
}

/// Returns the verdict on `what`, such as `bench "lab"`: one line, and below it the warnings, numbered.
pub(super) fn verdict(what: &str, warnings: &[&str]) -> String {
    if warnings.is_empty() {
        return format!("{what} is sound\n");
    }
    let plural = if warnings.len() == 1 { "" } else { "s" };
    let lines = warnings.iter().zip(1..).map(|(words, number)| format!("  {number}. {words}\n"));
    format!("{WARNING}: {what}: {} warning{plural}\n{}\n", warnings.len(), lines.collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    const REPORT: &str = "bench \"a\"\n  camera       \"b\"\n  WARNING      too dark\n  level        full; WARNING: late\n  \
                          WARNING      too dark\n";

    #[test]
    fn warnings_of_the_text_are_listed_once_and_nothing_else() {
        assert_eq!(warnings(REPORT), ["too dark", "late"]);
    }

    #[test]
    fn a_report_with_warnings_is_not_called_sound() {
        assert_eq!(verdict("bench \"a\"", &[]), "bench \"a\" is sound\n");
        let text = verdict("bench \"a\"", &warnings(REPORT));
        assert_eq!(text, "WARNING: bench \"a\": 2 warnings\n  1. too dark\n  2. late\n\n");
        assert!(verdict("bench \"a\"", &["late"]).starts_with("WARNING: bench \"a\": 1 warning\n"));
    }

    #[test]
    fn plans_and_warnings_are_beside_the_bench() {
        let mut facts = Facts { bench: json!({ "bench": "a" }), ..Facts::default() };
        facts.plans.push(json!({ "frame": 0 }));
        let all = facts.with_warnings(&["too dark", "late"]);
        assert_eq!(all["warnings"], json!(["too dark", "late"]));
        assert_eq!((&all["bench"], &all["plans"][0]["frame"]), (&json!("a"), &json!(0)));
    }
}
