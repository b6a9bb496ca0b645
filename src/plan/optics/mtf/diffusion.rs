//! Diffusion of charge before it is collected: electrons wander sideways in silicon without a field.
//!
//! Frequency -> factor. Two forms:
//! * **Gaussian** of standard deviation `s`, `exp(-2 pi^2 s^2 f^2)`: a measured or guessed width;
//! * **layered**: the share of electrons that reach the depletion region, as a wave in the light makes it, over the
//!   share at frequency 0. With absorption `a`, depletion depth `w` and a diffusion length that a wave shortens,
//!   `1 / L^2 = 1 / L0^2 + (2 pi f)^2`:
//!   lit from the *front* (Seib, IEEE Trans. Electron Devices 21, 210, 1974): `1 - exp(-a w) / (1 + a L)`;
//!   lit from the *back*, through field-free silicon of thickness `t` whose surface loses nothing (Crowell and Labuda,
//!   Bell Syst. Tech. J. 48, 1481, 1969, with surface recombination 0): the solution of `n'' = n / L^2 - a exp(-a z)`,
//!   `n'(0) = 0`, `n(t) = 0`, collected at `z = t`, plus what the depletion region absorbs.
//!
//! Lengths in um, `f` in cycles/um. Limits: no field outside the depletion region, no sideways motion inside it, bulk
//! silicon at 300 K. The tests solve the equations by finite differences.
//!
//! *Absorption of light in silicon at 300 K.* Wavelength (nm) -> absorption coefficient `4 pi k / lambda`, 1/um. Source
//! of the extinction coefficient `k`: Green, Solar Energy Materials and Solar Cells 92, 1305 (2008). Between rows `ln
//! k` is linear in wavelength: at most 5 % off between 400 and 1000 nm, below the differences of published tables.
//! Domain: 300 to 1100 nm; other wavelengths have no value. Cold silicon absorbs less red light: not modelled.

use crate::optics::mtf::blur;
use core::f64::consts::{PI, TAU};

/// Diffusion of charge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Diffusion {
    /// A Gaussian.
    Gaussian {
        /// Standard deviation on one axis, um.
        sigma_um: f64,
    },
    /// Layers of silicon.
    Layered(Layers),
}

/// Layers of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layers {
    /// Depth of the depletion region, um.
    pub depletion_um: f64,
    /// Diffusion length in the field-free silicon, um.
    pub diffusion_length_um: f64,
    /// Illuminated side.
    pub side: Side,
}

/// Illuminated side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Side {
    /// Through the depletion region; the field-free silicon below is deep.
    Front,
    /// Through the field-free silicon.
    Back {
        /// Its thickness, um.
        field_free_um: f64,
    },
}

impl Diffusion {
    /// Returns the factor at `frequency` (cycles/um) for light of `wavelength_nm`; `None` when its absorption is
    /// unknown.
    pub fn mtf(&self, frequency: f64, wavelength_nm: f64) -> Option<f64> {
        match self {
            Self::Gaussian { sigma_um } => Some(blur::gaussian(frequency, *sigma_um)),
            Self::Layered(layers) => absorption_per_um(wavelength_nm).map(|a| layers.mtf(frequency, a)),
        }
    }
}

impl Layers {
    /// Returns the factor at `frequency` (cycles/um) for an absorption coefficient in 1/um.
    pub fn mtf(&self, frequency: f64, absorption_per_um: f64) -> f64 {
        self.collected(frequency, absorption_per_um) / self.collected(0.0, absorption_per_um)
    }

    /// Returns the share of the electrons that are collected, for a wave of this frequency.
    fn collected(&self, frequency: f64, a: f64) -> f64 {
        let length = 1.0 / (1.0 / self.diffusion_length_um).hypot(TAU * frequency);
        match self.side {
            Side::Front => 1.0 - (-a * self.depletion_um).exp() / (1.0 + a * length),
            Side::Back { field_free_um } => {
                let passed = (-a * field_free_um).exp();
                wandered(a, length, field_free_um) + passed * (1.0 - (-a * self.depletion_um).exp())
            }
        }
    }
}

/// Returns the share that reaches the far side of field-free silicon of thickness `t`, without loss at the near
/// surface.
fn wandered(a: f64, length: f64, t: f64) -> f64 {
    // The closed form is 0 / 0 at a L = 1, where it is smooth: the error a millionth beside it is smaller than that.
    let length = if (a * length - 1.0).abs() < 1e-6 { (1.0 + 1e-6) / a } else { length };
    let al = a * length;
    let depth = t / length;
    al / (al * al - 1.0) * (al / depth.cosh() - (-a * t).exp() * (al + depth.tanh()))
}

/// Wavelength, nm; extinction coefficient.
const EXTINCTION: [(f64, f64); 26] = [
    (300.0, 4.234),
    (320.0, 3.303),
    (340.0, 2.977),
    (350.0, 2.938),
    (360.0, 2.966),
    (370.0, 2.171),
    (380.0, 0.946),
    (390.0, 0.445),
    (400.0, 0.296),
    (420.0, 0.176),
    (440.0, 0.107),
    (460.0, 0.071381),
    (480.0, 0.055004),
    (500.0, 0.044165),
    (550.0, 0.027968),
    (600.0, 0.019934),
    (650.0, 0.014431),
    (700.0, 0.010528),
    (750.0, 0.0078185),
    (800.0, 0.0054113),
    (850.0, 0.003612),
    (900.0, 0.0021701),
    (950.0, 0.0011793),
    (1000.0, 0.0005093),
    (1050.0, 0.0001362),
    (1100.0, 3.0637e-5),
];

/// Returns the absorption coefficient, 1/um; `None` outside 300 to 1100 nm.
pub fn absorption_per_um(wavelength_nm: f64) -> Option<f64> {
    let pair = EXTINCTION.windows(2).find(|pair| (pair[0].0..=pair[1].0).contains(&wavelength_nm))?;
    let ((from, low), (to, high)) = (pair[0], pair[1]);
    let share = (wavelength_nm - from) / (to - from);
    let extinction = (low.ln() * (1.0 - share) + high.ln() * share).exp();
    Some(4.0 * PI * extinction / (wavelength_nm * 1e-3))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the share collected at the sink by `n'' = n / L^2 - a exp(-a z)` on `n` cells, tridiagonal elimination,
    /// from the flux at both ends; `z` from the lit side. The near end is a sink (front) or closed (back); the far end
    /// is the other.
    fn solved(a: f64, length: f64, thickness: f64, is_sink_near: bool) -> f64 {
        let cells = 40_000;
        let h = thickness / f64::from(cells);
        let source = |i: i32| ((-a * f64::from(i) * h).exp() - (-a * f64::from(i + 1) * h).exp()) / h;
        let loss = 1.0 / (length * length);
        // Cell centres; a sink is half a cell outside, a closed end has no flux.
        let (mut upper, mut right) = (vec![0.0; cells as usize], vec![0.0; cells as usize]);
        for i in 0..cells {
            let conductance = |is_end: bool, is_sink: bool| match (is_end, is_sink) {
                (false, _) => 1.0 / (h * h),
                (true, true) => 2.0 / (h * h),
                (true, false) => 0.0,
            };
            let below = conductance(i == 0, is_sink_near);
            let above = conductance(i == cells - 1, !is_sink_near);
            let k = i as usize;
            let (before, before_right) = if i == 0 { (0.0, 0.0) } else { (upper[k - 1], right[k - 1]) };
            let inner_below = if i == 0 { 0.0 } else { below };
            let pivot = loss + below + above - inner_below * before;
            upper[k] = if i == cells - 1 { 0.0 } else { above / pivot };
            right[k] = (source(i) + inner_below * before_right) / pivot;
        }
        let mut n = vec![0.0; cells as usize];
        for k in (0..cells as usize).rev() {
            n[k] = right[k] + if k + 1 < cells as usize { upper[k] * n[k + 1] } else { 0.0 };
        }
        2.0 / h * if is_sink_near { n[0] } else { n[cells as usize - 1] }
    }

    #[test]
    fn layers_are_the_diffusion_equation() {
        let (a, long) = (0.1, 40.0);
        for f in [0.0, 0.02, 0.1] {
            let length = 1.0 / (1.0_f64 / long).hypot(TAU * f);
            let back =
                Layers { depletion_um: 5.0, diffusion_length_um: long, side: Side::Back { field_free_um: 12.0 } };
            let below = (-a * 12.0_f64).exp() * (1.0 - (-a * 5.0_f64).exp());
            let (ours, theirs) = (back.collected(f, a), solved(a, length, 12.0, false) + below);
            assert!((ours - theirs).abs() < 1e-6, "back, f {f}: {ours} against {theirs}");
            let front = Layers { depletion_um: 5.0, diffusion_length_um: long, side: Side::Front };
            // Deep: 400 um contain all of the light and ten diffusion lengths.
            let deep = (1.0 - (-a * 5.0_f64).exp()) + (-a * 5.0_f64).exp() * solved(a, length, 400.0, true);
            assert!((front.collected(f, a) - deep).abs() < 2e-5, "front, f {f}: {} {deep}", front.collected(f, a));
            let wrong = Layers { depletion_um: 5.2, ..front };
            assert!((wrong.collected(f, a) - deep).abs() > 1e-4 || f == 0.0, "another depth must show");
        }
    }

    #[test]
    fn red_light_spreads_more_in_a_front_lit_sensor_and_blue_light_in_a_back_lit_one() {
        let factor = |side, nm| {
            let layers = Layers { depletion_um: 6.0, diffusion_length_um: 60.0, side };
            Diffusion::Layered(layers).mtf(0.05, nm).unwrap()
        };
        assert!(factor(Side::Front, 850.0) < factor(Side::Front, 500.0) - 0.05, "front");
        let back = Side::Back { field_free_um: 10.0 };
        assert!(factor(back, 450.0) < factor(back, 850.0) - 0.05, "back");
        assert_eq!(
            Diffusion::Gaussian { sigma_um: 2.0 }.mtf(0.05, 5000.0),
            Some(blur::gaussian(0.05, 2.0)),
            "any light"
        );
        let layered = Diffusion::Layered(Layers { depletion_um: 6.0, diffusion_length_um: 60.0, side: back });
        assert_eq!(layered.mtf(0.05, 5000.0), None, "no absorption known");
    }

    #[test]
    fn the_closed_form_is_smooth_where_it_is_nought_over_nought() {
        let at = |a: f64| wandered(a, 20.0, 15.0);
        let (below, middle, above) = (at(0.05 * (1.0 - 1e-4)), at(0.05), at(0.05 * (1.0 + 1e-4)));
        assert!((middle - 0.5 * (below + above)).abs() < 1e-6, "{below} {middle} {above}");
    }
}

#[cfg(test)]
mod silicon_tests {
    use super::*;

    #[test]
    fn it_is_what_others_have_measured_and_the_table_ends() {
        // Green and Keevers, Progress in Photovoltaics 3, 189 (1995): another compilation, 1/cm.
        for (nm, per_cm) in [(450.0, 2.55e4), (500.0, 1.11e4), (600.0, 4.14e3), (700.0, 1.90e3), (900.0, 3.06e2)] {
            let ratio = absorption_per_um(nm).unwrap() * 1e4 / per_cm;
            assert!((ratio - 1.0).abs() < 0.1, "{nm} nm: {ratio}");
        }
        // Rows of the source that are not in the table here.
        for (nm, k) in [(410.0, 0.227), (520.0, 3.6415e-2), (680.0, 1.1905e-2), (830.0, 4.2734e-3), (980.0, 7.4866e-4)]
        {
            let ratio = absorption_per_um(nm).unwrap() * nm * 1e-3 / (4.0 * PI * k);
            assert!((ratio - 1.0).abs() < 0.05, "{nm} nm: {ratio}");
        }
        assert!(absorption_per_um(1100.0).is_some() && absorption_per_um(300.0).is_some(), "inside");
        assert!(absorption_per_um(299.9).is_none() && absorption_per_um(1100.1).is_none(), "outside");
    }
}
