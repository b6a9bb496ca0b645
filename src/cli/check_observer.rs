//! Where the observer is at the first exposure, how fast, and what that does to the stars.

use anyhow::Result;
use base::time::{Span, Tai};
use base::units::{ARCSEC, DAY_S, SPEED_OF_LIGHT_KM_S};
use core::fmt::{self, Write};
use histories::OrbitHistory;
use run::runtime::RunParams;
use sky::astrometry::{PROVEN_YEARS, Vantage};
use sky::observer::{Observer, ObserverTrack};
use sky::orbit::{CentralBody, TleOrbit, USUAL_DAYS};

/// Distance of the Moon at its furthest, km.
const MOON_KM: f64 = 406_700.0;

/// Writes place, speed, size of the aberration; a warning outside the years for which places are proven.
pub(super) fn write_observer(text: &mut String, params: &RunParams) -> Result<()> {
    let at = params.first_exposure;
    let track = ObserverTrack::new(params.observer.clone(), at);
    let vantage = Vantage::of(&track, at, params.light_deflection)?;
    let speed_km_s = vantage.observer.velocity_km_s.length();
    let aberration_arcsec = speed_km_s / SPEED_OF_LIGHT_KM_S / ARCSEC;
    let bent = if vantage.heliocentric_km.is_some() { "bent by the Sun" } else { "not bent" };
    writeln!(
        text,
        "  observer     {}; {speed_km_s:.3} km/s about the barycentre: aberration up to {aberration_arcsec:.2} arcsec; \
         light is {bent}",
        place(&params.observer, at)?
    )?;
    write_doubts(text, &params.observer, at)?;
    if let Observer::Table(history) = &params.observer {
        for warning in &history.warnings {
            writeln!(text, "  WARNING      observer.file: {warning}")?;
        }
    }
    write_error(text, params)?;
    let last = at + Span::from_s(params.frame_period.s() * f64::from(params.frames));
    if [at, last].into_iter().any(|at| !is_proven(at)) {
        let [first_yr, last_yr] = PROVEN_YEARS;
        writeln!(
            text,
            "  WARNING      apparent places are proven to 1 mas from {first_yr} to {last_yr}: some frames are outside \
             those years"
        )?;
    }
    Ok(())
}

/// Writes what speaks against the observer's orbit at its first exposure: elements that are old, and a place or speed that
/// few orbits about the Earth have.
fn write_doubts(text: &mut String, observer: &Observer, at: Tai) -> Result<()> {
    if let Observer::Tle(orbit) = observer {
        write_age(text, "observer", orbit, at)?;
    }
    let (true, Some(about @ CentralBody::Earth)) = (matches!(observer, Observer::Table(_)), observer.about()) else {
        return Ok(());
    };
    let state = observer.relative_state(at)?;
    let (distance_km, speed_km_s) = (state.position_km.length(), state.velocity_km_s.length());
    let escape_km_s = (2.0 * about.gm_km3_s2() / distance_km).sqrt();
    if distance_km > MOON_KM {
        writeln!(
            text,
            "  WARNING      the observer is {distance_km:.0} km from {about}: wanted less than {MOON_KM:.0} km, beyond which \
             is the Moon: check unit and centre of the file"
        )?;
    }
    if speed_km_s > escape_km_s {
        writeln!(
            text,
            "  WARNING      the observer has {speed_km_s:.3} km/s: {about} holds at {distance_km:.0} km what has less than \
             {escape_km_s:.3} km/s: check units and centre of the file"
        )?;
    }
    Ok(())
}

/// Warns of a file of states whose error between rows, as aberration, is over the accuracy of the run.
fn write_error(text: &mut String, params: &RunParams) -> Result<()> {
    let Observer::Table(history) = &params.observer else { return Ok(()) };
    let Some([_, km_s]) = history.interpolation_error() else { return Ok(()) };
    let (arcsec, most) = (km_s / SPEED_OF_LIGHT_KM_S / ARCSEC, params.budget.los_arcsec);
    if arcsec > most {
        writeln!(
            text,
            "  WARNING      the observer's states err by up to {arcsec:.1e} arcsec of aberration, more than \
             accuracy.los_arcsec = {most}: give denser rows, or velocities with them"
        )?;
    }
    Ok(())
}

/// Writes a warning about elements that are older than they should be.
pub(super) fn write_age(text: &mut String, what: &str, orbit: &TleOrbit, at: Tai) -> Result<(), fmt::Error> {
    let days = orbit.days_from_epoch(at);
    if days.abs() <= USUAL_DAYS {
        return Ok(());
    }
    let [error_km, error_km_s] = orbit.usual_error(at);
    let arcsec = error_km_s / SPEED_OF_LIGHT_KM_S / ARCSEC;
    writeln!(
        text,
        "  WARNING      the elements of {what} are used {days:.1} days from their epoch: SGP4 errs there by some \
         {error_km:.0} km and {error_km_s:.3} km/s in a low orbit, {arcsec:.3} arcsec of aberration; wanted {USUAL_DAYS} days \
         at most"
    )
}

/// Returns the description of a file of states, and its error between rows.
fn table(history: &OrbitHistory) -> String {
    let method = history.segments().first().map_or_else(String::new, |segment| segment.method().to_string());
    let bound = history.interpolation_error().map_or_else(
        || "too few rows to see how far it errs".to_owned(),
        |[km, km_s]| {
            if km <= 0.0 && km_s <= 0.0 {
                return "exact between rows".to_owned();
            }
            let arcsec = km_s / SPEED_OF_LIGHT_KM_S / ARCSEC;
            format!("errs by less than {km:.1e} km and {km_s:.1e} km/s, {arcsec:.1e} arcsec of aberration")
        },
    );
    let notes: String = history.notes.iter().map(|note| format!("; {note}")).collect();
    format!("{}, {} rows, {method}: {bound}{notes}", history.format, history.rows())
}

fn is_proven(at: Tai) -> bool {
    (PROVEN_YEARS[0]..=PROVEN_YEARS[1]).contains(&(2000.0 + at.years_since_j2000()))
}

fn place(observer: &Observer, at: Tai) -> Result<String> {
    let Some(about) = observer.about() else { return Ok("at rest at the barycentre".into()) };
    let state = observer.relative_state(at)?;
    let days_old = match observer {
        Observer::Geocentre => return Ok("at the centre of the Earth".into()),
        Observer::Tle(orbit) => format!(", elements {:.1} days old", orbit.days_from_epoch(at)),
        Observer::TwoBody { orbit, .. } => format!(", state {:.1} days old", (at - orbit.epoch()).s() / DAY_S),
        Observer::Table(history) => format!(", {}", table(history)),
        Observer::Circular(_) | Observer::Barycentre => String::new(),
    };
    let (distance_km, speed_km_s) = (state.position_km.length(), state.velocity_km_s.length());
    Ok(format!("{distance_km:.0} km from the centre of {about}, {speed_km_s:.3} km/s{days_old}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::time::Tai;

    #[test]
    fn years_are_printed_on_both_sides() {
        let at = |text: &str| Tai::from_rfc3339(text).unwrap();
        for (text, proven) in [
            ("1990-12-30T00:00:00Z", false),
            ("1991-01-02T00:00:00Z", true),
            ("2050-12-30T00:00:00Z", true),
            ("2051-01-02T00:00:00Z", false),
        ] {
            assert_eq!(is_proven(at(text)), proven, "{text}");
        }
    }

    #[test]
    fn places_are_reported() {
        let at = Tai::from_rfc3339("2026-03-01T00:00:00Z").unwrap();
        assert_eq!(place(&Observer::Barycentre, at).unwrap(), "at rest at the barycentre");
        assert_eq!(place(&Observer::Geocentre, at).unwrap(), "at the centre of the Earth");
        let orbit = sky::orbit::CircularOrbit::new(500.0, 97.4, 30.0, 10.0, at).unwrap();
        let reported = place(&Observer::Circular(orbit), at).unwrap();
        assert_eq!(reported, "6878 km from the centre of the Earth, 7.613 km/s");
    }

    fn doubts(observer: &Observer, at: Tai) -> String {
        let mut text = String::new();
        write_doubts(&mut text, observer, at).unwrap();
        text
    }

    /// Rows on a circular orbit about the Earth, 6 minutes at least, so many seconds apart.
    fn warned(step_s: f64) -> String {
        let mut rows = String::from("unix_s,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s\n");
        for step in 0..=(400.0 / step_s).ceil().max(6.0) as u32 {
            let t_s = f64::from(step) * step_s;
            let (sin, cos) = (1.078e-3 * t_s).sin_cos();
            rows += &format!(
                "{},{},{},0,{},{},0\n",
                1_772_323_200.0 + t_s,
                7000.0 * cos,
                7000.0 * sin,
                -7.546 * sin,
                7.546 * cos
            );
        }
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("o.csv"), rows).unwrap();
        let text = "[observer]\nkind = \"file\"\nfile = \"o.csv\"\n";
        let document = config::Document::from_text(text, &folder.path().join("lab.toml"));
        let bench = config::Bench::from_document(&document).unwrap();
        let params =
            run::wiring::bench_parts::run_params(&bench, Tai::from_rfc3339("2026-03-01T00:00:00Z").unwrap()).unwrap();
        let mut text = String::new();
        write_error(&mut text, &params).unwrap();
        text
    }

    #[test]
    fn old_elements_are_warned_of_with_their_error() {
        let lines = "1 00005U 58002B   00179.78495062  .00000023  00000-0  28098-4 0  4753\n\
            2 00005  34.2682 348.7242 1859667 331.7664  19.3264 10.82419157413667";
        let observer = Observer::Tle(Box::new(TleOrbit::parse(lines).unwrap()));
        let at = |text: &str| Tai::from_rfc3339(text).unwrap();
        assert_eq!(doubts(&observer, at("2000-07-04T00:00:00Z")), "", "within a week");
        let reported = doubts(&observer, at("2000-07-07T18:50:20Z"));
        for part in
            ["  WARNING      the elements of observer are used 10.0 days", "30 km and 0.024 km/s", "0.016 arcsec"]
        {
            assert!(reported.contains(part), "no \"{part}\" in {reported}");
        }
    }

    #[test]
    fn a_file_beyond_the_moon_or_faster_than_escape_is_warned_of() {
        let table = |x_km: f64, vy_km_s: f64| {
            let row = |t: f64| format!("{},{x_km},{},0,0,{vy_km_s},0\n", 1_772_323_200.0 + t, vy_km_s * t);
            let text = format!("unix_s,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s\n{}{}", row(0.0), row(1.0));
            let history = histories::read::orbit("rows.csv", &text).unwrap();
            let at = Tai::from_ns(history.span_ns()[0]);
            doubts(&Observer::Table(std::sync::Arc::new(history)), at)
        };
        assert_eq!(table(7_000.0, 7.5), "");
        assert_eq!(table(400_000.0, 1.0), "");
        let far = table(500_000.0, 1.0);
        assert!(far.contains("WARNING") && far.contains("500000 km") && far.contains("406700"), "{far}");
        let fast = table(7_000.0, 11.0);
        assert!(fast.contains("WARNING") && fast.contains("11.000 km/s") && fast.contains("10.672"), "{fast}");
    }

    #[test]
    fn the_error_of_sparse_states_is_a_warning_and_that_of_dense_ones_is_not() {
        assert_eq!(warned(10.0), "");
        let text = warned(1500.0);
        assert!(text.contains("WARNING") && text.contains("accuracy.los_arcsec"), "{text}");
    }

    #[test]
    fn a_file_is_reported_with_its_error() {
        let mut rows = String::from("unix_s,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s\n");
        for step in 0..5 {
            let (sin, cos) = (1.1e-3 * 60.0 * f64::from(step)).sin_cos();
            let (x, y, v) = (7000.0 * cos, 7000.0 * sin, 7.7);
            rows += &format!("{},{x},{y},0,{},{},0\n", 1_772_323_200 + 60 * step, -v * sin, v * cos);
        }
        let history = histories::read::orbit("rows.csv", &rows).unwrap();
        let at = Tai::from_ns(history.span_ns()[0]);
        let reported = place(&Observer::Table(std::sync::Arc::new(history)), at).unwrap();
        for part in
            ["7000 km from the centre of the Earth", "5 rows", "Hermite of degree 3", "errs by less than 5.", "e-3 km"]
        {
            assert!(reported.contains(part), "no \"{part}\" in {reported}");
        }
    }
}
