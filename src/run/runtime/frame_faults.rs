//! Commanded faults of frames and of the imaging chain, and when they act.
//!
//! In: a list of faults, each with its start (an instant, or a trigger) and its length. A frame is hit when its
//! exposure
//! ends inside a fault's time. Every hit is counted by fault, marked in the frame's flags and written with its numbers
//! into the frame's truth, so that no damage is silent; start and end go into the ledger. Deterministic. Whatever a
//! fault needs (tables of other optics, places of stars) is made before the run, by [`FrameFaults::prepare`].
//! Tests: below, `conditions`, and `tests/closed_loop/imaging_faults.rs`.
//!
//! Damages a finished frame's pixels on purpose: blank, repeated, torn, flipped bits.

use crate::runtime::conditions::{Conditions, FALSE_STARS_MAX, FAULT_STREAM};
use crate::runtime::ledger::{Event, EventKind, Ledger};
use crate::runtime::{engine::FrameEngine, error::Result, slot::Slot};
use base::random::{key, philox};
use base::time::{Span, Tai};
use frames::sink::{
    ActiveFault, ActiveFaults, CameraFault, DefectSpots, FaultFlags, FaultPixels, FrameFault, ImageFault, PixelFault,
    ProtonStorm, SendingFault, SentFrame,
};
use image::detector::defects::{Defect, DefectEdit, DefectId, DefectKind, DefectPlace, Rates};
use image::detector::protons::{ProtonDirection, ProtonFlux};
use plan::exposure::{Source, SourcePlace};
use plan::{exposure::target::FIRST_FALSE_STAR_ID, optics::PsfModel};

/// Start and end time of a fault that has not been triggered.
pub const NEVER: Tai = Tai::from_ns(i64::MAX);

/// Start of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Begin {
    /// Starts at this instant.
    At(Tai),
    /// Starts this long after a trigger is fired, each time it is fired.
    OnTrigger {
        /// Trigger number.
        number: u16,
        /// Delay after the trigger.
        delay: Span,
    },
}

/// A fault with its times.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedFrameFault {
    /// Start; [`NEVER`] until it is triggered.
    pub from: Tai,
    /// End, exclusive.
    pub until: Tai,
    /// The fault.
    pub fault: FrameFault,
    /// Frames hit so far.
    pub hits: u64,
    begin: Begin,
    lasts: Span,
    /// Number in the run's list of faults, from 1.
    number: u16,
    is_on: bool,
    made: Made,
}

/// Resources that were made for a fault before the run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Made {
    NotYet,
    Nothing,
    /// Index of other optics of the engine.
    Optics(usize),
    /// A part of the list of false stars: first index and count.
    Stars(usize, usize),
    /// A part of the list of defects: first index and count.
    Defects(usize, usize),
}

/// Effects of faults on one frame after it is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fate {
    /// True when it is not sent.
    pub is_dropped: bool,
    /// Delay of its delivery.
    pub delay: Span,
    repeated: Repeated,
    is_blank: bool,
    flags: FaultFlags,
    active: ActiveFaults,
}

impl Fate {
    /// Sent once, in time and undamaged.
    pub const SEND: Self = Self {
        is_dropped: false,
        delay: Span::ZERO,
        repeated: Repeated::Nothing,
        is_blank: false,
        flags: FaultFlags::NONE,
        active: ActiveFaults::NONE,
    };
}

/// A fault elsewhere, with which frames exposed during it are marked.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Mark {
    from: Tai,
    until: Tai,
    flag: FaultFlags,
}

/// The faults of one head.
#[derive(Debug, Default)]
pub struct FrameFaults {
    timed: Vec<TimedFrameFault>,
    marks: Vec<Mark>,
    false_stars: Vec<Source>,
    defects: Vec<Commanded>,
    previous: Vec<u16>,
    /// Other optics of the engine that no fault uses any more.
    spare_optics: Vec<usize>,
}

/// A defect of the detector, and its handle while it is active.
#[derive(Debug, Clone, Copy)]
struct Commanded {
    defect: Defect,
    id: Option<DefectId>,
}

impl FrameFaults {
    /// Adds a fault between two instants; returns the index under which [`Self::timed`] lists it.
    pub fn add(&mut self, from: Tai, until: Tai, fault: FrameFault) -> usize {
        let number = u16::try_from(self.timed.len() + 1).unwrap_or(u16::MAX);
        self.arm(Begin::At(from), until - from, fault, number)
    }

    /// Adds a fault of a given length, with its number in the run's list of faults; returns its index.
    pub fn arm(&mut self, begin: Begin, lasts: Span, fault: FrameFault, number: u16) -> usize {
        let (from, until) = match begin {
            Begin::At(from) => (from, from + lasts),
            Begin::OnTrigger { .. } => (NEVER, NEVER),
        };
        let (is_on, made) = (false, Made::NotYet);
        self.timed.push(TimedFrameFault { from, until, fault, hits: 0, begin, lasts, number, is_on, made });
        self.timed.len() - 1
    }

    /// Fires a trigger at `at`, now or later: the faults that wait for it start then (again, if they have started
    /// before). Returns how many there are. Allocates nothing.
    pub fn fire_trigger(&mut self, number: u16, at: Tai) -> usize {
        let mut fired = 0;
        for timed in &mut self.timed {
            if let Begin::OnTrigger { number: own, delay } = timed.begin
                && own == number
            {
                (timed.from, timed.until) = (at + delay, at + delay + timed.lasts);
                fired += 1;
            }
        }
        fired
    }

    /// Marks frames whose exposure ends while something else, such as the bus, is faulty.
    pub fn mark(&mut self, from: Tai, until: Tai, flag: FaultFlags) {
        self.marks.push(Mark { from, until, flag });
    }

    /// Returns every fault, in the order in which they were added.
    pub fn timed(&self) -> &[TimedFrameFault] {
        &self.timed
    }

    /// Makes everything the faults will need, so that none of it is made on the frame path.
    ///
    /// # Errors
    /// When the tables of other optics are unavailable.
    pub fn prepare(&mut self, engine: &mut FrameEngine) -> Result<()> {
        let params = &engine.params;
        let (seed, exposure_s) = (params.seed, params.camera.exposure_s);
        let size = [params.camera.geometry.width_px(), params.camera.geometry.height_px()];
        let radiometry = params.camera.radiometry.clone();
        if self.timed.iter().any(|timed| timed.made == Made::NotYet) {
            engine.conditions.reserve();
            // A fault may need the image before its first frame.
            self.previous.reserve(size[0] * size[1]);
        }
        // Optics of a defocus that is over serve the next one, so that memory does not grow with injected faults. A trigger
        // may bring a fault again.
        for timed in &mut self.timed {
            let is_over = timed.hits > 0 && !timed.is_on && matches!(timed.begin, Begin::At(_));
            if let (Made::Optics(number), true) = (timed.made, is_over) {
                self.spare_optics.push(number);
                timed.made = Made::Nothing;
            }
        }
        for timed in self.timed.iter_mut().filter(|timed| timed.made == Made::NotYet) {
            timed.made = match timed.fault {
                FrameFault::Camera(CameraFault::Defocus { sigma_px }) => {
                    let (spare, psf) = (self.spare_optics.pop(), PsfModel::gaussian(sigma_px));
                    Made::Optics(engine.drawer.add_optics(&engine.params, spare, psf)?)
                }
                FrameFault::Image(ImageFault::FalseStars { pixels, mag }) => {
                    let first = self.false_stars.len();
                    let electrons = radiometry.electrons(mag, 0.0, exposure_s);
                    add_false_stars(
                        &mut self.false_stars,
                        pixels,
                        [mag, electrons],
                        size,
                        u32::from(timed.number),
                        seed,
                    );
                    Made::Stars(first, self.false_stars.len() - first)
                }
                FrameFault::Camera(CameraFault::Pixels { spots, fault }) => {
                    let first = self.defects.len();
                    let kind = defect_kind(fault);
                    let commanded = |place| Commanded { defect: Defect { place, kind }, id: None };
                    let places = defect_places(spots, size, u32::from(timed.number), seed);
                    self.defects.extend(places.map(commanded));
                    Made::Defects(first, self.defects.len() - first)
                }
                FrameFault::Sending(_) | FrameFault::Image(_) => Made::Nothing,
            };
        }
        Ok(())
    }

    /// Applies the faults of `slot` to the conditions of its exposure; returns their effects on the finished frame.
    pub fn begin(&mut self, slot: Slot, engine: &mut FrameEngine, ledger: &mut Ledger) -> Fate {
        let end = slot.exposure_end;
        let mut fate = Fate::SEND;
        for mark in self.marks.iter().filter(|mark| mark.from <= end && end < mark.until) {
            fate.flags |= mark.flag;
        }
        let has_previous = !self.previous.is_empty();
        let full_well_e = engine.params.camera.detector.full_well_e;
        engine.conditions.reset();
        for timed in &mut self.timed {
            let is_on = timed.from <= end && end < timed.until;
            if timed.announce(is_on, slot, ledger)
                && let Made::Defects(first, count) = timed.made
            {
                let commanded = &mut self.defects[first..first + count];
                let left_out =
                    engine.drawer.imager.disturbances_mut().defects_mut().edit(|list| switch(commanded, is_on, list));
                if left_out > 0 {
                    ledger.note(Event::new(EventKind::DefectLeftOut, end, Some(slot.number), Span::ZERO));
                }
            }
            // The very first frame has no previous image to repeat.
            let needs_previous =
                matches!(timed.fault, FrameFault::Sending(SendingFault::Torn | SendingFault::Duplicate));
            if !is_on || (needs_previous && !has_previous) {
                continue;
            }
            timed.hits += 1;
            fate.flags |= timed.fault.flag();
            let share = (end - timed.from).s() / (timed.until - timed.from).s();
            let (name, number, amount) = (timed.fault.name(), timed.number, timed.fault.amount(share));
            fate.active.push(ActiveFault { name, number, amount });
            fate.take(&timed.fault);
            let stars = match timed.made {
                Made::Stars(first, count) => &self.false_stars[first..first + count],
                Made::NotYet | Made::Nothing | Made::Optics(_) | Made::Defects(..) => &[],
            };
            expose_under(&mut engine.conditions, timed, amount.value, full_well_e, stars);
        }
        engine.take_conditions();
        fate
    }

    /// Damages the finished frame, and records it in its flags and its truth.
    pub fn spoil(&mut self, fate: &Fate, frame: &mut SentFrame) {
        frame.meta.faults |= fate.flags;
        frame.meta.active = fate.active;
        if fate.is_blank {
            blank(frame);
        }
        if fate.is_blank || fate.repeated != Repeated::Nothing {
            // Its pixels do not, or not all, belong to its own attitude.
            frame.meta.wcs = None;
        }
        if self.needs_previous() {
            repeat(fate.repeated, frame, &mut self.previous);
        }
        for timed in self.timed.iter().filter(|timed| timed.is_on) {
            if let FrameFault::Image(ImageFault::BitFlip { bit, pixels }) = timed.fault {
                flip(bit, pixels, u32::from(timed.number), frame);
            }
        }
    }

    fn needs_previous(&self) -> bool {
        self.timed
            .iter()
            .any(|timed| matches!(timed.fault, FrameFault::Sending(SendingFault::Torn | SendingFault::Duplicate)))
    }
}

impl Fate {
    /// Adds the effect of a fault on a finished frame.
    fn take(&mut self, fault: &FrameFault) {
        match *fault {
            FrameFault::Sending(SendingFault::Drop) => self.is_dropped = true,
            FrameFault::Sending(SendingFault::Duplicate) => self.repeated = Repeated::All,
            FrameFault::Sending(SendingFault::Torn) => {
                if self.repeated == Repeated::Nothing {
                    self.repeated = Repeated::UpperHalf;
                }
            }
            FrameFault::Sending(SendingFault::Late(delay)) => self.delay = self.delay.max(delay),
            FrameFault::Image(ImageFault::Blank) => self.is_blank = true,
            // These faults change the exposure or single pixels.
            FrameFault::Image(_) | FrameFault::Camera(_) => {}
        }
    }
}

/// Adds defects to the detector, or removes them; returns how many did not fit.
fn switch(commanded: &mut [Commanded], is_on: bool, list: &mut DefectEdit<'_>) -> usize {
    let mut left_out = 0;
    for Commanded { defect, id } in commanded {
        *id = match id.take() {
            None if is_on => {
                let taken = list.insert(*defect).ok();
                left_out += usize::from(taken.is_none());
                taken
            }
            Some(there) if !is_on => {
                list.remove(there);
                None
            }
            there => there,
        };
    }
    left_out
}

impl TimedFrameFault {
    /// Adds an event to the ledger when the fault starts and when it ends; returns true when it did.
    fn announce(&mut self, is_on: bool, slot: Slot, ledger: &mut Ledger) -> bool {
        if is_on == self.is_on {
            return false;
        }
        self.is_on = is_on;
        let (kind, at) = if is_on { (EventKind::Fault, self.from) } else { (EventKind::FaultOver, slot.exposure_end) };
        let event = Event::new(kind, at, Some(slot.number), self.lasts);
        ledger.note(Event { what: self.fault.name(), ..event });
        true
    }
}

/// Applies a fault to the exposure of a frame; `value` is its present amount.
fn expose_under(
    conditions: &mut Conditions,
    timed: &TimedFrameFault,
    value: f64,
    full_well_e: f64,
    false_stars: &[Source],
) {
    match timed.fault {
        FrameFault::Image(ImageFault::StrayLight { .. }) | FrameFault::Image(ImageFault::StrayLightRamp { .. }) => {
            conditions.stray_e_per_s += value
        }
        FrameFault::Camera(CameraFault::Defocus { .. }) => {
            if let Made::Optics(optics) = timed.made {
                conditions.optics = optics;
            }
        }
        FrameFault::Image(ImageFault::Contamination { .. }) => conditions.throughput *= value,
        FrameFault::Image(ImageFault::TemperatureStep { .. }) => conditions.warmer_k += value,
        FrameFault::Image(ImageFault::Saturation { .. }) => conditions.flood_e += value * full_well_e,
        FrameFault::Image(ImageFault::MissingStars { share }) => {
            conditions.missing.share = 1.0 - (1.0 - conditions.missing.share) * (1.0 - share);
            conditions.missing.stream = u32::from(timed.number);
        }
        FrameFault::Image(ImageFault::MissingBrightStars { count }) => conditions.missing.brightest += count as usize,
        FrameFault::Image(ImageFault::Protons(storm)) => conditions.protons = Some(flux(storm)),
        FrameFault::Image(ImageFault::FalseStars { .. }) => {
            let space = FALSE_STARS_MAX.saturating_sub(conditions.false_stars.len());
            conditions.false_stars.extend_from_slice(&false_stars[..false_stars.len().min(space)]);
        }
        // These faults act on the detector or on the finished frame.
        FrameFault::Sending(_)
        | FrameFault::Image(ImageFault::Blank | ImageFault::BitFlip { .. })
        | FrameFault::Camera(CameraFault::Pixels { .. }) => {}
    }
}

fn flux(storm: ProtonStorm) -> ProtonFlux {
    let direction = match storm.beam_deg {
        None => ProtonDirection::Isotropic,
        Some([incidence_deg, azimuth_deg]) => ProtonDirection::Beam { incidence_deg, azimuth_deg },
    };
    ProtonFlux { per_cm2_s: storm.per_cm2_s, energy_mev: storm.energy_mev, direction }
}

fn defect_kind(fault: PixelFault) -> DefectKind {
    match fault {
        PixelFault::Hot { e_per_s } => DefectKind::Hot { extra_e_per_s: e_per_s },
        PixelFault::Dead { response } => DefectKind::Dead { response },
        PixelFault::Rts { e_per_s, high_s, low_s } => {
            let rates = Rates { up_per_s: 1.0 / low_s, down_per_s: 1.0 / high_s };
            DefectKind::Rts { extra_e_per_s: e_per_s, rates }
        }
        PixelFault::Stuck { dn } => DefectKind::Stuck { dn },
    }
}

/// Returns the places of defects: the given ones, and random pixels.
fn defect_places(spots: DefectSpots, size: [usize; 2], stream: u32, seed: u64) -> impl Iterator<Item = DefectPlace> {
    let DefectSpots { pixels, column, row } = spots;
    let given = pixels.at.map(|[x, y]| DefectPlace::Pixel(x, y));
    let lines = column.map(DefectPlace::Column).into_iter().chain(row.map(DefectPlace::Row));
    #[allow(clippy::cast_possible_truncation, reason = "sides are below 2^16")]
    let random = (0..pixels.random).map(move |i| {
        let [a, b, ..] = philox([0, i, stream, FAULT_STREAM], key(seed));
        DefectPlace::Pixel(scaled(a, size[0]) as u32, scaled(b, size[1]) as u32)
    });
    given.into_iter().chain(lines).chain(random)
}

/// Adds the false stars of one fault: at the given places, and at random places of the detector.
fn add_false_stars(
    out: &mut Vec<Source>,
    pixels: FaultPixels,
    [mag, electrons]: [f64; 2],
    size: [usize; 2],
    stream: u32,
    seed: u64,
) {
    let given = pixels.at.map(|px| px.map(f64::from));
    // Places have a resolution of a thousandth of a pixel: a star can lie anywhere between pixel centres.
    let along = |word: u32, side: usize| scaled(word, 1000 * side) as f64 * 1e-3 - 0.5;
    let random = (0..pixels.random).map(|i| {
        let [a, b, ..] = philox([0, i, stream, FAULT_STREAM], key(seed));
        [along(a, size[0]), along(b, size[1])]
    });
    for px in given.into_iter().chain(random) {
        let id = FIRST_FALSE_STAR_ID + u32::try_from(out.len()).unwrap_or(0);
        #[allow(clippy::cast_possible_truncation, reason = "magnitudes are single precision")]
        let mag = mag as f32;
        out.push(Source { id, electrons, mag, place: SourcePlace::Pixel(px) });
    }
}

/// Sets every pixel that is read out to the black level, and removes all sources from the truth.
pub(super) fn blank(frame: &mut SentFrame) {
    let black = frame.meta.black_level_dn.round().clamp(0.0, f64::from(u16::MAX));
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
    frame.image.pixels_mut().fill(black as u16);
    frame.meta.regions.clear_outside(&mut frame.image);
    frame.truth.clear();
    frame.targets.clear();
}

/// Amount of the previous image that a frame shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Repeated {
    Nothing,
    UpperHalf,
    All,
}

/// Copies all or half of the previous image into the frame, and keeps the frame's own image for the next one.
pub(super) fn repeat(repeated: Repeated, frame: &mut SentFrame, previous: &mut Vec<u16>) {
    let pixels = frame.image.pixels_mut();
    if previous.len() != pixels.len() {
        previous.clear();
        previous.extend_from_slice(pixels);
        return;
    }
    let count = match repeated {
        Repeated::All => pixels.len(),
        Repeated::UpperHalf => pixels.len() / 2,
        Repeated::Nothing => 0,
    };
    pixels[..count].swap_with_slice(&mut previous[..count]);
    if repeated != Repeated::All {
        previous[count..].copy_from_slice(&pixels[count..]);
    }
}

/// Flips one bit of some pixels; random pixels are new in every frame.
pub(super) fn flip(bit: u8, pixels: FaultPixels, stream: u32, frame: &mut SentFrame) {
    let (number, seed) = (frame.meta.number, frame.meta.seed);
    let (width, height) = (frame.image.width(), frame.image.height());
    let mask = 1_u16.checked_shl(u32::from(bit)).unwrap_or(0);
    let given = pixels.at.map(|[x, y]| [x as usize, y as usize]);
    let random = (0..pixels.random).map(|i| {
        let [a, b, ..] = philox([number, i, stream, FAULT_STREAM], key(seed));
        [scaled(a, width), scaled(b, height)]
    });
    let out = frame.image.pixels_mut();
    for [x, y] in given.into_iter().chain(random).filter(|[x, y]| *x < width && *y < height) {
        out[y * width + x] ^= mask;
    }
    frame.meta.regions.clear_outside(&mut frame.image);
}

/// Returns a random whole number below `below`.
#[allow(clippy::cast_possible_truncation, reason = "the high half of a product is below `below`")]
pub(super) fn scaled(word: u32, below: usize) -> usize {
    ((u64::from(word) * below as u64) >> 32) as usize
}

#[cfg(test)]
#[path = "frame_faults_tests.rs"]
mod tests;
