//! Tests that every frame has a row with its result, that rows come back in the order of frames, and that damage is
//! refused.

use super::row_writer::{RowWriter, RowsOutcome};
use super::rows::{HEADER, HEADER_OF_ONE, ORDER_FRAMES, RowReader, RowsOfHead};
use super::{CapturedFate, DrawnFrom, FrameRow, RowCounts};
use crate::runtime::clock_intake::PORTS_MAX;
use crate::runtime::{FrameMark, frame_marks};
use CapturedFate::{Dropped, Held, Late, Sent};
use base::{patience, time::Span};
use crossbeam_channel::{Receiver, bounded};
use frames::sink::{FaultFlags, NullSink, SentFrame, Sink};
use frames::sink::{crc32::pixel_crc32, sample::sample_frame};
use std::{io, io::Write, path::Path};

fn read(text: &str) -> Result<(Vec<FrameRow>, bool), String> {
    let mut reader = RowReader::new(text.as_bytes(), Path::new("frames.csv")).map_err(|error| error.to_string())?;
    let mut rows = Vec::new();
    while let Some(row) = reader.read().map_err(|error| error.to_string())? {
        rows.push(row);
    }
    Ok((rows, reader.is_cut_off()))
}

fn read_head(text: &str, head: usize) -> Vec<FrameRow> {
    let mut rows = RowsOfHead::new(RowReader::new(text.as_bytes(), Path::new("frames.csv")).unwrap(), head, 3);
    core::iter::from_fn(|| rows.read().unwrap()).collect()
}

/// Returns a mark with ten messages of each link per frame.
fn mark(frame: u32) -> FrameMark {
    FrameMark {
        frame,
        messages: [10 * u64::from(frame); PORTS_MAX],
        load: 1.0 / 3.0,
        degradation: "full",
        exposed: None,
    }
}

fn frame(number: u32, lateness_ms: i64, faults: FaultFlags) -> SentFrame {
    let mut frame = sample_frame(0);
    (frame.meta.number, frame.meta.lateness, frame.meta.faults) = (number, Span::from_ms(lateness_ms), faults);
    frame
}

/// Returns frame numbers and fates.
fn fates(rows: &[FrameRow]) -> Vec<(u32, CapturedFate)> {
    rows.iter().map(|row| (row.frame, row.fate)).collect()
}

#[test]
fn every_frame_has_a_row_with_its_result() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frames.csv");
    let (marks, end) = frame_marks();
    let writer = RowWriter::create(&path, 1, true).unwrap();
    let mut sink = writer.sink(0, Box::new(NullSink::new()), end, true);
    // 0: sent. 1: drawn, never sent. 2: late. 3: never drawn, held. 4: the run ends before it goes out.
    for (number, lateness_ms, faults) in
        [(0, -1, FaultFlags::NONE), (2, 1, FaultFlags::NONE), (3, 1, FaultFlags::FRAME_DUPLICATE)]
    {
        (number == 2).then(|| marks.put(mark(1)));
        (number != 3).then(|| marks.put(mark(number)));
        sink.send(&frame(number, lateness_ms, faults)).unwrap();
    }
    marks.put(mark(4));
    sink.finish().unwrap();
    let RowsOutcome { counts, lost, error } = writer.finish();
    assert_eq!((lost, error), (0, None));
    assert_eq!((counts.rows, counts.frames), (5, 3));
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(!read(&text).unwrap().1);
    let rows = read_head(&text, 0);
    let went_out = Some(pixel_crc32(&sample_frame(0).image));
    let fates: Vec<_> = rows.iter().map(|row| (row.frame, row.fate, row.crc32)).collect();
    let wanted =
        [(0, Sent, went_out), (1, Dropped, None), (2, Late, went_out), (3, Held, went_out), (4, Dropped, None)];
    assert_eq!(fates, wanted);
    let drawn = rows[2].drawn.unwrap();
    assert_eq!((drawn.messages[0], drawn.load, rows[3].drawn), (20, 1.0 / 3.0, None), "exact bits");
    assert_eq!(drawn.messages[1..], [0; PORTS_MAX - 1], "one link");
}

#[test]
fn heads_share_a_table_with_the_messages_of_each_link() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frames.csv");
    let writer = RowWriter::create(&path, 2, true).unwrap();
    let threads = [0, 1, 2].map(|head| {
        let (marks, end) = frame_marks();
        let mut sink = writer.sink(head, Box::new(NullSink::new()), end, false);
        let draw = move || {
            for number in 0..50 {
                let mut mark = mark(number);
                mark.messages[1] = head as u64;
                marks.put(mark);
                sink.send(&frame(number, -1, FaultFlags::NONE)).unwrap();
            }
            sink.finish().unwrap();
        };
        std::thread::Builder::new().name("sink".into()).spawn(draw).unwrap()
    });
    threads.into_iter().for_each(|thread| thread.join().unwrap());
    assert_eq!(writer.finish().counts.rows, 150);
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains("\n49,2,490;2,3fd5555555555555,full,sent,"), "{text}");
    for head in 0..3 {
        let rows = read_head(&text, head);
        assert!(rows.iter().map(|row| row.frame).eq(0..50), "{head}");
        assert!(rows.iter().all(|row| row.drawn.unwrap().messages[..2] == [10 * u64::from(row.frame), head as u64]));
    }
    assert!(read_head(&text, 3).is_empty(), "control: no such head");
}

#[test]
fn frames_that_a_fault_delays_duplicates_or_drops_come_back_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frames.csv");
    let (marks, end) = frame_marks();
    let writer = RowWriter::create(&path, 1, true).unwrap();
    // Late frames go out: none is held, even if a fault repeats an image.
    let mut sink = writer.sink(0, Box::new(NullSink::new()), end, false);
    let last = 3 * ORDER_FRAMES;
    (0..=last).for_each(|number| marks.put(mark(number)));
    // 1 is delayed behind 3, 2 repeats an image, 4 is repeated and late; then so many are dropped that the order is
    // lost.
    for (number, lateness_ms, faults) in [
        (0, -1, FaultFlags::NONE),
        (2, -1, FaultFlags::FRAME_DUPLICATE),
        (3, -1, FaultFlags::NONE),
        (1, -1, FaultFlags::NONE),
        (4, 1, FaultFlags::FRAME_DUPLICATE),
        (last - 1, -1, FaultFlags::NONE),
        (last, -1, FaultFlags::NONE),
        (last - 2, -1, FaultFlags::NONE),
    ] {
        sink.send(&frame(number, lateness_ms, faults)).unwrap();
    }
    sink.finish().unwrap();
    assert_eq!(writer.finish().counts.rows, u64::from(last) + 1);
    let text = std::fs::read_to_string(&path).unwrap();
    let in_file = read(&text).unwrap().0;
    assert!(!in_file.is_sorted_by_key(|row| row.frame), "control: not in the file");
    let rows = read_head(&text, 0);
    assert!(rows.iter().map(|row| row.frame).eq(0..=last));
    assert_eq!(fates(&rows)[..5], [(0, Sent), (1, Sent), (2, Sent), (3, Sent), (4, Late)]);
    assert!(rows[5..rows.len() - 3].iter().all(|row| row.fate == Dropped && row.drawn.is_some()));
    assert!(rows[rows.len() - 3..].iter().all(|row| row.fate == Sent && row.drawn.is_some()));
}

/// A disk on which writing never ends.
struct Hanging(Receiver<()>);

impl Write for Hanging {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let _ = self.0.recv(); // the test ends it
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Sends seven frames of two heads to a disk; returns the result of writing their rows.
fn written_to(disk: Box<dyn Write + Send>, waits: bool) -> RowsOutcome {
    let writer = RowWriter::start(disk, 1, waits).unwrap();
    let mut sinks = [0, 1].map(|head| writer.sink(head, Box::new(NullSink::new()), frame_marks().1, false));
    (0..7).for_each(|number| sinks[number as usize % 2].send(&sample_frame(number)).unwrap());
    let frames = sinks.map(|mut sink| sink.finish().unwrap().frames);
    assert_eq!(frames, [4, 3], "the sinks have them all");
    writer.finish()
}

#[test]
fn writer_that_blocks_is_given_up_and_its_rows_are_lost() {
    patience::be_short();
    for waits in [true, false] {
        let (_never, blocks) = bounded(0);
        let outcome = written_to(Box::new(Hanging(blocks)), waits);
        assert_eq!(outcome.lost, 7);
        let error = outcome.error.unwrap();
        assert!(error.starts_with("frames.csv cannot be written") && error.contains("given up"), "{error}");
    }
}

#[test]
fn full_disk_costs_rows_and_not_the_run() {
    struct Full;
    impl Write for Full {
        fn write(&mut self, _bytes: &[u8]) -> io::Result<usize> {
            Err(io::ErrorKind::StorageFull.into())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    let outcome = written_to(Box::new(Full), true);
    assert_eq!((outcome.lost, outcome.counts), (7, RowCounts::default()));
    assert!(outcome.error.is_some_and(|error| error.starts_with("frames.csv: ")));
    let control = written_to(Box::new(io::sink()), true);
    assert_eq!((control.lost, control.error, control.counts.rows), (0, None, 7));
}

#[test]
fn damage_is_refused_with_its_line_and_a_cut_row_is_left_out() {
    let good = format!("{HEADER}\n0,2,12;7,3ff0000000000000,full,sent,0a0b0c0d,\n");
    let mut messages = [0; PORTS_MAX];
    messages[..2].copy_from_slice(&[12, 7]);
    let row = &read(&good).unwrap().0[0];
    assert_eq!((row.head, row.drawn), (2, Some(DrawnFrom { messages, load: 1.0, exposed: None })));
    assert_eq!(read(&format!("{good}1,0,13,3ff")).unwrap(), (read(&good).unwrap().0, true));
    for (bad, why) in [
        ("1,2,3", "eight fields"),
        ("1,0,2,0,full,sent,0", "eight fields"),
        ("x,0,2,0,full,sent,0,", "frame: "),
        ("1,-1,2,0,full,sent,0,", "head: "),
        ("1,0,-2,0,full,sent,0,", "messages: "),
        ("1,0,2;,0,full,sent,0,", "messages: "),
        ("1,0,1;2;3;4;5;6;7;8;9,0,full,sent,0,", "8 links at most"),
        ("1,0,2,,full,sent,0,", "load_bits: "),
        ("1,0,2,0,full,lost,0,", "fate: "),
        ("1,0,2,0,full,sent,g,", "crc32: "),
        ("1,0,2,0,full,sent,0,1;2;3", "exposed: "),
        (&"9".repeat(2100), "longer than 2048"),
    ] {
        let error = read(&format!("{good}{bad}\n")).unwrap_err();
        assert!(error.contains("frames.csv:3: ") && error.contains(why), "{bad}: {error}");
    }
    assert!(read("frame,x\n").unwrap_err().contains("frames.csv:1: wanted frame,head,messages"));
}

#[test]
fn row_of_a_head_that_the_bench_has_not_is_refused_for_every_head() {
    let row = |frame: u32, head: usize| format!("{frame},{head},12,3ff0000000000000,full,sent,0a0b0c0d,\n");
    let text = [format!("{HEADER}\n"), row(0, 2), row(1, 3)].concat();
    for head in 0..3 {
        let reader = RowReader::new(text.as_bytes(), Path::new("frames.csv")).unwrap();
        let mut rows = RowsOfHead::new(reader, head, 3);
        let error = (0..3).find_map(|_| rows.read().err()).unwrap().to_string();
        assert!(error.contains("frames.csv:3: wanted a head of the bench"), "{head}: {error}");
    }
    assert_eq!(read_head(&[format!("{HEADER}\n"), row(0, 2)].concat(), 2).len(), 1, "control");
}

#[test]
fn table_of_the_first_form_has_one_head_and_one_link() {
    let table = format!("{HEADER_OF_ONE}\n7,12,3ff0000000000000,full,sent,0a0b0c0d\n8,,,full,held,0a0b0c0d\n");
    let rows = read(&table).unwrap().0;
    assert_eq!(fates(&rows), [(7, Sent), (8, Held)]);
    assert_eq!((rows[0].head, rows[0].drawn.unwrap().messages[0]), (0, 12));
    assert!(read(&format!("{table}9,0,12,0,full,sent,0\n")).unwrap_err().contains("wanted six fields"));
}
