//! Text on a terminal: messages without control characters, lines of progress.
//!
//! Messages as a terminal may show them: values of files may hold any character, and be of any length.
//!
//! Control characters are escaped, since they can move the cursor, ring the bell or change what is on the screen; lines
//! are shortened in the middle, since a value may be a file of its own. The operating system's numbers of errors and
//! the temporary names of files are left out: they help no reader. Every error passes here before it is printed.

use anyhow::{Context, Result};
use base::{clock::Stopwatch, streams::say};
use crossbeam_channel::{Receiver as Queue, Sender, bounded};
use frames::report::{Progress, progress_line};
use frames::sink::SentFrame;
use outputs::live::Numbers;
use run::runtime::RunRecord;
use std::io::{IsTerminal, Write};
use std::time::Duration;

/// Characters of a line at its beginning that are kept.
const KEPT_FIRST: usize = 2000;
/// Characters at its end that are kept.
const KEPT_LAST: usize = 300;

/// Returns the text with control characters escaped (line breaks and tabs stay) and long lines shortened.
pub(super) fn plain_text(text: &str) -> String {
    let text = without(text, " at path \"", '"', |path| path.ends_with(".part"));
    let text = without(&text, " (os error ", ')', |number| number.bytes().all(|byte| byte.is_ascii_digit()));
    text.split('\n').map(|line| shortened(&escaped(line))).collect::<Vec<_>>().join("\n")
}

/// Returns the text without the parts from `start` to `end` whose inside is to be left out.
fn without(text: &str, start: &str, end: char, is_left_out: impl Fn(&str) -> bool) -> String {
    let mut pieces = text.split(start);
    let mut kept = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        match piece.split_once(end) {
            Some((inside, rest)) if is_left_out(inside) => kept.push_str(rest),
            _ => kept.extend([start, piece]),
        }
    }
    kept
}

fn escaped(line: &str) -> String {
    let mut plain = String::with_capacity(line.len());
    for c in line.chars() {
        if c.is_control() && c != '\t' {
            plain.extend(c.escape_default());
        } else {
            plain.push(c);
        }
    }
    plain
}

fn shortened(line: &str) -> String {
    let characters = line.chars().count();
    let left_out = characters.saturating_sub(KEPT_FIRST + KEPT_LAST);
    if left_out == 0 {
        return line.into();
    }
    let first: String = line.chars().take(KEPT_FIRST).collect();
    let last: String = line.chars().skip(characters - KEPT_LAST).collect();
    format!("{first} ... ({left_out} characters left out) ... {last}")
}

// How far a command has come: a line on a terminal that is drawn over; elsewhere nothing, or a line now and then.

/// One line on standard error.
pub(super) struct ProgressLine {
    is_on_terminal: bool,
}

impl ProgressLine {
    pub(super) fn new() -> Self {
        Self { is_on_terminal: std::io::stderr().is_terminal() }
    }

    /// Draws over the line of a terminal; silent elsewhere.
    pub(super) fn show(&self, text: &str) {
        if self.is_on_terminal {
            let _a_closed_terminal_is_no_error = write!(std::io::stderr(), "\r{text:<79}");
        }
    }

    /// Draws over the line of a terminal; elsewhere prints a line of its own when one `is_due`.
    pub(super) fn show_or_print(&self, text: &str, is_due: bool) {
        self.show(text);
        if is_due && !self.is_on_terminal {
            eprintln!("{text}");
        }
    }

    pub(super) fn clear(&self) {
        self.show("");
        if self.is_on_terminal {
            let _a_closed_terminal_is_no_error = write!(std::io::stderr(), "\r");
        }
    }
}

// The progress line of a run, drawn by a thread of its own.

/// The thread that draws the progress line: nothing real-time.
pub(super) struct Monitor {
    pub(super) updates: Sender<Progress>,
    thread: std::thread::JoinHandle<()>,
}

impl Monitor {
    pub(super) fn start(say: bool) -> Result<Self> {
        let (updates, queue) = bounded(1);
        let watch = move || watch(&queue, say && std::io::stderr().is_terminal());
        let thread = std::thread::Builder::new()
            .name("monitor".into())
            .spawn(watch)
            .context("cannot start the monitor thread")?;
        Ok(Self { updates, thread })
    }

    /// Ends the thread; false when it has already ended by itself.
    ///
    /// All other holders of `updates` must have dropped it.
    pub(super) fn finish(self) -> bool {
        drop(self.updates);
        self.thread.join().is_ok()
    }
}

/// How often the progress line is drawn at most.
const REDRAW: Duration = Duration::from_millis(100);

/// Draws updates until all senders are gone.
fn watch(queue: &Queue<Progress>, draws: bool) {
    let mut drawn = false;
    for update in queue {
        if draws {
            draw(&update);
            drawn = true;
            std::thread::sleep(REDRAW);
        }
    }
    if drawn {
        say(format_args!("\n"));
    }
}

fn draw(update: &Progress) {
    const WIDTH: usize = 120;
    say(format_args!("\r{:<WIDTH$}", progress_line(update, WIDTH)));
}

// Progress of a run: the progress line and the live view's numbers.

/// Returns what hands the monitor a frame's progress, with where the first head points; an update is dropped while the
/// monitor is busy. Allocates nothing.
pub(super) fn sender(
    updates: Sender<Progress>,
    numbers: Option<Numbers>,
    frames: u64,
) -> impl FnMut(usize, &SentFrame, &RunRecord) {
    let mut since_first: Option<Stopwatch> = None;
    // Every head counts, the first one shows where it points.
    let mut first_head = None;
    move |head, frame, record| {
        if head == 0 {
            let meta = &frame.meta;
            first_head = Some(([meta.ra_deg, meta.dec_deg, meta.roll_deg], frame.truth.len(), meta.method.name()));
        }
        let Some(([ra_deg, dec_deg, roll_deg], stars, method)) = first_head else { return };
        let elapsed_s = since_first.get_or_insert_with(Stopwatch::start).elapsed().s();
        let done = record.frames.rendered;
        let update = Progress {
            frame: done,
            frames: Some(frames),
            fps: done.saturating_sub(1) as f64 / f64::max(elapsed_s, 1e-3),
            p99_ms: record.p99_ms(),
            late: record.frames.late,
            dropped: record.frames.dropped,
            ra_deg,
            dec_deg,
            roll_deg,
            stars,
            method,
        };
        let _monitor_is_busy = updates.try_send(update);
        if let Some(numbers) = &numbers {
            numbers.announce(&record.numbers(Some(frames)));
        }
    }
}

#[cfg(test)]
mod plain_text_tests {
    use super::*;

    #[test]
    fn control_characters_are_escaped_and_line_breaks_stay() {
        assert_eq!(
            plain_text("name \u{1b}[2J\u{7}\u{9b}1m\r is\n\tnone"),
            "name \\u{1b}[2J\\u{7}\\u{9b}1m\\r is\n\tnone"
        );
        assert_eq!(plain_text("Größe 3 µm: ✓"), "Größe 3 µm: ✓", "other characters stay");
    }

    #[test]
    fn numbers_of_errors_and_temporary_names_are_left_out() {
        assert_eq!(
            plain_text("a.png: No such file (os error 2) at path \"/x/.a.png.q1.part\"; try b (os error 17)"),
            "a.png: No such file; try b"
        );
        let kept = "an (os error x) at path \"/x/a.png\"";
        assert_eq!(plain_text(kept), kept, "only what the system writes");
    }

    #[test]
    fn long_line_keeps_its_beginning_and_its_end() {
        let cell = "x".repeat(10_000_000);
        let text = plain_text(&format!("table.csv, line 2: wanted a number, got {cell}; try another\nshort"));
        assert!(text.len() < 3000, "{}", text.len());
        assert!(text.starts_with("table.csv, line 2: wanted a number, got xxx"), "{}", &text[..60]);
        assert!(text.ends_with("; try another\nshort") && text.contains("characters left out"));
        let longest_of_ours = "a".repeat(KEPT_FIRST + KEPT_LAST);
        assert_eq!(plain_text(&longest_of_ours), longest_of_ours);
    }
}

#[cfg(test)]
mod monitor_tests {
    use super::*;

    #[test]
    fn monitor_thread_that_panics_is_reported() {
        assert!(Monitor::start(false).unwrap().finish(), "control: one that ends in order");
        let (updates, queue) = bounded::<Progress>(1);
        let broken = move || {
            let _queue = queue;
            panic!("as the test wants it");
        };
        let thread = std::thread::Builder::new().name("monitor".into()).spawn(broken).unwrap();
        assert!(!Monitor { updates, thread }.finish());
    }
}
