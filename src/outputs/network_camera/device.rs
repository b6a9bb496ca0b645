//! The camera as clients see it: one datagram of the control port -> an answer and the actions that follow.
//!
//! No sockets, no threads, no clock: sender and time are arguments, so that the whole protocol is tested and fuzzed as
//! a function. Answers never exceed one datagram of 576 bytes. Settings of the stream are published in [`Shared`]
//! before a datagram is answered and before its frames are wanted; the number of the acquisition in them goes up with
//! each start and stop.
//!
//! A command that comes again under the same number is answered as before and carried out once. By broadcast come
//! discovery, actions, and a new address, which this device cannot take: its address is the machine's.

// By its path: the fuzz package takes this file in as a module of another folder.
#[path = "device/commanded.rs"]
mod commanded;
#[path = "device/features.rs"]
mod features;
#[path = "device/messages.rs"]
mod messages;
#[path = "device/ptp.rs"]
mod ptp;
#[path = "device/receivers.rs"]
mod receivers;
#[path = "device/regions.rs"]
mod regions;
#[path = "device/user_sets.rs"]
mod user_sets;

use crate::network_camera::acquisition::{Acquisition, Wanted};
use crate::network_camera::control::{Change, Control};
use crate::network_camera::counters::{Counters, Tally};
use crate::network_camera::first_values::{
    HEARTBEAT_MS, XmlView, write_bootstrap, write_features, write_settings, write_urls,
};
use crate::network_camera::gvcp::{self, Action, Command, Malformed, Resend, Status};
use crate::network_camera::gvsp::{IP_UDP_BYTES, StreamSettings};
use crate::network_camera::params::{CommandParams, DeviceParams, PACKET_BYTES_MIN, Params, SensorParams, XmlForm};
use crate::network_camera::ptp::{DISABLED, PtpData};
use crate::network_camera::registers::{FIRST_XML, Memory, SECOND_XML, at, own};
use crate::network_camera::{chunk, xml};
use crate::network_camera::{
    messages::Messages, pixel_format::PixelFormat, proof::Proof, regions::RegionSet, repeats::LastChange,
    shared::Shared, user_sets::UserSet,
};
use base::bayer::BayerPattern;
use base::time::{Span, Tai};
use frames::camera_control::Regions;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::sync::Arc;

/// Bounds of the heartbeat time that a client may ask for, ms.
const HEARTBEAT_LEAST_MS: u32 = 500;
const HEARTBEAT_MOST_MS: u32 = 600_000;
/// The longest when other machines reach the camera: a client that is gone, or was forged, blocks others no longer.
const HEARTBEAT_MOST_EXPOSED_MS: u32 = 30_000;
/// The end of the registers with the XML's addresses.
const URLS_END: u32 = at::SECOND_URL + 0x200;
/// Bytes of memory that answer a discovery.
const DISCOVERY_BYTES: usize = 0xF8;
/// Bytes of a word of memory.
const WORD_BYTES: u16 = 4;
/// Bits of the packet size register.
const FIRE_TEST: u32 = 0x8000_0000;
const DO_NOT_FRAGMENT: u32 = 0x4000_0000;
/// Longest pause between packets that is kept, ns.
const DELAY_MOST_NS: u32 = 10_000_000;
/// Bit of the time stamp control register that latches.
const LATCH: u32 = 2;
/// Bit of the GVCP configuration register that turns the PTP clock on.
const PTP_ON: u32 = 0x8_0000;
/// Every field of the truth.
const ALL_CHUNKS: u32 = (1 << chunk::FIELDS.len()) - 1;
/// Sources of triggers.
const SOURCE_SOFTWARE: u32 = 0;
const SOURCE_ACTION: u32 = 1;

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
    memory: Memory,
    control: Control,
    acquisition: Acquisition,
    shared: Arc<Shared>,
    last_change: LastChange,
    proof: Proof,
    xml: XmlForm,
    xml_bytes: [usize; 2],
    place: DeviceParams,
    allow_other_receivers: bool,
    /// Of the present acquisition or the pause before the next.
    number: u32,
    /// Fields of the truth that are wanted, one bit each.
    chunks: u32,
    /// Address and value of the high half of a number that was written last; the low half makes it hold.
    high_half: (u32, u32),
    /// How clients command the camera that makes the frames; `None`: they only read its settings.
    commands: Option<CommandParams>,
    colours: Option<BayerPattern>,
    regions: RegionSet,
    /// Regions that the commanded camera reads out.
    read_out: Regions,
    /// The frame rate was set for regions that the camera does not read out yet, or is lower because of them.
    rate_waits: bool,
    user_sets: Vec<UserSet>,
    messages: Messages,
    /// State of the machine's PTP clock.
    ptp: PtpData,
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
        let plain = xml::plain(&params.identity, &place, sensor.colours, commands.as_ref());
        let zipped = xml::zipped(&params.identity, &place, sensor.colours, commands.as_ref())?;
        let lengths = [plain.len(), zipped.len()];
        let (first, second) = if params.xml == XmlForm::Zip { (zipped, plain) } else { (plain, zipped) };
        let mut memory = Memory::new(first, second);
        write_bootstrap(&mut memory, &params.identity, &place);
        let format = params.pixel_format.unwrap_or(PixelFormat::for_bits(sensor.bits));
        write_features(&mut memory, sensor, format);
        if let Some(commands) = &commands {
            write_settings(&mut memory, commands);
        }
        let shared = Shared::new();
        shared.set_temperature_c(sensor.temperature_c);
        memory.set(at::PACKET_SIZE, DO_NOT_FRAGMENT | params.packet_bytes.min(place.packet_bytes_max) & !3);
        let mut device = Self {
            memory,
            control: Control::default(),
            acquisition: Acquisition::default(),
            shared: Arc::new(shared),
            last_change: LastChange::default(),
            proof: Proof::default(),
            xml: params.xml,
            xml_bytes: lengths,
            place,
            allow_other_receivers: params.allow_other_receivers,
            number: 1,
            chunks: ALL_CHUNKS,
            high_half: (0, 0),
            commands,
            colours: sensor.colours,
            regions: RegionSet::new(sensor.size_px),
            read_out: Regions::WHOLE,
            rate_waits: false,
            user_sets: Vec::new(),
            messages: Messages::new(),
            ptp: PtpData::in_state(DISABLED),
        };
        device.show_region();
        device.user_sets = device.first_user_sets();
        device.note_ptp(device.ptp);
        device.latch_ptp();
        device.measure_payload();
        device.publish();
        Ok(device)
    }

    /// Returns the count of frames that clients still want.
    pub fn wanted(&self) -> Arc<Wanted> {
        Arc::clone(&self.shared.wanted)
    }

    pub(super) fn shared(&self) -> Arc<Shared> {
        Arc::clone(&self.shared)
    }

    fn tally(&self) -> &Tally {
        &self.shared.tally
    }

    /// Returns the counts so far.
    pub fn counters(&self) -> Counters {
        self.tally().read()
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
        if !self.is_neighbour(*from.ip()) {
            return self.tally().strangers.one();
        }
        let request = match gvcp::parse(bytes) {
            Ok(request) => request,
            Err(reason) => return self.tally().malformed(reason),
        };
        if is_broadcast && !request.command.may_be_broadcast() {
            return self.tally().broadcasts_ignored.one();
        }
        self.control.take_in(from, now);
        self.take_events();
        self.memory.set_long(own::TEMPERATURE, self.shared.temperature_bits());
        if let Some(reply) = self.last_change.answer_to(from, bytes, now) {
            out.reply.extend(reply);
            return self.tally().repeats.one();
        }
        gvcp::begin_answer(request.code, request.id, &mut out.reply);
        let is_silent = self.is_silent(&request.command);
        let is_change = request.command.is_change() && !is_silent;
        let status = self.carry_out(request.command, from, now, out);
        if status != Status::Success {
            self.tally().commands_refused.one();
        }
        gvcp::end_answer(status, &mut out.reply);
        if is_silent || !request.wants_answer {
            out.reply.clear();
        }
        // A refused request of an application without control changed nothing, and must not replace one that did.
        if is_change && (status == Status::Success || self.control.controller() == Some(from)) {
            self.last_change.keep(from, bytes, &out.reply, now);
        }
        self.publish();
    }

    /// Lets time pass: a controller that has been silent for too long loses control, and its stream ends.
    pub fn tick(&mut self, now: Tai) {
        self.take_events();
        let asked_ms = self.memory.word(at::HEARTBEAT_MS);
        let is_proven = self.is_controller_proven();
        let timeout = Span::from_ms(i64::from(if is_proven { asked_ms } else { asked_ms.min(HEARTBEAT_MS) }));
        if self.control.time_out(now, timeout) {
            self.tally().controllers_timed_out.one();
            self.last_change.forget();
            self.release();
            self.publish();
        }
    }

    /// Ends the stream of an acquisition whose receiver is gone.
    pub(super) fn end_stream_of(&mut self, acquisition: u32) {
        if self.number == acquisition {
            self.stop();
            self.publish();
        }
    }

    fn is_controller_proven(&self) -> bool {
        self.control.controller().is_some_and(|controller| self.proof.is_proven(controller))
    }

    /// Refuses what changes frames or sends more than was received, as long as the controller's address is not proven.
    fn must_be_proven(&self) -> Result<(), Status> {
        if self.is_controller_proven() {
            return Ok(());
        }
        self.tally().unproven_refused.one();
        Err(Status::AccessDenied)
    }

    /// Refuses an answer that is longer than its request once a client without a proof has received many.
    fn may_reply_at_length(&mut self, from: SocketAddrV4, now: Tai) -> Result<(), Status> {
        if self.proof.may_reply_at_length(from, now) {
            return Ok(());
        }
        self.tally().unproven_refused.one();
        Err(Status::AccessDenied)
    }

    /// Returns how frames are to be sent from now on.
    pub fn stream(&self) -> StreamSettings {
        let word = |address| self.memory.word(address);
        let port = u16::try_from(word(at::STREAM_PORT) & 0xFFFF).unwrap_or_default();
        let destination = SocketAddrV4::new(Ipv4Addr::from_bits(word(at::STREAM_ADDRESS)), port);
        let is_open = port != 0 && !destination.ip().is_unspecified() && self.acquisition.is_started();
        StreamSettings {
            acquisition: self.number,
            destination: is_open.then_some(destination),
            packet_bytes: usize::try_from(word(at::PACKET_SIZE) & 0xFFFF).unwrap_or_default(),
            delay_ns: word(at::PACKET_DELAY),
            format: self.format(),
            colours: self.colours,
            pattern: self.pattern(),
            regions: self.regions.present(),
            with_chunks: self.has_chunks(),
        }
    }

    /// Publishes the settings before the answer is sent and before frames are wanted, so that later frames use them.
    fn publish(&self) {
        let settings = self.stream();
        if settings != self.shared.settings() {
            self.shared.publish(settings);
        }
    }

    fn is_neighbour(&self, other: Ipv4Addr) -> bool {
        let mask = self.place.mask.to_bits();
        self.place.address.to_bits() & mask == other.to_bits() & mask
    }

    /// Returns true for requests that are never answered: those to send again, and those for other devices.
    fn is_silent(&self, command: &Command<'_>) -> bool {
        match command {
            Command::Resend(_) => true,
            Command::Action(action) => !self.is_meant(*action) || self.control.controller().is_none(),
            Command::ForceAddress { mac, .. } => *mac != self.place.mac,
            Command::Discovery
            | Command::ReadRegisters(_)
            | Command::WriteRegisters(_)
            | Command::ReadMemory { .. }
            | Command::WriteMemory { .. }
            | Command::Bad(_) => false,
        }
    }

    fn carry_out(&mut self, command: Command<'_>, from: SocketAddrV4, now: Tai, out: &mut Answer) -> Status {
        let done = match command {
            Command::Bad(reason) => {
                self.tally().malformed(reason);
                let is_unknown = reason == Malformed::UnknownCommand;
                Err(if is_unknown { Status::NotImplemented } else { Status::InvalidParameter })
            }
            Command::Discovery => {
                self.tally().discoveries.one();
                let may_reply = self.may_reply_at_length(from, now);
                may_reply.and_then(|()| self.memory.read(0, DISCOVERY_BYTES)).map(|bytes| out.reply.extend(bytes))
            }
            Command::Resend(resend) => {
                out.resend = Some(resend);
                Ok(())
            }
            Command::ReadRegisters(addresses) => self.read_registers(addresses, from, now, &mut out.reply),
            Command::ReadMemory { address, bytes } => self.read_memory(address, bytes, from, now, &mut out.reply),
            Command::WriteRegisters(pairs) => {
                let pairs = pairs.as_chunks::<2>().0.iter().map(|[address, value]| (number(address), number(value)));
                self.write_all(pairs, 1, from, now, out)
            }
            Command::WriteMemory { address, words } => {
                let addresses = (0..u32::MAX).step_by(4).map(|step| address.wrapping_add(step));
                self.write_all(addresses.zip(words.iter().map(number)), WORD_BYTES, from, now, out)
            }
            Command::ForceAddress { mac, address, mask } => self.force_address(mac, address, mask),
            Command::Action(action) => self.act(action, now),
        };
        done.err().unwrap_or(Status::Success)
    }

    fn read_registers(
        &mut self,
        addresses: &[[u8; 4]],
        from: SocketAddrV4,
        now: Tai,
        reply: &mut Vec<u8>,
    ) -> Result<(), Status> {
        self.control.may_read(from, &self.proof)?;
        for address in addresses {
            let place = self.place_in_memory(number(address), from, now)?;
            reply.extend(self.memory.read(place, 4)?);
        }
        Ok(())
    }

    fn read_memory(
        &mut self,
        address: u32,
        bytes: usize,
        from: SocketAddrV4,
        now: Tai,
        reply: &mut Vec<u8>,
    ) -> Result<(), Status> {
        self.control.may_read(from, &self.proof)?;
        let place = self.place_in_memory(address, from, now)?;
        self.may_reply_at_length(from, now)?;
        let data = self.memory.read(place, bytes)?;
        reply.extend(address.to_be_bytes());
        reply.extend(data);
        Ok(())
    }

    /// Returns the place behind an address that a client reads; the XML is at another address for each client.
    fn place_in_memory(&mut self, address: u32, from: SocketAddrV4, now: Tai) -> Result<u32, Status> {
        let view = XmlView { run_number: self.proof.run_number(), shift: self.proof.shift(from) };
        if (at::FIRST_URL..URLS_END).contains(&address) {
            write_urls(&mut self.memory, self.xml, self.xml_bytes, view);
        }
        if !Proof::is_shown(address) {
            return if address >= FIRST_XML { Err(Status::InvalidAddress) } else { Ok(address) };
        }
        let place = address.wrapping_sub(view.shift);
        if place < FIRST_XML || self.memory.read(place, 4).is_err() {
            self.tally().xml_misses.one();
            self.proof.miss(from, now);
            return Err(Status::InvalidAddress);
        }
        if place == FIRST_XML || place == SECOND_XML {
            self.proof.accept(from, self.control.controller(), now);
        }
        Ok(place)
    }

    /// Refuses a change of the machine's address; asking for the present one does no harm.
    fn force_address(&self, mac: [u8; 6], address: Ipv4Addr, mask: Ipv4Addr) -> Result<(), Status> {
        if mac != self.place.mac || (address, mask) == (self.place.address, self.place.mask) {
            return Ok(());
        }
        let is_taken = self.control.controller().is_some();
        Err(if is_taken { Status::AccessDenied } else { Status::NotImplemented })
    }

    /// Writes in order up to the first word that is refused. The answer's index counts `index_step` for each word
    /// written: WRITEREG_ACK counts registers, WRITEMEM_ACK counts bytes.
    fn write_all(
        &mut self,
        pairs: impl Iterator<Item = (u32, u32)>,
        index_step: u16,
        from: SocketAddrV4,
        now: Tai,
        out: &mut Answer,
    ) -> Result<(), Status> {
        let mut index = 0_u16;
        let mut done = Ok(());
        for (address, value) in pairs {
            done = self.write(address, value, from, now, out);
            if done.is_err() {
                break;
            }
            index += index_step;
        }
        out.reply.extend([0, 0]);
        out.reply.extend(index.to_be_bytes());
        done
    }

    fn write(
        &mut self,
        address: u32,
        value: u32,
        from: SocketAddrV4,
        now: Tai,
        out: &mut Answer,
    ) -> Result<(), Status> {
        // The ranges below hold whole words only.
        if !address.is_multiple_of(4) {
            return Err(Status::BadAlignment);
        }
        if address == at::CONTROL {
            return self.write_control(value, from, now);
        }
        self.control.may_write(from)?;
        match address {
            at::USER_NAME..=at::USER_NAME_LAST => self.memory.set(address, value),
            at::HEARTBEAT_MS => self.memory.set(address, value.clamp(HEARTBEAT_LEAST_MS, self.heartbeat_most_ms())),
            at::TIMESTAMP_CONTROL => {
                if value & LATCH != 0 {
                    let now = self.bench_time(now);
                    self.memory.set_long(at::TIMESTAMP, u64::try_from(now.ns()).unwrap_or_default());
                }
            }
            at::ACTION_DEVICE_KEY | at::ACTION_GROUP_KEY | at::ACTION_GROUP_MASK => self.memory.set(address, value),
            at::GVCP_CONFIGURATION => return self.write_ptp(own::PTP_ENABLE, u32::from(value & PTP_ON != 0)),
            at::MESSAGE_PORT..=at::MESSAGE_SOURCE_PORT => return self.write_message_channel(address, value, from),
            at::STREAM_PORT..=at::STREAM_SOURCE_PORT => return self.write_stream(address, value, from, out),
            own::SENSOR_WIDTH..own::END => {
                self.must_be_proven()?;
                return self.write_feature(address, value, now);
            }
            _ => return self.memory.read(address, 4).and(Err(Status::WriteProtect)),
        }
        Ok(())
    }

    fn heartbeat_most_ms(&self) -> u32 {
        if self.place.address.is_loopback() { HEARTBEAT_MOST_MS } else { HEARTBEAT_MOST_EXPOSED_MS }
    }

    fn write_control(&mut self, value: u32, from: SocketAddrV4, now: Tai) -> Result<(), Status> {
        let change = self.control.request(from, value, now, &self.proof);
        match change {
            Ok(Change::Taken) => self.tally().controllers_accepted.one(),
            Ok(Change::Displaced) => {
                self.tally().controllers_accepted.one();
                self.last_change.forget();
                self.release();
            }
            Ok(Change::Released) => self.release(),
            Ok(Change::Kept) => {}
            Err(Status::AccessDenied) => self.tally().controllers_refused.one(),
            Err(_) => {}
        }
        if change.is_ok() {
            let controller = self.control.controller();
            self.memory.set(at::CONTROL, value);
            self.memory.set(at::CONTROLLER_PORT, controller.map_or(0, |controller| controller.port().into()));
            self.memory.set(at::CONTROLLER_ADDRESS, controller.map_or(0, |controller| controller.ip().to_bits()));
        }
        change.map(|_| ())
    }

    fn write_stream(&mut self, address: u32, value: u32, from: SocketAddrV4, out: &mut Answer) -> Result<(), Status> {
        match address {
            at::STREAM_PORT => self.memory.set(address, value & 0xFFFF),
            at::PACKET_SIZE => return self.write_packet_size(value, out),
            at::PACKET_DELAY => self.memory.set(address, value.min(DELAY_MOST_NS)),
            at::STREAM_ADDRESS if value == 0 || self.may_receive(Ipv4Addr::from_bits(value), from) => {
                self.memory.set(address, value);
            }
            at::STREAM_ADDRESS => return Err(Status::InvalidParameter),
            _ => return self.memory.read(address, 4).and(Err(Status::WriteProtect)),
        }
        Ok(())
    }

    /// Sets the packet size within the limit of the interface. A test packet is sent only at a size that can get
    /// through, and only to a client that has proven its address.
    fn write_packet_size(&mut self, value: u32, out: &mut Answer) -> Result<(), Status> {
        if value & FIRE_TEST != 0 {
            self.must_be_proven()?;
        }
        let asked = value & 0xFFFF;
        let size = asked.min(self.place.packet_bytes_max).max(PACKET_BYTES_MIN) & !3;
        self.memory.set(at::PACKET_SIZE, value & DO_NOT_FRAGMENT | size);
        let port = u16::try_from(self.memory.word(at::STREAM_PORT)).unwrap_or_default();
        let to = SocketAddrV4::new(Ipv4Addr::from_bits(self.memory.word(at::STREAM_ADDRESS)), port);
        if value & FIRE_TEST != 0 && asked <= self.place.packet_bytes_max && port != 0 && !to.ip().is_unspecified() {
            let bytes = usize::try_from(asked).unwrap_or_default().saturating_sub(IP_UDP_BYTES);
            out.test_packet = Some((to, bytes));
        }
        Ok(())
    }

    fn is_meant(&self, action: Action) -> bool {
        action.device_key == self.memory.word(at::ACTION_DEVICE_KEY)
            && action.group_key == self.memory.word(at::ACTION_GROUP_KEY)
            && action.group_mask & self.memory.word(at::ACTION_GROUP_MASK) != 0
    }

    fn act(&mut self, action: Action, now: Tai) -> Result<(), Status> {
        if !self.is_meant(action) || !self.is_controller_proven() {
            return Ok(());
        }
        let Some(at_ns) = action.at_ns else { return self.trigger(SOURCE_ACTION, self.bench_time(now)) };
        let at = Tai::from_ns(i64::try_from(at_ns).map_err(|_| Status::InvalidParameter)?);
        if self.commands.is_none() {
            return Err(Status::InvalidParameter);
        }
        if at < self.bench_time(now) {
            return Err(Status::ActionLate);
        }
        self.trigger(SOURCE_ACTION, at)
    }

    /// Ends all that the controller began.
    fn release(&mut self) {
        self.stop();
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
            self.memory.set(address, 0);
        }
        self.memory.set(at::HEARTBEAT_MS, HEARTBEAT_MS);
    }
}

fn number(bytes: &[u8; 4]) -> u32 {
    u32::from_be_bytes(*bytes)
}
