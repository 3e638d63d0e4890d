//! What a reader learns from the beginning of a text before it reads it: what no single line says.

use crate::chunk::Side;
use crate::text::clean::{clean, is_quoted};
use crate::text::frame_evidence;
use crate::text::reader::Reader;
use crate::text::timestamps::TimestampParser;

/// What a reader learns from a text before it reads it, whatever its rows are.
#[derive(Debug)]
pub(in crate::text) struct Marks {
    /// What it took for possible before: nine decimals may be microseconds.
    short_fractions: bool,
    is_quoted_mail: bool,
    timestamps: TimestampParser,
}

impl Reader {
    /// Learns from the first bytes of the text what no single line says: the order of dates, whether it is quoted.
    ///
    /// Gives, for what the log calls sent and received, requests less responses among the frames that can be one only.
    pub fn look_ahead(&mut self, sample: &[u8]) -> [i32; 2] {
        self.look_at_marks(sample);
        self.look_at_statements(sample);
        let mut ahead = Self::to_count(self.dialects.clone());
        ahead.is_quoted_mail = self.is_quoted_mail;
        (ahead.proved, ahead.proved_row) = (self.proved.clone(), self.proved_row.clone());
        ahead.push(sample);
        let mut sides = [0i32; 2];
        while let Some((record, bytes)) = ahead.next(false) {
            let Some(side) = record.side else { continue };
            let slot = &mut sides[usize::from(side == Side::Received)];
            *slot = (*slot + frame_evidence::direction_evidence(bytes, record.proven_framing)).clamp(-100, 100);
        }
        if let (Some(proved), Some(learned)) = (&mut self.proved, &ahead.proved) {
            proved.learn_from(learned);
        }
        sides
    }

    /// Learns the same, for who does not ask about sent and received. Without that, the text need not be read twice, unless it
    /// is by what checksums prove. `known` keeps what does not depend on the rows, for further readers of the same text.
    pub(in crate::text) fn prepare(&mut self, sample: &[u8], known: &mut Vec<Marks>) {
        let short_fractions = self.timestamps.state.short_fractions;
        if self.proved.is_some() {
            self.look_ahead(sample);
        } else if let Some(marks) = known.iter().find(|marks| marks.short_fractions == short_fractions) {
            (self.is_quoted_mail, self.timestamps) = (marks.is_quoted_mail, marks.timestamps.clone());
        } else {
            self.look_at_marks(sample);
            known.push(Marks { short_fractions, is_quoted_mail: self.is_quoted_mail, timestamps: self.timestamps.clone() });
        }
    }

    /// Learns which statements of a program print frames.
    fn look_at_statements(&mut self, sample: &[u8]) {
        let Some(proved) = &mut self.proved else { return };
        let cleaned = sample.split(|&b| b == b'\n').map(|line| {
            let mut scratch = Vec::new();
            clean(line, false, self.is_quoted_mail, &mut scratch).to_vec()
        });
        proved.learn_statements(cleaned);
    }

    /// Learns the order of dates, and whether the text is quoted.
    fn look_at_marks(&mut self, sample: &[u8]) {
        self.is_quoted_mail = is_quoted(sample);
        self.has_angles = memchr::memchr_iter(b'<', sample).any(|at| {
            matches!(sample.get(at + 1..at + 4), Some([high, low, b'>']) if high.is_ascii_hexdigit() && low.is_ascii_hexdigit())
        });
        self.timestamps.look_ahead(sample);
    }
}
