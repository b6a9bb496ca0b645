//! Vector level of the loops over stars and pixels: the best of the processor, or a lower one.
//!
//! `STARLOOP_VECTOR_LEVEL` names it as the program does: `V4` (AVX-512), `V3` (AVX2 and FMA), `Scalar`. It shows how fast
//! another processor would be, and V3 and V4 draw the same bits.

use pulp::Arch;
use std::sync::OnceLock;

/// The variable that names it.
const VARIABLE: &str = "STARLOOP_VECTOR_LEVEL";

/// Returns the vector level, which is the same from the first call on.
pub fn vector_level() -> Arch {
    static LEVEL: OnceLock<Arch> = OnceLock::new();
    *LEVEL.get_or_init(|| {
        let Ok(asked) = std::env::var(VARIABLE) else { return Arch::new() };
        let known = levels();
        known.iter().find(|level| name(**level) == asked).copied().unwrap_or_else(|| {
            let names: Vec<String> = known.iter().copied().map(name).collect();
            let (names, best) = (names.join(", "), name(Arch::new()));
            eprintln!("starloop: {VARIABLE}: got {asked}, wanted one of {names}; {best} is used");
            Arch::new()
        })
    })
}

/// Returns the word for a level.
pub fn name(level: Arch) -> String {
    let text = format!("{level:?}");
    text.split(['(', ' ', '{']).next().unwrap_or_default().to_owned()
}

/// Returns the levels that the processor has.
fn levels() -> Vec<Arch> {
    let mut levels = vec![Arch::Scalar];
    #[cfg(target_arch = "x86_64")]
    levels.extend(pulp::x86::V3::try_new().map(Arch::V3));
    if name(Arch::new()) != name(levels[levels.len() - 1]) {
        levels.push(Arch::new());
    }
    levels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_levels_end_with_the_best() {
        let names: Vec<String> = levels().into_iter().map(name).collect();
        assert_eq!(names.first().map(String::as_str), Some("Scalar"));
        assert_eq!(names.last(), Some(&name(Arch::new())));
        assert!(names.iter().enumerate().all(|(place, name)| !names[..place].contains(name)), "{names:?}");
        assert!(names.iter().all(|name| name.chars().all(char::is_alphanumeric)), "{names:?}");
    }
}
