//! The C functions. The only file with `unsafe`: pointers come from C.
//!
//! Every function has the preconditions of the header: pointers are valid for the structure or length that they
//! refer to and are not used by another thread meanwhile, decoders were initialised, and `number` of a message names
//! the member that was written.

#![allow(unsafe_code, reason = "a C interface: raw pointers and a union; each block says what it rests on")]

use crate::layout::{RawAttitude, RawBurst, RawCameraStatus, RawCell, RawCommand, RawExposure, RawHeartbeat, RawPair, RawResponse, RawStatus, RawSync, RawTime, RawWheels};
use core::mem::{MaybeUninit, align_of, size_of};
use core::{ffi::c_int, ptr::NonNull, slice};
use firmware_protocol::can::{self, CanFrame, CanId, FRAMES_MAX, Format, IdMap};
use firmware_protocol::{EncodeError, Message, MessageId, PAYLOAD_MAX, Reject, serial};
use firmware_protocol::crc::Crc16;

const MESSAGE: c_int = 1;
const NOTHING: c_int = 0;
const ERROR_RANGE: c_int = -1;
const ERROR_NOT_CARRIED: c_int = -2;

/// The union of `sl_message`: plain numbers, so that every bit pattern is a value.
#[repr(C)]
union Body {
    sync: RawSync,
    time: RawTime,
    attitude: RawAttitude,
    burst: RawBurst,
    pair: RawPair,
    wheels: RawWheels,
    exposure: RawExposure,
    status: RawStatus,
    camera_status: RawCameraStatus,
    cell: RawCell,
    command: RawCommand,
    response: RawResponse,
    heartbeat: RawHeartbeat,
}

/// `sl_message`
#[repr(C)]
pub(crate) struct RawMessage {
    number: u8,
    body: Body,
}

/// `sl_frame`
#[repr(C)]
pub(crate) struct RawFrame {
    id: u32,
    fd: u8,
    len: u8,
    data: [MaybeUninit<u8>; 64],
}

/// One serial packet.
type Line = [u8; serial::ENCODED_MAX];

/// Space of `sl_can_decoder` for the crate's decoder.
#[repr(C)]
pub(crate) struct CanSpace([u64; 8]);

/// Space of `sl_serial_decoder` for the crate's decoder.
#[repr(C)]
pub(crate) struct SerialSpace([u64; 16]);

const _: () = assert!(size_of::<can::Decoder>() <= size_of::<CanSpace>());
const _: () = assert!(align_of::<can::Decoder>() <= align_of::<CanSpace>());
const _: () = assert!(size_of::<serial::Decoder>() <= size_of::<SerialSpace>());
const _: () = assert!(align_of::<serial::Decoder>() <= align_of::<SerialSpace>());

unsafe extern "C" {
    /// Ends the program; supplied by it, and never returns.
    fn sl_panic();
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    // SAFETY: a C function without arguments, which the program defines.
    unsafe { sl_panic() };
    loop {
        core::hint::spin_loop();
    }
}

fn rejected(reason: Reject) -> c_int {
    -1 - c_int::from(reason.code())
}

fn failed(error: EncodeError) -> c_int {
    match error {
        EncodeError::NotCarried { .. } => ERROR_NOT_CARRIED,
        EncodeError::OutOfRange { .. } | EncodeError::BufferTooShort { .. } => ERROR_RANGE,
    }
}

/// Returns the message of the crate; `None` when it has none of these values.
fn read(raw: &RawMessage) -> Option<Message> {
    let id = MessageId::from_number(raw.number).ok()?;
    // SAFETY: the caller wrote the member that `number` names, and every bit pattern is a value of it.
    unsafe {
        match id {
            MessageId::Sync => Some(Message::Sync(raw.body.sync.read())),
            MessageId::TimeFollowUp => raw.body.time.read().map(Message::TimeFollowUp),
            MessageId::Attitude => Some(Message::Attitude(raw.body.attitude.read())),
            MessageId::Jitter => raw.body.burst.read().map(Message::Jitter),
            MessageId::JitterPair => Some(Message::JitterPair(raw.body.pair.read())),
            MessageId::Wheels => Some(Message::Wheels(raw.body.wheels.read())),
            MessageId::Exposure => Some(Message::Exposure(raw.body.exposure.read())),
            MessageId::Status => raw.body.status.read().map(Message::Status),
            MessageId::CameraStatus => raw.body.camera_status.read().map(Message::Camera),
            MessageId::Table => raw.body.cell.read().map(Message::Table),
            MessageId::Command => Some(Message::Command(raw.body.command.read())),
            MessageId::Response => raw.body.response.read().map(Message::Response),
            MessageId::Heartbeat => raw.body.heartbeat.read().map(Message::Heartbeat),
            _ => None,
        }
    }
}

/// Returns the C form of a message; what it does not use is zero.
fn raw_of(message: &Message) -> RawMessage {
    // SAFETY: the structure consists of numbers, for which zero is a value.
    let mut raw: RawMessage = unsafe { core::mem::zeroed() };
    raw.number = message.id().number();
    match message {
        Message::Sync(sync) => raw.body.sync = RawSync { counter: sync.counter },
        Message::TimeFollowUp(time) => raw.body.time = RawTime::of(time),
        Message::Attitude(record) => raw.body.attitude = RawAttitude::of(record),
        Message::Jitter(burst) => raw.body.burst = RawBurst::of(burst),
        Message::JitterPair(pair) => {
            raw.body.pair = RawPair { slot: pair.slot, samples_arcsec: pair.samples_arcsec };
        }
        Message::Wheels(wheels) => raw.body.wheels = RawWheels { speed_rpm: wheels.speed_rpm },
        Message::Exposure(exposure) => raw.body.exposure = RawExposure::of(exposure),
        Message::Status(page) => raw.body.status = RawStatus::of(page),
        Message::Camera(status) => raw.body.camera_status = RawCameraStatus::of(status),
        Message::Table(cell) => raw.body.cell = RawCell::of(cell),
        Message::Command(command) => raw.body.command = RawCommand::of(command),
        Message::Response(response) => raw.body.response = RawResponse::of(response),
        Message::Heartbeat(heartbeat) => {
            raw.body.heartbeat = RawHeartbeat { state: heartbeat.state as u8, major: heartbeat.major };
        }
    }
    raw
}

/// Returns the result of a reader.
fn outcome(read: Result<Option<Message>, Reject>, raw: &mut MaybeUninit<RawMessage>) -> c_int {
    match read {
        Ok(None) => NOTHING,
        Ok(Some(message)) => {
            raw.write(raw_of(&message));
            MESSAGE
        }
        Err(reason) => rejected(reason),
    }
}

/// Returns the `len` bytes at `bytes`.
///
/// # Safety
/// `bytes` is valid for reading `len` bytes as long as the result lives, unless `len` is 0.
unsafe fn bytes_at<'a>(bytes: *const u8, len: usize) -> &'a [u8] {
    if len == 0 {
        return &[];
    }
    // SAFETY: as asked of the caller.
    unsafe { slice::from_raw_parts(bytes, len) }
}

#[unsafe(no_mangle)]
unsafe extern "C" fn sl_crc16(crc: u16, bytes: *const u8, len: usize) -> u16 {
    // SAFETY: the header asks for `len` readable bytes.
    Crc16::from_value(crc).over(unsafe { bytes_at(bytes, len) }).value()
}

#[unsafe(no_mangle)]
extern "C" fn sl_table_crc(crc: u16, value: f32) -> u16 {
    Crc16::from_value(crc).over(&value.to_le_bytes()).value()
}

fn encode_payload(raw: &RawMessage, to: &mut MaybeUninit<[u8; PAYLOAD_MAX]>) -> Result<c_int, c_int> {
    let payload = read(raw).ok_or(ERROR_RANGE)?.payload().map_err(failed)?;
    let mut bytes = [0; PAYLOAD_MAX];
    for (to, from) in bytes.iter_mut().zip(payload.as_slice()) {
        *to = *from;
    }
    to.write(bytes);
    c_int::try_from(payload.as_slice().len()).map_err(|_| ERROR_RANGE)
}

#[unsafe(no_mangle)]
unsafe extern "C" fn sl_payload_encode(message: &RawMessage, payload: &mut MaybeUninit<[u8; PAYLOAD_MAX]>) -> c_int {
    encode_payload(message, payload).unwrap_or_else(|error| error)
}

#[unsafe(no_mangle)]
unsafe extern "C" fn sl_payload_decode(
    number: u8,
    payload: *const u8,
    len: usize,
    raw: &mut MaybeUninit<RawMessage>,
) -> c_int {
    // SAFETY: the header asks for `len` readable bytes.
    let bytes = unsafe { bytes_at(payload, len) };
    let read = MessageId::from_number(number).and_then(|id| Message::from_payload(id, bytes));
    outcome(read.map(Some), raw)
}

/// Returns the identifiers of a base, which has `SL_EXTENDED` for 29 bits; `None` when there are none.
fn ids(base: u32, node: u8) -> Option<IdMap> {
    CanId::from_flagged(base).and_then(|base| IdMap::of(base, node))
}

fn encode_frames(
    raw: &RawMessage,
    fd: bool,
    ids: Option<IdMap>,
    to: &mut [MaybeUninit<RawFrame>],
) -> Result<c_int, c_int> {
    let (message, ids) = read(raw).zip(ids).ok_or(ERROR_RANGE)?;
    let format = if fd { Format::Fd } else { Format::Classic };
    let frames = can::encode(&message, format, &ids).map_err(failed)?;
    let mut count = 0;
    for (to, frame) in to.iter_mut().zip(frames.iter()) {
        let mut data = [MaybeUninit::new(0); 64];
        for (to, from) in data.iter_mut().zip(frame.data()) {
            to.write(*from);
        }
        let len = u8::try_from(frame.data().len()).map_err(|_| ERROR_RANGE)?;
        to.write(RawFrame { id: frame.id().flagged(), fd: u8::from(frame.is_fd()), len, data });
        count += 1;
    }
    Ok(count)
}

#[unsafe(no_mangle)]
unsafe extern "C" fn sl_can_encode(
    message: &RawMessage,
    fd: c_int,
    base: u32,
    node: u8,
    frames: &mut [MaybeUninit<RawFrame>; FRAMES_MAX],
) -> c_int {
    encode_frames(message, fd != 0, ids(base, node), frames).unwrap_or_else(|error| error)
}

#[unsafe(no_mangle)]
unsafe extern "C" fn sl_can_decoder_init(decoder: NonNull<CanSpace>, base: u32, node: u8) -> c_int {
    let ids = ids(base, node);
    // SAFETY: the space is writable, large and aligned enough (asserted above); what was there is overwritten.
    unsafe { decoder.cast::<can::Decoder>().write(can::Decoder::new(ids.unwrap_or_default())) };
    if ids.is_some() { 0 } else { ERROR_RANGE }
}

#[unsafe(no_mangle)]
unsafe extern "C" fn sl_can_read(
    decoder: NonNull<CanSpace>,
    frame: &RawFrame,
    raw: &mut MaybeUninit<RawMessage>,
) -> c_int {
    // SAFETY: `sl_can_decoder_init` wrote a decoder there, and the caller uses it from one thread.
    let decoder = unsafe { decoder.cast::<can::Decoder>().as_mut() };
    let len = usize::from(frame.len).min(frame.data.len());
    // SAFETY: the header asks for `len` bytes of data that were written, and no frame has more than 64.
    let data = unsafe { bytes_at(frame.data.as_ptr().cast(), len) };
    let of = |id: CanId| CanFrame::classic(id, data).or_else(|| CanFrame::fd(id, data));
    // A frame of another length carries no legal message; 12 bytes, an illegal length of a message, replace it.
    let legal = CanId::from_flagged(frame.id).and_then(|id| of(id).or_else(|| CanFrame::fd(id, &[0; 12])));
    let read = match legal {
        Some(frame) => decoder.read(&frame),
        None => Err(Reject::UnknownId),
    };
    outcome(read, raw)
}

fn encode_packet(seq: &mut u8, raw: &RawMessage, line: &mut MaybeUninit<Line>) -> Result<c_int, c_int> {
    let message = read(raw).ok_or(ERROR_RANGE)?;
    let mut bytes = [0; serial::ENCODED_MAX];
    let written = serial::Encoder::starting_at(*seq).encode(&message, &mut bytes).map_err(failed)?;
    line.write(bytes);
    *seq = seq.wrapping_add(1);
    c_int::try_from(written).map_err(|_| ERROR_RANGE)
}

#[unsafe(no_mangle)]
unsafe extern "C" fn sl_serial_encode(seq: &mut u8, message: &RawMessage, line: &mut MaybeUninit<Line>) -> c_int {
    encode_packet(seq, message, line).unwrap_or_else(|error| error)
}

#[unsafe(no_mangle)]
unsafe extern "C" fn sl_serial_decoder_init(decoder: NonNull<SerialSpace>) {
    // SAFETY: the space is writable, large and aligned enough (asserted above); what was there is overwritten.
    unsafe { decoder.cast::<serial::Decoder>().write(serial::Decoder::new()) };
}

#[unsafe(no_mangle)]
unsafe extern "C" fn sl_serial_read(
    decoder: NonNull<SerialSpace>,
    byte: u8,
    raw: &mut MaybeUninit<RawMessage>,
) -> c_int {
    // SAFETY: `sl_serial_decoder_init` wrote a decoder there, and the caller uses it from one thread.
    let decoder = unsafe { decoder.cast::<serial::Decoder>().as_mut() };
    outcome(decoder.read_byte(byte), raw)
}
