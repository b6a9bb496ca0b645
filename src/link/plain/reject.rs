//! Why a plain message is refused, and how often.

macro_rules! rejects {
    ($($(#[doc = $text:literal])+ $kind:ident = $name:literal,)+) => {
        /// Why a plain message is refused.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
        pub enum PlainReject { $($(#[doc = $text])+ #[error($name)] $kind,)+ }

        impl PlainReject {
            /// Every reason.
            pub const ALL: [Self; [$($name),+].len()] = [$(Self::$kind,)+];

            /// Returns its name in reports.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$kind => $name,)+ }
            }
        }
    };
}

rejects! {
    /// The number of bytes, or of numbers, is not that of the layout.
    Length = "plain_wrong_length",
    /// The bytes are not UTF-8 text.
    Text = "plain_not_text",
    /// The text is not a JSON object or array.
    Json = "plain_not_json",
    /// A word or a field is not a number.
    Number = "plain_not_a_number",
    /// A field of the layout is missing.
    FieldMissing = "plain_field_missing",
    /// A value is NaN or infinite.
    NotFinite = "plain_not_finite",
    /// The quaternion's norm is further than 1e-3 from 1: the byte order, the type or the order of fields is another.
    QuaternionNorm = "plain_quaternion_norm",
    /// The time is further from its epoch than 292 years.
    Time = "plain_time_out_of_range",
    /// A message of this number was received already.
    Repeated = "plain_repeated",
    /// A message of 42 ended before its time, attitude and rate were complete.
    Incomplete = "plain_incomplete",
}

/// Number of refused messages by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PlainRejectCounters {
    counts: [u32; PlainReject::ALL.len()],
}

impl PlainRejectCounters {
    pub(super) fn count(&mut self, reject: PlainReject) {
        let count = &mut self.counts[reject as usize];
        *count = count.saturating_add(1);
    }

    /// Returns how often this was the reason.
    #[must_use]
    pub fn get(&self, reject: PlainReject) -> u32 {
        self.counts[reject as usize]
    }

    /// Returns all refusals together.
    #[must_use]
    pub fn total(&self) -> u64 {
        self.counts.iter().map(|count| u64::from(*count)).sum()
    }

    /// Returns each reason with its count.
    pub fn iter(&self) -> impl Iterator<Item = (PlainReject, u32)> + '_ {
        PlainReject::ALL.into_iter().zip(self.counts)
    }
}
