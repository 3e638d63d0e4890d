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

/// A side has requests and responses if those of the rarer kind are at least one of so many.
const MIN_SHARE_OF_MIXED: u32 = 6;

/// The frames of one side that can be a request only, or a response only, and all of its byte strings.
#[derive(Clone, Copy, Debug, Default)]
struct SideCounts {
    records: u32,
    requests: u32,
    responses: u32,
}

impl SideCounts {
    /// Whether these are requests and responses alike.
    fn are_mixed(self) -> bool {
        let fewer = self.requests.min(self.responses);
        fewer > 0 && fewer * MIN_SHARE_OF_MIXED >= self.requests + self.responses
    }

    /// Requests less responses, within bounds.
    fn balance(self) -> i32 {
        (i64::from(self.requests) - i64::from(self.responses)).clamp(-100, 100) as i32
    }
}

/// Who sent the bytes of lines that do not say so, where all others name one side: its frames are requests only and those of
/// the lines without a word responses only, or the other way round.
fn side_of_others(sides: [SideCounts; 2], others: SideCounts) -> Option<Side> {
    let (named, side) = match sides.map(|counts| counts.records > 0) {
        [true, false] => (sides[0], Side::Sent),
        [false, true] => (sides[1], Side::Received),
        _ => return None,
    };
    let is_one = |counts: SideCounts| (counts.requests == 0) != (counts.responses == 0);
    let differ = is_one(named) && is_one(others) && (named.requests > 0) != (others.requests > 0);
    differ.then(|| side.other())
}

impl Reader {
    /// Learns from the first bytes of the text what no single line says: the order of dates, whether it is quoted.
    ///
    /// Gives, for what the log calls sent and received, requests less responses among the frames that can be one only. Where all
    /// lines have the same word or arrow, in front of requests and responses alike, it says nothing and is left out; in front of one
    /// line with both, it says that both came in one run.
    pub fn look_ahead(&mut self, sample: &[u8]) -> [i32; 2] {
        self.look_at_marks(sample);
        self.look_at_statements(sample);
        let mut ahead = Self::to_count(self.dialects.clone());
        (ahead.is_quoted_mail, ahead.has_angles) = (self.is_quoted_mail, self.has_angles);
        (ahead.proved, ahead.proved_row) = (self.proved.clone(), self.proved_row.clone());
        ahead.push(sample);
        let (mut sides, mut others) = ([SideCounts::default(); 2], SideCounts::default());
        let (mut first, mut is_one_line) = (None, true);
        while let Some((record, bytes)) = ahead.next(false) {
            let counts = match record.side {
                Some(side) => &mut sides[usize::from(side == Side::Received)],
                None => &mut others,
            };
            let evidence = frame_evidence::direction_evidence(bytes, record.proven_framing);
            is_one_line &= *first.get_or_insert(record.number) == record.number;
            counts.records += 1;
            counts.requests += u32::from(evidence > 0);
            counts.responses += u32::from(evidence < 0);
        }
        if (sides[0].are_mixed() && sides[1].records == 0) || (sides[1].are_mixed() && sides[0].records == 0) {
            self.assembler.ignores_sides = !is_one_line;
            sides = [SideCounts::default(); 2];
        } else if others.records > 0 {
            self.assembler.side_of_others = side_of_others(sides, others);
        }
        if let (Some(proved), Some(learned)) = (&mut self.proved, &ahead.proved) {
            proved.learn_from(learned);
        }
        sides.map(SideCounts::balance)
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
        self.expectation.look_ahead(sample);
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
