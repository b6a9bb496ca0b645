//! Settings -> the terminal's modes, read back and compared.

use super::{FlowControl, Parity, SerialParams, StopBits};
use rustix::termios::{ControlModes, InputModes, OptionalActions, Termios, tcgetattr, tcsetattr};
use std::{io, os::fd::BorrowedFd};

/// Both ends of an asynchronous line tolerate together 5 % in the last bit of a byte: 2 % is each end's share, with a
/// margin.
const BAUD_TOLERANCE: f64 = 0.02;

const LINE: ControlModes = ControlModes::CSIZE
    .union(ControlModes::PARENB)
    .union(ControlModes::PARODD)
    .union(ControlModes::CSTOPB)
    .union(ControlModes::CRTSCTS);

/// Sets a port, and refuses settings that the driver did not take. `Err` says wanted and got.
pub(super) fn apply(fd: BorrowedFd<'_>, params: &SerialParams) -> io::Result<()> {
    if params.flow == FlowControl::Software {
        let why = "software flow control eats bytes 0x11 and 0x13, which packets contain; use hardware or none";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, why));
    }
    if params.baud == 0 {
        let why = "a baud rate of 0 hangs up; use that of the other end";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, why));
    }
    let mut wanted = tcgetattr(fd)?;
    write_modes(&mut wanted, params)?;
    tcsetattr(fd, OptionalActions::Now, &wanted)?;
    compare(params, &wanted, &tcgetattr(fd)?)
}

fn write_modes(modes: &mut Termios, params: &SerialParams) -> io::Result<()> {
    modes.make_raw();
    // Bytes with parity or framing errors, and breaks, are marked: `unmark` takes the marks out.
    modes.input_modes.insert(InputModes::INPCK | InputModes::PARMRK);
    modes.input_modes.remove(InputModes::IXOFF | InputModes::IXANY | InputModes::IGNPAR);
    modes.control_modes.remove(LINE);
    modes.control_modes.insert(ControlModes::CREAD | ControlModes::CLOCAL | line(params));
    modes.set_speed(params.baud).map_err(io::Error::from)
}

fn line(params: &SerialParams) -> ControlModes {
    let parity = match params.parity {
        Parity::None => ControlModes::empty(),
        Parity::Even => ControlModes::PARENB,
        Parity::Odd => ControlModes::PARENB | ControlModes::PARODD,
    };
    let stop = if params.stop_bits == StopBits::Two { ControlModes::CSTOPB } else { ControlModes::empty() };
    let flow = if params.flow == FlowControl::Hardware { ControlModes::CRTSCTS } else { ControlModes::empty() };
    ControlModes::CS8 | parity | stop | flow
}

fn compare(params: &SerialParams, wanted: &Termios, got: &Termios) -> io::Result<()> {
    let differs = |what: &str, wanted: String, got: String| {
        Err(io::Error::other(format!("the driver did not take the {what}: wanted {wanted}, got {got}")))
    };
    let baud = got.output_speed();
    let error = (f64::from(baud) - f64::from(params.baud)).abs();
    if error > BAUD_TOLERANCE * f64::from(params.baud) || got.input_speed() != baud {
        return differs("baud rate", params.baud.to_string(), baud.to_string());
    }
    if !got.input_modes.contains(InputModes::PARMRK) {
        return differs("marking of damaged bytes", "PARMRK".into(), "none".into());
    }
    let (wanted, got) = (wanted.control_modes & LINE, got.control_modes & LINE);
    let names = [
        ("data bits", ControlModes::CSIZE),
        ("parity", ControlModes::PARENB | ControlModes::PARODD),
        ("stop bits", ControlModes::CSTOPB),
        ("hardware flow control", ControlModes::CRTSCTS),
    ];
    match names.into_iter().find(|(_, mode)| wanted & *mode != got & *mode) {
        Some((what, mode)) => differs(what, format!("{:?}", wanted & mode), format!("{:?}", got & mode)),
        None => Ok(()),
    }
}
