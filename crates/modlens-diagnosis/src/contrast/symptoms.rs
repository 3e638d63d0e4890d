//! What failed or odd transactions look like, one symptom each: what a joint explanation has to account for.

use std::collections::BTreeMap;

use modlens_protocol::checksum::crc_valid;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::{Functions, StandardLayout, EXCEPTION_BIT};
use modlens_protocol::in_words;
use modlens_protocol::mbap::{layout_lengths, PREFIX_BYTES};
use modlens_protocol::oddity::{bare_refusals, is_of_driver, is_swapped, is_text, lacks_last, Oddity};
use modlens_protocol::Ns;

use super::almost::{added_byte, counted_more, due, is_on_swapped_wires, place_behind_strays};
use super::before::Before;
use super::tally::{Place, Tally};
use crate::observation::{
    added, answer_length, data_length, figures_of_header, lacks_count, DamagedPart, Figures, FrameObservation, LayoutFault,
    Observation, Outcome, RequestKey,
};
use crate::protocols;

macro_rules! symptoms {
    ($($(#[$doc:meta])* $name:ident = $word:literal),* $(,)?) => {
        /// What an odd transaction or run of bytes looks like. `dissectors/diagnoses.toml` says how often each cause shows each.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Symptom { $($(#[$doc])* $name),* }

        impl Symptom {
            /// All of them.
            pub const ALL: &'static [Self] = &[$(Self::$name),*];

            /// The word in the table.
            pub fn word(self) -> &'static str {
                match self { $(Self::$name => $word),* }
            }
        }
    };
}

symptoms! {
    /// No answer came.
    NoAnswer = "no_answer",
    /// No answer of the unit is in the recording; only a first sight separates this from the others (`sight`).
    NeverAnswered = "never_answered",
    /// The answer is damaged from its first byte on, and no answer of the unit is valid; a first sight names this, too.
    NeverValid = "never_valid",
    /// A frame of another framing than the one before.
    OtherFraming = "other_framing",
    /// The answer came after the master had given up.
    LateAnswer = "late_answer",
    /// The answer equals the request, whole or cut.
    Echo = "echo",
    /// The answer is that to the request before.
    StepBehind = "step_behind",
    /// The answer carries the identifier of no open request.
    OtherId = "other_id",
    /// The answer carries the identifier of the request, but neither its unit nor its function.
    OtherHead = "other_head",
    /// Another unit answered.
    OtherUnit = "other_unit",
    /// The answer carries the identifier of the request and another unit.
    OtherUnitNumber = "other_unit_number",
    /// Another function was answered.
    OtherFunction = "other_function",
    /// The answer has another length than asked for, and a right checksum.
    OtherLength = "other_length",
    /// The answer lacks the byte count, and its checksum is right.
    CountMissing = "count_missing",
    /// The byte count has two bytes, and the checksum is right.
    CountWide = "count_wide",
    /// The byte count is not that of the bytes that follow, and the checksum is right.
    CountWrong = "count_wrong",
    /// The layout is not that of the function in another way, and the checksum is right.
    OtherLayout = "other_layout",
    /// The length field of an MBAP header is wrong.
    HeaderLength = "header_length",
    /// Over Modbus/TCP, a request or an answer without its MBAP header.
    HeaderMissing = "header_missing",
    /// The checksum is right but for the order of its two bytes.
    ChecksumSwapped = "checksum_swapped",
    /// Bytes follow a frame over Modbus/TCP whose header announces no more.
    BytesAfter = "bytes_after",
    /// A write is confirmed with another address or value.
    OtherValue = "other_value",
    /// A request without a checksum.
    RequestBare = "request_bare",
    /// The byte count, the quantity and the data of a request do not agree.
    RequestLayout = "request_layout",
    /// A request that was not answered asks for more than its function allows, or for nothing.
    RequestLimit = "request_limit",
    /// A write of a coil that was not answered has a value other than FF00 and 0000.
    RequestCoil = "request_coil",
    /// The byte count of the answer is not that of what was asked for, and the reader has stopped where the right one would end it.
    AnswerCounted = "answer_counted",
    /// A refusal without a checksum.
    RefusalBare = "refusal_bare",
    /// A refusal without its code, and with a right checksum.
    RefusalShort = "refusal_short",
    /// What came as the answer is a frame in hex digits.
    AnswerDigits = "answer_digits",
    /// The answer is the request with some of its bits changed.
    AlteredEcho = "altered_echo",
    /// The answer stops before its end, and is right as far as it goes.
    AnswerCut = "answer_cut",
    /// After such an answer, what came as the next one does not begin as an answer.
    AnswerRest = "answer_rest",
    /// The answer begins with the unit and lacks bytes after it.
    AnswerShort = "answer_short",
    /// A single byte after an answer: the unit's number, with which the next one begins.
    NextStart = "next_start",
    /// A valid answer that nobody asked for.
    SecondAnswer = "second_answer",
    /// The answer is damaged in its first one or two bytes, or lacks them.
    AnswerStart = "answer_start",
    /// The answer is damaged in its last bytes, or lacks them.
    AnswerEnd = "answer_end",
    /// One bit of the answer is wrong.
    AnswerBit = "answer_bit",
    /// The answer is right but for one byte too many.
    AnswerAdded = "answer_added",
    /// The answer is damaged after an intact beginning.
    AnswerInside = "answer_inside",
    /// The answer is damaged from its first byte on.
    AnswerWhole = "answer_whole",
    /// The answer begins with the unit, and is damaged after it.
    AnswerUnit = "answer_unit",
    /// The answer begins one or two bytes late: strays came before it.
    AnswerShifted = "answer_shifted",
    /// The answer begins after a run of bytes as a line leaves that nobody drives.
    AnswerBehind = "answer_behind",
    /// What came is the beginning of the answer with all levels inverted.
    AnswerSwapped = "answer_swapped",
    /// What came as the answer is a frame of another protocol.
    AnswerForeign = "answer_foreign",
    /// What came as the answer is text.
    AnswerText = "answer_text",
    /// What came as the answer consists of 00, FF and bytes with one run of equal bits.
    AnswerInverted = "answer_inverted",
    /// The request is damaged in its last bytes, or lacks them.
    RequestEnd = "request_end",
    /// The request is damaged elsewhere.
    RequestInside = "request_inside",
    /// A whole request is among what a program received that sends requests itself.
    ForeignRequest = "foreign_request",
    /// The request was sent while another one was open.
    RequestCrossed = "request_crossed",
    /// The answer collided with another frame.
    Collision = "collision",
    /// Refused: exception 1.
    RefusedFunction = "refused_function",
    /// Refused: exception 2.
    RefusedAddress = "refused_address",
    /// The same of an address that is the number of such a register in manuals.
    RefusedReference = "refused_reference",
    /// Refused: exception 3.
    RefusedValue = "refused_value",
    /// The same of a quantity that the protocol does not allow.
    RefusedQuantity = "refused_quantity",
    /// The same of a request that writes one value: there is no quantity to refuse.
    RefusedOneValue = "refused_one_value",
    /// Refused: exception 4.
    RefusedFailure = "refused_failure",
    /// Refused: exception 5 or 6.
    RefusedBusy = "refused_busy",
    /// Refused: exception 10.
    RefusedPath = "refused_path",
    /// Refused: exception 11.
    RefusedGateway = "refused_gateway",
    /// Refused with another exception.
    RefusedOther = "refused_other",
    /// One or two bytes between frames, as a driver leaves when it is switched.
    Stray = "stray",
    /// Text between frames.
    Text = "text",
    /// Other bytes between frames.
    Noise = "noise",
}

impl Symptom {
    /// Whether a frame is built wrongly, by the program that made it.
    pub fn is_of_layout(self) -> bool {
        (Self::CountMissing..=Self::AnswerDigits).contains(&self)
    }

    /// Whether a frame shows it by itself, whatever came before it.
    pub fn is_of_frame(self) -> bool {
        self.is_of_layout() || self.is_refusal() || matches!(self, Self::Stray | Self::Text)
    }

    /// Whether the request was refused by an exception.
    pub fn is_refusal(self) -> bool {
        (Self::RefusedFunction..=Self::RefusedOther).contains(&self)
    }
}

/// How often each symptom was seen, by unit; `None` where no unit is near.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Symptoms(BTreeMap<(Symptom, Option<u8>), Seen>);

/// How often a symptom was seen of a unit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seen {
    /// All of them.
    pub all: Tally,
    /// Those that are failed requests; others are refusals, odd answers, and bytes between frames.
    pub failed_requests: u64,
    /// The numbers that show it, of the first of them.
    pub figures: Option<Figures>,
}

impl Symptoms {
    fn count(&mut self, symptom: Symptom, unit: Option<u8>, place: Place) -> &mut Seen {
        let seen = self.0.entry((symptom, unit)).or_default();
        seen.all.count(true, place);
        seen
    }

    /// Counts a transaction, if it is odd.
    pub(super) fn transaction(&mut self, seen: &Observation, before: Before) {
        if let Some(symptom) = of_transaction(seen, before) {
            let is_failure = seen.outcome.counts() && seen.outcome.is_failure();
            let counted = self.count(symptom, Some(seen.unit), seen.place);
            counted.failed_requests += u64::from(is_failure);
            counted.figures = counted.figures.or_else(|| figures(symptom, seen, before));
        }
    }

    /// Counts a frame of another framing than the one before.
    pub(super) fn other_framing(&mut self, seen: &FrameObservation) {
        self.count(Symptom::OtherFraming, seen.unit, seen.place);
    }

    /// Counts an answer that was taken as it is, although the bytes of its checksum are swapped.
    pub(super) fn swapped_checksum(&mut self, seen: &FrameObservation) {
        self.count(Symptom::ChecksumSwapped, seen.unit, seen.place);
    }

    /// Counts a request that another master has sent.
    pub(super) fn foreign_request(&mut self, seen: &FrameObservation) {
        self.count(Symptom::ForeignRequest, seen.unit, seen.place).figures = seen.unit.map(|unit| [unit.into(), 0]);
    }

    /// Counts a frame of no transaction whose layout is not that of its function, although its checksum or header is right.
    pub(super) fn lone_layout(&mut self, seen: &FrameObservation) {
        let is_odd = seen.findings.has(Finding::LengthMismatch) || seen.findings.has(Finding::MbapLength);
        if is_odd && seen.txn.is_none() && seen.verdict == Verdict::Ok {
            self.count(Symptom::OtherLayout, seen.unit, seen.place);
        }
    }

    /// Counts bytes that belong to no transaction, near this unit; `is_behind_header` as `Around` says it.
    pub(super) fn frame(&mut self, seen: &FrameObservation, unit: Option<u8>, is_behind_header: bool) {
        if let Some((unit, code, times)) = bare_refusals(&seen.bytes) {
            for _ in 0..times {
                self.count(Symptom::RefusalBare, Some(unit), seen.place).figures = Some([code.into(), 0]);
            }
            return;
        }
        let symptom = match seen.bytes.as_slice() {
            bytes if is_behind_header && is_header(bytes) && added(bytes).is_none() => Symptom::HeaderLength,
            _ if is_behind_header => Symptom::BytesAfter,
            [byte] if Some(*byte) == unit => Symptom::NextStart,
            bytes if matches!(Oddity::of(bytes), Some(Oddity::Digits(_))) => Symptom::AnswerDigits,
            bytes if is_swapped(bytes) => Symptom::ChecksumSwapped,
            bytes if counted(seen).is_some() && crc_valid(bytes) => Symptom::CountWrong,
            [1..=247, pdu @ ..] if seen.mode == Mode::Tcp && in_words::pdu(pdu).is_some() => Symptom::HeaderMissing,
            bytes if bytes.len() < 3 && bytes.iter().all(|byte| is_of_driver(*byte)) => Symptom::Stray,
            bytes if is_text(bytes) => Symptom::Text,
            _ => Symptom::Noise,
        };
        let counted = self.count(symptom, unit, seen.place);
        let is_whole = || layout_lengths(Functions::embedded(), &seen.bytes).contains(&Some(seen.length as usize));
        if symptom == Symptom::HeaderLength && seen.bytes.len() == seen.length as usize && is_whole() {
            counted.figures = counted.figures.or(figures_of_header(&seen.bytes));
        }
        if symptom == Symptom::CountWrong {
            counted.figures = counted.figures.or(self::counted(seen));
        }
        if symptom == Symptom::BytesAfter {
            counted.figures = counted.figures.or(Some([added(&seen.bytes).unwrap_or(seen.length), 0]));
        }
    }

    pub(super) fn merge(&mut self, later: &Self) {
        for (key, seen) in &later.0 {
            let own = self.0.entry(*key).or_default();
            own.all.merge(&seen.all);
            own.failed_requests += seen.failed_requests;
            own.figures = own.figures.or(seen.figures);
        }
    }

    /// The numbers that show a symptom of a unit.
    pub fn figures(&self, symptom: Symptom, unit: Option<u8>) -> Option<Figures> {
        self.0.get(&(symptom, unit))?.figures
    }

    /// All of them with their counts.
    pub fn all(&self) -> impl Iterator<Item = (Symptom, Option<u8>, &Seen)> {
        self.0.iter().map(|((symptom, unit), seen)| (*symptom, *unit, seen))
    }
}

/// The byte count of a frame on a serial line that would be an answer to a read, and the bytes that follow it, where the two differ.
fn counted(seen: &FrameObservation) -> Option<Figures> {
    let [_, 1..=4, count, data @ .., _, _] = seen.bytes.as_slice() else { return None };
    let is_kept_whole = seen.mode == Mode::Rtu && seen.bytes.len() == seen.length as usize;
    (is_kept_whole && usize::from(*count) != data.len()).then_some([u32::from(*count), data.len() as u32])
}

/// Whether bytes begin as a frame over Modbus/TCP.
fn is_header(bytes: &[u8]) -> bool {
    figures_of_header(bytes).is_some_and(|[_, present]| present > 2)
}

/// The symptom of a transaction; `None` of one that is as it should be.
fn of_transaction(seen: &Observation, before: Before) -> Option<Symptom> {
    let has = |finding| seen.findings.has(finding);
    let symptom = match seen.outcome {
        _ if seen.layout.is_some() => layout(seen, before)?,
        Outcome::Silent | Outcome::NotSeen if has(Finding::QuantityLimit) => beyond_limit(seen)?,
        Outcome::Silent => Symptom::NoAnswer,
        _ if seen.is_altered_echo => Symptom::AlteredEcho,
        _ if seen.is_own_echo || has(Finding::LocalEcho) => Symptom::Echo,
        Outcome::Garbled if has(Finding::ResponseLength) && fits_before(seen, before) => Symptom::StepBehind,
        Outcome::Garbled if has(Finding::ResponseLength) => Symptom::OtherLength,
        Outcome::Garbled if seen.is_cut && seen.damage.is_none() => cut(seen),
        Outcome::Garbled | Outcome::NotSeen if seen.damage.is_some() => return garbled(seen, before),
        Outcome::BadRequest if seen.damage == Some(DamagedPart::End) => Symptom::RequestEnd,
        Outcome::BadRequest if lacks_checksum(seen) => Symptom::RequestBare,
        Outcome::BadRequest => Symptom::RequestInside,
        Outcome::Refused => refusal(seen),
        Outcome::Unasked if seen.late_response_to.is_some() => Symptom::LateAnswer,
        Outcome::Unasked => unasked(seen, before)?,
        _ if has(Finding::TwoMasters) => Symptom::RequestCrossed,
        _ if seen.answered_by.is_some() && seen.id.is_some() => Symptom::OtherUnitNumber,
        _ if seen.answered_by.is_some() => Symptom::OtherUnit,
        _ if has(Finding::WrongFunction) => Symptom::OtherFunction,
        _ if has(Finding::EchoMismatch) => Symptom::OtherValue,
        _ if has(Finding::TransactionId) => Symptom::OtherId,
        _ if has(Finding::ResponseLength) => Symptom::OtherLength,
        _ if seen.is_step_behind && is_crossed(seen, before) => Symptom::RequestCrossed,
        _ if seen.is_step_behind => Symptom::StepBehind,
        _ => return None,
    };
    Some(symptom)
}

/// The symptom of a request with a value that its function does not allow.
fn beyond_limit(seen: &Observation) -> Option<Symptom> {
    if limits(seen).is_some() {
        return Some(Symptom::RequestLimit);
    }
    let kind = Functions::embedded().standard_request(seen.function)?.kind;
    (kind == StandardLayout::WriteOne).then_some(Symptom::RequestCoil)
}

/// A quantity that the function does not allow, and the greatest that it does.
fn limits(seen: &Observation) -> Option<Figures> {
    let key = seen.key()?;
    let row = Functions::embedded().row(key.function, &[])?;
    let limits = row.field_limits[0].iter().find(|limits| limits.name == "quantity")?;
    let (_, most) = *limits.ranges.last()?;
    let quantity = u32::from(key.quantity);
    let is_allowed = limits.ranges.iter().any(|(least, most)| (*least..=*most).contains(&quantity));
    (!is_allowed).then_some([quantity, most])
}

/// No master gives up sooner than this.
const LEAST_TIMEOUT: Ns = 20_000_000;

/// Whether another unit was asked so soon after the request before, which was answered later, that it was not the same master.
fn is_crossed(seen: &Observation, before: Before) -> bool {
    let is_other = |(unit, _, waited, _): (u8, Place, Ns, Ns)| unit != seen.unit && waited < LEAST_TIMEOUT;
    seen.id.is_none() && before.overtaken.is_some_and(is_other)
}

/// The symptom of an answer over Modbus/TCP of which a part came: its function code may be that of no answer to the request.
fn cut(seen: &Observation) -> Symptom {
    of_other_function(seen).unwrap_or(Symptom::AnswerCut)
}

/// Of bytes that begin as an answer over Modbus/TCP to the request of this identifier: whether they are of another function.
fn of_other_function(seen: &Observation) -> Option<Symptom> {
    let (head, pdu) = seen.answer_head.split_at_checked(PREFIX_BYTES + 1)?;
    let is_of_request = head[..4] == [seen.id?.to_be_bytes(), [0, 0]].concat()[..];
    (is_of_request && pdu.first()? & !EXCEPTION_BIT != seen.function).then_some(Symptom::OtherFunction)
}

/// The symptom of a refusal.
fn refusal(seen: &Observation) -> Symptom {
    let request = || Functions::embedded().standard_request(seen.function & !EXCEPTION_BIT);
    let has_one = || seen.writes && seen.key().is_some_and(|key| key.quantity == 1);
    let writes_one = || has_one() || request().is_some_and(|request| request.kind == StandardLayout::WriteOne);
    match seen.exception {
        Some(1) => Symptom::RefusedFunction,
        Some(2) if of_reference(seen).is_some() => Symptom::RefusedReference,
        Some(2) => Symptom::RefusedAddress,
        Some(3) if writes_one() => Symptom::RefusedOneValue,
        Some(3) if seen.findings.has(Finding::QuantityLimit) => Symptom::RefusedQuantity,
        Some(3) => Symptom::RefusedValue,
        Some(4) => Symptom::RefusedFailure,
        Some(5 | 6) => Symptom::RefusedBusy,
        Some(10) => Symptom::RefusedPath,
        Some(11) => Symptom::RefusedGateway,
        _ => Symptom::RefusedOther,
    }
}

/// The address of a request that is a number of manuals, and the address that such a number stands for.
fn of_reference(seen: &Observation) -> Option<Figures> {
    let key = seen.key()?;
    Some([key.address.into(), key.meant_by_manuals()?.into()])
}

/// The numbers that show a symptom.
fn figures(symptom: Symptom, seen: &Observation, before: Before) -> Option<Figures> {
    match symptom {
        Symptom::RefusedReference => of_reference(seen),
        Symptom::RefusalBare => Some([(*seen.answer_head.last()?).into(), 0]),
        Symptom::OtherFunction if seen.outcome == Outcome::Unasked => {
            Some([seen.function, before.asked?.function].map(u32::from))
        }
        Symptom::HeaderLength
        | Symptom::BytesAfter
        | Symptom::CountWrong
        | Symptom::OtherLength
        | Symptom::OtherFunction
        | Symptom::OtherValue => seen.figures,
        Symptom::OtherId => Some([seen.id?, before.id?].map(u32::from)).filter(|[one, other]| one != other),
        Symptom::RequestLimit => limits(seen),
        Symptom::AnswerForeign => Some([protocols::known(&seen.answer_head)? as u32, 0]),
        // The lengths of a line in ASCII are characters.
        Symptom::AnswerCut => Some([seen.lengths[1], due(seen).filter(|due| seen.id.is_none() && seen.lengths[1] < *due)?]),
        Symptom::AnswerCounted => counted_more(seen),
        Symptom::AnswerAdded => added_byte(seen),
        Symptom::AnswerBehind => Some([place_behind_strays(seen)?, 0]),
        Symptom::OtherUnit if seen.outcome == Outcome::Unasked => Some([seen.unit, before.asked?.unit].map(u32::from)),
        Symptom::OtherUnit | Symptom::OtherUnitNumber => Some([seen.answered_by?, seen.unit].map(u32::from)),
        Symptom::AnswerShort => Some([seen.lengths[1], due(seen)?]),
        Symptom::AnswerInside | Symptom::AnswerBit | Symptom::RequestInside => seen.checksum,
        _ if symptom.is_refusal() => Some([seen.exception?.into(), 0]),
        _ => None,
    }
}

/// Whether the answer has the length that the request before asks for, to which none came.
fn fits_before(seen: &Observation, before: Before) -> bool {
    let is_of = |asked: &RequestKey| {
        let is_alike = (asked.unit, asked.function) == (seen.unit, seen.function) && seen.key() != Some(*asked);
        is_alike && answer_length(asked.function, asked.quantity) == Some(seen.lengths[1])
    };
    before.is_open && before.asked.as_ref().is_some_and(is_of)
}

/// Whether a request of six bytes has no room for a checksum (application protocol, 6.1 to 6.6).
fn lacks_checksum(seen: &Observation) -> bool {
    seen.lengths[0] == 6 && (1..=6).contains(&seen.function)
}

/// Whether the answer is an exception response without a checksum.
fn is_bare_refusal(seen: &Observation) -> bool {
    matches!(seen.answer_head[..], [unit, function, 1..=11] if unit == seen.unit && function == seen.function | EXCEPTION_BIT)
}

/// Whether what came begins with the unit and lacks bytes after it: a part of what is due, and more than strays.
fn lacks_bytes(seen: &Observation) -> bool {
    let is_part = |due: u32| (due / 2..due).contains(&seen.lengths[1]);
    seen.answer_head.first() == Some(&seen.unit) && seen.lengths[1] >= LEAST_TORSO && due(seen).is_some_and(is_part)
}

/// Whether what came may be the rest of the answer before, which was cut, and whose request was sent again.
fn is_rest(seen: &Observation, before: Before) -> bool {
    let is_rest_of = |(key, missing): (RequestKey, u32)| seen.key() == Some(key) && seen.lengths[1] <= missing;
    seen.lengths[1] >= LEAST_TORSO && before.cut.is_some_and(is_rest_of)
}

/// A shorter rest of an answer may be anything.
const LEAST_TORSO: u32 = 8;

/// The symptom of a frame that is built wrongly. That its byte count is missing, only what was asked for shows.
fn layout(seen: &Observation, before: Before) -> Option<Symptom> {
    let lacks_count =
        |asked: RequestKey| asked.function == seen.function && lacks_count(seen.lengths[1], asked.function, asked.quantity);
    Some(match seen.layout? {
        LayoutFault::WrongCount | LayoutFault::Other if seen.key().or(before.asked).is_some_and(lacks_count) => {
            Symptom::CountMissing
        }
        LayoutFault::WideCount => Symptom::CountWide,
        LayoutFault::WrongCount => Symptom::CountWrong,
        LayoutFault::HeaderLength => Symptom::HeaderLength,
        LayoutFault::BytesAfter => Symptom::BytesAfter,
        LayoutFault::SwappedChecksum => Symptom::ChecksumSwapped,
        LayoutFault::Request => Symptom::RequestLayout,
        LayoutFault::NoExceptionCode => Symptom::RefusalShort,
        LayoutFault::Other => Symptom::OtherLayout,
    })
}

fn garbled(seen: &Observation, before: Before) -> Option<Symptom> {
    let head = [seen.unit, seen.function];
    let bytes = &seen.answer_head;
    let symptom = match seen.damage? {
        _ if bare_refusals(bytes).is_some() || is_bare_refusal(seen) => Symptom::RefusalBare,
        _ if seen.findings.has(Finding::Collision) => Symptom::Collision,
        DamagedPart::Start => Symptom::AnswerStart,
        DamagedPart::End => Symptom::AnswerEnd,
        DamagedPart::Bit => Symptom::AnswerBit,
        DamagedPart::Inside if counted_more(seen).is_some() => Symptom::AnswerCounted,
        DamagedPart::Inside if added_byte(seen).is_some() => Symptom::AnswerAdded,
        DamagedPart::Inside if due(seen) == Some(seen.lengths[1] + 1) && !lacks_last(bytes) => Symptom::AnswerShort,
        DamagedPart::Inside if seen.is_cut || is_cut_by_chance(seen) => Symptom::AnswerCut,
        DamagedPart::Inside => Symptom::AnswerInside,
        DamagedPart::Whole if is_payload(seen) => return None,
        DamagedPart::Whole if (1..=2).any(|by| bytes.get(by..by + 2) == Some(&head)) => Symptom::AnswerShifted,
        DamagedPart::Whole if place_behind_strays(seen).is_some() => Symptom::AnswerBehind,
        DamagedPart::Whole if is_on_swapped_wires(seen) => Symptom::AnswerSwapped,
        DamagedPart::Whole if matches!(Oddity::of(bytes), Some(Oddity::Digits(_))) => Symptom::AnswerDigits,
        DamagedPart::Whole if is_text(bytes) => Symptom::AnswerText,
        DamagedPart::Whole if protocols::known(bytes).is_some() => Symptom::AnswerForeign,
        DamagedPart::Whole if seen.id.is_some() => return of_other_function(seen),
        DamagedPart::Whole if bytes.len() >= 3 && bytes.iter().all(|byte| is_of_driver(*byte)) => Symptom::AnswerInverted,
        DamagedPart::Whole if is_rest(seen, before) => Symptom::AnswerRest,
        DamagedPart::Whole if lacks_bytes(seen) => Symptom::AnswerShort,
        DamagedPart::Whole if bytes.first() == Some(&seen.unit) => Symptom::AnswerUnit,
        DamagedPart::Whole => Symptom::AnswerWhole,
    };
    Some(symptom)
}

/// Whether an answer that is too short looks like one with a wrong bit, but for its length.
fn is_cut_by_chance(seen: &Observation) -> bool {
    seen.has_chance_bit && due(seen).is_some_and(|due| seen.lengths[1] < due)
}

/// Whether what came has the length of the data that were asked for, and is more than levels: a program prints the data alone.
fn is_payload(seen: &Observation) -> bool {
    let data = seen.key().and_then(|key| data_length(key.function, key.quantity));
    let has_length = seen.lengths[1] >= LEAST_PAYLOAD && data == Some(seen.lengths[1]);
    has_length && !seen.answer_head.iter().all(|byte| is_of_driver(*byte))
}

/// A shorter run has the length of the data by chance.
const LEAST_PAYLOAD: u32 = 4;

/// Identifiers so far below that of the open request are those of requests before it.
const STEPS: u16 = 3;

fn unasked(seen: &Observation, before: Before) -> Option<Symptom> {
    if let Some((id, last)) = seen.id.zip(before.id).filter(|(id, last)| id != last) {
        return Some(if (1..=STEPS).contains(&last.wrapping_sub(id)) { Symptom::StepBehind } else { Symptom::OtherId });
    }
    match before.asked {
        // A refusal says what is wrong, whatever was asked.
        _ if seen.exception.is_some()
            && before.asked.is_none_or(|key| key.unit == seen.unit && key.function == seen.function) =>
        {
            Some(refusal(seen))
        }
        // Without any request before it, the recording began after it was sent.
        None => None,
        Some(key) if seen.id.is_some() && key.unit != seen.unit && key.function != seen.function => Some(Symptom::OtherHead),
        Some(key) if seen.answer_head.get(1..3) == Some(&[key.unit, key.function]) => Some(Symptom::AnswerShifted),
        Some(key) if key.unit != seen.unit => Some(Symptom::OtherUnit),
        Some(key) if before.is_open && key.function != seen.function => Some(Symptom::OtherFunction),
        Some(_) => Some(Symptom::SecondAnswer),
    }
}
