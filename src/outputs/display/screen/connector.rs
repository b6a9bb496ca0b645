//! A connector of a graphics card that is this program's alone: looked for, taken, and its mode chosen.
//!
//! Input: which card, which monitor, columns and rows of the frames, the refresh they are drawn for. Output: a
//! [`Connector`] in a mode of exactly that size. Monitors have the kernel's names here (`HDMI-A-1` where X says
//! `HDMI-1`).
//!
//! **Access to the card.** One open file of a card may set its modes: the first one, unless another program has it. A
//! Vulkan driver that lists its adapters opens the card as well and would keep it from us, so the card is opened before
//! this display's driver, and by `run::wiring::display_parts::hold_cards` before the renderer's.
//!
//! **Never run on a monitor:** tests below and in `mode` prove the choice of a mode and the refusals; code that needs a
//! card was compiled, no more.

use crate::display::error::DisplayError;
use crate::display::monitor::{self, MonitorFacts};
use crate::display::params::{CardChoice, Params};
use crate::display::screen::mode::{self, Mode};
use core::panic::AssertUnwindSafe;
use drm::Device as _;
use drm::control::{Device as _, connector};
use std::fs::File;
use std::os::fd::{AsFd, AsRawFd as _, BorrowedFd};
use std::path::{Path, PathBuf};

/// Folder in which the kernel puts its cards.
const CARDS: &str = "/dev/dri";
/// Vulkan counts planes by itself, not as the kernel numbers them: the first is the one that a connector has anyway.
const FIRST_PLANE: u32 = 0;

/// An open card.
#[derive(Debug)]
struct Card {
    file: File,
    path: PathBuf,
}

impl AsFd for Card {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.file.as_fd()
    }
}

impl drm::Device for Card {}
impl drm::control::Device for Card {}

impl Card {
    fn open(path: &Path) -> Result<Self, DisplayError> {
        let refuse = |error: std::io::Error| DisplayError::Card { card: path.into(), reason: error.to_string() };
        let file = File::options().read(true).write(true).open(path).map_err(refuse)?;
        let card = Self { file, path: path.into() };
        card.resource_handles().map_err(refuse)?;
        Ok(card)
    }

    /// Returns the connectors with a monitor.
    fn connectors(&self) -> Vec<connector::Info> {
        let all = self.resource_handles().map(|resources| resources.connectors().to_vec()).unwrap_or_default();
        let asked = all.into_iter().filter_map(|handle| self.get_connector(handle, true).ok());
        asked.filter(|info| info.state() == connector::State::Connected).collect()
    }
}

/// Returns the cards to look at: the one that was chosen, or all below `directory` that can be opened, in the order of
/// their names.
fn open_cards(choice: &CardChoice, directory: &Path) -> Result<Vec<Card>, DisplayError> {
    if let CardChoice::At(path) = choice {
        return Ok(vec![Card::open(path)?]);
    }
    let refuse = |found: String| DisplayError::NoCard { directory: directory.into(), found };
    let entries = std::fs::read_dir(directory).map_err(|error| refuse(error.to_string()))?;
    let paths = entries.filter_map(|entry| Some(entry.ok()?.path()));
    let is_card = |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("card"));
    let mut paths: Vec<PathBuf> = paths.filter(is_card).collect();
    paths.sort();
    let (mut cards, mut reasons) = (Vec::new(), Vec::new());
    for path in &paths {
        match Card::open(path) {
            Ok(card) => cards.push(card),
            Err(error) => reasons.push(error.to_string()),
        }
    }
    match (cards.is_empty(), reasons.is_empty()) {
        (false, _) => Ok(cards),
        (true, false) => Err(refuse(reasons.join("; "))),
        (true, true) => Err(refuse("no card".into())),
    }
}

/// A monitor that is this program's alone.
#[derive(Debug)]
pub(super) struct Connector {
    card: Card,
    handle: connector::Handle,
    name: String,
    mode: Mode,
}

impl Connector {
    /// Takes the connector that was asked for, in a mode for frames of `image_px`.
    ///
    /// # Errors
    /// When the card, the monitor or the mode does not exist, or another program has the card.
    pub(super) fn take(choice: &CardChoice, params: &Params, image_px: [u32; 2]) -> Result<Self, DisplayError> {
        let cards = open_cards(choice, Path::new(CARDS))?;
        let there = |(card, opened): (usize, &Card)| opened.connectors().into_iter().map(move |info| (card, info));
        let mut plugged: Vec<(usize, connector::Info)> = cards.iter().enumerate().flat_map(there).collect();
        let facts: Vec<MonitorFacts> = plugged.iter().map(|(_, info)| facts_of(info)).collect();
        let (on, info) = plugged.swap_remove(monitor::choose(&facts, &params.monitor)?);
        let wanted = |card: &(usize, Card)| card.0 == on;
        let Some((_, card)) = cards.into_iter().enumerate().find(wanted) else {
            return Err(DisplayError::NoCard { directory: CARDS.into(), found: "no card".into() });
        };
        let taken =
            |error: std::io::Error| DisplayError::CardTaken { card: card.path.clone(), reason: error.to_string() };
        card.acquire_master_lock().map_err(taken)?;
        let modes = modes_of(&info);
        let name = info.to_string();
        let Some(mode) = mode::choose(&modes, image_px, params.refresh) else {
            let found = modes.iter().map(Mode::to_string).collect::<Vec<_>>().join("; ");
            return Err(DisplayError::NoMode { connector: name, image_px, found });
        };
        Ok(Self { card, handle: info.handle(), name, mode })
    }

    /// Returns the refresh rate, mHz.
    pub(super) fn refresh_mhz(&self) -> u32 {
        self.mode.refresh_mhz
    }

    /// Returns columns and rows.
    pub(super) fn size_px(&self) -> [u32; 2] {
        self.mode.size_px
    }

    /// Returns a surface of this connector. It must be dropped, and `instance` with it, before the connector.
    #[allow(unsafe_code, reason = "wgpu opens a connector by no other call")]
    pub(super) fn surface(&self, instance: &wgpu::Instance) -> Result<wgpu::Surface<'static>, String> {
        let [width, height] = self.mode.size_px;
        let target = wgpu::SurfaceTargetUnsafe::Drm {
            fd: self.card.as_fd().as_raw_fd(),
            plane: FIRST_PLANE,
            connector_id: self.handle.into(),
            width,
            height,
            refresh_rate: self.mode.refresh_mhz,
        };
        let make = || {
            // SAFETY: the file is an open card that this program is master of; the card itself reported the connector
            // and its mode. This stays true while the surface lives: `VulkanPanel` holds the connector in its pane, the
            // last of its fields to be dropped, and nothing else keeps the surface or the instance.
            unsafe { instance.create_surface_unsafe(target) }
        };
        // wgpu panics where the driver refuses to hand over the connector.
        let made = std::panic::catch_unwind(AssertUnwindSafe(make));
        let refused = |_| "the driver does not hand over the connector".to_owned();
        made.map_err(refused)?.map_err(|error| error.to_string())
    }

    /// Returns true while its monitor is plugged in.
    pub(super) fn is_plugged_in(&self) -> bool {
        // The kernel's own state of the connector: probing it would stop the picture.
        self.card.get_connector(self.handle, false).is_ok_and(|info| info.state() == connector::State::Connected)
    }
}

impl core::fmt::Display for Connector {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{} of {} by direct scan-out, {}", self.name, self.card.path.display(), self.mode)
    }
}

fn modes_of(info: &connector::Info) -> Vec<Mode> {
    info.modes().iter().filter_map(Mode::of).collect()
}

fn facts_of(info: &connector::Info) -> MonitorFacts {
    let modes = modes_of(info);
    let usual = modes.iter().find(|mode| mode.is_preferred).or_else(|| modes.first());
    MonitorFacts {
        name: info.to_string(),
        size_px: usual.map_or([0, 0], |mode| mode.size_px),
        origin_px: [0, 0],
        refresh_mhz: usual.map(|mode| mode.refresh_mhz),
        is_primary: false,
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::display::screen) const HD: [u32; 2] = [1920, 1080];
    const MODE: Mode = Mode { size_px: HD, refresh_mhz: 59_940, is_preferred: true };

    /// Returns a connector without a card. No driver has `/dev/null` among its cards: each refuses it before it looks
    /// at the connector.
    pub(in crate::display::screen) fn connector_without_card() -> Connector {
        let file = File::options().read(true).write(true).open("/dev/null").unwrap();
        let card = Card { file, path: "/dev/null".into() };
        let handle = drm::control::from_u32(1).unwrap();
        Connector { card, handle, name: "DP-1".into(), mode: MODE }
    }

    #[test]
    fn devices_that_are_not_cards_are_reported_with_advice() {
        let folder = tempfile::tempdir().unwrap();
        let of = |choice: CardChoice| open_cards(&choice, folder.path()).unwrap_err();
        let none = of(CardChoice::First);
        assert!(matches!(none, DisplayError::NoCard { .. }), "an empty directory");
        std::fs::write(folder.path().join("renderD128"), "").unwrap();
        assert_eq!(of(CardChoice::First), none, "not by which modes are set");
        let card = folder.path().join("card0");
        std::fs::write(&card, "").unwrap();
        let text = of(CardChoice::First).to_string();
        assert!(text.contains("card0") && text.contains("driver"), "{text}");
        let (plain, absent) = (of(CardChoice::At(card)), of(CardChoice::At(folder.path().join("card1"))));
        for (error, name) in [(plain, "card0"), (absent, "card1")] {
            assert!(matches!(error, DisplayError::Card { .. }), "{error}");
            assert!(error.to_string().contains(name) && error.to_string().contains("video"), "{error}");
        }
        let nowhere = open_cards(&CardChoice::First, &folder.path().join("dri")).unwrap_err();
        assert!(matches!(nowhere, DisplayError::NoCard { .. }), "a machine without cards");
    }

    #[test]
    fn an_unavailable_mode_or_card_says_why() {
        let found = MODE.to_string();
        let none = DisplayError::NoMode { connector: "DP-1".into(), image_px: [1024, 768], found }.to_string();
        assert!(
            none.contains("DP-1") && none.contains("1024 x 768") && none.contains("1920 x 1080 at 59.940 Hz"),
            "{none}"
        );
        let taken = DisplayError::CardTaken { card: "/dev/dri/card0".into(), reason: "busy".into() }.to_string();
        assert!(taken.contains("/dev/dri/card0") && taken.contains("display server"), "{taken}");
    }
}
