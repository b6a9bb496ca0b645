//! One line about a run under way, for a terminal.

use std::borrow::Cow;

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
