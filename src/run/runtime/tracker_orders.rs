//! Converts camera requests of the built-in tracker to commands like those of any other client.

use base::time::Tai;
use frames::camera_control::{CameraCommand, CommandSource, Commanded};
use testbed::tracker::CameraWish;

/// Returns the commands for a request that came at `now`.
pub fn commands_of(wish: &CameraWish, now: Tai) -> impl Iterator<Item = Commanded> + use<> {
    let at = wish.from.max(now);
    let commands = [wish.regions.map(CameraCommand::Regions), wish.exposure.map(CameraCommand::Exposure)];
    commands.into_iter().flatten().map(move |command| Commanded { command, at, from: CommandSource::Tracker })
}
