//! A Parquet file -> its footer, checked so far that nothing is allocated for what is not there.
//!
//! The crate that decodes Parquet trusts some sizes of a file: of its tree of columns, of a page when it is unpacked,
//! of a dictionary. These are read first here ([`super::thrift`]) and compared with the file. Limits: a footer of 64
//! MiB, pages of 64 MiB unpacked (writers make pages of about 1 MiB). Tests: `super::tests::damage`.

use super::{caught::caught, thrift::Compact};
use base::refused::Refused;
use parquet::file::metadata::{ColumnChunkMetaData, ParquetMetaData, ParquetMetaDataReader};
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::{fs::File, sync::Arc};

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
