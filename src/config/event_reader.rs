//! Keys of one event -> what happens, when, and for how long.

use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use crate::event::{Action, GyroFaultKind, Pointing};
use crate::event_word::{BusKind, EventKeys, FrameKind, GyroKind, Kind, PixelKind};
use crate::key::{Section, taken};
use base::time::Span;
use base::units::DEG;
use frames::sink::{DefectSpots, FaultPixels, FrameFault, PixelFault, ProtonStorm};
use glam::DVec3;
use link::tap::LinkFault;

/// Reads the keys of one event.
pub(super) struct Reader<'a, 'd> {
    pub(super) keys: &'a EventKeys,
    pub(super) check: &'a mut Checker<'d>,
}

impl Reader<'_, '_> {
    pub(super) fn action(&mut self, kind: Kind) -> Result<Action, ConfigError> {
        let keys = self.keys;
        Ok(match kind {
            Kind::Slew => Action::Slew(Pointing::check([keys.ra_deg(), keys.dec_deg(), keys.roll_deg()], self.check)?),
            Kind::Safe => Action::Safe,
            Kind::Resume => Action::Resume,
            Kind::Bus(kind) => Action::Bus(self.bus_fault(kind)?),
            Kind::BusBackLoss => Action::BusBack(LinkFault::Loss { share: keys.share().check(self.check)? }),
            Kind::Frame(kind) => Action::Frame { head: self.head()?, fault: self.frame_fault(kind)? },
            Kind::Gyro(kind) => Action::Gyro(self.gyro_fault(kind)?),
            Kind::WheelFailure => {
                let missing = || keys.wheel().advised("such as 2").missing("its number, from 0", self.check);
                Action::WheelFailure { wheel: keys.wheel().optional(self.check)?.ok_or_else(missing)? }
            }
            Kind::TrackerOff => Action::TrackerOff { head: self.head()? },
            Kind::Trigger => Action::Trigger {
                number: keys.number().advised("the number of a trigger, such as 1").check(self.check)?,
            },
        })
    }

    /// Reads a fault on the bus towards the stimulator.
    fn bus_fault(&mut self, kind: BusKind) -> Result<LinkFault, ConfigError> {
        let keys = self.keys;
        let share = |check: &mut _| keys.share().check(check);
        Ok(match kind {
            BusKind::Loss => LinkFault::Loss { share: share(self.check)? },
            BusKind::Silence => LinkFault::Silence,
            BusKind::Delay => {
                LinkFault::Delay { by: keys.delay_ms().ms(self.check)?, jitter: keys.jitter_ms().ms(self.check)? }
            }
            BusKind::Duplicate => LinkFault::Duplicate { share: share(self.check)? },
            BusKind::WrongBits => LinkFault::WrongBits { share: share(self.check)? },
            BusKind::Reorder => LinkFault::Reorder { share: share(self.check)?, by: keys.delay_ms().ms(self.check)? },
            BusKind::Truncate => LinkFault::Truncate { share: share(self.check)? },
            BusKind::Babble => {
                let period = keys.period_ms().ms(self.check)?;
                LinkFault::Babble {
                    id: keys.can_id().check(self.check)?,
                    period,
                    bytes: keys.bytes().check(self.check)?,
                }
            }
            BusKind::Off => LinkFault::Off,
            BusKind::ClockStep => LinkFault::ClockStep { by: keys.step_ms().ms(self.check)? },
            BusKind::ClockDrift => LinkFault::ClockDrift { ppm: keys.ppm().check(self.check)? },
        })
    }

    /// Reads a fault of the gyro.
    fn gyro_fault(&mut self, kind: GyroKind) -> Result<GyroFaultKind, ConfigError> {
        let keys = self.keys;
        let mut rate = || keys.rate_deg_h().check(self.check).map(|rate| DVec3::from_array(rate) * (DEG / 3600.0));
        Ok(match kind {
            GyroKind::Dropout => GyroFaultKind::Dropout,
            GyroKind::Stuck => GyroFaultKind::Stuck,
            GyroKind::BiasJump => GyroFaultKind::BiasJump(rate()?),
            GyroKind::Spike => GyroFaultKind::Spike(rate()?),
        })
    }

    /// What happens to frames, or to the chain that images them.
    fn frame_fault(&mut self, kind: FrameKind) -> Result<FrameFault, ConfigError> {
        let keys = self.keys;
        Ok(match kind {
            FrameKind::Drop => FrameFault::Drop,
            FrameKind::Duplicate => FrameFault::Duplicate,
            FrameKind::Late => FrameFault::Late(keys.late_ms().ms(self.check)?),
            FrameKind::Torn => FrameFault::Torn,
            FrameKind::Blank => FrameFault::Blank,
            FrameKind::BitFlip => {
                FrameFault::BitFlip { bit: keys.bit().check(self.check)?, pixels: self.pixels(1_000_000)? }
            }
            FrameKind::StrayLight => FrameFault::StrayLight { e_per_s: keys.e_per_s().check(self.check)? },
            FrameKind::StrayLightRamp => {
                let from_e_per_s = keys.from_e_per_s().check(self.check)?;
                FrameFault::StrayLightRamp { from_e_per_s, to_e_per_s: keys.to_e_per_s().check(self.check)? }
            }
            FrameKind::Defocus => FrameFault::Defocus { sigma_px: keys.sigma_px().check(self.check)? },
            FrameKind::Contamination => {
                let from_share = keys.throughput().check(self.check)?;
                let to_share = keys.to_throughput().or_silently(from_share).check(self.check)?;
                FrameFault::Contamination { from_share, to_share }
            }
            FrameKind::TemperatureStep => FrameFault::TemperatureStep { by_k: keys.by_k().check(self.check)? },
            FrameKind::Saturation => FrameFault::Saturation { full_wells: keys.full_wells().check(self.check)? },
            FrameKind::FalseStars => {
                let mag = keys.mag().check(self.check)?;
                FrameFault::FalseStars { pixels: self.pixels(4096)?, mag }
            }
            FrameKind::MissingStars => {
                let share = keys.share().advised("a share of the catalog's stars, 0 to 1");
                FrameFault::MissingStars { share: share.check(self.check)? }
            }
            FrameKind::MissingBrightStars => {
                let count = keys.count().within(0..=100_000).advised("how many of the brightest stars");
                FrameFault::MissingBrightStars { count: count.check(self.check)? }
            }
            FrameKind::Pixels(kind) => FrameFault::Pixels { spots: self.spots()?, fault: self.pixel_fault(kind)? },
            FrameKind::ProtonStorm => FrameFault::Protons(self.storm()?),
        })
    }

    /// What is wrong with a pixel.
    fn pixel_fault(&mut self, kind: PixelKind) -> Result<PixelFault, ConfigError> {
        let (keys, check) = (self.keys, &mut *self.check);
        let rate = |advice: &'static str| keys.e_per_s().within(Rule::PositiveUpTo(1e9)).advised(advice);
        Ok(match kind {
            PixelKind::Hot => PixelFault::Hot { e_per_s: rate("electrons per second more").check(check)? },
            PixelKind::Dead => PixelFault::Dead { response: keys.response().check(check)? },
            PixelKind::Rts => {
                let e_per_s = rate("at the high level").check(check)?;
                PixelFault::Rts { e_per_s, high_s: keys.high_s().check(check)?, low_s: keys.low_s().check(check)? }
            }
            PixelKind::Stuck => PixelFault::Stuck { dn: keys.dn().check(check)? },
        })
    }

    /// A pixel that is given and a number of random ones; one at random when neither is said.
    fn pixels(&self, most: i64) -> Result<FaultPixels, ConfigError> {
        let px = self.keys.px();
        let along = |given: i64| {
            let fits = u32::try_from(given).ok().filter(|given| *given <= 65_535);
            fits.ok_or_else(|| px.invalid(given, "a whole number from 0 to 65535", self.check))
        };
        let at = px.raw().map(|[x, y]| Ok([along(*x)?, along(*y)?])).transpose()?;
        let random = self.keys.count().within(0..=most).optional(self.check)?;
        Ok(FaultPixels { at, random: random.unwrap_or(u32::from(at.is_none())) })
    }

    /// Places of defects; one pixel at random when none is said.
    fn spots(&self) -> Result<DefectSpots, ConfigError> {
        let column = self.keys.column().optional(self.check)?;
        let row = self.keys.row().optional(self.check)?;
        let pixels = self.pixels(256)?;
        let only_lines = !self.keys.count().is_given() && (column.is_some() || row.is_some());
        let random = if only_lines { 0 } else { pixels.random };
        Ok(DefectSpots { pixels: FaultPixels { random, ..pixels }, column, row })
    }

    fn storm(&mut self) -> Result<ProtonStorm, ConfigError> {
        let keys = self.keys;
        let is_beam = keys.incidence_deg().is_given() || keys.azimuth_deg().is_given();
        taken!(self.check, keys => incidence_deg, azimuth_deg, per_cm2_s, energy_mev);
        Ok(ProtonStorm { per_cm2_s, energy_mev, beam_deg: is_beam.then_some([incidence_deg, azimuth_deg]) })
    }

    /// When it happens: `at_s`, `at_frame`, or after a trigger; frames are `frame_period` apart.
    pub(super) fn begin(&mut self, kind: Kind, frame_period: Span) -> Result<(Span, Option<u16>), ConfigError> {
        let keys = self.keys;
        if let Some(trigger) = keys.on_trigger().optional(self.check)? {
            keys.refuse(&["at_frame"], "events without on_trigger", self.check)?;
            if !kind.is_of_frames() {
                let advice = "faults of frames and of imaging wait for triggers; give at_s or at_frame";
                return Err(keys.on_trigger().advised(advice).invalid("given", "no on_trigger here", self.check));
            }
            let delay = keys.at_s().or_silently(0.0).advised("seconds after the trigger; at once if left out");
            return Ok((Span::from_s(delay.check(self.check)?), Some(trigger)));
        }
        if !keys.at_frame().is_given() {
            return Ok((Span::from_s(keys.at_s().check(self.check)?), None));
        }
        keys.refuse(&["at_s"], "events without at_frame", self.check)?;
        let frame = keys.at_frame().check(self.check)?;
        // Just after the exposure's begin: the frame before has ended by then, however long it is exposed.
        Ok((Span::from_ns(frame_period.ns() * i64::from(frame) + 1), None))
    }

    /// How long it lasts: `for_s`, or `for_frames`.
    pub(super) fn lasts(&mut self, frame_period: Span) -> Result<Span, ConfigError> {
        let keys = self.keys;
        if !keys.for_frames().is_given() {
            return Ok(Span::from_s(keys.for_s().check(self.check)?));
        }
        keys.refuse(&["for_s"], "events without for_frames", self.check)?;
        let frames = keys.for_frames().check(self.check)?;
        Ok(Span::from_ns(frame_period.ns() * i64::from(frames)))
    }

    /// Which head the event is about; `None`: all.
    fn head(&self) -> Result<Option<usize>, ConfigError> {
        self.keys.head().optional(self.check)
    }
}
