//! The backends under test, and the reference: draw a plan and wait for the image in f64.

use crate::chart::Backends;
use base::{image::Image, refused::Refused};
use image::gpu::{AdapterChoice, Electrons, GpuDevice};
use image::render::Backend;
use image::render::{cpu::Cpu, gpu::Gpu, reference::Reference};
use plan::exposure::{ExposurePlan, cost::CostModel};
use std::sync::Arc;

/// A square image in f64.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Columns.
    pub width: usize,
    /// Row by row.
    pub pixels: Vec<f64>,
}

/// A backend that is rebuilt for the size of the scene.
#[derive(Debug)]
pub enum Drawer {
    /// The CPU.
    Cpu {
        /// Side of the latest scene, px.
        size_px: usize,
        /// The backend.
        backend: Box<Cpu>,
    },
    /// A GPU.
    Gpu {
        /// The device.
        device: Arc<GpuDevice>,
        /// Side of the latest scene, px.
        size_px: usize,
        /// The backend.
        backend: Option<Box<Gpu>>,
    },
}

impl Drawer {
    /// Returns the requested backends, and a line about one that is missing.
    ///
    /// # Errors
    /// When a GPU was requested by name and is not available.
    pub fn open(backends: Backends) -> Result<(Vec<Self>, Option<String>), Refused> {
        let mut drawers = Vec::new();
        if backends != Backends::Gpu {
            drawers.push(Self::Cpu { size_px: 0, backend: Box::new(Cpu::new(0, 0)) });
        }
        if backends == Backends::Cpu {
            return Ok((drawers, None));
        }
        match GpuDevice::open(&AdapterChoice::Best) {
            Ok(device) => drawers.push(Self::Gpu { device, size_px: 0, backend: None }),
            Err(error) if backends == Backends::Gpu => return Err(Refused(format!("--backend gpu: {error}"))),
            Err(error) => return Ok((drawers, Some(format!("no GPU: {error}")))),
        }
        Ok((drawers, None))
    }

    /// Returns the name used in commands.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Cpu { .. } => "cpu",
            Self::Gpu { .. } => "gpu",
        }
    }

    /// Returns true for a GPU that is emulated in software.
    pub fn is_software_gpu(&self) -> bool {
        matches!(self, Self::Gpu { device, .. } if device.is_software())
    }

    /// Returns a description of its device.
    pub fn description(&self) -> String {
        match self {
            Self::Cpu { backend, .. } => format!("cpu: {}", backend.description()),
            Self::Gpu { device, .. } => format!("gpu: {}", device.description()),
        }
    }

    /// Returns the cost constants.
    pub fn cost(&self) -> CostModel {
        match self {
            Self::Cpu { .. } => CostModel::CPU,
            Self::Gpu { device, .. } if device.is_software() => CostModel::SOFTWARE_GPU,
            Self::Gpu { .. } => CostModel::GPU,
        }
    }

    /// Draws, and waits until the image is complete; it stays on its device.
    ///
    /// # Errors
    /// When the backend refuses the plan or fails.
    pub fn draw(&mut self, plan: &ExposurePlan) -> Result<(), Refused> {
        let wanted_px = plan.camera.width_px();
        match self {
            Self::Cpu { size_px, backend } => {
                if *size_px != wanted_px {
                    (*size_px, **backend) = (wanted_px, Cpu::new(wanted_px, plan.camera.height_px()));
                }
                backend.render(plan)
            }
            Self::Gpu { device, size_px, backend } => {
                if *size_px != wanted_px {
                    *backend = None;
                    *size_px = wanted_px;
                }
                let gpu = match backend {
                    Some(gpu) => gpu,
                    none => none.insert(Box::new(Gpu::new(Arc::clone(device), wanted_px, plan.camera.height_px())?)),
                };
                gpu.render(plan)?;
                Ok(device.wait()?)
            }
        }
    }

    /// Draws, and returns the image in main memory.
    ///
    /// # Errors
    /// When the backend refuses the plan or fails.
    pub fn picture(&mut self, plan: &ExposurePlan) -> Result<Picture, Refused> {
        self.draw(plan)?;
        match self {
            Self::Cpu { backend, .. } => Ok(in_memory(&backend.electrons())),
            Self::Gpu { backend, .. } => {
                let mut image = Image::new(plan.camera.width_px(), plan.camera.height_px());
                if let Some(gpu) = backend {
                    gpu.read_electrons(&mut image)?;
                }
                Ok(in_memory(&Electrons::Host(&image)))
            }
        }
    }
}

/// Returns the reference's image of `plan`'s motion and stars.
///
/// # Errors
/// When the reference refuses the plan.
pub fn truth(plan: &ExposurePlan) -> Result<Picture, Refused> {
    let mut reference = Reference::new(plan.camera.width_px(), plan.camera.height_px());
    reference.render(plan)?;
    Ok(in_memory(&reference.electrons()))
}

fn in_memory(electrons: &Electrons<'_>) -> Picture {
    match electrons {
        Electrons::Host(image) => {
            Picture { width: image.width(), pixels: image.pixels().iter().map(|e| f64::from(*e)).collect() }
        }
        Electrons::Precise(image) => Picture { width: image.width(), pixels: image.pixels().to_vec() },
        Electrons::Device(_) => Picture { width: 0, pixels: Vec::new() },
    }
}
