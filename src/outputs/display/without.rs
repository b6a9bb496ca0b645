//! The display of a build without the feature `display`: none can be opened, and the error says how to build it.

use crate::display::{
    counters::Counts, error::DisplayError, grey::GreyMaker, monitor::MonitorFacts, params::Params,
    submit_log::Submitted,
};
use base::clock::Clock;
use core::convert::Infallible;
use crossbeam_channel::Receiver;
use frames::sink::{SentFrame, Sink, SinkError, SinkSummary};
use std::{path::Path, sync::Arc};

/// A monitor that shows frames. This build has none.
#[derive(Debug)]
pub struct Display(Infallible);

impl Display {
    /// Fails in this build.
    ///
    /// # Errors
    /// Always: [`DisplayError::NotBuilt`].
    pub fn open(_: &Params, _: [u32; 2], _: GreyMaker, _: Arc<dyn Clock>) -> Result<Self, DisplayError> {
        Err(DisplayError::NotBuilt)
    }

    /// Returns which monitor, driver and format.
    pub fn description(&self) -> &str {
        match self.0 {}
    }

    /// Returns the counts of frames and refreshes so far.
    pub fn counts(&self) -> Counts {
        match self.0 {}
    }

    /// Writes the submit times into a file.
    ///
    /// # Errors
    /// Never, as this build has no display.
    pub fn keep_submits(&mut self, _: &Path) -> Result<(), DisplayError> {
        match self.0 {}
    }

    /// Returns the submit times, for one reader.
    pub fn submits(&self) -> Receiver<Submitted> {
        match self.0 {}
    }

    /// Returns why nothing is shown any more, if so.
    pub fn ended(&self) -> Option<&DisplayError> {
        match self.0 {}
    }
}

impl Sink for Display {
    fn name(&self) -> &'static str {
        match self.0 {}
    }

    fn send(&mut self, _: &SentFrame) -> Result<(), SinkError> {
        match self.0 {}
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        match self.0 {}
    }
}

/// Fails in this build.
///
/// # Errors
/// Always: [`DisplayError::NotBuilt`].
pub fn monitors() -> Result<Vec<MonitorFacts>, DisplayError> {
    Err(DisplayError::NotBuilt)
}
