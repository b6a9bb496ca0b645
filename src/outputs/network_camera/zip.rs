//! One file -> a zip archive: what the URL of a camera's XML names. Deflated, no date, no attributes.
//!
//! The archive's length is a multiple of four, as memory is read in words; a comment of up to three spaces fills it up.
//! The layout is that of the zip application note; the test reads it back with an independent inflater's checksum.

use flate2::Compression;
use flate2::write::DeflateEncoder;
use std::io::{self, Write};

const LOCAL_HEADER: u32 = 0x0403_4B50;
const CENTRAL_HEADER: u32 = 0x0201_4B50;
const END: u32 = 0x0605_4B50;
const VERSION: u16 = 20;
const DEFLATED: u16 = 8;
/// 1980-01-01, the first day that the format knows.
const DATE: u16 = 0x0021;

/// An archive that holds one file.
pub(super) fn archive(name: &str, content: &[u8]) -> io::Result<Vec<u8>> {
    let mut deflated = DeflateEncoder::new(Vec::new(), Compression::best());
    deflated.write_all(content)?;
    let data = deflated.finish()?;
    let about = about(name, content, data.len());
    let mut out = Vec::new();
    out.extend(LOCAL_HEADER.to_le_bytes());
    out.extend(&about);
    out.extend(name.as_bytes());
    out.extend(&data);
    let central = out.len();
    out.extend(CENTRAL_HEADER.to_le_bytes());
    out.extend(VERSION.to_le_bytes());
    out.extend(&about);
    // Length of comment, disk, attributes inside and outside, place of the local header.
    out.extend([0; 14]);
    out.extend(name.as_bytes());
    let central_bytes = out.len() - central;
    let comment = (22 + out.len()).next_multiple_of(4) - (22 + out.len());
    out.extend(END.to_le_bytes());
    out.extend([0, 0, 0, 0, 1, 0, 1, 0]);
    out.extend(word(central_bytes));
    out.extend(word(central));
    out.extend(&word(comment)[..2]);
    out.resize(out.len() + comment, b' ');
    Ok(out)
}

/// What local and central header share, from the version to the length of the extra field.
fn about(name: &str, content: &[u8], data_bytes: usize) -> Vec<u8> {
    let mut about = Vec::with_capacity(26);
    [VERSION, 0, DEFLATED, 0, DATE].iter().for_each(|half| about.extend(half.to_le_bytes()));
    about.extend(crc32fast::hash(content).to_le_bytes());
    about.extend(word(data_bytes));
    about.extend(word(content.len()));
    about.extend(&word(name.len())[..2]);
    about.extend([0, 0]);
    about
}

/// Sizes here are far below 4 GiB.
fn word(size: usize) -> [u8; 4] {
    u32::try_from(size).unwrap_or(u32::MAX).to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    #[test]
    fn the_archive_reads_back_and_is_whole_words() {
        for content in ["", "a", "<x/>\n", &"star ".repeat(5000)] {
            let out = archive("camera.xml", content.as_bytes()).unwrap();
            assert_eq!(out.len() % 4, 0);
            let size = usize::try_from(u32::from_le_bytes(out[18..22].try_into().unwrap())).unwrap();
            let mut text = String::new();
            flate2::read::DeflateDecoder::new(&out[40..40 + size]).read_to_string(&mut text).unwrap();
            assert_eq!(text, content);
        }
    }

    #[test]
    fn another_program_unpacks_it() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("camera.zip");
        std::fs::write(&path, archive("camera.xml", b"<camera/>").unwrap()).unwrap();
        let told = std::process::Command::new("python3").args(["-m", "zipfile", "-t"]).arg(&path).output();
        let Ok(told) = told else {
            println!("SKIPPED: no python3 to read the archive");
            return;
        };
        assert!(told.status.success() && !String::from_utf8_lossy(&told.stdout).contains("bad"), "{told:?}");
        let mut damaged = std::fs::read(&path).unwrap();
        damaged[42] ^= 0x40;
        std::fs::write(&path, damaged).unwrap();
        let told = std::process::Command::new("python3").args(["-m", "zipfile", "-t"]).arg(&path).output().unwrap();
        let said = format!("{told:?}");
        assert!(!told.status.success() || said.contains("corrupted"), "the reader notices damage: {said}");
    }
}
