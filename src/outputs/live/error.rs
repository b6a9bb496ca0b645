//! Errors of the live view.

use base::refused::Refused;
use std::{io, net::SocketAddr};

/// A live view that could not be started.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The live view cannot listen at the address.
    #[error(
        "the live view cannot listen at {address}: {source}; wanted an address of this machine and a free port: port 0 takes one"
    )]
    Listen {
        /// The address asked for.
        address: SocketAddr,
        /// The system's reason.
        source: io::Error,
    },
    /// A refusal in words.
    #[error(transparent)]
    Refused(#[from] Refused),
}
