//! Lists of samples of an external plant: JSON rows of numbers -> samples by the run's clock.
//!
//! | request | one row of `samples` |
//! |---|---|
//! | `attitude` | `t_s`, q `w x y z` (`v_body = q v_icrf q*`), rate about the body axes in rad/s, and perhaps acceleration in rad/s^2 |
//! | `observer` | `t_s`, position, velocity, by `unit`: `km` (and km/s) or `m` (and m/s); ICRF axes |
//! | `jitter` | `t_s`, rotation vector about the body axes, by `unit`: `arcsec` or `rad` |
//!
//! An error in a row is reported with its place; then no row of the list is used. Tests: below.

use crate::runtime::{PlantAttitude, PlantSample};
use base::axes::{COMPUTED_NORM_TOLERANCE, Rotation};
use base::time::{Span, Tai};
use base::units::{ARCSEC, METRE_KM};
use glam::DVec3;
use serde_json::{Map, Value};
use sky::observer::BarycentricState;

/// Largest number of samples in one list.
const SAMPLES_MAX: usize = 4096;
/// Furthest time from the first exposure, s: three years.
const MOST_S: f64 = 1e8;

/// Subject of a list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Subject {
    Attitude,
    Observer,
    Jitter,
}

/// Data of one row.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Said {
    Attitude(PlantAttitude),
    Observer(BarycentricState),
    Jitter(DVec3),
}

/// A list of samples, times in seconds after the first exposure.
#[derive(Debug, Clone, PartialEq)]
pub struct SampleList {
    rows: Vec<(f64, Said)>,
}

impl SampleList {
    /// Reads the `samples` of a request, in its `unit`.
    pub(super) fn read(subject: Subject, keys: &Map<String, Value>) -> Result<Self, String> {
        let scale = subject.scale(keys.get("unit"))?;
        let rows = match keys.get("samples") {
            Some(Value::Array(rows)) if (1..=SAMPLES_MAX).contains(&rows.len()) => rows,
            Some(Value::Array(rows)) => {
                return Err(format!("samples has {} rows; wanted 1 to {SAMPLES_MAX} in a request", rows.len()));
            }
            Some(_) => return Err(format!("samples is not a list; wanted a list of rows: {}", subject.row())),
            None => return Err(format!("samples is missing; wanted a list of rows: {}", subject.row())),
        };
        let read = |(place, row): (usize, &Value)| {
            subject.sample(row, scale).map_err(|why| format!("samples[{place}] {why}; wanted {}", subject.row()))
        };
        rows.iter().enumerate().map(read).collect::<Result<_, _>>().map(|rows| Self { rows })
    }

    /// Returns the samples by the clock of a run whose first exposure is at `zero`.
    pub fn since(&self, zero: Tai) -> Vec<PlantSample> {
        let sample = |(t_s, said): &(f64, Said)| {
            let nothing = PlantSample::at(zero + Span::from_s(*t_s));
            match *said {
                Said::Attitude(attitude) => PlantSample { attitude: Some(attitude), ..nothing },
                Said::Observer(state) => PlantSample { observer: Some(state), ..nothing },
                Said::Jitter(rotation_rad) => PlantSample { jitter_rad: Some(rotation_rad), ..nothing },
            }
        };
        self.rows.iter().map(sample).collect()
    }
}

impl Subject {
    /// Returns the columns of a row in words.
    const fn row(self) -> &'static str {
        match self {
            Self::Attitude => {
                "[t_s, q_w, q_x, q_y, q_z, rate x, y, z in rad/s] and perhaps [.., acceleration x, y, z in rad/s^2]"
            }
            Self::Observer => "[t_s, position x, y, z, velocity x, y, z]",
            Self::Jitter => "[t_s, rotation x, y, z]",
        }
    }

    /// Returns the size of the unit in km or rad.
    fn scale(self, unit: Option<&Value>) -> Result<f64, String> {
        let units: &[(&str, f64)] = match self {
            Self::Attitude => return Ok(1.0),
            Self::Observer => &[("km", 1.0), ("m", METRE_KM)],
            Self::Jitter => &[("arcsec", ARCSEC), ("rad", 1.0)],
        };
        let Some(unit) = unit else { return Ok(units[0].1) };
        let found = units.iter().find(|(name, _)| unit.as_str() == Some(name));
        let names = || units.iter().map(|(name, _)| format!("\"{name}\"")).collect::<Vec<_>>().join(" or ");
        found.map(|(_, scale)| *scale).ok_or_else(|| format!("unit is {unit}; wanted {}", names()))
    }

    fn sample(self, row: &Value, scale: f64) -> Result<(f64, Said), String> {
        let numbers = numbers(row)?;
        let vector = |first: usize| DVec3::new(numbers[first], numbers[first + 1], numbers[first + 2]);
        let t_s = numbers.first().copied().ok_or("has no numbers")?;
        if t_s.abs() > MOST_S {
            return Err(format!("has t_s {t_s}, which is more than {MOST_S} s from the first exposure"));
        }
        let said = match (self, numbers.len()) {
            (Self::Attitude, 8 | 11) => {
                let wxyz = [numbers[1], numbers[2], numbers[3], numbers[4]];
                let acceleration_rad_s2 = if numbers.len() == 11 { vector(8) } else { DVec3::ZERO };
                let body_from_icrf =
                    Rotation::from_wxyz(wxyz, COMPUTED_NORM_TOLERANCE).ok_or_else(|| not_unit(wxyz))?;
                Said::Attitude(PlantAttitude { body_from_icrf, rate_rad_s: vector(5), acceleration_rad_s2 })
            }
            (Self::Observer, 7) => {
                Said::Observer(BarycentricState { position_km: vector(1) * scale, velocity_km_s: vector(4) * scale })
            }
            (Self::Jitter, 4) => Said::Jitter(vector(1) * scale),
            (Self::Attitude | Self::Observer | Self::Jitter, count) => return Err(format!("has {count} numbers")),
        };
        Ok((t_s, said))
    }
}

fn not_unit(wxyz: [f64; 4]) -> String {
    let norm = wxyz.iter().map(|part| part * part).sum::<f64>().sqrt();
    format!("has a quaternion of norm {norm}, which is further than {COMPUTED_NORM_TOLERANCE} from 1")
}

/// Returns the numbers of a row; JSON has no infinite ones.
fn numbers(row: &Value) -> Result<Vec<f64>, String> {
    let Value::Array(values) = row else { return Err("is not a list".into()) };
    values
        .iter()
        .map(|value| value.as_f64().ok_or_else(|| "contains a value that is not a number".to_owned()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn read(subject: Subject, keys: Value) -> Result<SampleList, String> {
        SampleList::read(subject, keys.as_object().unwrap())
    }

    #[test]
    fn rows_are_read_in_their_units() {
        let zero = Tai::from_ns(1_000_000_000);
        let attitudes = json!({ "samples": [[0.25, 0.6, 0.0, 0.8, 0.0, 0.1, 0.2, 0.3],
            [0.5, 1, 0, 0, 0, 0, 0, 0, 0.4, 0.5, 0.6]] });
        let read_attitudes = read(Subject::Attitude, attitudes).unwrap().since(zero);
        assert_eq!(read_attitudes[0].at, Tai::from_ns(1_250_000_000));
        let [first, second] = [0, 1].map(|i| read_attitudes[i].attitude.unwrap());
        assert_eq!(first.body_from_icrf.wxyz(), [0.6, 0.0, 0.8, 0.0]);
        assert_eq!((first.rate_rad_s, first.acceleration_rad_s2), (DVec3::new(0.1, 0.2, 0.3), DVec3::ZERO));
        assert_eq!(second.acceleration_rad_s2, DVec3::new(0.4, 0.5, 0.6));
        let [km, m] = [("km", 1.0), ("m", 1e3)].map(|(unit, k)| {
            let row = [0.0, 7000.0 * k, 0.0, -2.0 * k, 0.0, 7.5 * k, 0.0];
            read(Subject::Observer, json!({ "unit": unit, "samples": [row] })).unwrap().since(zero)[0].observer.unwrap()
        });
        assert_eq!((km, km.position_km.x, km.velocity_km_s.y), (m, 7000.0, 7.5));
        let rad = read(Subject::Jitter, json!({ "unit": "rad", "samples": [[0, 0, ARCSEC, 0]] })).unwrap();
        assert_eq!(read(Subject::Jitter, json!({ "samples": [[0, 0, 1, 0]] })).unwrap(), rad, "arcsec without a unit");
        assert_ne!(read(Subject::Jitter, json!({ "samples": [[0, 1, 0, 0]] })).unwrap(), rad, "control: another axis");
    }

    #[test]
    fn bad_rows_are_refused_with_place_and_reason() {
        let good = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let far = [2e8, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        for (keys, part) in [
            (json!({}), "samples is missing"),
            (json!({ "samples": 3 }), "samples is not a list"),
            (json!({ "samples": [] }), "samples has 0 rows; wanted 1 to 4096"),
            (json!({ "samples": vec![good; SAMPLES_MAX + 1] }), "4097 rows"),
            (json!({ "samples": [good, [0.0, 1.0]] }), "samples[1] has 2 numbers; wanted [t_s"),
            (json!({ "samples": [good, 7] }), "samples[1] is not a list"),
            (json!({ "samples": [[]] }), "samples[0] has no numbers"),
            (json!({ "samples": [[0, 1, 0, 0, 0, 0, 0, "0"]] }), "samples[0] contains a value that is not a number"),
            (json!({ "samples": [[0, 1, 0, 0, 0.1, 0, 0, 0]] }), "norm 1.00498"),
            (json!({ "samples": [[0, 0, 0, 0, 0, 0, 0, 0]] }), "norm 0"),
            (json!({ "samples": [far] }), "more than 100000000 s"),
        ] {
            let error = read(Subject::Attitude, keys.clone()).expect_err(part);
            assert!(error.contains(part), "{keys}: {error}");
        }
        let error = read(Subject::Jitter, json!({ "unit": "deg", "samples": [[0, 0, 0, 0]] })).expect_err("a unit");
        assert!(error.contains("unit is \"deg\"; wanted \"arcsec\" or \"rad\""), "{error}");
        assert!(read(Subject::Attitude, json!({ "samples": [good] })).is_ok(), "control");
    }
}
