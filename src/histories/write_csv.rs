//! Histories as CSV with named columns, as this crate reads them.

use crate::attitude::{AttitudeHistory, Times};
use crate::{epoch::utc_text, orbit::OrbitHistory, write_header::Header};
use base::time::Tai;
use std::io::{self, Write};

pub(crate) fn attitude(out: &mut dyn Write, history: &AttitudeHistory, header: &Header) -> io::Result<()> {
    let states = || history.segments().iter().flat_map(|segment| segment.states());
    let has_rates = states().all(|state| state.rate_rad_s.is_some());
    writeln!(out, "# attitude of {} ({}); v_body = q v_icrf q*", header.object_name, header.body)?;
    writeln!(out, "# sense: body_from_icrf\n# axes: ICRF")?;
    let is_absolute = history.times == Times::Absolute;
    let time = if is_absolute { "utc,tai_ns" } else { "t_s" };
    let rates = if has_rates { ",w_x_rad_s,w_y_rad_s,w_z_rad_s" } else { "" };
    writeln!(out, "{time},q_w,q_x,q_y,q_z{rates},segment")?;
    for (segment, number) in history.segments().iter().zip(1..) {
        for state in segment.states() {
            if is_absolute {
                write!(out, "{},{}", utc_text(Tai::from_ns(state.t_ns)), state.t_ns)?;
            } else {
                write!(out, "{}", state.t_ns as f64 * 1e-9)?;
            }
            let [w, x, y, z] = state.body_from_icrf.wxyz();
            write!(out, ",{w},{x},{y},{z}")?;
            if let Some(rate) = state.rate_rad_s.filter(|_| has_rates) {
                write!(out, ",{},{},{}", rate.x, rate.y, rate.z)?;
            }
            writeln!(out, ",{number}")?;
        }
    }
    out.flush()
}

pub(crate) fn orbit(out: &mut dyn Write, history: &OrbitHistory) -> io::Result<()> {
    writeln!(out, "# centre: {}\n# axes: ICRF", history.centre.name())?;
    writeln!(out, "utc,tai_ns,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s,segment")?;
    for (segment, number) in history.segments().iter().zip(1..) {
        for state in segment.states() {
            let (p, v) = (state.position_km, state.velocity_km_s);
            write!(out, "{},{}", utc_text(Tai::from_ns(state.t_ns)), state.t_ns)?;
            writeln!(out, ",{},{},{},{},{},{},{number}", p.x, p.y, p.z, v.x, v.y, v.z)?;
        }
    }
    out.flush()
}
