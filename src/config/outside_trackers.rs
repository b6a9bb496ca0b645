//! `[plant.tracker]` of a plant outside: the built-in star trackers beside it.

use crate::plant::{PlantKeys, TrackerCommands};
use crate::{bench::Bench, check::Checker, error::ConfigError, key::Section};
use base::time::Span;

/// The built-in star trackers beside a plant outside, one for each head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutsideTrackers {
    /// How long a tracker thinks: end of readout to attitude.
    pub delay: Span,
    /// Error of the trackers' time tags, unknown to their readers.
    pub tag_error: Span,
    /// Most stars a tracker measures in a frame.
    pub most_stars: usize,
    /// Commands of the trackers to their cameras.
    pub commands: TrackerCommands,
}

impl Default for OutsideTrackers {
    /// Returns the values of a `[plant.tracker]` without keys.
    fn default() -> Self {
        Self { delay: Span::from_ms(50), tag_error: Span::ZERO, most_stars: 40, commands: TrackerCommands::default() }
    }
}

impl PlantKeys {
    /// Reads the trackers beside a plant outside, if it has any.
    pub(super) fn outside_trackers(
        &self,
        bench: &Bench,
        check: &mut Checker<'_>,
    ) -> Result<Option<OutsideTrackers>, ConfigError> {
        let Some(tracker) = self.tracker.as_ref() else { return Ok(None) };
        check.unused(
            "plant.tracker",
            !bench.is_lockstep(),
            "a plant outside in lockstep, without a bus that leads out",
        )?;
        let heads = || (0..bench.head_count()).map(|number| bench.of_head(number));
        if heads().any(|head| head.camera.distortion.polynomial.is_some()) {
            let advice =
                "the built-in tracker knows no other distortion: leave plant.tracker out, or choose another camera";
            let wanted = "a camera whose distortion.model is \"brown-conrady\"";
            return Err(check.invalid("plant.tracker", "given", wanted, advice));
        }
        let tracker = tracker.at("plant.tracker");
        let delay = tracker.delay_ms().ms(check)?;
        let tag_error = tracker.tag_error_ms().ms(check)?;
        let most_stars = tracker.stars().check(check)?;
        let commands = TrackerCommands::check(&tracker, check)?;
        Ok(Some(OutsideTrackers { delay, tag_error, most_stars, commands }))
    }
}
