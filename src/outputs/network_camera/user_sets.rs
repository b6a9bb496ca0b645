//! User sets: settings that a client keeps and takes back, by number. They live in memory, until the program ends.
//!
//! The first set is the bench's and never changes; the others begin as copies of it. A set has the words of [`WORDS`]
//! and, of a camera that clients command, of [`COMMANDED_WORDS`]; numbers of double precision are two words. What is of
//! one client or one moment is in none: addresses, packet sizes, events, selectors, the acquisition.

use crate::network_camera::{device::Values, features::own, regions::RegionSet};

/// Settings of every camera, in the order in which they are loaded.
const WORDS: [u32; 9] = [
    own::PIXEL_FORMAT,
    own::TEST_PATTERN,
    own::ACQUISITION_MODE,
    own::FRAME_COUNT,
    own::TRIGGER_MODE,
    own::TRIGGER_SOURCE,
    own::CHUNK_MODE,
    own::FRAME_RATE,
    own::FRAME_RATE_LOW,
];
/// Settings of a camera that clients command. Automatic modes are off before numbers are loaded.
const COMMANDED_WORDS: [u32; 14] = [
    own::EXPOSURE_TIME,
    own::EXPOSURE_TIME + 4,
    own::GAIN,
    own::GAIN + 4,
    own::BLACK_LEVEL,
    own::BLACK_LEVEL + 4,
    own::TRIGGER_DELAY,
    own::TRIGGER_DELAY + 4,
    own::FRAME_RATE_ENABLE,
    own::TRIGGER_OVERLAP,
    own::BURST,
    own::EXPOSURE_MODE,
    own::EXPOSURE_AUTO,
    own::GAIN_AUTO,
];

/// One set.
#[derive(Debug, Clone)]
pub(super) struct UserSet {
    /// Addresses and values, in the order of loading.
    pub(super) words: Vec<(u32, u32)>,
    /// Fields of the truth that are wanted, one bit each.
    pub(super) chunks: u32,
    /// Parts of the image.
    pub(super) regions: RegionSet,
}

impl UserSet {
    /// Returns the settings as they are now.
    pub(super) fn of(values: &Values, is_commanded: bool) -> Self {
        let more: &[u32] = if is_commanded { &COMMANDED_WORDS } else { &[] };
        let words = WORDS.iter().chain(more).map(|address| (*address, values.memory.word(*address)));
        Self { words: words.collect(), chunks: values.chunks, regions: values.regions.clone() }
    }

    /// Returns every write that loads it.
    pub(super) fn writes(&self, is_commanded: bool) -> impl Iterator<Item = (u32, u32)> {
        let automatic: &[u32] = if is_commanded { &[own::EXPOSURE_AUTO, own::GAIN_AUTO] } else { &[] };
        automatic.iter().map(|address| (*address, 0)).chain(self.words.iter().copied())
    }
}
