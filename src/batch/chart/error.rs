//! Errors of making a chart.

use image::{gpu::GpuError, render::RenderError};
use sky::astrometry::AstrometryError;

/// Reason why a chart cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ChartError {
    /// the requested GPU is not available
    #[error("--backend gpu: {0}")]
    NoGpu(GpuError),
    /// a backend failed while it drew
    #[error("scene {scene}, {backend} backend: {source}")]
    Drawing {
        /// The scene.
        scene: String,
        /// The backend.
        backend: &'static str,
        /// Error of the backend.
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
        /// Cause.
        why: String,
    },
    /// rows do not go into CSV
    #[error("rows do not go into CSV: {0}")]
    Csv(#[from] csv::Error),
    /// no thread for the measurement
    #[error("no thread to measure Poisson methods on: {0}")]
    Thread(String),
}
