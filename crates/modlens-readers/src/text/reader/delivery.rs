//! Makes entries of what a dialect has found in a line, with who sent the bytes as far as the words around them say.

use std::sync::Arc;

use crate::text::dialect::Dialect;
use crate::text::proved::{ends_with_index, sender, ProvedHex};
use crate::text::reader::Reader;
use crate::text::role::LineRole;

impl Reader {
    /// Passes the matches of the current line to `deliver`, which makes entries of them.
    pub(super) fn deliver_matches(&mut self, dialect: &Arc<Dialect>) {
        let mut matches = std::mem::take(&mut self.matches);
        self.let_label_decide(&mut matches);
        let voice = Some(Arc::as_ptr(dialect).addr() as u64);
        let mut from = 0;
        for (role, found, end) in &mut matches {
            let bytes = &self.found[from..*end];
            // A time on a line of its own, or in a label, is that of the next bytes below it, unless they have their own.
            if matches!(role, LineRole::Header(_) | LineRole::Bytes(_)) {
                let above = self.prose.take_time_before(self.number);
                found.time = found.time.or(above);
            }
            from = *end;
            if *role != LineRole::Ignored {
                self.line_bytes.add(bytes);
            }
            // What two dialects print of one frame is one frame: ESPHome's modbus says what it writes, and its uart does as well.
            if let (LineRole::Bytes(side), true) = (*role, self.voices.last.is_some_and(|last| Some(last) != voice)) {
                if self.voices.repeats(voice, bytes, found.side.or(side), &self.assembler) {
                    self.assembler.skip_copy(bytes);
                    self.voices.repeats = true;
                    continue;
                }
            }
            self.assembler.take(dialect, *role, found, bytes, &self.timestamps);
            self.voices.note(voice);
            if dialect.generic && self.may_be_quoted() {
                self.prose.remember(bytes);
            }
        }
        self.matches = matches;
    }

    /// Lets words in front of bytes in brackets say who sent them: libmodbus gives the two kinds of brackets a meaning, other
    /// programs do not. Where a row of any program knows no word, what was learned of the text counts.
    pub(super) fn let_words_decide(&mut self, line: &[u8], row: &Dialect) {
        let learned = |front: &[u8]| self.proved.as_ref().and_then(|proved| proved.learned_sender(front));
        let has_label = self.side_of_label().is_some();
        for (role, found, _) in &mut self.matches {
            let brackets = line.get(found.start..found.start + 4);
            let is_in_brackets = matches!(brackets, Some([b'[', _, _, b']'] | [b'<', _, _, b'>']));
            match role {
                LineRole::Bytes(Some(side)) if is_in_brackets && found.start > 0 => {
                    let front = &line[..found.start];
                    let may_mean_brackets = self.has_angles || !ProvedHex::is_label(front);
                    let said = sender(front).or_else(|| learned(&line[..=found.start]));
                    *role = LineRole::Bytes(said.or(Some(*side).filter(|_| may_mean_brackets)));
                }
                LineRole::Bytes(side @ Some(_)) if is_in_brackets && !self.has_angles && has_label => *side = None,
                LineRole::Bytes(side @ Some(_)) if row.generic && ends_with_index(&line[..line.len().min(found.start + 2)]) => {
                    *side = None;
                }
                LineRole::Bytes(side @ None) if row.generic && found.side.is_none() && found.start > 0 => {
                    // In a table the words in front name a byte.
                    let front = &line[..found.start];
                    *side = learned(front).or_else(|| sender(front).filter(|_| !row.is_table()));
                }
                _ => {}
            }
        }
    }
}
