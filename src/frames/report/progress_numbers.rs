//! The numbers of a run under way, as one plain value, which a live view shows beside the frame.
//!
//! In: counts and tallies of the run's record, copied by the frame thread after a frame: no allocation, no text. All
//! are counts since the start, so a value that is lost on the way costs nothing but its age. Size: about 16 KiB.
//! Limits: [`PORTS_MAX`] ports and [`NAMES_MAX`] names each, [`EVENTS_MAX`] kinds of events; what does not fit is
//! counted. Tests: below.

use crate::report::{
    account::FrameAccount, stages::Stage, summary::FrameCounts, table::NewestEvents, time_tally::TimeTally,
    verdict::RunWord,
};
use std::borrow::Cow;

/// Number of ports whose counts are reported.
pub const PORTS_MAX: usize = 4;
/// Named counts in one list of a port.
pub const NAMES_MAX: usize = 48;
/// Kinds of events.
pub const EVENTS_MAX: usize = 72;

/// Counts with names, in the order they were given; a list of fixed length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NamedCounts<const MOST: usize = NAMES_MAX> {
    list: [(&'static str, u64); MOST],
    len: usize,
    left_out: usize,
}

impl<const MOST: usize> NamedCounts<MOST> {
    /// No names.
    pub const NONE: Self = Self { list: [("", 0); MOST], len: 0, left_out: 0 };

    /// Adds a count.
    pub fn push(&mut self, name: &'static str, count: u64) {
        match self.list.get_mut(self.len) {
            Some(place) => {
                *place = (name, count);
                self.len += 1;
            }
            None => self.left_out += 1,
        }
    }

    /// Names and counts.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, u64)> + '_ {
        self.list[..self.len].iter().copied()
    }

    /// Returns the number of names that did not fit.
    pub fn left_out(&self) -> usize {
        self.left_out
    }
}

impl<const MOST: usize> FromIterator<(&'static str, u64)> for NamedCounts<MOST> {
    fn from_iter<I: IntoIterator<Item = (&'static str, u64)>>(counts: I) -> Self {
        let mut all = Self::NONE;
        counts.into_iter().for_each(|(name, count)| all.push(name, count));
        all
    }
}

/// Counts of one port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PortCounts {
    /// Packets, and errors of the link.
    pub counters: NamedCounts,
    /// Messages refused, by reason.
    pub rejects: NamedCounts,
}

impl PortCounts {
    /// A port that has counted nothing.
    pub const NONE: Self = Self { counters: NamedCounts::NONE, rejects: NamedCounts::NONE };
}

/// A run so far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RunNumbers {
    /// Frames in the whole run; `None` when it has no end.
    pub frames_in_run: Option<u64>,
    /// Frames by outcome.
    pub frames: FrameCounts,
    /// Frames by their ends.
    pub account: FrameAccount,
    /// First word of the verdict so far.
    pub word: RunWord,
    /// Wall time per stage, in the order of [`Stage::ALL`].
    pub stages: [TimeTally; Stage::COUNT],
    /// Events of the ledger by kind, zeros included.
    pub events: NamedCounts<EVENTS_MAX>,
    /// The newest events, with their times.
    pub newest: NewestEvents,
    /// Counts per port; those beyond `port_count` are empty.
    pub ports: [PortCounts; PORTS_MAX],
    /// Ports there are.
    pub port_count: usize,
}

impl RunNumbers {
    /// A run in which nothing has happened.
    pub const NONE: Self = Self {
        frames_in_run: None,
        frames: FrameCounts {
            scheduled: 0,
            rendered: 0,
            delivered: 0,
            late: 0,
            held: 0,
            dropped: 0,
            extrapolated: 0,
            partly_extrapolated: 0,
            jitter_missing: 0,
            blank: 0,
        },
        account: FrameAccount::NONE,
        word: RunWord::Ok,
        stages: [TimeTally::EMPTY; Stage::COUNT],
        events: NamedCounts::NONE,
        newest: NewestEvents::NONE,
        ports: [PortCounts::NONE; PORTS_MAX],
        port_count: 0,
    };

    /// Takes in the counts of one port more; beyond [`PORTS_MAX`] ports are only counted.
    pub fn push_port(&mut self, port: PortCounts) {
        if let Some(place) = self.ports.get_mut(self.port_count) {
            *place = port;
        }
        self.port_count += 1;
    }

    /// Returns the number of ports that are not reported.
    pub fn ports_left_out(&self) -> usize {
        self.port_count.saturating_sub(PORTS_MAX)
    }

    /// Returns the ports that are reported.
    pub fn ports(&self) -> &[PortCounts] {
        &self.ports[..self.port_count.min(PORTS_MAX)]
    }
}

// One line about a run under way, for a terminal.

/// Numbers of the line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Frames delivered.
    pub frame: u64,
    /// Frames in the whole run; `None` when it has no end.
    pub frames: Option<u64>,
    /// Frames delivered per second of wall time.
    pub fps: f64,
    /// 99 % quantile of release to delivery, ms.
    pub p99_ms: f64,
    /// Frames late so far.
    pub late: u64,
    /// Frames dropped so far.
    pub dropped: u64,
    /// Boresight right ascension, deg.
    pub ra_deg: f64,
    /// Boresight declination, deg.
    pub dec_deg: f64,
    /// Roll, deg.
    pub roll_deg: f64,
    /// Stars in the frame.
    pub stars: usize,
    /// Smear method.
    pub method: &'static str,
}

/// Returns the line without a line break, at most `width` characters; a cut line ends in `…`.
pub fn progress_line(p: &Progress, width: usize) -> String {
    let frames = p.frames.map_or_else(|| Cow::Borrowed("-"), |n| n.to_string().into());
    let line = format!(
        "frame {}/{frames}  {:.1} fps  p99 {:.2} ms  late {}  dropped {}  RA {:.4} Dec {:+.4} roll {:.2} deg  {} stars  {}",
        p.frame, p.fps, p.p99_ms, p.late, p.dropped, p.ra_deg, p.dec_deg, p.roll_deg, p.stars, p.method
    );
    cut(line, width)
}

/// Returns one line about a job after `elapsed_s`, with `done` of `total` parts done: the next part, and the time left
/// where it can be estimated; at most `width` characters.
pub fn step_line(done: usize, total: usize, elapsed_s: f64, next: &str, width: usize) -> String {
    let left = match done {
        0 => String::new(),
        _ => format!(", about {:.0} s left", elapsed_s * total.saturating_sub(done) as f64 / done as f64),
    };
    cut(format!("{done}/{total} done in {elapsed_s:.0} s{left}; next: {next}"), width)
}

fn cut(line: String, width: usize) -> String {
    if line.chars().count() <= width {
        return line;
    }
    let kept = line.chars().take(width.saturating_sub(1));
    if width == 0 { String::new() } else { kept.chain(['…']).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_keep_their_order_and_none_is_lost_unseen() {
        let mut counts: NamedCounts = [("sent", 2), ("received", 0)].into_iter().collect();
        assert_eq!(counts.iter().collect::<Vec<_>>(), [("sent", 2), ("received", 0)]);
        (2..NAMES_MAX + 3).for_each(|_| counts.push("more", 1));
        assert_eq!((counts.iter().count(), counts.left_out()), (NAMES_MAX, 3));
    }

    #[test]
    fn ports_beyond_the_capacity_are_left_out() {
        let mut numbers = RunNumbers::NONE;
        (0..PORTS_MAX).for_each(|_| numbers.push_port(PortCounts::NONE));
        assert_eq!((numbers.ports().len(), numbers.ports_left_out()), (PORTS_MAX, 0));
        (0..2).for_each(|_| numbers.push_port(PortCounts::NONE));
        assert_eq!((numbers.ports().len(), numbers.ports_left_out()), (PORTS_MAX, 2));
        assert!(size_of::<RunNumbers>() < 18 * 1024, "{} bytes", size_of::<RunNumbers>());
    }
}

#[cfg(test)]
mod progress_tests {
    use super::*;

    const P: Progress = Progress {
        frame: 120,
        frames: Some(600),
        fps: 10.04,
        p99_ms: 14.256,
        late: 2,
        dropped: 0,
        ra_deg: 83.822_08,
        dec_deg: -5.391_11,
        roll_deg: 12.0,
        stars: 48,
        method: "kernel",
    };

    #[test]
    fn the_whole_line() {
        let wanted = "frame 120/600  10.0 fps  p99 14.26 ms  late 2  dropped 0  RA 83.8221 Dec -5.3911 roll 12.00 deg  48 stars  kernel";
        assert_eq!(progress_line(&P, 200), wanted);
        assert!(progress_line(&Progress { frames: None, ..P }, 200).starts_with("frame 120/-  "));
    }

    #[test]
    fn a_step_reports_what_is_left() {
        assert_eq!(step_line(0, 4, 0.0, "S1", 80), "0/4 done in 0 s; next: S1");
        assert_eq!(step_line(3, 4, 30.2, "S4", 80), "3/4 done in 30 s, about 10 s left; next: S4");
        assert_eq!(step_line(3, 4, 30.2, "S4", 9), "3/4 done…");
    }

    #[test]
    fn it_never_exceeds_the_terminal() {
        let whole = progress_line(&P, 200).chars().count();
        for width in 0..130 {
            let line = progress_line(&P, width);
            assert_eq!(line.chars().count(), width.min(whole), "{line}");
            assert_eq!(line.ends_with('…'), width > 0 && width < whole, "{line}");
        }
        assert_eq!(progress_line(&P, 12), "frame 120/6…");
        let odd = Progress { fps: f64::NAN, ra_deg: f64::INFINITY, p99_ms: 1e300, ..P };
        assert!(progress_line(&odd, 80).chars().count() == 80);
    }
}
