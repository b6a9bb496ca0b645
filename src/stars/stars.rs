//! Where the stars of a run come from: the built-in catalog, or layers on disk.

use crate::{catalog::Catalog, layer::LayerSet, tiles::TileStar};
use base::refused::Refused;
use std::{path::PathBuf, sync::Arc};

/// The stars of a run; shared by all that look at them.
#[derive(Debug, Clone)]
pub struct Sky {
    /// They.
    pub layers: Arc<LayerSet>,
    /// At most so many of their stars are in memory for each head.
    pub most_stars: u64,
}

/// Fields of a camera, and the memory for their stars.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldMemory {
    /// Half the diagonal of a field, rad.
    pub radius_rad: f64,
    /// Memory for stars of layers, MiB.
    pub memory_mb: u32,
}

impl Sky {
    /// Returns the faintest magnitude, `limiting_mag` at most, that `layers` (without any: the built-in catalog) reach
    /// with the stars of every field in half of the memory; the other half is for fields that may come.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn faintest(layers: &[PathBuf], limiting_mag: f32, fields: FieldMemory) -> Result<f32, Refused> {
        let sky = Self::open(layers, limiting_mag, fields.memory_mb)?;
        Ok(limiting_mag.min(sky.layers.faintest_of_fields(fields.radius_rad, sky.most_stars / 2)))
    }

    /// Returns the stars of `layers` not fainter than `limiting_mag` (Gaia G), with at most `memory_mb` MiB in memory
    /// at a time; without layers the built-in catalog, which is in memory whole.
    ///
    /// # Errors
    /// When a layer cannot be read or is damaged, or the layers do not make one sky.
    pub fn open(layers: &[PathBuf], limiting_mag: f32, memory_mb: u32) -> Result<Self, Refused> {
        if layers.is_empty() {
            let built_in = Catalog::built_in().map_err(Refused::of)?;
            let layers = Arc::new(LayerSet::of_catalog(built_in, limiting_mag));
            return Ok(Self { layers, most_stars: u64::MAX });
        }
        let most_stars = u64::from(memory_mb) * (1 << 20) / size_of::<TileStar>() as u64;
        Ok(Self { layers: Arc::new(LayerSet::open(layers, limiting_mag)?), most_stars })
    }
}
