//! The counts of a network camera: atomic while it runs, plain numbers to read.

use crate::network_camera::gvcp::Malformed;
use core::sync::atomic::{AtomicU64, Ordering};
use std::collections::BTreeMap;

macro_rules! counters {
    ($($(#[$doc:meta])* $name:ident;)*) => {
        /// Counts of one camera since its start.
        #[derive(Debug, Clone, Default, PartialEq, Eq, serde::Serialize)]
        pub struct Counters {
            $($(#[$doc])* pub $name: u64,)*
            /// Datagrams on the control port that could not be carried out, by reason.
            pub malformed: BTreeMap<&'static str, u64>,
        }

        /// The same while threads add to them.
        #[derive(Debug, Default)]
        pub(super) struct Tally {
            $(pub(super) $name: Count,)*
            malformed: [Count; Malformed::ALL.len()],
        }

        impl Counters {
            /// Returns every count that is not zero, by name.
            pub fn named(&self) -> Vec<(&'static str, u64)> {
                let counts = [$((stringify!($name), self.$name)),*];
                counts.into_iter().chain(self.malformed.iter().map(|(name, count)| (*name, *count))).filter(|(_, count)| *count > 0).collect()
            }
        }

        impl Tally {
            /// Returns the counts now. Each is exact; together they are of nearly one instant.
            pub(super) fn read(&self) -> Counters {
                let reasons = Malformed::ALL.iter().zip(&self.malformed);
                let malformed = reasons.map(|(reason, count)| (reason.name(), count.read())).filter(|(_, count)| *count > 0);
                Counters { $($name: self.$name.read(),)* malformed: malformed.collect() }
            }
        }
    };
}

counters! {
    /// Frames that the bench handed over.
    frames_offered;
    /// Frames without a client: none connected, none acquiring, no trigger, or a lower frame rate.
    frames_not_wanted;
    /// Frames lost because earlier ones were still waiting to be sent.
    frames_dropped;
    /// Frames of another size than the sensor, which were not announced to a client.
    frames_of_another_size;
    /// Frames sent whole.
    frames_sent;
    /// Frames with a packet that the system refused: the client has them only if it asked for that packet again.
    frames_refused;
    /// Frames that were sent as a test pattern, or were to be.
    frames_of_a_pattern;
    /// Frames given up because the acquisition stopped, or because the run ended before they were out.
    frames_cut;
    /// Packets handed to the system, resent and test ones included.
    packets;
    /// Bytes of those packets, GVSP headers included, IP and UDP headers not.
    bytes;
    /// Packets that were lost on purpose.
    packets_lost_on_purpose;
    /// Packets that the system refused.
    packets_refused;
    /// Packets that clients asked for again.
    resends_asked;
    /// Packets sent again.
    resends_served;
    /// Packets requested again that were already dropped (answered with status 800C).
    resends_gone;
    /// Packets asked for again that were not sent: by others than the stream's receiver, beyond what one frame may
    /// cost, more requests than may wait, or the acquisition or the run over first.
    resends_refused;
    /// Packets of a size that a client wanted to try.
    test_packets;
    /// The same, not sent: they came faster than the stream's rate.
    test_packets_refused;
    /// Streams and test packets refused because the client did not prove its address by reading the XML.
    unproven_refused;
    /// Reads of the XML at an address that belongs to another client.
    xml_misses;
    /// Streams stopped because the receiver's machine answered that it has no such port (ICMP unreachable).
    receivers_gone;
    /// Applications that took control.
    controllers_accepted;
    /// Attempts to take control while another application was in control.
    controllers_refused;
    /// Applications whose control ended because they fell silent.
    controllers_timed_out;
    /// Triggers that chose a frame.
    triggers;
    /// Events sent to the client's message port, those repeated for want of an answer not counted.
    events_sent;
    /// Events lost: too many waited, or none of the repetitions was answered.
    events_lost;
    /// Discovery requests answered.
    discoveries;
    /// Datagrams from outside the device's own subnet, not answered.
    strangers;
    /// Datagrams that came by broadcast and may not, not answered.
    broadcasts_ignored;
    /// Commands that came again under the same number: answered as before, not carried out again.
    repeats;
    /// Commands answered with an error.
    commands_refused;
}

/// One count that several threads may add to.
#[derive(Debug, Default)]
pub(super) struct Count(AtomicU64);

impl Count {
    pub(super) fn add(&self, more: u64) {
        self.0.fetch_add(more, Ordering::Relaxed);
    }

    pub(super) fn one(&self) {
        self.add(1);
    }

    pub(super) fn read(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

impl Tally {
    pub(super) fn malformed(&self, reason: Malformed) {
        self.malformed[reason as usize].one();
    }
}
