//! What people write about a log beside it: frames quoted in a sentence, and a time on a line of its own.

use std::collections::VecDeque;

use crate::text::date::time_of_day;
use modlens_protocol::Ns;

/// A line with so many words is a sentence.
const MIN_SENTENCE_WORDS: usize = 8;

/// So many frames are remembered, because a sentence may quote them.
const MAX_REMEMBERED: usize = 64;

/// A line with a time and nothing else has at most so many letters and characters.
const MAX_LABEL_LETTERS: usize = 16;
const MAX_TIME_LINE_CHARS: usize = 64;

/// A line that begins with a time, and has bytes below it, has at most so many characters.
const MAX_STAMPED_CHARS: usize = 120;

/// The fewest digits of a time of day with seconds.
const MIN_TIME_DIGITS: usize = 6;

/// The bytes to which such a line belongs are at most so many lines after it.
const MAX_LINES_TO_BYTES: u64 = 2;

/// What lines without bytes have said, and which frames were read.
#[derive(Debug, Default)]
pub(super) struct Prose {
    frames: VecDeque<Vec<u8>>,
    /// The last line that was a time: its number, and the time.
    time: Option<(u64, Ns)>,
}

impl Prose {
    /// Remembers a frame.
    pub fn remember(&mut self, bytes: &[u8]) {
        if self.frames.iter().any(|frame| frame == bytes) {
            return;
        }
        if self.frames.len() == MAX_REMEMBERED {
            self.frames.pop_front();
        }
        self.frames.push_back(bytes.to_vec());
    }

    /// Whether the line is a sentence with bytes with which a frame begins that was read before.
    pub fn may_quote(&self, line: &[u8], bytes: &[u8]) -> bool {
        is_sentence(line) && self.frames.iter().any(|frame| frame.starts_with(bytes))
    }

    /// Remembers the time of line `number`, which states nothing else.
    pub fn note_time(&mut self, number: u64, time: Option<Ns>) {
        self.time = time.map(|time| (number, time));
    }

    /// The time that a line right before line `number` states.
    pub fn time_before(&self, number: u64) -> Option<Ns> {
        self.time.filter(|(stated, _)| stated + MAX_LINES_TO_BYTES >= number).map(|(_, time)| time)
    }

    /// The same, which is then used up.
    pub fn take_time_before(&mut self, number: u64) -> Option<Ns> {
        let time = self.time_before(number)?;
        self.time = None;
        Some(time)
    }
}

/// Whether the line is a sentence rather than what a program prints.
pub(super) fn is_sentence(line: &[u8]) -> bool {
    let words = line.split(|b| !b.is_ascii_alphabetic());
    let words = words.filter(|word| word.len() > 1 && word[1..].iter().all(u8::is_ascii_lowercase));
    words.take(MIN_SENTENCE_WORDS).count() == MIN_SENTENCE_WORDS
}

/// Whether a line begins with a time of day in brackets, as a program prints it in front of words, and of bytes below them.
fn begins_with_time(text: &[u8]) -> bool {
    let inner = text.strip_prefix(b"[");
    text.len() <= MAX_STAMPED_CHARS && inner.is_some_and(|text| time_of_day(text).is_some())
}

/// Whether a line may hold a time, a name for it, and nothing else.
pub(super) fn may_be_time(text: &[u8]) -> bool {
    let count = |is: fn(&u8) -> bool| text.iter().filter(|b| is(b)).count();
    begins_with_time(text)
        || text.len() <= MAX_TIME_LINE_CHARS
            && text.contains(&b':')
            && count(u8::is_ascii_alphabetic) <= MAX_LABEL_LETTERS
            && count(u8::is_ascii_digit) >= MIN_TIME_DIGITS
}
