//! Setting with which the sinks of one camera head are made.

use crate::runtime::exposing::Exposing;
use base::{clock::Clock, time::Span};
use core::cell::RefCell;
use frames::{camera_control::DeskEnd, sink::SentFrame};
use outputs::display::calibration::Calibration;
use scene::camera::CameraParams;
use std::{path::Path, sync::Arc};

/// Parameters of the sinks of one camera head.
pub struct SinkSetting<'a> {
    /// Directory of the run, for sinks that write files; each of several heads has its own in it. `None`: no sink
    /// writes files.
    pub directory: Option<&'a Path>,
    /// A frame with the size, star capacity and camera of the frames to come.
    pub prototype: &'a SentFrame,
    /// Which camera head, when there are several.
    pub head: Option<usize>,
    /// True when the run must not wait for sinks.
    pub is_real: bool,
    /// The camera that makes the frames.
    pub camera: &'a CameraParams,
    /// Time from one exposure's start to the next.
    pub frame_period: Span,
    /// The calibration of the display that the run is drawn for, if it is drawn for one.
    pub calibration: Option<&'a Calibration>,
    /// The run's clock.
    pub clock: &'a Arc<dyn Clock>,
    /// Exposures that clients of network cameras command, and where their queues are put; `None`: clients only read.
    pub commands: Option<(&'a Exposing, &'a RefCell<Vec<DeskEnd>>)>,
}
