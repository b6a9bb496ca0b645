//! The house rules a compiler does not hold: who imports whom, forbidden words, README commands that run.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test stops at the first surprise: unreadable sources are one")]

mod frames_document;
mod imports;
mod paths;
mod readme;
mod source;
mod table;
mod words;
