//! The suite on serial ports over pseudo terminals.

use crate::ends::clock;
use base::clock::Clock;
use starloop_link::conformance::{Ends, check_link};
use starloop_link::serial::{PseudoTerminal, SerialLink, SerialParams};
use starloop_link::{LinkError, WireFormat};
use std::sync::Arc;

/// 300 baud: a write waits long enough for any reader on a busy machine.
const PATIENT_BAUD: u32 = 300;

fn ends(clock: &Arc<dyn Clock>) -> Result<Ends, LinkError> {
    let terminal = PseudoTerminal::open()?;
    let near = SerialLink::open(SerialParams::new(terminal.path(), PATIENT_BAUD), clock)?;
    Ok((Box::new(near), Box::new(SerialLink::of_terminal(terminal, PATIENT_BAUD, clock))))
}

#[test]
fn serial_ports_keep_every_promise() {
    let clock = clock();
    let report = check_link("pseudo terminal", WireFormat::Serial, &clock, || ends(&clock)).unwrap();
    for check in &report.checks {
        println!("{}: {}", check.promise, check.seen);
    }
}
