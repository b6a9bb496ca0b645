//! The newest frame of each head, and the CRC-32 over all frames, as a client can request them.

use crate::wiring::control::answers::write_below;
use base::time::Tai;
use frames::sink::crc32::{RunCrc32, pixel_crc32};
use frames::sink::facts::{FactSource, json_keys};
use frames::sink::{SentFrame, fits};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Frames of all heads.
#[derive(Debug, Clone)]
pub struct NewestFrames {
    heads: Vec<HeadFrames>,
    /// Folder where files may be written.
    output: Option<PathBuf>,
}

#[derive(Debug, Clone, Default)]
struct HeadFrames {
    newest: Option<SentFrame>,
    /// CRC-32 of the newest frame's pixels.
    newest_crc32: u32,
    crc32: RunCrc32,
    out: u64,
}

impl NewestFrames {
    /// Returns an empty store for this many heads; frames may be written below `output`.
    pub fn new(heads: usize, output: Option<&Path>) -> Self {
        Self { heads: (0..heads).map(|_| HeadFrames::default()).collect(), output: output.map(Path::to_path_buf) }
    }

    /// Copies a frame that has gone out into the buffer of the previous one.
    pub(crate) fn keep(&mut self, head: usize, frame: &SentFrame) {
        let Some(kept) = self.heads.get_mut(head) else { return };
        kept.count(frame);
        match kept.newest.as_mut().filter(|old| old.image.pixels().len() == frame.image.pixels().len()) {
            Some(newest) => {
                newest.image.pixels_mut().copy_from_slice(frame.image.pixels());
                newest.truth.clone_from(&frame.truth);
                newest.meta.clone_from(&frame.meta);
            }
            None => kept.newest = Some(frame.clone()),
        }
    }

    /// Keeps a frame that has gone out and is not needed any more: its buffer is exchanged for that of the previous
    /// one, so that no pixel is copied.
    pub(crate) fn keep_exchanged(&mut self, head: usize, frame: &mut SentFrame) {
        let Some(kept) = self.heads.get_mut(head) else { return };
        kept.count(frame);
        match kept.newest.as_mut() {
            Some(newest) => core::mem::swap(newest, frame),
            None => kept.newest = Some(frame.clone()),
        }
    }

    /// Returns the newest frame of a head.
    pub(super) fn newest(&self, head: usize) -> Option<&SentFrame> {
        self.heads.get(head).and_then(|kept| kept.newest.as_ref())
    }

    /// Returns the CRC-32 over each head's frames so far, as its sink computes it.
    pub(super) fn frames_crc32(&self) -> Vec<u32> {
        self.heads.iter().map(|head| head.crc32.value()).collect()
    }

    /// Returns the number of frames that have gone out, all heads together.
    pub(super) fn out(&self) -> u64 {
        self.heads.iter().map(|head| head.out).sum()
    }

    /// Returns the number of frames of the first head that have gone out.
    pub(super) fn out_of_first_head(&self) -> u64 {
        self.heads.first().map_or(0, |head| head.out)
    }

    /// Returns the newest frame of a head, its pixels in the reply, in a new FITS file below the output folder, or
    /// nowhere.
    pub(super) fn answer(&self, head: usize, path: Option<&str>, pixels: bool, zero: Tai) -> Result<Value, String> {
        let heads = self.heads.len();
        let kept = self.heads.get(head).ok_or_else(|| format!("head is {head}; there are {heads}, counted from 0"))?;
        let frame = kept.newest.as_ref().ok_or("no frame has gone out yet; step first")?;
        let mut answer = described(frame, kept.newest_crc32, zero);
        match path {
            None if !pixels => {}
            None => {
                let bytes: Vec<u8> = frame.image.pixels().iter().flat_map(|dn| dn.to_le_bytes()).collect();
                answer["pixels_base64_u16_le"] = base::base64::encode(&bytes).into();
            }
            Some(path) => {
                let bytes = write_below(self.output.as_deref(), path, |out| fits::write_frame(out, frame))?;
                answer["path"] = path.into();
                answer["bytes"] = bytes.into();
            }
        }
        Ok(answer)
    }
}

impl HeadFrames {
    fn count(&mut self, frame: &SentFrame) {
        self.out += 1;
        self.newest_crc32 = pixel_crc32(&frame.image);
        self.crc32.add(frame.meta.number, self.newest_crc32);
    }
}

/// Returns the facts of a frame that [`frames::sink::facts`] defines for the control socket, and its time since the
/// run's zero.
fn described(frame: &SentFrame, crc32: u32, zero: Tai) -> Value {
    let source = FactSource::of_frame(frame, Some(crc32));
    let mut answer = Value::Object(json_keys(&source, |row| row.control));
    answer["mid_exposure_s"] = (frame.meta.mid_exposure - zero).s().into();
    answer["meta"] = json_keys(&source, |row| row.control_meta).into();
    answer
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::time::Span;
    use frames::sink::sample::{bare_sample_frame, compare_with_pinned, differs_from_pinned, sample_frame};

    #[test]
    fn answer_about_a_frame_is_as_pinned() {
        for (name, frame) in [("control.json", sample_frame(7)), ("control_bare.json", bare_sample_frame(8))] {
            let zero = frame.meta.mid_exposure - Span::from_ms(1250);
            let mut kept = NewestFrames::new(1, None);
            kept.keep(0, &frame);
            let head = &kept.heads[0];
            let answer = described(head.newest.as_ref().unwrap(), head.newest_crc32, zero);
            let text = serde_json::to_string_pretty(&answer).unwrap();
            compare_with_pinned(name, &(text.clone() + "\n")).unwrap();
            assert!(differs_from_pinned(name, &text.replace("number", "level")), "control: another key");
        }
    }

    #[test]
    fn an_exchanged_buffer_gives_the_same_answers_as_a_copy() {
        let (mut copied, mut exchanged) = (NewestFrames::new(1, None), NewestFrames::new(1, None));
        let mut answers = Vec::new();
        for number in 1..4 {
            let mut frame = sample_frame(number);
            frame.image.pixels_mut()[0] = number as u16;
            copied.keep(0, &frame);
            exchanged.keep_exchanged(0, &mut frame);
            let [a, b] = [&copied, &exchanged].map(|kept| kept.answer(0, None, true, Tai::from_ns(0)).unwrap());
            assert_eq!(a, b, "frame {number}");
            answers.push(a);
        }
        assert_eq!(copied.frames_crc32(), exchanged.frames_crc32());
        assert_ne!(answers[0], answers[1], "frames differ");
    }
}
