//! In which state an instance is, and which calls it takes (section 2.3 of the standard, without event mode).

use crate::error::FmuError;
use base::refused::Refused;

/// Life of an instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum State {
    /// Made: parameters may be set.
    Instantiated,
    /// Between enter and exit of initialisation.
    Initialising,
    /// Steps are taken.
    Stepping,
    /// Over: outputs may be read.
    Terminated,
    /// A call failed: it may be reset or freed.
    Failed,
}

impl State {
    const fn words(self) -> &'static str {
        match self {
            Self::Instantiated => "before initialisation",
            Self::Initialising => "during initialisation",
            Self::Stepping => "between steps",
            Self::Terminated => "after the end",
            Self::Failed => "after an error",
        }
    }

    /// Refuses a call that this state does not take.
    pub(crate) fn wants(self, states: &[Self], function: &'static str) -> Result<(), FmuError> {
        if states.contains(&self) {
            return Ok(());
        }
        let wanted = states.first().copied().map_or("another state", Self::words);
        Err(FmuError::from(Refused(format!("{function} was called {state}; wanted {wanted}", state = self.words()))))
    }
}
