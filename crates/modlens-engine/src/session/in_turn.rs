//! Packets of a capture that came in turn, many at once.

use crate::session::capture::SWEEP_NS;
use crate::session::sources::CaptureState;
use crate::session::Session;
use modlens_readers::pcap::{Interface, PacketInTurn};

impl Session {
    /// Takes packets that came in turn. Requests that are followed by their responses are matched in pairs (`take_pairs`); each
    /// other packet is taken as the events that it means.
    pub(super) fn take_in_turn(&mut self, state: &mut CaptureState, mut packets: &[PacketInTurn<'_>], interface: &Interface) {
        let Some(first) = packets.first() else { return };
        // Those after it tell nothing more of the clock.
        state.note_time(first.time, interface, &mut self.decoder.origin);
        loop {
            let before = packets.len();
            packets = self.take_pairs(state, packets);
            if packets.len() < before {
                continue; // with another connection
            }
            let Some((packet, behind)) = packets.split_first() else { return };
            packets = behind;
            self.sweep_connections(state, packet.time);
            let bus = state.slot(packet.slot as usize).bus.filter(|_| !packet.bytes.is_empty());
            if let Some(bus) = bus {
                self.decoder.note_recorded_side(bus, packet.server_side_recorded);
                self.decoder.take_packet(bus, packet.from_client, &packet.chunk(), false);
            }
        }
    }

    /// Takes the pairs at the head of these packets that are unambiguous exchanges of one connection; gives those
    /// after them. None of them may move the clock on so far that requests of other connections have to be looked after.
    fn take_pairs<'a, 'b>(&mut self, state: &mut CaptureState, packets: &'b [PacketInTurn<'a>]) -> &'b [PacketInTurn<'a>] {
        let (Some(first), Some(last_sweep)) = (packets.first(), state.last_sweep) else { return packets };
        if !state.slot(first.slot as usize).bus.is_some_and(|bus| self.decoder.message_runs.turn_to_pairs(bus)) {
            return packets;
        }
        self.decoder.match_pairs(packets, |packet| packet.slot == first.slot && (packet.time - last_sweep).abs() < SWEEP_NS)
    }
}
