//! Lines of a hex dump as entries: what a `*` stands for, and gaps between offsets.

use super::{EntryAssembler, EntryBytes, PendingDumpLine};
use crate::text::template::LineMatch;
use crate::text::timestamps::TimestampParser;
use crate::text::LogEntry;

/// The most bytes that all `*` of a recording may stand for; what exceeds them counts as lost bytes.
const MAX_REPEATED_BYTES: u64 = 1 << 22;

/// Without a line of a dump before it, an offset from here on may be bytes.
const FIRST_OFFSET_OF_BYTES: u64 = 0x1000;

impl EntryAssembler {
    /// Whether a line of a dump with this offset and no bytes may be its last one.
    pub fn ends_dump_at(&self, offset: u64) -> bool {
        let expected = self.dump_state.expected_offset;
        // The last of 16-bit words may be half of one.
        expected.is_none_or(|expected| offset == expected || offset + 1 == expected || self.dump_state.has_repeat_mark)
            && (expected.is_some() || offset < FIRST_OFFSET_OF_BYTES)
    }

    /// Makes an entry of a line of a dump. A dump prints an endless stream, so line ends mean nothing: only offset 0 starts
    /// a new stream, and only a jump of the offsets shows that bytes were lost.
    pub(super) fn dump_line(&mut self, entry_bytes: &EntryBytes<'_>, found: &LineMatch, timestamps: &TimestampParser) {
        let plain = LogEntry {
            side: entry_bytes.side,
            line: entry_bytes.line,
            time: entry_bytes.time,
            number: entry_bytes.number,
            ..LogEntry::default()
        };
        let Some(offset) = found.offset else { return self.push(plain, entry_bytes.bytes, timestamps) };
        let state = &mut self.dump_state;
        let mut has_lost_bytes = false;
        let mut bytes = std::mem::take(&mut state.scratch);
        bytes.clear();
        if let Some(expected) = state.expected_offset.filter(|_| offset != 0) {
            let missing = offset.saturating_sub(expected);
            let is_allowed = missing <= MAX_REPEATED_BYTES - state.repeated_bytes;
            let is_filled = state.has_repeat_mark && is_allowed && !state.last_line.is_empty();
            if is_filled {
                state.repeated_bytes += missing;
                bytes.extend(state.last_line.iter().copied().cycle().take(missing as usize));
            }
            has_lost_bytes = expected != offset && !is_filled;
        }
        state.has_repeat_mark = false;
        state.last_line.clear();
        state.last_line.extend_from_slice(entry_bytes.bytes);
        let end_offset = offset + entry_bytes.bytes.len() as u64;
        state.expected_offset = Some(end_offset);
        bytes.extend_from_slice(entry_bytes.bytes);
        let record = LogEntry { starts_record: offset == 0, follows_loss: has_lost_bytes, ..plain };
        if found.may_end_with_half_word {
            self.pending_dump_line = Some(PendingDumpLine { record, bytes, end_offset });
        } else {
            self.push(record, &bytes, timestamps);
            self.dump_state.scratch = bytes;
        }
    }

    /// Makes an entry of the pending dump line. `offset` is that of the line after it: one less than expected says that
    /// the last word holds only one byte.
    pub(super) fn end_dump_line(&mut self, offset: Option<u64>, timestamps: &TimestampParser) {
        let Some(PendingDumpLine { record, mut bytes, end_offset }) = self.pending_dump_line.take() else { return };
        if offset.is_some_and(|offset| offset + 1 == end_offset) {
            bytes.pop();
        }
        self.push(record, &bytes, timestamps);
        self.dump_state.scratch = bytes;
    }
}
