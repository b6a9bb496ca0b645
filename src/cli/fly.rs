//! `starloop fly`: a test plan flown case by case, and one report of it.
//!
//! Everything that can be wrong with the plan is found before the first case flies, and before anything is written.

use crate::cli::provenance;
use crate::cli::report::{Writing, day_of, parts_of_plan, write};
use anyhow::{Context, Result, bail};
use base::input_file::{SETTINGS_BYTES, read_text};
use clap::{Args, Command, FromArgMatches, error::ErrorKind};
use core::sync::atomic::{AtomicUsize, Ordering};
use performance::case_folder::{PLAN, PlanFile};
use performance::fly::{Flight, Flown};
use performance::images::ImageForm;
use performance::plan::{Plan, PlanCase, Source};
use performance::{metric::refuse_all, requirements::Requirements};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Command line of `fly`.
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "One folder for each case (run.toml, case.json, frames.csv, tracker_log.csv), plan.json, requirements.toml \
                        and report.html, report.json, report.xml (JUnit). Exit status 0: PASSED; 4: FAILED (a requirement is not met) \
                        or NOT SHOWN (none is broken, more data are needed)."
)]
pub struct FlyArgs {
    /// Test plan (TOML), such as configs/test_plans/ecss_star_tracker.toml
    plan: PathBuf,
    /// Folder to write into: a new one; must be given
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Program under test in place of the plan's tracker, with its arguments: {frames}, {camera} and {log} are replaced
    /// by the paths; one quoted text, or word by word up to the next option of `starloop fly`
    #[arg(long, value_name = "WORD", num_args = 1.., allow_hyphen_values = true)]
    tracker_command: Vec<String>,
    /// Name of the tracker in the report
    #[arg(long, value_name = "NAME")]
    tracker_name: Option<String>,
    /// Only cases whose names begin so; may be repeated
    #[arg(long, value_name = "NAME")]
    case: Vec<String>,
    /// Keep the images that a program under test was given
    #[arg(long)]
    keep_images: bool,
    /// Images that a program under test gets beside FITS: png16 (the DN), or png8 on a linear scale, which is printed and
    /// in the report: DN of grey 0 and of one grey; those of the camera's noise when left out
    #[arg(long, value_name = "png16|png8|png8:BLACK,STEP")]
    images: Option<ImageForm>,
    /// Write the report as PDF too, through Chromium
    #[arg(long)]
    pdf: bool,
    /// Print nothing but the verdict and errors
    #[arg(long)]
    quiet: bool,
}

/// Runs the command; the exit status.
///
/// # Errors
/// With what could not be done, and why.
pub fn run(arguments: &FlyArgs) -> Result<u8> {
    let arguments = &quoted(options_behind(arguments.clone()).unwrap_or_else(|error| error.exit()))?;
    let out = arguments.out.as_ref().context("--out is missing; wanted a new folder")?;
    let (mut plan, errors) = Plan::read(&arguments.plan)?;
    if !arguments.tracker_command.is_empty() {
        plan.tracker.source = Source::Program;
        plan.tracker.command.clone_from(&arguments.tracker_command);
        plan.tracker.model = None;
    }
    plan.tracker.name = arguments.tracker_name.clone().or(plan.tracker.name);
    if out.join(PLAN).exists() {
        bail!("--out: {} has a flown plan already; wanted another folder", out.display());
    }
    let folder = arguments.plan.parent().map(Path::to_path_buf).unwrap_or_default();
    let mut flight = Flight::new(&plan, &folder, out)?;
    flight.keeps_images = arguments.keep_images;
    arguments.images.map_or(Ok(()), |form| flight.give_images(form))?;
    if let Some(form) = flight.images.filter(|_| !arguments.quiet) {
        eprintln!("images: {form}");
    }
    let requirements = sound((&plan, errors), &flight, &folder, &|case| is_wanted(arguments, case))
        .with_context(|| arguments.plan.display().to_string())?;
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    let flown = fly_all(&plan, &flight, arguments)?;
    let file = plan_file(&plan, &flight, &flown);
    keep(&file, requirements.as_deref(), out)?;
    let mut parts = parts_of_plan(out, &file)?;
    parts.provenance.seeds = vec![("plan".into(), plan.seed)];
    parts.document.date_of_test = parts.document.date_of_test.or_else(|| day_of(Some(&parts.provenance)));
    let names = [Some(arguments.plan.clone()), Some(folder.join(&plan.camera))];
    for path in names.into_iter().flatten().filter(|path| path.exists()) {
        parts.provenance.files.push(provenance::file(&path)?);
    }
    let json = serde_json::to_string_pretty(&parts.provenance)?;
    std::fs::write(out.join(provenance::FILE), json).context(provenance::FILE)?;
    let page = out.join("report.html");
    write(&parts, &Writing { out: &page, json: false, pdf: arguments.pdf })
}

/// Takes options of `fly` out of the words of the tracker's command.
fn options_behind(mut arguments: FlyArgs) -> Result<FlyArgs, clap::Error> {
    let command = FlyArgs::augment_args_for_update(Command::new("starloop fly").no_binary_name(true));
    let is_own = |word: &String| {
        let name = word.strip_prefix("--").and_then(|name| name.split('=').next());
        name.is_some_and(|name| command.get_arguments().any(|known| known.get_long() == Some(name)))
    };
    if let Some(place) = arguments.tracker_command.iter().position(is_own) {
        let behind = arguments.tracker_command.split_off(place);
        let before = FlyArgs { case: core::mem::take(&mut arguments.case), ..arguments.clone() };
        arguments.update_from_arg_matches(&command.clone().try_get_matches_from(behind)?)?;
        arguments.keep_images |= before.keep_images;
        arguments.pdf |= before.pdf;
        arguments.quiet |= before.quiet;
        arguments.case.splice(0..0, before.case);
    }
    if arguments.out.is_none() {
        let mut command = command;
        return Err(command.error(ErrorKind::MissingRequiredArgument, "--out <DIR> is missing; wanted a new folder"));
    }
    Ok(arguments)
}

/// Takes a quoted command apart.
fn quoted(mut arguments: FlyArgs) -> Result<FlyArgs> {
    if let [whole] = arguments.tracker_command.as_slice()
        && whole.contains(char::is_whitespace)
    {
        arguments.tracker_command = words_of(whole)?;
    }
    Ok(arguments)
}

/// Returns the words of a command as a shell has them: parted by blanks, except within quotes.
fn words_of(text: &str) -> Result<Vec<String>> {
    let (mut words, mut word, mut quote) = (Vec::new(), None::<String>, None);
    for letter in text.chars() {
        match quote {
            Some(end) if letter == end => quote = None,
            None if letter == '"' || letter == '\'' => {
                quote = Some(letter);
                word.get_or_insert_default();
            }
            None if letter.is_whitespace() => words.extend(word.take()),
            Some(_) | None => word.get_or_insert_default().push(letter),
        }
    }
    if let Some(quote) = quote {
        bail!("--tracker-command: got {text}, wanted a second {quote}");
    }
    words.extend(word);
    Ok(words)
}

/// Returns true for a case that is to be flown.
fn is_wanted(arguments: &FlyArgs, case: &str) -> bool {
    arguments.case.is_empty() || arguments.case.iter().any(|begin| case.starts_with(begin))
}

/// Checks cases and requirements before anything flies, and adds the errors of the plan itself; the text of the
/// requirements.
///
/// # Errors
/// With everything that is wrong.
pub(super) fn sound(
    (plan, mut errors): (&Plan, Vec<anyhow::Error>),
    flight: &Flight<'_>,
    folder: &Path,
    is_wanted: &dyn Fn(&str) -> bool,
) -> Result<Option<String>> {
    errors.extend(flight.check(is_wanted).err());
    let mut text = None;
    if let Some(name) = &plan.requirements {
        let path = folder.join(name);
        let checked = read_text(&path, SETTINGS_BYTES).with_context(|| path.display().to_string()).and_then(|read| {
            let name = path.display().to_string();
            Requirements::parse(&read, &name)?.check_cases(&plan.named_cases()).context(name)?;
            text = Some(read);
            Ok(())
        });
        errors.extend(checked.err());
    }
    refuse_all(&errors)?;
    Ok(text)
}

/// Flies every case, several at a time.
fn fly_all(plan: &Plan, flight: &Flight<'_>, arguments: &FlyArgs) -> Result<Vec<Flown>> {
    let all: Vec<(&PlanCase, (String, Option<f64>))> = plan.each().collect();
    // A case has its number whichever others are flown: its frames are the same.
    let wanted: Vec<_> = (1_u64..).zip(all).filter(|(_, (_, (name, _)))| is_wanted(arguments, name)).collect();
    if wanted.is_empty() {
        bail!("--case: no case of the plan begins so; wanted one of its names");
    }
    let done = AtomicUsize::new(0);
    let count = wanted.len();
    let fly = |(number, (case, (name, value))): &(u64, (&PlanCase, (String, Option<f64>)))| {
        let flown = flight.fly(case, (name, *value), *number).with_context(|| format!("case \"{name}\""))?;
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        if !arguments.quiet {
            eprintln!("  {done}/{count} {name}: {} frames", flown.frames);
        }
        Ok(flown)
    };
    wanted.par_iter().map(fly).collect()
}

fn plan_file(plan: &Plan, flight: &Flight<'_>, flown: &[Flown]) -> PlanFile {
    let settings = plan.settings();
    PlanFile {
        name: plan.name.clone(),
        tracker: plan.tracker_name(),
        camera: flight.camera_name.clone(),
        confidence: settings.confidence,
        probability: settings.probability,
        false_directional_arcsec: settings.false_limit.directional_arcsec,
        false_rotational_arcsec: settings.false_limit.rotational_arcsec,
        exclusion_noise_arcsec: settings.exclusion_noise_arcsec,
        images: flight.images.map(|form| form.to_string()),
        cases: flown.iter().map(|flown| flown.folder.clone()).collect(),
        document: plan.document.clone(),
        log: plan.tracker.log_form(),
    }
}

/// Writes `plan.json` and the requirements beside the cases.
fn keep(file: &PlanFile, requirements: Option<&str>, out: &Path) -> Result<()> {
    if let Some(text) = requirements {
        std::fs::write(out.join("requirements.toml"), text).context("requirements.toml")?;
    }
    let path = out.join(PLAN);
    std::fs::write(&path, serde_json::to_string_pretty(file)?).with_context(|| path.display().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn given(words: &str) -> Result<FlyArgs> {
        let command = FlyArgs::augment_args(Command::new("fly").no_binary_name(true));
        let matches = command.try_get_matches_from(words.split(' '))?;
        quoted(options_behind(FlyArgs::from_arg_matches(&matches)?)?)
    }

    #[test]
    fn a_tracker_command_ends_at_the_next_option_of_fly() {
        let got = given("p.toml --quiet --tracker-command py my.py {log} --own 3 --tracker-name SN003 --out o --pdf")
            .unwrap();
        assert_eq!(got.tracker_command, ["py", "my.py", "{log}", "--own", "3"]);
        assert_eq!((got.tracker_name.as_deref(), got.out), (Some("SN003"), Some("o".into())));
        assert!(got.pdf && got.quiet && !got.keep_images);
        let got = given("p.toml --out o --case a --tracker-command py {log} --case=b").unwrap();
        assert_eq!((got.case, got.tracker_command.len()), (vec!["a".to_owned(), "b".to_owned()], 2));
        assert!(given("p.toml").is_err(), "without --out");
        assert!(given("p.toml --tracker-command py --keep-images=3 --out o").is_err(), "a wrong value");
    }

    #[test]
    fn a_quoted_command_is_taken_apart() {
        assert_eq!(
            words_of("py -u 'my file.py' \"{log}\" --a=\"b c\" ''").unwrap(),
            ["py", "-u", "my file.py", "{log}", "--a=b c", ""]
        );
        assert!(words_of("py 'open").is_err());
    }
}
