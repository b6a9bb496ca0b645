//! The last column of `frames.csv`: the exposure of a commanded camera.
//!
//! `start;length;gain;black level;started;trigger;regions`: TAI in ns, ns, the 64 bits of dB and of DN in hexadecimal,
//! the event that started it, time of its trigger (TAI in ns; empty: none), and `left:top:width:height` of each region
//! with `+` between them. Empty: an exposure by the frame rate with the camera's own settings.

use crate::runtime::{Exposed, Started};
use base::time::{Span, Tai};
use frames::camera_control::{CameraSettings, Region, Regions, TriggerSource};
use std::io::{self, Write};

const WANTED: &str = "exposed: wanted start;length;gain;black level;started;trigger;regions, or nothing";

/// Writes the column.
pub(super) fn write(exposed: &Exposed, out: &mut dyn Write) -> io::Result<()> {
    let Exposed { start, started, settings } = exposed;
    let (gain, black) = (settings.gain_db.to_bits(), settings.black_level_dn.to_bits());
    write!(out, "{};{};{gain:016x};{black:016x};{};", start.ns(), settings.exposure.ns(), started.name())?;
    match started {
        Started::Rate => {}
        Started::Trigger { at, .. } => write!(out, "{}", at.ns())?,
    }
    out.write_all(b";")?;
    for (number, region) in settings.regions.as_slice().iter().enumerate() {
        let before = if number == 0 { "" } else { "+" };
        let Region { left_px, top_px, width_px, height_px } = region;
        write!(out, "{before}{left_px}:{top_px}:{width_px}:{height_px}")?;
    }
    Ok(())
}

/// Reads the column; `None` when it is empty.
///
/// # Errors
/// The wanted form.
pub(super) fn parse(text: &str) -> Result<Option<Exposed>, &'static str> {
    if text.is_empty() {
        return Ok(None);
    }
    let fields: Vec<&str> = text.split(';').collect();
    let [start, length, gain, black, name, trigger, list] = fields.as_slice() else { return Err(WANTED) };
    let ns = |text: &str| text.parse::<i64>().map_err(|_| WANTED);
    let bits = |text: &str| u64::from_str_radix(text, 16).map(f64::from_bits).map_err(|_| WANTED);
    let exposure = Span::from_ns(ns(length)?);
    let (gain_db, black_level_dn) = (bits(gain)?, bits(black)?);
    if exposure <= Span::ZERO || !gain_db.is_finite() || !black_level_dn.is_finite() {
        return Err(WANTED);
    }
    let settings = CameraSettings { exposure, gain_db, black_level_dn, regions: regions(list)? };
    Ok(Some(Exposed { start: Tai::from_ns(ns(start)?), started: started(name, trigger)?, settings }))
}

fn started(name: &str, trigger: &str) -> Result<Started, &'static str> {
    if name == Started::Rate.name() {
        return Ok(Started::Rate);
    }
    let source = TriggerSource::NAMED.iter().find(|(known, _)| *known == name).ok_or(WANTED)?.1;
    Ok(Started::Trigger { source, at: Tai::from_ns(trigger.parse().map_err(|_| WANTED)?) })
}

fn regions(list: &str) -> Result<Regions, &'static str> {
    if list.is_empty() {
        return Ok(Regions::WHOLE);
    }
    let region = |text: &str| {
        let numbers: Result<Vec<u32>, _> = text.split(':').map(str::parse).collect();
        let [left_px, top_px, width_px, height_px] = numbers.ok()?.try_into().ok()?;
        Some(Region { left_px, top_px, width_px, height_px })
    };
    let regions: Option<Vec<Region>> = list.split('+').map(region).collect();
    regions.as_deref().and_then(Regions::of).ok_or(WANTED)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text_of(exposed: &Exposed) -> String {
        let mut text = Vec::new();
        write(exposed, &mut text).unwrap();
        String::from_utf8(text).unwrap()
    }

    #[test]
    fn an_exposure_comes_back_bit_by_bit() {
        let region = Region { left_px: 1, top_px: 2, width_px: 30, height_px: 40 };
        let settings = CameraSettings {
            exposure: Span::from_ns(12_345_678),
            gain_db: 0.1 + 0.2,
            black_level_dn: 64.0,
            regions: Regions::of(&[region, Region { left_px: 100, ..region }]).unwrap(),
        };
        let at = Tai::from_ns(987_654_321);
        for started in [Started::Rate, Started::Trigger { source: TriggerSource::Line, at }] {
            for regions in [settings.regions, Regions::WHOLE] {
                let exposed = Exposed { start: at, started, settings: CameraSettings { regions, ..settings } };
                let text = text_of(&exposed);
                assert_eq!(parse(&text), Ok(Some(exposed)), "{text}");
                assert_ne!(parse(&text.replacen("12345678", "12345679", 1)), Ok(Some(exposed)), "control");
            }
        }
        assert_eq!(parse(""), Ok(None));
    }

    #[test]
    fn damage_is_refused() {
        let good = "1;2;0000000000000000;0000000000000000;bus;3;1:2:3:4";
        assert!(parse(good).is_ok());
        for (from, to) in
            [("1;2", "1;0"), ("bus", "cat"), (";3;", ";;"), ("3:4", "3"), ("1;2;0", "1;2;x"), ("1;2;", "1;")]
        {
            let bad = good.replacen(from, to, 1);
            assert_eq!(parse(&bad), Err(WANTED), "{bad}");
        }
    }
}
