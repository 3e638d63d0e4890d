//! Findings on a connection in a packet capture: what the capture lacks or repeats. They are about no frame.

use crate::findings::words;
use modlens_protocol::finding::Finding;
use modlens_readers::pcap::{Conflict, ConnectionHistory, Repetition};

/// Bytes of the connection are missing before this packet.
pub(crate) fn missing_bytes(count: u32, packet: u64) -> (Finding, String) {
    (Finding::MissingSegment, words::missing_segment(count, packet))
}

/// This packet repeats one before it, or bytes that had been sent.
pub(crate) fn repetition(kind: Repetition, packet: u64) -> (Finding, String) {
    match kind {
        Repetition::Duplicate => (Finding::DuplicatePacket, words::packet_twice(packet)),
        Repetition::Retransmission => (Finding::Retransmission, words::retransmission(packet)),
    }
}

/// This packet has other bytes than those before it in the same place of the stream.
pub(crate) fn conflict(conflict: &Conflict, packet: u64) -> (Finding, String) {
    (Finding::ConflictingSegment, words::conflicting_segment(conflict, packet))
}

/// The findings on a connection with those of its packets, which are on it even where it carried no Modbus.
pub(crate) fn with_those_of_packets(mut found: Vec<Finding>, history: &ConnectionHistory) -> Vec<Finding> {
    let of_packets = [
        (history.has_duplicates, Finding::DuplicatePacket),
        (history.retransmitted > 0, Finding::Retransmission),
        (history.has_conflicts, Finding::ConflictingSegment),
    ];
    for (is_seen, finding) in of_packets {
        if is_seen && !found.contains(&finding) {
            found.push(finding);
        }
    }
    found
}
