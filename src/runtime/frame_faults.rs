//! What goes wrong with frames, on purpose: withheld, repeated, late, torn, blank, or veiled by stray light.
//!
//! In: a list of faults, each with its begin and end. A frame is hit when its exposure ends inside a fault's time. Every
//! hit is counted by fault and marked in the frame's own flags, so that nothing is spoilt in silence. Deterministic.

use crate::base::time::{Span, Tai};
use crate::runtime::engine::FrameEngine;
use crate::sink::{FaultFlags, FrameFault, SentFrame};

/// A fault with its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedFrameFault {
    /// Begin.
    pub from: Tai,
    /// End, exclusive.
    pub until: Tai,
    /// What happens.
    pub fault: FrameFault,
    /// Frames hit so far.
    pub hits: u64,
}

/// What becomes of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fate {
    /// Not sent.
    pub is_dropped: bool,
    /// Sent later by this.
    pub delay: Span,
    is_repeated: bool,
    is_torn: bool,
    is_blank: bool,
    flags: FaultFlags,
}

impl Fate {
    /// Sent, once, in time and whole.
    pub const SEND: Self = Self {
        is_dropped: false,
        delay: Span::ZERO,
        is_repeated: false,
        is_torn: false,
        is_blank: false,
        flags: FaultFlags::NONE,
    };
}

/// A fault elsewhere that frames exposed in its time are marked with.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Mark {
    from: Tai,
    until: Tai,
    flag: FaultFlags,
}

/// The faults of one head.
#[derive(Debug, Default)]
pub struct FrameFaults {
    timed: Vec<TimedFrameFault>,
    marks: Vec<Mark>,
    previous: Vec<u16>,
}

impl FrameFaults {
    /// Adds a fault; the number under which [`Self::timed`] lists it.
    pub fn add(&mut self, from: Tai, until: Tai, fault: FrameFault) -> usize {
        self.timed.push(TimedFrameFault { from, until, fault, hits: 0 });
        self.timed.len() - 1
    }

    /// Marks frames whose exposure ends in a time at which something else is faulty: the bus.
    pub fn mark(&mut self, from: Tai, until: Tai, flag: FaultFlags) {
        self.marks.push(Mark { from, until, flag });
    }

    /// Every fault, in the order in which they were added.
    #[must_use]
    pub fn timed(&self) -> &[TimedFrameFault] {
        &self.timed
    }

    /// What becomes of the frame whose exposure ends at `release`; sets the stray light it is exposed with.
    pub fn begin(&mut self, release: Tai, engine: &mut FrameEngine) -> Fate {
        let mut fate = Fate::SEND;
        let mut stray_e_per_s = 0.0;
        for mark in self.marks.iter().filter(|mark| mark.from <= release && release < mark.until) {
            fate.flags |= mark.flag;
        }
        let has_previous = !self.previous.is_empty();
        for timed in self.timed.iter_mut().filter(|timed| timed.from <= release && release < timed.until) {
            // The first frame of all has none before it to be repeated.
            if !has_previous && matches!(timed.fault, FrameFault::Torn | FrameFault::Duplicate) {
                continue;
            }
            timed.hits += 1;
            fate.flags |= timed.fault.flag();
            match timed.fault {
                FrameFault::Drop => fate.is_dropped = true,
                FrameFault::Duplicate => fate.is_repeated = true,
                FrameFault::Late(delay) => fate.delay = fate.delay.max(delay),
                FrameFault::Torn => fate.is_torn = true,
                FrameFault::Blank => fate.is_blank = true,
                FrameFault::StrayLight { e_per_s } => stray_e_per_s += e_per_s,
            }
        }
        #[allow(clippy::cast_possible_truncation, reason = "electrons are single precision")]
        engine.set_stray_light_e((stray_e_per_s * engine.params().camera.exposure_s) as f32);
        fate
    }

    /// Spoils the finished frame and says so in its flags.
    pub fn spoil(&mut self, fate: &Fate, frame: &mut SentFrame) {
        frame.meta.faults |= fate.flags;
        if fate.is_blank {
            let black = frame.meta.black_level_dn.round().clamp(0.0, f64::from(u16::MAX));
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
            frame.image.pixels_mut().fill(black as u16);
            frame.truth.clear();
        }
        if self.needs_previous() {
            self.repeat(fate, frame);
        }
    }

    fn needs_previous(&self) -> bool {
        self.timed.iter().any(|timed| matches!(timed.fault, FrameFault::Torn | FrameFault::Duplicate))
    }

    /// Puts all or half of the previous image into the frame, and keeps what the frame was.
    fn repeat(&mut self, fate: &Fate, frame: &mut SentFrame) {
        let pixels = frame.image.pixels_mut();
        if self.previous.len() != pixels.len() {
            self.previous.clear();
            self.previous.extend_from_slice(pixels);
            return;
        }
        let repeated = match fate {
            Fate { is_repeated: true, .. } => pixels.len(),
            Fate { is_torn: true, .. } => pixels.len() / 2,
            _ => 0,
        };
        pixels[..repeated].swap_with_slice(&mut self.previous[..repeated]);
        if !fate.is_repeated {
            self.previous[repeated..].copy_from_slice(&pixels[repeated..]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame() -> SentFrame {
        let mut frame = SentFrame::with_capacity(4, 4, 0, "test".into());
        frame.image.pixels_mut().fill(7);
        frame.meta.black_level_dn = 100.0;
        frame
    }

    #[test]
    fn a_torn_frame_has_the_upper_half_of_the_one_before() {
        let mut faults = FrameFaults::default();
        faults.add(Tai::from_ns(5), Tai::from_ns(9), FrameFault::Torn);
        let mut first = frame();
        faults.spoil(&Fate::SEND, &mut first);
        let mut second = frame();
        second.image.pixels_mut().fill(9);
        faults.spoil(&Fate { is_torn: true, flags: FaultFlags::FRAME_TORN, ..Fate::SEND }, &mut second);
        assert_eq!(second.image.pixels()[..8], [7; 8]);
        assert_eq!(second.image.pixels()[8..], [9; 8]);
        assert!(second.meta.faults.contains(FaultFlags::FRAME_TORN));
        assert_eq!(first.image.pixels(), [7; 16], "a frame outside the fault is whole");
    }

    #[test]
    fn a_repeated_frame_is_the_one_before() {
        let mut faults = FrameFaults::default();
        faults.add(Tai::from_ns(5), Tai::from_ns(9), FrameFault::Duplicate);
        faults.spoil(&Fate::SEND, &mut frame());
        let mut second = frame();
        second.image.pixels_mut().fill(9);
        faults.spoil(&Fate { is_repeated: true, ..Fate::SEND }, &mut second);
        assert_eq!(second.image.pixels(), [7; 16]);
        let mut third = frame();
        third.image.pixels_mut().fill(11);
        faults.spoil(&Fate { is_repeated: true, ..Fate::SEND }, &mut third);
        assert_eq!(third.image.pixels(), [9; 16], "what the second would have been");
    }

    #[test]
    fn a_blank_frame_is_black_and_has_no_truth() {
        let mut faults = FrameFaults::default();
        let mut spoilt = frame();
        faults.spoil(&Fate { is_blank: true, ..Fate::SEND }, &mut spoilt);
        assert_eq!(spoilt.image.pixels(), [100; 16]);
        assert!(spoilt.truth.is_empty());
    }
}
