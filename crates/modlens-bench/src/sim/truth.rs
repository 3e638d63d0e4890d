//! The truth about a simulated recording: the frames that were sent, their positions in the recording, and the labels that a
//! good analyzer gives them.

use crate::model::{Direction, Framing, Label, Labels};
use crate::sim::damage::Damage;
use crate::sim::wire::{FrameRole, RequestOutcome, SentFrame, Wire, NO_FRAME};

/// A frame of which at least one byte was delivered.
#[derive(Clone, Debug)]
pub struct TruthFrame {
    /// 0 for the only line; 1 and 2 for the lines A and B of a two-line tap.
    pub line: u8,
    /// Offset of its first delivered byte in that line's stream.
    pub start: u64,
    /// Offset after its last delivered byte.
    pub end: u64,
    /// Request or response.
    pub direction: Direction,
    /// The unit.
    pub unit: u8,
    /// The function code without the exception bit.
    pub function: u8,
    /// It is an exception response.
    pub exception: bool,
    /// Number of the transaction, which a request and its response share.
    pub txn: u32,
    /// Another transaction to which the frame may be assigned. For a late response it is the transaction that timed out. The
    /// response to the retry after it has the same value: a live tap takes the first of the two for the response to the
    /// retry, and only the second one shows that there was one too many.
    pub alternative_txn: Option<u32>,
    /// All its bytes were delivered, unmodified and contiguous.
    pub valid: bool,
    /// An ASCII frame that lacks only CR or LF: to report it as whole is neither right nor wrong.
    pub is_unscored: bool,
    /// The recording does not decide its direction, which is not scored.
    pub is_undecided: bool,
    /// A local echo, whose direction is not scored.
    pub echo: bool,
    /// A response from the wrong unit or a repeated response, whose transaction is not scored.
    pub needs_no_pair: bool,
    /// The labels that it must get.
    pub labels: Labels,
    /// Labels that it may get, because the recording does not decide whether they apply.
    pub allowed_labels: Labels,
    /// Number of the overlap of two masters' transactions that it is part of, from 1; 0 for none.
    pub overlap_id: u32,
    /// The damage that was done to it.
    pub damage: Damage,
}

/// A place where bytes are missing: the line, and the offset of the first byte after the gap.
pub type Loss = (u8, u64);

/// The position and the condition of a frame in the recording.
#[derive(Clone, Copy, Debug, Default)]
struct RecordedSpan {
    start: u64,
    end: u64,
    delivered: usize,
    /// The number of delivered bytes before the last two, which are CR LF in an ASCII frame.
    body: usize,
    modified: bool,
    lost: bool,
}

impl RecordedSpan {
    fn is_whole(&self, sent: &SentFrame) -> bool {
        !self.modified && self.delivered == sent.wire.len() && self.is_contiguous()
    }

    fn is_contiguous(&self) -> bool {
        self.end - self.start == self.delivered as u64
    }
}

/// The truth about a recording: its frames and the places where bytes are missing.
pub(crate) fn truth(wire: &Wire, framing: Framing) -> (Vec<TruthFrame>, Vec<Loss>) {
    let (spans, losses) = spans(wire);
    let view = TruthBuilder { sent: &wire.frames, spans: &spans, losses: &losses, lines: wire.lines.len(), framing };
    let frames = wire.frames.iter().enumerate().filter(|(at, _)| spans[*at].delivered > 0);
    (frames.map(|(at, sent)| view.frame(at, sent)).collect(), losses)
}

fn line_id(line: usize, lines: usize) -> u8 {
    if lines == 1 {
        0
    } else {
        line as u8 + 1
    }
}

/// The position and condition of every sent frame, and the places where bytes are missing.
fn spans(wire: &Wire) -> (Vec<RecordedSpan>, Vec<Loss>) {
    let mut spans = vec![RecordedSpan::default(); wire.frames.len()];
    let mut losses = Vec::new();
    for (line, bytes) in wire.lines.iter().enumerate() {
        let id = line_id(line, wire.lines.len());
        let mut offset = 0;
        for byte in bytes {
            let span = (byte.owner != NO_FRAME).then(|| &mut spans[byte.owner as usize]);
            if byte.lost {
                if losses.last() != Some(&(id, offset)) {
                    losses.push((id, offset));
                }
                if let Some(span) = span {
                    span.lost = true;
                }
                continue;
            }
            if let Some(span) = span {
                let frame = &wire.frames[byte.owner as usize].wire;
                if span.delivered == 0 {
                    span.start = offset;
                }
                span.end = offset + 1;
                span.delivered += 1;
                span.body += usize::from(usize::from(byte.index) + 2 < frame.len());
                span.modified |= byte.value != frame[usize::from(byte.index)];
            }
            offset += 1;
        }
    }
    (spans, losses)
}

/// The sent frames with their positions, from which the truth about each is derived.
struct TruthBuilder<'a> {
    sent: &'a [SentFrame],
    spans: &'a [RecordedSpan],
    losses: &'a [Loss],
    lines: usize,
    framing: Framing,
}

impl TruthBuilder<'_> {
    /// The truth about one frame.
    fn frame(&self, at: usize, sent: &SentFrame) -> TruthFrame {
        let span = &self.spans[at];
        let valid = self.valid(at);
        let complete = !span.modified && span.body + 2 == sent.wire.len() && span.is_contiguous();
        let (labels, maybe) = if valid { self.labels(at) } else { damaged_labels(sent, span) };
        let old = match sent.role {
            FrameRole::Late { old, .. } => Some(self.sent[old].txn),
            FrameRole::Response(_) => self.late_before(at).map(|old| self.sent[old].txn),
            _ => None,
        };
        TruthFrame {
            line: line_id(sent.line, self.lines),
            start: span.start,
            end: span.end,
            direction: sent.direction,
            unit: sent.unit,
            function: sent.code & 0x7F,
            exception: sent.code & 0x80 != 0,
            txn: sent.txn,
            alternative_txn: old,
            valid,
            is_unscored: self.framing == Framing::Ascii && !valid && complete,
            is_undecided: false,
            echo: matches!(sent.role, FrameRole::Echo(_)),
            needs_no_pair: matches!(sent.role, FrameRole::WrongUnit(_) | FrameRole::Duplicate(_)),
            labels,
            allowed_labels: maybe,
            overlap_id: sent.overlap_id,
            damage: Damage { lost: span.lost, ..sent.damage },
        }
    }

    fn valid(&self, at: usize) -> bool {
        self.spans[at].is_whole(&self.sent[at])
    }

    /// The required and the allowed labels of a frame that was recorded whole.
    fn labels(&self, at: usize) -> (Labels, Labels) {
        let sent = &self.sent[at];
        let mut rules = LabelRules::default();
        if sent.direction == Direction::Request && !matches!(sent.role, FrameRole::Echo(_)) {
            self.request_labels(at, &mut rules);
        }
        match sent.role {
            FrameRole::Retry(before) => {
                let seen = self.valid(before) && !self.loss_between(before, at);
                let silent = match self.sent[before].outcome {
                    RequestOutcome::WrongUnit => self.valid(before + 1) && !self.mirrors(before, before + 1),
                    _ => true,
                };
                rules.require_if(Label::Retry, seen && silent);
            }
            FrameRole::Echo(original) => rules.require_if(Label::Echo, self.valid(original)),
            FrameRole::WrongUnit(request) => {
                // A write response from another unit that repeats the request may as well be the same request to that unit.
                let mirrors = self.mirrors(request, at);
                rules.require_if(Label::WrongUnit, self.valid(request) && !mirrors);
                rules.allow_if(Label::NoResponse, mirrors);
            }
            FrameRole::Duplicate(first) => {
                // Three equal frames may as well be a request, its retry and the response.
                let equal = self.echoes(first);
                rules.require_if(Label::Duplicate, self.valid(first) && !equal);
                rules.allow_if(Label::Retry, equal);
                // After a retry it may as well be the response to the first request.
                let FrameRole::Response(request) = self.sent[first].role else { return (rules.required, rules.allowed) };
                rules.allow_if(Label::Late, matches!(self.sent[request].role, FrameRole::Retry(_)));
            }
            FrameRole::Late { old, now } => {
                // A single response after two equal requests looks like the response to the second one.
                let both = matches!(self.sent[now].outcome, RequestOutcome::Response(own) if self.valid(own));
                rules.require_if(Label::Late, both && self.valid(old) && self.valid(now));
            }
            FrameRole::Response(_) => {
                rules.allow_if(Label::Retry, self.echoes(at) && self.is_doubled(at));
                rules.allow_if(Label::Late, self.late_before(at).is_some());
                // The late response and the response to the retry, if they are equal, may as well be one response sent twice.
                rules.allow_if(Label::Duplicate, self.late_before(at).is_some() && self.sent[at - 1].wire == self.sent[at].wire);
            }
            FrameRole::Request | FrameRole::Intruder(_) => {}
        }
        if sent.overlap_id > 0 {
            rules.require_if(
                Label::TwoMasters,
                matches!(sent.role, FrameRole::Intruder(_)) && self.overlap_is_whole(sent.overlap_id),
            );
        }
        (rules.required, rules.allowed)
    }

    /// The labels of a request that follow from what came of it.
    fn request_labels(&self, at: usize, rules: &mut LabelRules) {
        let sent = &self.sent[at];
        match sent.outcome {
            RequestOutcome::NoResponseExpected => rules.allow_if(Label::NoResponse, sent.unit != 0),
            RequestOutcome::WrongUnit => rules.allow_if(Label::NoResponse, true),
            RequestOutcome::Response(answer) => {
                let unclear = !self.valid(answer) || self.echoes(answer) && self.is_doubled(answer);
                rules.allow_if(Label::NoResponse, unclear);
            }
            RequestOutcome::NoResponse => rules.require_if(Label::NoResponse, sent.overlap_id == 0 && self.silence_is_clear(at)),
        }
        // A request may by chance equal the one before, whose response was not recorded.
        let before = self.sent[..at].iter().rposition(|other| other.direction == Direction::Request);
        if let (FrameRole::Request, Some(before)) = (sent.role, before) {
            let answered = matches!(self.sent[before].outcome, RequestOutcome::Response(answer) if self.valid(answer));
            rules.allow_if(Label::Retry, !answered && self.sent[before].wire == sent.wire);
        }
    }

    /// Whether the frame after a request without response shows that there was none.
    fn silence_is_clear(&self, at: usize) -> bool {
        let next = (at + 1..self.sent.len()).find(|&next| self.sent[next].role != FrameRole::Echo(at));
        next.is_some_and(|next| {
            let late = matches!(self.sent[next].role, FrameRole::Late { .. });
            !late && self.valid(next) && !self.loss_between(at, next)
        })
    }

    fn loss_between(&self, first: usize, second: usize) -> bool {
        let id = line_id(self.sent[first].line, self.lines);
        let (from, to) = (self.spans[first].end, self.spans[second].start);
        self.losses.iter().any(|&(line, place)| line == id && place >= from && place <= to)
    }

    /// Whether this response equals its request.
    fn echoes(&self, answer: usize) -> bool {
        match self.sent[answer].role {
            FrameRole::Response(request) => self.sent[request].wire == self.sent[answer].wire,
            _ => false,
        }
    }

    /// The request that timed out and whose late response stands directly before this response.
    fn late_before(&self, answer: usize) -> Option<usize> {
        match self.sent[answer - 1].role {
            FrameRole::Late { old, .. } => Some(old),
            _ => None,
        }
    }

    /// Whether two frames differ only in the unit.
    fn mirrors(&self, first: usize, second: usize) -> bool {
        let body = |at: usize| {
            let wire = &self.sent[at].wire;
            match self.framing {
                Framing::Rtu => &wire[1..wire.len() - 2],
                Framing::Ascii => &wire[3..wire.len() - 4],
            }
        };
        body(first) == body(second)
    }

    fn is_doubled(&self, answer: usize) -> bool {
        self.sent.get(answer + 1).is_some_and(|next| next.role == FrameRole::Duplicate(answer))
    }

    /// Whether both requests and both responses of an overlap of two masters were recorded whole.
    fn overlap_is_whole(&self, overlap_id: u32) -> bool {
        let frames = (0..self.sent.len()).filter(|&at| self.sent[at].overlap_id == overlap_id);
        frames.filter(|&at| self.valid(at)).count() == 4
    }
}

/// The required and the allowed labels of a frame that was not recorded whole.
fn damaged_labels(sent: &SentFrame, span: &RecordedSpan) -> (Labels, Labels) {
    let mut rules = LabelRules::default();
    let damage = &sent.damage;
    if span.lost {
        rules.require_if(Label::LostBytes, true);
    }
    rules.allow_if(Label::LostBytes, damage.trunc || damage.midstart || damage.no_end);
    // Labels are required of valid frames only; a damaged one may get those that fit what its sender meant it to be.
    for label in [Label::NoResponse, Label::Retry, Label::Late, Label::Duplicate, Label::Echo, Label::WrongUnit] {
        rules.allow_if(label, true);
    }
    rules.allow_if(Label::TwoMasters, sent.overlap_id > 0);
    (rules.required, rules.allowed)
}

/// The labels that a frame must get and those that it may get.
#[derive(Default)]
struct LabelRules {
    required: Labels,
    allowed: Labels,
}

impl LabelRules {
    /// Requires a label if it is certain that it applies, and allows it otherwise.
    fn require_if(&mut self, label: Label, certain: bool) {
        if certain {
            self.required.insert(label);
        } else {
            self.allowed.insert(label);
        }
    }

    /// Allows a label under a condition.
    fn allow_if(&mut self, label: Label, really: bool) {
        if really {
            self.allowed.insert(label);
        }
    }
}
