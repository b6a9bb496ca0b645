//! One refresh after the other: fetch the newest frame, make its greys, show them, say when.
//!
//! The frame is fetched after the wait for a free image, so that it is as new as can be. A frame that was drawn for a
//! moment is shown at the refresh whose light comes nearest to it ([`crate::display::Params::lead`]): its light begins
//! within half a refresh of that moment, and on the average at it, however soon it was drawn. Monitors set the pace;
//! where a driver does not wait for one (software Vulkan on a virtual server), the presenter waits itself.

use crate::display::screen::hand_over::{Incoming, Luminances};
use crate::display::screen::surface::{Panel, Turn};
use crate::display::{
    counters::count, error::DisplayError, grey::GreyMaker, picture::Picture, screen::state::State,
    submit_log::Submitted,
};
use base::clock::{Clock, Stopwatch};
use base::time::{Span, Tai};
use core::sync::atomic::Ordering;
use crossbeam_channel::Sender;
use std::{sync::Arc, time::Duration};

/// Time between looks for a monitor that is away, or a surface that is unavailable.
const AWAY: Duration = Duration::from_millis(20);
/// Assumed where the server does not know the refresh rate, for the pace of a driver that does not wait.
const USUAL_REFRESH: Span = Span::from_ns(16_666_667);
/// A frame that waits for a driver that does not wait: this part of a refresh after the one before.
const PACE: f64 = 0.5;
/// A refresh that comes later than this many after the one before has missed one.
const LATE: f64 = 1.5;
/// Refreshes after the end of a run for frames that are still on their way; in the second half none waits for its time.
const LAST_REFRESHES: u32 = 10;

/// Times of refreshes.
#[derive(Debug)]
pub(super) struct Pace {
    refresh: Option<Span>,
    watch: Stopwatch,
    since_last: Span,
    is_first: bool,
}

impl Pace {
    /// Returns the pace of a monitor with this time between refreshes, if it is known.
    pub(super) fn new(refresh: Option<Span>) -> Self {
        Self { refresh, watch: Stopwatch::start(), since_last: Span::ZERO, is_first: true }
    }

    /// Returns how long to wait before the next image is asked for.
    fn left(&mut self) -> Duration {
        self.since_last = self.since_last + self.watch.lap();
        let least_s = self.refresh.unwrap_or(USUAL_REFRESH).s() * PACE;
        let left_s = if self.is_first { 0.0 } else { least_s - self.since_last.s() };
        Duration::try_from_secs_f64(left_s).unwrap_or_default()
    }

    /// Records that an image was shown; true when it came too late.
    fn is_late(&mut self) -> bool {
        self.since_last = self.since_last + self.watch.lap();
        let most = self.refresh.map(|refresh| refresh.s() * LATE);
        let is_late = !self.is_first && most.is_some_and(|most_s| self.since_last.s() > most_s);
        (self.since_last, self.is_first) = (Span::ZERO, false);
        is_late
    }

    /// Starts again: the next image does not follow the one before.
    fn start_again(&mut self) {
        self.is_first = true;
    }
}

/// All that one display's thread owns.
pub(super) struct Presenter<G> {
    pub(super) panel: G,
    pub(super) incoming: Incoming,
    pub(super) picture: Picture,
    pub(super) maker: GreyMaker,
    pub(super) state: Arc<State>,
    pub(super) clock: Arc<dyn Clock>,
    pub(super) submits: Sender<Submitted>,
    pub(super) pace: Pace,
    /// How long before its light is wanted a frame is submitted at the earliest; `None`: frames are shown as they come.
    pub(super) lead: Option<Span>,
    pub(super) now: Showing,
}

/// The picture on the screen.
#[derive(Debug, Default)]
pub(super) struct Showing {
    frame: Luminances,
    /// Refreshes so far.
    refresh: u64,
    marker_is_white: bool,
    /// From the fetch of the latest frame to its submit.
    composing: Span,
    /// Frames no longer wait for their time.
    takes_all: bool,
}

impl<G: Panel> Presenter<G> {
    /// Presents until the run is over, the window closed, or the driver has failed; then shows what is still on its
    /// way.
    pub(super) fn run(&mut self) {
        while !self.state.is_over() && self.state.ended().is_none() {
            std::thread::sleep(self.pace.left());
            self.refresh_once();
        }
        // A frame that was accepted before the end is shown: a few tries, as the surface may just be away.
        for refresh in 0..LAST_REFRESHES {
            self.now.takes_all = 2 * refresh >= LAST_REFRESHES;
            if self.state.ended().is_some() || self.state.is_away() || self.incoming.is_empty() {
                break;
            }
            std::thread::sleep(self.pace.left());
            self.refresh_once();
        }
        self.now.takes_all = true;
        if self.fetch() {
            count(&self.state.counters.unseen);
        }
    }

    /// Shows one refresh, or waits shortly when nothing can be shown.
    pub(super) fn refresh_once(&mut self) {
        if self.state.is_away() {
            if self.fetch() {
                count(&self.state.counters.unseen);
            }
            self.pace.start_again();
            std::thread::sleep(AWAY);
            return;
        }
        if self.take_turn() {
            let begun = self.clock.now();
            let is_new = self.fetch();
            let submit = self.show(is_new);
            if is_new {
                self.now.composing = submit - begun;
            }
        }
        if let Some(failure) = self.panel.failure() {
            self.state.end(DisplayError::Driver(failure));
        }
    }

    /// Returns true if an image is available to show something in.
    fn take_turn(&mut self) -> bool {
        let counters = &self.state.counters;
        match self.panel.turn() {
            Turn::Ready => return true,
            Turn::Reconfigured => {
                count(&counters.reconfigured);
                return true;
            }
            Turn::Lost => count(&counters.lost_surface),
            Turn::NotNow => {}
        }
        self.pace.start_again();
        std::thread::sleep(AWAY);
        false
    }

    /// Returns true if another frame is to be shown.
    fn fetch(&mut self) -> bool {
        let lead = self.lead.filter(|_| !self.now.takes_all);
        let by = lead.map(|lead| self.clock.now() + self.now.composing + lead);
        let passed = self.incoming.fetch(&mut self.now.frame, by);
        self.state.counters.replaced.fetch_add(passed.unwrap_or(0), Ordering::Relaxed);
        passed.is_some()
    }

    /// Shows the present picture; returns the time at which it was submitted.
    fn show(&mut self, is_new: bool) -> Tai {
        let now = &mut self.now;
        // Before the first frame the picture is black, as it was made.
        let has_frame = !now.frame.pixels.is_empty();
        let is_changed = has_frame && (is_new || self.maker.changes_by_refresh());
        now.marker_is_white ^= is_new;
        let counters = &self.state.counters;
        if is_changed {
            let clipped = self.picture.compose(&now.frame.pixels, &self.maker, now.refresh, now.marker_is_white);
            if is_new {
                counters.clipped_px.fetch_add(clipped, Ordering::Relaxed);
            }
        }
        self.panel.show(&self.picture, is_changed);
        let submit = self.clock.now();
        let is_late = self.pace.is_late();
        if is_late {
            count(&counters.late);
        }
        count(if is_new { &counters.presented } else { &counters.repeated });
        let (frame, wanted_light) = (now.frame.number, now.frame.light);
        let (refresh, marker_is_white) = (now.refresh, now.marker_is_white);
        let submitted = Submitted { frame, refresh, submit, wanted_light, is_late, marker_is_white };
        if is_new && self.submits.try_send(submitted).is_err() {
            count(&counters.submits_lost);
        }
        now.refresh += 1;
        submit
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::display::grey::{GreyTable, Row};
    use crate::display::params::Params;
    use crate::display::picture::{Corner, Marker};
    use crate::display::screen::hand_over::{Outgoing, hand_over};
    use base::clock::Virtual;
    use crossbeam_channel::{Receiver, bounded};

    /// Shows on nothing and remembers; each turn comes from a list, then `Ready`.
    #[derive(Default)]
    struct Paper {
        turns: Vec<Turn>,
        shown: Vec<(Vec<u16>, bool)>,
        failure: Option<String>,
    }

    impl Panel for Paper {
        fn turn(&mut self) -> Turn {
            self.turns.pop().unwrap_or(Turn::Ready)
        }

        fn show(&mut self, picture: &Picture, is_changed: bool) {
            self.shown.push((picture.greys().to_vec(), is_changed));
        }

        fn failure(&self) -> Option<String> {
            self.failure.clone()
        }
    }

    struct Bench {
        presenter: Presenter<Paper>,
        outgoing: Outgoing,
        clock: Arc<Virtual>,
        submits: Receiver<Submitted>,
    }

    fn bench(maker: GreyMaker, marker: Option<Marker>) -> Bench {
        let (outgoing, incoming) = hand_over(2);
        let clock = Arc::new(Virtual::new(Tai::from_ns(1000)));
        let (sender, submits) = bounded(4);
        let presenter = Presenter {
            panel: Paper::default(),
            incoming,
            picture: Picture::new([2, 1], marker, 255),
            maker,
            state: Arc::new(State::default()),
            clock: Arc::clone(&clock) as Arc<dyn Clock>,
            submits: sender,
            pace: Pace::new(None),
            lead: None,
            now: Showing::default(),
        };
        Bench { presenter, outgoing, clock, submits }
    }

    fn nearest() -> GreyMaker {
        GreyMaker::nearest(&GreyTable::linear(8))
    }

    #[test]
    fn new_frames_are_presented_and_repeated_until_the_next() {
        let mut bench = bench(nearest(), None);
        bench.presenter.refresh_once();
        bench.outgoing.put(7, None, &[257, 65_535]);
        bench.clock.advance_to(Tai::from_ns(5000));
        bench.presenter.refresh_once();
        bench.presenter.refresh_once();
        let wanted = [(vec![0, 0], false), (vec![1, 255], true), (vec![1, 255], false)];
        assert_eq!(bench.presenter.panel.shown, wanted);
        let counts = bench.presenter.state.counters.read();
        assert_eq!((counts.presented, counts.repeated), (1, 2));
        let submits: Vec<Submitted> = bench.submits.try_iter().collect();
        let submit = Tai::from_ns(5000);
        let (wanted_light, is_late, marker_is_white) = (None, false, true);
        assert_eq!(submits, [Submitted { frame: 7, refresh: 1, submit, wanted_light, is_late, marker_is_white }]);
        assert_eq!(submits[0].predicted_light(Span::from_ns(30)).ns(), 5030);
    }

    /// Refreshes of 100 ns at whatever phase: the light of each frame begins within half of one of when it is wanted.
    #[test]
    fn each_frame_gets_the_refresh_whose_light_comes_nearest() {
        const REFRESH_NS: i64 = 100;
        const LATENCY_NS: i64 = 230;
        let mut off_ns = Vec::new();
        for phase_ns in (0..REFRESH_NS).step_by(7) {
            let mut bench = bench(nearest(), None);
            let params = Params { refresh: Some(Span::from_ns(REFRESH_NS)), ..Params::full_screen() };
            let params = Params { latency: Some(Span::from_ns(LATENCY_NS)), ..params };
            bench.presenter.lead = params.lead();
            for refresh in 0..40 {
                // Frame by frame, each drawn long before its time: sooner makes no difference.
                let light = Tai::from_ns(10_000 + REFRESH_NS * refresh);
                if refresh < 20 {
                    bench.outgoing.put(refresh as u32, Some(light), &[0, 0]);
                }
                bench.clock.advance_to(Tai::from_ns(9600 + phase_ns + REFRESH_NS * refresh));
                bench.presenter.refresh_once();
                while let Ok(Submitted { submit, wanted_light, .. }) = bench.submits.try_recv() {
                    off_ns.push((submit - wanted_light.unwrap()).ns() + LATENCY_NS);
                }
            }
            assert_eq!(bench.presenter.state.counters.read().presented, 20, "each at its own refresh");
        }
        assert!(off_ns.iter().all(|off| (-REFRESH_NS / 2..=REFRESH_NS / 2).contains(off)), "{off_ns:?}");
        let mean_ns = off_ns.iter().sum::<i64>() as f64 / off_ns.len() as f64;
        assert!(mean_ns.abs() < 4.0, "half a step of the phases: {mean_ns}");
    }

    #[test]
    fn the_last_frames_are_shown_though_their_time_never_comes() {
        let mut bench = bench(nearest(), None);
        bench.presenter.lead = Some(Span::ZERO);
        bench.presenter.pace = Pace::new(Some(Span::from_ns(1)));
        bench.outgoing.put(1, Some(Tai::from_ns(i64::MAX / 2)), &[257, 0]);
        bench.presenter.refresh_once();
        assert_eq!(bench.presenter.state.counters.read().presented, 0, "not yet");
        bench.presenter.state.finish();
        bench.presenter.run();
        assert_eq!(bench.presenter.state.counters.read().presented, 1);
    }

    #[test]
    fn the_marker_turns_over_with_new_frames_only() {
        let mut bench = bench(nearest(), Some(Marker { size_px: 1, corner: Corner::TopLeft }));
        for number in 0..3 {
            bench.outgoing.put(number, None, &[257, 257]);
            bench.presenter.refresh_once();
            bench.presenter.refresh_once();
        }
        let patches: Vec<u16> = bench.presenter.panel.shown.iter().map(|(greys, _)| greys[0]).collect();
        assert_eq!(patches, [255, 255, 0, 0, 255, 255]);
        let reported: Vec<bool> = bench.submits.try_iter().map(|submitted| submitted.marker_is_white).collect();
        assert_eq!(reported, [true, false, true]);
    }

    #[test]
    fn a_maker_that_changes_is_asked_at_each_refresh() {
        let maker = GreyMaker::by_row(8, true, |_, greys, row: Row| {
            greys.fill(row.refresh as u16);
            2
        });
        let mut bench = bench(maker, None);
        bench.outgoing.put(1, None, &[0, 0]);
        (0..3).for_each(|_| bench.presenter.refresh_once());
        let first: Vec<u16> = bench.presenter.panel.shown.iter().map(|(greys, _)| greys[0]).collect();
        assert_eq!(first, [0, 1, 2]);
        assert_eq!(bench.presenter.state.counters.read().clipped_px, 2, "once for the frame, not for its repeats");
        assert!(bench.presenter.panel.shown.iter().all(|(_, is_changed)| *is_changed));
    }

    #[test]
    fn frames_for_an_absent_monitor_are_counted_as_unseen() {
        let mut bench = bench(nearest(), None);
        assert!(bench.presenter.state.monitor_is_there(false));
        for number in 0..3 {
            bench.outgoing.put(number, None, &[1, 1]);
            bench.presenter.refresh_once();
        }
        assert!(bench.presenter.state.monitor_is_there(true));
        bench.outgoing.put(3, None, &[257, 257]);
        bench.presenter.refresh_once();
        let counts = bench.presenter.state.counters.read();
        assert_eq!((counts.unseen, counts.presented, counts.monitor_lost, counts.monitor_regained), (3, 1, 1, 1));
        assert_eq!(bench.presenter.panel.shown, [(vec![1, 1], true)]);
    }

    #[test]
    fn surfaces_that_are_lost_or_made_again_are_counted_and_no_frame_is_lost() {
        let mut bench = bench(nearest(), None);
        bench.presenter.panel.turns = vec![Turn::Reconfigured, Turn::NotNow, Turn::Lost];
        bench.outgoing.put(1, None, &[257, 0]);
        (0..3).for_each(|_| bench.presenter.refresh_once());
        let counts = bench.presenter.state.counters.read();
        assert_eq!((counts.lost_surface, counts.reconfigured, counts.presented), (1, 1, 1));
        assert_eq!(bench.presenter.panel.shown, [(vec![1, 0], true)]);
    }

    #[test]
    fn the_last_frame_is_shown_at_the_end_and_a_failure_ends_it() {
        let mut bench = bench(nearest(), None);
        bench.outgoing.put(1, None, &[257, 0]);
        bench.presenter.state.finish();
        bench.presenter.run();
        assert_eq!(bench.presenter.panel.shown.len(), 1);
        let mut bench = self::bench(nearest(), None);
        bench.presenter.panel.failure = Some("lost".into());
        bench.presenter.run();
        assert_eq!(bench.presenter.state.ended(), Some(&DisplayError::Driver("lost".into())));
    }

    #[test]
    fn submit_times_that_are_not_read_are_counted() {
        let mut bench = bench(nearest(), None);
        for number in 0..6 {
            bench.outgoing.put(number, None, &[0, 0]);
            bench.presenter.refresh_once();
        }
        let counts = bench.presenter.state.counters.read();
        assert_eq!((counts.presented, counts.submits_lost), (6, 2));
    }

    #[test]
    fn a_missed_refresh_is_late_where_the_rate_is_known() {
        let mut pace = Pace::new(Some(Span::from_ns(1)));
        assert!(!pace.is_late(), "the first follows nothing");
        std::thread::sleep(Duration::from_millis(1));
        assert!(pace.is_late(), "a millisecond at a refresh each nanosecond");
        pace.start_again();
        std::thread::sleep(Duration::from_millis(1));
        assert!(!pace.is_late(), "nor does what comes after a gap");
        let mut long = Pace::new(Some(Span::from_s(1e6)));
        assert!(!long.is_late() && !long.is_late(), "eleven days have not passed");
    }
}
