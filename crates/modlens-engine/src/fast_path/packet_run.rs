//! Exchanges of one connection that are matched in their packets (`packet_pairs`), one behind the other.

use crate::fast_path::pairing::OpenRequests;
use crate::fast_path::run::Run;
use crate::records::Span;
use modlens_protocol::mbap::{MAX_LENGTH_FIELD, PREFIX_BYTES as MBAP_PREFIX_BYTES};
use modlens_protocol::Ns;

/// The longest message (messaging on TCP/IP, 3.1.3).
const MAX_MESSAGE_BYTES: usize = MBAP_PREFIX_BYTES + MAX_LENGTH_FIELD;

/// A run of such exchanges.
pub(crate) struct PacketRun {
    /// Index of the bus.
    pub bus: usize,
    /// Indices of the client's line and of the server's.
    pub lines: [usize; 2],
    pub(super) run: Run,
    /// Requests that are outstanding beside them.
    pub(super) open: OpenRequests,
    /// Responses have to come within this time.
    pub(super) request_timeout: Ns,
    pub request: RequestInHand,
    /// Where the last response is in the arena, without its MBAP header.
    pub(super) last_response: Option<Span>,
}

/// A request whose response is still to come, if there is one.
pub(crate) struct RequestInHand {
    bytes: [u8; MAX_MESSAGE_BYTES],
    /// 0 without a request.
    length: usize,
    pub time: Ns,
    /// Number of its packet.
    pub packet: u64,
}

impl Default for RequestInHand {
    fn default() -> Self {
        Self { bytes: [0; MAX_MESSAGE_BYTES], length: 0, time: 0, packet: 0 }
    }
}

impl RequestInHand {
    /// Takes the packet of a request. `false` if there is one already, or if the packet is longer than a message.
    #[inline]
    pub fn take(&mut self, bytes: &[u8], time: Ns, packet: u64) -> bool {
        let is_possible = self.length == 0 && bytes.len() <= MAX_MESSAGE_BYTES;
        if is_possible {
            self.bytes[..bytes.len()].copy_from_slice(bytes);
            (self.length, self.time, self.packet) = (bytes.len(), time, packet);
        }
        is_possible
    }

    /// Its bytes; none without a request.
    #[inline]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }

    /// Leaves none.
    #[inline]
    pub fn clear(&mut self) {
        self.length = 0;
    }
}
