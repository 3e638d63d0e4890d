//! The truth: what was sent, where it stands in the recording, and what a good analyzer should say of it.

use crate::model::{Direction, Framing, Label, Labels};
use crate::sim::damage::Damage;
use crate::sim::wire::{Fate, Role, Sent, Wire, STRAY};

/// A frame of which at least one byte was delivered.
#[derive(Clone, Debug)]
pub struct TruthFrame {
    /// 0 for the only line; 1 and 2 for the lines A and B of a two-line tap.
    pub line: u8,
    /// Offset of its first delivered byte in that line's stream.
    pub start: u64,
    /// Offset behind its last delivered byte.
    pub end: u64,
    /// Who sent it.
    pub direction: Direction,
    /// Unit.
    pub unit: u8,
    /// Function without the exception bit.
    pub function: u8,
    /// An exception response.
    pub exception: bool,
    /// Transaction: request and response share it.
    pub txn: u32,
    /// For a late answer: the transaction that it was sent for. The retry's own answer behind it has it too: a live
    /// tap sees the first of the two as the retry's answer, and only the second as one too many.
    pub alt_txn: Option<u32>,
    /// All its bytes were delivered, unmodified and contiguous.
    pub valid: bool,
    /// Not valid, but complete up to its end mark (ASCII): to report it as whole is neither right nor wrong.
    pub lenient: bool,
    /// A local echo: its direction is a matter of taste.
    pub echo: bool,
    /// No pair is asked for: an answer from the wrong unit, or the same answer again.
    pub unpaired: bool,
    /// What must be said of it.
    pub labels: Labels,
    /// What may be said of it: the recording does not decide, or the words fit all the same.
    pub maybe: Labels,
    /// Two masters: the number of their meeting, from 1.
    pub episode: u32,
    /// What was done to it.
    pub damage: Damage,
}

/// A place where bytes are missing: line and offset of the first byte behind it.
pub type Loss = (u8, u64);

/// Where a frame stands in the recording.
#[derive(Clone, Copy, Debug, Default)]
struct Span {
    start: u64,
    end: u64,
    delivered: usize,
    /// Delivered bytes before the last two (an ASCII frame's CR LF).
    body: usize,
    modified: bool,
    lost: bool,
}

impl Span {
    fn whole(&self, sent: &Sent) -> bool {
        !self.modified && self.delivered == sent.wire.len() && self.contiguous()
    }

    fn contiguous(&self) -> bool {
        self.end - self.start == self.delivered as u64
    }
}

/// All of the truth about a recording.
pub(crate) fn truth(wire: &Wire, framing: Framing) -> (Vec<TruthFrame>, Vec<Loss>) {
    let (spans, losses) = spans(wire);
    let view = View { sent: &wire.frames, spans: &spans, losses: &losses, lines: wire.lines.len(), framing };
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

fn spans(wire: &Wire) -> (Vec<Span>, Vec<Loss>) {
    let mut spans = vec![Span::default(); wire.frames.len()];
    let mut losses = Vec::new();
    for (line, bytes) in wire.lines.iter().enumerate() {
        let id = line_id(line, wire.lines.len());
        let mut offset = 0;
        for byte in bytes {
            let span = (byte.owner != STRAY).then(|| &mut spans[byte.owner as usize]);
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

/// Sent frames and their places.
struct View<'a> {
    sent: &'a [Sent],
    spans: &'a [Span],
    losses: &'a [Loss],
    lines: usize,
    framing: Framing,
}

impl View<'_> {
    fn frame(&self, at: usize, sent: &Sent) -> TruthFrame {
        let span = &self.spans[at];
        let valid = self.valid(at);
        let complete = !span.modified && span.body + 2 == sent.wire.len() && span.contiguous();
        let (labels, maybe) = if valid { self.labels(at) } else { damaged_labels(sent, span) };
        let old = match sent.role {
            Role::Late { old, .. } => Some(self.sent[old].txn),
            Role::Answer(_) => self.late_before(at).map(|old| self.sent[old].txn),
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
            alt_txn: old,
            valid,
            lenient: self.framing == Framing::Ascii && !valid && complete,
            echo: matches!(sent.role, Role::Echo(_)),
            unpaired: matches!(sent.role, Role::WrongUnit(_) | Role::Duplicate(_)),
            labels,
            maybe,
            episode: sent.episode,
            damage: Damage { lost: span.lost, ..sent.damage },
        }
    }

    fn valid(&self, at: usize) -> bool {
        self.spans[at].whole(&self.sent[at])
    }

    /// What to say of a frame that arrived whole.
    fn labels(&self, at: usize) -> (Labels, Labels) {
        let sent = &self.sent[at];
        let mut said = Said::default();
        if sent.direction == Direction::Request && !matches!(sent.role, Role::Echo(_)) {
            self.request_labels(at, &mut said);
        }
        match sent.role {
            Role::Retry(before) => {
                let seen = self.valid(before) && !self.loss_between(before, at);
                let silent = match self.sent[before].fate {
                    Fate::Elsewhere => self.valid(before + 1) && !self.mirrors(before, before + 1),
                    _ => true,
                };
                said.say(Label::Retry, seen && silent);
            }
            Role::Echo(original) => said.say(Label::Echo, self.valid(original)),
            Role::WrongUnit(request) => {
                // An echoed write from another unit may as well be the same write to that unit.
                let mirrors = self.mirrors(request, at);
                said.say(Label::WrongUnit, self.valid(request) && !mirrors);
                said.perhaps(Label::NoResponse, mirrors);
            }
            Role::Duplicate(first) => {
                // Three equal frames may as well be a request, its retry and the answer.
                let equal = self.echoes(first);
                said.say(Label::Duplicate, self.valid(first) && !equal);
                said.perhaps(Label::Retry, equal);
                // Behind a retry it may as well be the first request's answer.
                let Role::Answer(request) = self.sent[first].role else { return (said.must, said.may) };
                said.perhaps(Label::Late, matches!(self.sent[request].role, Role::Retry(_)));
            }
            Role::Late { old, now } => {
                // One answer behind two equal requests answers the second, for all that anybody can see.
                let both = matches!(self.sent[now].fate, Fate::Answered(own) if self.valid(own));
                said.say(Label::Late, both && self.valid(old) && self.valid(now));
            }
            Role::Answer(_) => {
                said.perhaps(Label::Retry, self.echoes(at) && self.is_doubled(at));
                said.perhaps(Label::Late, self.late_before(at).is_some());
                // The late answer and the retry's own, byte for byte the same, may as well be one answer twice.
                said.perhaps(Label::Duplicate, self.late_before(at).is_some() && self.sent[at - 1].wire == self.sent[at].wire);
            }
            Role::Request | Role::Intruder(_) => {}
        }
        if sent.episode > 0 {
            said.say(Label::TwoMasters, matches!(sent.role, Role::Intruder(_)) && self.meeting_is_whole(sent.episode));
        }
        (said.must, said.may)
    }

    fn request_labels(&self, at: usize, said: &mut Said) {
        let sent = &self.sent[at];
        match sent.fate {
            Fate::NotDue => said.perhaps(Label::NoResponse, sent.unit != 0),
            Fate::Elsewhere => said.perhaps(Label::NoResponse, true),
            Fate::Answered(answer) => {
                let unclear = !self.valid(answer) || self.echoes(answer) && self.is_doubled(answer);
                said.perhaps(Label::NoResponse, unclear);
            }
            Fate::Silence => said.say(Label::NoResponse, sent.episode == 0 && self.silence_is_clear(at)),
        }
        // By chance the same request again, after one whose answer nobody saw.
        let before = self.sent[..at].iter().rposition(|other| other.direction == Direction::Request);
        if let (Role::Request, Some(before)) = (sent.role, before) {
            let answered = matches!(self.sent[before].fate, Fate::Answered(answer) if self.valid(answer));
            said.perhaps(Label::Retry, !answered && self.sent[before].wire == sent.wire);
        }
    }

    /// Whether what follows an unanswered request shows that there was no answer.
    fn silence_is_clear(&self, at: usize) -> bool {
        let next = (at + 1..self.sent.len()).find(|&next| self.sent[next].role != Role::Echo(at));
        next.is_some_and(|next| {
            let late = matches!(self.sent[next].role, Role::Late { .. });
            !late && self.valid(next) && !self.loss_between(at, next)
        })
    }

    fn loss_between(&self, first: usize, second: usize) -> bool {
        let id = line_id(self.sent[first].line, self.lines);
        let (from, to) = (self.spans[first].end, self.spans[second].start);
        self.losses.iter().any(|&(line, place)| line == id && place >= from && place <= to)
    }

    /// Whether this answer repeats its request byte for byte.
    fn echoes(&self, answer: usize) -> bool {
        match self.sent[answer].role {
            Role::Answer(request) => self.sent[request].wire == self.sent[answer].wire,
            _ => false,
        }
    }

    /// The given-up request whose late answer stands before this answer.
    fn late_before(&self, answer: usize) -> Option<usize> {
        match self.sent[answer - 1].role {
            Role::Late { old, .. } => Some(old),
            _ => None,
        }
    }

    /// Whether two frames say the same but for the unit.
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
        self.sent.get(answer + 1).is_some_and(|next| next.role == Role::Duplicate(answer))
    }

    /// Whether both requests and both answers of a meeting of two masters arrived.
    fn meeting_is_whole(&self, episode: u32) -> bool {
        let frames = (0..self.sent.len()).filter(|&at| self.sent[at].episode == episode);
        frames.filter(|&at| self.valid(at)).count() == 4
    }
}

/// What to say of a frame that did not arrive whole.
fn damaged_labels(sent: &Sent, span: &Span) -> (Labels, Labels) {
    let mut said = Said::default();
    let damage = &sent.damage;
    if span.lost {
        said.say(Label::LostBytes, true);
    }
    said.perhaps(Label::LostBytes, damage.trunc || damage.midstart || damage.no_end);
    // The scorer asks valid frames only; a damaged one may be called what its sender meant it to be.
    for label in [Label::NoResponse, Label::Retry, Label::Late, Label::Duplicate, Label::Echo, Label::WrongUnit] {
        said.perhaps(label, true);
    }
    said.perhaps(Label::TwoMasters, sent.episode > 0);
    (said.must, said.may)
}

#[derive(Default)]
struct Said {
    must: Labels,
    may: Labels,
}

impl Said {
    fn say(&mut self, label: Label, certain: bool) {
        if certain {
            self.must.insert(label);
        } else {
            self.may.insert(label);
        }
    }

    fn perhaps(&mut self, label: Label, really: bool) {
        if really {
            self.may.insert(label);
        }
    }
}
