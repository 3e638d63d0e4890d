//! Parts that several kinds of rows share: the details of findings, and copies of frames in a batch.

use crate::pairing::{BufferedFrame, DelayedFinding, ObservedFrame, PairingResult};
use crate::records::{Batch, Half, Span};
use modlens_protocol::finding::Finding;
use modlens_protocol::functions::EXCEPTION_BIT;
use modlens_protocol::Ns;

/// Time since the beginning of the recording.
pub(super) fn elapsed(recording_start: Option<Ns>, time: Option<Ns>) -> Option<Ns> {
    Some(time? - recording_start?)
}

/// The detail of a finding that a framer reports.
pub(super) fn framing_detail(finding: Finding, wire: &[u8]) -> String {
    match finding {
        Finding::MbapLength => format!("{} bytes on the wire do not fit the layout of the function", wire.len()),
        _ => format!("{} characters", wire.len()),
    }
}

/// The detail of a line error. Receivers mark single bytes, or a read as a whole (then `marked_bytes` is 0).
pub(super) fn marked_detail(marked_bytes: usize, length: usize) -> String {
    match marked_bytes {
        0 => String::from("marked by the receiver"),
        _ => format!("the receiver marked {marked_bytes} of {length} bytes"),
    }
}

/// The detail of a finding that pairing reports on the frame at hand.
pub(super) fn placed_detail(finding: Finding, result: &PairingResult, frame: &ObservedFrame<'_>) -> String {
    let unit = frame.adu.first().copied().unwrap_or(0);
    let other = result.other.map_or(String::new(), |txn| format!(" {txn}"));
    match finding {
        Finding::Retry => format!("repeats transaction{other}"),
        Finding::LateResponse => format!("answers transaction{other}"),
        Finding::LocalEcho => format!("repeats the request of transaction{other} at once"),
        Finding::TwoMasters if result.other.is_some() => format!("asked while transaction{other} waited for its answer"),
        Finding::TwoMasters => String::from("answered after a later request"),
        Finding::WrongUnit => format!("unit {unit} answered; transaction{other} asked another"),
        Finding::WrongFunction => {
            format!("function {}; transaction{other} asked for another", frame.adu.get(1).map_or(0, |code| code & !EXCEPTION_BIT))
        }
        _ => format!("unit {unit}"),
    }
}

/// The detail of a finding on a frame whose row is already written.
pub(super) fn note_detail(delayed: &DelayedFinding) -> String {
    let (unit, other) = (delayed.location.unit, delayed.other_txn);
    match delayed.finding {
        Finding::TwoMasters => format!("answered after the request of transaction {other}"),
        Finding::WrongUnit => format!("unit {unit} answered; transaction {other} asked another"),
        _ => format!("answered after the request of transaction {other}; one master that gave up, or two"),
    }
}

/// Copies a request or response into the batch; empty where the transaction lacks it.
pub(super) fn keep_half(batch: &mut Batch, frame: &BufferedFrame) -> Half {
    if !frame.is_present() {
        return Half::default();
    }
    let wire = batch.keep(&frame.wire);
    let pdu = match frame.pdu_index() {
        Some(at) => Span { start: wire.start + at as u32, length: frame.pdu().len() as u32 },
        None => batch.keep(frame.pdu()),
    };
    Half { frame: frame.number, wire, pdu, start: frame.start }
}
