//! The end of a tracker at the sinks of its head: takes a copy of each frame and what a camera and its maker know of
//! it.

use crate::runtime::tracker_out::shared::OutShared;
use base::time::{Span, Tai};
use base::{image::DnImage, region::Regions};
use crossbeam_channel::{Receiver, Sender, bounded};
use frames::sink::{FaultFlags, Loss, LossKind, SentFrame, Sink, SinkError, SinkLine, SinkSummary, sink_lines};
use glam::DVec3;
use std::sync::Arc;

/// Frames that may wait for a tracker.
pub const FRAMES_WAITING: usize = 4;

/// A frame as a tracker gets it.
#[derive(Debug, Clone)]
pub struct Seen {
    /// Number of the frame.
    pub number: u32,
    /// Middle of the exposure.
    pub mid_exposure: Tai,
    /// Integration time, s.
    pub exposure_s: f64,
    /// Parts of the image that were read out.
    pub regions: Regions,
    /// True attitude, scalar first; `None`: the frame shows no stars.
    pub truth_wxyz: Option<[f64; 4]>,
    /// True rate, sensor axes, rad/s.
    pub rate_rad_s: DVec3,
    /// Observer's velocity over the speed of light, ICRF axes.
    pub observer_beta: DVec3,
    /// Temperature of the detector, degrees Celsius.
    pub temperature_c: f64,
    /// Pixels; empty for a tracker that does not look at them.
    pub image: DnImage,
}

impl Seen {
    fn new(size_px: [usize; 2]) -> Self {
        Self {
            number: 0,
            mid_exposure: Tai::from_ns(0),
            exposure_s: 0.0,
            regions: Regions::WHOLE,
            truth_wxyz: None,
            rate_rad_s: DVec3::ZERO,
            observer_beta: DVec3::ZERO,
            temperature_c: f64::NAN,
            image: DnImage::new(size_px[0], size_px[1]),
        }
    }

    /// Returns the end of the exposure.
    pub fn exposure_end(&self) -> Tai {
        self.mid_exposure + Span::from_s(0.5 * self.exposure_s)
    }

    fn take(&mut self, frame: &SentFrame, has_pixels: bool) {
        let meta = &frame.meta;
        let is_blank = meta.faults.contains(FaultFlags::BLANK);
        (self.number, self.mid_exposure, self.exposure_s) = (meta.number, meta.mid_exposure, meta.exposure_s);
        self.regions = meta.regions;
        self.truth_wxyz = (!is_blank).then_some(meta.attitude_wxyz);
        self.rate_rad_s = DVec3::from_array(meta.rate_deg_s.map(f64::to_radians));
        self.observer_beta = DVec3::from_array(meta.observer_beta);
        self.temperature_c = meta.facts.map_or(f64::NAN, |facts| facts.temperature_c);
        if has_pixels {
            if self.image.pixels().len() == frame.image.pixels().len() {
                self.image.pixels_mut().copy_from_slice(frame.image.pixels());
            } else {
                self.image.clone_from(&frame.image);
            }
        }
    }
}

/// The end of one tracker's queue at the sinks.
struct Mouth {
    /// `None`: no more frames come.
    full: Option<Sender<Seen>>,
    empty: Receiver<Seen>,
    has_pixels: bool,
    shared: Arc<OutShared>,
    taken: u64,
    lost: u64,
}

/// The other end.
pub struct TapParts {
    /// Frames.
    pub full: Receiver<Seen>,
    /// Where their buffers go back.
    pub empty: Sender<Seen>,
}

/// A head's sinks with the trackers that see its frames. Name and summary are the sinks'; each tracker adds a line.
pub struct TrackerTap {
    inner: Box<dyn Sink>,
    mouths: Vec<Mouth>,
    losses: Vec<Loss>,
    summary: Option<SinkSummary>,
    newest: u32,
}

/// Puts a tracker beside the sinks of its head; `size_px` is of its images, zeros where it does not look at any.
pub fn tracker_tap(
    inner: Box<dyn Sink>,
    size_px: Option<[usize; 2]>,
    shared: Arc<OutShared>,
) -> (TrackerTap, TapParts) {
    let (full, to_take) = bounded(FRAMES_WAITING);
    let (given_back, empty) = bounded(FRAMES_WAITING);
    for _ in 0..FRAMES_WAITING {
        let _there_is_space_for_all = given_back.try_send(Seen::new(size_px.unwrap_or([0, 0])));
    }
    let mouth = Mouth { full: Some(full), empty, has_pixels: size_px.is_some(), shared, taken: 0, lost: 0 };
    let tap = TrackerTap { inner, mouths: vec![mouth], losses: Vec::new(), summary: None, newest: 0 };
    (tap, TapParts { full: to_take, empty: given_back })
}

impl Mouth {
    fn send(&mut self, frame: &SentFrame) -> bool {
        let Ok(mut seen) = self.empty.try_recv() else { return false };
        seen.take(frame, self.has_pixels);
        self.full.as_ref().is_some_and(|full| full.try_send(seen).is_ok())
    }

    fn line(&self) -> SinkLine {
        let counts = self.shared.counts();
        SinkLine {
            place: self.shared.place.clone(),
            kind: self.shared.protocol,
            frames: self.taken,
            dropped: self.lost,
            refused: 0,
            bytes: counts.bytes,
            run_crc32: Some(counts.crc32),
            output: Some(self.shared.output()),
            first_error: counts.first_error,
            is_lost: counts.is_lost,
            counts: vec![
                ("reports", counts.reports),
                ("attitudes", counts.attitudes),
                ("packets", counts.packets),
                ("packets_lost", counts.lost),
                ("packets_unread", counts.unread),
                ("commands", counts.commands),
                ("commands_refused", counts.refused),
                ("faults", counts.faults),
            ],
            ..SinkLine::default()
        }
    }
}

impl Sink for TrackerTap {
    fn name(&self) -> &'static str {
        self.inner.name()
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        self.newest = frame.meta.number;
        for mouth in &mut self.mouths {
            if mouth.send(frame) {
                mouth.taken += 1;
            } else {
                mouth.lost += 1;
                self.losses.push(Loss { kind: LossKind::TelemetryLost, frame: frame.meta.number });
            }
        }
        self.inner.send(frame)
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        for mouth in &mut self.mouths {
            mouth.full = None;
            mouth.shared.join();
        }
        let finished = self.inner.finish();
        self.summary = finished.as_ref().ok().cloned();
        finished
    }

    fn counts(&self) -> Vec<(&'static str, u64)> {
        self.inner.counts()
    }

    fn take_losses(&mut self, announce: &mut dyn FnMut(Loss)) {
        self.inner.take_losses(announce);
        self.losses.drain(..).for_each(&mut *announce);
        for mouth in &self.mouths {
            for _ in 0..mouth.shared.take_new_losses() {
                announce(Loss { kind: LossKind::TelemetryLost, frame: self.newest });
            }
        }
    }

    fn lines(&self) -> Vec<SinkLine> {
        let mut lines = sink_lines(&*self.inner, self.summary.as_ref());
        lines.extend(self.mouths.iter().map(Mouth::line));
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use frames::sink::{NullSink, compliance::check_sink, sample::sample_frame};

    fn shared() -> Arc<OutShared> {
        Arc::new(OutShared::new("tracker_out[0]".into(), "json"))
    }

    #[test]
    fn the_tap_complies() {
        check_sink(|| Box::new(tracker_tap(Box::new(NullSink::new()), Some([31, 17]), shared()).0)).unwrap();
    }

    #[test]
    fn a_slow_tracker_loses_frames_which_are_counted_and_named() {
        let (mut tap, parts) = tracker_tap(Box::new(NullSink::new()), Some([31, 17]), shared());
        (0..6).for_each(|number| tap.send(&sample_frame(number)).unwrap());
        let mut losses = Vec::new();
        tap.take_losses(&mut |loss| losses.push((loss.kind, loss.frame)));
        assert_eq!(losses, [(LossKind::TelemetryLost, 4), (LossKind::TelemetryLost, 5)]);
        let first = parts.full.try_recv().unwrap();
        assert_eq!((first.number, first.image.pixels()), (0, sample_frame(0).image.pixels()));
        parts.empty.try_send(first).unwrap();
        tap.send(&sample_frame(6)).unwrap();
        tap.finish().unwrap();
        let lines = tap.lines();
        assert_eq!((lines.len(), lines[1].frames, lines[1].dropped), (2, 5, 2));
    }
}
