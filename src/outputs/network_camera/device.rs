//! The camera as clients see it: one datagram of the control port -> an answer and the actions that follow.
//!
//! No sockets, no threads, no clock: sender and time are arguments, so that the whole protocol is tested and fuzzed as
//! a function. Answers never exceed one datagram of 576 bytes. Settings of the stream are published in [`Shared`]
//! before a datagram is answered and before its frames are wanted; the number of the acquisition in them goes up with
//! each start and stop.
//!
//! A command that comes again under the same number is answered as before and carried out once. By broadcast come
//! discovery, actions, and a new address, which this device cannot take: its address is the machine's.

mod access;
mod camera;
mod commander;
mod values;

use crate::network_camera::control::Change;
use crate::network_camera::counters::Counters;
use crate::network_camera::features::{at, own};
use crate::network_camera::gvcp::{self, Action, Command, Malformed, Resend, Status};
use crate::network_camera::gvsp::StreamSettings;
use crate::network_camera::messages::{Channel, Messages};
use crate::network_camera::params::{CommandParams, DeviceParams, Params, SensorParams, XmlForm};
use crate::network_camera::registers::{
    FIRST_XML, HEARTBEAT_MS, Memory, SECOND_XML, XmlView, write_bootstrap, write_features, write_settings, write_urls,
};
use crate::network_camera::{acquisition::Wanted, pixel_format::PixelFormat, proof::Proof, shared::Shared, xml};
use access::Access;
use base::time::{Span, Tai};
use camera::Camera;
use commander::Commander;
use frames::zip_archive::archive;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::sync::Arc;
pub(super) use values::Values;

/// The shortest heartbeat time that a client may ask for, ms.
const HEARTBEAT_LEAST_MS: u32 = 500;
/// The end of the registers with the XML's addresses.
const URLS_END: u32 = at::SECOND_URL + 0x200;
/// Bytes of memory that answer a discovery.
const DISCOVERY_BYTES: usize = 0xF8;
/// Bytes of a word of memory.
const WORD_BYTES: u16 = 4;
/// Bit of the packet size register.
const DO_NOT_FRAGMENT: u32 = 0x4000_0000;
/// Longest pause between packets that is kept, ns.
const DELAY_MOST_NS: u32 = 10_000_000;
/// Bit of the time stamp control register that latches.
const LATCH: u32 = 2;
/// Bit of the GVCP configuration register that turns the PTP clock on.
const PTP_ON: u32 = 0x8_0000;
/// Longest wait for an answer to a message, ms, and most repetitions: bounds on the cost of a client that is gone.
const MESSAGE_TIMEOUT_MOST_MS: u32 = 10_000;
const MESSAGE_RETRIES_MOST: u32 = 20;
/// Sources of triggers.
const SOURCE_SOFTWARE: u32 = 0;
const SOURCE_ACTION: u32 = 1;

/// Sender and time of a datagram.
#[derive(Clone, Copy)]
struct Sent {
    from: SocketAddrV4,
    now: Tai,
}

/// The actions after one datagram. Made once, used again.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Answer {
    /// To be sent back to the sender; empty for nothing.
    pub reply: Vec<u8>,
    /// A datagram of so many bytes, zeros, to be sent from the stream's port: the client measures the size that gets
    /// through.
    pub test_packet: Option<(SocketAddrV4, usize)>,
    /// Packets to be sent again, if the stream goes to this sender.
    pub resend: Option<Resend>,
}

/// The state of the control side.
pub struct Device {
    pub(super) camera: Camera,
    access: Access,
    messages: Messages,
    xml: XmlForm,
    xml_bytes: [usize; 2],
}

impl Device {
    /// Returns a device without a controller.
    ///
    /// # Errors
    /// When the XML cannot be deflated, which memory alone could prevent.
    pub fn new(
        params: &Params,
        sensor: &SensorParams,
        place: DeviceParams,
        commands: Option<CommandParams>,
    ) -> std::io::Result<Self> {
        let text = xml::text(&params.identity, &place, sensor.colours, commands.as_ref());
        let (plain, zipped) = (xml::in_words(&text), archive(&[("starloop.xml", text.as_bytes())])?);
        let xml_bytes = [plain.len(), zipped.len()];
        let (first, second) = if params.xml == XmlForm::Zip { (zipped, plain) } else { (plain, zipped) };
        let mut memory = Memory::new(first, second);
        write_bootstrap(&mut memory, &params.identity, &place);
        let format = params.pixel_format.unwrap_or(PixelFormat::for_bits(sensor.bits));
        write_features(&mut memory, sensor, format);
        if let Some(commands) = &commands {
            write_settings(&mut memory, commands);
        }
        memory.set(at::PACKET_SIZE, DO_NOT_FRAGMENT | params.packet_bytes.min(place.packet_bytes_max) & !3);
        let shared = Arc::new(Shared::new());
        shared.set_temperature_c(sensor.temperature_c);
        let access = Access::new(params, place, Arc::clone(&shared.tally));
        let values = Values::new(memory, sensor.size_px, sensor.colours);
        let camera = Camera::new(values, shared, commands.map(Commander::new));
        camera.publish();
        Ok(Self { camera, access, messages: Messages::new(), xml: params.xml, xml_bytes })
    }

    /// Returns the count of frames that clients still want.
    pub fn wanted(&self) -> Arc<Wanted> {
        Arc::clone(&self.camera.shared.wanted)
    }

    /// Returns the counts so far.
    pub fn counters(&self) -> Counters {
        self.camera.shared.tally.read()
    }

    /// Takes one datagram that came to the control port.
    pub fn answer(&mut self, from: SocketAddrV4, bytes: &[u8], now: Tai, out: &mut Answer) {
        self.take_in(from, bytes, false, now, out);
    }

    /// Takes one datagram that came by broadcast.
    pub fn answer_broadcast(&mut self, from: SocketAddrV4, bytes: &[u8], now: Tai, out: &mut Answer) {
        self.take_in(from, bytes, true, now, out);
    }

    fn take_in(&mut self, from: SocketAddrV4, bytes: &[u8], is_broadcast: bool, now: Tai, out: &mut Answer) {
        out.reply.clear();
        (out.test_packet, out.resend) = (None, None);
        if !self.access.is_neighbour(*from.ip()) {
            return self.camera.shared.tally.strangers.one();
        }
        let request = match gvcp::parse(bytes) {
            Ok(request) => request,
            Err(reason) => return self.camera.shared.tally.malformed(reason),
        };
        if is_broadcast && !request.command.may_be_broadcast() {
            return self.camera.shared.tally.broadcasts_ignored.one();
        }
        self.access.control.take_in(from, now);
        self.camera.take_events(&mut self.messages);
        self.camera.show_status();
        self.camera.values.memory.set_long(own::TEMPERATURE, self.camera.shared.temperature_bits());
        if let Some(reply) = self.access.last_change.answer_to(from, bytes, now) {
            out.reply.extend(reply);
            return self.camera.shared.tally.repeats.one();
        }
        gvcp::begin_answer(request.code, request.id, &mut out.reply);
        let is_silent = self.is_silent(&request.command);
        let is_change = request.command.is_change() && !is_silent;
        let status = self.carry_out(request.command, Sent { from, now }, out);
        if status != Status::Success {
            self.camera.shared.tally.commands_refused.one();
        }
        gvcp::end_answer(status, &mut out.reply);
        if is_silent || !request.wants_answer {
            out.reply.clear();
        }
        // A refused request of an application without control changed nothing, and must not replace one that did.
        if is_change && (status == Status::Success || self.access.control.controller() == Some(from)) {
            self.access.last_change.keep(from, bytes, &out.reply, now);
        }
        self.camera.publish();
    }

    /// Lets time pass: a controller that has been silent for too long loses control, and its stream ends.
    pub fn tick(&mut self, now: Tai) {
        self.camera.take_events(&mut self.messages);
        let asked_ms = self.camera.values.memory.word(at::HEARTBEAT_MS);
        let is_proven = self.access.is_controller_proven();
        let timeout = Span::from_ms(i64::from(if is_proven { asked_ms } else { asked_ms.min(HEARTBEAT_MS) }));
        if self.access.control.time_out(now, timeout) {
            self.camera.shared.tally.controllers_timed_out.one();
            self.access.last_change.forget();
            self.release();
            self.camera.publish();
        }
    }

    /// Ends the stream of an acquisition whose receiver is gone.
    pub(super) fn end_stream_of(&mut self, acquisition: u32) {
        if self.camera.number == acquisition {
            self.camera.stop();
            self.camera.publish();
        }
    }

    /// Returns how frames are to be sent from now on.
    pub fn stream(&self) -> StreamSettings {
        self.camera.stream()
    }

    /// Returns true for requests that are never answered: those to send again, and those for other devices.
    fn is_silent(&self, command: &Command<'_>) -> bool {
        match command {
            Command::Resend(_) => true,
            Command::Action(action) => {
                !is_meant(&self.camera.values.memory, *action) || self.access.control.controller().is_none()
            }
            Command::ForceAddress { mac, .. } => *mac != self.access.place.mac,
            Command::Discovery
            | Command::ReadRegisters(_)
            | Command::WriteRegisters(_)
            | Command::ReadMemory { .. }
            | Command::WriteMemory { .. }
            | Command::Bad(_) => false,
        }
    }

    fn carry_out(&mut self, command: Command<'_>, sent: Sent, out: &mut Answer) -> Status {
        let done = match command {
            Command::Bad(reason) => {
                self.camera.shared.tally.malformed(reason);
                let is_unknown = reason == Malformed::UnknownCommand;
                Err(if is_unknown { Status::NotImplemented } else { Status::InvalidParameter })
            }
            Command::Discovery => {
                self.camera.shared.tally.discoveries.one();
                let may_reply = self.access.may_reply_at_length(sent.from, sent.now);
                let known = may_reply.and_then(|()| self.camera.values.memory.read(0, DISCOVERY_BYTES));
                known.map(|bytes| out.reply.extend(bytes))
            }
            Command::Resend(resend) => {
                out.resend = Some(resend);
                Ok(())
            }
            Command::ReadRegisters(addresses) => self.read_registers(addresses, sent, &mut out.reply),
            Command::ReadMemory { address, bytes } => self.read_memory(address, bytes, sent, &mut out.reply),
            Command::WriteRegisters(pairs) => {
                let pairs = pairs.as_chunks::<2>().0.iter().map(|[address, value]| (number(address), number(value)));
                self.write_all(pairs, 1, sent, out)
            }
            Command::WriteMemory { address, words } => {
                let addresses = (0..u32::MAX).step_by(4).map(|step| address.wrapping_add(step));
                self.write_all(addresses.zip(words.iter().map(number)), WORD_BYTES, sent, out)
            }
            Command::ForceAddress { mac, address, mask } => self.access.force_address(mac, address, mask),
            Command::Action(action) => self.act(action, sent.now),
        };
        done.err().unwrap_or(Status::Success)
    }

    fn read_registers(&mut self, addresses: &[[u8; 4]], sent: Sent, reply: &mut Vec<u8>) -> Result<(), Status> {
        self.access.control.may_read(sent.from, &self.access.proof)?;
        for address in addresses {
            let place = self.place_in_memory(number(address), sent)?;
            reply.extend(self.camera.values.memory.read(place, 4)?);
        }
        Ok(())
    }

    fn read_memory(&mut self, address: u32, bytes: usize, sent: Sent, reply: &mut Vec<u8>) -> Result<(), Status> {
        self.access.control.may_read(sent.from, &self.access.proof)?;
        let place = self.place_in_memory(address, sent)?;
        self.access.may_reply_at_length(sent.from, sent.now)?;
        let data = self.camera.values.memory.read(place, bytes)?;
        reply.extend(address.to_be_bytes());
        reply.extend(data);
        Ok(())
    }

    /// Returns the place behind an address that a client reads; the XML is at another address for each client.
    fn place_in_memory(&mut self, address: u32, Sent { from, now }: Sent) -> Result<u32, Status> {
        let (proof, memory) = (&mut self.access.proof, &mut self.camera.values.memory);
        let view = XmlView { run_number: proof.run_number(), shift: proof.shift(from) };
        if (at::FIRST_URL..URLS_END).contains(&address) {
            write_urls(memory, self.xml, self.xml_bytes, view);
        }
        if !Proof::is_shown(address) {
            return if address >= FIRST_XML { Err(Status::InvalidAddress) } else { Ok(address) };
        }
        let place = address.wrapping_sub(view.shift);
        if place < FIRST_XML || memory.read(place, 4).is_err() {
            self.camera.shared.tally.xml_misses.one();
            proof.miss(from, now);
            return Err(Status::InvalidAddress);
        }
        if place == FIRST_XML || place == SECOND_XML {
            proof.accept(from, self.access.control.controller(), now);
        }
        Ok(place)
    }

    /// Writes in order up to the first word that is refused. The answer's index counts `index_step` for each word
    /// written: WRITEREG_ACK counts registers, WRITEMEM_ACK counts bytes.
    fn write_all(
        &mut self,
        pairs: impl Iterator<Item = (u32, u32)>,
        index_step: u16,
        sent: Sent,
        out: &mut Answer,
    ) -> Result<(), Status> {
        let mut index = 0_u16;
        let mut done = Ok(());
        for (address, value) in pairs {
            done = self.write(address, value, sent, out);
            if done.is_err() {
                break;
            }
            index += index_step;
        }
        out.reply.extend([0, 0]);
        out.reply.extend(index.to_be_bytes());
        done
    }

    fn write(&mut self, address: u32, value: u32, sent: Sent, out: &mut Answer) -> Result<(), Status> {
        // The ranges below hold whole words only.
        if !address.is_multiple_of(4) {
            return Err(Status::BadAlignment);
        }
        if address == at::CONTROL {
            return self.write_control(value, sent);
        }
        self.access.control.may_write(sent.from)?;
        let may_receive = || value == 0 || self.access.may_receive(Ipv4Addr::from_bits(value), sent.from);
        let kept = match address {
            at::USER_NAME..=at::USER_NAME_LAST => value,
            at::ACTION_DEVICE_KEY | at::ACTION_GROUP_KEY | at::ACTION_GROUP_MASK => value,
            at::HEARTBEAT_MS => value.clamp(HEARTBEAT_LEAST_MS, self.access.heartbeat_most_ms()),
            at::STREAM_PORT | at::MESSAGE_PORT => value & 0xFFFF,
            at::STREAM_ADDRESS | at::MESSAGE_ADDRESS if may_receive() => value,
            at::STREAM_ADDRESS | at::MESSAGE_ADDRESS => return Err(Status::InvalidParameter),
            at::PACKET_SIZE => return self.access.set_packet_size(value, &mut self.camera.values.memory, out),
            at::PACKET_DELAY => value.min(DELAY_MOST_NS),
            at::MESSAGE_TIMEOUT => value.min(MESSAGE_TIMEOUT_MOST_MS),
            at::MESSAGE_RETRIES => value.min(MESSAGE_RETRIES_MOST),
            at::TIMESTAMP_CONTROL => {
                if value & LATCH != 0 {
                    let now = self.camera.bench_time(sent.now);
                    self.camera.values.memory.set_long(at::TIMESTAMP, u64::try_from(now.ns()).unwrap_or_default());
                }
                return Ok(());
            }
            at::GVCP_CONFIGURATION => {
                self.camera.enable_ptp(value & PTP_ON != 0);
                return Ok(());
            }
            own::SENSOR_WIDTH..own::END => {
                self.access.must_be_proven()?;
                return match address {
                    own::EVENT_SELECTOR | own::EVENT_NOTIFICATION => {
                        self.camera.write_event(address, value, &mut self.messages)
                    }
                    own::DEVICE_RESET => self.reset(sent.now),
                    _ => self.camera.write(address, value, sent.now),
                };
            }
            _ => return self.camera.values.memory.read(address, 4).and(Err(Status::WriteProtect)),
        };
        self.camera.values.memory.set(address, kept);
        Ok(())
    }

    fn write_control(&mut self, value: u32, Sent { from, now }: Sent) -> Result<(), Status> {
        let change = self.access.control.request(from, value, now, &self.access.proof);
        match change {
            Ok(Change::Taken) => self.camera.shared.tally.controllers_accepted.one(),
            Ok(Change::Displaced) => {
                self.camera.shared.tally.controllers_accepted.one();
                self.access.last_change.forget();
                self.release();
            }
            Ok(Change::Released) => self.release(),
            Ok(Change::Kept) => {}
            Err(Status::AccessDenied) => self.camera.shared.tally.controllers_refused.one(),
            Err(_) => {}
        }
        if change.is_ok() {
            let controller = self.access.control.controller();
            let (port, address) = controller.map_or((0, 0), |to| (to.port().into(), to.ip().to_bits()));
            for (register, value) in
                [(at::CONTROL, value), (at::CONTROLLER_PORT, port), (at::CONTROLLER_ADDRESS, address)]
            {
                self.camera.values.memory.set(register, value);
            }
        }
        change.map(|_| ())
    }

    /// Returns where messages go; `None` as long as the client has not said, or has not proven its address.
    fn message_receiver(&self) -> Option<SocketAddrV4> {
        let port =
            u16::try_from(self.camera.values.memory.word(at::MESSAGE_PORT) & 0xFFFF).ok().filter(|port| *port != 0)?;
        let address = Ipv4Addr::from_bits(self.camera.values.memory.word(at::MESSAGE_ADDRESS));
        let is_known = !address.is_unspecified() && self.access.is_controller_proven();
        is_known.then(|| SocketAddrV4::new(address, port))
    }

    /// True when events are wanted: the control thread then looks for them often.
    pub(super) fn has_messages(&self) -> bool {
        self.messages.is_open() && self.message_receiver().is_some()
    }

    /// Writes the message that is to be sent now into `out`; its receiver, `None` for none.
    pub fn message(&mut self, now: Tai, out: &mut Vec<u8>) -> Option<SocketAddrV4> {
        let receiver = self.message_receiver()?;
        let timeout = Span::from_ms(self.camera.values.memory.word(at::MESSAGE_TIMEOUT).into());
        let channel = Channel { timeout, retries: self.camera.values.memory.word(at::MESSAGE_RETRIES) };
        self.messages.next(channel, now, &self.camera.shared.tally, out).then_some(receiver)
    }

    /// Takes a datagram from the port that messages are sent from.
    pub fn answer_to_message(&mut self, from: SocketAddrV4, bytes: &[u8]) {
        if self.message_receiver().is_some_and(|receiver| receiver.ip() == from.ip()) {
            self.messages.acknowledge(bytes);
        }
    }

    fn act(&mut self, action: Action, now: Tai) -> Result<(), Status> {
        if !is_meant(&self.camera.values.memory, action) || !self.access.is_controller_proven() {
            return Ok(());
        }
        let now = self.camera.bench_time(now);
        let Some(at_ns) = action.at_ns else { return self.camera.trigger(SOURCE_ACTION, now) };
        let at = Tai::from_ns(i64::try_from(at_ns).map_err(|_| Status::InvalidParameter)?);
        if self.camera.commander.is_none() {
            return Err(Status::InvalidParameter);
        }
        if at < now {
            return Err(Status::ActionLate);
        }
        self.camera.trigger(SOURCE_ACTION, at)
    }

    /// Ends the acquisition and loads the default set. Control ends with it.
    fn reset(&mut self, now: Tai) -> Result<(), Status> {
        self.camera.stop();
        self.camera.load_user_set(own::USER_SET_DEFAULT, now)?;
        self.access.control.release();
        self.release();
        Ok(())
    }

    /// Ends all that the controller began.
    fn release(&mut self) {
        self.camera.stop();
        self.messages.clear();
        for address in [
            at::CONTROL,
            at::CONTROLLER_PORT,
            at::CONTROLLER_ADDRESS,
            at::MESSAGE_PORT,
            at::MESSAGE_ADDRESS,
            at::STREAM_PORT,
            at::STREAM_ADDRESS,
            own::PARAMETERS_LOCKED,
            own::EVENT_NOTIFICATION,
        ] {
            self.camera.values.memory.set(address, 0);
        }
        self.camera.values.memory.set(at::HEARTBEAT_MS, HEARTBEAT_MS);
    }
}

fn number(bytes: &[u8; 4]) -> u32 {
    u32::from_be_bytes(*bytes)
}

/// Returns true for an action that has a key of this device and one of its groups.
fn is_meant(memory: &Memory, action: Action) -> bool {
    action.device_key == memory.word(at::ACTION_DEVICE_KEY)
        && action.group_key == memory.word(at::ACTION_GROUP_KEY)
        && action.group_mask & memory.word(at::ACTION_GROUP_MASK) != 0
}
