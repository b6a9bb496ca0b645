//! One real frame and its attitude -> the camera: geometry, PSF, noise, vignetting, background, zero point and colour.
//!
//! The order: detections -> geometry -> PSF -> geometry again, with the terms that are significant -> noise -> vignetting by the
//! background -> zero point -> vignetting by the stars where they contradict -> background -> response.

use crate::detect::{self, Detection};
use crate::geometry::{FittedGeometry, Freedom, Geometry, Tie, clipped, fitted_with_terms, rms_of};
use crate::light_fit::{self, FittedLight, LitStar};
use crate::measure::{PixelNoise, Plate, Spot, Stamp, measure};
use crate::psf_fit::{self, FittedPsf};
use crate::response::{Response, Tone, response};
use crate::sky_stars::{FieldStar, TIE_SNR, ties_of_detections, ties_of_spots};
use crate::{compare::Comparer, picture::Picture, result::Fitted};
use base::refused::Refused;
use glam::DVec2;
use plan::optics::{Illumination, illumination::Vignetting};
use std::path::Path;

/// How near a detection must be to a star of the catalog to be it, px, one step after the other.
const MATCH_PX: [f64; 3] = [4.0, 2.0, 1.5];
/// Standard deviations of a PSF that the fit starts from, px.
const START_SIGMA_PX: [f64; 2] = [0.4, 3.0];
/// Rounds of PSF and geometry.
const ROUNDS: usize = 2;

/// The geometry with what was found on the way.
struct Placed {
    fitted: FittedGeometry,
    freedom: Freedom,
    rms_without_air_px: f64,
    psf: Option<FittedPsf>,
    stamp: Stamp,
}

/// How the field is lit, and the stars' light with it.
struct Lit {
    illumination: Illumination,
    vignetting: Option<Vignetting>,
    light: Option<FittedLight>,
    is_by_stars: bool,
}

impl Comparer {
    /// Fits the camera to a frame whose attitude is known.
    pub(crate) fn fit(
        &self,
        path: &Path,
        real: &Picture,
        surface: &[f32],
        found: &[Detection],
        solved: Geometry,
    ) -> Result<Fitted, Refused> {
        let cells = light_fit::photon_transfer(real);
        let (noise, transfer) = light_fit::noise(&cells, &self.noise(), self.params.detector.prnu);
        let mut geometry = solved;
        for radius_px in MATCH_PX {
            let ties = ties_of_detections(&self.field(path, &geometry)?, found, radius_px);
            let fitted = geometry.fitted(&ties, Freedom::DISTORTION);
            geometry = fitted.ok_or_else(|| refused(path, "the geometry", "too few stars"))?.geometry;
        }
        let plate = Plate { picture: real, background: surface, noise };
        let placed = self.placed(path, &plate, geometry)?;
        let geometry = placed.fitted.geometry;
        let field = self.field(path, &geometry)?;
        let places: Vec<[f64; 2]> = field.iter().map(|one| one.px).collect();
        let spots = measure(&plate, &placed.stamp, &places);
        let lit = self.lit(&plate, &geometry, &field, &spots);
        let edge_tangent = self.params.geometry.half_diagonal_rad().tan();
        let background = light_fit::background(real, surface, self.unlit_dn(&noise), |at: DVec2| {
            lit.illumination.at(at * edge_tangent)
        });
        Ok(Fitted {
            placed: placed.fitted,
            freedom: placed.freedom,
            rms_without_air_px: placed.rms_without_air_px,
            psf: placed.psf,
            response: curve(&plate, &field, &spots),
            light: lit.light,
            vignetting: lit.vignetting,
            is_lit_by_stars: lit.is_by_stars,
            background,
            noise,
            transfer,
        })
    }

    /// Fits PSF and geometry in turn.
    fn placed(&self, path: &Path, plate: &Plate<'_>, geometry: Geometry) -> Result<Placed, Refused> {
        let base = Freedom { air: self.options.is_ground, ..Freedom::DISTORTION };
        let sigma_px = self.params.psf.core_sigma_px().clamp(START_SIGMA_PX[0], START_SIGMA_PX[1]);
        let mut stamp = Stamp::of(&plan::optics::PsfModel::gaussian(sigma_px));
        let mut psf = None;
        let mut best: Option<(FittedGeometry, Freedom, f64)> = None;
        for _ in 0..ROUNDS {
            let now = best.as_ref().map_or(geometry, |(fitted, ..)| fitted.geometry);
            let field = self.field(path, &now)?;
            let places: Vec<[f64; 2]> = field.iter().map(|one| one.px).collect();
            let spots = measure(plate, &stamp, &places);
            let present: Vec<Spot> = spots.iter().flatten().copied().collect();
            psf = psf_fit::fit(plate, &present, sigma_px);
            if let Some(fitted) = &psf {
                stamp = fitted.stamp.clone();
            }
            let ties = ties_of_spots(&field, &measure(plate, &stamp, &places));
            let (fitted, freedom) = fitted_with_terms(&self.unextended(&now), &ties, base)
                .ok_or_else(|| refused(path, "the geometry", "too few bright stars"))?;
            let rms_px = self.rms_without_air_px(&now, &ties, freedom);
            best = Some((fitted, freedom, rms_px));
        }
        let (fitted, freedom, rms_without_air_px) =
            best.ok_or_else(|| refused(path, "the geometry", "too few bright stars"))?;
        Ok(Placed { fitted, freedom, rms_without_air_px, psf, stamp })
    }

    /// Returns a geometry with the camera file's numbers for those that are fitted only where they are significant.
    fn unextended(&self, geometry: &Geometry) -> Geometry {
        let mut start = Geometry { centre_px: self.start.centre_px, stretch: [0.0; 2], ..*geometry };
        start.distortion.k2 = self.start.distortion.k2;
        start
    }

    /// Returns the rms distance of stars along an axis with the stretch of the air kept at 0, px.
    fn rms_without_air_px(&self, geometry: &Geometry, ties: &[Tie], freedom: Freedom) -> f64 {
        let without = clipped(&self.unextended(geometry), ties, Freedom { air: false, ..freedom });
        without.map_or(f64::NAN, |(plain, _)| rms_of(&plain.geometry, ties))
    }

    /// Returns the value of a pixel without light, DN: the black level and the dark current, which is drawn by itself.
    fn unlit_dn(&self, noise: &PixelNoise) -> f64 {
        let dark_e = self.params.detector.operating_dark_e_per_s() * self.camera.exposure.exposure_s;
        noise.black_dn + dark_e / noise.gain_e_per_dn
    }

    /// Finds the illumination by the background, or by the stars where they contradict it.
    fn lit(&self, plate: &Plate<'_>, geometry: &Geometry, field: &[FieldStar], spots: &[Option<Spot>]) -> Lit {
        let edge_tangent = self.params.geometry.half_diagonal_rad().tan();
        let pupil_mm = 0.5 * self.camera.optics.aperture_mm;
        let noise_dn = detect::noise_dn(plate.picture);
        let by_background = light_fit::vignetting(
            plate.picture,
            plate.background,
            self.unlit_dn(&plate.noise),
            pupil_mm,
            edge_tangent,
            noise_dn,
        );
        let of = |stops| Illumination { vignetting: Some(stops), cos4: true, unblocked: 1.0 };
        let illumination = by_background.map_or(self.params.illumination, of);
        let light = light(plate, geometry, field, spots, &illumination);
        let by_stars = light
            .as_ref()
            .and_then(|light| light_fit::vignetting_by_stars(light, &illumination, pupil_mm, edge_tangent));
        match by_stars {
            None => Lit { illumination, vignetting: by_background, light, is_by_stars: false },
            Some(stops) => {
                let illumination = of(stops);
                let light = self::light(plate, geometry, field, spots, &illumination);
                Lit { illumination, vignetting: Some(stops), light, is_by_stars: true }
            }
        }
    }
}

fn refused(path: &Path, what: &'static str, why: &str) -> Refused {
    Refused::at(path, format_args!("{what} cannot be fitted: {why}"))
}

/// Returns a star's spot where it is bright, whole and alone.
fn single<'s>(one: &FieldStar, spot: &'s Option<Spot>) -> Option<&'s Spot> {
    let is_good = |spot: &&Spot| spot.is_placed && !spot.is_saturated && spot.snr() > TIE_SNR && !one.is_blended;
    spot.as_ref().filter(is_good)
}

/// Returns the zero point by the stars that are bright, whole and alone.
fn light(
    plate: &Plate<'_>,
    geometry: &Geometry,
    field: &[FieldStar],
    spots: &[Option<Spot>],
    lit: &Illumination,
) -> Option<FittedLight> {
    let star = |(one, spot): (&FieldStar, &Option<Spot>)| {
        let spot = single(one, spot)?;
        let v = geometry.attitude.apply(one.star.direction);
        Some(LitStar {
            electrons: spot.flux_dn * plate.noise.gain_e_per_dn / lit.at(DVec2::new(v.x, v.y) / v.z),
            error_mag: 1.0857 / spot.snr(),
            mag_g: one.star.mag_g,
            bp_rp: colour(one),
            r2: plate.picture.half_diagonals(one.px).length_squared(),
        })
    };
    let stars: Vec<LitStar> = field.iter().zip(spots).filter_map(star).collect();
    light_fit::light(&stars)
}

/// Returns how the image's numbers follow the stars' light.
fn curve(plate: &Plate<'_>, field: &[FieldStar], spots: &[Option<Spot>]) -> Option<Response> {
    let star = |(one, spot): (&FieldStar, &Option<Spot>)| {
        let r2 = plate.picture.half_diagonals(one.px).length_squared();
        Some(Tone { spot: *single(one, spot)?, mag_g: one.star.mag_g, bp_rp: colour(one), r2 })
    };
    let stars: Vec<Tone> = field.iter().zip(spots).filter_map(star).collect();
    response(plate, &stars)
}

/// Returns a star's colour within the domain of colour terms.
fn colour(one: &FieldStar) -> f64 {
    one.star.bp_rp.clamp(-0.5, 5.0)
}
