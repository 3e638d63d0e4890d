//! The bytes of one line that are not framed yet, and the reads they came in.

mod pauses;

use std::collections::VecDeque;

use modlens_protocol::framing::{Mode, MAX_RTU_FRAME_BYTES};
use modlens_protocol::Ns;
use modlens_readers::chunk::{Chunk, Side, Times};

/// The time of a read without a clock.
pub const NO_TIME: Ns = Ns::MIN;

/// Framed bytes that the buffer keeps before it is compacted.
const MAX_CONSUMED_BYTES: usize = 1 << 16;

/// One read of the source, or one record of a recording.
#[derive(Clone, Copy, Debug)]
pub struct Read {
    /// Stream offset of the byte after its last one.
    pub end: u64,
    /// When its last byte had arrived, or `NO_TIME`.
    pub time: Ns,
    /// Line or packet number in the recording.
    pub origin: u64,
    /// The recording's word for who sent it.
    pub side: Option<Side>,
    /// It starts a record of the recording: no frame reaches across its beginning.
    pub starts_record: bool,
    /// The receiver marked a line error somewhere in it.
    pub has_line_error: bool,
    /// Its frames come without checksum.
    pub lacks_checksum: bool,
    /// The framing that it proves by itself, as a line of a log may.
    pub proven_framing: Option<Mode>,
}

/// The bytes of one line from the first unframed one on, with their times and marks.
#[derive(Debug, Default)]
pub struct Input {
    /// The unframed bytes, and in front of them some that are framed already.
    buffer: Vec<u8>,
    /// Index in `buffer` of the first unframed byte.
    head: usize,
    /// Stream offset of the first unframed byte.
    offset: u64,
    /// The reads of the unframed bytes, the oldest first.
    reads: VecDeque<Read>,
    /// Stream offset at which the first of `reads` began.
    first_read_start: u64,
    /// Time of the last read in front of `reads`.
    time_before_reads: Option<Ns>,
    /// Duration of a character, where the line settings are known.
    pub char_ns: Option<Ns>,
    /// A silence of this length ends every frame.
    pub break_ns: Ns,
    /// The line was silent for `break_ns`: complete frames are released. Incomplete ones may go on, since the adapter may
    /// hold bytes back.
    pub is_paused: bool,
    /// The line was silent for so long that the adapter holds nothing back, or the input has ended: all bytes are
    /// released.
    pub is_closed: bool,
    /// The end of the recording was signalled. Like the two above, this is reset by a further `push`.
    pub is_ended: bool,
    /// Stream offsets of bytes that the receiver marked one by one.
    marked_bytes: VecDeque<u64>,
    /// Stream offsets before which bytes were lost.
    losses: VecDeque<u64>,
    /// A read with a time had more than one byte: the times are those of reads, not of bytes.
    pub has_multibyte_reads: bool,
    /// Reads of consumed bytes, and those of them that had more than one byte.
    consumed_reads: [u64; 2],
    /// A read had a time.
    pub has_times: bool,
    /// Bytes had times of their own, as only a serial line gives them.
    pub has_byte_times: bool,
    /// Bytes of the longest read that had a time.
    longest_read_bytes: usize,
    /// The receiver has marked line errors or losses.
    has_marks: bool,
}

impl Input {
    /// An empty input of a line with this character time.
    pub fn new(char_ns: Option<Ns>) -> Self {
        Self { char_ns, ..Self::default() }
    }

    /// Says which offset the first byte will have; the input is empty.
    pub fn begin_at(&mut self, offset: u64) {
        (self.offset, self.first_read_start) = (offset, offset);
    }

    /// Whether a chunk can be appended without changing how the bytes before it are decided: it has no marks, and times (or
    /// none) like the reads so far. It must not be the first timed read of several bytes, nor have a time for each byte.
    #[inline]
    pub fn is_uniform_with(&self, chunk: &Chunk<'_>) -> bool {
        let timed = matches!(chunk.times, Times::Read(_));
        let plain = !chunk.follows_loss
            && !chunk.has_line_error
            && chunk.error_positions.is_empty()
            && !matches!(chunk.times, Times::Bytes(_));
        plain && timed == self.has_times && (self.has_multibyte_reads || !timed || chunk.bytes.len() < 2)
    }

    /// Appends the bytes of a chunk, with its marks and times; a chunk without bytes changes nothing, even if it has marks.
    ///
    /// What silence or the end of the input had released is held back again, and `consumed_bytes` are gone.
    #[inline]
    pub fn push(&mut self, chunk: &Chunk<'_>) {
        if chunk.bytes.is_empty() {
            return;
        }
        (self.is_paused, self.is_closed, self.is_ended) = (false, false, false);
        if self.head > 0 && (self.head >= self.buffer.len() || self.head > MAX_CONSUMED_BYTES) {
            self.buffer.drain(..self.head);
            self.head = 0;
        }
        if chunk.follows_loss || chunk.has_line_error || !chunk.error_positions.is_empty() {
            self.push_marks(chunk);
        }
        self.buffer.extend_from_slice(chunk.bytes);
        self.push_reads(chunk);
    }

    /// Keeps the stream offsets of the marks of a chunk that has some, whose bytes will be appended.
    fn push_marks(&mut self, chunk: &Chunk<'_>) {
        let start = self.end();
        self.has_marks = true;
        if chunk.follows_loss {
            self.losses.push_back(start);
        }
        self.marked_bytes.extend(chunk.error_positions.iter().map(|&at| start + u64::from(at)));
    }

    /// Appends the reads of a chunk whose bytes have been appended: one, or one for each byte that has a time of its own, with
    /// a last one for the bytes that lack theirs. The first byte's read starts a record if the chunk does or if bytes were lost
    /// before it; the others start none.
    #[inline]
    fn push_reads(&mut self, chunk: &Chunk<'_>) {
        let end = self.end();
        let starts_record = chunk.starts_record || chunk.follows_loss;
        self.has_times |= !matches!(chunk.times, Times::None);
        match chunk.times {
            Times::None => self.push_read(read_of(chunk, end, NO_TIME, starts_record)),
            Times::Read(time) => {
                self.has_multibyte_reads |= chunk.bytes.len() > 1;
                self.longest_read_bytes = self.longest_read_bytes.max(chunk.bytes.len());
                self.push_read(read_of(chunk, end, time, starts_record));
            }
            Times::Bytes(times) => {
                self.has_byte_times = true;
                let first = end - chunk.bytes.len() as u64;
                for (i, &time) in times.iter().take(chunk.bytes.len()).enumerate() {
                    self.push_read(read_of(chunk, first + i as u64 + 1, time, i == 0 && starts_record));
                }
                if times.len() < chunk.bytes.len() {
                    self.push_read(read_of(chunk, end, NO_TIME, times.is_empty() && starts_record));
                }
            }
        }
    }

    /// Appends a read. It is merged with the last one if neither has a time, it starts no record, and place, side and marks
    /// are the same, so that a file without times is one long read, whatever the size of its blocks.
    #[inline]
    fn push_read(&mut self, mut read: Read) {
        if let Some(last) = self.reads.back_mut() {
            let same = last.time == NO_TIME && read.time == NO_TIME && !read.starts_record && last.origin == read.origin;
            if same
                && last.side == read.side
                && last.has_line_error == read.has_line_error
                && last.lacks_checksum == read.lacks_checksum
            {
                last.end = read.end;
                return;
            }
        }
        // A record without checksum is exactly one frame, so no frame reaches across its ends.
        read.starts_record |= read.lacks_checksum || self.reads.back().is_some_and(|last| last.lacks_checksum);
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

    /// Time of the last byte, framed or not. Where its read has no time, it is that of the last framed read that had one.
    pub fn last_byte_time(&self) -> Option<Ns> {
        self.reads.back().map(|read| read.time).filter(|&time| time != NO_TIME).or(self.time_before_reads)
    }

    /// How long an adapter may hold bytes back: as long as the longest read takes on the line, since it may fill a packet
    /// of that size. 0 for single bytes.
    pub fn max_held_back_ns(&self) -> Ns {
        if self.longest_read_bytes < 2 {
            return 0;
        }
        self.longest_read_bytes.min(MAX_RTU_FRAME_BYTES) as Ns * self.char_ns.unwrap_or(0)
    }

    /// Lets time advance to `now` without further bytes: sets `is_paused` and `is_closed` where the silence since the last
    /// byte is long enough. Without times it does nothing.
    pub fn advance_time(&mut self, now: Ns) {
        if let Some(silence) = self.last_byte_time().map(|last| now - last) {
            self.is_paused |= silence >= self.break_ns;
            self.is_closed |= silence >= self.break_ns + self.max_held_back_ns();
        }
    }

    /// When silence releases something next: when it sets `is_paused`, or after that `is_closed`. `None` without unframed
    /// bytes, without times, or when all is released.
    pub fn deadline(&self) -> Option<Ns> {
        let is_waiting = !self.is_closed && !self.bytes().is_empty();
        let held_back = if self.is_paused { self.max_held_back_ns() } else { 0 };
        self.last_byte_time().filter(|_| is_waiting).map(|last| last + self.break_ns + held_back)
    }

    /// The last `length` bytes that were consumed. They are kept until the next `push`.
    pub fn consumed_bytes(&self, length: usize) -> &[u8] {
        &self.buffer[self.head - length..self.head]
    }

    /// Removes the first `length` bytes, which are framed, and the reads and marks that lie in front of the rest. The bytes
    /// stay in the buffer until the next `push`.
    #[inline(always)]
    #[allow(clippy::inline_always)] // Called for every frame, with hardly more to do than a call.
    pub fn consume(&mut self, length: usize) {
        self.head += length;
        self.offset += length as u64;
        while let Some(first) = self.reads.front().filter(|first| first.end <= self.offset) {
            if first.time != NO_TIME {
                self.time_before_reads = Some(first.time);
            }
            let is_multibyte = first.end - self.first_read_start > 1;
            self.consumed_reads = [self.consumed_reads[0] + 1, self.consumed_reads[1] + u64::from(is_multibyte)];
            self.first_read_start = first.end;
            self.reads.pop_front();
        }
        if self.has_marks {
            self.drop_consumed_marks();
        }
    }

    /// Whether packets may be passed by (`pass`): none is here, and those before them had times and several bytes, as all of a
    /// connection and lines of a log do, and no marks.
    pub fn takes_messages(&self) -> bool {
        self.reads.is_empty() && self.has_times && self.has_multibyte_reads && !self.has_marks
    }

    /// What `push` and `consume` do with packets, of which the last one has this time and ends at this stream offset and the
    /// longest one has so many bytes, where `takes_messages` holds. Their bytes are no `consumed_bytes`.
    pub fn pass(&mut self, end: u64, time: Ns, longest: usize) {
        (self.is_paused, self.is_closed, self.is_ended) = (false, false, false);
        self.longest_read_bytes = self.longest_read_bytes.max(longest);
        (self.offset, self.first_read_start) = (end, end);
        self.time_before_reads = Some(time);
    }

    /// Removes marks in front of the first unframed byte.
    fn drop_consumed_marks(&mut self) {
        for places in [&mut self.marked_bytes, &mut self.losses] {
            while places.front().is_some_and(|&at| at < self.offset) {
                places.pop_front();
            }
        }
    }

    /// The index in `reads` of the read that holds the byte.
    #[inline]
    fn read_index(&self, index: usize) -> Option<usize> {
        let at = self.offset + index as u64;
        // The first read is by far the most frequent case.
        if self.reads.front().is_some_and(|read| at < read.end) {
            return Some(0);
        }
        let i = self.reads.partition_point(|read| read.end <= at);
        (i < self.reads.len()).then_some(i)
    }

    /// The read that holds the first unframed byte.
    #[inline]
    pub fn first_read(&self) -> Option<&Read> {
        self.reads.front()
    }

    /// The first read, if it is exactly the first `length` unframed bytes.
    #[inline]
    pub fn whole_read(&self, length: usize) -> Option<&Read> {
        let is_whole = |read: &&Read| self.first_read_start == self.offset && read.end == self.offset + length as u64;
        self.reads.front().filter(is_whole)
    }

    /// Whether all unframed bytes are in one read, whose beginning is framed already, and none on this line had a time.
    #[inline]
    pub fn is_one_untimed_read(&self) -> bool {
        !self.has_times && self.reads.len() == 1 && self.first_read_start < self.offset
    }

    /// Whether a request of `request_bytes` and a response of `response_bytes` are at the head in reads that cannot change
    /// how they are decided: both in one read without times and side (other bytes may follow in it), or exactly in a read
    /// each, the second one less than `within` ns after the first, or both without times. Neither read may lack checksums or
    /// prove another framing than `mode`, and the receiver must never have marked anything on this line.
    #[inline]
    pub fn holds_exchange(&self, mode: Mode, request_bytes: usize, response_bytes: usize, within: Ns) -> bool {
        let is_plain = |read: &Read| !read.lacks_checksum && read.proven_framing.is_none_or(|proven| proven == mode);
        let Some(first) = self.reads.front().filter(|read| is_plain(read) && !self.has_marks) else { return false };
        let request_end = self.offset + request_bytes as u64;
        let response_end = request_end + response_bytes as u64;
        if first.end >= response_end {
            return !self.has_times && first.side.is_none();
        }
        let second = self.reads.get(1).filter(|read| is_plain(read) && read.end == response_end);
        let is_timely = |second: &Read| match (first.time, second.time) {
            (NO_TIME, NO_TIME) => !self.has_times,
            (NO_TIME, _) | (_, NO_TIME) => false,
            (request_time, response_time) => response_time - request_time < within,
        };
        first.end == request_end && self.first_read_start == self.offset && second.is_some_and(is_timely)
    }

    /// How many of the unframed bytes are in one read without time, side and marks, in which exchanges of this framing are
    /// decided by their bytes alone, as `holds_exchange` reports about each of them; 0 if the first read is none.
    pub fn plain_untimed_bytes(&self, mode: Mode) -> usize {
        let is_plain = |read: &&Read| {
            let proves_no_other = read.proven_framing.is_none_or(|proven| proven == mode);
            !self.has_marks && !self.has_times && read.side.is_none() && !read.lacks_checksum && proves_no_other
        };
        self.reads.front().filter(is_plain).map_or(0, |read| (read.end - self.offset) as usize)
    }

    /// The read that holds the byte.
    pub fn read(&self, index: usize) -> Option<&Read> {
        self.reads.get(self.read_index(index)?)
    }

    /// The places in the recording of the reads that hold neither the first nor the last of the first `length` bytes.
    pub fn inner_read_origins(&self, length: usize) -> impl Iterator<Item = u64> + '_ {
        let last = self.read_index(length - 1).unwrap_or(0);
        self.reads.iter().take(last).skip(1).map(|read| read.origin)
    }

    /// When the byte at this index of the unframed bytes had arrived, at the end of its stop bit. The time of a read is that
    /// of its last byte, from which the others are counted back; all have the same time where the line settings are not
    /// known.
    pub fn byte_time(&self, index: usize) -> Option<Ns> {
        let read = self.read(index)?;
        if read.time == NO_TIME {
            return None;
        }
        let bytes_behind = (read.end - 1 - (self.offset + index as u64)) as Ns;
        Some(read.time - bytes_behind * self.char_ns.unwrap_or(0))
    }

    /// How many bytes its read has from the byte on, the byte included.
    pub fn bytes_left_in_read(&self, index: usize) -> usize {
        self.read(index).map_or(0, |read| (read.end - self.offset) as usize - index)
    }

    /// Whether the byte is the first of a read.
    #[inline]
    pub fn starts_read(&self, index: usize) -> bool {
        self.read_index(index).is_some_and(|i| self.read_start(i) == self.offset + index as u64)
    }

    /// Stream offset at which the read of this index in `reads` begins.
    #[inline]
    fn read_start(&self, i: usize) -> u64 {
        if i == 0 {
            self.first_read_start
        } else {
            self.reads[i - 1].end
        }
    }
}

/// A read of bytes of a chunk that ends at stream offset `end`, with what the chunk reports about all of them.
#[inline]
fn read_of(chunk: &Chunk<'_>, end: u64, time: Ns, starts_record: bool) -> Read {
    Read {
        end,
        time,
        starts_record,
        origin: chunk.origin,
        side: chunk.side,
        has_line_error: chunk.has_line_error,
        lacks_checksum: chunk.lacks_checksum,
        proven_framing: chunk.proven_framing,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timed(bytes: &[u8], time: Ns) -> Chunk<'_> {
        Chunk { bytes, times: Times::Read(time), ..Chunk::default() }
    }

    #[test]
    fn a_pause_does_not_include_the_duration_of_the_bytes_behind_it() {
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
    fn marks_and_losses_stay_with_their_bytes() {
        let mut input = Input::default();
        input.push(&Chunk { bytes: &[1, 2, 3], error_positions: &[1], ..Chunk::default() });
        input.push(&Chunk { bytes: &[4, 5], follows_loss: true, ..Chunk::default() });
        assert_eq!((input.count_marked_bytes(0, 1), input.count_marked_bytes(0, 3), input.has_line_error(2, 5)), (0, 1, false));
        assert_eq!((input.has_loss(0, 3), input.has_loss(0, 4), input.has_loss(3, 5)), (false, true, true));
        input.consume(3);
        assert_eq!((input.has_line_error(0, 2), input.has_loss(0, 1)), (false, true));
        input.consume(1);
        assert!(!input.has_loss(0, 1));
    }

    #[test]
    fn a_record_starts_with_its_first_byte_also_where_its_times_are_missing() {
        let mut input = Input::default();
        input.push(&Chunk { bytes: &[1, 2], times: Times::Bytes(&[1_000, 2_000]), ..Chunk::default() });
        input.push(&Chunk { bytes: &[3, 4], times: Times::Bytes(&[]), follows_loss: true, ..Chunk::default() });
        assert_eq!(input.read(2).map(|read| read.starts_record), Some(true));
    }

    #[test]
    fn blocks_of_a_file_without_times_are_one_read() {
        let mut input = Input::default();
        for byte in 0..100u8 {
            input.push(&Chunk { bytes: &[byte], ..Chunk::default() });
        }
        assert_eq!(input.reads.len(), 1);
        assert_eq!(input.boundary_after(0, 100, 1), None);
    }
}
