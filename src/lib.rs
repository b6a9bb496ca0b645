//! starloop: a hardware-in-the-loop star-sensor stimulator.
//!
//! Data flows one way, in the order of these rooms; a room never imports one that stands after it
//! (`tests/conformance` holds the import table):
//!
//! ```text
//! bytes -> Stamped<AttitudeSample> -> LosPath -> [ApparentSource] -> ExposurePlan -> ElectronImage -> DnImage -> SentFrame -> FrameRecord
//! link     link                       attitude   sky+astrometry     exposure        render           detector   sink         runtime
//! ```

#![cfg_attr(
    test,
    allow(
        clippy::unwrap_used,
        clippy::panic,
        clippy::float_cmp,
        reason = "a test may stop at the first surprise and compares exact values where exactness is the claim"
    )
)]

/// Catalog sources -> apparent directions -> pixels.
pub mod astrometry;
/// Attitude samples -> history -> prediction -> line-of-sight path of one exposure.
pub mod attitude;
/// Units, axes, rotations, time, images, random numbers, the accuracy budget: free to every room.
pub mod base;
/// One file per command.
pub mod cli;
/// TOML -> checked parameters.
pub mod config;
/// Electrons -> digital numbers: one ordered list of stages.
pub mod detector;
/// The planner: which method, how many samples, which stars, at what predicted error and cost.
pub mod exposure;
/// wgpu machinery: device, buffers, passes, readback. No physics.
pub mod gpu;
/// Bytes from and to the flight computer, stamped at the edge: trait `Link`.
pub mod link;
/// Point-spread function and radiometry: magnitude -> electrons.
pub mod optics;
/// Plan -> mean electrons: trait `Backend` (gpu, cpu, reference).
pub mod render;
/// Timing and accuracy tables, run summary.
pub mod report;
/// Wiring, threads, deadlines, ledger, shutdown.
pub mod runtime;
/// Frames -> the world: trait `Sink` (recorder, null).
pub mod sink;
/// Time and a cone -> catalog sources; ephemerides; the observer's orbit.
pub mod sky;
/// The other end of the cable: simulated flight computer.
pub mod testbed;
