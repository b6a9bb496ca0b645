//! Whether a monitor is plugged in and switched on: asked of the X server itself, on a connection of its own.
//!
//! The window library keeps its list of monitors until the whole screen changes, and does not look at the plug.

use x11rb::protocol::randr::{Connection, ConnectionExt as _};
use x11rb::{connection::Connection as _, rust_connection::RustConnection};

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
