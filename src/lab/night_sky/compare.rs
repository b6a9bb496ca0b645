//! One real frame and a camera file -> attitude, fitted camera, drawn frame, figures.
//!
//! Detections -> attitude -> the fits (`fit`). Then the camera file is written, read again, and drawn: the figures are
//! those of the file.

use crate::detect::{self, Detection};
use crate::draw::{Drawn, draw};
use crate::figures::{self, Pair};
use crate::measure::{PixelNoise, Plate, Spot, measure};
use crate::picture::{Flip, Picture};
use crate::read::{self, ImageFile};
use crate::result::{Comparison, conclude};
use crate::sky_stars::{FieldStar, SkyStar, When, of_field, on_image, seen};
use crate::solve::{BrightSky, LEAST_MATCHES, SCALE_TOLERANCES};
use crate::{camera_text, limiting};
use crate::{geometry::Geometry, measure::Stamp, result::Fitted};
use base::axes::{Icrf, Rotation, Sensor, ra_dec_roll};
use base::{refused::Refused, time::Tai};
use config::{Camera, Document};
use glam::DVec3;
use run::wiring::camera_parts::camera_params;
use sky::astrometry::{ApparentPlaces, BrownConrady};
use stars::{Sky, catalog::Catalog};
use std::path::{Path, PathBuf};

/// Seed of the drawn frames.
const SEED: u64 = 1;
/// Memory of stars, MiB.
const STAR_MEMORY_MB: u32 = 256;

/// How frames are compared.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Middle of the exposures; without it, the catalog's directions are taken as they are.
    pub time: Option<Tai>,
    /// The frames are from the ground: the stretch by the air's refraction is fitted.
    pub is_ground: bool,
    /// The attitude to draw with, in place of the fitted one: only where it is right do the frames agree.
    pub attitude: Option<Rotation<Sensor, Icrf>>,
    /// The images are turned over before they are compared.
    pub flip: Option<Flip>,
    /// Layers of stars in place of the built-in catalog.
    pub layers: Vec<PathBuf>,
}

/// A camera and the sky that its frames are compared with.
pub struct Comparer {
    pub(crate) camera: Camera,
    text: String,
    path: PathBuf,
    pub(crate) options: Options,
    pub(crate) start: Geometry,
    pub(crate) params: scene::camera::CameraParams,
    sky: Sky,
    when: When,
    places: ApparentPlaces,
    bright: BrightSky,
}

/// An image as it is compared, with its background and its stars.
struct Frame {
    real: Picture,
    surface: Vec<f32>,
    found: Vec<Detection>,
    flip: Option<Flip>,
}

impl Frame {
    fn of(real: Picture, flip: Option<Flip>) -> Self {
        let surface = detect::background(&real);
        let found = detect::detections(&real, &surface);
        Self { real, surface, found, flip }
    }
}

/// Everything about one frame, for reports.
pub struct Compared {
    /// The figures.
    pub result: Comparison,
    /// The real frame.
    pub real: Picture,
    /// The drawn frame.
    pub drawn: Picture,
    /// The fitted camera file.
    pub camera_text: String,
    /// The stars.
    pub pairs: Vec<Pair>,
}

impl Comparer {
    /// Makes the comparer of a camera file.
    ///
    /// # Errors
    /// When the camera is refused, or has what is not compared, or the stars cannot be read.
    pub fn new(document: &Document, path: &Path, options: Options) -> Result<Self, Refused> {
        let part = |doing, why: String| Refused::at(path, format_args!("{doing}: {why}"));
        let camera = Camera::from_document(document).map_err(|error| part("the camera file", error.to_string()))?;
        let params = camera_params(&camera).map_err(|error| part("the camera", format!("{error:#}")))?;
        check_camera(&camera, &params)?;
        let geometry = params.geometry.parameters();
        let start = Geometry {
            attitude: Rotation::IDENTITY,
            focal_px: geometry.focal_px[0],
            centre_px: geometry.principal_point_px,
            distortion: if camera.distortion.polynomial.is_some() {
                BrownConrady::default()
            } else {
                geometry.distortion
            },
            stretch: [0.0; 2],
        };
        let sky = Sky::open(&options.layers, params.limiting_mag, STAR_MEMORY_MB)
            .map_err(|error| part("the stars", error.to_string()))?;
        let catalog = Catalog::built_in().map_err(|error| part("the built-in catalog", error.to_string()))?;
        let when = When { at: options.time, epoch_yr: sky.layers.epoch_yr() };
        let places = when.places().map_err(|error| part("the Earth's place", error.to_string()))?;
        let mut all: Vec<SkyStar> = catalog.sources().iter().map(|source| seen(source, &places)).collect();
        all.sort_by(|a, b| a.mag_g.total_cmp(&b.mag_g));
        let [width, height] =
            [params.geometry.width_px(), params.geometry.height_px()].map(|side| side as f64 / start.focal_px);
        let bright = BrightSky::new(&all, width * height, 2.0 * params.geometry.half_diagonal_rad());
        Ok(Self {
            text: document.text().into(),
            path: path.into(),
            camera,
            options,
            start,
            params,
            sky,
            when,
            places,
            bright,
        })
    }

    /// Compares one frame.
    ///
    /// # Errors
    /// When the file cannot be read, no attitude is found, or a fit fails.
    pub fn compare(&self, path: &Path) -> Result<Compared, Refused> {
        let file = read::read(path, self.params.output().size_px, self.params.detector.bits)?;
        let (frame, solved) = self.recognised(path, &file)?;
        let fitted = self.fit(path, &frame.real, &frame.surface, &frame.found, solved)?;
        self.compare_fitted(path, frame, &fitted)
    }

    /// Finds the attitude; an image whose order of rows is open is tried both ways.
    fn recognised(&self, path: &Path, file: &ImageFile) -> Result<(Frame, Geometry), Refused> {
        let flip = self.options.flip;
        let given = Frame::of(flip.map_or_else(|| file.picture.clone(), |flip| file.picture.flipped(flip)), flip);
        if given.found.len() < LEAST_MATCHES {
            return Err(Refused::at(
                path,
                format_args!(
                    "{got} stars above the background, wanted at least {wanted}: a blank, overexposed or blurred image \
         cannot be compared",
                    got = given.found.len(),
                    wanted = LEAST_MATCHES
                ),
            ));
        }
        let mut frames = vec![given];
        if flip.is_none() && file.is_row_order_open {
            frames.push(Frame::of(file.picture.flipped(Flip::Rows), Some(Flip::Rows)));
        }
        for tolerance in SCALE_TOLERANCES {
            for place in 0..frames.len() {
                if let Some(geometry) = self.solve(&frames[place].found, false, tolerance) {
                    return Ok((frames.swap_remove(place), geometry));
                }
            }
        }
        Err(self.without_attitude(path, &frames[0]))
    }

    /// Finds the attitude; of the detections with left and right exchanged where `is_mirrored`.
    fn solve(&self, found: &[Detection], is_mirrored: bool, tolerance: f64) -> Option<Geometry> {
        let last = self.params.geometry.width_px() as f64 - 1.0;
        let directed = |one: &Detection| {
            let px = if is_mirrored { [last - one.px[0], one.px[1]] } else { one.px };
            self.params.geometry.unproject(px).map(|direction| (Detection { px, ..*one }, direction))
        };
        let stars: Vec<(Detection, DVec3)> = found.iter().filter_map(directed).collect();
        self.bright.solve(&self.start, &stars, tolerance).map(|(geometry, _)| geometry)
    }

    /// Returns why no attitude is found: a mirrored image has another cause than a wrong focal length.
    fn without_attitude(&self, path: &Path, frame: &Frame) -> Refused {
        if SCALE_TOLERANCES.into_iter().any(|tolerance| self.solve(&frame.found, true, tolerance).is_some()) {
            let advice = match self.options.flip {
                Some(_) => "leave --flip out",
                None => {
                    "give --flip rows where its first row is the bottom one, --flip columns where left and right are exchanged"
                }
            };
            return Refused::at(
                path,
                format_args!(
                    "no attitude found: the image is mirrored left to right: its brightest {stars} stars fit the sky when it is \
         turned over; {advice}",
                    stars = frame.found.len()
                ),
            );
        }
        Refused::at(
            path,
            format_args!(
                "no attitude found: the brightest {stars} stars fit no part of the sky with a focal length of {focal_mm:.2} \
         mm within {tolerance_percent:.1} %; check optics.focal_length_mm and detector.pixel_pitch_um",
                stars = frame.found.len(),
                focal_mm = self.camera.optics.focal_length_mm,
                tolerance_percent = 100.0 * SCALE_TOLERANCES[1]
            ),
        )
    }

    /// Returns the stars on the image, brightest first; stars that the image cannot separate as one.
    pub(crate) fn field(&self, path: &Path, geometry: &Geometry) -> Result<Vec<FieldStar>, Refused> {
        let axis = geometry.attitude.inverse().apply(DVec3::Z);
        let radius = 1.05 * self.params.geometry.half_diagonal_rad() + 0.002;
        let stars = of_field(&self.sky, &self.places, axis, radius)
            .map_err(|error| Refused::at(path, format_args!("the stars of the field: {error}")))?;
        Ok(on_image(stars, geometry))
    }

    /// Returns the noise by the camera file.
    pub(crate) fn noise(&self) -> PixelNoise {
        let detector = &self.params.detector;
        PixelNoise {
            gain_e_per_dn: detector.gain_e_per_dn,
            read_dn: detector.readout_noise_e_rms() / detector.gain_e_per_dn,
            black_dn: detector.black_level_dn,
            most_dn: f64::from((1_u32 << detector.bits) - 1),
        }
    }

    fn compare_fitted(&self, path: &Path, frame: Frame, fitted: &Fitted) -> Result<Compared, Refused> {
        let Frame { real, surface, found, flip } = frame;
        let part = |doing, why: String| Refused::at(path, format_args!("{doing}: {why}"));
        let name = format!(
            "{}, fitted to {}",
            self.camera.name,
            path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
        );
        let fit = camera_text::Fit {
            geometry: &fitted.placed.geometry,
            shape: fitted.psf.as_ref().map(|psf| psf.shape),
            light: fitted.light.as_ref(),
            vignetting: fitted.vignetting,
            background: &fitted.background,
            noise: fitted.noise,
        };
        let text = camera_text::fitted(&self.text, &self.camera, &name, &fit)
            .map_err(|error| part("the fitted camera file", error.to_string()))?;
        // The file is read again: what is drawn is what is written.
        let camera = Camera::from_document(&Document::from_text(&text, &self.path))
            .map_err(|error| part("the fitted camera file", error.to_string()))?;
        let attitude = self.options.attitude.unwrap_or(fitted.placed.geometry.attitude);
        let drawn = draw(&camera, attitude, &self.sky, &self.when, SEED)
            .map_err(|error| part("drawing the field", format!("{error:#}")))?;
        let drawn_surface = detect::background(&drawn.picture);
        let stamp = fitted.psf.as_ref().map_or_else(|| Stamp::of(&self.params.psf), |psf| psf.stamp.clone());
        let plate = Plate { picture: &real, background: &surface, noise: fitted.noise };
        let drawn_plate = Plate { picture: &drawn.picture, background: &drawn_surface, noise: fitted.noise };
        let field = self.field(path, &fitted.placed.geometry)?;
        let places: Vec<[f64; 2]> = field.iter().map(|one| one.px).collect();
        let of_drawn = Geometry { attitude, ..fitted.placed.geometry };
        let drawn_places: Vec<[f64; 2]> =
            field.iter().map(|one| of_drawn.place(one.star.direction).unwrap_or([f64::NAN; 2])).collect();
        let (spots, drawn_spots) = (measure(&plate, &stamp, &places), measure(&drawn_plate, &stamp, &drawn_places));
        let pairs: Vec<Pair> = field
            .iter()
            .zip(spots.iter().zip(&drawn_spots))
            .filter_map(|(one, (real, other))| pair(one, real, other, &drawn, fitted.noise.gain_e_per_dn))
            .collect();
        let mut stars: Vec<[f64; 2]> = found.iter().map(|one| one.px).collect();
        stars.extend(&places);
        let parts = crate::result::Parts {
            path,
            fitted,
            camera: &camera,
            pairs: &pairs,
            snr: figures::snr_rows(&plate, &drawn_plate, &pairs),
            background: figures::background(&real, &drawn.picture, &stars),
            energy: figures::energy(&plate, &drawn_plate, &pairs),
            ra_dec_roll: ra_dec_roll(&attitude),
            detections: found.len(),
            is_ground: self.options.is_ground,
            is_given: self.options.attitude.is_some(),
            flip,
        };
        let mut result = conclude(&parts);
        result.limited_by = limiting::words(&result, limiting::shape_spread(&plate, &drawn_plate, &pairs));
        Ok(Compared { result, real, drawn: drawn.picture, camera_text: text, pairs })
    }
}

fn check_camera(camera: &Camera, params: &scene::camera::CameraParams) -> Result<(), Refused> {
    let refuse = |what, wanted| Err(Refused(format!("camera \"{name}\": {what}; wanted {wanted}", name = camera.name)));
    if params.output().size_px != params.sensor_px() {
        return refuse(
            "it bins or cuts its image",
            "one pixel of the file for each pixel of the detector: describe binned pixels as pixels",
        );
    }
    if camera.star_light().zero_point_e_per_s().is_none() {
        return refuse("its radiometry is a grey map", "radiometry.model \"photons\"");
    }
    if camera.band.is_some() {
        return refuse("its radiometry is a band", "a camera without [band]: zero point and colour terms are fitted");
    }
    Ok(())
}

/// Returns a star of both frames, with what was drawn of it.
fn pair(one: &FieldStar, real: &Option<Spot>, other: &Option<Spot>, drawn: &Drawn, gain: f64) -> Option<Pair> {
    let (real, other) = (real.as_ref().copied()?, other.as_ref().copied()?);
    let rows: Vec<_> = one.members.iter().filter_map(|id| drawn.truth.iter().find(|row| row.id == *id)).collect();
    let electrons: f64 = rows.iter().map(|row| row.electrons).sum();
    if electrons <= 0.0 {
        return None;
    }
    let place = |of: fn(&frames::sink::TruthStar) -> f64| {
        rows.iter().map(|row| row.electrons * of(row)).sum::<f64>() / electrons
    };
    Some(Pair {
        real,
        drawn: other,
        truth_px: [place(|row| row.x_px), place(|row| row.y_px)],
        truth_dn: electrons / gain,
        mag_g: one.star.mag_g,
        bp_rp: one.star.bp_rp,
        is_blended: one.is_blended,
        name: one.star.name,
    })
}
