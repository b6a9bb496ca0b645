//! The flight computer's loop, for a thread of its own.

use super::{FlightComputer, FlightError};
use base::clock::Clock;
use core::sync::atomic::{AtomicBool, Ordering};
use link::Port;

/// Sleeps to each due time and sends, until `stop` is set; notices that within 0.1 s, the period of SYNC.
///
/// # Errors
/// When the port refuses a message or fails.
pub fn run_until(
    stop: &AtomicBool,
    clock: &dyn Clock,
    computer: &mut FlightComputer,
    port: &mut Port,
) -> Result<(), FlightError> {
    while !stop.load(Ordering::Relaxed) {
        clock.sleep_until(computer.next_due());
        computer.step(clock.now(), port)?;
    }
    Ok(())
}
