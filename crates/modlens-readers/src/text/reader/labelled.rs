//! Lets the label above bytes say who sent them, where their own line does not.
//!
//! The words of the label say so, or else what was learned of the text: a label whose other bytes are proven requests.

use crate::chunk::Side;
use crate::text::frame_evidence;
use crate::text::proved::{denies, sender_below, ProvedHex};
use crate::text::reader::label::{label_text, Label};
use crate::text::reader::Reader;
use crate::text::role::LineRole;
use crate::text::template::LineMatch;

/// The bytes are at most so many lines below their label: a blank one may be between.
const MAX_LINES_TO_BYTES: u64 = 2;

impl Reader {
    /// Remembers a line that nothing has read, if it may be a label. One that says nothing may be between a label and its bytes.
    pub(super) fn note_label(&mut self, text: &[u8]) {
        let is_between =
            |label: &Label| label.bytes.is_empty() && label.number == label.own_number && label.number + 1 == self.number;
        let may_be_between = self.label.as_ref().is_some_and(is_between) && !denies(text) && self.side_of_label().is_some();
        if may_be_between && label_text(text).is_some_and(|text| below(self.proved.as_deref(), text).is_none()) {
            if let Some(label) = &mut self.label {
                label.number = self.number;
            }
            return;
        }
        self.label = Some(text).filter(|_| !self.is_counting() || self.proved.is_some()).and_then(label_text).map(|text| {
            let (text, number) = (text.to_vec(), self.number);
            Label { text, number, own_number: number, bytes: Vec::new() }
        });
    }

    /// Who sent bytes in the current line, as a label above it says.
    pub(super) fn side_of_label(&self) -> Option<Side> {
        let label = self.label.as_ref()?;
        let reach = if label.bytes.is_empty() { MAX_LINES_TO_BYTES } else { 1 };
        if label.number + reach < self.number {
            return None;
        }
        below(self.proved.as_deref(), &label.text)
    }

    /// Lets a label say who sent the bytes that were found in a line which does not say so itself.
    pub(super) fn let_label_decide(&mut self, matches: &mut [(LineRole, LineMatch, usize)]) {
        let Some(side) = self.side_of_label() else { return };
        let mut from = 0;
        for (role, found, end) in matches {
            if *role == LineRole::Bytes(None) && found.side.is_none() {
                *role = LineRole::Bytes(Some(side));
                let bytes = self.found[from..*end].to_vec();
                self.use_label(&bytes);
            }
            from = *end;
        }
    }

    /// Remembers bytes that a label has named, and that it was understood. It names no more once they are a whole frame.
    pub(super) fn use_label(&mut self, bytes: &[u8]) {
        let Some(label) = &mut self.label else { return };
        if label.bytes.is_empty() {
            self.unread_lines.remove(label.own_number, &label.text);
        }
        label.number = self.number;
        label.bytes.extend_from_slice(bytes);
        if frame_evidence::is_whole_frame(&label.bytes) {
            self.label = None;
        }
    }
}

/// Who sent the bytes below a label.
fn below(proved: Option<&ProvedHex>, text: &[u8]) -> Option<Side> {
    proved.and_then(|proved| proved.learned_label(text)).or_else(|| sender_below(text))
}
