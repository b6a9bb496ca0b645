//! Columns -> a Parquet file of one row group.
//!
//! In: named columns of one length. Out: bytes, the same on every machine: no time, no name of a machine. Numbers that are
//! not finite are missing cells. Tests: below, and with pyarrow in `hil_scripts/test_data_sets.py`.

use anyhow::{Result, bail};
use parquet::basic::{Compression, ZstdLevel};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::{file::metadata::KeyValue, file::properties::WriterProperties, schema::parser::parse_message_type};
use std::sync::Arc;

/// Level of compression: the fastest.
const LEVEL: i32 = 1;

/// Cells of one column.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Cells {
    /// Whole numbers.
    Whole(Vec<i64>),
    /// Whole numbers, some missing.
    SomeWhole(Vec<Option<i64>>),
    /// Numbers.
    Real(Vec<f64>),
    /// Text.
    Text(Vec<String>),
}

impl Cells {
    fn len(&self) -> usize {
        match self {
            Self::Whole(cells) => cells.len(),
            Self::SomeWhole(cells) => cells.len(),
            Self::Real(cells) => cells.len(),
            Self::Text(cells) => cells.len(),
        }
    }

    fn kind(&self) -> &'static str {
        match self {
            Self::Whole(_) => "required int64",
            Self::SomeWhole(_) => "optional int64",
            Self::Real(_) => "optional double",
            Self::Text(_) => "required binary",
        }
    }

    fn annotation(&self) -> &'static str {
        match self {
            Self::Text(_) => " (STRING)",
            Self::Whole(_) | Self::SomeWhole(_) | Self::Real(_) => "",
        }
    }
}

/// Returns the bytes of a table with a text about it.
///
/// # Errors
/// When columns differ in length, or the library refuses them.
pub(crate) fn bytes_of(columns: &[(&str, Cells)], about: &[(&str, String)]) -> Result<Vec<u8>> {
    let rows = columns.first().map_or(0, |(_, cells)| cells.len());
    if let Some((name, cells)) = columns.iter().find(|(_, cells)| cells.len() != rows) {
        bail!("column {name} has {} rows, wanted {rows}", cells.len());
    }
    let field = |(name, cells): &(&str, Cells)| format!("{} {name}{};", cells.kind(), cells.annotation());
    let schema = format!("message rows {{ {} }}", columns.iter().map(field).collect::<Vec<_>>().join(" "));
    let pairs = about.iter().map(|(key, value)| KeyValue::new((*key).to_owned(), value.clone())).collect();
    let properties = WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(LEVEL)?))
        .set_key_value_metadata(Some(pairs))
        .set_created_by(concat!("starloop ", env!("CARGO_PKG_VERSION")).into())
        .build();
    let schema = Arc::new(parse_message_type(&schema)?);
    let mut file = SerializedFileWriter::new(Vec::new(), schema, Arc::new(properties))?;
    let mut group = file.next_row_group()?;
    for (_, cells) in columns {
        match cells {
            Cells::Whole(cells) => write::<Int64Type>(&mut group, cells, None)?,
            Cells::SomeWhole(cells) => {
                let there: Vec<i64> = cells.iter().flatten().copied().collect();
                write::<Int64Type>(&mut group, &there, Some(&levels(cells, Option::is_some)))?;
            }
            Cells::Real(cells) => {
                let there: Vec<f64> = cells.iter().copied().filter(|cell| cell.is_finite()).collect();
                write::<DoubleType>(&mut group, &there, Some(&levels(cells, |cell| cell.is_finite())))?;
            }
            Cells::Text(cells) => {
                let cells: Vec<ByteArray> = cells.iter().map(|cell| cell.as_str().into()).collect();
                write::<ByteArrayType>(&mut group, &cells, None)?;
            }
        }
    }
    group.close()?;
    Ok(file.into_inner()?)
}

/// Returns 1 where a cell is there, 0 where it is missing.
fn levels<T>(cells: &[T], is_there: impl Fn(&T) -> bool) -> Vec<i16> {
    cells.iter().map(|cell| i16::from(is_there(cell))).collect()
}

fn write<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, Vec<u8>>,
    cells: &[T::T],
    levels: Option<&[i16]>,
) -> Result<()> {
    let Some(mut column) = group.next_column()? else { bail!("more columns than the schema has") };
    column.typed::<T>().write_batch(cells, levels, None)?;
    Ok(column.close()?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::RowAccessor;
    use std::io::Write;

    fn columns() -> Vec<(&'static str, Cells)> {
        vec![
            ("whole", Cells::Whole(vec![1, -2])),
            ("some", Cells::SomeWhole(vec![None, Some(7)])),
            ("real", Cells::Real(vec![f64::NAN, 0.1])),
            ("text", Cells::Text(vec!["a".into(), String::new()])),
        ]
    }

    #[test]
    fn cells_read_back_and_missing_ones_are_missing() {
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(&bytes_of(&columns(), &[("about", "x".into())]).unwrap()).unwrap();
        let reader = SerializedFileReader::new(file).unwrap();
        let rows: Vec<_> = reader.get_row_iter(None).unwrap().map(Result::unwrap).collect();
        assert_eq!((rows[0].get_long(0).unwrap(), rows[1].get_long(0).unwrap()), (1, -2));
        assert!(rows[0].get_long(1).is_err() && rows[1].get_long(1).unwrap() == 7);
        assert!(rows[0].get_double(2).is_err() && rows[1].get_double(2).unwrap() == 0.1);
        assert_eq!(rows[0].get_string(3).unwrap(), "a");
    }

    #[test]
    fn bytes_are_the_same_again_and_columns_of_other_lengths_are_refused() {
        assert_eq!(bytes_of(&columns(), &[]).unwrap(), bytes_of(&columns(), &[]).unwrap());
        let mut wrong = columns();
        wrong.push(("short", Cells::Whole(vec![1])));
        assert!(bytes_of(&wrong, &[]).unwrap_err().to_string().contains("short has 1 rows, wanted 2"));
    }
}
