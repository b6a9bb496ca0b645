//! Bytes as the terminal gives them, errors marked -> bytes of the line, errors counted.
//!
//! With PARMRK (POSIX, termios) a byte that came with a parity or framing error, or a break, is read as `FF 00 XX`, and
//! a good byte FF as `FF FF`. A damaged byte becomes the delimiter 00: its packet ends there and is rejected, whatever
//! the byte was.

use super::DELIMITER;

const MARK: u8 = 0xFF;
const DAMAGED: u8 = 0x00;

/// Takes the marks out. A mark may begin in one read and end in the next.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Unmark {
    state: State,
}

#[derive(Debug, Clone, Copy, Default)]
enum State {
    #[default]
    Plain,
    /// After FF.
    Marked,
    /// After FF 00.
    Damaged,
}

impl Unmark {
    /// Takes the marks out in place: number of bytes left at the front, and of damaged ones among them.
    pub(super) fn take(&mut self, bytes: &mut [u8]) -> (usize, u64) {
        let (mut len, mut errors) = (0, 0);
        for at in 0..bytes.len() {
            let byte = bytes[at];
            let (next, out) = match (self.state, byte) {
                (State::Plain, MARK) => (State::Marked, None),
                (State::Marked, DAMAGED) => (State::Damaged, None),
                (State::Damaged, _) => {
                    errors += 1;
                    (State::Plain, Some(DELIMITER))
                }
                // FF FF is a good FF. Nothing else should follow FF; another byte is taken as it is.
                (State::Plain | State::Marked, byte) => (State::Plain, Some(byte)),
            };
            self.state = next;
            if let Some(out) = out {
                bytes[len] = out;
                len += 1;
            }
        }
        (len, errors)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn take(unmark: &mut Unmark, bytes: &[u8]) -> (Vec<u8>, u64) {
        let mut bytes = bytes.to_vec();
        let (len, errors) = unmark.take(&mut bytes);
        bytes.truncate(len);
        (bytes, errors)
    }

    #[test]
    fn marks_are_taken_out_and_damage_counted() {
        let cases: [(&[u8], &[u8], u64); 6] = [
            (&[1, 0, 2], &[1, 0, 2], 0),
            (&[0xFF, 0xFF, 0xFF, 0xFF], &[0xFF, 0xFF], 0),
            (&[1, 0xFF, 0, 0x41, 2], &[1, 0, 2], 1),
            (&[0xFF, 0, 0], &[0], 1),
            (&[0xFF, 0, 0xFF, 0xFF, 0xFF], &[0, 0xFF], 1),
            (&[0xFF, 0, 1, 0xFF, 0, 2], &[0, 0], 2),
        ];
        for (read, line, errors) in cases {
            assert_eq!(take(&mut Unmark::default(), read), (line.to_vec(), errors), "{read:02x?}");
        }
    }

    #[test]
    fn reads_may_end_anywhere() {
        let read = [1, 0xFF, 0xFF, 0xFF, 0, 0x41, 2, 0xFF, 0, 0, 3];
        for border in 0..=read.len() {
            let mut unmark = Unmark::default();
            let (front, back) = read.split_at(border);
            let (mut line, mut errors) = take(&mut unmark, front);
            let rest = take(&mut unmark, back);
            line.extend(rest.0);
            errors += rest.1;
            assert_eq!((line, errors), (vec![1, 0xFF, 0, 2, 0, 3], 2), "border at {border}");
        }
    }
}
