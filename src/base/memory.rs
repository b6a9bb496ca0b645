//! Memory that this process may still take, from the numbers that Linux publishes.
//!
//! Input: `/proc/meminfo`, `/proc/self`, the control group (version 2), resource limits. Output: bytes and the limit
//! that they come from. Two questions have two answers: memory of any kind (the machine's and the control group's, a
//! file in `/dev/shm` included) and memory in the process's own address space (`ulimit -v`, `ulimit -d`). Without swap:
//! a frame must not wait for a disk. A limit that cannot be read is ignored. Limits: Linux; elsewhere nothing is known.

use core::fmt;

/// A limit of memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MemoryLimit {
    /// Memory of the machine that is free or can be freed without swapping.
    Machine,
    /// Limit of a control group, such as a container's.
    ControlGroup,
    /// Limit of the process's address space.
    AddressSpace,
    /// Limit of the process's private memory.
    Data,
    /// Memory that the system still promises, where it promises at most what it has (`vm.overcommit_memory = 2`).
    Commit,
}

impl fmt::Display for MemoryLimit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Machine => "on this machine (MemAvailable)",
            Self::ControlGroup => "below the control group's limit (memory.max)",
            Self::AddressSpace => "below the limit of the address space (ulimit -v)",
            Self::Data => "below the limit of private memory (ulimit -d)",
            Self::Commit => "that the system still promises (CommitLimit)",
        })
    }
}

/// Memory that may still be taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Available {
    /// Bytes.
    pub bytes: u64,
    /// Where they end.
    pub limit: MemoryLimit,
}

/// Returns how much memory of any kind may still be taken; `None` where the system does not say.
pub fn available() -> Option<Available> {
    least([
        number_of("/proc/meminfo", "MemAvailable:").map(|bytes| Available { bytes, limit: MemoryLimit::Machine }),
        control_group().map(|bytes| Available { bytes, limit: MemoryLimit::ControlGroup }),
    ])
}

/// Returns how much the process's private memory may still grow; `None` where it has no limit.
pub fn available_in_process() -> Option<Available> {
    let left = |limit: Option<u64>, key: &str| Some(limit?.saturating_sub(number_of("/proc/self/status", key)?));
    let [space, data] = own_limits();
    least([
        left(space, "VmSize:").map(|bytes| Available { bytes, limit: MemoryLimit::AddressSpace }),
        left(data, "VmData:").map(|bytes| Available { bytes, limit: MemoryLimit::Data }),
        promised().map(|bytes| Available { bytes, limit: MemoryLimit::Commit }),
    ])
}

fn least<const N: usize>(found: [Option<Available>; N]) -> Option<Available> {
    found.into_iter().flatten().min_by_key(|available| available.bytes)
}

fn own_limits() -> [Option<u64>; 2] {
    use rustix::process::{Resource, getrlimit};
    [Resource::As, Resource::Data].map(|resource| getrlimit(resource).current)
}

fn promised() -> Option<u64> {
    let policy = std::fs::read_to_string("/proc/sys/vm/overcommit_memory").ok()?;
    let is_strict = policy.trim() == "2";
    let number = |key| number_of("/proc/meminfo", key).filter(|_| is_strict);
    Some(number("CommitLimit:")?.saturating_sub(number("Committed_AS:")?))
}

/// Returns a line such as `MemAvailable:   123 kB`, in bytes.
fn number_of(path: &str, key: &str) -> Option<u64> {
    let text = std::fs::read_to_string(path).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix(key))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// Returns the least that is left in the control group of this process and those above it.
fn control_group() -> Option<u64> {
    let own = std::fs::read_to_string("/proc/self/cgroup").ok()?;
    let own = own.lines().find_map(|line| line.strip_prefix("0::"))?.trim_start_matches('/');
    let root = std::path::Path::new("/sys/fs/cgroup");
    let group = root.join(own);
    group.ancestors().take_while(|folder| folder.starts_with(root)).filter_map(left_in_group).min()
}

fn left_in_group(folder: &std::path::Path) -> Option<u64> {
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).ok();
    // "max" means: without a limit.
    let most: u64 = read("memory.max")?.trim().parse().ok()?;
    let used: u64 = read("memory.current")?.trim().parse().ok()?;
    // Pages of files that are not in use are given up first.
    let stat = read("memory.stat").unwrap_or_default();
    let files = stat.lines().find_map(|line| line.strip_prefix("inactive_file ")?.trim().parse().ok()).unwrap_or(0);
    Some(most.saturating_sub(used.saturating_sub(files)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn machine_memory_is_known_and_is_less_than_the_whole() {
        let found = available().expect("Linux says");
        let whole = number_of("/proc/meminfo", "MemTotal:").unwrap();
        assert!(found.bytes > 0 && found.bytes < whole, "{found:?} of {whole}");
        assert_eq!(number_of("/proc/meminfo", "NoSuchLine:"), None);
        assert_eq!(number_of("/no/such/file", "MemTotal:"), None);
    }

    #[test]
    fn control_group_counts_what_is_left_and_files_that_no_one_reads() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        assert_eq!(left_in_group(folder.path()), None);
        write("memory.max", "1000\n");
        write("memory.current", "700\n");
        write("memory.stat", "anon 500\ninactive_file 150\n");
        assert_eq!(left_in_group(folder.path()), Some(450));
        write("memory.max", "max\n");
        assert_eq!(left_in_group(folder.path()), None, "no limit");
    }
}
