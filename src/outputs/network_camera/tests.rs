//! The camera on loopback: the promises of every sink, and hostile clients.

use super::*;
use crate::network_camera::features::{at, own};
use base::{clock::Monotonic, image::DnImage};
use core::cell::Cell;
use core::sync::atomic::{AtomicBool, Ordering};
use frames::sink::{Loss, LossKind, SentFrame, Sink, compliance::check_sink, sample::sample_frame};
use std::net::{Ipv4Addr, UdpSocket};
use std::{sync::Arc, time::Duration};

/// Long enough for any machine.
const PATIENCE: Duration = Duration::from_secs(20);
const SENSOR: SensorParams = SensorParams {
    size_px: [31, 17],
    bits: 16,
    frame_rate_hz: 10.0,
    exposure_s: 0.1,
    gain_e_per_dn: 2.5,
    temperature_c: 20.0,
    colours: None,
};

/// Returns the number of sent frames whose outcome was counted.
fn accounted(counters: &Counters) -> u64 {
    let Counters { frames_not_wanted, frames_of_another_size, frames_dropped, .. } = counters;
    let Counters { frames_sent, frames_refused, frames_cut, .. } = counters;
    frames_not_wanted + frames_of_another_size + frames_dropped + frames_sent + frames_refused + frames_cut
}

/// Returns the numbers of the frames of each kind of loss that the camera reports.
fn lost(camera: &mut NetworkCamera, wanted: LossKind) -> Vec<u32> {
    let mut numbers = Vec::new();
    camera.take_losses(&mut |Loss { kind, frame }| {
        assert_eq!(kind, wanted, "frame {frame}");
        numbers.push(frame);
    });
    numbers
}

fn camera(params: &Params) -> NetworkCamera {
    let params = Params { port: 0, ..params.clone() };
    NetworkCamera::start(&params, &SENSOR, None, Arc::new(Monotonic::start())).unwrap()
}

/// As little of a client as makes frames come.
struct Client {
    control: UdpSocket,
    stream: UdpSocket,
    /// Number of the last command.
    id: Cell<u16>,
}

impl Client {
    fn of(camera: &NetworkCamera) -> Self {
        let socket = || {
            let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
            socket.set_read_timeout(Some(PATIENCE)).unwrap();
            socket
        };
        let client = Self { control: socket(), stream: socket(), id: Cell::new(0) };
        client.control.connect(camera.address()).unwrap();
        client
    }

    fn write(&self, address: u32, value: u32) {
        let payload = [address.to_be_bytes(), value.to_be_bytes()].concat();
        self.id.set(self.id.get() + 1);
        let id = self.id.get().to_be_bytes();
        self.control.send(&[&[0x42, 1, 0, 0x82, 0, 8][..], &id, &payload].concat()).unwrap();
        let mut answer = [0; 64];
        let bytes = self.control.recv(&mut answer).unwrap();
        assert_eq!(answer[..bytes], [&[0, 0, 0, 0x83, 0, 4][..], &id, &[0, 0, 0, 1]].concat(), "{address:x}");
    }

    /// Returns the data of one READMEM.
    fn read(&self, address: u32, bytes: u32) -> Vec<u8> {
        self.id.set(self.id.get() + 1);
        let id = self.id.get().to_be_bytes();
        let payload = [address.to_be_bytes(), bytes.to_be_bytes()].concat();
        self.control.send(&[&[0x42, 1, 0, 0x84, 0, 8][..], &id, &payload].concat()).unwrap();
        let mut answer = [0; 600];
        let bytes = self.control.recv(&mut answer).unwrap();
        answer[12..bytes].to_vec()
    }

    /// Reads the XML's first word where the camera shows it to this client.
    fn prove_address(&self) {
        let url = String::from_utf8(self.read(at::FIRST_URL, 512)).unwrap();
        let address = u32::from_str_radix(url.split(';').nth(1).unwrap(), 16).unwrap();
        assert_eq!(self.read(address, 4).len(), 4);
    }

    fn start(&self) {
        self.prove_address();
        self.write(at::CONTROL, 2);
        self.write(at::STREAM_ADDRESS, Ipv4Addr::LOCALHOST.to_bits());
        self.write(at::STREAM_PORT, self.stream.local_addr().unwrap().port().into());
        self.write(own::ACQUISITION_START, 1);
    }

    fn ask_again(&self, block: u16, first: u32, last: u32) {
        let request = [u32::from(block), first, last].map(u32::to_be_bytes).concat();
        self.control.send(&[&[0x42, 0, 0, 0x40, 0, 12, 0, 1][..], &request].concat()).unwrap();
    }

    /// Returns the next packet of the stream.
    fn packet(&self) -> Vec<u8> {
        let mut packet = [0; 2048];
        let bytes = self.stream.recv(&mut packet).unwrap();
        packet[..bytes].to_vec()
    }
}

fn bytes_of(image: &DnImage) -> Vec<u8> {
    image.pixels().iter().flat_map(|dn| dn.to_le_bytes()).collect()
}

#[test]
fn the_network_camera_complies() {
    check_sink(|| Box::new(camera(&Params::default()))).unwrap();
}

/// Returns leader, payload and trailer of one block; the payload joined.
fn block(client: &Client) -> (u16, Vec<u8>) {
    let leader = client.packet();
    assert_eq!((leader[4], leader.len()), (1, 44), "a leader");
    let mut payload = Vec::new();
    loop {
        let packet = client.packet();
        assert_eq!(packet[2..4], leader[2..4], "one block at a time");
        match packet[4] {
            3 => payload.extend(&packet[8..]),
            2 => return (u16::from_be_bytes([leader[2], leader[3]]), payload),
            kind => panic!("packet of kind {kind}"),
        }
    }
}

#[test]
fn frames_arrive_bit_for_bit_with_their_truth_and_again_when_asked() {
    let mut camera = camera(&Params { packet_bytes: 576, ..Params::default() });
    let client = Client::of(&camera);
    camera.send(&sample_frame(1)).unwrap();
    assert_eq!(camera.counters().frames_not_wanted, 1, "no client asked");
    client.start();
    camera.send(&sample_frame(2)).unwrap();
    let (id, payload) = block(&client);
    assert_eq!((id, payload), (1, bytes_of(&sample_frame(2).image)));
    client.ask_again(1, 1, 2);
    let again = [client.packet(), client.packet()];
    assert_eq!(again.map(|packet| packet[8..].to_vec()).concat(), bytes_of(&sample_frame(2).image));
    client.ask_again(9, 1, 1);
    assert_eq!(client.packet(), [0x80, 0x0C, 0, 9, 3, 0, 0, 1], "a block that never was");
    client.write(own::ACQUISITION_STOP, 1);
    client.write(own::CHUNK_MODE, 1);
    client.write(own::ACQUISITION_START, 1);
    camera.send(&sample_frame(3)).unwrap();
    let (id, payload) = block(&client);
    let (image, truth) = payload.split_at(31 * 17 * 2);
    assert_eq!((id, image), (2, bytes_of(&sample_frame(3).image).as_slice()), "blocks go on: the stream is the same");
    let mut wanted = Vec::new();
    chunk::append_chunks(&sample_frame(3).meta, image.len(), &mut wanted);
    assert_eq!(truth, wanted);
    camera.finish().unwrap();
    let counters = camera.counters();
    assert_eq!((counters.frames_offered, counters.frames_sent, counters.frames_dropped), (3, 2, 0));
    assert_eq!((counters.resends_asked, counters.resends_served, counters.resends_gone), (3, 2, 1));
}

#[test]
fn a_frame_that_finds_no_slot_is_dropped_and_counted_at_once() {
    // At this pace one frame of 1 kB takes 8 ms: of many frames sent at once most find no slot.
    let mut camera = camera(&Params { rate_bit_s: 1e6, frames_queued: 1, ..Params::default() });
    let client = Client::of(&camera);
    client.start();
    for number in 1..=200 {
        camera.send(&sample_frame(number)).unwrap();
    }
    camera.finish().unwrap();
    let counters = camera.counters();
    assert!(counters.frames_dropped > 0 && counters.frames_sent > 0, "{counters:?}");
    assert_eq!(counters.frames_sent + counters.frames_dropped, 200, "{counters:?}");
    let lost = lost(&mut camera, LossKind::Dropped);
    assert_eq!(lost.len() as u64, counters.frames_dropped, "each is named once: {lost:?}");
    assert!(lost.is_sorted_by(|a, b| a < b) && !lost.contains(&1), "the first found a slot: {lost:?}");
}

#[test]
fn garbage_and_endless_requests_lose_no_frame() {
    let mut camera = camera(&Params { rate_bit_s: 1e9, frames_queued: 16, ..Params::default() });
    let client = Client::of(&camera);
    client.start();
    for round in 0..50_u8 {
        for length in 0..20 {
            client.control.send(&vec![round; length]).unwrap();
        }
        client.ask_again(1, 0, 0xFF_FFFF);
    }
    for number in 1..=10 {
        camera.send(&sample_frame(number)).unwrap();
    }
    // Everything that was taken is out when this returns.
    camera.finish().unwrap();
    let counters = camera.counters();
    assert_eq!((counters.frames_sent, counters.frames_dropped), (10, 0), "{counters:?}");
    assert!(counters.malformed.values().sum::<u64>() > 0, "{counters:?}");
}

#[test]
fn a_second_camera_on_the_same_port_is_refused_and_another_address_is_free() {
    let first = camera(&Params::default());
    let taken = Params { port: first.address().port(), ..Params::default() };
    let error = NetworkCamera::start(&taken, &SENSOR, None, Arc::new(Monotonic::start())).err().unwrap();
    assert!(error.to_string().starts_with("network camera at 127.0.0.1:"), "{error}");
    let beside = Params { address: Ipv4Addr::new(127, 0, 0, 2), ..taken };
    NetworkCamera::start(&beside, &SENSOR, None, Arc::new(Monotonic::start())).unwrap();
}

#[test]
fn invalid_parameters_are_refused_in_words() {
    let base = Params { port: 0, ..Params::default() };
    let start = |params: Params| {
        NetworkCamera::start(&params, &SENSOR, None, Arc::new(Monotonic::start())).err().map(|error| error.to_string())
    };
    assert_eq!(start(base.clone()), None);
    let reported = |params| start(params).unwrap();
    assert!(reported(Params { packet_bytes: 575, ..base.clone() }).contains("576 to 65532"));
    assert!(reported(Params { rate_bit_s: f64::NAN, ..base.clone() }).contains("rate_bit_s"));
    assert!(reported(Params { frames_kept: 0, ..base.clone() }).contains("frames_kept"));
    let identity = Identity { serial: "sixteen letters.".into(), ..Identity::default() };
    assert!(reported(Params { identity, ..base.clone() }).contains("15 plain"));
    let identity = Identity { model: "<a>".into(), ..Identity::default() };
    assert!(reported(Params { identity, ..base }).contains("model"));
}

/// Returns a frame of 64 KiB: half a second at 1 Mbit/s.
fn large_frame(number: u32) -> SentFrame {
    let mut frame = SentFrame::with_capacity(256, 128, 0, "large".into());
    frame.meta.number = number;
    frame
}

#[test]
fn end_of_a_run_ignores_a_slow_pace_and_counts_unsent_frames() {
    let params = Params { port: 0, rate_bit_s: 1e6, frames_queued: 16, ..Params::default() };
    let sensor = SensorParams { size_px: [256, 128], ..SENSOR };
    let mut camera = NetworkCamera::start(&params, &sensor, None, Arc::new(Monotonic::start())).unwrap();
    let client = Client::of(&camera);
    client.start();
    client.write(at::PACKET_DELAY, 10_000_000);
    (1..=16).for_each(|number| camera.send(&large_frame(number)).unwrap());
    camera.finish().unwrap();
    let counters = camera.counters();
    assert_eq!((counters.frames_offered, accounted(&counters), counters.frames_dropped), (16, 16, 0), "{counters:?}");
    // The pace alone needs 8 s for them.
    assert!(counters.frames_cut > 8, "{counters:?}");
    let last: Vec<u32> = (1..=16).skip(16 - usize::try_from(counters.frames_cut).unwrap()).collect();
    assert_eq!(lost(&mut camera, LossKind::Cut), last, "those that came last, each once");
}

#[test]
fn a_client_that_never_stops_asking_does_not_hold_up_the_end() {
    let mut camera = camera(&Params::default());
    let client = Client::of(&camera);
    client.start();
    camera.send(&sample_frame(1)).unwrap();
    block(&client);
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !is_over.load(Ordering::Acquire) {
                let request = [1_u32, 0, 0].map(u32::to_be_bytes).concat();
                // Refused when the camera is gone.
                let _ = client.control.send(&[&[0x42, 0, 0, 0x40, 0, 12, 0, 1][..], &request].concat());
                std::thread::yield_now();
            }
        });
        camera.finish().unwrap();
        is_over.store(true, Ordering::Release);
    });
    let counters = camera.counters();
    assert!(counters.resends_refused > 0, "beyond what one frame may cost: {counters:?}");
}

#[test]
fn packets_are_sent_again_between_frames_and_every_one_is_accounted_for() {
    let mut camera = camera(&Params { packet_bytes: 576, ..Params::default() });
    let client = Client::of(&camera);
    client.start();
    camera.send(&sample_frame(1)).unwrap();
    block(&client);
    // Leader, two of payload, trailer; no frame follows that would carry them.
    client.ask_again(1, 0, 1);
    client.ask_again(1, 2, 5);
    assert_eq!([0; 4].map(|_| client.packet()[7]), [0, 1, 2, 3], "two packets past the end are none");
    // Four more may be sent again for this frame: three are answered as gone, and one is sent.
    client.ask_again(7, 0, 2);
    client.ask_again(1, 0, 0);
    client.ask_again(1, 0, 0);
    client.ask_again(7, 0, 99);
    let heads = [0; 4].map(|_| client.packet()[..8].to_vec());
    let gone = |number| vec![0x80, 0x0C, 0, 7, 3, 0, 0, number];
    assert_eq!(heads, [gone(0), gone(1), gone(2), vec![0, 0, 0, 1, 1, 0, 0, 0]]);
    camera.finish().unwrap();
    let counters = camera.counters();
    assert_eq!((counters.resends_served, counters.resends_gone, counters.resends_refused), (5, 3, 2 + 1 + 100));
    assert_eq!(counters.resends_asked, 5 + 3 + 103);
}

#[test]
fn single_frames_are_never_spent_on_the_acquisition_before() {
    let mut camera = camera(&Params { rate_bit_s: 1e10, frames_queued: 16, ..Params::default() });
    let client = Client::of(&camera);
    client.start();
    client.write(own::ACQUISITION_STOP, 1);
    client.write(own::ACQUISITION_MODE, 1);
    let is_over = Arc::new(AtomicBool::new(false));
    let reported = Arc::clone(&is_over);
    let feed = std::thread::Builder::new().name("feed".into()).spawn(move || {
        while !reported.load(Ordering::Acquire) {
            camera.send(&sample_frame(1)).unwrap();
        }
        camera
    });
    for number in 1..=200 {
        client.write(own::ACQUISITION_START, 1);
        assert_eq!(block(&client).0, number, "the only one of its acquisition");
        client.write(own::ACQUISITION_STOP, 1);
    }
    is_over.store(true, Ordering::Release);
    let mut camera = feed.unwrap().join().unwrap();
    camera.finish().unwrap();
    let counters = camera.counters();
    assert_eq!((counters.frames_sent, counters.frames_cut), (200, 0), "{counters:?}");
    assert_eq!(accounted(&counters), counters.frames_offered);
}

#[test]
fn stream_to_a_port_that_is_closed_is_stopped_by_the_answer_of_the_network() {
    let mut camera = camera(&Params { frames_queued: 16, ..Params::default() });
    let client = Client::of(&camera);
    client.start();
    camera.send(&sample_frame(1)).unwrap();
    assert_eq!(block(&client).0, 1);
    // The client breaks down: its control port stays, its stream port is closed.
    let Client { control, stream, id } = client;
    drop(stream);
    let mut number = 2;
    while camera.counters().receivers_gone == 0 {
        assert!(number < 2_000, "never noticed: {:?}", camera.counters());
        camera.send(&sample_frame(number)).unwrap();
        std::thread::sleep(Duration::from_millis(5));
        number += 1;
    }
    // A new acquisition of the same client runs.
    let stream = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let client = Client { control, stream, id };
    client.start();
    camera.send(&sample_frame(number)).unwrap();
    assert_eq!(block(&client).0, 1);
    camera.finish().unwrap();
    let counters = camera.counters();
    assert_eq!(counters.receivers_gone, 1);
    assert_eq!(accounted(&counters), counters.frames_offered, "{counters:?}");
}

#[test]
fn client_that_never_reads_an_answer_gets_no_stream() {
    let mut camera = camera(&Params { frames_queued: 16, ..Params::default() });
    let client = Client::of(&camera);
    let write = |id: u8, words: &[u32]| {
        let payload: Vec<u8> = words.iter().flat_map(|word| word.to_be_bytes()).collect();
        let length = u8::try_from(payload.len()).unwrap();
        client.control.send(&[&[0x42, 1, 0, 0x82, 0, length, 0, id][..], &payload].concat()).unwrap()
    };
    let port = u32::from(client.stream.local_addr().unwrap().port());
    let address = Ipv4Addr::LOCALHOST.to_bits();
    let words = [at::STREAM_PORT, port, at::STREAM_ADDRESS, address, own::ACQUISITION_START, 1];
    let sent = write(1, &[at::CONTROL, 2]) + write(2, &words);
    let mut answers = 0;
    let mut answer = [0; 600];
    (0..2).for_each(|_| answers += client.control.recv(&mut answer).unwrap());
    (1..=20).for_each(|number| camera.send(&sample_frame(number)).unwrap());
    camera.finish().unwrap();
    let counters = camera.counters();
    assert_eq!((counters.packets, counters.frames_not_wanted, counters.unproven_refused), (0, 20, 1), "{counters:?}");
    assert!(answers <= 3 * sent, "{answers} bytes for {sent}");
}

#[test]
fn a_lower_rate_is_each_nth_frame_and_test_packets_are_counted() {
    let mut camera = camera(&Params { frames_queued: 16, ..Params::default() });
    let client = Client::of(&camera);
    client.prove_address();
    client.write(at::CONTROL, 2);
    let [high, low] = [(2.5_f64.to_bits() >> 32) as u32, 2.5_f64.to_bits() as u32];
    client.write(own::FRAME_RATE, high);
    client.write(own::FRAME_RATE_LOW, low);
    client.start();
    client.write(at::PACKET_SIZE, 0x8000_0000 | 1000);
    assert_eq!(client.packet(), [0; 972]);
    (1..=10).for_each(|number| camera.send(&sample_frame(number)).unwrap());
    for number in [1, 5, 9] {
        assert_eq!(block(&client).1, bytes_of(&sample_frame(number).image), "{number}");
    }
    camera.finish().unwrap();
    let counters = camera.counters();
    assert_eq!((counters.frames_sent, counters.frames_not_wanted, counters.test_packets), (3, 7, 1), "{counters:?}");
}
