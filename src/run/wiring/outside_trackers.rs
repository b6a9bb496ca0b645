//! The built-in star trackers beside an external plant: a checked scenario -> a tracker for each head.

use crate::wiring::vehicle_parts::{camera_orders, tracker_params};
use crate::{runtime::OutsideTracker, wiring::error::LoopError};
use base::{refused::Refused, time::Tai};
use config::{OutsideTrackers, Scenario};
use stars::catalog::Catalog;
use std::sync::Arc;
use testbed::tracker::{GuideStars, TrackerParams};

/// Returns the tracker of each head, if the scenario has any; equal trackers share one list of guide stars.
pub(super) fn outside_trackers(scenario: &Scenario, start: Tai) -> Result<Vec<Option<OutsideTracker>>, LoopError> {
    let Some(OutsideTrackers { delay, tag_error, most_stars, commands }) = scenario.trackers else {
        return Ok(Vec::new());
    };
    let catalog = Catalog::built_in().map_err(|why| Refused(format!("catalog: {why}")))?;
    let mut guides: Vec<(TrackerParams, Arc<GuideStars>)> = Vec::new();
    let mut trackers = Vec::with_capacity(scenario.bench.head_count());
    for number in 0..scenario.bench.head_count() {
        let bench = scenario.bench.of_head(number);
        let params = tracker_params(&bench.camera, most_stars);
        let known = guides.iter().find(|(known, _)| *known == params).map(|(_, guide)| Arc::clone(guide));
        let guide = match known {
            Some(guide) => guide,
            None => {
                let guide = Arc::new(GuideStars::new(&catalog, &params, start)?);
                guides.push((params, Arc::clone(&guide)));
                guide
            }
        };
        let mut tracker = OutsideTracker::new(params, guide, delay, tag_error);
        tracker.set_orders(camera_orders(commands, &bench));
        trackers.push(Some(tracker));
    }
    Ok(trackers)
}
