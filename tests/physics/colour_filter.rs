//! Pixels behind colour filters: each colour counts its share of the light and none of the dark signal; and what it is
//! worth that all light is taken to be of one colour. Colours are found here from the names of the patterns.

use base::bayer::BayerPattern;
use base::image::{DnImage, Image};
use image::detector::binning::{Binning, BinningKind};
use image::detector::{Background, Detector, DetectorConditions, DetectorParams, Patterns, SpatialParams};
use image::detector::{pattern::ColourFilter, window::Window};
use plan::optics::star_spectrum::StarSpectra;
use plan::optics::{Band, Spectrum};

const SIZE: [usize; 2] = [130, 94];
const LIGHT_E: f64 = 4000.0;
const SKY_E: f32 = 500.0;
const DARK_E: f64 = 300.0;
const RESPONSES: [(char, f64); 3] = [('R', 0.35), ('G', 0.45), ('B', 0.25)];

fn filter(pattern: BayerPattern) -> ColourFilter {
    ColourFilter { pattern, red: RESPONSES[0].1, green: RESPONSES[1].1, blue: RESPONSES[2].1 }
}

fn params(spatial: SpatialParams) -> DetectorParams {
    DetectorParams { full_well_e: 60_000.0, dark_e_per_s: DARK_E, spatial, ..DetectorParams::QUIET }
}

fn behind(pattern: BayerPattern) -> SpatialParams {
    SpatialParams { colour_filter: Some(filter(pattern)), ..SpatialParams::OFF }
}

/// Returns a flat field of one second.
fn flat(detector: &mut Detector) -> DnImage {
    let mut light: Image<f32> = Image::new(SIZE[0], SIZE[1]);
    light.pixels_mut().fill(LIGHT_E as f32);
    let [width, height] = detector.output().geometry().size_px;
    let mut out = DnImage::new(width, height);
    detector.collect(&light, 3, &DetectorConditions::lit(1.0, Background::uniform(SKY_E)), &mut out);
    out
}

fn frame(spatial: SpatialParams) -> DnImage {
    flat(&mut Detector::new(params(spatial), SIZE[0], SIZE[1], 9))
}

/// Returns the mean and variance of the pixels that a pattern of this name gives this letter.
fn moments(image: &DnImage, name: &str, letter: char) -> [f64; 2] {
    let letters: Vec<char> = name.chars().collect();
    let is_of = |i: usize| letters[2 * ((i / image.width()) % 2) + (i % image.width()) % 2] == letter;
    let numbers: Vec<f64> =
        (0..image.pixels().len()).filter(|i| is_of(*i)).map(|i| f64::from(image.pixels()[i])).collect();
    let mean = numbers.iter().sum::<f64>() / numbers.len() as f64;
    [mean, numbers.iter().map(|dn| (dn - mean).powi(2)).sum::<f64>() / (numbers.len() - 1) as f64]
}

/// Returns the largest distance of a colour's mean from response x light + dark signal, in standard errors.
fn worst_sigmas(image: &DnImage, name: &str) -> f64 {
    let sigmas = RESPONSES.map(|(letter, response)| {
        let wanted = response * (LIGHT_E + f64::from(SKY_E)) + DARK_E;
        let pixels = (image.pixels().len() / if letter == 'G' { 2 } else { 4 }) as f64;
        (moments(image, name, letter)[0] - wanted).abs() / (wanted / pixels).sqrt()
    });
    sigmas.into_iter().fold(0.0, f64::max)
}

#[test]
fn light_of_each_colour_pixel_is_its_response_times_the_light() {
    for (name, pattern) in BayerPattern::NAMED {
        let image = frame(behind(pattern));
        assert!(worst_sigmas(&image, name) < 5.0, "{name}: {} standard errors", worst_sigmas(&image, name));
        for (letter, response) in RESPONSES {
            let [mean, variance] = moments(&image, name, letter);
            // Shot noise of what is counted, not of the light before the filter, and a twelfth for whole numbers: five
            // standard errors of a variance of 3,000 samples and more.
            assert!((variance / (mean + 1.0 / 12.0) - 1.0).abs() < 0.13, "{name} {letter}: {variance} of {mean}");
            assert!((variance / (mean / response) - 1.0).abs() > 0.3, "control: shot noise before the filter");
        }
        // Negative controls: the pattern shifted by a column, and by a row.
        for shifted in [[1, 0], [0, 1]].map(|by| pattern.from_pixel(by).name()) {
            assert!(worst_sigmas(&image, shifted) > 100.0, "{name} read as {shifted}");
        }
    }
}

#[test]
fn a_detector_without_filters_has_the_same_bits_and_one_with_clear_filters_too() {
    let without = frame(SpatialParams::OFF);
    let clear = ColourFilter { red: 1.0, green: 1.0, blue: 1.0, ..filter(BayerPattern::Rggb) };
    assert_eq!(frame(SpatialParams { colour_filter: Some(clear), ..SpatialParams::OFF }), without);
    assert!(Detector::new(params(SpatialParams::OFF), SIZE[0], SIZE[1], 9).patterns().prnu.is_none(), "costs nothing");
    assert_ne!(frame(behind(BayerPattern::Rggb)), without, "control");
}

#[test]
fn measured_photo_response_and_filter_multiply() {
    let map: Vec<f32> = (0..SIZE[0] * SIZE[1]).map(|i| (i % 5) as f32 * 0.02).collect();
    let given = Patterns { prnu: Some(map.clone().into()), ..Patterns::default() };
    let made = Detector::new(params(behind(BayerPattern::Gbrg)), SIZE[0], SIZE[1], 9).with_patterns(&given).unwrap();
    let response = made.patterns().prnu.clone().unwrap();
    for (i, (x, y)) in [(0, (0, 0)), (1, (1, 0)), (131, (1, 1)), (130, (0, 1))] {
        let letter = "GBRG".chars().nth(2 * (y % 2) + x % 2).unwrap();
        let wanted = RESPONSES.iter().find(|(named, _)| *named == letter).unwrap().1 * (1.0 + f64::from(map[i]));
        assert!((1.0 + f64::from(response[i]) - wanted).abs() < 1e-7, "pixel {i}");
    }
    let other = Patterns { dsnu_e: Some(vec![0.0; SIZE[0] * SIZE[1]].into()), ..Patterns::default() };
    let plain = Detector::new(params(behind(BayerPattern::Gbrg)), SIZE[0], SIZE[1], 9);
    let prnu = plain.patterns().prnu.clone();
    assert_eq!(plain.with_patterns(&other).unwrap().patterns().prnu, prnu, "another map leaves the filters");
}

#[test]
fn a_window_says_its_own_pattern_and_binned_pixels_have_none() {
    let window = Window { left_px: 3, top_px: 10, width_px: 60, height_px: 40 };
    let cut = SpatialParams { window: Some(window), ..behind(BayerPattern::Bggr) };
    let name = cut.output_colours().unwrap().name();
    assert_eq!(name, "GBRG", "a column later");
    let image = frame(cut);
    assert!(worst_sigmas(&image, name) < 5.0 && worst_sigmas(&image, "BGGR") > 100.0, "and the control");
    let binned = SpatialParams { binning: Some(Binning { factor: 2, kind: BinningKind::DigitalMean }), ..cut };
    assert_eq!((binned.output_colours(), SpatialParams::OFF.output_colours()), (None, None));
}

fn table(points: &[[f64; 2]]) -> Spectrum {
    Spectrum::share(points.to_vec()).unwrap()
}

/// The approximation's bound: responses of a usual sensor, and what they are for stars of other colours.
#[test]
fn stars_of_another_colour_than_the_reference_err_by_as_much_as_is_stated() {
    // Quantum efficiency without filters and with each, read off data sheets of CMOS sensors, cut at 700 nm.
    let bare = table(&[[400.0, 0.45], [450.0, 0.6], [530.0, 0.7], [600.0, 0.62], [650.0, 0.52], [700.0, 0.45]]);
    let red = [[400.0, 0.03], [540.0, 0.03], [570.0, 0.15], [590.0, 0.5], [610.0, 0.58], [650.0, 0.5], [700.0, 0.42]];
    let green = [
        [400.0, 0.04],
        [460.0, 0.1],
        [500.0, 0.42],
        [530.0, 0.6],
        [560.0, 0.5],
        [600.0, 0.18],
        [650.0, 0.06],
        [700.0, 0.1],
    ];
    let blue = [
        [400.0, 0.25],
        [420.0, 0.45],
        [450.0, 0.55],
        [480.0, 0.45],
        [520.0, 0.15],
        [560.0, 0.05],
        [650.0, 0.02],
        [700.0, 0.03],
    ];
    let spectra = StarSpectra::new();
    let rate =
        |qe: Spectrum, bp_rp: f64| Band::with_flat_transmission(1.0, qe).unwrap().e_per_s_m2(&spectra.of_color(bp_rp));
    let response = |qe: &[[f64; 2]], bp_rp: f64| rate(table(qe), bp_rp) / rate(bare.clone(), bp_rp);
    for (range, most) in [([0.3, 1.3], 0.25), ([-0.3, 2.0], 0.80)] {
        let mut worst = 0.0_f64;
        for (name, qe) in [("red", &red[..]), ("green", &green[..]), ("blue", &blue[..])] {
            for bp_rp in range {
                let error = response(qe, 0.8) / response(qe, bp_rp) - 1.0;
                println!("{name}, BP-RP {bp_rp}: {error:+.3}, response {:.3}", response(qe, bp_rp));
                worst = worst.max(error.abs());
            }
        }
        assert!(worst <= most && worst > 0.8 * most, "{range:?}: {worst}, stated {most}");
    }
}
