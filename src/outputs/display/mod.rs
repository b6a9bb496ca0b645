//! Linear-luminance frames -> greys on a monitor in front of a tracker.
//!
//! Input: [`frames::sink::SentFrame`], whose pixels are luminances, 0 none, 65535 the full luminance of the display, or
//! codes of luminance ([`luminance_code`]) where they are drawn by a calibration. Output: a window that fills a monitor
//! and shows, pixel by pixel, the greys that the display's table gives for them; nothing is scaled or filtered. Each
//! new frame leaves a [`Submitted`]: when it was handed to the graphics driver. That is earlier than the light of the
//! screen, which no part of this program can measure; the marker patch lets a photodiode measure the rest.
//!
//! Greys are made on the CPU ([`grey`], [`picture`]) and shown from a texture of whole numbers: one form of the
//! arithmetic, the same with and without a GPU, and the fragment shader has nothing to do but `grey / most`. That is
//! exact: its error is below 1e-4 of a grey, and a driver rounds to the nearest. Proved for every grey of 8 and of 10
//! bits by `tests/greys/main.rs`, and through an X server by `hil_scripts/tests/test_display.py`.
//!
//! Threads: one event loop for the whole program (`window`), and one presenter for each display, which waits for the
//! monitor's refresh. `send` copies a frame into one of five buffers and returns: it never waits for either.
//!
//! The module that opens windows, `screen`, is in builds with the feature `display`; `without` has its names in the
//! others, and its error says how to build it. Calibrations and numbers are in all of them.
//!
//! Limits: X11 (Wayland desktops through Xwayland), Vulkan. Ten bits where the driver offers A2B10G10R10. When the
//! X server itself dies, Xlib ends the program; so does a client that is killed from outside (`xkill`).
//!
//! Tour: `params` (parameters) -> `monitor` (choice of the screen) -> `screen` (the sink): `refresh` (how often),
//! `window` (that fills it), `surface`, `painter` (what can be shown on), `hand_over` (the newest frame whose time has
//! come), `presenter` (each refresh) -> `grey`, `picture` (the picture) -> `counters`, `submit_log` (results).
//!
//! Calibration: `geometry` and `response` say where and how bright, `drive` makes greys of luminance,
//! `beat` and `latency` compute the effects of shutters and clocks; `calibration` measures all of them.

pub mod beat;
pub mod calibration;
#[cfg_attr(not(feature = "display"), allow(dead_code, reason = "counted by a display that is open"))]
pub mod counters;
pub mod drive;
pub mod error;
pub mod flat_field;
pub mod geometry;
pub mod grey;
pub mod latency;
pub mod luminance_code;
pub mod monitor;
pub mod params;
pub mod picture;
pub mod response;
#[cfg(feature = "display")]
mod screen;
#[cfg_attr(not(feature = "display"), allow(dead_code, reason = "written by a display that is open"))]
pub mod submit_log;
#[cfg(not(feature = "display"))]
mod without;

pub use counters::Counts;
pub use error::DisplayError;
pub use grey::{GreyMaker, GreyTable};
pub use monitor::{MonitorChoice, MonitorFacts};
pub use params::{Bits, Params};
pub use picture::{Corner, Marker};
#[cfg(feature = "display")]
pub use screen::{Display, monitors, painter};
pub use submit_log::{SUBMITS, SubmitRow, Submitted};
#[cfg(not(feature = "display"))]
pub use without::{Display, monitors};
