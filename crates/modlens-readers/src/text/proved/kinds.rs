//! The runs of bytes that a text mentions, and what the proven frames among them are: by the statement that printed them, and
//! by how they begin.

use crate::chunk::Side;
use crate::text::frame_evidence::{direction_evidence, proven_framing};
use crate::text::proved::runs::Style;
use crate::text::proved::shapes::Shape;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::EXCEPTION_BIT;

/// The shortest response: an exception.
const MIN_ALIKE_BYTES: usize = 5;

/// A run of bytes in a line, and the text in front of it.
#[derive(Clone, Debug)]
pub(super) struct Mention {
    pub shape: Shape,
    /// Who sent the bytes, by the words in front of them.
    pub side: Option<Side>,
    /// The words in front of the bytes, hashed.
    pub label: Vec<u64>,
    pub style: Style,
    pub bytes: Vec<u8>,
    pub is_frame: bool,
    /// Nothing but brackets and quotes follows the bytes in the line.
    pub ends_line: bool,
}

/// What the proven frames of each statement are: more than 0 for requests, less for responses, 0 for both or either.
pub(super) struct Kinds {
    pub all: Vec<(Shape, i32)>,
    /// The units and functions of proven RTU frames.
    beginnings: Vec<[u8; 2]>,
}

impl Kinds {
    pub fn of(mentions: &[&Mention]) -> Self {
        let mut all: Vec<(Shape, [i32; 2])> = Vec::new();
        for mention in mentions.iter().filter(|one| one.is_frame) {
            let index = all.iter().position(|(shape, _)| *shape == mention.shape).unwrap_or_else(|| {
                all.push((mention.shape, [0; 2]));
                all.len() - 1
            });
            match direction_evidence(&mention.bytes, proven_framing(&mention.bytes)) {
                0 => {}
                evidence => all[index].1[usize::from(evidence < 0)] += 1,
            }
        }
        // A few frames of the other kind are a master that was heard by a unit, or an echo.
        let kind = |[requests, responses]: [i32; 2]| {
            if requests.min(responses) * 10 < requests.max(responses) {
                requests - responses
            } else {
                0
            }
        };
        let mut beginnings: Vec<[u8; 2]> = Vec::new();
        for frame in mentions.iter().filter(|one| one.is_frame && proven_framing(&one.bytes) == Some(Mode::Rtu)) {
            let beginning = [frame.bytes[0], frame.bytes[1] & !EXCEPTION_BIT];
            if !beginnings.contains(&beginning) {
                beginnings.push(beginning);
            }
        }
        Self { all: all.into_iter().map(|(shape, counts)| (shape, kind(counts))).collect(), beginnings }
    }

    /// Whether the bytes are long enough for a frame and begin with the unit and the function of a proven one.
    pub fn begins_alike(&self, bytes: &[u8]) -> bool {
        bytes.len() >= MIN_ALIKE_BYTES && self.beginnings.contains(&[bytes[0], bytes[1] & !EXCEPTION_BIT])
    }

    pub fn is_proven(&self, shape: Shape) -> bool {
        self.all.iter().any(|(known, _)| *known == shape)
    }

    pub fn kind(&self, shape: Shape) -> i32 {
        self.all.iter().find(|(known, _)| *known == shape).map_or(0, |(_, kind)| *kind)
    }

    /// Whether the proven frame is a request, or may be one by its own layout and by that of its statement.
    pub fn is_request(&self, mention: &Mention) -> bool {
        self.kind(mention.shape) >= 0 && direction_evidence(&mention.bytes, proven_framing(&mention.bytes)) >= 0
    }

    /// Whether what the words call sent are requests, as it is where the words say nothing.
    pub fn master_logs(&self, mentions: &[&Mention]) -> bool {
        let vote = |one: &&Mention| {
            let kind = self.kind(one.shape).signum();
            one.side.map_or(0, |side| if side == Side::Sent { kind } else { -kind })
        };
        mentions.iter().filter(|one| one.is_frame).map(vote).sum::<i32>() >= 0
    }
}
