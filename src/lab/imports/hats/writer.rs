//! Stars -> the Parquet files of a catalog: its partitions, and the footers of all of them in one file.
//!
//! Columns: `_healpix_29` (nested HEALPix at order 29, by which rows are sorted), `starloop_id` (the star's place in
//! the layers, in the order they were named), `source_id` (its number in its source catalog, when all layers have
//! numbers), `ra`, `dec` (deg, ICRS), `pmra` (with cos dec), `pmdec` (mas/yr), `parallax` (mas), `phot_g_mean_mag`,
//! `bp_rp` (mag); null where it is unknown. Pages are Zstandard.

use super::file::MAGIC;
use base::{refused::Refused, units::DEG};
use parquet::data_type::{DataType, DoubleType, FloatType, Int64Type};
use parquet::errors::{ParquetError, Result as Written};
use parquet::file::metadata::{FileMetaData, ParquetMetaData, ParquetMetaDataWriter, RowGroupMetaData, SortingColumn};
use parquet::file::properties::{EnabledStatistics, WriterProperties, WriterPropertiesPtr};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{SchemaDescriptor, TypePtr};
use parquet::{basic::Compression, schema::parser::parse_message_type};
use stars::layer::NewStar;
use std::{fs::File, io::Write, path::Path, sync::Arc};

/// Rows of a row group: what is packed, and read, at a time.
const GROUP_ROWS: usize = 131_072;
/// Writer of a file, in the form that Parquet asks for.
const WRITER: &str = concat!("starloop version ", env!("CARGO_PKG_VERSION"));
/// The column of numbers, where the layers have them.
const SOURCE_ID: &str = "required int64 source_id;";
const SCHEMA: &str = "message catalog {
    required int64 _healpix_29;
    required int64 starloop_id;
    SOURCE_ID    required double ra;
    required double dec;
    optional float pmra;
    optional float pmdec;
    optional float parallax;
    required double phot_g_mean_mag;
    optional float bp_rp;
}";

/// A row of a catalog.
#[derive(Debug, Clone, Copy)]
pub(super) struct CatalogRow {
    /// Nested HEALPix number at order 29.
    pub(super) healpix: u64,
    /// The star's place in the layers.
    pub(super) starloop_id: i64,
    pub(super) star: NewStar,
}

/// Writes partitions and keeps their footers.
pub(super) struct CatalogWriter {
    schema: TypePtr,
    properties: WriterPropertiesPtr,
    has_numbers: bool,
    groups: Vec<RowGroupMetaData>,
}

impl CatalogWriter {
    pub(super) fn new(has_numbers: bool) -> Written<Self> {
        let by_healpix = SortingColumn { column_idx: 0, descending: false, nulls_first: false };
        let properties = WriterProperties::builder()
            .set_compression(Compression::ZSTD(Default::default()))
            .set_dictionary_enabled(false)
            .set_statistics_enabled(EnabledStatistics::Chunk)
            .set_offset_index_disabled(true)
            .set_sorting_columns(Some(vec![by_healpix]))
            .set_created_by(WRITER.into());
        let schema = SCHEMA.replace("SOURCE_ID", if has_numbers { SOURCE_ID } else { "" });
        let schema = Arc::new(parse_message_type(&schema)?);
        Ok(Self { schema, properties: Arc::new(properties.build()), has_numbers, groups: Vec::new() })
    }

    /// Writes sorted rows to the file `within` the folder `dataset`.
    pub(super) fn write(&mut self, dataset: &Path, within: &str, rows: &[CatalogRow]) -> Result<(), Refused> {
        let path = dataset.join(within);
        let file = File::create(&path).map_err(Refused::file("cannot make", &path))?;
        let write = || {
            let mut file = SerializedFileWriter::new(file, Arc::clone(&self.schema), Arc::clone(&self.properties))?;
            for rows in rows.chunks(GROUP_ROWS) {
                write_group(file.next_row_group()?, rows, self.has_numbers)?;
            }
            for group in file.close()?.row_groups() {
                self.groups.push(group_of(group, within)?);
            }
            Ok(())
        };
        write()
            .map_err(|source: std::io::Error| Refused(format!("cannot write {path}: {source}", path = path.display())))
    }

    /// Writes `_metadata`, the footers of all partitions, and `_common_metadata`, that of none.
    pub(super) fn finish(self, dataset: &Path) -> Result<(), Refused> {
        let schema = Arc::new(SchemaDescriptor::new(self.schema));
        for (name, groups) in [("_common_metadata", Vec::new()), ("_metadata", self.groups)] {
            let rows = groups.iter().map(RowGroupMetaData::num_rows).sum();
            let footer = FileMetaData::new(1, rows, Some(WRITER.into()), None, Arc::clone(&schema), None);
            let metadata = ParquetMetaData::new(footer, groups);
            let path = dataset.join(name);
            let mut file = File::create(&path).map_err(Refused::file("cannot make", &path))?;
            file.write_all(&MAGIC).map_err(Refused::file("cannot write", &path))?;
            let written = ParquetMetaDataWriter::new(file, &metadata).finish();
            written.map_err(|source| Refused(format!("cannot write {path}: {source}", path = path.display())))?;
        }
        Ok(())
    }
}

/// Returns the entry of a row group of one footer for the footer of another file.
fn group_of(group: &RowGroupMetaData, within: &str) -> Written<RowGroupMetaData> {
    let of_file = |column: &_| parquet::file::metadata::ColumnChunkMetaData::clone(column).into_builder();
    let columns = group.columns().iter().map(|column| of_file(column).set_file_path(within.into()).build());
    let columns = columns.collect::<Written<Vec<_>>>()?;
    group.clone().into_builder().set_column_metadata(columns).build()
}

fn write_group(mut group: SerializedRowGroupWriter<'_, File>, rows: &[CatalogRow], has_numbers: bool) -> Written<()> {
    known::<Int64Type>(&mut group, rows, |row| row.healpix.cast_signed())?;
    known::<Int64Type>(&mut group, rows, |row| row.starloop_id)?;
    if has_numbers {
        known::<Int64Type>(&mut group, rows, |row| row.star.source_id)?;
    }
    known::<DoubleType>(&mut group, rows, |row| row.star.ra_rad / DEG)?;
    known::<DoubleType>(&mut group, rows, |row| row.star.dec_rad / DEG)?;
    maybe(&mut group, rows, |row| row.star.motion_mas_yr.map(|[east, _]| east))?;
    maybe(&mut group, rows, |row| row.star.motion_mas_yr.map(|[_, north]| north))?;
    maybe(&mut group, rows, |row| row.star.parallax_mas)?;
    known::<DoubleType>(&mut group, rows, |row| row.star.mag_g)?;
    maybe(&mut group, rows, |row| row.star.bp_rp)?;
    group.close().map(|_| ())
}

fn known<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, File>,
    rows: &[CatalogRow],
    value: impl Fn(&CatalogRow) -> T::T,
) -> Written<()> {
    let values: Vec<T::T> = rows.iter().map(value).collect();
    write_column::<T>(group, &values, None)
}

#[allow(clippy::cast_possible_truncation, reason = "an f32 holds every step of these fields to 1e-7 of itself")]
fn maybe(
    group: &mut SerializedRowGroupWriter<'_, File>,
    rows: &[CatalogRow],
    value: impl Fn(&CatalogRow) -> Option<f64>,
) -> Written<()> {
    let levels: Vec<i16> = rows.iter().map(|row| i16::from(value(row).is_some())).collect();
    let values: Vec<f32> = rows.iter().filter_map(|row| value(row).map(|value| value as f32)).collect();
    write_column::<FloatType>(group, &values, Some(&levels))
}

fn write_column<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, File>,
    values: &[T::T],
    levels: Option<&[i16]>,
) -> Written<()> {
    let column = group.next_column()?;
    let mut column = column.ok_or_else(|| ParquetError::General("fewer columns than the schema has".into()))?;
    column.typed::<T>().write_batch(values, levels, None)?;
    column.close()
}
