//! The GPU backend and detector against the CPU's. Runs on any Vulkan adapter, software included; without one every
//! test prints `SKIPPED: no Vulkan adapter`, or fails when `STARLOOP_REQUIRE_GPU=1`.
#![allow(
    clippy::panic,
    clippy::float_cmp,
    clippy::unwrap_used,
    missing_docs,
    unreachable_pub,
    reason = "a test may stop at the first surprise, and compares exact values where exactness is the claim"
)]

mod background;
mod detector;
mod device;
mod drawing;
mod effects;
mod overflow;
mod overlap;
mod passes;
mod psf_models;
mod repeat;
mod scene;
mod spatial;
mod whole;
