//! Attitude histories and orbits in files: CSV, CCSDS AEM and OEM (KVN and XML), STK `.a` and `.e`.
//!
//! A reader turns a text into an [`AttitudeHistory`] or an [`OrbitHistory`]: segments of states by rising time, in ICRF
//! axes, on the count of TAI or from a zero of their own. Between the states of one segment the file's own
//! interpolation applies; between segments, and outside them, nothing is available. A writer does the reverse.
//!
//! Own readers, because no library fits: the crate `ccsds-ndm` 0.0.9 is young and pulls in a framework of its own, the
//! Python package of that name refuses AEM version 2 as KVN, `anise` has no attitude messages, and none reads STK's
//! files.
//!
//! | module | subject |
//! |---|---|
//! | [`read`] | which reader a file needs; bounds of its size |
//! | `message` | one form of CCSDS messages; KVN and XML to it |
//! | `aem`, `aem_row`, `oem` | that form to attitudes and orbits |
//! | `stk` | STK's attitude and ephemeris files |
//! | `csv`, `csv_table` | tables with a header, and rows without one |
//! | `parquet_table` | tables in Parquet files (feature `parquet`) |
//! | `findings` | rates and velocities beside differences of rows; gaps, early ends |
//! | `epoch`, `reference_axes` | time systems; axes, and the frame bias |
//! | [`attitude`], [`orbit`] | the histories, their interpolation and its error |
//! | `chebyshev` | series of SPICE kernels |
//! | `spice` | SPICE kernels: CK and SPK, with their clocks (feature `spice`) |
//! | [mod@write] | all formats out |

mod aem;
mod aem_row;
pub mod attitude;
mod attitude_methods;
#[cfg_attr(not(feature = "spice"), allow(dead_code, reason = "only SPICE kernels have series"))]
mod chebyshev;
mod csv;
mod csv_table;
mod epoch;
mod error;
mod findings;
mod message;
mod metadata;
mod newton;
mod oem;
pub mod orbit;
#[cfg(feature = "parquet")]
mod parquet_table;
pub mod read;
mod reference_axes;
mod segments;
#[cfg(feature = "spice")]
pub mod spice;
mod stk;
#[cfg(test)]
mod tests;
pub mod write;

pub use attitude::{AttitudeHistory, AttitudeSegment, Times};
pub use attitude_methods::{AttitudeInterpolation, AttitudeMotion, AttitudeState};
pub use csv::Sense;
pub use error::HistoryError;
pub use orbit::{Centre, OrbitHistory, OrbitInterpolation, OrbitSegment, OrbitState};
