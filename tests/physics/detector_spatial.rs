//! The detector's defects, protons and effects of neighbours in whole frames, on the CPU: what a frame shows is what
//! the parameters say. Formulae are written afresh here.

use base::image::{DnImage, Image};
use image::detector::binning::{Binning, BinningKind};
use image::detector::charge_transfer::{ChargeTransfer, OutputCorner};
use image::detector::defects::{Defect, DefectKind, DefectPlace, Rates};
use image::detector::protons::{ProtonDirection, ProtonFlux};
use image::detector::{Detector, DetectorConditions, DetectorParams, SpatialParams};
use image::detector::{blooming::Blooming, image_lag::ImageLag, readout::Levels, tdi::Tdi, window::Window};

const SIZE: [usize; 2] = [128, 96];
const EXPOSURE_S: f64 = 0.5;
const BLACK_DN: f64 = 100.0;
const BEAM: ProtonDirection = ProtonDirection::Beam { incidence_deg: 0.0, azimuth_deg: 0.0 };

fn params(spatial: SpatialParams) -> DetectorParams {
    DetectorParams { full_well_e: 50_000.0, black_level_dn: BLACK_DN, spatial, ..DetectorParams::QUIET }
}

fn flat(e: f32) -> Image<f32> {
    let mut image = Image::new(SIZE[0], SIZE[1]);
    image.pixels_mut().fill(e);
    image
}

/// Draws a round star of so many electrons with sigma 3 px, by the midpoint of every pixel.
fn star(at_px: [f64; 2], electrons: f64) -> Image<f32> {
    let mut image = flat(0.0);
    for (i, e) in image.pixels_mut().iter_mut().enumerate() {
        let (dx, dy) = ((i % SIZE[0]) as f64 - at_px[0], (i / SIZE[0]) as f64 - at_px[1]);
        *e = (electrons / (18.0 * core::f64::consts::PI) * (-(dx * dx + dy * dy) / 18.0).exp()) as f32;
    }
    image
}

fn frame(detector: &mut Detector, mean: &Image<f32>, number: u32) -> DnImage {
    frame_under(detector, mean, number, &DetectorConditions::dark(EXPOSURE_S))
}

fn frame_under(detector: &mut Detector, mean: &Image<f32>, number: u32, conditions: &DetectorConditions) -> DnImage {
    let [width, height] = detector.output().geometry().size_px;
    let mut out = DnImage::new(width, height);
    detector.collect(mean, number, conditions, &mut out);
    out
}

fn detector(spatial: SpatialParams) -> Detector {
    Detector::new(params(spatial), SIZE[0], SIZE[1], 5)
}

/// Returns the mean and variance of the numbers.
fn moments(numbers: &[f64]) -> [f64; 2] {
    let n = numbers.len() as f64;
    let mean = numbers.iter().sum::<f64>() / n;
    [mean, numbers.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / (n - 1.0)]
}

fn electrons(image: &DnImage) -> Vec<f64> {
    image.pixels().iter().map(|dn| f64::from(*dn) - BLACK_DN).collect()
}

/// Returns the mean place of what is above the black level.
fn centroid(image: &DnImage, black_dn: f64) -> [f64; 2] {
    let weight = |i: usize| f64::from(image.pixels()[i]) - black_dn;
    let all = 0..image.pixels().len();
    let sum: f64 = all.clone().map(weight).sum();
    let width = image.width();
    let x = all.clone().map(|i| (i % width) as f64 * weight(i)).sum::<f64>() / sum;
    let y = all.map(|i| (i / width) as f64 * weight(i)).sum::<f64>() / sum;
    [x, y]
}

#[test]
fn binning_on_the_chip_reads_once_and_digital_sums_read_every_pixel() {
    let read_e: f64 = 20.0;
    let light_e = 50.0;
    // 2 x 2 pixels of 50 e-: 200 e- of light and of its variance; read noise once, or four times; rounding 1/12 each.
    for (kind, mean, variance) in [
        (BinningKind::Charge { full_well_e: 1e5 }, BLACK_DN + 200.0, 200.0 + read_e * read_e + 1.0 / 12.0),
        (BinningKind::DigitalSum, 4.0 * BLACK_DN + 200.0, 200.0 + 4.0 * read_e * read_e + 4.0 / 12.0),
        (BinningKind::DigitalMean, BLACK_DN + 50.0, (200.0 + 4.0 * read_e * read_e + 4.0 / 12.0) / 16.0),
    ] {
        let spatial = SpatialParams { binning: Some(Binning { factor: 2, kind }), ..SpatialParams::OFF };
        let params = DetectorParams { read_noise_e_rms: read_e, ..params(spatial) };
        let mut detector = Detector::new(params, SIZE[0], SIZE[1], 5);
        let numbers: Vec<f64> =
            (0..20).flat_map(|n| frame(&mut detector, &flat(light_e), n).pixels().to_vec()).map(f64::from).collect();
        assert_eq!(numbers.len(), 20 * SIZE[0] * SIZE[1] / 4);
        let [got_mean, got_variance] = moments(&numbers);
        let n = numbers.len() as f64;
        // A mean that is rounded is 1/8 higher (of four equal rests one is a half, and goes up) and has other steps.
        let (offset, steps) = if kind == BinningKind::DigitalMean { (0.125, 0.1) } else { (0.0, 0.0) };
        assert!((got_mean - mean - offset).abs() < 5.0 * (variance / n).sqrt(), "{kind:?}: mean {got_mean}");
        let allowed = 5.0 * variance * (2.0 / n).sqrt() + steps;
        assert!((got_variance - variance).abs() < allowed, "{kind:?}: {got_variance} for {variance}");
        // Values for the frame's header and the tracker.
        let levels = Levels::of_output(&params);
        let total_e = (got_mean - offset - levels.black_level_dn) * levels.gain_e_per_dn;
        assert!((total_e - 200.0).abs() < 1.0, "{kind:?}: {total_e} e-");
        let noise_e = (200.0 + levels.read_noise_e_rms.powi(2)).sqrt();
        let got_e = got_variance.sqrt() * levels.gain_e_per_dn;
        assert!((got_e / noise_e - 1.0).abs() < 0.02, "{kind:?}: noise {got_e} for {noise_e}");
    }
}

#[test]
fn a_star_is_where_the_output_geometry_says() {
    let window = Window { left_px: 24, top_px: 16, width_px: 80, height_px: 64 };
    let place = [61.3, 47.8];
    let mut places = Vec::new();
    for factor in [1_u32, 2, 4] {
        for kind in [BinningKind::Charge { full_well_e: 5e5 }, BinningKind::DigitalSum] {
            let binning = (factor > 1).then_some(Binning { factor, kind });
            for window in [None, Some(window)] {
                let mut detector = detector(SpatialParams { binning, window, ..SpatialParams::OFF });
                let image = frame(&mut detector, &star(place, 200_000.0), 0);
                let wanted = detector.output().geometry().output_from_sensor(place);
                let black_dn = Levels::of_output(detector.params()).black_level_dn;
                let got = centroid(&image, black_dn);
                // Shot noise 3 px / sqrt(2e5), five sigma, in sensor pixels.
                let limit = 5.0 * 3.0 / 200_000_f64.sqrt() / f64::from(factor);
                let off = (got[0] - wanted[0]).hypot(got[1] - wanted[1]);
                assert!(off < 1.5 * limit, "{factor} {kind:?} {window:?}: {got:?} for {wanted:?}");
                places.push(wanted);
            }
        }
    }
    assert!((places[0][0] - places[1][0] - 24.0).abs() < 1e-12, "the window shifts");
    assert!((places[0][0] - 2.0 * places[4][0] - 0.5).abs() < 1e-12, "half a pixel by binning");
}

#[test]
fn image_lag_shows_a_share_of_the_frames_before() {
    let lag = Some(ImageLag { share: 0.02 });
    let mut detector = detector(SpatialParams { image_lag: lag, ..SpatialParams::OFF });
    let first = moments(&electrons(&frame(&mut detector, &flat(10_000.0), 0)))[0];
    let second = moments(&electrons(&frame(&mut detector, &flat(0.0), 1)))[0];
    let third = moments(&electrons(&frame(&mut detector, &flat(0.0), 2)))[0];
    let error = 5.0 * 100.0 / (SIZE[0] * SIZE[1]) as f64;
    assert!((first - 9800.0).abs() < 100.0 * error, "{first}");
    assert!((second - 196.0).abs() < 2.0, "{second}");
    // 3.92 electrons in every pixel, to a few hundredths: the ADC makes 4 of it.
    assert!((third - 4.0).abs() < 0.05, "{third}");
    // The same run again, bit by bit, after frames of another one.
    let again = moments(&electrons(&frame(&mut detector, &flat(10_000.0), 0)))[0];
    assert_eq!(again.to_bits(), first.to_bits());
}

#[test]
fn saturated_stars_bleed_along_their_column_and_keep_their_charge() {
    let blooming = Some(Blooming { drained_share: 0.0 });
    let mut image = flat(0.0);
    image.pixels_mut()[40 * SIZE[0] + 30] = 500_000.0;
    let bled = frame(&mut detector(SpatialParams { blooming, ..SpatialParams::OFF }), &image, 0);
    let clipped = frame(&mut detector(SpatialParams::OFF), &image, 0);
    let sum = |image: &DnImage| electrons(image).iter().sum::<f64>();
    assert!((sum(&bled) / 500_000.0 - 1.0).abs() < 5.0 / 500_000_f64.sqrt(), "{}", sum(&bled));
    assert!((sum(&clipped) - 50_000.0).abs() < 1.0, "without blooming the excess is lost");
    let touched = (0..SIZE[1]).filter(|y| bled.get(30, *y).unwrap() > 101).count();
    assert_eq!(touched, 11, "ten full wells: one pixel full, nine full wells to the sides, the ends half full");
    assert!((0..SIZE[1]).all(|y| bled.get(29, y).unwrap() <= 101 && bled.get(31, y).unwrap() <= 101));
}

#[test]
fn charge_left_behind_moves_a_star_by_the_transfers() {
    // Each transfer delays by c pixels on average: n c in all, here 48.8 and 62.3 transfers of 1e-3.
    let transfer = ChargeTransfer { parallel_share: 1e-3, serial_share: 1e-3, corner: OutputCorner::TopLeft };
    let spatial = SpatialParams { charge_transfer: Some(transfer), ..SpatialParams::OFF };
    let place = [61.3, 47.8];
    let mean = star(place, 2e6);
    let [with, without] = [spatial, SpatialParams::OFF].map(|spatial| {
        let params = DetectorParams { full_well_e: 1e6, gain_e_per_dn: 2.0, ..params(spatial) };
        centroid(&frame(&mut Detector::new(params, SIZE[0], SIZE[1], 5), &mean, 0), BLACK_DN)
    });
    let shift = [with[0] - without[0], with[1] - without[1]];
    // c n / (1 - c), n one more than the place; equal shot noise cancels.
    for (got, wanted) in shift.iter().zip([62.3e-3 / 0.999, 48.8e-3 / 0.999]) {
        assert!((got - wanted).abs() < 2e-3, "{got} for {wanted}");
        assert!((got - 1.1 * wanted).abs() > 2e-3, "negative control");
    }
}

#[test]
fn defects_show_in_the_numbers_and_go_with_a_command() {
    let mut detector = detector(SpatialParams::OFF);
    let light = flat(1000.0);
    let plain = frame(&mut detector, &light, 0);
    let rates = Rates { up_per_s: 1.0, down_per_s: 3.0 };
    let list = detector.disturbances_mut().defects_mut();
    list.set_frame_period_s(1.0);
    let mut insert = |place, kind| list.insert(Defect { place, kind }).unwrap();
    let hot = insert(DefectPlace::Pixel(10, 10), DefectKind::Hot { extra_e_per_s: 8000.0 });
    insert(DefectPlace::Column(20), DefectKind::Dead { response: 0.25 });
    insert(DefectPlace::Row(30), DefectKind::Stuck { dn: 4000 });
    insert(DefectPlace::Pixel(50, 50), DefectKind::Rts { extra_e_per_s: 2000.0, rates });
    let frames = 2000;
    let mut of = [const { Vec::new() }; 4];
    for number in 0..frames {
        let image = frame(&mut detector, &light, number);
        for (list, [x, y]) in of.iter_mut().zip([[10, 10], [20, 40], [60, 30], [50, 50]]) {
            list.push(f64::from(image.get(x, y).unwrap()) - BLACK_DN);
        }
    }
    let n = f64::from(frames);
    // Hot: 1000 + 8000 * 0.5, with its own shot noise.
    let [mean, variance] = moments(&of[0]);
    assert!((mean - 5000.0).abs() < 5.0 * (5000.0 / n).sqrt(), "{mean}");
    assert!((variance / 5000.0 - 1.0).abs() < 5.0 * (2.0 / n).sqrt(), "{variance}");
    let [mean, variance] = moments(&of[1]);
    assert!((mean - 250.0).abs() < 5.0 * (250.0 / n).sqrt(), "{mean}");
    assert!((variance / 250.0 - 1.0).abs() < 5.0 * (2.0 / n).sqrt(), "{variance}");
    assert!(of[2].iter().all(|e| *e == 3900.0), "stuck");
    // RTS: two levels, a quarter of the time high, and a high frame is left with (1 - p) (1 - exp(-4 s)).
    let high: Vec<bool> = of[3].iter().map(|e| *e > 1500.0).collect();
    let share = high.iter().filter(|high| **high).count() as f64 / n;
    assert!((share - 0.25).abs() < 5.0 * (0.25 * 0.75 / n).sqrt() * 1.1, "{share}");
    let left =
        high.windows(2).filter(|w| w[0] && !w[1]).count() as f64 / high.iter().filter(|high| **high).count() as f64;
    let wanted = 0.75 * (1.0 - (-4.0_f64).exp());
    assert!((left - wanted).abs() < 5.0 * (wanted * (1.0 - wanted) / (0.25 * n)).sqrt(), "{left} for {wanted}");
    assert!(detector.disturbances_mut().defects_mut().remove(hot));
    let without = frame(&mut detector, &light, 0);
    assert_eq!(without.get(10, 10), plain.get(10, 10), "as before");
    detector.disturbances_mut().defects_mut().clear();
    assert_eq!(frame(&mut detector, &light, 0), plain, "all as before");
}

#[test]
fn protons_leave_the_charge_of_their_tracks() {
    let mut detector = detector(SpatialParams::OFF);
    let dark = flat(0.0);
    let flux = ProtonFlux { per_cm2_s: 4000.0, energy_mev: 100.0, direction: BEAM };
    assert_eq!(electrons(&frame(&mut detector, &dark, 0)).iter().sum::<f64>(), 0.0);
    let storm = DetectorConditions { protons: Some(flux), ..DetectorConditions::dark(EXPOSURE_S) };
    let (mut seen_e, mut reported_e, mut tracks) = (0.0, 0.0, 0);
    for number in 0..200 {
        seen_e += electrons(&frame_under(&mut detector, &dark, number, &storm)).iter().sum::<f64>();
        reported_e += detector.disturbances().proton_tracks().iter().map(|track| track.electrons).sum::<f64>();
        tracks += u32::try_from(detector.disturbances().proton_tracks().len()).unwrap();
    }
    // Half a track's width may lie outside; numbers are rounded.
    assert!((seen_e / reported_e - 1.0).abs() < 0.02, "{seen_e} {reported_e}");
    // 5.836 MeV cm^2/g, 2.33 g/cm^3, 3.65 eV; 15 um under 5.5 um pixels.
    let volume_cm3 = (128.0 * 5.5e-4) * (96.0 * 5.5e-4) * 15e-4;
    let wanted_e = 4000.0 * volume_cm3 * 200.0 * EXPOSURE_S * 5.836e6 * 2.33 / 3.65;
    // Their number is Poisson's, and Bohr's straggling is as large as the mean in so thin a layer.
    let spread = 5.0 * (2.0 / f64::from(tracks)).sqrt();
    assert!((reported_e / wanted_e - 1.0).abs() < spread, "{reported_e} for {wanted_e} of {tracks} tracks");
    assert_eq!(electrons(&frame(&mut detector, &dark, 0)).iter().sum::<f64>(), 0.0);
}

#[test]
fn tdi_stages_add_signal_and_average_the_patterns() {
    let stages = 16;
    let spatial = SpatialParams { tdi: Some(Tdi { stages }), ..SpatialParams::OFF };
    let params = DetectorParams { prnu: 0.02, dark_e_per_s: 100.0, read_noise_e_rms: 5.0, ..params(spatial) };
    let mut detector = Detector::new(params, SIZE[0], SIZE[1], 5);
    // The planner's mean image is that of the whole exposure, 16 lines of 31.25 ms.
    let numbers = electrons(&frame(&mut detector, &flat(16.0 * 200.0), 0));
    let [mean, variance] = moments(&numbers);
    let wanted = 3200.0 + 50.0;
    assert!((mean / wanted - 1.0).abs() < 5.0 * 0.02 / 16_f64.sqrt() / 128_f64.sqrt(), "{mean}");
    let pattern = (0.02 / 4.0 * 3200.0_f64).powi(2);
    let wanted = wanted + 25.0 + 1.0 / 12.0 + pattern;
    // The pattern is one number per column.
    let spread = 5.0 * (pattern * (2.0_f64 / 128.0).sqrt()).hypot(wanted * (2.0_f64 / numbers.len() as f64).sqrt());
    assert!((variance - wanted).abs() < spread, "{variance} for {wanted}");
    let columns: Vec<f64> =
        (0..SIZE[0]).map(|x| (0..SIZE[1]).map(|y| numbers[y * SIZE[0] + x]).sum::<f64>() / SIZE[1] as f64).collect();
    let between = moments(&columns)[1];
    let expected = pattern + (wanted - pattern) / SIZE[1] as f64;
    assert!((between / expected - 1.0).abs() < 5.0 * (2.0_f64 / 128.0).sqrt(), "{between} for {expected}");
    assert!(between < 0.5 * (0.02 * 3200.0_f64).powi(2), "pixels' own spread would be 16 times as much");
}
