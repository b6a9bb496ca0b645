//! The PTP clock of this machine, as `ptp4l` reports it over its local socket.
//!
//! The camera neither starts nor steers a clock. While PtpEnable is on, the control thread asks once a second for four
//! data sets (GET of management messages, IEEE 1588-2008 clause 15, domain 0) and takes in what has come, without
//! waiting. A clock that does not answer for [`PATIENCE`] is faulty. Of several ports the one that follows a master
//! counts.
//!
//! Proven by the tests below and `hil_scripts/tests/test_camera_ptp.py` (`ptp4l` of linuxptp, and a simulated clock).

use base::time::{Span, Tai};
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// States of a port with their names in the naming convention; the numbers are IEEE 1588's.
pub(super) const STATES: [(&str, u32); 9] = [
    ("Initializing", INITIALIZING),
    ("Faulty", FAULTY),
    ("Disabled", DISABLED),
    ("Listening", 4),
    ("PreMaster", 5),
    ("Master", 6),
    ("Passive", 7),
    ("Uncalibrated", 8),
    ("Slave", SLAVE),
];
pub(super) const INITIALIZING: u32 = 1;
pub(super) const FAULTY: u32 = 2;
pub(super) const DISABLED: u32 = 3;
pub(super) const SLAVE: u32 = 9;

/// Accuracies of a clock with their names in the naming convention; the numbers are IEEE 1588's.
pub(super) const ACCURACIES: [(&str, u32); 20] = [
    ("Within25ns", ACCURACY_LEAST),
    ("Within100ns", 0x21),
    ("Within250ns", 0x22),
    ("Within1us", 0x23),
    ("Within2p5us", 0x24),
    ("Within10us", 0x25),
    ("Within25us", 0x26),
    ("Within100us", 0x27),
    ("Within250us", 0x28),
    ("Within1ms", 0x29),
    ("Within2p5ms", 0x2A),
    ("Within10ms", 0x2B),
    ("Within25ms", 0x2C),
    ("Within100ms", 0x2D),
    ("Within250ms", 0x2E),
    ("Within1s", 0x2F),
    ("Within10s", 0x30),
    ("GreaterThan10s", ACCURACY_MOST),
    ("Unknown", ACCURACY_UNKNOWN),
    ("Reserved", 0xFF),
];
const ACCURACY_LEAST: u32 = 0x20;
const ACCURACY_MOST: u32 = 0x31;
const ACCURACY_UNKNOWN: u32 = 0xFE;
const ACCURACY_RESERVED: u32 = 0xFF;

/// From one question to the next.
const PERIOD: Span = Span::from_ms(1_000);
/// Silence after which a clock is faulty.
const PATIENCE: Span = Span::from_ms(3_000);
/// Bytes of a header, and where the parts of a management message begin.
const HEADER_BYTES: usize = 34;
const ACTION_AT: usize = HEADER_BYTES + 12;
const TLV_AT: usize = HEADER_BYTES + 14;
const ID_AT: usize = TLV_AT + 4;
const DATA_AT: usize = ID_AT + 2;
const MANAGEMENT: u8 = 0xD;
const VERSION: u8 = 2;
const RESPONSE: u8 = 2;
const MANAGEMENT_TLV: u16 = 1;
/// Data sets that are asked for.
const DEFAULT: u16 = 0x2000;
const CURRENT: u16 = 0x2001;
const PARENT: u16 = 0x2002;
const PORT: u16 = 0x2004;
/// Answers that are read in a row.
const IN_A_ROW: usize = 64;
/// Longer than any answer that is read.
const ANSWER_BYTES: usize = 1500;

/// State of the clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PtpData {
    pub(super) state: u32,
    pub(super) accuracy: u32,
    /// Time of the clock less that of its master, ns.
    pub(super) offset_ns: i64,
    /// Mean delay of the path to the master, ns.
    pub(super) delay_ns: i64,
    pub(super) clock_id: u64,
    pub(super) parent_id: u64,
    pub(super) grandmaster_id: u64,
}

impl PtpData {
    /// Returns data without a known clock, in a PTP state.
    pub(super) const fn in_state(state: u32) -> Self {
        let (offset_ns, delay_ns, clock_id, parent_id, grandmaster_id) = (0, 0, 0, 0, 0);
        Self { state, accuracy: ACCURACY_UNKNOWN, offset_ns, delay_ns, clock_id, parent_id, grandmaster_id }
    }
}

/// Client that asks the PTP daemon.
pub(super) struct PtpClient {
    path: PathBuf,
    socket: Option<(UnixDatagram, TempDir)>,
    sequence: u16,
    /// Times of the first question, the last question and the last answer.
    began: Option<Tai>,
    asked: Option<Tai>,
    answered: Option<Tai>,
    /// Port states of the answers to the last question: the largest.
    best_state: u32,
    data: PtpData,
}

impl PtpClient {
    /// Asks nothing yet. `path` is the socket of `ptp4l`.
    pub(super) fn new(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            socket: None,
            sequence: 0,
            began: None,
            asked: None,
            answered: None,
            best_state: 0,
            data: PtpData::in_state(DISABLED),
        }
    }

    /// Asks no more.
    pub(super) fn rest(&mut self) {
        (self.socket, self.began, self.asked, self.answered) = (None, None, None, None);
    }

    /// Asks when it is time, and reads the answers that have come. Returns the state.
    pub(super) fn poll(&mut self, now: Tai) -> PtpData {
        if self.began.is_none() {
            (self.began, self.data) = (Some(now), PtpData::in_state(INITIALIZING));
        }
        self.take_answers(now);
        if self.asked.is_none_or(|asked| now - asked >= PERIOD) {
            (self.asked, self.best_state) = (Some(now), 0);
            self.ask();
        }
        let last = self.answered.or(self.began).unwrap_or(now);
        if now - last > PATIENCE {
            self.data = PtpData::in_state(FAULTY);
        }
        self.data
    }

    fn ask(&mut self) {
        if self.socket.is_none() {
            self.socket = open().ok();
        }
        for id in [DEFAULT, CURRENT, PARENT, PORT] {
            self.sequence = self.sequence.wrapping_add(1);
            let question = question(id, self.sequence);
            if let Some((socket, _)) = &self.socket {
                // Without a daemon no answer comes, which shows in the state.
                let _ = socket.send_to(&question, &self.path); // a lost question shows as a missing answer
            }
        }
    }

    fn take_answers(&mut self, now: Tai) {
        let mut buffer = [0; ANSWER_BYTES];
        for _ in 0..IN_A_ROW {
            let received = self.socket.as_ref().and_then(|(socket, _)| socket.recv(&mut buffer).ok());
            let Some(bytes) = received else { break };
            if self.take(&buffer[..bytes]).is_some() {
                self.answered = Some(now);
            }
        }
    }

    /// Takes one answer; `None` for other datagrams.
    fn take(&mut self, answer: &[u8]) -> Option<()> {
        let half = |at: usize| Some(u16::from_be_bytes(answer.get(at..at + 2)?.try_into().ok()?));
        let is_answer = answer.first()? & 0xF == MANAGEMENT
            && answer.get(ACTION_AT)? & 0xF == RESPONSE
            && half(TLV_AT)? == MANAGEMENT_TLV;
        if !is_answer {
            return None;
        }
        let data = answer.get(DATA_AT..)?;
        let long = |at: usize| Some(u64::from_be_bytes(data.get(at..at + 8)?.try_into().ok()?));
        // A time interval counts 2^-16 ns.
        let interval_ns = |at: usize| Some(i64::from_be_bytes(data.get(at..at + 8)?.try_into().ok()?) >> 16);
        match half(ID_AT)? {
            DEFAULT => (self.data.accuracy, self.data.clock_id) = (accuracy(*data.get(6)?), long(10)?),
            CURRENT => (self.data.offset_ns, self.data.delay_ns) = (interval_ns(2)?, interval_ns(10)?),
            PARENT => (self.data.parent_id, self.data.grandmaster_id) = (long(0)?, long(24)?),
            PORT => {
                let state = u32::from(*data.get(10)?);
                self.best_state = self.best_state.max(state).min(SLAVE);
                self.data.state = self.best_state;
            }
            _ => return None,
        }
        Some(())
    }
}

/// Returns a socket that answers come to, by its name in a folder of its own: a name that also a clock in another
/// network namespace can answer to. Both go together.
fn open() -> std::io::Result<(UnixDatagram, TempDir)> {
    let folder = tempfile::Builder::new().prefix("starloop_ptp_").tempdir()?;
    let socket = UnixDatagram::bind(folder.path().join("answers"))?;
    socket.set_nonblocking(true)?;
    Ok((socket, folder))
}

fn accuracy(code: u8) -> u32 {
    let code = u32::from(code);
    if (ACCURACY_LEAST..=ACCURACY_MOST).contains(&code) || code == ACCURACY_UNKNOWN { code } else { ACCURACY_RESERVED }
}

/// Returns a GET of a data set of all ports.
fn question(id: u16, sequence: u16) -> [u8; DATA_AT] {
    let mut bytes = [0; DATA_AT];
    (bytes[0], bytes[1]) = (MANAGEMENT, VERSION);
    let length = u16::try_from(DATA_AT).unwrap_or_default();
    let mut put = |at: usize, half: u16| bytes[at..at + 2].copy_from_slice(&half.to_be_bytes());
    put(2, length);
    put(28, 1);
    put(30, sequence);
    put(TLV_AT, MANAGEMENT_TLV);
    put(TLV_AT + 2, 2);
    put(ID_AT, id);
    // Control field and message interval of management messages; any clock, any port.
    (bytes[32], bytes[33]) = (4, 0x7F);
    bytes[HEADER_BYTES..HEADER_BYTES + 10].fill(0xFF);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(id: u16, data: &[u8]) -> Vec<u8> {
        let mut bytes = question(id, 7).to_vec();
        bytes[ACTION_AT] = RESPONSE;
        bytes.extend(data);
        bytes
    }

    #[test]
    fn question_by_hand() {
        let wanted = [
            &[0x0D, 2, 0, 54, 0, 0, 0, 0][..],
            &[0; 20],
            &[0, 1, 0, 9, 4, 0x7F],
            &[0xFF; 10],
            &[0, 0, 0, 0, 0, 1, 0, 2, 0x20, 0x04],
        ];
        assert_eq!(question(PORT, 9)[..], wanted.concat());
    }

    #[test]
    fn answers_are_read_and_others_are_not() {
        let mut client = PtpClient::new(Path::new("/nowhere"));
        let id = |last| [1, 2, 3, 0xFF, 0xFE, 4, 5, last];
        let default = [&[1, 0, 0, 1, 128, 248, 0x21, 0, 0, 128][..], &id(6), &[0, 0]].concat();
        let current =
            [&1_u16.to_be_bytes()[..], &(-1500_i64 << 16).to_be_bytes(), &(777_i64 << 16).to_be_bytes()].concat();
        let parent = [&id(8)[..], &[0; 16], &id(9)].concat();
        let port = |state| [&id(6)[..], &[0, 1, state], &[0; 15]].concat();
        for (id, data) in [
            (DEFAULT, default),
            (CURRENT, current),
            (PARENT, parent),
            (PORT, port(6)),
            (PORT, port(9)),
            (PORT, port(4)),
        ] {
            let whole = answer(id, &data);
            assert_eq!(client.take(&whole), Some(()), "{id:x}");
            let mut wrong = whole.clone();
            wrong[ACTION_AT] = 0;
            assert_eq!(client.take(&wrong), None, "a question");
            assert_eq!(client.take(&whole[..DATA_AT]), None, "without its data");
        }
        let number = |last| u64::from_be_bytes(id(last));
        let wanted = PtpData {
            state: SLAVE,
            accuracy: 0x21,
            offset_ns: -1500,
            delay_ns: 777,
            clock_id: number(6),
            parent_id: number(8),
            grandmaster_id: number(9),
        };
        assert_eq!(client.data, wanted);
    }

    #[test]
    fn clock_that_does_not_answer_is_faulty_after_a_while() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ptp4l");
        let clock = UnixDatagram::bind(&path).unwrap();
        clock.set_nonblocking(true).unwrap();
        let mut client = PtpClient::new(&path);
        let at = |ms| Tai::from_ns(0) + Span::from_ms(ms);
        assert_eq!(client.poll(at(0)).state, INITIALIZING);
        let mut question = [0; 100];
        let (bytes, who) = clock.recv_from(&mut question).unwrap();
        assert_eq!((bytes, question[ID_AT..DATA_AT].to_vec()), (DATA_AT, vec![0x20, 0]));
        clock.send_to_addr(&answer(PORT, &[&[0; 10][..], &[9], &[0; 15]].concat()), &who).unwrap();
        assert_eq!((client.poll(at(10)).state, client.poll(at(3_010)).state), (SLAVE, SLAVE));
        assert_eq!(client.poll(at(3_011)).state, FAULTY);
        assert_eq!(
            (0..100).map_while(|_| clock.recv(&mut question).ok()).count(),
            3 + 4,
            "four questions a second at most"
        );
        client.rest();
        assert_eq!(client.poll(at(4_000)).state, INITIALIZING);
    }
}
