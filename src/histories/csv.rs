//! Attitudes and orbits as tables: with a header that names columns; attitudes also as rows of seconds and `w x y z`.
//!
//! | columns | meaning |
//! |---|---|
//! | `t_s`; `utc`, `tai`, `tt`, `tdb`, `gps`; `unix_s`; `tai_ns` | time: from a zero of the file, or absolute |
//! | `q_w q_x q_y q_z` (also `qw`, `w`); `q0 q1 q2 q3`; `q1 q2 q3 q4` | quaternion: scalar named, first, last |
//! | `w_x_rad_s` or `w_x_deg_s` (also `rate_x_`), y, z | rate of the body with respect to ICRF, body axes; optional |
//! | `segment` | a number: where it changes, a gap begins; optional |
//!
//! Remarks before the rows: `# sense: body_from_icrf` (which is the default: this program's quaternion) or
//! `icrf_from_body`, its conjugate; `# axes: ICRF`, `EME2000`. Other columns are not used.
//!
//! An orbit has a column of absolute time, `x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s` (or `_m`, `_m_s`), an
//! optional `segment`; remarks `# centre: EARTH` and `# axes: ICRF`.

use crate::attitude::{AttitudeHistory, AttitudeSegment, Times};
use crate::attitude_methods::{AttitudeInterpolation, AttitudeState};
use crate::csv_table::{Table, TimeColumn};
use crate::error::{HistoryError, Source};
use crate::orbit::{Centre, OrbitHistory, OrbitInterpolation, OrbitSegment, OrbitState, WANTED_CENTRE};
use crate::reference_axes::{ReferenceAxes, WANTED_AXES};
use crate::segments::Unfit;
use base::axes::{Rotation, WRITTEN_NORM_TOLERANCE};
use base::units::METRE_KM;
use glam::{DQuat, DVec3};

/// Which rotation the quaternions of a table are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sense {
    /// This program's: `v_body = q v_icrf q*`.
    BodyFromIcrf,
    /// Its conjugate, which most simulators call the attitude: `v_icrf = q v_body q*`.
    IcrfFromBody,
}

impl Sense {
    /// Its names in files.
    pub const NAMES: [(&'static str, Self); 2] =
        [("body_from_icrf", Self::BodyFromIcrf), ("icrf_from_body", Self::IcrfFromBody)];
}

/// Places of what a row has.
struct Columns {
    time: (TimeColumn, usize),
    /// w, x, y, z.
    quaternion: [usize; 4],
    /// Places, and radians in their unit.
    rate: Option<([usize; 3], f64)>,
    /// Numbers in a row.
    count: usize,
}

/// Reads a table.
pub(crate) fn attitudes(source: &Source<'_>, given: Option<Sense>) -> Result<AttitudeHistory, HistoryError> {
    let table = Table::new(*source);
    let sense = sense(&table, given)?;
    let axes = axes(&table)?;
    let columns = Columns::of(&table)?;
    let parts = table.segments(columns.count, |line, row| state(&table, line, row, &columns, (sense, axes)))?;
    let rows: usize = parts.iter().map(Vec::len).sum();
    let unfit = |error: Unfit| source.whole(format!("{rows} rows: {error}"));
    let has_rates = columns.rate.is_some();
    let method = if has_rates { AttitudeInterpolation::CubicHermite } else { AttitudeInterpolation::Slerp };
    let segments = parts.into_iter().map(|states| AttitudeSegment::new(states, method, [None; 2]));
    let segments = segments.collect::<Result<Vec<_>, _>>().map_err(unfit)?;
    let times = if columns.time.0 == TimeColumn::Seconds { Times::FromZero } else { Times::Absolute };
    let format = if table.columns().is_some() { "table with a header" } else { "rows of t w x y z" };
    let mut history = AttitudeHistory::new(format, times, segments).map_err(unfit)?;
    history.notes.extend(axes.note().map(Into::into));
    if let TimeColumn::Date(system) = columns.time.0 {
        history.notes.extend(system.note().map(Into::into));
    }
    Ok(history)
}

fn sense(table: &Table<'_>, given: Option<Sense>) -> Result<Sense, HistoryError> {
    let Some((word, line)) = table.remark("sense") else { return Ok(given.unwrap_or(Sense::BodyFromIcrf)) };
    let found = Sense::NAMES.iter().find(|(name, _)| *name == word).map(|(_, sense)| *sense);
    let found = found.ok_or_else(|| table.refuse(line, word, "body_from_icrf or icrf_from_body"))?;
    match given {
        Some(given) if given != found => {
            Err(table.refuse(line, word, "the sense that is given for the file, or none given: they differ"))
        }
        Some(_) | None => Ok(found),
    }
}

/// Reads the axes that a remark names; ICRF without one.
pub(crate) fn axes(table: &Table<'_>) -> Result<ReferenceAxes, HistoryError> {
    let Some((word, line)) = table.remark("axes") else { return Ok(ReferenceAxes::Icrf) };
    ReferenceAxes::of_name(word).ok_or_else(|| table.refuse(line, word, WANTED_AXES))
}

impl Columns {
    fn of(table: &Table<'_>) -> Result<Self, HistoryError> {
        let Some(names) = table.columns() else {
            let time = (TimeColumn::Seconds, 0);
            return Ok(Self { time, quaternion: [1, 2, 3, 4], rate: None, count: 5 });
        };
        let quaternion = Self::quaternion(table).ok_or_else(|| {
            table.without(
                "a quaternion in columns q_w,q_x,q_y,q_z, or q0,q1,q2,q3 (scalar q0), or q1,q2,q3,q4 (scalar q4)",
            )
        })?;
        Ok(Self { time: table.time_column()?, quaternion, rate: Self::rate(table)?, count: names.len() })
    }

    fn quaternion(table: &Table<'_>) -> Option<[usize; 4]> {
        let all = |names: [&str; 4]| {
            let found = names.map(|name| table.column(&[name]));
            let [Some(w), Some(x), Some(y), Some(z)] = found else { return None };
            Some([w, x, y, z])
        };
        let named = [["q_w", "q_x", "q_y", "q_z"], ["qw", "qx", "qy", "qz"], ["w", "x", "y", "z"]];
        let numbered = [["q0", "q1", "q2", "q3"], ["q4", "q1", "q2", "q3"], ["q_4", "q_1", "q_2", "q_3"]];
        named.into_iter().chain(numbered).find_map(all)
    }

    fn rate(table: &Table<'_>) -> Result<Option<([usize; 3], f64)>, HistoryError> {
        for stem in ["w", "rate", "omega"] {
            for (unit, rad) in [("rad_s", 1.0), ("deg_s", 1_f64.to_radians())] {
                let names = ["x", "y", "z"].map(|axis| format!("{stem}_{axis}_{unit}"));
                if table.column(&[&names[0]]).is_some() {
                    let places = table.columns_of([names[0].as_str(), names[1].as_str(), names[2].as_str()])?;
                    return Ok(Some((places, rad)));
                }
            }
            if table.column(&[&format!("{stem}_x")]).is_some() {
                return Err(table.without(&format!("a unit in the rate's names: {stem}_x_rad_s or {stem}_x_deg_s")));
            }
        }
        Ok(None)
    }
}

fn state(
    table: &Table<'_>,
    line: usize,
    row: &[&str],
    columns: &Columns,
    (sense, axes): (Sense, ReferenceAxes),
) -> Result<AttitudeState, HistoryError> {
    let t_ns = table.time_ns(line, row, columns.time)?;
    let [mut quaternion, mut rate] = [[0.0; 4], [0.0; 4]];
    for (number, place) in quaternion.iter_mut().zip(columns.quaternion) {
        *number = table.number(line, row, place)?;
    }
    if let Some((places, rad)) = columns.rate {
        for (number, place) in rate.iter_mut().zip(places) {
            *number = rad * table.number(line, row, place)?;
        }
    }
    let given = Rotation::<(), ()>::from_wxyz(quaternion, WRITTEN_NORM_TOLERANCE).ok_or_else(|| {
        table.refuse(line, &row.join(","), "a unit quaternion (w x y z) whose norm is 1 within 0.001")
    })?;
    let body_from_axes: DQuat = match sense {
        Sense::BodyFromIcrf => given.quat(),
        Sense::IcrfFromBody => given.quat().conjugate(),
    };
    let body_from_icrf = match axes {
        ReferenceAxes::Icrf => Rotation::from_quat(body_from_axes),
        ReferenceAxes::Eme2000 => Rotation::from_quat(body_from_axes * axes.rotation_from_icrf()),
    };
    let rate_rad_s = columns.rate.map(|_| DVec3::new(rate[0], rate[1], rate[2]));
    Ok(AttitudeState { t_ns, body_from_icrf, rate_rad_s })
}

/// Reads a table.
pub(crate) fn orbit(source: &Source<'_>) -> Result<OrbitHistory, HistoryError> {
    let table = Table::new(*source);
    let centre = match table.remark("centre").or_else(|| table.remark("center")) {
        None => Centre::Earth,
        Some((word, line)) => Centre::of_name(word).ok_or_else(|| table.refuse(line, word, WANTED_CENTRE))?,
    };
    let axes = axes(&table)?;
    let Some(names) = table.columns() else {
        return Err(table.refuse(1, "no header", "names of columns: utc,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s"));
    };
    let time = table.time_column()?;
    if time.0 == TimeColumn::Seconds {
        return Err(table.without("absolute times of an orbit: a column utc, tai, tt, tdb, gps, unix_s or tai_ns"));
    }
    let (places, km) = state_columns(&table)?;
    let parts = table.segments(names.len(), |line, row| {
        let mut numbers = [0.0; 6];
        for (number, place) in numbers.iter_mut().zip(places) {
            *number = km * table.number(line, row, place)?;
        }
        let [x, y, z, vx, vy, vz] = numbers;
        let [position_km, velocity_km_s] = [DVec3::new(x, y, z), DVec3::new(vx, vy, vz)].map(|v| axes.to_icrf(v));
        Ok(OrbitState { t_ns: table.time_ns(line, row, time)?, position_km, velocity_km_s })
    })?;
    let unfit = |error: Unfit| source.whole(error.to_string());
    let segments = parts.into_iter().map(|states| OrbitSegment::new(states, OrbitInterpolation::CUBIC, [None; 2]));
    let segments = segments.collect::<Result<Vec<_>, _>>().map_err(unfit)?;
    let mut history = OrbitHistory::new("table with a header", centre, segments).map_err(unfit)?;
    history.notes.extend(axes.note().map(Into::into));
    if let TimeColumn::Date(system) = time.0 {
        history.notes.extend(system.note().map(Into::into));
    }
    Ok(history)
}

/// Returns places of position and velocity, and kilometres in their unit.
fn state_columns(table: &Table<'_>) -> Result<([usize; 6], f64), HistoryError> {
    if table.column(&["x_m"]).is_some() {
        return Ok((table.columns_of(["x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s"])?, METRE_KM));
    }
    Ok((table.columns_of(["x_km", "y_km", "z_km", "vx_km_s", "vy_km_s", "vz_km_s"])?, 1.0))
}
