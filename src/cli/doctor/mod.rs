//! `starloop doctor`: what this machine can do for a bench, and what to do where something is missing.

use crate::cli::{doctor::host::Host, report_json::print_json, version};
use anyhow::Result;
use clap::Args;
use serde::Serialize;

mod host;

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
    let findings = [host::findings(&host), host::device_findings(), host::system_findings(&host)].concat();
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
        text += &format!("{:<8} {name:<19} {found}\n", state.name());
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

// One thing that `starloop doctor` looked for: whether it is there, and what to do where it is not.

base::words! {
    /// Whether something is there.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
    #[serde(rename_all = "snake_case")]
    pub(crate) enum State {
        /// It is there and may be used.
        Ready = "ready",
        /// It is there, but not as good as it could be.
        Limited = "limited",
        /// It is not there.
        Missing = "missing",
    }
}

/// One thing that was looked for.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct Finding {
    /// Short name, the same in every report.
    pub(crate) name: &'static str,
    pub(crate) state: State,
    /// The things that were found, in words.
    pub(crate) found: String,
    /// The step that makes it ready; `None` where it is.
    pub(crate) advice: Option<String>,
}

impl Finding {
    /// Returns something that is there.
    pub(crate) fn ready(name: &'static str, found: impl Into<String>) -> Self {
        Self { name, state: State::Ready, found: found.into(), advice: None }
    }

    /// Returns something that is there in part.
    pub(crate) fn limited(name: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { name, state: State::Limited, found: found.into(), advice: Some(advice.into()) }
    }

    /// Returns something that is not there.
    pub(crate) fn missing(name: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { name, state: State::Missing, found: found.into(), advice: Some(advice.into()) }
    }
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
        let findings = [host::findings(&host), host::system_findings(&host)].concat();
        assert!(findings.len() >= 9);
        for finding in &findings {
            assert_eq!(finding.advice.is_none(), finding.state == State::Ready, "{finding:?}");
            assert!(!finding.found.is_empty(), "{finding:?}");
            assert_eq!(findings.iter().filter(|other| other.name == finding.name).count(), 1, "{finding:?}");
        }
    }
}
