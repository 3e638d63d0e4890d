//! Silences between the bytes of an input, boundaries that no frame crosses, and marks of the receiver.

use super::{Input, Read, NO_TIME};
use crate::records::InnerPauses;
use modlens_protocol::Ns;

/// Where at most one read in so many has several bytes, an adapter passes every byte on at once.
const READS_PER_LATE_READ: u64 = 10;

/// Such an adapter, and the host, make the end of a frame late by so much at most as a matter of course.
const MAX_USUAL_LATENESS_NS: Ns = 20_000_000;

impl Input {
    /// The silence in ns before the byte at this index of the unframed bytes, if a read starts with it and the times of that
    /// read and of the one before are known; else `None`, as for the first byte of all.
    ///
    /// The time that the read's own bytes took on the line is subtracted, where the line settings are known. It is negative
    /// where the clock went back or the reads came closer together than that.
    #[inline]
    pub fn pause_before(&self, index: usize) -> Option<Ns> {
        if self.has_times {
            self.timed_pause_before(index)
        } else {
            None
        }
    }

    /// `pause_before(0)`, where the unframed bytes begin with `first`, the first read, which has a time.
    #[inline]
    pub fn pause_before_read(&self, first: &Read) -> Option<Ns> {
        let duration = (first.end - self.offset) as Ns * self.char_ns.unwrap_or(0);
        Some(first.time - self.time_before_reads? - duration)
    }

    /// `pause_before`, on a line that has times.
    fn timed_pause_before(&self, index: usize) -> Option<Ns> {
        let i = self.read_index(index)?;
        let start = self.read_start(i);
        let previous = if i == 0 { self.time_before_reads? } else { Some(self.reads[i - 1].time).filter(|&t| t != NO_TIME)? };
        let read = &self.reads[i];
        if start != self.offset + index as u64 || read.time == NO_TIME {
            return None;
        }
        Some(read.time - previous - (read.end - start) as Ns * self.char_ns.unwrap_or(0))
    }

    /// The time in ns from the end of the byte in front of the stream offset `place` to the start of the byte at `index`, an
    /// index of the unframed bytes. There may be stray bytes between the two. `place` is not in front of the first unframed
    /// byte. `None` if a time is missing; negative where the clock went back.
    pub fn silence_since(&self, place: u64, index: usize) -> Option<Ns> {
        let char_ns = self.char_ns.unwrap_or(0);
        let before = match (place - self.offset) as usize {
            0 if self.first_read_start == self.offset => self.time_before_reads?,
            0 => self.byte_time(0)? - char_ns,
            first => self.byte_time(first - 1)?,
        };
        Some(self.byte_time(index)? - before - char_ns)
    }

    /// Whether no frame crosses the place before this byte: a record starts here, or a silence of `break_ns` ends here.
    /// After the last byte, whether the input is closed.
    pub fn is_boundary(&self, index: usize) -> bool {
        let Some(i) = self.read_index(index) else { return self.is_closed };
        let ends_silence = || self.pause_before(index).is_some_and(|pause| pause >= self.break_ns);
        self.starts_read(index) && (self.reads[i].starts_record || ends_silence())
    }

    /// The first index in `from + 1..=to` before which there is a silence of at least `least` ns or a record starts. The end
    /// of the bytes that have come is none: what follows there is not known.
    #[inline]
    pub fn boundary_after(&self, from: usize, to: usize, least: Ns) -> Option<usize> {
        let within = |read: &Read| read.end > self.offset + to as u64;
        if self.reads.front().is_some_and(within) {
            return None;
        }
        self.later_boundary(from, to, least)
    }

    /// `boundary_after`, where more than one read has to be looked at.
    fn later_boundary(&self, from: usize, to: usize, least: Ns) -> Option<usize> {
        let mut i = self.read_index(from)?;
        loop {
            let end = (self.reads[i].end - self.offset) as usize;
            i += 1;
            if end > to || i >= self.reads.len() {
                return None;
            }
            if self.reads[i].starts_record || self.pause_before(end).is_some_and(|pause| pause >= least) {
                return Some(end);
            }
        }
    }

    /// The longest silence in ns between two reads inside the indices `from..to`; the one before `from` does not count.
    /// `None` if there is none with known times.
    pub fn longest_pause(&self, from: usize, to: usize) -> Option<Ns> {
        let mut at = from;
        let mut longest = None;
        while let Some(i) = self.read_index(at) {
            at = (self.reads[i].end - self.offset) as usize;
            if at >= to {
                break;
            }
            longest = longest.max(self.pause_before(at));
        }
        longest
    }

    /// The longest silence in ns between two reads of the first `length` bytes that neither adapter nor host can have made: one that
    /// comes late brings the bytes along that were sent meanwhile, except at the end of a frame. So the silence before the last
    /// read does not count, unless it is long and reads bring single bytes as a rule (`MAX_USUAL_LATENESS_NS`); and where the
    /// duration of a character is not known, none before a read of several bytes.
    pub fn longest_sent_pause(&self, length: usize) -> Option<Ns> {
        let last = self.read_index(length - 1)?;
        let comes_bytewise = self.consumed_reads[1] * READS_PER_LATE_READ < self.consumed_reads[0];
        let counts = |i: usize, pause: Ns| {
            let is_single = self.reads[i].end - self.read_start(i) == 1;
            let is_sent = i < last || (comes_bytewise && pause > MAX_USUAL_LATENESS_NS);
            is_single || (self.char_ns.is_some() && is_sent)
        };
        let pause = |i: usize| self.pause_before((self.read_start(i) - self.offset) as usize).filter(|&pause| counts(i, pause));
        (1..=last).filter_map(pause).max()
    }

    /// How many of the first `length` bytes came after their first read, and within which time; `None` if all are in one read,
    /// or if a time is missing.
    pub fn span_of_reads(&self, length: usize) -> Option<(usize, Ns)> {
        let (first, last) = (self.reads.front()?, &self.reads[self.read_index(length - 1)?]);
        let bytes = length - ((first.end - self.offset) as usize).min(length);
        (bytes > 0 && first.time != NO_TIME && last.time != NO_TIME).then(|| (bytes, last.time - first.time))
    }

    /// The silences between the reads of the first `length` bytes, as far as their times are known.
    pub fn pauses_inside(&self, length: usize) -> InnerPauses {
        let mut found = InnerPauses::default();
        if let Some((bytes, lasted)) = self.span_of_reads(length) {
            let reads = self.read_index(length - 1).map_or(0, |last| last as u32 + 1);
            found = InnerPauses { reads, bytes: bytes as u32, lasted, ..found };
        }
        let mut at = 0;
        while let Some(i) = self.read_index(at) {
            at = (self.reads[i].end - self.offset) as usize;
            if at >= length {
                break;
            }
            if let Some(pause) = self.pause_before(at) {
                found = InnerPauses { longest: found.longest.max(pause), count: found.count + 1, ..found };
            }
        }
        found
    }

    /// Counts the silences between the reads of the first `to` bytes, as far as their times are known: those longer than
    /// `least` ns, and all.
    pub fn count_pauses(&self, to: usize, least: Ns) -> (usize, usize) {
        let (mut at, mut longer, mut all) = (0, 0, 0);
        while let Some(i) = self.read_index(at) {
            at = (self.reads[i].end - self.offset) as usize;
            if at >= to {
                break;
            }
            if let Some(pause) = self.pause_before(at) {
                all += 1;
                longer += usize::from(pause > least);
            }
        }
        (longer, all)
    }

    /// Whether the receiver has ever marked line errors or losses on this line.
    #[inline]
    pub fn has_marks(&self) -> bool {
        self.has_marks
    }

    /// Whether the receiver marked a line error in `from..to`: on one of these bytes, or on a read as a whole that holds one.
    pub fn has_line_error(&self, from: usize, to: usize) -> bool {
        let Some(first) = self.read_index(from) else { return false };
        let last = self.read_index(to.saturating_sub(1)).unwrap_or(first);
        (first..=last).any(|i| self.reads[i].has_line_error) || self.count_marked_bytes(from, to) > 0
    }

    /// How many bytes in `from..to` the receiver marked one by one.
    pub fn count_marked_bytes(&self, from: usize, to: usize) -> usize {
        let place = |index: usize| self.offset + index as u64;
        self.marked_bytes.partition_point(|&at| at < place(to)) - self.marked_bytes.partition_point(|&at| at < place(from))
    }

    /// Whether bytes were lost in `from..to`, or before the byte at `from`.
    pub fn has_loss(&self, from: usize, to: usize) -> bool {
        let place = |index: usize| self.offset + index as u64;
        self.losses.iter().any(|&at| at >= place(from) && at < place(to))
    }
}
