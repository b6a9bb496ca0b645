//! All metrics: their names and units, and their values for a set of cases.
//!
//! All metrics of a set of cases.

use crate::availability::{
    ACQUISITION, ACQUISITION_CONFIDENCE, ACQUISITION_MEDIAN, ACQUISITION_TIME, FALSE, FALSE_COUNT, KINDS as EXCLUSION,
    LOSSES, RECOVERY, TRACKING, acquisition, exclusion_angles, tracking, tracking_of_case,
};
use crate::bias::{FOV, OF_ATTITUDES, OF_TIME, PIXEL, bias, spatial_errors};
use crate::metric::{Interval, Kind, Metric, Settings};
use crate::noise::{
    BANDWIDTH, INERTIAL, NEA, RATIO, SUCCESSIVE, bandwidth, noise_of_case, ratio_of_case, temporal_noise,
};
use crate::record::{Case, JudgedCase, Use, directional};
use crate::slopes::{
    ABERRATION, DATE, DRIFT, MDE, TAG, THERMO_ELASTIC, aberration_residual, date_error, drift, thermo_elastic,
};
use crate::statistics::quantile;
use base::units::ARCSEC;
use config::nearest;

pub(crate) const AME: Kind = Kind {
    id: "absolute_measurement_error",
    how: "AME: quantile of the error at the report's probability; order statistics",
    parts: &["directional", "rotational"],
    uses: &[Use::Run, Use::Inertial, Use::FovGrid, Use::Drift],
    interval: Interval::Quantile,
    counted: "attitudes",
    ..Kind::USUAL
};

/// Cases and what they say together.
#[derive(Debug, Clone, PartialEq)]
pub struct Assessment {
    /// With what it is said.
    pub settings: Settings,
    /// All frames.
    pub cases: Vec<JudgedCase>,
    /// All numbers: first those of all cases, then those of each that is flown for itself.
    pub metrics: Vec<Metric>,
}

/// Returns everything that the cases say.
pub fn assess(cases: &[Case], settings: &Settings) -> Assessment {
    let Settings { confidence, probability, false_limit, .. } = *settings;
    let judged: Vec<JudgedCase> = cases.iter().map(|case| case.judged(&false_limit)).collect();
    let mut metrics = bias(&judged, confidence);
    metrics.extend(spatial_errors(&judged, confidence));
    metrics.extend(temporal_noise(&judged, confidence, probability));
    metrics.extend(absolute_error(&judged, settings));
    metrics.extend(date_error(&judged, confidence));
    metrics.extend(aberration_residual(&judged, confidence));
    metrics.extend(drift(&judged, confidence));
    metrics.extend(thermo_elastic(&judged, confidence));
    metrics.extend(bandwidth(&judged, confidence));
    metrics.extend(exclusion_angles(&judged, settings));
    metrics.extend(acquisition(&judged, confidence, probability));
    metrics.extend(tracking(&judged, confidence));
    for case in judged.iter().filter(|case| Use::EACH_FOR_ITSELF.contains(&case.purpose)) {
        metrics.extend(tracking_of_case(case, confidence));
        metrics.extend(noise_of_case(case, confidence));
    }
    metrics.extend(judged.iter().filter_map(|case| ratio_of_case(case, confidence)));
    Assessment { settings: *settings, cases: judged, metrics }
}

fn absolute_error(cases: &[JudgedCase], settings: &Settings) -> Vec<Metric> {
    let wanted = |case: &&JudgedCase| matches!(case.purpose, Use::Run | Use::Inertial | Use::FovGrid | Use::Drift);
    let frames = cases.iter().filter(wanted).flat_map(|case| &case.frames);
    let errors: Vec<_> = frames.filter_map(|frame| frame.error_rad()).collect();
    let of = |name: &str, values: Vec<f64>| {
        let found = quantile(&values, settings.probability, settings.confidence);
        found.map(|found| AME.of(name, None, found.scaled(1.0 / ARCSEC)))
    };
    let across = of("directional", errors.iter().map(|error| directional(*error)).collect());
    let about = of("rotational", errors.iter().map(|error| error.z.abs()).collect());
    across.into_iter().chain(about).collect()
}

// Every metric that a requirement may name, with its unit, and where it comes from.

/// All kinds, in the order of the report.
const KINDS: [&Kind; 28] = [
    &OF_ATTITUDES,
    &OF_TIME,
    &FOV,
    &PIXEL,
    &INERTIAL,
    &SUCCESSIVE,
    &NEA,
    &AME,
    &DATE,
    &TAG,
    &ABERRATION,
    &DRIFT,
    &MDE,
    &THERMO_ELASTIC,
    &BANDWIDTH,
    &RATIO,
    &EXCLUSION[0].1,
    &EXCLUSION[1].1,
    &EXCLUSION[2].1,
    &ACQUISITION,
    &ACQUISITION_CONFIDENCE,
    &ACQUISITION_TIME,
    &ACQUISITION_MEDIAN,
    &TRACKING,
    &FALSE,
    &FALSE_COUNT,
    &LOSSES,
    &RECOVERY,
];

/// Returns the kinds that measure a metric; none for an unknown name.
pub(crate) fn kinds_of(metric: &str) -> Vec<&'static Kind> {
    KINDS.into_iter().filter(|kind| kind.names().any(|name| name == metric)).collect()
}

/// Returns every name, once.
pub fn metric_names() -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for name in KINDS.iter().flat_map(|kind| kind.names()) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    names
}

/// Returns what may have been meant by an unknown name, as a clause: its parts, or the nearest name.
pub(crate) fn meant(unknown: &str) -> String {
    let names = metric_names();
    let parts: Vec<&str> =
        names.iter().map(String::as_str).filter(|name| name.starts_with(&format!("{unknown}."))).collect();
    let near = nearest(unknown, names.iter().map(String::as_str));
    match (parts.as_slice(), near) {
        ([], None) => String::new(),
        ([], Some(name)) => format!("; did you mean \"{name}\"?"),
        (parts, _) => format!("; did you mean \"{}\"?", parts.join("\" or \"")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::{fewest_trials, share};
    use crate::synthetic::{Dice, Frame, case};
    use crate::{assess::assess, metric::Settings, record::Case};
    use core::fmt::Write;
    use glam::DVec3;

    const GUIDE: &str = include_str!("../../guide/metrics.md");

    /// Returns the table of the guide.
    fn metric_table() -> String {
        let mut table = "| metric | unit | cases (`use`) | how |\n|---|---|---|---|\n".to_owned();
        for (place, kind) in KINDS.iter().enumerate() {
            if KINDS[..place].iter().any(|before| before.id == kind.id && before.how == kind.how) {
                continue;
            }
            let names: Vec<String> = kind.names().map(|name| format!("`{name}`")).collect();
            let words = |uses: &[Use]| uses.iter().map(|of| format!("`{}`", of.name())).collect::<Vec<_>>().join(", ");
            let all = if kind.uses == Use::ALL { "all".to_owned() } else { words(kind.uses) };
            let each =
                if kind.case_uses.is_empty() { String::new() } else { format!("each of {}", words(kind.case_uses)) };
            let cases = [all, each].into_iter().filter(|text| !text.is_empty()).collect::<Vec<_>>().join("; ");
            let (names, unit, how) = (names.join(", "), kind.unit, kind.how.replace('|', "\\|"));
            let _ = writeln!(table, "| {names} | {unit} | {cases} | {how} |"); // writing to a string does not fail
        }
        table
    }

    fn flown(purpose: Use) -> Case {
        let mut dice = Dice::new(4);
        let frame = |i: u32| {
            let mut frame = Frame::still(f64::from(i), i / 10, dice.normals());
            frame.rate_rad_s = DVec3::X * 1e-3 * f64::from(i % 7) * f64::from(u8::from(purpose == Use::Slew));
            frame
        };
        let frames: Vec<Frame> = (0..400).map(frame).collect();
        case(purpose, &frames)
    }

    #[test]
    fn every_number_of_a_report_is_in_the_list_under_the_use_that_gives_it() {
        let mut seen = Vec::new();
        for purpose in &Use::ALL {
            for metric in assess(&[flown(*purpose)], &Settings::default()).metrics {
                let kinds = kinds_of(&metric.id);
                let is_listed = |kind: &&Kind| {
                    let uses = if metric.case.is_some() { kind.case_uses } else { kind.uses };
                    kind.unit == metric.unit && uses.contains(purpose)
                };
                assert!(kinds.iter().any(is_listed), "{} of {purpose:?}", metric.id);
                seen.push(metric.id);
            }
        }
        assert!(seen.len() > 40 && !kinds_of("bias.z").iter().any(|_| true), "control");
    }

    #[test]
    fn the_guide_has_the_table_of_metrics() {
        assert!(GUIDE.contains(&metric_table()), "put this into src/guide/metrics.md:\n{}", metric_table());
    }

    #[test]
    fn the_guides_figures_are_those_of_the_program() {
        let by_confidence = fewest_trials(0.997, 0.95);
        let by_interval = (1..).find(|n| share(*n, *n, 0.95).is_some_and(|share| share.low >= 0.997)).unwrap_or(0);
        let text: String = GUIDE.split_whitespace().collect::<Vec<_>>().join(" ");
        for wanted in [
            format!("`acquisition_confidence` of {by_confidence} attitudes without a failure is 95 %"),
            format!("the two-sided interval of `acquisition_probability` needs {by_interval}"),
        ] {
            assert!(text.contains(&wanted), "the guide lacks: {wanted}");
        }
    }

    #[test]
    fn a_name_that_does_not_exist_is_answered_with_those_that_do() {
        assert_eq!(meant("temporal_nois.x"), "; did you mean \"temporal_noise.x\"?");
        let time = meant("acquisition_time");
        assert!(time.contains("acquisition_time.at_probability") && time.contains("acquisition_time.median"), "{time}");
        assert!(kinds_of("acquisition_time").is_empty() && !kinds_of("acquisition_time.median").is_empty());
    }
}
