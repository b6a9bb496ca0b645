//! What the stimulator tells the flight computer after each frame: EXPOSURE, and STATUS with the pointing rendered.

use crate::base::time::Span;
use crate::runtime::receiver::Receiver;
use crate::sink::{FaultFlags, FrameMeta};
use firmware_protocol::Message;
use firmware_protocol::message::{Exposure, PointingAngle, StatusPage, StimulatorMode};

/// Messages for one frame: EXPOSURE, state, and one pointing angle in turn. Nothing before the clocks are correlated.
pub fn frame_messages(meta: &FrameMeta, receiver: &Receiver) -> impl Iterator<Item = Message> + use<> {
    let estimate = receiver.clock().estimate();
    let exposure = estimate.map(|estimate| {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "time on the wire wraps at 2^32 us")]
        let mid_exposure_us = estimate.to_remote_ns(meta.mid_exposure).div_euclid(1000) as u32;
        let seq = receiver.history().newest().map_or(0, |sample| sample.seq);
        let age_us = meta.horizon.max(Span::ZERO).ns() / 1000;
        let age_us = u32::try_from(age_us).unwrap_or(u32::MAX);
        Message::Exposure(Exposure::new(low_byte(meta.number), seq, mid_exposure_us, age_us))
    });
    let state = Message::Status(StatusPage::State {
        mode: mode(meta.faults),
        frames: u16::try_from(meta.number & 0xffff).unwrap_or(0),
        latency_us: u32::try_from(meta.attitude_age.ns().max(0) / 1000).unwrap_or(u32::MAX),
    });
    let (angle, degrees) = match meta.number % 3 {
        0 => (PointingAngle::RightAscension, meta.ra_deg),
        1 => (PointingAngle::Declination, meta.dec_deg),
        _ => (PointingAngle::Roll, meta.roll_deg),
    };
    let turns_2_32 = PointingAngle::to_turns(degrees.to_radians());
    let pointing = Message::Status(StatusPage::Pointing { angle, frame: low_byte(meta.number), turns_2_32 });
    exposure.into_iter().chain([state, pointing])
}

fn low_byte(number: u32) -> u8 {
    u8::try_from(number & 0xff).unwrap_or(0)
}

fn mode(faults: FaultFlags) -> StimulatorMode {
    if faults.contains(FaultFlags::BLANK) {
        StimulatorMode::Blank
    } else if faults.contains(FaultFlags::LINK_STALE) {
        StimulatorMode::Holding
    } else {
        StimulatorMode::Running
    }
}
