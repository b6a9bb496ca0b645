//! A Parquet file -> its footer, checked so far that nothing is allocated for what is not there.
//!
//! The crate that decodes Parquet trusts some sizes of a file: of its tree of columns, of a page when it is unpacked,
//! of a dictionary. These are read first here ([`Compact`]) and compared with the file. Limits: a footer of 64
//! MiB, pages of 64 MiB unpacked (writers make pages of about 1 MiB). Tests: `super::tests::damage`.
//!
//! [`Compact`] is the part of Thrift's compact protocol that gives the sizes announced by a file. Source: Apache Thrift, "Thrift Compact protocol encoding"; Apache Parquet, `parquet.thrift` (field
//! numbers).
//!
//! Every step gives `None` when the bytes end too early or make no sense.
//!
//! A panic of that crate becomes an error: it asserts things of files that damaged files do not keep.

use base::refused::Refused;
use core::cell::Cell;
use parquet::file::metadata::{ColumnChunkMetaData, ParquetMetaData, ParquetMetaDataReader};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Once};

/// First and last bytes of a Parquet file.
pub(super) const MAGIC: [u8; 4] = *b"PAR1";
/// Length of the footer, and the magic.
const END_BYTES: u64 = 8;
/// Longest footer, and largest page.
const MOST_BYTES: u64 = 64 << 20;
/// Longest head of a page: those of numbers have some 100 bytes.
const PAGE_HEAD_BYTES: u64 = 4096;
/// Columns within columns.
const DEEPEST: usize = 32;
/// Of `FileMetaData`: the columns; of one column: how many are within it.
const SCHEMA: i64 = 2;
const CHILDREN: i64 = 5;
/// Encodings that are read: plain, both dictionaries, delta, byte streams.
const ENCODINGS: [i64; 5] = [0, 2, 8, 5, 9];

/// A Parquet file that was opened.
#[derive(Debug)]
pub(super) struct ParquetFile {
    pub(super) path: PathBuf,
    pub(super) file: Arc<File>,
    pub(super) metadata: ParquetMetaData,
    /// Where the footer begins.
    footer_at: u64,
}

impl ParquetFile {
    pub(super) fn open(path: &Path) -> Result<Self, Refused> {
        let damaged = |why| Refused::at(path, format_args!("damaged, or no Parquet file: {why}"));
        let mut file = File::open(path).map_err(Refused::file("cannot open", path))?;
        let bytes = file.metadata().map_err(Refused::file("cannot read", path))?.len();
        let mut read = |at: u64, count: u64| read_at(&mut file, at, count).map_err(Refused::file("cannot read", path));
        let ends = MAGIC.len() as u64 + END_BYTES;
        if bytes < ends {
            return Err(damaged(format!("wanted at least {ends} bytes, got {bytes}")));
        }
        let end = read(bytes - END_BYTES, END_BYTES)?;
        if end[4..] != MAGIC || read(0, 4)? != MAGIC {
            return Err(damaged("wanted \"PAR1\" at both ends: cut short, half written or of another kind".into()));
        }
        let length = u64::from(u32::from_le_bytes([end[0], end[1], end[2], end[3]]));
        if length > MOST_BYTES.min(bytes - ends) {
            return Err(damaged(format!(
                "a footer of {length} bytes in a file of {bytes}; at most {MOST_BYTES} are read"
            )));
        }
        let footer_at = bytes - END_BYTES - length;
        let footer = read(footer_at, length)?;
        if !has_sound_columns(&footer).unwrap_or(false) {
            return Err(damaged("its footer has no sound list of columns".into()));
        }
        let metadata = caught(|| ParquetMetaDataReader::decode_metadata(&footer).map_err(|error| error.to_string()));
        let file = Self { path: path.into(), file: Arc::new(file), metadata: metadata.map_err(damaged)?, footer_at };
        file.rows()?;
        Ok(file)
    }

    /// Returns rows of the file.
    pub(super) fn rows(&self) -> Result<u64, Refused> {
        let mut groups = self.metadata.row_groups().iter().map(|group| u64::try_from(group.num_rows()).ok());
        let sum = groups.try_fold(0_u64, |sum, rows| sum.checked_add(rows?));
        let wanted = self.metadata.file_metadata().num_rows();
        sum.filter(|sum| u64::try_from(wanted) == Ok(*sum)).ok_or_else(|| {
            Refused::at(
                &self.path,
                format_args!(
                    "damaged, or no Parquet file: {wanted} rows in its footer, and another number in its row groups"
                ),
            )
        })
    }

    /// Reads the heads of all pages of a column of a row group and compares them with the file.
    pub(super) fn check_pages(&self, column: &ColumnChunkMetaData, rows: u64, value_bytes: u64) -> Result<(), String> {
        let begin = column.dictionary_page_offset().unwrap_or(column.data_page_offset());
        let begin = u64::try_from(begin).unwrap_or(u64::MAX);
        let length = u64::try_from(column.compressed_size()).unwrap_or(u64::MAX);
        let end = begin.checked_add(length).filter(|end| *end <= self.footer_at);
        let Some(end) = end.filter(|_| begin >= MAGIC.len() as u64) else {
            return Err(format!("{length} bytes at {begin} are not before the footer at {}", self.footer_at));
        };
        if u64::try_from(column.num_values()) != Ok(rows) {
            return Err(format!("wanted {rows} values, got {}", column.num_values()));
        }
        let (mut file, mut at, mut values) = (&*self.file, begin, 0_u64);
        while at < end {
            let page_at = at;
            let reported = |what: &str| format!("page at byte {page_at}: {what}");
            let head =
                read_at(&mut file, at, PAGE_HEAD_BYTES.min(end - at)).map_err(|error| reported(&error.to_string()))?;
            let (page, head_bytes) = PageHead::read(&head).ok_or_else(|| reported("its head makes no sense"))?;
            at += head_bytes;
            values = values.saturating_add(page.check(end - at, value_bytes).map_err(|what| reported(&what))?);
            at += page.packed_bytes;
        }
        if values == rows { Ok(()) } else { Err(format!("wanted {rows} values in its pages, got {values}")) }
    }
}

/// Returns whether every column that has columns within it has as many as there are, and they are not endlessly deep.
fn has_sound_columns(footer: &[u8]) -> Option<bool> {
    let mut compact = Compact { bytes: footer };
    let mut last = 0;
    while let Some((number, kind)) = compact.field(&mut last)? {
        if number != SCHEMA {
            compact.skip(kind)?;
            continue;
        }
        // Columns that are awaited, at each depth.
        let mut awaited = vec![1_u64];
        for _ in 0..compact.list()?.1 {
            let children = children(&mut compact)?;
            while awaited.last() == Some(&0) {
                awaited.pop();
            }
            *awaited.last_mut()? -= 1;
            if children > 0 {
                awaited.push(children);
            }
            if children > footer.len() as u64 || awaited.len() > DEEPEST {
                return Some(false);
            }
        }
        return Some(awaited.iter().all(|left| *left == 0));
    }
    Some(false)
}

fn children(compact: &mut Compact<'_>) -> Option<u64> {
    let (mut last, mut children) = (0, 0);
    while let Some((number, kind)) = compact.field(&mut last)? {
        match number {
            CHILDREN => children = u64::try_from(compact.signed()?).ok()?,
            _ => compact.skip(kind)?,
        }
    }
    Some(children)
}

/// Sizes from the head of a page.
#[derive(Debug, Default)]
struct PageHead {
    kind: i64,
    unpacked_bytes: u64,
    packed_bytes: u64,
    values: u64,
    encoding: i64,
}

impl PageHead {
    const INDEX: i64 = 1;
    const DICTIONARY: i64 = 2;

    /// Reads the head of a page; returns it with its length, bytes.
    fn read(bytes: &[u8]) -> Option<(Self, u64)> {
        let (mut head, mut compact, mut last) = (Self::default(), Compact { bytes }, 0);
        while let Some((number, kind)) = compact.field(&mut last)? {
            match number {
                1 => head.kind = compact.signed()?,
                2 => head.unpacked_bytes = u64::try_from(compact.signed()?).ok()?,
                3 => head.packed_bytes = u64::try_from(compact.signed()?).ok()?,
                // Data, dictionary, data of version 2.
                5 => head.read_inner(&mut compact, 2)?,
                7 => head.read_inner(&mut compact, 2)?,
                8 => head.read_inner(&mut compact, 4)?,
                _ => compact.skip(kind)?,
            }
        }
        Some((head, (bytes.len() - compact.bytes.len()) as u64))
    }

    fn read_inner(&mut self, compact: &mut Compact<'_>, encoding: i64) -> Option<()> {
        let mut last = 0;
        while let Some((number, kind)) = compact.field(&mut last)? {
            match number {
                1 => self.values = u64::try_from(compact.signed()?).ok()?,
                number if number == encoding => self.encoding = compact.signed()?,
                _ => compact.skip(kind)?,
            }
        }
        Some(())
    }

    /// Returns the rows it holds, when it fits into the bytes that are left.
    fn check(&self, left_bytes: u64, value_bytes: u64) -> Result<u64, String> {
        let Self { kind, unpacked_bytes, packed_bytes, values, encoding } = self;
        if *packed_bytes > left_bytes || (*packed_bytes).max(*unpacked_bytes) > MOST_BYTES {
            return Err(format!(
                "{packed_bytes} bytes, unpacked {unpacked_bytes}: {left_bytes} are left, and {MOST_BYTES} are read at most"
            ));
        }
        match *kind {
            Self::INDEX => Ok(0),
            _ if !ENCODINGS.contains(encoding) => Err(format!("encoding {encoding} is not read")),
            Self::DICTIONARY if values.checked_mul(value_bytes) != Some(*unpacked_bytes) => {
                Err(format!("a dictionary of {values} values in {unpacked_bytes} bytes"))
            }
            Self::DICTIONARY => Ok(0),
            _ => Ok(*values),
        }
    }
}

fn read_at(file: &mut (impl Read + Seek), at: u64, count: u64) -> std::io::Result<Vec<u8>> {
    file.seek(SeekFrom::Start(at))?;
    let mut bytes = vec![0; usize::try_from(count).unwrap_or(usize::MAX)];
    file.read_exact(&mut bytes)?;
    Ok(bytes)
}

/// Structs in structs: a Parquet file has four.
const DEEPEST_STRUCT: u8 = 16;

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
            kind if LISTS.contains(&kind) && depth < DEEPEST_STRUCT => {
                let (kind, count) = self.list()?;
                // A truth value alone has no byte as a field, and one as an element.
                let kind = if BOOLS.contains(&kind) { BYTE } else { kind };
                (0..count).try_for_each(|_| self.skip_within(kind, depth + 1))
            }
            STRUCT if depth < DEEPEST_STRUCT => {
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

thread_local! {
    static IS_READING: Cell<bool> = const { Cell::new(false) };
}

/// Returns the result of `read`, or its message when it panics. Panics elsewhere are reported as usual.
pub(super) fn caught<T>(read: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    static QUIET_WHILE_READING: Once = Once::new();
    QUIET_WHILE_READING.call_once(|| {
        let announce = take_hook();
        set_hook(Box::new(move |panic| {
            if !IS_READING.get() {
                announce(panic);
            }
        }));
    });
    IS_READING.set(true);
    let done = catch_unwind(AssertUnwindSafe(read));
    IS_READING.set(false);
    done.unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<&str>().copied().or(panic.downcast_ref::<String>().map(String::as_str));
        Err(format!("the reader gave up: {}", text.unwrap_or("it does not say why")))
    })
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

#[cfg(test)]
mod caught_tests {
    use super::*;

    #[test]
    fn panics_are_errors_and_the_next_reading_is_as_before() {
        assert_eq!(caught::<()>(|| panic!("no {}", "dictionary")), Err("the reader gave up: no dictionary".into()));
        assert_eq!(caught::<()>(|| panic!("plain")), Err("the reader gave up: plain".into()));
        assert_eq!(caught(|| Ok(5)), Ok(5));
        assert_eq!(caught::<()>(|| Err("no".into())), Err("no".into()));
    }
}
