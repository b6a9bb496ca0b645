//! Losses of a run that reached its end: a list for the summary, one line for people, an exit status for scripts.
//!
//! A frame that a sink did not take, or that a client of a gateway read too slowly; a file of the run that could not be
//! written, a capture that is not whole, a thread that ended early. A run that was cut short by an error is another
//! matter: its error says so.

use crate::report::sink_line::SinkLine;
use core::fmt;
use serde::Serialize;

base::words! {
    /// The kind of thing that was lost.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
    #[serde(rename_all = "snake_case")]
    pub enum LostPart {
        /// Frames that a sink was too slow for or failed on, or the sink itself.
        Sink = "sink",
        /// A file of the run, such as its summary.
        File = "file",
        /// Packets or rows of a capture.
        Capture = "capture",
        /// A thread that ended before the run did.
        Thread = "thread",
        /// Frames of the bus that a client of a gateway read too slowly.
        Gateway = "gateway",
    }
}

/// One thing that was lost.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct LossLine {
    /// Its kind.
    pub part: LostPart,
    /// Its name: the sink's place in the bench, the file, the thread.
    pub name: String,
    /// Number of frames, packets, files or threads.
    pub count: u64,
    /// Description of the loss, in words.
    pub detail: String,
}

/// Everything that a run lost.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
#[serde(transparent)]
pub struct Losses(Vec<LossLine>);

impl Losses {
    /// Lists the sinks that did not take every frame, or failed in another way.
    pub fn of_sinks(rows: &[SinkLine]) -> Self {
        Self(rows.iter().filter_map(of_sink).collect())
    }

    /// Adds a gateway whose client read too slowly for some of the frames of the bus, if any.
    pub fn note_gateway(&mut self, name: &str, dropped: u64, to_clients: u64) {
        if dropped > 0 {
            let of = dropped + to_clients;
            let detail = format!("{dropped} of {of} frames of the bus dropped, which its client read too slowly");
            self.note(LossLine { part: LostPart::Gateway, name: name.into(), count: dropped, detail });
        }
    }

    /// Adds one loss.
    pub fn note(&mut self, line: LossLine) {
        self.0.push(line);
    }

    /// Adds a file that was not written.
    pub fn note_file(&mut self, name: &str, why: impl fmt::Display) {
        self.note(LossLine {
            part: LostPart::File,
            name: name.into(),
            count: 1,
            detail: format!("not written: {why}"),
        });
    }

    /// Adds a capture that is not whole.
    pub fn note_capture(&mut self, why: impl fmt::Display) {
        self.note(LossLine { part: LostPart::Capture, name: "capture".into(), count: 1, detail: why.to_string() });
    }

    /// Adds a thread that ended before the run did.
    pub fn note_thread(&mut self, name: &str) {
        let detail = "the thread ended before the run did".into();
        self.note(LossLine { part: LostPart::Thread, name: name.into(), count: 1, detail });
    }

    /// Returns true when nothing was lost.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Returns the losses, in the order in which they were recorded.
    pub fn lines(&self) -> &[LossLine] {
        &self.0
    }
}

/// Writes all losses on one line.
impl fmt::Display for Losses {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (number, LossLine { name, detail, .. }) in self.0.iter().enumerate() {
            let separator = if number == 0 { "lost: " } else { "; " };
            write!(out, "{separator}{name}: {detail}")?;
        }
        Ok(())
    }
}

fn of_sink(row: &SinkLine) -> Option<LossLine> {
    let SinkLine { place, kind, frames, dropped, refused, first_error, is_lost, .. } = row;
    let count = dropped + refused;
    if count == 0 && first_error.is_none() && !is_lost {
        return None;
    }
    let offered = frames + count;
    let mut detail = format!("{dropped} of {offered} frames dropped");
    if *refused > 0 {
        detail += &format!(", {refused} refused");
    }
    if let Some(error) = first_error {
        detail += &format!(", first failure: {error}");
    }
    Some(LossLine { part: LostPart::Sink, name: format!("{place} ({kind})"), count, detail })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::summary::sample_summary;

    fn row(dropped: u64, refused: u64, first_error: Option<&str>) -> SinkLine {
        let [row] = <[SinkLine; 1]>::try_from(sample_summary().sinks).unwrap();
        SinkLine { dropped, refused, first_error: first_error.map(Into::into), is_lost: false, frames: 40, ..row }
    }

    #[test]
    fn sinks_that_took_every_frame_lost_nothing() {
        let losses = Losses::of_sinks(&[row(0, 0, None), row(0, 0, None)]);
        assert!(losses.is_empty() && losses.to_string().is_empty());
    }

    #[test]
    fn drops_refusals_failed_ends_and_lost_sinks_are_losses() {
        let broken = SinkLine { is_lost: true, ..row(0, 0, None) };
        let rows = [row(10, 0, None), row(0, 3, Some("no space")), row(0, 0, None), row(0, 0, Some("gone")), broken];
        let losses = Losses::of_sinks(&rows);
        assert_eq!(losses.lines().iter().map(|line| line.count).collect::<Vec<_>>(), [10, 3, 0, 0]);
        let first = &losses.lines()[0];
        assert_eq!((first.name.as_str(), first.part), ("extra_sink[0] (recorder)", LostPart::Sink));
        assert_eq!(first.detail, "10 of 50 frames dropped");
        assert_eq!(losses.lines()[1].detail, "0 of 43 frames dropped, 3 refused, first failure: no space");
    }

    #[test]
    fn frames_that_a_gateways_client_read_too_slowly_are_a_loss() {
        let mut losses = Losses::default();
        losses.note_gateway("slcan (TCP)", 0, 5678);
        assert!(losses.is_empty(), "control");
        losses.note_gateway("socketcand", 9, 5678);
        let line = &losses.lines()[0];
        assert_eq!((line.part, line.count, line.name.as_str()), (LostPart::Gateway, 9, "socketcand"));
        assert!(line.detail.starts_with("9 of 5687 frames of the bus dropped"), "{line:?}");
    }

    #[test]
    fn all_losses_are_one_line_of_text_and_a_list_in_json() {
        let mut losses = Losses::default();
        losses.note_file("summary.json", "no space");
        losses.note_thread("gateway");
        losses.note_capture("4 packets are missing");
        let line = "lost: summary.json: not written: no space; gateway: the thread ended before the run did; \
                    capture: 4 packets are missing";
        assert_eq!(losses.to_string(), line);
        let json = serde_json::to_value(&losses).unwrap();
        assert_eq!(
            (&json[0]["part"], &json[1]["part"], &json[2]["count"]),
            (&"file".into(), &"thread".into(), &1.into())
        );
    }
}
