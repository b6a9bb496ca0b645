//! Keys of files of requirements: declared here for reference, schema, templates and the check of keys.
#![allow(dead_code, reason = "crates above read the values of these keys, after their check")]

use crate::{key::section, key_type::Word, test_plan_keys::NeededList};

section! {
    /// Requirements on a star tracker.
    RequirementKeys at "" {
        tables:
        /// A limit of one metric.
        requirement: NeededList<LimitKeys>;
    }

    /// A limit of one metric.
    LimitKeys at "requirement" {
        /// Identifier, as in your specification.
        id: String = Needed, "text";
        /// Its words.
        text: String = "", "text";
        /// The metric, such as temporal_noise.x; src/guide/reports.md lists all.
        metric: String = Needed, "name of a metric";
        /// Largest magnitude that is met, in the metric's unit; this or least.
        most: f64 = Optional, Finite;
        /// Least value that is met, in the metric's unit; this or most.
        least: f64 = Optional, Finite;
        /// The case, of a metric that each case has for itself.
        case: String = Optional, "name of a case";
        /// Part that is compared with the limit: the interval, or the measured value alone.
        by: Word<()> = "interval", [("interval", ()), ("value", ())];
    }
}
