//! The calibration file: TOML, dated, with a CRC-32 over its content, of one display and one tracker.
//!
//! The check sum is taken over the content as this program writes it (every key, numbers with all their digits),
//! without the line of the sum itself: comments and spaces may change, a digit may not. It finds damage and edits; it
//! is not a signature. A file is refused when it is damaged, too old or from the future, or of another display, mode or
//! tracker: each error says what was wanted, what was found, and what to do. Tests: `file_tests`.

use super::identity::{DisplayIdentity, TrackerIdentity, same_display, same_tracker};
use super::plan::Plan;
use crate::display::drive::{DisplayDrive, Dither};
use crate::display::flat_field::{FlatField, FlatParameters};
use crate::display::geometry::{DisplayGeometry, GeometryParameters};
use crate::display::response::{Response, ResponseParameters};
use crate::display::{calibration::error, latency::Latency};
use base::input_file::{DATA_BYTES, read_text};
use base::{refused::Refused, time::Tai, units::DAY_S};
use frames::sink::{crc32::Crc32, write_file_atomically};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Version of the file's form.
pub const FORMAT: u32 = 2;
/// Clocks of two machines may differ by this much before a file is from the future, days.
const CLOCK_DAYS: f64 = 1.0;
/// The key of the check sum.
const SUM: &str = "crc32";

/// Light of one pixel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Light {
    /// Of a pixel of full grey where the flat field is 1, above black, electrons per second in the tracker, less what
    /// the tracker's file says that it vignettes.
    pub full_px_e_per_s: f64,
    /// Electrons per second of a star of instrument magnitude 0 in the same tracker.
    pub zero_point_e_per_s: f64,
    /// Standard deviation of the Gaussians that stars are drawn as, display px.
    pub spot_sigma_px: f64,
    /// The brightest star that is nowhere clipped: standing still, in the middle of a pixel, where the display is
    /// dimmest.
    pub brightest_mag: f64,
}

/// Quality of the fit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Residuals {
    /// Dots that the map was fitted to.
    pub dots_used: usize,
    /// Dots that were left out: off, without a number, or saturated.
    pub dots_left_out: usize,
    /// Number of them that were saturated.
    pub dots_saturated: usize,
    /// Share of what the tracker sees of the display that lies within the outermost dots.
    pub coverage: f64,
    /// Shown less mapped place of the dots, display px rms.
    pub rms_px: f64,
    /// Largest, display px.
    pub max_px: f64,
    /// The same rms as an angle, arcsec.
    pub rms_arcsec: f64,
    /// Error of the map from the noise of the dots, display px rms.
    pub map_error_px: f64,
    /// Standard error of the response, magnitudes, median of the greys above 1 % of full.
    pub response_mag: f64,
    /// Residual of the flat field, magnitudes rms; 0 when none was measured.
    pub flat_mag_rms: f64,
}

/// A calibration as it is kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// [`FORMAT`].
    pub format: u32,
    /// When the measurements were made, UTC, RFC 3339.
    pub measured_utc: String,
    /// When they were fitted, UTC, RFC 3339.
    pub made_utc: String,
    /// Days from the measurements on.
    pub valid_days: u32,
    /// Version of the program that wrote the file.
    pub starloop_version: String,
    /// Sum of the plan that was measured.
    pub plan_crc32: String,
    /// The display.
    pub display: DisplayIdentity,
    /// The tracker.
    pub tracker: TrackerIdentity,
    /// Directions to pixels.
    pub geometry: GeometryParameters,
    /// Greys to luminance.
    pub response: ResponseParameters,
    /// Light by place.
    pub flat: FlatParameters,
    /// Electrons and magnitudes; `None`: no fluxes were measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light: Option<Light>,
    /// Submit to photons; `None`: not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latency: Option<Latency>,
    /// Residuals.
    pub residual: Residuals,
}

/// A calibration's numbers, checked and ready for use.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibrated {
    /// Directions to pixels.
    pub geometry: DisplayGeometry,
    /// Greys to luminance.
    pub response: Response,
    /// Light by place.
    pub flat: FlatField,
}

impl Calibrated {
    /// Returns the conversion of luminance to greys, dithering over so many refreshes.
    pub fn drive(&self, dither: Dither) -> DisplayDrive {
        let camera = self.geometry.camera();
        let size_px = [camera.width_px(), camera.height_px()];
        DisplayDrive::new(&self.response, &self.flat, size_px, dither, self.geometry.mirrored())
    }
}

impl Calibration {
    /// Returns its content as text, without the check sum.
    fn content(&self) -> Result<String, Refused> {
        toml::to_string(self).map_err(|error| Refused::at("calibration", error))
    }

    /// Returns the check sum of its content.
    ///
    /// # Errors
    /// When the content cannot be written as TOML.
    pub fn sum(&self) -> Result<String, Refused> {
        let mut crc = Crc32::default();
        crc.update(self.content()?.as_bytes());
        Ok(format!("{:08x}", crc.value()))
    }

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), Refused> {
        let text = format!("{SUM} = \"{}\"\n{}", self.sum()?, self.content()?);
        write_file_atomically(path, |out| out.write_all(text.as_bytes())).map_err(Refused::of)?;
        Ok(())
    }

    /// Reads a file and checks its sum; not yet whether it belongs to anything ([`Self::admit`]).
    ///
    /// # Errors
    /// When it cannot be read, is not a calibration, or was changed since it was written.
    pub fn read(path: &Path) -> Result<Self, Refused> {
        let refuse = |reason: &str| {
            error::file(path, format!("no calibration that can be used: {}", reason.trim().replace('\n', "; ")))
        };
        let text = read_text(path, DATA_BYTES).map_err(|error| refuse(&error.to_string()))?;
        let mut table: toml::Table = toml::from_str(&text).map_err(|error| refuse(error.message()))?;
        let sum = table.remove(SUM);
        let got = sum.as_ref().and_then(toml::Value::as_str).unwrap_or("none").to_owned();
        if let Some(format) = table.get("format").and_then(toml::Value::as_integer).filter(|f| *f != i64::from(FORMAT))
        {
            return Err(refuse(&format!("format {format}, this version of starloop reads format {FORMAT}")));
        }
        let calibration: Self = table.try_into().map_err(|error: toml::de::Error| refuse(error.message()))?;
        let wanted = calibration.sum()?;
        if got != wanted {
            return Err(Refused::at(
                path,
                format_args!(
                    "damaged or edited: wanted the check sum {wanted} of its content, got {got}; calibrate again, or fetch the original"
                ),
            ));
        }
        calibration.calibrated()?;
        Ok(calibration)
    }

    /// Refuses it for another display, another tracker, or another time. `tracker` `None`: not asked.
    ///
    /// # Errors
    /// The first part that does not match.
    pub fn admit(&self, display: &DisplayIdentity, tracker: Option<&TrackerIdentity>, now: Tai) -> Result<(), Refused> {
        same_display(&self.measured_utc, display, &self.display)?;
        if let Some(tracker) = tracker {
            same_tracker(&self.measured_utc, tracker, &self.tracker)?;
        }
        in_time(&self.measured_utc, self.valid_days, now).map(|_| ())
    }

    /// Refuses it for a plan other than the one that was measured.
    ///
    /// # Errors
    /// Both sums.
    pub fn admit_plan(&self, plan: &Plan) -> Result<(), Refused> {
        let (wanted, got) = (plan.crc32(), self.plan_crc32.clone());
        if wanted == got {
            return Ok(());
        }
        let what = "plan (display, dots, ramp or tracker were changed since)";
        Err(error::mismatch(&self.measured_utc, what, wanted, got))
    }

    /// Days since its measurements.
    ///
    /// # Errors
    /// When its date is none.
    pub fn age_days(&self, now: Tai) -> Result<f64, Refused> {
        age_days(&self.measured_utc, now)
    }

    /// Returns its numbers, checked.
    ///
    /// # Errors
    /// When a number is out of range.
    pub fn calibrated(&self) -> Result<Calibrated, Refused> {
        let size_px = self.display.size_px();
        if size_px.iter().any(|side| !(1..=crate::display::geometry::LARGEST_SIDE_PX).contains(side)) {
            let (wanted, got) = ("1 to 16384", format!("{} x {}", size_px[0], size_px[1]));
            return Err(Refused(format!("display plan: display size wanted {wanted}, got {got}")));
        }
        Ok(Calibrated {
            geometry: DisplayGeometry::new(&self.geometry, size_px).map_err(error::not_a_camera)?,
            response: Response::new(self.response.clone())?,
            flat: FlatField::new(self.flat.clone(), size_px).map_err(|e| Refused(format!("flat field: {e}")))?,
        })
    }
}

fn age_days(measured_utc: &str, now: Tai) -> Result<f64, Refused> {
    let measured = Tai::from_rfc3339(measured_utc).map_err(|error| Refused::at("measured_utc", error))?;
    Ok((now - measured).s() / DAY_S)
}

/// Returns the age of measurements in days, when they are neither too old nor from the future.
pub(super) fn in_time(measured_utc: &str, valid_days: u32, now: Tai) -> Result<f64, Refused> {
    let age_days = age_days(measured_utc, now)?;
    if (-CLOCK_DAYS..=f64::from(valid_days)).contains(&age_days) {
        return Ok(age_days);
    }
    Err(Refused(format!(
        "calibration measured {measured_utc}: wanted an age of 0 to {valid_days} days, got {age_days:.1}; calibrate again, or set this machine's clock"
    )))
}

#[cfg(test)]
#[path = "file_tests.rs"]
mod tests;
