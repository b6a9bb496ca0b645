//! Errors of the control socket.

use super::lines::ControlAddress;
use std::path::PathBuf;

/// Why the control socket cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// The address cannot be listened on.
    #[error("control socket: cannot listen on {address} ({source}); port 0 takes any free one")]
    Listen {
        /// The address.
        address: ControlAddress,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The system has no random numbers.
    #[error("control socket: no random numbers for a token: {source}")]
    Random {
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The token cannot be written.
    #[error("control socket: cannot write the token to {} ({source})", path.display())]
    TokenFile {
        /// Its file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
}
