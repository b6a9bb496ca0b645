//! The scenes, as data: motion, PSF, number of stars.

/// A scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scene {
    /// Name in files.
    pub name: &'static str,
    /// Title.
    pub title: &'static str,
    /// Side of the detector, px.
    pub size_px: usize,
    /// PSF.
    pub psf: Psf,
    /// Time from row to row, s (0: global shutter).
    pub line_s: f64,
    /// Motion.
    pub motion: Movement,
    /// Stars.
    pub stars: Stars,
    /// True when its methods are compared in separate charts.
    pub is_charted: bool,
    /// Note about parts that a quick run leaves out.
    pub note: &'static str,
}

/// PSF of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Psf {
    /// Gaussian of this standard deviation, px.
    Gaussian(f64),
    /// Airy pattern: wavelength times F-number in px, obscuration.
    Airy(f64, f64),
}

/// Motion of a scene during its exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Movement {
    /// None.
    Still,
    /// Constant rate: px along x and y, and roll.
    Drift {
        /// Displacement along x and y, px.
        px: [f64; 2],
        /// Roll about the line of sight, rad.
        roll_rad: f64,
    },
    /// One sinusoid of the line of sight.
    Sinusoid {
        /// Amplitude, px.
        amplitude_px: f64,
        /// Cycles per exposure.
        cycles: f64,
    },
    /// A random path of 512 straight pieces: white up to a highest frequency.
    Wander {
        /// Rms along each axis, px.
        rms_px: f64,
        /// Highest frequency, cycles per exposure.
        most_cycles: u32,
    },
    /// Independent positions.
    Positions {
        /// Rms along each axis, px.
        rms_px: f64,
        /// Number of positions.
        count: u32,
    },
}

/// Stars of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stars {
    /// This many equal stars, well separated, corners of the detector included: for errors.
    Apart(usize),
    /// This many at random places: for times; errors from a few isolated ones.
    Field(usize),
}

/// No motion; other scenes differ from it.
pub const STILL: Scene = Scene {
    name: "still",
    title: "no motion",
    size_px: 128,
    psf: Psf::Gaussian(0.8),
    line_s: 0.0,
    motion: Movement::Still,
    stars: Stars::Apart(12),
    is_charted: false,
    note: "",
};

const LINE_3: Movement = Movement::Drift { px: [3.0, 0.9], roll_rad: 0.0 };

const ACCURACY: [Scene; 11] = [
    STILL,
    Scene { name: "line-3px", title: "line of 3 px", motion: LINE_3, is_charted: true, ..STILL },
    Scene {
        name: "line-20px",
        title: "line of 20 px",
        motion: Movement::Drift { px: [19.0, 6.2], roll_rad: 0.0 },
        ..STILL
    },
    Scene {
        name: "sinusoid-1px",
        title: "sinusoid of 1 px, 2.25 cycles",
        motion: Movement::Sinusoid { amplitude_px: 1.0, cycles: 2.25 },
        ..STILL
    },
    Scene {
        name: "sinusoid-3px",
        title: "sinusoid of 3 px, 10.3 cycles",
        motion: Movement::Sinusoid { amplitude_px: 3.0, cycles: 10.3 },
        is_charted: true,
        ..STILL
    },
    Scene {
        name: "random-1px",
        title: "random path of 1 px rms, up to 8 cycles",
        motion: Movement::Wander { rms_px: 1.0, most_cycles: 8 },
        is_charted: true,
        ..STILL
    },
    Scene {
        name: "random-fast",
        title: "random path of 2 px rms, up to 40 cycles",
        motion: Movement::Wander { rms_px: 2.0, most_cycles: 40 },
        ..STILL
    },
    Scene {
        name: "roll-2mrad",
        title: "roll of 2 mrad with a line of 3 px",
        size_px: 512,
        motion: Movement::Drift { px: [3.0, 0.9], roll_rad: 2e-3 },
        ..STILL
    },
    Scene { name: "rolling-slew", title: "rolling shutter, slew of 3 px", line_s: 2e-5, motion: LINE_3, ..STILL },
    Scene {
        name: "narrow-line-3px",
        title: "line of 3 px, sigma 0.3",
        psf: Psf::Gaussian(0.3),
        motion: LINE_3,
        ..STILL
    },
    Scene {
        name: "airy",
        title: "Airy pattern, no motion",
        psf: Psf::Airy(0.978_909, 0.3),
        stars: Stars::Apart(4),
        ..STILL
    },
];

const S1: Scene =
    Scene { name: "S1", title: "S1: 1024 x 1024, 100 stars", size_px: 1024, stars: Stars::Field(100), ..STILL };
const S2: Scene = Scene { name: "S2", title: "S2: 1024 x 1024, 5000 stars", stars: Stars::Field(5000), ..S1 };
const S3: Scene =
    Scene { name: "S3", title: "S3: 2048 x 2048, 100000 stars", size_px: 2048, stars: Stars::Field(100_000), ..S1 };
const S3_QUICK: Scene = Scene {
    title: "S3 reduced: 1024 x 1024, 25000 stars",
    size_px: 1024,
    stars: Stars::Field(25_000),
    note: "reduced to a quarter",
    ..S3
};
const S4: Scene = Scene {
    name: "S4",
    title: "S4: S2 with 64 positions of 1 px rms",
    motion: Movement::Positions { rms_px: 1.0, count: 64 },
    is_charted: true,
    ..S2
};

/// Returns all scenes; a quick run has a smaller S3.
pub fn scenes(quick: bool) -> Vec<Scene> {
    let s3 = if quick { S3_QUICK } else { S3 };
    ACCURACY.into_iter().chain([S1, S2, s3, S4]).collect()
}

impl Scene {
    /// Returns true when only the time is of interest.
    pub fn is_for_speed(&self) -> bool {
        matches!(self.stars, Stars::Field(_))
    }

    /// Returns a scene without motion, through a Gaussian of `sigma_px`.
    pub fn still(sigma_px: f64) -> Self {
        Self { psf: Psf::Gaussian(sigma_px), ..STILL }
    }
}
