//! Header of a written file.

use base::time::Tai;

/// Values of the header of a written file.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// Name of the object.
    pub object_name: String,
    /// International designator of the object, or UNKNOWN.
    pub object_id: String,
    /// Name of the axes whose attitude it is, such as SC_BODY_1.
    pub body: String,
    /// When the file is made.
    pub created: Tai,
}
