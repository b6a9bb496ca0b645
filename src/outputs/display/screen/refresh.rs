//! The refresh that frames are drawn for, against the monitor's own.
//!
//! A frame is one refresh: at another rate frames are repeated or passed over. Small differences are those of two
//! clocks with the same nominal rate (59.94 and 60 Hz, or two crystals); they are reported, with how often a frame is
//! then shown twice or not at all. A monitor of another mode is refused; in a window, which is not used with a tracker,
//! it is only reported. Tests below.

use crate::display::error::DisplayError;
use base::time::Span;

/// Rates of one name differ by less: 60 and 59.94 Hz by 0.1 %.
const SAME_RATE: f64 = 5e-3;
/// Resolution of the rates that the server reports: they are rounded to a millihertz.
const REPORTED_HZ: f64 = 5e-4;

/// Returns a message about the rates; `None`: frames were drawn for no refresh.
///
/// # Errors
/// When a full screen has another rate.
pub(super) fn reported(
    drawn: Option<Span>,
    monitor_mhz: Option<u32>,
    is_full_screen: bool,
) -> Result<Option<String>, DisplayError> {
    let Some(drawn_hz) = drawn.map(|refresh| 1.0 / refresh.s()) else { return Ok(None) };
    let Some(monitor_hz) = monitor_mhz.map(|mhz| f64::from(mhz) * 1e-3) else {
        return Ok(Some(format!("the server does not report its refresh rate: wanted {drawn_hz:.3} Hz")));
    };
    let off_hz = (drawn_hz - monitor_hz).abs();
    if off_hz > SAME_RATE * drawn_hz && is_full_screen {
        return Err(DisplayError::refuse(format!(
            "frames are drawn for refreshes at {drawn_hz:.3} Hz, and the monitor's are at {monitor_hz:.3} Hz: wanted the \
             same within 0.5 %; set timing.frame_rate_hz to the monitor's, or the monitor's mode to the frames'"
        )));
    }
    let what = if drawn_hz < monitor_hz { "shown twice" } else { "passed over" };
    let often = if off_hz > REPORTED_HZ {
        format!("a frame is {what} every {:.1} s", 1.0 / off_hz)
    } else {
        format!(
            "a frame is shown twice or passed over not before {:.0} s, as two clocks drift apart",
            1.0 / REPORTED_HZ
        )
    };
    Ok(Some(format!("frames for {drawn_hz:.3} Hz on {monitor_hz:.3} Hz: {often}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(drawn_hz: f64, mhz: Option<u32>, is_full_screen: bool) -> Result<Option<String>, DisplayError> {
        reported(Some(Span::from_s(1.0 / drawn_hz)), mhz, is_full_screen)
    }

    #[test]
    fn clocks_of_one_name_slip_and_others_are_refused() {
        let slip = at(60.0, Some(59_940), true).unwrap().unwrap();
        assert!(slip.contains("passed over every 16.7 s"), "{slip}");
        let slip = at(60.0, Some(60_100), true).unwrap().unwrap();
        assert!(slip.contains("shown twice every 10.0 s"), "{slip}");
        let same = at(60.0, Some(60_000), true).unwrap().unwrap();
        assert!(same.contains("not before 2000 s"), "{same}");
        // Both sides of the edge of 0.5 %.
        assert!(at(60.0, Some(60_299), true).is_ok() && at(60.0, Some(59_701), true).is_ok());
        for mhz in [60_301, 59_699, 144_000] {
            let error = at(60.0, Some(mhz), true).unwrap_err().to_string();
            assert!(error.contains("60.000 Hz") && error.contains("timing.frame_rate_hz"), "{error}");
        }
    }

    #[test]
    fn windows_and_servers_without_an_answer_are_reported() {
        let window = at(10.0, Some(60_000), false).unwrap().unwrap();
        assert!(window.contains("shown twice"), "{window}");
        assert!(at(60.0, None, true).unwrap().unwrap().contains("does not report"));
        assert_eq!(reported(None, Some(60_000), true).unwrap(), None, "frames that were drawn for no refresh");
    }
}
