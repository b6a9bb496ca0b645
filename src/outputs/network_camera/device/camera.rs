//! The camera behind the registers: writes to its features, the acquisition that they start and stop, user sets, and
//! the state of the machine's PTP clock.

use super::{PTP_ON, SOURCE_SOFTWARE, commander::Commander, commander::is_commanded, values::Values};
use crate::network_camera::acquisition::{Acquisition, Mode};
use crate::network_camera::features::{USER_SETS, at, own};
use crate::network_camera::messages::Messages;
use crate::network_camera::ptp::{DISABLED, INITIALIZING, PtpData, SLAVE};
use crate::network_camera::{
    feature::Feature, gvcp::Status, gvsp::StreamSettings, registers::ONE_IN_MOST, shared::Shared,
    test_pattern::TestPattern, user_sets::UserSet, xml::offset_step,
};
use base::time::Tai;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::sync::Arc;

pub(in crate::network_camera) struct Camera {
    pub(super) values: Values,
    pub(in crate::network_camera) shared: Arc<Shared>,
    acquisition: Acquisition,
    /// Of the present acquisition or the pause before the next.
    pub(super) number: u32,
    /// `None`: clients only read the settings.
    pub(super) commander: Option<Commander>,
    user_sets: Vec<UserSet>,
    ptp: PtpData,
}

impl Camera {
    pub(super) fn new(values: Values, shared: Arc<Shared>, commander: Option<Commander>) -> Self {
        let first = UserSet::of(&values, commander.is_some());
        let user_sets = vec![first; USER_SETS.len()];
        let (acquisition, ptp) = (Acquisition::default(), PtpData::in_state(DISABLED));
        let mut camera = Self { values, shared, acquisition, number: 1, commander, user_sets, ptp };
        camera.note_ptp(camera.ptp);
        camera.latch_ptp();
        camera
    }

    /// Returns how frames are to be sent from now on.
    pub(super) fn stream(&self) -> StreamSettings {
        let word = |address| self.values.memory.word(address);
        let port = u16::try_from(word(at::STREAM_PORT) & 0xFFFF).unwrap_or_default();
        let destination = SocketAddrV4::new(Ipv4Addr::from_bits(word(at::STREAM_ADDRESS)), port);
        let is_open = port != 0 && !destination.ip().is_unspecified() && self.acquisition.is_started();
        StreamSettings {
            acquisition: self.number,
            destination: is_open.then_some(destination),
            packet_bytes: usize::try_from(word(at::PACKET_SIZE) & 0xFFFF).unwrap_or_default(),
            delay_ns: word(at::PACKET_DELAY),
            format: self.values.format(),
            colours: self.values.colours,
            pattern: TestPattern::from_number(word(own::TEST_PATTERN)).unwrap_or_default(),
            regions: self.values.regions.present(),
            with_chunks: self.values.has_chunks(),
        }
    }

    /// Publishes the settings before the answer is sent and before frames are wanted, so that later frames use them.
    pub(super) fn publish(&self) {
        let settings = self.stream();
        if settings != self.shared.settings() {
            self.shared.publish(settings);
        }
    }

    /// Returns the time of the bench: that of its own clock when clients command the camera.
    pub(super) fn bench_time(&self, now: Tai) -> Tai {
        self.commander.as_ref().map_or(now, Commander::time)
    }

    fn is_running(&self) -> bool {
        self.acquisition.is_running(&self.shared.wanted)
    }

    /// Refuses what the table of features does not allow.
    fn check(&self, address: u32, value: u32) -> Result<(), Status> {
        let feature = Feature::written_at(address, self.commander.is_some()).ok_or(Status::WriteProtect)?;
        if feature.is_locked_by_acquisition() && self.is_running() {
            return Err(Status::Busy);
        }
        let is_taken = feature.takes(value, self.values.colours, |address| self.values.memory.word(address));
        if is_taken { Ok(()) } else { Err(Status::InvalidParameter) }
    }

    /// Carries out a write to one of the camera's own features.
    pub(super) fn write(&mut self, address: u32, value: u32, now: Tai) -> Result<(), Status> {
        let is_running = self.is_running();
        if let Some(commander) = self.commander.as_mut().filter(|_| is_commanded(address)) {
            return commander.write(&mut self.values, address, value, is_running);
        }
        self.check(address, value)?;
        let values = &mut self.values;
        match address {
            own::OFFSET_X | own::OFFSET_Y if !value.is_multiple_of(offset_step(values.colours)) => {
                return Err(Status::InvalidParameter);
            }
            own::CHUNK_SELECTOR => {
                values.memory.set(address, value);
                values.show_chunk();
            }
            own::CHUNK_ENABLE => {
                let selected = 1 << values.memory.word(own::CHUNK_SELECTOR);
                values.chunks = (values.chunks & !selected) | (selected * value);
                values.show_chunk();
            }
            own::REGION_SELECTOR => {
                values.memory.set(address, value);
                values.show_region();
            }
            own::REGION_MODE => {
                let selected = values.memory.word(own::REGION_SELECTOR);
                if !values.regions.switch(selected, value == 1) {
                    return Err(Status::InvalidParameter);
                }
                values.show_region();
            }
            own::FRAME_RATE => values.high_half = (address, value),
            own::FRAME_RATE_LOW => return self.write_rate(value),
            own::ACQUISITION_START => self.start(now)?,
            own::ACQUISITION_STOP => self.stop(),
            own::USER_SET_LOAD => return self.load_user_set(own::USER_SET_SELECTOR, now),
            own::USER_SET_SAVE => return self.save_user_set(),
            own::PTP_ENABLE => {
                self.enable_ptp(value == 1);
                return Ok(());
            }
            own::PTP_LATCH if value > 1 => return Err(Status::InvalidParameter),
            own::PTP_LATCH => {
                self.latch_ptp();
                return Ok(());
            }
            own::TRIGGER_SOFTWARE => return self.trigger(SOURCE_SOFTWARE, self.bench_time(now)),
            _ => values.memory.set(address, value),
        }
        self.values.keep_region();
        self.values.measure_payload();
        self.show_rate_range();
        Ok(())
    }

    /// Puts what the camera has chosen for itself into its registers, and events that the client wants into its
    /// messages.
    pub(super) fn take_events(&mut self, messages: &mut Messages) {
        let Some(commander) = &self.commander else { return };
        for event in commander.params.desk.events() {
            messages.push(event, &self.shared.tally);
            self.values.take_in(event.kind);
        }
    }

    /// Carries out a write to the registers of events.
    pub(super) fn write_event(&mut self, address: u32, value: u32, messages: &mut Messages) -> Result<(), Status> {
        self.check(address, value)?;
        let memory = &mut self.values.memory;
        if address == own::EVENT_NOTIFICATION {
            messages.want(memory.word(own::EVENT_SELECTOR), value == 1);
        }
        memory.set(address, value);
        memory.set(own::EVENT_NOTIFICATION, messages.is_wanted(memory.word(own::EVENT_SELECTOR)));
        Ok(())
    }

    /// Shows the state that the client has selected.
    pub(super) fn show_status(&mut self) {
        let is_awaited = match &self.commander {
            Some(_) => self.is_running() && self.values.is_trigger_awaited,
            None => self.acquisition.waits_for_trigger(),
        };
        let states = [is_awaited, self.is_running()];
        let selected = self.values.memory.word(own::STATUS_SELECTOR) as usize;
        self.values.memory.set(own::STATUS, states.get(selected).copied().unwrap_or_default().into());
    }

    fn show_rate_range(&mut self) {
        if let Some(commander) = &mut self.commander {
            commander.show_rate_range(&mut self.values);
        }
    }

    /// Sets the rate nearest to the one that is asked for: the bench's, or that of each n-th of its frames.
    fn write_rate(&mut self, low: u32) -> Result<(), Status> {
        let asked_hz = self.values.number_at(own::FRAME_RATE, low);
        let bench_hz = self.values.memory.float(own::FRAME_RATE_MOST);
        let one_in = (bench_hz / asked_hz).round();
        if !(1.0..=f64::from(ONE_IN_MOST)).contains(&one_in) || asked_hz > bench_hz {
            return Err(Status::InvalidParameter);
        }
        self.values.memory.set_long(own::FRAME_RATE, (bench_hz / one_in).to_bits());
        self.choose_frames();
        Ok(())
    }

    /// Applies the frame rate. With triggers each frame is chosen by one of them, not by a rate.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole, 1 to 65535")]
    fn choose_frames(&self) {
        let memory = &self.values.memory;
        // Every frame of a commanded camera is the client's.
        let is_all = memory.word(own::TRIGGER_MODE) == 1 || self.commander.is_some();
        let one_in = (memory.float(own::FRAME_RATE_MOST) / memory.float(own::FRAME_RATE)).round() as u32;
        self.shared.wanted.choose_one_in(if is_all { 1 } else { one_in });
    }

    fn start(&mut self, now: Tai) -> Result<(), Status> {
        if !self.values.regions_fit() {
            return Err(Status::InvalidParameter);
        }
        if let Some(commander) = &mut self.commander {
            commander.read_out_regions(&self.values)?;
        }
        let word = |address| self.values.memory.word(address);
        let mode = match word(own::ACQUISITION_MODE) {
            0 => Mode::Continuous,
            1 => Mode::SingleFrame,
            _ => Mode::MultiFrame(word(own::FRAME_COUNT)),
        };
        self.number = self.number.wrapping_add(1);
        let chooses_by_trigger = word(own::TRIGGER_MODE) == 1 && self.commander.is_none();
        let frames = self.acquisition.start(mode, chooses_by_trigger);
        self.choose_frames();
        self.publish();
        // A commanded camera exposes also while no client acquires: such frames are not of this acquisition.
        let from = self.commander.as_ref().map_or(Tai::from_ns(i64::MIN), |_| self.bench_time(now));
        self.shared.wanted.begin_from(from, self.number, frames);
        Ok(())
    }

    pub(super) fn stop(&mut self) {
        self.shared.wanted.end();
        self.number = self.number.wrapping_add(1);
        self.acquisition.stop();
    }

    /// Takes a trigger of a source at an instant of the bench clock: it starts an exposure of a commanded camera that
    /// acquires, or chooses the next frame of another one.
    pub(super) fn trigger(&mut self, source: u32, at: Tai) -> Result<(), Status> {
        if self.values.memory.word(own::TRIGGER_SOURCE) != source {
            return Ok(());
        }
        let is_heeded = match &self.commander {
            Some(commander) => self.is_running() && commander.trigger(&self.values, source, at)?,
            None => self.acquisition.trigger(&self.shared.wanted),
        };
        if is_heeded {
            // Until the frame loop reports again, there is this one to expose.
            self.values.is_trigger_awaited = false;
            self.shared.tally.triggers.one();
        }
        Ok(())
    }

    /// Loads the set that a register selects, one setting after another up to the first that is refused.
    pub(super) fn load_user_set(&mut self, register: u32, now: Tai) -> Result<(), Status> {
        let number = self.values.memory.word(register) as usize;
        let set = self.user_sets.get(number).cloned().ok_or(Status::InvalidParameter)?;
        // The highest frame rate is that of the regions.
        self.values.regions = set.regions.clone();
        self.values.show_region();
        self.show_rate_range();
        for (address, value) in set.writes(self.commander.is_some()) {
            self.write(address, value, now)?;
        }
        self.values.chunks = set.chunks;
        self.values.show_chunk();
        self.values.measure_payload();
        Ok(())
    }

    /// Keeps the settings in the selected set; the first one is the bench's.
    fn save_user_set(&mut self) -> Result<(), Status> {
        let number = self.values.memory.word(own::USER_SET_SELECTOR) as usize;
        let present = UserSet::of(&self.values, self.commander.is_some());
        let set = self.user_sets.get_mut(number).filter(|_| number > 0).ok_or(Status::WriteProtect)?;
        *set = present;
        Ok(())
    }

    /// True while the client wants to know of the clock.
    pub(in crate::network_camera) fn wants_ptp(&self) -> bool {
        self.values.memory.word(own::PTP_ENABLE) == 1
    }

    pub(super) fn enable_ptp(&mut self, is_on: bool) {
        self.values.memory.set(own::PTP_ENABLE, is_on.into());
        self.values.memory.set(at::GVCP_CONFIGURATION, u32::from(is_on) * PTP_ON);
        self.note_ptp(PtpData::in_state(if is_on { INITIALIZING } else { DISABLED }));
    }

    /// Takes the present state of the clock: status and servo are those of now, the other numbers those of the last
    /// latch.
    pub(in crate::network_camera) fn note_ptp(&mut self, data: PtpData) {
        self.ptp = data;
        let servo = (data.state == SLAVE).into();
        for (address, value) in [(own::PTP_STATUS, data.state), (own::PTP_SERVO, servo), (at::PTP_STATUS, data.state)] {
            self.values.memory.set(address, value);
        }
    }

    fn latch_ptp(&mut self) {
        let PtpData { accuracy, offset_ns, delay_ns, clock_id, parent_id, grandmaster_id, .. } = self.ptp;
        self.values.memory.set(own::PTP_ACCURACY, accuracy);
        for (address, bits) in [
            (own::PTP_OFFSET, offset_ns.cast_unsigned()),
            (own::PTP_DELAY, delay_ns.cast_unsigned()),
            (own::PTP_CLOCK_ID, clock_id),
            (own::PTP_PARENT_ID, parent_id),
            (own::PTP_GRANDMASTER_ID, grandmaster_id),
        ] {
            self.values.memory.set_long(address, bits);
        }
    }
}
