//! The facts of a frame in files and memory, byte by byte, as they were before there was one table of them.

use crate::sink::fits::{Pixels, write_electrons, write_frame};
use crate::sink::sample::{bare_sample_frame, compare_with_pinned, differs_from_pinned, hex_lines, sample_frame};
use crate::sink::{
    SentFrame, crc32::pixel_crc32, facts::FactSource, fits::card::CARD_BYTES, frame_log::FrameLog,
    shared_memory::slot_head,
};

/// Returns the cards of a FITS file, a line each; without the version and the checksum over it.
fn cards(bytes: &[u8]) -> String {
    let card = |card: &[u8]| String::from_utf8_lossy(card).trim_end().replace(env!("CARGO_PKG_VERSION"), "VERSION");
    let cards = bytes.chunks(CARD_BYTES).map(card);
    let cards = cards.take_while(|card| card != "END").filter(|card| !card.starts_with("CHECKSUM"));
    cards.map(|card| card + "\n").collect()
}

fn fits_of(frame: &SentFrame) -> String {
    let mut bytes = Vec::new();
    write_frame(&mut bytes, frame).unwrap();
    cards(&bytes)
}

#[test]
fn fits_headers_are_as_pinned() {
    compare_with_pinned("fits.txt", &fits_of(&sample_frame(7))).unwrap();
    compare_with_pinned("fits_bare.txt", &fits_of(&bare_sample_frame(8))).unwrap();
    let mut electrons = Vec::new();
    let pixels = [0.5; 6];
    write_electrons(&mut electrons, 3, 2, Pixels::F32(&pixels), &sample_frame(7).meta).unwrap();
    compare_with_pinned("fits_electrons.txt", &cards(&electrons)).unwrap();
    let mut other = sample_frame(7);
    other.meta.noise_seed += 1;
    assert!(differs_from_pinned("fits.txt", &fits_of(&other)), "control: one number is another");
}

fn csv_of(frames: &[SentFrame]) -> String {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("frames.csv");
    let mut log = FrameLog::create(path.clone()).unwrap();
    for frame in frames {
        log.append(&FactSource::of_frame(frame, Some(pixel_crc32(&frame.image)))).unwrap();
    }
    std::fs::read_to_string(path).unwrap()
}

#[test]
fn lines_of_the_frame_log_are_as_pinned() {
    compare_with_pinned("frames.csv", &csv_of(&[sample_frame(7), bare_sample_frame(8)])).unwrap();
    assert!(differs_from_pinned("frames.csv", &csv_of(&[sample_frame(7), sample_frame(8)])), "control");
}

#[cfg(target_endian = "little")]
#[test]
fn bytes_in_shared_memory_are_as_pinned() {
    let bytes = |frame: &SentFrame| hex_lines(bytemuck::bytes_of(&slot_head(frame)));
    compare_with_pinned("slot_head.txt", &bytes(&sample_frame(7))).unwrap();
    compare_with_pinned("slot_head_bare.txt", &bytes(&bare_sample_frame(8))).unwrap();
    assert!(differs_from_pinned("slot_head.txt", &bytes(&sample_frame(8))), "control: another frame");
}
