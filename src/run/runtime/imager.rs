//! Backend and detector together: plan -> DN.

use base::image::{DnImage, Image};
use base::{clock::Stopwatch, refused::Refused, region::Regions, time::Span};
use config::Backend;
use frames::report::{Stage, StageTimes};
use image::detector::{Detector, DetectorConditions, DetectorParams, PoissonMethod};
use image::gpu::{AdapterChoice, Electrons, GpuDevice};
use image::render::Backend as Renderer;
use image::render::{cpu::Cpu, gpu::Gpu, gpu::brighter::Brighter, overlap::Apart, reference::Reference};
use image::{detector::disturbances::Disturbances, detector::gpu::GpuDetector};
use plan::exposure::{ExposurePlan, cost::CostModel};
use std::sync::Arc;

/// A backend and the detector behind it.
pub struct Imager {
    drawing: Drawing,
    /// Index of the tables in use: 0 for the camera's own; others follow in the order in which they were added.
    tables: usize,
    size_px: [usize; 2],
    /// Draws stars and targets separately, so that each pixel shows the brighter; `None` when their light adds.
    apart: Option<Box<Apart>>,
    /// True when the latest image was drawn that way.
    is_apart: bool,
    /// The built-in cost constants of the backend.
    pub cost: CostModel,
    /// Why this backend was selected, in one line, when the choice was automatic.
    pub note: Option<String>,
}

/// Where images are drawn and read out.
#[allow(clippy::vec_box, reason = "others change places with the one in use")]
enum Drawing {
    /// In memory, by the CPU or reference backend.
    Host { backend: Box<dyn Renderer>, others: Vec<Box<dyn Renderer>>, detector: Box<Detector> },
    /// On a GPU; `mean` holds the mean image when it is requested.
    Device {
        backend: Box<Gpu>,
        others: Vec<Box<Gpu>>,
        detector: Box<GpuDetector>,
        brighter: Option<Box<Brighter>>,
        mean: Image<f32>,
    },
}

/// Wall time of the two halves of an image. On a GPU drawing is only submitted in the first; the second waits for both.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImagingTimes {
    /// Plan to electrons.
    pub render: Span,
    /// Electrons to DN.
    pub detector: Span,
    /// The same time divided by device stages; `None` where memory is shared.
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
    /// Returns the times by stage; stages that did not run are absent.
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
    /// Returns an imager for a detector of this size.
    ///
    /// # Errors
    /// When a GPU was requested and is unavailable, or it cannot use the detector's Poisson method.
    pub fn new(choice: Backend, params: DetectorParams, size_px: [usize; 2], seed: u64) -> Result<Self, Refused> {
        let [width, height] = size_px;
        Self::of_detector(choice, Detector::new(params, width, height, seed))
    }

    /// Returns an imager for a detector with measured or drawn patterns.
    ///
    /// # Errors
    /// When a GPU was requested and is unavailable, or it cannot use the detector's Poisson method.
    pub fn of_detector(choice: Backend, detector: Detector) -> Result<Self, Refused> {
        let (params, size_px) = (*detector.params(), detector.size_px());
        let [width, height] = size_px;
        match choice {
            Backend::Cpu => {
                Ok(Self::on_host(Box::new(Cpu::new(width, height)), detector, size_px, CostModel::CPU, None))
            }
            Backend::Reference => {
                let backend = Box::new(Reference::new(width, height));
                Ok(Self::on_host(backend, detector, size_px, CostModel::REFERENCE, None))
            }
            Backend::Gpu => Self::on_device(GpuDevice::open(&AdapterChoice::Best)?, &detector, size_px),
            Backend::Auto if params.poisson != PoissonMethod::Auto => {
                let note = format!("only the CPU draws shot noise by \"{}\": using the CPU backend", params.poisson);
                Ok(Self::on_host(Box::new(Cpu::new(width, height)), detector, size_px, CostModel::CPU, Some(note)))
            }
            Backend::Auto => {
                let note = match GpuDevice::open(&AdapterChoice::Best) {
                    Ok(gpu) if !gpu.is_software() => return Self::on_device(gpu, &detector, size_px),
                    Ok(gpu) => {
                        format!("only software Vulkan here ({}): using the CPU backend, which is faster", gpu.name())
                    }
                    Err(error) => format!("no Vulkan driver ({error}): using the CPU backend"),
                };
                Ok(Self::on_host(Box::new(Cpu::new(width, height)), detector, size_px, CostModel::CPU, Some(note)))
            }
        }
    }

    fn on_host(
        backend: Box<dyn Renderer>,
        detector: Detector,
        size_px: [usize; 2],
        cost: CostModel,
        note: Option<String>,
    ) -> Self {
        let drawing = Drawing::Host { backend, others: Vec::new(), detector: Box::new(detector) };
        Self { drawing, tables: 0, size_px, apart: None, is_apart: false, cost, note }
    }

    fn on_device(gpu: Arc<GpuDevice>, detector: &Detector, size_px: [usize; 2]) -> Result<Self, Refused> {
        let [width, height] = size_px;
        let cost = if gpu.is_software() { CostModel::SOFTWARE_GPU } else { CostModel::GPU };
        let detector = Box::new(GpuDetector::new(Arc::clone(&gpu), detector, width, height)?);
        let backend = Box::new(Gpu::new(gpu, width, height)?);
        let (others, mean) = (Vec::new(), Image::new(width, height));
        let drawing = Drawing::Device { backend, others, detector, brighter: None, mean };
        Ok(Self { drawing, tables: 0, size_px, apart: None, is_apart: false, cost, note: None })
    }

    /// Adds a second backend of the same kind with its own tables, so that another PSF can be drawn without building
    /// tables.
    ///
    /// # Errors
    /// When the device cannot build it.
    pub fn add_tables(&mut self) -> Result<(), Refused> {
        let [width, height] = self.size_px;
        match &mut self.drawing {
            Drawing::Host { backend, others, .. } => others.push(match backend.name() {
                "reference" => Box::new(Reference::new(width, height)),
                _ => Box::new(Cpu::new(width, height)),
            }),
            Drawing::Device { backend, others, .. } => {
                others.push(Box::new(Gpu::new(Arc::clone(backend.device()), width, height)?));
            }
        }
        Ok(())
    }

    /// Removes the set of tables that was added last.
    pub fn remove_last_tables(&mut self) {
        match &mut self.drawing {
            Drawing::Host { others, .. } => drop(others.pop()),
            Drawing::Device { others, .. } => drop(others.pop()),
        }
    }

    /// Selects the tables used from here on, 0 for the camera's own; returns the previous index.
    pub fn use_tables(&mut self, number: usize) -> usize {
        let before = self.tables;
        self.exchange(before);
        self.exchange(number);
        self.tables = number;
        before
    }

    /// Swaps the camera's own tables, when in use, with others.
    fn exchange(&mut self, number: usize) {
        let Some(place) = number.checked_sub(1) else { return };
        match &mut self.drawing {
            Drawing::Host { backend, others, .. } => {
                others.get_mut(place).into_iter().for_each(|other| core::mem::swap(backend, other));
            }
            Drawing::Device { backend, others, .. } => {
                others.get_mut(place).into_iter().for_each(|other| core::mem::swap(backend, other));
            }
        }
    }

    /// Makes each pixel show only the brighter of stars and targets from here on.
    ///
    /// # Errors
    /// When the device has no memory for it.
    pub fn keep_brighter(&mut self) -> Result<(), Refused> {
        self.apart = Some(Box::default());
        if let Drawing::Device { backend, brighter, .. } = &mut self.drawing {
            *brighter = Some(Box::new(Brighter::new(backend.device(), self.size_px)?));
        }
        Ok(())
    }

    /// Returns the electrons that the latest image lacks because only the brighter of stars and targets is kept.
    pub fn overlap_lost_e(&self) -> f64 {
        self.apart.as_ref().map_or(0.0, |apart| apart.lost_e)
    }

    fn backend(&self) -> &dyn Renderer {
        match &self.drawing {
            Drawing::Host { backend, .. } => &**backend,
            Drawing::Device { backend, .. } => &**backend,
        }
    }

    /// Returns the name of the backend.
    pub fn name(&self) -> &'static str {
        self.backend().name()
    }

    /// Returns a description of the device it runs on.
    pub fn description(&self) -> String {
        self.backend().description()
    }

    /// Returns true for the reference: it integrates every star's exact path.
    pub fn is_exact(&self) -> bool {
        self.name() == "reference"
    }

    /// Returns whether drawing is only submitted in the first of a frame's [`ImagingTimes`].
    pub fn is_on_device(&self) -> bool {
        matches!(self.drawing, Drawing::Device { .. })
    }

    /// Sets the relative illumination of every pixel, row by row, for the sky's part of the background.
    ///
    /// # Errors
    /// When the device has no memory for it.
    pub fn set_illumination_map(&mut self, map: Vec<f32>) -> Result<(), Refused> {
        match &mut self.drawing {
            Drawing::Host { detector, .. } => detector.set_illumination_map(Some(map)),
            Drawing::Device { detector, .. } => detector.set_illumination_map(Some(&map))?,
        }
        Ok(())
    }

    /// Returns defects and protons; places are sensor pixels.
    pub fn disturbances(&self) -> &Disturbances {
        match &self.drawing {
            Drawing::Host { detector, .. } => detector.disturbances(),
            Drawing::Device { detector, .. } => detector.disturbances(),
        }
    }

    /// Returns defects and protons for changes that apply from the next frame on.
    pub fn disturbances_mut(&mut self) -> &mut Disturbances {
        match &mut self.drawing {
            Drawing::Host { detector, .. } => detector.disturbances_mut(),
            Drawing::Device { detector, .. } => detector.disturbances_mut(),
        }
    }

    /// Clears what the detector keeps from frame to frame: the next frame is drawn as the first one.
    pub fn reset_detector(&mut self) {
        match &mut self.drawing {
            Drawing::Host { detector, .. } => detector.reset(),
            Drawing::Device { detector, .. } => detector.reset(),
        }
    }

    /// Draws only the mean image, and returns it in main memory on every backend.
    ///
    /// # Errors
    /// When the device failed.
    pub fn render(&mut self, plan: &ExposurePlan) -> Result<Electrons<'_>, Refused> {
        self.draw_only(&Regions::WHOLE);
        let apart = Self::apart_for(&mut self.apart, plan);
        match &mut self.drawing {
            Drawing::Host { backend, .. } => match apart {
                Some(apart) => apart.render(&mut **backend, plan)?,
                None => backend.render(plan)?,
            },
            Drawing::Device { backend, brighter, mean, .. } => match (apart, brighter) {
                (Some(apart), Some(brighter)) => {
                    brighter.render(backend, plan, apart)?;
                    backend.read_image(brighter.electrons(), mean)?;
                }
                _ => {
                    backend.render(plan)?;
                    backend.read_electrons(mean)?;
                }
            },
        }
        self.is_apart = self.apart.is_some() && !plan.targets.is_empty();
        Ok(self.latest_mean())
    }

    /// Returns the mean image of the latest [`Self::render`].
    pub fn latest_mean(&self) -> Electrons<'_> {
        match (&self.drawing, &self.apart) {
            (Drawing::Host { .. }, Some(apart)) if self.is_apart => apart.electrons(),
            (Drawing::Host { backend, .. }, _) => backend.electrons(),
            (Drawing::Device { mean, .. }, _) => Electrons::Host(mean),
        }
    }

    /// Returns where stars and targets are drawn separately; `None` for plans without targets.
    fn apart_for<'a>(apart: &'a mut Option<Box<Apart>>, plan: &ExposurePlan) -> Option<&'a mut Apart> {
        let apart = apart.as_deref_mut()?;
        apart.set_lost_e(0.0);
        (!plan.targets.is_empty()).then_some(apart)
    }

    /// Limits drawing of the next image to the parts that these regions need. The whole image is drawn when charge
    /// moves from pixel to pixel or from frame to frame, when stars and targets are drawn separately, and on a GPU.
    fn draw_only(&mut self, regions: &Regions) {
        if let Drawing::Host { backend, detector, .. } = &mut self.drawing {
            let is_local = detector.is_one_pass() && self.apart.is_none();
            let drawn = if is_local { detector.output().geometry().sensor_regions(regions) } else { Regions::WHOLE };
            backend.set_regions(&drawn);
        }
    }

    /// Draws and reads out frame `frame`: the regions of the conditions, and 0 in all other pixels.
    ///
    /// # Errors
    /// When the device failed.
    pub fn image(
        &mut self,
        plan: &ExposurePlan,
        frame: u32,
        conditions: &DetectorConditions,
        out: &mut DnImage,
    ) -> Result<ImagingTimes, Refused> {
        let mut watch = Stopwatch::start();
        self.draw_only(&conditions.regions);
        let render;
        let mut on_device = None;
        let mut apart = Self::apart_for(&mut self.apart, plan);
        self.is_apart = apart.is_some();
        match &mut self.drawing {
            Drawing::Host { backend, detector, .. } => {
                match &mut apart {
                    Some(apart) => apart.render(&mut **backend, plan)?,
                    None => backend.render(plan)?,
                }
                render = watch.lap();
                let electrons = apart.as_ref().map_or_else(|| backend.electrons(), |apart| apart.electrons());
                match electrons {
                    Electrons::Host(mean) => detector.collect(mean, frame, conditions, out),
                    Electrons::Precise(mean) => detector.collect_precise(mean, frame, conditions, out),
                    Electrons::Device(_) => {
                        return Err(Refused(format!(
                            "the GPU failed while drawing: {}",
                            "a host backend drew on a device"
                        )));
                    }
                }
            }
            Drawing::Device { backend, detector, brighter, .. } => {
                let electrons = match (apart, brighter) {
                    (Some(apart), Some(brighter)) => {
                        brighter.render(backend, plan, apart)?;
                        brighter.electrons()
                    }
                    _ => {
                        backend.render(plan)?;
                        backend.device_electrons()
                    }
                };
                render = watch.lap();
                detector.collect(electrons, frame, conditions, out)?;
                let times = detector.times();
                let upload = render + times.submit;
                on_device = Some(DeviceTimes { upload, wait: times.wait, readback: times.copy });
            }
        }
        Ok(ImagingTimes { render, detector: watch.lap(), device: on_device })
    }
}
