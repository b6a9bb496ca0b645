//! Which monitor: by name, by number, or the primary one.

use crate::display::error::DisplayError;

/// The monitor that is asked for.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum MonitorChoice {
    /// The one that the X server calls primary; when it calls none so, the first.
    #[default]
    Primary,
    /// By its place in the server's list, from 0.
    Index(usize),
    /// By the name of its output, such as `HDMI-1`, exactly.
    Named(String),
}

impl core::fmt::Display for MonitorChoice {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Primary => f.write_str("at all"),
            Self::Index(index) => write!(f, "number {index}, counted from 0"),
            Self::Named(name) => write!(f, "named \"{name}\""),
        }
    }
}

/// The data of a monitor.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MonitorFacts {
    /// Name of its output.
    pub name: String,
    /// Columns and rows.
    pub size_px: [u32; 2],
    /// Place of its first pixel on the desktop.
    pub origin_px: [i32; 2],
    /// Refresh rate, mHz, where the server knows it.
    pub refresh_mhz: Option<u32>,
    /// Whether the server calls it primary.
    pub is_primary: bool,
}

impl core::fmt::Display for MonitorFacts {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let ([w, h], [x, y]) = (self.size_px, self.origin_px);
        write!(f, "{} ({w} x {h} at {x}, {y}", self.name)?;
        if let Some(mhz) = self.refresh_mhz {
            write!(f, ", {:.3} Hz", f64::from(mhz) / 1000.0)?;
        }
        f.write_str(")")
    }
}

/// Returns the index of the monitor that was asked for.
///
/// # Errors
/// When the monitor is missing; the message lists those that were found.
pub fn choose(monitors: &[MonitorFacts], choice: &MonitorChoice) -> Result<usize, DisplayError> {
    let found = match choice {
        MonitorChoice::Primary => {
            let primary = monitors.iter().position(|monitor| monitor.is_primary);
            primary.or(if monitors.is_empty() { None } else { Some(0) })
        }
        MonitorChoice::Index(index) => Some(*index).filter(|index| *index < monitors.len()),
        MonitorChoice::Named(name) => monitors.iter().position(|monitor| monitor.name == *name),
    };
    found.ok_or_else(|| {
        let names: Vec<String> = monitors.iter().map(MonitorFacts::to_string).collect();
        let found = if names.is_empty() { "none".into() } else { names.join("; ") };
        DisplayError::refuse(format!("no monitor {choice}: found {found}; plug it in, or name one of these"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn monitor(name: &str, is_primary: bool) -> MonitorFacts {
        MonitorFacts {
            name: name.into(),
            size_px: [1920, 1080],
            origin_px: [0, 0],
            refresh_mhz: Some(59_940),
            is_primary,
        }
    }

    #[test]
    fn monitors_are_found_by_name_number_and_rank() {
        let two = [monitor("DP-1", false), monitor("HDMI-1", true)];
        assert_eq!(choose(&two, &MonitorChoice::Primary), Ok(1));
        assert_eq!(choose(&two, &MonitorChoice::Index(0)), Ok(0));
        assert_eq!(choose(&two, &MonitorChoice::Named("HDMI-1".into())), Ok(1));
        assert_eq!(choose(&two[..1], &MonitorChoice::Primary), Ok(0), "none is primary");
    }

    #[test]
    fn one_that_is_not_there_is_reported_with_those_that_are() {
        let two = [monitor("DP-1", false), monitor("HDMI-1", true)];
        for (choice, part) in
            [(MonitorChoice::Named("HDMI".into()), "named \"HDMI\""), (MonitorChoice::Index(2), "number 2")]
        {
            let text = choose(&two, &choice).unwrap_err().to_string();
            assert!(text.contains(part) && text.contains("DP-1 (1920 x 1080 at 0, 0, 59.940 Hz)"), "{text}");
        }
        assert!(choose(&[], &MonitorChoice::Primary).unwrap_err().to_string().contains("found none"));
    }
}
