//! The receiving side of HELLO, INFO, RUN, STOP, APPLY, TRIGGER, CAMERA and CAMERA_TRIGGER.
//!
//! A retry with the token of the last command gets the same answer and changes nothing. RUN, APPLY, TRIGGER and the
//! camera's commands need a HELLO of the same major version first. Without the capability of parameter tables, APPLY is
//! an unknown opcode, as in 1.0; without that of triggers, TRIGGER is one, as in 1.1; without that of cameras, theirs
//! are, as in 1.3. A peer gets the refusal codes of its own minor version ([`crate::message::Refusal::for_minor`]).

use crate::message::{
    CameraSet, CameraSetting, CameraTrigger, CameraTriggered, Command, Identity, Info, Rates, Refusal, Reply, Request,
    Response, Table, Trigger, Triggered, capability,
};
use crate::tables::TableStore;
use crate::{ATTITUDE_CONVENTION, version};

/// State of the answering side: its identity, and what it knows of its peer.
#[derive(Debug, Clone, Copy)]
pub struct Handshake {
    dbc_crc32: u32,
    rates: Rates,
    capabilities: u16,
    agreed: bool,
    /// Minor version of the peer, from its last HELLO.
    peer_minor: u8,
    running: bool,
    last: Option<(Command, Response)>,
}

/// The response to send, and the change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Answer {
    /// The one response to the command.
    pub response: Response,
    /// The change made by this command; `None` for a retry, a refusal, and a state that it already was in.
    pub did: Option<Did>,
}

/// A change that a command made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Did {
    /// Rendering is wanted from now on.
    Run,
    /// Rendering is no longer wanted: STOP, or a HELLO of another major version.
    Stop,
    /// Other rows of this table are in effect, or none.
    Applied(Table),
    /// A trigger was taken.
    Triggered(Triggered),
    /// A camera took a setting or a trigger.
    Camera,
}

/// Takes in the commands that go beyond the handshake. It is called once per command, not for a retry.
pub trait Takes {
    /// Takes a trigger in.
    ///
    /// # Errors
    /// Why not.
    fn trigger(&mut self, _trigger: Trigger) -> Result<Triggered, Refusal> {
        Err(Refusal::UnknownOpcode)
    }

    /// Takes a setting of a camera in.
    ///
    /// # Errors
    /// Why not.
    fn camera(&mut self, _setting: CameraSetting) -> Result<(), Refusal> {
        Err(Refusal::UnknownOpcode)
    }

    /// Takes a trigger of a camera in; returns true when its instant has passed.
    ///
    /// # Errors
    /// Why not.
    fn camera_trigger(&mut self, _trigger: CameraTrigger) -> Result<bool, Refusal> {
        Err(Refusal::UnknownOpcode)
    }
}

/// Takes triggers only.
struct ByFiring<F>(Option<F>);

impl<F: FnOnce(Trigger) -> Result<Triggered, Refusal>> Takes for ByFiring<F> {
    fn trigger(&mut self, trigger: Trigger) -> Result<Triggered, Refusal> {
        self.0.take().map_or(Err(Refusal::UnknownOpcode), |fire| fire(trigger))
    }
}

impl Handshake {
    /// Returns the state before the first HELLO; [`crate::DBC_CRC32`] is this crate's own file.
    pub const fn new(dbc_crc32: u32, rates: Rates) -> Self {
        Self { dbc_crc32, rates, capabilities: 0, agreed: false, peer_minor: 0, running: false, last: None }
    }

    /// Returns the same with [`capability`] bits to report; without this call they are zero.
    #[must_use]
    pub const fn with_capabilities(mut self, capabilities: u16) -> Self {
        self.capabilities = capabilities;
        self
    }

    /// Returns true between an accepted RUN and the next STOP or refused HELLO.
    pub const fn is_running(&self) -> bool {
        self.running
    }

    /// Returns the one answer to a command, by a side that takes no triggers; APPLY puts uploaded rows of `tables` into
    /// effect.
    pub fn answer(&mut self, command: &Command, tables: &mut TableStore) -> Answer {
        self.answer_with(command, tables, |_| Err(Refusal::UnknownOpcode))
    }

    /// Returns the same by a side that takes triggers, if it says so in its capabilities: `fire` takes one in, or says
    /// why not. It is not called again for a retry.
    pub fn answer_with(
        &mut self,
        command: &Command,
        tables: &mut TableStore,
        fire: impl FnOnce(Trigger) -> Result<Triggered, Refusal>,
    ) -> Answer {
        self.answer_by(command, tables, &mut ByFiring(Some(fire)))
    }

    /// Returns the same by a side that takes what its capabilities name: `takes` takes it in, or says why not.
    pub fn answer_by(&mut self, command: &Command, tables: &mut TableStore, takes: &mut impl Takes) -> Answer {
        if let Some((last, response)) = self.last
            && last == *command
        {
            return Answer { response, did: None };
        }
        let was_running = self.running;
        let reply = self.reply(command.request, tables, takes);
        let response = Response { token: command.token, reply };
        self.last = Some((*command, response));
        Answer { response, did: self.did(&reply, was_running) }
    }

    fn did(&self, reply: &Reply, was_running: bool) -> Option<Did> {
        match (reply, was_running, self.running) {
            (Reply::Applied(applied), ..) => Some(Did::Applied(applied.table)),
            (Reply::Triggered(triggered), ..) => Some(Did::Triggered(*triggered)),
            (Reply::CameraSet(_) | Reply::CameraTriggered(_), ..) => Some(Did::Camera),
            (_, false, true) => Some(Did::Run),
            (_, true, false) => Some(Did::Stop),
            _ => None,
        }
    }

    fn reply(&mut self, request: Request, tables: &mut TableStore, takes: &mut impl Takes) -> Reply {
        let minor = self.peer_minor;
        let refused = |reason| Reply::Refused { opcode: request.opcode(), reason };
        match request {
            Request::Hello(peer) => {
                self.agreed = peer.major == version::MAJOR;
                self.peer_minor = peer.minor;
                self.running &= self.agreed;
                if self.agreed { Reply::Hello(self.identity()) } else { refused(Refusal::WrongMajor) }
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
            Request::Camera(_) | Request::CameraTrigger(_) if self.capabilities & capability::CAMERA == 0 => {
                refused(Refusal::UnknownOpcode)
            }
            Request::Apply { .. } if self.capabilities & capability::PARAMETER_TABLES == 0 => {
                refused(Refusal::UnknownOpcode)
            }
            Request::Trigger(_) if self.capabilities & capability::TRIGGERS == 0 => refused(Refusal::UnknownOpcode),
            Request::Apply { .. } | Request::Trigger(_) | Request::Camera(_) | Request::CameraTrigger(_)
                if !self.agreed =>
            {
                refused(Refusal::NoHandshake)
            }
            Request::Apply { table, rows, crc, seed } => {
                tables.apply(table, rows, crc, seed).map_or_else(refused, Reply::Applied)
            }
            Request::Trigger(trigger) => {
                takes.trigger(trigger).map_or_else(|reason| refused(reason.for_minor(minor)), Reply::Triggered)
            }
            Request::Camera(setting) => match takes.camera(setting) {
                Ok(()) => Reply::CameraSet(CameraSet { kind: setting.kind, head: setting.head }),
                Err(reason) => refused(reason.for_minor(minor)),
            },
            Request::CameraTrigger(trigger) => match takes.camera_trigger(trigger) {
                Ok(is_late) => Reply::CameraTriggered(CameraTriggered { head: trigger.head, is_late }),
                Err(reason) => refused(reason.for_minor(minor)),
            },
            Request::Unknown { .. } => refused(Refusal::UnknownOpcode),
        }
    }

    const fn identity(&self) -> Identity {
        Identity {
            version: version::CURRENT,
            capabilities: self.capabilities,
            attitude_convention: ATTITUDE_CONVENTION,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::version::Version;

    fn ask(handshake: &mut Handshake, token: u8, request: Request) -> Reply {
        let answer = handshake.answer(&Command { token, request }, &mut TableStore::new());
        assert_eq!(answer.response.token, token);
        answer.response.reply
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
        assert_eq!(ask(&mut handshake, 4, later_minor), Reply::Hello(handshake.identity()));
        assert_eq!(ask(&mut handshake, 5, Request::Run), Reply::Run);
        assert!(handshake.is_running());
        assert_eq!(ask(&mut handshake, 6, other), refused(1, Refusal::WrongMajor));
        assert!(!handshake.is_running(), "a peer of another major is not rendered");
    }

    #[test]
    fn a_retry_gets_the_same_answer_and_changes_nothing() {
        let (mut handshake, mut tables) = (new(), TableStore::new());
        ask(&mut handshake, 1, Request::Hello(version::CURRENT));
        let run = Command { token: 2, request: Request::Run };
        let first = handshake.answer(&run, &mut tables);
        assert_eq!(first.did, Some(Did::Run));
        handshake.running = false;
        assert_eq!(handshake.answer(&run, &mut tables), Answer { did: None, ..first });
        assert!(!handshake.is_running(), "answered from memory, not done twice");
        ask(&mut handshake, 3, Request::Run);
        assert!(handshake.is_running(), "a new token is a new command");
        let stop = Command { token: 4, request: Request::Stop };
        assert_eq!(handshake.answer(&stop, &mut tables).did, Some(Did::Stop));
    }

    #[test]
    fn a_trigger_needs_capability_and_hello_and_a_retry_is_not_fired_twice() {
        let (mut fired, mut tables) = (0, TableStore::new());
        let trigger = Trigger { number: 7, at_us: 0 };
        let mut say = |handshake: &mut Handshake, token, request| {
            let fire = |given: Trigger| {
                fired += 1;
                let late = Triggered { number: given.number, is_late: true };
                if given.at_us == 9 { Err(Refusal::TriggerTime) } else { Ok(late) }
            };
            let answer = handshake.answer_with(&Command { token, request }, &mut tables, fire);
            (answer.response.reply, answer.did, fired)
        };
        let refused = |reason| Reply::Refused { opcode: 6, reason };
        let mut without = new();
        say(&mut without, 1, Request::Hello(version::CURRENT));
        let unknown = (refused(Refusal::UnknownOpcode), None, 0);
        assert_eq!(say(&mut without, 2, Request::Trigger(trigger)), unknown, "as 1.1 says");
        let mut with = new().with_capabilities(capability::TRIGGERS);
        assert_eq!(say(&mut with, 1, Request::Trigger(trigger)), (refused(Refusal::NoHandshake), None, 0));
        say(&mut with, 2, Request::Hello(version::CURRENT));
        let late = Triggered { number: 7, is_late: true };
        let done = Reply::Triggered(late);
        assert_eq!(say(&mut with, 3, Request::Trigger(trigger)), (done, Some(Did::Triggered(late)), 1));
        assert_eq!(say(&mut with, 3, Request::Trigger(trigger)), (done, None, 1), "a retry");
        assert_eq!(say(&mut with, 4, Request::Trigger(trigger)), (done, Some(Did::Triggered(late)), 2), "a new token");
        let odd = Request::Trigger(Trigger { at_us: 9, ..trigger });
        assert_eq!(say(&mut with, 5, odd), (refused(Refusal::TriggerTime), None, 3));
        let answer = with.answer(&Command { token: 6, request: Request::Trigger(trigger) }, &mut TableStore::new());
        assert_eq!(answer.response.reply, refused(Refusal::UnknownOpcode), "triggers are not implemented");
    }

    #[test]
    fn peer_of_an_earlier_minor_gets_no_refusal_code_it_lacks() {
        for (minor, wanted) in [(2, Refusal::UnknownOpcode), (3, Refusal::UnknownTrigger), (9, Refusal::UnknownTrigger)]
        {
            let (mut handshake, mut tables) = (new().with_capabilities(capability::TRIGGERS), TableStore::new());
            ask(&mut handshake, 1, Request::Hello(Version { major: version::MAJOR, minor }));
            let command = Command { token: 2, request: Request::Trigger(Trigger { number: 7, at_us: 0 }) };
            let answer = handshake.answer_with(&command, &mut tables, |_| Err(Refusal::UnknownTrigger));
            assert_eq!(answer.response.reply, Reply::Refused { opcode: 6, reason: wanted }, "HELLO 1.{minor}");
        }
        for reason in [Refusal::CameraRange, Refusal::CameraUnsupported, Refusal::UnknownHead, Refusal::CameraFull] {
            assert_eq!((reason.for_minor(3), reason.for_minor(4)), (Refusal::UnknownOpcode, reason));
        }
        // Negative control: the codes of 1.2 are sent as they are.
        assert!(Refusal::ALL.iter().take(10).all(|reason| reason.for_minor(0) == *reason));
    }

    /// Counts what it takes; refuses head 3.
    #[derive(Default)]
    struct Cameras {
        settings: u32,
        triggers: u32,
    }

    impl Takes for Cameras {
        fn camera(&mut self, setting: CameraSetting) -> Result<(), Refusal> {
            self.settings += 1;
            if setting.head == 3 { Err(Refusal::UnknownHead) } else { Ok(()) }
        }

        fn camera_trigger(&mut self, trigger: CameraTrigger) -> Result<bool, Refusal> {
            self.triggers += 1;
            Ok(!trigger.is_at_once())
        }
    }

    #[test]
    fn camera_commands_need_capability_and_hello_and_are_done_once() {
        let setting = |head| Request::Camera(CameraSetting { kind: 1, head, value: 5000 });
        let trigger = |at_us| Request::CameraTrigger(CameraTrigger { head: 255, at_us });
        let refused = |opcode, reason| Reply::Refused { opcode, reason };
        let (mut cameras, mut tables) = (Cameras::default(), TableStore::new());
        let mut say = |handshake: &mut Handshake, token, request| {
            let answer = handshake.answer_by(&Command { token, request }, &mut tables, &mut cameras);
            (answer.response.reply, answer.did, (cameras.settings, cameras.triggers))
        };
        let mut without = new().with_capabilities(capability::TRIGGERS);
        say(&mut without, 1, Request::Hello(version::CURRENT));
        assert_eq!(say(&mut without, 2, setting(0)), (refused(7, Refusal::UnknownOpcode), None, (0, 0)), "as 1.3 says");
        assert_eq!(say(&mut without, 3, trigger(0)), (refused(8, Refusal::UnknownOpcode), None, (0, 0)));
        let mut with = new().with_capabilities(capability::CAMERA);
        assert_eq!(say(&mut with, 1, setting(0)), (refused(7, Refusal::NoHandshake), None, (0, 0)));
        say(&mut with, 2, Request::Hello(version::CURRENT));
        let set = Reply::CameraSet(CameraSet { kind: 1, head: 0 });
        assert_eq!(say(&mut with, 3, setting(0)), (set, Some(Did::Camera), (1, 0)));
        assert_eq!(say(&mut with, 3, setting(0)), (set, None, (1, 0)), "a retry");
        assert_eq!(say(&mut with, 4, setting(3)), (refused(7, Refusal::UnknownHead), None, (2, 0)));
        let late = Reply::CameraTriggered(CameraTriggered { head: 255, is_late: true });
        assert_eq!(say(&mut with, 5, trigger(9)), (late, Some(Did::Camera), (2, 1)));
        let no_one = with.answer(&Command { token: 6, request: setting(0) }, &mut TableStore::new());
        assert_eq!(no_one.response.reply, refused(7, Refusal::UnknownOpcode), "without anyone to take it");
    }

    #[test]
    fn a_hello_of_another_major_reports_that_it_stopped() {
        let (mut handshake, mut tables) = (new(), TableStore::new());
        ask(&mut handshake, 1, Request::Hello(version::CURRENT));
        ask(&mut handshake, 2, Request::Run);
        let other = Request::Hello(Version { major: version::MAJOR + 1, minor: 0 });
        assert_eq!(handshake.answer(&Command { token: 3, request: other }, &mut tables).did, Some(Did::Stop));
        assert_eq!(handshake.answer(&Command { token: 4, request: other }, &mut tables).did, None, "so already");
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
