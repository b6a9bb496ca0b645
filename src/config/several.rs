//! Everything that is wrong with a document, at once.
//!
//! Checks stop at the first error. This one then takes the key to blame out of the text and checks again, so that one
//! reading finds as many errors as there are keys to blame. Errors after the first are found with the bad values at
//! their defaults, and say so.

use crate::document::Document;
use crate::error::ConfigError;

/// Errors after which no more are looked for.
const ERRORS_MAX: usize = 20;

/// Checks a document; all errors when there are several.
pub(super) fn check_all<T>(
    document: &Document,
    check: impl Fn(&Document) -> Result<T, ConfigError>,
) -> Result<T, ConfigError> {
    let mut error = match check(document) {
        Ok(checked) => return Ok(checked),
        Err(error) => error,
    };
    let mut rest = document.clone();
    let mut errors: Vec<ConfigError> = Vec::new();
    while errors.len() + 1 < ERRORS_MAX {
        let Some(without) = rest.without_the_blamed(&error) else { break };
        errors.push(error);
        match check(&without) {
            Ok(_) => return Err(ConfigError::of(errors)),
            Err(next) => error = next,
        }
        rest = without;
    }
    // A key that must be given is missing when its bad value is taken out: not another error.
    let is_known = errors.iter().any(|known| known.key().is_some() && known.key() == error.key());
    if !is_known {
        errors.push(error);
    }
    Err(ConfigError::of(errors))
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
    fn message_lists_all() {
        let document = Document::from_text("seed = -1\nnonsense = 3\n", Path::new("b.toml"));
        let message = Bench::from_document(&document).unwrap_err().to_string();
        let lines: Vec<&str> = message.lines().collect();
        assert_eq!(lines.len(), 2, "{message}");
        assert!(lines[1].contains("with that corrected") || lines[1].trim_start().starts_with("b.toml"), "{message}");
    }
}
