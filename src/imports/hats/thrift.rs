//! The part of Thrift's compact protocol that gives the sizes announced by a Parquet file, before anything is allocated
//! for them. Source: Apache Thrift, "Thrift Compact protocol encoding"; Apache Parquet, `parquet.thrift` (field
//! numbers).
//!
//! Every step gives `None` when the bytes end too early or make no sense.

/// Structs in structs: a Parquet file has four.
const DEEPEST: u8 = 16;

/// Kinds of fields.
const BOOLS: [u8; 2] = [1, 2];
const BYTE: u8 = 3;
const INTEGERS: [u8; 3] = [4, 5, 6];
const DOUBLE: u8 = 7;
const BINARY: u8 = 8;
const LISTS: [u8; 2] = [9, 10];
const STRUCT: u8 = 12;

/// Bytes that are read from the front.
pub(super) struct Compact<'a> {
    pub(super) bytes: &'a [u8],
}

impl Compact<'_> {
    fn byte(&mut self) -> Option<u8> {
        let (first, rest) = self.bytes.split_first()?;
        self.bytes = rest;
        Some(*first)
    }

    fn unsigned(&mut self) -> Option<u64> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7F) << shift;
            if byte & 0x80 == 0 {
                return Some(value);
            }
        }
        None
    }

    /// Returns a signed number.
    pub(super) fn signed(&mut self) -> Option<i64> {
        let folded = self.unsigned()?;
        Some((folded >> 1).cast_signed() ^ -(folded & 1).cast_signed())
    }

    /// Returns the number and kind of the next field of a struct, `None` at its end; `last` is the number of the field
    /// before.
    pub(super) fn field(&mut self, last: &mut i64) -> Option<Option<(i64, u8)>> {
        let head = self.byte()?;
        if head & 0x0F == 0 {
            return Some(None);
        }
        *last = if head >> 4 == 0 { self.signed()? } else { last.checked_add(i64::from(head >> 4))? };
        Some(Some((*last, head & 0x0F)))
    }

    /// Returns the kind and number of the elements of a list.
    pub(super) fn list(&mut self) -> Option<(u8, u64)> {
        let head = self.byte()?;
        let count = if head >> 4 == 15 { self.unsigned()? } else { u64::from(head >> 4) };
        Some((head & 0x0F, count))
    }

    /// Leaves a field of this kind out.
    pub(super) fn skip(&mut self, kind: u8) -> Option<()> {
        self.skip_within(kind, 0)
    }

    fn skip_within(&mut self, kind: u8, depth: u8) -> Option<()> {
        match kind {
            kind if BOOLS.contains(&kind) => Some(()),
            BYTE => self.byte().map(|_| ()),
            kind if INTEGERS.contains(&kind) => self.unsigned().map(|_| ()),
            DOUBLE => self.skip_bytes(8),
            BINARY => {
                let length = self.unsigned()?;
                self.skip_bytes(length)
            }
            kind if LISTS.contains(&kind) && depth < DEEPEST => {
                let (kind, count) = self.list()?;
                // A truth value alone has no byte as a field, and one as an element.
                let kind = if BOOLS.contains(&kind) { BYTE } else { kind };
                (0..count).try_for_each(|_| self.skip_within(kind, depth + 1))
            }
            STRUCT if depth < DEEPEST => {
                let mut last = 0;
                while let Some((_, kind)) = self.field(&mut last)? {
                    self.skip_within(kind, depth + 1)?;
                }
                Some(())
            }
            _ => None,
        }
    }

    fn skip_bytes(&mut self, count: u64) -> Option<()> {
        self.bytes = self.bytes.get(usize::try_from(count).ok()?..)?;
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_as_the_protocol_has_them() {
        for (bytes, wanted) in [(&[0][..], 0), (&[1], -1), (&[2], 1), (&[0xFE, 0xFF, 3], 32_767), (&[0xAC, 2], 150)] {
            assert_eq!(Compact { bytes }.signed(), Some(wanted), "{bytes:?}");
        }
        assert_eq!(Compact { bytes: &[0x80; 20] }.signed(), None, "without end");
        assert_eq!(Compact { bytes: &[0x80] }.signed(), None, "cut short");
    }

    #[test]
    fn structs_are_left_out_whole() {
        // A struct of all kinds: true, byte, i32, double, binary, list of two i32, list of two truth values, struct.
        let bytes = [
            0x11, 0x13, 7, 0x15, 0x80, 1, 0x17, 0, 0, 0, 0, 0, 0, 0, 0, 0x18, 2, b'a', b'b', 0x19, 0x25, 2, 4, 0x19,
            0x21, 1, 2, 0x1C, 0x15, 2, 0, 0, 99,
        ];
        let mut compact = Compact { bytes: &bytes };
        compact.skip(STRUCT).unwrap();
        assert_eq!(compact.bytes, [99]);
        for cut in 0..bytes.len() - 1 {
            assert_eq!(Compact { bytes: &bytes[..cut] }.skip(STRUCT), None, "cut to {cut}");
        }
        assert_eq!(Compact { bytes: &[0x1C; 100] }.skip(STRUCT), None, "structs in structs");
        assert_eq!(Compact { bytes: &[0xF9, 0xFF, 0xFF, 0xFF, 0xFF, 7] }.skip(LISTS[0]), None, "more than there is");
    }
}
