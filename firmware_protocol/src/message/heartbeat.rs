//! Sign of life of the flight computer. The stimulator's is STATUS: two nodes must not send one identifier.

use crate::Reject;
use crate::bytes::{Reader, Writer};

/// `0x70n`, 2 bytes.
///
/// | byte | field |
/// |---|---|
/// | 0 | state |
/// | 1 | protocol major version |
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Heartbeat {
    /// State of the sender.
    pub state: NodeState,
    /// Protocol major version of the sender.
    pub major: u8,
}

/// State of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum NodeState {
    /// Starting up.
    Starting = 0,
    /// Able to run.
    Ready = 1,
    /// Streaming or rendering.
    Running = 2,
    /// Not able to run.
    Fault = 3,
}

impl NodeState {
    const ALL: [Self; 4] = [Self::Starting, Self::Ready, Self::Running, Self::Fault];

    /// Returns the state of a code on the wire.
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }
}

impl Heartbeat {
    pub(crate) fn write(&self, to: &mut Writer) {
        to.u8(self.state as u8).u8(self.major);
    }

    pub(crate) fn read(from: &mut Reader<'_>) -> Result<Self, Reject> {
        let state = NodeState::from_code(from.u8()?).ok_or(Reject::UnknownValue)?;
        Ok(Self { state, major: from.u8()? })
    }
}
