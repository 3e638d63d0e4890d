//! The symptom that an odd transaction shows, and the numbers that go with it.

use modlens_protocol::annotate::exception_name;
use modlens_protocol::checksum::{crc16, CRC_BYTES};
use modlens_protocol::finding::Finding;
use modlens_protocol::functions::{Functions, StandardLayout, EXCEPTION_BIT};
use modlens_protocol::mbap::PREFIX_BYTES;
use modlens_protocol::oddity::{bare_refusals, is_doubled, is_of_driver, is_text, lacks_last, Oddity};
use modlens_protocol::Ns;

use super::almost::{
    added_byte, announced, counted_more, due, has_parity_bits, is_on_swapped_wires, is_request_on_swapped_wires,
    lacks_checksum_only, lacks_highest_bits, place_behind_strays,
};
use super::before::Before;
use super::symptom::Symptom;
use super::tally::Place;
use crate::observation::{
    answer_length, data_length, lacks_count, DamagedPart, Figures, LayoutFault, Observation, Outcome, RequestKey,
};
use crate::protocols;

/// The symptom of a transaction; `None` of one that is as it should be.
pub(super) fn of_transaction(seen: &Observation, before: Before) -> Option<Symptom> {
    let has = |finding| seen.findings.has(finding);
    let symptom = match seen.outcome {
        _ if seen.layout.is_some() => layout(seen, before)?,
        // An answer to the open request looks like such a request where its header is wrong.
        Outcome::Silent | Outcome::NotSeen if has(Finding::QuantityLimit) && has_open_id(seen, before) => Symptom::HeaderLength,
        Outcome::Silent | Outcome::NotSeen if has(Finding::QuantityLimit) => beyond_limit(seen)?,
        Outcome::Silent => Symptom::NoAnswer,
        _ if seen.altered_echo.is_some_and(|echo| echo.is_from_first) => Symptom::DistortedEcho,
        _ if seen.altered_echo.is_some() => Symptom::AlteredEcho,
        _ if seen.is_own_echo || has(Finding::LocalEcho) => Symptom::Echo,
        Outcome::Garbled if has(Finding::ResponseLength) && fits_before(seen, before) => Symptom::StepBehind,
        Outcome::Garbled if has(Finding::ResponseLength) => Symptom::OtherLength,
        Outcome::Garbled if lacks_checksum_only(seen) => Symptom::AnswerBare,
        Outcome::Garbled if seen.is_cut && announced(seen).is_some() => Symptom::AnswerAnnounces,
        Outcome::Garbled if seen.is_cut && seen.damage.is_none() => cut(seen),
        Outcome::Garbled if seen.damage.is_none() && seen.checksum.is_some() => Symptom::AnswerLrc,
        Outcome::Garbled | Outcome::NotSeen if seen.damage.is_some() => return garbled(seen, before),
        Outcome::BadRequest if seen.damage == Some(DamagedPart::End) => Symptom::RequestEnd,
        Outcome::BadRequest if lacks_checksum(seen) => Symptom::RequestBare,
        Outcome::BadRequest if is_cut_request(seen) => Symptom::RequestCut,
        Outcome::BadRequest => Symptom::RequestInside,
        Outcome::Refused => refusal(seen),
        Outcome::Unasked if seen.late_response_to.is_some() => Symptom::LateAnswer,
        Outcome::Unasked => unasked(seen, before)?,
        _ if has(Finding::TwoMasters) => Symptom::RequestCrossed,
        _ if seen.answered_by.is_some() && seen.id.is_some() => Symptom::OtherUnitNumber,
        _ if seen.answered_by.is_some() => Symptom::OtherUnit,
        _ if has(Finding::WrongFunction) => Symptom::OtherFunction,
        _ if has(Finding::EchoMismatch) => Symptom::OtherValue,
        _ if has(Finding::TransactionId) && seen.figures.is_some_and(is_swapped_id) => Symptom::SwappedId,
        _ if has(Finding::TransactionId) => Symptom::OtherId,
        _ if has(Finding::ResponseLength) => Symptom::OtherLength,
        _ if seen.is_step_behind && is_crossed(seen, before) => Symptom::RequestCrossed,
        _ if seen.is_step_behind => Symptom::StepBehind,
        _ => return None,
    };
    Some(symptom)
}

/// Whether a request carries the identifier of another one that is open.
fn has_open_id(seen: &Observation, before: Before) -> bool {
    seen.id.is_some() && seen.id == before.id && before.is_open
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
pub(super) fn figures(symptom: Symptom, seen: &Observation, before: Before) -> Option<Figures> {
    match symptom {
        Symptom::RefusedReference => of_reference(seen),
        Symptom::RefusalChecksum => Some([damaged_refusal(seen)?.into(), 0]),
        Symptom::RefusalCut => cut_refusal(seen),
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
        Symptom::OtherId | Symptom::SwappedId => {
            let own = || Some([seen.id?, before.id?].map(u32::from)).filter(|[one, other]| one != other);
            seen.figures.or_else(own)
        }
        Symptom::CountOdd => Some([(*seen.answer_head.get(2)?).into(), 0]),
        Symptom::AlteredEcho | Symptom::DistortedEcho => seen.altered_echo.map(|echo| [echo.changed, echo.sent]),
        Symptom::RequestLimit => limits(seen),
        Symptom::AnswerForeign => Some([protocols::known(&seen.answer_head)? as u32, 0]),
        // The lengths of a line in ASCII are characters, which are no bytes.
        Symptom::AnswerCut if seen.answer_head.first() == Some(&b':') => None,
        Symptom::AnswerCut => Some([seen.lengths[1], due(seen).filter(|due| seen.id.is_none() && seen.lengths[1] < *due)?]),
        Symptom::AnswerCounted => counted_more(seen),
        Symptom::AnswerAnnounces => announced(seen),
        Symptom::AnswerAdded => added_byte(seen),
        Symptom::AnswerBehind => Some([place_behind_strays(seen)?, 0]),
        Symptom::OtherUnit | Symptom::LoneAnswer if seen.outcome == Outcome::Unasked => {
            Some([seen.unit, before.asked?.unit].map(u32::from))
        }
        Symptom::OtherUnit | Symptom::OtherUnitNumber => Some([seen.answered_by?, seen.unit].map(u32::from)),
        Symptom::RequestCut => Some([seen.lengths[0], REQUEST_BYTES]),
        Symptom::AnswerShort => Some([seen.lengths[1], due(seen)?]),
        Symptom::AnswerInside | Symptom::AnswerBit | Symptom::AnswerLrc | Symptom::RequestInside => seen.checksum,
        Symptom::AnswerEnd => last_byte(seen),
        _ if symptom.is_refusal() => Some([seen.exception?.into(), 0]),
        _ => None,
    }
}

/// The last byte of an answer that is as long as it should be, and the one that belongs there, where the first half of the checksum
/// is right.
fn last_byte(seen: &Observation) -> Option<Figures> {
    let bytes =
        Some(&seen.answer_head).filter(|bytes| due(seen) == Some(bytes.len() as u32) && lacks_last(&bytes[..bytes.len() - 1]))?;
    let (body, there) = bytes.split_last_chunk::<CRC_BYTES>()?;
    Some([there[1], crc16(body).to_le_bytes()[1]].map(u32::from))
}

/// Whether an answer has the function and the length of one to this request, whoever was asked.
fn may_answer(seen: &Observation, asked: RequestKey) -> bool {
    let is_due = || answer_length(asked.function, asked.quantity).is_none_or(|due| due == seen.lengths[1]);
    asked.function == seen.function && (seen.exception.is_some() || is_due())
}

/// Whether the identifier of an answer is that of the request with its bytes swapped.
fn is_swapped_id([answered, asked]: Figures) -> bool {
    answered != asked && (answered >> 8 | (answered & 0xFF) << 8) == asked
}

/// Whether an answer has an odd number of bytes for registers, which have two each.
fn has_odd_count(seen: &Observation) -> bool {
    matches!(seen.answer_head[..], [_, 3 | 4, count, ..] if count % 2 == 1 && u32::from(count) + 5 == seen.lengths[1])
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

/// Whether a request of a fixed length has fewer bytes.
fn is_cut_request(seen: &Observation) -> bool {
    seen.id.is_none() && seen.lengths[0] < REQUEST_BYTES && (1..=6).contains(&seen.function)
}

/// Unit, function, address, quantity or value, and checksum of functions 1 to 6.
const REQUEST_BYTES: u32 = 8;

/// Whether the answer is an exception response without a checksum.
fn is_bare_refusal(seen: &Observation) -> bool {
    matches!(seen.answer_head[..], [unit, function, 1..=11] if unit == seen.unit && function == seen.function | EXCEPTION_BIT)
}

/// The code of an answer with the length of a refusal of the request, whose checksum is wrong.
fn damaged_refusal(seen: &Observation) -> Option<u8> {
    let [unit, function, code, ..] = *seen.answer_head.as_slice() else { return None };
    let is_refusal = seen.lengths[1] == REFUSAL_BYTES && unit == seen.unit && function == seen.function | EXCEPTION_BIT;
    Some(code).filter(|code| is_refusal && exception_name(*code).is_some())
}

/// The function that an answer refuses, and how many bytes of it there are, where it stops before its end: after the function, or
/// after the first half of its checksum.
fn cut_refusal(seen: &Observation) -> Option<Figures> {
    let bytes = seen.answer_head.as_slice();
    let is_refusal = bytes.starts_with(&[seen.unit, seen.function | EXCEPTION_BIT]);
    let is_cut = match bytes {
        [_, _] => true,
        [_, _, _, half] => *half == crc16(&bytes[..3]).to_le_bytes()[0],
        _ => false,
    };
    (is_refusal && is_cut).then_some([seen.function.into(), bytes.len() as u32])
}

/// Unit, function, code and checksum.
const REFUSAL_BYTES: u32 = 5;

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
        _ if is_doubled(bytes) => Symptom::AnswerDoubled,
        _ if seen.findings.has(Finding::Collision) => Symptom::Collision,
        DamagedPart::Inside | DamagedPart::Whole if lacks_highest_bits(seen) => Symptom::AnswerSeven,
        DamagedPart::Inside | DamagedPart::Whole if has_parity_bits(seen) => Symptom::AnswerParity,
        DamagedPart::Start => Symptom::AnswerStart,
        DamagedPart::End if added_byte(seen).is_some_and(|[_, place]| place < seen.lengths[1]) => Symptom::AnswerAdded,
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
        DamagedPart::Whole if is_request_on_swapped_wires(seen) => Symptom::EchoSwapped,
        DamagedPart::Whole if is_on_swapped_wires(seen) => Symptom::AnswerSwapped,
        DamagedPart::Whole if matches!(Oddity::of(bytes), Some(Oddity::Digits(_))) => Symptom::AnswerDigits,
        DamagedPart::Whole if is_text(bytes) => Symptom::AnswerText,
        DamagedPart::Whole if protocols::known(bytes).is_some() => Symptom::AnswerForeign,
        DamagedPart::Whole if seen.id.is_some() => return of_other_function(seen),
        DamagedPart::Whole if bytes.len() >= 3 && bytes.iter().all(|byte| is_of_driver(*byte)) => Symptom::AnswerInverted,
        DamagedPart::Whole if is_rest(seen, before) => Symptom::AnswerRest,
        DamagedPart::Whole if lacks_bytes(seen) => Symptom::AnswerShort,
        DamagedPart::Whole if damaged_refusal(seen).is_some() => Symptom::RefusalChecksum,
        DamagedPart::Whole if cut_refusal(seen).is_some() => Symptom::RefusalCut,
        DamagedPart::Whole if bytes.starts_with(&[seen.unit, seen.function | EXCEPTION_BIT]) => Symptom::AnswerInside,
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
        if is_swapped_id([id, last].map(u32::from)) {
            return Some(Symptom::SwappedId);
        }
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
        None => has_odd_count(seen).then_some(Symptom::CountOdd),
        Some(key) if seen.id.is_some() && key.unit != seen.unit && key.function != seen.function => Some(Symptom::OtherHead),
        Some(key) if seen.answer_head.get(1..3) == Some(&[key.unit, key.function]) => Some(Symptom::AnswerShifted),
        Some(key) if key.unit != seen.unit && !may_answer(seen, key) => Some(Symptom::LoneAnswer),
        Some(key) if key.unit != seen.unit => Some(Symptom::OtherUnit),
        Some(key) if before.is_open && key.function != seen.function => Some(Symptom::OtherFunction),
        Some(_) => Some(Symptom::SecondAnswer),
    }
}
