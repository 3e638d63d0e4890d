//! The two byte streams of a TCP connection, in order and once, with what is missing said.
//!
//! A segment is handed on when its direction is complete up to it, and when everything that its sender had seen of the
//! other direction (the acknowledgement) has been handed on: so answers never come before their questions, however the
//! capture has mixed them up. What does not come within limits is given up as missing.

use crate::pcap::net::Tcp;
use modlens_protocol::Ns;

/// So many segments may wait for one that is missing.
const MOST_WAITING: usize = 64;

/// So many bytes may wait.
const MOST_BYTES: usize = 64 << 10;

/// So long a retransmission may take.
const LONGEST_WAIT: Ns = 5_000_000_000;

/// A segment this far from where its direction stands is of another connection.
const FAR: i32 = 1 << 24;

/// Without identification in the IP header, a packet is told from a retransmission by time: no sender is so quick.
const AT_ONCE: Ns = 2_000_000;

/// A side of which so many runs of bytes are missing one after the other is not in the capture.
const DEAF_AFTER: u8 = 3;

/// Segments remembered to know them again.
const RECENT: usize = 8;

/// What came of a segment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Its bytes were handed on or wait.
    New,
    /// It has none.
    Empty,
    /// The capture has it twice.
    Twice,
    /// Its sender sent it again.
    Again,
    /// It cannot be of this connection.
    Foreign,
}

/// Bytes in order.
#[derive(Clone, Copy, Debug)]
pub struct Piece<'a> {
    /// Who sent them: 0 or 1.
    pub side: usize,
    /// The bytes.
    pub bytes: &'a [u8],
    /// The packet they came in.
    pub packet: u64,
    /// When it was captured.
    pub time: Option<Ns>,
    /// So many bytes are missing before them.
    pub missing: u32,
    /// Some of this packet's bytes were cut off by the capture.
    pub cut: bool,
}

/// A segment, as far as it matters here.
#[derive(Clone, Copy, Debug)]
pub struct Arrival<'a> {
    /// Who sent it: 0 or 1.
    pub side: usize,
    /// TCP's part.
    pub tcp: Tcp,
    /// What was kept of its payload.
    pub payload: &'a [u8],
    /// The payload's length on the wire.
    pub length: usize,
    /// IPv4's identification.
    pub ident: Option<u16>,
    /// Packet number.
    pub packet: u64,
    /// When.
    pub time: Option<Ns>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Fingerprint {
    start: u32,
    length: u32,
    ident: Option<u16>,
    time: Option<Ns>,
}

#[derive(Debug, Default)]
struct Side {
    /// Number of the next byte.
    next: Option<u32>,
    /// It has said that it ends, behind this byte.
    end: Option<u32>,
    missing: u32,
    /// Runs of missing bytes since the last byte that came.
    silent_losses: u8,
    recent: [Fingerprint; RECENT],
    newest: usize,
}

#[derive(Debug)]
struct Waiting {
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
    sides: [Side; 2],
    waiting: Vec<Waiting>,
    bytes: usize,
}

/// How far `a` is ahead of `b` in sequence space.
fn ahead(a: u32, b: u32) -> i32 {
    a.wrapping_sub(b) as i32
}

impl Stream {
    /// Takes a segment; `each` gets what is in order now.
    pub fn take(&mut self, it: &Arrival<'_>, each: &mut dyn FnMut(Piece<'_>)) -> Outcome {
        let side = &mut self.sides[it.side];
        let start = it.tcp.sequence.wrapping_add(u32::from(it.tcp.opens));
        let next = *side.next.get_or_insert(start);
        let early = ahead(start, next);
        if early.abs() > FAR {
            return Outcome::Foreign;
        }
        if it.tcp.ends {
            side.end = Some(start.wrapping_add(it.length as u32));
        }
        let mut outcome = Outcome::Empty;
        if it.length > 0 {
            outcome = side.known(it, start);
            if outcome == Outcome::New && ahead(start.wrapping_add(it.length as u32), next) <= 0 {
                // A byte before the next one, alone, asks whether the other side is still there.
                outcome = if it.length == 1 && early == -1 { Outcome::Empty } else { Outcome::Again };
            }
        }
        if outcome == Outcome::New {
            if self.waiting.is_empty() && early <= 0 && !self.blocked(it.side, it.tcp.acknowledged) {
                self.deliver(it.side, start, it.payload, it.length, (it.packet, it.time), each);
            } else {
                self.bytes += it.payload.len();
                self.waiting.push(Waiting {
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
            self.settle(it.time, each);
        }
        outcome
    }

    /// Nothing more comes: hands on what waits.
    pub fn finish(&mut self, each: &mut dyn FnMut(Piece<'_>)) {
        while !self.waiting.is_empty() {
            self.give_up();
            self.in_order(each);
        }
    }

    /// Whether both directions have come to their end.
    pub fn ended(&self) -> bool {
        self.waiting.is_empty() && self.sides.iter().all(|side| side.end.is_some() && side.end == side.next)
    }

    /// Whether the sender had seen bytes of the other side that have not come yet.
    fn blocked(&self, side: usize, acknowledged: Option<u32>) -> bool {
        let other = &self.sides[1 - side];
        match (acknowledged, other.next) {
            // The end of a direction counts as a byte.
            (Some(seen), Some(next)) => (u32::from(other.end.is_some()) as i32) < ahead(seen, next) && ahead(seen, next) <= FAR,
            _ => false,
        }
    }

    fn deliver(
        &mut self,
        side: usize,
        start: u32,
        bytes: &[u8],
        length: usize,
        (packet, time): (u64, Option<Ns>),
        each: &mut dyn FnMut(Piece<'_>),
    ) {
        let half = &mut self.sides[side];
        let next = half.next.unwrap_or(start);
        let old = ahead(next, start).max(0) as usize;
        if old >= length {
            return;
        }
        let fresh = bytes.get(old..).unwrap_or(&[]);
        let cut = length.saturating_sub(bytes.len());
        half.next = Some(start.wrapping_add(length as u32));
        half.silent_losses = 0;
        let missing = std::mem::take(&mut half.missing);
        half.missing = cut.min(length - old) as u32;
        if fresh.is_empty() {
            half.missing += missing;
        } else {
            each(Piece { side, bytes: fresh, packet, time, missing, cut: cut > 0 });
        }
    }

    fn settle(&mut self, now: Option<Ns>, each: &mut dyn FnMut(Piece<'_>)) {
        self.in_order(each);
        while self.waiting.len() > MOST_WAITING || self.bytes > MOST_BYTES || self.overdue(now) {
            self.give_up();
            self.in_order(each);
        }
    }

    fn overdue(&self, now: Option<Ns>) -> bool {
        let oldest = self.waiting.first().and_then(|first| first.time);
        oldest.zip(now).is_some_and(|(oldest, now)| now - oldest > LONGEST_WAIT)
    }

    /// Hands on what waits and can be handed on.
    fn in_order(&mut self, each: &mut dyn FnMut(Piece<'_>)) {
        let ready = |stream: &Self, it: &Waiting| {
            let next = stream.sides[it.side].next.unwrap_or(it.start);
            ahead(it.start, next) <= 0 && !stream.blocked(it.side, it.acknowledged)
        };
        while let Some(at) = self.waiting.iter().position(|it| ready(self, it)) {
            let it = self.waiting.remove(at);
            self.bytes -= it.bytes.len();
            self.deliver(it.side, it.start, &it.bytes, it.length, (it.packet, it.time), each);
        }
    }

    /// Gives up bytes that the oldest waiting segment waits for.
    fn give_up(&mut self) {
        let Some(oldest) = self.waiting.first() else { return };
        let (side, acknowledged) = (oldest.side, oldest.acknowledged);
        let lacks = |side: usize, stream: &Self| {
            let starts = stream.waiting.iter().filter(|it| it.side == side).map(|it| it.start);
            let next = stream.sides[side].next?;
            starts.min_by_key(|&start| ahead(start, next)).filter(|&start| ahead(start, next) > 0)
        };
        if let Some(start) = lacks(side, self) {
            self.skip(side, start);
        } else if let Some(start) = lacks(1 - side, self) {
            self.skip(1 - side, start);
        } else if let Some(seen) = acknowledged {
            self.skip(1 - side, seen);
            let other = &mut self.sides[1 - side];
            other.silent_losses = other.silent_losses.saturating_add(1);
            if other.silent_losses >= DEAF_AFTER {
                other.next = None;
            }
        }
    }

    fn skip(&mut self, side: usize, to: u32) {
        let half = &mut self.sides[side];
        if let Some(next) = half.next {
            half.missing = half.missing.saturating_add(ahead(to, next).max(0) as u32);
        }
        half.next = Some(to);
    }
}

impl Side {
    /// Whether this segment was here before; remembers it.
    fn known(&mut self, it: &Arrival<'_>, start: u32) -> Outcome {
        let this = Fingerprint { start, length: it.length as u32, ident: it.ident.filter(|&id| id != 0), time: it.time };
        let same = |old: &&Fingerprint| (old.start, old.length) == (this.start, this.length);
        let outcome = match self.recent.iter().rfind(same) {
            None => return self.remember(this),
            Some(old) if old.ident.is_some() || this.ident.is_some() => {
                if self.recent.iter().filter(same).any(|old| old.ident == this.ident) {
                    Outcome::Twice
                } else {
                    Outcome::Again
                }
            }
            Some(old) if old.time.zip(this.time).is_some_and(|(old, new)| (new - old).abs() < AT_ONCE) => Outcome::Twice,
            Some(_) => Outcome::Again,
        };
        self.remember(this);
        outcome
    }

    fn remember(&mut self, this: Fingerprint) -> Outcome {
        self.recent[self.newest] = this;
        self.newest = (self.newest + 1) % RECENT;
        Outcome::New
    }
}
