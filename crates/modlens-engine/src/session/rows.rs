//! Parts that several kinds of rows share: times since the beginning, and copies of frames in a batch.

use crate::pairing::BufferedFrame;
use crate::records::{Batch, FrameRef, Span};
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
    FrameRef { frame: frame.number, wire, pdu, start: frame.start }
}
