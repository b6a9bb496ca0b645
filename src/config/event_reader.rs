//! Keys of one event -> what happens, when, and for how long.

use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use crate::event::{Action, GyroFaultKind, Pointing};
use crate::event_word::{BusKind, EventKeys, FrameKind, GyroKind, Kind, PixelKind};
use base::time::Span;
use base::units::DEG;
use frames::sink::{DefectSpots, FaultPixels, FrameFault, PixelFault, ProtonStorm};
use glam::DVec3;
use image::detector::protons::stopping_power::DOMAIN_MEV;
use link::tap::LinkFault;

/// Reads the keys of one event.
pub(super) struct Reader<'a, 'd> {
    pub(super) keys: &'a EventKeys,
    pub(super) place: usize,
    pub(super) check: &'a mut Checker<'d>,
}

impl Reader<'_, '_> {
    pub(super) fn action(&self, kind: Kind) -> Result<Action, ConfigError> {
        Ok(match kind {
            Kind::Slew => Action::Slew(self.pointing()?),
            Kind::Safe => Action::Safe,
            Kind::Resume => Action::Resume,
            Kind::Bus(kind) => Action::Bus(self.bus_fault(kind)?),
            Kind::BusBackLoss => Action::BusBack(LinkFault::Loss { share: self.share()? }),
            Kind::Frame(kind) => Action::Frame { head: self.head()?, fault: self.frame_fault(kind)? },
            Kind::Gyro(kind) => Action::Gyro(self.gyro_fault(kind)?),
            Kind::WheelFailure => {
                let missing = || self.check.invalid(&self.key("wheel"), "missing", "its number, from 0", "such as 2");
                Action::WheelFailure { wheel: self.number("wheel", self.keys.wheel)?.ok_or_else(missing)? }
            }
            Kind::TrackerOff => Action::TrackerOff { head: self.head()? },
            Kind::Trigger => Action::Trigger { number: self.trigger("number", self.keys.number)? },
        })
    }

    /// Reads a fault on the bus towards the stimulator.
    fn bus_fault(&self, kind: BusKind) -> Result<LinkFault, ConfigError> {
        Ok(match kind {
            BusKind::Loss => LinkFault::Loss { share: self.share()? },
            BusKind::Silence => LinkFault::Silence,
            BusKind::Delay => LinkFault::Delay {
                by: self.milliseconds("delay_ms", self.keys.delay_ms)?,
                jitter: self.milliseconds("jitter_ms", Some(self.keys.jitter_ms.unwrap_or(0.0)))?,
            },
            BusKind::Duplicate => LinkFault::Duplicate { share: self.share()? },
            BusKind::WrongBits => LinkFault::WrongBits { share: self.share()? },
            BusKind::Reorder => {
                LinkFault::Reorder { share: self.share()?, by: self.milliseconds("delay_ms", self.keys.delay_ms)? }
            }
            BusKind::Truncate => LinkFault::Truncate { share: self.share()? },
            BusKind::Babble => self.babble()?,
            BusKind::Off => LinkFault::Off,
            BusKind::ClockStep => {
                let advice = "milliseconds, below zero for a clock that falls behind";
                let ms = self.required("step_ms", self.keys.step_ms, Rule::Within(-60_000.0, 60_000.0), advice)?;
                LinkFault::ClockStep { by: Span::from_s(ms * 1e-3) }
            }
            BusKind::ClockDrift => {
                let advice = "parts per million, below zero for a slow clock";
                let ppm = self.required("ppm", self.keys.ppm, Rule::Within(-10_000.0, 10_000.0), advice)?;
                LinkFault::ClockDrift { ppm }
            }
        })
    }

    /// Reads a fault of the gyro.
    fn gyro_fault(&self, kind: GyroKind) -> Result<GyroFaultKind, ConfigError> {
        Ok(match kind {
            GyroKind::Dropout => GyroFaultKind::Dropout,
            GyroKind::Stuck => GyroFaultKind::Stuck,
            GyroKind::BiasJump => GyroFaultKind::BiasJump(self.rate()?),
            GyroKind::Spike => GyroFaultKind::Spike(self.rate()?),
        })
    }

    /// What happens to frames, or to the chain that images them.
    fn frame_fault(&self, kind: FrameKind) -> Result<FrameFault, ConfigError> {
        let light = "electrons per second in every pixel, such as 200000.0";
        let share = "a share of the light, 0 to 1";
        let keys = self.keys;
        Ok(match kind {
            FrameKind::Drop => FrameFault::Drop,
            FrameKind::Duplicate => FrameFault::Duplicate,
            FrameKind::Late => FrameFault::Late(self.milliseconds("late_ms", keys.late_ms)?),
            FrameKind::Torn => FrameFault::Torn,
            FrameKind::Blank => FrameFault::Blank,
            FrameKind::BitFlip => {
                let bit = self.whole("bit", keys.bit, 15, "which bit of the pixels' numbers, from 0")?;
                FrameFault::BitFlip { bit, pixels: self.pixels(1_000_000)? }
            }
            FrameKind::StrayLight => FrameFault::StrayLight {
                e_per_s: self.required("e_per_s", keys.e_per_s, Rule::PositiveUpTo(1e12), light)?,
            },
            FrameKind::StrayLightRamp => {
                let number = |name, given| self.required(name, given, Rule::Within(0.0, 1e12), light);
                let from_e_per_s = number("from_e_per_s", keys.from_e_per_s)?;
                FrameFault::StrayLightRamp { from_e_per_s, to_e_per_s: number("to_e_per_s", keys.to_e_per_s)? }
            }
            FrameKind::Defocus => {
                let advice = "sigma of the defocused, Gaussian spot, px";
                FrameFault::Defocus {
                    sigma_px: self.required("sigma_px", keys.sigma_px, Rule::Within(0.2, 12.0), advice)?,
                }
            }
            FrameKind::Contamination => {
                let number = |name, given| self.required(name, given, Rule::Within(0.0, 1.0), share);
                let from_share = number("throughput", keys.throughput)?;
                FrameFault::Contamination {
                    from_share,
                    to_share: number("to_throughput", keys.to_throughput.or(Some(from_share)))?,
                }
            }
            FrameKind::TemperatureStep => {
                let advice = "kelvin by which the detector is warmer, below zero for colder";
                FrameFault::TemperatureStep {
                    by_k: self.required("by_k", keys.by_k, Rule::Within(-100.0, 100.0), advice)?,
                }
            }
            FrameKind::Saturation => {
                let advice = "light in each exposure, full wells; 4 if left out";
                let given = keys.full_wells.or(Some(4.0));
                FrameFault::Saturation {
                    full_wells: self.required("full_wells", given, Rule::PositiveUpTo(1e3), advice)?,
                }
            }
            FrameKind::FalseStars => {
                let mag =
                    self.required("mag", keys.mag, Rule::Within(-30.0, 40.0), "magnitude in the instrument's band")?;
                FrameFault::FalseStars { pixels: self.pixels(4096)?, mag }
            }
            FrameKind::MissingStars => {
                let advice = "a share of the catalog's stars, 0 to 1";
                FrameFault::MissingStars { share: self.required("share", keys.share, Rule::Within(0.0, 1.0), advice)? }
            }
            FrameKind::MissingBrightStars => FrameFault::MissingBrightStars {
                count: self.whole("count", keys.count, 100_000, "how many of the brightest stars")?,
            },
            FrameKind::Pixels(kind) => FrameFault::Pixels { spots: self.spots()?, fault: self.pixel_fault(kind)? },
            FrameKind::ProtonStorm => FrameFault::Protons(self.storm()?),
        })
    }

    /// What is wrong with a pixel.
    fn pixel_fault(&self, kind: PixelKind) -> Result<PixelFault, ConfigError> {
        let keys = self.keys;
        let rate = |advice| self.required("e_per_s", keys.e_per_s, Rule::PositiveUpTo(1e9), advice);
        Ok(match kind {
            PixelKind::Hot => PixelFault::Hot { e_per_s: rate("electrons per second more")? },
            PixelKind::Dead => {
                let share = "a share of the light, 0 to 1";
                let response = self.required("response", keys.response.or(Some(0.0)), Rule::Within(0.0, 1.0), share)?;
                PixelFault::Dead { response }
            }
            PixelKind::Rts => {
                let e_per_s = rate("at the high level")?;
                let time = |name, given: Option<f64>| {
                    let mean = "mean seconds at this level; 1 if left out";
                    self.required(name, given.or(Some(1.0)), Rule::Within(1e-3, 1e6), mean)
                };
                PixelFault::Rts { e_per_s, high_s: time("high_s", keys.high_s)?, low_s: time("low_s", keys.low_s)? }
            }
            PixelKind::Stuck => {
                PixelFault::Stuck { dn: self.whole("dn", keys.dn, 65_535, "the digital number that they read")? }
            }
        })
    }

    /// A pixel that is given and a number of random ones; one at random when neither is said.
    fn pixels(&self, most: i64) -> Result<FaultPixels, ConfigError> {
        let along = |given| self.whole("px", Some(given), 65_535, "column and row, from 0, such as [100, 200]");
        let at = self.keys.px.map(|[x, y]| Ok([along(x)?, along(y)?])).transpose()?;
        let random = match self.keys.count {
            None => u32::from(at.is_none()),
            given => self.whole("count", given, most, "how many at random")?,
        };
        Ok(FaultPixels { at, random })
    }

    /// Places of defects; one pixel at random when none is said.
    fn spots(&self) -> Result<DefectSpots, ConfigError> {
        let line = |name, given: Option<i64>| {
            given.map(|line| self.whole(name, Some(line), 65_535, "its number, from 0")).transpose()
        };
        let (column, row) = (line("column", self.keys.column)?, line("row", self.keys.row)?);
        let pixels = self.pixels(256)?;
        let only_lines = self.keys.count.is_none() && (column.is_some() || row.is_some());
        let random = if only_lines { 0 } else { pixels.random };
        Ok(DefectSpots { pixels: FaultPixels { random, ..pixels }, column, row })
    }

    fn storm(&self) -> Result<ProtonStorm, ConfigError> {
        let keys = self.keys;
        let flux = "protons per square centimetre and second";
        let angle = "degrees: a beam from there; from all sides when neither angle is given";
        let is_beam = keys.incidence_deg.is_some() || keys.azimuth_deg.is_some();
        let (incidence, azimuth) = (keys.incidence_deg.unwrap_or(0.0), keys.azimuth_deg.unwrap_or(0.0));
        let angles = [
            self.required("incidence_deg", Some(incidence), Rule::Within(0.0, 89.9), angle)?,
            self.required("azimuth_deg", Some(azimuth), Rule::Within(-360.0, 360.0), angle)?,
        ];
        Ok(ProtonStorm {
            per_cm2_s: self.required("per_cm2_s", keys.per_cm2_s, Rule::PositiveUpTo(1e9), flux)?,
            energy_mev: self.required(
                "energy_mev",
                keys.energy_mev,
                Rule::Within(DOMAIN_MEV[0], DOMAIN_MEV[1]),
                "MeV",
            )?,
            beam_deg: is_beam.then_some(angles),
        })
    }

    fn trigger(&self, name: &str, given: Option<i64>) -> Result<u16, ConfigError> {
        self.whole(name, given, 65_535, "the number of a trigger, such as 1")
    }

    /// When it happens: `at_s`, `at_frame`, or after a trigger; frames are `frame_period` apart.
    pub(super) fn begin(&self, kind: Kind, frame_period: Span) -> Result<(Span, Option<u16>), ConfigError> {
        let after = "seconds after the first exposure";
        let EventKeys { at_s, at_frame, on_trigger, .. } = *self.keys;
        if on_trigger.is_some() {
            let trigger = self.trigger("on_trigger", on_trigger)?;
            self.check.unused(&self.key("at_frame"), at_frame.is_some(), "events without on_trigger")?;
            if !kind.is_of_frames() {
                let wanted = "no on_trigger here";
                let advice = "faults of frames and of imaging wait for triggers; give at_s or at_frame";
                return Err(self.check.invalid(&self.key("on_trigger"), "given", wanted, advice));
            }
            let delay = "seconds after the trigger; at once if left out";
            let at_s = self.required("at_s", at_s.or(Some(0.0)), Rule::NotNegative, delay)?;
            return Ok((Span::from_s(at_s), Some(trigger)));
        }
        let Some(frame) = at_frame else {
            return Ok((Span::from_s(self.required("at_s", at_s, Rule::NotNegative, after)?), None));
        };
        self.check.unused(&self.key("at_s"), at_s.is_some(), "events without at_frame")?;
        let frame: u32 = self.whole("at_frame", Some(frame), 1_000_000_000, "the first frame that it hits, from 0")?;
        // Just after the exposure's begin: the frame before has ended by then, however long it is exposed.
        Ok((Span::from_ns(frame_period.ns() * i64::from(frame) + 1), None))
    }

    /// How long it lasts: `for_s`, or `for_frames`.
    pub(super) fn lasts(&self, frame_period: Span) -> Result<Span, ConfigError> {
        let Some(frames) = self.keys.for_frames else {
            let for_s = self.required("for_s", self.keys.for_s, Rule::Positive, "how many seconds it lasts")?;
            return Ok(Span::from_s(for_s));
        };
        self.check.unused(&self.key("for_s"), self.keys.for_s.is_some(), "events without for_frames")?;
        let frames: u32 = self.whole("for_frames", Some(frames.max(-1)), 1_000_000_000, "how many frames it hits")?;
        if frames == 0 {
            return Err(self.check.invalid(&self.key("for_frames"), 0, "1 or more", "it would hit nothing"));
        }
        Ok(Span::from_ns(frame_period.ns() * i64::from(frames)))
    }

    fn key(&self, name: &str) -> String {
        format!("event[{}].{name}", self.place)
    }

    fn required(&self, name: &str, given: Option<f64>, rule: Rule, advice: &str) -> Result<f64, ConfigError> {
        self.check.required(&self.key(name), given, rule, advice)
    }

    fn babble(&self) -> Result<LinkFault, ConfigError> {
        let advice = "milliseconds from one packet to the next, such as 0.5";
        let period_ms = self.required("period_ms", self.keys.period_ms, Rule::Within(0.05, 60_000.0), advice)?;
        let id =
            self.whole("can_id", self.keys.can_id, 0x7FF, "an identifier of 11 bits, such as 0x123; no use on serial")?;
        let bytes = self.whole("bytes", Some(self.keys.bytes.unwrap_or(8)), 64, "bytes of content, 8 if left out")?;
        Ok(LinkFault::Babble { id, period: Span::from_s(period_ms * 1e-3), bytes })
    }

    fn whole<N: TryFrom<i64>>(
        &self,
        name: &str,
        given: Option<i64>,
        most: i64,
        advice: &str,
    ) -> Result<N, ConfigError> {
        let got = given.map_or_else(|| "missing".into(), |number| number.to_string());
        let fits = given.filter(|number| (0..=most).contains(number)).and_then(|number| N::try_from(number).ok());
        fits.ok_or_else(|| self.check.invalid(&self.key(name), got, format!("a whole number from 0 to {most}"), advice))
    }

    fn share(&self) -> Result<f64, ConfigError> {
        self.required("share", self.keys.share, Rule::Within(0.0, 1.0), "a share of the packets, 0 to 1")
    }

    fn milliseconds(&self, name: &str, given: Option<f64>) -> Result<Span, ConfigError> {
        let ms = self.required(name, given, Rule::Within(0.0, 60_000.0), "milliseconds")?;
        Ok(Span::from_s(ms * 1e-3))
    }

    fn rate(&self) -> Result<DVec3, ConfigError> {
        let advice = "degrees per hour about the body axes, such as [5.0, 0.0, 0.0]";
        let missing = || self.check.invalid(&self.key("rate_deg_h"), "missing", "three finite numbers", advice);
        let rate_deg_h = self.keys.rate_deg_h.ok_or_else(missing)?;
        for component in rate_deg_h {
            self.check.meets(&self.key("rate_deg_h"), component, Rule::Within(-1e6, 1e6), advice)?;
        }
        Ok(DVec3::from_array(rate_deg_h) * (DEG / 3600.0))
    }

    /// Which head the event is about; `None`: all.
    fn head(&self) -> Result<Option<usize>, ConfigError> {
        self.number("head", self.keys.head)
    }

    fn number(&self, name: &str, given: Option<i64>) -> Result<Option<usize>, ConfigError> {
        let Some(number) = given else { return Ok(None) };
        let refuse = || self.check.invalid(&self.key(name), number, "a number from 0 to 15", "counted from 0");
        usize::try_from(number).ok().filter(|number| *number < 16).map(Some).ok_or_else(refuse)
    }

    fn pointing(&self) -> Result<Pointing, ConfigError> {
        let key = |name: &str| self.key(name);
        Pointing::check([self.keys.ra_deg, self.keys.dec_deg, self.keys.roll_deg], key, self.check)
    }
}
