//! CCSDS navigation messages (AEM, OEM) in one form, whether they came as KVN or XML.
//!
//! CCSDS 504.0-B (AEM), 502.0-B (OEM), 505.0-B (XML). A message is a version, and segments of metadata and rows of
//! text.

use crate::error::{HistoryError, Source};
use crate::message_kvn;
use crate::message_xml;
use std::borrow::Cow;

/// `KEY = VALUE` of a header or of metadata.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Entry<'a> {
    pub(crate) key: &'a str,
    pub(crate) value: &'a str,
    /// Byte of the text, for error messages.
    pub(crate) offset: usize,
}

/// One row of data: words separated by blanks, the epoch first.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Row<'a> {
    pub(crate) text: Cow<'a, str>,
    pub(crate) offset: usize,
}

/// One segment.
#[derive(Debug, Default)]
pub(crate) struct Segment<'a> {
    pub(crate) metadata: Vec<Entry<'a>>,
    pub(crate) rows: Vec<Row<'a>>,
    /// Where it begins.
    pub(crate) offset: usize,
}

/// Subject of a message: attitude or orbit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Attitude,
    Orbit,
}

/// How a message is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Encoding {
    Kvn,
    Xml,
}

/// A message whose values are not yet read.
#[derive(Debug)]
pub(crate) struct Message<'a> {
    pub(crate) encoding: Encoding,
    /// `1.0`, `2.0`, as written.
    pub(crate) version: &'a str,
    pub(crate) segments: Vec<Segment<'a>>,
}

impl Kind {
    /// Returns the key of its version, by which a message is known.
    pub(crate) fn version_key(self) -> &'static str {
        match self {
            Self::Attitude => "CCSDS_AEM_VERS",
            Self::Orbit => "CCSDS_OEM_VERS",
        }
    }

    /// Returns its name and the name of its XML root.
    pub(crate) fn name(self) -> [&'static str; 2] {
        match self {
            Self::Attitude => ["AEM", "aem"],
            Self::Orbit => ["OEM", "oem"],
        }
    }
}

impl Message<'_> {
    /// Takes a message apart and hands it to `read`; a text that begins with `<` is XML.
    pub(crate) fn with<T>(
        source: &Source<'_>,
        kind: Kind,
        read: impl FnOnce(&Message<'_>) -> Result<T, HistoryError>,
    ) -> Result<T, HistoryError> {
        if source.text.trim_start_matches('\u{feff}').trim_start().starts_with('<') {
            message_xml::with_message(source, kind, |message| check(source, message).and_then(|()| read(message)))
        } else {
            let message = message_kvn::message(source, kind)?;
            check(source, &message)?;
            read(&message)
        }
    }

    /// Returns the name of its format, for people.
    pub(crate) fn format(&self, kind: Kind) -> String {
        let encoding = match self.encoding {
            Encoding::Kvn => "KVN",
            Encoding::Xml => "XML",
        };
        format!("CCSDS {} {} ({encoding})", kind.name()[0], self.version)
    }
}

fn check(source: &Source<'_>, message: &Message<'_>) -> Result<(), HistoryError> {
    if message.segments.is_empty() {
        return Err(source.whole("no segment; wanted META_START ... META_STOP and rows of data, or <segment> in XML"));
    }
    Ok(())
}
