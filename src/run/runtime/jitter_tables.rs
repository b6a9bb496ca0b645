//! Parameter tables of the protocol -> the jitter history: units, and from body axes to sensor axes.
//!
//! In: rows in effect after an APPLY, arcsec about body axes. Out: lines, noise and harmonics, rad about sensor axes.
//! The history accepts every table that the protocol accepts (test below). Do not call for every frame: noise takes
//! about a millisecond to be made.

use base::axes::{Body, Rotation, Sensor};
use base::units::ARCSEC;
use firmware_protocol::message::Table;
use firmware_protocol::tables::{HarmonicRow, LineRow, PsdRow, TableStore};
use glam::DVec3;
use plan::attitude::{JitterHistory, JitterLine, JitterReject, PsdPoint, WheelHarmonic};

/// Applies one table.
///
/// # Errors
/// When the history refuses it; the table before stays in effect.
pub fn apply(
    table: Table,
    tables: &TableStore,
    sensor_from_body: Rotation<Sensor, Body>,
    jitter: &mut JitterHistory,
) -> Result<(), JitterReject> {
    let turned = |xyz_arcsec: [f32; 3]| sensor_from_body.apply(vector(xyz_arcsec) * ARCSEC);
    match table {
        Table::Lines => {
            let line = |row: LineRow| JitterLine {
                frequency_hz: f64::from(row.frequency_hz),
                amplitude_rad: turned(row.amplitude_xyz_arcsec),
                phase_rad: f64::from(row.phase_rad),
            };
            jitter.set_uploaded_lines(&tables.lines().map(line).collect::<Vec<_>>())
        }
        Table::Psd => {
            let point = |row: PsdRow| PsdPoint {
                frequency_hz: f64::from(row.frequency_hz),
                density: vector(row.density_xyz_arcsec2_hz) * (ARCSEC * ARCSEC),
            };
            let points: Vec<PsdPoint> = tables.psd().map(point).collect();
            jitter.set_psd(&points, u64::from(tables.psd_seed()), |body| sensor_from_body.apply(body))
        }
        Table::WheelHarmonics => {
            let harmonic = |row: HarmonicRow| WheelHarmonic {
                wheel: usize::from(row.wheel),
                harmonic: f64::from(row.harmonic),
                amplitude_rad: turned(row.amplitude_xyz_arcsec),
                exponent: f64::from(row.exponent),
                phase_rad: f64::from(row.phase_rad),
            };
            jitter.set_wheel_harmonics(&tables.harmonics().map(harmonic).collect::<Vec<_>>())
        }
    }
}

fn vector(xyz: [f32; 3]) -> DVec3 {
    DVec3::from_array(xyz.map(f64::from))
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::time::{Span, Tai};
    use firmware_protocol::tables::{Row, cells, crc};
    use plan::attitude::{HistoryLimits, RemoteClock, RemoteClockLimits};

    /// Rounding of f32 on the wire, and of sines.
    const WIRE: f64 = 1e-6;

    fn effective<R: Row>(rows: &[R]) -> TableStore {
        let mut tables = TableStore::new();
        cells(rows).for_each(|cell| tables.put(&cell));
        tables.apply(R::TABLE.number(), u8::try_from(rows.len()).unwrap(), crc(rows), 7).unwrap();
        tables
    }

    fn history() -> JitterHistory {
        let limits = HistoryLimits { capacity: 64, max_age: Span::from_ms(1000), max_lead: Span::from_ms(10) };
        let mut history = JitterHistory::new(limits, Span::from_ms(100));
        let mut clock = RemoteClock::new(RemoteClockLimits::default());
        clock.observe(0, Tai::from_ns(0));
        history.follow_clock(&clock.estimate().unwrap());
        history
    }

    /// Returns a quarter turn about body z: body x is sensor -y or y, depending on the convention of `apply`.
    fn mounting() -> Rotation<Sensor, Body> {
        Rotation::from_rotation_vector(DVec3::Z * core::f64::consts::FRAC_PI_2)
    }

    #[test]
    fn a_line_is_turned_into_sensor_axes_and_has_its_phase_at_scet_zero() {
        let row = LineRow { frequency_hz: 2.0, amplitude_xyz_arcsec: [3.0, 0.0, 0.0], phase_rad: 0.5 };
        let mut jitter = history();
        apply(Table::Lines, &effective(&[row]), mounting(), &mut jitter).unwrap();
        let mut track = jitter.new_track();
        let at = Tai::from_ns(1_100_000_000);
        jitter.fill(at, at, &mut track);
        let wanted = mounting().apply(DVec3::X) * (3.0 * ARCSEC * (core::f64::consts::TAU * 2.0 * 1.1 + 0.5).sin());
        let got = track.rotation_at(at);
        assert!((got - wanted).length() < WIRE * wanted.length(), "{got} {wanted}");
        assert!(wanted.y.abs() > 0.9 * wanted.length(), "control: it was turned");
    }

    #[test]
    fn everything_that_the_protocol_takes_is_taken() {
        let psd = |hz: f32, density: f32| PsdRow { frequency_hz: hz, density_xyz_arcsec2_hz: [density, 0.0, 1e-30] };
        let mut jitter = history();
        apply(Table::Psd, &effective(&[psd(0.1, 5.0), psd(50.0, 0.01), psd(9e3, 0.0)]), mounting(), &mut jitter)
            .unwrap();
        let harmonic = HarmonicRow {
            wheel: 3,
            harmonic: 5.9,
            amplitude_xyz_arcsec: [-3600.0, 1.0, 0.0],
            exponent: 4.0,
            phase_rad: -6.0,
        };
        apply(Table::WheelHarmonics, &effective(&[harmonic; 64]), mounting(), &mut jitter).unwrap();
        let line = LineRow { frequency_hz: 1e4, amplitude_xyz_arcsec: [3600.0; 3], phase_rad: 6.2 };
        apply(Table::Lines, &effective(&[line; 32]), mounting(), &mut jitter).unwrap();
        apply(Table::Lines, &TableStore::new(), mounting(), &mut jitter).expect("an empty table clears");
    }
}
