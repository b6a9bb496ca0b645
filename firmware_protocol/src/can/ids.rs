//! Message number and node <-> 11-bit identifier.

use crate::{MessageId, Reject};

const NODE_BITS: u32 = 4;
const NODE_MAX: u16 = 0xF;
const ID_MAX: u16 = 0x7FF;

/// `id = base + (message << 4 | node)`. SYNC is for all nodes and has node 0.
///
/// The node is that of the flight computer and star sensor pair; both ends are set to the same one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct IdMap {
    base: u16,
    node: u16,
}

impl IdMap {
    /// Returns a map; `None` when the node exceeds 15, the base is not a multiple of 16, or the highest identifier
    /// exceeds 11 bits (base above 0x0F0).
    #[must_use]
    pub fn new(base: u16, node: u8) -> Option<Self> {
        let node = u16::from(node);
        let highest = (u16::from(MessageId::Heartbeat.number()) << NODE_BITS) | NODE_MAX;
        let legal = node <= NODE_MAX && base.is_multiple_of(NODE_MAX + 1) && base <= ID_MAX - highest;
        legal.then_some(Self { base, node })
    }

    /// Returns the identifier of a message.
    #[must_use]
    pub fn id(&self, message: MessageId) -> u16 {
        self.base + ((u16::from(message.number()) << NODE_BITS) | self.node_of(message))
    }

    /// Returns the message of an identifier.
    ///
    /// # Errors
    /// [`Reject::UnknownId`] when it is none of this version's messages, or meant for another node.
    pub fn message(&self, id: u16) -> Result<MessageId, Reject> {
        let offset = id.checked_sub(self.base).ok_or(Reject::UnknownId)?;
        let number = u8::try_from(offset >> NODE_BITS).map_err(|_| Reject::UnknownId)?;
        let message = MessageId::from_number(number)?;
        if offset & NODE_MAX == self.node_of(message) { Ok(message) } else { Err(Reject::UnknownId) }
    }

    fn node_of(&self, message: MessageId) -> u16 {
        if message == MessageId::Sync { 0 } else { self.node }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_message_of_every_node_maps_back_and_only_to_itself() {
        for (base, node) in [(0, 0), (0, 15), (0xF0, 3)] {
            let map = IdMap::new(base, node).unwrap();
            let known = (0..=ID_MAX).filter_map(|id| map.message(id).ok().map(|message| (id, message)));
            let mut count = 0;
            for (id, message) in known {
                assert_eq!(map.id(message), id, "base {base:#x} node {node}");
                count += 1;
            }
            assert_eq!(count, MessageId::ALL.len(), "one identifier each");
        }
    }

    #[test]
    fn maps_that_do_not_fit_are_refused() {
        for (base, node) in [(0, 16), (8, 0), (0x100, 0)] {
            assert_eq!(IdMap::new(base, node), None, "base {base:#x} node {node}");
        }
        assert_eq!(IdMap::new(0, 2).unwrap().message(0x203), Err(Reject::UnknownId), "another node");
    }
}
