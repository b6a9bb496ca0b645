//! The `firmware_protocol` crate as a static library: the functions of `../c/starloop_protocol.h`, without the standard
//! library and without allocation.
//!
//! The program that links it defines `void sl_panic(void)`, which is called if the library panics and does not return.
//! `tests/firmware_kit/static_library.rs` of starloop builds it, links it into a C program, and holds it to
//! `vectors.json` and to random input.

#![no_std]

mod abi;
mod layout;
