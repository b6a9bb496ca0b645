//! Everything that is wrong with a document and with the files that it names, at once.
//!
//! Checks stop at the first error. This one then takes the key to blame out of the text, or puts in its place what was
//! meant, and checks again, so that one reading finds as many errors as there are keys to blame. Errors after the first
//! are found with the bad values at their defaults. Errors of a file that the document names are kept beside the value
//! that the rest of that file makes, so that they hide nothing in the document.

use crate::document::Document;
use crate::error::{ConfigError, Partly, Result};

/// Errors after which no more are looked for.
const ERRORS_MAX: usize = 20;

/// Checks a document; all errors when there are several.
pub(super) fn check_all<T>(document: &Document, check: impl Fn(&Document) -> Result<Partly<T>>) -> Result<T> {
    let (checked, errors) = check_partly(document, check)?;
    if errors.is_empty() { Ok(checked) } else { Err(ConfigError::of(errors)) }
}

/// Checks a document as far as that is possible: its value without what is wrong, and the errors; the errors alone when
/// nothing is left without what is wrong.
pub(super) fn check_partly<T>(
    document: &Document,
    check: impl Fn(&Document) -> Result<Partly<T>>,
) -> Result<Partly<T>> {
    let mut rest = document.clone();
    let mut errors: Vec<ConfigError> = Vec::new();
    for _ in 0..2 * ERRORS_MAX {
        let error = match check(&rest) {
            Ok((checked, named)) => {
                errors.extend(named);
                return Ok((checked, errors));
            }
            Err(error) => error,
        };
        // A key that must be given is missing when its bad value is taken out: not another error.
        let is_known = errors.iter().any(|known| known.key().is_some() && known.key() == error.key());
        let without = without(&rest, &error).filter(|_| !is_known || error.is_missing());
        if !is_known {
            errors.push(error);
        }
        match without {
            Some(without) if errors.len() < ERRORS_MAX => rest = without,
            _ => break,
        }
    }
    Err(ConfigError::of(errors))
}

/// Returns the document without what an error is about, or with a substitute for it.
fn without(document: &Document, error: &ConfigError) -> Option<Document> {
    let substitute = document.with_a_substitute(error);
    substitute.or_else(|| document.without_the_blamed(error)).or_else(|| document.without_the_blamed_setting(error))
}

#[cfg(test)]
mod tests {
    use crate::{Bench, Camera, ConfigError, Document};
    use std::path::Path;

    fn errors_of_bench(text: &str) -> Vec<String> {
        let error = Bench::from_document(&Document::from_text(text, Path::new("lab/bench.toml"))).unwrap_err();
        match error {
            ConfigError::Several { first, others } => {
                core::iter::once(*first).chain(others).map(|error| error.to_string()).collect()
            }
            ConfigError::Read { .. }
            | ConfigError::Syntax { .. }
            | ConfigError::UnknownKey { .. }
            | ConfigError::WrongKind { .. }
            | ConfigError::Invalid { .. } => vec![error.to_string()],
        }
    }

    #[test]
    fn every_wrong_key_is_reported_with_its_own_line() {
        let text = "seed = -1\nnonsense = 3\n\n[timing]\nframe_rate_hz = -4.0\nduration_s = \"long\"\n\n[accuracy]\n\
                    centroid_px = -2.0\n";
        let errors = errors_of_bench(text);
        assert_eq!(errors.len(), 5, "{errors:#?}");
        for (line, key) in [(1, "seed"), (2, "nonsense"), (5, "frame_rate_hz"), (6, "long"), (9, "centroid_px")] {
            let place = format!("lab/bench.toml:{line}: ");
            assert!(errors.iter().any(|error| error.starts_with(&place) && error.contains(key)), "{place}{key}");
        }
    }

    #[test]
    fn one_error_stays_one_and_a_table_that_is_unknown_goes_as_a_whole() {
        assert_eq!(errors_of_bench("seed = -1\n").len(), 1);
        let errors = errors_of_bench("seed = -1\n[unknown]\na = 1\nb = 2\n[timing]\nduration_s = -1.0\n");
        assert_eq!(errors.len(), 3, "{errors:#?}");
    }

    #[test]
    fn required_key_with_a_bad_value_is_one_error() {
        let document = Document::built_in("cameras/star_tracker_20deg.toml").unwrap();
        Camera::from_document(&document).unwrap();
        let text = "[flight_computer.slew]\naxis = [0.0, 1.0, 0.0]\nangle_deg = 1000.0\nduration_s = -1.0\n";
        let errors = errors_of_bench(text);
        assert!(errors.iter().any(|error| error.contains("angle_deg is 1000")), "{errors:#?}");
        assert!(!errors.iter().any(|error| error.contains("missing")), "{errors:#?}");
    }

    #[test]
    fn bench_and_camera_with_ten_mistakes_take_one_round() {
        let folder = tempfile::tempdir().unwrap();
        let camera = "[detector]\nwidth_px = 512\nheight_px = 512\nquantum_efficiency = 55\npixel_pitch_um = 0.0053\n\
                      [optics]\nfocal_length_mm = 0.016\n";
        std::fs::write(folder.path().join("cam.toml"), camera).unwrap();
        let bench = "camera = \"cam.toml\"\nnonsense = 3\n[timing]\nframe_rate_hz = 100\n[flight_computer]\n\
                     ra_deg = \"5h30m\"\ndec_deg = 95\n[link]\nkind = \"can\"\n[sink]\ndirectory = 7\n\
                     [[event]]\nat_s = 1.0\ndo = \"straylight\"\nfor_s = 1.0\n\
                     [[event]]\nat_s = 2.0\ndo = \"stray_light\"\nfor_s = -1.0\n";
        let document = Document::from_text(bench, &folder.path().join("bench.toml"));
        let message = Bench::from_document(&document).unwrap_err().to_string();
        for part in [
            "quantum_efficiency is 55",
            "pixel_pitch_um is 0.0053",
            "focal_length_mm is 0.016",
            "unknown key `nonsense`",
            "frame_rate_hz is 100; wanted at most 20",
            "ra_deg is \"5h30m\"",
            "dec_deg is 95",
            "link.kind is \"can\"",
            "sink.directory is 7",
            "event[0].do is \"straylight\" (did you mean \"stray_light\"?)",
            "event[0].e_per_s is missing",
            "event[1].e_per_s is missing",
            "event[1].for_s is -1",
        ] {
            assert!(message.contains(part), "no \"{part}\" in:\n{message}");
        }
        assert_eq!(message.lines().count(), 13, "{message}");
    }

    #[test]
    fn exposure_longer_than_a_frame_of_the_default_rate_hides_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let camera = "[detector]\nwidth_px = 512\nheight_px = 512\nquantum_efficiency = 55\n[optics]\nfocal_length_mm = 25\n\
                      [exposure]\nexposure_s = 0.5\n";
        std::fs::write(folder.path().join("cam.toml"), camera).unwrap();
        let bench = "camera = \"cam.toml\"\n[timing]\nframe_rate_hz = 10\n[flight_computer]\ndec_deg = 95\n";
        let document = Document::from_text(bench, &folder.path().join("bench.toml"));
        let message = Bench::from_document(&document).unwrap_err().to_string();
        for part in [
            "timing.frame_rate_hz is 10; wanted at most 2.0",
            "exposure.exposure_s",
            "dec_deg is 95",
            "quantum_efficiency is 55",
        ] {
            assert!(message.contains(part), "no \"{part}\" in:\n{message}");
        }
    }

    #[test]
    fn word_without_a_near_one_hides_no_other_event() {
        let text = "[[event]]\nat_s = 1.0\ndo = \"xyz\"\nshare = 2\n[[event]]\nat_s = -2.0\ndo = \"safe\"\n[[event]]\nat_s = 1\n";
        let errors = errors_of_bench(text);
        for part in ["event[0].do is \"xyz\"", "event[1].at_s is -2", "event[2].do is missing; wanted one of \"slew\""]
        {
            assert!(errors.iter().any(|error| error.contains(part)), "{part}: {errors:#?}");
        }
        assert!(!errors.iter().any(|error| error.contains("share")), "it belongs to no word: {errors:#?}");
    }

    #[test]
    fn settings_are_blamed_all_at_once() {
        let settings = ["seed=-1", "timing.duration_s=-3"].map(|text| crate::Setting::parse(text).unwrap());
        let document = Document::from_text("noise_seed = -1\n", Path::new("b.toml")).with_settings(settings.to_vec());
        let message = Bench::from_document(&document).unwrap_err().to_string();
        for part in ["--set seed=-1", "--set timing.duration_s=-3", "noise_seed is -1"] {
            assert!(message.contains(part), "{part}: {message}");
        }
    }

    #[test]
    fn message_lists_all() {
        let document = Document::from_text("seed = -1\nnonsense = 3\n", Path::new("b.toml"));
        let message = Bench::from_document(&document).unwrap_err().to_string();
        let lines: Vec<&str> = message.lines().collect();
        assert_eq!(lines.len(), 2, "{message}");
        assert!(lines[1].contains("with that corrected") || lines[1].trim_start().starts_with("b.toml"), "{message}");
    }
}
