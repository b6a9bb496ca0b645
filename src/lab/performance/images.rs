//! Images beside FITS for a program under test: PNG with the DN in 16 bits, or with 8 bits on a linear scale.
//!
//! In: frames. Out: `frame_000012.png`. One scale holds for all frames of a flight and is in its report, so that a grey
//! is a number of DN: PNGs of a recorder are stretched for people, each in its own way.

use anyhow::{Error, Result, bail};
use base::image::DnImage;
use config::Camera;
use core::{fmt, str::FromStr};
use frames::sink::png::{write_dn_raw, write_grey8};
use frames::sink::recorder::frame_path;
use frames::sink::{Recorder, SentFrame, Sink, SinkError, SinkSummary, write_new_file};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Noise below the black level of the camera that 8 bits still show, in standard deviations.
const NOISE_SHOWN: f64 = 5.0;

/// Images that a program gets beside FITS.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ImageForm {
    /// 8 bits; the camera's own scale where none is given.
    Png8(Option<LinearScale>),
    /// 16 bits: DN as they are.
    Png16,
}

/// Grey of a DN: its distance from black in steps, rounded and kept within 0 to 255.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearScale {
    black_dn: f64,
    dn_per_grey: f64,
}

impl LinearScale {
    /// Returns a scale that shows the whole read noise of a camera, in steps of half of it and of one DN at least.
    pub fn of_camera(camera: &Camera) -> Self {
        let detector = &camera.detector.params;
        let noise_dn = detector.read_noise_e_rms / detector.gain_e_per_dn;
        Self {
            black_dn: (detector.black_level_dn - NOISE_SHOWN * noise_dn).floor().max(0.0),
            dn_per_grey: (0.5 * noise_dn).round().max(1.0),
        }
    }

    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "kept within 0 to 255")]
    fn grey(self, dn: u16) -> u8 {
        ((f64::from(dn) - self.black_dn) / self.dn_per_grey).round().clamp(0.0, 255.0) as u8
    }
}

impl ImageForm {
    /// Returns the form with its scale: `usual` where none was given.
    #[must_use]
    pub fn settled(self, usual: LinearScale) -> Self {
        match self {
            Self::Png8(scale) => Self::Png8(Some(scale.unwrap_or(usual))),
            Self::Png16 => self,
        }
    }
}

impl FromStr for ImageForm {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let scale = |numbers: &str| {
            let (black, step) = numbers.split_once(',')?;
            let scale = LinearScale { black_dn: black.parse().ok()?, dn_per_grey: step.parse().ok()? };
            let is_good = scale.black_dn.is_finite() && scale.dn_per_grey > 0.0 && scale.dn_per_grey.is_finite();
            is_good.then_some(scale)
        };
        let given = text.strip_prefix("png8:").map(scale);
        match (text, given) {
            ("png8", _) => Ok(Self::Png8(None)),
            ("png16", _) => Ok(Self::Png16),
            (_, Some(Some(scale))) => Ok(Self::Png8(Some(scale))),
            _ => bail!("wanted png16, png8, or png8:BLACK,STEP: the DN of grey 0 and the DN of one grey, above 0"),
        }
    }
}

impl fmt::Display for ImageForm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Png16 => write!(f, "FITS, and PNG of 16 bits with the DN as they are"),
            Self::Png8(None) => write!(f, "FITS, and PNG of 8 bits"),
            Self::Png8(Some(LinearScale { black_dn, dn_per_grey })) => write!(
                f,
                "FITS, and PNG of 8 bits: grey = (DN - {black_dn}) / {dn_per_grey}, rounded, 0 to 255; white from {} DN",
                black_dn + 255.0 * dn_per_grey
            ),
        }
    }
}

/// A recorder with such images beside its own.
pub(crate) struct WithImages {
    recorder: Recorder,
    folder: PathBuf,
    /// The grey of each DN; none of 16 bits.
    greys: Option<Vec<u8>>,
}

impl WithImages {
    pub(crate) fn new(recorder: Recorder, folder: &Path, form: ImageForm) -> Self {
        let greys = match form {
            ImageForm::Png8(Some(scale)) => Some((0..=u16::MAX).map(|dn| scale.grey(dn)).collect()),
            ImageForm::Png8(None) | ImageForm::Png16 => None,
        };
        Self { recorder, folder: folder.into(), greys }
    }

    fn write(&self, out: &mut dyn Write, image: &DnImage) -> io::Result<()> {
        let Some(greys) = &self.greys else { return write_dn_raw(out, image) };
        let bytes: Vec<u8> = image.pixels().iter().map(|dn| greys[usize::from(*dn)]).collect();
        write_grey8(out, [image.width(), image.height()], &bytes)
    }
}

impl Sink for WithImages {
    fn name(&self) -> &'static str {
        self.recorder.name()
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        // The image comes first: a frame that is listed is complete.
        write_new_file(&frame_path(&self.folder, frame.meta.number, "png"), |out| self.write(out, &frame.image))?;
        self.recorder.send(frame)
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        self.recorder.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use frames::sink::{RecorderOptions, sample::sample_frame};

    #[test]
    fn greys_are_linear_and_the_scale_is_said() {
        let form: ImageForm = "png8:50,2".parse().unwrap();
        let scale = LinearScale { black_dn: 50.0, dn_per_grey: 2.0 };
        assert_eq!(form, ImageForm::Png8(Some(scale)));
        let greys = [0, 49, 50, 54, 250, 450, 560, 4095].map(|dn| scale.grey(dn));
        assert_eq!(greys, [0, 0, 0, 2, 100, 200, 255, 255]);
        let other = LinearScale { black_dn: 50.0, dn_per_grey: 4.0 };
        assert_ne!(other.grey(250), scale.grey(250), "control: another scale");
        assert_eq!(
            form.to_string(),
            "FITS, and PNG of 8 bits: grey = (DN - 50) / 2, rounded, 0 to 255; white from 560 DN"
        );
        for wrong in ["png", "png8:", "png8:5", "png8:a,1", "png8:5,0", "png8:5,-1", "png8:5,inf", "png16:5,1"] {
            assert!(wrong.parse::<ImageForm>().unwrap_err().to_string().contains("wanted png16"), "{wrong}");
        }
    }

    #[test]
    fn every_frame_has_its_image_of_the_asked_for_depth() {
        let options = RecorderOptions { fits: true, truth: false, png_every: 0, ser: false };
        let camera = Camera::from_document(&config::Document::open("cameras/small_tracker.toml".as_ref()).unwrap());
        let usual = LinearScale::of_camera(&camera.unwrap());
        for (form, depth) in [("png8", 8), ("png16", 16)] {
            let folder = tempfile::tempdir().unwrap();
            let recorder = Recorder::create(folder.path(), options).unwrap();
            let form = form.parse::<ImageForm>().unwrap().settled(usual);
            let mut sink = WithImages::new(recorder, folder.path(), form);
            sink.send(&sample_frame(3)).unwrap();
            assert_eq!(sink.finish().unwrap().frames, 1);
            let bytes = std::fs::read(folder.path().join("frame_000003.png")).unwrap();
            assert_eq!((&bytes[1..4], bytes[24]), (b"PNG".as_slice(), depth), "the depth is in byte 24");
            assert!(folder.path().join("frame_000003.fits").exists());
        }
    }

    #[test]
    fn usual_scale_shows_the_noise_around_the_black_level() {
        let mut camera =
            Camera::from_document(&config::Document::open("cameras/small_tracker.toml".as_ref()).unwrap()).unwrap();
        let noise = |camera: &Camera| camera.detector.params.read_noise_e_rms / camera.detector.params.gain_e_per_dn;
        let scale = LinearScale::of_camera(&camera);
        let below_dn = camera.detector.params.black_level_dn - scale.black_dn;
        assert!((0.0..1.0 + 1e-9).contains(&(below_dn - 5.0 * noise(&camera) + 1e-10)), "{scale:?}");
        camera.detector.params.read_noise_e_rms *= 20.0;
        assert!(LinearScale::of_camera(&camera).dn_per_grey > scale.dn_per_grey, "control: a noisy camera");
    }
}
