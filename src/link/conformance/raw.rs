//! Packets: order, bytes, stamps, limits, counters.

use super::exchange::packet;
use super::suite::{PATIENCE, Suite};
use crate::{Datagram, Link, LinkCounters, LinkError, Packet, SerialChunk, WireFormat};
use base::time::{Span, Tai};
use firmware_protocol::can::CanFrame;

/// Longest time by which a stamp may precede the sending: the kernel's stamps come over a paired reading of two clocks.
const STAMP_UNCERTAINTY: Span = Span::from_ns(100_000);
/// Packets sent without a pause.
const BURST: usize = 1000;
const STAMPED: usize = 100;
const ECHOES: usize = 300;

pub(super) fn lengths_and_order(suite: &mut Suite<'_>) -> Result<String, String> {
    let (mut near, mut far) = suite.pair()?;
    let lengths = suite.lengths.clone();
    for direction in ["there", "back"] {
        // Up and down again: no packet may profit from bytes of the one before it.
        for (number, len) in lengths.iter().chain(lengths.iter().rev()).enumerate() {
            let packet = packet(suite.format, number, *len)?;
            let named = |broken| format!("{direction}, {len} bytes: {broken}");
            suite.carry(&mut *near, &mut *far, &[packet]).map_err(named)?;
        }
        let mixed: Result<Vec<_>, _> =
            (0..64).map(|number| packet(suite.format, number, lengths[number * 7 % lengths.len()])).collect();
        suite.carry(&mut *near, &mut *far, &mixed?).map_err(|broken| format!("{direction}, 64 in a row: {broken}"))?;
        suite.expect_nothing(&mut *far)?;
        suite.expect_nothing(&mut *near)?;
        core::mem::swap(&mut near, &mut far);
    }
    Ok(format!("{} lengths, to {} bytes", lengths.len(), lengths.last().unwrap_or(&0)))
}

pub(super) fn stamps(suite: &mut Suite<'_>) -> Result<String, String> {
    let (mut near, mut far) = suite.pair()?;
    let (mut newest, mut oldest_age) = (Tai::from_ns(i64::MIN), Span::ZERO);
    for number in 0..STAMPED {
        let packet = packet(suite.format, number, suite.usual_length())?;
        let before = suite.clock.now();
        let leaves = near.send(&packet).map_err(|error| error.to_string())?;
        let at = suite.expect(&mut *far, &[packet])?.ok_or("no stamp")?;
        let after = suite.clock.now();
        if at > after || leaves < before {
            return Err(format!("packet {number}: stamped {} ns after it was received", (at - after).ns()));
        }
        if at + STAMP_UNCERTAINTY < before {
            return Err(format!("packet {number}: stamped {} ns before it was sent", (before - at).ns()));
        }
        if at < newest {
            return Err(format!("packet {number}: stamped {} ns before the one before it", (newest - at).ns()));
        }
        newest = at;
        oldest_age = oldest_age.max(after - at);
    }
    let unstamped = far.counters().unstamped;
    Ok(format!("{STAMPED} packets, read {:.1} us after their stamp at most, {unstamped} unstamped", us(oldest_age)))
}

pub(super) fn timeouts(suite: &mut Suite<'_>) -> Result<String, String> {
    let (mut near, _far) = suite.pair()?;
    let mut latest = Span::ZERO;
    for ms in [0, 1, 2, 5, 10, 20] {
        let until = suite.clock.now() + Span::from_ms(ms);
        let got = near.receive(until).map_err(|error| error.to_string())?;
        let ended = suite.clock.now();
        if let Some(packet) = got {
            return Err(format!("a packet arrived that was not sent: {:?}", packet.value));
        }
        if ended < until {
            return Err(format!("a wait of {ms} ms ended {:.1} us early", us(until - ended)));
        }
        latest = latest.max(ended - until);
    }
    Ok(format!("up to 20 ms, {:.1} us late at most", us(latest)))
}

pub(super) fn waiting_packet(suite: &mut Suite<'_>) -> Result<String, String> {
    let (mut near, mut far) = suite.pair()?;
    let packet = packet(suite.format, 1, suite.usual_length())?;
    near.send(&packet).map_err(|error| error.to_string())?;
    let sent = suite.clock.now();
    suite.clock.sleep_until(sent + Span::from_ms(50));
    let got = far.receive(sent - Span::from_ms(1000)).map_err(|error| error.to_string())?;
    match got {
        Some(got) if got.value == packet => Ok("with a limit a second ago".into()),
        other => Err(format!("wanted the packet that waits, got {other:?}")),
    }
}

pub(super) fn wrong_kind(suite: &mut Suite<'_>) -> Result<String, String> {
    let (mut near, mut far) = suite.pair()?;
    let (classic, fd) = (CanFrame::classic(1, &[1]).map(Packet::Can), CanFrame::fd(1, &[1; 12]).map(Packet::Can));
    let serial = SerialChunk::new(&[1]).map(Packet::Serial);
    let datagram = Datagram::new(&[1]).map(Packet::Datagram);
    let wrong = match suite.format {
        WireFormat::CanClassic => vec![fd, serial, datagram],
        WireFormat::CanFd => vec![serial, datagram],
        WireFormat::Serial => vec![classic, fd, datagram],
        WireFormat::Plain => vec![classic, fd, serial],
    };
    for packet in wrong.iter().flatten() {
        match near.send(packet) {
            Err(LinkError::WrongPacket { .. }) => {}
            other => return Err(format!("a {} packet: wanted a refusal, got {other:?}", packet.kind())),
        }
    }
    let right = packet(suite.format, 1, suite.usual_length())?;
    suite.carry(&mut *near, &mut *far, &[right])?;
    if near.counters().sent != 1 {
        return Err(format!("refused packets count as sent: {:?}", near.counters()));
    }
    Ok(format!("{} kinds", wrong.len()))
}

pub(super) fn burst(suite: &mut Suite<'_>) -> Result<String, String> {
    let (mut near, mut far) = suite.pair()?;
    let longest = suite.longest();
    let packets: Result<Vec<_>, _> = (0..BURST).map(|number| packet(suite.format, number, longest)).collect();
    let began = suite.clock.now();
    suite.carry(&mut *near, &mut *far, &packets?)?;
    let took = suite.clock.now() - began;
    suite.expect_nothing(&mut *far)?;
    let sent = LinkCounters { sent: BURST as u64, ..LinkCounters::default() };
    // How many reads a serial line takes is its own affair; packets are packets elsewhere.
    let reads = if suite.format == WireFormat::Serial { far.counters().received } else { BURST as u64 };
    let got = LinkCounters { received: reads.max(1), ..LinkCounters::default() };
    if near.counters() != sent || (LinkCounters { unstamped: 0, ..far.counters() }) != got {
        return Err(format!("sender {:?}, receiver {:?}", near.counters(), far.counters()));
    }
    let rate = BURST as f64 / took.s();
    Ok(format!("{BURST} packets of {longest} bytes in {:.1} ms: {rate:.0} a second", took.ms()))
}

/// Checks that each packet wakes the far end, which waits on a thread of its own.
pub(super) fn echo(suite: &mut Suite<'_>) -> Result<String, String> {
    // The far end outlives the exchange: closing a pseudo terminal discards bytes on their way.
    let (mut near, mut far) = suite.pair()?;
    let len = suite.longest();
    let packets: Result<Vec<_>, _> = (0..ECHOES).map(|number| packet(suite.format, number, len)).collect();
    let (packets, bytes, clock) = (packets?, ECHOES * len, suite.clock);
    let far = &mut *far;
    let trips = std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().name("echo".into());
        let echoing = thread.spawn_scoped(scope, move || send_back(far, bytes, || clock.now() + PATIENCE));
        let echoing = echoing.map_err(|error| error.to_string())?;
        let trips = packets.iter().map(|packet| round_trip(suite, &mut *near, packet)).collect::<Result<Vec<_>, _>>();
        let echoed = echoing.join().map_err(|_| "the echo panicked".to_owned());
        let with_echo = |broken: String| format!("{broken}; at the other end: {echoed:?}");
        let trips = trips.map_err(with_echo)?;
        echoed?.map(|()| trips)
    });
    let mut trips = trips?;
    trips.sort_unstable();
    let at = |share: f64| trips.get((trips.len() as f64 * share) as usize).map_or(0.0, |span| us(*span));
    Ok(format!("{ECHOES} round trips of {len} bytes: p50 {:.1} us, p99 {:.1} us", at(0.5), at(0.99)))
}

fn round_trip(suite: &Suite<'_>, near: &mut dyn Link, packet: &Packet) -> Result<Span, String> {
    let began = suite.clock.now();
    near.send(packet).map_err(|error| error.to_string())?;
    suite
        .expect(near, core::slice::from_ref(packet))
        .map_err(|broken| format!("{broken}; at this end: {:?}", near.counters()))?;
    Ok(suite.clock.now() - began)
}

/// Sends back the packets that arrive until they were `bytes` bytes.
fn send_back(link: &mut dyn Link, mut bytes: usize, limit: impl Fn() -> Tai) -> Result<(), String> {
    while bytes > 0 {
        let packet = link.receive(limit()).map_err(|error| error.to_string())?.ok_or("nothing to send back")?;
        link.send(&packet.value).map_err(|error| error.to_string())?;
        if link.counters().unsent != 0 || link.counters().lost != 0 {
            return Err(format!("{:?}", link.counters()));
        }
        bytes = bytes.saturating_sub(packet.value.data().len());
    }
    Ok(())
}

fn us(span: Span) -> f64 {
    span.ns() as f64 / 1e3
}
