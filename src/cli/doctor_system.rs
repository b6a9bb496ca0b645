//! `starloop doctor`, the system: processors, memory, real-time rights, buffers, other programs, this program's own
//! cache.

use crate::cli::doctor_finding::Finding;
use crate::cli::doctor_host::{Host, word};
use frames::report::Machine;
use run::runtime::cost_cache;
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, capabilities};
use std::process::Command;

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
pub(super) fn findings(host: &Host) -> Vec<Finding> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::doctor_finding::State;

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
