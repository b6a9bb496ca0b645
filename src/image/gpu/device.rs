//! The GPU: choice of an adapter, its device and queue, and the first thing that went wrong on it.
//!
//! Vulkan only; no validation layers; nothing is printed here (Mesa's device-select layer prints a line of its own when
//! `XDG_RUNTIME_DIR` is not set; `NODEVICE_SELECT=1` keeps it quiet). wgpu reports most mistakes and losses to
//! callbacks: they are kept here and come back as [`crate::gpu::GpuError::Failed`] from
//! [`crate::gpu::GpuDevice::check`], which every wait calls.
//!
//! [`FrameTimes`] has where the wall time of a frame went on the host's side. Device timestamps are not used: software
//! adapters report nonsense for them, and the deadline is on the wall anyway.

use base::time::Span;
use core::time::Duration;
use std::sync::{Arc, OnceLock};
use wgpu::DeviceType;

/// A wait longer than this is a hung device (software adapters on a busy machine need seconds at most).
const LONGEST_WAIT: Duration = Duration::from_secs(60);

/// Choice of the adapter.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum AdapterChoice {
    /// Discrete before integrated before virtual before software.
    #[default]
    Best,
    /// A software adapter: the same pixels on any machine.
    Software,
    /// The first whose name contains this text, whatever the case.
    Named(String),
}

/// A GPU that is ready to work; share it in an `Arc`.
#[derive(Debug)]
pub struct GpuDevice {
    device: wgpu::Device,
    queue: wgpu::Queue,
    info: wgpu::AdapterInfo,
    failure: Arc<OnceLock<String>>,
}

impl GpuDevice {
    /// Returns the name of every adapter, and whether it is this machine's processor; opens none of them.
    pub fn adapters() -> Vec<(String, bool)> {
        let infos = found_adapters().into_iter().map(|adapter| adapter.get_info());
        infos.map(|info| (info.name, info.device_type == DeviceType::Cpu)).collect()
    }

    /// Opens an adapter.
    ///
    /// # Errors
    /// When no adapter fits the choice or the adapter gives no device.
    pub fn open(choice: &AdapterChoice) -> Result<Arc<Self>, GpuError> {
        let adapters = found_adapters();
        let infos: Vec<wgpu::AdapterInfo> = adapters.iter().map(wgpu::Adapter::get_info).collect();
        let chosen = choose(&infos, choice).ok_or_else(|| no_adapter(&infos, choice))?;
        let (Some(adapter), Some(info)) = (adapters.get(chosen), infos.get(chosen)) else {
            return Err(no_adapter(&infos, choice));
        };
        let request = wgpu::DeviceDescriptor { label: Some("starloop"), ..wgpu::DeviceDescriptor::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&request))
            .map_err(|error| GpuError::NoDevice { adapter: info.name.clone(), reason: error.to_string() })?;
        let failure = Arc::new(OnceLock::new());
        // Only the first failure is kept: the rest follow from it.
        let uncaptured = Arc::clone(&failure);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let _ = uncaptured.set(error.to_string());
        }));
        let lost = Arc::clone(&failure);
        device.set_device_lost_callback(move |reason, message| {
            // A device that is dropped in order is "lost" too, but then no code reads this any more.
            let _ = lost.set(format!("device lost ({reason:?}): {message}"));
        });
        Ok(Arc::new(Self { device, queue, info: info.clone(), failure }))
    }

    /// Returns adapter, driver, and whether it is hardware.
    pub fn description(&self) -> String {
        let kind = if self.is_software() { "software" } else { "hardware" };
        let driver = [self.info.driver.as_str(), self.info.driver_info.as_str()];
        let driver = driver.iter().filter(|text| !text.is_empty()).copied().collect::<Vec<_>>().join(" ");
        format!("{}, driver {driver}, {kind}", self.info.name)
    }

    /// Returns the adapter's name.
    pub fn name(&self) -> &str {
        &self.info.name
    }

    /// Returns whether the "GPU" is this machine's processor.
    pub fn is_software(&self) -> bool {
        self.info.device_type == DeviceType::Cpu
    }

    /// Returns the device.
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// Returns the queue.
    pub fn queue(&self) -> &wgpu::Queue {
        &self.queue
    }

    /// Returns an error if the device failed.
    ///
    /// # Errors
    /// The first failure of this device.
    pub fn check(&self) -> Result<(), GpuError> {
        self.failure.get().map_or(Ok(()), |message| Err(GpuError::Failed(message.clone())))
    }

    /// Waits until all submitted work is done.
    ///
    /// # Errors
    /// When the device has failed, or does not finish within a minute.
    pub fn wait(&self) -> Result<(), GpuError> {
        self.check()?;
        let wait = wgpu::PollType::Wait { submission_index: None, timeout: Some(LONGEST_WAIT) };
        let result = self.device.poll(wait);
        self.check()?;
        result.map(|_| ()).map_err(|error| GpuError::Failed(error.to_string()))
    }

    /// Returns a new list of commands.
    pub fn encoder(&self, label: &'static str) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(label) })
    }

    /// Hands a list of commands to the GPU.
    ///
    /// # Errors
    /// When the device has failed.
    pub fn submit(&self, encoder: wgpu::CommandEncoder) -> Result<(), GpuError> {
        self.queue.submit([encoder.finish()]);
        self.check()
    }
}

/// Returns the adapters that the Vulkan loader finds.
fn found_adapters() -> Vec<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        flags: wgpu::InstanceFlags::empty(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN))
}

/// Returns the index of the adapter to take.
fn choose(infos: &[wgpu::AdapterInfo], choice: &AdapterChoice) -> Option<usize> {
    let fits = |info: &wgpu::AdapterInfo| match choice {
        AdapterChoice::Best => true,
        AdapterChoice::Software => info.device_type == DeviceType::Cpu,
        AdapterChoice::Named(name) => info.name.to_lowercase().contains(&name.to_lowercase()),
    };
    let order = |info: &wgpu::AdapterInfo| match info.device_type {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Cpu => 3,
        DeviceType::Other => 4,
    };
    let fitting = infos.iter().enumerate().filter(|(_, info)| fits(info));
    fitting.min_by_key(|(_, info)| order(info)).map(|(i, _)| i)
}

fn no_adapter(infos: &[wgpu::AdapterInfo], choice: &AdapterChoice) -> GpuError {
    let wanted = match choice {
        AdapterChoice::Best => String::new(),
        AdapterChoice::Software => " in software".into(),
        AdapterChoice::Named(name) => format!(" named \"{name}\""),
    };
    let found: Vec<&str> = infos.iter().map(|info| info.name.as_str()).collect();
    GpuError::NoAdapter { wanted, found: if found.is_empty() { "none".into() } else { found.join(", ") } }
}

/// Why the GPU could not be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum GpuError {
    /// no Vulkan adapter was found
    #[error("no Vulkan adapter{wanted}: found {found}; install a driver (mesa-vulkan-drivers has a software one)")]
    NoAdapter {
        /// Adapter that was requested beyond "any", as text after "adapter".
        wanted: String,
        /// Adapters that were found.
        found: String,
    },
    /// the adapter is there but gives no device
    #[error("adapter {adapter} gives no device: {reason}")]
    NoDevice {
        /// Name of the adapter.
        adapter: String,
        /// Reason given by the driver.
        reason: String,
    },
    /// a buffer is larger than the device takes
    #[error("{what}: got {got} bytes, the device takes at most {most}")]
    TooLarge {
        /// Contents of the buffer, as a word.
        what: &'static str,
        /// Bytes wanted.
        got: u64,
        /// Bytes allowed.
        most: u64,
    },
    /// the device failed or was lost
    #[error("the GPU failed: {0}")]
    Failed(String),
    /// something that only the CPU can do
    #[error("{what} \"{got}\" is not drawn on a GPU: wanted \"{wanted}\", or the CPU backend")]
    CpuOnly {
        /// The parameter.
        what: &'static str,
        /// Its value.
        got: String,
        /// The value that a GPU knows.
        wanted: &'static str,
    },
    /// an image of one size met a pass made for another
    #[error("{what}: got an image of {got:?} px, wanted {wanted:?}")]
    Size {
        /// Name of the pass.
        what: &'static str,
        /// Width and height given.
        got: [usize; 2],
        /// Width and height it was made for.
        wanted: [usize; 2],
    },
}

/// Wall time of one frame's trip through the detector pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameTimes {
    /// Writing parameters, recording and submitting.
    pub submit: Span,
    /// Waiting for the GPU until all submitted work is done, drawing included.
    pub wait: Span,
    /// Copying out.
    pub copy: Span,
}

impl Default for FrameTimes {
    fn default() -> Self {
        Self { submit: Span::ZERO, wait: Span::ZERO, copy: Span::ZERO }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter(name: &str, device_type: DeviceType) -> wgpu::AdapterInfo {
        let mut info = wgpu::AdapterInfo::new(device_type, wgpu::Backend::Vulkan);
        info.name = name.into();
        info
    }

    #[test]
    fn hardware_comes_before_software_and_names_are_found() {
        let infos = [adapter("llvmpipe", DeviceType::Cpu), adapter("Big GPU", DeviceType::DiscreteGpu)];
        assert_eq!(choose(&infos, &AdapterChoice::Best), Some(1));
        assert_eq!(choose(&infos, &AdapterChoice::Software), Some(0));
        assert_eq!(choose(&infos, &AdapterChoice::Named("LLVM".into())), Some(0));
        assert_eq!(choose(&infos, &AdapterChoice::Named("other".into())), None);
        assert_eq!(choose(&[], &AdapterChoice::Best), None);
    }

    #[test]
    fn a_missing_adapter_is_reported_with_what_there_is() {
        let infos = [adapter("llvmpipe", DeviceType::Cpu)];
        let text = no_adapter(&infos, &AdapterChoice::Named("H9".into())).to_string();
        assert!(text.contains("named \"H9\"") && text.contains("llvmpipe"), "{text}");
    }
}
