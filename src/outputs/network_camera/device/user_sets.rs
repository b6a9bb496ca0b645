//! Loading and saving of user sets, and the reset that loads one.

use super::Device;
use crate::network_camera::user_sets::{NAMES, UserSet};
use crate::network_camera::{gvcp::Status, registers::own};
use base::time::Tai;

impl Device {
    /// Returns the user sets at the start: every set begins as the first.
    pub(super) fn first_user_sets(&self) -> Vec<UserSet> {
        vec![self.present_set(); NAMES.len()]
    }

    fn present_set(&self) -> UserSet {
        UserSet::of(&self.memory, &self.regions, self.chunks, self.commands.is_some())
    }

    fn set_number(&self, register: u32) -> usize {
        usize::try_from(self.memory.word(register)).unwrap_or_default()
    }

    /// Loads the selected set, one setting after another up to the first that is refused.
    pub(super) fn load_user_set(&mut self, register: u32, now: Tai) -> Result<(), Status> {
        if self.acquisition.is_running(&self.shared.wanted) {
            return Err(Status::Busy);
        }
        let set = self.user_sets.get(self.set_number(register)).cloned().ok_or(Status::InvalidParameter)?;
        // The highest frame rate is that of the regions.
        self.regions = set.regions.clone();
        self.show_region();
        self.show_rate_range();
        for (address, value) in set.writes(self.commands.is_some()) {
            self.write_feature(address, value, now)?;
        }
        self.chunks = set.chunks;
        self.memory.set(own::CHUNK_ENABLE, self.chunks >> self.memory.word(own::CHUNK_SELECTOR) & 1);
        self.measure_payload();
        Ok(())
    }

    /// Keeps the settings in the selected set; the first one is the bench's.
    pub(super) fn save_user_set(&mut self) -> Result<(), Status> {
        let (number, present) = (self.set_number(own::USER_SET_SELECTOR), self.present_set());
        let set = self.user_sets.get_mut(number).filter(|_| number > 0).ok_or(Status::WriteProtect)?;
        *set = present;
        Ok(())
    }

    /// Ends the acquisition and loads the default set. Control ends with it.
    pub(super) fn reset(&mut self, now: Tai) -> Result<(), Status> {
        self.stop();
        self.load_user_set(own::USER_SET_DEFAULT, now)?;
        self.control.release();
        self.release();
        Ok(())
    }
}
