//! Common parts of the fuzz targets: means to try the readers of `base`, `link`, `sky`, `stars`, `imports` and
//! `outputs`.
//!
//! These crates are dependencies as they are, in a workspace of their own: its compiler flags count what every branch
//! does.
//!
//! | target | reads | asserts |
//! |---|---|---|
//! | `can_decode` | CAN frames | what is accepted is sent again as the same bytes; no accepted corruption |
//! | `serial_resync` | serial bytes | a packet is received whatever came before; no accepted corruption; no allocation |
//! | `slcan`, `socketcand` | text of clients | the same for any chunks, as an independent reading has it; no allocation |
//! | `captures` | candump, pcapng | errors have a place, bounded memory; what was written is read, cut off it is a prefix |
//! | `network_camera` | GVCP datagrams | one answer at most, of bounded length; a possible stream, changed by its controller alone |
//! | `layer` | star layers | bounded memory; damage is reported, or all stars are read and are the layer's; what was written is read |
//! | `star_lines` | CSV, Hipparcos, Tycho-2 | bounded memory; every line is a star, or counted, or the whole is an error |
//! | `elements` | two-line elements, OMM | the object asked for, and no other passed over; states are finite and above ground |
//! | `histories` | AEM, OEM, STK files, tables | bounded memory; times rise, attitudes are rotations; what was written is read |
//! | `tracker_commands` | requests of star trackers' clients | the same for any chunks, orders within limits, answers that can be read |
//! | `tracker_telemetry` | packets of star trackers | the same for any chunks, attitudes of norm 1, a device is read after noise |
//! | `session` | commands, table cells | the answers and tables of a model |

#![forbid(unsafe_code)]

/// Deliberate faults: does the fuzzer see them?
pub mod control;
/// Errors that a CRC-16 must detect, and that CRC written afresh.
pub mod damage;
/// Numbers from the front of the fuzzer's bytes.
pub mod input;
/// Legal messages from any bytes.
pub mod samples;
/// Files for readers that open a path.
pub mod scratch;

pub use input::Input;
