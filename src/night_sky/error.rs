//! Errors of a comparison.

use std::path::PathBuf;

/// A comparison that cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// the file cannot be read as an image
    #[error("{}: {what}; wanted {wanted}, got {got}", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// The property that is wrong.
        what: &'static str,
        /// The wanted value.
        wanted: String,
        /// The given value.
        got: String,
    },
    /// an image of another size
    #[error(
        "{}: the image has {} x {} pixels, the camera file {} x {}: give the camera that took it, or change \
         detector.width_px and height_px",
        path.display(), got[0], got[1], wanted[0], wanted[1]
    )]
    Size {
        /// The file.
        path: PathBuf,
        /// Columns and rows of the camera.
        wanted: [usize; 2],
        /// Columns and rows of the image.
        got: [usize; 2],
    },
    /// numbers beyond the converter's
    #[error(
        "{}: the image has values up to {got}, the camera file has {bits} bits: wanted values up to {most}, or those \
         values times {scale} (left-justified); correct detector.bits",
        path.display()
    )]
    Range {
        /// The file.
        path: PathBuf,
        /// Bits of the camera.
        bits: u32,
        /// Largest number of so many bits.
        most: f64,
        /// Factor of values in the upper bits of 16.
        scale: f64,
        /// Largest value found.
        got: f64,
    },
    /// too few stars
    #[error(
        "{}: {got} stars above the background, wanted at least {wanted}: a blank, overexposed or blurred image \
         cannot be compared",
        path.display()
    )]
    FewStars {
        /// The file.
        path: PathBuf,
        /// Detections.
        got: usize,
        /// Least number.
        wanted: usize,
    },
    /// the stars do not belong to the catalog's sky
    #[error(
        "{}: no attitude found: the brightest {stars} stars fit no part of the sky with a focal length of {focal_mm:.2} \
         mm within {tolerance_percent:.1} %; check optics.focal_length_mm and detector.pixel_pitch_um",
        path.display()
    )]
    NoAttitude {
        /// The file.
        path: PathBuf,
        /// Stars that were tried.
        stars: usize,
        /// Focal length of the camera.
        focal_mm: f64,
        /// How far the scale may be off.
        tolerance_percent: f64,
    },
    /// the stars belong to the catalog's sky in a mirror
    #[error(
        "{}: no attitude found: the image is mirrored left to right: its brightest {stars} stars fit the sky when it is \
         turned over; {advice}",
        path.display()
    )]
    Mirrored {
        /// The file.
        path: PathBuf,
        /// Stars that were tried.
        stars: usize,
        /// The option that helps.
        advice: &'static str,
    },
    /// a fit without a solution
    #[error("{}: {what} cannot be fitted: {why}", path.display())]
    Fit {
        /// The file.
        path: PathBuf,
        /// What.
        what: &'static str,
        /// Why not.
        why: String,
    },
    /// a camera with something that is not compared
    #[error("camera \"{name}\": {what}; wanted {wanted}")]
    Camera {
        /// Its name.
        name: String,
        /// The property that it has.
        what: &'static str,
        /// The properties that can be compared.
        wanted: &'static str,
    },
    /// another part of the program refused
    #[error("{}: {doing}: {why}", path.display())]
    Part {
        /// The image.
        path: PathBuf,
        /// The action.
        doing: &'static str,
        /// Its error with causes.
        why: String,
    },
}
