//! `starloop::link::gateway::slcan`: its parser.

#[path = "../../../src/link/gateway/slcan/parser.rs"]
mod parser;

pub use parser::{Command, LINE_MAX, Parser, SlcanReject};
