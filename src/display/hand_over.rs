//! The newest frame, from the sink's thread to the presenter's, with no one waiting.
//!
//! Three buffers go round: one with the presenter, one on the way, one to be filled. A frame that is put while another is
//! still on the way takes its place.

use crossbeam_channel::{Receiver, Sender, bounded};

/// Buffers in all.
const BUFFERS: usize = 3;

/// Luminances of one frame, row by row.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub(super) struct Luminances {
    /// Number of the frame.
    pub(super) number: u32,
    /// Its pixels.
    pub(super) pixels: Vec<u16>,
}

/// The sink's end.
#[derive(Debug)]
pub(super) struct Outgoing {
    full: Sender<Luminances>,
    /// The other end of `full`: to take back what was not fetched.
    not_fetched: Receiver<Luminances>,
    empty: Receiver<Luminances>,
    returned: Sender<Luminances>,
}

/// The presenter's end.
#[derive(Debug)]
pub(super) struct Incoming {
    full: Receiver<Luminances>,
    returned: Sender<Luminances>,
}

/// Both ends, for frames of so many pixels.
pub(super) fn hand_over(pixels: usize) -> (Outgoing, Incoming) {
    let (full, fetched) = bounded(1);
    let (returned, empty) = bounded(BUFFERS);
    for _ in 0..BUFFERS {
        let _there_is_room_for_all = returned.try_send(Luminances { number: 0, pixels: vec![0; pixels] });
    }
    let outgoing = Outgoing { full, not_fetched: fetched.clone(), empty, returned: returned.clone() };
    (outgoing, Incoming { full: fetched, returned })
}

impl Outgoing {
    /// Puts a frame on the way; true when it took the place of one that nobody had fetched.
    pub(super) fn put(&self, number: u32, pixels: &[u16]) -> bool {
        let mut has_replaced = false;
        let free = self.empty.try_recv().or_else(|_| {
            let taken_back = self.not_fetched.try_recv();
            has_replaced = taken_back.is_ok();
            taken_back
        });
        // With three buffers one is always free or on the way; a presenter that has ended may have kept its own.
        let Ok(mut buffer) = free else { return false };
        buffer.number = number;
        buffer.pixels.clear();
        buffer.pixels.extend_from_slice(pixels);
        while let Err(refused) = self.full.try_send(buffer) {
            if let Ok(older) = self.not_fetched.try_recv() {
                has_replaced = true;
                let _there_is_room_for_all = self.returned.try_send(older);
            }
            buffer = refused.into_inner();
        }
        has_replaced
    }
}

impl Incoming {
    /// Whether nothing is on its way.
    pub(super) fn is_empty(&self) -> bool {
        self.full.is_empty()
    }

    /// Exchanges `shown` for the newest frame; false when there is none.
    pub(super) fn fetch(&self, shown: &mut Luminances) -> bool {
        let Ok(newest) = self.full.try_recv() else { return false };
        let _there_is_room_for_all = self.returned.try_send(core::mem::replace(shown, newest));
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_wins_and_what_it_replaced_is_told() {
        let (outgoing, incoming) = hand_over(2);
        let mut shown = Luminances::default();
        assert!(!incoming.fetch(&mut shown), "nothing yet");
        let told: Vec<bool> = (0..5).map(|number| outgoing.put(number, &[number as u16; 2])).collect();
        assert_eq!(told, [false, true, true, true, true]);
        assert!(incoming.fetch(&mut shown));
        assert_eq!((shown.number, shown.pixels.as_slice()), (4, [4; 2].as_slice()));
        assert!(!incoming.fetch(&mut shown), "fetched once");
        assert!(!outgoing.put(5, &[5; 2]));
        assert!(incoming.fetch(&mut shown));
        assert_eq!(shown.number, 5);
    }

    #[test]
    fn a_presenter_that_is_gone_stops_nobody() {
        let (outgoing, incoming) = hand_over(1);
        drop(incoming);
        let replaced = (0..20).filter(|number| outgoing.put(*number, &[0])).count();
        assert_eq!(replaced, 19, "each takes the place of the one before");
    }

    #[test]
    fn both_ends_at_once_lose_nothing_unseen() {
        let (outgoing, incoming) = hand_over(64);
        let most = 20_000;
        let puts = std::thread::Builder::new()
            .spawn(move || (1..=most).filter(|number| outgoing.put(*number, &[*number as u16; 64])).count())
            .unwrap();
        let (mut shown, mut fetched) = (Luminances::default(), 0);
        while shown.number < most {
            let before = shown.number;
            if incoming.fetch(&mut shown) {
                fetched += 1;
                assert!(shown.number > before, "{} after {before}", shown.number);
                assert!(shown.pixels.iter().all(|pixel| *pixel == shown.number as u16), "no torn frame");
            }
        }
        assert_eq!(fetched + puts.join().unwrap(), most as usize, "each was fetched or replaced");
    }
}
