//! Packets of connections that came in turn, many at once.
//!
//! Nearly all packets of a capture are the next ones of connections that go on: nothing is to be said of them but when they came
//! and which bytes they brought. To hand each of them on by itself, as two events, took as long as to read it.

use crate::pcap::stream::StreamChunk;
use modlens_protocol::Ns;

/// So many packets are handed on at once, at most: more would not stay in the nearest cache.
pub(super) const MOST_IN_TURN: usize = 128;

/// The next packet of a TCP connection of Modbus.
#[derive(Clone, Copy, Debug)]
pub struct PacketInTurn<'a> {
    /// When it was captured.
    pub time: Ns,
    /// Its number in the file.
    pub number: u64,
    /// The bytes that it brought: none if it only acknowledges others.
    pub bytes: &'a [u8],
    /// Slot of the connection.
    pub slot: u32,
    /// Who sent it: 0 or 1.
    pub side: u8,
    /// The client has sent it.
    pub from_client: bool,
    /// Anything that the server has sent was captured, so that a missing response means something.
    pub server_side_recorded: bool,
}

impl<'a> PacketInTurn<'a> {
    /// Its bytes as those of any packet.
    #[inline]
    pub fn chunk(&self) -> StreamChunk<'a> {
        let Self { time, number, bytes, side, .. } = *self;
        StreamChunk { side: usize::from(side), bytes, packet: number, time: Some(time), missing: 0, cut: false }
    }
}
