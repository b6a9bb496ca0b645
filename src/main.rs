//! The `starloop` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    quiet_device_selection();
    starloop::cli::main()
}

/// Mesa's device-selection layer prints an error of its own about a display session that is not there whenever Vulkan
/// is asked for its devices. starloop selects its device itself, so the layer is switched off where there is no
/// session.
#[allow(unsafe_code, reason = "changing the environment is unsafe; this is the one place, before any thread")]
fn quiet_device_selection() {
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() && std::env::var_os("NODEVICE_SELECT").is_none() {
        // SAFETY: the first thing `main` does; no other thread exists that could read the environment.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}
