//! The table of targets on the sky in one frame: where each streak begins and ends, how far the target is, how it is
//! lit.
//!
//! CSV with the header [`HEADER`], beside the truth table of a frame that has such targets. Pixels and degrees have
//! nine decimals. Test: `every_column_is_written`.

use std::io::{self, Write};

/// Names of the columns, in order.
pub const HEADER: &str = "id,apparent_ra_deg,apparent_dec_deg,x_begin_px,y_begin_px,x_end_px,y_end_px,range_km,range_rate_km_s,rate_deg_s,\
                          phase_deg,sunlight,mag_g";

/// One target on the sky in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetRow {
    /// Identifier, as in the truth table.
    pub id: u32,
    /// Right ascension of the apparent direction at mid-exposure, ICRF axes, deg.
    pub ra_deg: f64,
    /// Declination of it, deg.
    pub dec_deg: f64,
    /// Place where its light begins, the camera's motion included, px.
    pub begin_px: [f64; 2],
    /// Place where its light ends, px.
    pub end_px: [f64; 2],
    /// Distance at mid-exposure, km.
    pub range_km: f64,
    /// Speed of its growth, km/s.
    pub range_rate_km_s: f64,
    /// Rate of its direction with respect to the stars, deg/s.
    pub rate_deg_s: f64,
    /// Angle at the target between Sun and observer, deg.
    pub phase_deg: f64,
    /// Share of the Sun that it sees.
    pub sunlight: f64,
    /// Magnitude in that light, Gaia G.
    pub mag_g: f64,
}

/// Writes one line per target.
///
/// # Errors
/// When the output fails.
pub fn write_targets(mut out: impl Write, targets: &[TargetRow]) -> io::Result<()> {
    writeln!(out, "{HEADER}")?;
    for row in targets {
        let ([x_begin, y_begin], [x_end, y_end]) = (row.begin_px, row.end_px);
        write!(
            out,
            "{},{:.9},{:.9},{x_begin:.9},{y_begin:.9},{x_end:.9},{y_end:.9},",
            row.id, row.ra_deg, row.dec_deg
        )?;
        let TargetRow { range_km, range_rate_km_s, rate_deg_s, phase_deg, sunlight, mag_g, .. } = row;
        writeln!(out, "{range_km:.6},{range_rate_km_s:.9},{rate_deg_s:.9},{phase_deg:.6},{sunlight:.6},{mag_g:.4}")?;
    }
    out.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_is_written() {
        let row = TargetRow {
            id: 7,
            ra_deg: 1.0,
            dec_deg: -2.0,
            begin_px: [3.0, 4.0],
            end_px: [5.0, 6.0],
            range_km: 1_000.0,
            range_rate_km_s: -8.0,
            rate_deg_s: 0.5,
            phase_deg: 90.0,
            sunlight: 1.0,
            mag_g: 6.25,
        };
        let mut out = Vec::new();
        write_targets(&mut out, &[row, row]).unwrap();
        let text = String::from_utf8(out).unwrap();
        let lines: Vec<_> = text.lines().collect();
        let columns = |line: &str| line.split(',').count();
        assert_eq!((lines.len(), columns(lines[0]), columns(lines[2])), (3, 13, 13), "{text}");
        let wanted = "7,1.000000000,-2.000000000,3.000000000,4.000000000,5.000000000,6.000000000,\
                      1000.000000,-8.000000000,0.500000000,90.000000,1.000000,6.2500";
        assert_eq!(lines[1], wanted);
    }
}
