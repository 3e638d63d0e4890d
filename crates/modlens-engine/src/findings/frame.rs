//! Findings on one frame by itself: its content, its reception, and its damage.

use crate::findings::{words, Found};
use crate::framer::{FrameResult, FramingFault};
use crate::input::Input;
use crate::rtu_model::damage_kind::DamageKind;
use crate::transactions::transaction::ObservedFrame;
use modlens_protocol::checksum::{crc16, lrc};
use modlens_protocol::direction::{counts_agree, possible_directions, Direction};
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::{FunctionRow, Functions, EXCEPTION_BIT};
use modlens_protocol::oddity::wrong_bit;

/// Unit numbers above this are reserved on serial lines (serial line specification, 2.2).
const LAST_UNIT: u8 = 247;

/// Finds what is odd about the content of a frame: a good one against the specification, a damaged one against its checksum.
/// Findings are added to `found`. A good frame with fewer bytes than unit and function code has none.
pub(crate) fn content(functions: &Functions, frame: &ObservedFrame<'_>, found: &mut Found) {
    if frame.verdict.is_good() {
        good_frame(functions, &GoodFrame { adu: frame.adu, direction: frame.direction, mode: frame.mode }, found);
    } else {
        checksum(functions, frame, found);
    }
}

/// Returns whether nothing is odd about the content of a request, `adu` being its unit and PDU. The fast path asks this about
/// each request that it takes, so that a finding on a request shows in ordinary traffic as well.
pub(crate) fn is_plain_request(functions: &Functions, mode: Mode, adu: &[u8]) -> bool {
    let mut found = Found::new();
    good_frame(functions, &GoodFrame { adu, direction: Direction::Request, mode }, &mut found);
    found.is_empty()
}

/// What the findings on the content of a good frame may depend on: its bytes and who sent it, but not when it came.
struct GoodFrame<'a> {
    /// Unit and PDU.
    adu: &'a [u8],
    direction: Direction,
    mode: Mode,
}

/// Finds what is odd about the content of a good frame.
fn good_frame(functions: &Functions, frame: &GoodFrame<'_>, found: &mut Found) {
    if let [unit, ref pdu @ ..] = *frame.adu {
        if !pdu.is_empty() {
            good_unit(unit, frame.mode, found);
            good_pdu(functions, frame, pdu, found);
        }
    }
}

/// Finds a unit that is reserved; on TCP none is.
fn good_unit(unit: u8, mode: Mode, found: &mut Found) {
    if unit > LAST_UNIT && mode != Mode::Tcp {
        found.push((Finding::ReservedUnit, words::unit(unit)));
    }
}

/// Finds what breaks the specification in the PDU of a good frame, which has at least a function code: an unknown function,
/// fields beyond their limits, and what `good_length` finds. After an unknown function nothing else is checked, as there is
/// no layout, nor in an exception response of a known one.
fn good_pdu(functions: &Functions, frame: &GoodFrame<'_>, pdu: &[u8], found: &mut Found) {
    let (function, body) = (pdu[0] & !EXCEPTION_BIT, &pdu[1..]);
    let Some(row) = functions.row(function, body) else {
        found.push((Finding::UnknownFunction, words::unknown_function(function)));
        return;
    };
    if pdu[0] & EXCEPTION_BIT != 0 {
        return;
    }
    let is_response = frame.direction == Direction::Response;
    for limits in &row.field_limits[usize::from(is_response)] {
        if let Some(value) = limits.violated_by(body) {
            found.push((Finding::QuantityLimit, words::quantity_limit(&limits.name, value, &limits.ranges)));
        }
    }
    good_length(functions, frame, row, pdu, found);
}

/// Finds a length that no layout of the function has in either direction (on TCP the framer reports that), or, in what is not a
/// response, a quantity that contradicts the number of data bytes. `row` is the function's; `pdu` is no exception response.
fn good_length(functions: &Functions, frame: &GoodFrame<'_>, row: &FunctionRow, pdu: &[u8], found: &mut Found) {
    let body = &pdu[1..];
    let (as_request, as_response) = possible_directions(functions, pdu);
    let fits_no_layout = !as_request && !as_response && frame.mode != Mode::Tcp;
    let contradicts_itself = frame.direction != Direction::Response && !counts_agree(row, body);
    if fits_no_layout || contradicts_itself {
        found.push((Finding::LengthMismatch, words::length_mismatch(body.len())));
    }
}

/// Finds what is wrong with the checksum of a damaged frame, and in RTU whether one change would make it right: one bit, else
/// another unit or function code. An incomplete frame is only said to be so. Noise has no finding here.
fn checksum(functions: &Functions, frame: &ObservedFrame<'_>, found: &mut Found) {
    match frame.verdict {
        Verdict::Incomplete => found.push((Finding::Incomplete, words::incomplete(frame.wire.len()))),
        Verdict::BadChecksum if frame.mode == Mode::Rtu => {
            let (content, sent) = frame.wire.split_at(frame.wire.len() - 2);
            found.push((Finding::BadChecksum, words::bad_crc(sent, crc16(content).to_le_bytes())));
            if let Some((at, bit)) = wrong_bit(functions, frame.wire) {
                found.push((Finding::BitFlip, words::bit_flip(frame.wire[at], at, bit)));
            } else if let Some(other) = frame_of_checksum(content, sent) {
                found.push((Finding::OtherChecksum, words::other_checksum(sent, &other)));
            }
        }
        Verdict::BadChecksum => found.push((Finding::BadChecksum, words::bad_lrc(lrc(frame.adu)))),
        _ => {}
    }
}

/// The `content` (unit and PDU) with another function code, or else another unit, if that is the frame to which the checksum
/// that was `sent` belongs. The function must be a known one, and an exception stays one. `None` if no value of either byte
/// does.
///
/// No further bytes are tried, because with each one the chance grows that some value fits by chance.
fn frame_of_checksum(content: &[u8], sent: &[u8]) -> Option<Vec<u8>> {
    for at in [1, 0] {
        for byte in 0..=255 {
            let mut other = content.to_vec();
            other[at] = byte;
            let same_kind = at == 0 || (byte ^ content[1]) & EXCEPTION_BIT == 0;
            let is_known = same_kind && Functions::embedded().name(other[1] & !EXCEPTION_BIT).is_some();
            if is_known && crc16(&other).to_le_bytes() == sent {
                return Some(other);
            }
        }
    }
    None
}

/// Finds what the receiver has marked in a frame, the first `length` bytes of the input: line errors, and bytes that it
/// has lost before the frame or inside it.
#[inline]
pub(crate) fn reception(input: &Input, length: usize, found: &mut Found) {
    if !input.has_marks() {
        return;
    }
    if input.has_line_error(0, length) {
        found.push((Finding::LineError, words::line_error(input.count_marked_bytes(0, length), length)));
    }
    if input.has_loss(0, length) {
        found.push((Finding::LostBytes, words::receiver_lost_bytes()));
    }
}

/// Finds what the framer reports about a frame: that it may be an accident of noise, how it was damaged, and how it breaks the
/// rules of its framing.
#[inline]
pub(crate) fn framing(framed: &FrameResult, found: &mut Found) {
    if framed.unconfirmed {
        found.push((Finding::Unconfirmed, words::unconfirmed(framed.confidence)));
    }
    if let Some((damage, finding)) = framed.damage.and_then(|damage| Some((damage, finding_of(damage)?))) {
        found.push((finding, words::damage(damage)));
    }
    if let Some(fault) = framed.fault {
        found.push(match fault {
            FramingFault::BareLineFeed => (Finding::BareLineFeed, words::characters(framed.length)),
            FramingFault::LowerCaseHex => (Finding::LowerCaseHex, words::characters(framed.length)),
            FramingFault::MbapLength => (Finding::MbapLength, words::mbap_length(framed.length)),
        });
    }
}

/// The finding on a damaged frame; `None` where the verdict `incomplete` already says it.
fn finding_of(damage: DamageKind) -> Option<Finding> {
    match damage {
        DamageKind::LostBytes { .. } => Some(Finding::LostBytes),
        DamageKind::FlowControl { .. } => Some(Finding::FlowControl),
        DamageKind::Collision { .. } => Some(Finding::Collision),
        DamageKind::DoubledByte { .. } => Some(Finding::DuplicateByte),
        DamageKind::Glitch => Some(Finding::StrayBytes),
        DamageKind::Truncated { .. } => None,
    }
}
