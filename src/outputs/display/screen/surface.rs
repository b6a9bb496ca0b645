//! The images that a monitor takes, one by one: a Vulkan swap chain, first in first out.
//!
//! Temporary failures are not errors: a surface that is lost or has another size is configured or made again. A surface
//! that does not come back within a second, or a lost device, ends the display.

use crate::display::screen::painter::{self, GreyPainter};
use crate::display::{error::DisplayError, params::Bits, picture::Picture, screen::state::State};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use wgpu::{CurrentSurfaceTexture, SurfaceTexture};
use winit::window::Window;

/// A surface that is lost so often in a row stays lost (the presenter asks 50 times a second).
const MOST_LOSSES: u32 = 50;

/// Errors of the driver.
#[derive(Debug, Default)]
struct Trouble {
    /// The last complaint, until it is looked at.
    last: Mutex<Option<String>>,
    /// The device is gone.
    lost: OnceLock<String>,
}

impl Trouble {
    fn complain(&self, message: String) {
        *self.last.lock().unwrap_or_else(PoisonError::into_inner) = Some(message);
    }

    fn take(&self) -> Option<String> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

/// A surface, its device, and the pipeline that paints on it.
pub(super) struct VulkanPanel {
    // Dropped from the top: an image before its surface, the surface and its instance before the window.
    acquired: Option<SurfaceTexture>,
    surface: wgpu::Surface<'static>,
    painter: GreyPainter,
    config: wgpu::SurfaceConfiguration,
    queue: wgpu::Queue,
    device: wgpu::Device,
    adapter: String,
    instance: wgpu::Instance,
    state: Arc<State>,
    trouble: Arc<Trouble>,
    losses: u32,
    last_complaint: String,
    window: Arc<Window>,
}

impl VulkanPanel {
    /// Opens a surface of `window` for pictures of `image_px`.
    ///
    /// # Errors
    /// When no driver shows on it, or not with this depth.
    pub(super) fn open(
        window: Arc<Window>,
        image_px: [u32; 2],
        bits: Bits,
        state: Arc<State>,
    ) -> Result<Self, DisplayError> {
        let refuse = |reason: String| {
            DisplayError::refuse(format!(
                "no Vulkan driver shows on this window: {reason}; install a driver (mesa-vulkan-drivers has a software one)"
            ))
        };
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends: wgpu::Backends::VULKAN,
            flags: wgpu::InstanceFlags::empty(),
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        let surface = surface_of(&window, &instance).map_err(refuse)?;
        let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions {
            power_preference: wgpu::PowerPreference::HighPerformance,
            compatible_surface: Some(&surface),
            ..Default::default()
        }))
        .map_err(|error| refuse(error.to_string()))?;
        let offered = surface.get_capabilities(&adapter);
        let format = painter::choose_format(&offered.format_capabilities, bits)?;
        let request = wgpu::DeviceDescriptor { label: Some("display"), ..wgpu::DeviceDescriptor::default() };
        let (device, queue) =
            pollster::block_on(adapter.request_device(&request)).map_err(|error| refuse(error.to_string()))?;
        let trouble = listen(&device);
        let config = configuration(format, state.window_px());
        surface.configure(&device, &config);
        let painter = GreyPainter::new(&device, format, bits.most(), image_px);
        if let Some(complaint) = trouble.take() {
            return Err(refuse(complaint));
        }
        Ok(Self {
            acquired: None,
            surface,
            painter,
            config,
            queue,
            device,
            adapter: format!("{}, {format:?}", adapter.get_info().name),
            instance,
            state,
            trouble,
            losses: 0,
            last_complaint: String::new(),
            window,
        })
    }

    /// Returns the adapter and format.
    pub(super) fn description(&self) -> &str {
        &self.adapter
    }

    /// Configures the surface for the window as it is now; false when the driver refuses.
    fn configure(&mut self) -> bool {
        let size_px: [u32; 2] = self.window.inner_size().into();
        [self.config.width, self.config.height] = size_px.map(|side| side.max(1));
        self.surface.configure(&self.device, &self.config);
        self.is_well()
    }

    /// Returns true if no error was reported since the last look.
    fn is_well(&mut self) -> bool {
        match self.trouble.take() {
            None => true,
            Some(complaint) => {
                self.last_complaint = complaint;
                false
            }
        }
    }

    /// Returns the next image, or why there is none.
    fn acquire(&mut self) -> Turn {
        match self.surface.get_current_texture() {
            // Suboptimal images are shown as they are: the size, which matters, is watched separately.
            CurrentSurfaceTexture::Success(image) | CurrentSurfaceTexture::Suboptimal(image) => {
                self.acquired = Some(image);
                Turn::Ready
            }
            CurrentSurfaceTexture::Timeout | CurrentSurfaceTexture::Occluded => Turn::NotNow,
            CurrentSurfaceTexture::Outdated => Turn::Reconfigured,
            CurrentSurfaceTexture::Lost | CurrentSurfaceTexture::Validation => Turn::Lost,
        }
    }

    fn remake(&mut self) -> Turn {
        self.losses += 1;
        match surface_of(&self.window, &self.instance) {
            Ok(surface) => {
                self.surface = surface;
                self.configure();
            }
            Err(why) => self.last_complaint = why,
        }
        Turn::Lost
    }
}

impl Panel for VulkanPanel {
    fn turn(&mut self) -> Turn {
        let window_px = self.state.window_px();
        let mut is_new = window_px != [self.config.width, self.config.height] && !window_px.contains(&0);
        if is_new && !self.configure() {
            return self.remake();
        }
        let mut turn = self.acquire();
        if turn == Turn::Reconfigured {
            is_new = true;
            turn = if self.configure() { self.acquire() } else { Turn::Lost };
        }
        match turn {
            Turn::Ready => {
                self.losses = 0;
                if is_new { Turn::Reconfigured } else { Turn::Ready }
            }
            Turn::NotNow => Turn::NotNow,
            Turn::Lost | Turn::Reconfigured => self.remake(),
        }
    }

    fn show(&mut self, picture: &Picture, is_changed: bool) {
        let Some(image) = self.acquired.take() else { return };
        if is_changed {
            self.painter.upload(&self.queue, picture.greys());
        }
        let view = image.texture.create_view(&wgpu::TextureViewDescriptor::default());
        let mut encoder =
            self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("display") });
        self.painter.record(&mut encoder, &view);
        self.queue.submit([encoder.finish()]);
        self.queue.present(image);
    }

    fn failure(&self) -> Option<String> {
        let lost = self.trouble.lost.get().cloned();
        let lost_for_good = || format!("the surface was lost {} times in a row: {}", self.losses, self.last_complaint);
        lost.or_else(|| (self.losses >= MOST_LOSSES).then(lost_for_good))
    }
}

fn surface_of(window: &Arc<Window>, instance: &wgpu::Instance) -> Result<wgpu::Surface<'static>, String> {
    instance.create_surface(Arc::clone(window)).map_err(|error| error.to_string())
}

/// Collects the errors that the driver reports.
fn listen(device: &wgpu::Device) -> Arc<Trouble> {
    let trouble = Arc::new(Trouble::default());
    let complaints = Arc::clone(&trouble);
    device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| complaints.complain(error.to_string())));
    let losses = Arc::clone(&trouble);
    device.set_device_lost_callback(move |reason, message| {
        // A later reason does not replace the first.
        let _ = losses.lost.set(format!("device lost ({reason:?}): {message}"));
    });
    trouble
}

fn configuration(format: wgpu::TextureFormat, [width, height]: [u32; 2]) -> wgpu::SurfaceConfiguration {
    wgpu::SurfaceConfiguration {
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
        format,
        color_space: wgpu::SurfaceColorSpace::Srgb,
        width: width.max(1),
        height: height.max(1),
        present_mode: wgpu::PresentMode::Fifo,
        // One image on the screen, one to paint: a third would be a refresh of delay.
        desired_maximum_frame_latency: 1,
        alpha_mode: wgpu::CompositeAlphaMode::Auto,
        view_formats: Vec::new(),
    }
}

// The target of the presenter: a surface, or a stand-in for one in tests.

/// Result of one wait for a refresh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Turn {
    /// There is a free image: show something.
    Ready,
    /// The image is available, but the surface was configured again.
    Reconfigured,
    /// No image can be shown now; ask again.
    NotNow,
    /// The surface was lost; it has been made again, or will be.
    Lost,
}

/// A surface of images that a monitor takes one by one.
pub(super) trait Panel {
    /// Waits for a free image: a second at most.
    fn turn(&mut self) -> Turn;

    /// Shows the picture in the image of the last [`Turn::Ready`] or [`Turn::Reconfigured`]. `is_changed`: the greys
    /// are not those of the last call.
    fn show(&mut self, picture: &Picture, is_changed: bool);

    /// Returns the first unrecoverable failure.
    fn failure(&self) -> Option<String>;
}
