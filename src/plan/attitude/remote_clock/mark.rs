//! A pair of stamps of one SYNC.

/// One pair of stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Mark {
    /// Remote time of SYNC's transmission, ns.
    pub remote_ns: i64,
    /// Local time of its reception minus `remote_ns`, ns.
    pub difference_ns: i64,
}
