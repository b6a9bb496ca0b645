//! `starloop check` of files about judging trackers and drawing data sets: test plans, requirements, data sets.

use crate::cli::{facts::Facts, fly::sound};
#[cfg(feature = "data_sets")]
use anyhow::Context;
use anyhow::Result;
use config::{Document, FileKind, check_keys};
use performance::{fly::Flight, plan::Plan, requirements::Requirements};
use std::path::Path;

/// Returns what there is to say about a test plan, requirements or a data set, all of it sound; `None` for other files.
///
/// # Errors
/// With everything that is wrong with the file.
pub(super) fn judged(document: &Document, path: &Path) -> Result<Option<Facts>> {
    let kind = FileKind::of(document);
    check_keys(kind, document)?;
    let mut facts = Facts::indented();
    let verdict = match kind {
        FileKind::TestPlan => plan(&mut facts, document, path)?,
        FileKind::Requirements => {
            let read = Requirements::parse(document.text(), &path.display().to_string())?;
            format!("requirements are sound: {} limits", read.requirement.len())
        }
        FileKind::DataSet => data_set(document, path)?,
        FileKind::Bench | FileKind::Scenario | FileKind::Camera | FileKind::Link | FileKind::Spacecraft => {
            return Ok(None);
        }
    };
    let mut report = Facts::indented();
    report.line(&verdict);
    report.append(facts);
    report.value("kind", kind.name());
    report.value("verdict", verdict);
    Ok(Some(report))
}

fn plan(facts: &mut Facts, document: &Document, path: &Path) -> Result<String> {
    let (plan, errors) = Plan::parse(document.text(), path)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let flight = Flight::new(&plan, folder, Path::new(""))?;
    let requirements = sound((&plan, errors), &flight, folder, &|_| true)?;
    facts.fact("camera", &flight.camera_name);
    facts.fact("tracker", plan.tracker_name());
    let frames: u64 = plan.each().map(|(case, _)| u64::from(case.attitudes.count()) * u64::from(case.frames)).sum();
    facts.fact("cases", format_args!("{}, {frames} frames", plan.each().count()));
    let limits = requirements.map_or(Ok(Requirements::usual()), |text| Requirements::parse(&text, "requirements"))?;
    facts.fact("requirements", limits.requirement.len());
    Ok(format!("test plan \"{}\" is sound", plan.name))
}

#[cfg(feature = "data_sets")]
fn data_set(document: &Document, path: &Path) -> Result<String> {
    let spec = data_sets::Spec::parse(document.text(), path.parent().unwrap_or(Path::new("")))
        .with_context(|| path.display().to_string())?;
    data_sets::Studio::camera_of(&spec, 0).with_context(|| path.display().to_string())?;
    Ok(format!("data set \"{}\" is sound", spec.name))
}

#[cfg(not(feature = "data_sets"))]
fn data_set(_: &Document, _: &Path) -> Result<String> {
    Ok("keys of the data set are sound; a program with the feature data_sets checks the rest".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checked(text: &str, folder: &Path) -> String {
        let path = folder.join("file.toml");
        let judged = judged(&Document::from_text(text, &path), &path);
        judged.map_or_else(
            |error| format!("{error:#}"),
            |facts| facts.map_or("another kind".into(), |facts| facts.text()),
        )
    }

    #[test]
    fn test_plans_requirements_and_data_sets_have_a_verdict_each() {
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
        let plans = configs.join("test_plans");
        let plan = include_str!("../../../configs/test_plans/ecss_star_tracker_short.toml");
        let sound = checked(plan, &plans);
        assert!(
            sound.starts_with("test plan \"ECSS star tracker, short plan\" is sound")
                && sound.contains("requirements 9"),
            "{sound}"
        );
        let wrong = plan
            .replacen("frame_rate_hz = 2.0", "frame_rate_hz = 5.0", 2)
            .replace("small_tracker.toml\"\nexcl", "none.toml\"\nexcl");
        let refused = checked(&wrong, &plans);
        for wanted in ["case \"lost in space\": frame_rate_hz", "case \"inertial\": frame_rate_hz", "none.toml"] {
            assert!(refused.contains(wanted), "all at once: {wanted}: {refused}");
        }
        let limits = include_str!("../../../configs/test_plans/requirements_small_tracker.toml");
        assert_eq!(checked(limits, &plans), "requirements are sound: 9 limits\n");
        assert!(
            checked(&limits.replace("bias.directional", "bias.direction"), &plans)
                .contains("did you mean \"bias.directional\"")
        );
        let set = include_str!("../../../configs/data_sets/targets.toml");
        assert!(checked(set, &configs).contains("sound"), "{}", checked(set, &configs));
        assert!(checked(&format!("{set}mask = 3\n"), &configs).contains("unknown key `mask`"));
        assert_eq!(checked("[timing]\nframe_rate_hz = 3.0\n", &configs), "another kind");
    }

    #[test]
    fn templates_are_sound() {
        let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/test_plans");
        for (kind, wanted) in
            [(FileKind::TestPlan, "is sound"), (FileKind::Requirements, "are sound"), (FileKind::DataSet, "sound")]
        {
            let text = checked(&config::key_template(kind), &configs);
            assert!(text.contains(wanted), "{kind:?}: {text}");
        }
    }
}
