//! STK's attitude and ephemeris files as text. One block has no gaps: segments follow each other in it, which a remark
//! says.

use crate::write_ccsds::{q1_q2_q3_qc, rate_deg_s};
use crate::{attitude::AttitudeHistory, epoch::stk_date, orbit::OrbitHistory};
use base::{time::Tai, units::NS_PER_S};
use std::io::{self, Write};

/// Returns seconds from the epoch, exact to the nanosecond.
fn seconds(t_ns: i64, epoch_ns: i64) -> String {
    let off_ns = t_ns.saturating_sub(epoch_ns);
    format!("{}.{:09}", off_ns / NS_PER_S, off_ns % NS_PER_S)
}

fn begin(out: &mut dyn Write, name: &str, rows: usize, epoch_ns: i64, segments: usize) -> io::Result<()> {
    writeln!(out, "stk.v.11.0")?;
    if segments > 1 {
        writeln!(out, "# {segments} segments in one block: the gaps between them are not marked")?;
    }
    writeln!(out, "BEGIN {name}\nNumberOf{name}Points {rows}\nScenarioEpoch {}", stk_date(Tai::from_ns(epoch_ns)))
}

pub(crate) fn attitude(out: &mut dyn Write, history: &AttitudeHistory) -> io::Result<()> {
    let states = || history.segments().iter().flat_map(|segment| segment.states());
    let epoch_ns = states().next().map_or(0, |state| state.t_ns);
    let has_rates = states().all(|state| state.rate_rad_s.is_some());
    begin(out, "Attitude", history.rows(), epoch_ns, history.segments().len())?;
    let rows_are = if has_rates { "AttitudeTimeQuatAngVels" } else { "AttitudeTimeQuaternions" };
    writeln!(out, "CentralBody Earth\nCoordinateAxes ICRF\n{rows_are}")?;
    let mut last = [0.0; 4];
    for state in states() {
        let [a, b, c, d] = q1_q2_q3_qc(state, &mut last);
        write!(out, "{} {a} {b} {c} {d}", seconds(state.t_ns, epoch_ns))?;
        if has_rates {
            let rate = rate_deg_s(state);
            write!(out, " {} {} {}", rate.x, rate.y, rate.z)?;
        }
        writeln!(out)?;
    }
    writeln!(out, "END Attitude")?;
    out.flush()
}

pub(crate) fn ephemeris(out: &mut dyn Write, history: &OrbitHistory) -> io::Result<()> {
    let states = || history.segments().iter().flat_map(|segment| segment.states());
    let epoch_ns = states().next().map_or(0, |state| state.t_ns);
    begin(out, "Ephemeris", history.rows(), epoch_ns, history.segments().len())?;
    let mut name = history.centre.name().to_ascii_lowercase();
    name.get_mut(..1).into_iter().for_each(str::make_ascii_uppercase);
    writeln!(out, "CentralBody {name}\nCoordinateSystem ICRF\nDistanceUnit Kilometers")?;
    writeln!(out, "InterpolationMethod Hermite\nInterpolationSamplesM1 1\nEphemerisTimePosVel")?;
    for state in states() {
        let (p, v) = (state.position_km, state.velocity_km_s);
        writeln!(out, "{} {} {} {} {} {} {}", seconds(state.t_ns, epoch_ns), p.x, p.y, p.z, v.x, v.y, v.z)?;
    }
    writeln!(out, "END Ephemeris")?;
    out.flush()
}
