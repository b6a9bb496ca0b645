//! The registers of the selected region, the frame rates that regions leave time for, and the command that makes the
//! camera read out no more than its regions.

use super::Device;
use crate::network_camera::{gvcp::Status, regions::stacked_px, registers::own};
use base::time::Tai;
use frames::camera_control::{CameraCommand, REGIONS_MAX, Region, Regions};

impl Device {
    /// Shows the selected region in the registers.
    pub(super) fn show_region(&mut self) {
        let selected = self.memory.word(own::REGION_SELECTOR);
        let Region { left_px, top_px, width_px, height_px } = self.regions.at(selected);
        for (address, value) in [
            (own::OFFSET_X, left_px),
            (own::OFFSET_Y, top_px),
            (own::WIDTH, width_px),
            (own::HEIGHT, height_px),
            (own::REGION_MODE, self.regions.is_on(selected)),
        ] {
            self.memory.set(address, value);
        }
    }

    /// Stores the values that a client has written to the registers of the selected region.
    pub(super) fn keep_region(&mut self) {
        let word = |address| self.memory.word(address);
        let (left_px, top_px) = (word(own::OFFSET_X), word(own::OFFSET_Y));
        let region = Region { left_px, top_px, width_px: word(own::WIDTH), height_px: word(own::HEIGHT) };
        self.regions.place(word(own::REGION_SELECTOR), region);
    }

    pub(super) fn write_region(&mut self, address: u32, value: u32) -> Result<(), Status> {
        let is_mode = address == own::REGION_MODE;
        if is_mode && self.acquisition.is_running(&self.shared.wanted) {
            return Err(Status::Busy);
        }
        let selected = self.memory.word(own::REGION_SELECTOR);
        let is_legal = match address {
            own::REGION_MODE => value <= 1 && self.regions.switch(selected, value == 1),
            _ => (value as usize) < REGIONS_MAX,
        };
        if !is_legal {
            return Err(Status::InvalidParameter);
        }
        self.memory.set(address, value);
        self.show_region();
        self.measure_payload();
        self.show_rate_range();
        Ok(())
    }

    /// Shows the highest frame rate of a commanded camera with the regions that are set; its frame rate becomes no
    /// higher.
    pub(super) fn show_rate_range(&mut self) {
        let Some(range) = self.range() else { return };
        let most = range.frame_rate_max_hz.to_bits();
        self.memory.set_long(own::FRAME_RATE_MOST, most);
        if self.check(&CameraCommand::Period(self.period())).is_err() {
            self.memory.set_long(own::FRAME_RATE, most);
            self.rate_waits = true;
        }
    }

    fn sensor_px(&self) -> [u32; 2] {
        [own::SENSOR_WIDTH, own::SENSOR_HEIGHT].map(|side| self.memory.word(side))
    }

    /// Returns the regions that the camera has to read out.
    fn wanted_read_out(&self) -> Regions {
        let (regions, [width_px, height_px]) = (self.regions.present(), self.sensor_px());
        let whole = Region { left_px: 0, top_px: 0, width_px, height_px };
        if regions.as_slice() == [whole] { Regions::WHOLE } else { regions }
    }

    /// Returns true when the camera does not read out yet what is set: it will from the next start of an acquisition
    /// on.
    pub(super) fn regions_wait(&self) -> bool {
        self.wanted_read_out() != self.read_out
    }

    /// Makes the camera that clients command read out the regions from the next exposure on, when they have changed, at
    /// the frame rate that was set for them.
    pub(super) fn command_regions(&mut self, at: Tai) -> Result<(), Status> {
        let pixels = |[columns, rows]: [u32; 2]| u64::from(columns) * u64::from(rows);
        if pixels(stacked_px(&self.regions.present())) > pixels(self.sensor_px()) {
            return Err(Status::InvalidParameter);
        }
        if self.commands.is_none() {
            return Ok(());
        }
        let wanted = self.wanted_read_out();
        if wanted != self.read_out {
            self.put(CameraCommand::Regions(wanted), at)?;
            self.read_out = wanted;
        }
        if self.rate_waits && self.memory.word(own::FRAME_RATE_ENABLE) == 1 {
            self.put(CameraCommand::Period(self.period()), at)?;
        }
        self.rate_waits = false;
        Ok(())
    }
}
