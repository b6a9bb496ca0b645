//! Frames and the records about them.
//!
//! * [`sink`]: trait `Sink`: recorder (FITS, SER, PNG, tables), shared memory, several at once;
//! * [`report`]: stage histograms, timing budget, run summary, tables, charts as SVG.

pub mod report;
pub mod sink;
