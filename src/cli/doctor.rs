//! `starloop doctor`: what this machine can do for a bench, and what to do where something is missing.

use crate::cli::doctor_finding::{Finding, State};
use crate::cli::{doctor_devices, doctor_host, doctor_system, version};
use crate::cli::{doctor_host::Host, report_json::print_json};
use anyhow::Result;
use clap::Args;
use serde::Serialize;

/// Command line of `doctor`.
#[derive(Debug, Args)]
#[command(after_help = "Looks and changes nothing. Whatever is missing, the exit status is 0: frames need none of it.")]
pub struct DoctorArgs {
    /// Print the findings as one line of JSON
    #[arg(long)]
    json: bool,
}

/// Everything that was found.
#[derive(Debug, Serialize)]
struct Report {
    version: &'static str,
    commit: &'static str,
    target: &'static str,
    features: Vec<&'static str>,
    findings: Vec<Finding>,
}

/// Runs the command.
///
/// # Errors
/// When the report cannot be printed.
pub fn run(arguments: &DoctorArgs) -> Result<()> {
    let host = Host::here();
    let findings = [doctor_host::findings(&host), doctor_devices::findings(), doctor_system::findings(&host)].concat();
    let report = Report {
        version: env!("CARGO_PKG_VERSION"),
        commit: version::COMMIT,
        target: version::TARGET,
        features: version::features(),
        findings,
    };
    if arguments.json {
        return print_json("doctor", &report);
    }
    print!("{}", text(&report));
    Ok(())
}

/// Returns the report for people.
fn text(report: &Report) -> String {
    let features = if report.features.is_empty() { "none".into() } else { report.features.join(", ") };
    let mut text =
        format!("starloop {} ({}), {}, features: {features}\n\n", report.version, report.commit, report.target);
    for Finding { name, state, found, advice } in &report.findings {
        text += &format!("{:<8} {name:<19} {found}\n", state.word());
        if let Some(advice) = advice {
            text += &format!("{:>29}{advice}\n", "-> ");
        }
    }
    let count = |wanted: State| report.findings.iter().filter(|finding| finding.state == wanted).count();
    text += &format!(
        "\n{} ready, {} limited, {} missing; frames on the CPU need none of what is missing\n",
        count(State::Ready),
        count(State::Limited),
        count(State::Missing)
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn advice_is_printed_below_what_needs_it_and_nowhere_else() {
        let findings = vec![Finding::ready("CAN", "can0"), Finding::missing("GPU", "none", "install a driver")];
        let report = Report { version: "1", commit: "2", target: "3", features: vec![], findings };
        let text = text(&report);
        assert!(text.contains("ready    CAN                 can0\nmissing  GPU                 none\n"), "{text}");
        assert!(text.contains("\n                          -> install a driver\n"), "{text}");
        assert_eq!(text.matches("-> ").count(), 1, "{text}");
        assert!(text.contains("1 ready, 0 limited, 1 missing"), "{text}");
    }

    #[test]
    fn every_finding_of_this_machine_that_is_not_ready_has_advice_and_names_are_unique() {
        let host = Host { root: "/".into() };
        let findings = [doctor_host::findings(&host), doctor_system::findings(&host)].concat();
        assert!(findings.len() >= 9);
        for finding in &findings {
            assert_eq!(finding.advice.is_none(), finding.state == State::Ready, "{finding:?}");
            assert!(!finding.found.is_empty(), "{finding:?}");
            assert_eq!(findings.iter().filter(|other| other.name == finding.name).count(), 1, "{finding:?}");
        }
    }
}
