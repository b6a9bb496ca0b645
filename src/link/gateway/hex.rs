//! Hexadecimal digits, without allocation.

use firmware_protocol::can::CanId;

/// Returns the value of one digit, in either case.
pub(super) fn digit(character: u8) -> Option<u8> {
    char::from(character).to_digit(16).and_then(|value| u8::try_from(value).ok())
}

/// Returns the value of one to eight digits.
pub(super) fn digits(text: &[u8]) -> Option<u32> {
    if text.is_empty() || text.len() > 8 {
        return None;
    }
    text.iter().try_fold(0_u32, |value, character| Some(value << 4 | u32::from(digit(*character)?)))
}

/// Adds `count` upper-case digits of `value`, the highest first.
pub(super) fn put_digits(out: &mut Vec<u8>, value: u32, count: u32) {
    for place in (0..count).rev() {
        let digit = char::from_digit(value >> (4 * place) & 0xF, 16).unwrap_or('0');
        out.push(digit.to_ascii_uppercase() as u8);
    }
}

/// Adds 3 digits of an identifier of 11 bits, 8 of one with 29.
pub(super) fn put_id(out: &mut Vec<u8>, id: CanId) {
    put_digits(out, id.number(), if id.is_extended() { 8 } else { 3 });
}

/// Adds two digits per byte.
pub(super) fn put_bytes(out: &mut Vec<u8>, bytes: &[u8]) {
    bytes.iter().for_each(|byte| put_digits(out, u32::from(*byte), 2));
}
