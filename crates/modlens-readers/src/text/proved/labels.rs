//! Learns of lines without bytes what is below them: a label below which all proven frames are requests names requests, in any
//! language, if below another one are responses.

use crate::chunk::Side;
use crate::text::frame_evidence::{direction_evidence, proven_framing};
use crate::text::proved::found::MIN_NEIGHBOUR_BYTES;
use crate::text::proved::kinds::Mention;
use crate::text::proved::line_runs::is_words;
use crate::text::proved::runs::Style;
use crate::text::proved::shapes::{shape, Shape};

/// The most labels that are remembered.
const MAX_LABELS: usize = 200;

/// A longer line is no label.
const MAX_CHARS: usize = 100;

/// How many requests and how many responses are below the lines of a text that hold no bytes.
#[derive(Clone, Debug, Default)]
pub(super) struct Labels {
    known: Vec<(Shape, [u32; 2])>,
    /// The last line, if it may be a label.
    last: Option<Shape>,
}

impl Labels {
    /// Adds a line with the runs of bytes in it.
    pub fn add(&mut self, line: &[u8], found: &[Mention]) {
        let text = line.trim_ascii();
        if text.is_empty() {
            return;
        }
        // A number in front of words, as `000012: Write Request`, is none of them.
        let is_number = |one: &Mention| !one.is_frame && one.bytes.len() < MIN_NEIGHBOUR_BYTES;
        let Some(first) = found.first().filter(|_| !(found.iter().all(is_number) && is_words(text))) else {
            self.last = shape_of(text);
            return;
        };
        let Some(label) = self.last.take().filter(|_| first.label.is_empty() && first.is_frame) else { return };
        let evidence = direction_evidence(&first.bytes, proven_framing(&first.bytes));
        if evidence == 0 {
            return;
        }
        let at = self.known.iter().position(|(known, _)| *known == label);
        if at.is_none() && self.known.len() < MAX_LABELS {
            self.known.push((label, [0; 2]));
        }
        let slot = at.or_else(|| self.known.len().checked_sub(1).filter(|last| self.known[*last].0 == label));
        if let Some(at) = slot {
            self.known[at].1[usize::from(evidence < 0)] += 1;
        }
    }

    /// Who sent the bytes below a label like this one; `None` where the text does not show it.
    pub fn side(&self, text: &[u8]) -> Option<Side> {
        let label = shape_of(text)?;
        let pure = |counts: &[u32; 2], at: usize| counts[at] > 0 && counts[1 - at] == 0;
        let (_, own) = self.known.iter().find(|(known, _)| *known == label)?;
        let is_request = pure(own, 0);
        let has_other = self.known.iter().any(|(_, counts)| pure(counts, usize::from(is_request)));
        let side = if is_request { Side::Sent } else { Side::Received };
        (has_other && (is_request || pure(own, 1))).then_some(side)
    }
}

/// The shape of a line that may be a label.
fn shape_of(text: &[u8]) -> Option<Shape> {
    (text.len() <= MAX_CHARS).then(|| shape(text.trim_ascii(), Style::Pairs)).flatten()
}
