//! Which format of a surface shows greys as they are.
//!
//! Only formats that store what the shader gives times `2^bits - 1`, rounded, will do: no sRGB encoding, no HDR
//! transfer.

use crate::display::{error::DisplayError, params::Bits};
use wgpu::{SurfaceColorSpaces, SurfaceFormatCapabilities, TextureFormat};

/// Formats with 8 bits of a grey.
const EIGHT: [TextureFormat; 2] = [TextureFormat::Bgra8Unorm, TextureFormat::Rgba8Unorm];
/// Formats with 10.
const TEN: [TextureFormat; 1] = [TextureFormat::Rgb10a2Unorm];

/// Returns the format to take.
///
/// # Errors
/// When the surface offers none of them; the message lists its formats.
pub(super) fn choose(offered: &[SurfaceFormatCapabilities], bits: Bits) -> Result<TextureFormat, DisplayError> {
    let wanted: &[TextureFormat] = match bits {
        Bits::Eight => &EIGHT,
        Bits::Ten => &TEN,
    };
    let is_plain = |format: TextureFormat| {
        offered
            .iter()
            .any(|obtained| obtained.format == format && obtained.color_spaces.contains(SurfaceColorSpaces::SRGB))
    };
    wanted.iter().copied().find(|format| is_plain(*format)).ok_or_else(|| {
        let names: Vec<String> = offered.iter().map(|obtained| format!("{:?}", obtained.format)).collect();
        let advice = match bits {
            Bits::Eight => "another driver or server may",
            Bits::Ten => "ask for bits = 8, or set the X server to depth 30 and take a driver that offers A2B10G10R10",
        };
        let offered = if names.is_empty() { "nothing".into() } else { names.join(", ") };
        DisplayError::Depth { bits: bits.count(), offered, advice }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn offer(format: TextureFormat, color_spaces: SurfaceColorSpaces) -> SurfaceFormatCapabilities {
        SurfaceFormatCapabilities { format, color_spaces }
    }

    #[test]
    fn greys_are_never_encoded() {
        let plain = SurfaceColorSpaces::SRGB;
        let encoding = offer(TextureFormat::Bgra8UnormSrgb, plain);
        let eight = offer(TextureFormat::Bgra8Unorm, plain);
        let ten = offer(TextureFormat::Rgb10a2Unorm, plain);
        let hdr = offer(TextureFormat::Rgb10a2Unorm, SurfaceColorSpaces::BT2100_PQ);
        let offered = [encoding, eight, ten];
        assert_eq!(choose(&offered, Bits::Eight), Ok(TextureFormat::Bgra8Unorm));
        assert_eq!(choose(&offered, Bits::Ten), Ok(TextureFormat::Rgb10a2Unorm));
        assert!(choose(&offered[..1], Bits::Eight).is_err(), "sRGB would encode");
        let text = choose(&[eight, hdr], Bits::Ten).unwrap_err().to_string();
        assert!(text.contains("Bgra8Unorm") && text.contains("bits = 8"), "{text}");
    }
}
