//! Medians of frame times, after two warm-up frames, within a time limit.

use base::{clock::Stopwatch, least_squares::median};

/// Time of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameTime {
    /// Median, ms.
    pub median_ms: f64,
    /// The fastest, without other load, ms.
    pub least_ms: f64,
}

/// Effort for one value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Effort {
    /// Time after which no further repetition starts, ms.
    pub most_ms: f64,
    /// Largest number of repetitions.
    pub most: usize,
}

impl Effort {
    /// Returns the effort of a quick run, or a full one.
    pub fn new(quick: bool) -> Self {
        if quick { Self { most_ms: 12.0, most: 40 } } else { Self { most_ms: 60.0, most: 200 } }
    }

    /// Returns an effort multiplied by `factor`.
    #[must_use]
    pub fn times(self, factor: usize) -> Self {
        Self { most_ms: self.most_ms * factor as f64, most: self.most * factor }
    }

    /// Measures the time of `frame`.
    ///
    /// # Errors
    /// Those of `frame`.
    pub fn time<E>(self, mut frame: impl FnMut() -> Result<(), E>) -> Result<FrameTime, E> {
        frame()?;
        frame()?;
        let mut taken_ms = Vec::with_capacity(self.most);
        let (mut watch, mut spent_ms) = (Stopwatch::start(), 0.0);
        while taken_ms.len() < self.most && spent_ms <= self.most_ms {
            frame()?;
            let ms = watch.lap().ms();
            spent_ms += ms;
            taken_ms.push(ms);
        }
        let least_ms = taken_ms.iter().copied().fold(f64::INFINITY, f64::min);
        Ok(FrameTime { median_ms: median(&mut taken_ms), least_ms })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_frames_warm_up_and_the_number_or_the_limit_ends_it() {
        let mut frames = 0;
        let mut frame = || -> Result<(), ()> {
            frames += 1;
            std::thread::sleep(core::time::Duration::from_millis(2));
            Ok(())
        };
        let time = Effort { most_ms: 1e9, most: 5 }.time(&mut frame).unwrap();
        assert!(time.least_ms >= 2.0 && time.median_ms >= time.least_ms, "{time:?}");
        let time = Effort { most_ms: 1.0, most: 50 }.time(&mut frame).unwrap();
        assert_eq!(time.least_ms, time.median_ms, "one frame is beyond the limit");
        assert_eq!(frames, (2 + 5) + (2 + 1));
        assert_eq!(Effort { most_ms: 1.0, most: 1 }.time(|| Err("lost")), Err("lost"));
    }
}
