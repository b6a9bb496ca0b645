//! The refusal of a scene.

use base::refused::Refused;

/// A layer of stars could not be read.
pub(crate) fn stars(why: Refused) -> Refused {
    Refused(format!("stars: {why}"))
}

/// The observer's orbit could not be computed.
pub(crate) fn observer(why: Refused) -> Refused {
    Refused(format!("observer: {why}"))
}
