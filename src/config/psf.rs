//! `[psf]`; beyond Gaussian and Airy there are `halo` (`halo_sigma_px`, `halo_share`), `moffat` (`fwhm_px`, `beta`),
//! `measured` (a FITS image and how to take it), `field` (`nodes = [columns, rows]` and that many `[[psf.node]]`, row
//! by row from the top left, each a PSF of its own).
//!
//! A measured PSF's file is read with the camera; its path is relative to the camera file. A packed configuration does
//! not contain it: a replay reads it from its original place.

use crate::check::{Checker, Rule};
use crate::key::{Section, listed, section, taken};
use crate::key_type::{Raw, Shape, Whole, Word};
use crate::mtf::{Chain, MtfKeys};
use crate::optics::{LARGEST_OBSCURATION, Optics};
use crate::{detector::Detector, error::Result};
use base::refused::Refused;
use frames::sink::fits::FitsImage;
use plan::optics::measured::{Background, Holds, Measurement, StarAt};
use plan::optics::psf_field::{MOST_NODES, PsfField};
use plan::optics::{PsfGrid, PsfModel};
use plan::{exposure::PsfSampling, optics::moffat::Moffat};
use serde::Deserialize;

/// Default exponent of a Moffat profile: turbulence (Trujillo et al. 2001).
const DEFAULT_BETA: f64 = 4.765;
/// Default wavelength, nm: near the pivot of the Gaia G band (622 nm).
const DEFAULT_WAVELENGTH_NM: f64 = 620.0;
/// Default width of a Gaussian, px: centroids of 5 x 5 windows are near their best.
const DEFAULT_SIGMA_PX: f64 = 0.7;

/// Least standard deviation of the core of a Gaussian with a halo, px.
const LEAST_HALO_CORE_PX: f64 = 0.3;

/// A table of a PSF: keys of its own, and those of a Moffat profile or measured star.
macro_rules! psf_section {
    ($(#[doc = $about:literal])+ $keys:ident at $place:literal { $($own:tt)* } $({ $($tables:tt)* })?) => {
        section! {
            $(#[doc = $about])+
            $keys at $place {
                $($own)*
                /// Full width at half maximum of a Moffat profile in pixels, such as 2.0; before a pixel integrates it.
                fwhm_px: f64 = Optional, Within(0.7, 40.0);
                /// How fast wings of a Moffat profile fall: 2.5 for broad ones, 4.765 for turbulence.
                beta: f64 = DEFAULT_BETA, Within(1.2, 5.0);
                /// FITS image of a measured star, with several samples along each side of a pixel.
                file: String = Optional, "path";
                /// Fineness of the image.
                samples_per_px: Whole<usize> = Optional, 2..=32,
                    "samples of the image along each side of a detector pixel; fewer than 2 are too coarse to centre a \
                     star within a pixel";
                /// "light": each sample is the light on its own small cell; "pixels": on a whole pixel centred there.
                holds: Word<Holds> = "light", [("light", Holds::Light), ("pixels", Holds::Pixels)];
                /// Level to subtract from the samples: a level in their unit, or a word.
                background: Raw<LevelOrWord> = Computed("\"none\""),
                    Shape::either(Shape::Number(Finite), Shape::Words(vec!["none", "border"])),
                    "or a level in the samples' unit; \"border\" takes the mean of the outermost samples";
                /// Where the star is in the image: a word, or a sample.
                star_at: Raw<PlaceOrWord> = Computed("\"centroid\""),
                    Shape::either(Shape::numbers(2), Shape::Words(vec!["centroid", "middle"])),
                    "or [column, row] of the sample at the star's centre, counted from 0 at the top left";
                /// Share of the star's light that the image holds; 1 when nothing to speak of lies outside.
                light_inside: f64 = 1.0, Within(0.5, 1.0);
                $(tables: $($tables)*)?
            }
        }
    };
}

psf_section! {
    /// Point-spread function of the optics.
    PsfKeys at "psf" {
        /// The form of a star's image.
        model: Word<Model> = "gaussian", [
            ("gaussian", Model::Gaussian), ("airy", Model::Airy), ("moffat", Model::Moffat),
            ("measured", Model::Measured), ("field", Model::Field), ("chain", Model::Chain), ("halo", Model::Halo),
        ], "gaussian takes sigma_px; halo takes that, halo_sigma_px and halo_share; airy takes f_number, wavelength_nm, obscuration; moffat takes fwhm_px, beta; \
            measured takes file, samples_per_px; field takes nodes and [[psf.node]]; chain takes what airy does, bp_rp \
            and [mtf]";
        /// Standard deviation of a Gaussian in pixels, such as 0.7; a star must spread over a few pixels.
        sigma_px: f64 = DEFAULT_SIGMA_PX, Within(0.05, 20.0);
        /// Standard deviation of a Gaussian halo in pixels, wider than the core's.
        halo_sigma_px: f64 = 3.0, Within(0.3, 20.0);
        /// Share of the light in the halo: 10 % is 0.1.
        halo_share: f64 = 0.1, Within(0.0, 0.9);
        /// Focal length over aperture of an Airy pattern or chain; leave it out to take that of [optics].
        f_number: f64 = Computed("that of [optics]"), Within(0.3, 1000.0);
        /// Effective wavelength in nanometres, such as 620.
        wavelength_nm: f64 = DEFAULT_WAVELENGTH_NM, Within(100.0, 20_000.0);
        /// Central obscuration of an Airy pattern or chain, a ratio of diameters; left out, that of [optics].
        obscuration: f64 = Computed("that of [optics]"), Within(0.0, LARGEST_OBSCURATION);
        /// Colour BP-RP of the star that a chain is drawn for, such as the Sun's, 0.82.
        bp_rp: f64 = Optional, Within(-1.0, 7.0);
        /// How pixel values are computed from the PSF: auto, table:S, supersampled:N, point or bicubic.
        sampling: String = "auto", "text", "auto is exact, and right for most cameras";
        /// Nodes of a field along a row and a column, the outermost at the detector's edges; each is a [[psf.node]].
        nodes: Raw<[i64; 2]> = Optional, Shape::Row(2, Box::new(Shape::Whole(2..=MOST_NODES as i64)));
    } {
        /// The PSF at a node of a field, row by row from the top left.
        node: Vec<NodeKeys>;
    }
}

psf_section! {
    /// The PSF at a node of a field.
    NodeKeys at "psf.node" {
        /// The form of a star's image.
        model: Word<NodeModel> = "gaussian", [
            ("gaussian", NodeModel::Gaussian), ("moffat", NodeModel::Moffat), ("measured", NodeModel::Measured),
        ], "gaussian takes sigma_px; moffat takes fwhm_px, beta; measured takes file, samples_per_px";
        /// Standard deviation of a Gaussian in pixels, such as 0.7; a star must spread over a few pixels.
        sigma_px: f64 = DEFAULT_SIGMA_PX, Within(0.05, 12.0);
    }
}

/// The form of a star's image.
#[derive(Debug, Clone, Copy)]
pub(super) enum Model {
    Gaussian,
    Airy,
    Chain,
    Moffat,
    Measured,
    Field,
    Halo,
}

/// `background`: a level, or `"none"`, `"border"`.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
pub(super) enum LevelOrWord {
    Level(f64),
    Word(String),
}

/// `star_at`: a sample, or `"centroid"`, `"middle"`.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
pub(super) enum PlaceOrWord {
    Sample([f64; 2]),
    Word(String),
}

/// Models allowed at a node.
#[derive(Debug, Clone, Copy)]
pub(super) enum NodeModel {
    Gaussian,
    Moffat,
    Measured,
}

/// Point-spread function of the optics, checked.
#[derive(Debug, Clone, PartialEq)]
pub enum Psf {
    /// A round Gaussian.
    Gaussian {
        /// Standard deviation on one axis, px.
        sigma_px: f64,
    },
    /// Diffraction by a circular aperture.
    Airy {
        /// Focal length over aperture.
        f_number: f64,
        /// Wavelength, nm.
        wavelength_nm: f64,
        /// Linear central obscuration.
        obscuration: f64,
    },
    /// A chain of transfer functions.
    Chain(Box<Chain>),
    /// A Moffat profile, a measured PSF, or a field of PSFs, as it is drawn.
    Made(PsfModel),
}

impl Psf {
    pub(super) fn check(
        keys: &PsfKeys,
        mtf: Option<&MtfKeys>,
        detector: &Detector,
        optics: &Optics,
        check: &mut Checker<'_>,
    ) -> Result<Self> {
        let model = keys.model().check(check)?;
        let is_chain = matches!(model, Model::Chain);
        if !is_chain {
            keys.refuse(&["bp_rp"], "model = \"chain\"", check)?;
        }
        if !matches!(model, Model::Airy | Model::Chain) {
            keys.refuse(&["f_number", "wavelength_nm", "obscuration"], "model = \"airy\"", check)?;
        }
        if !matches!(model, Model::Gaussian | Model::Halo) {
            keys.refuse(&["sigma_px"], "model = \"gaussian\"", check)?;
        }
        if !matches!(model, Model::Halo) {
            keys.refuse(&["halo_sigma_px", "halo_share"], "model = \"halo\"", check)?;
        }
        if !matches!(model, Model::Field) {
            keys.refuse(&["nodes"], "model = \"field\"", check)?;
            check.unused("psf.node", !keys.node.is_empty(), "model = \"field\"")?;
        }
        let own = keys.of_node();
        if !matches!(model, Model::Moffat | Model::Measured) {
            own.unused_by("", check)?;
        }
        match model {
            Model::Moffat => Ok(Self::Made(own.moffat(check)?)),
            Model::Measured => Ok(Self::Made(own.measured(check)?)),
            Model::Field => Ok(Self::Made(field(keys, [detector.width_px, detector.height_px], check)?)),
            Model::Halo => {
                // A table is made of it, which takes a core of 0.3 px or more.
                let sigma_px = keys.sigma_px().within(Rule::Within(LEAST_HALO_CORE_PX, 20.0)).check(check)?;
                let halo_sigma_px = keys.halo_sigma_px().within(Rule::Within(sigma_px, 20.0)).check(check)?;
                Ok(Self::Made(PsfModel::halo(sigma_px, halo_sigma_px, keys.halo_share().check(check)?)))
            }
            Model::Gaussian => Ok(Self::Gaussian { sigma_px: keys.sigma_px().check(check)? }),
            Model::Chain => Ok(Self::Chain(Box::new(Chain::check(keys, mtf, optics, detector, check)?))),
            Model::Airy => Ok(Self::Airy {
                f_number: keys.f_number().or(optics.f_number()).check(check)?,
                wavelength_nm: keys.wavelength_nm().check(check)?,
                obscuration: keys.obscuration().or(optics.obscuration).check(check)?,
            }),
        }
    }

    /// Returns how pixel values are computed from the PSF.
    pub(super) fn check_sampling(keys: &PsfKeys, check: &mut Checker<'_>) -> Result<PsfSampling> {
        let word = keys.sampling().check(check)?;
        let refuse = |wanted: &str| keys.sampling().invalid(format!("\"{word}\""), wanted, check);
        let sampling: PsfSampling =
            word.parse().map_err(|_| refuse("auto, table:S, supersampled:N, point or bicubic"))?;
        let tabled =
            keys.model().raw().is_some_and(|model| ["moffat", "measured", "field", "halo"].contains(&model.as_str()));
        if tabled && !sampling.is_exact() {
            return Err(refuse("auto or table:S for this model (the others take points of a Gaussian)"));
        }
        Ok(sampling)
    }
}

impl PsfKeys {
    /// Returns the keys of a PSF that are also allowed at a node.
    pub(super) fn of_node(&self) -> NodeKeys {
        NodeKeys {
            placed_at: Some("psf".into()),
            model: self.model().raw().cloned(),
            sigma_px: self.sigma_px().raw().copied(),
            fwhm_px: self.fwhm_px().raw().copied(),
            beta: self.beta().raw().copied(),
            file: self.file().raw().cloned(),
            samples_per_px: self.samples_per_px().raw().copied(),
            holds: self.holds().raw().cloned(),
            background: self.background().raw().cloned(),
            star_at: self.star_at().raw().cloned(),
            light_inside: self.light_inside().raw().copied(),
        }
    }
}

impl NodeKeys {
    /// Refuses keys that the model does not take.
    pub(super) fn unused_by(&self, model: &str, check: &Checker<'_>) -> Result<()> {
        let of_measured = ["file", "samples_per_px", "holds", "background", "star_at", "light_inside"];
        for (owner, keys) in [("moffat", &["fwhm_px", "beta"][..]), ("measured", &of_measured)] {
            if owner != model {
                self.refuse(keys, &format!("model = \"{owner}\""), check)?;
            }
        }
        Ok(())
    }

    /// Returns a Moffat profile.
    pub(super) fn moffat(&self, check: &mut Checker<'_>) -> Result<PsfModel> {
        self.unused_by("moffat", check)?;
        let (fwhm_px, beta) = (self.fwhm_px().check(check)?, self.beta().check(check)?);
        Ok(PsfModel::Moffat(Moffat::of_fwhm(fwhm_px, beta)))
    }

    /// Returns the image of a star.
    pub(super) fn measured(&self, check: &mut Checker<'_>) -> Result<PsfModel> {
        self.unused_by("measured", check)?;
        let how = self.measurement(check)?;
        let file = self.file();
        let path = file.raw().ok_or_else(|| file.missing("a path", check))?;
        let bytes = check.document.bytes_of(&file.key(), path)?;
        let refuse = |why: String| file.invalid(format!("\"{path}\": {why}"), "an image of a star", check);
        let image = FitsImage::read(bytes.as_slice()).map_err(|error| refuse(error.to_string()))?;
        let grid = grid_of(&image, &how).map_err(|error| refuse(error.to_string()))?;
        Ok(PsfModel::grid(grid))
    }

    fn measurement(&self, check: &mut Checker<'_>) -> Result<Measurement> {
        taken!(check, self => samples_per_px, holds);
        let words = [("none", Background::None), ("border", Background::Border)];
        let given = self.background();
        let background = match given.raw() {
            Some(LevelOrWord::Level(level)) if level.is_finite() => Background::Level(*level),
            Some(LevelOrWord::Level(level)) => return Err(given.invalid(level, "a finite level", check)),
            Some(LevelOrWord::Word(word)) => check.choice(&given.key(), Some(word), &words, &given.advice)?,
            None => check.choice(&given.key(), None, &words, &given.advice)?,
        };
        let words = [("centroid", StarAt::Centroid), ("middle", StarAt::Middle)];
        let given = self.star_at();
        let star_at = match given.raw() {
            Some(PlaceOrWord::Sample(at)) => StarAt::Sample(*at),
            Some(PlaceOrWord::Word(word)) => check.choice(&given.key(), Some(word), &words, &given.advice)?,
            None => check.choice(&given.key(), None, &words, &given.advice)?,
        };
        let light_inside = self.light_inside().check(check)?;
        Ok(Measurement { samples_per_px, holds, background, star_at, light_inside })
    }

    /// Returns the PSF of one node.
    fn node(&self, check: &mut Checker<'_>) -> Result<PsfModel> {
        let model = self.model().check(check)?;
        if !matches!(model, NodeModel::Gaussian) {
            self.refuse(&["sigma_px"], "model = \"gaussian\"", check)?;
        }
        match model {
            NodeModel::Gaussian => {
                self.unused_by("gaussian", check)?;
                Ok(PsfModel::gaussian(self.sigma_px().check(check)?))
            }
            NodeModel::Moffat => self.moffat(check),
            NodeModel::Measured => self.measured(check),
        }
    }
}

/// Reads `nodes` and `[[psf.node]]` over a detector of `size_px`.
pub(super) fn field(keys: &PsfKeys, size_px: [u32; 2], check: &mut Checker<'_>) -> Result<PsfModel> {
    let nodes = keys.nodes();
    let wanted = format!("two whole numbers from 2 to {MOST_NODES}");
    let given = nodes.raw().ok_or_else(|| nodes.missing(&wanted, check))?;
    let most = MOST_NODES as i64;
    if !given.iter().all(|n| (2..=most).contains(n)) {
        return Err(nodes.invalid(format!("{given:?}"), &wanted, check));
    }
    let counts = given.map(|n| usize::try_from(n).unwrap_or(2));
    let count = counts[0] * counts[1];
    if keys.node.len() != count {
        let wanted = format!("{count}, row by row from the top left");
        return Err(check.invalid("psf.node", format!("given {} times", keys.node.len()), wanted, &nodes.advice));
    }
    let psfs: Result<Vec<PsfModel>> = listed(&keys.node, "psf.node").iter().map(|keys| keys.node(check)).collect();
    let field = PsfField::new(counts, size_px.map(|n| n as usize), psfs?);
    let field = field.map_err(|error| check.invalid("psf.node", error.to_string(), "a field", &nodes.advice));
    Ok(PsfModel::field(field?))
}

/// Returns the PSF of a FITS image.
fn grid_of(image: &FitsImage, how: &Measurement) -> Result<PsfGrid, Refused> {
    how.psf(&image.top_row_first(), image.width)
}
