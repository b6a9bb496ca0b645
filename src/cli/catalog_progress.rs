//! How far a command on catalogs has come, on a terminal.

use std::io::{IsTerminal, Write};

/// One line on a terminal that is drawn over; silent elsewhere.
pub(super) struct ProgressLine {
    is_on: bool,
}

impl ProgressLine {
    pub(super) fn new() -> Self {
        Self { is_on: std::io::stderr().is_terminal() }
    }

    pub(super) fn show(&self, text: &str) {
        if self.is_on {
            let _a_closed_terminal_is_no_error = write!(std::io::stderr(), "\r{text:<79}");
        }
    }

    pub(super) fn clear(&self) {
        self.show("");
        if self.is_on {
            let _a_closed_terminal_is_no_error = write!(std::io::stderr(), "\r");
        }
    }
}
