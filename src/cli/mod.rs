//! (room being built)

pub mod catalog;
