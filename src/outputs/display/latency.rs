//! Submit time -> photon time: the latency of a display, measured by a photodiode on the marker patch.
//!
//! Submit time is when a frame was handed to the graphics system. A display has no clock that reports when its light
//! came; the delay from submit to light is known from many measured flips of the marker, or from the maker. Prediction:
//! photon time = submit time + median delay + the place of the row in the scan. Known: the median and the spread of the
//! measured runs. Not known: the delay of one frame; a queue that is one refresh longer today (a compositor, a driver's
//! setting) shows as a whole refresh, and only the patch can show that. A flip has one row: [`flips_of`] finds the edge
//! of each submit time that a run or `starloop display flip` kept. Input: CSV with `submit_s,edge_s`, one row a flip,
//! seconds of one clock; no edge: leave `edge_s` empty. Tests below.

use base::{least_squares::median, refused::Refused, time::Span};
use serde::{Deserialize, Serialize};
use std::io::Read;

/// Fewest flips with an edge.
pub const FEWEST_EDGES: usize = 10;
/// A delay beyond this is an edge of another flip, seconds.
const LONGEST_S: f64 = 1.0;
/// Shortest time between flips, s: longer than any latency, so that each edge belongs to the flip before it.
pub const APART_S: f64 = 0.1;
/// Largest share of flips without an edge.
const MOST_MISSED: f64 = 0.1;

/// Source of a latency.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LatencySource {
    /// A person stated it.
    Given,
    /// Measured on the marker patch.
    Measured,
}

/// Delay from submit to light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Latency {
    /// Source of the latency.
    pub source: LatencySource,
    /// Median delay at the marker, ns.
    pub median_ns: i64,
    /// From the 5 % to the 95 % quantile, ns.
    pub spread_ns: i64,
    /// Least and most, ns.
    pub range_ns: [i64; 2],
    /// Flips that were seen.
    pub flips: usize,
    /// Flips without an edge.
    pub missed: usize,
    /// From the first row's light to the last row's, ns; 0: all rows at once, or not known.
    pub scan_ns: i64,
    /// Row of the marker over the number of rows, 0 to 1.
    pub marker_row_share: f64,
}

/// One flip of the marker: a line of the table.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Flip {
    /// When it was submitted, seconds.
    pub submit_s: f64,
    /// When the photodiode saw it, seconds of the same clock; `None`: it did not.
    pub edge_s: Option<f64>,
}

/// Returns the edge of each flip: the first after its submit and before the next one's. Flips with another one within
/// [`APART_S`], before or after, are left out, as an edge may be of either. Times in seconds of one clock, in any
/// order.
///
/// # Errors
/// When too few flips are left.
pub fn flips_of(submits_s: &[f64], edges_s: &[f64]) -> Result<Vec<Flip>, Refused> {
    let sorted = |times: &[f64]| {
        let mut times = times.to_vec();
        times.sort_by(f64::total_cmp);
        times
    };
    let (submits, edges) = (sorted(submits_s), sorted(edges_s));
    let next_of = |i: usize| submits.get(i + 1).copied().unwrap_or(f64::INFINITY);
    let before = |i: usize| i.checked_sub(1).map_or(f64::NEG_INFINITY, |before| submits[before]);
    let is_alone = |i: &usize| next_of(*i) - submits[*i] >= APART_S && submits[*i] - before(*i) >= APART_S;
    let alone = (0..submits.len()).filter(is_alone);
    let flips: Vec<Flip> = alone
        .map(|i| {
            let first = edges.partition_point(|edge_s| *edge_s < submits[i]);
            let edge_s = edges.get(first).copied().filter(|edge_s| *edge_s < next_of(i));
            Flip { submit_s: submits[i], edge_s }
        })
        .collect();
    if flips.len() < FEWEST_EDGES {
        return Err(Refused(format!(
            "marker flips: wanted at least {FEWEST_EDGES} that the next one follows after {APART_S} s or more, got {apart} of \
         {flips}; an edge could be of another flip: `starloop display flip` flips slowly",
            apart = flips.len(),
            flips = submits.len()
        )));
    }
    Ok(flips)
}

impl Latency {
    /// Returns a latency that a person states, with its full spread.
    pub fn given(latency: Span, spread: Span) -> Self {
        let half = spread.ns() / 2;
        let range_ns = [latency.ns() - half, latency.ns() + half];
        let (median_ns, spread_ns) = (latency.ns(), spread.ns());
        Self {
            source: LatencySource::Given,
            median_ns,
            spread_ns,
            range_ns,
            flips: 0,
            missed: 0,
            scan_ns: 0,
            marker_row_share: 0.0,
        }
    }

    /// Reads the flips of the marker.
    ///
    /// # Errors
    /// When the table cannot be read, or has too few edges.
    pub fn measured(input: impl Read, marker_row_share: f64, scan: Span) -> Result<Self, Refused> {
        let mut flips = Vec::new();
        for row in csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(input).deserialize() {
            flips.push(row.map_err(|error: csv::Error| Refused(format!("marker table, line {line}: wanted submit_s,edge_s in seconds of one clock (edge_s may be empty), got {error}", line = error.position().map_or(1, csv::Position::line))))?);
        }
        Self::of_flips(&flips, marker_row_share, scan)
    }

    /// Returns the latency that flips of the marker show.
    ///
    /// # Errors
    /// When too few have an edge.
    pub fn of_flips(flips: &[Flip], marker_row_share: f64, scan: Span) -> Result<Self, Refused> {
        let delay_s = |flip: &Flip| flip.edge_s.map(|edge_s| edge_s - flip.submit_s);
        let plausible = flips.iter().filter_map(delay_s).filter(|s| (0.0..=LONGEST_S).contains(s));
        let mut delays_ns: Vec<f64> = plausible.map(|s| s * 1e9).collect();
        let flips = flips.len();
        let seen = delays_ns.len();
        let missed = flips - seen;
        if seen < FEWEST_EDGES {
            return Err(Refused(format!(
                "marker table: wanted at least {FEWEST_EDGES} flips with an edge, got {seen}; let the marker flip for longer"
            )));
        }
        if missed as f64 > MOST_MISSED * flips as f64 {
            return Err(Refused(format!(
                "marker table: wanted edges for nine of ten flips, got {missed} of {flips} without one; check the photodiode's place and threshold"
            )));
        }
        delays_ns.sort_by(f64::total_cmp);
        let quantile = |share: f64| delays_ns[((seen - 1) as f64 * share).round() as usize];
        #[allow(clippy::cast_possible_truncation, reason = "a second in nanoseconds at most")]
        let whole = |ns: f64| ns.round() as i64;
        Ok(Self {
            source: LatencySource::Measured,
            median_ns: whole(median(&mut delays_ns.clone())),
            spread_ns: whole(quantile(0.95) - quantile(0.05)),
            range_ns: [whole(delays_ns[0]), whole(delays_ns[seen - 1])],
            flips: seen,
            missed,
            scan_ns: scan.ns(),
            marker_row_share,
        })
    }

    /// Returns the time from submit to the light of a row (its number over the number of rows, 0 to 1).
    pub fn at_row(&self, row_share: f64) -> Span {
        Span::from_ns(self.median_ns) + self.scan_after_marker(row_share)
    }

    fn scan_after_marker(&self, row_share: f64) -> Span {
        Span::from_s((row_share - self.marker_row_share) * self.scan_ns as f64 * 1e-9)
    }

    /// Returns the latency in words, with its unknown parts.
    pub fn reported(&self) -> String {
        let ms = |ns: i64| ns as f64 * 1e-6;
        let (median, spread) = (ms(self.median_ns), ms(self.spread_ns));
        match self.source {
            LatencySource::Given => format!("{median:.3} ms +- {:.3} ms as given; not measured here", 0.5 * spread),
            LatencySource::Measured => format!(
                "{median:.3} ms from submit to light, 90 % within {spread:.3} ms, {:.3} to {:.3} ms in {} flips ({} missed)",
                ms(self.range_ns[0]),
                ms(self.range_ns[1]),
                self.flips,
                self.missed
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(delay_ms: impl Fn(u32) -> Option<f64>, flips: u32) -> String {
        let row = |i: u32| {
            let submit_s = 100.0 + 0.5 * f64::from(i);
            let edge = delay_ms(i).map(|ms| format!("{:.9}", submit_s + 1e-3 * ms)).unwrap_or_default();
            format!("{submit_s},{edge}\n")
        };
        "submit_s,edge_s\n".to_owned() + &(0..flips).map(row).collect::<String>()
    }

    fn measured(text: &str) -> Result<Latency, Refused> {
        Latency::measured(text.as_bytes(), 0.0, Span::from_ms(16))
    }

    #[test]
    fn median_and_spread_are_those_of_the_delays() {
        // 20 to 29.9 ms evenly, one flip without an edge.
        let latency = measured(&table(|i| (i != 7).then(|| 20.0 + 0.1 * f64::from(i)), 100)).unwrap();
        assert_eq!((latency.flips, latency.missed), (99, 1));
        assert!((latency.median_ns - 25_000_000).abs() <= 100_000, "{}", latency.median_ns);
        assert!((latency.spread_ns - 8_900_000).abs() <= 200_000, "{}", latency.spread_ns);
        assert!((latency.range_ns[0] - 20_000_000).abs() < 10 && (latency.range_ns[1] - 29_900_000).abs() < 10);
        assert!(latency.reported().contains("in 99 flips (1 missed)"), "{}", latency.reported());
    }

    #[test]
    fn edges_belong_to_the_flip_before_them() {
        let submits: Vec<f64> = (0..40).map(|i| 100.0 + 0.2 * f64::from(i)).collect();
        // Each 28 ms later, one missing, one twice (a bounce), the table not in order.
        let mut edges: Vec<f64> =
            submits.iter().enumerate().filter(|(i, _)| *i != 7).map(|(_, submit_s)| submit_s + 0.028).collect();
        edges.extend([submits[3] + 0.031, 99.0]);
        edges.reverse();
        let flips = flips_of(&submits, &edges).unwrap();
        assert_eq!((flips.len(), flips[7].edge_s), (40, None));
        let latency = Latency::of_flips(&flips, 0.0, Span::from_ms(16)).unwrap();
        assert!((latency.median_ns - 28_000_000).abs() < 100, "{}", latency.median_ns);
        assert!((latency.at_row(0.5).ns() - 36_000_000).abs() < 100, "half a scan below the marker");
        // Both sides of the shortest time between flips.
        let at = |period_s: f64| (0..40).map(|i| period_s * f64::from(i)).collect::<Vec<f64>>();
        assert!(flips_of(&at(0.1001), &[]).is_ok(), "no edges are the next step's complaint");
        let error = flips_of(&at(1.0 / 60.0), &edges).unwrap_err();
        assert_eq!(
            error,
            Refused(format!(
                "marker flips: wanted at least {FEWEST_EDGES} that the next one follows after {APART_S} s or more, got {apart} of \
         {flips}; an edge could be of another flip: `starloop display flip` flips slowly",
                apart = 0,
                flips = 40
            ))
        );
        assert!(error.to_string().contains("display flip"), "{error}");
    }

    #[test]
    fn photons_come_after_submit_and_scan() {
        let latency = measured(&table(|_| Some(25.0), 20)).unwrap();
        assert!((latency.at_row(0.5).ms() - 33.0).abs() < 1e-3, "{}", latency.at_row(0.5).ms());
        let given = Latency::given(Span::from_ms(20), Span::from_ms(4));
        assert_eq!(given.at_row(1.0).ms(), 20.0);
        assert!(given.reported().contains("not measured"), "{}", given.reported());
    }

    #[test]
    fn a_table_that_says_nothing_is_refused() {
        let refused = |text: &str| measured(text).unwrap_err().to_string();
        assert!(refused("submit_s,edge_s\n1.0,soon\n").starts_with("marker table, line 2: "));
        assert!(refused("a,b\n1.0,2.0\n").starts_with("marker table, line "));
        assert_eq!(
            measured(&table(|_| Some(5.0), 9)),
            Err(Refused(format!(
                "marker table: wanted at least {FEWEST_EDGES} flips with an edge, got {got}; let the marker flip for longer",
                got = 9
            )))
        );
        assert!(measured(&table(|_| Some(5.0), 10)).is_ok());
        let often_missed = measured(&table(|i| (i % 5 != 0).then_some(5.0), 100));
        assert_eq!(
            often_missed,
            Err(Refused(format!(
                "marker table: wanted edges for nine of ten flips, got {missed} of {flips} without one; check the photodiode's place and threshold",
                missed = 20,
                flips = 100
            )))
        );
        assert!(refused(&table(|_| Some(-1.0), 100)).contains("got 0;"));
    }
}
