//! Errors of the live view.

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
    /// There is nothing to show.
    #[error(
        "Params.heads of the live view: got an empty list, wanted at least one camera head; list every head of the run"
    )]
    NoHeads,
    /// Its thread could not be started.
    #[error("the live view's thread cannot be started: {0}; the run goes on without --monitor")]
    Thread(io::Error),
}
