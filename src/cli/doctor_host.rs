//! `starloop doctor`, the hardware that the kernel's files list: CAN interfaces, serial ports, clocks, pulses, lines.

use crate::cli::doctor_finding::Finding;
use std::path::{Path, PathBuf};

/// Type of a network interface that is CAN, as the kernel numbers them.
const TYPE_CAN: &str = "280";
/// Largest packet of an interface with CAN FD, bytes.
const MTU_CAN_FD: &str = "72";

const ADVICE_NO_CAN: &str = "plug in an adapter, or make a virtual one: modprobe vcan && ip link add dev vcan0 type vcan \
                             && ip link set vcan0 mtu 72 up; where the kernel has no CAN: `starloop bus` and its slcan port";
const ADVICE_CAN_DOWN: &str =
    "ip link set NAME up type can bitrate 500000 dbitrate 2000000 fd on (host_setup.sh --apply does it)";
const ADVICE_NO_SERIAL: &str = "plug in an adapter; without one: a bench with a simulated serial line";
const ADVICE_SERIAL_RIGHTS: &str = "usermod -aG dialout NAME, then log in again";
const ADVICE_FTDI: &str = "echo 1 > /sys/bus/usb-serial/devices/NAME/latency_timer (the package's udev rule does it)";
const ADVICE_NO_PTP: &str =
    "a network card with a hardware clock, and linuxptp; without one: time correlation over the bus";
const ADVICE_NO_PPS: &str = "modprobe pps-gpio, or pps-ldisc with ldattach pps; without one: time marks on the bus";
const ADVICE_NO_GPIO: &str = "a board with GPIO lines; without one: triggers as messages on the bus";
const ADVICE_RIGHTS: &str = "the rules of the package give these to the group dialout; see src/guide/installing.md";

/// The machine's files, below a root.
#[derive(Debug, Clone)]
pub(super) struct Host {
    pub(super) root: PathBuf,
}

impl Host {
    /// Returns the machine that the program runs on; `STARLOOP_HOST_ROOT` names another root, for tests.
    pub(super) fn here() -> Self {
        Self { root: std::env::var_os("STARLOOP_HOST_ROOT").map_or_else(|| "/".into(), PathBuf::from) }
    }
}

/// Returns what the kernel's files list.
pub(super) fn findings(host: &Host) -> Vec<Finding> {
    vec![can(host), serial(host), ptp(host), pps(host), gpio(host)]
}

/// Returns the names in a folder, sorted; none where it cannot be read.
fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
    names.sort();
    names
}

/// Returns a file's text without the blanks around it; empty where it cannot be read.
pub(super) fn word(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_default().trim().to_owned()
}

/// Returns the CAN interfaces, with their state.
fn can(host: &Host) -> Finding {
    const NAME: &str = "CAN";
    let folder = host.root.join("sys/class/net");
    let is_can = |name: &String| word(&folder.join(name).join("type")) == TYPE_CAN;
    let found: Vec<String> = names(&folder).into_iter().filter(is_can).collect();
    if found.is_empty() {
        return Finding::missing(NAME, "no interface", ADVICE_NO_CAN);
    }
    let flags = |name: &str| u32::from_str_radix(word(&folder.join(name).join("flags")).trim_start_matches("0x"), 16);
    let is_up = |name: &str| flags(name).is_ok_and(|flags| flags & 1 == 1);
    let described = found.iter().map(|name| {
        let kind = if word(&folder.join(name).join("mtu")) == MTU_CAN_FD { "CAN FD" } else { "classic CAN" };
        format!("{name} ({kind}, {})", if is_up(name) { "up" } else { "down" })
    });
    let described = described.collect::<Vec<_>>().join(", ");
    match found.iter().find(|name| !is_up(name)) {
        None => Finding::ready(NAME, described),
        Some(down) => Finding::limited(NAME, described, ADVICE_CAN_DOWN.replace("NAME", down)),
    }
}

/// Returns the serial ports, and whether they may be opened.
fn serial(host: &Host) -> Finding {
    const NAME: &str = "serial ports";
    let devices = host.root.join("dev");
    let has_chip = |name: &str| !matches!(&*word(&host.root.join("sys/class/tty").join(name).join("type")), "" | "0");
    let is_port = |name: &String| {
        ["ttyUSB", "ttyACM", "ttyAMA"].iter().any(|kind| name.starts_with(kind))
            || name.starts_with("ttyS") && has_chip(name)
    };
    let ports: Vec<String> = names(&devices).into_iter().filter(is_port).collect();
    if ports.is_empty() {
        return Finding::missing(NAME, "none", ADVICE_NO_SERIAL);
    }
    let found = ports.join(", ");
    if let Some(closed) = ports.iter().find(|port| !may_use(&devices.join(port))) {
        return Finding::limited(NAME, format!("{found}; no right to open {closed}"), ADVICE_SERIAL_RIGHTS);
    }
    let adapters = host.root.join("sys/bus/usb-serial/devices");
    let timer = |name: &String| word(&adapters.join(name).join("latency_timer")).parse::<u32>().ok();
    let slow = names(&adapters).into_iter().find(|name| timer(name).is_some_and(|ms| ms > 1));
    match slow {
        Some(name) => {
            let found = format!("{found}; {name} passes bytes on after {} ms", timer(&name).unwrap_or_default());
            Finding::limited(NAME, found, ADVICE_FTDI.replace("NAME", &name))
        }
        None => Finding::ready(NAME, found),
    }
}

/// Returns the hardware clocks.
fn ptp(host: &Host) -> Finding {
    const NAME: &str = "PTP clocks";
    let clock_name = |name: &String| word(&host.root.join("sys/class/ptp").join(name).join("clock_name"));
    let clocks = names(&host.root.join("sys/class/ptp"));
    let described: Vec<String> = clocks.iter().map(|name| format!("{name} ({})", clock_name(name))).collect();
    devices(host, NAME, &clocks, described.join(", "), ADVICE_NO_PTP)
}

/// Returns the sources of pulses.
fn pps(host: &Host) -> Finding {
    const NAME: &str = "PPS sources";
    let sources = names(&host.root.join("sys/class/pps"));
    match sources.is_empty() {
        true => Finding::missing(NAME, "none", ADVICE_NO_PPS),
        false => Finding::ready(NAME, sources.join(", ")),
    }
}

/// Returns the chips whose lines may be triggers.
fn gpio(host: &Host) -> Finding {
    const NAME: &str = "GPIO chips";
    let chips: Vec<String> =
        names(&host.root.join("dev")).into_iter().filter(|name| name.starts_with("gpiochip")).collect();
    devices(host, NAME, &chips, chips.join(", "), ADVICE_NO_GPIO)
}

/// Returns devices of one kind, and whether they may be opened.
fn devices(host: &Host, name: &'static str, found: &[String], described: String, none: &str) -> Finding {
    let path = |device: &String| -> PathBuf { host.root.join("dev").join(device) };
    match found.iter().find(|device| !may_use(&path(device))) {
        _ if found.is_empty() => Finding::missing(name, "none", none),
        Some(closed) => Finding::limited(name, format!("{described}; no right to open {closed}"), ADVICE_RIGHTS),
        None => Finding::ready(name, described),
    }
}

/// Returns whether this program may read and write a device.
fn may_use(path: &Path) -> bool {
    use rustix::fs::{Access, access};
    access(path, Access::READ_OK | Access::WRITE_OK).is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::doctor_finding::State;

    fn host(files: &[(&str, &str)]) -> (tempfile::TempDir, Host) {
        let folder = tempfile::tempdir().unwrap();
        for (path, text) in files {
            let path = folder.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        let host = Host { root: folder.path().into() };
        (folder, host)
    }

    #[test]
    fn a_bare_machine_lacks_everything_and_is_given_advice() {
        let (_folder, host) =
            host(&[("sys/class/net/eth0/type", "1\n"), ("dev/ttyS0", ""), ("sys/class/tty/ttyS0/type", "0\n")]);
        for finding in findings(&host) {
            assert_eq!(finding.state, State::Missing, "{finding:?}");
            assert!(finding.advice.is_some(), "{finding:?}");
        }
    }

    #[test]
    fn interfaces_are_listed_with_their_kind_and_state() {
        let files = [
            ("sys/class/net/can0/type", "280\n"),
            ("sys/class/net/can0/flags", "0x40080\n"),
            ("sys/class/net/can0/mtu", "16\n"),
            ("sys/class/net/vcan0/type", "280\n"),
            ("sys/class/net/vcan0/flags", "0x400c1\n"),
            ("sys/class/net/vcan0/mtu", "72\n"),
        ];
        let (_folder, both) = host(&files);
        let finding = can(&both);
        assert_eq!(finding.found, "can0 (classic CAN, down), vcan0 (CAN FD, up)");
        assert!(finding.state == State::Limited && finding.advice.unwrap().contains("set can0 up"));
        let (_folder, one) = host(&files[3..]);
        assert_eq!(can(&one).state, State::Ready, "control");
    }

    #[test]
    fn ports_without_a_chip_do_not_count_and_slow_adapters_are_named() {
        let files = [
            ("dev/ttyS0", ""),
            ("dev/ttyS1", ""),
            ("dev/ttyUSB0", ""),
            ("sys/class/tty/ttyS0/type", "4\n"),
            ("sys/class/tty/ttyS1/type", "0\n"),
            ("sys/bus/usb-serial/devices/ttyUSB0/latency_timer", "16\n"),
        ];
        let (_folder, slow) = host(&files);
        let finding = serial(&slow);
        assert!(finding.found.starts_with("ttyS0, ttyUSB0; ttyUSB0 passes bytes on after 16 ms"), "{finding:?}");
        let (_folder, quick) = host(&files[..5]);
        assert_eq!(serial(&quick), Finding::ready("serial ports", "ttyS0, ttyUSB0"), "control");
    }

    #[test]
    fn clocks_have_their_names() {
        let (_folder, host) = host(&[("sys/class/ptp/ptp0/clock_name", "igc\n"), ("dev/ptp0", "")]);
        assert_eq!(ptp(&host), Finding::ready("PTP clocks", "ptp0 (igc)"));
    }
}
