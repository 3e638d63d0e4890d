//! Parts that several kinds of rows share: times since the beginning, the place of a finding, and copies of frames in a batch.

use crate::pairing::BufferedFrame;
use crate::records::{Batch, FindingRow, FrameRef, Span};
use modlens_protocol::finding::Finding;
use modlens_protocol::Ns;

/// Time since the beginning of the recording.
pub(crate) fn elapsed(recording_start: Option<Ns>, time: Option<Ns>) -> Option<Ns> {
    Some(time? - recording_start?)
}

/// Copies a request or response into the batch; empty where the transaction lacks it.
pub(super) fn store_frame(batch: &mut Batch, frame: &BufferedFrame) -> FrameRef {
    if !frame.is_present() {
        return FrameRef::default();
    }
    let wire = batch.store(&frame.wire);
    let pdu = match frame.pdu_index() {
        Some(at) => Span { start: wire.start + at as u32, length: frame.pdu().len() as u32 },
        None => batch.store(frame.pdu()),
    };
    FrameRef { frame: frame.number, wire, pdu, start: frame.start, end: frame.end }
}

/// What the row of a finding reports about the place where it was found.
#[derive(Clone, Copy)]
pub(crate) struct FindingPlace {
    /// Number of the frame.
    pub frame: Option<u64>,
    /// Number of the transaction.
    pub txn: Option<u64>,
    /// Index of the bus.
    pub bus: usize,
    /// Start of the frame or transaction.
    pub start: Option<Ns>,
    /// Start of the recording.
    pub recording_start: Option<Ns>,
    /// Unit.
    pub unit: Option<u8>,
    /// Line, packet or offset in the recording.
    pub origin: u64,
}

impl FindingPlace {
    /// The row of a finding at this place.
    pub(crate) fn row(&self, finding: Finding, detail: String) -> FindingRow {
        FindingRow {
            frame: self.frame,
            txn: self.txn,
            bus: self.bus as u32,
            start: self.start,
            elapsed: elapsed(self.recording_start, self.start),
            unit: self.unit,
            finding,
            detail,
            origin: self.origin,
        }
    }
}
