//! Rust constants as WGSL text, so that a number exists once.

use core::fmt::Write as _;

/// Returns `const NAME = value;` with the digits that give the same f32 back.
pub fn constant(name: &str, value: f32) -> String {
    format!("const {name} = {};\n", literal(value))
}

/// Returns `const NAME: u32 = value;`.
pub fn constant_u32(name: &str, value: u32) -> String {
    format!("const {name} = {value}u;\n")
}

/// Returns `const NAME = true;`: an effect that is off costs nothing, as drivers drop code behind a false constant.
pub fn switch(name: &str, on: bool) -> String {
    format!("const {name} = {on};\n")
}

/// Returns one shader of constants and parts: WGSL takes declarations in any order.
pub fn assemble<'a>(constants: &str, parts: impl IntoIterator<Item = &'a str>) -> String {
    parts.into_iter().fold(constants.to_owned(), |text, part| text + "\n" + part)
}

/// Returns `const NAME_0 = ...; const NAME_1 = ...;`: a polynomial's coefficients.
pub fn coefficients(name: &str, values: &[f32]) -> String {
    values.iter().enumerate().fold(String::new(), |mut text, (i, value)| {
        // Writing into a string cannot fail.
        let _ = writeln!(text, "const {name}_{i} = {};", literal(*value));
        text
    })
}

/// Returns the shortest decimal that reads back as the same number (nine digits at most), with a WGSL suffix.
fn literal(value: f32) -> String {
    format!("{value:e}f")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals_give_the_same_number_back() {
        for value in [1.0_f32, -0.1, 2.050_355_3e-6, 16_777_216.0, f32::MIN_POSITIVE, 0.333_333_34] {
            let text = literal(value);
            let back: f32 = text.trim_end_matches('f').parse().expect("a number");
            assert_eq!(back.to_bits(), value.to_bits(), "{text}");
        }
        assert_eq!(assemble(&switch("ON", true), ["fn a() {}\n", "b"]), "const ON = true;\n\nfn a() {}\n\nb");
        assert_eq!(coefficients("A", &[1.0, 0.5]), "const A_0 = 1e0f;\nconst A_1 = 5e-1f;\n");
    }
}
