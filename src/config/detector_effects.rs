//! Keys of `[detector]`, and its effects that are off until their table is given (`[detector.blooming]` and so on):
//! keys and check of each in one file.

use crate::check::{Checker, Rule};
use crate::detector::{
    CELSIUS, GainRule, LARGEST_SIDE_PX, LineKeys, MOST_DARK_E_PER_S, MapKeys, NonlinearityKeys, RowNoiseKeys,
};
use crate::key::{Given, Section, section, taken};
use crate::key_type::{Whole, Word};
use crate::{error::Result, radiometry::Exposure};
use base::bayer::BayerPattern;
use image::detector::binning::{Binning, BinningKind, MOST};
use image::detector::charge_transfer::{ChargeTransfer, MOST_LEFT_BEHIND, OutputCorner};
use image::detector::defects::{DefectPopulation, Rates};
use image::detector::pattern::{ColourFilter, LEAST_RESPONSE};
use image::detector::protons::{ProtonDirection, ProtonFlux, SensitiveLayer};
use image::detector::{DarkLaw, PoissonMethod, Rounding, SpatialParams};
use image::detector::{
    blooming::Blooming, image_lag::ImageLag, protons::stopping_power::DOMAIN_MEV, tdi::Tdi, window::Window,
};

/// Smallest pitch, um: a fraction of the wavelength of all light that a detector counts.
const LEAST_PITCH_UM: f64 = 0.1;
/// Largest share of the pixels that a random population may make defective, of each kind.
const LARGEST_DEFECT_SHARE: f64 = 0.05;

section! {
    /// Geometry, charge and conversion.
    DetectorKeys at "detector" {
        /// Number of columns.
        width_px: Whole = Needed, 1..=LARGEST_SIDE_PX;
        /// Number of rows.
        height_px: Whole = Needed, 1..=LARGEST_SIDE_PX;
        /// Resolution of the converter, such as 12; above 16 does not fit the image.
        bits: Whole = 12, 1..=16;
        /// Digital number of a pixel without charge; it must leave a range for signal below the largest digital number.
        black_level_dn: f64 = Computed("64, at most an eighth of the range"), Within(0.0, 65_534.0);
        /// Saturation capacity from the data sheet, such as 30000.
        full_well_e: f64 = 30_000.0, Positive;
        /// Electrons per DN: full well / (2^bits - 1 - black level) uses the whole range.
        gain_e_per_dn: f64 = Computed("by gain_rule"), Positive;
        /// How the gain is found where it is not given.
        gain_rule: Word<GainRule> = Silent("fill-range"),
            [("fill-range", GainRule::FillRange), ("lsb", GainRule::Lsb)],
            "\"fill-range\": the full well is the largest DN; \"lsb\": one DN is full well / 2^bits";
        /// How the converter makes a whole number.
        rounding: Word<Rounding> = Silent("nearest"),
            [("nearest", Rounding::Nearest), ("truncate", Rounding::Truncate)];
        /// Noise after the pixel, electrons rms, adds to read_noise_e_rms in quadrature; 0 turns it off.
        amplifier_noise_e_rms: f64 = Silent(0.0), Within(0.0, 1e6);
        /// How shot noise is drawn; "auto" serves all means, and is the only one on a GPU.
        poisson: Word<PoissonMethod> = PoissonMethod::ALL[0].name(),
            PoissonMethod::ALL.map(|method| (method.name(), method));
        /// Pixel pitch in micrometres, such as 5.5.
        pixel_pitch_um: f64 = 10.0, Within(LEAST_PITCH_UM, 1000.0);
        /// Temporal noise of one read, electrons rms; 0 turns it off.
        read_noise_e_rms: f64 = 10.0, Within(0.0, 1e6);
        /// Mean dark current, electrons per second and pixel, at dark_temperature_c; 0 turns it off.
        dark_e_per_s: f64 = 10.0, Within(0.0, MOST_DARK_E_PER_S);
        /// Nanoamperes per square centimetre, such as 0.1; 0 turns it off.
        dark_current_na_per_cm2: f64 = Optional, Within(0.0, 1e6);
        /// Degrees Celsius at which the dark current was measured.
        dark_temperature_c: f64 = 20.0, CELSIUS;
        /// The detector's temperature in degrees Celsius; left out, it is dark_temperature_c.
        temperature_c: f64 = Computed("dark_temperature_c"), CELSIUS;
        /// Kelvin of warming that double the dark current, 5 to 10 for silicon.
        dark_doubling_k: f64 = DarkLaw::AT_REFERENCE.doubling_k, Positive;
        /// Rms share of the mean dark current: 20 % is 0.2; 0 turns it off.
        dark_nonuniformity: f64 = Silent(0.0), Within(0.0, 1.0);
        /// Photo-response non-uniformity, an rms fraction: 1 % is 0.01.
        prnu: f64 = 0.01, Within(0.0, 0.5);
        /// The same from peak to peak, in place of prnu.
        prnu_pp: f64 = Optional, NotNegative, "a peak-to-peak figure; over pp_sigmas it is the rms";
        /// Dark-signal non-uniformity of one frame, electrons rms; 0 turns it off.
        dsnu_e_rms: f64 = 1.0, NotNegative;
        /// The same from peak to peak, in place of dsnu_e_rms.
        dsnu_e_pp: f64 = Optional, NotNegative, "a peak-to-peak figure; over pp_sigmas it is the rms";
        /// Standard deviations from peak to peak, usually 5 to 6.
        pp_sigmas: f64 = Silent(6.0), Within(1.0, 20.0);
        /// Electrons per photon, a mean over the band with the fill factor: 45 % is 0.45.
        quantum_efficiency: f64 = 0.5, PositiveUpTo(1.0);
        tables:
        /// A colour filter before each pixel.
        colour_filter: Option<ColourFilterKeys>;
        /// Hot, dead and blinking pixels, drawn at random.
        defects: Option<DefectsKeys>;
        /// Tracks of protons.
        protons: Option<ProtonsKeys>;
        /// Charge that comes with the next frame.
        image_lag: Option<ImageLagKeys>;
        /// Charge above the full well that spills into the column.
        blooming: Option<BloomingKeys>;
        /// Charge that each transfer of a CCD leaves behind.
        charge_transfer: Option<ChargeTransferKeys>;
        /// Pixels that become one.
        binning: Option<BinningKeys>;
        /// The part of the sensor that is read.
        window: Option<WindowKeys>;
        /// Time delay and integration: charge that follows the image.
        tdi: Option<TdiKeys>;
        /// Fixed patterns of columns and rows.
        lines: LineKeys;
        /// Fixed patterns as FITS images of the detector's size.
        maps: MapKeys;
        /// Noise that a row shares.
        row_noise: RowNoiseKeys;
        /// Nonlinear response to charge.
        nonlinearity: NonlinearityKeys;
    }

    /// A colour filter before each pixel, in squares of two by two.
    ColourFilterKeys at "detector.colour_filter" {
        /// Colours of the first two rows of the sensor, from its first pixel at the top left.
        pattern: Word<BayerPattern> = Needed, BayerPattern::NAMED;
        /// Share of the electrons that a pixel without a filter counts, in red pixels, such as 0.35.
        red: f64 = Needed, Within(LEAST_RESPONSE, 1.0),
            "a share, for light of the colour of your stars: the colour's quantum efficiency over detector.quantum_efficiency";
        /// The same in green pixels, such as 0.45.
        green: f64 = Needed, Within(LEAST_RESPONSE, 1.0),
            "a share, for light of the colour of your stars: the colour's quantum efficiency over detector.quantum_efficiency";
        /// The same in blue pixels, such as 0.25.
        blue: f64 = Needed, Within(LEAST_RESPONSE, 1.0),
            "a share, for light of the colour of your stars: the colour's quantum efficiency over detector.quantum_efficiency";
    }

    /// Charge above the full well.
    BloomingKeys at "detector.blooming" {
        /// Share of the charge above the full well that the anti-blooming drain takes: 0 spills all, 1 none.
        drained_share: f64 = 0.0, Within(0.0, 1.0);
    }

    /// Charge that comes with the next frame.
    ImageLagKeys at "detector.image_lag" {
        /// Share of a frame's charge that comes with the next frame, such as 0.001; leave the table out for none.
        share: f64 = Needed, Within(1e-9, 0.9);
    }

    /// Charge that transfers of a CCD leave behind.
    ChargeTransferKeys at "detector.charge_transfer" {
        /// Share left behind by one transfer (1 - CTE) along columns, such as 1e-5; share times transfers is 6 at most.
        parallel_share: f64 = 0.0, Within(0.0, 0.1);
        /// Share left behind by one transfer (1 - CTE) along rows, such as 1e-5; share times transfers is 6 at most.
        serial_share: f64 = 0.0, Within(0.0, 0.1);
        /// Where the amplifier is, as the image is shown.
        output_corner: Word<OutputCorner> = "top-left", [
            ("top-left", OutputCorner::TopLeft), ("top-right", OutputCorner::TopRight),
            ("bottom-left", OutputCorner::BottomLeft), ("bottom-right", OutputCorner::BottomRight),
        ];
    }

    /// Pixels that become one.
    BinningKeys at "detector.binning" {
        /// Pixels along each side that become one.
        factor: Whole = Needed, 2..=i64::from(MOST);
        /// "charge" sums on the chip, the others sum or average digital numbers.
        kind: Word<Sum> = "charge",
            [("charge", Sum::Charge), ("digital-sum", Sum::Digital), ("digital-mean", Sum::Mean)];
        /// Charge that the summing node holds, electrons; at least one pixel's full well.
        summing_well_e: f64 = Computed("detector.full_well_e"), PositiveUpTo(1e9);
    }

    /// The part of the sensor that is read, in sensor pixels before binning.
    WindowKeys at "detector.window" {
        /// First column that is read, in sensor pixels from the top left, before binning.
        left_px: Whole = 0, 0..=LARGEST_SIDE_PX - 1;
        /// First row that is read, in sensor pixels from the top left, before binning.
        top_px: Whole = 0, 0..=LARGEST_SIDE_PX - 1;
        /// Columns that are read; the window must lie on the sensor.
        width_px: Whole = Computed("to the right edge"), 1..=LARGEST_SIDE_PX;
        /// Rows that are read; the window must lie on the sensor.
        height_px: Whole = Computed("to the lower edge"), 1..=LARGEST_SIDE_PX;
    }

    /// Time delay and integration.
    TdiKeys at "detector.tdi" {
        /// Rows that add up; exposure.exposure_s is the time of one of them.
        stages: Whole = Needed, 1..=4096;
    }

    /// Pixels that are hot, dead or blink.
    DefectsKeys at "detector.defects" {
        /// Hot pixels, a share of all pixels, such as 0.001.
        hot_share: f64 = 0.0, Within(0.0, LARGEST_DEFECT_SHARE);
        /// Mean of what a hot pixel has more, electrons per second.
        hot_e_per_s: f64 = 1000.0, Within(0.0, 1e9);
        /// Dead pixels, a share of all pixels, such as 0.001.
        dead_share: f64 = 0.0, Within(0.0, LARGEST_DEFECT_SHARE);
        /// Share of the light that a dead pixel still counts.
        dead_response: f64 = 0.0, Within(0.0, 1.0);
        /// Pixels that blink (random telegraph signal), a share of all pixels, such as 0.001.
        rts_share: f64 = 0.0, Within(0.0, LARGEST_DEFECT_SHARE);
        /// Mean of what a blinking pixel has more at its high level, electrons per second.
        rts_e_per_s: f64 = 100.0, Within(0.0, 1e9);
        /// Switches per second to the high level.
        rts_up_per_s: f64 = 0.1, Within(0.0, 1e6);
        /// Switches per second to the low level.
        rts_down_per_s: f64 = 0.1, Within(0.0, 1e6);
    }

    /// Tracks of protons.
    ProtonsKeys at "detector.protons" {
        /// From everywhere alike, or one direction by incidence_deg and azimuth_deg.
        direction: Word<IsBeam> = "isotropic", [("isotropic", IsBeam(false)), ("beam", IsBeam(true))];
        /// Degrees from the detector's normal.
        incidence_deg: f64 = 0.0, Within(0.0, 89.9);
        /// Degrees on the image from +x towards +y.
        azimuth_deg: f64 = 0.0, Within(-360.0, 360.0);
        /// Protons per cm^2 and second.
        per_cm2_s: f64 = 0.0, Within(0.0, 1e9);
        /// Kinetic energy in MeV, where stopping powers are tabulated.
        energy_mev: f64 = 60.0, Within(DOMAIN_MEV[0], DOMAIN_MEV[1]);
        /// Thickness of the layer that collects charge, micrometres.
        thickness_um: f64 = SensitiveLayer::TYPICAL.thickness_um, Within(0.1, 1000.0);
        /// Side of the square over which charge spreads about a path, pixels.
        track_width_px: f64 = SensitiveLayer::TYPICAL.track_width_px, Within(0.1, 8.0);
    }
}

/// The quantity that a binned pixel sums.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sum {
    Charge,
    Digital,
    Mean,
}

/// Whether protons come from one direction.
#[derive(Debug, Clone, Copy)]
pub(super) struct IsBeam(bool);

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
pub(super) fn check_effects(keys: &DetectorKeys, fits: Fits, check: &mut Checker<'_>) -> Result<SpatialParams> {
    let binning = keys.binning.as_ref().map(|keys| binning(keys, fits, check)).transpose()?;
    let by = binning.map_or(1, |binning| binning.factor);
    let (layer, protons) = protons(keys.protons.as_ref(), fits, check)?;
    let charge_is_binned = binning.is_some_and(|binning| matches!(binning.kind, BinningKind::Charge { .. }));
    let others = [
        ("detector.defects", keys.defects.is_some()),
        ("detector.protons", keys.protons.is_some()),
        ("detector.binning", charge_is_binned),
        ("detector.colour_filter", keys.colour_filter.is_some()),
    ];
    if let (Some(_), Some((key, _))) = (&keys.tdi, others.into_iter().find(|(_, is_given)| *is_given)) {
        let advice = "pixels of a TDI detector are seen by all rows of their column, which is not modelled: leave one of both out";
        return Err(check.invalid(key, "a table beside [detector.tdi]", "one of the two", advice));
    }
    Ok(SpatialParams {
        colour_filter: keys.colour_filter.as_ref().map(|keys| colour_filter(keys, check)).transpose()?,
        defects: keys.defects.as_ref().map_or(Ok(DefectPopulation::NONE), |keys| defects(keys, check))?,
        layer,
        protons,
        image_lag: keys
            .image_lag
            .as_ref()
            .map(|keys| keys.share().check(check).map(|share| ImageLag { share }))
            .transpose()?,
        blooming: keys.blooming.as_ref().map(|keys| blooming(keys, check)).transpose()?,
        charge_transfer: keys.charge_transfer.as_ref().map(|keys| transfer(keys, fits, check)).transpose()?,
        binning,
        window: keys.window.as_ref().map(|keys| window(keys, fits, by, check)).transpose()?,
        tdi: keys.tdi.as_ref().map(|keys| keys.stages().check(check).map(|stages| Tdi { stages })).transpose()?,
    })
}

fn colour_filter(keys: &ColourFilterKeys, check: &mut Checker<'_>) -> Result<ColourFilter> {
    taken!(check, keys => pattern, red, green, blue);
    Ok(ColourFilter { pattern, red, green, blue })
}

fn blooming(keys: &BloomingKeys, check: &mut Checker<'_>) -> Result<Blooming> {
    Ok(Blooming { drained_share: keys.drained_share().check(check)? })
}

fn transfer(keys: &ChargeTransferKeys, fits: Fits, check: &mut Checker<'_>) -> Result<ChargeTransfer> {
    let share = |transfers: u32| Rule::Within(0.0, (MOST_LEFT_BEHIND / f64::from(transfers)).min(0.1));
    let [width, height] = fits.size_px;
    Ok(ChargeTransfer {
        parallel_share: keys.parallel_share().within(share(height)).check(check)?,
        serial_share: keys.serial_share().within(share(width)).check(check)?,
        corner: keys.output_corner().check(check)?,
    })
}

fn binning(keys: &BinningKeys, fits: Fits, check: &mut Checker<'_>) -> Result<Binning> {
    let factor = keys.factor().check(check)?;
    for (side, name) in fits.size_px.iter().zip(["width_px", "height_px"]) {
        if !side.is_multiple_of(factor) {
            let wanted = format!("a factor that divides detector.{name} = {side}");
            let advice = "take another factor, or a sensor size that it divides";
            return Err(keys.factor().advised(advice).invalid(factor, wanted, check));
        }
    }
    let sum = keys.kind().check(check)?;
    if sum != Sum::Charge {
        keys.refuse(&["summing_well_e"], "detector.binning.kind = \"charge\"", check)?;
    }
    let kind = match sum {
        Sum::Charge => {
            let well = keys.summing_well_e().or(fits.full_well_e).within(Rule::Within(fits.full_well_e, 1e9));
            BinningKind::Charge { full_well_e: well.check(check)? }
        }
        Sum::Digital => BinningKind::DigitalSum,
        Sum::Mean => BinningKind::DigitalMean,
    };
    let largest = u64::from(factor * factor) * ((1 << fits.bits) - 1);
    if kind == BinningKind::DigitalSum && largest > u64::from(u16::MAX) {
        let got = format!("\"digital-sum\" of {factor} x {factor} numbers of {} bits, up to {largest}", fits.bits);
        let advice = "average them (\"digital-mean\"), or take fewer pixels or bits";
        return Err(keys.kind().advised(advice).invalid(got, "sums up to 65535, what an image holds", check));
    }
    Ok(Binning { factor, kind })
}

fn window(keys: &WindowKeys, fits: Fits, by: u32, check: &mut Checker<'_>) -> Result<Window> {
    let side = |check: &mut Checker<'_>, whole: u32, [first, size]: [Given<'_, Whole>; 2]| {
        let keys = [first.key(), size.key()];
        let first = first.within(0..=i64::from(whole) - 1).check(check)?;
        let rest = i64::from(whole - first);
        let size = size.or(rest).within(1..=rest).check(check)?;
        for (key, value) in keys.iter().zip([first, size]) {
            if !value.is_multiple_of(by) {
                let wanted = format!("a multiple of detector.binning.factor = {by}");
                return Err(check.invalid(key, value, wanted, "a window begins and ends on whole output pixels"));
            }
        }
        Ok((first, size))
    };
    let (left_px, width_px) = side(check, fits.size_px[0], [keys.left_px(), keys.width_px()])?;
    let (top_px, height_px) = side(check, fits.size_px[1], [keys.top_px(), keys.height_px()])?;
    Ok(Window { left_px, top_px, width_px, height_px })
}

/// Returns the exposure of a frame: `exposure_s` is that of one stage.
pub(super) fn tdi_exposure(exposure: Exposure, spatial: &SpatialParams, check: &Checker<'_>) -> Result<Exposure> {
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

fn defects(keys: &DefectsKeys, check: &mut Checker<'_>) -> Result<DefectPopulation> {
    taken!(check, keys => hot_share, hot_e_per_s, dead_share, dead_response, rts_share, rts_e_per_s);
    Ok(DefectPopulation {
        hot_share,
        hot_e_per_s,
        dead_share,
        dead_response,
        rts_share,
        rts_e_per_s,
        rts_rates: Rates {
            up_per_s: keys.rts_up_per_s().check(check)?,
            down_per_s: keys.rts_down_per_s().check(check)?,
        },
    })
}

/// Reads the protons. The layer is there without a flux too: protons may come by a command.
fn protons(
    keys: Option<&ProtonsKeys>,
    fits: Fits,
    check: &mut Checker<'_>,
) -> Result<(SensitiveLayer, Option<ProtonFlux>)> {
    let typical = SensitiveLayer { pixel_pitch_um: fits.pixel_pitch_um, ..SensitiveLayer::TYPICAL };
    let Some(keys) = keys else { return Ok((typical, None)) };
    let IsBeam(is_beam) = keys.direction().check(check)?;
    let direction = if is_beam {
        let incidence_deg = keys.incidence_deg().check(check)?;
        ProtonDirection::Beam { incidence_deg, azimuth_deg: keys.azimuth_deg().check(check)? }
    } else {
        keys.refuse(&["incidence_deg", "azimuth_deg"], "detector.protons.direction = \"beam\"", check)?;
        ProtonDirection::Isotropic
    };
    let per_cm2_s = keys.per_cm2_s().check(check)?;
    let flux = ProtonFlux { per_cm2_s, energy_mev: keys.energy_mev().check(check)?, direction };
    taken!(check, keys => thickness_um, track_width_px);
    let layer = SensitiveLayer { thickness_um, track_width_px, ..typical };
    Ok((layer, (flux.per_cm2_s > 0.0).then_some(flux)))
}
