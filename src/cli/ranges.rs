//! Angles on the command line: the same ranges in every command, and those of bench files.

use anyhow::ensure;
use config::RIGHT_ASCENSION_DEG;

/// A right ascension from -360 to 360 degrees, as one from 0 to below 360; `option` names it in messages.
///
/// # Errors
/// When it is out of range or no number.
pub(super) fn right_ascension_deg(option: &str, deg: f64) -> anyhow::Result<f64> {
    let [least, most] = RIGHT_ASCENSION_DEG;
    ensure!(
        (least..=most).contains(&deg),
        "{option}: right ascension wanted {least} to {most} degrees, got {deg}; 5h 30m is 82.5"
    );
    Ok(deg.rem_euclid(360.0))
}

/// A declination, -90 to 90 degrees; `option` names it in messages.
///
/// # Errors
/// When it is out of range or no number.
pub(super) fn declination_deg(option: &str, deg: f64) -> anyhow::Result<f64> {
    ensure!((-90.0..=90.0).contains(&deg), "{option}: declination wanted -90 to 90 degrees, got {deg}");
    Ok(deg)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_normalised_or_refused() {
        for (deg, wanted) in [(0.0, 0.0), (-90.0, 270.0), (360.0, 0.0), (-360.0, 0.0), (359.5, 359.5)] {
            let got = right_ascension_deg("--ra", deg).unwrap();
            assert!((got - wanted).abs() < 1e-12 && got < 360.0, "{deg}: {got}");
        }
        for deg in [-360.1, 400.0, f64::NAN, f64::INFINITY] {
            let told = right_ascension_deg("--ra", deg).unwrap_err().to_string();
            assert!(told.starts_with("--ra: right ascension wanted -360 to 360 degrees, got"), "{told}");
        }
        assert!(declination_deg("--dec", -90.0).is_ok());
        for deg in [90.1, f64::NAN] {
            assert!(declination_deg("--dec", deg).is_err(), "{deg}");
        }
    }
}
