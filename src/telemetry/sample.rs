//! One report, for tests.

use crate::{Mode, Report};
use base::time::Tai;

/// 2026-03-01T12:00:00.25 UTC; the attitude of a turn by 0.2 rad about x, as starloop has it.
pub(crate) fn report() -> Report {
    Report {
        frame: 7,
        time_tag: Tai::from_unix_ns(1_772_366_400_250_000_000),
        attitude_wxyz: Some([0.1_f64.cos(), -0.1_f64.sin(), 0.0, 0.0]),
        rate_rad_s: Some([0.001, -0.002, 0.003]),
        sigma_rad: [1e-5, 1e-5, 1e-4],
        stars: 21,
        mode: Mode::Tracking,
        exposure_s: 0.05,
        background_dn: 101.5,
        temperature_c: -5.0,
    }
}

/// The same without an attitude.
pub(crate) fn lost() -> Report {
    Report { attitude_wxyz: None, rate_rad_s: None, stars: 0, mode: Mode::Acquisition, ..report() }
}
