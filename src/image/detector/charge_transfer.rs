//! Charge transfer inefficiency: every transfer leaves a share behind, which trails away from the output.
//!
//! In and out: charge of every pixel, e-. A packet that needs `n` transfers arrives `k` pixels late with the share
//! `C(n + k - 1, k) (1 - c)^n c^k`, `c` the share left behind by one transfer: each of the `n` transfers may have to be done
//! again any number of times (negative binomial law; for `n c << 1` the familiar `n c` in the first trailing pixel:
//! Janesick 2001, section 5.2). Row `y` from the output needs `y + 1` parallel transfers, column `x` as many serial
//! ones. The law is cut after [`Trails::terms`] pixels, where less than [`TAIL`] of the farthest packet is left; that
//! rest is put into the last of them, so that charge is conserved, except the part that trails out of the image.
//!
//! Limits: the same share for every signal and time; no traps with time constants, no charge-injected fat zero.
//! Tests below compare it with a simulation of all transfers, one by one.

use crate::detector::Effect;
use crate::detector::effect_order::{FrameAt, NeighbourStage};
use base::image::Image;
use rayon::prelude::*;

/// Largest part of a packet that is not where the law puts it.
pub const TAIL: f64 = 1e-7;
/// Most pixels of a trail.
pub const MOST_TERMS: usize = 32;
/// Largest product of share and transfers for which [`MOST_TERMS`] are enough.
pub const MOST_LEFT_BEHIND: f64 = 6.0;

/// Corner of the amplifier.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum OutputCorner {
    /// Rows go up, pixels left: trails go down and right.
    #[default]
    TopLeft,
    /// Rows go up, pixels right.
    TopRight,
    /// Rows go down, pixels left.
    BottomLeft,
    /// Rows go down, pixels right.
    BottomRight,
}

/// Shares left behind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChargeTransfer {
    /// Share left behind by one transfer from row to row.
    pub parallel_share: f64,
    /// Share left behind by one transfer along the output register.
    pub serial_share: f64,
    /// Corner to which charge goes.
    pub corner: OutputCorner,
}

impl ChargeTransfer {
    /// Transfer without loss.
    pub const NONE: Self = Self { parallel_share: 0.0, serial_share: 0.0, corner: OutputCorner::TopLeft };

    /// Returns whether rows are counted from the last one.
    pub fn is_from_bottom(&self) -> bool {
        matches!(self.corner, OutputCorner::BottomLeft | OutputCorner::BottomRight)
    }

    /// Returns whether columns are counted from the last one.
    pub fn is_from_right(&self) -> bool {
        matches!(self.corner, OutputCorner::TopRight | OutputCorner::BottomRight)
    }
}

/// Shares of packets by place and delay.
#[derive(Debug, Clone, PartialEq)]
pub struct Trails {
    /// `[delay * places + place]`, places counted from the output.
    shares: Vec<f32>,
    places: usize,
}

impl Trails {
    /// Returns the trails of packets that need 1, 2, ... `places` transfers.
    pub fn new(share: f64, places: usize) -> Self {
        let terms = terms_for(share, places);
        let mut shares = vec![0.0; terms * places];
        for place in 0..places {
            let law = law(share, place + 1, terms);
            for (delay, share) in law.into_iter().enumerate() {
                #[allow(clippy::cast_possible_truncation, reason = "the inner loops work in single precision")]
                let share = share as f32;
                // Of a full well less than 1e-13 electrons; products with smaller shares would be denormal, and slow.
                shares[delay * places + place] = if share < 1e-20 { 0.0 } else { share };
            }
        }
        Self { shares, places }
    }

    /// Returns pixels that a packet spreads over, its own included.
    pub fn terms(&self) -> usize {
        self.shares.len() / self.places.max(1)
    }

    /// Returns all shares, `[delay * places + place]`.
    pub fn shares(&self) -> &[f32] {
        &self.shares
    }

    fn share(&self, delay: usize, place: usize) -> f32 {
        self.shares[delay * self.places + place]
    }
}

/// Returns shares by delay of a packet that needs `transfers`; the last one has all that is left.
fn law(share: f64, transfers: usize, terms: usize) -> Vec<f64> {
    let n = transfers as f64;
    let mut term = libm::pow(1.0 - share, n);
    let mut left = 1.0;
    let mut all = Vec::with_capacity(terms);
    for delay in 1..terms {
        all.push(term);
        left -= term;
        term *= share * (n + delay as f64 - 1.0) / delay as f64;
    }
    all.push(left);
    all
}

/// Returns terms after which less than [`TAIL`] of the farthest packet is left.
fn terms_for(share: f64, places: usize) -> usize {
    if share == 0.0 {
        return 1;
    }
    (2..MOST_TERMS)
        .find(|terms| {
            let last = law(share, places, *terms + 1);
            last[*terms] < TAIL
        })
        .unwrap_or(MOST_TERMS)
}

/// The stage with its tables.
#[derive(Debug)]
pub struct ChargeTransferStage {
    transfer: ChargeTransfer,
    parallel: Trails,
    serial: Trails,
    shifted: Image<f32>,
}

impl ChargeTransferStage {
    /// Returns the stage for images of this size.
    pub fn new(transfer: &ChargeTransfer, [width, height]: [usize; 2]) -> Self {
        Self {
            transfer: *transfer,
            parallel: Trails::new(transfer.parallel_share, height),
            serial: Trails::new(transfer.serial_share, width),
            shifted: Image::new(width, height),
        }
    }
}

impl NeighbourStage for ChargeTransferStage {
    fn effect(&self) -> Effect {
        Effect::ChargeTransfer
    }

    fn apply<'a>(&'a mut self, charge: &'a mut Image<f32>, _: &FrameAt) -> &'a mut Image<f32> {
        let (width, height) = (charge.width().max(1), charge.height());
        let Self { transfer, parallel, serial, shifted } = self;
        let from = charge.pixels();
        shifted.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(y, to)| {
            let row_at = |place: usize| if transfer.is_from_bottom() { height - 1 - place } else { place };
            shift_row(from, to, parallel, row_at(y), row_at);
        });
        let from = shifted.pixels();
        charge.pixels_mut().par_chunks_mut(width).zip(from.par_chunks(width)).for_each(|(to, from)| {
            shift_pixels(from, to, serial, transfer.is_from_right());
        });
        charge
    }
}

/// Returns one row of the image after the parallel transfers: sums over the rows before it, counted from the output.
fn shift_row(from: &[f32], to: &mut [f32], trails: &Trails, place: usize, row_at: impl Fn(usize) -> usize) {
    let width = to.len();
    to.fill(0.0);
    for delay in 0..trails.terms().min(place + 1) {
        let share = trails.share(delay, place - delay);
        let row = row_at(place - delay) * width;
        to.iter_mut().zip(&from[row..row + width]).for_each(|(to, e)| *to += share * e);
    }
}

/// Writes one row after the serial transfers to `to`.
fn shift_pixels(from: &[f32], to: &mut [f32], trails: &Trails, is_from_right: bool) {
    let width = from.len();
    let column_at = |place: usize| if is_from_right { width - 1 - place } else { place };
    for place in 0..width {
        let delays = 0..trails.terms().min(place + 1);
        to[column_at(place)] = delays.fold(0.0, |sum, delay| {
            let share = trails.share(delay, place - delay);
            sum + share * from[column_at(place - delay)]
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::random::philox;

    const AT: FrameAt = FrameAt { frame: 0, exposure_s: 1.0, key: [0; 2] };

    /// Returns every packet by every transfer: each tick all packets move one place towards the output, except the
    /// share that stays. The charge that leaves place 0 at tick `t` is pixel `t`.
    fn by_ticks(line: &[f64], share: f64) -> Vec<f64> {
        let mut wells = line.to_vec();
        (0..line.len())
            .map(|_| {
                let out = wells[0] * (1.0 - share);
                for place in 0..wells.len() {
                    let next = wells.get(place + 1).map_or(0.0, |e| e * (1.0 - share));
                    wells[place] = wells[place] * share + next;
                }
                out
            })
            .collect()
    }

    fn random(count: u32) -> Vec<f64> {
        (0..count).map(|i| f64::from(philox([i, 0, 9, 0], [4, 4])[0]) / 4_294_967_296.0 * 1e4).collect()
    }

    fn image(width: usize, height: usize) -> Image<f32> {
        let mut image = Image::new(width, height);
        let values = random(u32::try_from(width * height).unwrap());
        image.pixels_mut().iter_mut().zip(values).for_each(|(to, e)| *to = e as f32);
        image
    }

    fn transferred(transfer: ChargeTransfer, mut image: Image<f32>) -> Image<f32> {
        let mut stage = ChargeTransferStage::new(&transfer, [image.width(), image.height()]);
        stage.apply(&mut image, &AT);
        image
    }

    fn largest_difference(got: &[f32], wanted: &[f64]) -> f64 {
        assert_eq!(got.len(), wanted.len());
        got.iter().zip(wanted).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn a_column_is_as_transfer_by_transfer() {
        for share in [1e-6, 1e-4, 1e-3, 0.02] {
            let transfer = ChargeTransfer { parallel_share: share, serial_share: 0.0, corner: OutputCorner::TopLeft };
            let column = image(1, 250);
            let line: Vec<f64> = column.pixels().iter().map(|e| f64::from(*e)).collect();
            let got = transferred(transfer, column);
            let error = largest_difference(got.pixels(), &by_ticks(&line, share));
            // Rounding of f32 shares and sums at 1e4 e-, and the cut tail.
            assert!(error < 1e4 * 5e-7, "share {share}: {error} e-");
            let other = largest_difference(got.pixels(), &by_ticks(&line, share * 1.01));
            assert!(other > 2.0 * error, "negative control at {share}: {other} {error}");
        }
    }

    #[test]
    fn rows_and_corners() {
        let share = 2e-3;
        let (width, height) = (70, 50);
        for corner in
            [OutputCorner::TopLeft, OutputCorner::TopRight, OutputCorner::BottomLeft, OutputCorner::BottomRight]
        {
            let transfer = ChargeTransfer { parallel_share: share, serial_share: 5e-3, corner };
            let start = image(width, height);
            let mut wanted: Vec<f64> = start.pixels().iter().map(|e| f64::from(*e)).collect();
            let flip = |line: &mut Vec<f64>, on: bool| {
                if on {
                    line.reverse();
                }
            };
            for x in 0..width {
                let mut line: Vec<f64> = (0..height).map(|y| wanted[y * width + x]).collect();
                flip(&mut line, transfer.is_from_bottom());
                line = by_ticks(&line, share);
                flip(&mut line, transfer.is_from_bottom());
                (0..height).for_each(|y| wanted[y * width + x] = line[y]);
            }
            for y in 0..height {
                let mut line = wanted[y * width..(y + 1) * width].to_vec();
                flip(&mut line, transfer.is_from_right());
                line = by_ticks(&line, 5e-3);
                flip(&mut line, transfer.is_from_right());
                wanted[y * width..(y + 1) * width].copy_from_slice(&line);
            }
            let error = largest_difference(transferred(transfer, start).pixels(), &wanted);
            assert!(error < 1e4 * 5e-7, "{corner:?}: {error} e-");
        }
    }

    #[test]
    fn charge_is_conserved_where_the_trail_stays_inside() {
        let mut start = Image::new(64, 64);
        start.pixels_mut()[10 * 64 + 20] = 5000.0;
        let transfer = ChargeTransfer { parallel_share: 1e-3, serial_share: 1e-3, corner: OutputCorner::TopLeft };
        let out = transferred(transfer, start);
        let sum: f64 = out.pixels().iter().map(|e| f64::from(*e)).sum();
        assert!((sum / 5000.0 - 1.0).abs() < 3e-7, "{sum}");
        assert!((f64::from(out.get(20, 11).unwrap()) / 5000.0 - 11e-3).abs() < 5e-4, "n c in the next row");
        assert_eq!(out.get(19, 10), Some(0.0), "nothing runs ahead");
        assert_eq!(out.get(20, 9), Some(0.0), "nothing runs ahead");
    }

    #[test]
    fn zero_share_changes_nothing_and_few_terms_suffice() {
        let transfer = ChargeTransfer { parallel_share: 0.0, serial_share: 0.0, corner: OutputCorner::BottomRight };
        assert_eq!(transferred(transfer, image(33, 21)), image(33, 21));
        assert_eq!(Trails::new(0.0, 1000).terms(), 1);
        assert!(Trails::new(1e-5, 1000).terms() <= 5, "{}", Trails::new(1e-5, 1000).terms());
        let share = MOST_LEFT_BEHIND / 4096.0;
        let terms = Trails::new(share, 4096).terms();
        assert!(terms < MOST_TERMS, "the largest allowed: {terms}");
    }
}
