//! Checks of a whole frame and of a pair: what the specification says and the bytes do not do.

use crate::framer::silence::Rule;
use crate::input::Input;
use crate::pairing::{ObservedFrame, PendingTransaction};
use modlens_protocol::checksum::{correctable_bit, crc16};
use modlens_protocol::direction::{block_length, consistent, echo_differences, expected_block, readings, Direction};
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::hex::hex;
use modlens_protocol::pdu::u16_at;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;

/// Findings with what was frame, in words.
pub type Found = Vec<(Finding, String)>;

/// Unit numbers above this are reserved on serial lines (serial line specification, 2.2).
const LAST_UNIT: u8 = 247;

/// Checks a frame's content.
pub fn frame(functions: &Functions, frame: &ObservedFrame<'_>, found: &mut Found) {
    if !frame.verdict.good() {
        damage(frame, found);
        return;
    }
    let (Some((&unit, pdu)), true) = (frame.adu.split_first(), frame.adu.len() >= 2) else { return };
    let (code, body) = (pdu[0], &pdu[1..]);
    if unit > LAST_UNIT && frame.mode != Mode::Tcp {
        found.push((Finding::ReservedUnit, format!("unit {unit}")));
    }
    let Some(row) = functions.row(code & !EXCEPTION_BIT, body) else {
        found.push((Finding::UnknownFunction, format!("function {0} (0x{0:02X})", code & !EXCEPTION_BIT)));
        return;
    };
    if code & EXCEPTION_BIT != 0 {
        return;
    }
    let response = frame.direction == Direction::Response;
    for permit in &row.permits[usize::from(response)] {
        if let Some(value) = permit.violated_by(body) {
            let ranges: Vec<String> = permit
                .ranges
                .iter()
                .map(|(low, high)| if low == high { format!("{low}") } else { format!("{low} to {high}") })
                .collect();
            found.push((
                Finding::QuantityLimit,
                format!("{} is {value}, the specification has {}", permit.name, ranges.join(" or ")),
            ));
        }
    }
    let (as_request, as_response) = readings(functions, pdu);
    if !(as_request || as_response) && frame.mode != Mode::Tcp || (!response && !consistent(row, body)) {
        found.push((
            Finding::LengthMismatch,
            format!("{} bytes behind the function code do not fit the announced length", body.len()),
        ));
    }
}

fn damage(frame: &ObservedFrame<'_>, found: &mut Found) {
    match frame.verdict {
        Verdict::Incomplete => found.push((Finding::Incomplete, format!("{} bytes", frame.wire.len()))),
        Verdict::BadChecksum if frame.mode == Mode::Rtu => {
            let (content, sent) = frame.wire.split_at(frame.wire.len() - 2);
            let expected = crc16(content).to_le_bytes();
            found.push((Finding::BadChecksum, format!("found {}, expected {}", hex(sent), hex(&expected))));
            if let Some((at, bit)) = correctable_bit(frame.wire) {
                found.push((
                    Finding::BitFlip,
                    format!("byte {at}, bit {bit}: {:02x} should be {:02x}", frame.wire[at], frame.wire[at] ^ (1 << bit)),
                ));
            } else if let Some(other) = sibling(content, sent) {
                found.push((Finding::OtherChecksum, format!("{} is the checksum of {}", hex(sent), hex(&other))));
            }
        }
        Verdict::BadChecksum => {
            let sum = modlens_protocol::checksum::lrc(frame.adu);
            found.push((Finding::BadChecksum, format!("the LRC of the bytes is {sum:02X}")));
        }
        _ => {}
    }
}

/// The same frame with another unit or function code, if that is what the checksum belongs to.
///
/// Only short frames: with every further byte tried, chance makes one fit.
fn sibling(content: &[u8], sent: &[u8]) -> Option<Vec<u8>> {
    for at in [1, 0] {
        for byte in 0..=255 {
            let mut other = content.to_vec();
            other[at] = byte;
            let same_kind = at == 0 || (byte ^ content[1]) & EXCEPTION_BIT == 0;
            if same_kind && Functions::embedded().name(other[1] & !EXCEPTION_BIT).is_some() && crc16(&other).to_le_bytes() == sent
            {
                return Some(other);
            }
        }
    }
    None
}

/// Checks a frame's times against the silences of the specification, or those that were given.
pub fn timing(input: &Input, rule: Option<Rule>, resolution: Ns, frame: &ObservedFrame<'_>, found: &mut Found) {
    let Some(rule) = rule.filter(|_| frame.mode == Mode::Rtu && frame.verdict.good()) else { return };
    if input.coarse || 4 * resolution > rule.t15_ns {
        return;
    }
    let us = |ns: Ns| format!("{} us", ns / 1000);
    if let Some(gap) = input.pause_before(0).filter(|&gap| gap < rule.t35_ns) {
        found.push((Finding::ShortSilence, format!("{} of silence, t3.5 is {}", us(gap.max(0)), us(rule.t35_ns))));
    }
    if let Some(pause) = input.longest_pause(0, frame.wire.len()).filter(|&pause| pause > rule.t15_ns) {
        found.push((Finding::GapInside, format!("{} of silence inside, t1.5 is {}", us(pause), us(rule.t15_ns))));
    }
}

/// Checks a response against its request.
pub fn pair(functions: &Functions, transaction: &PendingTransaction, found: &mut Found) {
    let (request, response) = (transaction.request.pdu(), transaction.response.pdu());
    let damaged = matches!(transaction.status, Status::BadRequest | Status::BadResponse);
    if damaged || request.is_empty() || response.is_empty() || response[0] & EXCEPTION_BIT != 0 {
        return;
    }
    let Some(row) = functions.row(request[0], &request[1..]) else { return };
    for (name, asked, answered) in echo_differences(row, request, response) {
        found.push((Finding::EchoMismatch, format!("{name}: asked {asked}, answered {answered}")));
    }
    if let (Some(expected), Some(length)) = (expected_block(row, request), block_length(row, response)) {
        if expected != length {
            found.push((Finding::ResponseLength, format!("{length} bytes, {expected} were asked for")));
        } else if let Some(bits) = padding(row.roles.response_block, row.roles.quantity, request, response) {
            found.push((Finding::PaddingBits, bits));
        }
    }
}

fn padding(block: Option<(usize, bool)>, quantity: Option<usize>, request: &[u8], response: &[u8]) -> Option<String> {
    let (_, bits) = block?;
    let quantity = usize::from(u16_at(&request[1..], quantity?)?);
    let last = *response.last()?;
    if !bits || quantity % 8 == 0 {
        return None;
    }
    let padding = last >> (quantity % 8);
    (padding != 0).then(|| format!("last byte 0x{last:02X}: only its {} lowest bits were asked for", quantity % 8))
}
