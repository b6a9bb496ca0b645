//! Where the stars of a run come from: the built-in catalog, or layers on disk.

use crate::catalog::Catalog;
use crate::layer::{LayerError, LayerSet};
use crate::tiles::TileStar;
use std::path::PathBuf;
use std::sync::Arc;

/// The stars of a run; shared by all that look at them.
#[derive(Debug, Clone)]
pub struct Sky {
    /// They.
    pub layers: Arc<LayerSet>,
    /// At most so many of their stars are in memory for each head.
    pub most_stars: u64,
}

impl Sky {
    /// Returns the stars of `layers` not fainter than `limiting_mag` (Gaia G), with at most `memory_mb` MiB in memory
    /// at a time; without layers the built-in catalog, which is in memory whole.
    ///
    /// # Errors
    /// When a layer cannot be read or is damaged, or the layers do not make one sky.
    pub fn open(layers: &[PathBuf], limiting_mag: f32, memory_mb: u32) -> Result<Self, LayerError> {
        if layers.is_empty() {
            let built_in = Catalog::built_in().map_err(LayerError::Catalog)?;
            let layers = Arc::new(LayerSet::of_catalog(built_in, limiting_mag));
            return Ok(Self { layers, most_stars: u64::MAX });
        }
        let most_stars = u64::from(memory_mb) * (1 << 20) / size_of::<TileStar>() as u64;
        Ok(Self { layers: Arc::new(LayerSet::open(layers, limiting_mag)?), most_stars })
    }
}
