//! Errors of GPU devices.

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
