//! One row of `frames.csv`, the table of a captured run's frames: the inputs and the result of each frame.
//!
//! Columns: frame; head; messages that each link brought before it was drawn, `120;118` (all since the run started;
//! empty: nothing was drawn); load, the 64 bits of the number in hexadecimal; degradation; fate; CRC-32 of the pixels
//! that went out (empty: none did); exposure of a commanded camera ([`super::exposed`]). A row of fate `held` has the
//! checksum of the frame that was sent again.
//!
//! Form 1 of the table has no column of heads and one link, form 2 no column of exposures. All are read, form 3 is
//! written. Rows of one head are nearly in the order of frames: a row comes after every row of a frame [`ORDER_FRAMES`]
//! earlier.

use super::exposed;
use crate::runtime::{Exposed, receiver::PORTS_MAX};
use std::io::{self, Write};

/// Expands to the last columns of every form. The column of the degradation keeps its published name.
macro_rules! columns {
    () => {
        "load_bits,rung,fate,crc32"
    };
}
#[cfg(test)]
pub(super) use columns;

/// First line of form 1.
pub(super) const HEADER_OF_ONE: &str = concat!("frame,messages,", columns!());
/// First line of form 2.
const HEADER_OF_TWO: &str = concat!("frame,head,messages,", columns!());
/// First line of form 3.
pub(super) const HEADER: &str = concat!("frame,head,messages,", columns!(), ",exposed");
/// Message for a table with another first line.
pub(super) const WANTED_HEADER: &str = concat!("wanted frame,head,messages,", columns!(), ",exposed");
/// Largest number of rows of later frames before the row of a frame that goes out late.
pub(super) const ORDER_FRAMES: u32 = 1024;

/// Columns of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RowForm {
    /// One head and one link.
    One,
    /// Several heads and links.
    Two,
    /// Several, with exposures.
    Three,
}

impl RowForm {
    /// Returns the form whose first line is this.
    pub fn of_header(line: &str) -> Option<Self> {
        [(HEADER_OF_ONE, Self::One), (HEADER_OF_TWO, Self::Two), (HEADER, Self::Three)]
            .into_iter()
            .find_map(|(header, form)| (header == line).then_some(form))
    }
}

/// Result of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CapturedFate {
    /// It went out in time.
    Sent,
    /// It went out late.
    Late,
    /// The last frame that went out in time was sent again in its place.
    Held,
    /// Nothing went out.
    Dropped,
}

impl CapturedFate {
    const NAMED: [(Self, &'static str); 4] =
        [(Self::Sent, "sent"), (Self::Late, "late"), (Self::Held, "held"), (Self::Dropped, "dropped")];

    fn name(self) -> &'static str {
        Self::NAMED.iter().find(|(fate, _)| *fate == self).map_or("", |(_, name)| name)
    }

    fn of_name(name: &str) -> Option<Self> {
        Self::NAMED.iter().find(|(_, known)| *known == name).map(|(fate, _)| *fate)
    }
}

/// Inputs that a frame was drawn from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrawnFrom {
    /// Messages that each link brought before it was drawn.
    pub messages: [u64; PORTS_MAX],
    /// The load under which it was planned.
    pub load: f64,
    /// Exposure of a commanded camera; `None`: by the camera's file and the frame rate.
    pub exposed: Option<Exposed>,
}

/// One row.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameRow {
    /// Frame number.
    pub frame: u32,
    /// Number of its head, from 0.
    pub head: usize,
    /// Inputs that it was drawn from; `None`: nothing was drawn.
    pub drawn: Option<DrawnFrom>,
    /// Degradation of the frame.
    pub degradation: String,
    /// Result of the frame.
    pub fate: CapturedFate,
    /// CRC-32 of the pixels that went out.
    pub crc32: Option<u32>,
}

impl FrameRow {
    /// Writes the row of a run with this many links.
    pub(super) fn write(&self, links: usize, out: &mut dyn Write) -> io::Result<()> {
        write!(out, "{},{},", self.frame, self.head)?;
        if let Some(DrawnFrom { messages, .. }) = &self.drawn {
            for (number, messages) in messages.iter().take(links.max(1)).enumerate() {
                let before = if number == 0 { "" } else { ";" };
                write!(out, "{before}{messages}")?;
            }
        }
        match self.drawn {
            Some(DrawnFrom { load, .. }) => write!(out, ",{:016x},", load.to_bits())?,
            None => out.write_all(b",,")?,
        }
        write!(out, "{},{},", self.degradation, self.fate.name())?;
        if let Some(crc32) = self.crc32 {
            write!(out, "{crc32:08x}")?;
        }
        out.write_all(b",")?;
        if let Some(exposed) = self.drawn.as_ref().and_then(|drawn| drawn.exposed.as_ref()) {
            exposed::write(exposed, out)?;
        }
        writeln!(out)
    }

    /// Reads a row without its line's end.
    ///
    /// # Errors
    /// The error of the first wrong field.
    pub fn parse(text: &str, form: RowForm) -> Result<Self, &'static str> {
        let mut fields: Vec<&str> = text.split(',').collect();
        let wanted = match form {
            RowForm::One => "wanted six fields",
            RowForm::Two => "wanted seven fields",
            RowForm::Three => "wanted eight fields",
        };
        if form == RowForm::One {
            fields.insert(1, "0");
        }
        if form != RowForm::Three {
            fields.push("");
        }
        let [frame, head, messages, load, degradation, fate, crc32, exposed] = fields.as_slice() else {
            return Err(wanted);
        };
        let crc32 = match *crc32 {
            "" => None,
            crc32 => Some(u32::from_str_radix(crc32, 16).map_err(|_| "crc32: wanted 8 hexadecimal digits")?),
        };
        Ok(Self {
            frame: frame.parse().map_err(|_| "frame: wanted a whole number")?,
            head: head.parse().map_err(|_| "head: wanted a whole number")?,
            drawn: drawn(messages, load, exposed)?,
            degradation: (*degradation).into(),
            fate: CapturedFate::of_name(fate).ok_or("fate: wanted sent, late, held or dropped")?,
            crc32,
        })
    }
}

/// Reads the inputs that a frame was drawn from, if it was drawn.
fn drawn(messages: &str, load: &str, exposed: &str) -> Result<Option<DrawnFrom>, &'static str> {
    if (messages, load, exposed) == ("", "", "") {
        return Ok(None);
    }
    let mut of_links = [0; PORTS_MAX];
    for (number, text) in messages.split(';').enumerate() {
        let place = of_links.get_mut(number).ok_or("messages: wanted the numbers of 8 links at most")?;
        *place = text.parse().map_err(|_| "messages: wanted a whole number for each link, such as 120;118")?;
    }
    let load = u64::from_str_radix(load, 16).map_err(|_| "load_bits: wanted 16 hexadecimal digits")?;
    let load = Some(f64::from_bits(load)).filter(|load| load.is_finite()).ok_or("load_bits: wanted a finite number")?;
    Ok(Some(DrawnFrom { messages: of_links, load, exposed: exposed::parse(exposed)? }))
}
