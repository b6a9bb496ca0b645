//! Names and dates in the head of a report, which are given and not measured.

use serde::{Deserialize, Serialize};

/// `[document]` of a plan: names for the report's head.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Paperwork {
    /// The unit under test, such as "ST-20 engineering model".
    pub unit: Option<String>,
    /// Its serial number.
    pub serial_number: Option<String>,
    /// The person who made the test and the report.
    pub author: Option<String>,
    /// Date of the test; a flown plan has the day of the flight.
    pub date_of_test: Option<String>,
}

impl Paperwork {
    /// Returns these, with what is missing taken from others.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            unit: self.unit.or(other.unit),
            serial_number: self.serial_number.or(other.serial_number),
            author: self.author.or(other.author),
            date_of_test: self.date_of_test.or(other.date_of_test),
        }
    }
}
