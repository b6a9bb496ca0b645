//! Frames for programs on the same machine: a ring of frames in a file that lives in memory (tmpfs, `/dev/shm`).
//!
//! Input: frames. Output: a file of fixed size that a reader maps (`mmap`, `numpy.memmap`), which holds a few frames
//! and the truth numbers of each. The writer never waits and does not know its readers: the oldest frame is
//! overwritten, and a reader sees by the numbers how many it missed. Only the copy of a frame is made: no name service,
//! no daemon.
//!
//! Layout, numbers in the byte order of the machine (`firmware_protocol/FRAMES.md` has every field, held to these
//! structures by `tests/conformance/frames_document.rs`):
//!
//! | at | what |
//! |---|---|
//! | 0 | [`FileHead`], 64 bytes |
//! | 64 + slot (256 + 2 width height, rounded up to 64) | [`SlotHead`], 256 bytes; then the pixels, `u16`, row by row |
//!
//! *Reading.* `published` says how many frames there have been; frame `n`, from 1, is in slot `(n - 1) % slots`. A slot's
//! `serial` is 0 while the slot is written, then `n`. Read `serial`, copy the slot, read `serial` again: when both are
//! `n` the copy is frame `n`. The CRC-32 of the pixels is in the slot as well, for readers that want to be sure.
//! `hil_scripts/starloop/shared_frames.py` is such a reader.
//!
//! *The name.* The file gets its name when it is complete. A run holds a lock on its file for as long as it lives. Only
//! the program that holds the lock of the file with that name may take the name from it: a killed run's file is
//! replaced, a running run's file is not, and no run removes the file of another. The lock is one of an open file
//! description (`F_OFD_SETLK`) on a byte far behind the end of the file, so that a reader's `flock` does not collide
//! with it. When a ring loses its name during the run (the file was removed or replaced), every frame from then on is
//! an error ([`SinkError::Vanished`]): readers that have it open still get them, new readers cannot. The same holds for
//! a ring that another program cuts short ([`SinkError::Write`]): what readers find behind the cut is not a frame.
//!
//! Limits: one size of frame. Unix. Written by `pwrite`, so that no memory is shared by reference with other programs:
//! no `unsafe`, at the cost of one copy by the kernel. Tests: below, and `hil_scripts/tests/test_recorders.py` from another
//! process.

use crate::sink::facts::{FactSource, Place, Scalar, Stored, TABLE};
use crate::sink::{SentFrame, Sink, SinkError, SinkSummary, atomic::temporary_beside, crc32::pixel_crc32, line::Tally};
use base::file_lock;
use bytemuck::{Pod, Zeroable};
use core::mem::offset_of;
#[cfg(feature = "iceoryx2")]
use iceoryx2::prelude::ZeroCopySend;
use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::fs::{FileExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

/// First bytes of the file.
pub const MAGIC: [u8; 16] = *b"STARLOOP-FRAMES\0";
/// Version of the layout.
pub const VERSION: u32 = 1;
/// Slots begin at multiples of this: a line of a processor's cache.
const ALIGNED_BYTES: u64 = 64;
const FILE_HEAD_BYTES: u64 = size_of::<FileHead>() as u64;
const SLOT_HEAD_BYTES: u64 = size_of::<SlotHead>() as u64;

/// Bytes that are written at a time when the ring is made.
const FILLED_BYTES: usize = 64 * 1024;

/// Returns the size of a ring of `slots` frames of `size_px` (columns, rows), bytes.
pub fn ring_bytes(size_px: [usize; 2], slots: u32) -> u64 {
    FILE_HEAD_BYTES + u64::from(slots.max(1)) * slot_bytes(size_px)
}

/// Returns the number of bytes from one slot to the next.
fn slot_bytes([width, height]: [usize; 2]) -> u64 {
    (SLOT_HEAD_BYTES + 2 * (width * height) as u64).next_multiple_of(ALIGNED_BYTES)
}

/// The first 64 bytes.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
pub struct FileHead {
    /// [`MAGIC`].
    pub magic: [u8; 16],
    /// [`VERSION`].
    pub version: u32,
    /// Capacity, frames.
    pub slots: u32,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// From one slot to the next.
    pub slot_bytes: u64,
    /// Frames written so far.
    pub published: u64,
    /// 0: more will come; 1: the run is over.
    pub is_over: u32,
    /// Reserved, zero.
    pub reserved: [u32; 3],
}

/// The 256 bytes before the pixels of a frame, here and in `iceoryx`, by name for readers; [`crate::sink::facts`] has
/// the place of each fact.
#[cfg_attr(feature = "iceoryx2", derive(ZeroCopySend))]
#[cfg_attr(feature = "iceoryx2", type_name("StarloopFrameHead"))]
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
pub struct SlotHead {
    /// Number of the frame in this file, from 1; 0 while the slot is written.
    pub serial: u64,
    /// Mid-exposure, TAI since 1970-01-01T00:00:00 TAI, ns.
    pub mid_exposure_tai_ns: i64,
    /// Completion minus deadline, ns.
    pub lateness_ns: i64,
    /// Newest attitude to mid-exposure, ns.
    pub horizon_ns: i64,
    /// Frame number in the run.
    pub frame: u32,
    /// CRC-32 of the pixels.
    pub pixel_crc32: u32,
    /// Active faults, as in `FAULTBIT` of FITS files.
    pub faults: u32,
    /// Stars in the truth table.
    pub stars: u32,
    /// Integration time, s.
    pub exposure_s: f64,
    /// `sensor_from_icrf` at mid-exposure, scalar first.
    pub attitude_wxyz: [f64; 4],
    /// Boresight and image up (right ascension, declination, roll), deg.
    pub ra_dec_roll_deg: [f64; 3],
    /// Angular rate in sensor axes, deg/s.
    pub rate_deg_s: [f64; 3],
    /// Detector gain, e-/DN.
    pub gain_e_per_dn: f64,
    /// Black level, DN.
    pub black_level_dn: f64,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Seed of the exposure's noise, with the frame number.
    pub noise_seed: u64,
    /// Part of the exposure without jitter samples, ns.
    pub jitter_missing_ns: i64,
    /// Reserved, zero.
    pub reserved: [u64; 10],
}

/// The writing end. The file is removed when it goes, if it still bears the name.
#[derive(Debug)]
pub struct SharedMemory {
    path: PathBuf,
    file: File,
    head: FileHead,
    bytes: u64,
    /// Another program has cut the file short.
    is_cut: bool,
    tally: Tally,
}

impl SharedMemory {
    /// Makes the file, all of it, for `slots` frames of `size_px` (columns, rows). What a run before has left is
    /// replaced: readers of the old file keep it.
    ///
    /// # Errors
    /// [`SinkError::Write`] when it cannot be made, or the memory is not there; [`SinkError::NotShared`] when something
    /// else has the name, [`SinkError::InUse`] when another run has it.
    pub fn create(path: PathBuf, size_px: [usize; 2], slots: u32) -> Result<Self, SinkError> {
        let failed = |source: io::Error| SinkError::Write { path: path.clone(), source };
        remove_left(&path)?;
        let side = |px: usize| u32::try_from(px).map_err(|_| failed(io::ErrorKind::FileTooLarge.into()));
        let head = FileHead {
            magic: MAGIC,
            version: VERSION,
            slots: slots.max(1),
            width_px: side(size_px[0])?,
            height_px: side(size_px[1])?,
            slot_bytes: slot_bytes(size_px),
            ..FileHead::zeroed()
        };
        let temporary = temporary_beside(&path).map_err(failed)?;
        let file = OpenOptions::new().read(true).write(true).open(temporary.path()).map_err(failed)?;
        if !file_lock::take(&file, LOCKED_BYTE, 1).map_err(failed)? {
            return Err(SinkError::InUse { path });
        }
        let made = Self { path: path.clone(), file, head, bytes: 0, is_cut: false, tally: Tally::default() };
        made.fill().map_err(failed)?;
        // The call fails if the name exists, so no other file loses its name.
        temporary.persist_noclobber(&path).map_err(|refused| {
            let is_taken = refused.error.kind() == io::ErrorKind::AlreadyExists;
            if is_taken { SinkError::InUse { path: path.clone() } } else { failed(refused.error) }
        })?;
        Ok(made)
    }

    /// Writes every page, so that a machine without the memory says so now.
    fn fill(&self) -> io::Result<()> {
        let empty = [0; FILLED_BYTES];
        let mut at = FILE_HEAD_BYTES;
        let end = self.end();
        while at < end {
            let part = usize::try_from(end - at).unwrap_or(FILLED_BYTES).min(FILLED_BYTES);
            self.file.write_all_at(&empty[..part], at)?;
            at += part as u64;
        }
        self.file.write_all_at(bytemuck::bytes_of(&self.head), 0)
    }

    /// Returns the length of the file, bytes.
    fn end(&self) -> u64 {
        FILE_HEAD_BYTES + u64::from(self.head.slots) * self.head.slot_bytes
    }

    /// Refuses a file that another program has cut short, now or earlier: later frames make it long again, with holes.
    fn check_length(&mut self) -> io::Result<()> {
        let wanted = self.end();
        let got = self.file.metadata()?.len();
        self.is_cut |= got < wanted;
        if self.is_cut {
            return Err(io::Error::other(format!(
                "another program has cut it short while the run wrote to it (got {got} bytes, wanted {wanted} all the \
                 time): start the run again, and keep other programs from writing to the file"
            )));
        }
        Ok(())
    }

    fn publish(&mut self, frame: &SentFrame) -> io::Result<()> {
        self.check_length()?;
        let serial = self.head.published + 1;
        let slot = FILE_HEAD_BYTES + (self.head.published % u64::from(self.head.slots)) * self.head.slot_bytes;
        self.file.write_all_at(bytemuck::bytes_of(&SlotHead { serial: 0, ..slot_head(frame) }), slot)?;
        self.file.write_all_at(bytemuck::cast_slice(frame.image.pixels()), slot + SLOT_HEAD_BYTES)?;
        self.file.write_all_at(&serial.to_ne_bytes(), slot)?;
        self.file.write_all_at(&serial.to_ne_bytes(), offset_of!(FileHead, published) as u64)?;
        self.head.published = serial;
        Ok(())
    }
}

/// Removes the file of a run that was killed; refuses everything else that has the name.
fn remove_left(path: &Path) -> Result<(), SinkError> {
    let failed = |source: io::Error| SinkError::Write { path: path.into(), source };
    match fs::symlink_metadata(path) {
        Err(_nothing_has_the_name) => return Ok(()),
        Ok(found) if !found.is_file() => return Err(SinkError::NotShared { path: path.into() }),
        Ok(_) => (),
    }
    // A pipe that has come since would be waited for.
    let flags = rustix::fs::OFlags::NONBLOCK | rustix::fs::OFlags::NOFOLLOW;
    let flags = i32::try_from(flags.bits()).unwrap_or_default();
    let left = OpenOptions::new().read(true).write(true).custom_flags(flags).open(path).map_err(failed)?;
    let mut magic = [0; 16];
    if left.read_exact_at(&mut magic, 0).is_err() || magic != MAGIC {
        return Err(SinkError::NotShared { path: path.into() });
    }
    // A writer that lives holds its lock; one that was quicker than we are has another file there by now.
    if !file_lock::take(&left, LOCKED_BYTE, 1).map_err(failed)? || !has_name(&left, path) {
        return Err(SinkError::InUse { path: path.into() });
    }
    fs::remove_file(path).map_err(failed)
}

/// The byte that the writer of a ring locks: behind every ring's end.
const LOCKED_BYTE: i64 = 1 << 62;

/// Returns true if the open file is the one with the name.
fn has_name(file: &File, path: &Path) -> bool {
    let identity = |found: fs::Metadata| (found.dev(), found.ino());
    match (file.metadata(), fs::symlink_metadata(path)) {
        (Ok(open), Ok(named)) => identity(open) == identity(named),
        _ => false,
    }
}

/// Returns the numbers of a frame, each at its place of [`crate::sink::facts`]; without its `serial`.
pub(super) fn slot_head(frame: &SentFrame) -> SlotHead {
    let source = FactSource::of_frame(frame, Some(pixel_crc32(&frame.image)));
    let mut head = SlotHead::zeroed();
    for row in TABLE {
        let Some(Place(first_byte, stored, form)) = row.memory else { continue };
        let fact = (row.value)(&source);
        for element in 0..fact.elements() {
            let at = first_byte + element * stored.bytes();
            store(&mut bytemuck::bytes_of_mut(&mut head)[at..], stored, &fact.element(element, form));
        }
    }
    head
}

/// Writes an element in the byte order of the machine; a number that is too large becomes the largest number.
fn store(to: &mut [u8], stored: Stored, element: &Scalar<'_>) {
    let whole = element.whole();
    match stored {
        Stored::U32 => put(to, u32::try_from(whole).unwrap_or(u32::MAX).to_ne_bytes()),
        Stored::U64 => put(to, u64::try_from(whole).unwrap_or(u64::MAX).to_ne_bytes()),
        Stored::I64 => put(to, i64::try_from(whole).unwrap_or(i64::MAX).to_ne_bytes()),
        Stored::F64 => put(to, element.real().to_ne_bytes()),
    }
}

fn put<const N: usize>(to: &mut [u8], bytes: [u8; N]) {
    to[..N].copy_from_slice(&bytes);
}

impl Sink for SharedMemory {
    fn name(&self) -> &'static str {
        "shared_memory"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        self.tally.check(self.name(), frame)?;
        let wanted = [self.head.width_px as usize, self.head.height_px as usize];
        let got = [frame.image.width(), frame.image.height()];
        if got != wanted {
            self.tally.refuse();
            return Err(SinkError::FrameSize { path: self.path.clone(), wanted, got });
        }
        if let Err(source) = self.publish(frame) {
            self.tally.refuse();
            return Err(SinkError::Write { path: self.path.clone(), source });
        }
        // Published all the same: readers that have the ring open still read it.
        if !has_name(&self.file, &self.path) {
            self.tally.refuse();
            return Err(SinkError::Vanished { path: self.path.clone() });
        }
        self.bytes += SLOT_HEAD_BYTES + 2 * frame.image.pixels().len() as u64;
        self.tally.take(self.name(), frame)
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        self.head.is_over = 1;
        let is_whole = self.check_length();
        is_whole.map_err(|source| SinkError::Write { path: self.path.clone(), source })?;
        let reported = self.file.write_all_at(&1_u32.to_ne_bytes(), offset_of!(FileHead, is_over) as u64);
        reported.map_err(|source| SinkError::Write { path: self.path.clone(), source })?;
        let summary = self.tally.finish(self.name());
        if !has_name(&self.file, &self.path) {
            return Err(SinkError::Vanished { path: self.path.clone() });
        }
        Ok(SinkSummary { bytes: self.bytes, output: Some(self.path.clone()), ..summary })
    }
}

impl Drop for SharedMemory {
    fn drop(&mut self) {
        if has_name(&self.file, &self.path) {
            let _ = fs::remove_file(&self.path); // readers keep their mapping
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sink::{compliance::check_sink, sample::sample_frame};

    /// Returns the frame `n` (from 1) as a reader finds it; `None` when it is not there (any more).
    fn read(file: &File, n: u64) -> Option<(SlotHead, Vec<u16>)> {
        let mut head = FileHead::zeroed();
        file.read_exact_at(bytemuck::bytes_of_mut(&mut head), 0).unwrap();
        let at = 64 + (n - 1) % u64::from(head.slots) * head.slot_bytes;
        let mut slot = SlotHead::zeroed();
        file.read_exact_at(bytemuck::bytes_of_mut(&mut slot), at).unwrap();
        let mut pixels = vec![0_u16; (head.width_px * head.height_px) as usize];
        file.read_exact_at(bytemuck::cast_slice_mut(&mut pixels), at + 256).unwrap();
        (slot.serial == n).then_some((slot, pixels))
    }

    #[test]
    fn heads_have_the_documented_sizes() {
        assert_eq!((size_of::<FileHead>(), size_of::<SlotHead>()), (64, 256));
        assert_eq!((offset_of!(FileHead, published), offset_of!(FileHead, is_over)), (40, 48));
    }

    #[test]
    fn shared_memory_complies() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("frames");
        check_sink(|| Box::new(SharedMemory::create(path.clone(), [31, 17], 2).unwrap())).unwrap();
    }

    #[test]
    fn the_newest_frames_are_there_and_the_oldest_are_overwritten() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("frames");
        let mut sink = SharedMemory::create(path.clone(), [31, 17], 3).unwrap();
        let file = File::open(&path).unwrap();
        let length = file.metadata().unwrap().len();
        assert_eq!(length, ring_bytes([31, 17], 3), "as added up before the start");
        for n in 1..=8_u32 {
            sink.send(&sample_frame(100 + n)).unwrap();
            let (slot, pixels) = read(&file, n.into()).expect("the newest");
            let sent = sample_frame(100 + n);
            assert_eq!(pixels, sent.image.pixels());
            assert_eq!((slot.frame, slot.pixel_crc32, slot.stars), (100 + n, pixel_crc32(&sent.image), 2));
            assert_eq!((slot.attitude_wxyz, slot.rate_deg_s), (sent.meta.attitude_wxyz, sent.meta.rate_deg_s));
        }
        assert!(read(&file, 6).is_some() && read(&file, 5).is_none(), "three slots");
        assert_eq!(file.metadata().unwrap().len(), length, "of fixed size");
        assert_eq!(sink.finish().unwrap().frames, 8);
        drop(sink);
        assert!(!path.exists() && read(&file, 8).is_some(), "a reader keeps what it has open");
    }

    #[test]
    fn ring_of_a_killed_run_is_replaced_and_other_files_are_not() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("frames");
        let living = SharedMemory::create(path.clone(), [4, 4], 1).unwrap();
        let error = SharedMemory::create(path.clone(), [31, 17], 1).unwrap_err();
        assert!(matches!(error, SinkError::InUse { .. }), "{error}");
        let left = fs::read(&path).unwrap();
        drop(living);
        fs::write(&path, left).unwrap();
        drop(SharedMemory::create(path.clone(), [31, 17], 1).unwrap());
        fs::write(&path, "a letter to somebody").unwrap();
        let error = SharedMemory::create(path.clone(), [31, 17], 1).unwrap_err();
        assert!(matches!(error, SinkError::NotShared { .. }), "{error}");
        assert_eq!(fs::read(&path).unwrap(), b"a letter to somebody");
    }

    #[test]
    fn newer_ring_with_the_name_is_not_removed() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("frames");
        let first = SharedMemory::create(path.clone(), [4, 4], 1).unwrap();
        fs::remove_file(&path).unwrap();
        let second = SharedMemory::create(path.clone(), [31, 17], 1).unwrap();
        drop(first);
        assert!(has_name(&second.file, &path), "another run's");
        drop(second);
        assert!(fs::read_dir(directory.path()).unwrap().next().is_none(), "and nothing is left of either");
    }

    #[test]
    fn ring_that_was_cut_short_costs_every_frame_from_then_on() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("frames");
        let mut sink = SharedMemory::create(path.clone(), [31, 17], 2).unwrap();
        sink.send(&sample_frame(1)).unwrap();
        let length = fs::metadata(&path).unwrap().len();
        let other = OpenOptions::new().write(true).open(&path).unwrap();
        other.set_len(100).unwrap();
        let error = sink.send(&sample_frame(2)).unwrap_err().to_string();
        assert!(error.contains("cut it short"), "{error}");
        // As long as before, and full of holes.
        other.set_len(length).unwrap();
        assert!(sink.send(&sample_frame(3)).is_err());
        assert!(matches!(sink.finish(), Err(SinkError::Write { .. })), "and the end says so");
        assert_eq!(sink.tally.finish("shared_memory").refused, 2);
    }

    #[test]
    fn ring_that_was_removed_or_replaced_costs_every_frame_from_then_on() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("frames");
        for is_replaced in [false, true] {
            let mut sink = SharedMemory::create(path.clone(), [31, 17], 2).unwrap();
            let reader = File::open(&path).unwrap();
            sink.send(&sample_frame(1)).unwrap();
            fs::remove_file(&path).unwrap();
            if is_replaced {
                fs::write(&path, "another program's").unwrap();
            }
            for number in [2, 3] {
                let error = sink.send(&sample_frame(number)).unwrap_err();
                assert!(matches!(error, SinkError::Vanished { .. }), "{error}");
            }
            assert!(read(&reader, 3).is_some(), "a reader that has it open still gets frames");
            assert!(matches!(sink.finish(), Err(SinkError::Vanished { .. })), "and the end says so");
            assert_eq!(sink.tally.finish("shared_memory").refused, 2);
            drop(sink);
            assert_eq!(path.exists(), is_replaced, "what another program made stays");
            let _ = fs::remove_file(&path);
        }
    }

    #[test]
    fn reader_that_locks_the_ring_of_a_dead_run_does_not_keep_the_next_run_out() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("frames");
        let living = SharedMemory::create(path.clone(), [4, 4], 1).unwrap();
        let left = fs::read(&path).unwrap();
        let reader = File::open(&path).unwrap();
        reader.lock_shared().unwrap();
        let error = SharedMemory::create(path.clone(), [4, 4], 1).unwrap_err();
        assert!(matches!(error, SinkError::InUse { .. }), "control: a live run's ring is refused: {error}");
        drop(living);
        fs::write(&path, left).unwrap();
        let reader = File::open(&path).unwrap();
        reader.lock_shared().unwrap();
        drop(SharedMemory::create(path.clone(), [31, 17], 1).unwrap());
    }

    #[test]
    fn of_many_runs_that_want_the_name_of_a_killed_one_one_gets_it() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("frames");
        let killed = SharedMemory::create(path.clone(), [4, 4], 1).unwrap();
        let left = fs::read(&path).unwrap();
        drop(killed);
        for _ in 0..50 {
            fs::write(&path, &left).unwrap();
            let made: Vec<_> = std::thread::scope(|scope| {
                let threads: Vec<_> =
                    (0..4).map(|_| scope.spawn(|| SharedMemory::create(path.clone(), [4, 4], 1))).collect();
                threads.into_iter().map(|thread| thread.join().unwrap()).collect()
            });
            let living: Vec<_> = made.iter().flatten().collect();
            assert_eq!(living.len(), 1);
            assert!(has_name(&living[0].file, &path), "the ring that got the name has it");
        }
    }

    #[test]
    fn pipe_link_and_directory_are_refused_without_a_wait() {
        let directory = tempfile::tempdir().unwrap();
        let names = ["pipe", "link", "directory"].map(|name| directory.path().join(name));
        rustix::fs::mkfifoat(rustix::fs::CWD, &names[0], rustix::fs::Mode::RWXU).unwrap();
        let ring = SharedMemory::create(directory.path().join("ring"), [4, 4], 1).unwrap();
        std::os::unix::fs::symlink(&ring.path, &names[1]).unwrap();
        fs::create_dir(&names[2]).unwrap();
        for name in names {
            let error = SharedMemory::create(name.clone(), [4, 4], 1).unwrap_err();
            assert!(matches!(error, SinkError::NotShared { .. }), "{error}");
            assert!(fs::symlink_metadata(&name).is_ok(), "{} stays", name.display());
        }
    }

    #[test]
    fn another_size_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let mut sink = SharedMemory::create(directory.path().join("frames"), [30, 17], 1).unwrap();
        assert!(matches!(sink.send(&sample_frame(1)), Err(SinkError::FrameSize { .. })));
        assert_eq!(sink.finish().unwrap().refused, 1);
    }
}
