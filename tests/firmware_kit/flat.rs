//! Message -> its number and its values in the order of the C structures: the common form of both languages.

use firmware_protocol::Message;
use firmware_protocol::message::{CameraPage, CameraStatus, Info, Reply, Request, StatusPage};

/// A message as numbers.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Flat {
    pub(crate) number: u8,
    pub(crate) values: Vec<f64>,
}

impl Flat {
    pub(crate) fn of(message: &Message) -> Self {
        Self { number: message.id().number(), values: values(message) }
    }

    /// Returns `NUMBER VALUE ...`, every f32 with all its digits.
    pub(crate) fn line(&self) -> String {
        self.values.iter().fold(self.number.to_string(), |line, value| match value {
            whole if whole.fract() == 0.0 && whole.abs() < 1e12 => format!("{line} {whole}"),
            broken => format!("{line} {broken:?}"),
        })
    }

    /// Returns the inverse of [`Self::line`]; what is written with a point or an exponent was an f32.
    pub(crate) fn parse(line: &str) -> Self {
        let mut words = line.split_whitespace();
        let number = words.next().unwrap().parse().unwrap();
        let value = |word: &str| {
            let value: f64 = word.parse().unwrap();
            if word.contains(['.', 'e']) { f64::from(value as f32) } else { value }
        };
        Self { number, values: words.map(value).collect() }
    }
}

fn all<const N: usize>(values: [f32; N]) -> impl Iterator<Item = f64> {
    values.into_iter().map(f64::from)
}

fn values(message: &Message) -> Vec<f64> {
    let head = |head: &[u32]| head.iter().map(|value| f64::from(*value)).collect::<Vec<_>>();
    match message {
        Message::Sync(sync) => head(&[sync.counter.into()]),
        Message::TimeFollowUp(time) => head(&[time.scet.seconds(), time.scet.fraction(), time.counter.into()]),
        Message::Attitude(record) => {
            let mut values = head(&[record.t_us, record.seq.into(), record.flags.bits().into()]);
            values.extend(all(record.q_wxyz));
            values.extend(all(record.rate_rad_s).chain(all(record.acceleration_rad_s2)));
            values
        }
        Message::Jitter(burst) => {
            let samples = burst.samples_arcsec();
            let count = u32::try_from(samples.len()).unwrap();
            let mut values = head(&[burst.t_first_us, burst.period_us.into(), burst.seq.into(), count]);
            values.extend(samples.iter().copied().flat_map(all));
            values
        }
        Message::JitterPair(pair) => {
            let mut values = head(&[pair.slot.into()]);
            values.extend(pair.samples_arcsec.into_iter().flat_map(all));
            values
        }
        Message::Wheels(wheels) => all(wheels.speed_rpm).collect(),
        Message::Exposure(exposure) => {
            head(&[exposure.frame.into(), exposure.attitude_seq.into(), exposure.mid_exposure_us, exposure.age_us()])
        }
        Message::Table(cell) => {
            let mut values = head(&[cell.table.number().into(), cell.row.into(), cell.column.into()]);
            values.push(cell.value.into());
            values
        }
        Message::Heartbeat(heartbeat) => head(&[heartbeat.state as u32, heartbeat.major.into()]),
        Message::Status(page) => status(page),
        Message::Camera(status) => head(&camera_status(status)),
        Message::Command(command) => {
            let mut values = head(&[command.request.opcode().into(), command.token.into()]);
            values.extend(head(&arguments(command.request)));
            values
        }
        Message::Response(response) => {
            let mut values = head(&reply(response.reply));
            values.insert(1, response.token.into());
            values
        }
    }
}

fn status(page: &StatusPage) -> Vec<f64> {
    match *page {
        StatusPage::State { mode, frames, latency_us } => {
            vec![0.0, f64::from(mode as u8), frames.into(), latency_us.into()]
        }
        StatusPage::Prediction { horizon_10us, error_arcsec } => vec![1.0, horizon_10us.into(), error_arcsec.into()],
        StatusPage::Clock { drift_0_1ppm, residual_ns } => vec![2.0, drift_0_1ppm.into(), residual_ns.into()],
        StatusPage::Rejects { reason, count } => vec![3.0, reason.code().into(), count.into()],
        StatusPage::Pointing { angle, frame, flags, turns_2_32 } => {
            vec![f64::from(angle as u8), frame.into(), turns_2_32.into(), flags.into()]
        }
    }
}

fn camera_status(status: &CameraStatus) -> Vec<u32> {
    let mut values = vec![status.page.number().into(), status.head.into(), status.frame.into()];
    values.extend(match status.page {
        CameraPage::Exposure { started_by, exposure_us } => vec![started_by as u32, exposure_us],
        CameraPage::Levels { gain_cdb, black_level_dn_16 } => vec![gain_cdb.into(), black_level_dn_16],
        CameraPage::Trigger { delay_us } => vec![delay_us],
    });
    values
}

fn arguments(request: Request) -> Vec<u32> {
    match request {
        Request::Hello(version) => vec![version.major.into(), version.minor.into()],
        Request::Info { page } => vec![page.into()],
        Request::Apply { table, rows, crc, seed } => vec![table.into(), rows.into(), crc.into(), seed.into()],
        Request::Trigger(trigger) => vec![trigger.number.into(), trigger.at_us],
        Request::Camera(setting) => vec![setting.kind.into(), setting.head.into(), setting.value],
        Request::CameraTrigger(trigger) => vec![trigger.head.into(), trigger.at_us],
        Request::Run | Request::Stop | Request::Unknown { .. } => vec![],
    }
}

/// Returns opcode, code and what follows; the token is put in between.
fn reply(reply: Reply) -> Vec<u32> {
    match reply {
        Reply::Hello(identity) => vec![
            1,
            0,
            identity.version.major.into(),
            identity.version.minor.into(),
            identity.capabilities.into(),
            identity.attitude_convention.into(),
        ],
        Reply::Info(Info::DbcCrc32(crc)) => vec![2, 0, 0, crc],
        Reply::Info(Info::Rates(rates)) => vec![2, 0, 1, rates.attitude_hz.into(), rates.jitter_hz.into()],
        Reply::Run => vec![3, 0],
        Reply::Stop => vec![4, 0],
        Reply::Applied(applied) => vec![5, 0, applied.table.number().into(), applied.rows.into()],
        Reply::Triggered(triggered) => vec![6, 0, triggered.number.into(), triggered.is_late.into()],
        Reply::CameraSet(set) => vec![7, 0, set.kind.into(), set.head.into()],
        Reply::CameraTriggered(triggered) => vec![8, 0, triggered.head.into(), triggered.is_late.into()],
        Reply::Refused { opcode, reason } => vec![opcode.into(), reason.code().into()],
    }
}
