//! Rules that no compiler holds: the documents agree with the program and the crates, words, lengths of files.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test stops at the first surprise: unreadable sources are one")]

mod architecture;
mod book;
mod command_table;
mod commands;
mod crates;
mod english;
mod events_document;
mod excerpts;
mod features;
mod file_circles;
mod file_length;
mod frames_document;
mod pages;
mod print;
mod quoted_messages;
mod source;
mod test_lists;
mod verdict_words;
mod whole_files;
mod words;
