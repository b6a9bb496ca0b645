//! Device -> host: a ring of buffers that the host can map.
//!
//! `record` puts a copy at the end of a list of commands, `receive` waits for the oldest one. Depth 1 is right on a
//! software adapter (deeper adds a frame of latency each and gains nothing); a discrete GPU may gain from 2.

use crate::gpu::{buffers::create, device::GpuDevice, error::GpuError};
use wgpu::BufferUsages;

/// The ring.
#[derive(Debug)]
pub struct ReadbackRing {
    slots: Vec<wgpu::Buffer>,
    recorded: usize,
    received: usize,
}

impl ReadbackRing {
    /// Returns a ring of `depth` buffers of `bytes` each.
    ///
    /// # Errors
    /// When the device takes no buffer of this size.
    pub fn new(gpu: &GpuDevice, depth: usize, bytes: u64) -> Result<Self, GpuError> {
        let usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
        let slots = (0..depth.max(1)).map(|_| create(gpu, "readback", usage, bytes)).collect::<Result<_, _>>()?;
        Ok(Self { slots, recorded: 0, received: 0 })
    }

    /// Copies the start of `source` into the next buffer; false when all of them wait to be received.
    pub fn record(&mut self, encoder: &mut wgpu::CommandEncoder, source: &wgpu::Buffer) -> bool {
        if self.recorded - self.received >= self.slots.len() {
            return false;
        }
        let slot = &self.slots[self.recorded % self.slots.len()];
        encoder.copy_buffer_to_buffer(source, 0, slot, 0, slot.size().min(source.size()));
        self.recorded += 1;
        true
    }

    /// Asks for the oldest copy, waits for it and shows it to `read`. Call after the commands were submitted.
    ///
    /// # Errors
    /// When the device failed, or nothing was recorded.
    pub fn receive<T>(&mut self, gpu: &GpuDevice, read: impl FnOnce(&[u8]) -> T) -> Result<T, GpuError> {
        if self.received == self.recorded {
            return Err(GpuError::Failed("nothing to read back: no copy was recorded".into()));
        }
        let slot = &self.slots[self.received % self.slots.len()];
        self.received += 1;
        // A mapping that fails shows when the range is asked for.
        slot.map_async(wgpu::MapMode::Read, .., |_| {});
        gpu.wait()?;
        let value = {
            let view = slot.get_mapped_range(..).map_err(|error| GpuError::Failed(error.to_string()))?;
            read(&view)
        };
        slot.unmap();
        Ok(value)
    }
}
