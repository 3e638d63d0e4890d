//! Makes one packet of a frame: the data that a Wireshark dissector takes, and the options of the packet.

use super::annotations::{self, FindingNote};
use super::options::Encapsulation;
use super::payload::{self, Route};
use modlens_engine::records::{Batch, Frame};
use modlens_pcapng::blocks;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::Ns;
use modlens_readers::pcap::adu::unwrap;

/// Appends the data of a packet with link type 252 (exported PDU).
pub(super) fn bytes(style: Encapsulation, batch: &Batch, frame: &Frame, route: Route, notes: &[FindingNote], out: &mut Vec<u8>) {
    let wire = frame.wire.of(&batch.arena);
    if !frame.verdict.is_good() {
        let (protocol, info) = annotations::columns(batch, frame, notes);
        payload::data(&protocol, &info, wire, out);
        return;
    }
    let mut scratch = Vec::new();
    let (adu, checksum) = unwrap(frame.mode, frame.verdict, wire, &mut scratch);
    match (style, frame.mode) {
        // ASCII and TCP frames have no CRC; one is computed, because the dissector `mbrtu` requires it.
        (Encapsulation::Rtu, mode) => payload::rtu(adu, if mode == Mode::Rtu { checksum } else { &[] }, out),
        (_, Mode::Tcp) => payload::tcp(route, wire, out),
        _ => payload::udp(route, adu, checksum, out),
    }
}

/// Appends comments, flags and our custom option of a packet.
pub(super) fn annotations(
    style: Encapsulation,
    batch: &Batch,
    frame: &Frame,
    notes: &[FindingNote],
    origin: Option<Ns>,
    out: &mut Vec<u8>,
) {
    if frame.mode == Mode::Ascii && frame.verdict.is_good() {
        let text = String::from_utf8_lossy(frame.wire.of(&batch.arena));
        blocks::comment(&format!("Modbus ASCII {}", text.trim_end()), out);
    }
    if frame.verdict == Verdict::NoChecksum {
        blocks::comment("the recording has no checksums", out);
    }
    if let Some(text) = annotations::exception(frame) {
        blocks::comment(&text, out);
    }
    for note in notes.iter().filter(|(finding, _)| *finding != Finding::Exception) {
        blocks::comment(&annotations::comment(note), out);
    }
    blocks::flags(annotations::flags(batch, frame), out);
    // The dissector `mbrtu` gets an RTU frame even if the frame on the line had another mode. The original bytes are
    // then stored in our custom option.
    let is_verbatim = style != Encapsulation::Rtu
        || frame.verdict != Verdict::NoChecksum && frame.mode == Mode::Rtu
        || !frame.verdict.is_good();
    blocks::custom(out, |out| annotations::custom(batch, frame, is_verbatim, origin, out));
}
