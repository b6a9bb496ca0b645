//! starloop: a hardware-in-the-loop star-sensor stimulator. It runs on Linux only: CAN, serial ports, locks and
//! real-time scheduling are the kernel's.
//!
//! Data flows one way, in the order of these crates; a crate depends only on crates before it (its `Cargo.toml` says
//! which):
//!
//! ```text
//! bytes -> Stamped<AttitudeSample> -> LosPath -> [Source] -> ExposurePlan -> ElectronImage -> DnImage -> SentFrame -> FrameRecord
//! link     link                       plan       stars + sky        plan            image            image      frames       run
//! ```
//!
//! A run in ten lines: the built-in bench on the virtual clock, cut to half a second, its frames counted.
//!
//! ```
//! use starloop::config::{Document, Scenario};
//! use starloop::frames::sink::{NullSink, Sink};
//! use starloop::run::wiring::assemble::{Outputs, Run, RunOptions};
//!
//! let bench = Scenario::from_document(&Document::built_in("benches/loopback.toml")?)?.lasting(0.5);
//! let mut sink = |_head: usize| Box::new(NullSink::new()) as Box<dyn Sink>;
//! let run = Run::assemble(&bench, RunOptions::stepped(Outputs::Made(&mut sink)))?;
//! let end = run.fly(&Default::default(), &mut |_head, frame, _record| assert!(!frame.truth.is_empty()))?;
//! assert_eq!(end.record.frames.delivered, 5);
//! # Ok::<(), Box<dyn std::error::Error>>(())
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
pub use night_sky;
pub use outputs;
pub use plan;
pub use run;
pub use scene;
pub use sky;
pub use stars;
pub use testbed;

// One file per command.
pub mod cli;
