//! `starloop chart` in its quick form: tables that parse, bounds that hold, fronts that nothing beats, charts that show
//! what the tables say.

use batch::chart::{Backends, Charted, MethodRow, Settings, Step, effects, run, sweep};
use batch::chart::{
    effects::EffectRow, poisson::PoissonRow, prediction::PredictionRow, rows::broken, sampling::FootprintRow,
    scenes::scenes,
};
use frames::report::plot::{Chart, Style};
use image::detector::DetectorParams;
use std::{collections::BTreeSet, sync::OnceLock};

/// Scenes with charts of their own.
const CHARTED: [&str; 4] = ["line-3px", "sinusoid-3px", "random-1px", "S4"];
/// Rows by the CPU that fit the budget, at least: the bounds are not idle.
const LEAST_FITTING: usize = 40;
/// Share of the light to which a footprint's pixels sum, beyond the bound.
const ROUNDING: f64 = 1e-12;

/// Returns one quick run for all tests here; the GPU too where there is one.
fn charted() -> &'static Charted {
    static DONE: OnceLock<Charted> = OnceLock::new();
    DONE.get_or_init(|| {
        let settings = Settings { quick: true, backends: Backends::All, seed: 1 };
        let mut steps: Vec<Step> = Vec::new();
        let charted = run(&settings, &mut |step| steps.push(step.clone())).expect("a chart");
        let total = steps[0].total;
        assert!(steps.iter().enumerate().all(|(i, step)| (step.done, step.total) == (i, total)), "{steps:?}");
        assert_eq!(steps.len(), total, "every part is reported");
        charted
    })
}

fn text(name: &str) -> &'static str {
    let file = charted().files.iter().find(|file| file.name == name);
    &file.unwrap_or_else(|| panic!("no {name}")).text
}

fn table<R: serde::de::DeserializeOwned>(name: &str) -> Vec<R> {
    csv::Reader::from_reader(text(name).as_bytes()).deserialize().map(|row| row.expect("a row")).collect()
}

#[test]
fn every_table_parses_to_what_was_measured() {
    // One without a Vulkan driver.
    let backends = charted().methods.iter().map(|row| row.backend.as_str()).collect::<BTreeSet<_>>().len();
    for file in charted().files.iter().filter(|file| file.name.ends_with(".csv")) {
        let mut reader = csv::Reader::from_reader(file.text.as_bytes());
        let records: Vec<_> = reader.records().map(|record| record.expect("a whole record")).collect();
        assert!(records.len() > 5 * backends, "{}", file.name);
    }
    // NaN differs from itself: compare as text.
    let same = |name: &str, rows: &[MethodRow]| {
        assert_eq!(format!("{:?}", table::<MethodRow>(name)), format!("{rows:?}"), "{name}");
    };
    same("methods.csv", &charted().methods);
    same("sampling.csv", &charted().sampling);
    let choices = charted().methods.iter().filter(|row| row.is_choice() && row.backend == "cpu");
    let chosen: Vec<&str> = choices.map(|row| row.scene.as_str()).collect();
    assert_eq!(chosen, scenes(true).iter().map(|scene| scene.name).collect::<Vec<_>>(), "one choice per scene");
}

#[test]
fn measured_errors_are_within_the_bounds_of_every_row_that_fits() {
    let Charted { methods, sampling, .. } = charted();
    let fitting = methods.iter().chain(sampling).filter(|row| row.fits()).count();
    assert!(fitting >= LEAST_FITTING, "only {fitting} rows fit");
    assert!(broken(methods).is_empty(), "{:#?}", broken(methods));
    assert!(broken(sampling).is_empty(), "{:#?}", broken(sampling));
    assert!(methods.iter().all(MethodRow::is_drawn), "no method is refused by a backend");
    for row in methods.iter().filter(|row| row.is_choice()) {
        assert!(row.centroid_px <= row.bound_centroid_px, "whatever the verdict: {row:?}");
    }
}

#[test]
fn a_doctored_row_is_caught() {
    let honest = charted().methods.iter().find(|row| row.fits()).expect("a row that fits");
    assert!(broken(core::slice::from_ref(honest)).is_empty());
    let doctored = [
        MethodRow { centroid_px: 1.01 * honest.bound_centroid_px, ..honest.clone() },
        MethodRow { flux_rel: honest.bound_flux_rel + 3e-6, ..honest.clone() },
        MethodRow { pixel_sigma: honest.bound_pixel_sigma + 0.01, ..honest.clone() },
        MethodRow { centroid_px: f64::NAN, ..honest.clone() },
        MethodRow { bound_centroid_px: 0.5 * honest.centroid_px, ..honest.clone() },
    ];
    for row in &doctored {
        assert_eq!(broken(core::slice::from_ref(row)).len(), 1, "{row:?}");
    }
    let refused = MethodRow { verdict: "centroid-over-budget".into(), ..doctored[0].clone() };
    assert!(broken(&[refused]).is_empty(), "nothing was promised");
}

#[test]
fn shot_noise_prediction_and_footprints_keep_their_bounds() {
    let poisson: Vec<PoissonRow> = table("poisson.csv");
    assert!(poisson.iter().all(|row| row.distance <= row.bound && row.bound <= row.promise), "{poisson:?}");
    assert!(poisson.iter().all(|row| row.ns_per_pixel > 0.0));
    let prediction: Vec<PredictionRow> = table("prediction.csv");
    assert!(prediction.iter().all(|row| row.error_arcsec <= row.bound_arcsec + 1e-8), "{prediction:?}");
    let footprint: Vec<FootprintRow> = table("footprint.csv");
    assert!(footprint.iter().all(|row| row.lost_flux <= row.bound + ROUNDING), "{footprint:?}");
}

fn points(chart: &Chart, style: Style) -> Vec<[f64; 2]> {
    chart.series.iter().filter(|series| series.style == style).flat_map(|series| series.points.clone()).collect()
}

fn is_beaten(point: &[f64; 2], by: &[[f64; 2]]) -> bool {
    by.iter().any(|other| other != point && other[0] <= point[0] && other[1] <= point[1])
}

#[test]
fn nothing_beats_a_front_and_fronts_beat_the_rest() {
    for scene in scenes(true).iter().filter(|scene| scene.is_charted) {
        let chart = sweep::speed_accuracy_chart(&charted().methods, scene, "cpu");
        let (front, all) = (points(&chart, Style::Front), points(&chart, Style::Points));
        assert!(front.len() >= 2 && all.len() > front.len(), "{}: {front:?}", scene.name);
        assert!(front.iter().all(|point| all.contains(point) && !is_beaten(point, &all)), "{}: {front:?}", scene.name);
        let rest = all.iter().filter(|point| !front.contains(point));
        assert!(rest.clone().all(|point| is_beaten(point, &front)), "{}: {front:?} of {all:?}", scene.name);
        assert!(rest.clone().count() > 0, "and so the comparison can fail");
        let rings: usize = chart.series.iter().map(|series| series.marked.len()).sum();
        assert_eq!(rings, 1, "{}: one choice", scene.name);
    }
}

#[test]
fn every_chart_has_its_series() {
    let by_scene = CHARTED.iter().flat_map(|scene| {
        let methods = ["static", "gaussian", "samples", "effective-psf", "budget"];
        let nodes = ["samples", "samples, bound", "segments, bound", "gauss-legendre, bound"];
        [
            (format!("speed_accuracy_{scene}.svg"), methods.to_vec()),
            (format!("error_by_nodes_{scene}.svg"), nodes.to_vec()),
        ]
    });
    let single = [
        ("sampling.svg", vec!["auto", "table:8", "supersampled:3", "point", "bicubic"]),
        ("footprint.svg", vec!["Gaussian, sigma 0.8 px", "Gaussian, sigma 0.8 px, bound"]),
        ("poisson.svg", vec!["inversion", "cornish-fisher", "ptrs, bound", "rounded-normal"]),
        ("prediction.svg", vec!["hold", "constant-rate, bound", "interpolation"]),
        ("prediction_slew.svg", vec!["hold", "constant-acceleration", "interpolation, bound"]),
    ];
    for (name, wanted) in by_scene.chain(single.map(|(name, wanted)| (name.to_owned(), wanted))) {
        let svg = text(&name);
        for series in wanted {
            assert!(svg.contains(&format!(">{series}<")), "{name}: no \"{series}\"");
        }
        assert!(svg.contains("class=\"mark\"") && svg.contains("<polyline"), "{name}: points and lines");
        assert_eq!(svg.contains("class=\"ring\""), name.starts_with("speed_accuracy"), "{name}");
        assert!(!svg.contains("NaN"), "{name}");
    }
}

#[test]
fn the_table_for_people_reports_the_choices() {
    let summary = &charted().summary;
    for scene in scenes(true) {
        assert!(summary.lines().any(|line| line.starts_with(scene.name)), "no {} in\n{summary}", scene.name);
    }
    assert!(
        summary.contains("predicted times of line-3px, sinusoid-3px, random-1px, S1, S2, S3, S4 within")
            && summary.contains("0 of "),
        "{summary}"
    );
}

#[test]
fn every_effect_has_its_cost_on_every_backend() {
    let rows: Vec<EffectRow> = table("effects.csv");
    let backends: BTreeSet<&str> = rows.iter().map(|row| row.backend.as_str()).collect();
    for backend in backends {
        let named: Vec<&str> =
            rows.iter().filter(|row| row.backend == backend).map(|row| row.effect.as_str()).collect();
        let wanted = effects::DRAWING.iter().map(|case| case.0).chain(effects::DETECTOR.iter().map(|case| case.0));
        assert_eq!(named, wanted.collect::<Vec<_>>(), "{backend}");
    }
    for row in &rows {
        assert!(row.with_ms > 0.0 && row.without_ms > 0.0 && row.cost_ms == row.with_ms - row.without_ms, "{row:?}");
    }
}

#[test]
fn every_effect_is_something_that_is_switched_on() {
    use effects::{DETECTOR, DRAWING, DrawingSwitch, Switch};
    let scene = scenes(true)[0];
    let before = batch::chart::stage::Stage::new(&scene, 1).unwrap().instrument;
    for (name, switch) in DRAWING {
        if let DrawingSwitch::Instrument(switch) = switch {
            let mut with = before.clone();
            switch(&mut with);
            assert_ne!(with, before, "{name}");
        }
    }
    for (name, switch) in DETECTOR {
        if let Switch::Params(switch) = switch {
            let mut with = DetectorParams::QUIET;
            switch(&mut with);
            assert_ne!(with, DetectorParams::QUIET, "{name}");
        }
    }
}
