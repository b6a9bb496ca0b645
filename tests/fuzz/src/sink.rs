//! `starloop::sink`: what is told of a frame.

#[path = "../../../src/sink/active_fault.rs"]
pub mod active_fault;
#[path = "../../../src/sink/faults.rs"]
pub mod faults;
#[path = "../../../src/sink/frame.rs"]
pub mod frame;
#[path = "../../../src/sink/target_table.rs"]
pub mod target_table;
#[path = "../../../src/sink/wcs.rs"]
pub mod wcs;

pub use frame::FrameMeta;
