//! Colour filter array: each pixel counts the share of the light that the filter of its colour lets through.
//!
//! In: mean electrons of a pixel without a filter: stars, sky and stray light together. Out: these times the response
//! of the pixel's colour. The response is a share of the electrons that a pixel without a filter counts, for light of
//! the **reference spectrum**: the colour of stars for which the responses are given. Dark signal passes no filter. The
//! response belongs to the pixel as its photo-response non-uniformity does, and is drawn with it: `e' = e (1 + p)` with
//! `1 + p = response (1 + prnu)`, so that CPU, GPU and reference have one stage for both, and a detector without
//! filters has not a bit or a step more.
//!
//! *Named approximation: one colour of light.* All light has the reference spectrum. A star of another colour gets too much or
//! too little in each colour of pixel, by `response(reference) / response(its spectrum)`; places are not changed. With
//! filters of a usual sensor behind an infrared cut at 700 nm and a reference of BP-RP 0.8 (the Sun) that is at most 25
//! % for BP-RP from 0.3 to 1.3, and 80 % from -0.3 to 2.0. Rounding of the share to f32 adds 6e-6 at most. *Not
//! modelled:* light that crosses to the next pixel's filter. *Validation:* `tests/physics/colour_filter.rs` (both),
//! `tests/gpu/effects.rs`.

use base::bayer::{BayerPattern, Colour};
use std::sync::Arc;

/// Least response: rounding of the share of a darker filter would show.
pub const LEAST_RESPONSE: f64 = 0.01;

/// The filters of a detector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColourFilter {
    /// Pattern of the colours.
    pub pattern: BayerPattern,
    /// Share of the electrons of a pixel without a filter that red pixels get, 0.01 to 1.
    pub red: f64,
    /// The same of green pixels.
    pub green: f64,
    /// The same of blue pixels.
    pub blue: f64,
}

impl ColourFilter {
    /// Returns the response of pixels of a colour.
    pub const fn response(&self, colour: Colour) -> f64 {
        match colour {
            Colour::Red => self.red,
            Colour::Green => self.green,
            Colour::Blue => self.blue,
        }
    }

    /// Returns each pixel's response less 1, row by row: of its filter and of its own non-uniformity, where there is
    /// one.
    pub fn photo_response(&self, prnu: Option<&[f32]>, [width, height]: [usize; 2]) -> Arc<[f32]> {
        let share = |i: usize| {
            let own = prnu.and_then(|map| map.get(i)).copied().map_or(0.0, f64::from);
            let response = self.response(self.pattern.colour_at(i % width, i / width));
            #[allow(clippy::cast_possible_truncation, reason = "patterns are f32")]
            let share = (response * (1.0 + own) - 1.0) as f32;
            share
        };
        (0..width * height).map(share).collect()
    }
}
