//! The words of `[[event]]`: its keys, a row for every word, and the flags of faults of the bus.
//!
//! Old files stay readable: words and keys are added, not renamed. A row has the timing of a word, its keys, and the
//! action that they make.
//!
//! ```text
//! "bus_delay" Lasts (delay_ms) [jitter_ms] => Bus(LinkFault::Delay { by: delay_ms, jitter: jitter_ms });
//! ```
//!
//! the word, its [`Timing`], the keys that it needs, those that may be left out, and the variant of [`Action`](crate::event::Action).
//! The variant is an expression when a file is read and a pattern when an event is named or written, so that one row does
//! all three, and an action without a row does not compile. A key may have bounds of its own (`share.advised(..)`).
//! Several keys may make one value: `pixels(4096) of (px, count)` is read by `Reader::pixels`. How values are written:
//! `event_reader`.

use crate::event::{Action, Pointing};
use crate::event_reader::{Identifier, Reader};
use crate::key_type::{Raw, Shape, Whole, Word};
use crate::{check::Rule::PositiveUpTo, error::Result, key::section};
use frames::sink::FrameFault::{Camera, Image, Sending};
use frames::sink::{CameraFault, FaultFlags, ImageFault, PixelFault, ProtonStorm, SendingFault};
use image::detector::protons::stopping_power::DOMAIN_MEV;
use link::tap::LinkFault;
use testbed::vehicle::VehicleFault;

/// When an event happens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Timing {
    /// At an instant.
    Once,
    /// From an instant for a time.
    Lasts,
    /// The same, or after a trigger.
    Waits,
}

/// Everything about a word except its name.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    pub(super) timing: Timing,
    /// Keys by the value that they make.
    pub(super) needed: &'static [&'static [&'static str]],
    pub(super) optional: &'static [&'static [&'static str]],
    pub(super) read: fn(&mut Reader<'_, '_>) -> Result<Action>,
}

impl Row {
    /// Returns the keys that go with it beside those of all: those it needs, and those that may be left out.
    pub(super) fn keys(&self) -> [Vec<&'static str>; 2] {
        let length = self.lasts().then_some("for_s");
        [length.into_iter().chain(self.needed.concat()).collect(), self.optional.concat()]
    }

    pub(super) fn has_key(&self, name: &str) -> bool {
        self.keys().concat().contains(&name)
    }

    pub(super) fn lasts(&self) -> bool {
        self.timing != Timing::Once
    }
}

/// Returns the words whose row is wanted, each in quotes.
pub(super) fn words(is_wanted: impl Fn(&Row) -> bool) -> String {
    let wanted = ACTIONS.iter().filter(|(_, row)| is_wanted(row));
    wanted.map(|(word, _)| format!("\"{word}\"")).collect::<Vec<_>>().join(", ")
}

/// The words: see the top of this file.
macro_rules! rows {
    ($(
        $word:literal $timing:ident
        ($(
            $needed:ident
            $(($($need:expr),*) of ($($needed_key:ident),+))?
            $(. $need_method:ident ($($need_bound:expr),*))*
        ),*)
        [$(
            $optional:ident
            $(($($option:expr),*) of ($($optional_key:ident),+))?
            $(. $option_method:ident ($($option_bound:expr),*))*
        ),*]
        => $variant:ident $value:tt;
    )+) => {
        /// Every word for `do` with its row.
        pub(super) const ACTIONS: &[(&str, Row)] = &[$((
            $word,
            Row {
                timing: Timing::$timing,
                needed: &[$(keys_of!($needed $(($($needed_key),+))?)),*],
                optional: &[$(keys_of!($optional $(($($optional_key),+))?)),*],
                read: |reader| {
                    let _ = &reader;
                    $( let $needed = read!(
                        reader, $needed $(($($need),*))? $(. $need_method ($($need_bound),*))*
                    ); )*
                    $( let $optional = read!(
                        reader, $optional $(($($option),*))? $(. $option_method ($($option_bound),*))*
                    ); )*
                    Ok(Action::$variant $value)
                },
            },
        )),+];

        impl Action {
            /// Returns its word for `do` in `[[event]]`, which events and reports name it by.
            #[allow(unused_variables, reason = "a row's pattern binds what `keys` writes")]
            pub fn word(&self) -> &'static str {
                match *self {
                    $( Self::$variant $value => $word, )+
                }
            }

            /// Returns the keys that make it again, with their values.
            pub(super) fn keys(&self) -> $crate::event_reader::Keys {
                use $crate::event_reader::Written;
                let mut keys = Vec::new();
                match *self {
                    $( Self::$variant $value => {
                        $( $needed.write(stringify!($needed), &mut keys); )*
                        $( $optional.write(stringify!($optional), &mut keys); )*
                    } )+
                }
                keys
            }
        }
    };
}

/// The names of the keys of one value.
macro_rules! keys_of {
    ($key:ident) => { &[stringify!($key)] };
    ($value:ident ($($key:ident),+)) => { &[$(stringify!($key)),+] };
}

/// The value of one key, or of several.
macro_rules! read {
    ($reader:ident, $key:ident $(. $method:ident ($($bound:expr),*))*) => {
        $crate::event_reader::Taken::taken($reader.keys.$key() $(. $method($($bound),*))*, $reader.check)?
    };
    ($reader:ident, $value:ident ($($bound:expr),*)) => { $reader.$value($($bound),*)? };
}

section! {
    /// A command to the flight computer, or a fault, at its time.
    EventKeys at "event" {
        /// The command or fault.
        r#do: Word<Row> = Needed, ACTIONS;
        /// Seconds after the first exposure; after the trigger, when it waits for one.
        at_s: f64 = Optional, NotNegative;
        /// The first frame of the first head that it hits, from 0, in place of at_s.
        at_frame: Whole = Optional, 0..=1_000_000_000;
        /// The number of a trigger that it waits for, such as 1.
        on_trigger: Whole<u16> = Optional, 0..=65_535;
        /// How many seconds it lasts.
        for_s: f64 = Optional, Positive;
        /// How many frames of the first head it hits, in place of for_s.
        for_frames: Whole = Optional, 1..=1_000_000_000;
        /// Right ascension of the boresight to slew to, in degrees, not hours: 5h 30m is 82.5.
        ra_deg: f64 = Optional, Within(-360.0, 360.0);
        /// Declination of the boresight to slew to, degrees.
        dec_deg: f64 = Optional, Within(-90.0, 90.0);
        /// Position angle of the image's up direction after a slew, east of north, degrees.
        roll_deg: f64 = Silent(0.0), Within(-360.0, 360.0);
        /// A share of the packets, of missing_stars a share of the catalog's stars, 0 to 1.
        share: f64 = Optional, Within(0.0, 1.0);
        /// Milliseconds by which packets are late.
        delay_ms: f64 = Optional, Within(0.0, MOST_MS);
        /// Random part of the delay, milliseconds.
        jitter_ms: f64 = Silent(0.0), Within(0.0, MOST_MS);
        /// An identifier of 11 bits, such as 0x123, or of 29, as a text of 8 digits such as "18FF0123"; no use on serial.
        can_id: Raw<Identifier> = Optional, Identifier::shape();
        /// Milliseconds from one packet to the next, such as 0.5.
        period_ms: f64 = Optional, Within(0.05, MOST_MS);
        /// Bytes of content, 8 if left out.
        bytes: Whole<u8> = Silent(8), 0..=64;
        /// Milliseconds by which a clock steps, below zero for a clock that falls behind.
        step_ms: f64 = Optional, Within(-MOST_MS, MOST_MS);
        /// Parts per million, below zero for a slow clock.
        ppm: f64 = Optional, Within(-10_000.0, 10_000.0);
        /// Milliseconds by which frames are late.
        late_ms: f64 = Optional, Within(0.0, MOST_MS);
        /// Electrons per second in every pixel, such as 200000.0; of a hot or blinking pixel what it has more.
        e_per_s: f64 = Optional, PositiveUpTo(1e12);
        /// Degrees per hour about the body axes, such as [5.0, 0.0, 0.0].
        rate_deg_h: [f64; 3] = Optional, Within(-1e6, 1e6);
        /// Which head, counted from 0; left out: all.
        head: Whole<usize> = Optional, 0..=15;
        /// Which wheel, counted from 0.
        wheel: Whole<usize> = Optional, 0..=15;
        /// The number of a trigger, such as 1.
        number: Whole<u16> = Optional, 0..=65_535;
        /// Which bit of the pixels' numbers, from 0.
        bit: Whole<u8> = Optional, 0..=15;
        /// Column and row, from 0, such as [100, 200].
        px: Raw<[i64; 2]> = Optional, Shape::Row(2, Box::new(Shape::Whole(0..=65_535)));
        /// How many at random, of missing_bright_stars how many of the brightest.
        count: Whole = Optional, 0..=1_000_000;
        /// Electrons per second in every pixel at the start of a ramp, such as 200000.0.
        from_e_per_s: f64 = Optional, Within(0.0, 1e12);
        /// Electrons per second in every pixel at the end of a ramp, such as 200000.0.
        to_e_per_s: f64 = Optional, Within(0.0, 1e12);
        /// Sigma of the defocused, Gaussian spot, px.
        sigma_px: f64 = Optional, Within(0.2, 12.0);
        /// A share of the light, 0 to 1.
        throughput: f64 = Optional, Within(0.0, 1.0);
        /// The share of the light at the end of the event, 0 to 1; left out: as at the start.
        to_throughput: f64 = Computed("throughput"), Within(0.0, 1.0);
        /// Kelvin by which the detector is warmer, below zero for colder.
        by_k: f64 = Optional, Within(-100.0, 100.0);
        /// Light in each exposure, full wells; 4 if left out.
        full_wells: f64 = Silent(4.0), PositiveUpTo(1e3);
        /// Magnitude in the instrument's band.
        mag: f64 = Optional, Within(-30.0, 40.0);
        /// Number of a column, from 0.
        column: Whole = Optional, 0..=65_535;
        /// Number of a row, from 0.
        row: Whole = Optional, 0..=65_535;
        /// A share of the light, 0 to 1, that a dead pixel still counts.
        response: f64 = Silent(0.0), Within(0.0, 1.0);
        /// Mean seconds at the high level; 1 if left out.
        high_s: f64 = Silent(1.0), Within(1e-3, 1e6);
        /// Mean seconds at the low level; 1 if left out.
        low_s: f64 = Silent(1.0), Within(1e-3, 1e6);
        /// The digital number that stuck pixels read.
        dn: Whole<u16> = Optional, 0..=65_535;
        /// Protons per square centimetre and second.
        per_cm2_s: f64 = Optional, PositiveUpTo(1e9);
        /// Energy of the protons in MeV.
        energy_mev: f64 = Optional, Within(DOMAIN_MEV[0], DOMAIN_MEV[1]);
        /// Angle from the detector's normal.
        incidence_deg: f64 = Silent(0.0), Within(0.0, 89.9), BEAM;
        /// Angle on the image from +x.
        azimuth_deg: f64 = Silent(0.0), Within(-360.0, 360.0), BEAM;
    }
}

const MOST_MS: f64 = 60_000.0;
const BEAM: &str = "degrees: a beam from there; from all sides when neither angle is given";

/// Keys that go with every word, as far as it lasts.
pub(super) const OF_ALL: [&str; 5] = ["do", "at_s", "at_frame", "on_trigger", "for_frames"];

impl EventKeys {
    /// Returns the same, now when it says no other time.
    pub(super) fn begun_by(mut self, now_s: f64) -> Self {
        if self.at_frame.is_none() && self.on_trigger.is_none() {
            self.at_s.get_or_insert(now_s);
        }
        self
    }
}

rows! {
    "slew" Once (ra_deg, dec_deg) [roll_deg] => Slew(Pointing { ra_deg, dec_deg, roll_deg });
    "safe" Once () [] => Safe {};
    "resume" Once () [] => Resume {};
    "bus_loss" Lasts (share) [] => Bus(LinkFault::Loss { share });
    "bus_silence" Lasts () [] => Bus(LinkFault::Silence);
    "bus_delay" Lasts (delay_ms) [jitter_ms] => Bus(LinkFault::Delay { by: delay_ms, jitter: jitter_ms });
    "bus_duplicate" Lasts (share) [] => Bus(LinkFault::Duplicate { share });
    "bus_wrong_bits" Lasts (share) [] => Bus(LinkFault::WrongBits { share });
    "bus_reorder" Lasts (share, delay_ms) [] => Bus(LinkFault::Reorder { share, by: delay_ms });
    "bus_truncate" Lasts (share) [] => Bus(LinkFault::Truncate { share });
    "bus_babble" Lasts (can_id, period_ms) [bytes] => Bus(LinkFault::Babble { id: can_id, period: period_ms, bytes });
    "bus_off" Lasts () [] => Bus(LinkFault::Off);
    "clock_step" Lasts (step_ms) [] => Bus(LinkFault::ClockStep { by: step_ms });
    "clock_drift" Lasts (ppm) [] => Bus(LinkFault::ClockDrift { ppm });
    "bus_back_loss" Lasts (share) [] => BusBackLoss { share };
    "frame_drop" Waits () [head] => Frame { head, fault: Sending(SendingFault::Drop) };
    "frame_duplicate" Waits () [head] => Frame { head, fault: Sending(SendingFault::Duplicate) };
    "frame_late" Waits (late_ms) [head] => Frame { head, fault: Sending(SendingFault::Late(late_ms)) };
    "frame_torn" Waits () [head] => Frame { head, fault: Sending(SendingFault::Torn) };
    "frame_blank" Waits () [head] => Frame { head, fault: Image(ImageFault::Blank) };
    "frame_bit_flip" Waits (bit) [pixels(1_000_000) of (px, count), head]
        => Frame { head, fault: Image(ImageFault::BitFlip { bit, pixels }) };
    "stray_light" Waits (e_per_s) [head] => Frame { head, fault: Image(ImageFault::StrayLight { e_per_s }) };
    "stray_light_ramp" Waits (from_e_per_s, to_e_per_s) [head]
        => Frame { head, fault: Image(ImageFault::StrayLightRamp { from_e_per_s, to_e_per_s }) };
    "defocus_step" Waits (sigma_px) [head] => Frame { head, fault: Camera(CameraFault::Defocus { sigma_px }) };
    "contamination" Waits (throughput) [to_throughput.or_silently(throughput), head]
        => Frame { head, fault: Image(ImageFault::Contamination { from_share: throughput, to_share: to_throughput }) };
    "temperature_step" Waits (by_k) [head] => Frame { head, fault: Image(ImageFault::TemperatureStep { by_k }) };
    "saturation" Waits () [full_wells, head] => Frame { head, fault: Image(ImageFault::Saturation { full_wells }) };
    "false_stars" Waits (mag) [pixels(4096) of (px, count), head]
        => Frame { head, fault: Image(ImageFault::FalseStars { pixels, mag }) };
    "missing_stars" Waits (share.advised("a share of the catalog's stars, 0 to 1")) [head]
        => Frame { head, fault: Image(ImageFault::MissingStars { share }) };
    "missing_bright_stars" Waits (count.within(0..=100_000).advised("how many of the brightest stars")) [head]
        => Frame { head, fault: Image(ImageFault::MissingBrightStars { count }) };
    "hot_pixels" Waits (e_per_s.within(PositiveUpTo(1e9)).advised("electrons per second more"))
        [spots() of (px, column, row, count), head]
        => Frame { head, fault: Camera(CameraFault::Pixels { spots, fault: PixelFault::Hot { e_per_s } }) };
    "dead_pixels" Waits () [response, spots() of (px, column, row, count), head]
        => Frame { head, fault: Camera(CameraFault::Pixels { spots, fault: PixelFault::Dead { response } }) };
    "rts_pixels" Waits (e_per_s.within(PositiveUpTo(1e9)).advised("at the high level"))
        [high_s, low_s, spots() of (px, column, row, count), head]
        => Frame {
            head,
            fault: Camera(CameraFault::Pixels { spots, fault: PixelFault::Rts { e_per_s, high_s, low_s } }),
        };
    "stuck_pixels" Waits (dn) [spots() of (px, column, row, count), head]
        => Frame { head, fault: Camera(CameraFault::Pixels { spots, fault: PixelFault::Stuck { dn } }) };
    "proton_storm" Waits (per_cm2_s, energy_mev) [beam_deg() of (incidence_deg, azimuth_deg), head]
        => Frame { head, fault: Image(ImageFault::Protons(ProtonStorm { per_cm2_s, energy_mev, beam_deg })) };
    "gyro_dropout" Lasts () [] => Aboard(VehicleFault::GyroDropout);
    "gyro_stuck" Lasts () [] => Aboard(VehicleFault::GyroStuck);
    "gyro_bias_jump" Once (rate_deg_h) [] => Aboard(VehicleFault::GyroBiasJump(rate_deg_h));
    "gyro_spike" Lasts (rate_deg_h) [] => Aboard(VehicleFault::GyroSpike(rate_deg_h));
    "wheel_failure" Once (wheel() of (wheel)) [] => Aboard(VehicleFault::WheelFailure(wheel));
    "tracker_off" Lasts () [head] => Aboard(VehicleFault::TrackerOff(head));
    "trigger" Once (number.advised("the number of a trigger, such as 1")) [] => Trigger { number };
}

/// Returns the flag of frames that are exposed while the bus towards the stimulator has this fault.
pub fn link_flag(fault: &LinkFault) -> FaultFlags {
    match fault {
        LinkFault::Loss { .. } => FaultFlags::LINK_DROP,
        LinkFault::Silence => FaultFlags::LINK_STALE,
        LinkFault::Delay { .. } => FaultFlags::LINK_DELAY,
        LinkFault::Duplicate { .. } => FaultFlags::LINK_DUPLICATE,
        LinkFault::WrongBits { .. } | LinkFault::Truncate { .. } => FaultFlags::LINK_CORRUPT,
        LinkFault::Reorder { .. } => FaultFlags::LINK_REORDER,
        LinkFault::Babble { .. } => FaultFlags::LINK_BABBLE,
        LinkFault::Off => FaultFlags::LINK_OFF,
        LinkFault::ClockStep { .. } => FaultFlags::CLOCK_STEP,
        LinkFault::ClockDrift { .. } => FaultFlags::CLOCK_DRIFT,
    }
}
