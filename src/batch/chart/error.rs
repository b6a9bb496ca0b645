//! What can keep a chart from being made.

use image::gpu::GpuError;
use image::render::RenderError;
use sky::astrometry::AstrometryError;

/// Why there is no chart.
#[derive(Debug, thiserror::Error)]
pub enum ChartError {
    /// the GPU that was asked for is not there
    #[error("--backend gpu: {0}")]
    NoGpu(GpuError),
    /// a backend failed while it drew
    #[error("scene {scene}, {backend} backend: {source}")]
    Drawing {
        /// The scene.
        scene: String,
        /// The backend.
        backend: &'static str,
        /// What it said.
        source: RenderError,
    },
    /// a scene's camera was refused
    #[error("a scene's camera: {0}")]
    Camera(#[from] AstrometryError),
    /// an effect could not be measured
    #[error("effect \"{effect}\": {why}")]
    Effect {
        /// The effect.
        effect: &'static str,
        /// What was said.
        why: String,
    },
    /// rows do not go into CSV
    #[error("rows do not go into CSV: {0}")]
    Csv(#[from] csv::Error),
    /// no thread to measure on
    #[error("no thread to measure Poisson methods on: {0}")]
    Thread(String),
}
