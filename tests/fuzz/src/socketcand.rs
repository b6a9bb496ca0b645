//! `starloop::link::gateway::socketcand`: its parser.

#[path = "../../../src/link/gateway/socketcand/parser.rs"]
mod parser;

pub use parser::{BusName, Command, ELEMENT_MAX, NAME_MAX, Parser, SocketcandReject};
