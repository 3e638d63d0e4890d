//! What the packets of a TCP connection tell beside the bytes that they carry: who opened it and when, whether it was
//! refused, who ended it and how, what was transmitted again or is missing, and in which framing each side writes.

use crate::pcap::classify::framing_of_segment;
use crate::pcap::stream::{ArrivedSegment, SegmentOutcome, MAX_DUPLICATE_DELAY_NS};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::Ns;

/// A side without a frame in so many segments writes in no framing of Modbus.
const MAX_SEGMENTS_WITHOUT_FRAME: u8 = 16;

/// How one side of a connection ended it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Closing {
    /// By FIN: it sends nothing more (RFC 9293, 3.6).
    Finished,
    /// By RST: it sends nothing more and takes nothing more, either (RFC 9293, 3.5.3).
    Reset,
}

/// What is known of the framing in which one side writes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SideFraming {
    /// It has sent nothing.
    #[default]
    Silent,
    /// None of its segments, of which this counts the first ones, begins with a frame.
    Unknown(u8),
    /// One of its first segments begins with a frame of this framing.
    Known(Mode),
}

/// The FIN of a side.
#[derive(Clone, Copy, Debug)]
pub struct Fin {
    /// When it was captured.
    pub time: Option<Ns>,
}

/// The history of one TCP connection.
#[derive(Clone, Debug, Default)]
pub struct ConnectionHistory {
    /// Number of its first packet.
    pub packet: u64,
    /// Time of its first packet.
    pub begun: Option<Ns>,
    /// The SYN was captured.
    pub is_opened: bool,
    /// When the client asked for the connection: the time of its first SYN.
    pub opened: Option<Ns>,
    /// The server has sent something other than a RST.
    pub is_accepted: bool,
    /// The server has answered the SYN with a RST.
    pub is_refused: bool,
    /// A RST ended it, before both sides had finished.
    pub is_reset: bool,
    /// Time of the FIN or RST that ended it.
    pub closed: Option<Ns>,
    /// The side that sent it: 0 or 1.
    pub closed_by: Option<usize>,
    /// Segments that were transmitted again, SYNs included.
    pub retransmitted: u32,
    /// Bytes that are missing from the capture.
    pub lost_bytes: u64,
    /// Time of the last segment with new bytes.
    pub last_data: Option<Ns>,
    /// For each side, the framing in which it writes.
    pub framing: [SideFraming; 2],
    /// Packets of the connection were captured twice.
    pub has_duplicates: bool,
    /// Bytes were transmitted again as others.
    pub has_conflicts: bool,
    /// Identification and time of the last SYN.
    syn: (Option<u16>, Option<Ns>),
    /// The FIN of each side.
    fin: [Option<Fin>; 2],
    /// For each side, whether its FIN was reported.
    has_finished: [bool; 2],
}

impl ConnectionHistory {
    /// The history of a connection that begins with this packet.
    pub fn new(packet: u64, begun: Option<Ns>) -> Self {
        Self { packet, begun, ..Self::default() }
    }

    /// The silence before the end; from the opening on where the connection carried no byte. `None` while it is open.
    pub fn idle(&self) -> Option<Ns> {
        Some((self.closed? - self.last_data.or(self.opened).or(self.begun)?).max(0))
    }

    /// A side's FIN, if it has sent one.
    pub fn fin(&self, side: usize) -> Option<Fin> {
        self.fin[side]
    }

    /// Notes a segment of one side, after the stream has said what it brought.
    pub fn note_segment(&mut self, it: &ArrivedSegment<'_>, outcome: SegmentOutcome, client: usize) {
        match outcome {
            SegmentOutcome::New => self.last_data = it.time,
            SegmentOutcome::Retransmission => self.retransmitted += 1,
            SegmentOutcome::Duplicate => self.has_duplicates = true,
            SegmentOutcome::Conflicting => self.has_conflicts = true,
            SegmentOutcome::Empty | SegmentOutcome::OtherConnection => {}
        }
        if it.tcp.fin {
            self.fin[it.side].get_or_insert(Fin { time: it.time });
        }
        if it.tcp.syn && it.tcp.acknowledged.is_none() {
            self.note_syn(it.ident.filter(|&ident| ident != 0), it.time);
        } else if it.side != client && !it.tcp.rst {
            self.is_accepted = true;
        }
    }

    /// Notes a segment as `note_segment` would that has neither SYN nor FIN nor RST; `new_bytes` is its time if it has bytes, which
    /// are new.
    #[inline]
    pub fn note_plain_segment(&mut self, is_from_client: bool, new_bytes: Option<Ns>) {
        self.last_data = new_bytes.or(self.last_data);
        self.is_accepted |= !is_from_client;
    }

    /// Notes a SYN without ACK: the first one opens the connection, one more was captured twice or transmitted again.
    fn note_syn(&mut self, ident: Option<u16>, time: Option<Ns>) {
        let (old_ident, old_time) = std::mem::replace(&mut self.syn, (ident, time));
        if !std::mem::replace(&mut self.is_opened, true) {
            self.opened = time;
            return;
        }
        let is_soon = || old_time.zip(time).is_some_and(|(old, new)| (new - old).abs() < MAX_DUPLICATE_DELAY_NS);
        let is_duplicate = if ident.is_some() { ident == old_ident } else { is_soon() };
        self.has_duplicates |= is_duplicate;
        self.retransmitted += u32::from(!is_duplicate);
    }

    /// Notes bytes of one side, in order.
    #[inline]
    pub fn note_bytes(&mut self, functions: &Functions, side: usize, bytes: &[u8]) {
        let framing = &mut self.framing[side];
        let tried = match *framing {
            SideFraming::Silent => 0,
            SideFraming::Unknown(tried) if tried < MAX_SEGMENTS_WITHOUT_FRAME => tried,
            SideFraming::Unknown(_) | SideFraming::Known(_) => return,
        };
        *framing = framing_of_segment(functions, bytes).map_or(SideFraming::Unknown(tried + 1), SideFraming::Known);
    }

    /// Notes that a side has ended the connection. `false` if it had finished before, so that this is nothing new.
    pub fn note_closing(&mut self, side: usize, closing: Closing, time: Option<Ns>, client: usize) -> bool {
        if closing == Closing::Finished && std::mem::replace(&mut self.has_finished[side], true) {
            return false;
        }
        if closing == Closing::Reset {
            let has_carried_nothing = self.framing == [SideFraming::Silent; 2];
            self.is_refused = self.is_opened && !self.is_accepted && has_carried_nothing && side != client;
            self.is_reset = !self.is_refused && self.has_finished != [true; 2];
        }
        if self.closed_by.is_none() {
            (self.closed_by, self.closed) = (Some(side), time);
        }
        true
    }
}
