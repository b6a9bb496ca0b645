//! `starloop doctor`, devices that a library must ask for: GPU adapters and monitors.

use crate::cli::doctor_finding::Finding;
use image::gpu::GpuDevice;
use outputs::display::DisplayError;

const ADVICE_NO_GPU: &str =
    "install a Vulkan driver of the card (mesa-vulkan-drivers for AMD and Intel); until then the CPU draws";
const ADVICE_SOFTWARE: &str =
    "a card with a Vulkan driver; until then the CPU draws, which is faster than Vulkan in software";
const ADVICE_NOT_BUILT: &str = "install one with `cargo install --locked --path . --features display`; only displays in front of a tracker need it";
const ADVICE_DISPLAY: &str =
    "set DISPLAY to an X server, or log in at a desktop; only displays in front of a tracker need it";

/// Returns adapters and monitors.
pub(super) fn findings() -> Vec<Finding> {
    vec![gpu(&GpuDevice::adapters()), display()]
}

/// Returns the GPU adapters, hardware before software.
fn gpu(adapters: &[(String, bool)]) -> Finding {
    const NAME: &str = "GPU adapters";
    let names = |is_software: bool| {
        let fitting = adapters.iter().filter(|(_, software)| *software == is_software);
        fitting.map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ")
    };
    match (names(false), names(true)) {
        (hardware, _) if !hardware.is_empty() => Finding::ready(NAME, hardware),
        (_, software) if !software.is_empty() => {
            Finding::limited(NAME, format!("only software Vulkan: {software}"), ADVICE_SOFTWARE)
        }
        _ => Finding::missing(NAME, "no Vulkan driver", ADVICE_NO_GPU),
    }
}

/// Returns the monitors.
fn display() -> Finding {
    const NAME: &str = "display";
    match outputs::display::monitors() {
        Ok(monitors) if !monitors.is_empty() => {
            Finding::ready(NAME, monitors.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "))
        }
        Ok(_) => Finding::missing(NAME, "an X server without a monitor", ADVICE_DISPLAY),
        Err(DisplayError::NotBuilt) => Finding::missing(NAME, "not in this build", ADVICE_NOT_BUILT),
        Err(error) => Finding::missing(NAME, error.to_string(), ADVICE_DISPLAY),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::doctor_finding::State;

    #[test]
    fn hardware_is_ready_and_software_alone_is_limited() {
        let adapter = |name: &str, is_software| (name.to_owned(), is_software);
        assert_eq!(gpu(&[]).state, State::Missing);
        let software = gpu(&[adapter("llvmpipe", true)]);
        assert!(software.state == State::Limited && software.found.contains("llvmpipe"), "{software:?}");
        let both = gpu(&[adapter("llvmpipe", true), adapter("A card", false)]);
        assert_eq!(both, Finding::ready("GPU adapters", "A card"));
    }
}
