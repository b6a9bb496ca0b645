//! Frames and the records about them.
//!
//! * [`sink`]: trait `Sink`: recorder (FITS, SER, PNG, tables), shared memory, several at once;
//! * [`report`]: stage histograms, timing budget, run summary, tables, charts as SVG;
//! * [`camera_control`]: settings of a camera that change from exposure to exposure, and their commands;
//! * [`zip_archive`]: files in a zip archive.

pub mod camera_control;
pub mod report;
pub mod sink;
pub mod zip_archive;
