//! Planner and imager together, for the camera's own optics and for others that faults switch to.
//!
//! In: parameters of a run, sources. Out: plans and images. Each set of optics has a planner of its own and tables of its
//! own in the imager, under one index; both are switched at once, within a frame. Tests:
//! `tests/closed_loop/imaging_faults.rs`.

use crate::runtime::{error::Result, imager::Imager, params::RunParams};
use base::axes::Rotation;
use config::Overlap;
use plan::attitude::{JitterTrack, LosPath};
use plan::exposure::{Instrument, Planner, Source, SourcePlace, target::Target};
use plan::optics::PsfModel;
use scene::field_light::illumination_map;

/// Plans exposures and draws them.
pub struct Drawer {
    /// The planner of the optics in use.
    pub planner: Planner,
    /// The backend and the detector.
    pub imager: Imager,
    /// Planners of other optics; the entry of the optics in use is empty.
    optics: Vec<Option<Planner>>,
    /// Index of the optics in use.
    in_use: usize,
}

impl Drawer {
    /// Returns a drawer with the camera's own optics.
    pub(super) fn new(params: &RunParams, mut imager: Imager) -> Result<Self> {
        imager.disturbances_mut().defects_mut().set_frame_period_s(params.frame_period.s());
        let (camera, attitude) = (&params.camera, &params.attitude);
        let mut los = LosPath::commanded(Rotation::IDENTITY, params.first_exposure, camera.exposure_s);
        los.jitter = JitterTrack::with_capacity(attitude.jitter_lines.len(), attitude.settings.jitter_history.capacity);
        let planner = new_planner(params, &imager, los, None);
        if params.target_overlap == Overlap::Brighter && params.has_targets() {
            imager.keep_brighter()?;
        }
        if let Some(map) = illumination_map(camera) {
            imager.set_illumination_map(map)?;
        }
        Ok(Self { planner, imager, optics: vec![None], in_use: 0 })
    }

    /// Prepares other optics so that they can be switched to within a frame; returns their index. They replace `spare`
    /// ones, which are not in use and will not be again: these are freed first, so that the new ones take their memory.
    ///
    /// # Errors
    /// When the backend cannot build another set of tables.
    pub(super) fn add_optics(&mut self, params: &RunParams, spare: Option<usize>, psf: PsfModel) -> Result<usize> {
        let number = spare.unwrap_or(self.optics.len());
        match spare {
            Some(number) => self.optics[number] = None,
            None => self.imager.add_tables()?,
        }
        match (self.make_optics(params, number, psf), spare) {
            (Ok(planner), Some(_)) => self.optics[number] = Some(planner),
            (Ok(planner), None) => self.optics.push(Some(planner)),
            (Err(error), spare) => {
                // Tables and optics have the same indices: remove both or none.
                if spare.is_none() {
                    self.imager.remove_last_tables();
                }
                return Err(error);
            }
        }
        Ok(number)
    }

    /// Returns a planner for other optics, whose tables are built at `number`.
    fn make_optics(&mut self, params: &RunParams, number: usize, psf: PsfModel) -> Result<Planner> {
        let los = self.planner.latest().motion.los.clone();
        let mut planner = new_planner(params, &self.imager, los, Some(psf));
        // Drawing one star once builds all tables.
        let camera = &params.camera.geometry;
        let middle = [0.5 * camera.width_px() as f64, 0.5 * camera.height_px() as f64];
        let star = Source { id: 0, electrons: 1e4, mag: f32::NAN, place: SourcePlace::Pixel(middle) };
        let before = self.imager.use_tables(number);
        let drawn = self.imager.render(planner.plan(&[star])).map(|_| ());
        self.imager.use_tables(before);
        drawn?;
        Ok(planner)
    }

    /// Switches to optics that have been prepared; 0 are the camera's own.
    pub(super) fn use_optics(&mut self, number: usize) {
        if let Some(next) = self.optics.get_mut(number).and_then(Option::take) {
            let before = core::mem::replace(&mut self.planner, next);
            self.optics[self.in_use] = Some(before);
            self.in_use = number;
            self.imager.use_tables(number);
        }
    }

    /// Sets the scripted targets in place of those of the bench; allocates, so it is for single images.
    pub fn set_targets(&mut self, targets: &[Target]) {
        let others = self.optics.iter_mut().flatten();
        others.chain([&mut self.planner]).for_each(|planner| planner.set_targets(targets.to_vec()));
    }

    /// Draws the mean electrons of one target alone, along the motion of the latest image; they stay in the imager. The
    /// targets are gone then: set them before the next image. For single images.
    ///
    /// # Errors
    /// When the backend failed.
    pub fn draw_target_alone(&mut self, target: &Target) -> Result<()> {
        self.set_targets(&[]);
        // A planned target has the light that reaches the detector.
        self.planner.set_target_light(1.0);
        self.planner.set_targets_on_sky(&[*target]);
        self.imager.render(self.planner.plan(&[]))?;
        Ok(())
    }
}

/// Returns a planner of the run, for the camera's own optics or for others.
fn new_planner(params: &RunParams, imager: &Imager, los: LosPath, psf: Option<PsfModel>) -> Planner {
    let (camera, cost) = (&params.camera, params.cost.unwrap_or(imager.cost));
    let own = camera.instrument();
    let instrument = Instrument { psf: psf.unwrap_or_else(|| own.psf.clone()), ..own };
    let mut planner = Planner::new(instrument, params.budget, cost, params.method, los);
    if params.degrade && !imager.is_exact() {
        planner = planner.within_ms(params.drawing_budget_ms(&cost)).down_to(params.last_degradation);
    }
    if imager.is_exact() {
        planner = planner.exact();
    }
    planner.set_targets(params.targets.clone());
    planner.reserve_targets_on_sky(params.sky_targets.len());
    planner
}
