//! Notes of `render` about input that is legal, and often a mistake.

use base::time::Tai;
use sky::astrometry::PROVEN_YEARS;

/// Returns what a person should know: a time for which places are not proven, a camera that sees more than the sky has.
pub(super) fn notes(at: Tai, limiting_mag: f32, faintest_mag: f32) -> Vec<String> {
    let mut notes = Vec::new();
    let year = 2000.0 + at.years_since_j2000();
    let [first, last] = PROVEN_YEARS;
    if !(first..=last).contains(&year) {
        notes.push(format!(
            "note: {} is outside {first} to {last}, for which places are proven to 1 mas",
            at.to_rfc3339()
        ));
    }
    if limiting_mag > faintest_mag {
        notes.push(format!(
            "note: the camera is drawn to G = {limiting_mag}, but the catalog ends at G = {faintest_mag:.1}; --layer adds \
             fainter stars"
        ));
    }
    notes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unusual_input_is_noted_and_usual_input_is_not() {
        let at = |text: &str| Tai::from_rfc3339(text).unwrap();
        assert!(notes(at("2026-01-01T00:00:00Z"), 8.5, 8.5).is_empty());
        let both = notes(at("2226-01-01T00:00:00Z"), 17.0, 8.5);
        assert_eq!(both.len(), 2, "{both:?}");
        assert!(both[0].contains("2226") && both[1].contains("G = 17,") && both[1].contains("8.5"), "{both:?}");
    }
}
