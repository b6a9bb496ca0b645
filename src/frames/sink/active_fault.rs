//! Which commanded faults a frame was made under, with their numbers: part of its truth.
//!
//! A list of fixed length, so that frames travel without allocation; faults that do not fit are counted.

use core::fmt;

/// Faults of one frame that are named; more are counted.
pub const NAMED_FAULTS: usize = 12;

/// A number with its unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Amount {
    /// The number.
    pub value: f64,
    /// Its unit.
    pub unit: &'static str,
}

/// A fault as it acts on one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActiveFault {
    /// Its word in files.
    pub name: &'static str,
    /// Its number in the run's list of faults, from 1.
    pub number: u16,
    /// Size of the fault.
    pub amount: Amount,
}

impl ActiveFault {
    const NONE: Self = Self { name: "", number: 0, amount: Amount { value: 0.0, unit: "" } };
}

impl fmt::Display for ActiveFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}#{}={} {}", self.name, self.number, self.amount.value, self.amount.unit)
    }
}

/// The faults of one frame, in the order of their numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ActiveFaults {
    list: [ActiveFault; NAMED_FAULTS],
    count: usize,
}

impl ActiveFaults {
    /// No fault.
    pub const NONE: Self = Self { list: [ActiveFault::NONE; NAMED_FAULTS], count: 0 };

    /// Adds one.
    pub fn push(&mut self, fault: ActiveFault) {
        if let Some(place) = self.list.get_mut(self.count) {
            *place = fault;
        }
        self.count += 1;
    }

    /// Returns the faults that are named.
    pub fn named(&self) -> &[ActiveFault] {
        &self.list[..self.count.min(NAMED_FAULTS)]
    }

    /// Returns how many there are, named or not.
    pub fn count(&self) -> usize {
        self.count
    }
}

impl Default for ActiveFaults {
    fn default() -> Self {
        Self::NONE
    }
}

impl fmt::Display for ActiveFaults {
    /// Writes `none`, or faults joined by `; `, and how many more.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.count == 0 {
            return f.write_str("none");
        }
        for (i, fault) in self.named().iter().enumerate() {
            write!(f, "{}{fault}", if i == 0 { "" } else { "; " })?;
        }
        match self.count.checked_sub(NAMED_FAULTS).filter(|more| *more > 0) {
            Some(more) => write!(f, "; {more} more"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_named_with_their_numbers_and_none_is_lost() {
        let mut active = ActiveFaults::NONE;
        assert_eq!((active.to_string().as_str(), active.count()), ("none", 0));
        let fault = |number| ActiveFault { name: "stray_light", number, amount: Amount { value: 2.5e4, unit: "e-/s" } };
        active.push(fault(1));
        active.push(fault(7));
        assert_eq!(active.to_string(), "stray_light#1=25000 e-/s; stray_light#7=25000 e-/s");
        for number in 8..30 {
            active.push(fault(number));
        }
        assert_eq!((active.named().len(), active.count()), (NAMED_FAULTS, 24));
        assert!(active.to_string().ends_with("; 12 more"), "{active}");
    }
}
