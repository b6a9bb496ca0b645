//! The loop on the virtual clock: one thread, events in order of time, bit-identical whatever the machine does.
//!
//! Drawing takes no simulated time, so nothing is late; wall times per stage are measured all the same.

use crate::base::clock::{Clock, Stopwatch, Virtual};
use crate::base::time::{Span, Tai};
use crate::link::{LinkError, Port};
use crate::report::Stage;
use crate::runtime::engine::FrameEngine;
use crate::runtime::error::RunError;
use crate::runtime::outcome::RunOutcome;
use crate::runtime::receiver::Receiver;
use crate::runtime::record::{LinkReport, RunRecord};
use crate::runtime::reply;
use crate::sink::{SentFrame, Sink};

/// Runs every slot of the engine. `far_end` steps the other end of the cable to an instant and says when it next has
/// something to do; `progress` is called after each frame.
pub fn run(
    engine: &mut FrameEngine,
    receiver: &mut Receiver,
    port: &mut Port,
    clock: &Virtual,
    sink: &mut dyn Sink,
    far_end: &mut dyn FnMut(Tai) -> Result<Tai, LinkError>,
    progress: &mut dyn FnMut(&SentFrame, &RunRecord) -> bool,
) -> RunOutcome {
    let mut record = RunRecord::default();
    let mut run = VirtualRun { engine, receiver, port, clock, sink, far_end, progress };
    let error = run.frames(&mut record).err();
    let (sink, finishing) = match run.sink.finish() {
        Ok(summary) => (Some(summary), None),
        Err(error) => (None, Some(RunError::from(error))),
    };
    let link = LinkReport::of(run.port, 0);
    RunOutcome { record, link: Some(link), sink, error: error.or(finishing) }
}

struct VirtualRun<'a> {
    engine: &'a mut FrameEngine,
    receiver: &'a mut Receiver,
    port: &'a mut Port,
    clock: &'a Virtual,
    sink: &'a mut dyn Sink,
    far_end: &'a mut dyn FnMut(Tai) -> Result<Tai, LinkError>,
    progress: &'a mut dyn FnMut(&SentFrame, &RunRecord) -> bool,
}

impl VirtualRun<'_> {
    fn frames(&mut self, record: &mut RunRecord) -> Result<(), RunError> {
        let camera = &self.engine.params().camera;
        let (width, height) = (camera.geometry.width_px(), camera.geometry.height_px());
        let mut frame = SentFrame::with_capacity(width, height, 0, camera.name.clone());
        self.engine.warm_up(&mut frame)?;
        let mut next_due = (self.far_end)(self.clock.now())?;
        for number in 0..self.engine.params().frames {
            let slot = self.engine.slot(number);
            record.frames.scheduled += 1;
            while next_due <= slot.release {
                self.clock.advance_to(next_due);
                self.receive(record)?;
                next_due = (self.far_end)(next_due)?;
            }
            self.clock.advance_to(slot.release);
            self.receive(record)?;
            let mut watch = Stopwatch::start();
            let mut times = self.engine.expose(slot, self.receiver, &mut record.ledger, &mut frame)?;
            frame.meta.lateness = Span::ZERO;
            let drawn = watch.lap();
            self.sink.send(&frame)?;
            let sending = watch.lap();
            times.set(Stage::Sink, sending);
            times.set(Stage::ReleaseToDelivered, drawn + sending);
            record.count_rendered(&frame, &times);
            record.count_outgoing(&frame.meta);
            record.frames.delivered += 1;
            for message in reply::frame_messages(&frame.meta, self.receiver) {
                self.port.send(&message)?;
            }
            if !(self.progress)(&frame, record) {
                break;
            }
        }
        Ok(())
    }

    /// Takes in what has arrived by now.
    fn receive(&mut self, record: &mut RunRecord) -> Result<(), RunError> {
        while let Some(message) = self.port.receive(self.clock.now())? {
            if let Some(answer) = self.receiver.accept(&message, &mut record.ledger) {
                self.port.send(&answer)?;
            }
        }
        Ok(())
    }
}
