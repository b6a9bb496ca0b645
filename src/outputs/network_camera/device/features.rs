//! Writes to the camera's own features, and the acquisition that they start and stop.

use super::{Device, SOURCE_SOFTWARE};
use crate::network_camera::registers::{Memory, own};
use crate::network_camera::{
    acquisition::Mode, chunk, first_values::ONE_IN_MOST, gvcp::Status, pixel_format::PixelFormat, regions::stacked_px,
    test_pattern::TestPattern, user_sets::NAMES, xml::offset_step,
};
use base::time::Tai;

impl Device {
    pub(super) fn write_feature(&mut self, address: u32, value: u32, now: Tai) -> Result<(), Status> {
        if self.commands.is_some() && Self::is_commanded(address) {
            return self.write_commanded(address, value, self.bench_time(now));
        }
        let is_free = !self.acquisition.is_running(&self.shared.wanted);
        let free = || if is_free { Ok(()) } else { Err(Status::Busy) };
        let set_if = |memory: &mut Memory, is_legal: bool| {
            let done = if is_legal { Ok(()) } else { Err(Status::InvalidParameter) };
            done.map(|()| memory.set(address, value))
        };
        let (colours, step) = (self.colours, offset_step(self.colours));
        let memory = &mut self.memory;
        let space = |sensor, taken| memory.word(sensor).saturating_sub(memory.word(taken));
        match address {
            own::WIDTH => {
                let most = space(own::SENSOR_WIDTH, own::OFFSET_X);
                free().and_then(|()| set_if(memory, (1..=most).contains(&value)))?;
            }
            own::HEIGHT => {
                let most = space(own::SENSOR_HEIGHT, own::OFFSET_Y);
                free().and_then(|()| set_if(memory, (1..=most).contains(&value)))?;
            }
            own::OFFSET_X => {
                let most = space(own::SENSOR_WIDTH, own::WIDTH);
                free().and_then(|()| set_if(memory, value <= most && value.is_multiple_of(step)))?;
            }
            own::OFFSET_Y => {
                let most = space(own::SENSOR_HEIGHT, own::HEIGHT);
                free().and_then(|()| set_if(memory, value <= most && value.is_multiple_of(step)))?;
            }
            own::PIXEL_FORMAT => {
                free().and_then(|()| set_if(memory, PixelFormat::from_code(value, colours).is_some()))?
            }
            own::ACQUISITION_MODE => free().and_then(|()| set_if(memory, value <= 2))?,
            own::FRAME_COUNT => free().and_then(|()| set_if(memory, (1..=65_535).contains(&value)))?,
            own::TRIGGER_MODE | own::TRIGGER_SOURCE | own::CHUNK_MODE => {
                free().and_then(|()| set_if(memory, value <= 1))?;
            }
            own::CHUNK_SELECTOR => {
                set_if(memory, (value as usize) < chunk::FIELDS.len())?;
                memory.set(own::CHUNK_ENABLE, self.chunks >> value & 1);
            }
            own::CHUNK_ENABLE => {
                free().and_then(|()| set_if(memory, value <= 1))?;
                let selected = 1 << memory.word(own::CHUNK_SELECTOR);
                self.chunks = (self.chunks & !selected) | (selected * value);
            }
            own::PARAMETERS_LOCKED => set_if(memory, value <= 1)?,
            own::FRAME_RATE => self.high_half = (address, value),
            own::FRAME_RATE_LOW => return self.write_rate(value),
            own::ACQUISITION_START => {
                self.command_regions(self.bench_time(now))?;
                self.start(now);
            }
            own::ACQUISITION_STOP => self.stop(),
            own::TEST_PATTERN => set_if(memory, TestPattern::from_number(value).is_some())?,
            own::USER_SET_SELECTOR | own::USER_SET_DEFAULT => set_if(memory, (value as usize) < NAMES.len())?,
            own::USER_SET_LOAD => return self.load_user_set(own::USER_SET_SELECTOR, now),
            own::USER_SET_SAVE => return self.save_user_set(),
            own::DEVICE_RESET => return self.reset(now),
            own::EVENT_SELECTOR | own::EVENT_NOTIFICATION => return self.write_event(address, value),
            own::REGION_SELECTOR | own::REGION_MODE => return self.write_region(address, value),
            own::PTP_ENABLE | own::PTP_LATCH => return self.write_ptp(address, value),
            own::TRIGGER_SOFTWARE => return self.trigger(SOURCE_SOFTWARE, self.bench_time(now)),
            _ => return memory.read(address, 4).and(Err(Status::WriteProtect)),
        }
        self.keep_region();
        self.measure_payload();
        self.show_rate_range();
        Ok(())
    }

    /// Returns the rate nearest to the one that is asked for: the bench's, or that of each n-th of its frames.
    fn write_rate(&mut self, low: u32) -> Result<(), Status> {
        let asked_hz = self.number_at(own::FRAME_RATE, low);
        let bench_hz = self.memory.float(own::FRAME_RATE_MOST);
        let one_in = (bench_hz / asked_hz).round();
        if !(1.0..=f64::from(ONE_IN_MOST)).contains(&one_in) || asked_hz > bench_hz {
            return Err(Status::InvalidParameter);
        }
        self.memory.set_long(own::FRAME_RATE, (bench_hz / one_in).to_bits());
        self.choose_frames();
        Ok(())
    }

    /// Applies the frame rate. With triggers each frame is chosen by one of them, not by a rate.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole, 1 to 65535")]
    fn choose_frames(&self) {
        // Every frame of a commanded camera is the client's.
        let is_all = self.memory.word(own::TRIGGER_MODE) == 1 || self.commands.is_some();
        let one_in = (self.memory.float(own::FRAME_RATE_MOST) / self.memory.float(own::FRAME_RATE)).round() as u32;
        self.shared.wanted.choose_one_in(if is_all { 1 } else { one_in });
    }

    pub(super) fn format(&self) -> PixelFormat {
        PixelFormat::from_code(self.memory.word(own::PIXEL_FORMAT), self.colours).unwrap_or(PixelFormat::Mono16)
    }

    pub(super) fn pattern(&self) -> TestPattern {
        TestPattern::from_number(self.memory.word(own::TEST_PATTERN)).unwrap_or_default()
    }

    pub(super) fn has_chunks(&self) -> bool {
        self.memory.word(own::CHUNK_MODE) == 1 && self.chunks != 0
    }

    pub(super) fn measure_payload(&mut self) {
        let [columns, rows] = stacked_px(&self.regions.present()).map(|side| side as usize);
        let chunks = if self.has_chunks() { chunk::added_bytes() } else { 0 };
        let bytes = self.format().bytes(columns * rows) + chunks;
        self.memory.set(own::PAYLOAD_SIZE, u32::try_from(bytes).unwrap_or(u32::MAX));
    }

    fn start(&mut self, now: Tai) {
        let mode = match self.memory.word(own::ACQUISITION_MODE) {
            0 => Mode::Continuous,
            1 => Mode::SingleFrame,
            _ => Mode::MultiFrame(self.memory.word(own::FRAME_COUNT)),
        };
        self.number = self.number.wrapping_add(1);
        let chooses_by_trigger = self.memory.word(own::TRIGGER_MODE) == 1 && self.commands.is_none();
        let frames = self.acquisition.start(mode, chooses_by_trigger);
        self.choose_frames();
        self.publish();
        // A commanded camera exposes also while no client acquires: such frames are not of this acquisition.
        let from = self.commands.as_ref().map_or(Tai::from_ns(i64::MIN), |_| self.bench_time(now));
        self.shared.wanted.begin_from(from, self.number, frames);
    }

    pub(super) fn stop(&mut self) {
        self.shared.wanted.end();
        self.number = self.number.wrapping_add(1);
        self.acquisition.stop();
    }

    /// Returns a trigger of a source at an instant of the bench clock: it starts an exposure of a commanded camera, or
    /// chooses the next frame of another one.
    pub(super) fn trigger(&mut self, source: u32, at: Tai) -> Result<(), Status> {
        if self.memory.word(own::TRIGGER_SOURCE) != source {
            return Ok(());
        }
        if self.commands.is_some() {
            return self.command_trigger(source, at);
        }
        if self.acquisition.trigger(&self.shared.wanted) {
            self.tally().triggers.one();
        }
        Ok(())
    }
}
