//! The annotations of a frame: comments, flags, texts for bytes that are no valid frame, and our custom option.

use std::fmt::Write as _;

use modlens_engine::records::{Batch, Bus, Frame, FrameRef, Transaction};
use modlens_protocol::decimal::{push_int, push_short};
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::{Finding, Severity};
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::EXCEPTION_BIT;
use modlens_protocol::hex::hex;
use modlens_protocol::source::Clock;
use modlens_protocol::Ns;
use modlens_readers::pcap::metadata::DEFAULTS;
use modlens_tables::cell_text::push_us;
use modlens_tables::columns::exception_name;

/// Bits of the flags option (draft-ietf-opsawg-pcapng, section 4.3).
const BROADCAST_UNIT: u32 = 3 << 2;
const CHECKSUM_ERROR: u32 = 1 << 24;
const TOO_SHORT: u32 = 1 << 26;
const WRONG_GAP: u32 = 1 << 27;
const SYMBOL_ERROR: u32 = 1 << 31;

/// A finding and its detail.
pub type FindingNote = (Finding, String);

/// A finding as a comment: severity, code, title and detail.
pub fn comment((finding, detail): &FindingNote) -> String {
    let doc = finding.doc();
    let separator = if detail.is_empty() { "" } else { ": " };
    format!("{} {}: {}{separator}{detail}", doc.severity.text(), doc.code, doc.title)
}

/// The flags of a frame, most of which stand for errors.
pub fn flags(batch: &Batch, frame: &Frame) -> u32 {
    let mut flags = 0;
    if frame.verdict.is_good() && frame.unit == Some(0) && frame.mode != Mode::Tcp && frame.direction == Direction::Request {
        flags |= BROADCAST_UNIT;
    }
    flags |= match frame.verdict {
        Verdict::BadChecksum => CHECKSUM_ERROR,
        Verdict::Incomplete => TOO_SHORT,
        _ => 0,
    };
    for code in frame.findings.of(&batch.codes) {
        flags |= match code {
            Finding::ShortSilence | Finding::GapInFrame => WRONG_GAP,
            Finding::LineError => SYMBOL_ERROR,
            _ => 0,
        };
    }
    flags
}

/// The texts of the columns Protocol and Info for bytes that are no valid frame.
pub fn columns(batch: &Batch, frame: &Frame, notes: &[FindingNote]) -> (String, String) {
    let mode = frame.mode.text().to_uppercase();
    let checksum = if frame.mode == Mode::Ascii { "LRC" } else { "CRC" };
    let (kind, mut info) = match frame.verdict {
        Verdict::BadChecksum => (format!("{mode} bad {checksum}"), format!("{} bytes, checksum error", frame.wire.length)),
        Verdict::Incomplete => (format!("{mode} incomplete"), format!("{} bytes, the frame ends too early", frame.wire.length)),
        _ => (format!("{mode} noise"), format!("{} bytes, no valid frame", frame.wire.length)),
    };
    if let (Some(unit), Some(code)) = (frame.unit, frame.code) {
        let name = modlens_tables::columns::functions(batch).name(code & !EXCEPTION_BIT).unwrap_or("unknown");
        let _ = write!(info, ", unit {unit}, function {} {name}?", code & !EXCEPTION_BIT);
    }
    let is_described_already =
        |finding: &Finding| !matches!(finding, Finding::BadChecksum | Finding::Incomplete | Finding::BitFlip);
    for (finding, detail) in
        notes.iter().filter(|(finding, _)| is_described_already(finding) && finding.doc().severity != Severity::Info)
    {
        let _ = write!(info, ", {}: {detail}", finding.doc().title);
    }
    (kind, info)
}

/// A sentence for an exception response, which Wireshark names by its number only.
pub fn exception(frame: &Frame) -> Option<String> {
    let code = frame.exception?;
    Some(format!("exception {code}: {}", exception_name(code).unwrap_or("not in the specification")))
}

/// Everything about a frame for which pcapng has no field, as `key=value` separated by spaces. Columns with their usual
/// value are left out.
///
/// `pcap::metadata` reads this: from these words, the bytes and the comments it restores the rows. `verbatim` says that the
/// packet contains the bytes of the line unchanged; `origin` is given if no interface block has it.
pub fn custom(batch: &Batch, frame: &Frame, verbatim: bool, origin: Option<Ns>, out: &mut Vec<u8>) {
    push_number("frame=", frame.number, out);
    if let Some(txn) = frame.txn {
        push_number(" txn=", txn, out);
    }
    push_number(" offset=", frame.offset, out);
    push_word(" direction=", frame.direction.text(), out);
    if frame.mode != DEFAULTS.mode {
        push_word(" mode=", frame.mode.text(), out);
    }
    if frame.verdict != DEFAULTS.verdict {
        push_word(" verdict=", frame.verdict.text(), out);
    }
    if frame.delimited_by != DEFAULTS.delimited_by {
        push_word(" delimited_by=", frame.delimited_by.text(), out);
    }
    if frame.confidence != DEFAULTS.confidence {
        push_number(" confidence=", u64::from(frame.confidence), out);
    }
    if frame.unconfirmed {
        out.extend_from_slice(b" unconfirmed");
    }
    if let Some(gap) = frame.gap {
        push_us_field(" gap_us=", gap, out);
    }
    if frame.start.is_none() {
        out.extend_from_slice(b" no_time");
    }
    if !frame.verdict.is_good() {
        for (key, value) in [(" unit=", frame.unit), (" code=", frame.code)] {
            if let Some(value) = value {
                push_number(key, u64::from(value), out);
            }
        }
    }
    if let Some(id) = frame.mbap_id {
        push_number(" mbap_id=", u64::from(id), out);
    }
    if let Some(network) = &batch.buses[frame.bus as usize].network {
        push_number(" connection=", network.connection, out);
        push_word(" client=", &network.client, out);
    }
    if let Some(origin) = origin {
        out.extend_from_slice(b" origin_ns=");
        push_int(origin, out);
    }
    push_codes(frame.findings.of(&batch.codes), out);
    if !verbatim {
        push_word(" wire=", &hex(frame.wire.of(&batch.arena)), out);
    }
}

/// Everything about a transaction for which pcapng has no field, for the packet of its last frame.
pub fn transaction(batch: &Batch, row: &Transaction, out: &mut Vec<u8>) {
    push_number("transaction=", row.number, out);
    if row.status != DEFAULTS.status {
        push_word(" status=", row.status.text(), out);
    }
    let halves = [(" request=", " request_pdu=", &row.request), (" response=", " response_pdu=", &row.response)];
    for (key, bytes, half) in halves {
        if half.frame > 0 {
            push_number(key, half.frame, out);
            let pdu = half.pdu.of(&batch.arena);
            let usual = usual_pdu(batch, row.mode, half);
            if !std::ptr::eq(pdu, usual) && pdu != usual {
                push_word(bytes, &hex(pdu), out);
            }
        }
    }
    let times = [(" response_us=", row.response_time), (" waited_us=", row.waited), (" late_us=", row.late_response)];
    for (key, ns) in times.into_iter().chain([(" gap_us=", row.gap)]) {
        if let Some(ns) = ns {
            push_us_field(key, ns, out);
        }
    }
    for (key, value) in [(" retry_of=", row.retry_of), (" late_response_to=", row.late_response_to)] {
        if let Some(value) = value {
            push_number(key, value, out);
        }
    }
    if let Some(code) = row.exception {
        push_number(" exception=", u64::from(code), out);
    }
    if let Some(id) = row.mbap_id {
        push_number(" mbap_id=", u64::from(id), out);
    }
    if row.confidence != DEFAULTS.confidence {
        push_number(" confidence=", u64::from(row.confidence), out);
    }
    if row.unconfirmed {
        out.extend_from_slice(b" unconfirmed");
    }
    push_codes(row.findings.of(&batch.codes), out);
}

/// The PDU that a reader finds in the bytes of a valid frame.
fn usual_pdu<'a>(batch: &'a Batch, mode: Mode, half: &FrameRef) -> &'a [u8] {
    let wire = half.wire.of(&batch.arena);
    match mode {
        Mode::Rtu => wire.get(1..wire.len().saturating_sub(2)).unwrap_or(&[]),
        Mode::Tcp => wire.get(7..).unwrap_or(&[]),
        Mode::Ascii => &[],
    }
}

/// Appends finding codes.
fn push_codes(codes: &[Finding], out: &mut Vec<u8>) {
    for (at, code) in codes.iter().enumerate() {
        push_word(if at == 0 { " findings=" } else { "," }, code.doc().code, out);
    }
}

/// The keys are constants at each call: when this is inlined, appending a key is a single store.
#[inline(always)]
#[allow(clippy::inline_always)]
fn push_number(key: &str, value: u64, out: &mut Vec<u8>) {
    out.extend_from_slice(key.as_bytes());
    push_int(value as i64, out);
}

#[inline(always)]
#[allow(clippy::inline_always)]
fn push_us_field(key: &str, ns: Ns, out: &mut Vec<u8>) {
    out.extend_from_slice(key.as_bytes());
    push_us(ns, out);
}

#[inline(always)]
#[allow(clippy::inline_always)]
fn push_word(key: &str, value: &str, out: &mut Vec<u8>) {
    out.extend_from_slice(key.as_bytes());
    push_short(value.as_bytes(), out);
}

/// Name, description and our custom option for the interface of a bus, or of one of its lines. `how` describes the
/// encapsulation.
///
/// `origin` is the time of the first frame, from which `elapsed_us` counts.
pub fn interface(bus: &Bus, line: u8, origin: Option<Ns>, encapsulation: &str) -> (String, String, String) {
    let letter = match line {
        0 => "",
        1 => "A",
        _ => "B",
    };
    let name = if line == 0 { bus.name.clone() } else { format!("{} [{letter}]", bus.name) };
    let settings = bus.line.map(|line| line.to_string());
    let described = settings.as_ref().map_or(String::new(), |settings| format!(", {settings}"));
    let description = format!("Modbus{described}; {encapsulation}");
    let clock = match bus.clock {
        Clock::Utc => "utc",
        Clock::Relative => "relative",
        Clock::None => "none",
    };
    let mut custom = format!("export clock={clock}");
    if let Some(origin) = origin {
        let _ = write!(custom, " origin_ns={origin}");
    }
    if let Some(settings) = settings {
        let _ = write!(custom, " settings={settings}");
    }
    if line > 0 {
        let _ = write!(custom, " line={letter}");
    }
    // The name comes last because it may contain spaces.
    let _ = write!(custom, " name={}", bus.name);
    (name, description, custom)
}
