//! Errors of displays.

use std::path::PathBuf;

/// Why nothing, or not this, is shown.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DisplayError {
    /// This build has no displays.
    #[error(
        "this program was built without displays; install one with `cargo install --locked --path . --features display`"
    )]
    NotBuilt,
    /// No X server answers.
    #[error("no window can be opened: {0}; start an X server and set DISPLAY (XAUTHORITY too, for another user's)")]
    NoServer(String),
    /// The event loop's thread has ended, or does not answer.
    #[error("the display's event loop does not answer within {waited_s} s; is the X server stuck?")]
    NoAnswer {
        /// Time that was waited.
        waited_s: u64,
    },
    /// The monitor that was asked for is not there.
    #[error("no monitor {wanted}: found {found}; plug it in, or name one of these")]
    NoMonitor {
        /// Monitor that was requested.
        wanted: String,
        /// Monitors that were found.
        found: String,
    },
    /// Frames and monitor differ in size; nothing is ever scaled.
    #[error(
        "frames of {image} px for {place} of {area} px: wanted the same size, as nothing is scaled; change the camera's \
         resolution or the monitor's mode, or ask for window = [{image_w}, {image_h}]",
        image = of(*image_px), area = of(*area_px), image_w = image_px[0], image_h = image_px[1]
    )]
    Size {
        /// Columns and rows of the frames.
        image_px: [u32; 2],
        /// The monitor or the window.
        place: String,
        /// Its columns and rows.
        area_px: [u32; 2],
    },
    /// One frame of another size than the display was opened for.
    #[error("a frame of {} px on a display opened for {} px", of(*got_px), of(*wanted_px))]
    FrameSize {
        /// Columns and rows of the frame.
        got_px: [u32; 2],
        /// Columns and rows of the display.
        wanted_px: [u32; 2],
    },
    /// The window could not be made.
    #[error("the X server gives no window: {0}")]
    NoWindow(String),
    /// The window does not get where it was asked to be.
    #[error(
        "the window is at {got} where {wanted} was asked for; a window manager that leaves full-screen windows alone helps"
    )]
    NotPlaced {
        /// Place and size it has.
        got: String,
        /// Place and size it should have.
        wanted: String,
    },
    /// No graphics driver can show on this window.
    #[error("no Vulkan driver shows on this window: {0}; install a driver (mesa-vulkan-drivers has a software one)")]
    NoDriver(String),
    /// The driver has no format of this depth that shows greys as they are.
    #[error("{bits} bits are not offered here: the driver offers {offered}; {advice}")]
    Depth {
        /// Bits asked for.
        bits: u32,
        /// Formats there are.
        offered: String,
        /// Advice.
        advice: &'static str,
    },
    /// A table made for another number of bits.
    #[error(
        "a table of {table} bit greys for a display of {display} bits: wanted the same; calibrate in the mode that is used"
    )]
    TableDepth {
        /// Bits of the table.
        table: u32,
        /// Bits of the display.
        display: u32,
    },
    /// A grey table with invalid entries.
    #[error("grey table: wanted {wanted}, got {got}")]
    Table {
        /// Condition for a table.
        wanted: &'static str,
        /// Value that was given.
        got: String,
    },
    /// A marker that does not fit.
    #[error("a marker of {marker_px} px on frames of {} px: wanted 1 px up to the shorter side", of(*image_px))]
    MarkerSize {
        /// Its side.
        marker_px: u32,
        /// Columns and rows of the frames.
        image_px: [u32; 2],
    },
    /// The monitor's refreshes are not those that frames are drawn for.
    #[error(
        "frames are drawn for refreshes at {drawn_hz} Hz, and the monitor's are at {monitor_hz} Hz: wanted the same within \
         0.5 %; set timing.frame_rate_hz to the monitor's, or the monitor's mode to the frames'"
    )]
    RefreshRate {
        /// Rate of the frames.
        drawn_hz: String,
        /// Rate of the monitor.
        monitor_hz: String,
    },
    /// Submit times cannot be written to their file.
    #[error("submit times cannot be written to {}: {reason}; wanted a new file, and free space", path.display())]
    SubmitLog {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        reason: String,
    },
    /// The window was closed.
    #[error("the display's window was closed ({0}); what is sent from now on is not shown")]
    Closed(Closing),
    /// The driver failed for good.
    #[error("the display's graphics driver failed: {0}; what is sent from now on is not shown")]
    Driver(String),
    /// A thread could not be started.
    #[error("thread \"{name}\" cannot be started: {reason}")]
    Thread {
        /// Its name.
        name: &'static str,
        /// The system's reason.
        reason: String,
    },
}

/// Cause of a closed window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Closing {
    /// The key.
    Escape,
    /// The window manager, or a program, asked for it.
    Asked,
    /// Another client destroyed it.
    Destroyed,
}

impl core::fmt::Display for Closing {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Escape => "Esc was pressed",
            Self::Asked => "the window manager asked for it",
            Self::Destroyed => "another program destroyed it",
        })
    }
}

fn of([w, h]: [u32; 2]) -> String {
    format!("{w} x {h}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_size_says_both_and_what_to_try() {
        let error = DisplayError::Size { image_px: [1024, 768], place: "monitor HDMI-1".into(), area_px: [1920, 1080] };
        let text = error.to_string();
        for part in ["1024 x 768", "1920 x 1080", "HDMI-1", "window = [1024, 768]"] {
            assert!(text.contains(part), "{part}: {text}");
        }
    }
}
