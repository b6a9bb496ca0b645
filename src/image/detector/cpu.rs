//! The detector on the CPU: in one pass, every stage over a block of pixels while it is in the first-level cache; or,
//! when neighbour stages are on, a pass that makes charge, the neighbour stages, and a pass that reads out. Regions
//! limit the pass that reads out; charge is made and moved in the whole image, where it comes from anywhere.

use crate::detector::conditions::{Constants, DetectorConditions};
use crate::detector::effect_order::{FrameAt, NeighbourStage, ORDER, Part, effects_of};
use crate::detector::pattern::{PatternSizeError, Patterns};
use crate::detector::stages::{ChargeToDn, Mean, MeanToCharge, MeanToDn, Stages};
use crate::detector::{DetectorParams, Effect, neighbours};
use crate::detector::{
    background::Shape, disturbances::Disturbances, line_pattern::Lines, output::Output, seeds::Seeds,
};
use base::image::{DnImage, Image};
use base::random::key;
use base::vector_level::vector_level;
use core::marker::PhantomData;
use pulp::Arch;

/// A detector with its fixed patterns and its state from frame to frame.
#[derive(Debug)]
pub struct Detector {
    params: DetectorParams,
    seeds: Seeds,
    /// Relative illumination of every pixel, for the sky's part of the background; `None`: even.
    illumination: Option<Vec<f32>>,
    patterns: Patterns,
    lines: Lines,
    /// Noise of the rows of the latest frame, e-; empty when off.
    rows_e: Vec<f32>,
    neighbours: Vec<Box<dyn NeighbourStage>>,
    keeps_charge: bool,
    /// Electrons between the passes; no pixels while one pass does.
    charge: Image<f32>,
    disturbances: Disturbances,
    output: Output,
    size_px: [usize; 2],
    arch: Arch,
}

impl Detector {
    /// Returns a detector of this size; `seeds` fix its patterns and its noise (one number: both).
    pub fn new(params: DetectorParams, width_px: usize, height_px: usize, seeds: impl Into<Seeds>) -> Self {
        let seeds = seeds.into();
        let seed = seeds.sensor;
        let size_px = [width_px, height_px];
        let output = Output::new(&params.spatial, size_px);
        let adc_px = output.adc_px();
        let mut made = Self {
            params,
            seeds,
            illumination: None,
            patterns: Patterns::of_detector(&params, size_px, seed),
            lines: Lines::draw(&params.line_pattern, adc_px, seed),
            rows_e: vec![0.0; if params.row_noise.is_on() { adc_px[1] } else { 0 }],
            neighbours: Vec::new(),
            keeps_charge: false,
            charge: Image::new(0, 0),
            disturbances: Disturbances::new(&params, size_px, seeds),
            output,
            size_px,
            arch: vector_level(),
        };
        made.prepare_passes();
        made
    }

    /// Returns the same with patterns that are given instead of drawn, sensor pixel by sensor pixel: TDI averages them
    /// along its stages, charge binning adds up offsets.
    ///
    /// # Errors
    /// When one has not as many pixels as the detector.
    pub fn with_patterns(mut self, given: &Patterns) -> Result<Self, PatternSizeError> {
        let given = given.given_to(&self.params, self.size_px)?;
        self.patterns = given.or(&self.patterns);
        Ok(self)
    }

    /// Keeps every frame's charge for [`Self::charge`]: the stages run in two passes from here on, and draw the same.
    pub fn keep_charge(&mut self) {
        self.keeps_charge = true;
        self.prepare_passes();
    }

    fn prepare_passes(&mut self) {
        self.neighbours = neighbours::stages(&self.params, self.size_px, self.keeps_charge);
        let [width, height] = if self.neighbours.is_empty() { [0, 0] } else { self.size_px };
        self.charge = Image::new(width, height);
    }

    /// Returns the parameters.
    pub fn params(&self) -> &DetectorParams {
        &self.params
    }

    /// Sets the relative illumination of every pixel, row by row, for the sky's part of the background. With `None`, or
    /// a map of another size, the illumination is even.
    pub fn set_illumination_map(&mut self, map: Option<Vec<f32>>) {
        self.illumination = map.filter(|map| map.len() == self.size_px[0] * self.size_px[1]);
    }

    /// Returns the map, where there is one.
    pub fn illumination_map(&self) -> Option<&[f32]> {
        self.illumination.as_deref()
    }

    /// Defects and protons.
    pub fn disturbances(&self) -> &Disturbances {
        &self.disturbances
    }

    /// Defects and protons, to be changed from the next frame on.
    pub fn disturbances_mut(&mut self) -> &mut Disturbances {
        &mut self.disturbances
    }

    /// Returns columns and rows of the ADC's image: charge binning makes it smaller than the sensor.
    pub fn adc_px(&self) -> [usize; 2] {
        self.output.adc_px()
    }

    /// Returns the geometry of the output image: its pixels on the ADC's image and on the sensor.
    pub fn output(&self) -> &Output {
        &self.output
    }

    /// Clears the state that is kept from frame to frame: the next frame is as the first.
    pub fn reset(&mut self) {
        self.neighbours.iter_mut().for_each(|stage| stage.reset());
    }

    /// Returns the seeds of its patterns and of its noise.
    pub fn seeds(&self) -> Seeds {
        self.seeds
    }

    /// Returns the fixed patterns, where switched on; the photo-response behind the pixel's filter.
    pub fn patterns(&self) -> &Patterns {
        &self.patterns
    }

    /// Returns the fixed patterns of columns and rows; empty where off.
    pub fn lines(&self) -> &Lines {
        &self.lines
    }

    /// Returns columns and rows.
    pub fn size_px(&self) -> [usize; 2] {
        self.size_px
    }

    /// Returns whether all stages run in one pass: no neighbour stage is on, and pixels that are not read out need no
    /// light.
    pub fn is_one_pass(&self) -> bool {
        self.neighbours.is_empty()
    }

    /// Returns the neighbour stages that are on, in order.
    pub fn neighbour_effects(&self) -> impl Iterator<Item = Effect> + '_ {
        self.neighbours.iter().map(|stage| stage.effect())
    }

    /// Returns the charge of the latest frame in the pixels, e-, where two passes are run; after the neighbour stages
    /// that keep the image's size.
    pub fn charge(&self) -> Option<&Image<f32>> {
        (!self.neighbours.is_empty()).then_some(&self.charge)
    }

    /// Reads `mean` electrons out as frame `frame`. Does not allocate.
    pub fn collect(&mut self, mean: &Image<f32>, frame: u32, conditions: &DetectorConditions, out: &mut DnImage) {
        self.collect_from(mean, frame, conditions, out);
    }

    /// Exposes the detector as [`Self::collect`] does, from an image in double precision.
    pub fn collect_precise(
        &mut self,
        mean: &Image<f64>,
        frame: u32,
        conditions: &DetectorConditions,
        out: &mut DnImage,
    ) {
        self.collect_from(mean, frame, conditions, out);
    }

    fn collect_from<T: Mean>(
        &mut self,
        mean: &Image<T>,
        frame: u32,
        conditions: &DetectorConditions,
        out: &mut DnImage,
    ) {
        let key = key(self.seeds.noise);
        self.disturbances.advance(frame, conditions, self.params.dark_law);
        if !self.rows_e.is_empty() {
            self.params.row_noise.draw(frame, key, &mut self.rows_e);
        }
        let illumination = self.illumination.as_deref();
        let background = conditions.background;
        let stages = Stages {
            constants: Constants::new(&self.params, conditions, background.level_e(illumination.is_some())),
            background: background.is_shaped(illumination.is_some()).then_some(Shape {
                background,
                size_px: self.size_px,
                illumination,
            }),
            key,
            frame,
            poisson: self.params.poisson,
            patterns: &self.patterns,
            outliers: self.disturbances.outliers(),
            lines: &self.lines,
            rows_e: &self.rows_e,
            width: self.output.adc_px()[0],
        };
        let regions = self.output.adc_regions(&conditions.regions);
        let adc = self.output.adc_image(out);
        if self.neighbours.is_empty() {
            let (ends, from) = (MeanToDn(PhantomData::<T>), mean.pixels());
            stages.run_in(&regions, ends, self.arch, &ORDER, from, adc.pixels_mut());
        } else {
            let before = effects_of(Part::Charge);
            stages.run(MeanToCharge(PhantomData::<T>), self.arch, before, mean.pixels(), self.charge.pixels_mut());
            let at = FrameAt { frame, exposure_s: conditions.exposure_s, key };
            let charge = self.neighbours.iter_mut().fold(&mut self.charge, |charge, stage| stage.apply(charge, &at));
            let (effects, from) = (effects_of(Part::Readout), charge.pixels());
            stages.run_in(&regions, ChargeToDn, self.arch, effects, from, adc.pixels_mut());
        }
        self.disturbances.stick(adc);
        self.output.finish(out);
        conditions.regions.clear_outside(out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detector::binning::{Binning, BinningKind};
    use crate::detector::window::Window;
    use crate::detector::{Background, LinePattern, Nonlinearity, PoissonMethod, RowNoise, SpatialParams};
    use base::region::{Region, Regions};

    const SIZE: [usize; 2] = [301, 203];
    const LIT: DetectorConditions = DetectorConditions::lit(0.1, Background::uniform(3.5));

    fn params(poisson: PoissonMethod) -> DetectorParams {
        DetectorParams {
            full_well_e: 3000.0,
            gain_e_per_dn: 1.5,
            bits: 11,
            black_level_dn: 100.0,
            read_noise_e_rms: 10.0,
            dark_e_per_s: 30.0,
            prnu: 0.01,
            dsnu_e_rms: 2.0,
            poisson,
            ..DetectorParams::QUIET
        }
    }

    /// Returns the dark and bright pixels, below zero and above the full well.
    fn mean() -> Image<f32> {
        let mut mean = Image::new(SIZE[0], SIZE[1]);
        for (i, e) in mean.pixels_mut().iter_mut().enumerate() {
            *e = ((i * 7919) % 4001) as f32 * 0.9 - 2.0;
            if i % 3 == 0 {
                *e *= 0.004;
            }
        }
        mean
    }

    fn read_out(detector: &mut Detector) -> DnImage {
        let mut dn = DnImage::new(SIZE[0], SIZE[1]);
        detector.collect(&mean(), 5, &LIT, &mut dn);
        dn
    }

    /// Returns Fowler, Noll and Vo's hash.
    fn hash(dn: &DnImage) -> u64 {
        let bytes = dn.pixels().iter().flat_map(|dn| dn.to_le_bytes());
        bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3))
    }

    fn quiet(poisson: PoissonMethod) -> DetectorParams {
        DetectorParams { read_noise_e_rms: 0.0, prnu: 0.0, dsnu_e_rms: 0.0, dark_e_per_s: 0.0, ..params(poisson) }
    }

    #[test]
    fn one_pass_and_two_draw_the_bits_that_were_always_drawn() {
        // Taken before there were two passes, on a processor that fuses multiply-add.
        for (params, wanted) in [
            (params(PoissonMethod::Auto), 0x7f5d_97ae_9678_7a16),
            (quiet(PoissonMethod::Auto), 0x97c3_41a8_7436_b8f6),
            (params(PoissonMethod::Ptrs), 0x7e7c_511a_924c_3d1d),
            (quiet(PoissonMethod::Ptrs), 0xe1f1_7c1f_4618_56d4),
        ] {
            let mut detector = Detector::new(params, SIZE[0], SIZE[1], 17);
            assert!(detector.charge().is_none(), "one pass keeps no charge");
            let one = read_out(&mut detector);
            if matches!(detector.arch, Arch::Scalar) {
                println!("SKIPPED: the bits of one pass: this processor does not fuse multiply-add");
            } else {
                assert_eq!(hash(&one), wanted, "{params:?}");
            }
            detector.keep_charge();
            assert_eq!(read_out(&mut detector), one, "two passes: {params:?}");
            let most = detector.charge().expect("kept").pixels().iter().copied().fold(0.0, f32::max);
            assert_eq!(most, 3000.0, "clipped between the passes");
            // Negative control.
            detector.seeds.noise = 18;
            assert_ne!(read_out(&mut detector), one, "another seed");
        }
    }

    fn regions(of: &[[u32; 4]]) -> Regions {
        let region =
            |&[left_px, top_px, width_px, height_px]: &[u32; 4]| Region { left_px, top_px, width_px, height_px };
        Regions::of(&of.iter().map(region).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn regions_have_the_bits_of_the_whole_image_and_nothing_is_outside() {
        let lines = LinePattern { column_gain_rms: 0.01, column_e_rms: 3.0, row_e_rms: 3.0 };
        let shaped = DetectorParams {
            line_pattern: lines,
            row_noise: RowNoise { e_rms: 4.0, corner_cycles_per_row: 0.01 },
            dark_nonuniformity: 0.2,
            nonlinearity: Nonlinearity::through(&[[2000.0, 1990.0]]).expect("rising"),
            ..params(PoissonMethod::Auto)
        };
        let sloped = Background { gradient_e: [3.0, -2.0], quadratic_e: 1.5, ..Background::uniform(5.0) };
        // Odd and even corners of an image of odd width, longer and shorter than a block, overlapping, at every edge.
        let lists: [&[[u32; 4]]; 4] = [
            &[[10, 20, 32, 32], [43, 21, 31, 7], [41, 25, 5, 3]],
            &[[0, 0, 301, 3], [0, 200, 1, 3], [300, 0, 1, 203], [7, 100, 290, 2]],
            &[[150, 200, 40, 3]],
            &[[0, 0, 301, 203]],
        ];
        for params in
            [params(PoissonMethod::Auto), params(PoissonMethod::Ptrs), params(PoissonMethod::RoundedNormal), shaped]
        {
            for (passes, of) in [1, 2].into_iter().flat_map(|passes| lists.map(|of| (passes, of))) {
                let mut detector = Detector::new(params, SIZE[0], SIZE[1], 17);
                if passes == 2 {
                    detector.keep_charge();
                }
                let conditions = DetectorConditions::lit(0.1, sloped);
                let (mut whole, mut part) = (DnImage::new(SIZE[0], SIZE[1]), DnImage::new(SIZE[0], SIZE[1]));
                detector.collect(&mean(), 5, &conditions, &mut whole);
                let regions = regions(of);
                let conditions = DetectorConditions { regions, ..conditions };
                part.pixels_mut().fill(9999);
                detector.collect(&mean(), 5, &conditions, &mut part);
                regions.clear_outside(&mut whole);
                assert!(part == whole, "{of:?}, {passes} passes, {params:?}");
                // Negative controls: another seed, and pixels outside.
                detector.seeds.noise = 18;
                detector.collect(&mean(), 5, &conditions, &mut part);
                assert!(part != whole, "another seed");
            }
        }
    }

    #[test]
    fn regions_of_cut_and_binned_images_have_the_bits_of_the_whole_image() {
        let kinds = [BinningKind::DigitalSum, BinningKind::DigitalMean, BinningKind::Charge { full_well_e: 9000.0 }];
        let binnings = kinds.map(|kind| Some(Binning { factor: 2, kind })).into_iter().chain([None]);
        for binning in binnings {
            let window = Some(Window { left_px: 20, top_px: 10, width_px: 200, height_px: 120 });
            let spatial = SpatialParams { binning, window, ..SpatialParams::OFF };
            let mut detector =
                Detector::new(DetectorParams { spatial, ..params(PoissonMethod::Auto) }, SIZE[0], SIZE[1], 17);
            let [width, height] = detector.output().geometry().size_px;
            let (mut whole, mut part) = (DnImage::new(width, height), DnImage::new(width, height));
            detector.collect(&mean(), 5, &LIT, &mut whole);
            let regions = regions(&[[3, 5, 17, 9], [80, 50, 20, 10]]);
            detector.collect(&mean(), 5, &DetectorConditions { regions, ..LIT }, &mut part);
            assert!(part != whole, "control: all of the image has light");
            regions.clear_outside(&mut whole);
            assert!(part == whole, "{binning:?}");
        }
    }

    #[test]
    fn double_precision_goes_the_same_ways() {
        let mut detector = Detector::new(params(PoissonMethod::Auto), SIZE[0], SIZE[1], 17);
        let single = read_out(&mut detector);
        let mut precise = Image::<f64>::new(SIZE[0], SIZE[1]);
        precise.pixels_mut().iter_mut().zip(mean().pixels()).for_each(|(p, e)| *p = f64::from(*e));
        let mut dn = DnImage::new(SIZE[0], SIZE[1]);
        for _ in 0..2 {
            detector.collect_precise(&precise, 5, &LIT, &mut dn);
            assert_eq!(dn, single);
            detector.keep_charge();
        }
    }
}
