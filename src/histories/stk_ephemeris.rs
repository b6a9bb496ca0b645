//! STK ephemeris files (`.e`): seconds, positions and velocities, in metres unless the file says kilometres.

use crate::error::{HistoryError, Source};
use crate::orbit::{Centre, OrbitHistory, OrbitInterpolation, OrbitSegment, OrbitState, UnfitOrbit};
use crate::{newton::MOST_NODES, stk::Block};
use glam::DVec3;

/// Reads a file.
pub(crate) fn read(source: &Source<'_>) -> Result<OrbitHistory, HistoryError> {
    let block = Block::read(source, "Ephemeris", "NumberOfEphemerisPoints")?;
    let (epoch, axes) = (block.epoch()?, block.axes("CoordinateSystem")?);
    if !block.rows_are.key.eq_ignore_ascii_case("EphemerisTimePosVel") {
        return Err(block.refuse(&block.rows_are, "EphemerisTimePosVel: positions with velocities"));
    }
    let centre = block.find("CentralBody").map(|entry| {
        let known = Centre::of_name(entry.value);
        known.ok_or_else(|| block.refuse(entry, "Earth, Moon or Sun"))
    });
    let centre = centre.transpose()?.unwrap_or(Centre::Earth);
    let km = match block.find("DistanceUnit").map(|entry| (entry, entry.value.to_ascii_lowercase())) {
        None => 1e-3,
        Some((entry, unit)) => match unit.as_str() {
            "meters" | "meter" | "m" => 1e-3,
            "kilometers" | "kilometer" | "km" => 1.0,
            _ => return Err(block.refuse(entry, "Meters or Kilometers")),
        },
    };
    let states = block.rows.iter().map(|row| {
        let (t_ns, [x, y, z, vx, vy, vz]) = block.numbers::<6>(row, epoch)?;
        let [position_km, velocity_km_s] = [DVec3::new(x, y, z), DVec3::new(vx, vy, vz)].map(|v| axes.to_icrf(v * km));
        Ok(OrbitState { t_ns, position_km, velocity_km_s })
    });
    let states = states.collect::<Result<Vec<_>, HistoryError>>()?;
    let unfit = |error: UnfitOrbit| source.whole(error.to_string());
    let method = method(&block)?;
    let segments = block.segments(&states, epoch, |state| state.t_ns).into_iter();
    let segments = segments.map(|states| OrbitSegment::new(states, method, [None; 2])).collect::<Result<_, _>>();
    let mut history = OrbitHistory::new("STK ephemeris", centre, segments.map_err(unfit)?).map_err(unfit)?;
    history.notes.extend(axes.note().map(Into::into));
    Ok(history)
}

/// Returns the interpolation that the file asks for; cubic where it leaves it open.
fn method(block: &Block<'_>) -> Result<OrbitInterpolation, HistoryError> {
    let samples_less_1 = block.degree("InterpolationSamplesM1")?.or(block.degree("InterpolationOrder")?);
    let Some(entry) = block.find("InterpolationMethod") else { return Ok(OrbitInterpolation::CUBIC) };
    match (entry.value.to_ascii_lowercase().as_str(), samples_less_1) {
        ("lagrange", Some(degree)) => Ok(OrbitInterpolation::Lagrange(degree)),
        ("lagrange", None) => Ok(OrbitInterpolation::Lagrange(5)),
        ("hermite", rows) if rows.unwrap_or(1) < MOST_NODES / 2 => {
            Ok(OrbitInterpolation::Hermite { rows: rows.unwrap_or(1) + 1 })
        }
        _ => {
            let wanted = format!("Lagrange, or Hermite with InterpolationSamplesM1 below {}", MOST_NODES / 2);
            Err(block.refuse(entry, &wanted))
        }
    }
}
