//! The methods for motion in the exposure, by name.

use core::fmt;
use core::str::FromStr;

/// A method with its parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Method {
    /// The PSF at the mean position. Domain: path much shorter than the PSF.
    Static,
    /// Gauss-Legendre nodes in time, per star. Domain: smooth motion.
    GaussLegendre {
        /// Nodes.
        nodes: usize,
    },
    /// PSF convolved with the path once per frame. Domain: any path that is nearly the same for all stars.
    EffectivePsf {
        /// Nodes from which the kernel is built.
        nodes: usize,
    },
    /// Midpoints in time, per star. Domain: any path, when there are enough of them.
    Samples {
        /// Nodes.
        nodes: usize,
    },
}

/// What the user or the config asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MethodChoice {
    /// The planner chooses.
    #[default]
    Auto,
    /// This method; its number of nodes by the planner unless given.
    Fixed(MethodName, Option<usize>),
}

/// A method without its parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum MethodName {
    /// See [`Method::Static`].
    Static,
    /// See [`Method::GaussLegendre`].
    GaussLegendre,
    /// See [`Method::EffectivePsf`].
    EffectivePsf,
    /// See [`Method::Samples`].
    Samples,
}

impl MethodName {
    /// All methods, cheapest idea first.
    pub const ALL: [Self; 4] = [Self::Static, Self::GaussLegendre, Self::EffectivePsf, Self::Samples];

    /// The name people type.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::GaussLegendre => "gauss-legendre",
            Self::EffectivePsf => "effective-psf",
            Self::Samples => "samples",
        }
    }
}

impl Method {
    /// The method without its parameter.
    #[must_use]
    pub fn name(self) -> MethodName {
        match self {
            Self::Static => MethodName::Static,
            Self::GaussLegendre { .. } => MethodName::GaussLegendre,
            Self::EffectivePsf { .. } => MethodName::EffectivePsf,
            Self::Samples { .. } => MethodName::Samples,
        }
    }

    /// Nodes per star, or per kernel.
    #[must_use]
    pub fn nodes(self) -> usize {
        match self {
            Self::Static => 1,
            Self::GaussLegendre { nodes } | Self::EffectivePsf { nodes } | Self::Samples { nodes } => nodes,
        }
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Static => f.write_str("static"),
            other => write!(f, "{} ({} nodes)", other.name().name(), other.nodes()),
        }
    }
}

/// Text that names no method.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "method \"{got}\": wanted auto, static, gauss-legendre[:N], effective-psf[:N] or samples[:N] with N from 1 to 65536"
)]
pub struct MethodError {
    got: String,
}

impl FromStr for MethodChoice {
    type Err = MethodError;
    fn from_str(text: &str) -> Result<Self, MethodError> {
        let refuse = || MethodError { got: text.into() };
        if text == "auto" {
            return Ok(Self::Auto);
        }
        let (name, nodes) = match text.split_once(':') {
            Some((name, n)) => {
                let n = n.parse().ok().filter(|n| (1..=65_536).contains(n)).ok_or_else(refuse)?;
                (name, Some(n))
            }
            None => (text, None),
        };
        let wanted = name.replace('_', "-");
        let found = MethodName::ALL.into_iter().find(|m| m.name() == wanted).ok_or_else(refuse)?;
        if found == MethodName::Static && nodes.is_some() {
            return Err(refuse());
        }
        Ok(Self::Fixed(found, nodes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_parse_and_nonsense_is_refused() {
        assert_eq!("auto".parse(), Ok(MethodChoice::Auto));
        assert_eq!("samples:64".parse(), Ok(MethodChoice::Fixed(MethodName::Samples, Some(64))));
        assert_eq!("gauss_legendre".parse(), Ok(MethodChoice::Fixed(MethodName::GaussLegendre, None)));
        for wrong in ["", "fast", "samples:0", "samples:x", "static:3", "samples:99999999"] {
            assert!(wrong.parse::<MethodChoice>().is_err(), "{wrong}");
        }
    }
}
