//! Counter-based random numbers: Philox-4x32-10.
//!
//! Input: a 64-bit key (the seed) and a 128-bit counter (frame, pixel block, stage). Output: four 32-bit words. Any
//! pixel of any frame can be drawn alone and in any order. Source: Salmon, Moraes, Dror and Shaw, "Parallel random
//! numbers: as easy as 1, 2, 3", SC11 (2011); the test below holds their published vectors.

/// Which draw a word is for: the last word of the counter, so that stages never share numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Stage {
    /// Photon and dark shot noise, and read noise, of one frame (one block serves two pixels).
    Temporal = 0,
    /// Photo-response non-uniformity: fixed pattern, frame 0.
    Prnu = 1,
    /// Dark-signal non-uniformity: fixed pattern, frame 0.
    Dsnu = 2,
    /// Words of one pixel's own, by attempt: Poisson draws by rejection.
    Overflow = 3,
    /// Frequencies and phases of line-of-sight noise: "frame" is the axis, "block" the line.
    Jitter = 4,
    /// Dark-current non-uniformity: fixed pattern, frame 0.
    DarkCurrent = 10,
    /// Offsets of columns: fixed pattern, frame 0; "pixel" is the column.
    ColumnOffset = 11,
    /// Gains of columns: fixed pattern, frame 0.
    ColumnGain = 12,
    /// Offsets of rows: fixed pattern, frame 0; "pixel" is the row.
    RowOffset = 13,
    /// Noise that a row shares, of one frame: "block" is three times the row and more, attempt 1 the state before row 0.
    RowNoise = 14,
    /// Level of a telegraph signal, by frame: "block" is its place.
    Telegraph = 20,
    /// Places of a random population of defects: "frame" is the kind, "block" the number.
    DefectPlaces = 21,
    /// Protons of one frame, two blocks each: "block" is the number, "attempt" which of the two.
    Protons = 22,
    /// A statistical star tracker: "block" 0 is what becomes of the frame, 1 its noise; places of waves in the last
    /// "frame".
    TrackerModel = 31,
    /// Stars of a made-up population: "frame" is the tile, "block" the star, "attempt" the layer and which block of the
    /// star.
    SyntheticStars = 30,
    /// Items and shards of a data set: "frame" is the item or shard, "attempt" the purpose.
    DataSet = 40,
}

const MULTIPLIER_0: u32 = 0xD251_1F53;
const MULTIPLIER_1: u32 = 0xCD9E_8D57;
const WEYL_0: u32 = 0x9E37_79B9;
const WEYL_1: u32 = 0xBB67_AE85;
const ROUNDS: usize = 10;
/// The low half of a number of 64 bits.
const LOW_HALF: u64 = 0xffff_ffff;

/// Returns one Philox-4x32-10 block.
#[inline(always)]
pub fn philox(counter: [u32; 4], key: [u32; 2]) -> [u32; 4] {
    philox_wide(counter, key).map(low)
}

/// Returns one Philox-4x32-10 block in the low halves of four numbers; their high halves are anything.
///
/// The state stays in 64 bits, whose high halves no product reads: a vector of them needs one multiplication, one shift
/// and one xor of three per word and round, and nothing that moves words between lanes.
#[inline(always)]
pub fn philox_wide(counter: [u32; 4], key: [u32; 2]) -> [u64; 4] {
    let [mut c0, mut c1, mut c2, mut c3] = counter.map(u64::from);
    let [mut k0, mut k1] = key;
    for _ in 0..ROUNDS {
        let p0 = u64::from(MULTIPLIER_0).wrapping_mul(c0 & LOW_HALF);
        let p1 = u64::from(MULTIPLIER_1).wrapping_mul(c2 & LOW_HALF);
        (c0, c1, c2, c3) = ((p1 >> 32) ^ c1 ^ u64::from(k0), p1, (p0 >> 32) ^ c3 ^ u64::from(k1), p0);
        k0 = k0.wrapping_add(WEYL_0);
        k1 = k1.wrapping_add(WEYL_1);
    }
    [c0, c1, c2, c3]
}

#[inline(always)]
#[allow(clippy::cast_possible_truncation, reason = "the low half is wanted")]
fn low(product: u64) -> u32 {
    product as u32
}

#[inline(always)]
#[allow(clippy::cast_possible_truncation, reason = "a 64-bit value shifted by 32 fits")]
fn high(product: u64) -> u32 {
    (product >> 32) as u32
}

/// Returns the key of a seed.
pub fn key(seed: u64) -> [u32; 2] {
    [low(seed), high(seed)]
}

/// Returns the counter of block `block` of `frame` for `stage`.
#[inline(always)]
pub fn counter(frame: u32, block: u32, stage: Stage) -> [u32; 4] {
    [block, frame, stage as u32, 0]
}

/// Returns the counter of attempt `attempt` of `block`, where one draw may need several blocks of words.
#[inline(always)]
pub fn attempt_counter(frame: u32, block: u32, stage: Stage, attempt: u32) -> [u32; 4] {
    [block, frame, stage as u32, attempt]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `kat_vectors` of Random123 1.14 for philox4x32-10.
    #[test]
    fn published_vectors() {
        assert_eq!(philox([0; 4], [0; 2]), [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
        assert_eq!(philox([u32::MAX; 4], [u32::MAX; 2]), [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]);
        assert_eq!(
            philox([0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344], [0xa409_3822, 0x299f_31d0]),
            [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]
        );
    }

    #[test]
    fn stages_frames_and_seeds_do_not_share_numbers() {
        let base = philox(counter(1, 2, Stage::Temporal), key(3));
        assert_ne!(base, philox(counter(2, 2, Stage::Temporal), key(3)), "frame");
        assert_ne!(base, philox(counter(1, 2, Stage::Prnu), key(3)), "stage");
        assert_ne!(base, philox(counter(1, 2, Stage::Temporal), key(4)), "seed");
        assert_ne!(base, philox(attempt_counter(1, 2, Stage::Temporal, 1), key(3)), "attempt");
    }
}
