//! `starloop check`, what the camera sees: down to which magnitude, whether the frames have those stars, and whether a
//! frame has any.
//!
//! Input: parameters and stars of a run, plans of some frames. Output: text. `run::wiring::seen_mag` defines the stars that
//! are seen: stars of the Sun's colour at SNR 3, without motion. Frames of a calibrated display are
//! drawn in steps of its luminance, without a tracker's noise: of them only their stars are counted.

use anyhow::Result;
use config::{Bench, Plant, Radiometry};
use core::{f64::consts::TAU, fmt::Write};
use plan::exposure::ExposurePlan;
use run::wiring::sensitivity::{SEEN_SNR, sensitivity_for_suns};
use run::{runtime::RunParams, wiring::sensitivity::Sensitivity};
use stars::{Sky, StarIndex};

/// The brightest star of the sky, Sirius, G.
const BRIGHTEST_MAG: f64 = -1.5;
/// Differences of magnitudes below this are rounding of the file's numbers.
const SAME_MAG: f64 = 0.05;
/// Steradians of the sky.
const SKY_SR: f64 = 2.0 * TAU;

/// The sight of a bench's camera.
pub(super) struct Sight {
    /// `None` for a calibrated display, whose frames have no tracker's noise.
    sensitivity: Option<Sensitivity>,
    /// True where the planned attitudes are those of the run.
    is_planned: bool,
}

impl Sight {
    /// Returns what a bench's camera sees.
    pub(super) fn of(bench: &Bench, plant: &Plant, params: &RunParams) -> Self {
        let has_noise = params.drawn_from_sensor.is_none() && params.camera.radiometry.zero_point_e_per_s().is_some();
        let is_planned = match plant {
            Plant::FlightComputer | Plant::File(_) => !bench.flight_computer.is_external,
            Plant::Vehicle(_) | Plant::Outside => false,
        };
        Self { sensitivity: has_noise.then(|| sensitivity_for_suns(&params.camera)), is_planned }
    }

    /// Writes down to which magnitude the camera sees, and warns of stars that it would see and the frames lack.
    ///
    /// # Errors
    /// When the text cannot grow.
    pub(super) fn write(&self, text: &mut String, bench: &Bench, params: &RunParams, sky: &Sky) -> Result<()> {
        let [_, faintest] = sky.layers.magnitudes().map(f64::from);
        let drawn = f64::from(params.camera.limiting_mag);
        if let Some(sensitivity) = &self.sensitivity {
            let seen = sensitivity.limiting_mag(SEEN_SNR);
            match seen.filter(|seen| *seen >= BRIGHTEST_MAG) {
                Some(seen) => {
                    writeln!(text, "  sees         stars to G = {seen:.2} at SNR {SEEN_SNR} in one frame")?;
                    if let Some(what) = left_out(&bench.camera.radiometry, [drawn, faintest, seen]) {
                        writeln!(text, "  WARNING      {what}")?;
                    }
                }
                None => {
                    let seen = seen.map_or_else(|| "none".into(), |seen| format!("G = {seen:.2}"));
                    writeln!(
                        text,
                        "  WARNING      the camera sees no star: its limit at SNR {SEEN_SNR} is {seen}, the brightest star has \
                         G = {BRIGHTEST_MAG}: check aperture_mm, exposure_s and quantum_efficiency"
                    )?;
                }
            }
        } else if drawn > faintest {
            writeln!(
                text,
                "  WARNING      the catalog ends at G = {faintest:.1}: fainter stars are missing from the frames"
            )?;
        }
        if !self.is_planned {
            write_mean_stars(text, bench, sky)?;
        }
        Ok(())
    }

    /// Warns of a planned frame in which no star is, or none that the camera sees.
    ///
    /// # Errors
    /// When the text cannot grow.
    pub(super) fn write_frame(&self, text: &mut String, number: u32, plan: &ExposurePlan) -> Result<()> {
        if !self.is_planned {
            return Ok(());
        }
        let in_field = || plan.stars.iter().filter(|star| star.electrons_on_detector > 0.0);
        let Some(brightest_e) = in_field().map(|star| star.electrons).reduce(f64::max) else {
            writeln!(text, "  WARNING      no star is in the field of frame {number}")?;
            return Ok(());
        };
        let Some(Sensitivity { window, pixel, .. }) = &self.sensitivity else { return Ok(()) };
        let snr = window.terms(brightest_e, pixel).snr;
        if snr < SEEN_SNR {
            writeln!(
                text,
                "  WARNING      the camera sees none of the {} stars of frame {number}: the brightest has SNR {snr:.2}, wanted \
                 {SEEN_SNR}",
                in_field().count()
            )?;
        }
        Ok(())
    }
}

/// Returns the magnitude to which a camera sees; `None` for one without noise, and for one that sees no star.
pub(super) fn seen_mag(params: &RunParams) -> Option<f64> {
    let has_noise = params.drawn_from_sensor.is_none() && params.camera.radiometry.zero_point_e_per_s().is_some();
    has_noise.then(|| sensitivity_for_suns(&params.camera))?.limiting_mag(SEEN_SNR)
}

/// Returns which stars the camera sees, and the limit of drawing or the catalog leaves out, and why.
pub(super) fn left_out(radiometry: &Radiometry, [drawn, faintest, seen]: [f64; 3]) -> Option<String> {
    if radiometry.seen_stars_left_out || seen <= drawn.min(faintest) + SAME_MAG {
        return None;
    }
    let why = match radiometry.limiting_mag {
        Some(_) if drawn < faintest => {
            format!("radiometry.limiting_mag is {drawn:.2}: leave it out, or set seen_stars_left_out = true")
        }
        None if drawn < faintest => {
            format!("no more stars than those to G = {drawn:.2} fit into memory: raise sky.memory_mb")
        }
        _ => format!(
            "the catalog ends at G = {faintest:.1}: name sky.layers, or set radiometry.seen_stars_left_out = true"
        ),
    };
    Some(format!("stars that the camera sees, to G = {seen:.2}, are left out: {why}"))
}

/// Warns of a field that has no star in most directions, where the directions of the run are not known.
fn write_mean_stars(text: &mut String, bench: &Bench, sky: &Sky) -> Result<()> {
    let stars: u64 = sky.layers.layers().map(StarIndex::stars).sum();
    let [width, height] = bench.camera.fov_deg().map(|side_deg| (0.5 * side_deg).to_radians());
    // The solid angle of a rectangular pyramid.
    let field_sr = 4.0 * (width.sin() * height.sin()).asin();
    let mean = stars as f64 * field_sr / SKY_SR;
    if mean < 1.0 {
        writeln!(
            text,
            "  WARNING      most frames have no star: the mean field has {mean:.2e} of the {stars} stars of the catalog, wanted \
             1 at least"
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stars_that_are_seen_and_left_out_are_warned_of_on_both_sides() {
        let mut radiometry = Bench::built_in().unwrap().camera.radiometry;
        radiometry.seen_stars_left_out = false;
        let warned = |radiometry: &Radiometry, magnitudes| left_out(radiometry, magnitudes).unwrap_or_default();
        let given = Radiometry { limiting_mag: Some(7.0), ..radiometry };
        assert_eq!(warned(&given, [7.0, 8.5, 7.04]), "", "as good as seen");
        let text = warned(&given, [7.0, 8.5, 7.49]);
        assert!(text.contains("to G = 7.49") && text.contains("limiting_mag is 7.00"), "{text}");
        assert_eq!(warned(&Radiometry { seen_stars_left_out: true, ..given }, [7.0, 8.5, 7.49]), "", "on purpose");
        let auto = Radiometry { limiting_mag: None, ..radiometry };
        assert_eq!(warned(&auto, [8.0, 8.5, 7.49]), "");
        assert!(warned(&auto, [8.5, 8.5, 10.0]).contains("the catalog ends at G = 8.5"));
        assert!(warned(&auto, [12.0, 16.0, 14.0]).contains("sky.memory_mb"));
    }
}
