//! The registers of the selected region, and the command that makes the camera read out no more than its regions.

use super::Device;
use crate::network_camera::gvcp::Status;
use crate::network_camera::regions::stacked_px;
use crate::network_camera::registers::own;
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

    /// Keeps what a client has written to the registers of the selected region.
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
        Ok(())
    }

    /// Makes the camera that clients command read out the regions from the next exposure on, when they have changed.
    pub(super) fn command_regions(&mut self, at: Tai) -> Result<(), Status> {
        let regions = self.regions.present();
        let size_px = [own::SENSOR_WIDTH, own::SENSOR_HEIGHT].map(|side| self.memory.word(side));
        let pixels = |[columns, rows]: [u32; 2]| u64::from(columns) * u64::from(rows);
        if pixels(stacked_px(&regions)) > pixels(size_px) {
            return Err(Status::InvalidParameter);
        }
        let whole = Region { left_px: 0, top_px: 0, width_px: size_px[0], height_px: size_px[1] };
        let wanted = if regions.as_slice() == [whole] { Regions::WHOLE } else { regions };
        if self.commands.is_some() && wanted != self.read_out {
            self.put(CameraCommand::Regions(wanted), at)?;
            self.read_out = wanted;
        }
        Ok(())
    }
}
