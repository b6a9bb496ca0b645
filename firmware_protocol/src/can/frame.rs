//! One frame on the bus.

use super::{CanId, ToCanId};

/// Longest classic payload.
pub const CLASSIC_MAX: usize = 8;
/// Longest FD payload.
pub const FD_MAX: usize = 64;

/// Payload lengths that a data length code can say.
const FD_LENGTHS: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

/// A data frame, classic or FD, with an identifier of 11 or 29 bits. Only legal lengths exist.
#[derive(Debug, Clone, Copy)]
pub struct CanFrame {
    id: CanId,
    fd: bool,
    len: u8,
    data: [u8; FD_MAX],
}

impl CanFrame {
    /// Returns a classic frame; `None` when no identifier has this number or the data exceed 8 bytes.
    pub fn classic(id: impl ToCanId, data: &[u8]) -> Option<Self> {
        (data.len() <= CLASSIC_MAX).then(|| Self::new(id, false, data)).flatten()
    }

    /// Returns an FD frame; `None` when no identifier has this number or no length code says the length of the data.
    pub fn fd(id: impl ToCanId, data: &[u8]) -> Option<Self> {
        FD_LENGTHS.contains(&data.len()).then(|| Self::new(id, true, data)).flatten()
    }

    fn new(id: impl ToCanId, fd: bool, bytes: &[u8]) -> Option<Self> {
        let mut data = [0; FD_MAX];
        data.get_mut(..bytes.len())?.copy_from_slice(bytes);
        let len = u8::try_from(bytes.len()).ok()?;
        Some(Self { id: id.to_can_id()?, fd, len, data })
    }

    /// Returns the same frame with other data; `None` when a frame of its kind has no such length.
    pub fn with_data(&self, data: &[u8]) -> Option<Self> {
        if self.fd { Self::fd(self.id, data) } else { Self::classic(self.id, data) }
    }

    /// Returns the identifier.
    pub const fn id(&self) -> CanId {
        self.id
    }

    /// Returns true for CAN FD.
    pub const fn is_fd(&self) -> bool {
        self.fd
    }

    /// Returns the payload.
    pub fn data(&self) -> &[u8] {
        self.data.get(..usize::from(self.len)).unwrap_or(&[])
    }
}

impl PartialEq for CanFrame {
    fn eq(&self, other: &Self) -> bool {
        (self.id, self.fd, self.data()) == (other.id, other.fd, other.data())
    }
}
impl Eq for CanFrame {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_frames_that_exist_can_be_made() {
        assert!(CanFrame::classic(0x7FF, &[0; 8]).is_some());
        assert!(CanFrame::classic(0x800, &[]).is_none(), "12 bits");
        let long = CanId::extended(0x7FF).unwrap();
        assert_ne!(CanFrame::classic(long, &[0; 8]), CanFrame::classic(0x7FF, &[0; 8]), "29 bits and 11");
        assert!(CanFrame::classic(1, &[0; 9]).is_none(), "9 bytes");
        assert!(CanFrame::fd(1, &[0; 48]).is_some());
        assert!(CanFrame::fd(1, &[0; 47]).is_none(), "no such length code");
        assert!(CanFrame::fd(1, &[0; 65]).is_none(), "too long");
    }
}
