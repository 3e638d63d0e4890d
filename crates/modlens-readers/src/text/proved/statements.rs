//! Learns which statements of a program print frames, although no checksum proves the bytes of some of them.
//!
//! A statement is what lines with the same text in front of their bytes come from (`shapes`). The lines of a text are looked
//! at together, before the text is read:
//!
//! - A statement whose lines take turns with proven requests prints the responses to them, even where every one is damaged.
//!   Its label, the likeness of both labels, unit, function and length of its bytes, and the number of turns are evidence.
//! - Where no checksum is printed at all, requests and responses prove each other: unit, function, quantity and length.
//! - A statement whose proven frames are requests only labels requests, in any language, if another one labels responses.

use std::collections::BTreeSet;

use crate::chunk::Side;
use crate::text::frame_evidence::proven_framing;
use crate::text::proved::kinds::{Kinds, Mention};
use crate::text::proved::runs::Style;
use crate::text::proved::shapes::Shape;
use modlens_protocol::checksum::CRC_BYTES;
use modlens_protocol::direction::{expected_data_bytes, match_response, possible_directions, RequestRef, ResponseMatch};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::mbap::PREFIX_BYTES;

/// The most runs of bytes that are compared.
const MAX_MENTIONS: usize = 4000;

/// The evidence that a statement without proof needs; `Turns::evidence` lists what counts.
const MIN_EVIDENCE: u32 = 3;

/// The evidence that exchanges without checksums need; `exchange_evidence` lists what counts.
const MIN_EXCHANGE_EVIDENCE: u32 = 3;

/// So many turns are no coincidence.
const MANY_TURNS: usize = 3;

/// The most stray bytes in front of a damaged response.
const MAX_STRAY_BYTES: usize = 2;

/// More statements than these in one text are no program's.
const MAX_TOLD_AGAIN: usize = 64;

/// What a statement prints.
#[derive(Clone, Copy, Debug)]
struct Statement {
    shape: Shape,
    side: Option<Side>,
    lacks_checksum: bool,
}

/// The statements that print frames.
#[derive(Clone, Debug, Default)]
pub(super) struct Statements {
    known: Vec<Statement>,
    /// Those of which a text has one line.
    single: Vec<Shape>,
    /// Those whose frames the next line names again: what a person typed, and what became of it.
    told_again: Vec<Shape>,
    /// How many requests without checksum are followed by a response that fits, of how many.
    pub exchanges: (usize, usize),
}

/// How the lines of one statement stand to proven frames.
#[derive(Clone, Copy, Debug, Default)]
struct Turns {
    lines: usize,
    /// Lines that follow a proven request, or precede a proven response without a request.
    count: usize,
    /// Of these, lines that share the unit, unit and function, and also the length with their counterpart.
    fits: [usize; 3],
    /// Lines that would be the response without checksum to the request before them.
    without_checksum: usize,
    /// The words in front say that somebody sent the bytes, and not that it was who sent the counterpart.
    says_side: bool,
    /// They say so of both, and that these were two.
    says_other_side: bool,
    has_similar_label: bool,
    ends_line: bool,
    is_request: bool,
    /// Lines of which the words in front say who sent their bytes, which begin with the unit and the function of a proven frame.
    alike: usize,
    /// Who sent these.
    side: Option<Side>,
}

impl Turns {
    /// Whether the lines are damaged or unchecked counterparts of proven frames.
    fn are_frames(self) -> bool {
        2 * self.count >= self.lines && self.count > 0 && self.evidence() >= MIN_EVIDENCE
    }

    /// Whether the lines say who sent their bytes, and these begin as proven frames do.
    fn are_named_frames(self) -> bool {
        2 * self.alike >= self.lines && self.alike > 0
    }

    fn evidence(self) -> u32 {
        let most = |fits: usize| 2 * fits >= self.count;
        let likeness = u32::from(most(self.fits[0])) + u32::from(most(self.fits[1])) + u32::from(most(self.fits[2]));
        u32::from(self.says_side)
            + u32::from(self.says_other_side)
            + u32::from(self.has_similar_label)
            + u32::from(self.ends_line)
            + likeness
            + u32::from(self.count >= MANY_TURNS || (self.fits[1] == self.count && self.count > 1))
    }
}

impl Statements {
    /// Learns from all runs of bytes at the beginning of a text, in their order.
    pub fn learn(mentions: &[Mention]) -> Self {
        let mentions = &mentions[..mentions.len().min(MAX_MENTIONS)];
        let (single, told_again) = (single_shapes(mentions), told_again(mentions));
        let mut learned = Self { single, told_again, ..Self::default() };
        let mut styles: Vec<Style> = Vec::new();
        for mention in mentions {
            if !styles.contains(&mention.style) {
                styles.push(mention.style);
            }
        }
        let of_style = |style: Style| mentions.iter().filter(|one| one.style == style).collect::<Vec<_>>();
        for style in styles.iter().map(|style| of_style(*style)).filter(|style| style.iter().any(|one| one.is_frame)) {
            learned.learn_turns(&style);
        }
        if !mentions.iter().any(|one| one.is_frame) {
            let best = styles.into_iter().map(of_style).map(|style| (exchange_evidence(&style), style));
            if let Some((_, style)) =
                best.filter(|(evidence, _)| *evidence >= MIN_EXCHANGE_EVIDENCE).max_by_key(|(evidence, _)| *evidence)
            {
                learned.learn_exchanges(&style);
            }
        }
        learned
    }

    /// Whether frames are read from lines of this statement, although nothing proves them.
    pub fn contains(&self, shape: Shape) -> bool {
        self.known.iter().any(|one| one.shape == shape)
    }

    /// Whether the text has one line of this statement and no more.
    pub fn is_single(&self, shape: Shape) -> bool {
        self.single.binary_search(&shape).is_ok()
    }

    /// Whether the text has any statement of one line.
    pub fn has_single(&self) -> bool {
        !self.single.is_empty()
    }

    /// Whether the next line says the same again, and who sent it.
    pub fn is_told_again(&self, shape: Shape) -> bool {
        self.told_again.contains(&shape)
    }

    /// Who sent the bytes of this statement, as far as the text shows it.
    pub fn side(&self, shape: Shape) -> Option<Side> {
        self.known.iter().find(|one| one.shape == shape)?.side
    }

    /// Whether this statement prints frames without their checksum.
    pub fn lacks_checksum(&self, shape: Shape) -> bool {
        self.known.iter().any(|one| one.shape == shape && one.lacks_checksum)
    }

    fn add(&mut self, shape: Shape, side: Option<Side>, lacks_checksum: bool) {
        if !self.contains(shape) {
            self.known.push(Statement { shape, side, lacks_checksum });
        }
    }

    /// Learns from lines in one notation, some of which hold proven frames.
    fn learn_turns(&mut self, mentions: &[&Mention]) {
        let kinds = Kinds::of(mentions);
        let mut found: Vec<(Shape, Turns)> = Vec::new();
        let is_bare_copy =
            |one: &Mention| !one.is_frame && mentions.iter().any(|frame| frame.is_frame && is_body_of(&one.bytes, frame));
        for (at, mention) in mentions.iter().enumerate().filter(|(_, one)| !kinds.is_proven(one.shape) && !is_bare_copy(one)) {
            let index = found.iter().position(|(shape, _)| *shape == mention.shape).unwrap_or_else(|| {
                found.push((mention.shape, Turns::default()));
                found.len() - 1
            });
            let turns = &mut found[index].1;
            turns.lines += 1;
            if mention.side.is_some() && kinds.begins_alike(&mention.bytes) {
                turns.alike += 1;
                turns.side = mention.side;
            }
            let before = at.checked_sub(1).map(|before| mentions[before]).filter(|one| one.is_frame && kinds.is_request(one));
            let behind = mentions.get(at + 1).copied().filter(|one| one.is_frame && kinds.kind(one.shape) < 0);
            match (before, behind) {
                (Some(request), _) => turns.add(mention, request, response_fit(&request.bytes, &mention.bytes)),
                (None, Some(response)) => {
                    turns.is_request = true;
                    turns.add(mention, response, request_fit(&mention.bytes, &response.bytes));
                }
                _ => {}
            }
        }
        let named: Vec<_> = found.iter().filter(|(_, turns)| turns.are_named_frames()).copied().collect();
        found.retain(|(_, turns)| turns.are_frames());
        let has_requests = kinds.all.iter().any(|(_, kind)| *kind > 0) || found.iter().any(|(_, turns)| turns.is_request);
        let has_responses = kinds.all.iter().any(|(_, kind)| *kind < 0) || found.iter().any(|(_, turns)| !turns.is_request);
        let side = |is_request: bool| {
            let is_sent = is_request == kinds.master_logs(mentions);
            (has_requests && has_responses).then_some(if is_sent { Side::Sent } else { Side::Received })
        };
        for (shape, turns) in found {
            let lacks_checksum = 2 * turns.without_checksum > turns.count;
            self.add(shape, side(turns.is_request), lacks_checksum);
        }
        for (shape, turns) in named {
            self.add(shape, turns.side, false);
        }
        for &(shape, kind) in &kinds.all {
            let is_repeated = mentions.iter().filter(|one| one.is_frame && one.shape == shape).nth(1).is_some();
            if kind != 0 || is_repeated {
                self.add(shape, side(kind > 0).filter(|_| kind != 0), false);
            }
        }
    }

    /// Learns from lines in one notation, none of which has a checksum, and whose exchanges prove each other.
    fn learn_exchanges(&mut self, mentions: &[&Mention]) {
        let mut requests = 0;
        for two in mentions.windows(2).filter(|two| is_request(&two[0].bytes)) {
            requests += 1;
            if exchange_worth(&two[0].bytes, &two[1].bytes) > 0 {
                self.exchanges.0 += 1;
                let has_labels = two[0].shape != two[1].shape;
                self.add(two[0].shape, has_labels.then_some(Side::Sent), true);
                self.add(two[1].shape, has_labels.then_some(Side::Received), true);
            }
        }
        self.exchanges.1 = requests.max(self.exchanges.0);
    }
}

impl Turns {
    /// Counts a line and its counterpart.
    fn add(&mut self, mention: &Mention, other: &Mention, fit: Fit) {
        self.count += 1;
        for (count, least) in self.fits.iter_mut().zip(1..) {
            *count += usize::from(fit.level >= least);
        }
        self.without_checksum += usize::from(fit.lacks_checksum);
        self.ends_line |= mention.ends_line && other.ends_line && fit.level > 1;
        self.says_side |= mention.side.is_some() && mention.side != other.side;
        self.says_other_side |= self.says_side && (other.side.is_some() || fit.level > 0);
        let common = mention.label.iter().filter(|word| other.label.contains(word)).count();
        self.has_similar_label |= common > 0 && 2 * common >= mention.label.len().max(other.label.len());
    }
}

/// Whether these bytes are a proven RTU frame without its checksum, as a person types it, or a program prints it before it adds that.
fn is_body_of(bytes: &[u8], frame: &Mention) -> bool {
    frame.bytes.len() == bytes.len() + CRC_BYTES
        && frame.bytes.starts_with(bytes)
        && proven_framing(&frame.bytes) == Some(Mode::Rtu)
}

/// The shapes each of whose frames the next line, of another shape, repeats and calls sent, or received, as they do.
fn told_again(mentions: &[Mention]) -> Vec<Shape> {
    let mut found: Vec<(Shape, bool)> = Vec::new();
    for (at, mention) in mentions.iter().enumerate().filter(|(_, one)| one.is_frame && one.side.is_some()) {
        let next = mentions.get(at + 1);
        let is_repeated =
            next.is_some_and(|next| next.side == mention.side && next.bytes == mention.bytes && next.shape != mention.shape);
        match found.iter_mut().find(|(shape, _)| *shape == mention.shape) {
            Some((_, is_always)) => *is_always &= is_repeated,
            None => found.push((mention.shape, is_repeated)),
        }
        if found.len() > MAX_TOLD_AGAIN {
            return Vec::new();
        }
    }
    found.into_iter().filter(|(_, is_always)| *is_always).map(|(shape, _)| shape).collect()
}

/// The shapes of which there is one line, in order; none where the text may have further lines.
fn single_shapes(mentions: &[Mention]) -> Vec<Shape> {
    if mentions.len() == MAX_MENTIONS {
        return Vec::new();
    }
    let mut all: Vec<Shape> = mentions.iter().map(|one| one.shape).collect();
    all.sort_unstable();
    all.chunk_by(|one, other| one == other).filter(|same| same.len() == 1).map(|same| same[0]).collect()
}

/// How well a run of bytes fits its counterpart: 1 by the unit, 2 also by the function, 3 also by the length.
#[derive(Clone, Copy, Debug, Default)]
struct Fit {
    level: usize,
    lacks_checksum: bool,
}

/// The unit and the PDU of a proven frame, and how many bytes are in front of the unit.
fn parts(frame: &[u8]) -> (u8, &[u8], usize) {
    match proven_framing(frame) {
        Some(Mode::Tcp) => (frame[PREFIX_BYTES], &frame[PREFIX_BYTES + 1..], PREFIX_BYTES),
        _ => (frame[0], &frame[1..frame.len() - CRC_BYTES], 0),
    }
}

/// How well the bytes fit a proven request as its response, perhaps with stray bytes in front of them.
fn response_fit(request: &[u8], bytes: &[u8]) -> Fit {
    let functions = Functions::embedded();
    let (unit, pdu, front) = parts(request);
    let asked = RequestRef { unit, pdu };
    let row = functions.row(pdu[0], &pdu[1..]);
    let expected = row.and_then(|row| expected_data_bytes(row, pdu));
    let mut best = Fit { level: usize::from(bytes.get(front) == Some(&unit)), lacks_checksum: false };
    for rest in (0..=MAX_STRAY_BYTES).filter_map(|stray| bytes.get(front + stray..)).filter(|rest| rest.len() >= 2) {
        if rest[0] != unit || rest[1] & 0x7F != pdu[0] {
            continue;
        }
        let fully = |pdu: &[u8]| row.is_some() && match_response(functions, asked, unit, pdu) == ResponseMatch::Fully;
        let lacks_checksum = front == 0 && fully(&rest[1..]);
        let has_length = expected.is_some_and(|data| rest.len() == 3 + data + CRC_BYTES);
        let checked = rest.len() > 1 + CRC_BYTES && fully(&rest[1..rest.len() - CRC_BYTES]);
        let level = if lacks_checksum || has_length || checked { 3 } else { 2 };
        if level > best.level {
            best = Fit { level, lacks_checksum };
        }
    }
    best
}

/// How well the bytes fit a proven response as its request.
fn request_fit(bytes: &[u8], response: &[u8]) -> Fit {
    let (unit, pdu, front) = parts(response);
    let Some([own_unit, own @ ..]) = bytes.get(front..).filter(|rest| rest.len() >= 4) else { return Fit::default() };
    let asks = |asked: &[u8]| {
        let asked = RequestRef { unit: *own_unit, pdu: asked };
        match_response(Functions::embedded(), asked, unit, pdu) == ResponseMatch::Fully
    };
    let lacks_checksum = front == 0 && is_request(bytes) && asks(own);
    let has_function = *own_unit == unit && own[0] == pdu[0] & 0x7F;
    let level = match () {
        () if lacks_checksum || (has_function && asks(&own[..own.len() - CRC_BYTES])) => 3,
        () if has_function => 2,
        () => usize::from(*own_unit == unit),
    };
    Fit { level, lacks_checksum }
}

/// Whether these bytes are a request of a known function that was printed without its checksum.
fn is_request(bytes: &[u8]) -> bool {
    let functions = Functions::embedded();
    bytes.len() >= 3 && functions.row(bytes[1], &bytes[2..]).is_some() && possible_directions(functions, &bytes[1..]).0
}

/// What two runs of bytes, read as a request and its response without checksums, prove: a read, whose quantity and length have
/// to agree, is enough alone; an exception is nearly enough, and an echo is what other protocols have as well.
fn exchange_worth(request: &[u8], response: &[u8]) -> u32 {
    let functions = Functions::embedded();
    let Some((unit, pdu)) = response.split_first().filter(|(_, pdu)| pdu.len() >= 2) else { return 0 };
    let asked = RequestRef { unit: request[0], pdu: &request[1..] };
    if !is_request(request) || match_response(functions, asked, *unit, pdu) != ResponseMatch::Fully {
        return 0;
    }
    match functions.row(request[1], &request[2..]).and_then(|row| expected_data_bytes(row, &request[1..])) {
        _ if pdu[0] & 0x80 != 0 => 2,
        Some(1..) => 3,
        _ => ECHO_WORTH,
    }
}

/// What an echo is worth.
const ECHO_WORTH: u32 = 1;

/// The sum of what the exchanges prove, an echo that comes again not counted; 0 if most of the runs belong to none.
fn exchange_evidence(mentions: &[&Mention]) -> u32 {
    let worths: Vec<u32> = mentions.windows(2).map(|two| exchange_worth(&two[0].bytes, &two[1].bytes)).collect();
    let fitting = worths.iter().filter(|worth| **worth > 0).count();
    if 3 * 2 * fitting < mentions.len() {
        return 0;
    }
    let mut echoes = BTreeSet::new();
    let counts = |(worth, mention): (u32, &&Mention)| {
        let is_known_echo = worth == ECHO_WORTH && !echoes.insert(mention.bytes.clone());
        if is_known_echo {
            0
        } else {
            worth
        }
    };
    worths.into_iter().zip(mentions).map(counts).sum()
}
