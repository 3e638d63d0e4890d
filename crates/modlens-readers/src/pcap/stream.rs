//! Reassembles the two byte streams of a TCP connection: in order, without duplicates, and with missing bytes counted.
//!
//! A segment is delivered once its own direction is complete up to it and everything that its sender has acknowledged of
//! the other direction has been delivered. So a response never comes before its request, however the capture has mixed the
//! packets. Bytes that do not arrive within limits are given up and counted as missing.

use crate::pcap::delivered::{ahead, Conflict, Delivered};
use crate::pcap::net::Tcp;
use crate::pcap::plain::PlainSegment;
use modlens_protocol::Ns;

/// The most segments that wait for a missing one.
const MAX_WAITING_SEGMENTS: usize = 64;

/// The most bytes that wait for a missing segment.
const MAX_WAITING_BYTES: usize = 64 << 10;

/// A segment waits so long for a retransmission of a missing one.
const MAX_WAIT_NS: Ns = 5_000_000_000;

/// A sequence number this far from the expected one belongs to another connection between the same ports.
const MAX_SEQUENCE_DISTANCE: i32 = 1 << 24;

/// Where the IP header has no identification, a segment or datagram that is repeated within this time was captured twice: no
/// sender retransmits so quickly.
pub(super) const MAX_DUPLICATE_DELAY_NS: Ns = 2_000_000;

/// After so many runs of missing bytes without any data between them, a side counts as not captured, and its sequence
/// numbers are no longer waited for.
const MAX_LOSSES_WITHOUT_DATA: u8 = 3;

/// How many segments of a side are remembered to recognise duplicates.
const RECENT_SEGMENTS: usize = 8;

/// What a segment has brought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SegmentOutcome {
    /// It brought new bytes, which were delivered or wait for others.
    New,
    /// It has no payload.
    Empty,
    /// The same packet was captured twice.
    Duplicate,
    /// Its sender has transmitted the bytes again.
    Retransmission,
    /// It repeats bytes as others: `Stream::conflict` has both versions.
    Conflicting,
    /// Its sequence number is too far away: it belongs to another connection between the same ports.
    OtherConnection,
}

/// Bytes of one direction, delivered in order.
#[derive(Clone, Copy, Debug)]
pub struct StreamChunk<'a> {
    /// Who sent them: 0 or 1.
    pub side: usize,
    /// The bytes.
    pub bytes: &'a [u8],
    /// Number of the packet that they came in.
    pub packet: u64,
    /// When the packet was captured.
    pub time: Option<Ns>,
    /// How many bytes are missing before them.
    pub missing: u32,
    /// The capture kept only a part of the packet.
    pub cut: bool,
}

/// A captured segment, as input of the reassembly.
#[derive(Clone, Copy, Debug)]
pub struct ArrivedSegment<'a> {
    /// Who sent it: 0 or 1.
    pub side: usize,
    /// Fields of the TCP header.
    pub tcp: Tcp,
    /// The payload, as far as the capture kept it.
    pub payload: &'a [u8],
    /// The length of the payload on the wire.
    pub length: usize,
    /// Identification in the IPv4 header.
    pub ident: Option<u16>,
    /// Number of the packet.
    pub packet: u64,
    /// When it was captured.
    pub time: Option<Ns>,
}

/// What a segment is recognised by when it comes again.
#[derive(Clone, Copy, Debug, Default)]
struct SegmentFingerprint {
    start: u32,
    length: u32,
    /// Identification in the IPv4 header; 0 if it has none.
    ident: u16,
    time: Option<Ns>,
}

/// One direction of a connection.
#[derive(Debug, Default)]
struct StreamDirection {
    /// Sequence number of the next byte; `None` until the first segment, and where the side is not captured.
    next: Option<u32>,
    /// Sequence number after the last byte, once a FIN has announced it.
    end: Option<u32>,
    /// Missing bytes that are still to be reported with the next ones delivered.
    missing: u32,
    /// Runs of missing bytes since the last data.
    losses_without_data: u8,
    /// A ring of the last segments.
    recent: [SegmentFingerprint; RECENT_SEGMENTS],
    /// Index in `recent` of the next one to be replaced.
    oldest: usize,
    /// How many of the last ones in `recent` stand right one after the other up to `next`, so that none begins there.
    in_turn: usize,
    /// The last bytes before `next`.
    delivered: Delivered,
}

/// A segment that waits for bytes before it.
#[derive(Debug)]
struct WaitingSegment {
    side: usize,
    start: u32,
    acknowledged: Option<u32>,
    bytes: Vec<u8>,
    length: usize,
    packet: u64,
    time: Option<Ns>,
}

/// Both directions of a connection.
#[derive(Debug, Default)]
pub struct Stream {
    sides: [StreamDirection; 2],
    waiting: Vec<WaitingSegment>,
    /// The number of bytes in `waiting`.
    waiting_bytes: usize,
}

impl Stream {
    /// Takes a segment; `each` is called with all bytes that are in order now.
    pub fn take(&mut self, it: &ArrivedSegment<'_>, each: &mut dyn FnMut(StreamChunk<'_>)) -> SegmentOutcome {
        let side = &mut self.sides[it.side];
        let start = it.tcp.sequence.wrapping_add(u32::from(it.tcp.syn));
        let next = *side.next.get_or_insert(start);
        let distance = ahead(start, next);
        if distance.abs() > MAX_SEQUENCE_DISTANCE {
            return SegmentOutcome::OtherConnection;
        }
        if it.tcp.fin {
            side.end = Some(start.wrapping_add(it.length as u32));
        }
        let mut outcome = SegmentOutcome::Empty;
        if it.length > 0 {
            outcome = side.check_and_remember(it, start);
            if outcome == SegmentOutcome::New && ahead(start.wrapping_add(it.length as u32), next) <= 0 {
                // A single byte before the expected one is a keep-alive probe (RFC 9293, 3.8.4).
                outcome = if it.length == 1 && distance == -1 { SegmentOutcome::Empty } else { SegmentOutcome::Retransmission };
            }
        }
        if outcome == SegmentOutcome::New {
            if self.waiting.is_empty() && distance <= 0 && !self.is_blocked(it.side, it.tcp.acknowledged) {
                self.deliver(it.side, start, it.payload, it.length, (it.packet, it.time), each);
            } else {
                self.waiting_bytes += it.payload.len();
                self.waiting.push(WaitingSegment {
                    side: it.side,
                    start,
                    acknowledged: it.tcp.acknowledged,
                    bytes: it.payload.to_vec(),
                    length: it.length,
                    packet: it.packet,
                    time: it.time,
                });
            }
        }
        if !self.waiting.is_empty() {
            self.deliver_or_give_up(it.time, each);
        }
        outcome
    }

    /// Whether nothing waits or is missing, and no side has finished. It stays so as long as `take_next` takes all segments.
    pub fn is_steady(&self) -> bool {
        self.waiting.is_empty() && self.sides.iter().all(|side| side.end.is_none() && side.missing == 0)
    }

    /// Takes a segment with all of its payload that `take` would deliver as it is and at once: the stream is steady, and it is the
    /// next one of its side and new. `false`, with nothing changed, if it is not. The caller delivers the payload.
    #[inline(always)]
    #[allow(clippy::inline_always)] // Called for each packet, with hardly more to do than a call.
    pub fn take_next(&mut self, side: usize, it: &PlainSegment<'_>, time: Ns) -> bool {
        if self.sides[side].next != Some(it.sequence) || self.is_blocked(side, Some(it.acknowledged)) {
            return false;
        }
        let length = it.payload.len() as u32;
        if length == 0 {
            return true;
        }
        let direction = &mut self.sides[side];
        if direction.in_turn < RECENT_SEGMENTS {
            if direction.recent.iter().any(|old| old.start == it.sequence) {
                return false;
            }
            direction.in_turn += 1;
        }
        direction.next = Some(it.sequence.wrapping_add(length));
        direction.losses_without_data = 0;
        direction.delivered.push(it.payload);
        direction.remember(SegmentFingerprint { start: it.sequence, length, ident: it.ident, time: Some(time) });
        true
    }

    /// Where the payload of a segment contradicts bytes that have come with the same sequence numbers, delivered or waiting. To be
    /// asked before `take`, which drops them.
    pub fn conflict(&self, it: &ArrivedSegment<'_>) -> Option<Conflict> {
        let direction = &self.sides[it.side];
        let next = direction.next?;
        let start = it.tcp.sequence.wrapping_add(u32::from(it.tcp.syn));
        let distance = ahead(start, next);
        // The byte of a keep-alive probe may be anything (RFC 9293, 3.8.4).
        let is_probe = it.length == 1 && distance == -1;
        if is_probe || distance.abs() > MAX_SEQUENCE_DISTANCE || (distance >= 0 && self.waiting.is_empty()) {
            return None;
        }
        let mut waiting = self.waiting.iter().filter(|waiting| waiting.side == it.side);
        direction
            .delivered
            .conflict(next, start, it.payload)
            .or_else(|| waiting.find_map(|waiting| Conflict::between((waiting.start, &waiting.bytes), (start, it.payload))))
    }

    /// Delivers what waits, because no further segment comes.
    pub fn finish(&mut self, each: &mut dyn FnMut(StreamChunk<'_>)) {
        while !self.waiting.is_empty() {
            self.give_up();
            self.deliver_in_order(each);
        }
    }

    /// Whether both directions have been delivered up to their FIN.
    pub fn ended(&self) -> bool {
        self.waiting.is_empty() && self.has_finished(0) && self.has_finished(1)
    }

    /// Whether everything that a side has sent, up to its FIN, has been delivered.
    pub fn has_finished(&self, side: usize) -> bool {
        let direction = &self.sides[side];
        direction.end.is_some() && direction.end == direction.next
    }

    /// Whether the sender of a segment has acknowledged bytes of the other side that have not been delivered yet.
    fn is_blocked(&self, side: usize, acknowledged: Option<u32>) -> bool {
        let other = &self.sides[1 - side];
        match (acknowledged, other.next) {
            // A FIN takes up one sequence number.
            (Some(seen), Some(next)) => {
                (u32::from(other.end.is_some()) as i32) < ahead(seen, next) && ahead(seen, next) <= MAX_SEQUENCE_DISTANCE
            }
            _ => false,
        }
    }

    /// Delivers those bytes of a segment that are new, and moves its direction on after it.
    fn deliver(
        &mut self,
        side: usize,
        start: u32,
        bytes: &[u8],
        length: usize,
        (packet, time): (u64, Option<Ns>),
        each: &mut dyn FnMut(StreamChunk<'_>),
    ) {
        let direction = &mut self.sides[side];
        let next = direction.next.unwrap_or(start);
        let old = ahead(next, start).max(0) as usize;
        if old >= length {
            return;
        }
        let fresh = bytes.get(old..).unwrap_or(&[]);
        let cut = length.saturating_sub(bytes.len());
        direction.next = Some(start.wrapping_add(length as u32));
        direction.losses_without_data = 0;
        let missing = std::mem::take(&mut direction.missing);
        direction.missing = cut.min(length - old) as u32;
        direction.delivered.push(fresh);
        if cut > 0 {
            direction.delivered.clear();
        }
        if fresh.is_empty() {
            direction.missing += missing;
        } else {
            each(StreamChunk { side, bytes: fresh, packet, time, missing, cut: cut > 0 });
        }
    }

    /// Delivers what is in order, and gives up missing bytes for which segments have waited too long.
    fn deliver_or_give_up(&mut self, now: Option<Ns>, each: &mut dyn FnMut(StreamChunk<'_>)) {
        self.deliver_in_order(each);
        while self.waiting.len() > MAX_WAITING_SEGMENTS || self.waiting_bytes > MAX_WAITING_BYTES || self.is_overdue(now) {
            self.give_up();
            self.deliver_in_order(each);
        }
    }

    /// Whether the oldest waiting segment has waited too long.
    fn is_overdue(&self, now: Option<Ns>) -> bool {
        let oldest = self.waiting.first().and_then(|first| first.time);
        oldest.zip(now).is_some_and(|(oldest, now)| now - oldest > MAX_WAIT_NS)
    }

    /// Delivers all waiting segments that are in order now.
    fn deliver_in_order(&mut self, each: &mut dyn FnMut(StreamChunk<'_>)) {
        let ready = |stream: &Self, it: &WaitingSegment| {
            let next = stream.sides[it.side].next.unwrap_or(it.start);
            ahead(it.start, next) <= 0 && !stream.is_blocked(it.side, it.acknowledged)
        };
        while let Some(at) = self.waiting.iter().position(|it| ready(self, it)) {
            let it = self.waiting.remove(at);
            self.waiting_bytes -= it.bytes.len();
            self.deliver(it.side, it.start, &it.bytes, it.length, (it.packet, it.time), each);
        }
    }

    /// Gives up the bytes that the oldest waiting segment waits for: bytes of its own direction, or bytes of the other one
    /// that its sender has acknowledged.
    fn give_up(&mut self) {
        let Some(oldest) = self.waiting.first() else { return };
        let (side, acknowledged) = (oldest.side, oldest.acknowledged);
        let first_gap_end = |side: usize, stream: &Self| {
            let starts = stream.waiting.iter().filter(|it| it.side == side).map(|it| it.start);
            let next = stream.sides[side].next?;
            starts.min_by_key(|&start| ahead(start, next)).filter(|&start| ahead(start, next) > 0)
        };
        if let Some(start) = first_gap_end(side, self) {
            self.skip_to(side, start);
        } else if let Some(start) = first_gap_end(1 - side, self) {
            self.skip_to(1 - side, start);
        } else if let Some(seen) = acknowledged {
            self.skip_to(1 - side, seen);
            let other = &mut self.sides[1 - side];
            other.losses_without_data = other.losses_without_data.saturating_add(1);
            if other.losses_without_data >= MAX_LOSSES_WITHOUT_DATA {
                (other.next, other.in_turn) = (None, 0);
                other.delivered.clear();
            }
        }
    }

    /// Counts the bytes up to the sequence number `to` as missing.
    fn skip_to(&mut self, side: usize, to: u32) {
        let direction = &mut self.sides[side];
        if let Some(next) = direction.next {
            direction.missing = direction.missing.saturating_add(ahead(to, next).max(0) as u32);
        }
        direction.next = Some(to);
        direction.delivered.clear();
    }
}

impl StreamDirection {
    /// Whether this segment is new, a duplicate of the capture or a retransmission; it is remembered for the next ones.
    fn check_and_remember(&mut self, it: &ArrivedSegment<'_>, start: u32) -> SegmentOutcome {
        let this = SegmentFingerprint { start, length: it.length as u32, ident: it.ident.unwrap_or(0), time: it.time };
        let same = |old: &&SegmentFingerprint| (old.start, old.length) == (this.start, this.length);
        let outcome = match self.recent.iter().rfind(same) {
            None => SegmentOutcome::New,
            Some(old) if old.ident != 0 || this.ident != 0 => {
                if self.recent.iter().filter(same).any(|old| old.ident == this.ident) {
                    SegmentOutcome::Duplicate
                } else {
                    SegmentOutcome::Retransmission
                }
            }
            Some(old) if old.time.zip(this.time).is_some_and(|(old, new)| (new - old).abs() < MAX_DUPLICATE_DELAY_NS) => {
                SegmentOutcome::Duplicate
            }
            Some(_) => SegmentOutcome::Retransmission,
        };
        self.remember(this);
        self.in_turn = 0;
        outcome
    }

    #[inline]
    fn remember(&mut self, this: SegmentFingerprint) {
        self.recent[self.oldest] = this;
        self.oldest = (self.oldest + 1) % RECENT_SEGMENTS;
    }
}
