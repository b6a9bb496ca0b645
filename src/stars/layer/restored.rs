//! A tile of a layer -> stars that an import stores as the same bytes.
//!
//! Rounding may have put a star half a step beyond the edge of its tile, or to the faint end of its layer, where an
//! import would take it to be its neighbour's. Such a star is given less than half a step inside, so that it rounds to
//! where it was: layer -> stars -> layer gives the same bytes (`imports::hats::tests::layers_come_back_as_they_were`).

use super::layout::{NO_COLOUR, PARALLAX_STEP_MAS, StarRecord, TileFrame};
use super::{open::Layer, star::NewStar};
use crate::store::{MAG_STEP, NO_PARALLAX, mag_of};
use base::{refused::Refused, source::ra_dec_rad};

/// Where a star is looked for inside its tile, steps: nearest first; the last two for what no half step finds.
const OFFSETS_STEPS: [f64; 8] = [0.0, 0.25, 0.45, 0.49, 0.499, 0.4999, 1.0, 2.0];

const SIGNS: [f64; 3] = [-1.0, 0.0, 1.0];

impl Layer {
    /// Appends the stars of a tile to `out`, brightest first; `bytes` is scratch. A star's `source_id` is its number,
    /// or its place in a layer without numbers.
    ///
    /// # Errors
    /// When the tile cannot be read or is damaged.
    pub fn restore_tile(&self, tile: u64, bytes: &mut Vec<u8>, out: &mut Vec<NewStar>) -> Result<(), Refused> {
        let index = self.index();
        if index.places(tile).is_empty() {
            return Ok(());
        }
        let frame = TileFrame::new(index.order, tile);
        let before = out.len();
        let read = self.each_piece(tile, bytes, &mut |piece| {
            out.extend(piece.stars().map(|(place, record, number)| {
                let record = StarRecord::from_bytes(record);
                let [ra_rad, dec_rad] = inside(&frame, index.order, tile, record.place);
                NewStar {
                    source_id: if index.numbering.is_some() { number } else { place.cast_signed() },
                    ra_rad,
                    dec_rad,
                    motion_mas_yr: record.motion_mas_yr(),
                    parallax_mas: (record.parallax != NO_PARALLAX)
                        .then(|| f64::from(record.parallax) * PARALLAX_STEP_MAS),
                    mag_g: magnitude(record.g, index.magnitudes),
                    bp_rp: (record.bp_rp != NO_COLOUR).then(|| f64::from(record.bp_rp) * MAG_STEP),
                }
            }));
            Ok(())
        });
        if read.is_err() {
            out.truncate(before);
        }
        read
    }
}

/// Returns right ascension and declination that lie in the tile.
fn inside(frame: &TileFrame, order: u8, tile: u64, place: [u32; 2]) -> [f64; 2] {
    let direction = frame.direction(place);
    let east = frame.direction([place[0] + 1, place[1]]) - direction;
    let north = frame.direction([place[0], place[1] + 1]) - direction;
    let about = OFFSETS_STEPS.iter().flat_map(|offset| {
        SIGNS
            .iter()
            .flat_map(move |eastward| SIGNS.iter().map(move |northward| [offset * eastward, offset * northward]))
    });
    let mut places = about.map(|[eastward, northward]| ra_dec_rad(direction + eastward * east + northward * north));
    let is_in = |place: &[f64; 2]| crate::healpix::cell(order, place[0], place[1]) == tile;
    places.find(is_in).unwrap_or_else(|| ra_dec_rad(direction))
}

/// Returns a magnitude within the layer's range: from, and below.
fn magnitude(g: u16, [from, below]: [f32; 2]) -> f64 {
    let mag = mag_of(g);
    let below = f64::from(below);
    if mag < below { mag.max(f64::from(from)) } else { 0.5 * (mag - 0.5 * MAG_STEP + below) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::MAG_ZERO;
    use base::{source::direction_from_ra_dec, units::MAS};

    #[test]
    fn stars_beyond_the_edge_of_their_tile_are_given_inside_it() {
        let (order, mut moved) = (6, 0);
        for i in 0..100_000_u32 {
            // Points along the meridian of RA 0, near the edges that pixels have there.
            let dec_rad = f64::from(i) * 1.5e-5;
            let edge = crate::healpix::cell(order, 0.0, dec_rad);
            let ra_rad = f64::from(i % 7) * 0.1 * MAS;
            let tile = crate::healpix::cell(order, ra_rad, dec_rad);
            let frame = TileFrame::new(order, tile);
            let steps = frame.steps(direction_from_ra_dec(ra_rad, dec_rad));
            let [ra, dec] = inside(&frame, order, tile, steps);
            assert_eq!(crate::healpix::cell(order, ra, dec), tile, "{i}, beside {edge}");
            assert_eq!(frame.steps(direction_from_ra_dec(ra, dec)), steps, "{i}: rounds to where it was");
            let there = ra_dec_rad(frame.direction(steps));
            moved += u32::from(crate::healpix::cell(order, there[0], there[1]) != tile);
        }
        assert!(moved > 100, "control: {moved} were beyond the edge");
    }

    #[test]
    fn magnitudes_stay_within_their_layer() {
        let steps = |mag: f64| ((mag - MAG_ZERO) / MAG_STEP).round() as u16;
        for (mag, limits) in [
            (9.9996, [f32::NEG_INFINITY, 10.0]),
            (10.0, [10.0, 14.0]),
            (13.9999, [10.0, 14.0]),
            (14.00049, [10.0, 14.0005]),
            (10.0004, [10.0004, 14.0]),
            (12.3, [10.0, 14.0]),
        ] {
            let g = steps(mag);
            let back = magnitude(g, limits);
            assert!(back >= f64::from(limits[0]) && back < f64::from(limits[1]), "{mag}: {back}");
            assert_eq!(steps(back), g, "{mag}: {back}");
        }
    }
}
