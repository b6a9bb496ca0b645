//! Errors of displays.

use base::refused::Refused;

/// Why nothing, or not this, is shown.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DisplayError {
    /// This build has no displays.
    #[error(
        "this program was built without displays; install one with `cargo install --locked --path . --features display`"
    )]
    NotBuilt,
    /// It cannot be opened as it was asked for.
    #[error(transparent)]
    Refused(#[from] Refused),
    /// Frames and monitor differ in size; nothing is ever scaled.
    #[error(
        "frames of {image} px for {place} of {area} px: wanted the same size, as nothing is scaled; change the camera's \
         resolution or the monitor's mode, or a window (window = [{image_w}, {image_h}], --window)",
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
    /// The window was closed.
    #[error("the display's window was closed ({0}); what is sent from now on is not shown")]
    Closed(Closing),
    /// The driver failed for good.
    #[error("the display's graphics driver failed: {0}; what is sent from now on is not shown")]
    Driver(String),
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

impl DisplayError {
    /// Returns a refusal that is only a sentence.
    pub(super) fn refuse(text: impl Into<String>) -> Self {
        Self::Refused(Refused(text.into()))
    }
}

/// Returns columns and rows in words.
pub(super) fn of([w, h]: [u32; 2]) -> String {
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
