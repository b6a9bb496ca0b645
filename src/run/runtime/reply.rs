//! Messages from the stimulator to the flight computer after each frame: EXPOSURE, the pointing rendered, its own
//! state.
//!
//! In: a frame's truth, the receiver, the rejections of the port. Out: at most seven messages, most urgent first:
//! EXPOSURE, STATUS state, right ascension, declination and roll of this frame, one of STATUS prediction and clock in
//! turn, one STATUS rejects (each reason when its count has risen, once a second at most). No EXPOSURE before the first
//! attitude. Only the flight computer sends HEARTBEAT: two senders of one identifier would collide on a real bus, and
//! STATUS shows that the stimulator is alive. CAMERA_STATUS of every head follows, once requested (`camera_pages`).
//! Tests: `tests/closed_loop/session.rs`.

use crate::runtime::{port_reading::REASONS, receiver::Receiver};
use base::time::{Span, Tai};
use base::units::ARCSEC;
use firmware_protocol::message::{
    CameraPage, CameraStatus, Exposure, PointingAngle, StartedBy, StatusPage, StimulatorMode, frame_flag,
};
use firmware_protocol::{Message, Reject};
use frames::camera_control::TriggerSource;
use frames::sink::{FaultFlags, FrameMeta};

/// Shortest interval between reports of one reason's count.
const ONCE: Span = Span::from_ms(1000);

/// State of the reports: which page is next, and when each reason was last reported.
#[derive(Debug, Clone, Default)]
pub struct Reply {
    /// Frames reported so far.
    frames: u64,
    rejects: [Reported; REASONS],
}

/// Count of one reason as last reported to the flight computer.
#[derive(Debug, Clone, Copy, Default)]
struct Reported {
    count: u32,
    at: Option<Tai>,
}

/// One frame with the data needed to report it.
#[derive(Debug, Clone, Copy)]
pub struct ReportedFrame<'a> {
    /// The frame's truth.
    pub meta: &'a FrameMeta,
    /// Bound of its pointing error, if known.
    pub pointing_bound_rad: Option<f64>,
    /// Number of refused inputs of the ports, by the reason's code.
    pub rejects: &'a [u32; REASONS],
    /// Current time.
    pub now: Tai,
}

impl Reply {
    /// Sends what there is to report about a frame of a head. Heads share one exposure time: only the first head reports
    /// its frame, and each head its settings, once requested.
    pub(super) fn report<E>(
        &mut self,
        head: usize,
        frame: &ReportedFrame<'_>,
        receiver: &Receiver,
        mut send: impl FnMut(Message) -> Result<(), E>,
    ) -> Result<(), E> {
        if head == 0 {
            self.messages(frame, receiver).try_for_each(&mut send)?;
        }
        let is_reporting = receiver.session.cameras.is_reporting;
        camera_pages(head, frame.meta).into_iter().filter(|_| is_reporting).try_for_each(send)
    }

    /// Returns the messages for one frame.
    fn messages(&mut self, frame: &ReportedFrame<'_>, receiver: &Receiver) -> impl Iterator<Item = Message> + use<> {
        let ReportedFrame { meta, now, .. } = *frame;
        self.frames += 1;
        let state = self.state(mode(meta, receiver), receiver, now);
        let in_turn = if self.frames.is_multiple_of(2) { prediction(frame) } else { clock(receiver) };
        [
            exposure(meta, receiver).map(Message::Exposure),
            Some(Message::Status(state)),
            Some(pointing(meta, PointingAngle::RightAscension, meta.ra_deg)),
            Some(pointing(meta, PointingAngle::Declination, meta.dec_deg)),
            Some(pointing(meta, PointingAngle::Roll, meta.roll_deg)),
            in_turn.map(Message::Status),
            self.reject(&all_rejects(frame.rejects, receiver), now).map(Message::Status),
        ]
        .into_iter()
        .flatten()
    }

    /// Returns the message sent instead of a frame when the stream has stopped and the policy is to send none.
    pub fn stopped(&self, receiver: &Receiver, now: Tai) -> Message {
        Message::Status(self.state(StimulatorMode::Stopped, receiver, now))
    }

    fn state(&self, mode: StimulatorMode, receiver: &Receiver, now: Tai) -> StatusPage {
        let frames = u16::try_from(self.frames & 0xffff).unwrap_or(0);
        StatusPage::State { mode, frames, latency_us: latency_us(receiver, now) }
    }

    /// Returns the page of the reason whose report is longest ago, among those whose count has risen and that are due.
    fn reject(&mut self, counts: &[u32; REASONS], now: Tai) -> Option<StatusPage> {
        let is_due = |reported: &Reported| reported.at.is_none_or(|last| now - last >= ONCE);
        let risen = self.rejects.iter_mut().zip(counts).zip(Reject::ALL);
        let ((reported, count), reason) = risen
            .filter(|((reported, count), _)| **count > reported.count && is_due(reported))
            .min_by_key(|((reported, _), _)| reported.at)?;
        *reported = Reported { count: *count, at: Some(now) };
        Some(StatusPage::Rejects { reason, count: *count })
    }
}

/// Returns the time from the epoch of the newest attitude to now, when the frame goes out, us.
fn latency_us(receiver: &Receiver, now: Tai) -> u32 {
    let age = receiver.attitudes.age_at(now).unwrap_or(Span::ZERO);
    u32::try_from(age.ns().max(0) / 1000).unwrap_or(u32::MAX)
}

/// Returns the rejections of the ports and of the histories.
fn all_rejects(ports: &[u32; REASONS], receiver: &Receiver) -> [u32; REASONS] {
    let mut all = *ports;
    let mut add = |reason: Reject, count: u64| {
        let total = &mut all[usize::from(reason.code())];
        *total = total.saturating_add(u32::try_from(count).unwrap_or(u32::MAX));
    };
    for counts in [receiver.attitudes.history.counts(), receiver.mountings.of(0).jitter.counts()] {
        add(Reject::StaleTime, counts.stale + counts.older_than_history);
        add(Reject::FutureTime, counts.future);
        add(Reject::NotFinite, counts.not_finite);
        add(Reject::UnknownValue, counts.too_fast);
    }
    // A pair that came too late has a time older than possible, an outlying one a newer time.
    add(Reject::StaleTime, receiver.clock.remote.late);
    add(Reject::FutureTime, receiver.clock.remote.outliers);
    all
}

fn exposure(meta: &FrameMeta, receiver: &Receiver) -> Option<Exposure> {
    let mid_exposure_us = receiver.attitudes.remote_us_at(meta.mid_exposure, &receiver.clock.remote)?;
    let seq = receiver.attitudes.history.newest().map_or(0, |sample| sample.seq);
    let age_us = meta.horizon.max(Span::ZERO).ns() / 1000;
    let age_us = u32::try_from(age_us).unwrap_or(u32::MAX);
    Some(Exposure::new(low_byte(meta.number), seq, mid_exposure_us, age_us))
}

fn pointing(meta: &FrameMeta, angle: PointingAngle, degrees: f64) -> Message {
    let turns_2_32 = PointingAngle::to_turns(degrees.to_radians());
    Message::Status(StatusPage::Pointing { angle, frame: low_byte(meta.number), flags: frame_flags(meta), turns_2_32 })
}

/// Returns the fault flags of a frame in the bits of its STATUS pages.
fn frame_flags(meta: &FrameMeta) -> u16 {
    let jitter = if meta.jitter_missing > Span::ZERO { frame_flag::JITTER_MISSING } else { 0 };
    let attitude = if meta.is_partly_extrapolated { frame_flag::PARTLY_EXTRAPOLATED } else { 0 };
    jitter | attitude
}

/// Returns the prediction horizon of the attitude and its bound, if known.
fn prediction(frame: &ReportedFrame<'_>) -> Option<StatusPage> {
    let ten_us = (frame.meta.horizon.ns() / 10_000).clamp(i64::from(i16::MIN), i64::from(i16::MAX));
    let horizon_10us = i16::try_from(ten_us).unwrap_or(i16::MAX);
    #[allow(clippy::cast_possible_truncation, reason = "an error in f32 is as good")]
    let error_arcsec = (frame.pointing_bound_rad? / ARCSEC) as f32;
    Some(StatusPage::Prediction { horizon_10us, error_arcsec })
}

fn clock(receiver: &Receiver) -> Option<StatusPage> {
    let estimate = receiver.clock.remote.estimate()?;
    // The drift is local seconds per remote second; the flight computer needs its own rate relative to ours.
    #[allow(clippy::cast_possible_truncation, reason = "float-to-int casts saturate")]
    let drift_0_1ppm = (-estimate.drift * 1e7).round() as i16;
    let limits = (i64::from(i32::MIN), i64::from(i32::MAX));
    let residual_ns = i32::try_from(estimate.residual.ns().clamp(limits.0, limits.1)).unwrap_or(i32::MAX);
    Some(StatusPage::Clock { drift_0_1ppm, residual_ns })
}

/// Returns the CAMERA_STATUS pages of a frame of a head: its exposure settings.
fn camera_pages(head: usize, meta: &FrameMeta) -> [Message; 3] {
    let (head, frame) = (u8::try_from(head).unwrap_or(u8::MAX), low_byte(meta.number));
    let delay_us = rounded(meta.trigger_delay.s() * 1e6, u32::MAX);
    let gain_cdb = u16::try_from(rounded(meta.gain_db * 100.0, u16::MAX.into())).unwrap_or(u16::MAX);
    [
        CameraPage::Exposure { started_by: started_by(meta), exposure_us: rounded(meta.exposure_s * 1e6, u32::MAX) },
        CameraPage::Levels { gain_cdb, black_level_dn_16: rounded(meta.black_level_dn * 16.0, (1 << 24) - 1) },
        CameraPage::Trigger { delay_us },
    ]
    .map(|page| Message::Camera(CameraStatus { head, frame, page }))
}

fn started_by(meta: &FrameMeta) -> StartedBy {
    match TriggerSource::NAMED.into_iter().find(|(name, _)| *name == meta.started_by) {
        None => StartedBy::Rate,
        Some((_, TriggerSource::Software)) => StartedBy::Software,
        Some((_, TriggerSource::Action)) => StartedBy::Action,
        Some((_, TriggerSource::Bus)) => StartedBy::Bus,
        Some((_, TriggerSource::Line)) => StartedBy::Line,
        Some((_, TriggerSource::Control)) => StartedBy::Control,
    }
}

/// Returns the nearest count, at most `largest`; 0 for negative values and NaN.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "float-to-int casts saturate")]
fn rounded(value: f64, largest: u32) -> u32 {
    (value.round() as u32).min(largest)
}

fn low_byte(number: u32) -> u8 {
    u8::try_from(number & 0xff).unwrap_or(0)
}

fn mode(meta: &FrameMeta, receiver: &Receiver) -> StimulatorMode {
    if !receiver.session.is_rendering() {
        StimulatorMode::Idle
    } else if meta.faults.contains(FaultFlags::BLANK) {
        StimulatorMode::Blank
    } else if meta.faults.contains(FaultFlags::LINK_STALE) {
        StimulatorMode::Holding
    } else {
        StimulatorMode::Running
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pointing_pages_carry_what_the_frame_lacks() {
        let (late, stopped) = (frame_flag::JITTER_MISSING, frame_flag::PARTLY_EXTRAPOLATED);
        for (missing_ms, is_partly_extrapolated, wanted) in
            [(0, false, 0), (3, false, late), (0, true, stopped), (3, true, late | stopped)]
        {
            let mut meta = FrameMeta::empty("camera".into());
            (meta.jitter_missing, meta.is_partly_extrapolated) = (Span::from_ms(missing_ms), is_partly_extrapolated);
            let Message::Status(StatusPage::Pointing { flags, .. }) = pointing(&meta, PointingAngle::Roll, 0.0) else {
                panic!("a pointing page");
            };
            assert_eq!(flags, wanted);
        }
    }

    #[test]
    fn camera_pages_have_what_the_frame_was_exposed_with() {
        let mut meta = FrameMeta::empty("camera".into());
        (meta.number, meta.exposure_s, meta.gain_db, meta.black_level_dn) = (0x1_07, 0.05, 6.004, 64.5);
        let status = |page| Message::Camera(CameraStatus { head: 3, frame: 7, page });
        let levels = status(CameraPage::Levels { gain_cdb: 600, black_level_dn_16: 1032 });
        let exposure = |started_by| status(CameraPage::Exposure { started_by, exposure_us: 50_000 });
        let delay = |delay_us| status(CameraPage::Trigger { delay_us });
        assert_eq!(camera_pages(3, &meta), [exposure(StartedBy::Rate), levels, delay(0)]);
        (meta.started_by, meta.trigger_delay) = (TriggerSource::Bus.name(), Span::from_ms(2));
        assert_eq!(camera_pages(3, &meta), [exposure(StartedBy::Bus), levels, delay(2000)]);
        (meta.gain_db, meta.black_level_dn) = (f64::NAN, 1e9);
        let clipped = status(CameraPage::Levels { gain_cdb: 0, black_level_dn_16: (1 << 24) - 1 });
        assert_eq!(camera_pages(3, &meta)[1], clipped);
    }

    #[test]
    fn a_reason_is_reported_when_its_count_has_risen_and_once_a_second() {
        let mut reply = Reply::default();
        let mut counts = [0; REASONS];
        let mut reported = |counts: &[u32; REASONS], ms: i64| reply.reject(counts, Tai::from_ns(ms * 1_000_000));
        assert_eq!(reported(&counts, 0), None);
        counts[Reject::BadCrc as usize] = 3;
        counts[Reject::TornGroup as usize] = 1;
        assert_eq!(reported(&counts, 100), Some(StatusPage::Rejects { reason: Reject::BadCrc, count: 3 }));
        assert_eq!(reported(&counts, 200), Some(StatusPage::Rejects { reason: Reject::TornGroup, count: 1 }));
        counts[Reject::BadCrc as usize] = 4;
        assert_eq!(reported(&counts, 1099), None, "within the second");
        assert_eq!(reported(&counts, 1100), Some(StatusPage::Rejects { reason: Reject::BadCrc, count: 4 }));
        assert_eq!(reported(&counts, 5000), None, "nothing new");
    }
}
