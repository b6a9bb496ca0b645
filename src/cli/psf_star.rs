//! A camera's star: its PSF and the chain that makes it, for a colour and a place in the field.

use anyhow::{Context, Result, bail};
use config::{Camera, Chain, LightOfChain, Psf};
use plan::optics::chain_psf::{ChainPsf, Drawing};
use plan::optics::mtf::MtfChain;
use plan::optics::{Band, PsfGrid, PsfModel};
use run::wiring::camera_parts::camera_params;

/// Nyquist frequency, cycles/px.
pub(super) const NYQUIST: f64 = 0.5;
/// Samples per pixel of a blend of a field's PSFs.
const GRID_OVERSAMPLING: usize = 16;
/// Share of the light that may lie outside such a blend.
const GRID_OUTSIDE: f64 = 1e-4;

/// A camera's star and all that is known of it.
#[derive(Debug)]
pub(super) struct Star {
    pub(super) camera: Camera,
    pub(super) psf: PsfModel,
    /// The chain, and what drawing it errs by; for chains.
    pub(super) chain: Option<(MtfChain, ChainPsf)>,
}

impl Star {
    pub(super) fn new(mut camera: Camera, bp_rp: Option<f64>) -> Result<Self> {
        if let Some(bp_rp) = bp_rp {
            let band = camera.band.clone();
            match (&mut camera.psf, band) {
                (Psf::Chain(chain), Some(band)) => take_color(chain, &band, bp_rp)?,
                _ => bail!("--bp-rp is {bp_rp}, but \"{}\" has no chain over a [band]: leave it out", camera.name),
            }
        }
        let Psf::Chain(chain) = &camera.psf else {
            let psf = camera_params(&camera)?.psf;
            return Ok(Self { camera, psf, chain: None });
        };
        let chain = MtfChain::new(chain.params.clone())?;
        let drawn =
            ChainPsf::draw(&chain, &Drawing::default()).with_context(|| format!("camera \"{}\"", camera.name))?;
        Ok(Self { camera, psf: PsfModel::grid(drawn.grid.clone()), chain: Some((chain, drawn)) })
    }

    /// Takes the PSF of another place in the field.
    pub(super) fn move_to(&mut self, place: &[f64]) -> Result<()> {
        let detector = &self.camera.detector;
        let size = [detector.width_px, detector.height_px].map(f64::from);
        let &[x, y] = place else { bail!("--place has {} numbers; wanted two, such as 100,200", place.len()) };
        if !(-0.5..=size[0] - 0.5).contains(&x) || !(-0.5..=size[1] - 0.5).contains(&y) {
            bail!("--place is {x},{y}; wanted a place on the detector of {} x {} px", size[0], size[1]);
        }
        if self.psf.as_field().is_none() {
            bail!("--place is {x},{y}, but \"{}\" has one PSF for all places: leave it out", self.camera.name);
        }
        let half_px = self.psf.half_px(GRID_OUTSIDE).max(2);
        let blend = PsfGrid::sampled(GRID_OVERSAMPLING, half_px, |dx, dy| self.psf.pixel_of([x, y], dx, dy));
        self.psf = PsfModel::grid(blend.with_context(|| format!("the PSF at {x},{y}"))?);
        Ok(())
    }

    /// Returns whether x and y differ.
    pub(super) fn has_axes(&self) -> bool {
        self.chain.as_ref().is_some_and(|(chain, _)| chain.has_axes())
    }
}

fn take_color(chain: &mut Chain, band: &Band, bp_rp: f64) -> Result<()> {
    if !(-1.0..=7.0).contains(&bp_rp) {
        bail!("--bp-rp is {bp_rp}; wanted a colour from -1 to 7, such as the Sun's, 0.82");
    }
    chain.light = LightOfChain::Color(bp_rp);
    chain.params = chain.params.in_band(band, bp_rp);
    Ok(())
}
