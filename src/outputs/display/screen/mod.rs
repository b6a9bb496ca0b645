//! The sink: frames in, a monitor that shows them.

mod hand_over;
pub mod painter;
mod presenter;
mod refresh;
mod state;
mod surface;
mod window;

pub use window::monitors;

use crate::display::counters::{Counts, count};
use crate::display::screen::hand_over::{Outgoing, hand_over};
use crate::display::screen::presenter::{Pace, Presenter, Showing};
use crate::display::screen::surface::{Panel, VulkanPanel};
use crate::display::screen::window::{Opened, Order};
use crate::display::submit_log::{SubmitLog, Submitted};
use crate::display::{error::DisplayError, grey::GreyMaker, params::Params, picture::Picture, screen::state::State};
use base::{clock::Clock, refused::Refused, time::Span};
use crossbeam_channel::{Receiver, bounded};
use frames::sink::crc32::{RunCrc32, pixel_crc32};
use frames::sink::{SentFrame, Sink, SinkError, SinkSummary};
use std::{path::Path, sync::Arc, thread::JoinHandle};

/// Submit times kept until they are read: more than a minute at 60 Hz.
const SUBMITS: usize = 4096;
const NAME: &str = "display";

/// A monitor that shows frames.
///
/// When its window is closed (Esc, the window manager, another program), or the driver fails, the next `send` refuses
/// its frame and says why; later frames are taken, counted as unseen, and not shown. The run decides whether it goes
/// on. An unplugged monitor is not an error: frames are counted as unseen until it is back.
#[derive(Debug)]
pub struct Display {
    image_px: [u32; 2],
    outgoing: Outgoing,
    state: Arc<State>,
    submits: Receiver<Submitted>,
    presenter: Option<JoinHandle<()>>,
    description: String,
    latency: Option<Span>,
    log: Option<SubmitLog>,
    has_reported_its_end: bool,
    is_finished: bool,
    frames: u64,
    refused: u64,
    run_crc32: RunCrc32,
}

impl Display {
    /// Opens the window for frames of `image_px` (columns, rows), and starts its presenter. Submit times are read from
    /// `clock`.
    ///
    /// # Errors
    /// When the X server, the monitor or the driver is missing, or the parameters contradict each other.
    pub fn open(
        params: &Params,
        image_px: [u32; 2],
        maker: GreyMaker,
        clock: Arc<dyn Clock>,
    ) -> Result<Self, DisplayError> {
        check(params, image_px, &maker)?;
        let state = Arc::new(State::default());
        let opened = window::open(Order {
            monitor: params.monitor.clone(),
            window_px: params.window_px,
            image_px,
            state: Arc::clone(&state),
        })?;
        let (mhz, id) = (opened.monitor.refresh_mhz, opened.window.id());
        let rate =
            refresh::reported(params.refresh, mhz, params.window_px.is_none()).inspect_err(|_| window::forget(id))?;
        let place = [Some(place_of(&opened, params)), rate].into_iter().flatten().collect::<Vec<_>>().join("; ");
        let refresh = opened.monitor.refresh_mhz.map(period);
        let (bits, shared) = (params.bits, Arc::clone(&state));
        let panel = move || VulkanPanel::open(opened.window, image_px, bits, shared);
        let start = Start { params, image_px, maker, clock, state, refresh };
        let describe = move |panel: &VulkanPanel| format!("{place}; {}", panel.description());
        start.display(panel, describe, move || window::forget(id))
    }

    /// Returns which monitor, how it is filled, which driver and which format.
    pub fn description(&self) -> &str {
        &self.description
    }

    /// Returns the counts of frames and refreshes so far.
    pub fn counts(&self) -> Counts {
        self.state.counters.read()
    }

    /// Writes the submit time of every frame from here on into a new file ([`crate::display::SubmitRow`]). Who asks for
    /// this does not read [`Self::submits`].
    ///
    /// # Errors
    /// When it is there already, or cannot be made.
    pub fn keep_submits(&mut self, path: &Path) -> Result<(), DisplayError> {
        self.log = Some(SubmitLog::create(path, self.latency)?);
        Ok(())
    }

    fn log_submits(&mut self) {
        let Some(log) = &mut self.log else { return };
        self.submits.try_iter().for_each(|submitted| log.add(&submitted));
    }

    /// Returns the submit times, oldest first, for one reader; when 4096 wait, further ones are lost and counted.
    pub fn submits(&self) -> Receiver<Submitted> {
        self.submits.clone()
    }

    /// Returns the submit to light, as it was given.
    pub fn latency(&self) -> Option<Span> {
        self.latency
    }

    /// Returns why nothing is shown any more, if so.
    pub fn ended(&self) -> Option<&DisplayError> {
        self.state.ended()
    }

    fn refuse(&mut self, frame: u32, why: DisplayError) -> Result<(), SinkError> {
        self.refused += 1;
        Err(SinkError::Device { sink: NAME, frame, source: Box::new(why) })
    }
}

impl Sink for Display {
    fn name(&self) -> &'static str {
        NAME
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        let number = frame.meta.number;
        if self.is_finished {
            self.refused += 1;
            return Err(SinkError::Finished { sink: NAME, frame: number });
        }
        let got_px = [frame.image.width(), frame.image.height()].map(|length| length as u32);
        if got_px != self.image_px {
            return self.refuse(number, DisplayError::FrameSize { got_px, wanted_px: self.image_px });
        }
        self.log_submits();
        let end = self.state.ended().cloned();
        if let (Some(end), false) = (&end, self.has_reported_its_end) {
            self.has_reported_its_end = true;
            return self.refuse(number, end.clone());
        }
        self.run_crc32.add(number, pixel_crc32(&frame.image));
        self.frames += 1;
        if end.is_some() {
            count(&self.state.counters.unseen);
        } else {
            let exposure_start = frame.meta.mid_exposure - Span::from_s(0.5 * frame.meta.exposure_s);
            if self.outgoing.put(number, Some(exposure_start), frame.image.pixels()) {
                count(&self.state.counters.replaced);
            }
        }
        Ok(())
    }

    fn counts(&self) -> Vec<(&'static str, u64)> {
        let c = self.state.counters.read();
        let named = [
            ("presented", c.presented),
            ("repeated", c.repeated),
            ("replaced", c.replaced),
            ("late", c.late),
            ("unseen", c.unseen),
            ("lost_surface", c.lost_surface),
            ("reconfigured", c.reconfigured),
            ("monitor_lost", c.monitor_lost),
            ("monitor_regained", c.monitor_regained),
            ("submits_lost", c.submits_lost + self.log.as_ref().map_or(0, SubmitLog::unwritten)),
            ("clipped_px", c.clipped_px),
        ];
        named.into_iter().filter(|(_, count)| *count > 0).collect()
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        self.is_finished = true;
        self.state.finish();
        let is_lost = self.presenter.take().is_some_and(|presenter| presenter.join().is_err());
        self.log_submits();
        let written = self.log.as_mut().map_or(Ok(()), SubmitLog::finish);
        written.map_err(|error| Refused(format!("the {NAME} sink ended with a failure: {error}")))?;
        if is_lost {
            return Err(SinkError::Lost { sink: NAME });
        }
        let (frames, refused, run_crc32) = (self.frames, self.refused, self.run_crc32.value());
        Ok(SinkSummary { sink: NAME, frames, refused, bytes: 0, run_crc32, output: None })
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        self.state.finish();
        if let Some(presenter) = self.presenter.take() {
            let _ = presenter.join(); // no caller is left to report to
        }
    }
}

/// Checks the conditions for opening a window.
fn check(params: &Params, image_px: [u32; 2], maker: &GreyMaker) -> Result<(), DisplayError> {
    if maker.bits() != params.bits.count() {
        return Err(DisplayError::refuse(format!(
            "a table of {} bit greys for a display of {} bits: wanted the same; calibrate in the mode that is used",
            maker.bits(),
            params.bits.count()
        )));
    }
    params.marker.map_or(Ok(()), |marker| marker.check(image_px))
}

fn period(mhz: u32) -> Span {
    Span::from_s(1000.0 / f64::from(mhz))
}

fn place_of(opened: &Opened, params: &Params) -> String {
    match (params.window_px, opened.is_managed) {
        (Some([w, h]), _) => format!("a window of {w} x {h} px"),
        (None, true) => format!("monitor {}, full screen", opened.monitor),
        (None, false) => format!("monitor {}, full screen without the window manager", opened.monitor),
    }
}

/// The inputs of a display, whichever surface it shows on.
struct Start<'a> {
    params: &'a Params,
    image_px: [u32; 2],
    maker: GreyMaker,
    clock: Arc<dyn Clock>,
    state: Arc<State>,
    refresh: Option<Span>,
}

impl Start<'_> {
    /// Starts the presenter. `panel` is made on its thread; `at_end` is called there when nothing is shown any more.
    fn display<G: Panel>(
        self,
        panel: impl FnOnce() -> Result<G, DisplayError> + Send + 'static,
        describe: impl FnOnce(&G) -> String + Send + 'static,
        at_end: impl FnOnce() + Send + 'static,
    ) -> Result<Display, DisplayError> {
        let Self { params, image_px, maker, clock, state, refresh } = self;
        let (latency, lead) = (params.latency, params.lead());
        let size_px = image_px.map(|length| length as usize);
        let (outgoing, incoming) = hand_over(size_px[0] * size_px[1]);
        let (submitted, submits) = bounded(SUBMITS);
        let (reported, answer) = bounded(1);
        let picture = Picture::new(size_px, params.marker, params.bits.most());
        let shared = Arc::clone(&state);
        let present = move || {
            let opened = panel();
            let _ = reported.send(opened.as_ref().map(describe).map_err(Clone::clone)); // the opener waits for it
            if let Ok(panel) = opened {
                let (pace, now) = (Pace::new(refresh), Showing::default());
                let (state, submits) = (shared, submitted);
                Presenter { panel, incoming, picture, maker, state, clock, submits, pace, lead, now }.run();
            }
            at_end();
        };
        let no_thread =
            |error: std::io::Error| DisplayError::refuse(format!("thread \"{NAME}\" cannot be started: {error}"));
        let presenter = std::thread::Builder::new().name(NAME.into()).spawn(present).map_err(no_thread)?;
        let ended = |_| DisplayError::Driver("its thread ended at its start".into());
        let description = answer.recv().map_err(ended)??;
        Ok(Display {
            image_px,
            outgoing,
            state,
            submits,
            presenter: Some(presenter),
            description,
            latency,
            log: None,
            has_reported_its_end: false,
            is_finished: false,
            frames: 0,
            refused: 0,
            run_crc32: RunCrc32::default(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::display::picture::{Corner, Marker};
    use crate::display::{error::Closing, grey::GreyTable, params::Bits, screen::surface::Turn};
    use base::clock::Monotonic;
    use frames::sink::{compliance::check_sink, sample::sample_frame};

    /// Takes everything.
    struct Paper;

    impl Panel for Paper {
        fn turn(&mut self) -> Turn {
            Turn::Ready
        }

        fn show(&mut self, _: &Picture, _: bool) {}

        fn failure(&self) -> Option<String> {
            None
        }
    }

    fn maker() -> GreyMaker {
        GreyMaker::nearest(&GreyTable::linear(8))
    }

    fn on_paper() -> Display {
        let (params, image_px) = (Params::full_screen(), [31, 17]);
        let refresh = Some(Span::from_ns(1_000_000));
        let (clock, state) = (Arc::new(Monotonic::start()), Arc::new(State::default()));
        let start = Start { params: &params, image_px, maker: maker(), clock, state, refresh };
        start.display(|| Ok(Paper), |_| "paper".into(), || {}).unwrap()
    }

    #[test]
    fn the_display_complies() {
        check_sink(|| Box::new(on_paper())).unwrap();
    }

    #[test]
    fn each_frame_is_presented_or_replaced() {
        let mut display = on_paper();
        (0..50).for_each(|number| display.send(&sample_frame(number)).unwrap());
        assert_eq!(display.finish().unwrap().frames, 50);
        let counts = display.counts();
        assert_eq!(counts.presented + counts.replaced, 50, "{counts:?}");
        let last = display.submits().try_iter().last().unwrap();
        assert_eq!(last.frame, 49, "the last one is shown before the end");
    }

    #[test]
    fn submit_times_of_a_run_are_kept_when_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(crate::display::SUBMITS);
        let mut display = on_paper();
        display.keep_submits(&path).unwrap();
        (0..50).for_each(|number| display.send(&sample_frame(number)).unwrap());
        display.finish().unwrap();
        let mut read = csv::Reader::from_path(path).unwrap();
        let rows: Vec<crate::display::SubmitRow> = read.deserialize().map(Result::unwrap).collect();
        assert_eq!(rows.len() as u64, display.counts().presented);
        assert_eq!(rows.last().unwrap().frame, 49);
        assert!(rows.windows(2).all(|pair| pair[1].submit_tai_ns >= pair[0].submit_tai_ns));
        assert!(rows.iter().all(|row| row.light_off_ns.is_none()), "no latency is known");
    }

    #[test]
    fn a_closed_window_is_reported_once_and_then_counted() {
        let mut display = on_paper();
        display.state.end(DisplayError::Closed(Closing::Escape));
        let reported = display.send(&sample_frame(1)).unwrap_err().to_string();
        assert!(reported.contains("Esc"), "{reported}");
        display.send(&sample_frame(2)).unwrap();
        let summary = display.finish().unwrap();
        assert_eq!((summary.frames, summary.refused, display.counts().unseen), (1, 1, 1));
    }

    #[test]
    fn a_frame_of_another_size_is_refused_and_the_next_is_taken() {
        let mut display = on_paper();
        let mut wrong = sample_frame(1);
        wrong.image = base::image::DnImage::new(31, 18);
        let text = display.send(&wrong).unwrap_err().to_string();
        assert!(text.contains("31 x 18") && text.contains("31 x 17"), "{text}");
        display.send(&sample_frame(2)).unwrap();
    }

    #[test]
    fn contradictory_parameters_are_refused_without_a_window() {
        let clock = || Arc::new(Monotonic::start());
        let open = |params: Params| Display::open(&params, [64, 48], maker(), clock()).unwrap_err();
        let plain = Params::full_screen();
        let depth = open(Params { bits: Bits::Ten, ..plain.clone() });
        assert!(
            depth.to_string().starts_with("a table of 8 bit greys for a display of 10 bits: wanted the same"),
            "{depth}"
        );
        let marker = Some(Marker { size_px: 49, corner: Corner::TopLeft });
        let error = open(Params { marker, ..plain }).to_string();
        assert!(
            error.starts_with("a marker of 49 px on frames of 64 x 48 px: wanted 1 px up to the shorter side"),
            "{error}"
        );
    }
}
