//! A Parquet file -> the cells of Gaia's columns, some thousand rows at a time.
//!
//! Columns are found by name; numbers are INT32, INT64, FLOAT or DOUBLE, optional or not, and blank where they are null
//! or not a number. Pages may be plain or dictionaries, of either version, unpacked, Snappy or Zstandard. Memory: of
//! each column one page, its dictionary, and [`BATCH_ROWS`] cells. The CRC-32 of a page is checked where it has one;
//! most writers (pyarrow among them, by default) write none, and a changed value in such a file goes unnoticed.
//!
//! Parquet files -> stars for layers.
//!
//! Rows become stars as those of Gaia's CSV do ([`crate::published::gaia`]): by the same columns, of the same units,
//! with the same counts of what is blank. A row of a partition must lie in the pixel of the partition, within 0.02 mas
//! (0.06 arcsec where places are of single precision).

use crate::hats::file::{ParquetFile, caught};
use crate::hats::pixel::Pixel;
use crate::published::gaia::{COLUMNS, DEC, Names, RA, SOURCE_ID, star_of_row};
use base::{refused::Refused, units::DEG};
use parquet::basic::{ConvertedType, LogicalType, Type};
use parquet::data_type::{DataType, DoubleType, FloatType, Int32Type, Int64Type};
use parquet::file::serialized_reader::SerializedPageReader;
use parquet::schema::types::{ColumnDescPtr, ColumnDescriptor};
use parquet::{column::page::PageReader, column::reader::ColumnReaderImpl, file::metadata::RowGroupMetaData};
use stars::layer::Sorting;
use std::{path::Path, sync::Arc};

/// Identifiers of a catalog that starloop wrote, in the place of `source_id`.
pub const STARLOOP_ID: &str = "starloop_id";
/// Rows of a batch.
const BATCH_ROWS: usize = 8192;
/// Accepted types of a column of numbers.
const WANTED_NUMBER: &str = "numbers: INT32, INT64, FLOAT or DOUBLE, one a row";
/// Accepted types of a column of identifiers.
const WANTED_WHOLE: &str = "whole numbers: INT32 or INT64, one a row";

/// The rows of a file, read batch by batch.
pub(super) struct Rows {
    pub(super) file: ParquetFile,
    names: [String; COLUMNS],
    /// Place of each column in the file; `None`: it has no such column, and needs none.
    places: [Option<usize>; COLUMNS],
    /// Row group that is read, and rows of it to come.
    group: usize,
    left: usize,
    readers: Vec<(usize, ColumnRows)>,
    /// Rows of batches before.
    before: u64,
    pub(super) batch: Batch,
}

/// Cells of a few thousand rows.
#[derive(Debug, Default)]
pub(super) struct Batch {
    pub(super) rows: usize,
    ids: Vec<Option<i64>>,
    /// Not a number where they are blank; empty when the file has no such column.
    numbers: [Vec<f64>; COLUMNS],
}

impl Rows {
    /// Finds the columns of a file.
    pub(super) fn begin(file: ParquetFile, of_archive: &Names) -> Result<Self, Refused> {
        let schema = file.metadata.file_metadata().schema_descr();
        let place = |name: &str| schema.columns().iter().position(|column| column.path().string() == name);
        let mut names: [String; COLUMNS] = core::array::from_fn(|column| of_archive.here(column).into());
        let is_archives = names[SOURCE_ID] == Names::all()[SOURCE_ID];
        if is_archives && place(&names[SOURCE_ID]).is_none() && place(STARLOOP_ID).is_some() {
            names[SOURCE_ID] = STARLOOP_ID.into();
        }
        let places = core::array::from_fn(|column| place(&names[column]));
        let missing = of_archive.missing(|column| places[column].is_some());
        if !missing.is_empty() {
            let there: Vec<String> = schema.columns().iter().map(|column| column.path().string()).collect();
            let (column, got) = (missing.join(", "), format!("none; the file has {}", there.join(", ")));
            return Err(Refused(format!(
                "{path}, column {column}: wanted a column of that name, got {got}",
                path = file.path.display()
            )));
        }
        for (column, place) in places.iter().enumerate() {
            let Some(place) = place else { continue };
            if let Err((wanted, got)) = check_type(&schema.column(*place), column == SOURCE_ID) {
                return Err(Refused(format!(
                    "{path}, column {column}: wanted {wanted}, got {got}",
                    path = file.path.display(),
                    column = names[column]
                )));
            }
        }
        let (readers, batch) = (Vec::new(), Batch::default());
        Ok(Self { file, names, places, group: 0, left: 0, readers, before: 0, batch })
    }

    /// Returns whether places are of single precision: good to a tenth of an arcsecond.
    pub(super) fn has_coarse_places(&self) -> bool {
        let schema = self.file.metadata.file_metadata().schema_descr();
        [RA, DEC]
            .iter()
            .filter_map(|column| self.places[*column])
            .any(|place| schema.column(place).physical_type() == Type::FLOAT)
    }

    /// Reads the next rows into the batch; false at the end of the file.
    pub(super) fn read_batch(&mut self) -> Result<bool, Refused> {
        self.before += self.batch.rows as u64;
        while self.left == 0 {
            if self.group == self.file.metadata.num_row_groups() {
                return Ok(false);
            }
            self.open_group()?;
        }
        let rows = self.left.min(BATCH_ROWS);
        self.left -= rows;
        self.batch.rows = rows;
        for (column, reader) in &mut self.readers {
            let batch = &mut self.batch;
            let read = caught(|| match *column {
                SOURCE_ID => reader.read_ids(rows, &mut batch.ids),
                column => reader.read_numbers(rows, &mut batch.numbers[column]),
            });
            let column = &self.names[*column];
            read.map_err(|why| {
                Refused(format!("{path}, column {column}: damaged: {why}", path = self.file.path.display()))
            })?;
        }
        Ok(true)
    }

    fn open_group(&mut self) -> Result<(), Refused> {
        let group = self.file.metadata.row_group(self.group);
        let rows = u64::try_from(group.num_rows()).unwrap_or(0);
        self.readers.clear();
        self.group += 1;
        if rows == 0 {
            return Ok(());
        }
        for (column, place) in self.places.iter().enumerate() {
            let Some(place) = *place else { continue };
            let damaged = |why| {
                Refused(format!(
                    "{path}, column {column}: damaged: {why}",
                    path = self.file.path.display(),
                    column = self.names[column]
                ))
            };
            let chunk = group.column(place);
            let value_bytes = if matches!(chunk.column_type(), Type::INT32 | Type::FLOAT) { 4 } else { 8 };
            self.file.check_pages(chunk, rows, value_bytes).map_err(damaged)?;
            let reader = caught(|| ColumnRows::open(&self.file, group, place)).map_err(damaged)?;
            self.readers.push((column, reader));
        }
        self.left = usize::try_from(rows).unwrap_or(usize::MAX);
        Ok(())
    }

    /// Returns the row of the file, from 1.
    pub(super) fn number_of(&self, row: usize) -> u64 {
        self.before + row as u64 + 1
    }

    pub(super) fn source_id(&self, row: usize) -> Result<i64, Refused> {
        self.batch.ids[row].ok_or_else(|| self.refuse(row, SOURCE_ID, "a whole number", "null".into()))
    }

    /// Returns a number, or `None` where the cell is blank or the file has no such column.
    pub(super) fn number(&self, row: usize, column: usize) -> Result<Option<f64>, Refused> {
        match self.batch.numbers[column].get(row).copied().filter(|number| !number.is_nan()) {
            Some(number) if number.is_infinite() => {
                Err(self.refuse(row, column, "a number, or null", number.to_string()))
            }
            number => Ok(number),
        }
    }

    /// Returns whether the rows' numbers are their places in layers, and not those of a source catalog.
    pub(super) fn has_places_as_ids(&self) -> bool {
        self.names[SOURCE_ID] == STARLOOP_ID
    }

    pub(super) fn refuse(&self, row: usize, column: usize, wanted: &'static str, got: String) -> Refused {
        let (path, column) = (self.file.path.clone(), self.names[column].clone());
        Refused(format!(
            "{path}, row {row}, column {column}: wanted {wanted}, got {got}",
            path = path.display(),
            row = self.number_of(row)
        ))
    }
}

/// Returns whether a column holds what it should: what was wanted, and what it is.
fn check_type(column: &ColumnDescriptor, is_whole: bool) -> Result<(), (&'static str, String)> {
    let wanted = if is_whole { WANTED_WHOLE } else { WANTED_NUMBER };
    let kind = column.physical_type();
    let fits = match kind {
        Type::INT32 | Type::INT64 => true,
        Type::FLOAT | Type::DOUBLE => !is_whole,
        Type::BOOLEAN | Type::INT96 | Type::BYTE_ARRAY | Type::FIXED_LEN_BYTE_ARRAY => false,
    };
    // Dates, times and decimal numbers are whole numbers of something else.
    let is_plain = match column.logical_type_ref() {
        None => matches!(
            column.converted_type(),
            ConvertedType::NONE
                | ConvertedType::INT_8
                | ConvertedType::INT_16
                | ConvertedType::INT_32
                | ConvertedType::INT_64
                | ConvertedType::UINT_8
                | ConvertedType::UINT_16
                | ConvertedType::UINT_32
                | ConvertedType::UINT_64
        ),
        Some(logical) => matches!(logical, LogicalType::Integer { .. }),
    };
    if fits && is_plain && column.max_rep_level() == 0 {
        return Ok(());
    }
    let many = if column.max_rep_level() > 0 { ", any number a row" } else { "" };
    let of = column.logical_type_ref().map_or(String::new(), |logical| format!(" of {logical:?}"));
    Err((wanted, format!("{kind}{of}{many}")))
}

/// A column of a row group as it is read.
enum ColumnRows {
    I32(Typed<Int32Type>),
    I64(Typed<Int64Type>),
    F32(Typed<FloatType>),
    F64(Typed<DoubleType>),
}

impl ColumnRows {
    fn open(file: &ParquetFile, group: &RowGroupMetaData, place: usize) -> Result<Self, String> {
        let (chunk, rows) = (group.column(place), usize::try_from(group.num_rows()).unwrap_or(0));
        let pages = SerializedPageReader::new(Arc::clone(&file.file), chunk, rows, None);
        let pages: Box<dyn PageReader> =
            Box::new(pages.map_err(|error| format!("{:?}: {error}", chunk.compression()))?);
        let column = chunk.column_descr_ptr();
        Ok(match chunk.column_type() {
            Type::INT32 => Self::I32(Typed::new(column, pages)),
            Type::INT64 => Self::I64(Typed::new(column, pages)),
            Type::FLOAT => Self::F32(Typed::new(column, pages)),
            Type::DOUBLE => Self::F64(Typed::new(column, pages)),
            other @ (Type::BOOLEAN | Type::INT96 | Type::BYTE_ARRAY | Type::FIXED_LEN_BYTE_ARRAY) => {
                return Err(format!("wanted {WANTED_NUMBER}, got {other}"));
            }
        })
    }

    fn read_ids(&mut self, rows: usize, ids: &mut Vec<Option<i64>>) -> Result<(), String> {
        ids.clear();
        match self {
            Self::I32(column) => column.read(rows, |id| ids.push(id.map(i64::from))),
            Self::I64(column) => column.read(rows, |id| ids.push(id)),
            Self::F32(_) | Self::F64(_) => Err(format!("wanted {WANTED_WHOLE}")),
        }
    }

    fn read_numbers(&mut self, rows: usize, numbers: &mut Vec<f64>) -> Result<(), String> {
        numbers.clear();
        match self {
            Self::I32(column) => column.read(rows, |number| numbers.push(number.map_or(f64::NAN, f64::from))),
            Self::I64(column) => column.read(rows, |number| numbers.push(number.map_or(f64::NAN, |n| n as f64))),
            Self::F32(column) => column.read(rows, |number| numbers.push(number.map_or(f64::NAN, f64::from))),
            Self::F64(column) => column.read(rows, |number| numbers.push(number.unwrap_or(f64::NAN))),
        }
    }
}

/// A reader of one type and what it reads into.
struct Typed<T: DataType> {
    reader: ColumnReaderImpl<T>,
    /// Definition levels: the highest is a value, lower ones are null; empty for a column without nulls.
    highest: i16,
    levels: Vec<i16>,
    values: Vec<T::T>,
}

impl<T: DataType> Typed<T> {
    fn new(column: ColumnDescPtr, pages: Box<dyn PageReader>) -> Self {
        let highest = column.max_def_level();
        Self { reader: ColumnReaderImpl::new(column, pages), highest, levels: Vec::new(), values: Vec::new() }
    }

    fn read(&mut self, rows: usize, mut each: impl FnMut(Option<T::T>)) -> Result<(), String> {
        self.levels.clear();
        self.values.clear();
        let read = self.reader.read_records(rows, Some(&mut self.levels), None, &mut self.values);
        let (records, ..) = read.map_err(|error| error.to_string())?;
        if records != rows {
            return Err(format!("wanted {rows} rows more, got {records}"));
        }
        let mut values = self.values.drain(..);
        if self.highest == 0 {
            values.for_each(|value| each(Some(value)));
            return Ok(());
        }
        for level in &self.levels {
            each(if *level == self.highest { values.next() } else { None });
        }
        Ok(())
    }
}

/// Count of rows whose place is of single precision.
pub const COARSE_PLACES: &str = "rows with places of single precision, good to 0.06 arcsec";

/// Takes a file in; returns the number of rows. `pixel` is that of the partition, when it is one. `progress` gets
/// the rows now and then.
///
/// # Errors
/// When the file cannot be read to its end, lacks a column, a cell is not a number, or a row lies elsewhere; stars
/// taken in before are then to be forgotten (no checkpoint was written).
pub fn import(
    path: &Path,
    pixel: Option<Pixel>,
    names: &Names,
    sorting: &mut Sorting,
    progress: &mut dyn FnMut(u64),
) -> Result<u64, Refused> {
    let file = ParquetFile::open(path)?;
    let wanted = file.rows()?;
    let mut rows = Rows::begin(file, names)?;
    let is_coarse = rows.has_coarse_places();
    if rows.has_places_as_ids() {
        sorting.leave_numbers_out();
    }
    let mut got = 0;
    while rows.read_batch()? {
        for row in 0..rows.batch.rows {
            if let Some(pixel) = pixel {
                check_place(&rows, row, pixel, is_coarse)?;
            }
            let number = |column| rows.number(row, column);
            let refuse = |column, wanted, got: f64| rows.refuse(row, column, wanted, got.to_string());
            if let Some(star) = star_of_row(rows.source_id(row)?, names.epoch_yr, number, refuse, sorting)? {
                let refused = |source| {
                    Refused(format!("{path}, row {row}: {source}", path = path.display(), row = rows.number_of(row)))
                };
                sorting.add(&star).map_err(refused)?;
            }
        }
        got += rows.batch.rows as u64;
        progress(got);
    }
    if is_coarse {
        sorting.announce(COARSE_PLACES, got);
    }
    if got == wanted {
        Ok(got)
    } else {
        Err(Refused::at(path, format_args!("its footer: wanted {wanted} rows, got {got}")))
    }
}

/// Checks that a row with a place is in the right partition. An illegal place is refused where the star is stored.
fn check_place(rows: &Rows, row: usize, pixel: Pixel, is_coarse: bool) -> Result<(), Refused> {
    let (Some(ra_deg), Some(dec_deg)) = (rows.number(row, RA)?, rows.number(row, DEC)?) else { return Ok(()) };
    let (ra_rad, dec_rad) = (ra_deg * DEG, dec_deg * DEG);
    match Pixel::of(pixel.order, ra_rad, dec_rad) {
        Some(got) if !pixel.has(ra_rad, dec_rad, is_coarse) => Err(Refused(format!(
            "{path}, row {row}: RA {ra_deg} Dec {dec_deg} deg: wanted pixel {wanted} of order {order}, got {got}",
            path = rows.file.path.display(),
            row = rows.number_of(row),
            wanted = pixel.number,
            order = pixel.order,
            got = got.number
        ))),
        _ => Ok(()),
    }
}
