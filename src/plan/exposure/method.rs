//! The methods for motion in the exposure, by name.

pub use base::drawn::MethodName;
use core::{fmt, str::FromStr};

/// A method with its parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Method {
    /// The PSF at the mean position. Domain: path much shorter than the PSF.
    Static,
    /// PSF convolved with a Gaussian of the path's covariance. Domain: a path that looks like noise.
    Gaussian,
    /// Gauss-Legendre nodes in time, per star. Domain: smooth motion.
    GaussLegendre {
        /// Number of nodes.
        nodes: usize,
    },
    /// Straight segments of equal time, per star. Domain: a path that is nearly straight in between.
    Segments {
        /// Number of segments.
        segments: usize,
        /// Number of Gauss-Legendre nodes along each segment.
        per_segment: usize,
    },
    /// Gauss-Legendre nodes in time between the corners of a path, per star. Domain: jitter or a path given by few points,
    /// smooth in between.
    Corners {
        /// Number of stretches between corners.
        stretches: usize,
        /// Number of Gauss-Legendre nodes of each stretch.
        per_stretch: usize,
    },
    /// Samples in time, per star. Domain: any path, if there are enough of them.
    Samples {
        /// Number of nodes.
        nodes: usize,
    },
    /// PSF convolved with the path once per frame. Domain: any path that is nearly the same for all stars.
    EffectivePsf {
        /// Number of nodes from which the kernel is built.
        nodes: usize,
        /// Number of stretches between the path's corners that share the nodes, as in [`Self::Corners`]; 0: the nodes are
        /// those of [`Self::Samples`], or of [`Self::GaussLegendre`] where motion is smooth.
        stretches: usize,
    },
    /// PSF convolved with the path at the corners of a grid of zones, blended between them. Domain: any path; roll,
    /// distortion and a rolling shutter change it little, and evenly, within a zone.
    ZonalPsf {
        /// Zones along columns and rows.
        zones: [u16; 2],
        /// Number of nodes from which each kernel is built.
        nodes: usize,
        /// As in [`Self::EffectivePsf`].
        stretches: usize,
    },
}

/// Method setting of the user or the configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MethodChoice {
    /// The planner chooses.
    #[default]
    Auto,
    /// This method; the planner chooses the number of nodes unless it is given.
    Fixed(MethodName, Option<usize>),
}

impl Method {
    /// Returns the method without its parameter.
    pub fn name(self) -> MethodName {
        match self {
            Self::Static => MethodName::Static,
            Self::Gaussian => MethodName::Gaussian,
            Self::GaussLegendre { .. } => MethodName::GaussLegendre,
            Self::Segments { .. } => MethodName::Segments,
            Self::Corners { .. } => MethodName::Corners,
            Self::Samples { .. } => MethodName::Samples,
            Self::EffectivePsf { .. } => MethodName::EffectivePsf,
            Self::ZonalPsf { .. } => MethodName::ZonalPsf,
        }
    }

    /// Returns the number of nodes per star, or per kernel.
    pub fn nodes(self) -> usize {
        match self {
            Self::Static => 1,
            Self::Gaussian => 9,
            Self::GaussLegendre { nodes }
            | Self::EffectivePsf { nodes, .. }
            | Self::Samples { nodes }
            | Self::ZonalPsf { nodes, .. } => nodes,
            Self::Segments { segments, per_segment } => segments * per_segment,
            Self::Corners { stretches, per_stretch } => stretches * per_stretch,
        }
    }

    /// Returns the number of kernels that draw one star.
    pub fn stamps(self) -> usize {
        if matches!(self, Self::ZonalPsf { .. }) { 4 } else { 1 }
    }

    /// Returns the number of kernels that are built for a frame.
    pub fn kernels(self) -> usize {
        match self {
            Self::Gaussian | Self::EffectivePsf { .. } => 1,
            Self::ZonalPsf { zones: [columns, rows], .. } => (usize::from(columns) + 1) * (usize::from(rows) + 1),
            Self::Static
            | Self::GaussLegendre { .. }
            | Self::Segments { .. }
            | Self::Corners { .. }
            | Self::Samples { .. } => 0,
        }
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.name().name();
        match self {
            Self::Static | Self::Gaussian => f.write_str(name),
            Self::ZonalPsf { zones: [columns, rows], nodes, .. } => {
                write!(f, "{name} ({columns} x {rows}, {nodes} nodes)")
            }
            Self::Segments { segments, per_segment } => write!(f, "{name} ({segments} of {per_segment} nodes)"),
            Self::Corners { stretches, per_stretch } => {
                write!(f, "{name} ({stretches} stretches of {per_stretch} nodes)")
            }
            Self::GaussLegendre { .. } | Self::Samples { .. } | Self::EffectivePsf { .. } => {
                write!(f, "{name} ({} nodes)", self.nodes())
            }
        }
    }
}

/// The text is not the name of a method.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "method \"{got}\": wanted auto, static, gaussian, gauss-legendre[:N], segments[:N], corners[:N], samples[:N], \
     effective-psf[:N] or zonal-psf[:N] with N from 1 to 65536"
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
        if !found.takes_number() && nodes.is_some() {
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
        for wrong in ["", "fast", "samples:0", "samples:x", "static:3", "gaussian:2", "samples:99999999"] {
            assert!(wrong.parse::<MethodChoice>().is_err(), "{wrong}");
        }
    }
}
