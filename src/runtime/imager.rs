//! Backend and detector together: plan -> DN.

use crate::base::clock::Stopwatch;
use crate::base::image::DnImage;
use crate::base::time::Span;
use crate::detector::{Detector, DetectorParams};
use crate::exposure::ExposurePlan;
use crate::exposure::cost::CostModel;
use crate::gpu::Electrons;
use crate::render::cpu::Cpu;
use crate::render::reference::Reference;
use crate::render::{Backend, RenderError};

/// Which backend the user asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BackendChoice {
    /// A hardware GPU when there is one, else the CPU.
    #[default]
    Auto,
    /// The GPU (software Vulkan counts), or an error.
    Gpu,
    /// The CPU.
    Cpu,
    /// The f64 reference.
    Reference,
}

/// A backend and the detector behind it.
pub struct Imager {
    backend: Box<dyn Backend>,
    detector: Detector,
    cost: CostModel,
    note: Option<String>,
}

/// Wall time of the two halves of an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImagingTimes {
    /// Plan to electrons.
    pub render: Span,
    /// Electrons to DN.
    pub detector: Span,
}

impl Imager {
    /// For a detector of this size.
    ///
    /// # Errors
    /// When the GPU was asked for and there is none.
    pub fn new(
        choice: BackendChoice,
        params: DetectorParams,
        size_px: [usize; 2],
        seed: u64,
    ) -> Result<Self, RenderError> {
        let [width, height] = size_px;
        let detector = Detector::new(params, width, height, seed);
        let cpu = || -> Box<dyn Backend> { Box::new(Cpu::new(width, height)) };
        let (backend, cost, note): (Box<dyn Backend>, _, _) = match choice {
            BackendChoice::Cpu | BackendChoice::Auto => (cpu(), CostModel::CPU, None),
            BackendChoice::Reference => (Box::new(Reference::new(width, height)), CostModel::REFERENCE, None),
            BackendChoice::Gpu => return Err(RenderError::NoGpu("not built".into())),
        };
        Ok(Self { backend, detector, cost, note })
    }

    /// Name of the backend.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.backend.name()
    }

    /// Device behind it.
    #[must_use]
    pub fn description(&self) -> String {
        self.backend.description()
    }

    /// Why this backend and not another, in one line, when the choice was left to us.
    #[must_use]
    pub fn note(&self) -> Option<&str> {
        self.note.as_deref()
    }

    /// Cost constants of the backend.
    #[must_use]
    pub fn cost(&self) -> CostModel {
        self.cost
    }

    /// Draws the mean image only.
    ///
    /// # Errors
    /// When the device failed.
    pub fn render(&mut self, plan: &ExposurePlan) -> Result<Electrons<'_>, RenderError> {
        self.backend.render(plan)?;
        Ok(self.backend.electrons())
    }

    /// Draws and reads out frame `frame`.
    ///
    /// # Errors
    /// When the device failed.
    pub fn image(&mut self, plan: &ExposurePlan, frame: u32, out: &mut DnImage) -> Result<ImagingTimes, RenderError> {
        let mut watch = Stopwatch::start();
        self.backend.render(plan)?;
        let render = watch.lap();
        let exposure_s = plan.motion.los.exposure_s;
        match self.backend.electrons() {
            Electrons::Host(mean) => self.detector.collect(mean, frame, exposure_s, out),
            Electrons::Precise(mean) => self.detector.collect_precise(mean, frame, exposure_s, out),
        }
        Ok(ImagingTimes { render, detector: watch.lap() })
    }
}
