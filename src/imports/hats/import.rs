//! Parquet files -> stars for layers.
//!
//! Rows become stars as those of Gaia's CSV do ([`crate::published::gaia`]): by the same columns, of the same units,
//! with the same counts of what is blank. A row of a partition must lie in the pixel of the partition, within 0.02 mas
//! (0.06 arcsec where places are of single precision).

use super::{file::ParquetFile, pixel::Pixel, rows::Rows};
use crate::published::gaia::{DEC, Names, RA, star_of_row};
use base::{refused::Refused, units::DEG};
use stars::layer::Sorting;
use std::path::Path;

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
