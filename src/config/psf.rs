//! `[psf]` beyond Gaussian and Airy: `moffat` (`fwhm_px`, `beta`), `measured` (a FITS image and how to take it), `field`
//! (`nodes = [columns, rows]` and that many `[[psf.node]]`, row by row from the top left, each a PSF of its own).
//!
//! A measured PSF's file is read when the camera is; its path is relative to the camera file. It is no part of a packed
//! configuration: a replay reads it where it was.

use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use frames::sink::fits::FitsImage;
use plan::optics::measured::{Background, Holds, MeasuredError, Measurement, StarAt};
use plan::optics::psf_field::{MOST_NODES, PsfField};
use plan::optics::{PsfGrid, PsfModel};
use serde::Deserialize;

/// Default exponent of a Moffat profile: turbulence (Trujillo et al. 2001).
const DEFAULT_BETA: f64 = 4.765;
/// Default width of a Gaussian at a node, as for a whole camera, px.
const DEFAULT_SIGMA_PX: f64 = 0.7;

/// Keys of the models of this file.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NodeKeys {
    pub(super) model: Option<String>,
    pub(super) sigma_px: Option<f64>,
    pub(super) fwhm_px: Option<f64>,
    pub(super) beta: Option<f64>,
    pub(super) file: Option<String>,
    pub(super) samples_per_px: Option<i64>,
    pub(super) holds: Option<String>,
    pub(super) background: Option<LevelOrWord>,
    pub(super) star_at: Option<PlaceOrWord>,
    pub(super) light_inside: Option<f64>,
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

/// What a node may be.
#[derive(Clone, Copy)]
enum NodeModel {
    Gaussian,
    Moffat,
    Measured,
}

impl NodeKeys {
    /// Refuses keys that the model does not take; `table` is theirs.
    pub(super) fn unused_by(&self, model: &str, table: &str, check: &Checker<'_>) -> Result<(), ConfigError> {
        for (key, is_given, owner) in [
            ("fwhm_px", self.fwhm_px.is_some(), "moffat"),
            ("beta", self.beta.is_some(), "moffat"),
            ("file", self.file.is_some(), "measured"),
            ("samples_per_px", self.samples_per_px.is_some(), "measured"),
            ("holds", self.holds.is_some(), "measured"),
            ("background", self.background.is_some(), "measured"),
            ("star_at", self.star_at.is_some(), "measured"),
            ("light_inside", self.light_inside.is_some(), "measured"),
        ] {
            check.unused(&format!("{table}.{key}"), is_given && owner != model, &format!("model = \"{owner}\""))?;
        }
        Ok(())
    }

    /// A Moffat profile.
    pub(super) fn moffat(&self, table: &str, check: &mut Checker<'_>) -> Result<PsfModel, ConfigError> {
        self.unused_by("moffat", table, check)?;
        let advice = "full width at half maximum in pixels, such as 2.0; of the optics, before a pixel integrates it";
        let fwhm_px = check.required(&format!("{table}.fwhm_px"), self.fwhm_px, Rule::Within(0.7, 40.0), advice)?;
        let advice =
            "how fast the wings fall: 2.5 for broad ones, 4.765 for turbulence; gaussian is a model of its own";
        let key = format!("{table}.beta");
        let beta = check.number(&key, self.beta, DEFAULT_BETA, Rule::Within(1.2, 5.0), advice)?;
        let alpha_px = 0.5 * fwhm_px / (2.0_f64.powf(1.0 / beta) - 1.0).sqrt();
        Ok(PsfModel::moffat(alpha_px, beta))
    }

    /// The image of a star.
    pub(super) fn measured(&self, table: &str, check: &mut Checker<'_>) -> Result<PsfModel, ConfigError> {
        self.unused_by("measured", table, check)?;
        let key = |name: &str| format!("{table}.{name}");
        let how = self.measurement(table, check)?;
        let advice = "a FITS image of a star, with several samples along each side of a pixel";
        let path = self.file.as_deref().ok_or_else(|| check.invalid(&key("file"), "missing", "a path", advice))?;
        let bytes = check.document.bytes_of(&key("file"), path)?;
        let refuse =
            |why: String| check.invalid(&key("file"), format!("\"{path}\": {why}"), "an image of a star", advice);
        let image = FitsImage::read(bytes.as_slice()).map_err(|error| refuse(error.to_string()))?;
        let grid = grid_of(&image, &how).map_err(|error| refuse(error.to_string()))?;
        Ok(PsfModel::grid(grid))
    }

    fn measurement(&self, table: &str, check: &mut Checker<'_>) -> Result<Measurement, ConfigError> {
        let key = |name: &str| format!("{table}.{name}");
        let advice = "samples of the image along each side of a detector pixel; fewer than 2 do not tell where in a pixel a star is";
        let samples_per_px = check.whole(&key("samples_per_px"), self.samples_per_px, None, 2..=32, advice)? as usize;
        let words = [("light", Holds::Light), ("pixels", Holds::Pixels)];
        let advice =
            "\"light\": each sample is the light on its own small cell; \"pixels\": on a whole pixel centred there";
        let holds = check.choice(&key("holds"), self.holds.as_deref(), &words, advice)?;
        let words = [("none", Background::None), ("border", Background::Border)];
        let advice = "or a level in the samples' unit; \"border\" takes the mean of the outermost samples";
        let background = match &self.background {
            Some(LevelOrWord::Level(level)) if level.is_finite() => Background::Level(*level),
            Some(LevelOrWord::Level(level)) => {
                return Err(check.invalid(&key("background"), level, "a finite level", advice));
            }
            Some(LevelOrWord::Word(word)) => check.choice(&key("background"), Some(word), &words, advice)?,
            None => check.choice(&key("background"), None, &words, advice)?,
        };
        let words = [("centroid", StarAt::Centroid), ("middle", StarAt::Middle)];
        let advice = "or [column, row] of the sample the star stands at, counted from 0 at the top left";
        let star_at = match &self.star_at {
            Some(PlaceOrWord::Sample(at)) => StarAt::Sample(*at),
            Some(PlaceOrWord::Word(word)) => check.choice(&key("star_at"), Some(word), &words, advice)?,
            None => check.choice(&key("star_at"), None, &words, advice)?,
        };
        let advice = "share of the star's light that the image holds; 1 when nothing to speak of lies outside";
        let light_inside =
            check.number(&key("light_inside"), self.light_inside, 1.0, Rule::Within(0.5, 1.0), advice)?;
        Ok(Measurement { samples_per_px, holds, background, star_at, light_inside })
    }

    /// The PSF of one node.
    fn node(&self, table: &str, check: &mut Checker<'_>) -> Result<PsfModel, ConfigError> {
        let models =
            [("gaussian", NodeModel::Gaussian), ("moffat", NodeModel::Moffat), ("measured", NodeModel::Measured)];
        let advice = "gaussian takes sigma_px; moffat takes fwhm_px, beta; measured takes file, samples_per_px";
        let model = check.choice(&format!("{table}.model"), self.model.as_deref(), &models, advice)?;
        let sigma = format!("{table}.sigma_px");
        if let NodeModel::Gaussian = model {
            self.unused_by("gaussian", table, check)?;
            let advice = "standard deviation in pixels, such as 0.7";
            let sigma_px = check.number(&sigma, self.sigma_px, DEFAULT_SIGMA_PX, Rule::Within(0.05, 12.0), advice)?;
            return Ok(PsfModel::gaussian(sigma_px));
        }
        check.unused(&sigma, self.sigma_px.is_some(), "model = \"gaussian\"")?;
        if let NodeModel::Moffat = model { self.moffat(table, check) } else { self.measured(table, check) }
    }
}

/// `nodes` and `[[psf.node]]` over a detector of `size_px`.
pub(super) fn field(
    nodes: Option<[i64; 2]>,
    keys: &[NodeKeys],
    size_px: [u32; 2],
    check: &mut Checker<'_>,
) -> Result<PsfModel, ConfigError> {
    let advice = "nodes along a row and a column, the outermost at the detector's edges, and a [[psf.node]] for each";
    let wanted = format!("two whole numbers from 2 to {MOST_NODES}");
    let given = nodes.ok_or_else(|| check.invalid("psf.nodes", "missing", &wanted, advice))?;
    let most = MOST_NODES as i64;
    if !given.iter().all(|n| (2..=most).contains(n)) {
        return Err(check.invalid("psf.nodes", format!("{given:?}"), &wanted, advice));
    }
    let nodes = given.map(|n| usize::try_from(n).unwrap_or(2));
    let count = nodes[0] * nodes[1];
    if keys.len() != count {
        let wanted = format!("{count}, row by row from the top left");
        return Err(check.invalid("psf.node", format!("given {} times", keys.len()), wanted, advice));
    }
    let psfs: Result<Vec<PsfModel>, ConfigError> =
        keys.iter().enumerate().map(|(i, keys)| keys.node(&format!("psf.node[{i}]"), check)).collect();
    let field = PsfField::new(nodes, size_px.map(|n| n as usize), psfs?);
    Ok(PsfModel::field(field.map_err(|error| check.invalid("psf.node", error.to_string(), "a field", advice))?))
}

/// The PSF of a FITS image.
fn grid_of(image: &FitsImage, how: &Measurement) -> Result<PsfGrid, MeasuredError> {
    how.psf(&image.top_row_first(), image.width)
}
