//! Pulses per second from the kernel (`/sys/class/pps/ppsN/assert`) -> instants on the bench clock.
//!
//! The kernel stamps each pulse with CLOCK_REALTIME in the interrupt: text `SECONDS.NANOSECONDS#COUNT`. A pulse is
//! placed on the bench clock like a packet's stamp, by its age when it is fetched; error: the interrupt's latency
//! (microseconds on a GPIO, a millisecond on USB) and half the window of the paired reading. A pulse that is older than
//! two seconds, or whose stamp a step of CLOCK_REALTIME spoilt, is useless for a clock: it is counted as refused.
//!
//! Look at least once a second, off the frame path: each look reads a file (some microseconds, no allocation).
//! Source: Linux `Documentation/driver-api/pps.rst`. Tests here, on a file that looks the same.

use super::{LinkError, kernel_stamp::StampMap};
use base::time::{Span, Tai};
use base::{clock::PairedReading, units::NS_PER_S};
use std::{fs::File, io, os::unix::fs::FileExt, path::Path};

const NO_DEVICE: &str =
    "; see `ls /sys/class/pps`; load a driver (`modprobe pps-gpio`, or `pps-ldisc` with `ldattach pps`)";
const NOT_PPS: &str = "; it must be of the form SECONDS.NANOSECONDS#COUNT, as in /sys/class/pps/pps0/assert";
/// Longest text of a pulse: two 20-digit numbers, nine digits, two signs, a line break, and a margin.
const TEXT_MAX: usize = 64;
/// An older pulse says nothing: another one is due.
const AGE_MAX: Span = Span::from_ms(2000);

/// A source of pulses.
#[derive(Debug)]
pub struct Pps {
    file: File,
    newest: u64,
    stamps: StampMap,
    /// Counts since the start.
    counters: PpsCounters,
}

/// Counts of the pulses so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PpsCounters {
    /// Pulses handed on.
    pub pulses: u64,
    /// Pulses that passed between two looks.
    pub missed: u64,
    /// Pulses refused: too old, or stamped across a step of CLOCK_REALTIME.
    pub refused: u64,
    /// Looks that gave no legible text: the device is gone.
    pub unreadable: u64,
}

/// One line of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Pulse {
    realtime_ns: i64,
    count: u64,
}

impl Pps {
    /// Opens a source: a folder such as `/sys/class/pps/pps0`. The pulse that it shows already is not handed on.
    ///
    /// # Errors
    /// When the source does not exist, or its text is not that of pulses.
    pub fn open(path: &Path, now: PairedReading) -> Result<Self, LinkError> {
        let failed =
            |doing, source, advice| LinkError::System { link: path.display().to_string(), doing, source, advice };
        let file = File::open(path.join("assert")).map_err(|error| failed("open the pulses", error, NO_DEVICE))?;
        let first = read(&file).map_err(|error| failed("read the pulses", error, NOT_PPS))?;
        let (stamps, counters) = (StampMap::new(now), PpsCounters::default());
        Ok(Self { file, newest: first.count, stamps, counters })
    }

    /// Returns the newest pulse, once; `now` must have been read just before.
    pub fn poll(&mut self, now: PairedReading) -> Option<Tai> {
        let Ok(pulse) = read(&self.file) else {
            self.counters.unreadable += 1;
            return None;
        };
        if pulse.count == self.newest {
            // Whatever steps there were, the next pulse is stamped after them.
            let _ = self.stamps.place(None, now);
            self.stamps.drained();
            return None;
        }
        self.counters.missed += pulse.count.saturating_sub(self.newest).saturating_sub(1);
        self.newest = pulse.count;
        let placed = self.stamps.place(Some(pulse.realtime_ns), now);
        self.stamps.drained();
        let good = placed.is_kernels && now.bench - placed.at <= AGE_MAX;
        self.counters.pulses += u64::from(good);
        self.counters.refused += u64::from(!good);
        good.then_some(placed.at)
    }

    /// Returns the counts of the pulses so far.
    pub fn counters(&self) -> PpsCounters {
        self.counters
    }
}

/// Reads from the start each time: the kernel writes a new text.
fn read(file: &File) -> io::Result<Pulse> {
    let mut text = [0; TEXT_MAX];
    let len = file.read_at(&mut text, 0)?;
    let text = text.get(..len).and_then(|bytes| str::from_utf8(bytes).ok()).unwrap_or("");
    parse(text).ok_or_else(|| io::Error::new(io::ErrorKind::InvalidData, format!("its text is {text:?}")))
}

fn parse(text: &str) -> Option<Pulse> {
    let (instant, count) = text.trim_end().split_once('#')?;
    let (seconds, fraction) = instant.split_once('.')?;
    if fraction.len() != 9 || !fraction.bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    let realtime_ns = seconds.parse::<i64>().ok()?.checked_mul(NS_PER_S)?.checked_add(fraction.parse().ok()?)?;
    Some(Pulse { realtime_ns, count: count.parse().ok()? })
}

#[cfg(test)]
mod tests {
    use super::*;

    const UTC_S: i64 = 1_700_000_000;
    /// CLOCK_REALTIME less the bench clock.
    const OFFSET_NS: i64 = UTC_S * NS_PER_S;

    fn reading(bench_ns: i64, offset_ns: i64) -> PairedReading {
        PairedReading { bench: Tai::from_ns(bench_ns), realtime_ns: bench_ns + offset_ns, window: Span::from_ns(300) }
    }

    struct Source {
        folder: tempfile::TempDir,
    }

    impl Source {
        fn new() -> Self {
            let source = Self { folder: tempfile::tempdir().unwrap() };
            source.write("0.000000000#0\n");
            source
        }

        fn write(&self, text: &str) {
            std::fs::write(self.folder.path().join("assert"), text).unwrap();
        }

        fn pulse(&self, bench_ns: i64, count: u64) {
            self.write(&format!("{}.{:09}#{count}\n", UTC_S + bench_ns / NS_PER_S, bench_ns % NS_PER_S));
        }

        fn open(&self) -> Pps {
            Pps::open(self.folder.path(), reading(0, OFFSET_NS)).unwrap()
        }
    }

    #[test]
    fn each_pulse_comes_once_where_it_was() {
        let source = Source::new();
        let mut pps = source.open();
        assert_eq!(pps.poll(reading(100, OFFSET_NS)), None, "nothing new");
        source.pulse(1_000_000_123, 1);
        let now = reading(1_400_000_000, OFFSET_NS);
        assert_eq!(pps.poll(now), Some(Tai::from_ns(1_000_000_123)));
        assert_eq!(pps.poll(reading(1_500_000_000, OFFSET_NS)), None, "once");
        source.pulse(4_000_000_000, 4);
        assert_eq!(pps.poll(reading(4_000_100_000, OFFSET_NS)), Some(Tai::from_ns(4_000_000_000)));
        assert_eq!(pps.counters(), PpsCounters { pulses: 2, missed: 2, refused: 0, unreadable: 0 });
    }

    #[test]
    fn pulses_that_cannot_be_placed_are_refused() {
        let source = Source::new();
        let mut pps = source.open();
        source.pulse(1_000_000_000, 1);
        let too_late = 1_000_000_000 + AGE_MAX.ns() + 1;
        assert_eq!(pps.poll(reading(too_late, OFFSET_NS)), None, "older than two seconds");
        source.pulse(4_000_000_000, 2);
        let stepped = OFFSET_NS + 50_000_000;
        assert_eq!(pps.poll(reading(4_100_000_000, stepped)), None, "the clock stepped since the last look");
        source.pulse(5_050_000_000, 3);
        assert_eq!(pps.poll(reading(5_200_000_000, stepped)), Some(Tai::from_ns(5_000_000_000)), "after the step");
        source.pulse(8_000_000_000, 4);
        assert_eq!(pps.poll(reading(6_000_000_000, stepped)), None, "from the future");
        assert_eq!((pps.counters().pulses, pps.counters().refused), (1, 3));
    }

    #[test]
    fn a_pulse_just_young_enough_counts() {
        let source = Source::new();
        let mut pps = source.open();
        source.pulse(1_000_000_000, 1);
        assert!(pps.poll(reading(1_000_000_000 + AGE_MAX.ns(), OFFSET_NS)).is_some());
    }

    #[test]
    fn a_missing_device_and_foreign_text_are_clear_errors() {
        let folder = tempfile::tempdir().unwrap();
        let open = || Pps::open(folder.path(), reading(0, OFFSET_NS)).unwrap_err().to_string();
        assert!(open().contains("/sys/class/pps"), "{}", open());
        for text in ["", "#", "1#1", "1.5#1", "1.12345678x#1", "1.123456789#x", "9999999999999.000000000#1", "é"] {
            std::fs::write(folder.path().join("assert"), text).unwrap();
            assert!(open().contains("SECONDS.NANOSECONDS#COUNT"), "{text:?}: {}", open());
        }
    }

    #[test]
    fn a_device_that_goes_is_counted() {
        let source = Source::new();
        let mut pps = source.open();
        source.write("");
        assert_eq!(pps.poll(reading(1, OFFSET_NS)), None);
        assert_eq!(pps.counters().unreadable, 1);
    }
}
