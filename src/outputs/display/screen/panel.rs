//! The target of the presenter: a surface, or a stand-in for one in tests.

use crate::display::picture::Picture;

/// Result of one wait for a refresh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Turn {
    /// There is a free image: show something.
    Ready,
    /// The image is available, but the surface was configured again.
    Reconfigured,
    /// No image can be shown now; ask again.
    NotNow,
    /// The surface was lost; it has been made again, or will be.
    Lost,
}

/// A surface of images that a monitor takes one by one.
pub(super) trait Panel {
    /// Waits for a free image: a second at most.
    fn turn(&mut self) -> Turn;

    /// Shows the picture in the image of the last [`Turn::Ready`] or [`Turn::Reconfigured`]. `is_changed`: the greys
    /// are not those of the last call.
    fn show(&mut self, picture: &Picture, is_changed: bool);

    /// Returns the first unrecoverable failure.
    fn failure(&self) -> Option<String>;
}
