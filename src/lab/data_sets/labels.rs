//! Labels of items: a table with a row for each item, and one with a row for each star and target.
//!
//! In: items, one after the other. Out: both tables as Parquet, and the labels of one item as JSON for WebDataset. Every
//! column is defined once, in [`ITEM_COLUMNS`] or [`STAR_COLUMNS`]; the guide's `labels.md` lists them, which a test below
//! checks.
//!
//! Columns -> a Parquet file of one row group.
//!
//! In: named columns of one length. Out: bytes, the same on every machine: no time, no name of a machine. Numbers that are
//! not finite are missing cells. Tests: below, and with pyarrow in `hil_scripts/tests/test_data_sets.py`.

use crate::studio::Item;
use anyhow::{Result, bail};
use base::source_id::{GaiaRelease, SourceId};
use frames::sink::{TruthKind, TruthStar};
use parquet::basic::{Compression, ZstdLevel};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::{file::metadata::KeyValue, file::properties::WriterProperties, schema::parser::parse_message_type};
use serde_json::{Map, Value, json};
use stars::numbering::hipparcos_of_gaia;
use std::sync::Arc;

/// A cell before it is in a column.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// A whole number.
    Whole(i64),
    /// A whole number, where there is one.
    SomeWhole(Option<i64>),
    /// A number; missing when it is not finite.
    Real(f64),
    /// Text.
    Text(String),
}

/// A column of the table of items.
pub struct ItemColumn {
    /// Its name.
    pub name: &'static str,
    /// Its meaning.
    pub meaning: &'static str,
    of: fn(&Filed<'_>) -> Cell,
}

/// A column of the table of stars.
pub struct StarColumn {
    /// Its name.
    pub name: &'static str,
    /// Its meaning.
    pub meaning: &'static str,
    of: fn(&StarRow<'_>) -> Cell,
}

const fn item(name: &'static str, meaning: &'static str, of: fn(&Filed<'_>) -> Cell) -> ItemColumn {
    ItemColumn { name, meaning, of }
}

const fn star(name: &'static str, meaning: &'static str, of: fn(&StarRow<'_>) -> Cell) -> StarColumn {
    StarColumn { name, meaning, of }
}

/// An item with what the files know of it.
#[derive(Debug, Clone, Copy)]
pub struct Filed<'a> {
    /// The item.
    pub item: &'a Item,
    /// Its image, relative to the folder; in a tar file or an array, its name or place there.
    pub file: &'a str,
    /// CRC-32 of its pixels.
    pub crc32: u32,
    /// Keys that were drawn for its shard, as JSON.
    pub drawn_keys: &'a str,
}

/// A row of the truth with its item.
pub struct StarRow<'a> {
    item: &'a Item,
    star: &'a TruthStar,
    snr: f64,
}

/// Columns of the table of items.
pub const ITEM_COLUMNS: [ItemColumn; 27] = [
    item("item", "number of the item", |row| Cell::Whole(row.item.recipe.item.into())),
    item("shard", "shard whose camera drew it", |row| Cell::Whole(row.item.shard.into())),
    item("file", "image, relative to the folder; in a tar file or an array, its name or place there", |row| {
        Cell::Text(row.file.into())
    }),
    item("crc32", "CRC-32 of the pixels as little-endian 16-bit words, row by row", |row| {
        Cell::Whole(row.crc32.into())
    }),
    item("width_px", "columns", |row| whole(row.item.frame.image.width())),
    item("height_px", "rows", |row| whole(row.item.frame.image.height())),
    item("time_utc", "middle of the exposure", |row| Cell::Text(row.item.frame.meta.mid_exposure.to_rfc3339())),
    item("tai_ns", "the same, nanoseconds TAI since 1970", |row| Cell::Whole(row.item.frame.meta.mid_exposure.ns())),
    item("exposure_s", "exposure", |row| Cell::Real(row.item.frame.meta.exposure_s)),
    item("q_w", "attitude `sensor_from_icrf` in the middle of the exposure: Hamilton, scalar first, passive", |row| {
        Cell::Real(row.item.frame.meta.attitude_wxyz[0])
    }),
    item("q_x", "its second part", |row| Cell::Real(row.item.frame.meta.attitude_wxyz[1])),
    item("q_y", "its third part", |row| Cell::Real(row.item.frame.meta.attitude_wxyz[2])),
    item("q_z", "its fourth part", |row| Cell::Real(row.item.frame.meta.attitude_wxyz[3])),
    item("ra_deg", "right ascension of the boresight", |row| Cell::Real(row.item.frame.meta.ra_deg)),
    item("dec_deg", "declination of the boresight", |row| Cell::Real(row.item.frame.meta.dec_deg)),
    item("roll_deg", "position angle of image up, east of north", |row| Cell::Real(row.item.frame.meta.roll_deg)),
    item("rate_x_deg_s", "angular rate about the sensor's x axis", |row| Cell::Real(row.item.recipe.rate_deg_s.x)),
    item("rate_y_deg_s", "about its y axis", |row| Cell::Real(row.item.recipe.rate_deg_s.y)),
    item("rate_z_deg_s", "about its z axis", |row| Cell::Real(row.item.recipe.rate_deg_s.z)),
    item("jitter_arcsec", "standard deviation that the jitter was drawn with, each axis", |row| {
        Cell::Real(row.item.recipe.jitter_arcsec)
    }),
    item("jitter_mean_x_px", "mean displacement of the image by the jitter, columns", |row| {
        Cell::Real(row.item.recipe.mean_jitter_px()[0])
    }),
    item("jitter_mean_y_px", "the same, rows", |row| Cell::Real(row.item.recipe.mean_jitter_px()[1])),
    item("stars", "stars in the image", |row| count(row.item, TruthKind::Star)),
    item("targets", "targets in the image", |row| count(row.item, TruthKind::Target)),
    item("sensor_seed", "seed of the detector's patterns", |row| Cell::Whole(row.item.frame.meta.seed.cast_signed())),
    item("faults", "faults as JSON: the keys of their events", |row| Cell::Text(faults(row.item).to_string())),
    item("drawn_keys", "keys of the camera and the bench that were drawn for the shard, as JSON", |row| {
        Cell::Text(row.drawn_keys.into())
    }),
];

/// Columns of the table of stars and targets.
pub const STAR_COLUMNS: [StarColumn; 17] = [
    star("item", "number of the item", |row| Cell::Whole(row.item.recipe.item.into())),
    star(
        "id",
        "row of the star in the catalog; false stars, targets, bodies and tracks have ranges of their own",
        |row| Cell::Whole(row.star.id.into()),
    ),
    star("kind", "star, target, false_star, planet, moon, earth or proton_track", |row| {
        Cell::Text(row.star.kind.name().into())
    }),
    star("name", "name in the catalog that the star was taken from", |row| {
        Cell::Text(row.star.source_id.map_or_else(String::new, |name| name.to_string()))
    }),
    star("gaia_dr3", "number in Gaia DR3; missing where it has none", |row| Cell::SomeWhole(gaia_of(row.star))),
    star("hip", "number in the Hipparcos catalog; missing where none is known", |row| {
        Cell::SomeWhole(hipparcos_of(row.star))
    }),
    star("mag", "magnitude in the instrument's band", |row| Cell::Real(row.star.mag.into())),
    star("apparent_ra_deg", "right ascension in which it is seen, with aberration and deflection (ICRF axes)", |row| {
        Cell::Real(row.star.apparent_deg[0])
    }),
    star("apparent_dec_deg", "declination in which it is seen", |row| Cell::Real(row.star.apparent_deg[1])),
    star("catalog_ra_deg", "right ascension of its catalog place at the epoch of the item", |row| {
        Cell::Real(row.star.catalog_deg[0])
    }),
    star("catalog_dec_deg", "declination of its catalog place", |row| Cell::Real(row.star.catalog_deg[1])),
    star("x_px", "mean column over the exposure; the first pixel's centre is 0", |row| Cell::Real(row.star.x_px)),
    star("y_px", "mean row over the exposure, down", |row| Cell::Real(row.star.y_px)),
    star("electrons", "electrons collected in the exposure, mean, before noise", |row| Cell::Real(row.star.electrons)),
    star(
        "snr",
        "signal-to-noise ratio of its sum over the camera's best window, as `starloop snr` has it, without faults and motion",
        |row| Cell::Real(row.snr),
    ),
    star("smear_px", "length of its path over the image during the exposure", |row| Cell::Real(row.star.smear_px)),
    star("smear_deg", "direction from the start of that path to its end, from columns towards rows", |row| {
        Cell::Real(row.star.smear_deg)
    }),
];

/// The labels of a shard.
#[derive(Debug, Default)]
pub struct Labels {
    items: Vec<Vec<Cell>>,
    stars: Vec<Vec<Cell>>,
}

impl Labels {
    /// Adds the labels of an item.
    pub fn push(&mut self, row: &Filed<'_>) {
        self.items.push(ITEM_COLUMNS.iter().map(|column| (column.of)(row)).collect());
        self.stars
            .extend(stars_of(row.item).map(|star| STAR_COLUMNS.iter().map(|column| (column.of)(&star)).collect()));
    }

    /// Returns the tables of items and of stars as Parquet.
    ///
    /// # Errors
    /// When the library refuses them.
    pub fn tables(self, about: &[(&str, String)]) -> Result<[Vec<u8>; 2]> {
        let items = columns_of(ITEM_COLUMNS.iter().map(|column| column.name), self.items);
        let stars = columns_of(STAR_COLUMNS.iter().map(|column| column.name), self.stars);
        Ok([bytes_of(&items, about)?, bytes_of(&stars, about)?])
    }
}

/// Returns the labels of an item as JSON, with its stars in a list.
pub fn json_of(row: &Filed<'_>) -> Value {
    let mut object: Map<String, Value> =
        ITEM_COLUMNS.iter().map(|column| (column.name.to_owned(), json_cell((column.of)(row)))).collect();
    let star = |star: StarRow<'_>| -> Map<String, Value> {
        STAR_COLUMNS.iter().map(|column| (column.name.to_owned(), json_cell((column.of)(&star)))).collect()
    };
    object.insert("sources".into(), stars_of(row.item).map(star).collect());
    Value::Object(object)
}

fn stars_of(item: &Item) -> impl Iterator<Item = StarRow<'_>> {
    item.frame.truth.iter().zip(&item.snr).map(move |(star, snr)| StarRow { item, star, snr: *snr })
}

fn json_cell(cell: Cell) -> Value {
    match cell {
        Cell::Whole(number) => json!(number),
        Cell::SomeWhole(number) => json!(number),
        Cell::Real(number) => json!(number),
        Cell::Text(text) => json!(text),
    }
}

/// Returns rows as columns; the kind of a column is that of its cells.
fn columns_of<'n>(names: impl Iterator<Item = &'n str>, rows: Vec<Vec<Cell>>) -> Vec<(&'n str, Cells)> {
    let mut rows: Vec<_> = rows.into_iter().map(Vec::into_iter).collect();
    names.map(|name| (name, cells_of(rows.iter_mut().filter_map(Iterator::next).collect()))).collect()
}

fn cells_of(cells: Vec<Cell>) -> Cells {
    let mut out = match cells.first() {
        Some(Cell::Whole(_)) | None => Cells::Whole(Vec::new()),
        Some(Cell::SomeWhole(_)) => Cells::SomeWhole(Vec::new()),
        Some(Cell::Real(_)) => Cells::Real(Vec::new()),
        Some(Cell::Text(_)) => Cells::Text(Vec::new()),
    };
    for cell in cells {
        match (&mut out, cell) {
            (Cells::Whole(out), Cell::Whole(cell)) => out.push(cell),
            (Cells::SomeWhole(out), Cell::SomeWhole(cell)) => out.push(cell),
            (Cells::Real(out), Cell::Real(cell)) => out.push(cell),
            (Cells::Text(out), Cell::Text(cell)) => out.push(cell),
            // A column has one kind; a cell of another one is left out, and the table is refused for its length.
            (Cells::Whole(_) | Cells::SomeWhole(_) | Cells::Real(_) | Cells::Text(_), _other) => {}
        }
    }
    out
}

fn whole(number: usize) -> Cell {
    Cell::Whole(i64::try_from(number).unwrap_or(i64::MAX))
}

fn count(item: &Item, kind: TruthKind) -> Cell {
    whole(item.frame.truth.iter().filter(|row| row.kind == kind).count())
}

/// Returns the faults of an item: the keys of their events.
fn faults(item: &Item) -> Value {
    item.recipe.faults.iter().map(|(keys, _)| Value::Object(keys.clone())).collect()
}

fn gaia_of(star: &TruthStar) -> Option<i64> {
    match star.source_id? {
        SourceId::Gaia(GaiaRelease::Dr3, number) => i64::try_from(number).ok(),
        SourceId::Gaia(GaiaRelease::Dr2 | GaiaRelease::Unknown, _)
        | SourceId::Hipparcos(_)
        | SourceId::Tycho(..)
        | SourceId::Own(_) => None,
    }
}

fn hipparcos_of(star: &TruthStar) -> Option<i64> {
    match star.source_id? {
        SourceId::Hipparcos(number) => Some(number.into()),
        SourceId::Gaia(GaiaRelease::Dr3, number) => hipparcos_of_gaia(number).map(i64::from),
        SourceId::Gaia(GaiaRelease::Dr2 | GaiaRelease::Unknown, _) | SourceId::Tycho(..) | SourceId::Own(_) => None,
    }
}

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
    use crate::{Spec, Studio};
    use std::path::Path;

    fn item() -> Item {
        let text = "name = \"x\"\ncamera = \"cameras/small_tracker.toml\"\n[attitude]\nkind = \"list\"\n\
                    ra_dec_roll_deg = [[83.8, -1.2, 0]]\n";
        Studio::new(&Spec::parse(text, Path::new(".")).unwrap(), 0).unwrap().item(0).unwrap()
    }

    #[test]
    fn labels_are_those_of_the_item() {
        let item = item();
        let filed = Filed { item: &item, file: "a.fits", crc32: 7, drawn_keys: "{}" };
        let json = json_of(&filed);
        assert_eq!((&json["file"], &json["crc32"]), (&json!("a.fits"), &json!(7)));
        let sources = json["sources"].as_array().unwrap();
        assert!(sources.len() == item.frame.truth.len() && json["stars"].as_u64().unwrap() > 5);
        // Mintaka, delta Orionis, is within a degree of the boresight.
        assert!(sources.iter().any(|star| star["hip"] == json!(25_930)), "HIP 25930");
        let mut labels = Labels::default();
        labels.push(&filed);
        let [items, stars] = labels.tables(&[]).unwrap();
        assert!(items.starts_with(b"PAR1") && stars.len() > 1000);
    }

    #[test]
    fn every_column_is_in_the_guide() {
        let page = include_str!("../../guide/labels.md");
        let items = ITEM_COLUMNS.iter().map(|column| (column.name, column.meaning));
        for (name, meaning) in items.chain(STAR_COLUMNS.iter().map(|column| (column.name, column.meaning))) {
            assert!(page.contains(&format!("| `{name}` | {meaning} |")), "labels.md lacks: | `{name}` | {meaning} |");
        }
    }
}

#[cfg(test)]
mod table_tests {
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
