//! Properties of the codecs: what is sent is what is read, damage is refused, nothing panics.

#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

mod arbitrary_input;
mod damage;
mod round_trip;
mod samples;
mod torn_groups;
