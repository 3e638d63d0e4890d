//! Reads lines that no dialect can read by what checksums prove in them.

use std::sync::Arc;

use crate::chunk::Side;
use crate::text::dialect::Dialect;
use crate::text::frame_evidence;
use crate::text::notation::NotationFlags;
use crate::text::proved::{other_hex, read_frames, Found, Worth};
use crate::text::reader::line_bytes::BESIDE;
use crate::text::reader::rest_of_frame::read_rest;
use crate::text::reader::Reader;
use crate::text::role::LineRole;
use crate::text::template::LineMatch;
use modlens_protocol::Ns;

/// A line has at least so many letters and digits after its bytes, if these hold a further frame.
const MIN_TAIL_CHARS: usize = 10;

/// A number of other meaning is read as at most so many bytes.
const MAX_NUMBER_BYTES: usize = 2;

impl Reader {
    /// Reads what checksums prove in a line that no dialect reads. Returns whether there was anything.
    pub(super) fn read_proved(&mut self, line: &[u8]) -> bool {
        if read_rest(self, line) {
            return true;
        }
        let Some(proved) = &mut self.proved else { return false };
        let all = proved.read(line, self.number);
        if all.is_empty() {
            return false;
        }
        self.use_proved();
        self.deliver_found(line, 0, all);
        true
    }

    /// Reads the frames that are in a line after what a dialect has read of it, which is the text up to `tail`.
    pub(super) fn read_proved_tail(&mut self, line: &[u8], tail: usize) {
        let text = line.get(tail..).unwrap_or(&[]).trim_ascii();
        if text.len() < MIN_TAIL_CHARS || text.iter().filter(|b| b.is_ascii_hexdigit()).count() < MIN_TAIL_CHARS {
            return;
        }
        // A column of characters beside a dump holds no further bytes.
        if self.proved.is_none() || matches!(text[0], b'|' | b'>') {
            return;
        }
        self.read_beside(line, tail);
    }

    /// Reads the frames in a part of a line that a dialect has left, and lists other hex in it. Returns whether there was any.
    fn read_beside(&mut self, line: &[u8], start: usize) -> bool {
        let mut all = read_frames(line, start);
        if !all.iter().any(|one| one.worth == Worth::Frame) {
            all = other_hex(line, start);
        }
        // Programs print the same bytes in two notations: they count once.
        all.retain(|one| one.worth != Worth::LikeFrames && !contains(&self.found, &one.bytes));
        if all.iter().any(|one| one.worth == Worth::Frame) {
            self.use_proved();
        }
        let is_any = !all.is_empty();
        self.deliver_found(line, start, all);
        is_any
    }

    /// Reads the frames that are in a line in front of what a dialect has read of it. Most lines of a log have about the same
    /// number of characters there, so that a longer front alone is worth a look.
    pub(super) fn read_proved_front(&mut self, line: &[u8]) {
        let end = self.matches.first().map_or(0, |(_, found, _)| found.start);
        if self.proved.is_none() || end <= self.plain_front {
            return;
        }
        if !self.read_beside(&line[..end], 0) {
            self.plain_front = end;
        }
    }

    /// Reads the frames of a line instead of the bytes that a dialect of any program has found in it, if these are no frame
    /// and lack one of the frames. Returns whether it did.
    pub(super) fn prefer_proved(&mut self, line: &[u8], row: &Dialect) -> bool {
        if self.proved.is_none() || self.is_time_and_frame(row) || !self.may_lack_something(line) {
            return false;
        }
        let all = read_frames(line, 0);
        let has_number = self.matches.len() > 1 && has_number(&self.matches);
        let is_frame = |one: &Found| one.worth == Worth::Frame;
        let says_more = !self.has_side() && all.iter().any(|one| one.side.is_some());
        let is_better = all.iter().any(|one| is_frame(one) && (has_number || says_more || !contains(&self.found, &one.bytes)));
        if is_better {
            self.use_proved();
            self.deliver_found(line, 0, all);
        }
        is_better
    }

    /// Whether the line is a time and one frame, and nothing else, so that there is nothing to be found in it.
    fn is_time_and_frame(&self, row: &Dialect) -> bool {
        let has_time = matches!(&self.matches[..], [(_, found, _)] if found.time.is_some());
        row.is_plain_hex && has_time && frame_evidence::is_whole_frame(&self.found)
    }

    /// Whether the matches in the line may lack frames of it, or the word in front that says who sent them.
    fn may_lack_something(&self, line: &[u8]) -> bool {
        let first = self.matches.first().map_or(0, |(_, found, _)| found.start);
        let has_words = !self.has_side() && line[..first].iter().any(u8::is_ascii_alphabetic);
        let is_long = |times: usize| is_long(line, times, self.found.len());
        let is_frame = || frame_evidence::is_whole_frame(&self.found);
        self.matches.len() > 1 || has_words || (!self.has_side() && is_long(4)) || (is_long(3) && !is_frame())
    }

    /// Whether the dialect says who sent the bytes.
    fn has_side(&self) -> bool {
        self.matches.iter().any(|(role, found, _)| *role != LineRole::Bytes(None) || found.side.is_some())
    }

    /// Adds the row of this way of reading to those in use.
    fn use_proved(&mut self) {
        if let Some(row) = self.proved_row.clone().filter(|_| !self.dialects.iter().any(|row| row.is_proved)) {
            self.dialects.push(row);
        }
    }

    /// Makes entries of what was found in a line, and in lines before it that were counted as unread.
    fn deliver_found(&mut self, line: &[u8], start: usize, all: Vec<Found>) {
        let all = self.without_expected(line, all);
        let front_end = all.first().filter(|first| first.earlier.is_empty()).map_or(start, |first| first.front.end);
        let mut time = self.timestamps.find(&line[..front_end]).or_else(|| self.prose.time_before(self.number));
        let mut side = None;
        for (i, one) in all.into_iter().enumerate() {
            self.assembler.number = self.number;
            let mut text = line;
            if let Some((number, earlier)) = one.earlier.first() {
                text = earlier;
                time = self.timestamps.find(&text[..one.front.end]);
                self.assembler.number = *number;
            } else if i > 0 {
                time = self.timestamps.find(&line[one.front.clone()]).or(time);
            }
            self.line_bytes.add(&one.bytes);
            for (number, text) in &one.earlier {
                self.unread_lines.remove(*number, text);
            }
            // A list of frames after one word: all of them were sent or received.
            let has_words = text[one.front.clone()].iter().any(u8::is_ascii_alphabetic);
            side = one.side.or(side.filter(|_| !has_words));
            if self.is_quote(text, &one) {
                self.assembler.skip_copy(&one.bytes);
                continue;
            }
            let said = side.or_else(|| self.side_of_label());
            self.deliver_one(&one, said, time);
            if side.is_none() && said.is_some() && one.worth != Worth::Beside {
                self.use_label(&one.bytes);
            }
        }
        self.assembler.number = self.number;
    }

    /// Whether a sentence of this text may quote its frames, so that they are remembered.
    pub(super) fn may_be_quoted(&self) -> bool {
        self.proved.as_ref().is_some_and(|proved| proved.has_single())
    }

    /// Whether a sentence quotes bytes of a frame that was read before, or the next line says the same and who sent it.
    fn is_quote(&self, line: &[u8], one: &Found) -> bool {
        let (Some(proved), Some(shape)) = (self.proved.as_deref(), one.shape) else { return false };
        one.worth != Worth::Beside
            && (proved.is_told_again(shape) || (proved.is_single(shape) && self.prose.may_quote(line, &one.bytes)))
    }

    /// Makes an entry of bytes, unless they were printed before.
    fn deliver_one(&mut self, one: &Found, side: Option<Side>, time: Option<Ns>) {
        let Some(row) = self.proved_row.as_ref().map(Arc::clone) else { return };
        let voice = Some(one.shape.unwrap_or(0));
        let is_other_voice = self.voices.last != voice;
        if one.worth == Worth::Beside && self.assembler.has_printed(&one.bytes) {
            self.assembler.skip_copy(&one.bytes);
        } else if one.worth == Worth::Beside {
            self.assembler.skip(self.assembler.number, &one.bytes, BESIDE);
        } else if one.worth == Worth::Frame && is_other_voice && self.voices.repeats(voice, &one.bytes, side, &self.assembler) {
            self.assembler.skip_copy(&one.bytes);
            self.voices.repeats = true;
        } else {
            let flags = NotationFlags { no_checksum: one.lacks_checksum };
            let found = LineMatch { time, side, flags, ..LineMatch::default() };
            self.assembler.take(&row, LineRole::Bytes(side), &found, &one.bytes, &self.timestamps);
            self.voices.note(voice);
            if self.may_be_quoted() {
                self.prose.remember(&one.bytes);
            }
        }
    }
}

/// Whether one of the matches in a line is so short that it may be a number of other meaning, such as a counter.
fn has_number(matches: &[(LineRole, LineMatch, usize)]) -> bool {
    let starts = std::iter::once(0).chain(matches.iter().map(|(_, _, end)| *end));
    matches.iter().zip(starts).any(|((_, _, end), start)| end - start <= MAX_NUMBER_BYTES)
}

/// Whether a line has more than so many characters for each of `length` bytes, and some more.
pub(super) fn is_long(line: &[u8], times: usize, length: usize) -> bool {
    line.len() > times * length + MIN_TAIL_CHARS
}

/// Whether `bytes` stand anywhere in `all`.
fn contains(all: &[u8], bytes: &[u8]) -> bool {
    memchr::memmem::find(all, bytes).is_some()
}
