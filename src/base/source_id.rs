//! The name of a star in the catalog that it was taken from: `Gaia DR3 4472832130942575872`, `HIP 87937`, `TYC 1-13-1`.
//!
//! The text form reads back to the same name. A star of a catalog of one's own has its plain number. Tests: below.

use crate::refused::Refused;
use core::{fmt, str::FromStr};

/// A star's name in its source catalog.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SourceId {
    /// A `source_id` of Gaia's archive.
    Gaia(GaiaRelease, u64),
    /// A number of the Hipparcos catalog.
    Hipparcos(u32),
    /// A Tycho-2 name: region, number in the region, component.
    Tycho(u32, u32, u32),
    /// A number of a catalog of unknown origin.
    Own(i64),
}

/// A release of Gaia's archive: a star may have different numbers in two releases.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum GaiaRelease {
    /// The second, positions of J2015.5.
    Dr2,
    /// The third, and its early form, positions of J2016.0.
    Dr3,
    /// Not known.
    Unknown,
}

impl GaiaRelease {
    const NAMED: [(Self, &str); 3] = [(Self::Dr2, "Gaia DR2 "), (Self::Dr3, "Gaia DR3 "), (Self::Unknown, "Gaia ")];

    fn name(self) -> &'static str {
        Self::NAMED.iter().find(|(release, _)| *release == self).map_or("", |(_, name)| name)
    }
}

impl fmt::Display for SourceId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gaia(release, number) => write!(f, "{}{number}", release.name()),
            Self::Hipparcos(number) => write!(f, "HIP {number}"),
            Self::Tycho(region, number, component) => write!(f, "TYC {region}-{number}-{component}"),
            Self::Own(number) => write!(f, "{number}"),
        }
    }
}

impl FromStr for SourceId {
    type Err = Refused;

    fn from_str(text: &str) -> Result<Self, Refused> {
        let gaia = || {
            let (release, rest) =
                GaiaRelease::NAMED.iter().find_map(|(release, name)| Some((*release, text.strip_prefix(name)?)))?;
            Some(Self::Gaia(release, rest.parse().ok()?))
        };
        let hipparcos = || Some(Self::Hipparcos(text.strip_prefix("HIP ")?.parse().ok()?));
        let tycho = || {
            let mut parts = text.strip_prefix("TYC ")?.split('-').map(str::parse);
            match [(); 4].map(|()| parts.next()) {
                [Some(Ok(region)), Some(Ok(number)), Some(Ok(component)), None] => {
                    Some(Self::Tycho(region, number, component))
                }
                _ => None,
            }
        };
        let own = || text.parse().ok().map(Self::Own);
        gaia().or_else(hipparcos).or_else(tycho).or_else(own).ok_or_else(|| {
            Refused(format!(
                "wanted a name such as Gaia DR3 4472832130942575872, HIP 87937, TYC 1-13-1 or a number, got \"{text}\""
            ))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_read_back() {
        for (id, text) in [
            (SourceId::Gaia(GaiaRelease::Dr3, 4_472_832_130_942_575_872), "Gaia DR3 4472832130942575872"),
            (SourceId::Gaia(GaiaRelease::Dr2, 7), "Gaia DR2 7"),
            (SourceId::Gaia(GaiaRelease::Unknown, 7), "Gaia 7"),
            (SourceId::Hipparcos(87_937), "HIP 87937"),
            (SourceId::Tycho(1, 13, 1), "TYC 1-13-1"),
            (SourceId::Own(-3), "-3"),
        ] {
            assert_eq!((id.to_string().as_str(), text.parse()), (text, Ok(id)));
        }
        for text in ["", "HIP", "Gaia DR3 x", "TYC 1-13", "TYC 1-13-1-2", "Barnard"] {
            let refused = text.parse::<SourceId>().unwrap_err().to_string();
            assert!(refused.contains(&format!("got \"{text}\"")), "{refused}");
        }
    }
}
