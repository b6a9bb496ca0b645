//! The stream of jitter samples: whether one is expected, and how much of an exposure lacks its samples.
//!
//! In: arrivals of messages with samples, and the epochs of the samples that an exposure has. Out: the time that lacks
//! samples. A stream is expected from its first sample until nothing has arrived for [`ENDS_AFTER`]. No sample is
//! missing where neighbours are up to one and a half periods apart, or the outermost one is less than a period from the
//! exposure's end. Tests: below, and `tests/closed_loop/late_jitter.rs`.

use crate::attitude::los::JitterPoint;
use base::time::{Span, Tai};

/// Time without a message after which a stream has ended.
const ENDS_AFTER: Span = Span::from_ms(1000);

/// The stream of samples, if there is one.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Stream {
    known: Option<Known>,
}

#[derive(Debug, Clone, Copy)]
struct Known {
    /// Epoch of its first sample.
    since: Tai,
    /// Time between samples.
    period: Span,
    /// Arrival of its newest message.
    received_at: Tai,
}

impl Stream {
    /// Records a message whose samples start at `first_at` and are `period` apart.
    pub(super) fn note(&mut self, first_at: Tai, period: Span, received_at: Tai) {
        let going = self.known.filter(|known| received_at - known.received_at <= ENDS_AFTER);
        let since = going.map_or(first_at, |known| known.since.min(first_at));
        let received_at = going.map_or(received_at, |known| known.received_at.max(received_at));
        self.known = Some(Known { since, period, received_at });
    }

    /// Removes the stream.
    pub(super) fn clear(&mut self) {
        self.known = None;
    }

    fn live(&self, at: Tai) -> Option<Known> {
        self.known.filter(|known| at - known.received_at <= ENDS_AFTER)
    }

    /// Returns true while samples are expected.
    pub(super) fn is_live(&self, at: Tai) -> bool {
        self.live(at).is_some()
    }

    /// Returns true when samples up to `until` are still to come; `newest` is the epoch of the newest sample.
    pub(super) fn is_behind(&self, newest: Option<Tai>, until: Tai) -> bool {
        self.live(until).is_some_and(|known| newest.is_none_or(|newest| until - newest >= known.period))
    }

    /// Returns how much of `from..=until` lacks samples; `points` are those that affect it, in order of time.
    pub(super) fn missing(&self, points: &[JitterPoint], from: Tai, until: Tai) -> Span {
        let Some(known) = self.live(until) else { return Span::ZERO };
        let from = from.max(known.since);
        let inside = |a: Tai, b: Tai| (b.min(until) - a.max(from)).max(Span::ZERO);
        let (Some(first), Some(last)) = (points.first(), points.last()) else { return inside(from, until) };
        let ends = [inside(from, first.at), inside(last.at, until)].into_iter().filter(|end| *end >= known.period);
        let longest = Span::from_ns(known.period.ns() / 2 * 3);
        let gaps = points.windows(2).filter(|pair| pair[1].at - pair[0].at > longest);
        ends.chain(gaps.map(|pair| inside(pair[0].at, pair[1].at))).fold(Span::ZERO, |sum, gap| sum + gap)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn ms(t_ms: i64) -> Tai {
        Tai::from_ns(t_ms * 1_000_000)
    }

    fn points(epochs_ms: impl IntoIterator<Item = i64>) -> Vec<JitterPoint> {
        epochs_ms.into_iter().map(|t_ms| JitterPoint { at: ms(t_ms), rotation_rad: DVec3::ZERO }).collect()
    }

    /// Returns a stream of 1 kHz from 0 on, last received at 120 ms.
    fn stream() -> Stream {
        let mut stream = Stream::default();
        stream.note(ms(0), Span::from_ms(1), ms(2));
        stream.note(ms(106), Span::from_ms(1), ms(120));
        stream
    }

    #[test]
    fn missing_time_is_that_without_samples() {
        let all = || (9..=111).collect::<Vec<i64>>();
        let without =
            |lost: core::ops::RangeInclusive<i64>| points(all().into_iter().filter(move |t| !lost.contains(t)));
        for (points, wanted_ms) in [
            (points(all()), 0),
            (points(10..=110), 0),
            (points([]), 100),
            (points(0..=80), 30),
            (points(40..=111), 30),
            (without(50..=50), 2),
            (without(50..=69), 21),
            (without(0..=19), 10),
        ] {
            assert_eq!(stream().missing(&points, ms(10), ms(110)), Span::from_ms(wanted_ms), "{} points", points.len());
        }
    }

    #[test]
    fn no_samples_are_expected_before_the_first_or_after_the_end() {
        assert_eq!(Stream::default().missing(&[], ms(10), ms(110)), Span::ZERO, "no stream");
        assert_eq!(stream().missing(&points(0..=50), ms(-50), ms(50)), Span::ZERO, "it begins in the exposure");
        assert_eq!(stream().missing(&[], ms(1020), ms(1120)), Span::from_ms(100), "it may go on");
        assert_eq!(stream().missing(&[], ms(1021), ms(1121)), Span::ZERO, "it has ended");
        assert!(stream().is_live(ms(1120)) && !stream().is_live(ms(1121)));
        let mut cleared = stream();
        cleared.clear();
        assert!(!cleared.is_live(ms(120)));
    }

    #[test]
    fn stream_is_behind_until_its_last_sample_in_the_exposure_has_come() {
        for (newest, wanted) in [(None, true), (Some(100), true), (Some(109), true), (Some(110), false)] {
            assert_eq!(stream().is_behind(newest.map(ms), ms(110)), wanted, "{newest:?}");
        }
        assert!(!Stream::default().is_behind(None, ms(110)), "nothing is waited for");
    }
}
