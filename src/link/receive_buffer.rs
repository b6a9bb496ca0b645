//! The receive buffer of a socket: seconds of any sender that a bench has, a quarter of a second of a full 1 Mbit/s bus of
//! short frames.

use rustix::net::sockopt::{set_socket_recv_buffer_size, set_socket_recv_buffer_size_force};
use std::{io, os::fd::AsFd};

/// Size asked for.
const BYTES: usize = 4 << 20;

/// Enlarges it: beyond the system's limit (`net.core.rmem_max`) where the rights suffice, else up to it.
pub(super) fn enlarge(socket: &impl AsFd) -> io::Result<()> {
    set_socket_recv_buffer_size_force(socket, BYTES).or_else(|_| set_socket_recv_buffer_size(socket, BYTES))?;
    Ok(())
}
