//! Errors of the system for a gateway.

use crate::LinkError;

/// Returns the error of a link that could not do something.
pub(super) fn system(link: &str, doing: &'static str, source: std::io::Error, advice: &'static str) -> LinkError {
    LinkError::System { link: link.into(), doing, source, advice }
}
