//! The chain of modulation transfer functions (MTF): contrast that each link from pupil to readout transmits.
//!
//! In: spatial frequency in cycles/px (1 / (2 px) is the Nyquist frequency) and the camera's optics and detector. Out:
//! a factor, 1 at frequency 0. All terms here are real: none shifts the image. Factors may be negative (reversed
//! contrast, as of a defocused lens), so they are real optical transfer functions; an MTF is their magnitude.
//!
//! In the order of light: [`diffraction`], [`aberration`], [`defocus`], Gaussian [`blur`] (assembly, fabrication),
//! [`diffusion`], [`blur`] by the pixel's aperture and by the circuit. [`motion`] is for comparison only: exposures
//! integrate motion themselves, and a PSF that included it would count it twice. [`chain`] multiplies them, over a
//! band.

pub mod aberration;
pub mod blur;
pub mod chain;
mod chain_params;
pub mod defocus;
pub mod diffraction;
pub mod diffusion;
pub mod motion;

pub use chain::{MtfChain, Term};
pub use chain_params::{ChainParams, Defocus, DefocusForm, MtfError, TdiBlur, WAVELENGTHS, Wavefront};
