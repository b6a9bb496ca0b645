//! Faults of telemetry: what is wrong with reports and packets, and when.

use base::axes::{Icrf, Rotation, Sensor};
use base::random::{Stage, counter, key, philox};
use base::time::{Span, Tai};
use config::{TrackerOutFault, TrackerOutFaultKind as Kind};
use firmware_protocol::can::CanFrame;
use glam::DQuat;
use telemetry::{Report, Wire};

/// Stream of the seed, so that faults and errors of the tracker do not share numbers.
const DAMAGE_SEED: u64 = 0x7465_6c65;

/// Faults at work.
#[derive(Debug)]
pub(super) struct Damages {
    all: Vec<TrackerOutFault>,
    /// First exposure, from which the times of faults count.
    zero: Tai,
    seed: [u32; 2],
    packets: u32,
    reports: u32,
    frozen: Option<Report>,
    pub(super) hits: u64,
}

/// Fate of a packet.
pub(super) enum Fate {
    /// It goes out now.
    Now(Wire),
    /// It goes out later by this much.
    Later(Wire, Span),
    /// It is lost, by command.
    Gone,
}

impl Damages {
    pub(super) fn new(all: Vec<TrackerOutFault>, zero: Tai, seed: u64) -> Self {
        Self { all, zero, seed: key(seed ^ DAMAGE_SEED), packets: 0, reports: 0, frozen: None, hits: 0 }
    }

    /// Applies those of reports at `now`.
    pub(super) fn of_report(&mut self, report: &Report, now: Tai) -> Report {
        let number = self.reports;
        self.reports = self.reports.wrapping_add(1);
        let mut out = *report;
        let mut is_frozen = false;
        for (_, damage) in self.active(now, number, 0) {
            match damage.kind {
                Kind::Freeze => {
                    (out, is_frozen) = (*self.frozen.get_or_insert(out), true);
                }
                Kind::Invalid => (out.attitude_wxyz, out.rate_rad_s, out.stars) = (None, None, 0),
                Kind::Bias(turn_rad) => {
                    out.attitude_wxyz = out.attitude_wxyz.map(|[w, x, y, z]| {
                        let attitude: Rotation<Sensor, Icrf> = Rotation::from_quat(DQuat::from_xyzw(x, y, z, w));
                        attitude.rotated_by(turn_rad).wxyz()
                    });
                }
                Kind::Drop | Kind::Corrupt | Kind::Late(_) => continue,
            }
            self.hits += 1;
        }
        if !is_frozen {
            self.frozen = Some(*report);
        }
        out
    }

    /// Applies those of packets at `now`.
    pub(super) fn of_packet(&mut self, mut wire: Wire, now: Tai) -> Fate {
        let number = self.packets;
        self.packets = self.packets.wrapping_add(1);
        let mut late = Span::ZERO;
        for (place, damage) in self.active(now, number, 1) {
            match damage.kind {
                Kind::Drop => {
                    self.hits += 1;
                    return Fate::Gone;
                }
                Kind::Corrupt => wire = self.with_a_wrong_bit(wire, number, place),
                Kind::Late(by) => late = late + by,
                Kind::Freeze | Kind::Invalid | Kind::Bias(_) => continue,
            }
            self.hits += 1;
        }
        if late > Span::ZERO { Fate::Later(wire, late) } else { Fate::Now(wire) }
    }

    /// Faults that hit a report (`of` 0) or a packet (1), each with its place in the list.
    fn active(&self, now: Tai, number: u32, of: u32) -> Vec<(u32, TrackerOutFault)> {
        let is_hit = |(place, damage): &(u32, TrackerOutFault)| {
            let from = self.zero + damage.at;
            from <= now && now < from + damage.lasts && {
                let [word, ..] = philox(counter(number, 4 * place + of, Stage::TrackerModel), self.seed);
                (f64::from(word) + 0.5) / 4_294_967_296.0 < damage.share
            }
        };
        (0..).zip(self.all.iter().copied()).filter(is_hit).collect()
    }

    fn with_a_wrong_bit(&self, wire: Wire, number: u32, place: u32) -> Wire {
        let [word, ..] = philox(counter(number, 4 * place + 2, Stage::TrackerModel), self.seed);
        let flip = |data: &mut [u8]| {
            let bits = data.len() * 8;
            if let Some(bit) = (word as usize).checked_rem(bits) {
                data[bit / 8] ^= 1 << (bit % 8);
            }
        };
        match wire {
            Wire::Bytes(mut bytes) => {
                flip(&mut bytes);
                Wire::Bytes(bytes)
            }
            Wire::Can(frame) => {
                let mut data = frame.data().to_vec();
                flip(&mut data);
                CanFrame::classic(frame.id(), &data).map_or(Wire::Can(frame), Wire::Can)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use telemetry::Mode;

    fn at(ms: i64) -> Tai {
        Tai::from_ns(ms * 1_000_000)
    }

    fn report(frame: u32) -> Report {
        Report {
            frame,
            time_tag: at(i64::from(frame)),
            attitude_wxyz: Some([1.0, 0.0, 0.0, 0.0]),
            rate_rad_s: None,
            sigma_rad: [0.0; 3],
            stars: 9,
            mode: Mode::Tracking,
            exposure_s: 0.1,
            background_dn: 0.0,
            temperature_c: 0.0,
        }
    }

    fn of(kind: Kind, share: f64) -> Damages {
        let fault = TrackerOutFault { kind, at: Span::from_ms(10), lasts: Span::from_ms(10), share };
        Damages::new(vec![fault], at(0), 5)
    }

    #[test]
    fn reports_are_changed_inside_the_window_only() {
        let mut frozen = of(Kind::Freeze, 1.0);
        let frames: Vec<u32> =
            [5, 9, 10, 15, 19, 20].map(|ms| frozen.of_report(&report(ms), at(i64::from(ms))).frame).into();
        assert_eq!((frames, frozen.hits), (vec![5, 9, 9, 9, 9, 20], 3));
        let mut invalid = of(Kind::Invalid, 1.0);
        let known = [9, 10, 20].map(|ms| invalid.of_report(&report(ms), at(i64::from(ms))).attitude_wxyz.is_some());
        assert_eq!(known, [true, false, true]);
        let mut biased = of(Kind::Bias(DVec3::X * 0.2), 1.0);
        let [w, x, ..] = biased.of_report(&report(12), at(12)).attitude_wxyz.unwrap();
        assert!((w - 0.1_f64.cos()).abs() < 1e-15 && (x.abs() - 0.1_f64.sin()).abs() < 1e-15, "{w} {x}");
    }

    #[test]
    fn packets_are_lost_late_or_damaged_by_their_share() {
        let packet = || Wire::Bytes(vec![0; 9]);
        let mut half = of(Kind::Drop, 0.5);
        let lost = (0..1000).filter(|_| matches!(half.of_packet(packet(), at(12)), Fate::Gone)).count();
        assert!((430..570).contains(&lost), "{lost} of 1000: four and a half standard deviations");
        assert!(matches!(half.of_packet(packet(), at(25)), Fate::Now(_)), "control: it is over");
        let mut late = of(Kind::Late(Span::from_ms(7)), 1.0);
        assert!(matches!(late.of_packet(packet(), at(12)), Fate::Later(_, by) if by == Span::from_ms(7)));
        let mut corrupt = of(Kind::Corrupt, 1.0);
        let Fate::Now(Wire::Bytes(bytes)) = corrupt.of_packet(packet(), at(12)) else { unreachable!() };
        assert_eq!(bytes.iter().map(|byte| byte.count_ones()).sum::<u32>(), 1);
    }
}
