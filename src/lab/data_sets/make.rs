//! Workers that draw the shards of a data set.
//!
//! In: a description, the number of items, a folder, which shards. Out: their files; when all shards of the data set are
//! there, also what belongs to the whole of it. Each worker is one thread that draws one shard at a time with a camera of
//! its own; several programs may draw shards of one folder at the same time. Shards that are there are not drawn again.
//! Tests: below, and `hil_scripts/tests/test_data_sets.py`, which kills it.

use crate::folder::{About, Times, all_records, begin, finish, read_record, write_shard};
use crate::spec::Spec;
use anyhow::{Context, Result, bail};
use core::ops::Range;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Mutex, PoisonError};
use std::{path::Path, time::Duration};

/// Most items of a data set.
pub const MOST_ITEMS: u32 = 100_000_000;
/// Most workers.
pub const MOST_WORKERS: usize = 1024;
/// Time between two reports of progress.
const REPORT_EVERY: Duration = Duration::from_millis(200);

/// Request for a data set, or for a part of one.
#[derive(Debug, Clone)]
pub struct Order<'a> {
    /// The description.
    pub spec: &'a Spec,
    /// Items of the whole data set.
    pub count: u32,
    /// Its folder.
    pub folder: &'a Path,
    /// Shards to draw; all of them where nothing is given.
    pub shards: Option<Range<u32>>,
    /// Threads.
    pub workers: usize,
    /// Version of the program, which belongs to the data set.
    pub program: &'a str,
}

/// How far it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Progress {
    /// Items drawn by this program.
    pub drawn: u32,
    /// Items that this program has to draw.
    pub wanted: u32,
}

/// Result of a request.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Summary {
    /// Items that were drawn.
    pub drawn: u32,
    /// Items that were there already.
    pub found: u32,
    /// Whether every shard of the data set is there.
    pub is_whole: bool,
    /// Whether it was stopped before its end.
    pub is_stopped: bool,
    /// Wall time of all workers together.
    pub times: Times,
}

/// State that workers share.
struct Shared<'a> {
    order: &'a Order<'a>,
    /// Shards to draw.
    missing: Vec<u32>,
    /// Place of the next one.
    next: AtomicU32,
    drawn: AtomicU32,
    stop: &'a AtomicBool,
    times: Mutex<Times>,
}

/// Draws the shards that are missing; stops in order when `stop` is set. `report` is called now and then.
///
/// # Errors
/// When the folder is about something else, an item cannot be drawn or a file cannot be written.
pub fn make(order: &Order<'_>, stop: &AtomicBool, mut report: impl FnMut(Progress)) -> Result<Summary> {
    check(order)?;
    let about = About::new(order.spec, order.count, order.program);
    begin(order.folder, order.spec, &about)?;
    let shards = order.shards.clone().unwrap_or(0..order.spec.shards(order.count));
    let mut summary = Summary::default();
    let (mut missing, mut wanted) = (Vec::new(), 0);
    for shard in shards {
        let items = order.spec.items_of(shard, order.count);
        match read_record(order.folder, shard, &items)? {
            Some(_) => summary.found += items.end - items.start,
            None => {
                missing.push(shard);
                wanted += items.end - items.start;
            }
        }
    }
    let (next, drawn, times) = (AtomicU32::new(0), AtomicU32::new(0), Mutex::default());
    let shared = Shared { order, missing, next, drawn, stop, times };
    run_workers(&shared, |drawn| report(Progress { drawn, wanted }))?;
    summary.drawn = shared.drawn.load(Ordering::SeqCst);
    summary.times = *shared.times.lock().unwrap_or_else(PoisonError::into_inner);
    summary.is_stopped = summary.drawn < wanted;
    if let Some(records) = all_records(order.folder, order.spec, order.count)? {
        finish(order.folder, order.spec, &about, &records)?;
        summary.is_whole = true;
    }
    Ok(summary)
}

fn check(order: &Order<'_>) -> Result<()> {
    if order.count == 0 || order.count > MOST_ITEMS {
        bail!("--count: got {}, wanted 1 to {MOST_ITEMS}", order.count);
    }
    if order.workers == 0 || order.workers > MOST_WORKERS {
        bail!("--workers: got {}, wanted 1 to {MOST_WORKERS}", order.workers);
    }
    let all = order.spec.shards(order.count);
    match &order.shards {
        Some(shards) if shards.is_empty() || shards.end > all => {
            bail!("--shards: got {} to {}, wanted some of the shards 0 to {}", shards.start, shards.end, all - 1)
        }
        Some(_) | None => Ok(()),
    }
}

/// Runs the workers to their end, with a report now and then.
fn run_workers(shared: &Shared<'_>, mut report: impl FnMut(u32)) -> Result<()> {
    let workers = shared.order.workers.min(shared.missing.len());
    std::thread::scope(|scope| {
        let start = |number: usize| {
            let builder = std::thread::Builder::new().name(format!("worker {number}"));
            builder.spawn_scoped(scope, || work(shared)).context("cannot start a worker")
        };
        let threads = (0..workers).map(start).collect::<Result<Vec<_>>>()?;
        while threads.iter().any(|thread| !thread.is_finished()) {
            report(shared.drawn.load(Ordering::Relaxed));
            std::thread::park_timeout(REPORT_EVERY);
        }
        report(shared.drawn.load(Ordering::Relaxed));
        for thread in threads {
            match thread.join() {
                Ok(done) => done?,
                Err(_panic) => bail!("a worker ended by a panic"),
            }
        }
        Ok(())
    })
}

/// Draws shards until none is left.
fn work(shared: &Shared<'_>) -> Result<()> {
    // Shards are the parallelism: one core each.
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).thread_name(|_| "drawing".into()).build()?;
    let done = one.install(|| work_on_one_core(shared));
    if done.is_err() {
        // Leaves no shard to the others.
        shared.next.store(u32::MAX / 2, Ordering::SeqCst);
    }
    done
}

fn work_on_one_core(shared: &Shared<'_>) -> Result<()> {
    let order = shared.order;
    loop {
        let place = shared.next.fetch_add(1, Ordering::SeqCst) as usize;
        let Some(&shard) = shared.missing.get(place) else { return Ok(()) };
        let items = order.spec.items_of(shard, order.count);
        let seen = |_item| {
            shared.drawn.fetch_add(1, Ordering::Relaxed);
            !shared.stop.load(Ordering::Relaxed)
        };
        let times =
            write_shard(order.spec, (shard, items), order.folder, seen).with_context(|| format!("shard {shard}"))?;
        let Some(times) = times else { return Ok(()) };
        shared.times.lock().unwrap_or_else(PoisonError::into_inner).add(times);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    const SPEC: &str =
        "name = \"x\"\ncamera = \"cameras/small_tracker.toml\"\n[output]\nshard_items = 4\nimages = \"png\"\n";

    fn spec(rest: &str) -> Spec {
        Spec::parse(&format!("{SPEC}{rest}"), Path::new(".")).unwrap()
    }

    fn order<'a>(spec: &'a Spec, folder: &'a Path, workers: usize) -> Order<'a> {
        Order { spec, count: 10, folder, shards: None, workers, program: "p" }
    }

    fn made(order: &Order<'_>) -> Summary {
        make(order, &AtomicBool::new(false), |_| {}).unwrap()
    }

    fn bytes_below(folder: &Path) -> BTreeMap<String, Vec<u8>> {
        let mut all = BTreeMap::new();
        for entry in std::fs::read_dir(folder).unwrap().map(Result::unwrap) {
            let path = entry.path();
            if path.is_dir() {
                let below = bytes_below(&path);
                all.extend(below.into_iter().map(|(name, bytes)| (format!("{}/{name}", path.display()), bytes)));
            } else {
                all.insert(entry.file_name().to_string_lossy().into_owned(), std::fs::read(&path).unwrap());
            }
        }
        let begin = format!("{}/", folder.display());
        all.into_iter().map(|(name, bytes)| (name.replace(&begin, ""), bytes)).collect()
    }

    #[test]
    fn folder_is_the_same_by_one_worker_by_two_in_parts_and_after_a_stop() {
        let spec = spec("");
        let folders: Vec<_> = (0..4).map(|_| tempfile::tempdir().unwrap()).collect();
        let [one, two, parts, stopped] = [0, 1, 2, 3].map(|place| folders[place].path());
        let summary = made(&order(&spec, one, 1));
        assert!(summary.is_whole && summary.drawn == 10 && summary.found == 0);
        made(&order(&spec, two, 2));
        for shards in [2..3, 0..1] {
            let part = made(&Order { shards: Some(shards), ..order(&spec, parts, 1) });
            assert!(!part.is_whole);
        }
        assert_eq!(made(&order(&spec, parts, 1)).drawn, 4, "the shard that was missing");
        let stop = AtomicBool::new(true);
        let half = make(&order(&spec, stopped, 1), &stop, |_| {}).unwrap();
        assert!(half.is_stopped && !half.is_whole && half.drawn == 1);
        std::fs::write(stopped.join("images/.x.part"), "left by a kill").unwrap();
        made(&order(&spec, stopped, 1));
        let wanted = bytes_below(one);
        assert!(wanted.contains_key("checksums.sha256") && wanted.len() == 10 + 3 * 3 + 4, "{:?}", wanted.keys());
        for folder in [two, parts, stopped] {
            assert!(bytes_below(folder) == wanted, "{}", folder.display());
        }
        assert!(crate::folder::damaged(one).unwrap().is_empty());
        std::fs::write(one.join("images/00000/00000001.png"), "x").unwrap();
        assert_eq!(crate::folder::damaged(one).unwrap().len(), 1, "control: damage is found");
        assert_eq!(made(&order(&spec, one, 1)).drawn, 4, "and its shard is drawn again");
        assert!(bytes_below(one) == wanted);
    }

    #[test]
    fn more_items_leave_those_that_are_there() {
        let (spec, folder) = (spec(""), tempfile::tempdir().unwrap());
        made(&order(&spec, folder.path(), 1));
        let before = bytes_below(folder.path());
        let more = made(&Order { count: 13, ..order(&spec, folder.path(), 1) });
        assert_eq!((more.found, more.drawn), (8, 5), "the last shard was not full");
        let after = bytes_below(folder.path());
        assert!((0..10).all(|item| {
            let path = format!("images/{:05}/{item:08}.png", item / 4);
            before[&path] == after[&path]
        }));
    }

    #[test]
    fn orders_that_make_no_sense_are_refused_and_a_failure_ends_all() {
        let (good, folder) = (spec(""), tempfile::tempdir().unwrap());
        let refused = |order: Order<'_>| format!("{:#}", make(&order, &AtomicBool::new(false), |_| {}).unwrap_err());
        assert!(refused(Order { count: 0, ..order(&good, folder.path(), 1) }).contains("--count: got 0"));
        assert!(refused(order(&good, folder.path(), 0)).contains("--workers: got 0"));
        assert!(refused(Order { shards: Some(2..4), ..order(&good, folder.path(), 1) }).contains("shards 0 to 2"));
        let bad = spec("[[target]]\nmag = { choice = [4] }\n");
        assert!(refused(order(&bad, folder.path(), 2)).contains("target[0]"));
    }
}
