//! The camera as a sink: `send` copies a frame that is wanted into a free slot, or counts why not, and returns.

use crate::network_camera::interface::{self, Interface};
use crate::network_camera::packets::{Outlet, TestOutlet};
use crate::network_camera::params::{CommandParams, DeviceParams, Params, SensorParams};
use crate::network_camera::shared::{Shared, Slot};
use crate::network_camera::stream::{Kept, Stream};
use crate::network_camera::{
    acquisition::Turn, counters::Counters, device::Device, listener::Listener, ptp::PtpClient,
};
use base::clock::{Clock, Monotonic};
use base::{refused::Refused, time::Span};
use crossbeam_channel::{Receiver, Sender, bounded};
use frames::sink::crc32::{RunCrc32, pixel_crc32};
use frames::sink::{Loss, LossKind, SentFrame, Sink, SinkError, SinkSummary};
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::{path::PathBuf, sync::Arc, thread::JoinHandle};

/// Requests to send again that may wait.
const ASKS_QUEUED: usize = 256;
/// The end of a run waits no longer for frames that are still to be sent, whatever pace and pause a client chose.
const FAREWELL: Span = Span::from_ms(1_000);
const NAME: &str = "network_camera";

/// A camera on the network, from its start to the end of the run.
pub struct NetworkCamera {
    address: SocketAddr,
    clock: Arc<dyn Clock>,
    shared: Arc<Shared>,
    full: Option<Sender<Slot>>,
    free: Receiver<Slot>,
    /// A slot taken for a frame that then was not wanted.
    spare: Option<Slot>,
    turn: Turn,
    pixels: usize,
    stream: Option<JoinHandle<()>>,
    listener: Option<JoinHandle<()>>,
    /// A thread ended before its stop was requested.
    is_lost: bool,
    frames: u64,
    refused: u64,
    run_crc32: RunCrc32,
}

impl NetworkCamera {
    /// Brings the camera up: two threads, one control port, one stream port. `clock` is the bench's: its time is what
    /// clients latch. On a virtual clock, clients being real, heartbeat and pace go by the machine's. With `commands`
    /// clients command the camera that makes the frames; without, they only read its settings and choose among its
    /// frames.
    ///
    /// # Errors
    /// When a value cannot be, no interface has the address, or the system refuses a socket or a thread.
    pub fn start(
        params: &Params,
        sensor: &SensorParams,
        commands: Option<CommandParams>,
        clock: Arc<dyn Clock>,
    ) -> Result<Self, Refused> {
        params.check(sensor)?;
        let clock = if clock.is_real() { clock } else { Arc::new(Monotonic::start()) };
        let found = Interface::of(params.address)?;
        let refuse = |doing| move |source| interface::system(params.address, doing, source, "");
        let control = interface::control_socket(params.address, params.port)?;
        let address = control.local_addr().map_err(refuse("read its address"))?;
        let stream_socket = Arc::new(interface::stream_socket(params.address)?);
        let stream_source_port = stream_socket.local_addr().map_err(refuse("read its address"))?.port();
        let messages = interface::message_socket(params.address)?;
        let message_source_port = messages.local_addr().map_err(refuse("read its address"))?.port();
        let place = DeviceParams {
            address: params.address,
            mask: found.mask,
            mac: params.mac.unwrap_or(found.mac),
            packet_bytes_max: found.packet_bytes_max()?,
            stream_source_port,
            message_source_port,
        };
        let device = Device::new(params, sensor, place, commands).map_err(refuse("deflate its XML"))?;
        let shared = Arc::clone(&device.camera.shared);
        let pixels = sensor.size_px.iter().map(|side| *side as usize).product();
        let (full, frames) = bounded(params.frames_queued as usize);
        let (given_back, free) = bounded(params.frames_queued as usize);
        for _ in 0..params.frames_queued {
            let _ = given_back.try_send(Slot::with_capacity(pixels)); // the queue has space for all buffers
        }
        let (ask, asks) = bounded(ASKS_QUEUED);
        let (tests, rate, tally) = (Arc::clone(&stream_socket), params.rate_bit_s, || Arc::clone(&shared.tally));
        let tests = TestOutlet::new(tests, rate, clock.now(), tally());
        let outlet = Outlet::new(stream_socket, Arc::clone(&clock), rate, params.lose_one_in, tally());
        let kept = Kept::new(params.frames_kept as usize, pixels, device.stream());
        let width_px = sensor.size_px[0] as usize;
        let stream = Stream {
            shared: Arc::clone(&shared),
            frames,
            free: given_back,
            asks,
            outlet,
            kept,
            width_px,
            dn_bits: sensor.bits,
            pending: None,
        };
        let broadcasts = receive_broadcasts(&found, address.port());
        let listener = Listener {
            device,
            shared: Arc::clone(&shared),
            clock: Arc::clone(&clock),
            control,
            broadcasts,
            messages,
            ptp: PtpClient::new(&params.ptp_socket),
            tests,
            asks: ask,
        };
        let spawn = |name: &str, run: Box<dyn FnOnce() + Send>| {
            let thread = std::thread::Builder::new().name(name.into()).spawn(run);
            thread.map_err(refuse("start a thread"))
        };
        let stream = Some(spawn("camera stream", Box::new(move || stream.run()))?);
        let listener = Some(spawn("camera control", Box::new(move || listener.run()))?);
        Ok(Self {
            address,
            clock,
            shared,
            full: Some(full),
            free,
            spare: None,
            turn: Turn::default(),
            pixels,
            stream,
            listener,
            is_lost: false,
            frames: 0,
            refused: 0,
            run_crc32: RunCrc32::default(),
        })
    }

    /// Returns where clients find it.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Returns whether other machines can reach it: a camera does not ask for a password.
    pub fn is_exposed(&self) -> bool {
        !self.address.ip().is_loopback()
    }

    /// Returns the counts of sent, lost and refused so far.
    pub fn counters(&self) -> Counters {
        self.shared.tally.read()
    }

    /// Copies a frame that a client wants, when there is a slot for it.
    fn offer(&mut self, frame: &SentFrame) {
        let Shared { tally, wanted, .. } = &*self.shared;
        tally.frames_offered.one();
        if let Some(facts) = &frame.meta.facts {
            self.shared.set_temperature_c(facts.temperature_c);
        }
        let is_before = wanted.is_before(frame.meta.exposure_start());
        if wanted.by().is_none_or(|acquisition| is_before || !self.turn.comes(acquisition, wanted)) {
            return tally.frames_not_wanted.one();
        }
        if frame.image.pixels().len() != self.pixels {
            return tally.frames_of_another_size.one();
        }
        let slot = self.spare.take().or_else(|| self.free.try_recv().ok());
        let Some(mut slot) = slot else { return self.shared.lose(LossKind::Dropped, frame.meta.number) };
        // The copy comes before the count: a frame that is counted out will be sent.
        slot.take_in(frame);
        let Some(acquisition) = wanted.take() else {
            self.spare = Some(slot);
            return tally.frames_not_wanted.one();
        };
        slot.acquisition = acquisition;
        // As many places as slots: the queue has space unless the stream is gone.
        if self.full.as_ref().is_none_or(|full| full.try_send(slot).is_err()) {
            self.shared.lose(LossKind::Dropped, frame.meta.number);
        }
    }

    /// Returns whether both threads are at work.
    fn is_whole(&self) -> bool {
        let runs = |thread: &Option<JoinHandle<()>>| thread.as_ref().is_some_and(|thread| !thread.is_finished());
        runs(&self.stream) && runs(&self.listener)
    }

    fn join(&mut self) {
        let Some(full) = self.full.take() else { return };
        // Before the hang-up, after which both end: the stream by itself, the control side by its flag.
        self.is_lost = !self.is_whole();
        self.shared.hang_up(self.clock.now() + FAREWELL);
        drop(full);
        self.is_lost |= self.stream.take().is_some_and(|stream| stream.join().is_err());
        self.shared.end();
        self.is_lost |= self.listener.take().is_some_and(|listener| listener.join().is_err());
    }
}

/// Returns where discovery comes in by broadcast, as far as the system allows; without, the camera is found by its
/// address.
fn receive_broadcasts(found: &Interface, port: u16) -> Vec<UdpSocket> {
    let to = [Ipv4Addr::BROADCAST, found.broadcast()];
    to.into_iter().filter_map(|broadcast| interface::broadcast_socket(broadcast, port).ok()).collect()
}

impl Sink for NetworkCamera {
    fn name(&self) -> &'static str {
        NAME
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        if self.full.is_none() {
            self.refused += 1;
            return Err(SinkError::Finished { sink: NAME, frame: frame.meta.number });
        }
        if !self.is_whole() {
            self.refused += 1;
            return Err(SinkError::Lost { sink: NAME });
        }
        self.run_crc32.add(frame.meta.number, pixel_crc32(&frame.image));
        self.frames += 1;
        self.offer(frame);
        Ok(())
    }

    fn counts(&self) -> Vec<(&'static str, u64)> {
        self.counters().named()
    }

    fn take_losses(&mut self, announce: &mut dyn FnMut(Loss)) {
        self.shared.take_losses(announce);
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        self.join();
        if self.is_lost {
            return Err(SinkError::Lost { sink: NAME });
        }
        Ok(SinkSummary {
            sink: NAME,
            frames: self.frames,
            refused: self.refused,
            bytes: self.shared.tally.bytes.read(),
            run_crc32: self.run_crc32.value(),
            output: Some(PathBuf::from(self.address.to_string())),
        })
    }
}

impl Drop for NetworkCamera {
    fn drop(&mut self) {
        self.join();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use frames::sink::sample::sample_frame;

    const SENSOR: SensorParams = SensorParams {
        size_px: [31, 17],
        bits: 16,
        frame_rate_hz: 10.0,
        exposure_s: 0.1,
        gain_e_per_dn: 2.5,
        temperature_c: 20.0,
        colours: None,
    };

    /// Returns a thread that broke down.
    fn broken() -> JoinHandle<()> {
        let thread = std::thread::Builder::new().name("broken".into()).spawn(|| panic!("for a test")).unwrap();
        while !thread.is_finished() {
            std::thread::yield_now();
        }
        thread
    }

    fn camera() -> NetworkCamera {
        let params = Params { port: 0, ..Params::default() };
        NetworkCamera::start(&params, &SENSOR, None, Arc::new(Monotonic::start())).unwrap()
    }

    fn is_lost<T>(result: &Result<T, SinkError>) -> bool {
        matches!(result, Err(SinkError::Lost { sink: NAME }))
    }

    #[test]
    fn a_camera_whose_thread_broke_down_says_so() {
        let whole = &mut camera();
        whole.send(&sample_frame(1)).unwrap();
        whole.finish().unwrap();
        let mut without_stream = camera();
        without_stream.stream = Some(broken());
        let mut without_control = camera();
        without_control.shared.end();
        without_control.listener = Some(broken());
        for mut camera in [without_stream, without_control] {
            assert!(is_lost(&camera.send(&sample_frame(1))));
            assert!(is_lost(&camera.finish()) && is_lost(&camera.finish()), "the same answer again");
            assert!(matches!(camera.send(&sample_frame(2)), Err(SinkError::Finished { .. })));
            assert_eq!((camera.frames, camera.refused), (0, 2));
        }
    }
}
