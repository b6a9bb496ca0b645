//! CCSDS messages as lines of `KEY = VALUE` (KVN): text -> [`Message`].

use crate::error::{HistoryError, Source};
use crate::message::{Encoding, Entry, Kind, Message, Row, Segment};
use std::borrow::Cow;

/// Where in a message a line is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    Header,
    Metadata,
    /// After metadata: rows of an orbit, or the beginning of a block.
    Body,
    /// Between DATA_START and DATA_STOP.
    Data,
    /// Between COVARIANCE_START and COVARIANCE_STOP, which are passed over.
    Covariance,
}

/// Takes the lines of a message apart.
pub(crate) fn message<'a>(source: &Source<'a>, kind: Kind) -> Result<Message<'a>, HistoryError> {
    let mut reader = Reader { source: *source, kind, place: Place::Header, version: None, segments: Vec::new() };
    let mut offset = 0;
    for line in source.text.split_inclusive('\n') {
        reader.take(line.trim_start_matches('\u{feff}').trim(), offset)?;
        offset += line.len();
    }
    let ends = match reader.place {
        Place::Header | Place::Body => None,
        Place::Metadata => Some("META_STOP"),
        Place::Data => Some("DATA_STOP"),
        Place::Covariance => Some("COVARIANCE_STOP"),
    };
    if let Some(wanted) = ends {
        return Err(source.refuse(
            source.text.len(),
            "the end of the file",
            &format!("{wanted}: the file is cut short"),
        ));
    }
    let key = kind.version_key();
    let version = reader.version.ok_or_else(|| source.whole(format!("no line {key} = ...; wanted it first")))?;
    Ok(Message { encoding: Encoding::Kvn, version, segments: reader.segments })
}

struct Reader<'a> {
    source: Source<'a>,
    kind: Kind,
    place: Place,
    version: Option<&'a str>,
    segments: Vec<Segment<'a>>,
}

impl<'a> Reader<'a> {
    fn take(&mut self, line: &'a str, offset: usize) -> Result<(), HistoryError> {
        let is_comment =
            line == "COMMENT" || line.strip_prefix("COMMENT").is_some_and(|rest| rest.starts_with([' ', '\t']));
        if line.is_empty() || is_comment {
            return Ok(());
        }
        match self.place {
            Place::Header => self.header(line, offset),
            Place::Metadata if line == "META_STOP" => self.go(Place::Body),
            Place::Metadata => self.metadata(line, offset),
            Place::Body => self.body(line, offset),
            Place::Data if line == "DATA_STOP" => self.go(Place::Body),
            Place::Data => self.row(line, offset),
            Place::Covariance if line == "COVARIANCE_STOP" => self.go(Place::Body),
            Place::Covariance => Ok(()),
        }
    }

    fn go(&mut self, place: Place) -> Result<(), HistoryError> {
        self.place = place;
        Ok(())
    }

    fn header(&mut self, line: &'a str, offset: usize) -> Result<(), HistoryError> {
        if line == "META_START" {
            return self.segment(offset);
        }
        let entry = self.entry(line, offset, "KEY = VALUE or META_START")?;
        if self.version.is_none() {
            let key = self.kind.version_key();
            if entry.key != key {
                return Err(self.source.refuse(offset, line, &format!("{key} = ... as the first line")));
            }
            self.version = Some(entry.value);
        }
        Ok(())
    }

    fn segment(&mut self, offset: usize) -> Result<(), HistoryError> {
        self.segments.push(Segment { offset, ..Segment::default() });
        self.go(Place::Metadata)
    }

    fn metadata(&mut self, line: &'a str, offset: usize) -> Result<(), HistoryError> {
        let entry = self.entry(line, offset, "KEY = VALUE or META_STOP")?;
        let Some(segment) = self.segments.last_mut() else { return Ok(()) };
        if segment.metadata.iter().any(|known| known.key == entry.key) {
            return Err(self.source.refuse(offset, line, &format!("{} once in a segment", entry.key)));
        }
        segment.metadata.push(entry);
        Ok(())
    }

    fn body(&mut self, line: &'a str, offset: usize) -> Result<(), HistoryError> {
        match (line, self.kind) {
            ("META_START", _) => self.segment(offset),
            ("DATA_START", Kind::Attitude) => self.go(Place::Data),
            ("COVARIANCE_START", Kind::Orbit) => self.go(Place::Covariance),
            (_, Kind::Orbit) => self.row(line, offset),
            (_, Kind::Attitude) => Err(self.source.refuse(offset, line, "DATA_START or META_START")),
        }
    }

    fn row(&mut self, line: &'a str, offset: usize) -> Result<(), HistoryError> {
        if let Some(segment) = self.segments.last_mut() {
            segment.rows.push(Row { text: Cow::Borrowed(line), offset });
        }
        Ok(())
    }

    fn entry(&self, line: &'a str, offset: usize, wanted: &str) -> Result<Entry<'a>, HistoryError> {
        let (key, value) = line.split_once('=').ok_or_else(|| self.source.refuse(offset, line, wanted))?;
        // A unit in brackets may follow.
        let value = value.trim();
        let value = value.split_once(" [").map_or(value, |(value, _)| value.trim_end());
        Ok(Entry { key: key.trim(), value, offset })
    }
}
