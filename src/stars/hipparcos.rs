//! Gaia numbers -> Hipparcos numbers of the same stars.
//!
//! In: a `source_id` of Gaia DR3. Out: the star's number in the Hipparcos catalog, where it has one and is brighter than
//! G = 8.5, the limit of the built-in catalog. The table is made by `hil_scripts/make_hipparcos_table.py`. Tests: below, and
//! places in the Hipparcos catalog itself in `hil_scripts/test_data_sets.py`.

/// Number of stars, Gaia numbers in ascending order, Hipparcos numbers; little-endian.
const TABLE: &[u8] = include_bytes!("catalog/gaia_hipparcos.bin");
const GAIA_BYTES: usize = 8;
const HIPPARCOS_BYTES: usize = 4;
/// The number of stars comes first.
const HEAD_BYTES: usize = 4;

/// Returns the Hipparcos number of a star that Gaia DR3 knows by `source_id`; `None` when the table has none.
pub fn hipparcos_of_gaia(source_id: u64) -> Option<u32> {
    let count = (TABLE.len() - HEAD_BYTES) / (GAIA_BYTES + HIPPARCOS_BYTES);
    let (gaia, hipparcos) = TABLE[HEAD_BYTES..].split_at(count * GAIA_BYTES);
    let gaia = gaia.as_chunks::<GAIA_BYTES>().0;
    let place = gaia.binary_search_by_key(&source_id, |bytes| u64::from_le_bytes(*bytes)).ok()?;
    hipparcos.as_chunks::<HIPPARCOS_BYTES>().0.get(place).map(|bytes| u32::from_le_bytes(*bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_stars_have_their_numbers_and_others_have_none() {
        // A star of magnitude 5.8 in Cetus.
        assert_eq!(hipparcos_of_gaia(650_159_265_042_048), Some(14_315));
        assert_eq!(hipparcos_of_gaia(650_159_265_042_049), None);
        assert_eq!((hipparcos_of_gaia(0), hipparcos_of_gaia(u64::MAX)), (None, None));
    }

    #[test]
    fn table_is_whole_and_in_order() {
        let count = u32::from_le_bytes(TABLE[..HEAD_BYTES].try_into().unwrap()) as usize;
        assert_eq!(TABLE.len(), HEAD_BYTES + count * (GAIA_BYTES + HIPPARCOS_BYTES));
        let gaia = TABLE[HEAD_BYTES..HEAD_BYTES + count * GAIA_BYTES].as_chunks::<GAIA_BYTES>().0;
        assert!(gaia.windows(2).all(|pair| u64::from_le_bytes(pair[0]) < u64::from_le_bytes(pair[1])));
    }
}
