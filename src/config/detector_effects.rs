//! `[detector.blooming]`, `[detector.image_lag]` and so on: effects that are off until their table is given.

use crate::check::{Checker, Rule};
use crate::detector::DetectorKeys;
use crate::error::ConfigError;
use crate::radiometry::Exposure;
use image::detector::SpatialParams;
use image::detector::binning::{Binning, BinningKind, MOST};
use image::detector::blooming::Blooming;
use image::detector::charge_transfer::{ChargeTransfer, MOST_LEFT_BEHIND, OutputCorner};
use image::detector::defects::{DefectPopulation, Rates};
use image::detector::image_lag::ImageLag;
use image::detector::protons::stopping_power::DOMAIN_MEV;
use image::detector::protons::{ProtonDirection, ProtonFlux, SensitiveLayer};
use image::detector::tdi::Tdi;
use image::detector::window::Window;
use serde::Deserialize;

/// Largest share of the pixels that a random population may make defective, of each kind.
const LARGEST_DEFECT_SHARE: f64 = 0.05;

/// A table of keys that are all numbers or words, none of them needed.
macro_rules! keys {
    ($($table:ident { $($key:ident: $type:ty),* $(,)? })*) => {
        $(
            #[derive(Debug, Default, Deserialize)]
            #[serde(deny_unknown_fields)]
            pub(super) struct $table {
                $($key: Option<$type>),*
            }
        )*
    };
}

keys! {
    BloomingKeys { drained_share: f64 }
    ImageLagKeys { share: f64 }
    ChargeTransferKeys { parallel_share: f64, serial_share: f64, output_corner: String }
    BinningKeys { factor: i64, kind: String, summing_well_e: f64 }
    WindowKeys { left_px: i64, top_px: i64, width_px: i64, height_px: i64 }
    TdiKeys { stages: i64 }
    DefectsKeys {
        hot_share: f64, hot_e_per_s: f64, dead_share: f64, dead_response: f64,
        rts_share: f64, rts_e_per_s: f64, rts_up_per_s: f64, rts_down_per_s: f64,
    }
    ProtonsKeys {
        per_cm2_s: f64, energy_mev: f64, direction: String, incidence_deg: f64, azimuth_deg: f64,
        thickness_um: f64, track_width_px: f64,
    }
}

/// The detector's figures that these effects must fit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fits {
    /// Columns and rows.
    pub(super) size_px: [u32; 2],
    /// Pitch of the pixels.
    pub(super) pixel_pitch_um: f64,
    /// Saturation capacity.
    pub(super) full_well_e: f64,
    /// Bits of the converter.
    pub(super) bits: u32,
}

/// Checks all tables that are given.
pub(super) fn check_effects(
    keys: &DetectorKeys,
    fits: Fits,
    check: &mut Checker<'_>,
) -> Result<SpatialParams, ConfigError> {
    let binning = keys.binning.as_ref().map(|keys| binning(keys, fits, check)).transpose()?;
    let by = binning.map_or(1, |binning| binning.factor);
    let (layer, protons) = protons(keys.protons.as_ref(), fits, check)?;
    let charge_is_binned = binning.is_some_and(|binning| matches!(binning.kind, BinningKind::Charge { .. }));
    let others = [
        ("detector.defects", keys.defects.is_some()),
        ("detector.protons", keys.protons.is_some()),
        ("detector.binning", charge_is_binned),
    ];
    if let (Some(_), Some((key, _))) = (&keys.tdi, others.into_iter().find(|(_, is_given)| *is_given)) {
        let advice = "pixels of a TDI detector are seen by all rows of their column, which is not modelled: leave one of both out";
        return Err(check.invalid(key, "a table beside [detector.tdi]", "one of the two", advice));
    }
    Ok(SpatialParams {
        defects: keys.defects.as_ref().map_or(Ok(DefectPopulation::NONE), |keys| defects(keys, check))?,
        layer,
        protons,
        image_lag: keys.image_lag.as_ref().map(|keys| image_lag(keys, check)).transpose()?,
        blooming: keys.blooming.as_ref().map(|keys| blooming(keys, check)).transpose()?,
        charge_transfer: keys.charge_transfer.as_ref().map(|keys| transfer(keys, fits, check)).transpose()?,
        binning,
        window: keys.window.as_ref().map(|keys| window(keys, fits, by, check)).transpose()?,
        tdi: keys.tdi.as_ref().map(|keys| tdi(keys, check)).transpose()?,
    })
}

fn blooming(keys: &BloomingKeys, check: &mut Checker<'_>) -> Result<Blooming, ConfigError> {
    let advice = "share of the charge above the full well that the anti-blooming drain takes: 0 spills all, 1 none";
    let key = "detector.blooming.drained_share";
    Ok(Blooming { drained_share: check.number(key, keys.drained_share, 0.0, Rule::Within(0.0, 1.0), advice)? })
}

fn image_lag(keys: &ImageLagKeys, check: &Checker<'_>) -> Result<ImageLag, ConfigError> {
    let advice =
        "share of a frame's charge that comes with the next frame, such as 0.001; leave the table out for none";
    let rule = Rule::Within(1e-9, 0.9);
    Ok(ImageLag { share: check.required("detector.image_lag.share", keys.share, rule, advice)? })
}

fn transfer(keys: &ChargeTransferKeys, fits: Fits, check: &mut Checker<'_>) -> Result<ChargeTransfer, ConfigError> {
    let advice = "share left behind by one transfer (1 - CTE), such as 1e-5; share times transfers is 6 at most";
    let [width, height] = fits.size_px.map(f64::from);
    let corners = [
        ("top-left", OutputCorner::TopLeft),
        ("top-right", OutputCorner::TopRight),
        ("bottom-left", OutputCorner::BottomLeft),
        ("bottom-right", OutputCorner::BottomRight),
    ];
    let mut share = |key: &str, given, transfers: f64| {
        let rule = Rule::Within(0.0, (MOST_LEFT_BEHIND / transfers).min(0.1));
        check.number(&format!("detector.charge_transfer.{key}"), given, 0.0, rule, advice)
    };
    Ok(ChargeTransfer {
        parallel_share: share("parallel_share", keys.parallel_share, height)?,
        serial_share: share("serial_share", keys.serial_share, width)?,
        corner: check.choice(
            "detector.charge_transfer.output_corner",
            keys.output_corner.as_deref(),
            &corners,
            "where the amplifier is, as the image is shown",
        )?,
    })
}

fn binning(keys: &BinningKeys, fits: Fits, check: &mut Checker<'_>) -> Result<Binning, ConfigError> {
    let advice = "pixels along each side that become one";
    let factor = check.whole("detector.binning.factor", keys.factor, None, 2..=MOST, advice)?;
    for (side, name) in fits.size_px.iter().zip(["width_px", "height_px"]) {
        if !side.is_multiple_of(factor) {
            let wanted = format!("a factor that divides detector.{name} = {side}");
            let advice = "take another factor, or a sensor size that it divides";
            return Err(check.invalid("detector.binning.factor", factor, wanted, advice));
        }
    }
    let words = [("charge", 0), ("digital-sum", 1), ("digital-mean", 2)];
    let advice = "\"charge\" sums on the chip, the others sum or average digital numbers";
    let kind = check.choice("detector.binning.kind", keys.kind.as_deref(), &words, advice)?;
    let well = "detector.binning.summing_well_e";
    if kind != 0 {
        check.unused(well, keys.summing_well_e.is_some(), "detector.binning.kind = \"charge\"")?;
    }
    let kind = match kind {
        0 => {
            let advice = "charge that the summing node holds, electrons; at least one pixel's full well";
            let rule = Rule::Within(fits.full_well_e, 1e9);
            BinningKind::Charge {
                full_well_e: check.number(well, keys.summing_well_e, fits.full_well_e, rule, advice)?,
            }
        }
        1 => BinningKind::DigitalSum,
        _ => BinningKind::DigitalMean,
    };
    let largest = u64::from(factor * factor) * ((1 << fits.bits) - 1);
    if kind == BinningKind::DigitalSum && largest > u64::from(u16::MAX) {
        let got = format!("\"digital-sum\" of {factor} x {factor} numbers of {} bits, up to {largest}", fits.bits);
        let advice = "average them (\"digital-mean\"), or take fewer pixels or bits";
        return Err(check.invalid("detector.binning.kind", got, "sums up to 65535, what an image holds", advice));
    }
    Ok(Binning { factor, kind })
}

fn window(keys: &WindowKeys, fits: Fits, by: u32, check: &mut Checker<'_>) -> Result<Window, ConfigError> {
    let side = |check: &mut Checker<'_>, axis: usize, names: [&str; 2], given: [Option<i64>; 2]| {
        let whole = fits.size_px[axis];
        let [first_key, size_key] = names.map(|name| format!("detector.window.{name}"));
        let advice = "in sensor pixels from the top left, before binning";
        let first = check.whole(&first_key, given[0], Some(0), 0..=whole - 1, advice)?;
        let room = whole - first;
        let size = check.whole(&size_key, given[1], Some(room), 1..=room, "the window must lie on the sensor")?;
        for (key, value) in [(first_key, first), (size_key, size)] {
            if !value.is_multiple_of(by) {
                let wanted = format!("a multiple of detector.binning.factor = {by}");
                return Err(check.invalid(&key, value, wanted, "a window begins and ends on whole output pixels"));
            }
        }
        Ok((first, size))
    };
    let (left_px, width_px) = side(check, 0, ["left_px", "width_px"], [keys.left_px, keys.width_px])?;
    let (top_px, height_px) = side(check, 1, ["top_px", "height_px"], [keys.top_px, keys.height_px])?;
    Ok(Window { left_px, top_px, width_px, height_px })
}

fn tdi(keys: &TdiKeys, check: &mut Checker<'_>) -> Result<Tdi, ConfigError> {
    let stages = "rows that add up; exposure.exposure_s is the time of one of them";
    Ok(Tdi { stages: check.whole("detector.tdi.stages", keys.stages, None, 1..=4096, stages)? })
}

/// The exposure of a frame: `exposure_s` is that of one stage.
pub(super) fn tdi_exposure(
    exposure: Exposure,
    spatial: &SpatialParams,
    check: &Checker<'_>,
) -> Result<Exposure, ConfigError> {
    let Some(tdi) = spatial.tdi else { return Ok(exposure) };
    if exposure.rolling_line_us > 0.0 {
        let (key, got) = ("exposure.rolling_line_us", exposure.rolling_line_us);
        let advice = "a TDI detector shifts all rows together: leave this key or [detector.tdi] out";
        return Err(check.invalid(key, got, "0 with [detector.tdi]", advice));
    }
    let exposure_s = check.meets(
        "exposure.exposure_s",
        tdi.exposure_s(exposure.exposure_s),
        Rule::PositiveUpTo(3600.0),
        "the time of one stage, times detector.tdi.stages",
    )?;
    Ok(Exposure { exposure_s, ..exposure })
}

fn defects(keys: &DefectsKeys, check: &mut Checker<'_>) -> Result<DefectPopulation, ConfigError> {
    let mut number = |key: &str, given, default, rule, advice| {
        check.number(&format!("detector.defects.{key}"), given, default, rule, advice)
    };
    let share = Rule::Within(0.0, LARGEST_DEFECT_SHARE);
    let share_of = "a share of all pixels, such as 0.001";
    let mean = "mean of what such a pixel has more, electrons per second";
    let rate = "switches per second";
    Ok(DefectPopulation {
        hot_share: number("hot_share", keys.hot_share, 0.0, share, share_of)?,
        hot_e_per_s: number("hot_e_per_s", keys.hot_e_per_s, 1000.0, Rule::Within(0.0, 1e9), mean)?,
        dead_share: number("dead_share", keys.dead_share, 0.0, share, share_of)?,
        dead_response: number(
            "dead_response",
            keys.dead_response,
            0.0,
            Rule::Within(0.0, 1.0),
            "share of the light that a dead pixel still counts",
        )?,
        rts_share: number("rts_share", keys.rts_share, 0.0, share, share_of)?,
        rts_e_per_s: number("rts_e_per_s", keys.rts_e_per_s, 100.0, Rule::Within(0.0, 1e9), mean)?,
        rts_rates: Rates {
            up_per_s: number("rts_up_per_s", keys.rts_up_per_s, 0.1, Rule::Within(0.0, 1e6), rate)?,
            down_per_s: number("rts_down_per_s", keys.rts_down_per_s, 0.1, Rule::Within(0.0, 1e6), rate)?,
        },
    })
}

/// The layer is there without a flux too: protons may come by a command.
fn protons(
    keys: Option<&ProtonsKeys>,
    fits: Fits,
    check: &mut Checker<'_>,
) -> Result<(SensitiveLayer, Option<ProtonFlux>), ConfigError> {
    let typical = SensitiveLayer { pixel_pitch_um: fits.pixel_pitch_um, ..SensitiveLayer::TYPICAL };
    let Some(keys) = keys else { return Ok((typical, None)) };
    let words = [("isotropic", false), ("beam", true)];
    let advice = "from everywhere alike, or one direction by incidence_deg and azimuth_deg";
    let is_beam = check.choice("detector.protons.direction", keys.direction.as_deref(), &words, advice)?;
    if !is_beam {
        let beam = "detector.protons.direction = \"beam\"";
        check.unused("detector.protons.incidence_deg", keys.incidence_deg.is_some(), beam)?;
        check.unused("detector.protons.azimuth_deg", keys.azimuth_deg.is_some(), beam)?;
    }
    let mut number = |key: &str, given, default, rule, advice| {
        check.number(&format!("detector.protons.{key}"), given, default, rule, advice)
    };
    let direction = if is_beam {
        let normal = "degrees from the detector's normal";
        let turn = "degrees on the image from +x towards +y";
        ProtonDirection::Beam {
            incidence_deg: number("incidence_deg", keys.incidence_deg, 0.0, Rule::Within(0.0, 89.9), normal)?,
            azimuth_deg: number("azimuth_deg", keys.azimuth_deg, 0.0, Rule::Within(-360.0, 360.0), turn)?,
        }
    } else {
        ProtonDirection::Isotropic
    };
    let energy = "kinetic energy in MeV, where stopping powers are tabulated";
    let flux = ProtonFlux {
        per_cm2_s: number("per_cm2_s", keys.per_cm2_s, 0.0, Rule::Within(0.0, 1e9), "protons per cm^2 and second")?,
        energy_mev: number("energy_mev", keys.energy_mev, 60.0, Rule::Within(DOMAIN_MEV[0], DOMAIN_MEV[1]), energy)?,
        direction,
    };
    let layer = SensitiveLayer {
        thickness_um: number(
            "thickness_um",
            keys.thickness_um,
            typical.thickness_um,
            Rule::Within(0.1, 1000.0),
            "thickness of the layer that collects charge, micrometres",
        )?,
        track_width_px: number(
            "track_width_px",
            keys.track_width_px,
            typical.track_width_px,
            Rule::Within(0.1, 8.0),
            "side of the square over which charge spreads about a path, pixels",
        )?,
        ..typical
    };
    Ok((layer, (flux.per_cm2_s > 0.0).then_some(flux)))
}
