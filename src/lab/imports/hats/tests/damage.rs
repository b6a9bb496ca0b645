//! Files that were cut, flipped, overwritten: an error, or all rows as they were.

use super::*;

/// Rows of the file that is damaged.
const ROWS: usize = 60;
/// Most memory that reading damaged files may add to the test, MiB: pages are at most 64 MiB unpacked.
const MOST_MIB: u64 = 400;

/// Returns the error of a file, or nothing when every row is accounted for.
fn reported(path: &Path, bytes: &[u8]) -> Option<String> {
    std::fs::write(path, bytes).unwrap();
    let (done, sorting, _folder) = take(path, &Names::default());
    match done {
        Err(error) => {
            let reported = error.to_string();
            assert!(reported.contains("damaged.parquet"), "names the file: {reported}");
            Some(reported)
        }
        Ok(rows) => {
            let counted =
                sorting.counts().stars + sorting.counts().too_faint + sorting.reported().map(|(_, n)| n).sum::<u64>();
            assert_eq!((rows, counted), (ROWS as u64, ROWS as u64), "every row is a star or counted");
            None
        }
    }
}

/// Returns the peak memory of this program, MiB; nothing where the system does not report it.
fn most_memory_mib() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib >> 10)
}

fn forms() -> [Form; 3] {
    let second = WriterVersion::PARQUET_2_0;
    [
        PLAIN,
        Form { compression: Compression::SNAPPY, dictionary: true, group_rows: 25, ..PLAIN },
        Form { compression: Compression::ZSTD(Default::default()), version: second, dictionary: true, ..PLAIN },
    ]
}

#[test]
fn files_that_are_cut_short_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.parquet");
    for form in forms() {
        write_file(&path, &columns(ROWS), &form);
        let whole = std::fs::read(&path).unwrap();
        assert_eq!(reported(&path, &whole), None, "control: the whole file");
        for cut in (0..whole.len()).step_by(37).chain(whole.len() - 20..whole.len()) {
            let reported = reported(&path, &whole[..cut]).expect("cut short");
            assert!(reported.contains("no Parquet file"), "{cut}: {reported}");
        }
        let longer = [&whole[..], b"more"].concat();
        assert!(reported(&path, &longer).unwrap().contains("PAR1"));
    }
}

#[test]
fn damage_is_an_error_or_leaves_every_row_accounted_for() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.parquet");
    let mut rng = StdRng::seed_from_u64(21);
    let before = most_memory_mib();
    let (mut refused, mut seen) = (0, 0);
    for form in forms() {
        write_file(&path, &columns(ROWS), &form);
        let whole = std::fs::read(&path).unwrap();
        let footer = u32::from_le_bytes(whole[whole.len() - 8..whole.len() - 4].try_into().unwrap()) as usize;
        let footer_at = whole.len() - 8 - footer;
        for i in 0..600 {
            let mut bytes = whole.clone();
            // A third anywhere, a third in the footer, a third several bytes at once.
            let at =
                if i % 3 == 1 { rng.random_range(footer_at..whole.len()) } else { rng.random_range(0..whole.len()) };
            if i % 3 == 2 {
                let end = (at + rng.random_range(1..12)).min(whole.len());
                rng.fill(&mut bytes[at..end]);
            } else {
                bytes[at] ^= 1 << rng.random_range(0..8);
            }
            seen += 1;
            refused += u32::from(reported(&path, &bytes).is_some());
        }
    }
    assert!(refused > seen / 4, "control: {refused} of {seen} were refused");
    if let (Some(before), Some(after)) = (before, most_memory_mib()) {
        assert!(after < before + MOST_MIB, "{before} MiB before, {after} after");
    }
}

/// Returns the first place of `needle` in a file.
fn place_of(bytes: &[u8], needle: &[u8]) -> usize {
    bytes.windows(needle.len()).position(|window| window == needle).expect("there")
}

#[test]
fn sizes_that_are_too_large_are_refused_before_anything_is_allocated() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.parquet");
    write_file(&path, &columns(ROWS), &Form { dictionary: true, ..PLAIN });
    let whole = std::fs::read(&path).unwrap();
    // The head of the first page follows the magic: kind, size unpacked, size, each a field and a number.
    assert_eq!(whole[4..6], [0x15, 0x04], "a dictionary comes first");
    let mut footer = whole.clone();
    let end = whole.len() - 8;
    footer[end..end + 4].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(reported(&path, &footer).unwrap().contains("a footer of 4294967295 bytes"));
    // The tree of columns: the root has nine within it, by field 5 after its name.
    let root = place_of(&whole, b"test") + 4;
    assert_eq!(whole[root..root + 2], [0x15, 18], "nine columns");
    let mut tree = whole.clone();
    tree[root + 1] = 20;
    assert!(reported(&path, &tree).unwrap().contains("no sound list of columns"));
    let crowd = [&whole[..root + 1], &[0xFE, 0xFF, 0xFF, 0xFF, 0x0F], &whole[root + 2..end]].concat();
    let length = u32::from_le_bytes(whole[end..end + 4].try_into().unwrap()) + 4;
    let crowd = [&crowd[..], &length.to_le_bytes(), b"PAR1"].concat();
    assert!(reported(&path, &crowd).unwrap().contains("no sound list of columns"), "two billion columns");
}

#[test]
fn heads_of_pages_that_make_no_sense_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.parquet");
    let mut file = columns(ROWS);
    file.remove(0);
    write_file(&path, &file, &Form { dictionary: true, ..PLAIN });
    let whole = std::fs::read(&path).unwrap();
    // source_id: a dictionary of 60 values of 8 bytes: its head is 15 04 15 C0 07 15 C0 07 4C 15 78 ...
    assert_eq!(whole[4..15], [0x15, 4, 0x15, 0xC0, 7, 0x15, 0xC0, 7, 0x4C, 0x15, 0x78]);
    let with = |at: usize, byte: u8| {
        let mut bytes = whole.clone();
        bytes[at] = byte;
        reported(&path, &bytes).expect("refused")
    };
    let reported = with(14, 0x7A);
    let wanted = "column source_id: damaged: page at byte 4: a dictionary of 61 values in 480 bytes";
    assert!(reported.contains(wanted), "{reported}");
    let reported = with(8, 0x7F);
    assert!(reported.contains("a dictionary of 60 values in 8160 bytes"), "unpacked to more: {reported}");
    let reported = with(11, 0x0F);
    assert!(reported.contains("992 bytes, unpacked 480"), "packed to more than the column has: {reported}");
    let reported = with(7, 0x0F);
    assert!(reported.contains("its head makes no sense"), "fewer than no bytes: {reported}");
}
