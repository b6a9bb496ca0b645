//! Reads a tracker's measurements of a display's images into sights: tables, or folders of FITS frames.
//!
//! A frame is named as its image: `level_114.fits` of `level_114.png`. `EXPTIME` (s) must be in its header, `DATE-OBS`
//! (UTC) should be. Integers are digital numbers, which the camera's file makes electrons of; floating point is
//! electrons.

use anyhow::{Context, Result, bail};
use base::image::{DnImage, Image};
use base::input_file::{DATA_BYTES, InputFile};
use base::time::Tai;
use config::Camera;
use frames::sink::fits::{FitsImage, image::OwnedPixels};
use outputs::display::calibration::measurement::read_csv;
use outputs::display::calibration::spots::{FrameScale, sights_of_frame};
use outputs::display::calibration::{Pattern, Plan, Sight};
use std::path::Path;

/// Measurements of a display, with the time of the first.
#[derive(Debug, Default)]
pub(super) struct Measurements {
    /// Measured images.
    pub(super) sights: Vec<Sight>,
    /// When the first frame was taken, or why that is unknown; `None`: no frame has a date.
    pub(super) first: Option<Result<Tai>>,
    /// Images of the plan without a frame.
    pub(super) missing: Vec<String>,
}

/// Returns the rows of a table.
pub(super) fn sights_of_table(path: &Path) -> Result<Vec<Sight>> {
    let file = InputFile::open(path, DATA_BYTES).with_context(|| path.display().to_string())?;
    Ok(read_csv(file, path)?)
}

/// Reads the frames of a folder. Images without a frame are listed, those of the latency marker need none.
pub(super) fn measurements_of_folder(folder: &Path, plan: &Plan, camera: &Camera) -> Result<Measurements> {
    let mut found = Measurements::default();
    let mut frames = 0;
    for pattern in plan.patterns() {
        let path = folder.join(format!("{}.fits", pattern.name()));
        if path.exists() {
            let Frame { image, saturated_from, date } = frame_of(&path, camera)?;
            found.sights.extend(sights_of_frame(pattern, &image, saturated_from));
            found.first = earlier(found.first, date);
            frames += 1;
        } else if !matches!(pattern, Pattern::Marker(_)) {
            found.missing.push(pattern.name());
        }
    }
    if frames == 0 {
        let wanted = "wanted FITS frames named as the plan's images (dots.fits, level_0.fits ...)";
        bail!("{}: {wanted}, got none", folder.display());
    }
    Ok(found)
}

/// Returns the earlier of two dates; a date that cannot be read comes before all others.
pub(super) fn earlier(a: Option<Result<Tai>>, b: Option<Result<Tai>>) -> Option<Result<Tai>> {
    match (a, b) {
        (Some(Ok(a)), Some(Ok(b))) => Some(Ok(a.min(b))),
        (Some(Err(error)), _) | (_, Some(Err(error))) => Some(Err(error)),
        (a, b) => a.or(b),
    }
}

/// A frame in electrons per second.
struct Frame {
    image: Image<f64>,
    saturated_from: f64,
    /// Not read where the time is given: some programs write invalid dates.
    date: Option<Result<Tai>>,
}

fn frame_of(path: &Path, camera: &Camera) -> Result<Frame> {
    let place = || path.display().to_string();
    let file = InputFile::open(path, DATA_BYTES).with_context(place)?;
    let fits = FitsImage::read(std::io::BufReader::new(file)).with_context(place)?;
    let Some(exposure_s) = fits.header.real("EXPTIME").filter(|s| *s > 0.0) else {
        bail!(
            "{}: wanted the exposure, EXPTIME in seconds above 0, in the header: levels of other exposures are other \
               levels; got none; write it there, or measure with another program and give a table",
            place()
        )
    };
    let wanted = [camera.detector.width_px as usize, camera.detector.height_px as usize];
    if [fits.width, fits.height] != wanted {
        let got = format!("{} x {}", fits.width, fits.height);
        bail!("{}: wanted the camera's {} x {} px, got {got}", place(), wanted[0], wanted[1]);
    }
    let date = fits.header.text("DATE-OBS").map(|text| date_of(&text).with_context(place));
    let scale = scale_of(camera, exposure_s);
    // An image that is read upside down would fit as well: a display that is mirrored and half turned.
    let values = fits.top_row_first();
    let image = if let OwnedPixels::U16(_) = fits.pixels {
        let mut frame = DnImage::new(wanted[0], wanted[1]);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "they were u16")]
        frame.pixels_mut().iter_mut().zip(values).for_each(|(dn, value)| *dn = value as u16);
        scale.applied(&frame)
    } else {
        let mut image = Image::new(wanted[0], wanted[1]);
        image.pixels_mut().iter_mut().zip(values).for_each(|(e_per_s, value)| *e_per_s = value / exposure_s);
        image
    };
    Ok(Frame { image, saturated_from: scale.saturated_from(), date })
}

fn scale_of(camera: &Camera, exposure_s: f64) -> FrameScale {
    let detector = &camera.detector;
    let largest_dn = detector.params.largest_dn();
    let (gain_e_per_dn, black_level_dn) = (detector.params.gain_e_per_dn, detector.params.black_level_dn);
    FrameScale { gain_e_per_dn, black_level_dn, exposure_s, largest_dn, full_well_e: detector.params.full_well_e }
}

/// Returns a date of a FITS header: UTC without its letter, or a day.
pub(super) fn date_of(text: &str) -> Result<Tai> {
    let text = text.trim();
    let is_zoned = text.ends_with('Z') || text.get(10..).is_some_and(|time| time.contains(['+', '-']));
    let whole = match (text.contains('T'), is_zoned) {
        (true, true) => text.to_owned(),
        (true, false) => format!("{text}Z"),
        (false, _) => format!("{text}T00:00:00Z"),
    };
    Ok(Tai::from_rfc3339(&whole)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use config::Document;
    use frames::sink::fits::{Header, Pixels, write_image};
    use outputs::display::calibration::{DisplayIdentity, Grid, TrackerIdentity};

    fn plan() -> Plan {
        let display = DisplayIdentity { name: "d".into(), width_px: 320, height_px: 200, bits: 8 };
        let tracker = TrackerIdentity { name: "t".into(), width_px: 9, height_px: 9, geometry_crc32: "0".into() };
        Plan::new(display, tracker, Grid { columns: 8, rows: 5, dot_px: 5, margin_px: 12 }, 16).unwrap()
    }

    fn camera() -> Camera {
        let text = "name = \"t\"\n[detector]\nwidth_px = 64\nheight_px = 48\npixel_pitch_um = 10.0\n[optics]\n\
                    focal_length_mm = 20.0\naperture_mm = 10.0\n[exposure]\nexposure_s = 0.1\n";
        Camera::from_document(&Document::from_text(text, Path::new("t.toml"))).unwrap()
    }

    fn write(folder: &Path, name: &str, level_e: f32, change: impl Fn(&mut Header)) {
        let mut header = Header::default();
        change(&mut header);
        let file = std::fs::File::create(folder.join(format!("{name}.fits"))).unwrap();
        write_image(file, 64, 48, Pixels::F32(&[level_e; 64 * 48]), &header).unwrap();
    }

    #[test]
    fn frames_say_their_exposure_and_when_they_were_taken() {
        let folder = tempfile::tempdir().unwrap();
        let exposed = |exposure_s: f64, date: &'static str| {
            move |header: &mut Header| {
                header.push("EXPTIME", exposure_s, "");
                header.push("DATE-OBS", date, "");
            }
        };
        write(folder.path(), "level_0", 100.0, exposed(0.5, "2026-03-01T12:00:07"));
        write(folder.path(), "level_255", 1e9, exposed(0.25, "2026-03-01T12:00:00"));
        let found = measurements_of_folder(folder.path(), &plan(), &camera()).unwrap();
        assert_eq!(found.first.unwrap().unwrap(), Tai::from_rfc3339("2026-03-01T12:00:00Z").unwrap(), "the earliest");
        assert_eq!(found.sights[0].luminance, Some(200.0), "electrons per second, by the frame's own exposure");
        let saturated = |pattern| found.sights.iter().filter(|s| s.pattern == pattern).all(|s| s.is_saturated);
        assert_eq!([saturated(Pattern::Level(0)), saturated(Pattern::Level(255))], [false, true]);
        assert!(found.missing.contains(&"dots".into()) && !found.missing.contains(&"marker_on".into()));
    }

    #[test]
    fn frames_are_read_from_the_top_whatever_their_order_of_rows() {
        let folder = tempfile::tempdir().unwrap();
        let written = |order: &str, values: &[f32]| {
            let path = folder.path().join("frame.fits");
            let mut header = Header::default();
            header.push("EXPTIME", 1.0, "");
            header.push("ROWORDER", order, "");
            let file = std::fs::File::create(&path).unwrap();
            write_image(file, 64, 48, Pixels::F32(values), &header).unwrap();
            frame_of(&path, &camera()).unwrap().image
        };
        let values: Vec<f32> = (0..64 * 48_u16).map(f32::from).collect();
        let turned: Vec<f32> = values.rchunks_exact(64).flatten().copied().collect();
        let top_down = written("TOP-DOWN", &values);
        assert_eq!(top_down, written("BOTTOM-UP", &turned));
        assert_ne!(top_down, written("TOP-DOWN", &turned), "control");
    }

    #[test]
    fn dates_that_cannot_be_read_matter_only_where_they_are_needed() {
        let folder = tempfile::tempdir().unwrap();
        let dated = |date: &'static str| {
            move |header: &mut Header| {
                header.push("EXPTIME", 0.1, "");
                header.push("DATE-OBS", date, "");
            }
        };
        write(folder.path(), "level_0", 1.0, dated("2026-03-01T12:00:07"));
        write(folder.path(), "level_255", 1.0, dated("01/03/99"));
        let found = measurements_of_folder(folder.path(), &plan(), &camera()).unwrap();
        assert!(!found.sights.is_empty() && found.first.unwrap().is_err());
    }

    #[test]
    fn a_frame_without_an_exposure_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let refused = || format!("{:#}", measurements_of_folder(folder.path(), &plan(), &camera()).unwrap_err());
        assert!(refused().contains("dots.fits"), "an empty folder: {}", refused());
        write(folder.path(), "dots", 1.0, |_| {});
        assert!(refused().contains("dots.fits") && refused().contains("EXPTIME"), "{}", refused());
        write(folder.path(), "dots", 1.0, |header| header.push("EXPTIME", 0.0, ""));
        assert!(refused().contains("EXPTIME"), "{}", refused());
        write(folder.path(), "dots", 1.0, |header| header.push("EXPTIME", 0.1, ""));
        assert!(measurements_of_folder(folder.path(), &plan(), &camera()).unwrap().first.is_none(), "no date");
    }

    #[test]
    fn dates_with_and_without_a_zone_or_a_time() {
        let at = |text: &str| date_of(text).unwrap().to_rfc3339();
        let noon = at("2026-03-01T12:00:00Z");
        assert_eq!(
            [at("2026-03-01T12:00:00"), at("2026-03-01T13:00:00+01:00"), at(" 2026-03-01T12:00:00.000 ")],
            [noon.clone(), noon.clone(), noon]
        );
        assert_eq!(at("2026-03-01"), at("2026-03-01T00:00:00Z"));
        assert!(date_of("yesterday").is_err());
    }
}
