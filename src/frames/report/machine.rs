//! The machine a run was measured on, since its times mean nothing without it.

use serde::Serialize;

/// Processor and system.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Machine {
    /// Processor model; `unknown` where the system does not say.
    pub cpu: String,
    /// Hardware threads this program may use; 0 when unknown.
    pub cores: usize,
    /// Operating system and architecture.
    pub system: String,
}

impl Machine {
    /// Asks the system.
    pub fn read() -> Self {
        let cpuinfo = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        Self {
            cpu: cpu_model(&cpuinfo).unwrap_or("unknown").to_owned(),
            cores: std::thread::available_parallelism().map_or(0, usize::from),
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        }
    }
}

/// Returns the first model named in the text of `/proc/cpuinfo` (x86: `model name`, Arm boards: `Model`).
fn cpu_model(cpuinfo: &str) -> Option<&str> {
    let value = |wanted: &str| {
        cpuinfo
            .lines()
            .filter_map(|line| line.split_once(':'))
            .find(|(key, _)| key.trim() == wanted)
            .map(|(_, v)| v.trim())
    };
    value("model name").or_else(|| value("Model")).filter(|model| !model.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_model_is_found_on_both_kinds_of_machine() {
        assert_eq!(
            cpu_model("processor\t: 0\nmodel name\t: Example CPU @ 2 GHz\nmodel\t: 7\n"),
            Some("Example CPU @ 2 GHz")
        );
        assert_eq!(cpu_model("processor\t: 0\nModel\t\t: Example Board 4\n"), Some("Example Board 4"));
        assert_eq!(cpu_model("processor : 0\n"), None);
        assert_eq!(cpu_model(""), None);
    }

    #[test]
    fn this_machine_answers() {
        let machine = Machine::read();
        assert!(!machine.cpu.is_empty() && !machine.system.is_empty(), "{machine:?}");
    }
}
