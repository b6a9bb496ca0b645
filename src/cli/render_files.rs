//! The line that `render` prints about the files it wrote, for people and as JSON.

use serde::Serialize;
use std::path::PathBuf;

/// An image and the files that it went into.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct WrittenImage {
    pub(super) image: PathBuf,
    /// The truth table, where one was asked for.
    pub(super) truth: Option<PathBuf>,
    pub(super) camera: String,
    pub(super) width_px: usize,
    pub(super) height_px: usize,
    pub(super) fov_deg: [f64; 2],
    pub(super) exposure_s: f64,
    /// Sources drawn: stars of the field, or those of `--sources`.
    pub(super) stars: usize,
    pub(super) method: String,
    pub(super) backend: &'static str,
    /// Median times, ms, where they were asked for.
    pub(super) timing: Option<serde_json::Value>,
}

impl WrittenImage {
    /// Returns the line for people.
    pub(super) fn line(&self) -> String {
        let [fov_x, fov_y] = self.fov_deg;
        let truth = self.truth.as_ref().map(|path| format!("; truth in {}", path.display())).unwrap_or_default();
        format!(
            "{}: {} x {} px, {fov_x:.2} x {fov_y:.2} deg, {} stars, exposure {} s, camera \"{}\", {} backend{truth}",
            self.image.display(),
            self.width_px,
            self.height_px,
            self.stars,
            self.exposure_s,
            self.camera,
            self.backend
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_names_every_file_and_no_other() {
        let mut written = WrittenImage {
            image: "a.png".into(),
            truth: None,
            camera: "small".into(),
            width_px: 4,
            height_px: 3,
            fov_deg: [2.0, 1.5],
            exposure_s: 0.1,
            stars: 7,
            method: "static".into(),
            backend: "cpu",
            timing: None,
        };
        let line = "a.png: 4 x 3 px, 2.00 x 1.50 deg, 7 stars, exposure 0.1 s, camera \"small\", cpu backend";
        assert_eq!(written.line(), line);
        written.truth = Some("a.csv".into());
        assert_eq!(written.line(), format!("{line}; truth in a.csv"));
    }
}
