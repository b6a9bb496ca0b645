//! `starloop doctor`, all that it looks for: devices in the kernel's files, the system, adapters and monitors.
//!
//! `starloop doctor`, the hardware that the kernel's files list: CAN interfaces, serial ports, clocks, pulses, lines.

use crate::cli::doctor::Finding;
use frames::report::Machine;
use image::gpu::GpuDevice;
use outputs::display::DisplayError;
use run::runtime::cost_cache;
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, capabilities};
use std::path::{Path, PathBuf};
use std::process::Command;

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
pub(crate) struct Host {
    pub(crate) root: PathBuf,
}

impl Host {
    /// Returns the machine that the program runs on; `STARLOOP_HOST_ROOT` names another root, for tests.
    pub(crate) fn here() -> Self {
        Self { root: std::env::var_os("STARLOOP_HOST_ROOT").map_or_else(|| "/".into(), PathBuf::from) }
    }
}

/// Returns what the kernel's files list.
pub(crate) fn findings(host: &Host) -> Vec<Finding> {
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
pub(crate) fn word(path: &Path) -> String {
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

// `starloop doctor`, the system: processors, memory, real-time rights, buffers, other programs, this program's own
// cache.

/// Priority that real-time threads of a run take at most.
const WANTED_PRIORITY: u64 = 50;
/// Receive buffer that a CAN socket asks for, bytes.
const WANTED_BUFFER_BYTES: u64 = 4 << 20;
/// Memory below which large cameras do not fit, MiB.
const WANTED_MEMORY_MIB: u64 = 1024;
/// Python packages of the scripts that talk over buses.
const PYTHON_PACKAGES: [&str; 3] = ["can", "cantools", "serial"];

const ADVICE_PRIORITY: &str =
    "host_setup.sh --apply writes /etc/security/limits.d/60-starloop.conf; then log in again (ulimit -r shows it)";
const ADVICE_LOCK: &str = "the same file sets memlock unlimited (ulimit -l shows it)";
const ADVICE_GOVERNOR: &str =
    "host_setup.sh --apply, or echo performance > /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor";
const ADVICE_BUFFER: &str = "sysctl net.core.rmem_max=4194304 (host_setup.sh --apply keeps it)";
const ADVICE_MEMORY: &str =
    "`starloop check` states the memory of a bench; smaller images and shorter queues take less";
const ADVICE_COSTS: &str = "`starloop calibrate` measures the costs of this machine, for runs on the real clock";
const ADVICE_PYTHON: &str = "apt-get install python3 python3-venv; only scripts and clients in Python need it";
const ADVICE_PACKAGES: &str =
    "pip install python-can cantools pyserial, in a virtual environment; only clients in Python need it";
const ADVICE_PTP4L: &str =
    "apt-get install linuxptp; only network cameras with PTP and machines with a common clock need it";

/// Returns what the system offers.
pub(crate) fn system_findings(host: &Host) -> Vec<Finding> {
    let mut findings = vec![processors(), memory(host)];
    findings.extend(rights());
    findings.extend([governor(host), receive_buffer(host)]);
    findings.extend([ptp_daemon(), python(), costs()]);
    findings
}

/// Returns the processors.
fn processors() -> Finding {
    let machine = Machine::read();
    Finding::ready("processors", format!("{}, {} threads, {}", machine.cpu, machine.cores, machine.system))
}

/// Returns the memory that is free for programs.
fn memory(host: &Host) -> Finding {
    const NAME: &str = "memory";
    let text = word(&host.root.join("proc/meminfo"));
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"));
    let mib = line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok()).unwrap_or_default() / 1024;
    let found = format!("{mib} MiB available");
    if mib < WANTED_MEMORY_MIB { Finding::limited(NAME, found, ADVICE_MEMORY) } else { Finding::ready(NAME, found) }
}

/// Returns whether threads may be real-time and memory may be locked.
fn rights() -> [Finding; 2] {
    let is_granted = |set| capabilities(None).is_ok_and(|sets| sets.effective.contains(set));
    let priority = getrlimit(Resource::Rtprio).current;
    let memory = getrlimit(Resource::Memlock).current;
    [
        priority_finding(is_granted(CapabilitySet::SYS_NICE), priority),
        lock_finding(is_granted(CapabilitySet::IPC_LOCK), memory),
    ]
}

fn priority_finding(is_granted: bool, limit: Option<u64>) -> Finding {
    const NAME: &str = "real-time priority";
    match limit {
        _ if is_granted => Finding::ready(NAME, "any (CAP_SYS_NICE)"),
        None => Finding::ready(NAME, "unlimited"),
        Some(limit) if limit >= WANTED_PRIORITY => Finding::ready(NAME, format!("up to {limit}")),
        Some(0) => Finding::missing(NAME, "not allowed", ADVICE_PRIORITY),
        Some(limit) => Finding::limited(NAME, format!("up to {limit}; wanted {WANTED_PRIORITY}"), ADVICE_PRIORITY),
    }
}

fn lock_finding(is_granted: bool, limit: Option<u64>) -> Finding {
    const NAME: &str = "locked memory";
    match limit {
        _ if is_granted => Finding::ready(NAME, "any (CAP_IPC_LOCK)"),
        None => Finding::ready(NAME, "unlimited"),
        Some(bytes) => Finding::limited(NAME, format!("{} KiB; wanted unlimited", bytes / 1024), ADVICE_LOCK),
    }
}

/// Returns the governor of the processors' frequency, and whether the kernel is a real-time one.
fn governor(host: &Host) -> Finding {
    const NAME: &str = "frequency governor";
    let kernel =
        if word(&host.root.join("sys/kernel/realtime")) == "1" { "PREEMPT_RT kernel" } else { "ordinary kernel" };
    match &*word(&host.root.join("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")) {
        "" => Finding::ready(NAME, format!("the system sets no frequencies; {kernel}")),
        "performance" => Finding::ready(NAME, format!("performance; {kernel}")),
        other => Finding::limited(NAME, format!("{other}; wanted performance; {kernel}"), ADVICE_GOVERNOR),
    }
}

/// Returns the largest receive buffer of a socket.
fn receive_buffer(host: &Host) -> Finding {
    const NAME: &str = "receive buffers";
    match word(&host.root.join("proc/sys/net/core/rmem_max")).parse::<u64>() {
        Ok(bytes) if bytes >= WANTED_BUFFER_BYTES => Finding::ready(NAME, format!("up to {bytes} bytes")),
        Ok(bytes) => {
            Finding::limited(NAME, format!("up to {bytes} bytes; wanted {WANTED_BUFFER_BYTES}"), ADVICE_BUFFER)
        }
        Err(_) => Finding::missing(NAME, "the limit cannot be read", ADVICE_BUFFER),
    }
}

/// Returns whether the program that disciplines clocks is installed.
fn ptp_daemon() -> Finding {
    const NAME: &str = "PTP daemon";
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let system = ["/usr/sbin".into(), "/sbin".into()];
    let found =
        std::env::split_paths(&folders).chain(system).map(|folder| folder.join("ptp4l")).find(|path| path.exists());
    found.map_or_else(
        || Finding::missing(NAME, "no ptp4l", ADVICE_PTP4L),
        |path| Finding::ready(NAME, path.display().to_string()),
    )
}

/// Returns Python and what the scripts import.
fn python() -> Finding {
    const NAME: &str = "Python";
    let script = format!(
        "import importlib.util as u, platform\nprint(platform.python_version(), \
         *[n for n in {PYTHON_PACKAGES:?} if u.find_spec(n) is None])"
    );
    let output = Command::new("python3").args(["-c", &script]).output().ok().filter(|output| output.status.success());
    let text = output.and_then(|output| String::from_utf8(output.stdout).ok()).unwrap_or_default();
    let mut words = text.split_whitespace();
    let Some(version) = words.next() else { return Finding::missing(NAME, "no python3", ADVICE_PYTHON) };
    let absent: Vec<&str> = words.collect();
    if absent.is_empty() {
        return Finding::ready(NAME, format!("{version} with {}", PYTHON_PACKAGES.join(", ")));
    }
    Finding::limited(NAME, format!("{version} without {}", absent.join(", ")), ADVICE_PACKAGES)
}

/// Returns whether the costs of frames were measured here.
fn costs() -> Finding {
    const NAME: &str = "measured costs";
    let Some(folder) = cost_cache::folder() else {
        return Finding::missing(NAME, "no home folder to keep them in", ADVICE_COSTS);
    };
    let files = std::fs::read_dir(&folder)
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| entry.file_name().into_string().ok());
    let mut files: Vec<String> = files.filter(|name| name.starts_with("costs_")).collect();
    files.sort();
    match files.is_empty() {
        true => Finding::missing(NAME, "none: runs use the built-in costs", ADVICE_COSTS),
        false => Finding::ready(NAME, format!("{} in {}", files.join(", "), folder.display())),
    }
}

// `starloop doctor`, devices that a library must ask for: GPU adapters and monitors.

const ADVICE_NO_GPU: &str =
    "install a Vulkan driver of the card (mesa-vulkan-drivers for AMD and Intel); until then the CPU draws";
const ADVICE_SOFTWARE: &str =
    "a card with a Vulkan driver; until then the CPU draws, which is faster than Vulkan in software";
const ADVICE_NOT_BUILT: &str = "install one with `cargo install --locked --path . --features display`; only displays in front of a tracker need it";
const ADVICE_DISPLAY: &str =
    "set DISPLAY to an X server, or log in at a desktop; only displays in front of a tracker need it";

/// Returns adapters and monitors.
pub(crate) fn device_findings() -> Vec<Finding> {
    vec![gpu(&GpuDevice::adapters()), display()]
}

/// Returns the GPU adapters, hardware before software.
fn gpu(adapters: &[(String, bool)]) -> Finding {
    const NAME: &str = "GPU adapters";
    let names = |is_software: bool| {
        let fitting = adapters.iter().filter(|(_, software)| *software == is_software);
        fitting.map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ")
    };
    match (names(false), names(true)) {
        (hardware, _) if !hardware.is_empty() => Finding::ready(NAME, hardware),
        (_, software) if !software.is_empty() => {
            Finding::limited(NAME, format!("only software Vulkan: {software}"), ADVICE_SOFTWARE)
        }
        _ => Finding::missing(NAME, "no Vulkan driver", ADVICE_NO_GPU),
    }
}

/// Returns the monitors.
fn display() -> Finding {
    const NAME: &str = "display";
    match outputs::display::monitors() {
        Ok(monitors) if !monitors.is_empty() => {
            Finding::ready(NAME, monitors.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "))
        }
        Ok(_) => Finding::missing(NAME, "an X server without a monitor", ADVICE_DISPLAY),
        Err(DisplayError::NotBuilt) => Finding::missing(NAME, "not in this build", ADVICE_NOT_BUILT),
        Err(error) => Finding::missing(NAME, error.to_string(), ADVICE_DISPLAY),
    }
}

#[cfg(test)]
mod doctor_host_tests {
    use super::*;
    use crate::cli::doctor::State;

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

#[cfg(test)]
mod doctor_system_tests {
    use super::*;
    use crate::cli::doctor::State;

    #[test]
    fn limits_are_judged_by_what_a_run_asks_for() {
        assert_eq!(priority_finding(false, Some(0)).state, State::Missing);
        assert_eq!(priority_finding(false, Some(10)).state, State::Limited);
        assert_eq!(priority_finding(false, Some(50)).state, State::Ready);
        assert_eq!(priority_finding(true, Some(0)).state, State::Ready, "the capability comes before the limit");
        assert_eq!(lock_finding(false, Some(65_536)).found, "64 KiB; wanted unlimited");
        assert_eq!(lock_finding(false, None).state, State::Ready);
    }

    #[test]
    fn files_of_the_system_are_judged() {
        let folder = tempfile::tempdir().unwrap();
        let host = Host { root: folder.path().into() };
        let write = |path: &str, text: &str| {
            let path = folder.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        assert_eq!(receive_buffer(&host).state, State::Missing);
        assert_eq!(governor(&host).state, State::Ready, "nothing to set");
        write("proc/sys/net/core/rmem_max", "212992\n");
        write("proc/meminfo", "MemTotal: 9\nMemAvailable:    2097152 kB\n");
        write("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "powersave\n");
        write("sys/kernel/realtime", "1\n");
        assert_eq!(receive_buffer(&host).state, State::Limited);
        assert_eq!(memory(&host), Finding::ready("memory", "2048 MiB available"));
        let governor = governor(&host);
        assert!(governor.state == State::Limited && governor.found.contains("PREEMPT_RT"), "{governor:?}");
        write("proc/sys/net/core/rmem_max", "4194304\n");
        assert_eq!(receive_buffer(&host).state, State::Ready, "control");
    }
}

#[cfg(test)]
mod doctor_devices_tests {
    use super::*;
    use crate::cli::doctor::State;

    #[test]
    fn hardware_is_ready_and_software_alone_is_limited() {
        let adapter = |name: &str, is_software| (name.to_owned(), is_software);
        assert_eq!(gpu(&[]).state, State::Missing);
        let software = gpu(&[adapter("llvmpipe", true)]);
        assert!(software.state == State::Limited && software.found.contains("llvmpipe"), "{software:?}");
        let both = gpu(&[adapter("llvmpipe", true), adapter("A card", false)]);
        assert_eq!(both, Finding::ready("GPU adapters", "A card"));
    }
}
