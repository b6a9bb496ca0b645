//! Packets -> a capture file.

use super::pcapng::PcapngWriter;
use super::{CaptureError, CaptureFormat, CapturedPacket, candump};
use crate::Packet;
use std::io::Write;

/// Writes packets in a format of choice. The output should be buffered.
pub struct CaptureWriter<W: Write> {
    form: Form<W>,
}

enum Form<W: Write> {
    Candump(W),
    Pcapng(PcapngWriter<W>),
}

impl<W: Write> CaptureWriter<W> {
    /// Begins a capture.
    ///
    /// # Errors
    /// When its beginning cannot be written.
    pub fn new(out: W, format: CaptureFormat) -> Result<Self, CaptureError> {
        let form = match format {
            CaptureFormat::Candump => Form::Candump(out),
            CaptureFormat::Pcapng => Form::Pcapng(PcapngWriter::new(out).map_err(CaptureError::Write)?),
        };
        Ok(Self { form })
    }

    /// Writes one packet.
    ///
    /// # Errors
    /// When the format has no form for it, or it cannot be written.
    pub fn write(&mut self, captured: &CapturedPacket) -> Result<(), CaptureError> {
        match (&mut self.form, &captured.packet) {
            (Form::Candump(out), Packet::Can(frame)) => {
                candump::write_line(out, captured, frame).map_err(CaptureError::Write)
            }
            (Form::Candump(_), Packet::Serial(_) | Packet::Datagram(_)) => Err(CaptureError::NotCan),
            (Form::Pcapng(writer), _) => writer.write(captured).map_err(CaptureError::Write),
        }
    }

    /// Hands everything to the system.
    ///
    /// # Errors
    /// When it does not take it.
    pub fn flush(&mut self) -> Result<(), CaptureError> {
        let out: &mut dyn Write = match &mut self.form {
            Form::Candump(out) => out,
            Form::Pcapng(writer) => writer.out(),
        };
        out.flush().map_err(CaptureError::Write)
    }
}
