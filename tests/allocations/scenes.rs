//! Scenes that slew, so that the number of stars changes from frame to frame, by every method and shutter.

use base::time::{Span, Tai};
use base::{accuracy::AccuracyBudget, axes::Rotation, image::DnImage, random::philox};
use glam::DVec3;
use image::detector::defects::{Defect, DefectKind, DefectPlace, DefectPopulation, Rates};
use image::detector::protons::{ProtonDirection, ProtonFlux};
use image::detector::{
    Detector, DetectorConditions, DetectorParams, LinePattern, Nonlinearity, RowNoise, SpatialParams,
};
use image::detector::{blooming::Blooming, charge_transfer::ChargeTransfer, image_lag::ImageLag};
use image::{gpu::Electrons, render::Backend, render::cpu::Cpu};
use plan::attitude::{JitterPoint, LosPath};
use plan::exposure::cost::CostModel;
use plan::exposure::{Degradation, Instrument, MethodChoice, Planner, PsfSampling, Shutter, Source, SourcePlace};
use plan::optics::{Illumination, PsfModel};
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};

/// Number of frames after which nothing may be allocated.
pub(crate) const WARM_UP: u32 = 10;
/// Number of all frames.
pub(crate) const FRAMES: u32 = 40;
const SIZE: usize = 256;
/// Largest error of a jitter sample.
const FURTHEST_PX: f64 = 3_000.0;
const EXPOSURE_S: f64 = 0.1;

/// One scene, its method and its shutter.
pub(crate) struct Scene {
    pub(crate) name: &'static str,
    psf: PsfModel,
    shutter: Shutter,
    method: &'static str,
    rate_rad_s: [f64; 3],
    time_budget_ms: Option<f64>,
    /// True when the detector runs in two passes.
    keep_charge: bool,
    /// True when defects, protons and the effects of neighbours are on, and defects change.
    is_disturbed: bool,
    /// True when a jitter sample of a frame is wrong, by more in some frames than in any before.
    is_damaged: bool,
}

/// Returns all scenes.
pub(crate) fn all() -> Vec<Scene> {
    let scene = |name, method| Scene {
        name,
        psf: PsfModel::gaussian(0.8),
        shutter: Shutter::Global,
        method,
        rate_rad_s: [0.02, 0.05, 0.01],
        time_budget_ms: None,
        keep_charge: false,
        is_disturbed: false,
        is_damaged: false,
    };
    let damaged = |name| Scene { is_damaged: true, time_budget_ms: Some(20.0), ..scene(name, "auto") };
    let rolling = Shutter::Rolling { line_s: 2e-4 };
    let airy = PsfModel::airy(1.2, 0.0);
    let airy_again = airy.clone();
    vec![
        Scene { rate_rad_s: [0.0; 3], ..scene("still", "auto") },
        scene("slewing", "auto"),
        scene("samples", "samples:32"),
        scene("segments", "segments:16"),
        scene("gaussian", "gaussian"),
        scene("effective PSF", "effective-psf:32"),
        scene("zonal PSF", "zonal-psf:32"),
        Scene { shutter: rolling, ..scene("rolling shutter", "auto") },
        Scene { shutter: rolling, ..scene("rolling shutter, zonal PSF", "zonal-psf:32") },
        Scene { psf: airy.clone(), rate_rad_s: [0.0; 3], ..scene("Airy, still", "auto") },
        Scene { psf: airy, ..scene("Airy, effective PSF", "effective-psf:16") },
        Scene { keep_charge: true, ..scene("detector in two passes", "auto") },
        Scene { is_disturbed: true, ..scene("defects, protons, neighbours", "auto") },
        damaged("damaged jitter"),
        Scene { psf: airy_again, ..damaged("damaged jitter, Airy") },
        Scene { shutter: rolling, ..damaged("damaged jitter, rolling shutter") },
        Scene { time_budget_ms: Some(0.1), ..scene("little time", "auto") },
        Scene { time_budget_ms: Some(0.0), ..scene("no time", "auto") },
    ]
}

/// A scene with all objects to draw it.
pub(crate) struct Drawn {
    planner: Planner,
    backend: Cpu,
    detector: Detector,
    is_disturbed: bool,
    is_damaged: bool,
    sources: Vec<Source>,
    image: DnImage,
}

impl Drawn {
    pub(crate) fn new(scene: &Scene) -> Self {
        let camera = CameraGeometry::new(CameraParameters {
            width_px: SIZE,
            height_px: SIZE,
            focal_px: [800.0; 2],
            principal_point_px: [127.5; 2],
            distortion: BrownConrady { k1: -0.05, ..Default::default() },
        })
        .unwrap();
        let instrument = Instrument {
            camera,
            shutter: scene.shutter,
            psf: scene.psf.clone(),
            sampling: PsfSampling::Auto,
            illumination: Illumination::EVEN,
            full_well_e: 1e5,
            read_noise_e_rms: 10.0,
        };
        let mut los = LosPath::commanded(Rotation::IDENTITY, Tai::from_ns(0), EXPOSURE_S);
        los.rate_rad_s = DVec3::from_array(scene.rate_rad_s);
        let method: MethodChoice = scene.method.parse().unwrap();
        let mut planner = Planner::new(instrument, AccuracyBudget::default(), CostModel::CPU, method, los);
        if let Some(time_budget_ms) = scene.time_budget_ms {
            planner = planner.within_ms(time_budget_ms).down_to(Degradation::BrightStarsOnly);
        }
        let params = DetectorParams {
            full_well_e: 1e5,
            gain_e_per_dn: 2.0,
            bits: 16,
            black_level_dn: 100.0,
            read_noise_e_rms: 10.0,
            dark_e_per_s: 1.0,
            prnu: 0.01,
            dsnu_e_rms: 1.0,
            dark_nonuniformity: 0.1,
            amplifier_noise_e_rms: 3.0,
            nonlinearity: Nonlinearity::through(&[[1e4, 9.9e3], [5e4, 4.8e4]]).unwrap(),
            line_pattern: LinePattern { column_e_rms: 1.0, column_gain_rms: 0.001, row_e_rms: 1.0 },
            row_noise: RowNoise { e_rms: 1.0, corner_cycles_per_row: 0.1 },
            spatial: if scene.is_disturbed { disturbed() } else { SpatialParams::OFF },
            ..DetectorParams::QUIET
        };
        let mut detector = Detector::new(params, SIZE, SIZE, 1);
        if scene.keep_charge {
            detector.keep_charge();
        }
        Self {
            planner,
            backend: Cpu::new(SIZE, SIZE),
            detector,
            is_disturbed: scene.is_disturbed,
            is_damaged: scene.is_damaged,
            sources: (0..20_000).map(source).collect(),
            image: DnImage::new(SIZE, SIZE),
        }
    }

    /// Draws frame `number`: the field drifts, and its edges gain and lose stars.
    pub(crate) fn frame(&mut self, number: u32) {
        // More and fewer in turn, but only slightly more than in the first frames.
        let stars = 3_000 + 750 * usize::try_from(number % 5).unwrap();
        let drift_px = 0.7 * f64::from(number);
        for (i, source) in self.sources.iter_mut().enumerate() {
            let SourcePlace::Pixel(px) = &mut source.place else { continue };
            px[0] = place(u32::try_from(i).unwrap(), 0) + drift_px - 60.0;
        }
        if self.is_disturbed {
            self.change_defects(number);
        }
        if self.is_damaged {
            self.damage_jitter(number);
        }
        let plan = self.planner.plan(&self.sources[..stars]);
        self.backend.render(plan).unwrap();
        let Electrons::Host(mean) = self.backend.electrons() else { panic!("the CPU draws in memory") };
        self.detector.collect(mean, number, &DetectorConditions::dark(EXPOSURE_S), &mut self.image);
    }

    /// Replaces the jitter: 50 samples of half a pixel, one of them wrong by up to [`FURTHEST_PX`].
    fn damage_jitter(&mut self, number: u32) {
        let points = &mut self.planner.motion_mut().los.jitter.points;
        points.clear();
        let off_px = FURTHEST_PX * (-0.3 * f64::from(FRAMES - 1 - number)).exp2();
        for i in 0..50_u32 {
            let [x, y] = [0, 1].map(|axis| place(1000 * number + i, axis) / 400.0);
            let size_px = if i == number % 50 { off_px } else { 0.5 };
            points.push(JitterPoint {
                at: Tai::from_ns(0) + Span::from_s(EXPOSURE_S * f64::from(i) / 49.0),
                rotation_rad: DVec3::new(x, y, 0.0) * (size_px / 800.0),
            });
        }
    }

    /// Adds a column, and removes the oldest commanded defect.
    fn change_defects(&mut self, number: u32) {
        let defects = self.detector.disturbances_mut().defects_mut();
        let (place, kind) = (DefectPlace::Column(number), DefectKind::Hot { extra_e_per_s: 100.0 });
        let oldest = defects.iter().find(|(_, defect)| matches!(defect.place, DefectPlace::Column(_)));
        defects.insert(Defect { place, kind }).unwrap();
        if let Some((id, _)) = oldest {
            assert!(defects.remove(id));
        }
    }
}

/// Returns everything that disturbs pixels and moves charge; the image keeps its size.
fn disturbed() -> SpatialParams {
    let rates = Rates { up_per_s: 1.0, down_per_s: 1.0 };
    SpatialParams {
        defects: DefectPopulation {
            hot_share: 0.001,
            hot_e_per_s: 1e4,
            dead_share: 0.001,
            rts_share: 0.001,
            rts_e_per_s: 1e4,
            rts_rates: rates,
            ..DefectPopulation::NONE
        },
        protons: Some(ProtonFlux { per_cm2_s: 1e4, energy_mev: 60.0, direction: ProtonDirection::Isotropic }),
        image_lag: Some(ImageLag { share: 0.01 }),
        blooming: Some(Blooming { drained_share: 0.5 }),
        charge_transfer: Some(ChargeTransfer { parallel_share: 1e-4, serial_share: 1e-5, ..ChargeTransfer::NONE }),
        ..SpatialParams::OFF
    }
}

/// Returns a position along one axis, from well outside the detector on one side to the other, px.
fn place(i: u32, axis: usize) -> f64 {
    philox([i, 0, 0, 0], [1, 2]).map(|word| f64::from(word) / 4_294_967_296.0)[axis] * 400.0 - 20.0
}

fn source(i: u32) -> Source {
    // Brightness over four decades: several classes.
    let light = f64::from(philox([i, 1, 0, 0], [1, 2])[0]) / 4_294_967_296.0;
    Source {
        id: i,
        electrons: 30.0 * 1e4_f64.powf(light * light),
        mag: 5.0,
        place: SourcePlace::Pixel([place(i, 0), place(i, 1)]),
    }
}
