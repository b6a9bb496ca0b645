//! `firmware_protocol/FRAMES.md` against the structures that are written into shared memory.

use core::mem::offset_of;
use frames::sink::shared_memory::{FileHead, MAGIC, SlotHead, VERSION};

/// Offset, type, name of a field.
type Field = (usize, &'static str, &'static str);

macro_rules! fields {
    ($head:ty: $($name:ident: $kind:literal,)+) => {
        vec![$((offset_of!($head, $name), $kind, stringify!($name)),)+]
    };
}

fn file_head() -> Vec<Field> {
    fields! { FileHead:
        magic: "u8[16]", version: "u32", slots: "u32", width_px: "u32", height_px: "u32", slot_bytes: "u64",
        published: "u64", is_over: "u32", reserved: "u32[3]",
    }
}

fn slot_head() -> Vec<Field> {
    fields! { SlotHead:
        serial: "u64", mid_exposure_tai_ns: "i64", lateness_ns: "i64", horizon_ns: "i64", frame: "u32",
        pixel_crc32: "u32", faults: "u32", stars: "u32", exposure_s: "f64", attitude_wxyz: "f64[4]",
        ra_dec_roll_deg: "f64[3]", rate_deg_s: "f64[3]", gain_e_per_dn: "f64", black_level_dn: "f64",
        width_px: "u32", height_px: "u32", noise_seed: "u64", jitter_missing_ns: "i64", reserved: "u64[10]",
    }
}

/// Returns the tables of the document that have offsets, in order.
fn documented(text: &str) -> Vec<Vec<(usize, String, String)>> {
    let tables = text.split("| offset |").skip(1);
    let row = |line: &str| {
        let cells: Vec<_> = line.trim_matches('|').split('|').map(str::trim).collect();
        (cells[0].parse().unwrap(), cells[1].to_owned(), cells[2].to_owned())
    };
    tables.map(|table| table.lines().skip(2).take_while(|line| line.starts_with('|')).map(row).collect()).collect()
}

/// Returns bytes of a type as the document writes it.
fn size_of_kind(kind: &str) -> usize {
    let (scalar, count) = kind.split_once('[').unwrap_or((kind, "1]"));
    let bits: usize = scalar[1..].parse().unwrap();
    bits / 8 * count.trim_end_matches(']').parse::<usize>().unwrap()
}

fn differences(text: &str) -> Vec<String> {
    let tables = documented(text);
    assert_eq!(tables.len(), 2, "head of the file, head of a slot");
    let mut found = Vec::new();
    let sizes = [size_of::<FileHead>(), size_of::<SlotHead>()];
    for ((table, fields), size) in tables.iter().zip([file_head(), slot_head()]).zip(sizes) {
        let wanted: Vec<_> =
            fields.iter().map(|(at, kind, name)| (*at, (*kind).to_owned(), (*name).to_owned())).collect();
        found.extend((*table != wanted).then(|| format!("{table:?}, wanted {wanted:?}")));
        // The sizes of the types leave no gap, so that they are those of the structure.
        let ends = table.iter().map(|(at, kind, _)| at + size_of_kind(kind));
        let next = table.iter().skip(1).map(|(at, ..)| *at).chain([size]);
        found.extend(ends.zip(next).filter(|(end, next)| end != next).map(|pair| format!("gap: {pair:?}")));
    }
    found
}

fn text() -> String {
    std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/firmware_protocol/FRAMES.md")).unwrap()
}

#[test]
fn shared_memory_layout_is_the_documented_one() {
    let text = text();
    assert_eq!(differences(&text), Vec::<String>::new());
    let magic = String::from_utf8_lossy(&MAGIC[..15]).into_owned();
    assert!(MAGIC[15] == 0 && text.contains(&format!("the characters `{magic}`, then a zero byte")), "{magic}");
    assert!(text.contains(&format!("| version | {VERSION};")), "version {VERSION}");
}

/// Negative control: one offset, type or name changed.
#[test]
fn wrong_layout_in_the_document_is_noticed() {
    let text = text();
    for (right, wrong) in
        [("| 40 | u64 | published", "| 44 | u64 | published"), ("| f64[4] |", "| f32[4] |"), ("| stars |", "| rows |")]
    {
        assert_eq!(text.matches(right).count(), 1, "{right}");
        assert!(!differences(&text.replace(right, wrong)).is_empty(), "{wrong}");
    }
}
