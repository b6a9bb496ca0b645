//! Backend and detector together: plan -> DN.

use crate::base::clock::Stopwatch;
use crate::base::image::{DnImage, Image};
use crate::base::time::Span;
use crate::detector::defects::Defects;
use crate::detector::gpu::GpuDetector;
use crate::detector::protons::{ProtonFlux, ProtonFluxError, ProtonTrack};
use crate::detector::{Detector, DetectorParams, PoissonMethod};
use crate::exposure::ExposurePlan;
use crate::exposure::cost::CostModel;
use crate::gpu::{AdapterChoice, Electrons, GpuDevice};
use crate::render::cpu::Cpu;
use crate::render::gpu::Gpu;
use crate::render::reference::Reference;
use crate::render::{Backend, RenderError};
use crate::report::{Stage, StageTimes};
use std::sync::Arc;

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
    drawing: Drawing,
    cost: CostModel,
    note: Option<String>,
}

/// Where images are drawn and read out.
enum Drawing {
    /// In memory, by the CPU or reference backend.
    Host { backend: Box<dyn Backend>, detector: Box<Detector> },
    /// On a GPU; `mean` is for those who ask for the mean image.
    Device { backend: Box<Gpu>, detector: Box<GpuDetector>, mean: Image<f32> },
}

/// Wall time of the two halves of an image. On a GPU drawing is only submitted in the first; the second waits for both.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImagingTimes {
    /// Plan to electrons.
    pub render: Span,
    /// Electrons to DN.
    pub detector: Span,
    /// The same time otherwise divided; `None` where memory is shared.
    pub device: Option<DeviceTimes>,
}

/// Wall time of an image that was made on a device, which draws and reads out in one go.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceTimes {
    /// Writing buffers, recording and submitting.
    pub upload: Span,
    /// Waiting for the device.
    pub wait: Span,
    /// Copying DN to memory.
    pub readback: Span,
}

impl ImagingTimes {
    /// By stage: what did not run is absent.
    #[must_use]
    pub fn by_stage(&self) -> StageTimes {
        let mut times = StageTimes::default();
        match self.device {
            None => {
                times.set(Stage::Render, self.render);
                times.set(Stage::Detector, self.detector);
            }
            Some(device) => {
                times.set(Stage::Upload, device.upload);
                times.set(Stage::Render, device.wait);
                times.set(Stage::Readback, device.readback);
            }
        }
        times
    }
}

impl Imager {
    /// For a detector of this size.
    ///
    /// # Errors
    /// When the GPU was asked for and there is none, or it cannot draw by the detector's Poisson method.
    pub fn new(
        choice: BackendChoice,
        params: DetectorParams,
        size_px: [usize; 2],
        seed: u64,
    ) -> Result<Self, RenderError> {
        let [width, height] = size_px;
        Self::of_detector(choice, Detector::new(params, width, height, seed))
    }

    /// For a detector with patterns that were measured or drawn.
    ///
    /// # Errors
    /// When the GPU was asked for and there is none, or it cannot draw by the detector's Poisson method.
    pub fn of_detector(choice: BackendChoice, detector: Detector) -> Result<Self, RenderError> {
        let (params, size_px) = (*detector.params(), detector.size_px());
        let [width, height] = size_px;
        match choice {
            BackendChoice::Cpu => Ok(Self::on_host(Box::new(Cpu::new(width, height)), detector, CostModel::CPU, None)),
            BackendChoice::Reference => {
                let backend = Box::new(Reference::new(width, height));
                Ok(Self::on_host(backend, detector, CostModel::REFERENCE, None))
            }
            BackendChoice::Gpu => Self::on_device(GpuDevice::open(&AdapterChoice::Best)?, &detector, size_px),
            BackendChoice::Auto if params.poisson != PoissonMethod::Auto => {
                let note = format!("only the CPU draws shot noise by \"{}\": using the CPU backend", params.poisson);
                Ok(Self::on_host(Box::new(Cpu::new(width, height)), detector, CostModel::CPU, Some(note)))
            }
            BackendChoice::Auto => {
                let note = match GpuDevice::open(&AdapterChoice::Best) {
                    Ok(gpu) if !gpu.is_software() => return Self::on_device(gpu, &detector, size_px),
                    Ok(gpu) => format!(
                        "only software Vulkan here ({}): using the CPU backend, which is faster",
                        gpu.description()
                    ),
                    Err(error) => format!("no Vulkan driver ({error}): using the CPU backend"),
                };
                Ok(Self::on_host(Box::new(Cpu::new(width, height)), detector, CostModel::CPU, Some(note)))
            }
        }
    }

    fn on_host(backend: Box<dyn Backend>, detector: Detector, cost: CostModel, note: Option<String>) -> Self {
        Self { drawing: Drawing::Host { backend, detector: Box::new(detector) }, cost, note }
    }

    fn on_device(gpu: Arc<GpuDevice>, detector: &Detector, size_px: [usize; 2]) -> Result<Self, RenderError> {
        let [width, height] = size_px;
        let cost = if gpu.is_software() { CostModel::SOFTWARE_GPU } else { CostModel::GPU };
        let detector = Box::new(GpuDetector::new(Arc::clone(&gpu), detector, width, height)?);
        let backend = Box::new(Gpu::new(gpu, width, height)?);
        let drawing = Drawing::Device { backend, detector, mean: Image::new(width, height) };
        Ok(Self { drawing, cost, note: None })
    }

    fn backend(&self) -> &dyn Backend {
        match &self.drawing {
            Drawing::Host { backend, .. } => &**backend,
            Drawing::Device { backend, .. } => &**backend,
        }
    }

    /// Name of the backend.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.backend().name()
    }

    /// Device behind it.
    #[must_use]
    pub fn description(&self) -> String {
        self.backend().description()
    }

    /// Why this backend and not another, in one line, when the choice was left to us.
    #[must_use]
    pub fn note(&self) -> Option<&str> {
        self.note.as_deref()
    }

    /// Built-in cost constants of the backend.
    #[must_use]
    pub fn cost(&self) -> CostModel {
        self.cost
    }

    /// False for the reference: it is the truth, however long it takes.
    #[must_use]
    pub fn may_degrade(&self) -> bool {
        self.name() != "reference"
    }

    /// True when drawing is only submitted in the first of a frame's [`ImagingTimes`].
    #[must_use]
    pub fn is_on_device(&self) -> bool {
        matches!(self.drawing, Drawing::Device { .. })
    }

    /// Stray light of the frames from here on: mean electrons more in every pixel.
    pub fn set_stray_light_e(&mut self, stray_light_e: f32) {
        match &mut self.drawing {
            Drawing::Host { detector, .. } => detector.set_stray_light_e(stray_light_e),
            Drawing::Device { detector, .. } => detector.set_stray_light_e(stray_light_e),
        }
    }

    /// Defects, to be changed from the next frame on; places are sensor pixels.
    pub fn defects_mut(&mut self) -> &mut Defects {
        match &mut self.drawing {
            Drawing::Host { detector, .. } => detector.defects_mut(),
            Drawing::Device { detector, .. } => detector.defects_mut(),
        }
    }

    /// Protons of the frames from here on; `None`: none.
    ///
    /// # Errors
    /// When a value means nothing; the flux stays as it was.
    pub fn set_proton_flux(&mut self, flux: Option<ProtonFlux>) -> Result<(), ProtonFluxError> {
        match &mut self.drawing {
            Drawing::Host { detector, .. } => detector.set_proton_flux(flux),
            Drawing::Device { detector, .. } => detector.set_proton_flux(flux),
        }
    }

    /// Proton tracks of the latest frame, in sensor pixels.
    #[must_use]
    pub fn proton_tracks(&self) -> &[ProtonTrack] {
        match &self.drawing {
            Drawing::Host { detector, .. } => detector.proton_tracks(),
            Drawing::Device { detector, .. } => detector.proton_tracks(),
        }
    }

    /// Frames come every so often: how often telegraph pixels are looked at.
    pub fn set_frame_period(&mut self, period: Span) {
        self.defects_mut().set_frame_period_s(period.s());
    }

    /// Forgets what the detector keeps from frame to frame: the next frame is as the first.
    pub fn reset_detector(&mut self) {
        match &mut self.drawing {
            Drawing::Host { detector, .. } => detector.reset(),
            Drawing::Device { detector, .. } => detector.reset(),
        }
    }

    /// The detector's temperature in the frames from here on, degrees Celsius: scales the dark current.
    pub fn set_temperature_c(&mut self, operating_c: f64) {
        match &mut self.drawing {
            Drawing::Host { detector, .. } => detector.set_temperature_c(operating_c),
            Drawing::Device { detector, .. } => detector.set_temperature_c(operating_c),
        }
    }

    /// Draws the mean image only; it comes back in memory whatever the backend.
    ///
    /// # Errors
    /// When the device failed.
    pub fn render(&mut self, plan: &ExposurePlan) -> Result<Electrons<'_>, RenderError> {
        match &mut self.drawing {
            Drawing::Host { backend, .. } => backend.render(plan)?,
            Drawing::Device { backend, mean, .. } => {
                backend.render(plan)?;
                backend.read_electrons(mean)?;
            }
        }
        Ok(self.latest_mean())
    }

    /// What the latest [`Self::render`] drew.
    #[must_use]
    pub fn latest_mean(&self) -> Electrons<'_> {
        match &self.drawing {
            Drawing::Host { backend, .. } => backend.electrons(),
            Drawing::Device { mean, .. } => Electrons::Host(mean),
        }
    }

    /// Draws and reads out frame `frame`.
    ///
    /// # Errors
    /// When the device failed.
    pub fn image(&mut self, plan: &ExposurePlan, frame: u32, out: &mut DnImage) -> Result<ImagingTimes, RenderError> {
        let mut watch = Stopwatch::start();
        let exposure_s = plan.motion.los.exposure_s;
        let render;
        let mut on_device = None;
        match &mut self.drawing {
            Drawing::Host { backend, detector } => {
                backend.render(plan)?;
                render = watch.lap();
                match backend.electrons() {
                    Electrons::Host(mean) => detector.collect(mean, frame, exposure_s, out),
                    Electrons::Precise(mean) => detector.collect_precise(mean, frame, exposure_s, out),
                    Electrons::Device(_) => return Err(RenderError::Device("a host backend drew on a device".into())),
                }
            }
            Drawing::Device { backend, detector, .. } => {
                backend.render(plan)?;
                render = watch.lap();
                detector.collect(backend.device_electrons(), frame, exposure_s, out)?;
                let times = detector.times();
                let upload = render + times.submit;
                on_device = Some(DeviceTimes { upload, wait: times.wait, readback: times.copy });
            }
        }
        Ok(ImagingTimes { render, detector: watch.lap(), device: on_device })
    }
}
