//! `[plant] kind = "file"`: attitudes from a file, and how they are laid upon the run. Tests: `plant_tests`.

use crate::timing::{StartTime, Timing};
use crate::{check::Checker, error::ConfigError, kernels::Kernels, kernels::refused, key::Given, plant::PlantKeys};
use base::time::{Span, Tai};
use histories::{AttitudeHistory, Sense, Times, read};
use std::sync::Arc;
use testbed::flight_computer::FileProfile;

/// Attitudes of a file, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct FilePlant {
    /// The attitudes.
    pub history: Arc<AttitudeHistory>,
    /// Which instant of the run its times belong to.
    pub begins: Begins,
    /// True: the body rests before the first and after the last row; false: no attitude is sent there.
    pub rests_outside: bool,
    /// Whether the file of the run states what is outside, rather than the format of the attitudes.
    pub outside_is_given: bool,
}

/// How the times of a file are placed on the clock of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Begins {
    /// Its zero, or its first row where its times are absolute, is the first exposure.
    FirstExposure,
    /// Its own times are those of the run.
    Utc,
}

impl FilePlant {
    /// Reads the file and checks that the run is within it.
    pub(super) fn check(keys: &PlantKeys, timing: &Timing, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let given = keys.attitude();
        let sense = keys.sense().optional(check)?;
        let kernels = Kernels { file: keys.attitude(), texts: keys.kernels(), naif_id: keys.naif_id() };
        let history = match kernels.attitudes(check)? {
            Some(_) if sense.is_some() => {
                let wanted = "no sense: a kernel states its own frames";
                return Err(keys.sense().invalid("given", wanted, check));
            }
            Some(history) => history,
            None => {
                let (text, path) = text_of(&given, check)?;
                read::attitudes(&path, &text, sense).map_err(|error| refused(&given, &error, check))?
            }
        };
        let usual = match history.times {
            Times::Absolute => "utc",
            Times::FromZero => "first_exposure",
        };
        let begins = keys.begins().or_silently(usual).check(check)?;
        if begins == Begins::Utc && history.times == Times::FromZero {
            let wanted = "\"first_exposure\": the times of the file count from a zero of its own";
            return Err(keys.begins().invalid("\"utc\"", wanted, check));
        }
        let usual = if history.times == Times::FromZero { "rest" } else { "none" };
        let outside = keys.outside().or_silently(usual).check(check)?;
        let outside_is_given = keys.outside().is_given();
        let plant = Self { history: Arc::new(history), begins, rests_outside: outside, outside_is_given };
        plant.check_overlap(&given, timing, check)?;
        Ok(plant)
    }

    /// Refuses a file none of whose attitudes is within the run.
    fn check_overlap(
        &self,
        given: &Given<'_, String>,
        timing: &Timing,
        check: &Checker<'_>,
    ) -> Result<(), ConfigError> {
        let (StartTime::At(start), Begins::Utc) = (timing.start, self.begins) else { return Ok(()) };
        let end = start + Span::from_s(timing.duration_s) + LEAD + timing.phase;
        let [first, last] = self.history.span_ns().map(Tai::from_ns);
        if last >= start && first <= end {
            return Ok(());
        }
        let advice = format!(
            "set timing.start_utc = \"{}\", a second before the file begins, or plant.begins = \"first_exposure\"",
            (first - LEAD).to_rfc3339()
        );
        let wanted = format!("a time of the run, from {start} to {end}");
        Err(check.invalid(&given.key(), format!("attitudes from {first} to {last}"), wanted, &advice))
    }

    /// Returns the attitudes on the clock of a run whose first exposure is at `zero`.
    pub fn profile(&self, zero: Tai) -> FileProfile {
        let zero_ns = match (self.begins, self.history.times) {
            (Begins::Utc, _) => zero.ns(),
            (Begins::FirstExposure, Times::FromZero) => 0,
            (Begins::FirstExposure, Times::Absolute) => self.history.span_ns()[0],
        };
        FileProfile { history: Arc::clone(&self.history), zero, zero_ns, rests_outside: self.rests_outside }
    }
}

/// From the start of the clock to the first exposure.
const LEAD: Span = Span::from_ms(1000);

/// Returns the text of the file that a key names, and how messages call it.
pub(super) fn text_of(given: &Given<'_, String>, check: &Checker<'_>) -> Result<(String, String), ConfigError> {
    let path = given.raw().ok_or_else(|| given.missing("the path of a file", check))?;
    let path = check.document.data_beside(path);
    let text = read::text_of(&path).map_err(|error| refused(given, &error, check))?;
    Ok((text, path.display().to_string()))
}

/// Sense of a table, by its names in files.
pub(super) const SENSES: [(&str, Sense); 2] = Sense::NAMES;
