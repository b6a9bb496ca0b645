//! Consistent overhead byte stuffing: bytes without zeros, one byte longer per 254.
//!
//! Each zero is replaced by the distance to the next one; a first byte holds the distance to the first.

use crate::Reject;

/// Distance that says "no zero follows the 254 bytes".
const FULL: u8 = 0xFF;

/// Stuffs `plain` into `stuffed`; the number of bytes written, or `None` when they do not fit.
pub(super) fn stuff(plain: &[u8], stuffed: &mut [u8]) -> Option<usize> {
    let (mut distance_at, mut at, mut distance) = (0, 1, 1);
    for &byte in plain {
        if byte != 0 {
            *stuffed.get_mut(at)? = byte;
            at += 1;
            distance += 1;
        }
        if byte == 0 || distance == FULL {
            *stuffed.get_mut(distance_at)? = distance;
            (distance_at, at, distance) = (at, at + 1, 1);
        }
    }
    *stuffed.get_mut(distance_at)? = distance;
    Some(at)
}

/// Takes the stuffing out in place; the plain bytes.
pub(super) fn unstuff(stuffed: &mut [u8]) -> Result<&[u8], Reject> {
    let (mut from, mut to) = (0, 0);
    while let Some(&distance) = stuffed.get(from) {
        let run = usize::from(distance).checked_sub(1).ok_or(Reject::BadFraming)?;
        let source = from + 1..from + 1 + run;
        from = source.end;
        if stuffed.get(source.clone()).is_none_or(|bytes| bytes.contains(&0)) {
            return Err(Reject::BadFraming);
        }
        stuffed.copy_within(source, to);
        to += run;
        if distance != FULL && from < stuffed.len() {
            *stuffed.get_mut(to).ok_or(Reject::BadFraming)? = 0;
            to += 1;
        }
    }
    stuffed.get(..to).ok_or(Reject::BadFraming)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn stuffed(plain: &[u8]) -> ([u8; 600], usize) {
        let mut space = [0xEE; 600];
        let len = stuff(plain, &mut space).unwrap();
        (space, len)
    }

    #[test]
    fn examples_worked_by_hand() {
        for (plain, wanted) in [
            (&[][..], &[1][..]),
            (&[0], &[1, 1]),
            (&[0, 0], &[1, 1, 1]),
            (&[0x11, 0x22, 0, 0x33], &[3, 0x11, 0x22, 2, 0x33]),
            (&[0x11, 0, 0, 0], &[2, 0x11, 1, 1, 1]),
        ] {
            let (space, len) = stuffed(plain);
            assert_eq!(&space[..len], wanted, "{plain:?}");
        }
    }

    #[test]
    fn broken_stuffing_is_refused() {
        for bytes in [&[3, 1][..], &[0], &[2, 0], &[1, 0, 1]] {
            let mut space = [0; 3];
            space[..bytes.len()].copy_from_slice(bytes);
            assert_eq!(unstuff(&mut space[..bytes.len()]), Err(Reject::BadFraming), "{bytes:?}");
        }
    }

    #[test]
    fn too_little_space_does_not_panic() {
        assert_eq!(stuff(&[1, 2, 3], &mut [0; 3]), None);
        assert_eq!(stuff(&[], &mut []), None);
    }

    proptest! {
        #[test]
        fn round_trips_without_zeros(plain in prop::collection::vec(prop_oneof![Just(0_u8), any::<u8>()], 0..520)) {
            let (mut space, len) = stuffed(&plain);
            prop_assert!(!space[..len].contains(&0), "a zero on the line");
            prop_assert!(len <= plain.len() + 1 + plain.len() / 254);
            prop_assert_eq!(unstuff(&mut space[..len]).unwrap(), &plain[..]);
        }

        #[test]
        fn any_bytes_are_no_panic(mut bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let _ = unstuff(&mut bytes);
        }
    }
}
