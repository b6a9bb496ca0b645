//! The simulated far end: an oscillator, and a link that delays its marks.

use base::random::{key, philox};
use base::time::{Span, Tai};
use firmware_protocol::message::Scet;
use plan::attitude::RemoteClockLimits;

const BOOT_NS: i64 = 1_800_000_000_000_000_000;
/// The link's delay when nothing queues.
pub(super) const CONSTANT_DELAY: Span = Span::from_ns(300_000);
const DRIFT_NS_PER_S: f64 = 20_000.0;

/// Uniform, exponential and normal numbers from a counter.
pub(super) struct Dice {
    seed: u64,
    drawn: u32,
}

/// How marks are delayed beyond the constant delay.
#[derive(Clone, Copy)]
pub(super) struct Link {
    pub floor_ns: f64,
    pub late_share: f64,
    pub very_late_share: f64,
}

/// Oscillator and link. The remote clock reads true elapsed time and `ahead_ns` more.
pub(super) struct Bench {
    pub dice: Dice,
    link: Link,
    elapsed_s: f64,
    ahead_ns: f64,
    rate_ns_per_s: f64,
    walk: f64,
    /// Steady change of the rate.
    pub ramp_ns_per_s2: f64,
    /// Steps of the remote clock so far.
    pub stepped_ns: i64,
    /// Steps of the local clock so far.
    pub local_stepped_ns: i64,
    /// More delay than calibrated.
    pub slower: Span,
}

impl Dice {
    pub(super) fn new(seed: u64) -> Self {
        Self { seed, drawn: 0 }
    }

    pub(super) fn uniform(&mut self) -> f64 {
        self.drawn += 1;
        (f64::from(philox([self.drawn, 0, 0, 0], key(self.seed))[0]) + 0.5) / 4_294_967_296.0
    }

    pub(super) fn exponential(&mut self, mean: f64) -> f64 {
        -mean * self.uniform().ln()
    }

    pub(super) fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (core::f64::consts::TAU * self.uniform()).cos()
    }
}

impl Link {
    pub(super) const USUAL: Self = Self { floor_ns: 20_000.0, late_share: 0.1, very_late_share: 0.002 };

    fn queueing_ns(&self, dice: &mut Dice) -> f64 {
        let (floor, chance, size) = (dice.exponential(self.floor_ns), dice.uniform(), dice.uniform());
        if chance < self.very_late_share {
            floor + 50e6
        } else if chance < self.very_late_share + self.late_share {
            floor + 5e6 * size
        } else {
            floor
        }
    }
}

impl Bench {
    pub(super) fn new(seed: u64, allan_1s: f64, link: Link) -> Self {
        Self {
            dice: Dice::new(seed),
            link,
            elapsed_s: 0.0,
            ahead_ns: 0.0,
            rate_ns_per_s: DRIFT_NS_PER_S,
            // A random walk of the rate with q (ns/s)^2/s has the Allan variance q tau / 3.
            walk: 3.0 * (allan_1s * 1e9).powi(2),
            ramp_ns_per_s2: 0.0,
            stepped_ns: 0,
            local_stepped_ns: 0,
            slower: Span::ZERO,
        }
    }

    pub(super) fn ppm_more(&mut self, ppm: f64) {
        self.rate_ns_per_s += 1000.0 * ppm;
    }

    /// Takes an exact step of the integrated random walk.
    pub(super) fn advance_to(&mut self, elapsed_s: f64) {
        let t_s = elapsed_s - self.elapsed_s;
        let (a, b) = (self.dice.normal(), self.dice.normal());
        let turned = (self.walk * t_s).sqrt() * a;
        let wandered = t_s * (0.5 * turned + (self.walk * t_s / 12.0).sqrt() * b);
        self.ahead_ns += self.rate_ns_per_s * t_s + wandered + 0.5 * self.ramp_ns_per_s2 * t_s * t_s;
        self.rate_ns_per_s += turned + self.ramp_ns_per_s2 * t_s;
        self.elapsed_s = elapsed_s;
    }

    /// Returns the remote clock's reading, ns, and the true local time.
    pub(super) fn truth(&self) -> (i64, Tai) {
        let elapsed_ns = (self.elapsed_s * 1e9).round() as i64;
        let remote_ns = elapsed_ns + self.ahead_ns.round() as i64 + self.stepped_ns;
        (remote_ns, Tai::from_ns(BOOT_NS + elapsed_ns + self.local_stepped_ns))
    }

    /// Returns a mark sent at `at_s`: SCET as it goes over the wire, and the receive stamp.
    pub(super) fn mark(&mut self, at_s: f64) -> (i64, Tai) {
        self.advance_to(at_s);
        let (remote_ns, local) = self.truth();
        let queueing = Span::from_ns(self.link.queueing_ns(&mut self.dice).round() as i64);
        (as_on_the_wire(remote_ns), local + CONSTANT_DELAY + self.slower + queueing)
    }
}

/// Returns a SCET as the receiver reads it after the sender cut it to 2^-24 s.
pub(super) fn as_on_the_wire(remote_ns: i64) -> i64 {
    received_ns(scet(remote_ns))
}

pub(super) fn scet(remote_ns: i64) -> Scet {
    Scet::from_ns(u64::try_from(remote_ns).unwrap())
}

/// Returns the conversion of the receiver.
pub(super) fn received_ns(scet: Scet) -> i64 {
    i64::try_from(scet.ns()).unwrap()
}

/// Returns the SCET with one of the 24 bits of its fraction (from 0), or of the 32 of its seconds (from 24), the other
/// way.
pub(super) fn with_bit_flipped(scet: Scet, bit: u32) -> Scet {
    let (seconds, fraction) = (scet.seconds(), scet.fraction());
    let flipped = if bit < 24 { (seconds, fraction ^ (1 << bit)) } else { (seconds ^ (1 << (bit - 24)), fraction) };
    Scet::new(flipped.0, flipped.1).unwrap()
}

pub(super) fn limits() -> RemoteClockLimits {
    RemoteClockLimits { constant_delay: CONSTANT_DELAY, ..Default::default() }
}

pub(super) fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share) as usize]
}
