//! Files -> a zip archive: the XML of a network camera, a co-simulation unit. Deflated, no date, no attributes.
//!
//! The archive's length is a multiple of four, as a camera's memory is read in words; a comment of up to three spaces
//! fills it up. The same files give the same bytes. The layout is that of the zip application note without its 64-bit
//! extensions; the tests read it back with an independent inflater and with another program.

use flate2::{Compression, write::DeflateEncoder};
use std::io::{self, Write};

const LOCAL_HEADER: u32 = 0x0403_4B50;
const CENTRAL_HEADER: u32 = 0x0201_4B50;
const END: u32 = 0x0605_4B50;
const VERSION: u16 = 20;
const DEFLATED: u16 = 8;
/// 1980-01-01, the first day that the format knows.
const DATE: u16 = 0x0021;
/// Bytes of the record at the end without its comment.
const END_BYTES: usize = 22;

/// Returns an archive of files, each with its name, in their order.
///
/// # Errors
/// When there are more than 65,535 files, or they need more than 4 GiB.
pub fn archive(files: &[(&str, &[u8])]) -> io::Result<Vec<u8>> {
    let (mut out, mut central) = (Vec::new(), Vec::new());
    for (name, content) in files {
        let mut deflated = DeflateEncoder::new(Vec::new(), Compression::best());
        deflated.write_all(content)?;
        let data = deflated.finish()?;
        let (about, place) = (about(name, content, data.len())?, out.len());
        out.extend(LOCAL_HEADER.to_le_bytes());
        out.extend(&about);
        out.extend(name.as_bytes());
        out.extend(&data);
        central.extend(CENTRAL_HEADER.to_le_bytes());
        central.extend(VERSION.to_le_bytes());
        central.extend(&about);
        // Length of comment, disk, attributes inside and outside.
        central.extend([0; 10]);
        central.extend(word(place)?);
        central.extend(name.as_bytes());
    }
    let central_place = out.len();
    out.extend(&central);
    let comment = (END_BYTES + out.len()).next_multiple_of(4) - (END_BYTES + out.len());
    let count = half(files.len())?;
    out.extend(END.to_le_bytes());
    out.extend([0; 4]);
    out.extend(count);
    out.extend(count);
    out.extend(word(central.len())?);
    out.extend(word(central_place)?);
    out.extend(half(comment)?);
    out.resize(out.len() + comment, b' ');
    Ok(out)
}

/// Returns the bytes that local and central header share, from the version to the length of the extra field.
fn about(name: &str, content: &[u8], data_bytes: usize) -> io::Result<Vec<u8>> {
    let mut about = Vec::with_capacity(26);
    [VERSION, 0, DEFLATED, 0, DATE].iter().for_each(|half| about.extend(half.to_le_bytes()));
    about.extend(crc32fast::hash(content).to_le_bytes());
    about.extend(word(data_bytes)?);
    about.extend(word(content.len())?);
    about.extend(half(name.len())?);
    about.extend([0, 0]);
    Ok(about)
}

fn word(size: usize) -> io::Result<[u8; 4]> {
    let too_large = |_| io::Error::other(format!("a zip archive without 64-bit extensions cannot hold {size} bytes"));
    u32::try_from(size).map(u32::to_le_bytes).map_err(too_large)
}

fn half(count: usize) -> io::Result<[u8; 2]> {
    let too_many = |_| io::Error::other(format!("a zip archive without 64-bit extensions cannot count to {count}"));
    u16::try_from(count).map(u16::to_le_bytes).map_err(too_many)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;

    #[test]
    fn the_archive_reads_back_and_is_whole_words() {
        for content in ["", "a", "<x/>\n", &"star ".repeat(5000)] {
            let out = archive(&[("camera.xml", content.as_bytes())]).unwrap();
            assert_eq!(out.len() % 4, 0);
            let size = usize::try_from(u32::from_le_bytes(out[18..22].try_into().unwrap())).unwrap();
            let mut text = String::new();
            flate2::read::DeflateDecoder::new(&out[40..40 + size]).read_to_string(&mut text).unwrap();
            assert_eq!(text, content);
        }
    }

    #[test]
    fn sizes_that_the_format_cannot_say_are_errors() {
        assert!(word(1 << 32).is_err() && half(1 << 16).is_err());
        assert!(word((1 << 32) - 1).is_ok() && half((1 << 16) - 1).is_ok());
    }

    #[test]
    fn another_program_unpacks_it() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("camera.zip");
        std::fs::write(&path, archive(&[("camera.xml", b"<camera/>"), ("folder/other.txt", b"two")]).unwrap()).unwrap();
        let reported = std::process::Command::new("python3").args(["-m", "zipfile", "-t"]).arg(&path).output();
        let Ok(reported) = reported else {
            println!("SKIPPED: no python3 to read the archive");
            return;
        };
        assert!(
            reported.status.success() && !String::from_utf8_lossy(&reported.stdout).contains("bad"),
            "{reported:?}"
        );
        let mut damaged = std::fs::read(&path).unwrap();
        damaged[42] ^= 0x40;
        std::fs::write(&path, damaged).unwrap();
        let reported = std::process::Command::new("python3").args(["-m", "zipfile", "-t"]).arg(&path).output().unwrap();
        let said = format!("{reported:?}");
        assert!(!reported.status.success() || said.contains("corrupted"), "the reader notices damage: {said}");
    }
}
