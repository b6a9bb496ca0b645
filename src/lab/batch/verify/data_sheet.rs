//! Data sheet of a detector as a laboratory measures it, and its comparison with the camera file.

use frames::report::plot::{Axis, Chart, Series, Style};
use image::detector::{DetectorParams, LinePattern};

/// One level of light, minus the dark level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightPoint {
    /// Electrons per pixel from light.
    pub light_e: f64,
    /// Mean signal, DN.
    pub signal_dn: f64,
    /// Temporal variance minus that of the dark, DN^2.
    pub variance_dn2: f64,
    /// Temporal variance including that of the dark, DN^2.
    pub total_variance_dn2: f64,
}

/// Measured properties of a detector.
#[derive(Debug, Clone, PartialEq)]
pub struct DataSheet {
    /// Electrons per digital number (EMVA: 1/K).
    pub gain_e_per_dn: f64,
    /// Mean of a dark image with zero exposure, DN.
    pub black_level_dn: f64,
    /// Noise of a read, e- rms.
    pub read_noise_e_rms: f64,
    /// Dark current, e-/s.
    pub dark_e_per_s: f64,
    /// Spread of the pixels' dark means (EMVA: DSNU), e- rms.
    pub dsnu_e_rms: f64,
    /// Standard error of its square, e-^2.
    pub dsnu2_se: f64,
    /// Spread of the pixels' responses at half saturation (EMVA: PRNU), rms share.
    pub prnu: f64,
    /// Signal at the plateau above the dark level, e-.
    pub saturation_e: f64,
    /// Counted electrons per electron from light: 1 when gain and signal agree.
    pub responsivity: f64,
    /// Largest deviation from a straight line between 5 and 95 % of saturation, relative.
    pub linearity_error: f64,
    /// The photon transfer curve.
    pub points: Vec<LightPoint>,
}

/// A property stated by a file and measured by a sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// Its name.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Value in the file.
    pub file: f64,
    /// Measured value.
    pub measured: f64,
    /// Largest difference, as a share of the file's value.
    pub most: f64,
    /// Resolution of the procedure: one standard error, as a share of the file's value, unless negligible.
    pub se: f64,
}

/// Largest statistical difference, standard errors.
const STANDARD_ERRORS: f64 = 4.0;

impl Comparison {
    /// Returns the ratio of measured to stated value minus 1; the difference itself if the file states zero.
    pub fn error(&self) -> f64 {
        if self.file == 0.0 { self.measured } else { self.measured / self.file - 1.0 }
    }

    /// Returns true when the two agree.
    pub fn holds(&self) -> bool {
        self.error().abs() <= self.most.max(STANDARD_ERRORS * self.se)
    }
}

/// Values of a file in the terms of the sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stated {
    /// See [`DataSheet`].
    pub gain_e_per_dn: f64,
    /// See [`DataSheet`].
    pub black_level_dn: f64,
    /// See [`DataSheet`].
    pub read_noise_e_rms: f64,
    /// See [`DataSheet`].
    pub dark_e_per_s: f64,
    /// See [`DataSheet`].
    pub dsnu_e_rms: f64,
    /// See [`DataSheet`].
    pub prnu: f64,
    /// Full well, or its part within the converter's range, e-.
    pub saturation_e: f64,
}

impl Stated {
    /// Returns the values for detector parameters in an exposure: noise and patterns of every kind together, as a
    /// laboratory measures them.
    pub fn of(params: &DetectorParams, exposure_s: f64) -> Self {
        let dark_e_per_s = params.operating_dark_e_per_s();
        let LinePattern { column_e_rms, column_gain_rms, row_e_rms } = params.line_pattern;
        let uneven_dark_e = params.dark_nonuniformity * dark_e_per_s * exposure_s;
        Self {
            gain_e_per_dn: params.gain_e_per_dn,
            black_level_dn: params.black_level_dn,
            read_noise_e_rms: params.temporal_noise_e_rms(),
            dark_e_per_s,
            dsnu_e_rms: params.dsnu_e_rms.hypot(column_e_rms).hypot(row_e_rms).hypot(uneven_dark_e),
            prnu: params.prnu.hypot(column_gain_rms),
            saturation_e: params.full_well_e.min(params.converter_full_e()),
        }
    }
}

/// Largest relative difference between sheet and file; [`DARK_REL`] for the dark current.
pub const SHEET_REL: f64 = 0.01;
/// The same for the dark current.
pub const DARK_REL: f64 = 0.02;

impl DataSheet {
    /// Returns the sheet beside its file.
    pub fn compare(&self, file: &Stated) -> [Comparison; 8] {
        let line = |name, unit, file, measured| Comparison { name, unit, file, measured, most: SHEET_REL, se: 0.0 };
        [
            line("gain", "e-/DN", file.gain_e_per_dn, self.gain_e_per_dn),
            line("black level", "DN", file.black_level_dn, self.black_level_dn),
            line("read noise", "e- rms", file.read_noise_e_rms, self.read_noise_e_rms),
            Comparison { most: DARK_REL, ..line("dark current", "e-/s", file.dark_e_per_s, self.dark_e_per_s) },
            // Half of the square's own error; for a file that states zero, the resolution of the square is the limit.
            Comparison {
                se: if file.dsnu_e_rms > 0.0 {
                    0.5 * self.dsnu2_se / file.dsnu_e_rms.powi(2)
                } else {
                    self.dsnu2_se.sqrt()
                },
                ..line("DSNU", "e- rms", file.dsnu_e_rms, self.dsnu_e_rms)
            },
            line("PRNU", "rms", file.prnu, self.prnu),
            line("saturation", "e-", file.saturation_e, self.saturation_e),
            line("e- counted per e-", "", 1.0, self.responsivity),
        ]
    }

    /// Returns a chart of variance over signal, with the line of the gain.
    pub fn chart(&self, camera: &str) -> Chart {
        let measured = self.points.iter().map(|p| [p.signal_dn, p.variance_dn2]).collect();
        let line = |p: &LightPoint| [p.signal_dn, p.signal_dn / self.gain_e_per_dn];
        let slope = format!("slope 1 / {:.4} e-/DN", self.gain_e_per_dn);
        let series = vec![
            Series::new("pairs of flats", Style::Points, 0, measured),
            Series::new(slope, Style::Line, 1, self.points.iter().map(line).collect()),
        ];
        let x = Axis::log("signal over the dark level, DN");
        let y = Axis::log("temporal variance over that of the dark, DN^2");
        Chart::new(format!("Photon transfer of {camera}"), x, y, series)
            .noted("EMVA 1288: the slope up to 70 % of saturation is the reciprocal gain.")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deviating_sheet_does_not_pass() {
        let line = |file, measured| Comparison { name: "x", unit: "", file, measured, most: 0.01, se: 0.0 };
        assert!(line(2.0, 2.019).holds() && !line(2.0, 2.021).holds() && !line(2.0, f64::NAN).holds());
        assert!(line(0.0, 0.005).holds() && !line(0.0, 0.5).holds(), "a file that says none");
        assert!(Comparison { se: 0.1, ..line(2.0, 2.7) }.holds(), "a difference below the resolution does not count");
    }
}
