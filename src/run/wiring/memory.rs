//! The memory of a run, a single image or several closed loops, added up before any of it is taken.
//!
//! Input: a checked bench, its sinks and how it runs, or a camera. Output: a list of parts in bytes ([`RunMemory`]),
//! and a refusal with the sum and the biggest parts when it does not fit ([`RunMemory::check`]). A program that runs
//! out of memory is ended by an abort in mid-allocation or by the kernel in mid-run; a sum that does not fit is an
//! error in words at once.
//!
//! Counted: images and maps of the detector, frames on their way, queues and kept frames of every sink, the ring in
//! shared memory, pictures of the live view, stars of layers, a fixed share for everything whose size does not depend
//! on the camera. Estimates err upwards. Limits: memory of a graphics card and its driver is not counted. Tests: below,
//! `hil_scripts/tests/test_files.py` (limits set from outside).

use crate::runtime::{delivery, real_time::STARS_AT_FIRST, tracker_out::FRAMES_WAITING};
use base::memory::{Available, available, available_in_process};
use config::{Backend, Bench, Camera, Sink, SinkMemory, SinkSettings, TrackerSource};
use core::fmt;
use frames::sink::{TargetRow, TruthStar};

/// Memory that does not depend on the camera: the program, catalog, tables, threads and their stacks.
const FIXED_BYTES: u64 = 128 << 20;
/// Address space that the thread of a sink takes: its stack, and what glibc's allocator reserves for a thread.
const THREAD_BYTES: u64 = 68 << 20;
/// Bytes of one number of the detector's images and maps.
const CHARGE_BYTES: u64 = 4;
/// Bytes of a pixel of a frame.
const DN_BYTES: u64 = 2;
/// Frames besides those in queues on the real clock: the current one, the previous one, two prototypes for buffers.
const FRAMES_AT_HAND: u64 = 4;
/// Frames that are under way on the virtual clock.
const FRAMES_UNDER_WAY: u64 = 4;
/// Pictures of the live view that are exchanged, and one that becomes a PNG.
const LIVE_PICTURES: u64 = 4;
/// Closed loops that one thread may have in progress: while it waits for a part of one it may start another.
const LOOPS_PER_THREAD: usize = 2;
/// Number of parts that a refusal names.
const NAMED_PARTS: usize = 4;

/// Form in which a bench is run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunForm {
    /// True on the bench clock, where every sink has a queue.
    pub is_real: bool,
    /// True with the live view.
    pub has_view: bool,
}

/// One part of the sum.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MemoryPart {
    /// Name of the part, with the keys that determine its size.
    pub name: String,
    /// Bytes.
    pub bytes: u64,
    /// False for a file in memory, which is outside the process's address space.
    pub is_in_process: bool,
}

/// The parts of a run's memory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunMemory {
    parts: Vec<MemoryPart>,
}

/// A run that does not fit into memory.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "this run needs {} of memory, and {} are free {}: {biggest}; wanted a run that fits: try a smaller camera, or fewer \
     frames in the largest of these",
    size(*.needed), size(.available.bytes), .available.limit
)]
pub struct MemoryError {
    /// The sum, bytes.
    pub needed: u64,
    /// Available memory.
    pub available: Available,
    /// The biggest parts, in words.
    pub biggest: String,
}

impl RunMemory {
    /// Adds up a bench with these sinks. Every head counts as one with the largest camera of them.
    pub fn of(bench: &Bench, sinks: &[SinkSettings], form: RunForm) -> Self {
        let own_pixels = |head: &Bench| pixels([head.camera.detector.width_px, head.camera.detector.height_px]);
        let largest = (0..bench.head_count()).map(|number| bench.of_head(number)).max_by_key(own_pixels);
        let mut memory = Self::of_heads(largest.as_ref().unwrap_or(bench), bench.head_count(), sinks, form);
        let on_pixels = bench.tracker_outs.iter().filter(|out| matches!(out.source, TrackerSource::Pixels { .. }));
        let frames: u64 = on_pixels.map(|out| FRAMES_WAITING as u64 * frame_bytes(&bench.of_head(out.head))).sum();
        if frames > 0 {
            memory.add("frames for star trackers (tracker_out)", frames);
        }
        memory
    }

    /// Adds up a bench with this many camera heads, as scenarios have.
    pub fn of_heads(bench: &Bench, heads: usize, sinks: &[SinkSettings], form: RunForm) -> Self {
        let heads = heads.max(1) as u64;
        let mut memory = Self::of_program();
        let [width, height] = [bench.camera.detector.width_px, bench.camera.detector.height_px];
        let is_reference = bench.render.backend == Backend::Reference;
        let images = heads * detector_bytes(&bench.camera, is_reference);
        memory.add(&format!("images and maps of the detector ({width} x {height} px, heads: {heads})"), images);
        let frame = frame_bytes(bench);
        let under_way = if form.is_real { delivery::BUFFERS as u64 + FRAMES_AT_HAND } else { FRAMES_UNDER_WAY };
        memory.add("frames between drawing and sinks", heads * under_way * frame);
        for (number, settings) in sinks.iter().enumerate() {
            let place = number.checked_sub(1).map_or_else(|| "sink".into(), |extra| format!("extra_sink[{extra}]"));
            memory.add_sink(&place, settings, heads, frame, bench, (form, sinks.len()));
        }
        if form.has_view {
            memory.add("pictures of the live view (--monitor)", heads * LIVE_PICTURES * frame);
        }
        if !bench.layers.is_empty() {
            let stars = u64::from(bench.star_memory_mb) << 20;
            memory.add(&format!("stars of layers (sky.memory_mb = {})", bench.star_memory_mb), heads * stars);
        }
        memory
    }

    /// Adds up one image of a camera, as `starloop render` draws it, from layers of stars or the built-in catalog.
    pub fn of_image(camera: &Camera, is_reference: bool, layers_mb: Option<u32>) -> Self {
        let mut memory = Self::of_program();
        let [width, height] = [camera.detector.width_px, camera.detector.height_px];
        let images = detector_bytes(camera, is_reference);
        memory.add(&format!("images and maps of the detector ({width} x {height} px)"), images);
        memory.add("the frame", DN_BYTES * pixels(camera.image_px()));
        // An image of electrons is converted to a picture through a copy.
        memory.add("the picture on its way to a file", CHARGE_BYTES * pixels([width, height]));
        if let Some(mb) = layers_mb {
            memory.add(&format!("stars of layers (at most {mb} MiB)"), u64::from(mb) << 20);
        }
        memory
    }

    /// Adds up cameras that draw single images side by side, `cameras` of them.
    pub fn of_images(camera: &Camera, cameras: usize) -> Self {
        Self::of_image(camera, false, None).side_by_side(cameras, &format!(", for {cameras} workers"))
    }

    /// Adds up closed loops that are flown side by side on `threads` threads, at most `loops` of them, with no sinks.
    pub fn of_loops(bench: &Bench, heads: usize, loops: usize, threads: usize) -> Self {
        let one = Self::of_heads(bench, heads, &[], RunForm { is_real: false, has_view: false });
        let side_by_side = loops.min(threads.saturating_mul(LOOPS_PER_THREAD)).max(1);
        let what = format!(", for {side_by_side} closed loops (RAYON_NUM_THREADS = {threads})");
        one.side_by_side(side_by_side, &what)
    }

    fn of_program() -> Self {
        let mut memory = Self { parts: Vec::new() };
        memory.add("program, tables and threads", FIXED_BYTES);
        memory
    }

    /// Returns the memory of so many side by side in one program, which `what` says in the name of each part.
    fn side_by_side(mut self, count: usize, what: &str) -> Self {
        for part in self.parts.iter_mut().skip(1) {
            part.name.push_str(what);
            part.bytes = part.bytes.saturating_mul(count as u64);
        }
        self
    }

    fn add(&mut self, name: &str, bytes: u64) {
        self.parts.push(MemoryPart { name: name.into(), bytes, is_in_process: true });
    }

    fn add_sink(
        &mut self,
        place: &str,
        settings: &SinkSettings,
        heads: u64,
        frame: u64,
        bench: &Bench,
        (form, sinks): (RunForm, usize),
    ) {
        let has_thread = settings.sink != Sink::Null || sinks > 1;
        let queue = match form.is_real {
            _ if !has_thread => 0,
            true => u64::from(settings.queue_frames),
            false => 1,
        };
        if has_thread {
            self.add(&format!("the thread of {place}"), heads * THREAD_BYTES);
        }
        self.add(
            &format!("frames that wait for {place} ({place}.queue = {})", settings.queue_frames),
            heads * queue * frame,
        );
        for SinkMemory { what, by, bytes, is_in_process } in settings.sink.memory(bench.camera.image_px(), frame) {
            let key = by.map_or_else(|| place.into(), |(key, value)| format!("{place}.{key} = {value}"));
            let part = MemoryPart { name: format!("{what} ({key})"), bytes: heads * bytes, is_in_process };
            self.parts.push(part);
        }
    }

    /// Returns the sum, bytes.
    pub fn total(&self) -> u64 {
        sum(self.parts.iter())
    }

    /// Returns the sum and its biggest parts in words.
    pub fn in_words(&self) -> String {
        format!("{}: {}", size(self.total()), self.biggest())
    }

    /// Refuses a run that does not fit into what the machine, its control group and the process's limits leave.
    ///
    /// # Errors
    /// [`MemoryError`] with the sum and the biggest parts.
    pub fn check(&self) -> Result<(), MemoryError> {
        self.check_against(available(), available_in_process())
    }

    fn check_against(&self, machine: Option<Available>, process: Option<Available>) -> Result<(), MemoryError> {
        let in_process = sum(self.parts.iter().filter(|part| part.is_in_process));
        for (needed, available) in [(in_process, process), (self.total(), machine)] {
            if let Some(available) = available.filter(|available| available.bytes < needed) {
                return Err(MemoryError { needed, available, biggest: self.biggest() });
            }
        }
        Ok(())
    }

    fn biggest(&self) -> String {
        let mut parts: Vec<&MemoryPart> = self.parts.iter().collect();
        parts.sort_by_key(|part| core::cmp::Reverse(part.bytes));
        let named = parts.iter().take(NAMED_PARTS).map(|part| format!("{} {}", part.name, size(part.bytes)));
        named.collect::<Vec<_>>().join(", ")
    }
}

fn sum<'a>(parts: impl Iterator<Item = &'a MemoryPart>) -> u64 {
    parts.map(|part| part.bytes).fold(0, u64::saturating_add)
}

fn pixels(size_px: [u32; 2]) -> u64 {
    let [width, height] = size_px.map(u64::from);
    width * height
}

/// Returns the bytes of the images and maps of one head's detector.
fn detector_bytes(camera: &Camera, is_reference: bool) -> u64 {
    let side_px = [camera.detector.width_px, camera.detector.height_px];
    detector_numbers(camera, is_reference) * CHARGE_BYTES * pixels(side_px)
}

/// Returns the values per sensor pixel and head: the drawn image, maps, and the images of stages with neighbours.
fn detector_numbers(camera: &Camera, is_reference: bool) -> u64 {
    let detector = &camera.detector;
    let drawn = if is_reference { 2 } else { 1 };
    let maps = detector.maps.kept(&detector.params) + usize::from(!camera.illumination.is_even());
    // A map is drawn in one buffer and kept in another.
    let drawing = usize::from(maps > 0);
    (drawn + maps + drawing + detector.params.spatial.images_kept()) as u64
}

/// Returns the bytes of a frame with its truth table.
fn frame_bytes(bench: &Bench) -> u64 {
    let truth = (STARS_AT_FIRST * size_of::<TruthStar>() + bench.targets.len() * size_of::<TargetRow>()) as u64;
    DN_BYTES * pixels(bench.camera.image_px()) + truth
}

/// Returns a number of bytes in readable form.
fn size(bytes: u64) -> impl fmt::Display {
    let mib = bytes as f64 / f64::from(1 << 20);
    if mib < 1024.0 { format!("{mib:.0} MiB") } else { format!("{:.1} GiB", mib / 1024.0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::memory::MemoryLimit;
    use config::Document;
    use std::path::Path;

    const GIB: u64 = 1 << 30;
    const REAL: RunForm = RunForm { is_real: true, has_view: false };

    /// Returns the built-in camera with another number of pixels, and these sinks.
    fn bench(side_px: u32, sinks: &str) -> Bench {
        let mut bench = Bench::from_document(&Document::from_text(sinks, Path::new("b.toml"))).unwrap();
        bench.camera.detector.width_px = side_px;
        bench.camera.detector.height_px = side_px;
        bench
    }

    fn memory(side_px: u32, sinks: &str, form: RunForm) -> RunMemory {
        let bench = bench(side_px, sinks);
        RunMemory::of(&bench, &bench.sinks, form)
    }

    fn here(bytes: u64) -> Option<Available> {
        Some(Available { bytes, limit: MemoryLimit::Machine })
    }

    #[test]
    fn kept_and_queued_frames_of_a_large_camera_are_refused_with_the_sum_and_the_biggest_part() {
        let sinks = "[sink]\nkind = \"network_camera\"\nport = 0\nframes_kept = 64\nframes_queued = 16\n";
        let memory = memory(16_384, sinks, REAL);
        assert!(
            (48 * GIB..56 * GIB).contains(&memory.total()),
            "64 + 16 + 8 + 8 frames of 0.5 GiB, and the detector's images: {}",
            memory.total()
        );
        let error = memory.check_against(here(8 * GIB), None).unwrap_err();
        let text = error.to_string();
        assert!(text.contains("8.0 GiB are free on this machine"), "{text}");
        let biggest = "frames kept for clients (sink.frames_kept = 64) 32.1 GiB, ";
        assert!(text.contains(&format!("(MemAvailable): {biggest}")), "the biggest part first: {text}");
        memory.check_against(here(64 * GIB), None).expect("control: it fits here");
    }

    #[test]
    fn every_queue_head_and_ring_is_in_the_sum() {
        let grown = |change: &dyn Fn(&mut Bench)| {
            let mut bench = bench(1024, "[sink]\nkind = \"recorder\"\n");
            change(&mut bench);
            RunMemory::of(&bench, &bench.sinks, REAL).total()
        };
        let plain = grown(&|_| {});
        let frame = 2 * 1024 * 1024;
        assert!(grown(&|bench| bench.sinks[0].queue_frames += 100) >= plain + 100 * frame);
        assert!(grown(&|bench| bench.extra_heads.push(bench.first_head())) >= plain + 16 * frame);
        let larger = |bench: &mut Bench| {
            let mut head = bench.first_head();
            (head.camera.detector.width_px, head.camera.detector.height_px) = (2048, 2048);
            bench.extra_heads.push(head);
        };
        assert!(grown(&larger) >= plain + 16 * 4 * frame, "a head with a larger camera of its own");
        assert!(grown(&|bench| bench.camera.detector.params.prnu += 0.01) >= plain);
        let ring = Sink::SharedMemory { path: "/dev/shm/x".into(), slots: 64 };
        let ring = SinkSettings { sink: ring, queue_frames: 1 };
        assert!(grown(&|bench| bench.sinks.push(ring.clone())) >= plain + 65 * frame);
        let out = "[[tracker_out]]\nlink = \"udp\"\nsend_to = 1\n";
        let outs = [out.to_owned(), format!("{out}source = \"model\"\n")].map(|keys| memory(1024, &keys, REAL).total());
        assert!(outs[0] >= outs[1] + 4 * frame, "a tracker on pixels has frames that wait");
        let layers = |bench: &mut Bench| (bench.layers, bench.star_memory_mb) = (vec!["a".into()], 3000);
        assert!(grown(&layers) >= plain + (3000 << 20));
        let bench = bench(1024, "");
        let of = |form| RunMemory::of(&bench, &bench.sinks, form).total();
        assert!(of(RunForm { has_view: true, ..REAL }) > of(REAL));
        assert!(of(REAL) > of(RunForm { is_real: false, has_view: false }), "queues are for the real clock");
    }

    #[test]
    fn image_of_a_large_camera_is_refused_with_the_sum() {
        let camera = bench(32_768, "").camera;
        let memory = RunMemory::of_image(&camera, false, None);
        assert!(
            (22 * GIB..23 * GIB).contains(&memory.total()),
            "4 images of 4 bytes a pixel, 2, 4: {}",
            memory.in_words()
        );
        let text = memory.check_against(here(8 * GIB), None).unwrap_err().to_string();
        assert!(text.contains("images and maps of the detector (32768 x 32768 px) 16.0 GiB"), "{text}");
        memory.check_against(here(24 * GIB), None).expect("control: it fits here");
        assert!(RunMemory::of_image(&camera, true, None).total() >= memory.total() + 4 * GIB, "f64 of the reference");
        assert_eq!(RunMemory::of_image(&camera, false, Some(512)).total(), memory.total() + GIB / 2);
        let three = RunMemory::of_images(&camera, 3);
        assert_eq!(three.total() - FIXED_BYTES, 3 * (memory.total() - FIXED_BYTES));
        assert!(three.in_words().contains("for 3 workers"));
    }

    #[test]
    fn closed_loops_side_by_side_are_added_up_as_far_as_threads_fly_them() {
        let bench = bench(8192, "");
        let of = |loops, threads| RunMemory::of_loops(&bench, 1, loops, threads).total() - FIXED_BYTES;
        assert_eq!(of(100, 2), 4 * of(1, 2), "two threads, two loops each");
        assert_eq!(of(3, 8), 3 * of(1, 2), "no more than there are");
        let single = RunForm { is_real: false, has_view: false };
        assert_eq!(of(1, 1), RunMemory::of(&bench, &[], single).total() - FIXED_BYTES);
        let text = RunMemory::of_loops(&bench, 1, 9, 4).check_against(here(GIB), None).unwrap_err().to_string();
        assert!(text.contains("for 8 closed loops (RAYON_NUM_THREADS = 4)"), "{text}");
    }

    #[test]
    fn ring_in_shared_memory_is_outside_the_address_space() {
        let memory = memory(4096, "[sink]\nkind = \"shared_memory\"\nslots = 64\n", REAL);
        let ring: u64 = memory.parts.iter().filter(|part| !part.is_in_process).map(|part| part.bytes).sum();
        assert!(ring >= 64 * 2 * 4096 * 4096);
        let limit = Available { bytes: memory.total() - ring, limit: MemoryLimit::AddressSpace };
        memory.check_against(None, Some(limit)).expect("it fits without the ring");
        memory.check_against(here(limit.bytes), None).expect_err("and does not with it");
        memory.check_against(None, None).expect("a system that does not say is not asked");
    }
}
