//! Words and bytes of rows.

use crate::pairing::{Kept, Note, Placed, Seen};
use crate::records::{Batch, Half, Span};
use modlens_protocol::finding::Finding;
use modlens_protocol::functions::EXCEPTION_BIT;
use modlens_protocol::Ns;

pub(super) fn elapsed(origin: Option<Ns>, start: Option<Ns>) -> Option<Ns> {
    Some(start? - origin?)
}

pub(super) fn framing_detail(finding: Finding, wire: &[u8]) -> String {
    match finding {
        Finding::MbapLength => format!("{} bytes on the wire do not fit the layout of the function", wire.len()),
        _ => format!("{} characters", wire.len()),
    }
}

/// Receivers tell byte by byte, or for a read as a whole (then `marked` is 0).
pub(super) fn marked_detail(marked: usize, length: usize) -> String {
    match marked {
        0 => String::from("marked by the receiver"),
        _ => format!("the receiver marked {marked} of {length} bytes"),
    }
}

pub(super) fn placed_detail(finding: Finding, placed: &Placed, seen: &Seen<'_>) -> String {
    let unit = seen.adu.first().copied().unwrap_or(0);
    let other = placed.other.map_or(String::new(), |txn| format!(" {txn}"));
    match finding {
        Finding::Retry => format!("repeats transaction{other}"),
        Finding::LateResponse => format!("answers transaction{other}"),
        Finding::LocalEcho => format!("repeats the request of transaction{other} at once"),
        Finding::TwoMasters if placed.other.is_some() => format!("asked while transaction{other} waited for its answer"),
        Finding::TwoMasters => String::from("answered after a later request"),
        Finding::WrongUnit => format!("unit {unit} answered; transaction{other} asked another"),
        Finding::WrongFunction => {
            format!("function {}; transaction{other} asked for another", seen.adu.get(1).map_or(0, |code| code & !EXCEPTION_BIT))
        }
        _ => format!("unit {unit}"),
    }
}

pub(super) fn note_detail(note: &Note) -> String {
    let seen = note.meeting;
    match note.finding {
        Finding::TwoMasters => format!("answered after the request of transaction {}", seen.other),
        Finding::WrongUnit => format!("unit {} answered; transaction {} asked another", seen.unit, seen.other),
        _ => format!("answered after the request of transaction {}; one master that gave up, or two", seen.other),
    }
}

pub(super) fn keep_half(batch: &mut Batch, kept: &Kept) -> Half {
    if kept.frame == 0 {
        return Half::default();
    }
    let wire = batch.keep(&kept.wire);
    let pdu = match kept.inside() {
        Some(at) => Span { start: wire.start + at as u32, length: kept.pdu().len() as u32 },
        None => batch.keep(kept.pdu()),
    };
    Half { frame: kept.frame, wire, pdu, start: kept.start }
}
