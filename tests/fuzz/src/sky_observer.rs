//! `starloop::sky::observer`: the state alone.

pub use crate::sky::state::BarycentricState;
