//! Parquet files and HATS catalogs of `starloop catalog`; `without_hats` has the same names.

use crate::cli::catalog_hats::{Input, Kind};
use anyhow::bail;
use imports::hats::{ExportReport, Exporting, HatsCatalog, Partition, Pixel, export as export_hats, import};
use imports::published::gaia::Names;
use stars::layer::{Layer, Sorting};
use std::path::Path;

/// A Parquet file, with the pixel of the partition when it is one.
pub(super) struct Parquet(Option<Pixel>);

impl Parquet {
    /// Returns a file that belongs to no catalog.
    ///
    /// # Errors
    /// In a program without the feature.
    #[allow(clippy::unnecessary_wraps, reason = "the form without the feature fails")]
    pub(super) fn alone(_path: &Path) -> anyhow::Result<Self> {
        Ok(Self(None))
    }

    /// Imports `input`; returns the number of rows.
    pub(super) fn import(
        &self,
        input: &Input,
        sorting: &mut Sorting,
        progress: &mut dyn FnMut(u64),
    ) -> anyhow::Result<u64> {
        Ok(import(&input.path, self.0, &input.names, sorting, progress)?)
    }
}

/// Returns the files of the catalog in `folder`. `epoch_yr` must be the catalog's, where it states one.
pub(super) fn partitions(folder: &Path, names: &Names, epoch_yr: f64) -> anyhow::Result<Vec<Input>> {
    let catalog = HatsCatalog::open(folder)?;
    if let Some(said) = catalog.epoch_yr()?.filter(|said| *said != epoch_yr) {
        bail!("--epoch: wanted {said}, the epoch of {}, got {epoch_yr}", folder.display());
    }
    let mut names = names.clone();
    catalog.name_columns(&mut names)?;
    let input = |partition: &Partition| Input {
        name: partition.name.clone(),
        path: partition.path.clone(),
        names: names.clone(),
        kind: Kind::Parquet(Parquet(Some(partition.pixel))),
        credits: catalog.credits().map(str::to_owned),
    };
    Ok(catalog.partitions.iter().map(input).collect())
}

/// Writes layers as a catalog of a name and at most so many rows a partition; returns in words what was written.
pub(super) fn export(
    layers: &[Layer],
    folder: &Path,
    (name, max_rows): (&str, usize),
    share: &mut dyn FnMut(f64),
) -> anyhow::Result<String> {
    let what = Exporting { name: name.into(), max_rows };
    let ExportReport { stars, partitions, orders: [from, to], bytes } = export_hats(layers, folder, &what, share)?;
    Ok(format!("{stars} stars in {partitions} partitions of order {from} to {to}, {bytes} bytes"))
}
