//! How far a command has come: a line on a terminal that is drawn over; elsewhere nothing, or a line now and then.

use std::io::{IsTerminal, Write};

/// One line on standard error.
pub(super) struct ProgressLine {
    is_on_terminal: bool,
}

impl ProgressLine {
    pub(super) fn new() -> Self {
        Self { is_on_terminal: std::io::stderr().is_terminal() }
    }

    /// Draws over the line of a terminal; silent elsewhere.
    pub(super) fn show(&self, text: &str) {
        if self.is_on_terminal {
            let _a_closed_terminal_is_no_error = write!(std::io::stderr(), "\r{text:<79}");
        }
    }

    /// Draws over the line of a terminal; elsewhere prints a line of its own when one `is_due`.
    pub(super) fn show_or_print(&self, text: &str, is_due: bool) {
        self.show(text);
        if is_due && !self.is_on_terminal {
            eprintln!("{text}");
        }
    }

    pub(super) fn clear(&self) {
        self.show("");
        if self.is_on_terminal {
            let _a_closed_terminal_is_no_error = write!(std::io::stderr(), "\r");
        }
    }
}
