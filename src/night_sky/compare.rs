//! One real frame and a camera file -> attitude, fitted camera, drawn frame, figures.
//!
//! The order of the fits: detections -> attitude -> geometry -> PSF -> geometry again -> noise -> background and
//! vignetting -> zero point and colour. Then the camera file is written, read again, and drawn: the figures are those
//! of the file.

use crate::camera_text;
use crate::detect::{self, Detection};
use crate::draw::{Drawn, draw};
use crate::error::CompareError;
use crate::field::{FieldStar, TIE_SNR, clipped, on_image, rms_of, ties_of_detections, ties_of_spots};
use crate::figures::{self, Pair};
use crate::fitted::Fitted;
use crate::geometry::{Freedom, Geometry, Tie};
use crate::light_fit::{self, FittedLight, LitStar};
use crate::measure::{PixelNoise, Plate, Spot, measure};
use crate::picture::Picture;
use crate::psf_fit;
use crate::read;
use crate::result::{Comparison, conclude};
use crate::sky_stars::{SkyStar, When, of_field, seen};
use crate::solve::{BrightSky, LEAST_MATCHES, SCALE_TOLERANCES};
use crate::stamp::Stamp;
use base::axes::{Icrf, Rotation, Sensor, ra_dec_roll};
use base::time::Tai;
use config::{Camera, Document};
use glam::{DVec2, DVec3};
use plan::optics::Illumination;
use run::wiring::camera_parts::camera_params;
use sky::astrometry::{ApparentPlaces, BrownConrady};
use stars::Sky;
use stars::catalog::Catalog;
use std::path::{Path, PathBuf};

/// Seed of the drawn frames.
const SEED: u64 = 1;
/// How near a detection must be to a star of the catalog to be it, px, one step after the other.
const MATCH_PX: [f64; 3] = [4.0, 2.0, 1.5];
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
    /// Layers of stars in place of the built-in catalog.
    pub layers: Vec<PathBuf>,
}

/// A camera and the sky that its frames are compared with.
pub struct Comparer {
    pub(crate) camera: Camera,
    text: String,
    path: PathBuf,
    options: Options,
    start: Geometry,
    params: scene::camera::CameraParams,
    sky: Sky,
    when: When,
    places: ApparentPlaces,
    bright: BrightSky,
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
    pub fn new(document: &Document, path: &Path, options: Options) -> Result<Self, CompareError> {
        let part = |doing, why: String| CompareError::Part { path: path.into(), doing, why };
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
    pub fn compare(&self, path: &Path) -> Result<Compared, CompareError> {
        let detector = &self.params.detector;
        let real = read::read(path, self.params.output().size_px, detector.bits)?;
        let surface = detect::background(&real);
        let found = detect::detections(&real, &surface);
        if found.len() < LEAST_MATCHES {
            return Err(CompareError::FewStars { path: path.into(), got: found.len(), wanted: LEAST_MATCHES });
        }
        let solved = self.solve(path, &found)?;
        let fitted = self.fit(path, &real, &surface, &found, solved)?;
        self.compare_fitted(path, real, &surface, &found, &fitted)
    }

    /// Finds the attitude.
    fn solve(&self, path: &Path, found: &[Detection]) -> Result<Geometry, CompareError> {
        let directed = |mirrored: bool| -> Vec<(Detection, DVec3)> {
            let flip = self.params.geometry.width_px() as f64 - 1.0;
            let of = |one: &Detection| {
                let px = if mirrored { [flip - one.px[0], one.px[1]] } else { one.px };
                self.params.geometry.unproject(px).map(|direction| (Detection { px, ..*one }, direction))
            };
            found.iter().filter_map(of).collect()
        };
        let stars = directed(false);
        for tolerance in SCALE_TOLERANCES {
            if let Some((geometry, _)) = self.bright.solve(&self.start, &stars, tolerance) {
                return Ok(geometry);
            }
        }
        let is_mirrored = self.bright.solve(&self.start, &directed(true), SCALE_TOLERANCES[0]).is_some();
        let hint = if is_mirrored { "; mirrored left to right they do: turn the image over" } else { "" };
        Err(CompareError::NoAttitude {
            path: path.into(),
            stars: stars.len(),
            focal_mm: self.camera.optics.focal_length_mm,
            tolerance_percent: 100.0 * SCALE_TOLERANCES[1],
            hint,
        })
    }

    /// Returns the stars on the image, brightest first; stars that the image cannot separate as one.
    fn field(&self, path: &Path, geometry: &Geometry) -> Result<Vec<FieldStar>, CompareError> {
        let axis = geometry.attitude.inverse().apply(DVec3::Z);
        let radius = 1.05 * self.params.geometry.half_diagonal_rad() + 0.002;
        let stars = of_field(&self.sky, &self.places, axis, radius).map_err(|error| CompareError::Part {
            path: path.into(),
            doing: "the stars of the field",
            why: error.to_string(),
        })?;
        Ok(on_image(stars, geometry))
    }

    /// Returns the noise by the camera file.
    fn noise(&self) -> PixelNoise {
        let detector = &self.params.detector;
        PixelNoise {
            gain_e_per_dn: detector.gain_e_per_dn,
            read_dn: detector.readout_noise_e_rms() / detector.gain_e_per_dn,
            black_dn: detector.black_level_dn,
            most_dn: f64::from((1_u32 << detector.bits) - 1),
        }
    }

    fn fit(
        &self,
        path: &Path,
        real: &Picture,
        surface: &[f32],
        found: &[Detection],
        solved: Geometry,
    ) -> Result<Fitted, CompareError> {
        let refuse = |what, why: &str| CompareError::Fit { path: path.into(), what, why: why.into() };
        let cells = light_fit::photon_transfer(real);
        let prnu = self.params.detector.prnu;
        let (noise, transfer) = light_fit::noise(&cells, &self.noise(), prnu);
        let mut geometry = solved;
        for radius_px in MATCH_PX {
            let ties = self.ties_of_detections(path, &geometry, found, radius_px)?;
            geometry = geometry
                .fitted(&ties, Freedom::Distortion)
                .ok_or_else(|| refuse("the geometry", "too few stars"))?
                .geometry;
        }
        let sigma_px = self.params.psf.core_sigma_px();
        let mut stamp = Stamp::of(&plan::optics::PsfModel::gaussian(sigma_px.clamp(0.4, 3.0)));
        let plate = Plate { picture: real, background: surface, noise };
        let mut psf = None;
        let (mut focal_error_px, mut stretch_error, mut rms_without_air_px) = (0.0, 0.0, f64::NAN);
        for _ in 0..2 {
            let field = self.field(path, &geometry)?;
            let places: Vec<[f64; 2]> = field.iter().map(|one| one.px).collect();
            let spots = measure(&plate, &stamp, &places);
            let present: Vec<Spot> = spots.iter().flatten().copied().collect();
            psf = psf_fit::fit(&plate, &present, sigma_px.clamp(0.4, 3.0));
            if let Some(fitted) = &psf {
                stamp = fitted.stamp.clone();
            }
            let spots = measure(&plate, &stamp, &places);
            let ties = ties_of_spots(&field, &spots);
            let plain = clipped(&geometry, &ties, Freedom::Distortion)
                .ok_or_else(|| refuse("the geometry", "too few bright stars"))?;
            rms_without_air_px = rms_of(&plain.geometry, &ties);
            let full = if self.options.is_ground { clipped(&geometry, &ties, Freedom::Air) } else { Some(plain) };
            let full = full.ok_or_else(|| refuse("the stretch of the air", "too few bright stars"))?;
            (geometry, focal_error_px, stretch_error) = (full.geometry, full.focal_error_px, full.stretch_error);
        }
        let edge_tangent = self.params.geometry.half_diagonal_rad().tan();
        let pupil_mm = 0.5 * self.camera.optics.aperture_mm;
        let noise_dn = detect::noise_dn(real);
        let vignetting = light_fit::vignetting(real, surface, noise.black_dn, pupil_mm, edge_tangent, noise_dn);
        let illumination = vignetting.map_or(self.params.illumination, |stops| Illumination {
            vignetting: Some(stops),
            cos4: true,
            unblocked: 1.0,
        });
        let background =
            light_fit::background(real, surface, noise.black_dn, |at: DVec2| illumination.at(at * edge_tangent));
        let light = self.light(path, &plate, &stamp, &geometry, &illumination)?;
        Ok(Fitted {
            geometry,
            focal_error_px,
            stretch_error,
            rms_without_air_px,
            psf,
            light,
            vignetting,
            background,
            noise,
            transfer,
        })
    }

    /// Returns the zero point by the stars that are bright, whole and alone.
    fn light(
        &self,
        path: &Path,
        plate: &Plate<'_>,
        stamp: &Stamp,
        geometry: &Geometry,
        lit: &Illumination,
    ) -> Result<Option<FittedLight>, CompareError> {
        let field = self.field(path, geometry)?;
        let places: Vec<[f64; 2]> = field.iter().map(|one| one.px).collect();
        let spots = measure(plate, stamp, &places);
        let star = |(one, spot): (&FieldStar, &Option<Spot>)| {
            let spot = spot
                .as_ref()
                .filter(|spot| spot.is_placed && !spot.is_saturated && spot.snr() > TIE_SNR && !one.is_blended)?;
            let at = plate.picture.half_diagonals(one.px);
            let v = geometry.attitude.apply(one.star.direction);
            Some(LitStar {
                electrons: spot.flux_dn * plate.noise.gain_e_per_dn / lit.at(DVec2::new(v.x, v.y) / v.z),
                error_mag: 1.0857 / spot.snr(),
                mag_g: one.star.mag_g,
                bp_rp: one.star.bp_rp.clamp(-0.5, 5.0),
                r2: at.length_squared(),
            })
        };
        let stars: Vec<LitStar> = field.iter().zip(&spots).filter_map(star).collect();
        Ok(light_fit::light(&stars))
    }

    /// Returns detections with the stars that a geometry puts near them.
    fn ties_of_detections(
        &self,
        path: &Path,
        geometry: &Geometry,
        found: &[Detection],
        radius_px: f64,
    ) -> Result<Vec<Tie>, CompareError> {
        let field = self.field(path, geometry)?;
        Ok(ties_of_detections(&field, found, radius_px))
    }

    fn compare_fitted(
        &self,
        path: &Path,
        real: Picture,
        surface: &[f32],
        found: &[Detection],
        fitted: &Fitted,
    ) -> Result<Compared, CompareError> {
        let part = |doing, why: String| CompareError::Part { path: path.into(), doing, why };
        let name = format!(
            "{}, fitted to {}",
            self.camera.name,
            path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
        );
        let fit = camera_text::Fit {
            geometry: &fitted.geometry,
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
        let attitude = self.options.attitude.unwrap_or(fitted.geometry.attitude);
        let drawn = draw(&camera, attitude, &self.sky, &self.when, SEED)
            .map_err(|error| part("drawing the field", format!("{error:#}")))?;
        let drawn_surface = detect::background(&drawn.picture);
        let stamp = fitted.psf.as_ref().map_or_else(|| Stamp::of(&self.params.psf), |psf| psf.stamp.clone());
        let plate = Plate { picture: &real, background: surface, noise: fitted.noise };
        let drawn_plate = Plate { picture: &drawn.picture, background: &drawn_surface, noise: fitted.noise };
        let field = self.field(path, &fitted.geometry)?;
        let places: Vec<[f64; 2]> = field.iter().map(|one| one.px).collect();
        let of_drawn = Geometry { attitude, ..fitted.geometry };
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
        };
        let result = conclude(&parts);
        Ok(Compared { result, real, drawn: drawn.picture, camera_text: text, pairs })
    }
}

fn check_camera(camera: &Camera, params: &scene::camera::CameraParams) -> Result<(), CompareError> {
    let refuse = |what, wanted| Err(CompareError::Camera { name: camera.name.clone(), what, wanted });
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
    })
}
