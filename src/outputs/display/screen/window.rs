//! Windows: one event loop for the whole program, on a thread of its own, begun with the first display.
//!
//! Input: orders for windows. Output: each window once it is where it was asked to be; from then on its size, its
//! monitor's comings and goings, and its end, in the display's `State`. A window without a manager, or with one that
//! knows no full screen, fills its monitor all the same: it is placed by hand, and remade without a manager when that
//! is undone.

use crate::display::error::{Closing, DisplayError};
use crate::display::monitor::{self, MonitorChoice, MonitorFacts};
use crate::display::screen::state::State;
use base::{clock::Stopwatch, time::Span};
use crossbeam_channel::{Sender, bounded};
use std::sync::{Arc, OnceLock};
use std::time::Duration;
use winit::dpi::{PhysicalPosition, PhysicalSize};
use winit::event::{ElementState, StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::keyboard::{Key, NamedKey};
use winit::platform::x11::{EventLoopBuilderExtX11, WindowAttributesExtX11};
use winit::window::{Fullscreen, Window, WindowAttributes, WindowId};
use winit::{application::ApplicationHandler, monitor::MonitorHandle};
use x11rb::{
    connection::Connection as _,
    protocol::randr::{Connection, ConnectionExt as _},
    rust_connection::RustConnection,
};

/// Longest wait for the event loop: a placement takes two seconds at most, twice.
const LONGEST_WAIT: Duration = Duration::from_secs(10);
/// Between looks at a window that is being placed.
const LOOK: Span = Span::from_ms(40);
/// Between looks for the monitors of windows that are shown.
const WATCH: Span = Span::from_ms(500);

/// A window that is wanted.
#[derive(Debug, Clone)]
pub(super) struct Order {
    /// Monitor of the window.
    pub(super) monitor: MonitorChoice,
    /// A plain window of this size instead of a full screen.
    pub(super) window_px: Option<[u32; 2]>,
    /// Columns and rows of the frames.
    pub(super) image_px: [u32; 2],
    /// Receiver of its events.
    pub(super) state: Arc<State>,
}

/// A window where it was wanted.
pub(super) struct Opened {
    pub(super) window: Arc<Window>,
    pub(super) monitor: MonitorFacts,
    /// False when no window manager has a say in it.
    pub(super) is_managed: bool,
}

type Reply = Sender<Result<Opened, DisplayError>>;

enum Request {
    Open(Order, Reply),
    Forget(WindowId),
    List(Sender<Vec<MonitorFacts>>),
}

static EVENT_LOOP: OnceLock<Result<EventLoopProxy<Request>, String>> = OnceLock::new();

/// Opens a window and waits until it is in its place.
///
/// # Errors
/// When the server or the monitor is missing, or frames of this size cannot fill it.
pub(super) fn open(order: Order) -> Result<Opened, DisplayError> {
    ask(|reply| Request::Open(order, reply))?
}

/// Returns the monitors of the X server.
///
/// # Errors
/// When the server is missing, or does not answer.
pub fn monitors() -> Result<Vec<MonitorFacts>, DisplayError> {
    ask(Request::List)
}

/// Asks the event loop, which is started when it does not run yet.
fn ask<T>(request: impl FnOnce(Sender<T>) -> Request) -> Result<T, DisplayError> {
    let proxy = EVENT_LOOP.get_or_init(start).as_ref().map_err(|why| no_server(why))?;
    let no_answer = || {
        let waited_s = LONGEST_WAIT.as_secs();
        DisplayError::refuse(format!(
            "the display's event loop does not answer within {waited_s} s; is the X server stuck?"
        ))
    };
    let (reply, answer) = bounded(1);
    proxy.send_event(request(reply)).map_err(|_| no_answer())?;
    answer.recv_timeout(LONGEST_WAIT).map_err(|_| no_answer())
}

fn no_server(why: &str) -> DisplayError {
    DisplayError::refuse(format!(
        "no window can be opened: {why}; start an X server and set DISPLAY (XAUTHORITY too, for another user's)"
    ))
}

/// Lets a window go; it closes with its last owner.
pub(super) fn forget(window: WindowId) {
    if let Some(Ok(proxy)) = EVENT_LOOP.get() {
        let _ = proxy.send_event(Request::Forget(window)); // the event loop may have ended
    }
}

fn start() -> Result<EventLoopProxy<Request>, String> {
    let (reported, answer) = bounded(1);
    let thread = std::thread::Builder::new().name("windows".into());
    thread.spawn(move || run(&reported)).map_err(|error| error.to_string())?;
    answer.recv_timeout(LONGEST_WAIT).map_err(|_| "the event loop ended or hangs at its start".to_owned())?
}

/// Leaves out the place in the window library's sources that its errors name.
fn without_source_path(error: &str) -> String {
    let behind = error.split_once(".rs:").and_then(|(_, rest)| rest.split_once(": "));
    behind.map_or(error, |(_, reason)| reason).to_owned()
}

fn run(reported: &Sender<Result<EventLoopProxy<Request>, String>>) {
    let mut builder = EventLoop::with_user_event();
    builder.with_any_thread(true);
    match builder.with_x11().build() {
        Err(error) => drop(reported.send(Err(without_source_path(&error.to_string())))),
        Ok(event_loop) => {
            let _ = reported.send(Ok(event_loop.create_proxy())); // the other thread waits for it
            let _ = event_loop.run_app(&mut Windows::new()); // returns when the server is gone
        }
    }
}

/// A window on its way to its place.
struct Opening {
    shown: Shown,
    placement: Placement,
    reply: Reply,
}

/// A window in its place.
struct Shown {
    window: Arc<Window>,
    order: Order,
    monitor: MonitorFacts,
    is_managed: bool,
}

impl Shown {
    fn opened(&self) -> Opened {
        Opened { window: Arc::clone(&self.window), monitor: self.monitor.clone(), is_managed: self.is_managed }
    }

    fn area(&self, is_full: bool) -> Area {
        let origin = self.window.inner_position().ok().map(|at| [at.x, at.y]);
        let size = self.window.inner_size();
        Area { origin_px: if is_full { origin } else { None }, size_px: [size.width, size.height] }
    }

    /// Records whether its monitor is present; a window whose monitor has come back is placed again.
    fn watch(&self, event_loop: &ActiveEventLoop, plugs: &Plugs) {
        let Some(is_in) = plugs.is_in(&self.monitor.name) else { return };
        if self.order.window_px.is_some() || is_in != self.order.state.is_away() {
            return;
        }
        let found = monitors_of(event_loop).into_iter().find(|(facts, _)| facts.name == self.monitor.name);
        if let Some((facts, handle)) = found.filter(|_| is_in) {
            let ([x, y], [w, h]) = (facts.origin_px, facts.size_px);
            self.window.set_fullscreen(None);
            self.window.set_outer_position(PhysicalPosition::new(x, y));
            let _ = self.window.request_inner_size(PhysicalSize::new(w, h)); // an event reports the new size
            if self.is_managed {
                self.window.set_fullscreen(Some(Fullscreen::Borderless(Some(handle))));
            }
        }
        self.order.state.monitor_is_there(is_in);
    }
}

/// All windows of the program.
struct Windows {
    opening: Vec<Opening>,
    shown: Vec<Shown>,
    plugs: Option<Plugs>,
    watch: Stopwatch,
    since_look: Span,
    since_watch: Span,
}

impl Windows {
    fn new() -> Self {
        let watch = Stopwatch::start();
        let (opening, shown, plugs) = (Vec::new(), Vec::new(), Plugs::connect());
        Self { opening, shown, plugs, watch, since_look: Span::ZERO, since_watch: Span::ZERO }
    }

    fn begin(&mut self, event_loop: &ActiveEventLoop, order: Order, reply: Reply) {
        match begin(event_loop, order, true) {
            Ok((shown, placement)) => self.opening.push(Opening { shown, placement, reply }),
            Err(error) => drop(reply.send(Err(error))),
        }
    }

    /// Looks once at every window that is being placed.
    fn look(&mut self, event_loop: &ActiveEventLoop) {
        for mut opening in core::mem::take(&mut self.opening) {
            let is_full = opening.shown.order.window_px.is_none();
            let area = opening.shown.area(is_full);
            match opening.placement.look(area) {
                Verdict::Waiting => self.opening.push(opening),
                Verdict::Settled => self.settle(opening),
                Verdict::Refused if is_full && opening.shown.is_managed => {
                    let Opening { shown, reply, .. } = opening;
                    match begin(event_loop, shown.order, false) {
                        Ok((shown, placement)) => self.opening.push(Opening { shown, placement, reply }),
                        Err(error) => drop(reply.send(Err(error))),
                    }
                }
                Verdict::Refused => {
                    let wanted = opening.placement.wanted();
                    drop(opening.reply.send(Err(DisplayError::refuse(format!(
                        "the window is at {area} where {wanted} was asked for; a window manager that leaves full-screen \
                         windows alone helps"
                    )))));
                }
            }
        }
    }

    fn settle(&mut self, opening: Opening) {
        let size = opening.shown.window.inner_size();
        opening.shown.order.state.set_window_px([size.width, size.height]);
        if opening.reply.send(Ok(opening.shown.opened())).is_ok() {
            self.shown.push(opening.shown);
        }
    }
}

/// Makes a window for `order`.
fn begin(event_loop: &ActiveEventLoop, order: Order, is_managed: bool) -> Result<(Shown, Placement), DisplayError> {
    let monitors = monitors_of(event_loop);
    let facts: Vec<MonitorFacts> = monitors.iter().map(|(facts, _)| facts.clone()).collect();
    let chosen = monitor::choose(&facts, &order.monitor)?;
    let (monitor, handle) = monitors[chosen].clone();
    let (place, wanted) = match order.window_px {
        Some(size_px) => ("a window".to_owned(), Area { origin_px: None, size_px }),
        None => {
            let area = Area { origin_px: Some(monitor.origin_px), size_px: monitor.size_px };
            (format!("monitor {}", monitor.name), area)
        }
    };
    if wanted.size_px != order.image_px {
        return Err(DisplayError::Size { image_px: order.image_px, place, area_px: wanted.size_px });
    }
    let fullscreen = wanted.origin_px.map(|_| Fullscreen::Borderless(Some(handle)));
    let attributes = attributes(wanted, fullscreen, is_managed);
    let no_window = |error| DisplayError::refuse(format!("the X server gives no window: {error}"));
    let window = event_loop.create_window(attributes).map_err(no_window)?;
    window.set_cursor_visible(false);
    let shown = Shown { window: Arc::new(window), order, monitor, is_managed };
    Ok((shown, Placement::new(wanted)))
}

fn attributes(wanted: Area, fullscreen: Option<Fullscreen>, is_managed: bool) -> WindowAttributes {
    let [w, h] = wanted.size_px;
    let attributes = Window::default_attributes()
        .with_title("starloop display")
        .with_name("starloop", "starloop")
        .with_inner_size(PhysicalSize::new(w, h))
        .with_resizable(wanted.origin_px.is_some())
        .with_override_redirect(!is_managed);
    match wanted.origin_px {
        Some([x, y]) => attributes
            .with_decorations(false)
            .with_position(PhysicalPosition::new(x, y))
            .with_fullscreen(fullscreen.filter(|_| is_managed)),
        None => attributes,
    }
}

/// Returns the monitors with their data.
fn monitors_of(event_loop: &ActiveEventLoop) -> Vec<(MonitorFacts, MonitorHandle)> {
    let primary = event_loop.primary_monitor();
    let all = event_loop.available_monitors().enumerate().map(|(index, handle)| {
        let (size, origin) = (handle.size(), handle.position());
        let facts = MonitorFacts {
            name: handle.name().unwrap_or_else(|| format!("monitor {index}")),
            size_px: [size.width, size.height],
            origin_px: [origin.x, origin.y],
            refresh_mhz: handle.refresh_rate_millihertz().filter(|mhz| *mhz > 0),
            is_primary: primary.as_ref() == Some(&handle),
        };
        (facts, handle)
    });
    all.filter(|(facts, _)| !facts.size_px.contains(&0)).collect()
}

impl ApplicationHandler<Request> for Windows {
    fn resumed(&mut self, _: &ActiveEventLoop) {}

    fn new_events(&mut self, event_loop: &ActiveEventLoop, _: StartCause) {
        let passed = self.watch.lap();
        self.since_look = self.since_look + passed;
        self.since_watch = self.since_watch + passed;
        if self.since_look >= LOOK {
            self.since_look = Span::ZERO;
            self.look(event_loop);
        }
        if self.since_watch >= WATCH {
            self.since_watch = Span::ZERO;
            if let Some(plugs) = &self.plugs {
                self.shown.iter().for_each(|shown| shown.watch(event_loop, plugs));
            }
        }
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, request: Request) {
        match request {
            Request::Open(order, reply) => self.begin(event_loop, order, reply),
            Request::List(reply) => {
                let all = monitors_of(event_loop).into_iter().map(|(facts, _)| facts).collect();
                let _ = reply.send(all); // the other thread waits for it
            }
            Request::Forget(id) => self.shown.retain(|shown| shown.window.id() != id),
        }
    }

    #[allow(clippy::wildcard_enum_match_arm, reason = "winit's events: a window needs few of them")]
    fn window_event(&mut self, _: &ActiveEventLoop, id: WindowId, event: WindowEvent) {
        let Some(shown) = self.shown.iter().find(|shown| shown.window.id() == id) else { return };
        let state = &shown.order.state;
        match event {
            WindowEvent::Resized(size) => state.set_window_px([size.width, size.height]),
            WindowEvent::CloseRequested => state.end(DisplayError::Closed(Closing::Asked)),
            WindowEvent::Destroyed => state.end(DisplayError::Closed(Closing::Destroyed)),
            WindowEvent::KeyboardInput { event: key, .. }
                if key.state == ElementState::Pressed && key.logical_key == Key::Named(NamedKey::Escape) =>
            {
                state.end(DisplayError::Closed(Closing::Escape));
            }
            _ => {}
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        let next = |period: Span| ControlFlow::wait_duration(Duration::from_millis(period.ms() as u64));
        event_loop.set_control_flow(match (self.opening.is_empty(), self.shown.is_empty()) {
            (false, _) => next(LOOK),
            (true, false) => next(WATCH),
            (true, true) => ControlFlow::Wait,
        });
    }
}

// Whether a monitor is plugged in and switched on: asked of the X server itself, on a connection of its own.
//
// The window library keeps its list of monitors until the whole screen changes, and does not look at the plug.

/// A connection to ask by.
pub(super) struct Plugs {
    server: RustConnection,
    root: u32,
}

impl Plugs {
    /// Connects to the server of `DISPLAY`; `None` when it does not let us.
    pub(super) fn connect() -> Option<Self> {
        let (server, screen) = x11rb::connect(None).ok()?;
        let root = server.setup().roots.get(screen)?.root;
        Some(Self { server, root })
    }

    /// Returns whether the output of this name is connected and shows something; `None` when the server does not say.
    pub(super) fn is_in(&self, name: &str) -> Option<bool> {
        let resources = self.server.randr_get_screen_resources_current(self.root).ok()?.reply().ok()?;
        for output in resources.outputs {
            let asked = self.server.randr_get_output_info(output, resources.config_timestamp).ok()?;
            let info = asked.reply().ok()?;
            if info.name == name.as_bytes() {
                return Some(info.connection != Connection::DISCONNECTED && info.crtc != 0);
            }
        }
        // An output that has gone altogether, as those of docks do.
        Some(false)
    }
}

// Whether a window has got where it was asked to be.
//
// Window managers move and resize a window some time after it is asked for, in several steps. A place counts when it
// has been right for a while; a window that is not right in time is remade as one that no window manager touches.

/// Looks in a row that must find the window right.
const RIGHT_LOOKS: u32 = 5;
/// Looks in all.
const MOST_LOOKS: u32 = 50;

/// A part of the desktop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Area {
    /// Its first pixel; `None` where it does not matter.
    pub(super) origin_px: Option<[i32; 2]>,
    /// Columns and rows.
    pub(super) size_px: [u32; 2],
}

impl core::fmt::Display for Area {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let [w, h] = self.size_px;
        write!(f, "{w} x {h} px")?;
        match self.origin_px {
            Some([x, y]) => write!(f, " at {x}, {y}"),
            None => f.write_str(" anywhere"),
        }
    }
}

/// Result of one look at the window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// The window may still reach its place.
    Waiting,
    /// The window is in its place to stay.
    Settled,
    /// The window does not reach its place.
    Refused,
}

/// The looks at one window.
#[derive(Debug)]
pub(super) struct Placement {
    wanted: Area,
    looks: u32,
    right: u32,
}

impl Placement {
    /// Returns a window that is wanted there.
    pub(super) fn new(wanted: Area) -> Self {
        Self { wanted, looks: 0, right: 0 }
    }

    /// Returns where it is wanted.
    pub(super) fn wanted(&self) -> Area {
        self.wanted
    }

    /// Looks at where it is.
    pub(super) fn look(&mut self, got: Area) -> Verdict {
        let is_there = self.wanted.origin_px.is_none() || self.wanted.origin_px == got.origin_px;
        let is_right = is_there && self.wanted.size_px == got.size_px;
        self.looks += 1;
        self.right = if is_right { self.right + 1 } else { 0 };
        match (self.right >= RIGHT_LOOKS, self.looks >= MOST_LOOKS) {
            (true, _) => Verdict::Settled,
            (false, true) => Verdict::Refused,
            (false, false) => Verdict::Waiting,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_do_not_contain_paths_of_the_build() {
        let error = "os error at /home/me/.cargo/registry/src/winit-0.30.13/src/mod.rs:788: Failed to open X11 display";
        assert_eq!(without_source_path(error), "Failed to open X11 display");
        assert_eq!(without_source_path("no server"), "no server");
    }
}

#[cfg(test)]
mod placement_tests {
    use super::*;

    const SCREEN: Area = Area { origin_px: Some([0, 0]), size_px: [640, 480] };
    const BELOW_A_TITLE: Area = Area { origin_px: Some([1, 18]), size_px: [640, 480] };

    fn verdicts(wanted: Area, looks: impl IntoIterator<Item = Area>) -> Vec<Verdict> {
        let mut placement = Placement::new(wanted);
        looks.into_iter().map(|got| placement.look(got)).collect()
    }

    #[test]
    fn a_place_counts_when_it_lasts() {
        let moved = [SCREEN, SCREEN, BELOW_A_TITLE, SCREEN, SCREEN, SCREEN, SCREEN, SCREEN];
        let verdicts = verdicts(SCREEN, moved);
        assert_eq!(verdicts.iter().position(|verdict| *verdict == Verdict::Settled), Some(7));
    }

    #[test]
    fn a_title_bar_that_stays_is_a_refusal() {
        let verdicts = verdicts(SCREEN, [BELOW_A_TITLE; 50]);
        assert_eq!((verdicts[48], verdicts[49]), (Verdict::Waiting, Verdict::Refused));
    }

    #[test]
    fn a_plain_window_may_be_anywhere_but_has_its_size() {
        let anywhere = Area { origin_px: None, ..SCREEN };
        assert_eq!(verdicts(anywhere, [BELOW_A_TITLE; 5])[4], Verdict::Settled);
        let small = Area { size_px: [639, 480], ..SCREEN };
        assert_eq!(verdicts(anywhere, [small; 50])[49], Verdict::Refused);
    }
}
