//! The rest of a frame that an earlier line has begun: a line with words, or several lines of nothing but hex, as a terminal or a
//! text field wraps them. The checksum at its end proves that they belong together.

use crate::text::proved::{longest_hex, only_hex};
use crate::text::reader::Reader;
use crate::text::role::LineRole;
use crate::text::template::LineMatch;

/// The rest of a frame has at most so many bytes.
const MOST_BYTES: usize = 512;

/// Reads a line that completes the frame which an earlier one has begun, with those between them. Returns whether it does.
pub(super) fn read_rest(reader: &mut Reader, line: &[u8]) -> bool {
    reader.wrapped.keep_above(reader.number);
    let count = reader.wrapped.count();
    if reader.proved.is_none() || !reader.assembler.has_begun(count) {
        return false;
    }
    let between = reader.wrapped.bytes();
    let own = if between.is_empty() { longest_hex(line) } else { only_hex(line) };
    let Some(bytes) = own.filter(|own| between.len() + own.len() <= MOST_BYTES) else { return false };
    if !reader.assembler.completes(&[&between[..], &bytes].concat(), count) {
        return false;
    }
    let number = reader.number;
    for above in reader.wrapped.take() {
        reader.unread_lines.remove(above.number, &above.text);
        take(reader, above.number, &above.bytes);
    }
    take(reader, number, &bytes);
    true
}

/// Takes bytes that continue the frame of an earlier line.
fn take(reader: &mut Reader, number: u64, bytes: &[u8]) {
    let Some(row) = reader.proved_row.clone() else { return };
    let side = reader.assembler.last_side();
    let found = LineMatch { side, ..LineMatch::default() };
    reader.assembler.number = number;
    reader.assembler.take(&row, LineRole::Bytes(side), &found, bytes, &reader.timestamps);
}
