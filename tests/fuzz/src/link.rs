//! `starloop::link`, as far as it reads bytes of others.

#[path = "../../../src/link/capture/mod.rs"]
pub mod capture;
#[path = "gateway.rs"]
pub mod gateway;
#[path = "../../../src/link/packet.rs"]
mod packet;

pub use packet::{CHUNK_MAX, Packet, SerialChunk};
