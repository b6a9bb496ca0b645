//! Gaia's CSV, every bit of it flipped and cut at every length: stars, counts or an error, and never more stars than
//! rows; lines of the longest length, and beyond it.

use super::gaia::{self, COMMENTS, LONGEST_LINE, Names, WITHOUT_END, WITHOUT_MAGNITUDE, WITHOUT_PLACE};
use flate2::{Compression, write::GzEncoder};
use stars::layer::Sorting;
use std::{collections::BTreeMap, io::Write, path::Path};

/// As the archive writes it, less its other columns; a row of every kind. Identifiers that begin with 3 are one bit
/// from `#`.
const TEXT: &str = "# %ECSV 1.0\n# ---\n# delimiter: ','\n# - {name: source_id, datatype: int64}\n\
    source_id,ra,dec,parallax,pmra,pmdec,phot_g_mean_mag,phot_bp_mean_mag,phot_rp_mean_mag,bp_rp\n\
    3295806720,44.996,0.0056,0.354,11.93,-3.4,17.641426,18.1,16.9,1.2\n\
    34361129088,45.0,-0.02,null,null,null,18.5,null,null,null\n\
    5,null,0.02,null,null,null,18.5,null,null,null\n\
    6,359.25,-89.5,-0.25,0.5,-0.75,null,null,null,null\n\
    37,15.0,2.0,1.0,,,12.0,12.5,11.5,\n";
const ROWS: u64 = 5;

/// Contents found in a file: its rows, its stars, and the counts.
struct Found {
    rows: u64,
    stars: u64,
    reported: BTreeMap<String, u64>,
}

impl Found {
    fn reported(&self, what: &str) -> u64 {
        self.reported.get(what).copied().unwrap_or(0)
    }

    fn left_out(&self) -> u64 {
        self.reported(WITHOUT_PLACE) + self.reported(WITHOUT_MAGNITUDE)
    }
}

fn read(text: &[u8], folder: &Path) -> Result<Found, String> {
    let mut sorting = Sorting::start(folder, &[22.0]).unwrap();
    let rows = gaia::import_text(text, Path::new("g.csv"), &Names::default(), &mut sorting, &mut |_| {});
    let rows = rows.map_err(|error| error.to_string())?;
    let reported = sorting.reported().map(|(what, count)| (what.to_owned(), count)).collect();
    Ok(Found { rows, stars: sorting.counts().stars, reported })
}

/// Compares the findings with the text's lines; returns whether it was read.
fn is_read(text: &[u8], folder: &Path) -> bool {
    match read(text, folder) {
        Err(reported) => {
            assert!(reported.contains("g.csv"), "{reported}");
            false
        }
        Ok(found) => {
            let lines = text.split(|byte| *byte == b'\n').filter(|line| !line.trim_ascii().is_empty());
            let rows = lines.skip_while(|line| line.starts_with(b"#")).skip(1).count() as u64;
            assert_eq!(found.rows + found.reported(COMMENTS), rows, "{}", String::from_utf8_lossy(text));
            let too_faint = found.rows - found.stars - found.left_out();
            assert!(found.stars <= ROWS && found.rows <= ROWS && too_faint <= 1);
            true
        }
    }
}

#[test]
fn no_flipped_bit_and_no_cut_loses_a_row_silently() {
    let (folder, text) = (tempfile::tempdir().unwrap(), TEXT.as_bytes());
    let whole = read(text, folder.path()).unwrap();
    assert_eq!((whole.rows, whole.stars, whole.left_out()), (ROWS, 3, 2), "control: the file undamaged");
    assert_eq!(whole.reported.len(), 2, "and nothing else is reported: {:?}", whole.reported);
    let (mut taken, mut refused) = (0, 0);
    for at in 0..text.len() {
        for bit in 0..8 {
            let mut flipped = text.to_vec();
            flipped[at] ^= 1 << bit;
            *(if is_read(&flipped, folder.path()) { &mut taken } else { &mut refused }) += 1;
        }
    }
    // Digits and unused columns against all else.
    assert!(taken > 1000 && refused > 1000, "{taken} {refused}");
    let header_end = TEXT.find("bp_rp\n").unwrap() + 6;
    for end in 0..text.len() {
        let is_whole_line = text[..end].ends_with(b"\n");
        match read(&text[..end], folder.path()) {
            Ok(found) => {
                // A header that is cut in an unused column is still a header.
                assert!(found.stars <= 3 && (end > header_end || found.rows == 0), "cut at {end}");
                let is_reported = found.reported(WITHOUT_END) == 1;
                assert_eq!(is_reported, !is_whole_line && found.rows > 0, "cut at {end}");
            }
            Err(reported) => assert!(!is_whole_line || end < header_end, "cut at {end}: {reported}"),
        }
    }
}

#[test]
fn one_bit_makes_no_comment_of_a_row_and_no_number_positive() {
    let folder = tempfile::tempdir().unwrap();
    let found = read(TEXT.replacen("\n34361", "\n#4361", 1).as_bytes(), folder.path()).unwrap();
    assert_eq!((found.rows, found.reported(COMMENTS)), (ROWS - 1, 1), "a row that looks like a comment is counted");
    let reported = read(TEXT.replacen(",-0.02", ",\r0.02", 1).as_bytes(), folder.path()).err().unwrap();
    assert!(reported.contains("line 7, column dec: wanted a number"), "{reported}");
}

#[test]
fn lines_are_read_up_to_the_longest() {
    let folder = tempfile::tempdir().unwrap();
    let (head, _) = TEXT.split_at(TEXT.find("3295806720").unwrap());
    let text = |length: usize| {
        let row = "7,44.9,0.5,1.0,,,12.0,,,";
        format!("{head}{row}{}\n{row}\n", " ".repeat(length - row.len()))
    };
    let packed = |text: &str| {
        let path = folder.path().join("g.csv.gz");
        let mut encoder = GzEncoder::new(std::fs::File::create(&path).unwrap(), Compression::fast());
        encoder.write_all(text.as_bytes()).unwrap();
        encoder.finish().unwrap();
        let mut sorting = Sorting::start(&folder.path().join("work"), &[22.0]).unwrap();
        gaia::import(&path, &Names::default(), &mut sorting, &mut |_| {}).map_err(|error| error.to_string())
    };
    let plain = |text: &str| read(text.as_bytes(), &folder.path().join("work")).map(|found| found.rows);
    assert_eq!((plain(&text(LONGEST_LINE)), packed(&text(LONGEST_LINE))), (Ok(2), Ok(2)));
    for reported in [plain(&text(LONGEST_LINE + 1)).unwrap_err(), packed(&text(LONGEST_LINE + 1)).unwrap_err()] {
        assert!(reported.contains("line 6: longer than 1048576 bytes"), "{reported}");
    }
    // Comments and a file of one endless line are treated alike.
    let comment = format!("#{}\n{TEXT}", "-".repeat(LONGEST_LINE));
    assert!(plain(&comment).unwrap_err().contains("line 1: longer"));
    let endless = "0".repeat(64 << 20);
    for reported in [plain(&endless).unwrap_err(), packed(&endless).unwrap_err()] {
        assert!(reported.contains("line 1: longer"), "{reported}");
    }
}
