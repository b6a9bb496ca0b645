//! The sink that writes a directory per run.
//!
//! Per frame: `frame_000012.fits`, `frame_000012.truth.csv`, with targets on the sky `frame_000012.targets.csv`, every
//! so often `frame_000012.png`, then a line in `frames.csv`. The image comes first, so that no truth table is without
//! its image, and the line last, so that a frame listed there is complete. When a step fails, the files that the frame
//! has got so far are removed; a frame whose files are there and that is not listed was under way when the program was
//! killed. With `ser` the images are in one file as well, `frames.ser`, in the order of the lines; a frame that is not
//! listed is not in it. A directory that already holds a recording is refused, and no file, link, pipe or device that
//! the recording did not make is opened or replaced: the frame is refused instead.

use crate::sink::crc32::{RunCrc32, pixel_crc32};
use crate::sink::frame_log::{FrameLog, path_in};
use crate::sink::{SentFrame, Sink, SinkError, SinkSummary, fits, png, target_table, truth};
use crate::sink::{atomic::write_new_file, facts::FactSource, ser::SerFile};
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Files that are recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RecorderOptions {
    /// A FITS image per frame.
    pub fits: bool,
    /// A truth table per frame.
    pub truth: bool,
    /// A PNG for people with every frame whose number is a multiple of this; 0 for none.
    pub png_every: u32,
    /// All images in one SER file.
    pub ser: bool,
}

impl Default for RecorderOptions {
    fn default() -> Self {
        Self { fits: true, truth: true, png_every: 0, ser: false }
    }
}

/// A recording under way.
#[derive(Debug)]
pub struct Recorder {
    directory: PathBuf,
    options: RecorderOptions,
    log: FrameLog,
    ser: Option<SerFile>,
    last_number: Option<u32>,
    frames: u64,
    refused: u64,
    bytes: u64,
    run_crc32: RunCrc32,
    finished: bool,
}

impl Recorder {
    /// Makes the directory (and its parents) and an empty `frames.csv` in it.
    ///
    /// # Errors
    /// When the directory cannot be made or already holds a recording.
    pub fn create(directory: impl Into<PathBuf>, options: RecorderOptions) -> Result<Self, SinkError> {
        let directory = directory.into();
        if let Err(source) = fs::create_dir_all(&directory) {
            return Err(SinkError::Directory { path: directory, source });
        }
        if fs::symlink_metadata(path_in(&directory)).is_ok() {
            return Err(SinkError::Occupied { path: directory });
        }
        let log = FrameLog::create(path_in(&directory))?;
        let ser = options.ser.then(|| SerFile::create(directory.join("frames.ser"))).transpose()?;
        Ok(Self {
            directory,
            options,
            log,
            ser,
            last_number: None,
            frames: 0,
            refused: 0,
            bytes: 0,
            run_crc32: RunCrc32::default(),
            finished: false,
        })
    }

    fn record(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        self.check(frame)?;
        let crc32 = pixel_crc32(&frame.image);
        let mut files = FrameFiles::new(&self.directory, frame.meta.number);
        let recorded = self.write_files(frame, &mut files).and_then(|()| self.append(frame, crc32));
        let bytes = recorded.inspect_err(|_| files.remove())? + files.bytes;
        self.last_number = Some(frame.meta.number);
        self.frames += 1;
        self.bytes += bytes;
        self.run_crc32.add(frame.meta.number, crc32);
        Ok(())
    }

    /// Appends the frame to the SER file, if there is one, and to the log: to both or to neither. Returns the bytes
    /// written.
    fn append(&mut self, frame: &SentFrame, crc32: u32) -> Result<u64, SinkError> {
        let images = self.ser.as_mut().map_or(Ok(0), |ser| ser.append(frame))?;
        match self.log.append(&FactSource::of_frame(frame, Some(crc32))) {
            Ok(line) => Ok(images + line),
            Err(error) => {
                self.ser.iter_mut().for_each(SerFile::take_back);
                Err(error)
            }
        }
    }

    fn check(&self, frame: &SentFrame) -> Result<(), SinkError> {
        let got = frame.meta.number;
        if self.finished {
            return Err(SinkError::Finished { sink: self.name(), frame: got });
        }
        match self.last_number {
            Some(last) if got <= last => Err(SinkError::FrameOrder { path: self.directory.clone(), last, got }),
            _ => Ok(()),
        }
    }

    fn write_files(&self, frame: &SentFrame, files: &mut FrameFiles) -> Result<(), SinkError> {
        if self.options.fits {
            files.write("fits", |out| fits::write_frame(out, frame))?;
        }
        if self.options.truth {
            files.write("truth.csv", |out| truth::write_truth(out, &frame.truth))?;
        }
        if self.options.truth && !frame.targets.is_empty() {
            files.write("targets.csv", |out| target_table::write_targets(out, &frame.targets))?;
        }
        if self.options.png_every > 0 && frame.meta.number.is_multiple_of(self.options.png_every) {
            files.write("png", |out| png::write_dn_for_people(out, &frame.image))?;
        }
        Ok(())
    }
}

/// The files that one frame has got so far.
struct FrameFiles {
    directory: PathBuf,
    number: u32,
    written: Vec<PathBuf>,
    bytes: u64,
}

impl FrameFiles {
    fn new(directory: &Path, number: u32) -> Self {
        Self { directory: directory.into(), number, written: Vec::new(), bytes: 0 }
    }

    fn write(&mut self, ending: &str, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<(), SinkError> {
        let path = frame_path(&self.directory, self.number, ending);
        self.bytes += write_new_file(&path, write)?;
        self.written.push(path);
        Ok(())
    }

    /// Removes them: a frame is recorded with all of its files or with none.
    fn remove(&mut self) {
        for path in self.written.drain(..) {
            // The failure that led here is the one to report; a file that cannot be removed is not listed.
            let _ = fs::remove_file(path);
        }
    }
}

/// Returns the path of one file of a frame: `frame_000012.<ending>`.
pub fn frame_path(directory: &Path, number: u32, ending: &str) -> PathBuf {
    directory.join(format!("frame_{number:06}.{ending}"))
}

impl Sink for Recorder {
    fn name(&self) -> &'static str {
        "recorder"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        let recorded = self.record(frame);
        self.refused += u64::from(recorded.is_err());
        recorded
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        self.finished = true;
        let trailer = self.ser.as_mut().map_or(Ok(0), SerFile::finish);
        self.log.finish()?;
        let trailer_bytes = trailer?;
        Ok(SinkSummary {
            sink: self.name(),
            frames: self.frames,
            refused: self.refused,
            bytes: self.bytes + trailer_bytes,
            run_crc32: self.run_crc32.value(),
            output: Some(self.directory.clone()),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sink::frame_log::{read_frame_log, tests::FrameRow};
    use crate::sink::{sample::sample_frame, truth::read_truth};

    const EVERYTHING: RecorderOptions = RecorderOptions { fits: true, truth: true, png_every: 2, ser: true };

    fn listed(directory: &Path) -> Vec<FrameRow> {
        read_frame_log(fs::File::open(path_in(directory)).unwrap()).unwrap()
    }

    #[test]
    fn a_run_reads_back() {
        let directory = tempfile::tempdir().unwrap();
        let run = directory.path().join("deep/run");
        let mut recorder = Recorder::create(&run, EVERYTHING).unwrap();
        for number in [3, 4, 8] {
            recorder.send(&sample_frame(number)).unwrap();
        }
        let summary = recorder.finish().unwrap();
        let on_disk: u64 = fs::read_dir(&run).unwrap().map(|e| e.unwrap().metadata().unwrap().len()).sum();
        assert_eq!((summary.frames, summary.bytes), (3, on_disk), "every byte is counted");
        let frame = sample_frame(4);
        let image = fits::read_image(fs::File::open(run.join("frame_000004.fits")).unwrap()).unwrap();
        assert_eq!(image.pixels.as_pixels(), fits::Pixels::U16(frame.image.pixels()));
        let stars = read_truth(fs::File::open(run.join("frame_000004.truth.csv")).unwrap()).unwrap();
        assert_eq!(stars, frame.truth);
        assert_eq!(listed(&run)[1], FrameRow::new(&frame, pixel_crc32(&frame.image)));
        assert!(run.join("frame_000008.png").exists() && !run.join("frame_000003.png").exists(), "every second");
    }

    #[test]
    fn an_earlier_recording_is_not_touched() {
        let directory = tempfile::tempdir().unwrap();
        Recorder::create(directory.path(), EVERYTHING).unwrap().send(&sample_frame(1)).unwrap();
        let error = Recorder::create(directory.path(), EVERYTHING).unwrap_err();
        assert!(matches!(error, SinkError::Occupied { .. }), "{error}");
        assert_eq!(listed(directory.path()).len(), 1);
    }

    #[test]
    fn a_directory_that_cannot_be_made_is_named() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("a_file");
        fs::write(&file, "in the way").unwrap();
        let error = Recorder::create(file.join("run"), EVERYTHING).unwrap_err();
        assert!(matches!(error, SinkError::Directory { .. }), "{error}");
        assert!(error.to_string().contains("a_file"), "{error}");
    }

    #[test]
    fn a_repeated_number_is_refused_and_the_first_stays() {
        let directory = tempfile::tempdir().unwrap();
        let mut recorder = Recorder::create(directory.path(), EVERYTHING).unwrap();
        recorder.send(&sample_frame(5)).unwrap();
        let before = fs::read(directory.path().join("frame_000005.fits")).unwrap();
        let mut other = sample_frame(6);
        other.meta.number = 5;
        let error = recorder.send(&other).unwrap_err();
        assert!(matches!(error, SinkError::FrameOrder { last: 5, got: 5, .. }), "{error}");
        assert_eq!(fs::read(directory.path().join("frame_000005.fits")).unwrap(), before);
    }

    #[test]
    fn a_sequence_holds_the_frames_that_are_listed() {
        let directory = tempfile::tempdir().unwrap();
        let options = RecorderOptions { fits: false, truth: false, ser: true, ..RecorderOptions::default() };
        let mut recorder = Recorder::create(directory.path(), options).unwrap();
        recorder.send(&sample_frame(1)).unwrap();
        recorder.send(&sample_frame(1)).unwrap_err();
        recorder.send(&sample_frame(2)).unwrap();
        assert_eq!(recorder.ser.as_ref().map(SerFile::frames), Some(2));
        let bytes = recorder.finish().unwrap().bytes;
        assert_eq!(recorder.finish().unwrap().bytes, bytes, "the trailer is counted once");
        let on_disk: u64 = fs::read_dir(directory.path()).unwrap().map(|e| e.unwrap().metadata().unwrap().len()).sum();
        assert_eq!(bytes, on_disk);
        assert_eq!(listed(directory.path()).len(), 2);
    }

    fn names_in(directory: &Path) -> Vec<String> {
        let entries = fs::read_dir(directory).unwrap();
        let mut names: Vec<String> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_that_cannot_be_written_costs_the_frame_and_leaves_none_of_its_files() {
        for blocked in ["fits", "truth.csv", "png"] {
            let directory = tempfile::tempdir().unwrap();
            let mut recorder = Recorder::create(directory.path(), EVERYTHING).unwrap();
            recorder.send(&sample_frame(1)).unwrap();
            let before = names_in(directory.path());
            let in_the_way = frame_path(directory.path(), 2, blocked);
            fs::create_dir(&in_the_way).unwrap();
            let error = recorder.send(&sample_frame(2)).unwrap_err();
            assert!(error.to_string().contains(&format!("frame_000002.{blocked}")), "{error}");
            fs::remove_dir(&in_the_way).unwrap();
            assert_eq!(names_in(directory.path()), before, "{blocked}: neither an image nor a truth table of frame 2");
            assert_eq!(listed(directory.path()).len(), 1, "not listed");
            recorder.send(&sample_frame(2)).expect("the way is free: the same frame may be tried again");
            let summary = recorder.finish().unwrap();
            assert_eq!((summary.frames, summary.refused), (2, 1));
        }
    }

    #[test]
    fn a_row_that_cannot_be_written_costs_the_frame_and_leaves_none_of_its_files() {
        let directory = tempfile::tempdir().unwrap();
        let mut recorder = Recorder::create(directory.path(), EVERYTHING).unwrap();
        recorder.send(&sample_frame(1)).unwrap();
        let before = names_in(directory.path());
        let log = std::mem::replace(&mut recorder.log, FrameLog::on_a_full_disk());
        let error = recorder.send(&sample_frame(2)).unwrap_err();
        assert!(matches!(&error, SinkError::Write { source, .. } if source.kind() == io::ErrorKind::StorageFull));
        assert_eq!(names_in(directory.path()), before);
        assert_eq!(recorder.ser.as_ref().map(SerFile::frames), Some(1));
        recorder.log = log;
        recorder.send(&sample_frame(2)).expect("space again");
        assert_eq!(listed(directory.path()).len(), 2);
    }

    #[test]
    fn a_pipe_a_link_or_a_strangers_file_at_a_frames_name_is_refused_and_stays() {
        let directory = tempfile::tempdir().unwrap();
        let victim = directory.path().join("victim");
        fs::write(&victim, "precious").unwrap();
        let mut recorder = Recorder::create(directory.path().join("run"), EVERYTHING).unwrap();
        let path = |number: u32| frame_path(&directory.path().join("run"), number, "fits");
        rustix::fs::mkfifoat(rustix::fs::CWD, path(1), rustix::fs::Mode::RWXU).unwrap();
        std::os::unix::fs::symlink(&victim, path(2)).unwrap();
        fs::write(path(3), "a stranger's").unwrap();
        for number in 1..=3 {
            let error = recorder.send(&sample_frame(number)).unwrap_err();
            assert!(matches!(error, SinkError::NameTaken { .. }), "{error}");
        }
        recorder.send(&sample_frame(4)).expect("the run goes on");
        assert_eq!(fs::read(&victim).unwrap(), b"precious");
        assert_eq!(fs::read(path(3)).unwrap(), b"a stranger's");
        assert_eq!(recorder.finish().unwrap().refused, 3);
    }
}
