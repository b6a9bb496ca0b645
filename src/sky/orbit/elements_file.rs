//! A text of mean elements in any form -> the set of one object that is nearest in time.

use super::{TleOrbit, omm};
use super::{
    omm_forms::form_of,
    tle::{LINE_LENGTH, is_line, no_such_object},
};
use base::{refused::Refused, time::Tai};

/// Mark of UTF-8, with which some programs begin a file.
const BYTE_ORDER_MARK: char = '\u{feff}';

/// Returns whether a text is meant as elements: a message of mean elements, or lines that begin with 1 and 2, whatever
/// else is wrong with them, or one of the two with its whole length.
pub fn is_elements(text: &str) -> bool {
    let text = text.trim_start_matches(BYTE_ORDER_MARK);
    let has_line = |number: char| text.lines().any(|line| is_line(number, line) && !line.contains(','));
    let is_whole = |line: &str| {
        line.trim_end().len() == LINE_LENGTH && !line.contains(',') && (is_line('1', line) || is_line('2', line))
    };
    form_of(text).is_some() || (has_line('1') && has_line('2')) || text.lines().any(is_whole)
}

impl TleOrbit {
    /// Reads the object with `norad_id`, or the only one, of a text: pairs of element lines, or an OMM as JSON, KVN, XML
    /// or CSV. Of several sets of the object the one whose epoch is nearest to `near` is taken.
    ///
    /// # Errors
    /// When the text has no such object, or several and none is asked for, or other lines than pairs and their titles;
    /// or when a set of the object is damaged or no orbit that SGP4 follows, with its place.
    pub fn read(text: &str, norad_id: Option<u64>, near: Tai) -> Result<Self, Refused> {
        let text = text.trim_start_matches(BYTE_ORDER_MARK);
        let sets = match form_of(text) {
            Some(form) => omm::sets(text, form, norad_id)?,
            None => Self::sets_of_lines(text, norad_id)?,
        };
        let days = |set: &Self| set.days_from_epoch(near).abs();
        let nearest = sets.into_iter().min_by(|a, b| days(a).total_cmp(&days(b)));
        nearest.ok_or_else(|| no_such_object(norad_id, 0))
    }
}
