//! `starloop report`: a tracker's log compared with the truth of a run, or of a flown plan.

use crate::cli::{EXIT_DONE, EXIT_NOT_MET, provenance, report_json::json_line};
use anyhow::{Context, Result, bail};
use base::input_file::{SETTINGS_BYTES, read_text};
use clap::Args;
use frames::sink::write_file_atomically;
use performance::assess::{Assessment, assess};
use performance::case_folder::{CASE, LOG, PLAN, PlanFile, read_case};
use performance::metric::{Settings, check_share};
use performance::provenance::{FileHash, Paperwork, Provenance};
use performance::report::{MOST_HTML_BYTES, Report, to_html, to_junit};
use performance::{
    find_axes::find_axes,
    log_form::{Axes, LogForm, Roll},
    record::Case,
    requirements::Requirements,
};
use run::wiring::sinks::directory_of_head;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Names of browsers that print to PDF.
const BROWSERS: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];

/// Command line of `report`.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Writes tracker_report.html, .json and .xml (JUnit) into the folder of a run, report.html and so on into that of \
                  a flown plan, or beside --out. Exit status 0: PASSED; 4: FAILED (a requirement is not met) or NOT SHOWN (none is \
                  broken, more data are needed). Logs and requirements: src/guide/reports.md; metrics: src/guide/metrics.md."
)]
pub struct ReportArgs {
    /// Folder of a recorded run (with frames.csv), or of a plan that `starloop fly` has flown
    run: PathBuf,
    /// Log of the tracker: a table with a header, lines of JSON, CCSDS AEM, STK .a, a capture of its bus [default:
    /// tracker_log.csv in the folder]
    #[arg(long, value_name = "LOG")]
    tracker: Option<PathBuf>,
    /// Convention of the roll in the log, by the program that has it: lost, tetra3, astrometry, ... [default: as the log or
    /// the plan states it]
    #[arg(long, value_name = "CONVENTION", value_parser = str::parse::<Roll>)]
    roll: Option<Roll>,
    /// Tracker's axes along image right, image down and the boresight, such as "-y -z x"; or "w x y z", the quaternion from
    /// its axes to the sensor's
    #[arg(long, value_name = "AXES", value_parser = str::parse::<Axes>, allow_hyphen_values = true)]
    axes: Option<Axes>,
    /// Find the constant turn from the tracker's axes to the sensor's, and print the line to paste in place of a report
    #[arg(long, conflicts_with_all = ["axes", "requirements", "json", "pdf", "out"])]
    find_axes: bool,
    /// Requirements (TOML); without them: no false solution, and half of the attitudes acquired
    #[arg(long, value_name = "FILE")]
    requirements: Option<PathBuf>,
    /// Camera head of a run that has several, counted from 0
    #[arg(long, value_name = "N")]
    head: Option<usize>,
    /// Confidence of intervals [default: 0.95, of a plan its own]
    #[arg(long, value_name = "L", value_parser = share)]
    confidence: Option<f64>,
    /// Probability at which performances are stated [default: 0.997, of a plan its own]
    #[arg(long, value_name = "P", value_parser = share)]
    probability: Option<f64>,
    /// Name of the unit under test, for the head of the report
    #[arg(long, value_name = "NAME")]
    unit: Option<String>,
    /// Its serial number
    #[arg(long, value_name = "NUMBER")]
    serial_number: Option<String>,
    /// Author of the report
    #[arg(long, value_name = "NAME")]
    author: Option<String>,
    /// Date of the test [default: the day of the run or flight]
    #[arg(long, value_name = "DATE")]
    date_of_test: Option<String>,
    /// Report to write; the others have its name with .json, .xml and .pdf [default: tracker_report.html in RUN, report.html in the folder of a flown plan]
    #[arg(long, value_name = "FILE.html")]
    out: Option<PathBuf>,
    /// Write the report as PDF too, through Chromium
    #[arg(long)]
    pdf: bool,
    /// Print the report as one line of JSON instead of the verdict
    #[arg(long)]
    json: bool,
}

fn share(text: &str) -> Result<f64, String> {
    let share: f64 = text.parse().map_err(|_| format!("got \"{text}\", wanted a number"))?;
    check_share("share", share).map(|()| share).map_err(|error| error.to_string())
}

/// Where and how a report is written.
pub(super) struct Writing<'a> {
    /// The HTML file.
    pub(super) out: &'a Path,
    /// Print JSON instead of the verdict.
    pub(super) json: bool,
    /// Make a PDF too.
    pub(super) pdf: bool,
}

/// Everything that a report is made from.
pub(super) struct Parts {
    pub(super) title: String,
    pub(super) cases: Vec<Case>,
    pub(super) settings: Settings,
    pub(super) requirements: Requirements,
    pub(super) conditions: Vec<(String, String)>,
    pub(super) document: Paperwork,
    pub(super) provenance: Provenance,
}

/// Runs the command; the exit status.
///
/// # Errors
/// With what could not be done, and why.
pub fn run(arguments: &ReportArgs) -> Result<u8> {
    let plan = PlanFile::read(&arguments.run)?;
    let mut parts = match &plan {
        Some(plan) => of_plan(&arguments.run, plan, arguments)?,
        None => of_run(arguments)?,
    };
    let settings = &mut parts.settings;
    settings.confidence = arguments.confidence.unwrap_or(settings.confidence);
    settings.probability = arguments.probability.unwrap_or(settings.probability);
    if arguments.find_axes {
        return print_axes(&parts).map(|()| EXIT_DONE);
    }
    if let Some(path) = &arguments.requirements {
        parts.requirements = read_requirements(path)?;
        let cases: Vec<_> = parts.cases.iter().map(|case| (case.name.clone(), case.purpose)).collect();
        parts.requirements.check_cases(&cases).with_context(|| path.display().to_string())?;
        parts.provenance.files.push(provenance::file(path)?);
    }
    let ReportArgs { unit, serial_number, author, date_of_test, .. } = arguments.clone();
    parts.document = Paperwork { unit, serial_number, author, date_of_test }.or(parts.document);
    // A run has a page of its own, report.html.
    let name = if plan.is_some() { "report.html" } else { "tracker_report.html" };
    let out = arguments.out.clone().unwrap_or_else(|| arguments.run.join(name));
    write(&parts, &Writing { out: &out, json: arguments.json, pdf: arguments.pdf })
}

impl ReportArgs {
    /// Returns what the command line states about the log.
    fn log_form(&self) -> LogForm {
        LogForm { roll: self.roll, axes: self.axes, is_unturned: self.find_axes }
    }
}

/// Statements beside the log, for the conditions of a report.
fn stated(form: &LogForm) -> impl Iterator<Item = (String, String)> {
    let roll = form.roll.map(|roll| ("roll of the log".to_owned(), <&str>::from(roll).to_owned()));
    let axes = form.axes.map(|axes| ("axes of the log".to_owned(), axes.to_string()));
    roll.into_iter().chain(axes)
}

/// Finds and prints the turn from the tracker's axes to the sensor's.
fn print_axes(parts: &Parts) -> Result<()> {
    let limit = &parts.settings.false_limit;
    let judged: Vec<_> = parts.cases.iter().map(|case| case.judged(limit)).collect();
    let found = find_axes(&judged, limit, parts.settings.confidence)?;
    let [x, y, z] = found.spread_arcsec.to_array();
    println!(
        "constant: {} of {} solutions agree; spread {x:.2}, {y:.2} arcsec about x and y, {z:.2} about the boresight (1 sigma)",
        found.agreeing, found.solutions
    );
    let off = format!("the nearest map of axes, {:.1} arcsec off", found.off_map_arcsec);
    if found.is_map {
        println!("axes = \"{}\" # {off}: the tracker's bias stays in the report", found.map);
        println!("axes = {} # the turn itself: it takes the bias out of the report", found.axes);
    } else {
        println!("axes = {} # takes the tracker's bias out of the report", found.axes);
        println!("# {off}: \"{}\", too far to be meant", found.map);
    }
    Ok(())
}

/// Reads a file of requirements.
pub(super) fn read_requirements(path: &Path) -> Result<Requirements> {
    let name = path.display().to_string();
    let text = read_text(path, SETTINGS_BYTES).with_context(|| name.clone())?;
    Requirements::parse(&text, &name)
}

/// Reads a flown plan.
pub(super) fn of_plan(folder: &Path, plan: &PlanFile, arguments: &ReportArgs) -> Result<Parts> {
    if arguments.tracker.is_some() {
        bail!("--tracker: got the folder of a flown plan, in which each case has its log, {LOG}; leave it out");
    }
    let log = arguments.log_form().or(plan.log);
    parts_of_plan(folder, &PlanFile { log, ..plan.clone() })
}

/// Reads the cases of a flown plan.
pub(super) fn parts_of_plan(folder: &Path, plan: &PlanFile) -> Result<Parts> {
    let mut provenance = provenance::provenance();
    let mut files = vec![folder.join(PLAN)];
    let mut cases = Vec::new();
    for name in &plan.cases {
        let case = folder.join(name);
        cases.push(read_case(&case, None, &plan.log)?);
        files.extend(["run.toml", CASE, "frames.csv", LOG].map(|file| case.join(file)));
    }
    provenance.files = hashes(&files, folder)?;
    let kept = folder.join("requirements.toml");
    let requirements = if kept.exists() { read_requirements(&kept)? } else { Requirements::usual() };
    let earlier = earlier(folder);
    let document =
        plan.document.clone().or(Paperwork { date_of_test: day_of(earlier.as_ref()), ..Paperwork::default() });
    let mut conditions = vec![
        ("plan".to_owned(), plan.name.clone()),
        ("tracker under test".into(), plan.tracker.clone()),
        ("camera".into(), plan.camera.clone()),
        ("cases".into(), plan.cases.len().to_string()),
    ];
    conditions.extend(stated(&plan.log));
    conditions.extend(plan.images.iter().map(|images| ("images".to_owned(), images.clone())));
    provenance.seeds = earlier.map(|earlier| earlier.seeds).unwrap_or_default();
    let title = format!("{}, {}", plan.tracker, plan.name);
    Ok(Parts { title, cases, settings: plan.settings(), requirements, conditions, document, provenance })
}

/// The hashes of files, by their names below the folder.
fn hashes(files: &[PathBuf], folder: &Path) -> Result<Vec<FileHash>> {
    let hash =
        |path: &PathBuf| FileHash::of_file(path, &path.strip_prefix(folder).unwrap_or(path).display().to_string());
    files.iter().filter(|path| path.exists()).map(hash).collect()
}

/// Where the folder's own results come from.
fn earlier(folder: &Path) -> Option<Provenance> {
    serde_json::from_str(&read_text(&folder.join(provenance::FILE), SETTINGS_BYTES).ok()?).ok()
}

/// Returns the day on which a run or a flight was made.
pub(super) fn day_of(earlier: Option<&Provenance>) -> Option<String> {
    Some(earlier?.made_utc.split('T').next()?.to_owned())
}

/// Reads one recorded run.
fn of_run(arguments: &ReportArgs) -> Result<Parts> {
    let folder = directory_of_head(&arguments.run, arguments.head);
    let form = arguments.log_form();
    let mut case = read_case(&folder, arguments.tracker.as_deref(), &form)?;
    if case.name.starts_with("head") || case.name == "run" {
        case.name = arguments.run.file_name().map_or(case.name, |name| name.to_string_lossy().into_owned());
    }
    let mut provenance = provenance::provenance();
    let log = arguments.tracker.clone().unwrap_or_else(|| folder.join(LOG));
    let own = [folder.join("frames.csv"), arguments.run.join("summary.json"), arguments.run.join(provenance::FILE)];
    provenance.files = hashes(&own, &arguments.run)?;
    provenance.files.push(provenance::file(&log)?);
    let mut conditions = conditions_of_run(&arguments.run);
    conditions.push(("tracker's log".into(), log.display().to_string()));
    conditions.extend(stated(&form));
    let earlier = earlier(&arguments.run);
    let document = Paperwork { date_of_test: day_of(earlier.as_ref()), ..Paperwork::default() };
    if let Some(earlier) = earlier {
        conditions.push(("run made by".into(), earlier.command_line.join(" ")));
        provenance.seeds = earlier.seeds;
        provenance.files.extend(earlier.files);
    }
    let (title, requirements) = (case.name.clone(), Requirements::usual());
    let settings = Settings::default();
    Ok(Parts { title, cases: vec![case], settings, requirements, conditions, document, provenance })
}

/// The conditions of a run, from its summary.
fn conditions_of_run(folder: &Path) -> Vec<(String, String)> {
    let text = read_text(&folder.join("summary.json"), SETTINGS_BYTES).unwrap_or_default();
    let summary: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
    let wanted = ["bench", "camera", "backend", "clock", "start_utc", "frame_period_s", "seed", "noise_seed"];
    let value = |key: &str| {
        let value = summary.get(key)?;
        Some((key.replace('_', " "), value.as_str().map_or_else(|| value.to_string(), str::to_owned)))
    };
    let mut found: Vec<(String, String)> = wanted.iter().filter_map(|key| value(key)).collect();
    let counts = summary.get("frames").and_then(serde_json::Value::as_object);
    let counts = counts.into_iter().flatten().filter(|(_, count)| count.as_u64() != Some(0));
    found.extend(counts.map(|(name, count)| (format!("frames {}", name.replace('_', " ")), count.to_string())));
    let faults = summary.get("faults").and_then(serde_json::Value::as_object);
    let faults = faults.into_iter().flatten().map(|(name, count)| (format!("frames with {name}"), count.to_string()));
    found.extend(faults);
    found
}

/// Assesses, writes all files and prints the verdict; the exit status.
pub(super) fn write(parts: &Parts, writing: &Writing<'_>) -> Result<u8> {
    let assessment: Assessment = assess(&parts.cases, &parts.settings);
    let judged = parts.requirements.judge(&assessment.metrics, &assessment.settings);
    let signed = (parts.document.clone(), parts.provenance.clone());
    let report = Report::new(parts.title.clone(), &assessment, judged, parts.conditions.clone(), signed);
    let json = report.to_json()?;
    let beside = writing.out.with_extension("json");
    let name = beside.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let html = to_html(&report, &assessment, &FileHash::of_text(&name, &json));
    if html.len() > MOST_HTML_BYTES {
        bail!("the report has {} bytes; wanted at most {MOST_HTML_BYTES}: report on fewer cases", html.len());
    }
    save(writing.out, &html)?;
    save(&beside, &json)?;
    save(&writing.out.with_extension("xml"), &to_junit(&report))?;
    if writing.pdf {
        print_pdf(writing.out)?;
    }
    if writing.json {
        println!("{}", json_line("report", &report)?);
    } else {
        println!("{}", report.verdict);
        println!("{}", writing.out.display());
    }
    Ok(if report.is_met { EXIT_DONE } else { EXIT_NOT_MET })
}

fn save(path: &Path, text: &str) -> Result<()> {
    // The error names the file.
    write_file_atomically(path, |out| out.write_all(text.as_bytes()))?;
    Ok(())
}

/// Prints the HTML file into a PDF beside it.
fn print_pdf(html: &Path) -> Result<()> {
    let pdf = html.with_extension("pdf");
    let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.into()).display().to_string();
    let profile = tempfile::tempdir().context("--pdf")?;
    for browser in BROWSERS {
        let mut command = Command::new(browser);
        command.args(["--headless", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer"]);
        command.arg(format!("--user-data-dir={}", profile.path().display()));
        command.arg(format!("--print-to-pdf={}", absolute(&pdf))).arg(format!("file://{}", absolute(html)));
        match command.output() {
            Ok(output) if output.status.success() && pdf.exists() => return Ok(()),
            Ok(output) => bail!("--pdf: {browser} ended with {} and made no {}", output.status, pdf.display()),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
            Err(error) => return Err(error).with_context(|| format!("--pdf: {browser}")),
        }
    }
    bail!("--pdf: found none of {}; wanted one of them on the PATH", BROWSERS.join(", "))
}
