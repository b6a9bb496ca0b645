//! Defects, protons and the effects of neighbours: CPU and GPU make the same image of the same electrons.
//!
//! The mean image is written to the device in whole units of its fixed point, so both start from the same bits; what is
//! left is rounding (the device may fuse multiply-adds).

use crate::scene::{DnDifference, EXPOSURE_S, device};
use base::image::{DnImage, Image};
use base::random::philox;
use starloop_image::detector::binning::{Binning, BinningKind};
use starloop_image::detector::charge_transfer::{ChargeTransfer, OutputCorner};
use starloop_image::detector::defects::{Defect, DefectKind, DefectPlace, DefectPopulation, Rates};
use starloop_image::detector::protons::{ProtonDirection, ProtonFlux};
use starloop_image::detector::{Detector, DetectorConditions, DetectorParams, SpatialParams};
use starloop_image::detector::{blooming::Blooming, gpu::GpuDetector, image_lag::ImageLag, window::Window};
use starloop_image::gpu::{DeviceElectrons, GpuDevice};

/// Odd, so that pairs of pixels lie across the ends of rows; 4 divides one side less one.
const SIZE: [usize; 2] = [121, 85];
/// Units per electron.
const SCALE: f32 = 1024.0;
/// Share of pixels that may be off by one number.
const SHARE: f64 = 2e-3;

/// Returns a dark frame with bright spots, some of them saturated.
fn mean(frame: u32, [width, height]: [usize; 2]) -> Image<f32> {
    let mut image = Image::new(width, height);
    for (pixel, e) in (0_u32..).zip(image.pixels_mut()) {
        let [a, b, ..] = philox([pixel, frame, 5, 0], [7, 7]).map(|word| word as f32 / 4_294_967_296.0);
        let light_e = if a < 0.01 { 300_000.0 * b } else { 500.0 * b };
        *e = (light_e * SCALE).floor() / SCALE;
    }
    image
}

fn upload(gpu: &GpuDevice, image: &Image<f32>) -> DeviceElectrons {
    let mut electrons = DeviceElectrons::new(gpu, image.width(), image.height()).expect("an image");
    let mut encoder = gpu.encoder("upload");
    electrons.clear(&mut encoder, SCALE);
    gpu.submit(encoder).expect("submitted");
    let sums: Vec<u8> = image.pixels().iter().flat_map(|e| ((e * SCALE) as i32).to_ne_bytes()).collect();
    gpu.queue().write_buffer(electrons.buffer(), 0, &sums);
    electrons
}

fn params(spatial: SpatialParams) -> DetectorParams {
    DetectorParams {
        full_well_e: 1e5,
        gain_e_per_dn: 8.0,
        bits: 14,
        black_level_dn: 100.0,
        read_noise_e_rms: 10.0,
        dark_e_per_s: 30.0,
        prnu: 0.01,
        dsnu_e_rms: 2.0,
        spatial,
        ..DetectorParams::QUIET
    }
}

/// Returns three frames by both, and the detector on the CPU.
fn both(
    spatial: SpatialParams,
    size: [usize; 2],
    conditions: &DetectorConditions,
    command: impl Fn(&mut Detector),
) -> Option<Vec<[DnImage; 2]>> {
    let gpu = device()?;
    let mut cpu = Detector::new(params(spatial), size[0], size[1], 3);
    command(&mut cpu);
    let mut device = GpuDetector::new(gpu.clone(), &cpu, size[0], size[1]).expect("a detector");
    let [width, height] = cpu.output().geometry().size_px;
    let frames = (0..3).map(|frame| {
        let mean = mean(frame, size);
        let mut out = [DnImage::new(width, height), DnImage::new(width, height)];
        cpu.collect(&mean, frame, conditions, &mut out[0]);
        device.collect(&upload(&gpu, &mean), frame, conditions, &mut out[1]).expect("collected");
        out
    });
    Some(frames.collect())
}

/// Checks that both agree in all frames, and that the effect is seen in the last one.
fn agree(name: &str, spatial: SpatialParams, size: [usize; 2], command: impl Fn(&mut Detector)) {
    let at = DetectorConditions::dark(EXPOSURE_S);
    let Some(frames) = both(spatial, size, &at, command) else { return };
    for (number, [cpu, gpu]) in frames.iter().enumerate() {
        let difference = DnDifference::between(cpu, gpu);
        assert!(difference.within(SHARE), "{name}, frame {number}: {difference:?}");
    }
    let Some(plain) = both(SpatialParams::OFF, size, &at, |_| {}) else { return };
    let (with, without) = (&frames[2][1], &plain[2][0]);
    if with.pixels().len() == without.pixels().len() {
        assert!(!DnDifference::between(without, with).within(SHARE), "{name}: nothing is seen of it");
    }
}

const RATES: Rates = Rates { up_per_s: 3.0, down_per_s: 3.0 };

fn defects(detector: &mut Detector) {
    let list = detector.disturbances_mut().defects_mut();
    let mut insert = |place, kind| list.insert(Defect { place, kind }).expect("space");
    insert(DefectPlace::Column(17), DefectKind::Stuck { dn: 999 });
    insert(DefectPlace::Row(3), DefectKind::Dead { response: 0.3 });
    insert(DefectPlace::Column(30), DefectKind::Hot { extra_e_per_s: 20_000.0 });
    insert(DefectPlace::Row(50), DefectKind::Rts { extra_e_per_s: 9000.0, rates: RATES });
}

const STORM: ProtonFlux = ProtonFlux { per_cm2_s: 3e4, energy_mev: 40.0, direction: ProtonDirection::Isotropic };
const PROTONS: SpatialParams = SpatialParams { protons: Some(STORM), ..SpatialParams::OFF };

#[test]
fn defects_agree() {
    agree("commanded defects", SpatialParams::OFF, SIZE, defects);
    let population = DefectPopulation {
        hot_share: 0.03,
        hot_e_per_s: 30_000.0,
        dead_share: 0.02,
        dead_response: 0.1,
        rts_share: 0.02,
        rts_e_per_s: 30_000.0,
        rts_rates: RATES,
    };
    agree("random defects", SpatialParams { defects: population, ..SpatialParams::OFF }, SIZE, |_| {});
}

#[test]
fn protons_agree() {
    agree("protons", PROTONS, SIZE, |_| {});
    let of_frame = DetectorConditions { protons: Some(STORM), ..DetectorConditions::dark(EXPOSURE_S) };
    let by_frame = both(SpatialParams::OFF, SIZE, &of_frame, |_| {});
    let Some(by_params) = both(PROTONS, SIZE, &DetectorConditions::dark(EXPOSURE_S), |_| {}) else { return };
    assert_eq!(by_frame, Some(by_params), "protons of a frame are those of the parameters");
}

#[test]
fn lag_blooming_and_transfer_agree() {
    let lag = Some(ImageLag { share: 0.05 });
    agree("image lag", SpatialParams { image_lag: lag, ..SpatialParams::OFF }, SIZE, |_| {});
    for drained_share in [0.0, 0.4] {
        let blooming = Some(Blooming { drained_share });
        agree("blooming", SpatialParams { blooming, ..SpatialParams::OFF }, SIZE, |_| {});
    }
    for corner in [OutputCorner::TopLeft, OutputCorner::BottomRight] {
        let charge_transfer = Some(ChargeTransfer { parallel_share: 3e-3, serial_share: 1e-3, corner });
        agree("charge transfer", SpatialParams { charge_transfer, ..SpatialParams::OFF }, SIZE, |_| {});
    }
}

#[test]
fn binning_and_windows_agree() {
    let window = Some(Window { left_px: 20, top_px: 12, width_px: 60, height_px: 40 });
    agree("window", SpatialParams { window, ..SpatialParams::OFF }, SIZE, defects);
    for kind in [BinningKind::Charge { full_well_e: 2e5 }, BinningKind::DigitalMean, BinningKind::DigitalSum] {
        let binning = Some(Binning { factor: 2, kind });
        let size = [122, 86];
        agree("binning", SpatialParams { binning, ..SpatialParams::OFF }, size, defects);
        agree("both", SpatialParams { binning, window, ..PROTONS }, size, |_| {});
    }
}

#[test]
fn everything_at_once_agrees() {
    let all = SpatialParams {
        image_lag: Some(ImageLag { share: 0.02 }),
        blooming: Some(Blooming { drained_share: 0.2 }),
        charge_transfer: Some(ChargeTransfer {
            parallel_share: 1e-4,
            serial_share: 1e-5,
            corner: OutputCorner::TopRight,
        }),
        binning: Some(Binning { factor: 2, kind: BinningKind::Charge { full_well_e: 1.5e5 } }),
        window: Some(Window { left_px: 4, top_px: 2, width_px: 100, height_px: 80 }),
        ..SpatialParams::OFF
    };
    agree("everything", SpatialParams { protons: Some(STORM), ..all }, [122, 86], defects);
}

#[test]
fn the_comparison_sees_a_defect_more_and_another_share() {
    let spatial = SpatialParams { image_lag: Some(ImageLag { share: 0.05 }), ..SpatialParams::OFF };
    let other = SpatialParams { image_lag: Some(ImageLag { share: 0.051 }), ..SpatialParams::OFF };
    let at = DetectorConditions::dark(EXPOSURE_S);
    let (Some(a), Some(b)) = (both(spatial, SIZE, &at, |_| {}), both(other, SIZE, &at, |_| {})) else { return };
    assert!(!DnDifference::between(&a[2][0], &b[2][1]).within(SHARE), "another share");
    let one = |detector: &mut Detector| {
        let (place, kind) = (DefectPlace::Pixel(60, 40), DefectKind::Hot { extra_e_per_s: 1e5 });
        detector.disturbances_mut().defects_mut().insert(Defect { place, kind }).expect("space");
    };
    let Some(c) = both(spatial, SIZE, &at, one) else { return };
    assert!(!DnDifference::between(&a[2][0], &c[2][1]).within(SHARE), "a hot pixel");
}

#[test]
fn a_reset_forgets_on_both() {
    let Some(gpu) = device() else { return };
    let spatial = SpatialParams { image_lag: Some(ImageLag { share: 0.5 }), ..SpatialParams::OFF };
    let mut cpu = Detector::new(params(spatial), SIZE[0], SIZE[1], 3);
    let mut on_device = GpuDetector::new(gpu.clone(), &cpu, SIZE[0], SIZE[1]).expect("a detector");
    let (dark, at) = (Image::new(SIZE[0], SIZE[1]), DetectorConditions::dark(EXPOSURE_S));
    let mut frame = |number: u32, image: &Image<f32>, reset: bool| {
        let mut out = [DnImage::new(SIZE[0], SIZE[1]), DnImage::new(SIZE[0], SIZE[1])];
        if reset {
            cpu.reset();
            on_device.reset();
        }
        cpu.collect(image, number, &at, &mut out[0]);
        on_device.collect(&upload(&gpu, image), number, &at, &mut out[1]).expect("collected");
        assert!(DnDifference::between(&out[0], &out[1]).within(SHARE), "frame {number}");
        out[0].clone()
    };
    frame(1, &mean(1, SIZE), false);
    let lagging = frame(2, &dark, false);
    let clean = frame(2, &dark, true);
    assert!(!DnDifference::between(&lagging, &clean).within(SHARE), "the rest is seen");
    assert_eq!(frame(2, &dark, false), clean, "the same frame once more starts again");
}
