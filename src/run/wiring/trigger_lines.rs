//! The GPIO lines of a bench -> chips to listen to, and heads that wait for their edges.

use crate::runtime::{Head, Ledger, edge_thread::TriggerChip};
use anyhow::{Context, Result, bail};
use base::clock::{Clock, PairedReading};
use config::{Bench, TriggerLine};
use frames::camera_control::{CameraCommand, CommandSource, Commanded};
use link::gpio::GpioChip;
use std::path::Path;

/// Opens each chip that a line names, with all its lines.
///
/// # Errors
/// When a chip or a line does not exist, or is in use by another program.
pub(super) fn open_chips(bench: &Bench, clock: &dyn Clock) -> Result<Vec<TriggerChip>> {
    let mut chips: Vec<&Path> = bench.trigger_lines.iter().map(|line| line.chip.as_path()).collect();
    chips.sort_unstable();
    chips.dedup();
    let open = |path: &Path| {
        let of_chip: Vec<&TriggerLine> = bench.trigger_lines.iter().filter(|line| line.chip == path).collect();
        let lines: Vec<_> = of_chip.iter().map(|line| line.line.clone()).collect();
        let chip = GpioChip::open(path, &lines, PairedReading::take(clock)).context("[[trigger_line]]")?;
        Ok(TriggerChip { chip, heads: of_chip.iter().map(|line| line.head).collect() })
    };
    chips.into_iter().map(open).collect()
}

/// Makes heads wait for the edges of their lines from the first exposure on.
///
/// # Errors
/// When a line triggers a head that the run does not have, or one that cannot be commanded.
pub(super) fn arm(bench: &Bench, heads: &mut [Head]) -> Result<()> {
    let count = heads.len();
    for (place, line) in bench.trigger_lines.iter().enumerate() {
        if let Some(head) = line.head.filter(|head| *head >= count) {
            bail!("trigger_line[{place}].head: got {head}, wanted a head of the run, 0 to {}", count - 1);
        }
        let is_of_line = |number: usize| line.head.is_none_or(|head| head == number);
        for head in heads.iter_mut().enumerate().filter(|(number, _)| is_of_line(*number)).map(|(_, head)| head) {
            let at = head.engine.params().first_exposure;
            let exposing = head.engine.exposing_mut();
            if exposing.range().is_none() {
                bail!(
                    "trigger_line[{place}]: a frame that is drawn for a display has no exposure to start; leave the line out"
                );
            }
            exposing.set_has_line();
            let commands = [CameraCommand::Mode(line.mode), CameraCommand::Triggered(true)];
            for command in commands.into_iter().take(if line.is_armed { 2 } else { 1 }) {
                let commanded = Commanded { command, at, from: CommandSource::Line };
                exposing.take(&commanded, &mut Ledger::default()).context("[[trigger_line]]")?;
            }
        }
    }
    Ok(())
}
