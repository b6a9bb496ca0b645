//! The receiving side of HELLO, INFO, RUN and STOP.
//!
//! A retry with the token of the last command gets the same answer and changes nothing. RUN needs a HELLO of the same
//! major version first.

use crate::message::{Command, Identity, Info, Rates, Refusal, Reply, Request, Response};
use crate::{ATTITUDE_CONVENTION, version};

/// What the answering side knows of itself and of its peer.
#[derive(Debug, Clone, Copy)]
pub struct Handshake {
    dbc_crc32: u32,
    rates: Rates,
    agreed: bool,
    running: bool,
    last: Option<(Command, Response)>,
}

impl Handshake {
    /// Before the first HELLO.
    #[must_use]
    pub const fn new(dbc_crc32: u32, rates: Rates) -> Self {
        Self { dbc_crc32, rates, agreed: false, running: false, last: None }
    }

    /// True between an accepted RUN and the next STOP or refused HELLO.
    #[must_use]
    pub const fn is_running(&self) -> bool {
        self.running
    }

    /// The one answer to a command.
    pub fn answer(&mut self, command: &Command) -> Response {
        if let Some((last, response)) = self.last
            && last == *command
        {
            return response;
        }
        let reply = self.reply(command.request);
        let response = Response { token: command.token, reply };
        self.last = Some((*command, response));
        response
    }

    fn reply(&mut self, request: Request) -> Reply {
        let refused = |reason| Reply::Refused { opcode: request.opcode(), reason };
        match request {
            Request::Hello(peer) => {
                self.agreed = peer.major == version::MAJOR;
                self.running &= self.agreed;
                if self.agreed { Reply::Hello(identity()) } else { refused(Refusal::WrongMajor) }
            }
            Request::Info { page: 0 } => Reply::Info(Info::DbcCrc32(self.dbc_crc32)),
            Request::Info { page: 1 } => Reply::Info(Info::Rates(self.rates)),
            Request::Info { .. } => refused(Refusal::UnknownPage),
            Request::Run => {
                self.running = self.agreed;
                if self.agreed { Reply::Run } else { refused(Refusal::NoHandshake) }
            }
            Request::Stop => {
                self.running = false;
                Reply::Stop
            }
            Request::Unknown { .. } => refused(Refusal::UnknownOpcode),
        }
    }
}

fn identity() -> Identity {
    Identity { version: version::CURRENT, capabilities: 0, attitude_convention: ATTITUDE_CONVENTION }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::version::Version;

    fn ask(handshake: &mut Handshake, token: u8, request: Request) -> Reply {
        let response = handshake.answer(&Command { token, request });
        assert_eq!(response.token, token);
        response.reply
    }

    fn new() -> Handshake {
        Handshake::new(7, Rates { attitude_hz: 100, jitter_hz: 1000 })
    }

    #[test]
    fn run_needs_a_hello_of_the_same_major() {
        let mut handshake = new();
        let refused = |opcode, reason| Reply::Refused { opcode, reason };
        assert_eq!(ask(&mut handshake, 1, Request::Run), refused(3, Refusal::NoHandshake));
        let other = Request::Hello(Version { major: version::MAJOR + 1, minor: 0 });
        assert_eq!(ask(&mut handshake, 2, other), refused(1, Refusal::WrongMajor));
        assert_eq!(ask(&mut handshake, 3, Request::Run), refused(3, Refusal::NoHandshake));
        let later_minor = Request::Hello(Version { major: version::MAJOR, minor: 9 });
        assert_eq!(ask(&mut handshake, 4, later_minor), Reply::Hello(identity()));
        assert_eq!(ask(&mut handshake, 5, Request::Run), Reply::Run);
        assert!(handshake.is_running());
        assert_eq!(ask(&mut handshake, 6, other), refused(1, Refusal::WrongMajor));
        assert!(!handshake.is_running(), "a peer of another major is not rendered");
    }

    #[test]
    fn a_retry_gets_the_same_answer_and_changes_nothing() {
        let mut handshake = new();
        ask(&mut handshake, 1, Request::Hello(version::CURRENT));
        let run = Command { token: 2, request: Request::Run };
        let first = handshake.answer(&run);
        handshake.running = false;
        assert_eq!(handshake.answer(&run), first);
        assert!(!handshake.is_running(), "answered from memory, not done twice");
        ask(&mut handshake, 3, Request::Run);
        assert!(handshake.is_running(), "a new token is a new command");
    }

    #[test]
    fn facts_come_by_page_and_unknown_things_are_refused_by_name() {
        let mut handshake = new();
        assert_eq!(ask(&mut handshake, 1, Request::Info { page: 0 }), Reply::Info(Info::DbcCrc32(7)));
        let no_page = Reply::Refused { opcode: 2, reason: Refusal::UnknownPage };
        assert_eq!(ask(&mut handshake, 2, Request::Info { page: 2 }), no_page);
        let no_opcode = Reply::Refused { opcode: 99, reason: Refusal::UnknownOpcode };
        assert_eq!(ask(&mut handshake, 3, Request::Unknown { opcode: 99 }), no_opcode);
    }
}
