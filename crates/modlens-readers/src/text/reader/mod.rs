//! Goes through the lines of a text, with the rows that it needs.

mod others;

use std::collections::VecDeque;
use std::sync::Arc;

use memchr::memchr;

use crate::chunk::Side;
use crate::text::clean::{clean, is_quoted};
use crate::text::clock::{ClockSettings, Kind};
use crate::text::deliver::Deliver;
use crate::text::dialect::{Dialect, Dialects, Role};
use crate::text::evidence;
use crate::text::notation::Notation;
use crate::text::stamp::{delta, Stamps};
use crate::text::template::{Match, Scratch, Template};
use crate::text::Record;
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;

/// Unparsed lines that are kept to be shown.
const SHOWN: usize = 3;

/// Characters of an unparsed line that are kept.
const SHOWN_LENGTH: usize = 120;

/// A line longer than this is given up: it is no text.
const LONGEST_LINE: usize = 1 << 24;

/// Records that one line may hold.
const PER_LINE: usize = 64;

/// What was read and is not delivered: the line, the bytes, why.
pub type LeftOut = (u64, Vec<u8>, &'static str);

/// Reads the text of one recording, in pieces of any size.
#[derive(Debug)]
pub struct Reader {
    dialects: Vec<Arc<Dialect>>,
    /// Rows to try where those in use do not fit.
    others: Option<Arc<Dialects>>,
    tries: u32,
    tries_behind: u32,
    /// The last lines, if nothing could read them.
    unread: VecDeque<(u64, Vec<u8>)>,
    buffer: Vec<u8>,
    at: usize,
    number: u64,
    quoted: bool,
    stamps: Stamps,
    preferred: Option<Notation>,
    bytes: Vec<u8>,
    scratch: Vec<u8>,
    matches: Vec<(Role, Match, usize)>,
    found: Vec<u8>,
    deliver: Deliver,
    /// Lines not understood.
    pub unparsed: u64,
    /// The first of them.
    pub first_unparsed: Vec<(u64, String)>,
}

impl Reader {
    /// A reader for these rows: the first that fits a line reads it. With `others`, these are tried where none fits.
    pub fn new(dialects: Vec<Arc<Dialect>>, others: Option<Arc<Dialects>>, clock: Arc<ClockSettings>) -> Self {
        let mut stamps = Stamps::new(clock);
        stamps.state.short_fractions = dialects.iter().any(|dialect| dialect.short_fractions);
        Self {
            dialects,
            others,
            tries: 0,
            tries_behind: 0,
            unread: VecDeque::new(),
            buffer: Vec::new(),
            at: 0,
            number: 0,
            quoted: false,
            stamps,
            preferred: None,
            bytes: Vec::new(),
            scratch: Vec::new(),
            matches: Vec::new(),
            found: Vec::new(),
            deliver: Deliver::default(),
            unparsed: 0,
            first_unparsed: Vec::new(),
        }
    }

    /// Learns from the first bytes of the text what no single line says: the order of dates, whether it is quoted.
    ///
    /// Gives, for what the log calls sent and received, requests less responses among the frames that can be one only.
    pub fn look_ahead(&mut self, sample: &[u8]) -> [i32; 2] {
        self.quoted = is_quoted(sample);
        self.stamps.look_ahead(sample);
        let mut ahead = Self::new(self.dialects.clone(), None, Arc::default());
        ahead.quoted = self.quoted;
        ahead.push(sample);
        let mut sides = [0i32; 2];
        while let Some((record, bytes)) = ahead.next(false) {
            let Some(side) = record.side else { continue };
            let slot = &mut sides[usize::from(side == Side::Received)];
            *slot = (*slot + evidence::direction_evidence(bytes, record.framing)).clamp(-100, 100);
        }
        sides
    }

    /// Takes more text.
    pub fn push(&mut self, data: &[u8]) {
        if self.at > 0 {
            self.buffer.drain(..self.at);
            self.at = 0;
        }
        self.buffer.extend_from_slice(data);
    }

    /// The next record and its bytes; with `last`, a line without line end is one, too.
    pub fn next(&mut self, last: bool) -> Option<(Record, &[u8])> {
        while self.deliver.is_empty() {
            if !self.line(last) {
                if last {
                    self.deliver.finish(&self.stamps);
                }
                break;
            }
        }
        self.deliver.pop()
    }

    /// Reads one line; false if there is none.
    fn line(&mut self, last: bool) -> bool {
        let rest = &self.buffer[self.at..];
        let (length, skip) = match memchr(b'\n', rest) {
            Some(end) => (end, end + 1),
            None if rest.is_empty() || !(last || rest.len() > LONGEST_LINE) => return false,
            None => (rest.len(), rest.len()),
        };
        self.number += 1;
        let start = self.at;
        self.at += skip;
        let buffer = std::mem::take(&mut self.buffer);
        let mut scratch = std::mem::take(&mut self.scratch);
        let raw = &buffer[start..start + length];
        let line = clean(raw, self.number == 1, self.quoted, &mut scratch);
        self.read(line);
        self.buffer = buffer;
        self.scratch = scratch;
        true
    }

    fn read(&mut self, line: &[u8]) {
        self.deliver.number = self.number;
        let text = line.trim_ascii();
        if text.is_empty() {
            self.deliver.blank_line(&self.stamps);
            return;
        }
        let dialects = std::mem::take(&mut self.dialects);
        // Bytes that a line before announced are those of its row.
        let announced = self.deliver.expects_continuation();
        let first = dialects.iter().filter(|row| announced && row.has_heads);
        let row = first.chain(dialects.iter()).find(|dialect| self.matches_of(dialect, line)).cloned();
        let deltas = dialects.iter().any(|dialect| dialect.deltas);
        self.dialects = dialects;
        if let Some(row) = row {
            // Plain bytes may be what the line before announced.
            let behind = row.generic && self.unread.back().is_some_and(|(number, _)| number + 2 >= self.number);
            if !(behind && self.rows_behind(line)) {
                self.hand_over(&row);
            }
            self.unread.clear();
        } else if !self.another_row(line) && !comment(text) && !self.rows_behind(line) {
            if !deltas {
                self.deliver.end_announcement(&self.stamps);
            }
            self.note_unparsed(text);
        }
        if let Some(delta) = delta(text).filter(|_| deltas) {
            let time = self.stamps.add_delta(delta);
            self.deliver.end_frame_at(time, &self.stamps);
        }
    }

    fn hand_over(&mut self, dialect: &Arc<Dialect>) {
        let matches = std::mem::take(&mut self.matches);
        let mut from = 0;
        for (role, found, end) in &matches {
            self.deliver.take(dialect, *role, found, &self.found[from..*end], &self.stamps);
            from = *end;
        }
        self.matches = matches;
    }

    /// All records that the row finds in the line; false if it cannot read the line to its end.
    fn matches_of(&mut self, dialect: &Dialect, line: &[u8]) -> bool {
        self.matches.clear();
        self.found.clear();
        let (mut from, mut whole) = (0, false);
        let seen = self.stamps.state;
        while from < line.len() && self.matches.len() < PER_LINE {
            let Some((role, mut found, last)) = self.first_rule(dialect, line, from) else { break };
            if role == Role::More
                && dialect.has_heads
                && found.offset.is_none()
                && !self.deliver.expects_continuation()
                && !evidence::is_whole_frame(&self.bytes)
            {
                self.stamps.state = seen;
                return false;
            }
            self.found.extend_from_slice(&self.bytes);
            if let Some((start, end)) = found.key {
                found.key = Some((self.deliver.key(line[start..end].trim_ascii()), 0));
            }
            if found.time.is_none() && found.start > from {
                found.time = self.stamps.find(&line[from..found.start]);
            }
            (from, whole) = (found.end.max(from + 1), last);
            self.matches.push((role, found, self.found.len()));
        }
        let tail = line.get(from..).unwrap_or(&[]);
        let ends = if whole { tail.iter().all(|b| b" \t\r.,;*`_|]}\"'".contains(b)) } else { may_follow(tail) };
        let read = ends && !self.matches.is_empty();
        if !read {
            self.stamps.state = seen;
        }
        read
    }

    /// The match of the first rule without bytes that fits; or else that of bytes which begins first, and of equal ones that
    /// of the first rule. Its bytes are in `self.bytes`.
    fn first_rule(&mut self, dialect: &Dialect, line: &[u8], from: usize) -> Option<(Role, Match, bool)> {
        let starts = &dialect.starts;
        for i in 0..starts.first {
            let found = self.attempt(dialect, i, |template, scratch| template.find(line, from, scratch));
            if found.is_some() {
                return found;
            }
        }
        let mut tied = None;
        for &i in &starts.tied {
            tied = self.attempt(dialect, i, |template, scratch| template.find(line, from, scratch)).map(|found| (i, found));
            if tied.is_some() {
                break;
            }
        }
        let mut at = from;
        while let Some(start) = starts.next(line, at) {
            let before = |i: usize| tied.as_ref().is_none_or(|(rule, (_, found, _))| (start, i) < (found.start, *rule));
            for i in starts.rules(line, start, dialect.rules.len()).take_while(|&i| before(i)) {
                if !dialect.rules[i].1.may_begin(line, start) {
                    continue;
                }
                let found = self.attempt(dialect, i, |template, scratch| template.match_at(line, start, scratch));
                if found.is_some() {
                    return found;
                }
            }
            if !before(0) {
                break;
            }
            at = start + 1;
        }
        let (i, found) = tied?;
        // What was tried behind it may have left other bytes.
        if at > from {
            return self.attempt(dialect, i, |template, scratch| template.find(line, from, scratch));
        }
        Some(found)
    }

    /// Tries a rule; what it learned of the clock is forgotten if it does not fit.
    fn attempt(
        &mut self,
        dialect: &Dialect,
        index: usize,
        find: impl FnOnce(&Template, &mut Scratch<'_>) -> Option<Match>,
    ) -> Option<(Role, Match, bool)> {
        let (role, template) = &dialect.rules[index];
        let seen = self.stamps.state;
        let found = find(template, &mut Scratch::new(&mut self.stamps, &mut self.bytes, &mut self.preferred));
        if found.is_none() {
            self.stamps.state = seen;
        }
        found.map(|found| (*role, found, template.must_reach_line_end))
    }

    fn note_unparsed(&mut self, line: &[u8]) {
        self.note_unparsed_at(self.number, line);
    }

    fn note_unparsed_at(&mut self, number: u64, line: &[u8]) {
        self.unparsed += 1;
        if self.first_unparsed.len() < SHOWN {
            let text: String = String::from_utf8_lossy(line).chars().take(SHOWN_LENGTH).collect();
            self.first_unparsed.push((number, text));
        }
    }

    /// Nothing more comes for a while: what waits for a further line is delivered.
    pub fn settle(&mut self) {
        self.deliver.finish(&self.stamps);
    }

    /// The rows in use.
    pub fn dialects(&self) -> &[Arc<Dialect>] {
        &self.dialects
    }

    /// Lines so far.
    pub fn lines(&self) -> u64 {
        self.number
    }

    /// Records so far.
    pub fn records(&self) -> u64 {
        self.deliver.records
    }

    /// Whether lines that announce bytes have been seen, in case the row in use has such.
    pub fn announced(&self) -> bool {
        self.deliver.announced > 0 || !self.dialects.first().is_some_and(|row| row.has_heads)
    }

    /// How many byte strings were left out, by reason.
    pub fn left_out_counts(&self) -> impl Iterator<Item = (&'static str, u64)> + '_ {
        self.deliver.counts.iter().map(|(reason, count)| (*reason, *count))
    }

    /// The first byte strings that were left out.
    pub fn left_out(&self) -> &[LeftOut] {
        &self.deliver.left_out
    }

    /// The names of devices that the lines have shown; `Record::key` counts them from 1.
    pub fn keys(&self) -> &[Vec<u8>] {
        &self.deliver.keys
    }

    /// The clock, as far as the lines have shown it.
    pub fn clock(&self) -> Clock {
        self.stamps.clock()
    }

    /// What kind of clock it is.
    pub fn clock_kind(&self) -> Kind {
        self.stamps.kind()
    }

    /// The smallest difference that the stamps can express.
    pub fn resolution(&self) -> Option<Ns> {
        self.stamps.resolution()
    }
}

/// Whether this may stand behind bytes: their characters, their number, a mark, nothing.
fn may_follow(tail: &[u8]) -> bool {
    let text = tail.trim_ascii();
    let set_off = tail.len() - tail.trim_ascii_start().len() >= 2 || tail.starts_with(b"\t");
    set_off || text.first().is_none_or(|b| !b.is_ascii() || b"([{|<>\"',.;)]}*#".contains(b))
}

/// A line for people, in files that people made.
fn comment(text: &[u8]) -> bool {
    text.starts_with(b"#") || text.starts_with(b"//") || text.starts_with(b";") || text.starts_with(b"```")
}
