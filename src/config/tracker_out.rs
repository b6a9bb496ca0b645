//! `[[tracker_out]]`: telemetry of star trackers on real protocols: of the tracker on pixels, or of one of given
//! errors.
//!
//! `protocol` and `link` say which other keys there are. `run::wiring::tracker_out` makes what is described here.

use crate::key::{Section, listed, section, taken};
use crate::key_type::{Any, Numbers, Raw, Whole, Word};
use crate::link::{Address, address, named_address, port_or_address};
use crate::tracker_protocol::{PDO_MAPS, PROTOCOLS, TrackerPdos, TrackerProtocol};
use crate::{bench::Bench, camera::HEADS_MAX, check::Checker, error::Result};
use base::time::Span;
use base::units::{ARCSEC, DEG};
use glam::DVec3;
use std::path::{Component, PathBuf};
use std::{ffi::OsStr, net::SocketAddr};
use testbed::tracker_model::{ModelParams, NoiseMethod};

/// Most of them in one bench.
const OUTS_MAX: usize = 16;
/// A head's errors repeat with no shorter period than this, degrees: a field cannot be smaller.
const LEAST_FIELD_DEG: f64 = 0.01;

/// Telemetry of one tracker, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackerOut {
    /// Number of the head whose frames it sees.
    pub head: usize,
    /// Where its attitudes come from.
    pub source: TrackerSource,
    /// Protocol.
    pub protocol: TrackerProtocol,
    /// Over what.
    pub line: TrackerLine,
    /// Quaternions are the conjugate of starloop's, where the protocol leaves it open.
    pub is_conjugate: bool,
    /// Packets per second; `None`: one with each frame.
    pub rate_hz: Option<f64>,
    /// From the end of readout to the packet.
    pub delay: Span,
    /// Error of its time tags.
    pub tag_error: Span,
    /// Faults of its telemetry, each at its time.
    pub faults: Vec<TrackerOutFault>,
}

/// Where attitudes come from.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "one for each [[tracker_out]]")]
pub enum TrackerSource {
    /// The built-in tracker, on drawn pixels.
    Pixels {
        /// Most stars that it measures in a frame.
        most_stars: usize,
    },
    /// A tracker of given errors, on the truth.
    Model(ModelParams),
}

/// Over what a tracker speaks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TrackerLine {
    /// Datagrams to an address.
    Udp {
        /// Whom they go to.
        to: SocketAddr,
        /// Where commands are taken; `None`: at a free port, which the run names.
        listen: Option<SocketAddr>,
    },
    /// A TCP server for one client at a time.
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
    /// A pseudo-terminal, to which a symbolic link is made.
    Pty {
        /// The link.
        path: PathBuf,
    },
    /// A CAN interface of the kernel.
    SocketCan {
        /// Its name.
        interface: String,
    },
    /// A CAN bus of its own with slcan on a pseudo-terminal.
    SlcanPty {
        /// The symbolic link to it.
        path: PathBuf,
        /// Bits per second on the bus.
        bit_rate: u32,
    },
    /// A CAN bus of its own with slcan over TCP.
    SlcanTcp {
        /// Where it listens.
        listen: SocketAddr,
        /// Bits per second on the bus.
        bit_rate: u32,
    },
    /// The simulated CAN bus of the run.
    Bus,
    /// A file: one line per packet, with its instant and its bytes.
    File {
        /// Below the run's directory, where it has one.
        path: PathBuf,
    },
}

impl TrackerLine {
    /// Returns true when only this program is at the other end: it may be on the virtual clock.
    pub fn has_virtual_time(&self) -> bool {
        matches!(self, Self::Udp { .. } | Self::Bus | Self::File { .. })
    }
}

/// Endings of files that a run writes into its folder itself.
const OWN_ENDINGS: [&str; 9] = ["json", "jsonl", "html", "csv", "toml", "eds", "fits", "png", "pcapng"];

/// Fault of telemetry for a while.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackerOutFault {
    /// What.
    pub kind: TrackerOutFaultKind,
    /// When it begins, after the first exposure.
    pub at: Span,
    /// How long it lasts.
    pub lasts: Span,
    /// Share of the packets that it hits.
    pub share: f64,
}

/// Kinds of faults of telemetry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TrackerOutFaultKind {
    /// Packets are lost.
    Drop,
    /// One bit of a packet is wrong.
    Corrupt,
    /// The report is the last one before.
    Freeze,
    /// The attitude is not known.
    Invalid,
    /// The attitude is turned by this rotation vector, sensor axes, rad.
    Bias(DVec3),
    /// Packets are late by so much.
    Late(Span),
}

/// `link` before the keys that belong to it are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LineWord {
    Udp,
    Tcp,
    Serial,
    Pty,
    SocketCan,
    SlcanPty,
    SlcanTcp,
    Bus,
    File,
}

impl LineWord {
    fn is_can(self) -> bool {
        matches!(self, Self::SocketCan | Self::SlcanPty | Self::SlcanTcp | Self::Bus)
    }
}

section! {
    /// Telemetry of a star tracker on a protocol that clients speak.
    TrackerOutKeys at "tracker_out" {
        /// Number of the camera head whose frames the tracker sees, from 0.
        head: Whole<usize> = 0, 0..=HEADS_MAX as i64 - 1;
        /// Where attitudes come from: the built-in tracker on drawn pixels, or the truth with the errors of [tracker_out.model].
        source: Word<bool> = "pixels", [("pixels", true), ("model", false)];
        /// Protocol: json; nos3 and sagitta over a line of bytes; canopen; ccsds is space packets with PUS services.
        protocol: Word<TrackerProtocol> = "json", PROTOCOLS;
        /// Over what: bus is the run's simulated CAN bus, file writes down each packet with its instant.
        link: Word<LineWord> = Needed, [
            ("udp", LineWord::Udp), ("tcp", LineWord::Tcp), ("serial", LineWord::Serial), ("pty", LineWord::Pty),
            ("socketcan", LineWord::SocketCan), ("slcan_pty", LineWord::SlcanPty), ("slcan_tcp", LineWord::SlcanTcp),
            ("bus", LineWord::Bus), ("file", LineWord::File),
        ];
        /// Where datagrams go: a port on loopback such as 9001, or "address:port".
        send_to: Raw<Address> = Optional, port_or_address();
        /// Where a server listens, or commands in datagrams are taken: a port on loopback, or "address:port"; 0 takes a
        /// free one.
        listen: Raw<Address> = Optional, port_or_address();
        /// Serial port, name of the link to a pseudo-terminal, or file (below the run's directory, no name of its own files).
        path: String = Optional, "path";
        /// Bits per second of a serial port.
        baud: Whole = 115_200, 300..=4_000_000;
        /// CAN interface of the kernel, such as "can0".
        interface: String = Optional, "name such as \"can0\"";
        /// Bits per second on a CAN bus of its own.
        bit_rate: Whole = 500_000, 10_000..=1_000_000;
        /// CANopen node number; 96 to 127 have no identifier of starloop's own messages.
        node_id: Whole<u8> = 96, 1..=127;
        /// Milliseconds from one CANopen heartbeat to the next; 0 for none.
        heartbeat_ms: Whole<u16> = 1000, 0..=65_535;
        /// The CANopen node is operational without being started by a master.
        starts_operational: bool = false, Any;
        /// Transmit PDOs of the CANopen node: starloop has four; oresat has the three of OreSat1's star tracker, which is
        /// node 44 there.
        pdo_map: Word<TrackerPdos> = "starloop", PDO_MAPS;
        /// Number of the application process in space packets.
        apid: Whole<u16> = 100, 0..=2046;
        /// Sense of the quaternion, for json, canopen and ccsds: starloop is v_sensor = q v_icrf q*, conjugate the
        /// other one.
        quaternion: Word<bool> = "starloop", [("starloop", false), ("conjugate", true)];
        /// Packets per second, of the newest attitude; left out, one with each frame.
        rate_hz: f64 = Optional, PositiveUpTo(1000.0);
        /// Milliseconds from the end of readout to the packet.
        delay_ms: f64 = 50.0, Within(0.0, 10_000.0);
        /// Milliseconds by which its time tags are late: a date error.
        tag_error_ms: f64 = 0.0, Within(-1000.0, 1000.0);
        /// Most stars that the tracker on pixels measures in a frame, brightest first.
        stars: Whole<usize> = 40, 4..=200;
        tables:
        /// Errors of a tracker without pixels.
        model: Option<ModelKeys>;
        /// Faults of the telemetry.
        fault: Vec<FaultKeys>;
    }

    /// Errors of a tracker without pixels: 1 sigma, about the sensor's x, y and z (boresight) axes.
    ModelKeys at "tracker_out.model" {
        /// Constant error, arcsec.
        bias_arcsec: [f64; 3] = Numbers([0.0; 3]), Within(-36_000.0, 36_000.0);
        /// Error that grows with time, arcsec per hour.
        drift_arcsec_per_h: [f64; 3] = Numbers([0.0; 3]), Within(-36_000.0, 36_000.0);
        /// Error that is slow over the field, arcsec.
        fov_spatial_arcsec: [f64; 3] = Numbers([1.0, 1.0, 6.0]), Within(0.0, 36_000.0);
        /// Error that is slow over a pixel, arcsec.
        pixel_spatial_arcsec: [f64; 3] = Numbers([1.0, 1.0, 8.0]), Within(0.0, 36_000.0);
        /// Part of the largest displacement by aberration that an attitude keeps, arcsec.
        aberration_residual_arcsec: f64 = 0.0, Within(-36_000.0, 36_000.0);
        /// Temporal noise at rest, arcsec.
        noise_arcsec: [f64; 3] = Numbers([2.0, 2.0, 16.0]), Within(0.0, 36_000.0);
        /// Temporal noise and spatial errors over the sky: even, the same everywhere; stars, by those that the field offers,
        /// with the root mean square over the sky as given.
        noise_over_sky: Word<NoiseMethod> = "even", [("even", NoiseMethod::Even), ("stars", NoiseMethod::Stars)];
        /// Stars that it says it used; of noise_over_sky = "stars" the most that it uses, brightest first.
        stars: Whole<u32> = 20, 4..=200;
        /// Temporal noise that is added, in squares, for each degree per second across the boresight, arcsec: about the
        /// axis of the rate (along the motion of the stars), about the axis across it, about the boresight.
        noise_arcsec_per_deg_s: [f64; 3] = Numbers([0.0; 3]), Within(0.0, 36_000.0);
        /// Milliseconds by which the instant of an attitude is before the time that it states: a measurement date error
        /// whose time tags are right.
        date_error_ms: f64 = 0.0, Within(-1000.0, 1000.0);
        /// Seconds of good conditions before an attitude is found.
        acquisition_s: f64 = 0.0, Within(0.0, 3600.0);
        /// Chance that a frame gives an attitude after that.
        acquisition_probability: f64 = 1.0, Within(0.0, 1.0);
        /// Chance that a frame gives an attitude while it tracks.
        tracking_probability: f64 = 1.0, Within(0.0, 1.0);
        /// Chance that an attitude is false: any attitude, all equally likely.
        false_probability: f64 = 0.0, Within(0.0, 1.0);
        /// Degrees per second up to which an attitude is found.
        acquires_below_deg_s: f64 = 1.0, PositiveUpTo(360.0);
        /// Degrees per second from which it is lost.
        lost_above_deg_s: f64 = 3.0, PositiveUpTo(360.0);
        /// Degrees from the boresight to the Sun below which it is blinded; 0 for never.
        sun_exclusion_deg: f64 = 0.0, Within(0.0, 180.0);
        /// The same for the Moon.
        moon_exclusion_deg: f64 = 0.0, Within(0.0, 180.0);
    }

    /// A fault of the telemetry.
    FaultKeys at "tracker_out.fault" {
        /// Drop loses packets, corrupt turns a bit, freeze repeats the last attitude, invalid knows none, bias turns
        /// it, late delays packets.
        kind: Word<TrackerOutFaultKind> = Needed, [
            ("drop", TrackerOutFaultKind::Drop), ("corrupt", TrackerOutFaultKind::Corrupt),
            ("freeze", TrackerOutFaultKind::Freeze), ("invalid", TrackerOutFaultKind::Invalid),
            ("bias", TrackerOutFaultKind::Bias(DVec3::ZERO)), ("late", TrackerOutFaultKind::Late(Span::ZERO)),
        ];
        /// Seconds after the first exposure at which it begins.
        at_s: f64 = Needed, Within(0.0, 1e7);
        /// Seconds for which it lasts.
        for_s: f64 = Needed, PositiveUpTo(1e7);
        /// Share of the packets that it hits.
        share: f64 = Silent(1.0), Within(0.0, 1.0);
        /// Arcseconds about the sensor's axes, of bias.
        bias_arcsec: [f64; 3] = Optional, Within(-648_000.0, 648_000.0);
        /// Milliseconds by which packets are late.
        late_ms: f64 = Optional, Within(0.0, 10_000.0);
    }
}

/// Reads the telemetry of a bench, whose heads are known.
pub(super) fn check_tracker_outs(
    keys: &[TrackerOutKeys],
    bench: &Bench,
    check: &mut Checker<'_>,
) -> Result<Vec<TrackerOut>> {
    if keys.len() > OUTS_MAX {
        return Err(check.invalid("tracker_out", keys.len(), format!("at most {OUTS_MAX}"), "leave some out"));
    }
    listed(keys, "tracker_out").iter().map(|keys| keys.tracker_out(bench, check)).collect()
}

impl TrackerOutKeys {
    fn tracker_out(&self, bench: &Bench, check: &mut Checker<'_>) -> Result<TrackerOut> {
        taken!(check, self => head, source, protocol, link);
        if head >= bench.head_count() {
            let wanted = format!("a head of the bench: below {}", bench.head_count());
            return Err(self.head().invalid(head, wanted, check));
        }
        let is_can = matches!(protocol, TrackerProtocol::CanOpen { .. });
        let is_stream = matches!(protocol, TrackerProtocol::Nos3 | TrackerProtocol::Sagitta);
        if is_can != link.is_can() && link != LineWord::File {
            let wanted =
                if is_can { "socketcan, slcan_pty, slcan_tcp, bus or file" } else { "a line of bytes or file" };
            return Err(self
                .link()
                .advised("canopen is for CAN, the other protocols are not")
                .invalid("another", wanted, check));
        }
        if is_stream && link == LineWord::Udp {
            let given = self.link().advised("its client is at a serial line: udp has no stream of bytes");
            return Err(given.invalid("\"udp\"", "serial, pty, tcp or file", check));
        }
        if link == LineWord::Bus && !bench.link.is_simulated_can() {
            let given = self.link().advised("its own bus, with slcan_pty or slcan_tcp, goes with any link");
            return Err(given.invalid("\"bus\"", "a bench whose link is a simulated CAN bus", check));
        }
        let source = if source {
            check.unused(&format!("{}.model", self.table()), self.model.is_some(), "source = \"model\"")?;
            TrackerSource::Pixels { most_stars: self.stars().check(check)? }
        } else {
            self.refuse(&["stars"], "source = \"pixels\"", check)?;
            TrackerSource::Model(self.figures(head, bench, check)?)
        };
        if is_stream {
            self.refuse(&["quaternion"], "protocols that leave it open: json, canopen and ccsds", check)?;
        }
        if protocol == TrackerProtocol::Nos3 {
            self.refuse(&["rate_hz"], "protocols that speak unasked", check)?;
        }
        let is_conjugate = !is_stream && self.quaternion().check(check)?;
        Ok(TrackerOut {
            head,
            source,
            protocol: self.checked_protocol(protocol, check)?,
            line: self.line(link, check)?,
            is_conjugate,
            rate_hz: self.rate_hz().optional(check)?,
            delay: self.delay_ms().ms(check)?,
            tag_error: self.tag_error_ms().ms(check)?,
            faults: self.faults(check)?,
        })
    }

    /// Returns the protocol with the keys that belong to it.
    fn checked_protocol(&self, protocol: TrackerProtocol, check: &mut Checker<'_>) -> Result<TrackerProtocol> {
        if !matches!(protocol, TrackerProtocol::CanOpen { .. }) {
            self.refuse(
                &["node_id", "heartbeat_ms", "starts_operational", "pdo_map"],
                "protocol = \"canopen\"",
                check,
            )?;
        }
        if !matches!(protocol, TrackerProtocol::Ccsds { .. }) {
            self.refuse(&["apid"], "protocol = \"ccsds\"", check)?;
        }
        Ok(match protocol {
            TrackerProtocol::Json | TrackerProtocol::Nos3 | TrackerProtocol::Sagitta => protocol,
            TrackerProtocol::CanOpen { .. } => TrackerProtocol::CanOpen {
                node: self.node_id().check(check)?,
                heartbeat_ms: self.heartbeat_ms().check(check)?,
                starts_operational: self.starts_operational().check(check)?,
                pdos: self.pdo_map().check(check)?,
            },
            TrackerProtocol::Ccsds { .. } => TrackerProtocol::Ccsds { apid: self.apid().check(check)? },
        })
    }

    fn line(&self, link: LineWord, check: &mut Checker<'_>) -> Result<TrackerLine> {
        let not_of = |is: bool, names: &[&str], owner: &str, check: &Checker<'_>| {
            if is { Ok(()) } else { self.refuse(names, owner, check) }
        };
        let has_path = matches!(link, LineWord::Serial | LineWord::Pty | LineWord::SlcanPty | LineWord::File);
        let listens = matches!(link, LineWord::Udp | LineWord::Tcp | LineWord::SlcanTcp);
        let has_bus = matches!(link, LineWord::SlcanPty | LineWord::SlcanTcp);
        not_of(has_path, &["path"], "link = \"serial\", \"pty\", \"slcan_pty\" or \"file\"", check)?;
        not_of(listens, &["listen"], "link = \"udp\", \"tcp\" or \"slcan_tcp\"", check)?;
        not_of(link == LineWord::Udp, &["send_to"], "link = \"udp\"", check)?;
        not_of(link == LineWord::Serial, &["baud"], "link = \"serial\"", check)?;
        not_of(link == LineWord::SocketCan, &["interface"], "link = \"socketcan\"", check)?;
        not_of(has_bus, &["bit_rate"], "link = \"slcan_pty\" or \"slcan_tcp\"", check)?;
        let path = |what: &str, check: &Checker<'_>| {
            self.path().raw().map(PathBuf::from).ok_or_else(|| self.path().missing(what, check))
        };
        Ok(match link {
            LineWord::Udp => {
                TrackerLine::Udp { to: named_address(&self.send_to(), check)?, listen: address(&self.listen(), check)? }
            }
            LineWord::Tcp => TrackerLine::Tcp { listen: named_address(&self.listen(), check)? },
            LineWord::Serial => {
                TrackerLine::Serial { path: path("a serial port", check)?, baud: self.baud().check(check)? }
            }
            LineWord::Pty => TrackerLine::Pty { path: path("a name for the link to the pseudo-terminal", check)? },
            LineWord::SocketCan => {
                let interface = self.interface();
                let name = interface.raw().cloned().ok_or_else(|| interface.missing("a CAN interface", check))?;
                TrackerLine::SocketCan { interface: name }
            }
            LineWord::SlcanPty => TrackerLine::SlcanPty {
                path: path("a name for the link to the pseudo-terminal", check)?,
                bit_rate: self.bit_rate().check(check)?,
            },
            LineWord::SlcanTcp => TrackerLine::SlcanTcp {
                listen: named_address(&self.listen(), check)?,
                bit_rate: self.bit_rate().check(check)?,
            },
            LineWord::Bus => TrackerLine::Bus,
            LineWord::File => TrackerLine::File { path: self.file(path("a file", check)?, check)? },
        })
    }

    /// Returns the path of a file below the run's folder which is none of the run's own files.
    fn file(&self, path: PathBuf, check: &Checker<'_>) -> Result<PathBuf> {
        let names: Vec<Component<'_>> = path.components().filter(|part| *part != Component::CurDir).collect();
        let is_below = !names.is_empty() && names.iter().all(|part| matches!(part, Component::Normal(_)));
        let ending = path.extension().and_then(OsStr::to_str).unwrap_or_default();
        let is_own = names.len() == 1 && OWN_ENDINGS.iter().any(|own| own.eq_ignore_ascii_case(ending));
        let wanted = match (is_below, is_own) {
            (false, _) => "a path below the run's folder: relative, without \"..\"",
            (true, true) => "another ending, such as .txt: the run's own files have this one",
            (true, false) => return Ok(path),
        };
        Err(self.path().invalid(path.display(), wanted, check))
    }

    /// Returns the figures of the model; its periods are those of the head's camera.
    fn figures(&self, head: usize, bench: &Bench, check: &mut Checker<'_>) -> Result<ModelParams> {
        let keys = self.model.clone().unwrap_or_default().at(&format!("{}.model", self.table()));
        taken!(check, keys => bias_arcsec, drift_arcsec_per_h, fov_spatial_arcsec, pixel_spatial_arcsec, noise_arcsec);
        taken!(check, keys => aberration_residual_arcsec, noise_over_sky, stars, noise_arcsec_per_deg_s, date_error_ms, acquisition_s);
        taken!(check, keys => acquisition_probability, tracking_probability, false_probability, acquires_below_deg_s, lost_above_deg_s, sun_exclusion_deg, moon_exclusion_deg);
        if lost_above_deg_s < acquires_below_deg_s {
            let wanted = format!("at least acquires_below_deg_s, {acquires_below_deg_s}");
            return Err(keys.lost_above_deg_s().invalid(lost_above_deg_s, wanted, check));
        }
        let camera = bench.of_head(head).camera;
        let pixel_rad = camera.detector.pixel_pitch_um * 1e-3 / camera.optics.focal_length_mm;
        let field_rad = (f64::from(camera.detector.width_px) * pixel_rad).max(LEAST_FIELD_DEG * DEG);
        let arcsec = |three: [f64; 3]| DVec3::from_array(three) * ARCSEC;
        Ok(ModelParams {
            bias_rad: arcsec(bias_arcsec),
            drift_rad_h: arcsec(drift_arcsec_per_h),
            fov_spatial_rad: arcsec(fov_spatial_arcsec),
            field_rad,
            aberration_residual_rad: aberration_residual_arcsec * ARCSEC,
            pixel_spatial_rad: arcsec(pixel_spatial_arcsec),
            pixel_rad,
            noise_rad: arcsec(noise_arcsec),
            noise_method: noise_over_sky,
            noise_rate_s: arcsec(noise_arcsec_per_deg_s) / DEG,
            date_error: Span::from_s(date_error_ms * 1e-3),
            acquisition: Span::from_s(acquisition_s),
            acquisition_probability,
            tracking_probability,
            false_probability,
            acquires_below_rad_s: acquires_below_deg_s * DEG,
            lost_above_rad_s: lost_above_deg_s * DEG,
            sun_exclusion_rad: sun_exclusion_deg * DEG,
            moon_exclusion_rad: moon_exclusion_deg * DEG,
            // A run does not say where the Earth is.
            earth_exclusion_rad: 0.0,
            stars,
        })
    }

    fn faults(&self, check: &mut Checker<'_>) -> Result<Vec<TrackerOutFault>> {
        let place = format!("{}.fault", self.table());
        let read = |keys: FaultKeys| {
            let mut kind = keys.kind().check(check)?;
            let bias_arcsec = keys.bias_arcsec().optional(check)?;
            let late_ms = keys.late_ms().optional(check)?;
            if let TrackerOutFaultKind::Bias(turn_rad) = &mut kind {
                let wanted = || keys.bias_arcsec().missing("arcseconds about x, y and z", check);
                *turn_rad = DVec3::from_array(bias_arcsec.ok_or_else(wanted)?) * ARCSEC;
            } else {
                keys.refuse(&["bias_arcsec"], "kind = \"bias\"", check)?;
            }
            if let TrackerOutFaultKind::Late(late) = &mut kind {
                *late = Span::from_s(late_ms.ok_or_else(|| keys.late_ms().missing("milliseconds", check))? * 1e-3);
            } else {
                keys.refuse(&["late_ms"], "kind = \"late\"", check)?;
            }
            Ok(TrackerOutFault {
                kind,
                at: Span::from_s(keys.at_s().check(check)?),
                lasts: Span::from_s(keys.for_s().check(check)?),
                share: keys.share().check(check)?,
            })
        };
        listed(&self.fault, &place).into_iter().map(read).collect()
    }
}

#[cfg(test)]
#[path = "tracker_out_tests.rs"]
mod tests;
