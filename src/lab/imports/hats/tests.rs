//! Catalogs there and back; Parquet in all its forms; catalogs and files that are not what they should be.

use super::*;
use crate::is_hats;
use crate::published::gaia::{EPOCH_YR, Names, WITHOUT_MAGNITUDE, WITHOUT_PLACE};
use base::{refused::Refused, units::DEG};
use core::f64::consts::TAU;
use parquet::basic::{Compression, Encoding};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int32Type, Int64Type};
use parquet::file::properties::{WriterProperties, WriterVersion};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::parser::parse_message_type;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use stars::layer::{Layer, LayerReport, NewStar, Sorting};
use std::path::{Path, PathBuf};
use std::sync::Arc;

mod damage;

const LIMITS: [f32; 3] = [10.0, 14.0, 18.0];

/// Returns stars all over the sky, a quarter of them within a degree of the north pole, many at the ends of the layers.
fn stars(count: usize, seed: u64) -> Vec<NewStar> {
    let mut rng = StdRng::seed_from_u64(seed);
    let star = |i: usize| {
        let (u, v): (f64, f64) = (rng.random(), rng.random());
        let dec_rad = if i.is_multiple_of(4) { (1.0 - 1e-4 * v).asin() } else { (2.0 * v - 1.0).asin() };
        let mag_g = match i % 5 {
            0 => 10.0 + rng.random_range(-0.002..0.002),
            1 => 14.0 + rng.random_range(-0.002..0.002),
            _ => rng.random_range(2.0..18.0),
        };
        NewStar {
            source_id: i as i64 * 7 + 3,
            ra_rad: TAU * u,
            dec_rad,
            motion_mas_yr: (!i.is_multiple_of(3)).then(|| [rng.random_range(-50.0..50.0), rng.random_range(-9e3..9e3)]),
            parallax_mas: (!i.is_multiple_of(5)).then(|| rng.random_range(-1.0..700.0)),
            mag_g,
            bp_rp: (!i.is_multiple_of(7)).then(|| rng.random_range(-0.6..5.1)),
        }
    };
    (0..count).map(star).collect()
}

fn build(folder: &Path, stars: &[NewStar]) -> Vec<LayerReport> {
    let mut sorting = Sorting::start(&folder.join("work"), &LIMITS).unwrap();
    stars.iter().for_each(|star| sorting.add(star).unwrap());
    sorting.finish(&folder.join("layers"), EPOCH_YR, "whom it concerns", &mut |_| {}).unwrap()
}

fn opened(reports: &[LayerReport]) -> Vec<Layer> {
    reports.iter().map(|report| Layer::open(&report.path).unwrap()).collect()
}

/// Returns all partitions of a catalog into layers.
fn import_all(catalog: &Path, folder: &Path) -> Result<Vec<LayerReport>, Refused> {
    let catalog = HatsCatalog::open(catalog)?;
    let mut names = Names::default();
    catalog.name_columns(&mut names)?;
    let mut sorting = Sorting::start(&folder.join("work"), &LIMITS)?;
    for partition in &catalog.partitions {
        import(&partition.path, Some(partition.pixel), &names, &mut sorting, &mut |_| {})?;
    }
    sorting.finish(&folder.join("layers"), EPOCH_YR, "whom it concerns", &mut |_| {})
}

fn exporting(max_rows: usize) -> Exporting {
    Exporting { name: "test".into(), max_rows }
}

#[test]
fn layers_come_back_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let before = build(&path("before"), &stars(6_000, 1));
    for (max_rows, partitions) in [(1_000_000, 12..=12), (200, 30..=400), (20, 300..=2_500)] {
        let catalog = path(&format!("catalog{max_rows}"));
        let mut last = 0.0;
        let mut progress = |share: f64| {
            assert!(share >= last && share <= 1.0, "progress goes on: {share} after {last}");
            last = share;
        };
        let report = export(&opened(&before), &catalog, &exporting(max_rows), &mut progress).unwrap();
        assert_eq!((report.stars, last), (6_000, 1.0));
        assert!(partitions.contains(&report.partitions), "{report:?}");
        let listed = HatsCatalog::open(&catalog).unwrap();
        assert_eq!(listed.partitions.len(), report.partitions);
        assert_eq!(listed.epoch_yr().unwrap(), Some(EPOCH_YR));
        let most = listed.partitions.iter().map(|partition| rows_of(&partition.path)).max().unwrap();
        assert!(most as usize <= max_rows, "{most} rows in a partition of at most {max_rows}");
        let after = import_all(&catalog, &path(&format!("after{max_rows}"))).unwrap();
        for (a, b) in before.iter().zip(&after) {
            assert_eq!(std::fs::read(&a.path).unwrap(), std::fs::read(&b.path).unwrap(), "{}", a.path.display());
        }
    }
    let other = build(&path("other"), &stars(6_000, 2));
    assert_ne!(std::fs::read(&before[1].path).unwrap(), std::fs::read(&other[1].path).unwrap(), "control");
}

fn rows_of(path: &Path) -> u64 {
    file::ParquetFile::open(path).unwrap().rows().unwrap()
}

#[test]
fn layers_that_do_not_fit_together_are_not_exported() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let reports = build(&path("one"), &stars(2_000, 3));
    let refused = |layers: &[Layer], max_rows: usize| {
        let reported = export(layers, &path("out"), &exporting(max_rows), &mut |_| {}).unwrap_err().to_string();
        assert!(!path("out").exists() && !path("out.part").exists(), "nothing is left: {reported}");
        reported
    };
    let layer = |place: usize| Layer::open(&reports[place].path).unwrap();
    assert!(refused(&[layer(1), layer(0)], 100).contains("magnitudes: wanted 14 or fainter"));
    assert!(refused(&[layer(0), layer(0)], 100).contains("magnitudes"), "no star twice");
    let star = NewStar { mag_g: 9.0, ..stars(1, 0)[0] };
    let same_place: Vec<NewStar> = (0..5).map(|source_id| NewStar { source_id, ..star }).collect();
    let crowd = build(&path("crowd"), &same_place);
    let reported = refused(&[Layer::open(&crowd[0].path).unwrap()], 4);
    assert!(reported.contains("of order 13: 5 stars") && reported.contains("raise --max-rows"), "{reported}");
    assert!(refused(&[Layer::open(&crowd[2].path).unwrap()], 4).contains("stars: wanted some"));
    let mut sorting = Sorting::start(&path("work"), &[99.0]).unwrap();
    sorting.add(&NewStar { mag_g: 19.0, ..star }).unwrap();
    let later = sorting.finish(&path("later"), 2000.0, "", &mut |_| {}).unwrap();
    assert!(refused(&[layer(0), Layer::open(&later[0].path).unwrap()], 4).contains("epoch: wanted J2016, got J2000"));
    let mut bytes = std::fs::read(&reports[2].path).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    std::fs::write(path("damaged"), bytes).unwrap();
    assert!(refused(&[Layer::open(&path("damaged")).unwrap()], 100).contains("damaged: numbers of the stars"));
    export(&[layer(0)], &path("out"), &exporting(100), &mut |_| {}).unwrap();
    let slash = PathBuf::from(format!("{}/", path("slash").display()));
    export(&[layer(0)], &slash, &exporting(100), &mut |_| {}).unwrap();
    assert!(HatsCatalog::open(&path("slash")).is_ok() && !path("slash.part").exists());
    for nameless in ["", ".", "./", "..", "no_such/.."] {
        let reported = export(&[layer(0)], Path::new(nameless), &exporting(100), &mut |_| {}).unwrap_err().to_string();
        assert!(reported.contains("wanted the name of a new folder"), "{nameless:?}: {reported}");
    }
    let again = export(&[layer(0)], &path("out"), &exporting(100), &mut |_| {}).unwrap_err().to_string();
    assert!(again.contains("out: there already"), "{again}");
}

/// How a test file is written.
#[derive(Clone)]
struct Form {
    compression: Compression,
    version: WriterVersion,
    dictionary: bool,
    encoding: Option<Encoding>,
    group_rows: usize,
}

const PLAIN: Form = Form {
    compression: Compression::UNCOMPRESSED,
    version: WriterVersion::PARQUET_1_0,
    dictionary: false,
    encoding: None,
    group_rows: usize::MAX,
};

/// The columns of a test file: name, type and cells.
type Column = (&'static str, Cells);

#[derive(Clone)]
enum Cells {
    I64(Vec<Option<i64>>),
    I32(Vec<Option<i32>>),
    F64(Vec<Option<f64>>),
    F32(Vec<Option<f32>>),
    Text(Vec<Option<ByteArray>>),
}

impl Cells {
    fn rows(&self) -> usize {
        match self {
            Self::I64(cells) => cells.len(),
            Self::I32(cells) => cells.len(),
            Self::F64(cells) => cells.len(),
            Self::F32(cells) => cells.len(),
            Self::Text(cells) => cells.len(),
        }
    }

    fn kind(&self) -> &'static str {
        match self {
            Self::I64(_) => "int64",
            Self::I32(_) => "int32",
            Self::F64(_) => "double",
            Self::F32(_) => "float",
            Self::Text(_) => "binary",
        }
    }

    fn write(&self, group: &mut SerializedRowGroupWriter<'_, std::fs::File>, from: usize, to: usize) {
        match self {
            Self::I64(cells) => put::<Int64Type>(group, &cells[from..to]),
            Self::I32(cells) => put::<Int32Type>(group, &cells[from..to]),
            Self::F64(cells) => put::<DoubleType>(group, &cells[from..to]),
            Self::F32(cells) => put::<FloatType>(group, &cells[from..to]),
            Self::Text(cells) => put::<ByteArrayType>(group, &cells[from..to]),
        }
    }
}

fn put<T: DataType>(group: &mut SerializedRowGroupWriter<'_, std::fs::File>, cells: &[Option<T::T>]) {
    let levels: Vec<i16> = cells.iter().map(|cell| i16::from(cell.is_some())).collect();
    let values: Vec<T::T> = cells.iter().flatten().cloned().collect();
    let mut column = group.next_column().unwrap().unwrap();
    column.typed::<T>().write_batch(&values, Some(&levels), None).unwrap();
    column.close().unwrap();
}

/// Writes a file whose columns may all be null.
fn write_file(path: &Path, columns: &[Column], form: &Form) {
    let fields = columns.iter().map(|(name, cells)| format!("optional {} {name};", cells.kind()));
    let schema = format!("message test {{ {} }}", fields.collect::<String>());
    let mut properties = WriterProperties::builder()
        .set_compression(form.compression)
        .set_writer_version(form.version)
        .set_dictionary_enabled(form.dictionary)
        .set_data_page_row_count_limit(100)
        .set_write_batch_size(50);
    if let Some(encoding) = form.encoding {
        properties = properties.set_encoding(encoding);
    }
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let file = std::fs::File::create(path).unwrap();
    let schema = Arc::new(parse_message_type(&schema).unwrap());
    let mut writer = SerializedFileWriter::new(file, schema, Arc::new(properties.build())).unwrap();
    let rows = columns[0].1.rows();
    for from in (0..rows).step_by(form.group_rows.min(rows)) {
        let mut group = writer.next_row_group().unwrap();
        let to = (from + form.group_rows.min(rows)).min(rows);
        columns.iter().for_each(|(_, cells)| cells.write(&mut group, from, to));
        group.close().unwrap();
    }
    writer.close().unwrap();
}

/// Returns Gaia's columns with `count` rows: every fifth without a motion, one without a place, one without a
/// magnitude.
fn columns(count: usize) -> Vec<Column> {
    let floats = |value: &dyn Fn(usize) -> Option<f64>| Cells::F64((0..count).map(value).collect());
    let some = |value: &dyn Fn(usize) -> f64| floats(&|i| Some(value(i)));
    let float = |value: &dyn Fn(usize) -> Option<f32>| Cells::F32((0..count).map(value).collect());
    vec![
        ("solution_id", Cells::Text(vec![Some("left out".into()); count])),
        ("source_id", Cells::I64((0..count).map(|i| Some(i as i64 + 1)).collect())),
        ("ra", floats(&|i| (i != 3).then_some(10.0 + i as f64 * 1e-3))),
        ("dec", some(&|i| 20.0 - i as f64 * 1e-3)),
        ("parallax", some(&|i| if i % 2 == 0 { f64::NAN } else { 3.0 })),
        ("pmra", floats(&|i| (i % 5 != 0).then_some(12.5))),
        ("pmdec", some(&|i| (i % 1000) as f64)),
        ("phot_g_mean_mag", float(&|i| (i != 7).then_some(9.0 + (i % 8) as f32 * 0.5))),
        ("bp_rp", float(&|i| (i % 3 != 0).then_some(1.25))),
    ]
}

/// Takes one file in.
fn take(path: &Path, names: &Names) -> (Result<u64, Refused>, Sorting, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let mut sorting = Sorting::start(&folder.path().join("work"), &[22.0]).unwrap();
    (import(path, None, names, &mut sorting, &mut |_| {}), sorting, folder)
}

fn bytes_of(sorting: Sorting, folder: &tempfile::TempDir) -> Vec<u8> {
    let reports = sorting.finish(folder.path(), EPOCH_YR, "", &mut |_| {}).unwrap();
    std::fs::read(&reports[0].path).unwrap()
}

#[test]
fn every_form_of_parquet_gives_the_same_stars() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("form.parquet");
    write_file(&path, &columns(20_000), &PLAIN);
    let (done, sorting, into) = take(&path, &Names::default());
    assert_eq!(done.unwrap(), 20_000);
    let counts = sorting.counts();
    assert_eq!(sorting.reported().collect::<Vec<_>>(), [(WITHOUT_MAGNITUDE, 1), (WITHOUT_PLACE, 1)]);
    assert_eq!(counts.stars, 19_998);
    // Rows 0, 5, 10, ... have no motion; 0, 2, 4, ... no parallax; 0, 3, 6, ... no colour; 3 and 7 are left out.
    assert_eq!((counts.without_motion, counts.without_parallax, counts.without_colour), (4_000, 10_000, 6_666));
    let wanted = bytes_of(sorting, &into);
    let zstd = Compression::ZSTD(Default::default());
    let second = WriterVersion::PARQUET_2_0;
    for (reported, form) in [
        ("dictionaries", Form { dictionary: true, ..PLAIN }),
        ("Snappy", Form { compression: Compression::SNAPPY, ..PLAIN }),
        ("Zstandard, dictionaries", Form { compression: zstd, dictionary: true, ..PLAIN }),
        ("gzip", Form { compression: Compression::GZIP(Default::default()), ..PLAIN }),
        ("Brotli", Form { compression: Compression::BROTLI(Default::default()), ..PLAIN }),
        ("LZ4", Form { compression: Compression::LZ4_RAW, dictionary: true, ..PLAIN }),
        ("row groups", Form { group_rows: 777, ..PLAIN }),
        ("version 2", Form { version: second, ..PLAIN }),
        (
            "version 2, Snappy, dictionaries",
            Form { version: second, compression: Compression::SNAPPY, dictionary: true, ..PLAIN },
        ),
        ("version 2, Zstandard, row groups", Form { version: second, compression: zstd, group_rows: 3_000, ..PLAIN }),
    ] {
        write_file(&path, &columns(20_000), &form);
        let (done, sorting, into) = take(&path, &Names::default());
        assert_eq!(done.unwrap(), 20_000, "{reported}");
        assert!(bytes_of(sorting, &into) == wanted, "{reported}");
    }
    let mut moved = columns(20_000);
    moved[3].1 = Cells::F64((0..20_000).map(|i| Some(20.000_001 - f64::from(i) * 1e-3)).collect());
    write_file(&path, &moved, &PLAIN);
    let (_, sorting, into) = take(&path, &Names::default());
    assert!(bytes_of(sorting, &into) != wanted, "control: other places, other bytes");
}

#[test]
fn numbers_of_all_types_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("types.parquet");
    let mut file = columns(50);
    file[1] = ("source_id", Cells::I32((0..50).map(Some).collect()));
    file[2] = ("ra", Cells::F32((0..50).map(|i| Some(i as f32)).collect()));
    file[4] = ("parallax", Cells::I64(vec![Some(2); 50]));
    file[7] = ("phot_g_mean_mag", Cells::I32(vec![Some(15); 50]));
    write_file(&path, &file, &PLAIN);
    let (done, sorting, into) = take(&path, &Names::default());
    assert_eq!(done.unwrap(), 50);
    assert_eq!(sorting.reported().collect::<Vec<_>>(), [(COARSE_PLACES, 50)], "a tenth of an arcsecond is reported");
    let reports = sorting.finish(into.path(), EPOCH_YR, "", &mut |_| {}).unwrap();
    let mut found = Vec::new();
    Layer::open(&reports[0].path).unwrap().cone(glam::DVec3::Z, 4.0, 99.0, &mut found).unwrap();
    assert_eq!(found.len(), 50);
    assert!(found.iter().all(|star| star.mag_g == 15.0 && star.parallax_mas == Some(2.0)));
    // Streams of bytes and differences, as other writers encode numbers.
    for (encoding, columns) in
        [(Encoding::BYTE_STREAM_SPLIT, &columns(500)[1..]), (Encoding::PLAIN, &columns(500)[1..])]
    {
        write_file(&path, columns, &Form { encoding: Some(encoding), ..PLAIN });
        assert_eq!(take(&path, &Names::default()).0.unwrap(), 500, "{encoding}");
    }
}

#[test]
fn names_of_columns() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("names.parquet");
    let renamed = |from: &'static str, to: &'static str| -> Vec<Column> {
        columns(40).into_iter().map(|(name, cells)| (if name == from { to } else { name }, cells)).collect()
    };
    write_file(&path, &renamed("source_id", STARLOOP_ID), &PLAIN);
    assert_eq!(take(&path, &Names::default()).0.unwrap(), 40, "what starloop wrote has identifiers of its own");
    write_file(&path, &renamed("phot_g_mean_mag", "G"), &PLAIN);
    let reported = take(&path, &Names::default()).0.unwrap_err().to_string();
    assert!(
        reported.contains("column phot_g_mean_mag: wanted a column of that name, got none; the file has"),
        "{reported}"
    );
    assert!(reported.contains("pmdec, G, bp_rp"), "{reported}");
    let mut names = Names::default();
    names.rename("phot_g_mean_mag", "G");
    assert_eq!(take(&path, &names).0.unwrap(), 40);
    names.rename_unless_renamed("phot_g_mean_mag", "H");
    assert_eq!(take(&path, &names).0.unwrap(), 40, "what a person said holds");
}

#[test]
fn cells_that_are_wrong_are_reported_with_file_row_and_column() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wrong.parquet");
    let refused = |place: usize, cells: Cells| {
        let mut file = columns(9_000);
        file[place].1 = cells;
        write_file(&path, &file, &PLAIN);
        take(&path, &Names::default()).0.unwrap_err().to_string()
    };
    let with = |at: usize, value: Option<f64>| {
        Cells::F64((0..9_000).map(|i| if i == at { value } else { Some(5.0) }).collect())
    };
    let reported = refused(2, with(8_500, Some(f64::INFINITY)));
    assert!(reported.contains("wrong.parquet, row 8501, column ra: wanted a number, or null, got inf"), "{reported}");
    let reported = refused(2, with(8_500, Some(-1.0)));
    assert!(
        reported.contains("wrong.parquet, row 8501, column ra: wanted degrees from 0 to 360, got -1"),
        "{reported}"
    );
    let ids = (0..9_000).map(|i| (i != 20).then_some(i)).collect();
    let reported = refused(1, Cells::I64(ids));
    assert!(reported.contains("row 21, column source_id: wanted a whole number, got null"), "{reported}");
    let reported = refused(1, with(0, None));
    assert!(
        reported.contains("column source_id: wanted whole numbers: INT32 or INT64, one a row, got DOUBLE"),
        "{reported}"
    );
    let reported = refused(7, Cells::Text(vec![Some("15.0".into()); 9_000]));
    assert!(
        reported.contains("column phot_g_mean_mag: wanted numbers") && reported.contains("BYTE_ARRAY"),
        "{reported}"
    );
}

/// Returns a catalog of two partitions, in pixels 4 and 6 of order 0, about RA 0 and 180 on the equator.
fn catalog(folder: &Path) -> PathBuf {
    let path = folder.join("catalog");
    for (pixel, ra) in [(4, 1.0), (6, 180.0)] {
        let mut file = columns(100);
        file[2].1 = Cells::F64((0..100).map(|i| Some(ra + f64::from(i) * 1e-3)).collect());
        file[3].1 = Cells::F64((0..100).map(|i| Some(f64::from(i) * 1e-3)).collect());
        file[2].0 = "RAdeg";
        write_file(&path.join(format!("dataset/Norder=0/Dir=0/Npix={pixel}.parquet")), &file, &PLAIN);
    }
    std::fs::write(path.join("partition_info.csv"), "Norder,Npix,num_rows\n0,4,100\n0,6,100\n").unwrap();
    for beside in ["_metadata", "data_thumbnail.parquet", "per_partition_statistics.parquet"] {
        std::fs::write(path.join("dataset").join(beside), "left out").unwrap();
    }
    write_properties(&path, &[]);
    path
}

/// Writes the properties of [`catalog`], with others in their place.
fn write_properties(catalog: &Path, other: &[(&str, &str)]) {
    let mut values = vec![
        ("obs_collection", "two"),
        ("dataproduct_type", "object"),
        ("hats_nrows", "200"),
        ("hats_col_ra", "RAdeg"),
        ("hats_col_dec", "dec"),
    ];
    for (key, value) in other {
        values.retain(|(known, _)| known != key);
        values.push((key, value));
    }
    let values: Vec<(&str, String)> = values.into_iter().map(|(key, value)| (key, value.into())).collect();
    properties::write(&catalog.join("hats.properties"), &values).unwrap();
}

#[test]
fn catalogs_are_whole_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (path, mut tries) = (catalog(folder.path()), 0);
    let mut attempt = || {
        tries += 1;
        import_all(&path, &folder.path().join(tries.to_string()))
    };
    let reports = attempt().unwrap();
    // Of 100 rows each, one has no magnitude.
    assert_eq!(reports.iter().map(|report| report.stars).sum::<u64>(), 198);
    let mut refused = |words: &str| {
        let reported = attempt().unwrap_err().to_string();
        assert!(reported.contains(words), "wanted {words:?} in {reported}");
    };
    let file = |number: u64| path.join(format!("dataset/Norder=0/Dir=0/Npix={number}.parquet"));
    let list = path.join("partition_info.csv");

    write_properties(&path, &[("hats_nrows", "201")]);
    refused("hats_nrows, and the footers of its partitions: wanted 201 rows, got 200");
    write_properties(&path, &[("hats_nrows", "many")]);
    refused("hats_nrows: wanted a whole number, got many");
    for kind in ["margin", "index", "association"] {
        write_properties(&path, &[("dataproduct_type", kind)]);
        refused(&format!(
            "dataproduct_type: wanted \"object\": one row a star, each in its own partition, got \"{kind}\""
        ));
    }
    write_properties(&path, &[("hats_col_ra", "")]);
    refused("hats_col_ra: wanted the name of a column, got nothing");
    for frame in ["galactic", "fk5"] {
        write_properties(&path, &[("hats_frame", frame)]);
        refused(&format!("hats_frame: wanted icrs or icrf or equatorial, got \"{frame}\""));
    }
    write_properties(&path, &[("hats_frame", "ICRS"), ("hats_coordinate_epoch", "J2015.5")]);
    assert_eq!(HatsCatalog::open(&path).unwrap().epoch_yr().unwrap(), Some(2015.5));
    write_properties(&path, &[("hats_coordinate_epoch", "2015.5")]);
    assert_eq!(HatsCatalog::open(&path).unwrap().epoch_yr().unwrap(), Some(2015.5));
    write_properties(&path, &[("hats_coordinate_epoch", "MJD 57388")]);
    let reported = HatsCatalog::open(&path).unwrap().epoch_yr().unwrap_err().to_string();
    assert!(reported.contains("hats_coordinate_epoch: wanted a Julian year from 1900 to 2100"), "{reported}");
    write_properties(&path, &[("hats_col_ra", "dec")]);
    refused("deg: wanted pixel");
    write_properties(&path, &[]);

    std::fs::rename(file(6), file(7)).unwrap();
    refused("Npix=6: listed in partition_info.csv, and missing");
    std::fs::write(&list, "Norder,Npix\n0,4\n0,7\n").unwrap();
    refused("Npix=7.parquet, row 1: RA 180 Dec 0 deg: wanted pixel 7 of order 0, got 6");
    std::fs::rename(file(7), file(6)).unwrap();
    std::fs::write(&list, "Norder,Npix\n0,4\n").unwrap();
    refused("Npix=6.parquet: there, and not listed in partition_info.csv");
    for (line, words) in [
        ("0,6\n0,6\n", "Norder=0/Dir=0/Npix=6 and Norder=0/Dir=0/Npix=6 share a part of the sky"),
        ("0,6\n1,27\n", "Npix=6 and Norder=1/Dir=0/Npix=27 share a part of the sky"),
        ("0,12\n", "partition_info.csv, line 3: wanted a HEALPix order and pixel"),
        ("6\n", "line 3: wanted a HEALPix order and pixel in columns Norder and Npix, got \"6\""),
    ] {
        std::fs::write(&list, format!("Norder,Npix\n0,4\n{line}")).unwrap();
        refused(words);
    }
    std::fs::write(&list, "order,pixel\n0,4\n").unwrap();
    refused("partition_info.csv, line 1");
    std::fs::write(&list, "Norder,Npix\n0,4\n0,6\n").unwrap();

    std::fs::create_dir(path.join("dataset/more")).unwrap();
    refused("more: wanted Norder=, a number");
    std::fs::remove_dir(path.join("dataset/more")).unwrap();
    let strange = path.join("dataset/Norder=0/Dir=0/notes.txt");
    std::fs::write(&strange, "").unwrap();
    refused("notes.txt: wanted Npix=, a number, and \".parquet\"");
    std::fs::remove_file(&strange).unwrap();
    std::fs::create_dir_all(path.join("dataset/Norder=0/Dir=10000")).unwrap();
    std::fs::rename(file(6), path.join("dataset/Norder=0/Dir=10000/Npix=6.parquet")).unwrap();
    refused("Npix=6.parquet: wanted it in Norder=0/Dir=0");
    std::fs::rename(path.join("dataset/Norder=0/Dir=10000/Npix=6.parquet"), file(6)).unwrap();

    let whole = std::fs::read(file(6)).unwrap();
    std::fs::write(file(6), &whole[..whole.len() / 2]).unwrap();
    refused("Npix=6.parquet: damaged, or no Parquet file");
    std::fs::write(file(6), whole).unwrap();
    std::fs::remove_file(path.join("hats.properties")).unwrap();
    refused("hats.properties: No such file");
}

#[test]
fn other_lays_of_a_catalog_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = catalog(folder.path());
    let stars = |name: &str, catalog: &Path| {
        let reports = import_all(catalog, &folder.path().join(name)).unwrap();
        reports.iter().map(|report| report.stars).sum::<u64>()
    };
    // A partition as a folder of files, and the file of properties by its older name.
    let within = path.join("dataset/Norder=0/Dir=0");
    std::fs::create_dir(within.join("Npix=6")).unwrap();
    std::fs::rename(within.join("Npix=6.parquet"), within.join("Npix=6/part0.parquet")).unwrap();
    std::fs::rename(path.join("hats.properties"), path.join("properties")).unwrap();
    assert!(is_hats(&path) && !is_hats(&within) && !is_hats(&path.join("properties")));
    assert_eq!(stars("folder", &path), 198);
    // A collection, whose main catalog it is.
    std::fs::write(folder.path().join("collection.properties"), "hats_primary_table_url=catalog\n").unwrap();
    assert!(is_hats(folder.path()));
    assert_eq!(stars("collection", folder.path()), 198);
    // A row that another program rounded to the other side of an edge is within; one further off is not.
    let mut file = columns(1);
    file[2].1 = Cells::F64(vec![Some(180.0)]);
    file[2].0 = "RAdeg";
    for (dec_deg, is_in) in [(90.0, true), (90.0 - 1e-9, true), (90.0 - 1e-5, false)] {
        file[3].1 = Cells::F64(vec![Some(dec_deg)]);
        let pole = folder.path().join("pole.parquet");
        write_file(&pole, &file, &PLAIN);
        let mut names = Names::default();
        names.rename("ra", "RAdeg");
        let mut sorting = Sorting::start(&folder.path().join(format!("work{dec_deg}")), &LIMITS).unwrap();
        // Pixel 0 of order 0 has RA 0 to 90 at the pole.
        let done = import(&pole, Pixel::new(0, 0), &names, &mut sorting, &mut |_| {});
        assert_eq!(done.is_ok(), is_in, "{dec_deg}: {done:?}");
    }
    let (ra, dec) = (stars::healpix::centre(0, 4).0, 0.0 * DEG);
    assert!(Pixel { order: 0, number: 4 }.has(ra, dec, false));
}
