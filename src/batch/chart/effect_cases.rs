//! The effects whose cost is charted, as data: a name and a change that switches it on.

use base::{bayer::BayerPattern, time::Tai};
use image::detector::binning::{Binning, BinningKind};
use image::detector::charge_transfer::{ChargeTransfer, OutputCorner};
use image::detector::protons::{ProtonDirection, ProtonFlux};
use image::detector::{Background, DetectorParams, LinePattern, Nonlinearity, Rounding, RowNoise};
use image::detector::{
    blooming::Blooming, defects::population::DefectPopulation, image_lag::ImageLag, pattern::ColourFilter, tdi::Tdi,
    window::Window,
};
use plan::exposure::{Instrument, Target, TargetCurve, TargetPath, TargetWay};
use plan::optics::{Illumination, PsfModel};
use plan::{
    exposure::planner::Planner, exposure::target::FIRST_TARGET_ID, optics::illumination::Vignetting,
    optics::psf_field::PsfField,
};
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};

/// Change that switches an effect of the detector on.
#[derive(Debug, Clone, Copy)]
pub enum Switch {
    /// Its parameters.
    Params(fn(&mut DetectorParams)),
    /// Light besides the stars, and true when the image plane is lit unevenly.
    Background(Background, bool),
}

/// Change that switches an effect of drawing on.
#[derive(Debug, Clone, Copy)]
pub enum DrawingSwitch {
    /// A change of the instrument.
    Instrument(fn(&mut Instrument)),
    /// A change of the planner.
    Planner(fn(&mut Planner)),
}

/// Detector effects besides shot noise and conversion.
pub const DETECTOR: [(&str, Switch); 22] = [
    ("background, the same everywhere", Switch::Background(Background::uniform(20.0), false)),
    ("background with a shape", Switch::Background(SHAPED, false)),
    ("sky through uneven illumination", Switch::Background(SKY, true)),
    ("colour filter", Switch::Params(|params| params.spatial.colour_filter = Some(FILTER))),
    ("PRNU", Switch::Params(|params| params.prnu = 0.01)),
    ("dark current", Switch::Params(|params| params.dark_e_per_s = 100.0)),
    ("dark current, uneven", Switch::Params(|params| (params.dark_e_per_s, params.dark_nonuniformity) = (100.0, 0.1))),
    ("defects, 1 in 1000", Switch::Params(|params| params.spatial.defects = SOME_DEFECTS)),
    ("protons, 1e4 per cm2 and s", Switch::Params(|params| params.spatial.protons = Some(STORM))),
    ("image lag", Switch::Params(|params| params.spatial.image_lag = Some(ImageLag { share: 0.01 }))),
    ("blooming", Switch::Params(|params| params.spatial.blooming = Some(Blooming { drained_share: 0.0 }))),
    ("charge transfer", Switch::Params(|params| params.spatial.charge_transfer = Some(POOR_TRANSFER))),
    ("binning of charge, 2 x 2", Switch::Params(|params| params.spatial.binning = Some(BINNING))),
    ("time-delayed integration, 16", Switch::Params(|params| params.spatial.tdi = Some(Tdi { stages: 16 }))),
    ("nonlinear response", Switch::Params(|params| params.nonlinearity = bent())),
    ("columns and rows", Switch::Params(|params| params.line_pattern = LINES)),
    ("DSNU", Switch::Params(|params| params.dsnu_e_rms = 2.0)),
    ("row noise with 1/f", Switch::Params(|params| params.row_noise = ROWS)),
    ("read noise", Switch::Params(|params| params.read_noise_e_rms = 5.0)),
    ("amplifier noise", Switch::Params(|params| params.amplifier_noise_e_rms = 5.0)),
    ("truncation", Switch::Params(|params| params.rounding = Rounding::Truncate)),
    ("window, a quarter", Switch::Params(|params| params.spatial.window = Some(QUARTER))),
];

/// Drawing effects besides round Gaussians of stars on an even image plane.
pub const DRAWING: [(&str, DrawingSwitch); 8] = [
    ("wide Gaussian", DrawingSwitch::Instrument(|instrument| instrument.psf = PsfModel::gaussian(3.0))),
    ("Airy pattern", DrawingSwitch::Instrument(|instrument| instrument.psf = PsfModel::airy(1.5, 0.3))),
    ("Moffat", DrawingSwitch::Instrument(|instrument| instrument.psf = PsfModel::moffat(1.2, 3.5))),
    (
        "PSF of the field, 2 x 2 cells",
        DrawingSwitch::Instrument(|instrument| instrument.psf = over_the_field(instrument)),
    ),
    ("relative illumination", DrawingSwitch::Instrument(|instrument| instrument.illumination = UNEVEN)),
    ("distortion", DrawingSwitch::Instrument(distort)),
    ("rolling shutter, at rest", DrawingSwitch::Instrument(|instrument| instrument.shutter = ROLLING)),
    ("ten targets, 3 px", DrawingSwitch::Planner(|planner| planner.set_targets(ten_targets()))),
];

const SHAPED: Background = Background { gradient_e: [5.0, -3.0], quadratic_e: 4.0, ..Background::uniform(20.0) };
const SKY: Background = Background { sky_e: 20.0, ..Background::DARK };
const SOME_DEFECTS: DefectPopulation =
    DefectPopulation { hot_share: 1e-3, hot_e_per_s: 500.0, ..DefectPopulation::NONE };
const STORM: ProtonFlux = ProtonFlux { per_cm2_s: 1e4, energy_mev: 50.0, direction: ProtonDirection::Isotropic };
const POOR_TRANSFER: ChargeTransfer =
    ChargeTransfer { parallel_share: 1e-4, serial_share: 1e-5, corner: OutputCorner::TopLeft };
const BINNING: Binning = Binning { factor: 2, kind: BinningKind::Charge { full_well_e: 4e7 } };
const FILTER: ColourFilter = ColourFilter { pattern: BayerPattern::Rggb, red: 0.35, green: 0.45, blue: 0.25 };
const LINES: LinePattern = LinePattern { column_e_rms: 2.0, column_gain_rms: 0.005, row_e_rms: 1.0 };
const ROWS: RowNoise = RowNoise { e_rms: 2.0, corner_cycles_per_row: 0.01 };
const QUARTER: Window = Window { left_px: 64, top_px: 64, width_px: 128, height_px: 128 };
const ROLLING: plan::exposure::Shutter = plan::exposure::Shutter::Rolling { line_s: 2e-5 };
const UNEVEN: Illumination = Illumination {
    vignetting: Some(Vignetting { window_radius_mm: 20.0, pupil_radius_mm: 18.0, distance_mm: 30.0 }),
    cos4: true,
    unblocked: 0.9,
};

fn bent() -> Nonlinearity {
    Nonlinearity::through(&[[1e4, 1e4], [2e4, 1.95e4], [4e4, 3.7e4]]).unwrap_or(Nonlinearity::OFF)
}

/// Returns a field of nine PSFs, sharper in the middle.
fn over_the_field(instrument: &Instrument) -> PsfModel {
    let size_px = [instrument.camera.width_px(), instrument.camera.height_px()];
    let node = |i: u32| PsfModel::moffat(1.2 + 0.1 * f64::from((i % 3).abs_diff(1) + (i / 3).abs_diff(1)), 3.5);
    PsfField::new([3, 3], size_px, (0..9).map(node).collect()).map_or(instrument.psf.clone(), PsfModel::field)
}

fn distort(instrument: &mut Instrument) {
    let distortion = BrownConrady { k1: -0.1, ..BrownConrady::default() };
    let parameters = CameraParameters { distortion, ..*instrument.camera.parameters() };
    if let Ok(camera) = CameraGeometry::new(parameters) {
        instrument.camera = camera;
    }
}

fn ten_targets() -> Vec<Target> {
    let target = |i: u32| Target {
        id: FIRST_TARGET_ID + i,
        mag: f32::NAN,
        e_per_s: 1e6,
        begin: Tai::from_ns(-1_000_000_000),
        end: Tai::from_ns(1_000_000_000),
        way: TargetWay::Script(TargetPath {
            position_px: [20.0 * f64::from(i) + 20.0, 100.0],
            velocity_px_s: [20.0, 22.0],
            curve: TargetCurve::Straight,
        }),
        light: None,
    };
    (0..10).map(target).collect()
}
