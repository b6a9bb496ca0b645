//! STK attitude files (`.a`): quaternions from the reference axes to the body's, scalar last or first, with or without
//! rates (deg/s, body axes).

use crate::attitude::{AttitudeHistory, AttitudeSegment, Times, Unfit};
use crate::error::{HistoryError, Source};
use crate::{attitude_methods::AttitudeInterpolation, attitude_state::AttitudeState, stk::Block};
use base::axes::{Rotation, WRITTEN_NORM_TOLERANCE};
use glam::{DQuat, DVec3};

/// Reads a file.
pub(crate) fn read(source: &Source<'_>) -> Result<AttitudeHistory, HistoryError> {
    let block = Block::read(source, "Attitude", "NumberOfAttitudePoints")?;
    let (epoch, axes) = (block.epoch()?, block.axes("CoordinateAxes")?);
    let rows_are = block.rows_are.key.to_ascii_lowercase();
    let (is_scalar_first, has_rates) = match rows_are.as_str() {
        "attitudetimequaternions" => (false, false),
        "attitudetimequatscalarfirst" => (true, false),
        "attitudetimequatangvels" => (false, true),
        _ => {
            let wanted = "AttitudeTimeQuaternions, AttitudeTimeQuatScalarFirst or AttitudeTimeQuatAngVels: write the \
                          attitude as quaternions, angles and matrices are not read";
            return Err(block.refuse(&block.rows_are, wanted));
        }
    };
    let states = block.rows.iter().map(|row| {
        let (t_ns, [a, b, c, d, wx, wy, wz]) = if has_rates {
            block.numbers::<7>(row, epoch)?
        } else {
            let (t_ns, [a, b, c, d]) = block.numbers::<4>(row, epoch)?;
            (t_ns, [a, b, c, d, 0.0, 0.0, 0.0])
        };
        let given = if is_scalar_first { DQuat::from_xyzw(b, c, d, a) } else { DQuat::from_xyzw(a, b, c, d) };
        if (given.length() - 1.0).abs() > WRITTEN_NORM_TOLERANCE {
            return Err(source.refuse(row.offset, &row.text, "a quaternion whose norm is 1 within 0.001"));
        }
        let body_from_icrf = Rotation::from_quat(given.normalize().conjugate() * axes.rotation_from_icrf());
        let rate_rad_s = has_rates.then(|| DVec3::new(wx, wy, wz).map(f64::to_radians));
        Ok(AttitudeState { t_ns, body_from_icrf, rate_rad_s })
    });
    let states = states.collect::<Result<Vec<_>, HistoryError>>()?;
    let method = match (block.degree("InterpolationOrder")?, has_rates) {
        (Some(degree), _) if degree > 1 => AttitudeInterpolation::Lagrange(degree),
        (Some(_) | None, true) => AttitudeInterpolation::CubicHermite,
        (Some(_) | None, false) => AttitudeInterpolation::Slerp,
    };
    let unfit = |error: Unfit| source.whole(error.to_string());
    let segments = block.segments(&states, epoch, |state| state.t_ns).into_iter();
    let segments = segments.map(|states| AttitudeSegment::new(states, method, [None; 2])).collect::<Result<_, _>>();
    let mut history = AttitudeHistory::new("STK attitude", Times::Absolute, segments.map_err(unfit)?).map_err(unfit)?;
    history.notes.extend(axes.note().map(Into::into));
    Ok(history)
}
