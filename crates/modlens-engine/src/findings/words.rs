//! The details of findings: what was seen this time, worded for the user. All of them stand here, and nowhere else.
//!
//! Title, reason and advice, which are the same every time, are in `modlens_protocol::finding`.

use crate::findings::contradictions::Contradiction;
use crate::rtu_model::damage_kind::DamageKind;
use crate::transactions::result::{DelayedFinding, PairingResult};
use crate::transactions::transaction::ConnectionEnd;
use crate::transactions::transaction::ObservedFrame;
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::functions::EXCEPTION_BIT;
use modlens_protocol::hex::hex;
use modlens_protocol::Ns;
use modlens_readers::pcap::Conflict;

// One frame: its content.

pub(crate) fn unit(unit: u8) -> String {
    format!("unit {unit}")
}

pub(crate) fn unknown_function(function: u8) -> String {
    format!("function {function} (0x{function:02X})")
}

/// `ranges`: the permitted values, both ends included.
pub(crate) fn quantity_limit(field: &str, value: u32, ranges: &[(u32, u32)]) -> String {
    let range = |&(low, high): &(u32, u32)| if low == high { format!("{low}") } else { format!("{low} to {high}") };
    let ranges: Vec<String> = ranges.iter().map(range).collect();
    format!("{field} is {value}, the specification allows {}", ranges.join(" or "))
}

pub(crate) fn length_mismatch(body_bytes: usize) -> String {
    format!("{body_bytes} bytes after the function code do not match the announced length")
}

pub(crate) fn incomplete(bytes: usize) -> String {
    format!("{bytes} bytes")
}

pub(crate) fn bad_crc(sent: &[u8], expected: [u8; 2]) -> String {
    let is_swapped = expected[0] != expected[1] && sent == [expected[1], expected[0]];
    let why = if is_swapped { ": the two bytes are swapped, the low one goes first" } else { "" };
    format!("found {}, expected {}{why}", hex(sent), hex(&expected))
}

pub(crate) fn bad_lrc(sum: u8) -> String {
    format!("the LRC of the bytes is {sum:02X}")
}

/// `byte` is the value received at index `at`.
pub(crate) fn bit_flip(byte: u8, at: usize, bit: u8) -> String {
    format!("byte {at}, bit {bit}: {byte:02x} should be {:02x}", byte ^ (1 << bit))
}

pub(crate) fn other_checksum(sent: &[u8], other: &[u8]) -> String {
    format!("{} is the checksum of {}", hex(sent), hex(other))
}

// One frame: its reception and its framing.

/// Receivers mark single bytes, or a read as a whole (then `marked_bytes` is 0).
pub(crate) fn line_error(marked_bytes: usize, length: usize) -> String {
    match marked_bytes {
        0 => String::from("reported by the receiver"),
        _ => format!("the receiver reported errors in {marked_bytes} of {length} bytes"),
    }
}

pub(crate) fn receiver_lost_bytes() -> String {
    String::from("the receiver lost bytes before this frame")
}

pub(crate) fn unconfirmed(confidence: u8) -> String {
    format!("in noise, or hardly more likely than another reading of these bytes: odds of {} to 1", 1u64 << confidence)
}

/// What happened to a damaged frame, and where in it.
pub(crate) fn damage(damage: DamageKind) -> String {
    let bytes = |count: usize| match count {
        0 => String::from("bytes"),
        1 => String::from("1 byte"),
        _ => format!("{count} bytes"),
    };
    match damage {
        DamageKind::LostBytes { at: 0, count } => format!("{} missing at the start", bytes(count)),
        DamageKind::LostBytes { at, count } => format!("{} missing after byte {}", bytes(count), at - 1),
        DamageKind::FlowControl { at, value } => lost_flow_control_byte(at, value),
        DamageKind::Truncated { count } => format!("{} never came", bytes(count)),
        DamageKind::Collision { at } => format!("wrong from byte {at} on, where more bits are 0 than were sent"),
        DamageKind::DoubledByte { at } => format!("byte {at} repeats the one before it"),
        DamageKind::Glitch => String::from("one byte value next to a frame, as drivers produce when they are switched"),
    }
}

/// The byte of software flow control that a frame lacks.
fn lost_flow_control_byte(at: usize, value: u8) -> String {
    let place = at.checked_sub(1).map_or(String::from("at the start"), |before| format!("after byte {before}"));
    let name = if value == 0x11 { "XON" } else { "XOFF" };
    format!("1 byte missing {place}: 0x{value:02x} ({name}) makes the CRC valid")
}

/// The length of an ASCII frame.
pub(crate) fn characters(length: usize) -> String {
    format!("{length} characters")
}

pub(crate) fn mbap_length(bytes: usize) -> String {
    format!("{bytes} bytes on the wire do not fit the layout of the function")
}

// One frame: its times.

pub(crate) fn short_silence(silence: Ns, t35: Ns) -> String {
    format!("{} of silence, t3.5 is {}", microseconds(silence.max(0)), microseconds(t35))
}

/// A silence inside a frame, and who paused.
pub(crate) fn gap_in_frame(silence: Ns, t15: Ns, frame: &ObservedFrame<'_>) -> String {
    let sender = match (frame.direction, frame.adu.first()) {
        (Direction::Request, _) => String::from("the master paused"),
        (Direction::Response, Some(unit)) => format!("unit {unit} paused"),
        _ => String::from("its sender paused"),
    };
    format!("{} of silence inside, t1.5 is {}: {sender}", microseconds(silence), microseconds(t15))
}

/// As `gap_in_frame`, where the adapter may have hidden more of it.
pub(crate) fn gap_inside_at_least(silence: Ns, t15: Ns, frame: &ObservedFrame<'_>) -> String {
    format!("at least {}", gap_in_frame(silence, t15, frame))
}

pub(crate) fn clock_jumped() -> String {
    String::from("this read is earlier than the one before")
}

fn microseconds(ns: Ns) -> String {
    format!("{} us", ns / 1000)
}

// The order of frames.

/// A finding that pairing has on the frame at hand; the other transaction is named where the finding has one. Findings without
/// words of their own name the unit.
pub(crate) fn order(finding: Finding, result: &PairingResult, frame: &ObservedFrame<'_>) -> String {
    let unit = frame.adu.first().copied().unwrap_or(0);
    let function = frame.adu.get(1).map_or(0, |code| code & !EXCEPTION_BIT);
    let other = result.other.map_or(String::new(), |txn| format!(" {txn}"));
    match finding {
        Finding::Retry => format!("repeats transaction{other}"),
        Finding::LateResponse => format!("responds to transaction{other}"),
        Finding::LocalEcho => format!("repeats the request of transaction{other} immediately"),
        Finding::TwoMasters if result.other.is_some() => format!("sent while transaction{other} was waiting for its response"),
        Finding::TwoMasters => String::from("responded after a later request"),
        Finding::WrongUnit => format!("unit {unit} responded; transaction{other} addressed another"),
        Finding::ConflictingResponse => format!("transaction{other} had another response"),
        Finding::WrongFunction => format!("function {function}; transaction{other} requested another"),
        _ => self::unit(unit),
    }
}

/// A finding that pairing has on an earlier frame.
pub(crate) fn delayed(delayed: &DelayedFinding) -> String {
    let (unit, other) = (delayed.location.unit, delayed.other_txn);
    match delayed.finding {
        Finding::TwoMasters => format!("responded after the request of transaction {other}"),
        Finding::WrongUnit => format!("unit {unit} responded; transaction {other} addressed another"),
        _ => format!("responded after the request of transaction {other}: one master that had given up, or two masters"),
    }
}

// A transaction.

/// `waited`: how long after the request the next one came.
pub(crate) fn no_response(unit: u8, waited: Option<Ns>) -> String {
    let waited = waited.map_or(String::new(), |ns| format!("; the next request came after {} ms", (ns + 500_000) / 1_000_000));
    format!("unit {unit}{waited}")
}

/// How a connection ended, and who ended it, where that is known.
pub(crate) fn connection_closed(end: ConnectionEnd) -> String {
    let what = if end.is_reset { "reset" } else { "closed" };
    match end.by_client {
        Some(true) => format!("the client {what} the connection"),
        Some(false) => format!("the server {what} the connection"),
        None => format!("the connection was {what}"),
    }
}

/// `heard` of `all` frames are of the side that was heard.
pub(crate) fn one_side_only(is_request: bool, heard: u64, all: u64) -> String {
    format!("{heard} of {all} frames are {}", if is_request { "requests" } else { "responses" })
}

/// `valid` of `all` bytes belong to valid frames.
pub(crate) fn no_valid_frame(valid: u64, all: u64) -> String {
    format!("{valid} of {all} bytes belong to valid frames")
}

/// What contradicts physics or the settings of a line.
pub(crate) fn contradiction(contradiction: &Contradiction) -> String {
    match *contradiction {
        Contradiction::Faster { frames, timed, bytes, needed, had } => format!(
            "in {frames} of {timed} frames; for instance {bytes} bytes within {}, which take {} at these settings",
            microseconds(had),
            microseconds(needed)
        ),
        Contradiction::Overfull { bytes, needed, had } => format!(
            "{bytes} bytes take {} ms at these settings, the recording lasts {} ms: a utilization of {} %",
            needed / 1_000_000,
            had / 1_000_000,
            100 * needed / had
        ),
        Contradiction::ErrorsOnValid { frames, valid } => format!("{frames} of {valid} valid frames have errors reported"),
    }
}

/// `n` of `all` responses of a unit have the two bytes of their checksum swapped.
pub(crate) fn swapped_checksum(unit: u8, n: u64, all: u64) -> String {
    format!("unit {unit}: {n} of {all} responses have the bytes of their checksum swapped")
}

/// `n` of `all` responses of a unit have no checksum.
pub(crate) fn missing_checksum(unit: u8, n: u64, all: u64) -> String {
    format!("unit {unit}: {n} of {all} responses have no checksum")
}

/// `n` of `all` responses of a unit are followed by so many bytes of one value.
pub(crate) fn padded_responses(unit: u8, (byte, length): (u8, u8), n: u64, all: u64) -> String {
    let bytes = vec![format!("{byte:02X}"); usize::from(length)].join(" ");
    format!("unit {unit}: {n} of {all} responses are followed by {bytes}")
}

/// `n` of `all` requests to a unit were answered by another one.
pub(crate) fn answers_as_other_unit(asked: u8, answering: u8, n: u64, all: u64) -> String {
    format!("{n} of {all} requests to unit {asked} were answered as unit {answering}")
}

pub(crate) fn exception(code: u8) -> String {
    format!("exception {code}")
}

pub(crate) fn echo_mismatch(field: &str, requested: u32, answered: u32) -> String {
    format!("{field}: request {requested}, response {answered}")
}

pub(crate) fn response_length(bytes: usize, expected: usize) -> String {
    format!("{bytes} bytes, {expected} were requested")
}

/// `requested_bits`: how many bits of the last byte were requested.
pub(crate) fn padding_bits(last: u8, requested_bits: u16) -> String {
    format!("last byte 0x{last:02X}: only its {requested_bits} lowest bits were requested")
}

pub(crate) fn unsupported_function(function: u8, listed: &[u8]) -> String {
    let listed: Vec<String> = listed.iter().map(u8::to_string).collect();
    format!("function {function}; the profile lists {}", listed.join(", "))
}

/// The values of a point make sense in the order `found` only, for this `reason`.
pub(crate) fn order_mismatch(point: &str, found: &str, declared: &str, reason: &str) -> String {
    format!("{point}: {found}, not {declared}: {reason}")
}

// A connection in a capture.

pub(crate) fn missing_segment(bytes: u32, packet: u64) -> String {
    format!("{bytes} bytes are missing before packet {packet}")
}

pub(crate) fn packet_twice(packet: u64) -> String {
    format!("packet {packet} is a copy of an earlier packet; further copies are only counted")
}

/// Both versions of the bytes that differ.
pub(crate) fn conflicting_segment(conflict: &Conflict, packet: u64) -> String {
    let Conflict { at, first, second } = conflict;
    format!("packet {packet} has {} from byte {at} on, where {} had come before", hex(second), hex(first))
}

pub(crate) fn retransmission(packet: u64) -> String {
    format!("packet {packet} repeats bytes that had already arrived")
}
