//! Lists the partitions of a HATS catalog on disk, and checks that each is there and listed.
//!
//! Source: IVOA Note "HATS: Hierarchical Adaptive Tiling Scheme". A catalog is a folder of `hats.properties` (older
//! ones: `properties`), `partition_info.csv` and `dataset/Norder=k/Dir=d/Npix=n.parquet`, or `Npix=n/` with files in
//! it; a collection is a folder of catalogs, whose main one is taken. Tests: `super::tests`.

use super::pixel::{MOST_ORDER, Pixel};
use super::{file::ParquetFile, properties::Properties};
use crate::published::gaia::Names;
use base::input_file::{DATA_BYTES, read_text};
use base::refused::Refused;
use core::fmt::Display;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Kind of catalog that is read: one row, one object.
const OBJECTS: &str = "object";
/// Epoch of the positions, in catalogs that starloop wrote, and in others.
pub(super) const EPOCH: &str = "starloop_epoch_yr";
const COORDINATE_EPOCH: &str = "hats_coordinate_epoch";
/// Axes of the positions.
const FRAME: &str = "hats_frame";
/// Names of the axes that are read: those of the ICRS.
const FRAMES: [&str; 3] = ["icrs", "icrf", "equatorial"];
/// The property of the credits that a catalog asks for.
pub(super) const ACKNOWLEDGEMENT: &str = "obs_ack";

/// A catalog whose partitions are all there.
#[derive(Debug)]
pub struct HatsCatalog {
    properties: Properties,
    /// Its files, in the order of the list.
    pub partitions: Vec<Partition>,
}

/// A Parquet file of a catalog.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Partition {
    /// Pixel that has all its rows.
    pub pixel: Pixel,
    /// The file.
    pub path: PathBuf,
    /// Its name among all partitions, wherever the catalog is: catalog, folders and file.
    pub name: String,
}

impl HatsCatalog {
    /// Opens a catalog: compares its list of partitions with its files, and its number of rows with theirs.
    ///
    /// # Errors
    /// When it is of another kind (a margin, an index), a partition is missing, not listed, cannot be opened or
    /// overlaps another, or the rows are not as many as it says.
    pub fn open(folder: &Path) -> Result<Self, Refused> {
        let properties = Properties::read(folder)?;
        let kind = properties.wanted("dataproduct_type", OBJECTS)?;
        if kind != OBJECTS {
            let wanted = format!("\"{OBJECTS}\": one row a star, each in its own partition");
            return Err(properties.refuse("dataproduct_type", &wanted, &format!("\"{kind}\"")));
        }
        if let Some(frame) = properties.get(FRAME).filter(|frame| !FRAMES.iter().any(|f| f.eq_ignore_ascii_case(frame)))
        {
            return Err(properties.refuse(FRAME, &FRAMES.join(" or "), &format!("\"{frame}\"")));
        }
        let listed = listed(&properties.folder().join("partition_info.csv"))?;
        let mut there = there(properties.folder(), properties.get("hats_npix_suffix").unwrap_or(".parquet"))?;
        let mut partitions = Vec::new();
        for pixel in listed {
            let dataset = properties.folder().join("dataset").join(pixel.folder());
            let files = there.remove(&pixel).ok_or_else(|| {
                partition(&dataset.join(format!("Npix={}", pixel.number)), "listed in partition_info.csv, and missing")
            })?;
            partitions.extend(files.into_iter().map(|path| (pixel, path)));
        }
        if let Some((_, files)) = there.first_key_value() {
            let what = "there, and not listed in partition_info.csv";
            return Err(partition(&files[0], what));
        }
        let name = properties.wanted("obs_collection", "a name")?;
        let partitions = partitions.into_iter().map(|(pixel, path)| {
            let within = path.strip_prefix(properties.folder()).unwrap_or(&path);
            Partition { pixel, name: format!("{name}/{}", within.display()), path }
        });
        let partitions = partitions.collect();
        let catalog = Self { properties, partitions };
        catalog.check_rows()?;
        Ok(catalog)
    }

    /// Gives `names` the columns of right ascension and declination that the catalog names, unless the user renamed
    /// them.
    ///
    /// # Errors
    /// When it does not say.
    pub fn name_columns(&self, names: &mut Names) -> Result<(), Refused> {
        let said = ["hats_col_ra", "hats_col_dec"].map(|key| self.properties.wanted(key, "the name of a column"));
        for (archive, said) in ["ra", "dec"].iter().zip(said) {
            names.rename_unless_renamed(archive, said?);
        }
        Ok(())
    }

    /// Returns the epoch of the positions, Julian year, where the catalog says it.
    ///
    /// # Errors
    /// When it is not a number.
    pub fn epoch_yr(&self) -> Result<Option<f64>, Refused> {
        let of_key = |key: &'static str| {
            let number = |text: &str| text.trim_start_matches(['J', 'j']).trim().parse::<f64>().ok();
            let is_year = |year: &f64| (1900.0..=2100.0).contains(year);
            let wanted = "a Julian year from 1900 to 2100, such as 2015.5 or J2015.5";
            let stated = self.properties.get(key);
            stated.map(|text| number(text).filter(is_year).ok_or_else(|| self.properties.refuse(key, wanted, text)))
        };
        of_key(EPOCH).or_else(|| of_key(COORDINATE_EPOCH)).transpose()
    }

    /// Credits that the catalog asks for, where it names some.
    pub fn credits(&self) -> Option<&str> {
        self.properties.get(ACKNOWLEDGEMENT)
    }

    /// Returns rows by the footers of all files against what the catalog says.
    fn check_rows(&self) -> Result<(), Refused> {
        let rows = self.partitions.iter().map(|partition| ParquetFile::open(&partition.path)?.rows());
        let got = rows.sum::<Result<u64, Refused>>()?;
        match self.properties.number("hats_nrows")? {
            Some(wanted) if wanted != got => {
                let path = self.properties.path.clone();
                Err(Refused::at(
                    path,
                    format_args!("hats_nrows, and the footers of its partitions: wanted {wanted} rows, got {got}"),
                ))
            }
            _ => Ok(()),
        }
    }
}

/// The files are not those that the list of partitions has.
fn partition(path: &Path, what: impl Display) -> Refused {
    Refused::at(path, format_args!("{what}; fetch or make the catalog again"))
}

/// Returns the pixels of `partition_info.csv`, none within another.
fn listed(path: &Path) -> Result<Vec<Pixel>, Refused> {
    let text = read_text(path, DATA_BYTES).map_err(Refused::file("cannot read", path))?;
    let mut lines = text.lines().enumerate();
    let refuse = |line: usize, got: &str| {
        Refused(format!(
            "{path}, line {line}: wanted a HEALPix order and pixel in columns Norder and Npix, got \"{got}\"",
            path = path.display(),
            line = line + 1
        ))
    };
    let (_, head) = lines.next().ok_or_else(|| refuse(0, ""))?;
    let place = |name| head.split(',').position(|cell| cell.trim() == name).ok_or_else(|| refuse(0, head));
    let (order, number) = (place("Norder")?, place("Npix")?);
    let mut pixels = Vec::new();
    for (at, line) in lines.filter(|(_, line)| !line.trim().is_empty()) {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let cell = |place: usize| cells.get(place).and_then(|cell| cell.parse().ok());
        let pixel = cell(order).zip(cell(number)).and_then(|(order, number)| Pixel::new(order, number));
        pixels.push(pixel.ok_or_else(|| refuse(at, line))?);
    }
    pixels.sort_by_key(|pixel| (pixel.finest().start, pixel.order));
    let shared = pixels.windows(2).find(|pair| pair[1].finest().start < pair[0].finest().end);
    match shared {
        Some(pair) => {
            let [one, other] = [pair[0], pair[1]].map(|pixel| format!("{}/Npix={}", pixel.folder(), pixel.number));
            Err(partition(path, format!("{one} and {other} share a part of the sky")))
        }
        None => Ok(pixels),
    }
}

/// Returns the files of each pixel that are on disk.
fn there(folder: &Path, suffix: &str) -> Result<BTreeMap<Pixel, Vec<PathBuf>>, Refused> {
    let mut there = BTreeMap::new();
    let mut orders = visible(&folder.join("dataset"))?;
    // Files beside them describe the whole catalog: `data_thumbnail.parquet`, `per_partition_statistics.parquet`, ...
    orders.retain(|path| path.is_dir());
    for (order, path) in numbered(orders, "Norder=", "")? {
        for (_, path) in numbered(visible(&path)?, "Dir=", "")? {
            for (number, path) in numbered(visible(&path)?, "Npix=", suffix.trim_matches('/'))? {
                let foreign = |what: &str| partition(&path, what);
                let pixel = Pixel::new(order, number);
                let pixel = pixel.ok_or_else(|| foreign(&format!("no HEALPix pixel of order 0 to {MOST_ORDER}")))?;
                if !path.parent().is_some_and(|parent| parent.ends_with(pixel.folder())) {
                    return Err(foreign(&format!("wanted it in {}", pixel.folder())));
                }
                let files = if path.is_dir() { visible(&path)?.into_iter().collect() } else { vec![path.clone()] };
                if files.is_empty() {
                    return Err(foreign("a folder without a file"));
                }
                if there.insert(pixel, files).is_some() {
                    return Err(foreign("there twice: as a file and as a folder"));
                }
            }
        }
    }
    Ok(there)
}

/// Files and folders of names like `Norder=5`, by number; anything else is foreign to a catalog.
fn numbered(paths: BTreeSet<PathBuf>, prefix: &str, suffix: &str) -> Result<Vec<(u64, PathBuf)>, Refused> {
    let number = |path: PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str());
        let suffix = if path.is_dir() { "" } else { suffix };
        let number = name.and_then(|name| name.strip_prefix(prefix)?.strip_suffix(suffix)?.parse().ok());
        let what = || format!("wanted {prefix}, a number, and \"{suffix}\"");
        number.map(|number| (number, path.clone())).ok_or_else(|| partition(&path, what()))
    };
    paths.into_iter().map(number).collect()
}

/// Files and folders, sorted, but those that readers of Parquet folders leave out: `_metadata`, `.crc` files, ...
fn visible(folder: &Path) -> Result<BTreeSet<PathBuf>, Refused> {
    let cannot = |source| Refused::file("cannot list", folder)(source);
    let mut paths = BTreeSet::new();
    for entry in std::fs::read_dir(folder).map_err(cannot)? {
        let entry = entry.map_err(cannot)?;
        if !entry.file_name().to_string_lossy().starts_with(['_', '.']) {
            paths.insert(entry.path());
        }
    }
    Ok(paths)
}
