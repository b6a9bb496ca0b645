//! Stuff bits against frames written out as text, bit by bit, and against counts made by hand.

use super::*;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// Digits of a number, the highest first.
fn digits(value: usize, count: usize) -> String {
    format!("{value:0count$b}")
}

/// Returns the remainder of the polynomial division, by hand as on paper: 16 digits of divisor under the first 1.
fn remainder(message: &str) -> String {
    let divisor = b"1100010110011001";
    let mut rest = [message.as_bytes(), &[b'0'; 15]].concat();
    while let Some(first) = rest.iter().position(|digit| *digit == b'1').filter(|first| first + 16 <= rest.len()) {
        for (digit, under) in rest[first..].iter_mut().zip(divisor) {
            *digit = if *digit == *under { b'0' } else { b'1' };
        }
    }
    String::from_utf8(rest[rest.len() - 15..].to_vec()).unwrap()
}

/// Returns the bits with their stuff bits in place.
fn stuffed(bits: &str, stuffs_the_end: bool) -> String {
    let mut out = String::new();
    for (place, bit) in bits.chars().enumerate() {
        out.push(bit);
        let is_last = place + 1 == bits.len();
        if out.ends_with("00000") && (stuffs_the_end || !is_last) {
            out.push('1');
        } else if out.ends_with("11111") && (stuffs_the_end || !is_last) {
            out.push('0');
        }
    }
    out
}

fn data_bits(frame: &CanFrame) -> String {
    frame.data().iter().map(|byte| digits(usize::from(*byte), 8)).collect()
}

fn classic_by_text(frame: &CanFrame) -> u64 {
    let message = text_of(frame);
    let bits = message.clone() + &remainder(&message);
    (stuffed(&bits, true).len() - bits.len()) as u64
}

fn fd_by_text(frame: &CanFrame) -> (u64, u64) {
    let number = frame.id().number() as usize;
    // SOF, identifier, RRS, IDE; or SOF, 11 bits, SRR, IDE, 18 bits, RRS. Then FDF, reserved, BRS.
    let head = if frame.id().is_extended() {
        format!("0{}11{}0101", digits(number >> 18, 11), digits(number % (1 << 18), 18))
    } else {
        format!("0{}00101", digits(number, 11))
    };
    let code =
        [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64].iter().position(|len| *len == frame.data().len());
    let bits = format!("{head}0{}{}", digits(code.unwrap(), 4), data_bits(frame));
    let in_head = stuffed(&head, true).len() - head.len();
    ((in_head) as u64, (stuffed(&bits, false).len() - bits.len() - in_head) as u64)
}

/// Returns bytes that make runs likely.
fn random_data(dice: &mut StdRng, len: usize) -> Vec<u8> {
    let bytes = [0x00, 0xFF, 0x0F, 0xF8, 0x1F, 0x07];
    (0..len).map(|_| if dice.random::<bool>() { bytes[dice.random_range(0..6)] } else { dice.random() }).collect()
}

#[test]
fn the_crc_is_the_published_one() {
    let mut wire = Stuffer::new();
    wire.bytes(b"123456789");
    // CRC-15/CAN in the catalogue of parametrised CRC algorithms (Cook): check value 0x059E.
    assert_eq!(wire.crc, 0x059E);
    let text: String = b"123456789".iter().map(|byte| digits(usize::from(*byte), 8)).collect();
    assert_eq!(remainder(&text), digits(0x059E, 15), "and so is the division on paper");
}

#[test]
fn classic_frames_have_the_stuff_bits_of_their_text() {
    let mut dice = StdRng::seed_from_u64(1);
    let mut at_the_end = 0;
    for _ in 0..3000 {
        let len = dice.random_range(0..=8);
        let frame = CanFrame::classic(random_id(&mut dice), &random_data(&mut dice, len)).unwrap();
        let stuff = classic(&frame);
        assert_eq!(stuff, classic_by_text(&frame), "{frame:?}");
        assert!(stuff <= (34 + more_bits(&frame) + 8 * len as u64 - 1) / 4, "{frame:?}: more than the worst case");
        at_the_end += u32::from(remainder(&text_of(&frame)).ends_with("00000"));
    }
    assert!(at_the_end > 20, "CRCs that end in a run: {at_the_end}");
}

/// Returns the bits of a classic frame from its start to the end of its data.
fn text_of(frame: &CanFrame) -> String {
    let (number, length) = (frame.id().number() as usize, digits(frame.data().len(), 4));
    // SOF, identifier, RTR, IDE, r0; or SOF, 11 bits, SRR, IDE, 18 bits, RTR, r1, r0.
    let head = if frame.id().is_extended() {
        format!("0{}11{}000{length}", digits(number >> 18, 11), digits(number % (1 << 18), 18))
    } else {
        format!("0{}000{length}", digits(number, 11))
    };
    head + &data_bits(frame)
}

/// Returns an identifier of either length; runs of equal bits are likely.
fn random_id(dice: &mut StdRng) -> CanId {
    let ones = dice.random_range(0..=29);
    let number: u32 = if dice.random::<bool>() { (1 << ones) - 1 } else { dice.random_range(0..1 << 29) };
    let standard = u16::try_from(number % 0x800).ok().and_then(CanId::standard);
    if dice.random::<bool>() { CanId::extended(number) } else { standard }.unwrap()
}

/// Returns bits of an identifier that has more than 11: SRR, 18 bits, and the second reserved bit of classic frames.
fn more_bits(frame: &CanFrame) -> u64 {
    match (frame.id().is_extended(), frame.is_fd()) {
        (false, _) => 0,
        (true, false) => 20,
        (true, true) => 19,
    }
}

#[test]
fn fd_frames_have_the_stuff_bits_of_their_text() {
    let mut dice = StdRng::seed_from_u64(2);
    for _ in 0..3000 {
        let len = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64][dice.random_range(0..16)];
        let frame = CanFrame::fd(random_id(&mut dice), &random_data(&mut dice, len)).unwrap();
        let (head, rest) = fd(&frame);
        assert_eq!((head, rest), fd_by_text(&frame), "{frame:?}");
        let most = (17 + more_bits(&frame) + 5 + 8 * len as u64 - 1) / 4;
        assert!(head + rest <= most, "{frame:?}: more than the worst case");
    }
}

#[test]
fn counts_made_by_hand() {
    // 34 dominant bits, the CRC of nothing being nothing: a stuff bit after each whole 5.
    assert_eq!(classic(&CanFrame::classic(0, &[]).unwrap()), 6);
    // 14 dominant bits before FDF: 2. Then ESI and length, 5 dominant bits, where the fixed stuff bit is.
    assert_eq!(fd(&CanFrame::fd(0, &[]).unwrap()), (2, 0));
    // The same, then 1 and 8 dominant bits: 1.
    assert_eq!(fd(&CanFrame::fd(0, &[0]).unwrap()), (2, 1));
    // 0 then 11 recessive: 2, and 3 dominant; the alternating data have none.
    assert_eq!(fd(&CanFrame::fd(0x7FF, &[0x55]).unwrap()), (2, 0));
    // 29 bits: 12 dominant bits, 2 recessive, 22 or 19 dominant; a stuff bit after each whole 5.
    let zero = CanId::extended(0).unwrap();
    assert_eq!(fd(&CanFrame::fd(zero, &[]).unwrap()), (2 + 3, 0));
    // All recessive: 1 dominant, 31 recessive (6 stuff bits, the first run has 5), 1 dominant before FDF.
    assert_eq!(fd(&CanFrame::fd(CanId::LAST, &[0x55]).unwrap()).0, 6);
}

#[test]
fn exact_frames_are_shorter_on_the_wire() {
    use crate::{Packet, simulated::BusTiming};
    use base::time::Span;
    let bus = BusTiming::CanClassic { bit_rate_bps: 500_000 };
    let frame = Packet::Can(CanFrame::classic(0, &[]).unwrap());
    // 44 bits, 6 stuff bits and 3 of interframe space, of 2 us each.
    assert_eq!(bus.duration_with(&frame, Stuffing::Exact), Some(Span::from_ns(53 * 2000)));
    assert_eq!(bus.duration_with(&frame, Stuffing::Worst), bus.duration(&frame));
    // An identifier of 29 bits has 20 more; SRR and IDE among them change the CRC: counted as text.
    let long = CanFrame::classic(CanId::extended(0).unwrap(), &[]).unwrap();
    let bits = 64 + i64::try_from(classic_by_text(&long)).unwrap() + 3;
    assert_eq!(bus.duration_with(&Packet::Can(long), Stuffing::Exact), Some(Span::from_ns(bits * 2000)));
    let bus = BusTiming::CanFd { arbitration_bps: 500_000, data_bps: 5_000_000 };
    let frame = Packet::Can(CanFrame::fd(0, &[0]).unwrap());
    // 17 + 2 + 13 slow bits; 5 + 8 + 1 stuff + 4 count + 17 CRC + 6 fixed fast ones.
    assert_eq!(bus.duration_with(&frame, Stuffing::Exact), Some(Span::from_ns(32 * 2000 + 41 * 200)));
}
