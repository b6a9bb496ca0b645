//! An orbit as a table: a column of absolute time, `x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s` (or `_m`, `_m_s`), an
//! optional `segment`; remarks `# centre: EARTH` and `# axes: ICRF`.

use crate::csv_attitude::axes;
use crate::csv_table::{Table, TimeColumn};
use crate::error::{HistoryError, Source};
use crate::orbit::{Centre, OrbitHistory, OrbitInterpolation, OrbitSegment, OrbitState, UnfitOrbit, WANTED_CENTRE};
use base::units::METRE_KM;
use glam::DVec3;

/// Reads a table.
pub(crate) fn read(source: &Source<'_>) -> Result<OrbitHistory, HistoryError> {
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
    let segment = table.column(&["segment"]);
    let mut parts: Vec<(Option<&str>, Vec<OrbitState>)> = Vec::new();
    for (line, row) in table.rows() {
        if row.len() != names.len() {
            let (got, wanted) = (format!("{} values", row.len()), format!("{} values in a row", names.len()));
            return Err(table.refuse(line, &got, &wanted));
        }
        let mut numbers = [0.0; 6];
        for (number, place) in numbers.iter_mut().zip(places) {
            *number = km * table.number(line, &row, place)?;
        }
        let [x, y, z, vx, vy, vz] = numbers;
        let [position_km, velocity_km_s] = [DVec3::new(x, y, z), DVec3::new(vx, vy, vz)].map(|v| axes.to_icrf(v));
        let state = OrbitState { t_ns: table.time_ns(line, &row, time)?, position_km, velocity_km_s };
        let part = segment.and_then(|place| row.get(place).copied());
        match parts.last_mut().filter(|(last, _)| *last == part) {
            Some((_, states)) => states.push(state),
            None => parts.push((part, vec![state])),
        }
    }
    let unfit = |error: UnfitOrbit| source.whole(error.to_string());
    let segments = parts.into_iter().map(|(_, states)| OrbitSegment::new(states, OrbitInterpolation::CUBIC, [None; 2]));
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
