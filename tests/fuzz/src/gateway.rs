//! `starloop::link::gateway`: the parsers alone, without sockets and threads.

#[path = "../../../src/link/gateway/hex.rs"]
#[allow(dead_code, reason = "what writes text is not used here")]
mod hex;
#[path = "slcan.rs"]
pub mod slcan;
#[path = "socketcand.rs"]
pub mod socketcand;
