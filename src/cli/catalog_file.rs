//! How an import knows a file again: by its name and its fingerprint.

use anyhow::Context;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Bytes at each end of a file by which it is known again.
const END_BYTES: u64 = 64 << 10;

/// Returns the name of a file without its folder: it may be moved between two tries.
pub(super) fn name_of(path: &Path) -> anyhow::Result<String> {
    let name = path.file_name().and_then(|name| name.to_str());
    name.map(str::to_owned).with_context(|| format!("{}: wanted a file with a readable name", path.display()))
}

/// Returns the fingerprint of a file: its length, and the checksum of its two ends.
pub(super) fn mark(path: &Path) -> anyhow::Result<String> {
    let read = || {
        let mut file = std::fs::File::open(path)?;
        let bytes = file.metadata()?.len();
        let mut ends = Vec::new();
        (&mut file).take(END_BYTES).read_to_end(&mut ends)?;
        file.seek(SeekFrom::Start(bytes.saturating_sub(END_BYTES)))?;
        file.take(END_BYTES).read_to_end(&mut ends)?;
        std::io::Result::Ok(format!("{bytes} bytes, CRC-32 of its ends {:08x}", crc32fast::hash(&ends)))
    };
    read().with_context(|| format!("cannot read {}", path.display()))
}
