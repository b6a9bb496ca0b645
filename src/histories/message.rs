//! CCSDS navigation messages (AEM, OEM) in one form, whether they came as KVN or XML.
//!
//! CCSDS 504.0-B (AEM), 502.0-B (OEM), 505.0-B (XML). A message is a version, and segments of metadata and rows of
//! text.

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
    /// Returns the name of its format, for people.
    pub(crate) fn format(&self, kind: Kind) -> String {
        let encoding = match self.encoding {
            Encoding::Kvn => "KVN",
            Encoding::Xml => "XML",
        };
        format!("CCSDS {} {} ({encoding})", kind.name()[0], self.version)
    }
}
