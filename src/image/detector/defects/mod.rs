//! Defective pixels, columns and rows: a list that may change while frames are drawn -> the outliers of each frame.
//!
//! | kind | what it does | where |
//! |---|---|---|
//! | hot | `extra_e_per_s * exposure_s` mean electrons more, with their shot noise | dark signal |
//! | dead | counts only `response` of its light | photo response |
//! | RTS | as hot, while a [`telegraph`] signal is high | dark signal |
//! | stuck | always reads the same digital number | after the ADC |
//!
//! Places are pixels of the sensor; a stuck pixel that charge binning sums with others makes the sum stuck. A column or
//! row is one defect with one telegraph signal. The capacity of the list in pixels is fixed when it is made; inserting
//! and removing allocate nothing. Terms: Janesick, "Scientific charge-coupled devices" (2001); RTS in dark current:
//! Hopkins and Hopkinson, IEEE Trans. Nucl. Sci. 42 (1995) 2074. Tests: below, in `telegraph` and in
//! `tests/physics/detector_spatial.rs`.

pub mod population;
pub mod telegraph;

pub use population::DefectPopulation;
pub use telegraph::Rates;

use crate::detector::outliers::{Outlier, fold_equal, with_space};
use base::image::DnImage;
use telegraph::Telegraph;

/// Place of a defect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DefectPlace {
    /// One pixel: column and row.
    Pixel(u32, u32),
    /// A whole column.
    Column(u32),
    /// A whole row.
    Row(u32),
}

/// Kind and size of a defect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DefectKind {
    /// More dark current, e-/s.
    Hot {
        /// Mean electrons per second more.
        extra_e_per_s: f64,
    },
    /// Less response to light.
    Dead {
        /// Share of the light that is counted, 0 to 1.
        response: f64,
    },
    /// Dark current of two levels.
    Rts {
        /// Mean electrons per second more at the high level.
        extra_e_per_s: f64,
        /// Switching rates.
        rates: Rates,
    },
    /// Always the same digital number.
    Stuck {
        /// The digital number.
        dn: u16,
    },
}

/// One defect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Defect {
    /// Place of the defect.
    pub place: DefectPlace,
    /// Kind of the defect.
    pub kind: DefectKind,
}

/// Name of an inserted defect, for removing it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DefectId(u32);

/// Reason why a defect was refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum DefectError {
    /// The place is not on the detector.
    #[error("defect at {place:?}: the detector has {size_px:?} px; give a place on it")]
    Outside {
        /// Place that was given.
        place: DefectPlace,
        /// Columns and rows.
        size_px: [u32; 2],
    },
    /// The list is full.
    #[error("defect of {wanted_px} px: the list holds {held_px} of at most {most_px}; remove some")]
    Full {
        /// Pixels of the defect.
        wanted_px: usize,
        /// Pixels held.
        held_px: usize,
        /// Capacity of the list, pixels.
        most_px: usize,
    },
    /// A value is invalid.
    #[error("defect {what}: got {got}, wanted {wanted}")]
    Value {
        /// Name of the value.
        what: &'static str,
        /// Value that was given.
        got: f64,
        /// Values that are allowed.
        wanted: &'static str,
    },
}

#[derive(Debug, Clone, Copy)]
struct Entry {
    id: DefectId,
    defect: Defect,
    signal: Option<Telegraph>,
}

/// A pixel of the ADC's image whose number never changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Stuck {
    pixel: u32,
    dn: u16,
}

/// Capacity of a list of defects.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DefectSpace {
    /// Columns and rows of the sensor.
    pub size_px: [usize; 2],
    /// Sensor pixels, along each side, that the chip sums before the ADC.
    pub charge_binning: u32,
    /// Number of defects that fit.
    pub defects: usize,
    /// Number of defective pixels that fit: a column counts as many as the sensor has rows.
    pub pixels: usize,
}

/// The defects of a detector.
#[derive(Debug)]
pub struct Defects {
    space: DefectSpace,
    size_px: [u32; 2],
    seed: u64,
    frame_period_s: f64,
    held_px: usize,
    next: u32,
    entries: Vec<Entry>,
    stuck: Vec<Stuck>,
    /// Fixed defects by pixel: `dark_e` per second. RTS pixels are in it with nothing more.
    fixed: Vec<Outlier>,
    /// The same with this frame's part.
    frame: Vec<Outlier>,
}

/// A list of defects while several are inserted and removed.
#[derive(Debug)]
pub struct DefectEdit<'a> {
    list: &'a mut Defects,
}

impl DefectEdit<'_> {
    /// Inserts a defect as [`Defects::insert`] does.
    ///
    /// # Errors
    /// As for [`Defects::insert`].
    pub fn insert(&mut self, defect: Defect) -> Result<DefectId, DefectError> {
        self.list.put(defect)
    }

    /// Removes a defect as [`Defects::remove`] does.
    pub fn remove(&mut self, id: DefectId) -> bool {
        self.list.take(id)
    }
}

impl Clone for Defects {
    fn clone(&self) -> Self {
        Self {
            entries: with_space(&self.entries),
            stuck: with_space(&self.stuck),
            fixed: with_space(&self.fixed),
            frame: with_space(&self.frame),
            ..*self
        }
    }
}

impl Defects {
    /// Returns an empty list; the seed fixes the telegraph signals, which are sampled every `frame_period_s`.
    #[allow(clippy::cast_possible_truncation, reason = "sides are below 2^16")]
    pub fn new(space: DefectSpace, seed: u64, frame_period_s: f64) -> Self {
        Self {
            space,
            size_px: space.size_px.map(|side| side as u32),
            seed,
            frame_period_s,
            held_px: 0,
            next: 0,
            entries: Vec::with_capacity(space.defects),
            stuck: Vec::with_capacity(space.pixels),
            fixed: Vec::with_capacity(space.pixels),
            frame: Vec::with_capacity(space.pixels),
        }
    }

    /// Returns the capacity.
    pub fn space(&self) -> DefectSpace {
        self.space
    }

    /// Sets the frame period, s, which is the sampling period of telegraph pixels from the next frame on.
    pub fn set_frame_period_s(&mut self, frame_period_s: f64) {
        self.frame_period_s = frame_period_s;
        for i in 0..self.entries.len() {
            self.entries[i].signal = self.signal(&self.entries[i].defect);
        }
    }

    /// Defects held, in the order they came.
    pub fn iter(&self) -> impl Iterator<Item = (DefectId, Defect)> {
        self.entries.iter().map(|entry| (entry.id, entry.defect))
    }

    /// Returns true if the list is empty.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Inserts a defect; where several meet, responses multiply, electrons add, and the latest stuck number applies.
    ///
    /// # Errors
    /// When it is not on the detector, its numbers are invalid, or the list is full; the list is then unchanged.
    pub fn insert(&mut self, defect: Defect) -> Result<DefectId, DefectError> {
        self.edit(|list| list.insert(defect))
    }

    /// Takes in many at once, which costs as much as one.
    ///
    /// # Errors
    /// At the first one that is not taken; those before it are.
    pub fn insert_all(&mut self, defects: impl IntoIterator<Item = Defect>) -> Result<(), DefectError> {
        self.edit(|list| defects.into_iter().try_for_each(|defect| list.insert(defect).map(|_| ())))
    }

    /// Takes a defect away; false when there is none of this name.
    pub fn remove(&mut self, id: DefectId) -> bool {
        self.edit(|list| list.remove(id))
    }

    /// Applies all changes that `change` makes; the outliers of frames are rebuilt once, afterwards.
    pub fn edit<T>(&mut self, change: impl FnOnce(&mut DefectEdit<'_>) -> T) -> T {
        let changed = change(&mut DefectEdit { list: self });
        self.rebuild();
        changed
    }

    /// Takes all defects away.
    pub fn clear(&mut self) {
        self.entries.clear();
        self.held_px = 0;
        self.rebuild();
    }

    /// Returns the outliers of frame `frame`, sorted by pixel.
    pub fn at_frame(&mut self, frame: u32, exposure_s: f64) -> &[Outlier] {
        #[allow(clippy::cast_possible_truncation, reason = "the inner loops work in single precision")]
        let exposure_s = exposure_s as f32;
        self.frame.clear();
        self.frame.extend(self.fixed.iter().map(|o| Outlier { dark_e: o.dark_e * exposure_s, ..*o }));
        for entry in &mut self.entries {
            let (DefectKind::Rts { extra_e_per_s, .. }, Some(signal)) = (entry.defect.kind, &mut entry.signal) else {
                continue;
            };
            if signal.is_high(frame, self.seed) {
                #[allow(clippy::cast_possible_truncation, reason = "the inner loops work in single precision")]
                let extra_e = extra_e_per_s as f32 * exposure_s;
                add_dark(&mut self.frame, entry.defect.place, self.size_px, extra_e);
            }
        }
        &self.frame
    }

    /// Writes the numbers of stuck pixels into the image that the ADC made.
    pub fn stick(&self, adc: &mut DnImage) {
        for stuck in &self.stuck {
            if let Some(dn) = adc.pixels_mut().get_mut(stuck.pixel as usize) {
                *dn = stuck.dn;
            }
        }
    }

    fn take(&mut self, id: DefectId) -> bool {
        let Some(at) = self.entries.iter().position(|entry| entry.id == id) else { return false };
        let entry = self.entries.remove(at);
        self.held_px -= self.pixels_of(entry.defect.place);
        true
    }

    fn put(&mut self, defect: Defect) -> Result<DefectId, DefectError> {
        self.check(&defect)?;
        let wanted_px = self.pixels_of(defect.place);
        if self.held_px + wanted_px > self.space.pixels || self.entries.len() == self.space.defects {
            return Err(DefectError::Full { wanted_px, held_px: self.held_px, most_px: self.space.pixels });
        }
        let id = DefectId(self.next);
        self.next = self.next.wrapping_add(1);
        self.held_px += wanted_px;
        let signal = self.signal(&defect);
        self.entries.push(Entry { id, defect, signal });
        Ok(id)
    }

    fn signal(&self, defect: &Defect) -> Option<Telegraph> {
        let DefectKind::Rts { rates, .. } = defect.kind else { return None };
        Some(Telegraph::new(rates, self.frame_period_s, self.stream(defect.place)))
    }

    fn check(&self, defect: &Defect) -> Result<(), DefectError> {
        let [width, height] = self.size_px;
        let inside = match defect.place {
            DefectPlace::Pixel(x, y) => x < width && y < height,
            DefectPlace::Column(x) => x < width,
            DefectPlace::Row(y) => y < height,
        };
        if !inside {
            return Err(DefectError::Outside { place: defect.place, size_px: self.size_px });
        }
        let not_negative = |what, got: f64| {
            let met = got.is_finite() && got >= 0.0;
            if met { Ok(()) } else { Err(DefectError::Value { what, got, wanted: "a finite number, 0 or more" }) }
        };
        match defect.kind {
            DefectKind::Hot { extra_e_per_s } => not_negative("extra_e_per_s", extra_e_per_s),
            DefectKind::Dead { response } if (0.0..=1.0).contains(&response) => Ok(()),
            DefectKind::Dead { response } => {
                Err(DefectError::Value { what: "response", got: response, wanted: "a number from 0 to 1" })
            }
            DefectKind::Rts { extra_e_per_s, rates } => not_negative("extra_e_per_s", extra_e_per_s)
                .and_then(|()| not_negative("up_per_s", rates.up_per_s))
                .and_then(|()| not_negative("down_per_s", rates.down_per_s)),
            DefectKind::Stuck { .. } => Ok(()),
        }
    }

    fn pixels_of(&self, place: DefectPlace) -> usize {
        let [width, height] = self.size_px;
        match place {
            DefectPlace::Pixel(..) => 1,
            DefectPlace::Column(_) => height as usize,
            DefectPlace::Row(_) => width as usize,
        }
    }

    /// Returns the number of the random stream: it depends on the place, not on the order of insertion.
    fn stream(&self, place: DefectPlace) -> u32 {
        match place {
            DefectPlace::Pixel(x, y) => y * self.size_px[0] + x,
            DefectPlace::Column(x) => 0x8000_0000 | x,
            DefectPlace::Row(y) => 0xC000_0000 | y,
        }
    }

    fn rebuild(&mut self) {
        self.fixed.clear();
        self.stuck.clear();
        for entry in &self.entries {
            let pixels = pixels(entry.defect.place, self.size_px);
            match fixed_part(entry.defect.kind) {
                Fixed::Outlier(outlier) => self.fixed.extend(pixels.map(|pixel| Outlier { pixel, ..outlier })),
                Fixed::Stuck(dn) => {
                    let by = self.space.charge_binning.max(1);
                    let [width, height] = self.size_px;
                    let adc = |pixel: u32| [pixel % width / by, pixel / width / by];
                    // A rest that fills no sum is not read.
                    let read = pixels.map(adc).filter(|[x, y]| *x < width / by && *y < height / by);
                    self.stuck.extend(read.map(|[x, y]| Stuck { pixel: y * (width / by) + x, dn }));
                }
            }
        }
        // A stable sort would allocate. The order within a pixel decides the last bit of a sum of three: it is that of
        // the values, not that in which defects were added.
        self.fixed.sort_unstable_by(|a, b| {
            let values = |outlier: &Outlier| [outlier.response, outlier.dark_e, outlier.charge_e];
            let by_values = values(a).into_iter().zip(values(b)).map(|(a, b)| a.total_cmp(&b));
            by_values.fold(a.pixel.cmp(&b.pixel), core::cmp::Ordering::then)
        });
        let kept = fold_equal(&mut self.fixed);
        self.fixed.truncate(kept);
    }
}

/// The effect of a defect that is equal in every frame.
enum Fixed {
    /// Electrons per second, and response.
    Outlier(Outlier),
    /// A number.
    Stuck(u16),
}

#[allow(clippy::cast_possible_truncation, reason = "the inner loops work in single precision")]
fn fixed_part(kind: DefectKind) -> Fixed {
    let none = Outlier::none(0);
    match kind {
        DefectKind::Hot { extra_e_per_s } => Fixed::Outlier(Outlier { dark_e: extra_e_per_s as f32, ..none }),
        DefectKind::Dead { response } => Fixed::Outlier(Outlier { response: response as f32, ..none }),
        DefectKind::Rts { .. } => Fixed::Outlier(none),
        DefectKind::Stuck { dn } => Fixed::Stuck(dn),
    }
}

/// Returns the row-major indices of a place, ascending.
fn pixels(place: DefectPlace, [width, height]: [u32; 2]) -> impl Iterator<Item = u32> {
    let (first, step, count) = match place {
        DefectPlace::Pixel(x, y) => (y * width + x, 1, 1),
        DefectPlace::Column(x) => (x, width, height),
        DefectPlace::Row(y) => (y * width, 1, width),
    };
    (0..count).map(move |i| first + i * step)
}

fn add_dark(list: &mut [Outlier], place: DefectPlace, size_px: [u32; 2], extra_e: f32) {
    for pixel in pixels(place, size_px) {
        if let Ok(at) = list.binary_search_by_key(&pixel, |outlier| outlier.pixel) {
            list[at].dark_e += extra_e;
        }
    }
}

#[cfg(test)]
mod tests;
