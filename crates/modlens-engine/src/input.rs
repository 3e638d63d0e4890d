//! Bytes that are not framed yet, and the reads they came in.

mod pauses;

use std::collections::VecDeque;

use modlens_protocol::framing::{Mode, MAX_RTU_FRAME_BYTES};
use modlens_protocol::Ns;
use modlens_readers::chunk::{Chunk, Side, Times};

/// No clock.
pub const NO_TIME: Ns = Ns::MIN;

/// One read of the source, or one record of a recording.
#[derive(Clone, Copy, Debug)]
pub struct Read {
    /// Stream offset behind its last byte.
    pub end: u64,
    /// When its last byte had come, or `NO_TIME`.
    pub time: Ns,
    /// Line or packet number in the file.
    pub origin: u64,
    /// Who sent it, where the recording says so.
    pub side: Option<Side>,
    /// Whether it starts a record.
    pub record: bool,
    /// Whether the receiver marked a line error in it.
    pub line_error: bool,
    /// Whether its frames come without checksum.
    pub no_checksum: bool,
    /// The framing that it proves by itself.
    pub framing: Option<Mode>,
}

/// The bytes of one line from the first unframed one on.
#[derive(Debug, Default)]
pub struct Input {
    buffer: Vec<u8>,
    head: usize,
    /// Stream offset of the first unframed byte.
    offset: u64,
    reads: VecDeque<Read>,
    /// Stream offset at which the first read kept began.
    front_start: u64,
    /// Time of the last byte before the first read kept.
    before: Option<Ns>,
    /// Character time, where the line settings are known.
    pub char_ns: Option<Ns>,
    /// A silence of this length ends every frame.
    pub break_ns: Ns,
    /// Silence has ended every frame that is whole; of others, the tap's adapter may hold the rest back.
    pub paused: bool,
    /// The recording is over, or silence has lasted: nothing more belongs to the bytes that are here.
    pub closed: bool,
    /// Only the end of the recording closes this for good.
    pub ended: bool,
    /// Stream offsets of bytes that the receiver marked one by one.
    errors: VecDeque<u64>,
    /// Stream offsets before which bytes were lost.
    holes: VecDeque<u64>,
    /// Whether any read had more than one byte: then times are those of reads, not of bytes.
    pub coarse: bool,
    /// Whether any read had a time.
    pub timed: bool,
    /// Bytes of the longest read that had a time.
    longest: usize,
    /// Whether the receiver has marked anything.
    marked: bool,
}

impl Input {
    /// An empty input of a line with this character time.
    pub fn new(char_ns: Option<Ns>) -> Self {
        Self { char_ns, ..Self::default() }
    }

    /// An empty input whose first byte will have this offset.
    #[cfg(test)]
    pub fn at(offset: u64) -> Self {
        Self { offset, front_start: offset, ..Self::default() }
    }

    /// Whether a chunk changes nothing of how the bytes before it are looked at.
    pub fn takes_alike(&self, chunk: &Chunk<'_>) -> bool {
        let timed = matches!(chunk.times, Times::Read(_));
        let plain = !chunk.follows_loss
            && !chunk.has_line_error
            && chunk.error_positions.is_empty()
            && !matches!(chunk.times, Times::Bytes(_));
        plain && timed == self.timed && (self.coarse || !timed || chunk.bytes.len() < 2)
    }

    /// Takes the bytes of a chunk.
    pub fn push(&mut self, chunk: &Chunk<'_>) {
        if chunk.bytes.is_empty() {
            return;
        }
        (self.paused, self.closed, self.ended) = (false, false, false);
        if self.head > 0 && (self.head >= self.buffer.len() || self.head > 1 << 16) {
            self.buffer.drain(..self.head);
            self.head = 0;
        }
        self.marked |= chunk.follows_loss || chunk.has_line_error || !chunk.error_positions.is_empty();
        if chunk.follows_loss {
            self.holes.push_back(self.end());
        }
        let begin = self.end();
        self.errors.extend(chunk.error_positions.iter().map(|&at| begin + u64::from(at)));
        self.buffer.extend_from_slice(chunk.bytes);
        let end = self.end();
        let read = |end: u64, time: Ns, record: bool| Read {
            end,
            time,
            record,
            origin: chunk.origin,
            side: chunk.side,
            line_error: chunk.has_line_error,
            no_checksum: chunk.lacks_checksum,
            framing: chunk.proven_framing,
        };
        match chunk.times {
            Times::None => self.push_read(read(end, NO_TIME, chunk.starts_record || chunk.follows_loss)),
            Times::Read(time) => {
                self.timed = true;
                self.coarse |= chunk.bytes.len() > 1;
                self.longest = self.longest.max(chunk.bytes.len());
                self.push_read(read(end, time, chunk.starts_record || chunk.follows_loss));
            }
            Times::Bytes(times) => {
                self.timed = true;
                let first = end - chunk.bytes.len() as u64;
                for (i, &time) in times.iter().take(chunk.bytes.len()).enumerate() {
                    self.push_read(read(first + i as u64 + 1, time, i == 0 && (chunk.starts_record || chunk.follows_loss)));
                }
                if times.len() < chunk.bytes.len() {
                    self.push_read(read(end, NO_TIME, false));
                }
            }
        }
    }

    fn push_read(&mut self, mut read: Read) {
        // Reads that nothing tells apart are one: a file in blocks of any size is one long read.
        if let Some(last) = self.reads.back_mut() {
            let same = last.time == NO_TIME && read.time == NO_TIME && !read.record && last.origin == read.origin;
            if same && last.side == read.side && last.line_error == read.line_error && last.no_checksum == read.no_checksum {
                last.end = read.end;
                return;
            }
        }
        // What comes without checksum is a frame as it is: no other reaches into it.
        read.record |= read.no_checksum || self.reads.back().is_some_and(|last| last.no_checksum);
        self.reads.push_back(read);
    }

    /// The unframed bytes.
    #[inline]
    pub fn bytes(&self) -> &[u8] {
        &self.buffer[self.head..]
    }

    /// Stream offset of the first unframed byte.
    #[inline]
    pub fn offset(&self) -> u64 {
        self.offset
    }

    fn end(&self) -> u64 {
        self.offset + (self.buffer.len() - self.head) as u64
    }

    /// Time of the newest byte.
    pub fn newest(&self) -> Option<Ns> {
        self.reads.back().map(|read| read.time).filter(|&time| time != NO_TIME).or(self.before)
    }

    /// For so long no byte has to be seen while bytes are on the line: an adapter that fills packets holds back what a
    /// packet takes.
    pub fn unseen_ns(&self) -> Ns {
        if self.longest < 2 {
            return 0;
        }
        self.longest.min(MAX_RTU_FRAME_BYTES) as Ns * self.char_ns.unwrap_or(0)
    }

    /// Time has come to `now` without more bytes.
    pub fn wait(&mut self, now: Ns) {
        if let Some(silence) = self.newest().map(|newest| now - newest) {
            self.paused |= silence >= self.break_ns;
            self.closed |= silence >= self.break_ns + self.unseen_ns();
        }
    }

    /// When silence ends something next.
    pub fn deadline(&self) -> Option<Ns> {
        let waiting = !self.closed && !self.bytes().is_empty();
        let unseen = if self.paused { self.unseen_ns() } else { 0 };
        self.newest().filter(|_| waiting).map(|newest| newest + self.break_ns + unseen)
    }

    /// The last so many bytes that were forgotten since the last `push`.
    pub fn forgotten(&self, length: usize) -> &[u8] {
        &self.buffer[self.head - length..self.head]
    }

    /// Forgets the first `length` bytes: they are framed.
    #[inline]
    pub fn consume(&mut self, length: usize) {
        self.head += length;
        self.offset += length as u64;
        if self.reads.front().is_none_or(|first| first.end > self.offset) && self.errors.is_empty() && self.holes.is_empty() {
            return;
        }
        self.forget();
    }

    /// Forgets reads and marks in front of the first byte.
    fn forget(&mut self) {
        while let Some(first) = self.reads.front() {
            if first.end > self.offset {
                break;
            }
            if first.time != NO_TIME {
                self.before = Some(first.time);
            }
            self.front_start = first.end;
            self.reads.pop_front();
        }
        for places in [&mut self.errors, &mut self.holes] {
            while places.front().is_some_and(|&at| at < self.offset) {
                places.pop_front();
            }
        }
    }

    #[inline]
    fn read_of(&self, index: usize) -> Option<usize> {
        let at = self.offset + index as u64;
        // Nearly all questions are about the first read.
        if self.reads.front().is_some_and(|read| at < read.end) {
            return Some(0);
        }
        let i = self.reads.partition_point(|read| read.end <= at);
        (i < self.reads.len()).then_some(i)
    }

    /// The read that holds the first byte.
    #[inline]
    pub fn first_read(&self) -> Option<&Read> {
        self.reads.front()
    }

    /// Whether the first `asked` bytes and the `answered` ones behind them came in one read that says nothing of them, or
    /// in a read each, the second one within this time.
    #[inline]
    pub fn holds_exchange(&self, mode: Mode, asked: usize, answered: usize, within: Ns) -> bool {
        let plain = |read: &Read| !read.no_checksum && read.framing.is_none_or(|proven| proven == mode);
        let Some(first) = self.reads.front().filter(|read| plain(read) && !self.marked) else { return false };
        let (middle, end) = (self.offset + asked as u64, self.offset + (asked + answered) as u64);
        if first.end >= end {
            return !self.timed && first.side.is_none();
        }
        let second = self.reads.get(1).filter(|read| plain(read) && read.end == end);
        let timely = |second: &Read| match (first.time, second.time) {
            (NO_TIME, NO_TIME) => !self.timed,
            (NO_TIME, _) | (_, NO_TIME) => false,
            (before, after) => after - before < within,
        };
        first.end == middle && self.front_start == self.offset && second.is_some_and(timely)
    }

    /// When the first bytes came, if they are just one packet, and when the next one did.
    pub fn packet(&self, length: usize) -> Option<(Ns, Option<Ns>)> {
        let first = self.reads.front().filter(|_| !self.marked && self.front_start == self.offset)?;
        let whole = first.end == self.offset + length as u64 && !first.no_checksum && first.framing.is_none();
        let next = self.reads.get(1).map(|read| read.time);
        (whole && first.time != NO_TIME).then_some((first.time, next))
    }

    /// The read that holds the byte.
    pub fn read(&self, index: usize) -> Option<&Read> {
        self.reads.get(self.read_of(index)?)
    }

    /// Where the reads stand that hold neither the first nor the last of the first `length` bytes.
    pub fn between(&self, length: usize) -> impl Iterator<Item = u64> + '_ {
        let last = self.read_of(length - 1).unwrap_or(0);
        self.reads.iter().take(last).skip(1).map(|read| read.origin)
    }

    /// When the byte had come: its stop bit, as far as the read's time tells.
    pub fn byte_time(&self, index: usize) -> Option<Ns> {
        let read = self.read(index)?;
        if read.time == NO_TIME {
            return None;
        }
        let behind = (read.end - 1 - (self.offset + index as u64)) as Ns;
        Some(read.time - behind * self.char_ns.unwrap_or(0))
    }

    /// So many bytes of its read stand from the byte on, with it.
    pub fn rest_of_read(&self, index: usize) -> usize {
        self.read(index).map_or(0, |read| (read.end - self.offset) as usize - index)
    }

    /// Whether the byte is the first of a read.
    #[inline]
    pub fn starts_read(&self, index: usize) -> bool {
        self.read_of(index).is_some_and(|i| self.read_start(i) == self.offset + index as u64)
    }

    #[inline]
    fn read_start(&self, i: usize) -> u64 {
        if i == 0 {
            self.front_start
        } else {
            self.reads[i - 1].end
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timed(bytes: &[u8], time: Ns) -> Chunk<'_> {
        Chunk { bytes, times: Times::Read(time), ..Chunk::default() }
    }

    #[test]
    fn pauses_leave_out_the_bytes_own_time() {
        let mut input = Input { char_ns: Some(1000), break_ns: 1_000_000, ..Input::default() };
        input.push(&timed(&[1, 2], 10_000));
        input.push(&timed(&[3, 4, 5], 20_000));
        assert_eq!(input.pause_before(2), Some(7_000));
        assert_eq!(input.pause_before(3), None);
        assert_eq!(input.byte_time(3), Some(19_000));
        input.consume(2);
        assert_eq!(input.pause_before(0), Some(7_000));
        input.consume(1);
        assert_eq!((input.offset(), input.bytes()), (3, &[4u8, 5][..]));
        assert_eq!(input.pause_before(0), None, "the middle of a read has no pause before it");
    }

    #[test]
    fn marks_and_holes_stay_with_their_bytes() {
        let mut input = Input::default();
        input.push(&Chunk { bytes: &[1, 2, 3], error_positions: &[1], ..Chunk::default() });
        input.push(&Chunk { bytes: &[4, 5], follows_loss: true, ..Chunk::default() });
        assert_eq!((input.errors_in(0, 1), input.errors_in(0, 3), input.line_error(2, 5)), (0, 1, false));
        assert_eq!((input.hole(0, 3), input.hole(0, 4), input.hole(3, 5)), (false, true, true));
        input.consume(3);
        assert_eq!((input.line_error(0, 2), input.hole(0, 1)), (false, true));
        input.consume(1);
        assert!(!input.hole(0, 1));
    }

    #[test]
    fn blocks_of_a_file_are_one_read() {
        let mut input = Input::default();
        for byte in 0..100u8 {
            input.push(&Chunk { bytes: &[byte], ..Chunk::default() });
        }
        assert_eq!(input.reads.len(), 1);
        assert_eq!(input.edge_after(0, 100, 1), None);
    }
}
