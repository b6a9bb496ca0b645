//! Message number and node <-> identifier.

use super::id::{EXTENDED_MAX, STANDARD_MAX};
use super::{CanId, ToCanId};
use crate::{MessageId, Reject};

const NODE_BITS: u32 = 4;
const NODE_MAX: u8 = 0xF;
/// Highest identifier at base 0.
const HIGHEST: u32 = ((MessageId::Heartbeat.number() as u32) << NODE_BITS) | NODE_MAX as u32;

/// `id = base + (message << 4 | node)`, of 11 or 29 bits. SYNC is for all nodes and has node 0.
///
/// The node is that of the flight computer and star sensor pair; both ends are set to the same one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct IdMap {
    base: CanId,
    node: u8,
}

impl IdMap {
    /// Highest base of identifiers with 11 bits.
    pub const BASE_MAX: u32 = (STANDARD_MAX as u32 - HIGHEST) & !0xF;
    /// Highest base of identifiers with 29 bits.
    pub const EXTENDED_BASE_MAX: u32 = (EXTENDED_MAX - HIGHEST) & !0xF;

    /// Returns a map to identifiers of 11 bits; `None` when the node exceeds 15, the base is not a multiple of 16, or
    /// the highest identifier exceeds 11 bits (base above 0x0F0).
    pub fn new(base: u16, node: u8) -> Option<Self> {
        Self::of(CanId::standard(base)?, node)
    }

    /// Returns a map to identifiers of 29 bits; `None` when the node exceeds 15, the base is not a multiple of 16, or
    /// the highest identifier exceeds 29 bits (base above 0x1FFFF8F0).
    pub fn extended(base: u32, node: u8) -> Option<Self> {
        Self::of(CanId::extended(base)?, node)
    }

    /// Returns a map from its base, which says the length of the identifiers.
    pub fn of(base: CanId, node: u8) -> Option<Self> {
        let most = if base.is_extended() { Self::EXTENDED_BASE_MAX } else { Self::BASE_MAX };
        let legal = node <= NODE_MAX && base.number().is_multiple_of(1 << NODE_BITS) && base.number() <= most;
        legal.then_some(Self { base, node })
    }

    /// Returns the identifier of a message.
    pub fn id(&self, message: MessageId) -> CanId {
        let offset = (u32::from(message.number()) << NODE_BITS) | u32::from(self.node_of(message));
        let number = self.base.number() + offset;
        let id = if self.base.is_extended() { CanId::extended(number) } else { standard(number) };
        id.unwrap_or_default() // a legal base leaves space for every offset
    }

    /// Returns the message of an identifier.
    ///
    /// # Errors
    /// [`Reject::UnknownId`] when it is none of this version's messages, meant for another node, or of the other length.
    pub fn message(&self, id: impl ToCanId) -> Result<MessageId, Reject> {
        let id = id.to_can_id().filter(|id| id.is_extended() == self.base.is_extended()).ok_or(Reject::UnknownId)?;
        let offset = id.number().checked_sub(self.base.number()).ok_or(Reject::UnknownId)?;
        let number = u8::try_from(offset >> NODE_BITS).map_err(|_| Reject::UnknownId)?;
        let message = MessageId::from_number(number)?;
        let node = u32::from(self.node_of(message));
        if offset % (1 << NODE_BITS) == node { Ok(message) } else { Err(Reject::UnknownId) }
    }

    fn node_of(&self, message: MessageId) -> u8 {
        if message == MessageId::Sync { 0 } else { self.node }
    }
}

fn standard(number: u32) -> Option<CanId> {
    u16::try_from(number).ok().and_then(CanId::standard)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_message_of_every_node_maps_back_and_only_to_itself() {
        let standard = (0..=0x7FF).filter_map(CanId::standard);
        for (base, node) in [(0, 0), (0, 15), (0xF0, 3)] {
            let map = IdMap::new(base, node).unwrap();
            check(&map, standard.clone());
            assert!((0..=0x7FF).filter_map(CanId::extended).all(|id| map.message(id).is_err()), "29 bits");
        }
        for (base, node) in [(0, 0), (0x18FF_0000, 5), (0x1FFF_F8F0, 15)] {
            let map = IdMap::extended(base, node).unwrap();
            check(&map, (base.saturating_sub(0x800)..=base + 0x70F).filter_map(CanId::extended));
            assert!(standard.clone().all(|id| map.message(id).is_err()), "11 bits");
        }
    }

    fn check(map: &IdMap, ids: impl Iterator<Item = CanId>) {
        let mut count = 0;
        for (id, message) in ids.filter_map(|id| map.message(id).ok().map(|message| (id, message))) {
            assert_eq!(map.id(message), id, "{map:?}");
            count += 1;
        }
        assert_eq!(count, MessageId::ALL.len(), "one identifier each");
    }

    #[test]
    fn maps_that_do_not_fit_are_refused() {
        for (base, node) in [(0, 16), (8, 0), (0x100, 0)] {
            assert_eq!(IdMap::new(base, node), None, "base {base:#x} node {node}");
        }
        for (base, node) in [(0, 16), (8, 0), (0x1FFF_F900, 0), (0x2000_0000, 0)] {
            assert_eq!(IdMap::extended(base, node), None, "base {base:#x} node {node}");
        }
        assert_eq!((IdMap::BASE_MAX, IdMap::EXTENDED_BASE_MAX), (0x0F0, 0x1FFF_F8F0));
        assert_eq!(IdMap::new(0, 2).unwrap().message(0x203), Err(Reject::UnknownId), "another node");
        assert_eq!(IdMap::extended(0x100, 2).unwrap().id(MessageId::Attitude), CanId::extended(0x402).unwrap());
    }
}
