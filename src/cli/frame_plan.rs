//! The plan of one frame of a bench, without drawing it: from the simulated flight computer's own truth.

use anyhow::{Context, Result};
use base::{axes::Rotation, time::Span};
use plan::exposure::{ExposurePlan, Planner};
use plan::{attitude::LosPath, exposure::cost::CostModel};
use run::runtime::RunParams;
use scene::Scene;
use stars::Sky;
use testbed::flight_computer::FlightComputer;

/// Everything but the planner.
pub(super) struct FramePlans<'a> {
    params: &'a RunParams,
    computer: FlightComputer,
    scene: Scene,
}

impl<'a> FramePlans<'a> {
    /// Plans the frames of a run whose attitude this flight computer sends.
    pub(super) fn new(computer: FlightComputer, params: &'a RunParams, sky: &Sky) -> Self {
        Self { params, computer, scene: Scene::new(&params.scene(&params.almanac()), sky) }
    }

    /// Returns a planner that weighs every method; with a limit, one that also takes degradation levels.
    pub(super) fn planner(&self, cost: CostModel, limit_ms: Option<f64>) -> Planner {
        let RunParams { camera, budget, method, .. } = self.params;
        let los = LosPath::commanded(Rotation::IDENTITY, self.params.first_exposure, camera.exposure_s);
        let mut planner = Planner::new(camera.instrument(), *budget, cost, *method, los).thorough();
        planner.set_targets(self.params.targets.clone());
        match limit_ms {
            Some(limit_ms) => planner.within_ms(limit_ms).down_to(self.params.last_degradation),
            None => planner,
        }
    }

    /// Returns what shines into the frames.
    pub(super) fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Returns whether frame `number` has an attitude.
    pub(super) fn has_attitude(&self, number: u32) -> bool {
        let half = Span::from_s(0.5 * self.params.camera.exposure_s);
        self.computer.truth(self.params.exposure_start(number) + half).is_some()
    }

    /// Plans frame `number`.
    ///
    /// # Errors
    /// When the observer's orbit cannot be computed.
    pub(super) fn plan<'p>(&mut self, number: u32, planner: &'p mut Planner) -> Result<&'p ExposurePlan> {
        let attitude = &self.params.attitude;
        let los = &mut planner.motion_mut().los;
        los.exposure_start = self.params.exposure_start(number);
        let at = los.mid_exposure();
        let truth = self.computer.truth(at).with_context(|| format!("frame {number}: no attitude at {at}"))?;
        let mount = attitude.sensor_from_body;
        los.mid_sensor_from_icrf = mount * truth.body_from_icrf;
        los.rate_rad_s = mount.apply(truth.rate_rad_s);
        los.acceleration_rad_s2 = mount.apply(truth.acceleration_rad_s2);
        los.jitter.lines.clone_from(&attitude.jitter_lines);
        los.jitter.lines_epoch = attitude.jitter_epoch;
        let los = &planner.latest().motion.los;
        self.scene.find(los, true)?;
        planner.set_targets_on_sky(self.scene.targets.in_view());
        Ok(planner.plan(self.scene.sources()))
    }
}
