//! Tests that imports hold no more memory than allowed, even with all stars in one place, and that layers are read
//! piece by piece.

use crate::counting::most_held_in;
use stars::layer::{Layer, NewStar, Sorting};
use std::path::Path;

/// Stars of an import, all in one part of the sky: 34 bytes each on disk, 56 while they are sorted.
const STARS: i64 = 400_000;
/// Memory allowed for the import, bytes: a tenth of that needed to sort all of them at once.
const GIVEN_BYTES: usize = 2 << 20;
/// Additional memory: the head's tables at order 6 (16 bytes for each of 49,152 tiles), buffers of the layer and of the
/// runs.
const BESIDE_BYTES: usize = (1 << 20) + (2 << 20) + 65 * (64 << 10);

fn import(folder: &Path, memory_bytes: usize, place: impl Fn(i64) -> f64) {
    let mut sorting = Sorting::start(&folder.join("work"), &[20.0]).unwrap().with_memory(memory_bytes);
    for number in 0..STARS {
        let (motion_mas_yr, parallax_mas, bp_rp) = (None, None, None);
        let (ra_rad, dec_rad, mag_g) = (place(number), 0.3, 12.0);
        let star = NewStar { source_id: number + 1, ra_rad, dec_rad, motion_mas_yr, parallax_mas, mag_g, bp_rp };
        sorting.add(&star).unwrap();
    }
    let reports = sorting.finish(folder, 2016.0, "", &mut |_| {}).unwrap();
    assert_eq!(reports[0].stars, u64::try_from(STARS).unwrap());
}

/// Returns errors in the memory use of imports.
pub(crate) fn complaints_of_imports() -> Vec<String> {
    let mut wrong = Vec::new();
    let folder = tempfile::tempdir().unwrap();
    let most = GIVEN_BYTES + BESIDE_BYTES;
    let one_place = |_: i64| 1.0;
    #[allow(clippy::cast_precision_loss, reason = "a few hundred thousand")]
    let one_degree = |number: i64| 1.0 + 0.02 * number as f64 / STARS as f64;
    let in_one_place = most_held_in(|| import(folder.path(), GIVEN_BYTES, one_place));
    let in_one_degree = most_held_in(|| import(&folder.path().join("degree"), GIVEN_BYTES, one_degree));
    let generous = most_held_in(|| import(&folder.path().join("generous"), 1 << 30, one_place));
    for (case, held) in [("in one place", in_one_place), ("in one degree", in_one_degree)] {
        if held > most {
            wrong.push(format!("an import of stars {case} held {held} bytes, wanted at most {most}"));
        }
    }
    let at_once = usize::try_from(STARS).unwrap() * 56;
    assert!(generous > at_once && at_once > 2 * most, "control: memory follows what is given: {generous}");
    let layer = Layer::open(&folder.path().join("g20.starlayer")).unwrap();
    let verifying = most_held_in(|| layer.verify(&mut |_| {}).unwrap());
    if verifying > 2 << 20 {
        wrong.push(format!("verifying a tile of {STARS} stars held {verifying} bytes"));
    }
    println!("imports held {in_one_place}, {in_one_degree} and {generous} bytes; verifying {verifying}");
    wrong
}
