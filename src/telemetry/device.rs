//! Common parts of all protocols: the report of a tracker, the orders of a client, the trait of a device, the senses of
//! quaternions and the sign that keeps a series of them without jumps.

use base::time::{Span, Tai};
use firmware_protocol::can::CanFrame;

/// State of the tracker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Nothing, by command.
    Standby,
    /// Looking for its attitude.
    Acquisition,
    /// Following it.
    Tracking,
}

/// Result of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Report {
    /// Number of the frame.
    pub frame: u32,
    /// Middle of the exposure, by the tracker's clock.
    pub time_tag: Tai,
    /// Attitude then, `sensor_from_icrf`, scalar first; `None`: not known.
    pub attitude_wxyz: Option<[f64; 4]>,
    /// Rate of the sensor axes with respect to ICRF, in sensor axes, rad/s.
    pub rate_rad_s: Option<[f64; 3]>,
    /// Standard deviations about the sensor axes, rad, as the tracker expects them.
    pub sigma_rad: [f64; 3],
    /// Stars that it used.
    pub stars: u16,
    /// State.
    pub mode: Mode,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Background of the image, DN; not a number where it does not look at pixels.
    pub background_dn: f64,
    /// Temperature of the detector, degrees Celsius.
    pub temperature_c: f64,
}

/// Order of a client.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Order {
    /// Measure attitudes.
    Operate,
    /// Stop measuring attitudes.
    Pause,
    /// Expose for so long.
    Exposure(Span),
    /// Begin again, lost in space.
    Reset,
}

/// One packet on a line.
#[derive(Debug, Clone, PartialEq)]
pub enum Wire {
    /// Bytes: a datagram, or a piece of a stream.
    Bytes(Vec<u8>),
    /// A CAN frame.
    Can(CanFrame),
}

impl Wire {
    /// Returns a classic CAN frame; `None` of an identifier above 11 bits or more than 8 bytes.
    pub fn can(id: u16, data: &[u8]) -> Option<Self> {
        CanFrame::classic(id, data).map(Self::Can)
    }

    /// Its bytes, without those of a CAN frame's header.
    pub fn data(&self) -> &[u8] {
        match self {
            Self::Bytes(bytes) => bytes,
            Self::Can(frame) => frame.data(),
        }
    }
}

/// Abilities of a tracker.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Limits {
    /// Shortest and longest exposure, s; `None`: exposures cannot be commanded.
    pub exposure_s: Option<[f64; 2]>,
}

impl Limits {
    /// Returns the order of an exposure time in seconds; `None` outside the limits.
    pub fn exposure(&self, seconds: f64) -> Option<Order> {
        let [least, most] = self.exposure_s?;
        // A few nanoseconds for those who count in single precision.
        let near = 1e-7 * most;
        let is_within = seconds >= least - near && seconds <= most + near;
        is_within.then(|| Order::Exposure(Span::from_s(seconds.clamp(least, most))))
    }
}

/// A number in single precision, little-endian.
#[allow(clippy::cast_possible_truncation, reason = "single precision on the wire")]
pub(crate) fn single(value: f64) -> [u8; 4] {
    (value as f32).to_le_bytes()
}

/// Counts of commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Answered {
    /// Commands and requests that were understood and obeyed.
    pub commands: u64,
    /// Commands that were refused, and bytes that are none, by runs.
    pub refused: u64,
}

/// A star tracker at the other end of a line, as its protocol shows it.
pub trait Device: Send {
    /// True when it speaks only when it is asked.
    fn is_polled(&self) -> bool {
        false
    }

    /// Sends what follows from power being switched on.
    fn start(&mut self, _now: Tai, _out: &mut Vec<Wire>) {}

    /// Sends a report at `now`.
    fn report(&mut self, report: &Report, now: Tai, out: &mut Vec<Wire>);

    /// Takes what came from a client, in runs of any length on a stream; answers go to `out`, orders to `orders`.
    fn take(&mut self, wire: &Wire, now: Tai, out: &mut Vec<Wire>, orders: &mut Vec<Order>);

    /// Sends what is due by `now` without a report, such as a heartbeat.
    fn step(&mut self, _now: Tai, _out: &mut Vec<Wire>) {}

    /// When [`Self::step`] next has something to send.
    fn next_due(&self) -> Option<Tai> {
        None
    }

    /// Commands so far.
    fn answered(&self) -> Answered;
}

/// Which rotation a quaternion is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sense {
    /// As in starloop: `v_sensor = q v_icrf q*`.
    #[default]
    Starloop,
    /// Its conjugate.
    Conjugate,
}

impl Sense {
    /// Returns a quaternion of starloop in this sense, and the other way round.
    pub fn of(self, [w, x, y, z]: [f64; 4]) -> [f64; 4] {
        match self {
            Self::Starloop => [w, x, y, z],
            Self::Conjugate => [w, -x, -y, -z],
        }
    }
}

/// Chooses between `q` and `-q`, which are the same attitude: the one nearer to the last, at first the one with `w >=
/// 0`.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Continuity {
    last: Option<[f64; 4]>,
}

impl Continuity {
    pub(crate) fn next(&mut self, q: [f64; 4]) -> [f64; 4] {
        let dot: f64 = match self.last {
            Some(last) => last.iter().zip(q).map(|(a, b)| a * b).sum(),
            None => q[0],
        };
        let same = if dot < 0.0 { q.map(|part| -part) } else { q };
        self.last = Some(same);
        same
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sign_follows_the_last_and_the_conjugate_turns_back() {
        let mut series = Continuity::default();
        assert_eq!(series.next([-0.6, 0.0, 0.8, 0.0]), [0.6, 0.0, -0.8, 0.0], "scalar not negative at first");
        assert_eq!(series.next([-0.1, 0.0, -0.99, 0.0]), [-0.1, 0.0, -0.99, 0.0], "nearer to the last as it is");
        assert_eq!(series.next([0.2, 0.0, 0.98, 0.0]), [-0.2, 0.0, -0.98, 0.0]);
        let q = [0.5, 0.1, -0.2, 0.3];
        assert_eq!(Sense::Conjugate.of(Sense::Conjugate.of(q)), q);
        assert_ne!(Sense::Conjugate.of(q), Sense::Starloop.of(q));
    }
}
