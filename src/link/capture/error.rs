//! Why a capture file cannot be written or read.

use base::time::Span;

/// A capture file that cannot be written, or not read any further.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// The system refused to write.
    #[error("capture cannot be written: {0}")]
    Write(#[source] std::io::Error),
    /// A packet that the format has no form for.
    #[error(
        "capture: got a packet of a serial line or of a plain link, wanted CAN: a candump log holds CAN only; use pcapng"
    )]
    NotCan,
    /// The system refused to read.
    #[error("capture cannot be read at byte {offset}: {source}")]
    Read {
        /// Bytes read before.
        offset: u64,
        /// Error of the system.
        source: std::io::Error,
    },
    /// The thread that writes broke down.
    #[error("capture: the thread that writes it broke down; the file ends somewhere before the run did")]
    WriterLost,
    /// The thread that writes blocks.
    #[error(
        "{file} cannot be written: nothing was written for {:.1} s and the rest was given up: is the disk still there?",
        patience.s()
    )]
    GivenUp {
        /// Name of the file of the capture.
        file: &'static str,
        /// Time that was waited.
        patience: Span,
    },
    /// The file is empty.
    #[error("capture: got an empty file, wanted a candump log or pcapng")]
    Empty,
    /// The older format.
    #[error("capture: got a classic pcap file, wanted pcapng or a candump log; convert it: editcap -F pcapng IN OUT")]
    ClassicPcap,
    /// A line that is not a line of a candump log.
    #[error("capture line {line}: {why}; got \"{text}\", wanted such as (1772366400.123456789) can0 123#DEADBEEF")]
    Line {
        /// Line, from 1.
        line: u64,
        /// Fault of the line.
        why: &'static str,
        /// Its beginning.
        text: String,
    },
    /// A pcapng block that is damaged.
    #[error("capture block at byte {offset}: {why}")]
    Block {
        /// Place of the block's start.
        offset: u64,
        /// Fault of the block, with what was wanted and got.
        why: String,
    },
    /// The file ends inside a line or block, as after a power cut: everything before it was read.
    #[error("capture is cut off at {place}: everything before it was read")]
    CutOff {
        /// Line or byte.
        place: String,
    },
}
