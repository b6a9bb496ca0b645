//! Errors that prevent a camera from coming up on the network.

use std::{io, net::Ipv4Addr};

/// A camera that could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum NetworkCameraError {
    /// No interface of this machine has the address.
    #[error(
        "network camera at {address}: no interface has this address; wanted one of: {known}; try 127.0.0.1, or give the \
         interface the address"
    )]
    NoInterface {
        /// The address asked for.
        address: Ipv4Addr,
        /// Addresses of the interfaces there are.
        known: String,
    },
    /// The interface takes smaller packets than clients send and ask for.
    #[error(
        "network camera at {address}: packets on {name} have at most {mtu} bytes (its MTU); wanted 576 or more; raise the \
         MTU, or take the address of another interface"
    )]
    SmallMtu {
        /// The address asked for.
        address: Ipv4Addr,
        /// The interface.
        name: String,
        /// Its MTU.
        mtu: u32,
    },
    /// A value that a camera cannot have.
    #[error("network camera: {what} is {got}; wanted {wanted}")]
    Invalid {
        /// Which value.
        what: &'static str,
        /// The rule.
        wanted: String,
        /// The value.
        got: String,
    },
    /// The system refused a socket, a file or a thread.
    #[error("network camera at {address}: cannot {doing} ({source}){advice}")]
    System {
        /// The address.
        address: String,
        /// Action that failed.
        doing: &'static str,
        /// The system's reason.
        source: io::Error,
        /// Advice, as a clause.
        advice: &'static str,
    },
}
