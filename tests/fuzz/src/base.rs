//! `starloop::base`, as far as the readers need it.

#[path = "../../../src/base/image.rs"]
pub mod image;
#[path = "../../../src/base/leap.rs"]
mod leap;
#[path = "../../../src/base/source_id.rs"]
pub mod source_id;
#[path = "../../../src/base/time.rs"]
pub mod time;
#[path = "../../../src/base/unfinished.rs"]
pub mod unfinished;
#[path = "../../../src/base/units.rs"]
pub mod units;
