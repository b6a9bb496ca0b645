//! One frame on the bus.

/// Longest classic payload.
pub const CLASSIC_MAX: usize = 8;
/// Longest FD payload.
pub const FD_MAX: usize = 64;

const STANDARD_ID_MAX: u16 = 0x7FF;
/// Payload lengths that a data length code can say.
const FD_LENGTHS: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

/// A data frame with an 11-bit identifier, classic or FD. Only legal lengths exist.
#[derive(Debug, Clone, Copy)]
pub struct CanFrame {
    id: u16,
    fd: bool,
    len: u8,
    data: [u8; FD_MAX],
}

impl CanFrame {
    /// Returns a classic frame; `None` when the identifier exceeds 11 bits or the data 8 bytes.
    #[must_use]
    pub fn classic(id: u16, data: &[u8]) -> Option<Self> {
        (data.len() <= CLASSIC_MAX).then(|| Self::new(id, false, data)).flatten()
    }

    /// Returns an FD frame; `None` when the identifier exceeds 11 bits or no length code says the length of the data.
    #[must_use]
    pub fn fd(id: u16, data: &[u8]) -> Option<Self> {
        FD_LENGTHS.contains(&data.len()).then(|| Self::new(id, true, data)).flatten()
    }

    fn new(id: u16, fd: bool, bytes: &[u8]) -> Option<Self> {
        let mut data = [0; FD_MAX];
        data.get_mut(..bytes.len())?.copy_from_slice(bytes);
        let len = u8::try_from(bytes.len()).ok()?;
        (id <= STANDARD_ID_MAX).then_some(Self { id, fd, len, data })
    }

    /// Returns the 11-bit identifier.
    #[must_use]
    pub const fn id(&self) -> u16 {
        self.id
    }

    /// Returns true for CAN FD.
    #[must_use]
    pub const fn is_fd(&self) -> bool {
        self.fd
    }

    /// Returns the payload.
    #[must_use]
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
        assert!(CanFrame::classic(1, &[0; 9]).is_none(), "9 bytes");
        assert!(CanFrame::fd(1, &[0; 48]).is_some());
        assert!(CanFrame::fd(1, &[0; 47]).is_none(), "no such length code");
        assert!(CanFrame::fd(1, &[0; 65]).is_none(), "too long");
    }
}
