//! The suite on the sinks of this crate and on broken ones, and one full disk for every writer.

use super::{check_sink, run};
use crate::sink::sample::sample_frame;
use crate::sink::{NullSink, Recorder, RecorderOptions, SentFrame, Sink, SinkError, SinkSummary, fits, png, truth};
use base::image::ElectronImage;
use std::io::{self, Write};

#[test]
fn the_null_sink_complies() {
    check_sink(|| Box::new(NullSink::new())).unwrap();
}

#[test]
fn the_recorder_complies() {
    let directory = tempfile::tempdir().unwrap();
    let mut runs = (0..).map(|n| directory.path().join(format!("run{n}")));
    let options = RecorderOptions { png_every: 1, ..RecorderOptions::default() };
    check_sink(|| Box::new(Recorder::create(runs.next().unwrap(), options).unwrap())).unwrap();
}

#[test]
fn sinks_agree_on_the_checksum_of_a_run() {
    let directory = tempfile::tempdir().unwrap();
    let mut recorder = Recorder::create(directory.path(), RecorderOptions::default()).unwrap();
    let recorded = run(&mut recorder, &[1, 2], 0).unwrap();
    assert_eq!(recorded.run_crc32, run(&mut NullSink::new(), &[1, 2], 0).unwrap().run_crc32);
}

/// Breaks one promise, to show that the suite notices.
struct Broken {
    inner: NullSink,
    loses_frame: Option<u32>,
    checksum: bool,
}

impl Sink for Broken {
    fn name(&self) -> &'static str {
        "broken"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        if self.loses_frame == Some(frame.meta.number) { Ok(()) } else { self.inner.send(frame) }
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        let mut summary = self.inner.finish()?;
        summary.run_crc32 *= u32::from(self.checksum);
        Ok(summary)
    }
}

#[test]
fn the_suite_notices_broken_sinks() {
    let broken =
        |loses_frame, checksum| check_sink(|| Box::new(Broken { inner: NullSink::new(), loses_frame, checksum }));
    assert_eq!(broken(None, true), Ok(()), "the control itself");
    assert!(broken(Some(2), true).unwrap_err().contains("frames counted"));
    assert!(broken(None, false).unwrap_err().contains("one bit"));
    assert!(broken(Some(8), true).unwrap_err().contains("after finish"));
}

/// A disk with space for so many bytes.
struct FullAfter {
    space: usize,
}

impl Write for FullAfter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.space == 0 && !bytes.is_empty() {
            return Err(io::ErrorKind::StorageFull.into());
        }
        let written = bytes.len().min(self.space);
        self.space -= written;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn every_writer_reports_a_disk_that_fills_up_at_any_byte() {
    let frame = sample_frame(1);
    let electrons = ElectronImage::new(9, 9);
    type Writer<'a> = (&'a str, &'a dyn Fn(&mut dyn Write) -> io::Result<()>);
    let writers: [Writer<'_>; 6] = [
        ("fits", &|out| fits::write_frame(out, &frame)),
        ("fits electrons", &|out| {
            let pixels = fits::Pixels::F32(electrons.pixels());
            fits::write_electrons(out, electrons.width(), electrons.height(), pixels, &frame.meta)
        }),
        ("png 8", &|out| png::write_dn_for_people(out, &frame.image)),
        ("png 16", &|out| png::write_dn_raw(out, &frame.image)),
        ("png electrons", &|out| png::write_electrons_for_people(out, &electrons)),
        ("truth", &|out| truth::write_truth(out, &frame.truth)),
    ];
    for (name, write) in writers {
        let mut whole = Vec::new();
        write(&mut whole).unwrap();
        for space in 0..whole.len() {
            let error = write(&mut FullAfter { space }).expect_err("no space");
            assert_eq!(error.kind(), io::ErrorKind::StorageFull, "{name} after {space} of {} bytes", whole.len());
        }
        write(&mut FullAfter { space: whole.len() }).expect("just enough space");
    }
}
