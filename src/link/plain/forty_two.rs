//! Lines of the simulator 42 (NASA GSFC) -> records.
//!
//! In: the lines that 42 sends over a socket, one at a time: `TIME`, then `SC[n].qn = [...]` and others, then
//! `[ENDMSG]`; before 2024 `SC[n].B[0].qn = ...` without brackets, and `[EOF]`. Out: a record per message, in starloop's conventions. The attitude is of B in N, scalar last, with the
//! other sense of the quaternion; the rate is of B with respect to N, in B, rad/s. N is the inertial frame of the
//! world: of the Earth the J2000 equator, which is taken as ICRF (they differ by 0.02 arcsec). The observer is
//! `Orb[0]` + `SC[n].PosR`, metres. Times are UTC with 86,400 seconds in each day. Other values are left unread; a line
//! that is neither a time nor a value nor an end is counted. Source: 42, commit 11e3cc3,
//! `Source/AutoCode/TxRxIPC.c`, `Kit/Source/mathkit.c`, and `Source/IPC/SimWriteToSocket.c` of the years before. Tests: `tests`,
//! `hil_scripts/tests/test_plain_links.py`.

use super::layout::TimeMeaning;
use super::{PlainAttitude, PlainRecord, PlainReject, PlainState, PlainTime, RefusedMessage};
use base::{axes::WRITTEN_NORM_TOLERANCE, units::METRE_KM};

/// The last line of a message, and that of a message before 2024.
const ENDS_OF_MESSAGE: [&[u8]; 2] = [b"[ENDMSG]", b"[EOF]"];
/// Answer of the receiver to a message.
pub const ACKNOWLEDGE: &[u8; 4] = b"Ack\0";
const NS_PER_S: f64 = 1e9;

/// Returns whether a line is the last one of a message.
pub fn is_end_of_message(line: &[u8]) -> bool {
    ENDS_OF_MESSAGE.contains(&line.trim_ascii())
}

/// The message so far.
#[derive(Debug, Clone, Default)]
pub(super) struct FortyTwo {
    unix_ns: Option<i64>,
    /// Scalar last.
    qn: Option<[f64; 4]>,
    wn: Option<[f64; 3]>,
    pos_r: Option<[f64; 3]>,
    vel_r: Option<[f64; 3]>,
    pos_n: Option<[f64; 3]>,
    vel_n: Option<[f64; 3]>,
    /// A line of the message was refused, and with it the message.
    is_refused: bool,
    /// The line that is quoted when all of it is refused: its attitude, or else its first line about a spacecraft.
    quoted: Option<RefusedMessage>,
}

impl FortyTwo {
    /// Takes a line; a record with the last one of a message.
    pub(super) fn take(
        &mut self,
        line: &[u8],
        spacecraft: u16,
        time: TimeMeaning,
    ) -> Result<Option<PlainRecord>, RefusedMessage> {
        let line = line.trim_ascii();
        if is_end_of_message(line) {
            let message = core::mem::take(self);
            // The refused line is counted already.
            if message.is_refused {
                return Ok(None);
            }
            return message.record(time).map(Some).map_err(|reason| {
                let mut refused = message.quoted.unwrap_or(RefusedMessage::new(reason, line));
                refused.reason = reason;
                refused
            });
        }
        let taken = self.take_line(line, spacecraft);
        self.is_refused |= taken.is_err_and(|reject| reject != PlainReject::Unread);
        taken.map(|()| None).map_err(|reject| RefusedMessage::new(reject, line))
    }

    fn take_line(&mut self, line: &[u8], spacecraft: u16) -> Result<(), PlainReject> {
        let text = core::str::from_utf8(line).map_err(|_| PlainReject::Text)?;
        if let Some(stamp) = text.strip_prefix("TIME ") {
            self.unix_ns = Some(unix_ns(stamp.trim()).ok_or(PlainReject::Time)?);
            return Ok(());
        }
        let Some((name, value)) = text.split_once('=') else {
            return if text.is_empty() { Ok(()) } else { Err(PlainReject::Unread) };
        };
        let name = name.trim();
        if name.starts_with("SC[")
            && (self.quoted.is_none() || quantity(name, "SC", spacecraft).is_some_and(is_attitude))
        {
            self.quoted = Some(RefusedMessage::new(PlainReject::Incomplete, line));
        }
        match (quantity(name, "SC", spacecraft), quantity(name, "Orb", 0)) {
            (Some(attitude), _) if is_attitude(attitude) => self.qn = Some(numbers(value)?),
            (Some("wn" | "B[0].wn"), _) => self.wn = Some(numbers(value)?),
            (Some("PosR"), _) => self.pos_r = Some(numbers(value)?),
            (Some("VelR"), _) => self.vel_r = Some(numbers(value)?),
            (_, Some("PosN")) => self.pos_n = Some(numbers(value)?),
            (_, Some("VelN")) => self.vel_n = Some(numbers(value)?),
            _ => {}
        }
        Ok(())
    }

    fn record(&self, time: TimeMeaning) -> Result<PlainRecord, PlainReject> {
        let (Some(unix_ns), Some([x, y, z, w]), Some(rate_rad_s)) = (self.unix_ns, self.qn, self.wn) else {
            return Err(PlainReject::Incomplete);
        };
        if ((w * w + x * x + y * y + z * z).sqrt() - 1.0).abs() > WRITTEN_NORM_TOLERANCE {
            return Err(PlainReject::QuaternionNorm);
        }
        let attitude = PlainAttitude { q_wxyz: [w, -x, -y, -z], rate_rad_s, acceleration_rad_s2: [0.0; 3] };
        let time = match time {
            TimeMeaning::Arrival => PlainTime::Arrival,
            TimeMeaning::Tag => PlainTime::Tag(unix_ns),
        };
        Ok(PlainRecord { time, attitude: Some(attitude), jitter_rad: None, observer: self.observer() })
    }

    fn observer(&self) -> Option<PlainState> {
        let sum = |orbit: [f64; 3], offset: Option<[f64; 3]>| {
            let offset = offset.unwrap_or_default();
            [0, 1, 2].map(|i| (orbit[i] + offset[i]) * METRE_KM)
        };
        let (position_km, velocity_km_s) = (sum(self.pos_n?, self.pos_r), sum(self.vel_n?, self.vel_r));
        Some(PlainState { position_km, velocity_km_s })
    }
}

fn is_attitude(quantity: &str) -> bool {
    matches!(quantity, "qn" | "B[0].qn")
}

/// Returns the part after `SC[0].` in the name of a quantity of this object.
fn quantity<'n>(name: &'n str, object: &str, number: u16) -> Option<&'n str> {
    let (digits, rest) = name.strip_prefix(object)?.strip_prefix('[')?.split_once(']')?;
    (digits.parse() == Ok(number)).then(|| rest.strip_prefix('.')).flatten()
}

/// Reads exactly `N` finite numbers, with or without brackets.
fn numbers<const N: usize>(value: &str) -> Result<[f64; N], PlainReject> {
    let value = value.trim();
    let inside = value.strip_prefix('[').map_or(value, |rest| rest.strip_suffix(']').unwrap_or(rest));
    let mut words = inside.split_ascii_whitespace();
    let mut numbers = [0.0_f64; N];
    for number in &mut numbers {
        *number = words.next().ok_or(PlainReject::Length)?.parse().map_err(|_| PlainReject::Number)?;
        if !number.is_finite() {
            return Err(PlainReject::NotFinite);
        }
    }
    if words.next().is_some() { Err(PlainReject::Length) } else { Ok(numbers) }
}

/// Reads `2025-079-12:00:00.010000000` (year, day of year, time of day, UTC) as Unix time, ns.
#[allow(clippy::cast_possible_truncation, reason = "a fraction of a day in ns")]
fn unix_ns(stamp: &str) -> Option<i64> {
    let mut parts = stamp.splitn(3, '-');
    let (year, day, clock) = (parts.next()?.parse::<i64>().ok()?, parts.next()?.parse::<i64>().ok()?, parts.next()?);
    let mut parts = clock.splitn(3, ':');
    let (hour, minute) = (parts.next()?.parse::<i64>().ok()?, parts.next()?.parse::<i64>().ok()?);
    let second = parts.next()?.parse::<f64>().ok()?;
    let is_legal = (1970..=2261).contains(&year)
        && (1..=366).contains(&day)
        && (0..24).contains(&hour)
        && (0..60).contains(&minute)
        && (0.0..=60.0).contains(&second);
    if !is_legal {
        return None;
    }
    let before = year - 1;
    let days = 365 * (year - 1970) + (before / 4 - before / 100 + before / 400 - 477) + day - 1;
    let whole_s = 86_400 * days + 3600 * hour + 60 * minute;
    Some(whole_s * 1_000_000_000 + (second * NS_PER_S).round() as i64)
}
