//! What is between the bytes of an input and on them: pauses, places that no frame crosses, marks of the receiver.

use super::{Input, Read, NO_TIME};
use modlens_protocol::Ns;

impl Input {
    /// The silence between the byte and the one before, where a read starts with it and both times are known.
    ///
    /// Time that the read's own bytes took on the line is taken off, where the line settings are known.
    pub fn pause_before(&self, index: usize) -> Option<Ns> {
        let i = self.read_of(index)?;
        let start = self.read_start(i);
        let previous = if i == 0 { self.before? } else { Some(self.reads[i - 1].time).filter(|&t| t != NO_TIME)? };
        let read = &self.reads[i];
        if start != self.offset + index as u64 || read.time == NO_TIME {
            return None;
        }
        Some(read.time - previous - (read.end - start) as Ns * self.char_ns.unwrap_or(0))
    }

    /// The silence between the byte and the end of what stood in front of this stream offset, strays between them or not.
    pub fn quiet_since(&self, place: u64, index: usize) -> Option<Ns> {
        let char_ns = self.char_ns.unwrap_or(0);
        let before = match (place - self.offset) as usize {
            0 if self.front_start == self.offset => self.before?,
            0 => self.byte_time(0)? - char_ns,
            first => self.byte_time(first - 1)?,
        };
        Some(self.byte_time(index)? - before - char_ns)
    }

    /// Whether no frame reaches across the place before this byte: a record starts here, or a long silence ended.
    pub fn hard_edge(&self, index: usize) -> bool {
        let Some(i) = self.read_of(index) else { return self.closed };
        self.starts_read(index) && (self.reads[i].record || self.pause_before(index).is_some_and(|pause| pause >= self.break_ns))
    }

    /// The first place from `from` + 1 to `to` where a pause of at least `least` or a record's start stands.
    #[inline]
    pub fn edge_after(&self, from: usize, to: usize, least: Ns) -> Option<usize> {
        let within = |read: &Read| read.end > self.offset + to as u64;
        if self.reads.front().is_some_and(within) {
            return None;
        }
        self.later_edge(from, to, least)
    }

    fn later_edge(&self, from: usize, to: usize, least: Ns) -> Option<usize> {
        let mut i = self.read_of(from)?;
        loop {
            let end = (self.reads[i].end - self.offset) as usize;
            i += 1;
            if end > to || i >= self.reads.len() {
                return None;
            }
            if self.reads[i].record || self.pause_before(end).is_some_and(|pause| pause >= least) {
                return Some(end);
            }
        }
    }

    /// The longest pause between bytes of `from..to`.
    pub fn longest_pause(&self, from: usize, to: usize) -> Option<Ns> {
        let mut at = from;
        let mut longest = None;
        while let Some(i) = self.read_of(at) {
            at = (self.reads[i].end - self.offset) as usize;
            if at >= to {
                break;
            }
            longest = longest.max(self.pause_before(at));
        }
        longest
    }

    /// Of the pauses between the reads of the first `to` bytes: how many are longer than `least`, and how many there are.
    pub fn later_reads(&self, to: usize, least: Ns) -> (usize, usize) {
        let (mut at, mut later, mut all) = (0, 0, 0);
        while let Some(i) = self.read_of(at) {
            at = (self.reads[i].end - self.offset) as usize;
            if at >= to {
                break;
            }
            if let Some(pause) = self.pause_before(at) {
                all += 1;
                later += usize::from(pause > least);
            }
        }
        (later, all)
    }

    /// Whether the receiver has marked anything on this line: errors, or bytes that were lost.
    #[inline]
    pub fn marked(&self) -> bool {
        self.marked
    }

    /// Whether the receiver marked a line error in `from..to`.
    pub fn line_error(&self, from: usize, to: usize) -> bool {
        let Some(first) = self.read_of(from) else { return false };
        let last = self.read_of(to.saturating_sub(1)).unwrap_or(first);
        (first..=last).any(|i| self.reads[i].line_error) || self.errors_in(from, to) > 0
    }

    /// How many bytes of `from..to` the receiver marked one by one.
    pub fn errors_in(&self, from: usize, to: usize) -> usize {
        let place = |index: usize| self.offset + index as u64;
        self.errors.partition_point(|&at| at < place(to)) - self.errors.partition_point(|&at| at < place(from))
    }

    /// Whether bytes were lost in `from..to`, or before the byte at `from`.
    pub fn hole(&self, from: usize, to: usize) -> bool {
        let place = |index: usize| self.offset + index as u64;
        self.holes.iter().any(|&at| at >= place(from) && at < place(to))
    }
}
