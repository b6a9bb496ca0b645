//! Text -> [`Message`], by the reader of its encoding.

use crate::error::{HistoryError, Source};
use crate::message::{Kind, Message};
use crate::{message_kvn, message_xml};

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
}

fn check(source: &Source<'_>, message: &Message<'_>) -> Result<(), HistoryError> {
    if message.segments.is_empty() {
        return Err(source.whole("no segment; wanted META_START ... META_STOP and rows of data, or <segment> in XML"));
    }
    Ok(())
}
