//! `[[tracker_in]]`: star trackers outside, which see a head's frames and answer with attitudes.
//!
//! A spacecraft that is flown inside points by them in place of its own at that head. `run::wiring::tracker_ins` opens
//! what is described here.

use crate::key::{Section, listed, section, taken};
use crate::key_type::{Numbers, Raw, Whole, Word};
use crate::link::{Address, named_address, port_or_address};
use crate::tracker_protocol::{PDO_MAPS, TrackerPdos, TrackerProtocol};
use crate::{camera::HEADS_MAX, check::Checker, error::Result};
use base::time::Span;
use base::units::ARCSEC;
use glam::DVec3;
use std::{net::SocketAddr, path::PathBuf};

/// A tracker outside, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackerIn {
    /// Number of the head whose frames it sees.
    pub head: usize,
    /// Protocol.
    pub protocol: TrackerProtocol,
    /// Over what.
    pub line: AnswerLine,
    /// Quaternions are the conjugate of starloop's, where the protocol leaves it open.
    pub is_conjugate: bool,
    /// From the middle of an exposure to an answer that is not late.
    pub late_after: Span,
    /// Standard deviations about the sensor's axes, rad.
    pub sigma_rad: DVec3,
}

/// Over what a tracker outside answers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum AnswerLine {
    /// Datagrams.
    Udp {
        /// Where they are taken.
        listen: SocketAddr,
    },
    /// A TCP server for one tracker.
    Tcp {
        /// Where it listens.
        listen: SocketAddr,
    },
    /// A serial port.
    Serial {
        /// Device.
        path: PathBuf,
        /// Bits per second.
        baud: u32,
    },
    /// A CAN interface of the kernel.
    SocketCan {
        /// Its name.
        interface: String,
    },
    /// A CAN bus of its own with slcan over TCP.
    SlcanTcp {
        /// Where it listens.
        listen: SocketAddr,
        /// Bits per second on the bus.
        bit_rate: u32,
    },
    /// The simulated CAN bus of the run, which the tracker reaches by its gateways.
    Bus,
}

/// `link` before the keys that belong to it are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum AnswerWord {
    Udp,
    Tcp,
    Serial,
    SocketCan,
    SlcanTcp,
    Bus,
}

/// The CANopen node of a tracker outside, where no key says otherwise.
const CANOPEN: TrackerProtocol =
    TrackerProtocol::CanOpen { node: 96, heartbeat_ms: 0, starts_operational: true, pdos: TrackerPdos::Starloop };

section! {
    /// A star tracker outside that sees the frames of a head and answers with attitudes, on the real clock; a spacecraft that
    /// is flown inside points by them.
    TrackerInKeys at "tracker_in" {
        /// Number of the camera head whose frames the tracker sees, from 0.
        head: Whole<usize> = 0, 0..=HEADS_MAX as i64 - 1;
        /// Protocol of its answers, as in [[tracker_out]]: json; sagitta over a line of bytes; canopen; ccsds is space packets.
        protocol: Word<TrackerProtocol> = "json", [
            ("json", TrackerProtocol::Json), ("sagitta", TrackerProtocol::Sagitta),
            ("canopen", CANOPEN),
            ("ccsds", TrackerProtocol::Ccsds { apid: 100 }),
        ];
        /// Over what: bus is the run's simulated CAN bus, which the tracker reaches by the gateways of [link].
        link: Word<AnswerWord> = Needed, [
            ("udp", AnswerWord::Udp), ("tcp", AnswerWord::Tcp), ("serial", AnswerWord::Serial),
            ("socketcan", AnswerWord::SocketCan), ("slcan_tcp", AnswerWord::SlcanTcp), ("bus", AnswerWord::Bus),
        ];
        /// Where answers are taken: a port on loopback such as 9101, or "address:port"; 0 takes a free one.
        listen: Raw<Address> = Optional, port_or_address();
        /// Serial port.
        path: String = Optional, "path";
        /// Bits per second of a serial port.
        baud: Whole = 115_200, 300..=4_000_000;
        /// CAN interface of the kernel, such as "can0".
        interface: String = Optional, "name such as \"can0\"";
        /// Bits per second on a CAN bus of its own.
        bit_rate: Whole = 500_000, 10_000..=1_000_000;
        /// Number of the tracker's CANopen node, which is started when it says that it waits.
        node_id: Whole<u8> = 96, 1..=127;
        /// Map of the node's transmit PDOs, as in [[tracker_out]].
        pdo_map: Word<TrackerPdos> = "starloop", PDO_MAPS;
        /// Sense of the quaternion, for json, canopen and ccsds: starloop is v_sensor = q v_icrf q*, conjugate the
        /// other one.
        quaternion: Word<bool> = "starloop", [("starloop", false), ("conjugate", true)];
        /// Milliseconds from the middle of an exposure after which an answer is late.
        late_after_ms: f64 = 500.0, PositiveUpTo(2000.0);
        /// Errors of its attitudes about the sensor's x, y and z (boresight) axes, 1 sigma, as the estimator weighs them.
        sigma_arcsec: [f64; 3] = Numbers([5.0, 5.0, 40.0]), Within(0.001, 36_000.0);
    }
}

/// Reads the trackers outside of a bench with `heads`.
pub(super) fn check_tracker_ins(
    keys: &[TrackerInKeys],
    heads: usize,
    is_on_simulated_can: bool,
    check: &mut Checker<'_>,
) -> Result<Vec<TrackerIn>> {
    let mut trackers: Vec<TrackerIn> = Vec::with_capacity(keys.len());
    for keys in listed(keys, "tracker_in") {
        let tracker = keys.tracker_in(heads, is_on_simulated_can, check)?;
        if trackers.iter().any(|other| other.head == tracker.head) {
            let wanted = "one tracker for each head";
            return Err(keys.head().invalid(format!("{} again", tracker.head), wanted, check));
        }
        trackers.push(tracker);
    }
    Ok(trackers)
}

impl TrackerInKeys {
    fn tracker_in(&self, heads: usize, is_on_simulated_can: bool, check: &mut Checker<'_>) -> Result<TrackerIn> {
        taken!(check, self => head, protocol, link, sigma_arcsec);
        if head >= heads {
            let wanted = format!("a head of the bench: below {heads}");
            return Err(self.head().invalid(head, wanted, check));
        }
        let is_can = matches!(link, AnswerWord::SocketCan | AnswerWord::SlcanTcp | AnswerWord::Bus);
        let speaks_can = matches!(protocol, TrackerProtocol::CanOpen { .. });
        if is_can != speaks_can {
            let wanted = if speaks_can { "socketcan, slcan_tcp or bus" } else { "udp, tcp or serial" };
            let given = self.link().advised("canopen is for CAN, the other protocols are not");
            return Err(given.invalid("another", wanted, check));
        }
        if link == AnswerWord::Bus && !is_on_simulated_can {
            let given = self.link().advised("its own bus, with slcan_tcp, goes with any link");
            return Err(given.invalid("\"bus\"", "a bench whose link is a simulated CAN bus", check));
        }
        if protocol == TrackerProtocol::Sagitta {
            self.refuse(&["quaternion"], "protocols that leave it open: json, canopen and ccsds", check)?;
        }
        let protocol = match protocol {
            TrackerProtocol::CanOpen { heartbeat_ms, starts_operational, .. } => {
                let (node, pdos) = (self.node_id().check(check)?, self.pdo_map().check(check)?);
                TrackerProtocol::CanOpen { node, heartbeat_ms, starts_operational, pdos }
            }
            other @ (TrackerProtocol::Json
            | TrackerProtocol::Nos3
            | TrackerProtocol::Sagitta
            | TrackerProtocol::Ccsds { .. }) => {
                self.refuse(&["node_id", "pdo_map"], "protocol = \"canopen\"", check)?;
                other
            }
        };
        Ok(TrackerIn {
            head,
            protocol,
            line: self.line(link, check)?,
            is_conjugate: protocol != TrackerProtocol::Sagitta && self.quaternion().check(check)?,
            late_after: self.late_after_ms().ms(check)?,
            sigma_rad: DVec3::from_array(sigma_arcsec) * ARCSEC,
        })
    }

    fn line(&self, link: AnswerWord, check: &mut Checker<'_>) -> Result<AnswerLine> {
        let listens = matches!(link, AnswerWord::Udp | AnswerWord::Tcp | AnswerWord::SlcanTcp);
        for (is_used, names, owner) in [
            (listens, &["listen"][..], "link = \"udp\", \"tcp\" or \"slcan_tcp\""),
            (link == AnswerWord::Serial, &["path", "baud"], "link = \"serial\""),
            (link == AnswerWord::SocketCan, &["interface"], "link = \"socketcan\""),
            (link == AnswerWord::SlcanTcp, &["bit_rate"], "link = \"slcan_tcp\""),
        ] {
            if !is_used {
                self.refuse(names, owner, check)?;
            }
        }
        Ok(match link {
            AnswerWord::Udp => AnswerLine::Udp { listen: named_address(&self.listen(), check)? },
            AnswerWord::Tcp => AnswerLine::Tcp { listen: named_address(&self.listen(), check)? },
            AnswerWord::Serial => {
                let path = self.path().raw().map(PathBuf::from);
                let path = path.ok_or_else(|| self.path().missing("a serial port", check))?;
                AnswerLine::Serial { path, baud: self.baud().check(check)? }
            }
            AnswerWord::SocketCan => {
                let name = self.interface().raw().cloned();
                AnswerLine::SocketCan {
                    interface: name.ok_or_else(|| self.interface().missing("a CAN interface", check))?,
                }
            }
            AnswerWord::SlcanTcp => AnswerLine::SlcanTcp {
                listen: named_address(&self.listen(), check)?,
                bit_rate: self.bit_rate().check(check)?,
            },
            AnswerWord::Bus => AnswerLine::Bus,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Bench, Document};
    use std::path::Path;

    fn trackers(text: &str) -> Result<Vec<TrackerIn>, String> {
        let document = Document::from_text(text, Path::new("lab/bench.toml"));
        Bench::from_document(&document).map(|bench| bench.tracker_ins).map_err(|error| error.to_string())
    }

    fn one(keys: &str) -> Result<TrackerIn, String> {
        trackers(&format!("[[tracker_in]]\n{keys}")).map(|all| all.into_iter().next().expect("one"))
    }

    #[test]
    fn trackers_outside_are_as_the_bench_file_says() {
        assert_eq!(trackers("").unwrap(), []);
        let plain = one("link = \"udp\"\nlisten = 9101").unwrap();
        assert_eq!((plain.head, plain.protocol, plain.late_after), (0, TrackerProtocol::Json, Span::from_ms(500)));
        assert_eq!(plain.line, AnswerLine::Udp { listen: "127.0.0.1:9101".parse().unwrap() });
        assert!((plain.sigma_rad / ARCSEC - DVec3::new(5.0, 5.0, 40.0)).length() < 1e-9);
        let can = one(
            "protocol = \"canopen\"\nlink = \"bus\"\nnode_id = 100\npdo_map = \"oresat\"\nquaternion = \"conjugate\"",
        )
        .unwrap();
        let pdos = TrackerPdos::OreSat;
        assert!(can.is_conjugate);
        assert!(matches!(can.protocol, TrackerProtocol::CanOpen { node: 100, pdos: of, .. } if of == pdos));
    }

    #[test]
    fn each_rule_has_a_failing_example() {
        for (keys, parts) in [
            ("head = 0", ["tracker_in[0].link", "missing"]),
            ("link = \"udp\"", ["tracker_in[0].listen", "missing"]),
            ("link = \"serial\"", ["tracker_in[0].path", "missing"]),
            ("protocol = \"canopen\"\nlink = \"socketcan\"", ["tracker_in[0].interface", "missing"]),
            ("link = \"udp\"\nlisten = 9101\nhead = 1", ["tracker_in[0].head", "below 1"]),
            ("link = \"bus\"", ["tracker_in[0].link", "udp, tcp or serial"]),
            (
                "protocol = \"canopen\"\nlink = \"udp\"\nlisten = 1",
                ["tracker_in[0].link", "socketcan, slcan_tcp or bus"],
            ),
            ("link = \"tcp\"\nlisten = 9101\nbaud = 9600", ["tracker_in[0].baud", "serial"]),
            ("link = \"udp\"\nlisten = 9101\nnode_id = 5", ["tracker_in[0].node_id", "canopen"]),
            ("link = \"udp\"\nlisten = 1\nlate_after_ms = 2001.0", ["tracker_in[0].late_after_ms", "2000"]),
            (
                "link = \"udp\"\nlisten = 1\n[[tracker_in]]\nlink = \"udp\"\nlisten = 2",
                ["tracker_in[1].head", "one tracker for each head"],
            ),
        ] {
            let error = one(keys).expect_err(keys);
            assert!(parts.iter().all(|part| error.contains(part)), "{keys}: {error}");
        }
    }
}
