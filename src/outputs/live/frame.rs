//! The facts of one frame, as the state and a look back give them.

use crate::live::latest::Picture;
use frames::sink::facts::{FactSource, json_keys};
use serde_json::{Map, Value, json};

/// Returns the facts of a frame, and when it came.
pub(super) fn frame_of(picture: &Picture, age_s: f64) -> Map<String, Value> {
    let of_view =
        [("count", json!(picture.count)), ("taken_utc", json!(picture.taken.to_rfc3339())), ("age_s", json!(age_s))];
    let mut frame = json_keys(&FactSource::of_frame(&picture.frame, None), |row| row.live);
    frame.extend(of_view.map(|(key, value)| (key.to_owned(), value)));
    frame
}
