//! Frames from the sink's thread to the presenter's, with no one waiting.
//!
//! Five buffers go round: one that is shown, one that the presenter holds until its time, two on the way, one to be
//! filled. Of frames whose time has come the newest wins; one that is put while two are on the way takes the older
//! one's place. A frame without a time to wait for is shown at the next refresh.

use base::time::Tai;
use crossbeam_channel::{Receiver, Sender, bounded};

/// Frames on the way.
const WAITING: usize = 2;
/// Buffers in all.
const BUFFERS: usize = WAITING + 3;

/// Luminances of one frame, row by row.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub(super) struct Luminances {
    /// Number of the frame.
    pub(super) number: u32,
    /// Start of its exposure: when its light is to begin.
    pub(super) light: Option<Tai>,
    /// Its pixels.
    pub(super) pixels: Vec<u16>,
}

impl Luminances {
    fn is_due(&self, by: Option<Tai>) -> bool {
        match (self.light, by) {
            (Some(light), Some(by)) => light <= by,
            _ => true,
        }
    }
}

/// The sink's end.
#[derive(Debug)]
pub(super) struct Outgoing {
    full: Sender<Luminances>,
    /// The other end of `full`, to take back frames that were not fetched.
    not_fetched: Receiver<Luminances>,
    empty: Receiver<Luminances>,
    returned: Sender<Luminances>,
}

/// The presenter's end.
#[derive(Debug)]
pub(super) struct Incoming {
    full: Receiver<Luminances>,
    returned: Sender<Luminances>,
    /// Fetched, and not yet due.
    next: Option<Luminances>,
}

/// Returns both ends, for frames of so many pixels.
pub(super) fn hand_over(pixels: usize) -> (Outgoing, Incoming) {
    let (full, fetched) = bounded(WAITING);
    let (returned, empty) = bounded(BUFFERS);
    for _ in 0..BUFFERS {
        // The queue has space for all buffers.
        let _ = returned.try_send(Luminances { pixels: vec![0; pixels], ..Luminances::default() });
    }
    let outgoing = Outgoing { full, not_fetched: fetched.clone(), empty, returned: returned.clone() };
    (outgoing, Incoming { full: fetched, returned, next: None })
}

impl Outgoing {
    /// Puts a frame on the way; true when it replaced one that was not fetched.
    pub(super) fn put(&self, number: u32, light: Option<Tai>, pixels: &[u16]) -> bool {
        let mut has_replaced = false;
        let free = self.empty.try_recv().or_else(|_| {
            let taken_back = self.not_fetched.try_recv();
            has_replaced = taken_back.is_ok();
            taken_back
        });
        // With five buffers one is always free or on the way; a presenter that has ended may have kept its own.
        let Ok(mut buffer) = free else { return false };
        (buffer.number, buffer.light) = (number, light);
        buffer.pixels.clear();
        buffer.pixels.extend_from_slice(pixels);
        while let Err(refused) = self.full.try_send(buffer) {
            if let Ok(older) = self.not_fetched.try_recv() {
                has_replaced = true;
                let _ = self.returned.try_send(older); // the queue has space for all buffers
            }
            buffer = refused.into_inner();
        }
        has_replaced
    }
}

impl Incoming {
    /// Returns whether nothing is on its way.
    pub(super) fn is_empty(&self) -> bool {
        self.next.is_none() && self.full.is_empty()
    }

    /// Exchanges `shown` for the newest frame whose light is to begin at `by` or before (`None`: for the newest of
    /// all). Returns how many older ones it passed over; `None` when no such frame waits.
    pub(super) fn fetch(&mut self, shown: &mut Luminances, by: Option<Tai>) -> Option<u64> {
        let mut fetched = 0_u64;
        while let Some(next) = self.next.take().or_else(|| self.full.try_recv().ok()) {
            if !next.is_due(by) {
                self.next = Some(next);
                break;
            }
            let _ = self.returned.try_send(core::mem::replace(shown, next)); // the queue has space for all buffers
            fetched += 1;
        }
        fetched.checked_sub(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_wins_and_what_it_replaced_is_reported() {
        let (outgoing, mut incoming) = hand_over(2);
        let mut shown = Luminances::default();
        assert_eq!(incoming.fetch(&mut shown, None), None, "nothing yet");
        let reported: Vec<bool> = (0..5).map(|number| outgoing.put(number, None, &[number as u16; 2])).collect();
        assert_eq!(reported, [false, false, true, true, true]);
        assert_eq!(incoming.fetch(&mut shown, Some(Tai::from_ns(0))), Some(1), "3 was there too");
        assert_eq!((shown.number, shown.pixels.as_slice()), (4, [4; 2].as_slice()));
        assert_eq!(incoming.fetch(&mut shown, None), None, "fetched once");
        assert!(!outgoing.put(5, None, &[5; 2]));
        assert_eq!(incoming.fetch(&mut shown, None), Some(0));
        assert_eq!(shown.number, 5);
    }

    #[test]
    fn a_frame_waits_for_its_time_and_those_behind_it_wait_too() {
        let (outgoing, mut incoming) = hand_over(1);
        let mut shown = Luminances::default();
        let at = |ns| Some(Tai::from_ns(ns));
        for number in 1..=3_u32 {
            assert!(!outgoing.put(number, at(100 * i64::from(number)), &[number as u16]), "{number}");
            // Fetched at once, so that two more fit.
            assert_eq!(incoming.fetch(&mut shown, at(99)), None);
        }
        assert!(!incoming.is_empty());
        assert_eq!((incoming.fetch(&mut shown, at(100)), shown.number), (Some(0), 1), "on the edge");
        assert_eq!(incoming.fetch(&mut shown, at(199)), None);
        assert_eq!((incoming.fetch(&mut shown, at(305)), shown.number), (Some(1), 3), "2 came too late to be seen");
        assert!(incoming.is_empty());
        outgoing.put(4, at(400), &[4]);
        assert_eq!((incoming.fetch(&mut shown, None), shown.number), (Some(0), 4), "at the end nothing waits");
    }

    #[test]
    fn ended_presenter_does_not_stop_the_sender() {
        let (outgoing, incoming) = hand_over(1);
        drop(incoming);
        for number in 0..20 {
            let _ = outgoing.put(number, None, &[0]); // taken, or replaces the one before
        }
    }

    #[test]
    fn both_ends_at_once_lose_nothing_unseen() {
        let (outgoing, mut incoming) = hand_over(64);
        let most = 20_000;
        let puts = std::thread::Builder::new()
            .spawn(move || (1..=most).filter(|number| outgoing.put(*number, None, &[*number as u16; 64])).count())
            .unwrap();
        let (mut shown, mut seen) = (Luminances::default(), 0);
        while shown.number < most {
            let before = shown.number;
            if let Some(passed) = incoming.fetch(&mut shown, None) {
                seen += 1 + passed as usize;
                assert!(shown.number > before, "{} after {before}", shown.number);
                assert!(shown.pixels.iter().all(|pixel| *pixel == shown.number as u16), "no torn frame");
            }
        }
        assert_eq!(seen + puts.join().unwrap(), most as usize, "each was fetched, passed over or replaced");
    }
}
