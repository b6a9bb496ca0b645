//! A display with no X server: a connector of a graphics card that is this program's alone.
//!
//! Input: a [`Connector`], columns and rows of the frames. Output: a [`ScanOut`] that shows on it, and a thread that
//! watches its plug.
//!
//! Limits: a driver with `VK_EXT_acquire_drm_display`; one display on a card; no keys, as no window has them. **Never
//! run on a monitor:** tests below prove the refusals; code that needs a card was compiled, no more.

use crate::display::screen::panel::{Panel, Turn};
use crate::display::screen::surface::{MOST_LOSSES, Pane, VulkanPanel};
use crate::display::{
    counters::Counts, error::DisplayError, params::Bits, picture::Picture, screen::connector::Connector,
    screen::state::State,
};
use std::sync::{Arc, Weak};
use std::time::Duration;

/// Between looks at the plug.
const WATCH: Duration = Duration::from_millis(500);

/// Reports to the display when its monitor is unplugged or comes back, until the display ends.
///
/// # Errors
/// When the thread cannot be started.
pub(super) fn watch(connector: &Arc<Connector>, state: &Arc<State>) -> Result<(), DisplayError> {
    let (connector, state) = (Arc::downgrade(connector), Arc::clone(state));
    let look = move || {
        while let (false, Some(connector)) = (state.is_over() || state.ended().is_some(), Weak::upgrade(&connector)) {
            state.monitor_is_there(connector.is_plugged_in());
            // Or the card would be held until the next look.
            drop(connector);
            std::thread::sleep(WATCH);
        }
    };
    let no_thread = |error: std::io::Error| DisplayError::Thread { name: "plug", reason: error.to_string() };
    std::thread::Builder::new().name("plug".into()).spawn(look).map_err(no_thread).map(drop)
}

/// Target of the presenter: a surface, made again with its driver when it is lost or the monitor was away.
pub(super) struct ScanOut {
    panel: Option<VulkanPanel>,
    connector: Arc<Connector>,
    image_px: [u32; 2],
    bits: Bits,
    state: Arc<State>,
    /// Number of returns of the monitor when the surface was made.
    returns: u64,
    losses: u32,
    last_refusal: String,
}

impl ScanOut {
    /// Opens a surface of `connector` for pictures of its size.
    ///
    /// # Errors
    /// When the driver does not scan out to it, or not with this depth.
    pub(super) fn open(
        connector: Arc<Connector>,
        image_px: [u32; 2],
        bits: Bits,
        state: Arc<State>,
    ) -> Result<Self, DisplayError> {
        let (losses, last_refusal) = (0, String::new());
        let mut opened = Self { panel: None, connector, image_px, bits, state, returns: 0, losses, last_refusal };
        opened.make()?;
        Ok(opened)
    }

    /// Returns the adapter and format.
    pub(super) fn description(&self) -> &str {
        self.panel.as_ref().map_or("", VulkanPanel::description)
    }

    fn counts(&self) -> Counts {
        self.state.counters.read()
    }

    fn make(&mut self) -> Result<(), DisplayError> {
        // A driver hands a connector out once: the old one goes first.
        self.panel = None;
        self.returns = self.counts().monitor_regained;
        let pane = Pane::Connector(Arc::clone(&self.connector));
        self.panel = Some(VulkanPanel::open(pane, self.image_px, self.bits, Arc::clone(&self.state))?);
        Ok(())
    }
}

impl Panel for ScanOut {
    fn turn(&mut self) -> Turn {
        // A monitor that was away has forgotten its mode, which is set for new surfaces only.
        let is_same = self.returns == self.counts().monitor_regained;
        match self.panel.as_mut().filter(|_| is_same).map_or(Turn::Lost, Panel::turn) {
            Turn::Lost => {
                self.losses += 1;
                if let Err(error) = self.make() {
                    self.last_refusal = error.to_string();
                }
                Turn::Lost
            }
            turn @ (Turn::Ready | Turn::Reconfigured | Turn::NotNow) => {
                self.losses = 0;
                turn
            }
        }
    }

    fn show(&mut self, picture: &Picture, is_changed: bool) {
        if let Some(panel) = &mut self.panel {
            panel.show(picture, is_changed);
        }
    }

    fn failure(&self) -> Option<String> {
        let lost = || format!("the surface was lost {} times in a row: {}", self.losses, self.last_refusal);
        let failed = self.panel.as_ref().and_then(Panel::failure);
        failed.or_else(|| (self.losses >= MOST_LOSSES).then(lost))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::display::screen::connector::tests::{HD, connector_without_card};

    /// Returns a scan-out without a card.
    fn without_card(losses: u32) -> ScanOut {
        let connector = Arc::new(connector_without_card());
        let (state, last_refusal) = (Arc::new(State::default()), String::new());
        ScanOut { panel: None, connector, image_px: HD, bits: Bits::Eight, state, returns: 0, losses, last_refusal }
    }

    #[test]
    fn connector_without_a_driver_is_refused() {
        let error = without_card(0).make().unwrap_err();
        assert!(matches!(error, DisplayError::NoScanOut { .. }), "{error}");
        let text = error.to_string();
        assert!(text.contains("DP-1 of /dev/null") && text.contains("VK_EXT_acquire_drm_display"), "{text}");
    }

    #[test]
    fn a_surface_that_is_lost_too_often_stays_lost() {
        let mut out = without_card(MOST_LOSSES - 2);
        assert_eq!((out.turn(), out.failure()), (Turn::Lost, None));
        assert_eq!(out.turn(), Turn::Lost);
        let failure = out.failure().unwrap();
        assert!(failure.contains("50 times") && failure.contains("DP-1"), "{failure}");
    }

    #[test]
    fn a_connector_that_is_gone_is_reported_as_an_unplugged_monitor() {
        let out = without_card(0);
        watch(&out.connector, &out.state).unwrap();
        while !out.state.is_away() {
            std::thread::yield_now();
        }
        assert_eq!(out.counts().monitor_lost, 1);
        out.state.finish();
    }
}
