//! Where the stars of a run come from: the built-in catalog, or layers on disk.

use crate::catalog::{Catalog, CatalogError};
use crate::layer::LayerSet;
use crate::tiles::TileStar;
use std::path::PathBuf;
use std::sync::Arc;

/// The stars of a run; shared by all that look at them.
#[derive(Debug, Clone)]
pub enum Sky {
    /// A catalog in memory.
    Catalog(Arc<Catalog>),
    /// Layers, of which tiles are in memory.
    Layers {
        /// They.
        layers: Arc<LayerSet>,
        /// At most so many of their stars are in memory for each head.
        most_stars: u64,
    },
}

impl Sky {
    /// The stars of `layers` not fainter than `limiting_mag` (Gaia G), of which `memory_mb` MiB are in memory at a time;
    /// without layers the built-in catalog.
    ///
    /// # Errors
    /// When a layer cannot be read or is damaged, or the layers are no one sky.
    pub fn open(layers: &[PathBuf], limiting_mag: f32, memory_mb: u32) -> Result<Self, CatalogError> {
        if layers.is_empty() {
            return Ok(Self::Catalog(Arc::new(Catalog::built_in()?)));
        }
        let most_stars = u64::from(memory_mb) * (1 << 20) / size_of::<TileStar>() as u64;
        Ok(Self::Layers { layers: Arc::new(LayerSet::open(layers, limiting_mag)?), most_stars })
    }

    /// Julian year to which the positions refer.
    #[must_use]
    pub fn epoch_yr(&self) -> f64 {
        match self {
            Self::Catalog(catalog) => catalog.epoch_yr(),
            Self::Layers { layers, .. } => layers.epoch_yr(),
        }
    }

    /// No star is faster, mas/yr.
    #[must_use]
    pub fn fastest_mas_yr(&self) -> f64 {
        match self {
            Self::Catalog(catalog) => catalog.fastest_mas_yr(),
            Self::Layers { layers, .. } => layers.fastest_mas_yr(),
        }
    }

    /// There are no stars fainter than this, Gaia G.
    #[must_use]
    pub fn faintest_mag(&self) -> f32 {
        match self {
            Self::Catalog(catalog) => catalog.sources().iter().map(|star| star.mag_g).fold(f32::MIN, f32::max),
            Self::Layers { layers, .. } => layers.below_mag(),
        }
    }
}
