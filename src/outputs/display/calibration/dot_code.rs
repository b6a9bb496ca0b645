//! Which dot is which: centroids of all dots and of those with each bit -> numbers.
//!
//! A dot's code is its number, counted from 1, and above it a bit that makes the count of ones even. A centroid of the
//! image with all dots carries bit k when the image of bit k has a centroid at the same place. One bit read wrong
//! spoils the parity, and a number read twice names neither: such centroids are left out and counted. Tests below.

use crate::display::calibration::error;
use base::refused::Refused;

/// Share of the median distance between neighbours within which two centroids are the same dot.
const SAME_PLACE: f64 = 0.25;

/// Returns the number of images that identify `count` dots.
pub fn bits_of(count: usize) -> u32 {
    usize::BITS - count.leading_zeros() + 1
}

/// Returns the code of dot `number` of `count`.
pub fn code(number: usize, count: usize) -> usize {
    number | (number.count_ones() as usize % 2) << (bits_of(count) - 1)
}

/// Returns the number of a code; `None` for one that no dot has.
fn number(code: usize, count: usize) -> Option<usize> {
    let number = code & !(1 << (bits_of(count) - 1));
    (code.count_ones().is_multiple_of(2) && (1..=count).contains(&number)).then_some(number)
}

/// Reads the codes: for each centroid of `all`, its dot's number. `bits[k]` holds the centroids of the image of bit k.
///
/// # Errors
/// When an image is missing.
pub fn numbers(all: &[[f64; 2]], bits: &[Vec<[f64; 2]>], count: usize) -> Result<Vec<Option<usize>>, Refused> {
    let wanted = bits_of(count) as usize;
    if let Some(bit) = (0..wanted).find(|bit| bits.get(*bit).is_none_or(Vec::is_empty)) {
        let got = format!("no centroid of dots_bit_{bit}");
        return Err(error::not_a_map("centroids of every image of dots", got));
    }
    let near = SAME_PLACE * neighbour_distance(all);
    let is_at = |places: &[[f64; 2]], at: &[f64; 2]| places.iter().any(|place| distance(place, at) <= near);
    let read = |at: &[f64; 2]| {
        let code = (0..wanted).filter(|bit| is_at(&bits[*bit], at)).map(|bit| 1 << bit).sum();
        number(code, count)
    };
    let mut numbers: Vec<Option<usize>> = all.iter().map(read).collect();
    let mut times = vec![0_u32; count + 1];
    numbers.iter().flatten().for_each(|number| times[*number] += 1);
    numbers.iter_mut().for_each(|number| *number = number.filter(|number| times[*number] == 1));
    Ok(numbers)
}

fn distance(a: &[f64; 2], b: &[f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Returns the median distance to the nearest other dot.
fn neighbour_distance(places: &[[f64; 2]]) -> f64 {
    let nearest = |(i, at): (usize, &[f64; 2])| {
        let others = places.iter().enumerate().filter(|(j, _)| *j != i);
        others.map(|(_, place)| distance(place, at)).fold(f64::INFINITY, f64::min)
    };
    let mut distances: Vec<f64> = places.iter().enumerate().map(nearest).collect();
    base::least_squares::median(&mut distances)
}

#[cfg(test)]
mod tests {
    use super::*;

    const COUNT: usize = 35;

    fn place(number: usize) -> [f64; 2] {
        // Rolled and mirrored: codes do not care.
        let (column, row) = ((number - 1) % 7, (number - 1) / 7);
        [300.0 - 20.0 * row as f64 - 3.0 * column as f64, 100.0 + 21.0 * column as f64]
    }

    fn shown() -> (Vec<[f64; 2]>, Vec<Vec<[f64; 2]>>) {
        let with_bit = |bit: u32| (1..=COUNT).filter(|n| code(*n, COUNT) >> bit & 1 == 1).map(place).collect();
        ((1..=COUNT).map(place).collect(), (0..bits_of(COUNT)).map(with_bit).collect())
    }

    #[test]
    fn every_dot_is_named() {
        let (all, bits) = shown();
        assert_eq!(bits_of(COUNT), 7, "six bits and the parity");
        let found = numbers(&all, &bits, COUNT).unwrap();
        assert_eq!(found, (1..=COUNT).map(Some).collect::<Vec<_>>());
    }

    #[test]
    fn a_bit_read_wrong_leaves_the_dot_out() {
        let (mut all, mut bits) = shown();
        bits[1].remove(3);
        bits[0].push([1000.0, 1000.0]);
        all.push([500.0, 500.0]);
        let found = numbers(&all, &bits, COUNT).unwrap();
        assert_eq!(found.iter().flatten().count(), COUNT - 1, "the others are named: {found:?}");
        assert!((0..COUNT).all(|i| found[i].is_none_or(|n| n == i + 1)), "none is named wrongly");
        assert_eq!(found[COUNT], None, "stray light has no code");
    }

    #[test]
    fn missing_images_are_reported() {
        let (all, mut bits) = shown();
        bits.pop();
        assert!(numbers(&all, &bits, COUNT).unwrap_err().to_string().contains("dots_bit_6"));
    }
}
