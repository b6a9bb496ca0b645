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

// The rooms in the order of the flow, one line each; their own pages say more.

// Units, axes, rotations, time, images, random numbers, the accuracy budget: free to every room.
pub mod base;
// Bytes from and to the flight computer, stamped at the edge: trait `Link`.
pub mod link;
// Attitude samples -> history -> prediction -> line-of-sight path of one exposure.
pub mod attitude;
// Time and a cone -> catalog sources; the Earth; the observer's orbit.
pub mod sky;
// Catalog sources -> apparent directions -> pixels.
pub mod astrometry;
// Point-spread function and radiometry: magnitude -> electrons.
pub mod optics;
// The planner: which method, how many samples, which stars, at what predicted error and cost.
pub mod exposure;
// wgpu machinery: device, buffers, passes, readback. No physics.
pub mod gpu;
// Plan -> mean electrons: trait `Backend` (gpu, cpu, reference).
pub mod render;
// Electrons -> digital numbers: one ordered list of stages.
pub mod detector;
// Frames -> the world: trait `Sink` (recorder, null).
pub mod sink;
// Linear-luminance frames -> greys on a monitor in front of a tracker.
pub mod display;
// Frames -> a camera on the network: GVCP and GVSP.
pub mod network_camera;
// The other end of the cable: simulated flight computer.
pub mod testbed;
// Timing and accuracy tables, run summary.
pub mod report;
// Newest frame and numbers -> one page for people, metrics for machines (HTTP).
pub mod live;
// Accuracy against speed, measured: every method, scene and backend -> CSV and SVG.
pub mod chart;
// A camera held against its file from its own frames: photon transfer, fidelity by brightness.
pub mod verify;
// Wiring, threads, deadlines, ledger, shutdown.
pub mod runtime;
// TOML -> checked parameters.
pub mod config;
// Checked configurations -> the parts of a run; the closed loop.
pub mod wiring;
// One file per command.
pub mod cli;
