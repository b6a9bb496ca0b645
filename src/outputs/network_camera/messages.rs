//! The message channel: events of the camera -> datagrams to the client, sent again until they are acknowledged.
//!
//! ```text
//! header: 0x42, flags u8, code u16, length u16, id u16
//! event:  0 u16, event u16, stream channel u16 (FFFF: none), block u16 (0: none), time stamp u64    | frame number u64
//! ```
//!
//! EVENTDATA_CMD carries the number of the frame; a missed trigger has no frame of its own, so its number is that of
//! the frame that is exposed or awaited then. With a timeout (MCTT) each message waits for its answer and is sent again
//! as often as the client said (MCRC); without, it is sent once. One message is under way at a time; when the queue
//! behind it is full, new messages are lost and counted. Time is an argument. Event identifiers up to 0x8FFF are the
//! standard's.
//!
//! Proven by `outputs::network_camera::device_tests` and `hil_scripts/tests/test_camera_events.py` (tshark, the reference
//! GenApi).

use crate::network_camera::counters::Tally;
use base::time::{Span, Tai};
use frames::camera_control::{CameraEvent, CameraEventKind};
use std::collections::VecDeque;

/// Code of an event with data; its answer has the next number.
const EVENT_DATA: u16 = 0x00C2;
const KEY: u8 = 0x42;
const WANTS_ANSWER: u8 = 0x01;
/// Bytes of the header of a command, of an event, and of the data behind it.
const HEADER_BYTES: usize = 8;
const EVENT_BYTES: usize = 16;
const DATA_BYTES: usize = 8;
/// Where an event's time stamp and data begin, from the event's first byte.
pub(super) const TIMESTAMP_AT: usize = 8;
pub(super) const FRAME_ID_AT: usize = EVENT_BYTES;
/// No stream channel, and no block.
const NO_CHANNEL: u16 = 0xFFFF;
const NO_BLOCK: u16 = 0;
/// Events that may wait.
const PLACES: usize = 256;

/// An event that clients may want.
pub(super) struct Event {
    /// Name of the selector's entry.
    pub(super) name: &'static str,
    /// Its identifier on the wire.
    pub(super) id: u16,
    kind: CameraEventKind,
}

/// Every event, by its number in the selector.
pub(super) const EVENTS: [Event; 4] = [
    Event { name: "FrameTrigger", id: 0x0002, kind: CameraEventKind::FrameTrigger },
    Event { name: "ExposureStart", id: 0x0003, kind: CameraEventKind::ExposureStart },
    Event { name: "ExposureEnd", id: 0x0004, kind: CameraEventKind::ExposureEnd },
    Event { name: "FrameTriggerMissed", id: 0x9001, kind: CameraEventKind::FrameTriggerMissed },
];

/// Where messages go, and how long they wait for an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Channel {
    /// Zero: none is waited for.
    pub(super) timeout: Span,
    /// Repetitions of a message that is not answered.
    pub(super) retries: u32,
}

/// A message that waits for its answer.
#[derive(Debug, Clone, Copy)]
struct Flight {
    event: CameraEvent,
    id: u16,
    deadline: Tai,
    retries_left: u32,
}

/// Messages on their way.
#[derive(Debug)]
pub(super) struct Messages {
    waiting: VecDeque<CameraEvent>,
    flight: Option<Flight>,
    last_id: u16,
    /// Events that are wanted, one bit each.
    wanted: u32,
}

impl Messages {
    pub(super) fn new() -> Self {
        Self { waiting: VecDeque::with_capacity(PLACES), flight: None, last_id: 0, wanted: 0 }
    }

    /// Ends the messages, and discards waiting ones.
    pub(super) fn clear(&mut self) {
        self.waiting.clear();
        (self.flight, self.wanted) = (None, 0);
    }

    /// Returns 1 when the event of this number is wanted.
    pub(super) fn is_wanted(&self, number: u32) -> u32 {
        self.wanted >> number & 1
    }

    /// Wants the event of this number, or does not.
    pub(super) fn want(&mut self, number: u32, is_wanted: bool) {
        self.wanted = self.wanted & !(1 << number) | u32::from(is_wanted) << number;
    }

    /// Returns true when any event is wanted.
    pub(super) fn is_open(&self) -> bool {
        self.wanted != 0
    }

    /// Takes in an event, when it is wanted.
    pub(super) fn push(&mut self, event: CameraEvent, tally: &Tally) {
        let number = EVENTS.iter().position(|known| known.kind == event.kind);
        if number.is_none_or(|number| self.wanted >> number & 1 == 0) {
            return;
        }
        if self.waiting.len() == PLACES {
            return tally.events_lost.one();
        }
        self.waiting.push_back(event);
    }

    /// Writes the message that is to be sent now into `out`; false for none.
    pub(super) fn next(&mut self, channel: Channel, now: Tai, tally: &Tally, out: &mut Vec<u8>) -> bool {
        if let Some(flight) = self.flight.as_mut().filter(|flight| flight.deadline <= now) {
            if flight.retries_left > 0 {
                flight.retries_left -= 1;
                flight.deadline = now + channel.timeout;
                write(&flight.event, flight.id, true, out);
                return true;
            }
            tally.events_lost.one();
            self.flight = None;
        }
        if self.flight.is_some() {
            return false;
        }
        let Some(event) = self.waiting.pop_front() else { return false };
        self.last_id = if self.last_id == u16::MAX { 1 } else { self.last_id + 1 };
        let is_answered = channel.timeout > Span::ZERO;
        if is_answered {
            let deadline = now + channel.timeout;
            self.flight = Some(Flight { event, id: self.last_id, deadline, retries_left: channel.retries });
        }
        write(&event, self.last_id, is_answered, out);
        tally.events_sent.one();
        true
    }

    /// Takes an answer of the client.
    pub(super) fn acknowledge(&mut self, answer: &[u8]) {
        let Some(flight) = &self.flight else { return };
        let [code, id] = [EVENT_DATA + 1, flight.id].map(u16::to_be_bytes);
        if answer.get(2..4) == Some(&code[..]) && answer.get(6..HEADER_BYTES) == Some(&id[..]) {
            self.flight = None;
        }
    }
}

/// Writes one message in place of the old contents.
fn write(event: &CameraEvent, id: u16, is_answered: bool, out: &mut Vec<u8>) {
    let known = EVENTS.iter().find(|known| known.kind == event.kind);
    out.clear();
    out.extend([KEY, if is_answered { WANTS_ANSWER } else { 0 }]);
    out.extend(EVENT_DATA.to_be_bytes());
    out.extend(u16::try_from(EVENT_BYTES + DATA_BYTES).unwrap_or_default().to_be_bytes());
    out.extend(id.to_be_bytes());
    for half in [0, known.map_or(0, |known| known.id), NO_CHANNEL, NO_BLOCK] {
        out.extend(half.to_be_bytes());
    }
    out.extend(u64::try_from(event.at.ns()).unwrap_or_default().to_be_bytes());
    out.extend(u64::from(event.frame).to_be_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: Tai = Tai::from_ns(7_000_000_000);
    const PATIENT: Channel = Channel { timeout: Span::from_ms(100), retries: 2 };
    const END: CameraEvent =
        CameraEvent { kind: CameraEventKind::ExposureEnd, at: Tai::from_ns(0x0102_0304_0506), frame: 9 };

    fn open() -> (Messages, Tally) {
        let mut messages = Messages::new();
        messages.want(2, true);
        (messages, Tally::default())
    }

    #[test]
    fn message_by_hand() {
        let (mut messages, tally) = open();
        let mut out = Vec::new();
        messages.push(END, &tally);
        messages.push(CameraEvent { kind: CameraEventKind::ExposureStart, ..END }, &tally);
        assert!(messages.next(PATIENT, NOW, &tally, &mut out));
        let wanted = [
            &[0x42, 1, 0, 0xC2, 0, 24, 0, 1][..],
            &[0, 0, 0, 4, 0xFF, 0xFF, 0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 0, 0, 0, 0, 0, 0, 0, 9],
        ];
        assert_eq!(out, wanted.concat());
        messages.acknowledge(&[0, 0, 0, 0xC3, 0, 0, 0, 1]);
        assert!(!messages.next(PATIENT, NOW, &tally, &mut out), "the start is not wanted");
        assert_eq!((tally.events_sent.read(), tally.events_lost.read()), (1, 0));
    }

    #[test]
    fn message_without_an_answer_is_repeated_and_then_given_up() {
        let (mut messages, tally) = open();
        let mut out = Vec::new();
        (0..2).for_each(|_| messages.push(END, &tally));
        let at = |ms| NOW + Span::from_ms(ms);
        let sent: Vec<i64> = (0..400).filter(|ms| messages.next(PATIENT, at(*ms), &tally, &mut out)).collect();
        assert_eq!(sent, [0, 100, 200, 300], "the second event follows when the first is given up");
        assert_eq!(out[6..8], [0, 2]);
        assert_eq!((tally.events_sent.read(), tally.events_lost.read()), (2, 1));
        for wrong in [&[][..], &[0, 0, 0, 0xC3, 0, 0, 0, 1], &[0, 0, 0, 0xC1, 0, 0, 0, 2]] {
            messages.acknowledge(wrong);
            assert!(messages.flight.is_some(), "{wrong:?}");
        }
        messages.acknowledge(&[0, 0, 0, 0xC3, 0, 0, 0, 2]);
        assert!(messages.flight.is_none());
    }

    #[test]
    fn without_a_timeout_each_message_is_sent_once_and_places_are_limited() {
        let (mut messages, tally) = open();
        let channel = Channel { timeout: Span::ZERO, retries: 5 };
        (0..300).for_each(|_| messages.push(END, &tally));
        let mut out = Vec::new();
        let sent = (0..300).filter(|_| messages.next(channel, NOW, &tally, &mut out)).count();
        assert_eq!((sent, tally.events_lost.read()), (PLACES, 300 - PLACES as u64));
        assert_eq!(out[1], 0, "no answer is wanted");
        messages.push(END, &tally);
        messages.clear();
        assert!(!messages.is_open() && !messages.next(channel, NOW, &tally, &mut out));
    }
}
