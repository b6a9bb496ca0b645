//! starloop: a hardware-in-the-loop star-sensor stimulator. It runs on Linux only: CAN, serial ports, locks and real-time
//! scheduling are the kernel's.
//!
//! Data flows one way, in the order of these crates; a crate depends only on crates before it (its `Cargo.toml` says which):
//!
//! ```text
//! bytes -> Stamped<AttitudeSample> -> LosPath -> [ApparentSource] -> ExposurePlan -> ElectronImage -> DnImage -> SentFrame -> FrameRecord
//! link     link                       plan       stars + sky        plan            image            image      frames       run
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

// The crates in the order of the flow; `src/ARCHITECTURE.md` has a sentence for each.
pub use base;
pub use batch;
pub use config;
pub use frames;
pub use image;
pub use imports;
pub use link;
pub use outputs;
pub use plan;
pub use run;
pub use scene;
pub use sky;
pub use stars;
pub use testbed;

// One file per command.
pub mod cli;
