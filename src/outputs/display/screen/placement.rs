//! Whether a window has got where it was asked to be.
//!
//! Window managers move and resize a window some time after it is asked for, in several steps. A place counts when it
//! has been right for a while; a window that is not right in time is remade as one that no window manager touches.

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
