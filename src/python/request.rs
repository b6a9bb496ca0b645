//! Request for an image from Python: keywords of `Camera.render` as JSON.

use base::axes::{Icrf, Rotation, Sensor, WRITTEN_NORM_TOLERANCE, sensor_from_ra_dec_roll};
use base::time::{Span, Tai};
use base::units::ARCSEC;
use batch::still::{DEFAULT_TIME, MOST_DEG_PER_S, MOST_ELECTRONS};
use glam::DVec3;
use plan::attitude::LosPath;
use plan::exposure::{Motion, PixelPath, PixelPoint, Source, SourcePlace};
use serde::Deserialize;
use serde_json::{Map, Value};

/// Keywords of one image.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Request {
    /// `sensor_from_icrf`, scalar first.
    attitude: Option<[f64; 4]>,
    /// The boresight and the position angle of the image's up direction, deg.
    pointing_deg: Option<[f64; 3]>,
    /// The middle of the exposure, RFC 3339.
    time: Option<String>,
    /// Sensor axes, deg/s.
    rate_deg_s: Option<[f64; 3]>,
    /// Rows of t_s, dx_px, dy_px, roll_arcsec.
    los: Option<Vec<[f64; 4]>>,
    /// Rows of x_px, y_px, electrons in place of the sky.
    sources: Option<Vec<[f64; 3]>>,
    pub(crate) frame: u32,
    pub(crate) stage: Stage,
    pub(crate) scene: SceneKeys,
}

/// Keywords that change what must be prepared: images that share them share the preparation.
#[derive(Debug, Clone, Default, Deserialize, PartialEq)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct SceneKeys {
    /// Tables of a bench: observer, sky, target, accuracy, render.
    pub(crate) bench: Map<String, Value>,
    /// Faults, each as the keys of an event.
    pub(crate) faults: Vec<Map<String, Value>>,
    pub(crate) seed: Option<u64>,
    pub(crate) noise_seed: Option<u64>,
}

/// How far an image is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Stage {
    /// Digital numbers.
    #[default]
    Dn,
    /// Mean electrons before the detector.
    Electrons,
}

impl Request {
    /// Reads the keywords.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        serde_json::from_str(text).map_err(|error| error.to_string())
    }

    /// Returns the middle of the exposure.
    pub(crate) fn at(&self) -> Result<Tai, String> {
        Tai::from_rfc3339(self.time.as_deref().unwrap_or(DEFAULT_TIME)).map_err(|why| format!("time: {why}"))
    }

    /// Returns whether the image is of the sky, or of given sources at a known attitude.
    pub(crate) fn has_attitude(&self) -> bool {
        self.attitude.is_some() || self.pointing_deg.is_some()
    }

    fn sensor_from_icrf(&self) -> Result<Rotation<Sensor, Icrf>, String> {
        match (self.attitude, self.pointing_deg) {
            (Some(_), Some(_)) => Err("attitude and ra, dec: got both, wanted one of them".into()),
            (Some(wxyz), None) => Rotation::from_wxyz(wxyz, WRITTEN_NORM_TOLERANCE)
                .ok_or_else(|| format!("attitude: got {wxyz:?}, wanted a quaternion w, x, y, z of norm 1")),
            (None, Some(deg)) => {
                let [ra, dec, roll] = deg.map(f64::to_radians);
                let is_fine = deg.iter().all(|deg| deg.is_finite()) && deg[1].abs() <= 90.0;
                let refuse = || format!("ra, dec, roll: got {deg:?}, wanted finite degrees and dec from -90 to 90");
                is_fine.then(|| sensor_from_ra_dec_roll(ra, dec, roll)).ok_or_else(refuse)
            }
            (None, None) if self.sources.is_some() => Ok(Rotation::IDENTITY),
            (None, None) => Err("wanted attitude, or ra and dec, or sources".into()),
        }
    }

    /// Returns the motion of the image during an exposure of this length.
    pub(crate) fn motion(&self, exposure_s: f64) -> Result<Motion, String> {
        let start = self.at()? - Span::from_s(0.5 * exposure_s);
        let mut los = LosPath::commanded(self.sensor_from_icrf()?, start, exposure_s);
        let rate_deg_s = DVec3::from_array(self.rate_deg_s.unwrap_or_default());
        if !rate_deg_s.is_finite() || rate_deg_s.length() > MOST_DEG_PER_S {
            return Err(format!("rate: got {} deg/s, wanted at most {MOST_DEG_PER_S}", rate_deg_s.length()));
        }
        los.rate_rad_s = rate_deg_s * 1_f64.to_radians();
        let point = |[t_s, dx_px, dy_px, roll]: &[f64; 4]| PixelPoint {
            t_s: *t_s,
            dx_px: *dx_px,
            dy_px: *dy_px,
            roll_rad: roll * ARCSEC,
        };
        let path = |rows: &Vec<[f64; 4]>| PixelPath::line(rows.iter().map(point).collect(), exposure_s);
        let image_path = self.los.as_ref().map(path).transpose().map_err(|error| format!("los: {error}"))?;
        Ok(Motion { los, image_path })
    }

    /// Returns given sources; `None` for the sky.
    pub(crate) fn sources(&self) -> Result<Option<Vec<Source>>, String> {
        let source = |(i, row): (usize, &[f64; 3])| {
            let [x, y, electrons] = *row;
            let is_fine = x.is_finite() && y.is_finite() && (0.0..=MOST_ELECTRONS).contains(&electrons);
            let refuse =
                || format!("sources: row {i}: got {row:?}, wanted places in px and 0 to {MOST_ELECTRONS:e} electrons");
            let id = u32::try_from(i).map_err(|_| refuse())?;
            is_fine
                .then_some(Source { id, electrons, mag: f32::NAN, place: SourcePlace::Pixel([x, y]) })
                .ok_or_else(refuse)
        };
        self.sources.as_ref().map(|rows| rows.iter().enumerate().map(source).collect()).transpose()
    }
}
