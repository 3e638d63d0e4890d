//! From matches to records: where one begins, which pieces belong together, what was printed before.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use crate::chunk::Side;
use crate::text::dialect::{Dialect, Role, Wrap};
use crate::text::evidence::closed;
use crate::text::reader::LeftOut;
use crate::text::stamp::Stamps;
use crate::text::template::Match;
use crate::text::{unwrap, Record};
use modlens_protocol::checksum::crc_valid;
use modlens_protocol::Ns;

/// A star in a dump stands for as many lines as the offsets say; more than this is a hole.
const REPEAT_LIMIT: u64 = 1 << 24;

/// Byte strings left out that are kept to be listed.
const LISTED: usize = 1000;

/// Bytes of a frame in pieces that are kept to see its checksum close.
const GROUP_LIMIT: usize = 1024;

const COPY: &str = "bytes that the program printed before";

/// One stream of pieces: that of a device whose lines carry its name, or of all.
#[derive(Debug, Default)]
struct Join {
    side: Option<Side>,
    /// The record before ended with what closes a frame, or there was none.
    open: bool,
    /// The pieces since the last place where a frame could begin.
    group: Vec<u8>,
}

/// What a line announced about the bytes behind it.
#[derive(Clone, Copy, Debug)]
struct Head {
    side: Option<Side>,
    time: Option<Ns>,
    key: usize,
    copies: bool,
}

/// Where a dump goes on.
#[derive(Debug, Default)]
struct Dump {
    expected: Option<u64>,
    last: Vec<u8>,
    /// Scratch: the lines that a star stands for, and the one behind it.
    all: Vec<u8>,
    repeat: bool,
}

/// What a record is made of, before it is one.
struct Piece<'a> {
    bytes: &'a [u8],
    side: Option<Side>,
    time: Option<Ns>,
    key: usize,
    line: u8,
    number: u64,
    no_checksum: bool,
}

/// The records that are ready, and what the next ones depend on.
#[derive(Debug, Default)]
pub(super) struct Deliver {
    ready: VecDeque<(Record, usize, usize)>,
    arena: Vec<u8>,
    joins: Vec<Join>,
    head: Option<Head>,
    /// Lines of a frame that is printed over several, up to the next head.
    gathered: Option<(Arc<Dialect>, Head, Vec<u8>, u64)>,
    dump: Dump,
    /// The last line of a dump in words, until the next offset says how long it was.
    held: Option<(Record, Vec<u8>, u64)>,
    generic: bool,
    pub keys: Vec<Vec<u8>>,
    pub left_out: Vec<LeftOut>,
    pub counts: BTreeMap<&'static str, u64>,
    pub records: u64,
    /// Lines that announced bytes: heads, and offsets of dumps.
    pub announced: u64,
    pub number: u64,
}

impl Deliver {
    pub fn is_empty(&self) -> bool {
        self.ready.is_empty()
    }

    pub fn pop(&mut self) -> Option<(Record, &[u8])> {
        let (record, start, end) = self.ready.pop_front()?;
        Some((record, &self.arena[start..end]))
    }

    /// Whether a head waits for its bytes.
    pub fn expects_more(&self) -> bool {
        self.head.is_some()
    }

    /// The number of a device's name.
    pub fn key(&mut self, name: &[u8]) -> usize {
        let at = self.keys.iter().position(|known| known == name);
        at.unwrap_or_else(|| {
            self.keys.push(name.to_vec());
            self.keys.len() - 1
        }) + 1
    }

    pub fn take(&mut self, dialect: &Arc<Dialect>, role: Role, found: &Match, bytes: &[u8], stamps: &Stamps) {
        self.end_held(found.offset, stamps);
        let key = found.key.map_or(0, |(key, _)| key);
        match role {
            Role::Skip => {}
            Role::Repeat => self.dump.repeat = true,
            Role::Copy => self.leave_out(self.number, bytes, COPY),
            Role::Head(_) | Role::HeadOfCopies => {
                self.end_gathered(stamps);
                self.announced += 1;
                let side = if let Role::Head(side) = role { side } else { None };
                self.head = Some(Head { side, time: found.time, key, copies: role == Role::HeadOfCopies });
            }
            Role::More => self.more(dialect, found, bytes, stamps),
            Role::Again if self.joins.get(key).is_some_and(|join| join.group.ends_with(bytes)) => {
                self.leave_out(self.number, bytes, COPY);
            }
            Role::Again => self.piece(dialect, found, bytes, Some(Side::Received), found.time, key, stamps),
            Role::Bytes(side) => self.piece(dialect, found, bytes, found.side.or(side), found.time, key, stamps),
        }
    }

    fn more(&mut self, dialect: &Arc<Dialect>, found: &Match, bytes: &[u8], stamps: &Stamps) {
        self.announced += u64::from(found.offset.is_some());
        let head = self.head.unwrap_or(Head { side: None, time: found.time, key: 0, copies: false });
        if head.copies {
            self.leave_out(self.number, bytes, COPY);
        } else if dialect.joined {
            if found.offset == Some(0) {
                self.end_gathered(stamps);
            }
            let number = self.number;
            let gathered = self.gathered.get_or_insert_with(|| (Arc::clone(dialect), head, Vec::new(), number));
            if gathered.2.len() + bytes.len() <= 1 << 16 {
                gathered.2.extend_from_slice(bytes);
            }
        } else {
            let time = found.time.or(head.time);
            self.piece(dialect, found, bytes, head.side, time, head.key, stamps);
        }
    }

    #[allow(clippy::too_many_arguments)] // What a head and a line say together.
    fn piece(
        &mut self,
        dialect: &Dialect,
        found: &Match,
        bytes: &[u8],
        side: Option<Side>,
        time: Option<Ns>,
        key: usize,
        stamps: &Stamps,
    ) {
        self.generic = dialect.generic;
        let no_checksum = dialect.no_checksum || found.marks.no_checksum;
        let piece = Piece { bytes, side, time, key, line: found.line, number: self.number, no_checksum };
        if dialect.stream {
            self.dump_line(&piece, found, stamps);
        } else if dialect.wrap == Some(Wrap::Solarman) {
            match unwrap::solarman(bytes) {
                Ok(inner) => {
                    self.leave_out(self.number, bytes, "Solarman V5 wrapper of a frame");
                    self.record(&Piece { bytes: &bytes[inner], ..piece }, stamps);
                }
                Err(reason) => self.leave_out(self.number, bytes, reason),
            }
        } else {
            self.record(&piece, stamps);
        }
    }

    fn record(&mut self, piece: &Piece<'_>, stamps: &Stamps) {
        if piece.bytes.is_empty() {
            return;
        }
        while self.joins.len() <= piece.key {
            self.joins.push(Join::default());
        }
        let join = &mut self.joins[piece.key];
        let (closed, framing) = closed(piece.bytes);
        let no_checksum = piece.no_checksum && !closed;
        let edge = closed || no_checksum || !join.open || join.side != piece.side;
        if edge || join.group.len() + piece.bytes.len() > GROUP_LIMIT {
            join.group.clear();
        }
        join.group.extend_from_slice(piece.bytes);
        join.open = !(closed || no_checksum || (!edge && crc_valid(&join.group)));
        join.side = piece.side;
        let record = Record {
            time: piece.time,
            side: piece.side,
            line: piece.line,
            record: edge,
            no_checksum,
            framing,
            key: piece.key,
            number: piece.number,
            ..Record::default()
        };
        self.push(record, piece.bytes, stamps);
    }

    /// A line of an endless stream: only offsets say what belongs together.
    fn dump_line(&mut self, piece: &Piece<'_>, found: &Match, stamps: &Stamps) {
        let plain = Record { side: piece.side, line: piece.line, time: piece.time, number: piece.number, ..Record::default() };
        let Some(offset) = found.offset else { return self.push(plain, piece.bytes, stamps) };
        let mut hole = false;
        let mut all = std::mem::take(&mut self.dump.all);
        all.clear();
        if let Some(expected) = self.dump.expected.filter(|_| offset != 0) {
            let missing = offset.saturating_sub(expected);
            let filled = self.dump.repeat && missing <= REPEAT_LIMIT && !self.dump.last.is_empty();
            if filled {
                all.extend(self.dump.last.iter().copied().cycle().take(missing as usize));
            }
            hole = expected != offset && !filled;
        }
        self.dump.repeat = false;
        self.dump.last.clear();
        self.dump.last.extend_from_slice(piece.bytes);
        self.dump.expected = Some(offset + piece.bytes.len() as u64);
        all.extend_from_slice(piece.bytes);
        let record = Record { record: offset == 0, hole, ..plain };
        if found.pads {
            self.held = Some((record, all, offset + piece.bytes.len() as u64));
        } else {
            self.push(record, &all, stamps);
            self.dump.all = all;
        }
    }

    fn end_held(&mut self, offset: Option<u64>, stamps: &Stamps) {
        let Some((record, mut bytes, end)) = self.held.take() else { return };
        if offset.is_some_and(|offset| offset + 1 == end) {
            bytes.pop();
        }
        self.push(record, &bytes, stamps);
        self.dump.all = bytes;
    }

    /// The record that is gathered is whole, and came then.
    pub fn stamp(&mut self, time: Ns, stamps: &Stamps) {
        if let Some((_, head, _, _)) = &mut self.gathered {
            head.time = head.time.or(Some(time));
        }
        self.end_gathered(stamps);
    }

    fn end_gathered(&mut self, stamps: &Stamps) {
        let Some((dialect, head, bytes, number)) = self.gathered.take() else { return };
        let inner = match dialect.wrap {
            Some(Wrap::Network) => match unwrap::network(&bytes) {
                Ok(inner) => inner,
                Err(reason) => return self.leave_out(number, &bytes, reason),
            },
            _ => 0..bytes.len(),
        };
        let no_checksum = dialect.no_checksum;
        let piece = Piece { bytes: &bytes[inner], side: head.side, time: head.time, key: head.key, line: 0, number, no_checksum };
        self.record(&piece, stamps);
    }

    /// A line that is no record: what a head announced is over.
    pub fn end_of_head(&mut self, stamps: &Stamps) {
        self.end_held(None, stamps);
        self.end_gathered(stamps);
        self.head = None;
    }

    /// In text that people set, a blank line parts frames.
    pub fn blank_line(&mut self, stamps: &Stamps) {
        self.end_gathered(stamps);
        if self.generic {
            for join in &mut self.joins {
                join.open = false;
            }
        }
    }

    pub fn finish(&mut self, stamps: &Stamps) {
        self.end_held(None, stamps);
        self.end_gathered(stamps);
    }

    fn leave_out(&mut self, number: u64, bytes: &[u8], reason: &'static str) {
        *self.counts.entry(reason).or_default() += 1;
        if self.left_out.len() < LISTED {
            self.left_out.push((number, bytes.to_vec(), reason));
        }
    }

    fn push(&mut self, record: Record, bytes: &[u8], stamps: &Stamps) {
        if self.ready.is_empty() {
            self.arena.clear();
        }
        let start = self.arena.len();
        self.arena.extend_from_slice(bytes);
        self.records += 1;
        self.ready.push_back((Record { clock: stamps.clock(), ..record }, start, self.arena.len()));
    }
}
