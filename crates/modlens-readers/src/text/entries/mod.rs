//! Assembles the matches of lines into entries: decides where a frame may begin, joins bytes that a program prints over
//! several lines, fills gaps in dumps, and skips bytes that the log shows twice.

mod copies;
mod dump;

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use crate::chunk::Side;
use crate::text::dialect::{Dialect, Encapsulation};
use crate::text::encapsulation::V5_START;
use crate::text::frame_evidence::check_frame;
use crate::text::role::LineRole;
use crate::text::template::LineMatch;
use crate::text::timestamps::TimestampParser;
use crate::text::{encapsulation, LogEntry};
use modlens_protocol::framing::Mode;
use modlens_protocol::Ns;

/// Bytes that were read but not delivered: the number of the line, the bytes, and the reason.
pub type SkippedBytes = (u64, Vec<u8>, &'static str);

/// How many skipped byte strings are kept so that they can be listed.
const MAX_LISTED: usize = 1000;

/// The most bytes of a frame in blocks that are collected to see whether the checksum at their end is valid.
const MAX_GROUP_BYTES: usize = 1024;

/// The most bytes of a frame that is printed over several lines.
const MAX_MULTI_LINE_BYTES: usize = 1 << 16;

/// The rest of a frame is at most so many lines after its beginning, among what else a program prints.
const MAX_LINES_TO_REST: u64 = 3;

/// The reason reported for skipped duplicates.
const DUPLICATE: &str = "bytes that the program had printed before";

/// The reasons reported for what is around a frame of Solarman V5.
const V5_WRAPPER: &str = "Solarman V5 wrapper of a frame";
const V5_WRAPPER_WITHOUT_SUM: &str = "Solarman V5 wrapper, with a wrong checksum, of a frame";

/// The bytes of one device whose lines carry its name, or of all lines without a name.
#[derive(Debug, Default)]
struct DeviceStream {
    side: Option<Side>,
    /// The last bytes did not end with a valid checksum or at an announced length, so the next ones may continue a frame.
    is_mid_frame: bool,
    /// All bytes since the last place where a frame could begin.
    group: Vec<u8>,
    /// The group before.
    previous: Vec<u8>,
    /// How often in a row the same frame was delivered.
    same_frames: u32,
    /// Number of the line of the last bytes, and its time.
    number: u64,
    time: Option<Ns>,
}

/// What a header line says about the bytes in the lines that follow it.
#[derive(Clone, Copy, Debug)]
struct Header {
    side: Option<Side>,
    time: Option<Ns>,
    key: usize,
    announces_duplicates: bool,
}

/// The state of a hex dump between two of its lines.
#[derive(Debug, Default)]
struct DumpState {
    /// The offset that the next line should have.
    expected_offset: Option<u64>,
    /// The bytes of the last line, which a `*` repeats.
    last_line: Vec<u8>,
    /// Reused memory for the lines that a `*` stands for and the line after it.
    scratch: Vec<u8>,
    /// The last line was a `*`.
    has_repeat_mark: bool,
    /// The bytes that all `*` so far stand for.
    repeated_bytes: u64,
}

/// A frame that a program prints over several lines, as far as it was read.
#[derive(Debug)]
struct MultiLineFrame {
    dialect: Arc<Dialect>,
    header: Header,
    bytes: Vec<u8>,
    /// Number of its first line.
    number: u64,
}

/// A line of a dump in 16-bit words. It may end with half a word, which only the next offset shows.
#[derive(Debug)]
struct PendingDumpLine {
    record: LogEntry,
    bytes: Vec<u8>,
    /// The next offset if all of the last word are data.
    end_offset: u64,
}

/// Bytes of one or several lines with what is known of them, before their place in the frame is decided.
struct EntryBytes<'a> {
    bytes: &'a [u8],
    side: Option<Side>,
    time: Option<Ns>,
    key: usize,
    line: u8,
    number: u64,
    no_checksum: bool,
}

/// The entries that are ready to be fetched, and the state on which the next ones depend.
#[derive(Debug, Default)]
pub(super) struct EntryAssembler {
    ready: VecDeque<(LogEntry, usize, usize)>,
    ready_bytes: Vec<u8>,
    /// Place of the entry that was fetched last in `ready_bytes`.
    popped: (usize, usize),
    streams: Vec<DeviceStream>,
    /// The last header line, as long as lines of its bytes may follow.
    header: Option<Header>,
    multi_line_frame: Option<MultiLineFrame>,
    dump_state: DumpState,
    pending_dump_line: Option<PendingDumpLine>,
    /// The last bytes were read by a generic dialect.
    is_generic: bool,
    pub keys: Vec<Vec<u8>>,
    pub skipped: Vec<SkippedBytes>,
    pub counts: BTreeMap<&'static str, (u64, u64)>,
    pub records: u64,
    /// Lines that announced bytes: header lines, and dump lines with an offset.
    pub announced: u64,
    pub number: u64,
    /// What the lines say about who sent their bytes is the same for all, and means nothing.
    pub ignores_sides: bool,
    /// Who sent the bytes of lines that do not say so, where the rest of the text shows it.
    pub side_of_others: Option<Side>,
}

impl EntryAssembler {
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.ready.is_empty()
    }

    pub fn pop(&mut self) -> Option<LogEntry> {
        let (record, start, end) = self.ready.pop_front()?;
        self.popped = (start, end);
        Some(record)
    }

    /// The bytes of the entry that was fetched last.
    pub fn popped(&self) -> &[u8] {
        &self.ready_bytes[self.popped.0..self.popped.1]
    }

    /// Whether a header line has announced bytes that may still follow.
    pub fn expects_continuation(&self) -> bool {
        self.header.is_some()
    }

    /// The number of a device's name, from 1; a new name gets the next number.
    pub fn key(&mut self, name: &[u8]) -> usize {
        let at = self.keys.iter().position(|known| known == name);
        at.unwrap_or_else(|| {
            self.keys.push(name.to_vec());
            self.keys.len() - 1
        }) + 1
    }

    /// Takes one match of a line. `bytes` are those that the template found, `role` says what they are.
    pub fn take(
        &mut self,
        dialect: &Arc<Dialect>,
        role: LineRole,
        found: &LineMatch,
        bytes: &[u8],
        timestamps: &TimestampParser,
    ) {
        self.end_dump_line(found.offset, timestamps);
        let key = found.key.map_or(0, |(key, _)| key);
        match role {
            LineRole::Ignored => {}
            LineRole::RepeatedLines => self.dump_state.has_repeat_mark = true,
            LineRole::Duplicate => self.skip(self.number, bytes, DUPLICATE),
            LineRole::Header(_) | LineRole::DuplicateHeader => {
                self.end_multi_line_frame(timestamps);
                self.announced += 1;
                let side = if let LineRole::Header(side) = role { side } else { None };
                let announces_duplicates = role == LineRole::DuplicateHeader;
                self.header = Some(Header { side, time: found.time, key, announces_duplicates });
            }
            LineRole::Continuation => self.continuation(dialect, found, bytes, timestamps),
            LineRole::PossibleDuplicate => {
                let printed = self.printed_before(key, bytes);
                if printed > 0 {
                    self.skip(self.number, &bytes[..printed], DUPLICATE);
                }
                if printed < bytes.len() {
                    self.entry(dialect, found, &bytes[printed..], Some(Side::Received), found.time, key, timestamps);
                }
            }
            LineRole::Bytes(side) => self.entry(dialect, found, bytes, found.side.or(side), found.time, key, timestamps),
        }
    }

    /// Takes bytes that a header line announced: duplicates are skipped, parts of a multi-line frame are collected.
    fn continuation(&mut self, dialect: &Arc<Dialect>, found: &LineMatch, bytes: &[u8], timestamps: &TimestampParser) {
        self.announced += u64::from(found.offset.is_some());
        let without_header = Header { side: None, time: found.time, key: 0, announces_duplicates: false };
        let header = self.header.unwrap_or(without_header);
        if header.announces_duplicates {
            self.skip(self.number, bytes, DUPLICATE);
        } else if dialect.is_joined {
            if found.offset == Some(0) {
                self.end_multi_line_frame(timestamps);
            }
            let number = self.number;
            let begin = || MultiLineFrame { dialect: Arc::clone(dialect), header, bytes: Vec::new(), number };
            let frame = self.multi_line_frame.get_or_insert_with(begin);
            if frame.bytes.len() + bytes.len() <= MAX_MULTI_LINE_BYTES {
                frame.bytes.extend_from_slice(bytes);
            }
        } else {
            let time = found.time.or(header.time);
            self.entry(dialect, found, bytes, header.side, time, header.key, timestamps);
        }
    }

    /// Removes what a dialect wraps around frames, and turns the bytes into an entry of a dump or of a log.
    #[allow(clippy::too_many_arguments)] // What a header line and the line itself say together.
    fn entry(
        &mut self,
        dialect: &Dialect,
        found: &LineMatch,
        bytes: &[u8],
        side: Option<Side>,
        time: Option<Ns>,
        key: usize,
        timestamps: &TimestampParser,
    ) {
        self.is_generic = dialect.generic;
        let no_checksum = dialect.no_checksum || found.flags.no_checksum;
        let entry_bytes = EntryBytes { bytes, side, time, key, line: found.line, number: self.number, no_checksum };
        if dialect.is_dump {
            self.dump_line(&entry_bytes, found, timestamps);
        } else if dialect.encapsulation == Some(Encapsulation::Solarman) || (dialect.generic && bytes.first() == Some(&V5_START))
        {
            match encapsulation::solarman_rtu_frame(bytes) {
                Ok(inner) => {
                    let reason = if encapsulation::solarman_sum_fits(bytes) { V5_WRAPPER } else { V5_WRAPPER_WITHOUT_SUM };
                    self.skip(self.number, bytes, reason);
                    self.log_entry(&EntryBytes { bytes: &bytes[inner], ..entry_bytes }, timestamps);
                }
                Err(_) if dialect.generic => self.log_entry(&entry_bytes, timestamps),
                Err(reason) => self.skip(self.number, bytes, reason),
            }
        } else {
            self.log_entry(&entry_bytes, timestamps);
        }
    }

    /// Makes an entry of the bytes and decides whether a frame may begin with it.
    ///
    /// A frame may not begin where the bytes before, from the same sender, do not end with a valid checksum yet: programs
    /// print what one read returned, which may be a part of a frame.
    fn log_entry(&mut self, entry_bytes: &EntryBytes<'_>, timestamps: &TimestampParser) {
        if entry_bytes.bytes.is_empty() {
            return;
        }
        let grown = self.grown(entry_bytes);
        if grown > 0 {
            self.skip(entry_bytes.number, &entry_bytes.bytes[..grown], DUPLICATE);
        }
        let entry_bytes = &EntryBytes { bytes: &entry_bytes.bytes[grown..], ..*entry_bytes };
        if let Some(record) = self.place(entry_bytes, check_frame(entry_bytes.bytes)) {
            self.push(record, entry_bytes.bytes, timestamps);
        }
    }

    /// Makes an entry of a line of plain hex that is a whole frame, as `take` would, but gives it back at once: no entry
    /// waits to be fetched. `None` if the bytes are skipped.
    #[inline(always)]
    #[allow(clippy::inline_always)] // Called once, for nearly every line; the entry is large.
    pub fn take_frame(
        &mut self,
        bytes: &[u8],
        framing: Option<Mode>,
        (time, side): (Option<Ns>, Option<Side>),
        timestamps: &TimestampParser,
    ) -> Option<LogEntry> {
        let entry_bytes = EntryBytes { bytes, side, time, key: 0, line: 0, number: self.number, no_checksum: false };
        let record = self.place(&entry_bytes, (true, framing))?;
        self.records += 1;
        Some(LogEntry { clock: timestamps.clock(), ..record })
    }

    /// The bytes of a frame that one of the last lines has begun, if there is one; so many lines may belong to it.
    fn begun(&self, between: u64) -> Option<&[u8]> {
        let is_near = |stream: &DeviceStream| stream.number + MAX_LINES_TO_REST + between >= self.number;
        let is_open = |stream: &&DeviceStream| stream.is_mid_frame && is_near(stream);
        self.streams.first().filter(is_open).map(|stream| &stream.group[..])
    }

    /// Whether one of the last lines has begun a frame.
    pub fn has_begun(&self, between: u64) -> bool {
        self.begun(between).is_some()
    }

    /// Whether these bytes complete the frame that one of the last lines has begun.
    pub fn completes(&self, bytes: &[u8], between: u64) -> bool {
        self.begun(between).is_some_and(|begun| check_frame(&[begun, bytes].concat()).0)
    }

    /// Who sent the last bytes.
    pub fn last_side(&self) -> Option<Side> {
        self.streams.first().and_then(|stream| stream.side)
    }

    /// Whether no line before says anything about the next one but in the streams of devices.
    pub fn expects_nothing(&self) -> bool {
        self.header.is_none() && self.multi_line_frame.is_none() && self.pending_dump_line.is_none() && self.is_generic
    }

    /// The entry of these bytes, which are not empty, with its place in the stream of its device; `None` if they are skipped.
    /// The arguments are those of `log_entry`, and what `check_frame` reports about the bytes.
    #[inline(always)]
    #[allow(clippy::inline_always)] // Where much is known of the bytes, little of it is done.
    fn place(&mut self, entry_bytes: &EntryBytes<'_>, (is_whole_frame, framing): (bool, Option<Mode>)) -> Option<LogEntry> {
        while self.streams.len() <= entry_bytes.key {
            self.streams.push(DeviceStream::default());
        }
        if self.is_inner_copy(entry_bytes, framing) || self.is_logged_twice(entry_bytes, framing) {
            self.skip(entry_bytes.number, entry_bytes.bytes, DUPLICATE);
            return None;
        }
        let side = entry_bytes.side.or(self.side_of_others).filter(|_| !self.ignores_sides);
        let stream = &mut self.streams[entry_bytes.key];
        let no_checksum = entry_bytes.no_checksum && !is_whole_frame;
        let ends_ascii = stream.side == side && ends_ascii_frame(&stream.group, entry_bytes.bytes);
        let starts_record = !ends_ascii && (is_whole_frame || no_checksum || !stream.is_mid_frame || stream.side != side);
        let is_same = starts_record && stream.group == entry_bytes.bytes;
        stream.same_frames = if is_same { stream.same_frames + 1 } else { 1 };
        (stream.number, stream.time) = (entry_bytes.number, entry_bytes.time);
        if starts_record || stream.group.len() + entry_bytes.bytes.len() > MAX_GROUP_BYTES {
            std::mem::swap(&mut stream.group, &mut stream.previous);
            stream.group.clear();
        }
        stream.group.extend_from_slice(entry_bytes.bytes);
        stream.is_mid_frame = !(is_whole_frame || no_checksum || (!starts_record && check_frame(&stream.group).0));
        stream.side = side;
        Some(LogEntry {
            time: entry_bytes.time,
            side,
            line: entry_bytes.line,
            starts_record,
            lacks_checksum: no_checksum,
            proven_framing: framing,
            key: entry_bytes.key,
            number: entry_bytes.number,
            ..LogEntry::default()
        })
    }

    /// Ends the multi-line frame with the time that its last line states.
    pub fn end_frame_at(&mut self, time: Ns, timestamps: &TimestampParser) {
        if let Some(frame) = &mut self.multi_line_frame {
            frame.header.time = frame.header.time.or(Some(time));
        }
        self.end_multi_line_frame(timestamps);
    }

    /// Makes an entry of the multi-line frame, if there is one.
    fn end_multi_line_frame(&mut self, timestamps: &TimestampParser) {
        let Some(MultiLineFrame { dialect, header, bytes, number }) = self.multi_line_frame.take() else { return };
        let inner = match dialect.encapsulation {
            Some(Encapsulation::Network) => match encapsulation::network_payload(&bytes) {
                Ok(inner) => inner,
                Err(reason) => return self.skip(number, &bytes, reason),
            },
            _ => 0..bytes.len(),
        };
        let no_checksum = dialect.no_checksum;
        let Header { side, time, key, .. } = header;
        self.log_entry(&EntryBytes { bytes: &bytes[inner], side, time, key, line: 0, number, no_checksum }, timestamps);
    }

    /// Ends what the last header line announced, because a line that no template reads follows.
    pub fn end_announcement(&mut self, timestamps: &TimestampParser) {
        self.end_dump_line(None, timestamps);
        self.end_multi_line_frame(timestamps);
        self.header = None;
    }

    /// Handles a blank line. In text that people typed (read by a generic dialect) it separates frames.
    pub fn blank_line(&mut self, timestamps: &TimestampParser) {
        self.end_multi_line_frame(timestamps);
        if self.is_generic {
            for stream in &mut self.streams {
                stream.is_mid_frame = false;
            }
        }
    }

    /// Makes entries of everything that waits for a further line.
    pub fn finish(&mut self, timestamps: &TimestampParser) {
        self.end_dump_line(None, timestamps);
        self.end_multi_line_frame(timestamps);
    }

    /// Counts bytes that are not delivered and keeps the first of them for the list shown to users.
    pub fn skip(&mut self, number: u64, bytes: &[u8], reason: &'static str) {
        let (count, total) = self.counts.entry(reason).or_default();
        *count += 1;
        *total += bytes.len() as u64;
        if self.skipped.len() < MAX_LISTED {
            self.skipped.push((number, bytes.to_vec(), reason));
        }
    }

    fn push(&mut self, record: LogEntry, bytes: &[u8], timestamps: &TimestampParser) {
        if self.ready.is_empty() {
            self.ready_bytes.clear();
            self.popped = (0, 0);
        }
        let start = self.ready_bytes.len();
        self.ready_bytes.extend_from_slice(bytes);
        self.records += 1;
        self.ready.push_back((LogEntry { clock: timestamps.clock(), ..record }, start, self.ready_bytes.len()));
    }
}

/// Whether these bytes are the line end, or its second half, of a frame of Modbus ASCII that was printed in parts.
fn ends_ascii_frame(frame: &[u8], bytes: &[u8]) -> bool {
    frame.first() == Some(&b':')
        && match frame.last() {
            Some(b'\n') => false,
            Some(b'\r') => bytes == b"\n",
            _ => matches!(bytes, b"\r" | b"\r\n"),
        }
}
