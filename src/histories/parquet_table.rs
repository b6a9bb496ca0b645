//! Tables in Parquet files -> text as the reader of tables takes it: a line for the names of columns, a line for each
//! row.
//!
//! Columns are named as in a table of text. Time stamps of milliseconds or microseconds are UTC; a time in nanoseconds
//! is a whole number in `tai_ns`. The file's own metadata `sense` and `axes` become remarks. Line `n` of an error is
//! row `n - 1`, less the remarks. Cells that are lists or missing are refused where they are used. Tests: below, and
//! with `pyarrow` in `hil_scripts/tests/test_histories.py`.

use crate::error::HistoryError;
use base::time::Tai;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::{errors::ParquetError, record::Field};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::{fs::File, path::Path};

/// Metadata that say what the numbers are.
const REMARKS: [&str; 2] = ["sense", "axes"];

/// Reads a table of at most `most_bytes` of text.
pub(crate) fn text_of(path: &Path, most_bytes: u64) -> Result<String, HistoryError> {
    let refuse = |why: String| HistoryError { file: path.display().to_string(), line: None, why };
    let file = File::open(path).map_err(|error| refuse(format!("cannot be opened: {error}")))?;
    // The library is known to panic on some damaged files.
    let read = catch_unwind(AssertUnwindSafe(|| rows_as_text(file, most_bytes)));
    match read {
        Ok(Ok(Some(text))) => Ok(text),
        Ok(Ok(None)) => {
            Err(refuse(format!("a table of more than {most_bytes} bytes of text; wanted a smaller one: split it")))
        }
        Ok(Err(error)) => Err(refuse(format!("a damaged Parquet file: {error}; wanted a whole one: write it again"))),
        Err(_panic) => Err(refuse("a damaged Parquet file; wanted a whole one: write it again".into())),
    }
}

/// Returns the table as text; `None` when it is too large.
fn rows_as_text(file: File, most_bytes: u64) -> Result<Option<String>, ParquetError> {
    let reader = SerializedFileReader::new(file)?;
    let about = reader.metadata().file_metadata();
    let mut text = String::new();
    for pair in about.key_value_metadata().into_iter().flatten() {
        let value = pair.value.as_deref().unwrap_or_default();
        if REMARKS.contains(&pair.key.as_str()) && !value.contains(['\n', '\r']) {
            text += &format!("# {}: {value}\n", pair.key);
        }
    }
    let names: Vec<String> =
        about.schema().get_fields().iter().map(|field| format!("\"{}\"", plain(field.name()))).collect();
    text += &names.join(",");
    text.push('\n');
    for row in reader.get_row_iter(None)? {
        let row = row?;
        for (place, (_, field)) in row.get_column_iter().enumerate() {
            if place > 0 {
                text.push(',');
            }
            text += &cell(field);
        }
        text.push('\n');
        if text.len() as u64 > most_bytes {
            return Ok(None);
        }
    }
    Ok(Some(text))
}

/// Returns a cell as text; a nested one becomes a dash, which later fails to parse as a number.
#[allow(clippy::wildcard_enum_match_arm, reason = "the library's enum: cells of further types are refused")]
fn cell(field: &Field) -> String {
    match field {
        Field::Double(value) => value.to_string(),
        Field::Float(value) => value.to_string(),
        Field::Byte(value) => value.to_string(),
        Field::Short(value) => value.to_string(),
        Field::Int(value) => value.to_string(),
        Field::Long(value) => value.to_string(),
        Field::UByte(value) => value.to_string(),
        Field::UShort(value) => value.to_string(),
        Field::UInt(value) => value.to_string(),
        Field::ULong(value) => value.to_string(),
        Field::Str(text) => plain(text),
        Field::TimestampMillis(ms) => stamp(ms.checked_mul(1_000_000)),
        Field::TimestampMicros(us) => stamp(us.checked_mul(1_000)),
        _no_cell => "-".into(),
    }
}

fn stamp(unix_ns: Option<i64>) -> String {
    unix_ns.map_or_else(|| "-".into(), |ns| Tai::from_unix_ns(ns).to_rfc3339())
}

/// Returns a text without what would end a cell or begin a remark.
fn plain(text: &str) -> String {
    text.chars().map(|c| if c.is_control() || matches!(c, ',' | '#' | '"') { '_' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read;
    use parquet::data_type::{DoubleType, Int64Type};
    use parquet::file::{metadata::KeyValue, properties::WriterProperties, writer::SerializedFileWriter};
    use parquet::{basic::Compression, schema::parser::parse_message_type};
    use std::{path::PathBuf, sync::Arc};

    const MOST: u64 = 1 << 20;

    /// Returns a turn about z, a second a row, with a column that is not used.
    fn written(folder: &Path, sense: Option<&str>) -> PathBuf {
        let path = folder.join("turn.parquet");
        let schema = "message m { required int64 tai_ns; required double q_w; required double q_x; required double q_y; \
                      required double q_z; required double other; }";
        let pair = sense.map(|sense| KeyValue::new("sense".into(), sense.to_owned()));
        let properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_key_value_metadata(Some(pair.into_iter().collect()))
            .build();
        let schema = Arc::new(parse_message_type(schema).unwrap());
        let mut file = SerializedFileWriter::new(File::create(&path).unwrap(), schema, Arc::new(properties)).unwrap();
        let mut group = file.next_row_group().unwrap();
        let angles: Vec<f64> = (0..5).map(|i| 0.05 * f64::from(i)).collect();
        let times: Vec<i64> = (0..5).map(|i| 1_772_366_437_000_000_000 + i * 1_000_000_000).collect();
        let mut column = group.next_column().unwrap().unwrap();
        column.typed::<Int64Type>().write_batch(&times, None, None).unwrap();
        column.close().unwrap();
        let zeros = vec![0.0; 5];
        let cosines: Vec<f64> = angles.iter().map(|angle| angle.cos()).collect();
        let sines: Vec<f64> = angles.iter().map(|angle| -angle.sin()).collect();
        for values in [&cosines, &zeros, &zeros, &sines, &zeros] {
            let mut column = group.next_column().unwrap().unwrap();
            column.typed::<DoubleType>().write_batch(values, None, None).unwrap();
            column.close().unwrap();
        }
        group.close().unwrap();
        file.close().unwrap();
        path
    }

    #[test]
    fn table_reads_as_its_text_and_its_sense_is_that_of_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let read = |sense| {
            let path = written(folder.path(), sense);
            read::attitudes("turn", &read::text_of(&path).unwrap(), None).unwrap()
        };
        let (ours, theirs) = (read(None), read(Some("icrf_from_body")));
        let at = |history: &crate::AttitudeHistory| {
            let [first, _] = history.span_ns();
            history.at_ns(first + 2_500_000_000).unwrap().body_from_icrf.wxyz()
        };
        let ([w, .., z], conjugate) = (at(&ours), at(&theirs));
        assert!((w - 0.125_f64.cos()).abs() < 1e-12 && (z + 0.125_f64.sin()).abs() < 1e-12, "{w} {z}");
        assert!((conjugate[3] + z).abs() < 1e-12, "control: the other sense is the conjugate");
    }

    #[test]
    fn damaged_and_too_large_files_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        let path = written(folder.path(), None);
        let whole = std::fs::read(&path).unwrap();
        assert!(text_of(&path, 50).unwrap_err().to_string().contains("smaller"));
        for place in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[place] ^= 0x55;
            std::fs::write(&path, bytes).unwrap();
            // Either it is refused, or it is a table of other numbers: never a panic.
            let _either = text_of(&path, MOST);
        }
        std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
        assert!(text_of(&path, MOST).unwrap_err().to_string().contains("damaged"));
    }
}
