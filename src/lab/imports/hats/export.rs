//! Layers -> a HATS catalog.
//!
//! The sky is parted as finely as it must be for no partition to have more than so many rows. Memory: the stars of one
//! part, which is a partition, or a cell of order 6 to 8 (as the layers' tiles are) where that has more; in the densest
//! part of the whole of Gaia DR3 some 100,000 stars, 100 bytes each. The catalog gets its name when it is whole. An
//! import of it with the limits of the layers makes the same layers, byte for byte (`super::tests`).

use super::catalog::{ACKNOWLEDGEMENT, EPOCH};
use super::pixel::{MOST_ORDER, Pixel};
use super::properties;
use super::writer::{CatalogRow, CatalogWriter};
use base::{refused::Refused, unfinished::Unfinished};
use stars::layer::{Layer, NewStar};
use std::fs;
use std::path::{Path, PathBuf};

/// Finest cell that is read at a time: counts of all are in memory.
const MOST_CELL_ORDER: u8 = 8;
/// Finest partition: as fine as the importers of others go.
const MOST_PARTITION_ORDER: u8 = 13;

/// How a catalog is to be.
#[derive(Debug, Clone)]
pub struct Exporting {
    /// Its name (`obs_collection`).
    pub name: String,
    /// Most rows in a partition.
    pub max_rows: usize,
}

/// A catalog that was written.
#[derive(Debug, Clone, PartialEq)]
pub struct ExportReport {
    /// Stars in it.
    pub stars: u64,
    /// Its partitions.
    pub partitions: usize,
    /// Their HEALPix orders, from and to.
    pub orders: [u8; 2],
    /// Bytes of its partitions.
    pub bytes: u64,
}

/// Writes layers of one epoch as the catalog `folder`. `progress` gets the share done, 0..1.
///
/// # Errors
/// When the layers do not fit together or are damaged, the folder is there already, or the disk failed; nothing is left
/// of it then.
pub fn export(
    layers: &[Layer],
    folder: &Path,
    what: &Exporting,
    progress: &mut dyn FnMut(f64),
) -> Result<ExportReport, Refused> {
    check(layers)?;
    // Without a slash at its end: a name is put beside it.
    let folder = &folder.components().collect::<PathBuf>();
    if folder.file_name().is_none() {
        return Err(Refused(format!(
            "{folder:?}: wanted the name of a new folder for the catalog, such as out/sky, got none at its end"
        )));
    }
    let mut unfinished = folder.as_os_str().to_owned();
    unfinished.push(".part");
    let unfinished = PathBuf::from(unfinished);
    if let Some(path) = [folder, &unfinished].into_iter().find(|path| path.exists()) {
        return Err(Refused::at(path, "there already: name another folder, or remove it"));
    }
    let _registered = Unfinished::register(&unfinished);
    let done = Export::begin(layers, &unfinished, what, progress).and_then(|export| export.finish());
    let done = done.and_then(|report| {
        fs::rename(&unfinished, folder).map_err(Refused::file("cannot rename", &unfinished))?;
        Ok(report)
    });
    if done.is_err() && unfinished.exists() {
        fs::remove_dir_all(&unfinished).map_err(Refused::file("cannot remove", &unfinished))?;
    }
    done
}

/// Checks that the layers are of one epoch, and none contains magnitudes of another.
fn check(layers: &[Layer]) -> Result<(), Refused> {
    let refuse = |layer: &Layer, what, wanted, got| {
        Err(Refused::at(layer.path(), format_args!("{what}: wanted {wanted}, got {got}")))
    };
    for pair in layers.windows(2) {
        let [before, layer] = pair else { continue };
        let (facts, of_before) = (layer.index(), before.index());
        if facts.epoch_yr != of_before.epoch_yr {
            let (wanted, got) = (format!("J{}", of_before.epoch_yr), format!("J{}", facts.epoch_yr));
            return refuse(layer, "epoch", wanted, got);
        }
        if facts.magnitudes[0] < of_before.magnitudes[1] {
            let wanted = format!("{} or fainter, where {} ends", of_before.magnitudes[1], before.path().display());
            return refuse(layer, "magnitudes", wanted, format!("from {}", facts.magnitudes[0]));
        }
    }
    match layers.first() {
        Some(first) if layers.iter().all(|layer| layer.index().stars() == 0) => {
            refuse(first, "stars", "some in a layer".into(), "none".into())
        }
        _ => Ok(()),
    }
}

/// A catalog on its way.
struct Export<'a> {
    layers: &'a [Layer],
    what: &'a Exporting,
    progress: &'a mut dyn FnMut(f64),
    folder: &'a Path,
    dataset: PathBuf,
    writer: CatalogWriter,
    /// Order of the cells that are counted, and stars before each of them.
    cell_order: u8,
    before: Vec<u64>,
    pixels: Vec<Pixel>,
    stars: u64,
    bytes: u64,
}

impl<'a> Export<'a> {
    fn begin(
        layers: &'a [Layer],
        folder: &'a Path,
        what: &'a Exporting,
        progress: &'a mut dyn FnMut(f64),
    ) -> Result<Self, Refused> {
        let dataset = folder.join("dataset");
        fs::create_dir_all(&dataset).map_err(Refused::file("cannot make", &dataset))?;
        let has_numbers = layers.iter().all(|layer| layer.index().numbering.is_some());
        let writer = CatalogWriter::new(has_numbers)
            .map_err(|source| Refused(format!("cannot write {path}: {source}", path = dataset.display())))?;
        let cell_order = layers.iter().map(|layer| layer.index().order).min().unwrap_or(0).min(MOST_CELL_ORDER);
        let mut before = vec![0; (12 << (2 * cell_order)) + 1];
        for layer in layers {
            for (tile, stars) in layer.index().stars_of_tiles().enumerate() {
                before[(tile >> (2 * (layer.index().order - cell_order))) + 1] += stars;
            }
        }
        for cell in 1..before.len() {
            before[cell] += before[cell - 1];
        }
        let (pixels, stars, bytes) = (Vec::new(), 0, 0);
        Ok(Self { layers, what, progress, folder, dataset, writer, cell_order, before, pixels, stars, bytes })
    }

    fn finish(mut self) -> Result<ExportReport, Refused> {
        for number in 0..12 {
            self.visit(Pixel { order: 0, number })?;
        }
        self.write_list()?;
        self.write_properties()?;
        self.writer.finish(&self.dataset)?;
        let orders = self.pixels.iter().map(|pixel| pixel.order);
        let orders = [orders.clone().min().unwrap_or(0), orders.max().unwrap_or(0)];
        Ok(ExportReport { stars: self.stars, partitions: self.pixels.len(), orders, bytes: self.bytes })
    }

    /// Goes down to where a pixel has few enough stars, or is a cell.
    fn visit(&mut self, pixel: Pixel) -> Result<(), Refused> {
        let cells = pixel.at(self.cell_order);
        let place = |cell: u64| usize::try_from(cell).unwrap_or(usize::MAX);
        let stars = self.before[place(cells.end)] - self.before[place(cells.start)];
        if stars == 0 {
            return Ok(());
        }
        if stars > self.what.max_rows as u64 && pixel.order < self.cell_order {
            return pixel.parts().into_iter().try_for_each(|part| self.visit(part));
        }
        let rows = self.read(pixel)?;
        self.split(pixel, &rows)?;
        (self.progress)(self.stars as f64 / self.before.last().copied().unwrap_or(1) as f64);
        Ok(())
    }

    /// Returns the stars of a pixel, sorted as a catalog has them.
    fn read(&self, pixel: Pixel) -> Result<Vec<CatalogRow>, Refused> {
        let (mut rows, mut stars, mut bytes) = (Vec::new(), Vec::new(), Vec::new());
        let mut first = 0;
        for layer in self.layers {
            for tile in pixel.at(layer.index().order) {
                layer.restore_tile(tile, &mut bytes, &mut stars)?;
                let places = first + layer.index().places(tile).start.cast_signed()..;
                rows.extend(places.zip(stars.drain(..)).map(|(starloop_id, star): (i64, NewStar)| CatalogRow {
                    healpix: stars::healpix::cell(MOST_ORDER, star.ra_rad, star.dec_rad),
                    starloop_id,
                    star,
                }));
            }
            first += layer.index().stars().cast_signed();
        }
        rows.sort_unstable_by_key(|row| (row.healpix, row.starloop_id));
        Ok(rows)
    }

    /// Writes the rows of a pixel, of its parts where they are too many for one file.
    fn split(&mut self, pixel: Pixel, rows: &[CatalogRow]) -> Result<(), Refused> {
        if rows.is_empty() {
            return Ok(());
        }
        if rows.len() > self.what.max_rows {
            let Pixel { order, number } = pixel;
            if order == MOST_PARTITION_ORDER {
                return Err(Refused(format!(
                    "pixel {number} of order {order}: {stars} stars; wanted at most {most}: raise --max-rows",
                    stars = rows.len(),
                    most = self.what.max_rows
                )));
            }
            let mut rest = rows;
            let [first @ .., last] = pixel.parts();
            for part in first {
                let (of_part, others) = rest.split_at(rest.partition_point(|row| row.healpix < part.finest().end));
                self.split(part, of_part)?;
                rest = others;
            }
            return self.split(last, rest);
        }
        let folder = self.dataset.join(pixel.folder());
        fs::create_dir_all(&folder).map_err(Refused::file("cannot make", &folder))?;
        let within = format!("{}/Npix={}.parquet", pixel.folder(), pixel.number);
        self.writer.write(&self.dataset, &within, rows)?;
        let path = self.dataset.join(&within);
        self.bytes += fs::metadata(&path).map_err(Refused::file("cannot read", &path))?.len();
        self.stars += rows.len() as u64;
        self.pixels.push(pixel);
        Ok(())
    }

    fn write_list(&mut self) -> Result<(), Refused> {
        self.pixels.sort_unstable();
        let lines = self.pixels.iter().map(|Pixel { order, number }| format!("{order},{number}\n"));
        let path = self.folder.join("partition_info.csv");
        let text = format!("Norder,Npix\n{}", lines.collect::<String>());
        fs::write(&path, text).map_err(Refused::file("cannot write", &path))
    }

    fn write_properties(&self) -> Result<(), Refused> {
        let share: f64 = self.pixels.iter().map(|pixel| 1.0 / (12_u64 << (2 * pixel.order)) as f64).sum();
        let mut credits: Vec<&str> =
            self.layers.iter().map(|layer| layer.index().credits.as_str()).filter(|text| !text.is_empty()).collect();
        credits.dedup();
        let epoch_yr = self.layers.first().map_or(String::new(), |layer| layer.index().epoch_yr.to_string());
        let values = [
            ("obs_collection", self.what.name.clone()),
            ("dataproduct_type", "object".into()),
            ("hats_nrows", self.stars.to_string()),
            ("hats_col_ra", "ra".into()),
            ("hats_col_dec", "dec".into()),
            ("hats_col_healpix", "_healpix_29".into()),
            ("hats_col_healpix_order", MOST_ORDER.to_string()),
            ("hats_npix_suffix", ".parquet".into()),
            ("hats_max_rows", self.what.max_rows.to_string()),
            ("hats_estsize", (self.bytes / 1024).to_string()),
            ("moc_sky_fraction", format!("{share:.5}")),
            ("hats_builder", concat!("starloop ", env!("CARGO_PKG_VERSION")).into()),
            ("hats_version", "v1.0".into()),
            (ACKNOWLEDGEMENT, credits.join("; ")),
            (EPOCH, epoch_yr),
        ];
        // Older readers know the file by its second name.
        ["hats.properties", "properties"]
            .iter()
            .try_for_each(|name| properties::write(&self.folder.join(name), &values))
    }
}
