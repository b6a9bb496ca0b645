//! The newest frame of each head, and the CRC-32 over all of them, for a client to ask for.

use crate::wiring::control::base64;
use crate::wiring::control::output::write_below;
use base::time::Tai;
use frames::sink::crc32::{RunCrc32, pixel_crc32};
use frames::sink::{FrameMeta, SentFrame, fits};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Frames of all heads.
#[derive(Debug)]
pub struct NewestFrames {
    heads: Vec<HeadFrames>,
    /// Where files may be written.
    output: Option<PathBuf>,
}

#[derive(Debug, Default)]
struct HeadFrames {
    newest: Option<SentFrame>,
    crc32: RunCrc32,
    out: u64,
}

impl NewestFrames {
    /// Of so many heads; frames may be written below `output`.
    #[must_use]
    pub fn new(heads: usize, output: Option<&Path>) -> Self {
        Self { heads: (0..heads).map(|_| HeadFrames::default()).collect(), output: output.map(Path::to_path_buf) }
    }

    /// Keeps a frame that has gone out, in the buffer of the one before.
    pub(crate) fn keep(&mut self, head: usize, frame: &SentFrame) {
        let Some(kept) = self.heads.get_mut(head) else { return };
        kept.out += 1;
        kept.crc32.add(frame.meta.number, pixel_crc32(&frame.image));
        match kept.newest.as_mut().filter(|old| old.image.pixels().len() == frame.image.pixels().len()) {
            Some(newest) => {
                newest.image.pixels_mut().copy_from_slice(frame.image.pixels());
                newest.truth.clone_from(&frame.truth);
                newest.meta.clone_from(&frame.meta);
            }
            None => kept.newest = Some(frame.clone()),
        }
    }

    /// CRC-32 over each head's frames so far, as its sink has it.
    pub(super) fn frames_crc32(&self) -> Vec<u32> {
        self.heads.iter().map(|head| head.crc32.value()).collect()
    }

    /// Frames that have gone out, all heads together.
    pub(super) fn out(&self) -> u64 {
        self.heads.iter().map(|head| head.out).sum()
    }

    /// Frames of the first head that have gone out.
    pub(super) fn out_of_first_head(&self) -> u64 {
        self.heads.first().map_or(0, |head| head.out)
    }

    /// The newest frame of a head, its pixels in the reply or in a new FITS file below the output folder.
    pub(super) fn answer(&self, head: usize, path: Option<&str>, zero: Tai) -> Result<Value, String> {
        let heads = self.heads.len();
        let kept = self.heads.get(head).ok_or_else(|| format!("head is {head}; there are {heads}, counted from 0"))?;
        let frame = kept.newest.as_ref().ok_or("no frame has gone out yet; step first")?;
        let mut answer = described(frame, zero);
        match path {
            None => {
                let bytes: Vec<u8> = frame.image.pixels().iter().flat_map(|dn| dn.to_le_bytes()).collect();
                answer["pixels_base64_u16_le"] = base64::encode(&bytes).into();
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

fn described(frame: &SentFrame, zero: Tai) -> Value {
    let faults: Vec<&str> = frame.meta.faults.names().collect();
    json!({
        "number": frame.meta.number,
        "mid_exposure_s": (frame.meta.mid_exposure - zero).s(),
        "width": frame.image.width(),
        "height": frame.image.height(),
        "faults": faults,
        "crc32": format!("{:08x}", pixel_crc32(&frame.image)),
        "meta": meta(&frame.meta, frame.truth.len()),
    })
}

fn meta(meta: &FrameMeta, stars: usize) -> Value {
    json!({
        "mid_exposure_utc": meta.mid_exposure.to_rfc3339(),
        "exposure_s": meta.exposure_s,
        "attitude_wxyz": meta.attitude_wxyz,
        "ra_deg": meta.ra_deg,
        "dec_deg": meta.dec_deg,
        "roll_deg": meta.roll_deg,
        "rate_deg_s": meta.rate_deg_s,
        "attitude_age_s": meta.attitude_age.s(),
        "horizon_s": meta.horizon.s(),
        "origin": meta.origin,
        "method": meta.method,
        "rung": meta.rung,
        "backend": meta.backend,
        "camera": &*meta.camera,
        "gain_e_per_dn": meta.gain_e_per_dn,
        "black_level_dn": meta.black_level_dn,
        "stars": stars,
    })
}
