//! Stages that need more than one pixel or an earlier frame: charge image -> charge image, between shot noise and
//! readout. The list is empty when none is on; the detector then runs in one pass and keeps no charge image.
//!
//! A stage is an object: its state from frame to frame and its working memory are its own, made in
//! [`stages`], never in a frame. [`crate::detector::gpu::neighbours`] has the same list on a device.

use crate::detector::binning::{Binning, BinningKind, ChargeBinningStage};
use crate::detector::effect_order::{FrameAt, NeighbourStage};
use crate::detector::{DetectorParams, Effect, readout};
use crate::detector::{blooming::BloomingStage, charge_transfer::ChargeTransferStage, image_lag::ImageLagStage};
use base::image::Image;

/// Returns the stages that are on, in order; with `keep_charge` at least the full well, so that there is a charge
/// image.
pub fn stages(params: &DetectorParams, size_px: [usize; 2], keep_charge: bool) -> Vec<Box<dyn NeighbourStage>> {
    // Stages that are on are pushed here by their constructors, whichever order they come in.
    let mut stages: Vec<Box<dyn NeighbourStage>> = Vec::new();
    let spatial = &params.spatial;
    if let Some(lag) = &spatial.image_lag {
        stages.push(Box::new(ImageLagStage::new(lag, readout::limit_e(params), size_px)));
    }
    if let Some(transfer) = &spatial.charge_transfer {
        stages.push(Box::new(ChargeTransferStage::new(transfer, size_px)));
    }
    if let Some(Binning { factor, kind: BinningKind::Charge { full_well_e } }) = spatial.binning {
        stages.push(Box::new(ChargeBinningStage::new(factor, full_well_e, size_px)));
    }
    let full_well_e = readout::limit_e(params);
    if let Some(blooming) = &spatial.blooming {
        stages.push(Box::new(BloomingStage::new(blooming, full_well_e, size_px)));
    } else if keep_charge || !stages.is_empty() {
        // In one pass the full well is clipped block by block; here it must be a stage between its neighbours.
        stages.push(Box::new(ClipFullWell { full_well_e }));
    }
    stages.sort_by_key(|stage| crate::detector::ORDER.iter().position(|effect| *effect == stage.effect()));
    stages
}

/// [`readout::clip`] on a charge image.
#[derive(Debug)]
struct ClipFullWell {
    full_well_e: f32,
}

impl NeighbourStage for ClipFullWell {
    fn effect(&self) -> Effect {
        Effect::FullWell
    }

    fn apply<'a>(&'a mut self, charge: &'a mut Image<f32>, _at: &FrameAt) -> &'a mut Image<f32> {
        readout::clip(charge.pixels_mut(), self.full_well_e);
        charge
    }
}
