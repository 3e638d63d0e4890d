//! Reads a text line by line with the dialects that it needs.

mod announcements;
mod counts;
mod delivery;
mod deltas;
mod expectation;
mod fallback;
mod label;
mod labelled;
mod line_bytes;
mod look_ahead;
mod matching;
mod prose;
mod proved_lines;
mod regular_lines;
mod rest;
mod rest_of_frame;
mod unread_lines;
mod voices;
mod wrapped;

use std::collections::VecDeque;
use std::sync::Arc;

use memchr::{memchr, memrchr3};

use crate::text::clean::clean;
use crate::text::clock::{ClockKind, ClockSettings};
use crate::text::dialect::{Dialect, Dialects};
use crate::text::encapsulation::LOGGER_REFUSES;
use crate::text::entries::{EntryAssembler, SkippedBytes};
use crate::text::notation::Notation;
use crate::text::proved::{hex_bytes, ProvedHex};
use crate::text::reports::Said;
use crate::text::role::LineRole;
use crate::text::template::LineMatch;
use crate::text::timestamps::TimestampParser;
use crate::text::LogEntry;
use announcements::Expectation;
use deltas::Runs;
use label::Label;
use line_bytes::LineBytes;
pub(super) use look_ahead::Marks;
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;
use prose::{may_be_time, Prose};
pub use unread_lines::UnreadLines;
use voices::Voices;
use wrapped::WrappedLines;

/// A longer line is read in blocks of at most so many bytes, so that a dump without any line end takes no more memory than
/// one with line ends.
const MAX_LINE_BYTES: usize = 1 << 20;

/// A block of a long line ends at a space or comma if there is one in its last bytes.
const PIECE_END_BYTES: usize = 4096;

/// What is said of such an answer.
const LOGGER_SAYS: &str =
    "the data logger answers a request by itself, without Modbus: the serial number that the program sends is not that of \
                           the logger, or the logger does not reach the device";

/// Room for the bytes of a line, and some more, which the check of their CRC may read.
const FRAME_ROOM: usize = 368;

/// What the short way (`regular_lines`) makes of the next line.
enum NextLine {
    /// It has read the line.
    Entry(LogEntry),
    /// It has read the line, whose frame the log had printed before.
    Printed,
    /// Nothing: the line is not regular, or not there as a whole. The general way has to read it.
    Irregular,
}

/// Reads the text of one recording, which may arrive in blocks of any size.
#[derive(Debug)]
pub struct Reader {
    dialects: Vec<Arc<Dialect>>,
    /// Rows to try where those in `dialects` do not fit a line.
    others: Option<Arc<Dialects>>,
    /// How many single lines have been tried with other rows.
    single_line_tries: u32,
    /// How many lines have been tried with other rows together with the lines before them.
    unread_line_tries: u32,
    /// The last lines, with their numbers, if no row in use could read them.
    unread: VecDeque<(u64, Vec<u8>)>,
    /// Text that has arrived; from `at` on it is still to be read.
    buffer: Vec<u8>,
    at: usize,
    /// Number of the last line, from 1.
    number: u64,
    /// The last line was too long, and what follows is more of it.
    is_continued: bool,
    /// Most lines begin with mail quotes.
    is_quoted_mail: bool,
    /// The text has bytes in angle brackets, as libmodbus prints received ones.
    has_angles: bool,
    timestamps: TimestampParser,
    /// The notation that gave the last valid checksum, of a template with several.
    preferred: Option<Notation>,
    /// Bytes of the last match.
    bytes: Vec<u8>,
    /// Reused memory for a line without its decoration.
    scratch: Vec<u8>,
    /// All matches in the current line, each with the end of its bytes in `found`.
    matches: Vec<(LineRole, LineMatch, usize)>,
    /// Bytes of all matches in the current line.
    found: Vec<u8>,
    /// Where the last match in the current line ends.
    tail: usize,
    assembler: EntryAssembler,
    /// The row that stands for bytes which checksums prove, and what finds them; `None` where other rows were named.
    proved_row: Option<Arc<Dialect>>,
    proved: Option<Box<ProvedHex>>,
    voices: Voices,
    /// In front of bytes that a dialect has read, so many characters held no frame.
    plain_front: usize,
    unread_lines: UnreadLines,
    line_bytes: LineBytes,
    wrapped: WrappedLines,
    prose: Prose,
    /// The last line that may be a label for the bytes below it.
    label: Option<Label>,
    expectation: Expectation,
    runs: Runs,
    /// The next line may be a regular one.
    expects_regular_lines: bool,
    /// All lines are read in the general way; only tests ask for that.
    is_general: bool,
    /// The bytes of a regular line, and some of lines before.
    frame: Box<[u8; FRAME_ROOM]>,
    /// How many bytes the last regular line has, if its entry is the last one that was returned; else 0.
    frame_length: usize,
}

/// What the lines of a text that nothing could read show, or else an answer that a data logger gave by itself; `None` if neither is
/// there.
pub fn unread_says(reader: &Reader) -> Option<Said> {
    let refuses = || reader.skipped_counts().any(|(reason, ..)| reason == LOGGER_REFUSES);
    reader.unread_lines.says().or_else(|| refuses().then(|| Said::from(LOGGER_SAYS.to_owned())))
}

impl Reader {
    /// A reader with these rows, of which the first that fits a line reads it. Where none fits, the rows of `others` are
    /// tried, and a row that fits is used from there on.
    pub fn new(dialects: Vec<Arc<Dialect>>, others: Option<Arc<Dialects>>, clock: Arc<ClockSettings>) -> Self {
        let mut timestamps = TimestampParser::new(clock);
        timestamps.state.short_fractions = dialects.iter().any(|dialect| dialect.may_have_short_fractions);
        let named = dialects.iter().find(|row| row.is_proved);
        let proved_row = named.or_else(|| others.as_ref()?.proved_row()).cloned();
        Self {
            dialects,
            others,
            single_line_tries: 0,
            unread_line_tries: 0,
            unread: VecDeque::new(),
            buffer: Vec::new(),
            at: 0,
            number: 0,
            is_continued: false,
            is_quoted_mail: false,
            has_angles: true,
            timestamps,
            preferred: None,
            bytes: Vec::new(),
            scratch: Vec::new(),
            matches: Vec::new(),
            found: Vec::new(),
            tail: 0,
            assembler: EntryAssembler::default(),
            proved: proved_row.is_some().then(Box::default),
            proved_row,
            voices: Voices::default(),
            plain_front: 0,
            unread_lines: UnreadLines::default(),
            line_bytes: LineBytes::default(),
            wrapped: WrappedLines::default(),
            prose: Prose::default(),
            label: None,
            expectation: Expectation::default(),
            runs: Runs::default(),
            expects_regular_lines: false,
            is_general: false,
            frame: Box::new([0; FRAME_ROOM]),
            frame_length: 0,
        }
    }

    /// A reader with these rows alone, of whose unread lines only the number is asked for.
    pub(super) fn to_count(dialects: Vec<Arc<Dialect>>) -> Self {
        Self { unread_lines: UnreadLines::only_counted(), ..Self::new(dialects, None, Arc::default()) }
    }

    /// Appends text.
    pub fn push(&mut self, data: &[u8]) {
        if self.at > 0 {
            self.buffer.drain(..self.at);
            self.at = 0;
        }
        self.buffer.extend_from_slice(data);
    }

    /// The next entry and its bytes; `None` if more text is needed. `is_last` says that the text has ended, so that a last
    /// line without line end is read and nothing waits for a further line.
    pub fn next(&mut self, is_last: bool) -> Option<(LogEntry, &[u8])> {
        let entry = self.advance(is_last)?;
        Some((entry, self.entry_bytes()))
    }

    /// The next entry, as `next` gives it; `entry_bytes` has its bytes.
    #[inline]
    pub fn advance(&mut self, is_last: bool) -> Option<LogEntry> {
        while self.assembler.is_empty() {
            if self.expects_regular_lines {
                match self.read_regular_line() {
                    NextLine::Entry(entry) => return Some(entry),
                    NextLine::Printed => continue,
                    NextLine::Irregular => {}
                }
            }
            if !self.read_next_line(is_last) {
                if is_last {
                    self.assembler.finish(&self.timestamps);
                }
                break;
            }
        }
        self.frame_length = 0;
        self.assembler.pop()
    }

    /// The bytes of the entry that `advance` gave last.
    #[inline]
    pub fn entry_bytes(&self) -> &[u8] {
        match self.frame_length {
            0 => self.assembler.popped(),
            length => &self.frame[..length],
        }
    }

    /// Reads the next line of the buffer, or a block of a long one; returns false if there is no whole line.
    fn read_next_line(&mut self, is_last: bool) -> bool {
        let rest = &self.buffer[self.at..];
        let (length, skip) = match memchr(b'\n', &rest[..rest.len().min(MAX_LINE_BYTES)]) {
            Some(end) => (end, end + 1),
            None if rest.len() > MAX_LINE_BYTES => {
                let piece = piece_of_line(&rest[..MAX_LINE_BYTES]);
                (piece, piece)
            }
            None if rest.is_empty() || !is_last => return false,
            None => (rest.len(), rest.len()),
        };
        self.number += u64::from(!self.is_continued);
        self.is_continued = length == skip;
        let start = self.at;
        self.at += skip;
        let buffer = std::mem::take(&mut self.buffer);
        let mut scratch = std::mem::take(&mut self.scratch);
        let raw = &buffer[start..start + length];
        let line = clean(raw, self.number == 1, self.is_quoted_mail, &mut scratch);
        self.read_line(line);
        self.buffer = buffer;
        self.scratch = scratch;
        true
    }

    /// Hands a line to the first row that can read it: the rows in use, then other rows, then other rows together with
    /// the lines before. A line that nothing reads is counted, unless it is a comment without hex.
    fn read_line(&mut self, line: &[u8]) {
        self.assembler.number = self.number;
        self.expects_regular_lines = false;
        let text = line.trim_ascii();
        if text.is_empty() {
            self.assembler.blank_line(&self.timestamps);
            return;
        }
        let dialects = std::mem::take(&mut self.dialects);
        // Bytes that a header line announced belong to the dialect of that line, so dialects with headers come first.
        let is_announced = self.assembler.expects_continuation();
        let with_headers = dialects.iter().filter(|row| is_announced && row.has_headers);
        let row = with_headers.chain(dialects.iter()).find(|dialect| self.collect_matches(dialect, line)).cloned();
        let has_deltas = dialects.iter().any(|dialect| dialect.has_deltas);
        self.dialects = dialects;
        if let Some(row) = row {
            // Plain bytes right after an unread line may be what that line announced in a dialect not in use yet.
            let may_be_announced = row.generic && self.unread.back().is_some_and(|(number, _)| number + 2 >= self.number);
            let is_read_with_others = may_be_announced && self.read_with_unread_lines(line);
            if !(is_read_with_others || row.generic && self.prefer_proved(line, &row) || self.leave_out_expected(line)) {
                self.let_words_decide(line, &row);
                self.read_proved_front(line);
                self.deliver_matches(&row);
                self.read_proved_tail(line, self.tail);
            }
            self.unread.clear();
            if self.matches.iter().all(|(role, ..)| *role == LineRole::Ignored) {
                self.note_label(text);
                // The last line of a dump has its length; another number of so many digits may be bytes.
                let offset = self.matches.first().and_then(|(_, found, _)| found.offset);
                if offset.is_some_and(|offset| !self.assembler.ends_dump_at(offset)) {
                    self.note_unparsed(text);
                }
            }
            // A label that has not named the bytes of this line names none.
            self.label = self.label.take().filter(|label| label.number == self.number);
            self.expects_regular_lines =
                !self.is_general && !self.expectation.leaves_out(self.number) && self.may_expect_regular_lines(&row);
        } else if !self.read_with_another_dialect(line)
            && (is_comment(text) || !self.read_with_unread_lines(line))
            && !self.read_proved(line)
        {
            self.leave_unread(text, has_deltas);
        }
        self.list_rest(line);
        if let Some(time) = has_deltas.then(|| self.runs.time(text, &mut self.timestamps)).flatten() {
            self.assembler.end_frame_at(time, &self.timestamps);
        }
    }

    /// Counts a line that nothing reads. A comment counts only if it holds hex, and ends nothing that was announced.
    fn leave_unread(&mut self, text: &[u8], has_deltas: bool) {
        self.note_label(text);
        if has_deltas {
            self.runs.note(text);
        }
        if is_comment(text) && hex_bytes(text) == 0 {
            return;
        }
        if !is_comment(text) {
            self.expectation.note(self.number, text);
        }
        if !has_deltas && !is_comment(text) {
            self.assembler.end_announcement(&self.timestamps);
        }
        if self.proved.is_some() && may_be_time(text) {
            let time = self.timestamps.find(text);
            self.prose.note_time(self.number, time);
        }
        self.note_unparsed(text);
        if self.proved.is_some() && self.assembler.has_begun(self.wrapped.count()) {
            self.wrapped.note(self.number, text);
        }
    }

    /// Counts the current line as unparsed.
    fn note_unparsed(&mut self, line: &[u8]) {
        self.note_unparsed_at(self.number, line);
    }

    /// Counts the line of this number as unparsed.
    fn note_unparsed_at(&mut self, number: u64, line: &[u8]) {
        self.unread_lines.add(number, line, self.assembler.frame_before(number).unwrap_or_default());
    }

    /// Whether only the number of unread lines is asked for, to see how well the rows fit a text.
    fn is_counting(&self) -> bool {
        self.unread_lines.only_counts()
    }

    /// The lines that nothing could read.
    pub fn unread_lines(&self) -> &UnreadLines {
        &self.unread_lines
    }

    /// Delivers what waits for a further line, because none is expected for a while.
    pub fn settle(&mut self) {
        self.assembler.finish(&self.timestamps);
    }

    /// The dialects in use.
    pub fn dialects(&self) -> &[Arc<Dialect>] {
        &self.dialects
    }

    /// The number of lines read so far.
    pub fn lines(&self) -> u64 {
        self.number
    }

    /// The number of entries delivered so far.
    pub fn records(&self) -> u64 {
        self.assembler.records
    }

    /// How many requests that were printed without checksum are followed by a response that fits, of how many.
    pub(super) fn exchanges(&self) -> (usize, usize) {
        self.proved.as_ref().map_or((0, 0), |proved| proved.exchanges())
    }

    /// False if the first dialect in use has header lines and the text has shown none of them, so that its bytes may be of
    /// another dialect.
    pub fn has_announced_bytes(&self) -> bool {
        self.assembler.announced > 0 || !self.dialects.first().is_some_and(|row| row.has_headers)
    }

    /// How many byte strings were skipped, and how many bytes they hold, by reason.
    pub fn skipped_counts(&self) -> impl Iterator<Item = (&'static str, u64, u64)> + '_ {
        self.assembler.counts.iter().map(|(reason, (count, bytes))| (*reason, *count, *bytes))
    }

    /// The first byte strings that were skipped.
    pub fn skipped(&self) -> &[SkippedBytes] {
        &self.assembler.skipped
    }

    /// The names of devices found in the lines; `LogEntry::key` counts them from 1.
    pub fn keys(&self) -> &[Vec<u8>] {
        &self.assembler.keys
    }

    /// What the timestamps so far show the clock to be, as the engine needs to know it.
    pub fn clock(&self) -> Clock {
        self.timestamps.clock()
    }

    /// What the timestamps so far refer to, as messages say.
    pub fn clock_kind(&self) -> ClockKind {
        self.timestamps.kind()
    }

    /// The smallest time difference in ns that the timestamps can express; `None` without timestamps.
    #[inline]
    pub fn resolution(&self) -> Option<Ns> {
        self.timestamps.resolution()
    }
}

/// How much of the beginning of a line to read at once: up to a space or comma near its end, and not half of two hex digits.
fn piece_of_line(beginning: &[u8]) -> usize {
    let tail = beginning.len().saturating_sub(PIECE_END_BYTES);
    if let Some(at) = memrchr3(b' ', b'\t', b',', &beginning[tail..]) {
        return tail + at + 1;
    }
    let digits = beginning.iter().rev().take_while(|byte| byte.is_ascii_hexdigit()).count();
    beginning.len() - digits % 2
}

/// Whether the line is a comment or a code fence, as people write them into files of their own.
fn is_comment(text: &[u8]) -> bool {
    text.starts_with(b"#") || text.starts_with(b"//") || text.starts_with(b";") || text.starts_with(b"```")
}
