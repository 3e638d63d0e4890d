//! What the frames of a short recording say, in words: facts that hold whatever the trouble is.

use std::collections::VecDeque;

use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::{Functions, StandardLayout};
use modlens_protocol::in_words::{answer, registers, request};
use modlens_protocol::mbap::PREFIX_BYTES;

use crate::observation::{Observation, Outcome, RequestKey};

/// How a request begins in words.
pub const REQUEST: &str = "a request";

/// A longer recording is not told frame by frame.
const MOST_ROWS: usize = 8;

/// What a short recording says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Told {
    /// The first of what was answered, such as `unit 1 answers the read of holding registers 0 to 1 (function 3) with 10 and 20`.
    pub answered: Option<String>,
    /// The requests and answers of which the other half is missing.
    pub alone: Vec<String>,
    /// No transaction has a finding that is more than worth knowing, but that an answer has no request.
    pub is_plain: bool,
}

impl Told {
    /// What these transactions say; `None` of a longer recording.
    pub(super) fn of(transactions: &VecDeque<Observation>, mode: Option<Mode>) -> Option<Self> {
        if transactions.len() > MOST_ROWS {
            return None;
        }
        let mut all: Vec<String> = transactions.iter().filter_map(|seen| alone(seen, mode)).collect();
        all.dedup();
        let is_plain = |seen: &Observation| !seen.findings.without(Finding::Unsolicited).has_trouble();
        Some(Self { answered: transactions.iter().find_map(answered), alone: all, is_plain: transactions.iter().all(is_plain) })
    }
}

/// What was answered.
fn answered(seen: &Observation) -> Option<String> {
    if seen.outcome != Outcome::Good {
        return None;
    }
    let (unit, asked) = (seen.unit, asked(seen)?);
    if seen.writes {
        return Some(format!("unit {unit} confirms {asked}"));
    }
    let has_registers = seen.data.is_present && matches!(seen.function, 3 | 4);
    let values =
        if has_registers { format!(" with {}", registers(seen.data.head, seen.data.length.into())) } else { String::new() };
    Some(format!("unit {unit} answers {asked}{values}"))
}

/// What is asked for.
fn asked(seen: &Observation) -> Option<String> {
    match seen.key() {
        Some(key) => request(key.function, key.address, key.quantity),
        None => Some(format!("\u{ab}{}\u{bb}", Functions::embedded().name(seen.function)?)),
    }
}

/// The address that a number of manuals stands for.
fn in_manuals(seen: &Observation) -> String {
    let meant = seen.key().and_then(RequestKey::meant_by_manuals);
    meant.map_or(String::new(), |meant| format!("; as a number of a manual, that is address {meant} on the wire"))
}

/// A request or an answer without the other half.
fn alone(seen: &Observation, mode: Option<Mode>) -> Option<String> {
    let unit = seen.unit;
    match seen.outcome {
        Outcome::NotSeen | Outcome::Silent => {
            Some(format!("{REQUEST} to unit {unit}: {}{}{}", asked(seen)?, or_confirmed(seen, mode), in_manuals(seen)))
        }
        Outcome::Unasked => Some(format!("an answer of unit {unit}: {}", answer(seen.answer_head.get(head(mode?)?..)?)?)),
        _ => None,
    }
}

/// The bytes of a frame before its PDU; of a line in ASCII, a frame has characters.
fn head(mode: Mode) -> Option<usize> {
    match mode {
        Mode::Rtu => Some(1),
        Mode::Tcp => Some(PREFIX_BYTES + 1),
        Mode::Ascii => None,
    }
}

/// The value that a write of one has, for the reader to compare, and that it may be its confirmation.
fn or_confirmed(seen: &Observation, mode: Option<Mode>) -> String {
    let layout = Functions::embedded().standard_request(seen.function);
    if layout.is_none_or(|one| one.kind != StandardLayout::WriteOne) {
        return String::new();
    }
    let value = mode.and_then(head).and_then(|head| match seen.request_head.get(head..)? {
        [_, _, _, high, low, ..] => Some(u16::from_be_bytes([*high, *low])),
        _ => None,
    });
    let written = value.map_or(String::new(), |value| format!(" with {value} (hex {value:04X})"));
    format!("{written}, or its confirmation, which has the same bytes")
}
