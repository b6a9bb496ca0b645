//! Mistakes and limits of the device come back as errors.

use crate::scene::device;
use starloop_image::gpu::{AdapterChoice, GpuDevice, GpuError};
use starloop_image::render::Backend;
use starloop_image::{gpu::shader::ComputePass, render::gpu::Gpu};

#[test]
fn the_description_names_the_adapter_and_says_whether_it_is_hardware() {
    let Some(device) = device() else { return };
    let kind = if device.is_software() { "software" } else { "hardware" };
    let gpu = Gpu::new(device.clone(), 8, 8).expect("a backend");
    println!("{}", gpu.description());
    assert_eq!((gpu.name(), gpu.description().ends_with(kind)), ("gpu", true));
}

#[test]
fn a_refused_shader_is_an_error_and_the_device_stays_failed() {
    // A device of its own: the failure is kept.
    if device().is_none() {
        return;
    }
    let own = GpuDevice::open(&AdapterChoice::Best).expect("a second device");
    let refused = ComputePass::new(&own, "nonsense", "fn main( {".into());
    assert!(matches!(refused, Err(GpuError::Failed(_))), "{refused:?}");
    assert!(own.check().is_err() && own.wait().is_err(), "the failure is not forgotten");
    assert!(
        matches!(&Gpu::new(own, 8, 8), Err(error) if error.to_string().starts_with("the GPU failed while drawing: ")),
        "nor passed over"
    );
}

#[test]
fn missing_adapter_and_oversized_image_are_refused() {
    let Some(device) = device() else { return };
    let missing = GpuDevice::open(&AdapterChoice::Named("no such adapter".into()));
    assert!(matches!(missing, Err(GpuError::NoAdapter { .. })), "{missing:?}");
    let huge = Gpu::new(device, 20_000, 20_000);
    assert!(matches!(&huge, Err(error) if error.to_string().starts_with("electrons: got ")), "{:?}", huge.err());
}
