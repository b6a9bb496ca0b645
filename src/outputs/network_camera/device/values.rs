//! Values that clients have set: the memory that they read, and what its selectors choose from.

use crate::network_camera::regions::{RegionSet, stacked_px};
use crate::network_camera::{chunk, features::own, pixel_format::PixelFormat, registers::Memory};
use base::bayer::BayerPattern;
use frames::camera_control::{CameraEventKind, Region, Regions};

/// Every field of the truth.
const ALL_CHUNKS: u32 = (1 << chunk::FIELDS.len()) - 1;

pub(in crate::network_camera) struct Values {
    pub(in crate::network_camera) memory: Memory,
    pub(in crate::network_camera) regions: RegionSet,
    /// Fields of the truth that are wanted, one bit each.
    pub(in crate::network_camera) chunks: u32,
    pub(in crate::network_camera) colours: Option<BayerPattern>,
    /// Address and value of the high half of a number that was written last; the low half makes it hold.
    pub(super) high_half: (u32, u32),
    /// A commanded camera would take a trigger at once.
    pub(super) is_trigger_awaited: bool,
}

impl Values {
    pub(super) fn new(memory: Memory, size_px: [u32; 2], colours: Option<BayerPattern>) -> Self {
        let (regions, chunks, high_half) = (RegionSet::new(size_px), ALL_CHUNKS, (0, 0));
        let mut values = Self { memory, regions, chunks, colours, high_half, is_trigger_awaited: false };
        values.show_region();
        values.measure_payload();
        values
    }

    pub(super) fn format(&self) -> PixelFormat {
        PixelFormat::from_code(self.memory.word(own::PIXEL_FORMAT), self.colours).unwrap_or(PixelFormat::Mono16)
    }

    pub(super) fn has_chunks(&self) -> bool {
        self.memory.word(own::CHUNK_MODE) == 1 && self.chunks != 0
    }

    /// Returns the number whose high half was written last and whose low half is this one.
    pub(super) fn number_at(&self, address: u32, low: u32) -> f64 {
        let kept = || self.memory.word(address);
        let high = if self.high_half.0 == address { self.high_half.1 } else { kept() };
        f64::from_bits(u64::from(high) << 32 | u64::from(low))
    }

    pub(super) fn measure_payload(&mut self) {
        let [columns, rows] = stacked_px(&self.regions.present()).map(|side| side as usize);
        let chunks = if self.has_chunks() { chunk::added_bytes() } else { 0 };
        let bytes = self.format().bytes(columns * rows) + chunks;
        self.memory.set(own::PAYLOAD_SIZE, u32::try_from(bytes).unwrap_or(u32::MAX));
    }

    /// Shows in the registers whether the selected field of the truth is wanted.
    pub(super) fn show_chunk(&mut self) {
        self.memory.set(own::CHUNK_ENABLE, self.chunks >> self.memory.word(own::CHUNK_SELECTOR) & 1);
    }

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

    /// Returns the regions that a commanded camera has to read out.
    pub(super) fn wanted_read_out(&self) -> Regions {
        let (regions, [width_px, height_px]) = (self.regions.present(), self.sensor_px());
        let whole = Region { left_px: 0, top_px: 0, width_px, height_px };
        if regions.as_slice() == [whole] { Regions::WHOLE } else { regions }
    }

    /// Returns true if the regions together have no more pixels than the sensor.
    pub(super) fn regions_fit(&self) -> bool {
        let pixels = |[columns, rows]: [u32; 2]| u64::from(columns) * u64::from(rows);
        pixels(stacked_px(&self.regions.present())) <= pixels(self.sensor_px())
    }

    fn sensor_px(&self) -> [u32; 2] {
        [own::SENSOR_WIDTH, own::SENSOR_HEIGHT].map(|side| self.memory.word(side))
    }

    /// Takes a value that the camera has chosen for itself: clients read it from now on.
    pub(super) fn take_in(&mut self, event: CameraEventKind) {
        match event {
            CameraEventKind::ExposureChosen(exposure) => {
                self.memory.set_long(own::EXPOSURE_TIME, (exposure.ns() as f64 * 1e-3).to_bits());
            }
            CameraEventKind::GainChosen(gain_db) => self.memory.set_long(own::GAIN, gain_db.to_bits()),
            CameraEventKind::ExposureAutoDone => self.memory.set(own::EXPOSURE_AUTO, 0),
            CameraEventKind::GainAutoDone => self.memory.set(own::GAIN_AUTO, 0),
            CameraEventKind::TriggerAwaited(is_awaited) => self.is_trigger_awaited = is_awaited,
            CameraEventKind::FrameTrigger
            | CameraEventKind::FrameTriggerMissed
            | CameraEventKind::ExposureStart
            | CameraEventKind::ExposureEnd => {}
        }
    }
}
