//! Bounded queues between the senders of camera commands and the loop that exposes its frames.

use crate::camera_control::settings::Commanded;
use base::time::{Span, Tai};
use crossbeam_channel::{Receiver, Sender, TryIter, bounded};

/// Commands, and events, that may wait.
const PLACES: usize = 256;

/// An event that a camera reports to its client.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CameraEventKind {
    /// A trigger was accepted.
    FrameTrigger,
    /// From now on a trigger is awaited, and would be taken at once, or is not.
    TriggerAwaited(bool),
    /// A trigger came too early and was left out.
    FrameTriggerMissed,
    /// An exposure began.
    ExposureStart,
    /// An exposure ended.
    ExposureEnd,
    /// Automatic exposure has chosen this integration time.
    ExposureChosen(Span),
    /// Automatic gain has chosen this gain, dB.
    GainChosen(f64),
    /// The image is as bright as wanted: automatic exposure, which was to work once, is off.
    ExposureAutoDone,
    /// The same of automatic gain.
    GainAutoDone,
}

/// A report with its instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraEvent {
    /// Kind of the event.
    pub kind: CameraEventKind,
    /// When, on the bench clock.
    pub at: Tai,
    /// Frame number in the run that it belongs to.
    pub frame: u32,
}

/// The end of the senders of commands. Both directions never wait.
#[derive(Debug, Clone)]
pub struct CameraDesk {
    commands: Sender<Commanded>,
    events: Receiver<CameraEvent>,
}

/// The end of the loop that exposes.
#[derive(Debug)]
pub struct DeskEnd {
    commands: Receiver<Commanded>,
    events: Sender<CameraEvent>,
}

/// Makes both ends.
pub fn desk() -> (CameraDesk, DeskEnd) {
    let (commands, taken) = bounded(PLACES);
    let (reported, events) = bounded(PLACES);
    (CameraDesk { commands, events }, DeskEnd { commands: taken, events: reported })
}

impl CameraDesk {
    /// Puts a command; false when the queue is full or the run is over, and the command is lost.
    pub fn put(&self, commanded: Commanded) -> bool {
        self.commands.try_send(commanded).is_ok()
    }

    /// Returns the events that have come.
    pub fn events(&self) -> TryIter<'_, CameraEvent> {
        self.events.try_iter()
    }
}

impl DeskEnd {
    /// Returns the commands that have come, in order.
    pub fn commands(&self) -> TryIter<'_, Commanded> {
        self.commands.try_iter()
    }

    /// Reports an event; one that finds the queue full is lost, as GigE Vision's events may be.
    pub fn report(&self, event: CameraEvent) -> bool {
        self.events.try_send(event).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera_control::{CameraCommand, CommandSource};

    #[test]
    fn queues_are_bounded_and_keep_the_order() {
        let (desk, end) = desk();
        let command = |frames| Commanded {
            command: CameraCommand::Burst(frames),
            at: Tai::from_ns(7),
            from: CommandSource::Control,
        };
        let put = (0..300).filter(|frames| desk.put(command(*frames))).count();
        assert_eq!(put, PLACES);
        let taken: Vec<Commanded> = end.commands().collect();
        assert_eq!((taken.len(), taken[0], taken[PLACES - 1]), (PLACES, command(0), command(255)));
        assert!(end.report(CameraEvent { kind: CameraEventKind::ExposureEnd, at: Tai::from_ns(1), frame: 3 }));
        assert_eq!(desk.events().count(), 1);
        drop(end);
        assert!(!desk.put(command(1)), "the run is over");
    }
}
