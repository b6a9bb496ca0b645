//! Angles on the command line: decimal degrees, with advice for those who type hours.
//!
//! The ranges are those of configuration files, so that a number means the same everywhere.

use config::RIGHT_ASCENSION_DEG;

/// Reads a right ascension, degrees.
///
/// # Errors
/// When it is not a number of degrees from -360 to 360; hours are converted in the message.
pub fn right_ascension_deg(text: &str) -> Result<f64, String> {
    let [least, most] = RIGHT_ASCENSION_DEG;
    within(text, least, most).map_err(|wanted| {
        let hours = degrees_of_sexagesimal(text, true);
        let advice = hours.map(|degrees| format!(": degrees, not hours: {} is {degrees}", text.trim()));
        format!("{wanted}{}", advice.unwrap_or_default())
    })
}

/// Reads a declination, degrees.
///
/// # Errors
/// When it is not a number of degrees from -90 to 90.
pub fn declination_deg(text: &str) -> Result<f64, String> {
    within(text, -90.0, 90.0)
}

fn within(text: &str, least: f64, most: f64) -> Result<f64, String> {
    let value = text.trim().parse::<f64>().ok().filter(|value| (least..=most).contains(value));
    value.ok_or_else(|| format!("wanted decimal degrees from {least} to {most}"))
}

/// Returns the degrees of hours such as `5h30m` and `5h 30m 12.5s`, and of numbers such as `-5:30:12.5`, which are hours of a right
/// ascension and degrees of any other angle.
pub fn degrees_of_sexagesimal(text: &str, is_right_ascension: bool) -> Option<f64> {
    let text = text.trim().to_ascii_lowercase();
    let is_hours = text.contains('h') || is_right_ascension;
    if !text.contains(['h', ':']) {
        return None;
    }
    // The sign is of the whole, also before a zero.
    let (sign, text) = text.strip_prefix('-').map_or((1.0, text.as_str()), |rest| (-1.0, rest));
    let parts: Vec<&str> = text.split(['h', 'm', 's', ':', ' ']).filter(|part| !part.is_empty()).collect();
    let numbers: Vec<f64> = parts.iter().map(|part| part.parse().ok()).collect::<Option<_>>()?;
    if numbers.iter().any(|number| number.is_sign_negative()) {
        return None;
    }
    let whole = match numbers[..] {
        [whole] => whole,
        [whole, m] => whole + m / 60.0,
        [whole, m, s] => whole + m / 60.0 + s / 3600.0,
        _ => return None,
    };
    let degrees = sign * whole * if is_hours { 15.0 } else { 1.0 };
    Some((degrees * 1e6).round() / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degrees_are_read_and_hours_are_converted_in_the_message() {
        assert_eq!(right_ascension_deg("83.8"), Ok(83.8));
        assert_eq!(right_ascension_deg("-360"), Ok(-360.0));
        for (text, degrees) in [("5h30m", "82.5"), ("5h 30m 12s", "82.55"), ("5:30:12", "82.55"), ("23h", "345")] {
            let refused = right_ascension_deg(text).unwrap_err();
            assert!(refused.ends_with(&format!("not hours: {text} is {degrees}")), "{refused}");
        }
        for text in ["400", "nan", "abc", "5h30x", ""] {
            let refused = right_ascension_deg(text).unwrap_err();
            assert_eq!(refused, "wanted decimal degrees from -360 to 360", "{text}");
        }
        for (text, is_right_ascension, degrees) in [
            ("-1:12:00", false, Some(-1.2)),
            ("-0:30:00", false, Some(-0.5)),
            ("-45:30", false, Some(-45.5)),
            ("41:48:36", false, Some(41.81)),
            ("-1h30m", false, Some(-22.5)),
            ("5:35:00", true, Some(83.75)),
            ("-0:30", true, Some(-7.5)),
            ("1:-30", true, None),
            ("45.5", false, None),
        ] {
            assert_eq!(degrees_of_sexagesimal(text, is_right_ascension), degrees, "{text}");
        }
        assert_eq!(declination_deg("-90"), Ok(-90.0));
        assert_eq!(declination_deg("90.1").unwrap_err(), "wanted decimal degrees from -90 to 90");
    }
}
