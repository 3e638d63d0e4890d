//! Import of captures that modlens has written: frames and transactions become the same rows again, without framing and
//! pairing them again.
//!
//! They cannot be decided again, because the file may lack what they were decided by: the bytes around a frame, the reads
//! after a pause, the requests before a response. The metadata of each packet give its verdict, direction and transaction;
//! only the bytes are decoded again.

use crate::findings::Found;
use crate::pairing::{BufferedFrame, ObservedFrame, PendingTransaction};
use crate::records::{Bus, Frame, InnerPauses, Network, Span};
use crate::session::bus::{FROM_CLIENT, FROM_SERVER};
use crate::session::decoder::Decoder;
use crate::session::rows::{elapsed, FindingPlace};
use crate::session::sources::{CaptureOptions, ReimportState, WaitingFrame};
use crate::session::BusOptions;
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::functions::EXCEPTION_BIT;
use modlens_protocol::renamed::{current, Vocabulary};
use modlens_protocol::source::Place;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;
use modlens_readers::pcap::adu::unwrap;
use modlens_readers::pcap::metadata::{self, micros, named, number, unhex, value, PacketMetadata, PortMetadata};
use modlens_readers::pcap::Interface;

/// Frames that may wait for the metadata of their transaction. In a file that was cut, some wait for ever.
const MAX_WAITING_FRAMES: usize = 4_096;

/// The findings in a packet's metadata.
fn finding_codes(text: &str) -> Vec<Finding> {
    value(text, "findings").map_or(Vec::new(), |list| list.split(',').filter_map(Finding::from_code).collect())
}

/// The finding and its detail in a comment `severity code: title: detail`, as `capture::annotations` of the writers writes it.
/// `None` for any other comment. The detail is empty where the comment has none.
fn finding_in(comment: &str) -> Option<(Finding, String)> {
    let (head, rest) = comment.split_once(": ")?;
    let (severity, code) = head.split_once(' ')?;
    let finding = Finding::from_code(code).filter(|finding| finding.doc().severity.text() == severity)?;
    // Files of the version before have other titles; no title has a colon in it.
    let detail = if rest == finding.doc().title { "" } else { rest.split_once(": ").map_or("", |(_, detail)| detail) };
    Some((finding, detail.to_owned()))
}

/// Unit and PDU of a good frame.
fn adu_of<'a>(metadata: &'a PacketMetadata<'_>, scratch: &'a mut Vec<u8>) -> &'a [u8] {
    unwrap(metadata.fields.mode, metadata.fields.verdict, &metadata.bytes, scratch).0
}

/// The line of a connection on which frames of this direction come.
fn connection_line(direction: Direction) -> u8 {
    if direction == Direction::Response {
        FROM_SERVER
    } else {
        FROM_CLIENT
    }
}

/// The frame from which the statistics and its row are made. `frame_number` is its number in this session, `adu` has unit and PDU if it is a good one;
/// `packet` and `time`, in ns, are those of its packet. Its end is its start and `char_ns` for each of its
/// bytes; with 0, because the line settings are not known, both are the same.
fn observed<'a>(
    metadata: &'a PacketMetadata<'_>,
    frame_number: u64,
    adu: &'a [u8],
    char_ns: Ns,
    (packet, time): (u64, Option<Ns>),
) -> ObservedFrame<'a> {
    let (frame_words, fields) = (metadata.frame, &metadata.fields);
    let start = time.filter(|_| !frame_words.split(' ').any(|word| word == "no_time"));
    ObservedFrame {
        number: frame_number,
        wire: &metadata.bytes,
        adu,
        verdict: fields.verdict,
        direction: fields.direction,
        mode: fields.mode,
        start,
        end: start.map(|start| start + metadata.bytes.len() as Ns * char_ns),
        clean_start: true,
        gap: micros(frame_words, "gap_us"),
        mbap_id: number(frame_words, "mbap_id").map(|id| id as u16),
        origin: packet,
        unconfirmed: is_unconfirmed(frame_words),
        confidence: confidence_of(frame_words),
        is_cut: false,
        lacks_request: false,
        side: None,
        codes: &[],
    }
}

/// The row of a frame, as far as its metadata alone tell it: the caller adds bus, line, transaction, and the places of its
/// bytes and findings in the batch.
///
/// Unit and function of a good frame are read from its bytes, those of a damaged one from the metadata, since its bytes do
/// not tell them. Only a good frame has an exception code.
fn frame_row(metadata: &PacketMetadata<'_>, observed: &ObservedFrame<'_>) -> Frame {
    let (text, adu) = (metadata.frame, observed.adu);
    let byte_of = |key: &str| number(text, key).map(|value| value as u8);
    let is_good = observed.verdict.is_good();
    let code = if is_good { adu.get(1).copied() } else { byte_of("code") };
    let is_exception = is_good && code.is_some_and(|code| code & EXCEPTION_BIT != 0);
    Frame {
        number: observed.number,
        offset: number(text, "offset").unwrap_or(0),
        start: observed.start,
        end: observed.end,
        gap: observed.gap,
        pauses: InnerPauses::default(),
        mode: observed.mode,
        direction: observed.direction,
        unit: if is_good { adu.first().copied() } else { byte_of("unit") },
        code,
        exception: adu.get(2).copied().filter(|_| is_exception),
        verdict: observed.verdict,
        unconfirmed: observed.unconfirmed,
        confidence: observed.confidence,
        delimited_by: metadata.fields.delimited_by,
        mbap_id: observed.mbap_id,
        origin: observed.origin,
        last_origin: observed.origin,
        side: observed.side,
        bus: 0,
        line: 0,
        wire: Span::default(),
        elapsed: None,
        txn: None,
        findings: Span::default(),
    }
}

/// Takes the frame out of the waiting ones that the metadata of a transaction name by this `key`, `request` or `response`. Its
/// PDU is replaced if the metadata have one (`request_pdu`). `None` if they name none or it does not wait.
fn take_half(reimport: &mut ReimportState, text: &str, key: &str) -> Option<WaitingFrame> {
    let found = reimport.waiting.remove(&(reimport.frames_before + number(text, key)?))?;
    Some(match value(text, &format!("{key}_pdu")).and_then(unhex) {
        Some(pdu) => WaitingFrame { frame: found.frame.clone().with_pdu(&pdu), ..found },
        None => found,
    })
}

/// The transaction in these metadata, without its frames; `None` if its status is unknown. `first` is its first frame, from
/// which unit, function and framing are taken. `txns_before` is added to the transaction numbers of the file.
fn transaction_in(text: &str, txns_before: u64, first: &WaitingFrame) -> Option<Box<PendingTransaction>> {
    let status = metadata::value_or_default(text, "status", metadata::DEFAULTS.status, |name| {
        named(&Status::ALL, Status::text, name.map(|name| current(Vocabulary::Status, name)))
    });
    let other = |key: &str| number(text, key).map(|txn| txns_before + txn);
    Some(Box::new(PendingTransaction {
        status: status?,
        exception: number(text, "exception").map(|code| code as u8),
        response_time: micros(text, "response_us"),
        waited: micros(text, "waited_us"),
        late_response: micros(text, "late_us"),
        retry_of: other("retry_of"),
        late_response_to: other("late_response_to"),
        gap: micros(text, "gap_us"),
        mbap_id: number(text, "mbap_id").map(|id| id as u16),
        findings: finding_codes(text),
        certainty: confidence_of(text),
        unconfirmed: is_unconfirmed(text),
        ..transaction_of(first, txns_before + number(text, "transaction").unwrap_or(0))
    }))
}

/// A transaction that is read back, as far as its first frame shows it.
fn transaction_of(first: &WaitingFrame, txn: u64) -> PendingTransaction {
    PendingTransaction {
        txn,
        unit: first.adu.first().copied().unwrap_or(0),
        function: first.adu.get(1).map_or(0, |code| code & !EXCEPTION_BIT),
        origin: first.packet,
        is_reimported: true,
        ..PendingTransaction::new(first.mode)
    }
}

/// The findings in the comments of a packet: those on the frame itself, as its metadata name them, and the others. If the
/// metadata name a finding once, only the first comment on it is on the frame.
fn commented_findings(metadata: &PacketMetadata<'_>) -> (Found, Found) {
    let mut codes = finding_codes(metadata.frame);
    let findings = metadata.comments.iter().filter_map(|comment| finding_in(comment));
    findings.partition(|(finding, _)| {
        let named = codes.iter().position(|code| code == finding);
        named.map(|at| codes.remove(at)).is_some()
    })
}

impl Decoder {
    /// Imports a packet with our metadata: one frame, and the transactions that are complete with it. `packet` is its number,
    /// `time` its time in ns.
    ///
    /// The comments of the packet hold findings with their details. Those that the metadata of the frame name are emitted at
    /// once as findings on the frame; the others wait with it for its transaction. The beginning of the recording, if the
    /// session does not know it yet, is that of the interface's metadata, or else of the frame's. Packets of an interface that
    /// modlens did not write are ignored.
    pub(super) fn reimport_packet(
        &mut self,
        reimport: &mut ReimportState,
        options: &CaptureOptions,
        interface: &Interface,
        metadata: &PacketMetadata<'_>,
        packet: u64,
        time: Option<Ns>,
    ) {
        let Some(port) = &interface.written_by_modlens else { return };
        let in_frame = || value(metadata.frame, "origin_ns").and_then(|text| text.parse().ok());
        if let Some(recording_start) = port.origin.or_else(in_frame) {
            self.origin.get_or_insert(recording_start);
        }
        let bus = self.reimport_bus(reimport, options, port, metadata.frame);
        let frame = self.reimport_frame(reimport, (bus, port.line), metadata, packet, time);
        let (on_frame, other_findings) = commented_findings(metadata);
        for finding in on_frame {
            self.emit_frame_finding(&frame, finding);
        }
        self.wait_for_transaction(reimport, &frame, metadata, other_findings);
        if self.wanted.frames {
            self.batch.frames.push(frame);
        }
        for text in &metadata.transactions {
            self.reimport_transaction(reimport, text);
        }
    }

    /// The index of the bus of a packet, which is added if it is new: one for each port, or, on connections, for each server
    /// and number of the connection. `frame_words` is the metadata of the frame.
    fn reimport_bus(
        &mut self,
        reimport: &mut ReimportState,
        options: &CaptureOptions,
        port: &PortMetadata,
        frame_words: &str,
    ) -> usize {
        let connection = number(frame_words, "connection");
        if let Some((_, bus)) = reimport.buses.iter().rev().find(|((name, of), _)| *of == connection && *name == port.name) {
            return *bus;
        }
        let network = connection.map(|connection| Network {
            client_port: None,
            client: value(frame_words, "client").unwrap_or_default().to_owned(),
            server: port.name.clone(),
            connection,
        });
        let name = port.name.clone();
        let row =
            Bus { name, source: options.source.clone(), place: Place::Packet, clock: port.clock, line: port.settings, network };
        let bus = self.add_bus(BusOptions { bus: row, mode: None, line: port.settings, resolution: None, rule: None });
        reimport.buses.push(((port.name.clone(), connection), bus));
        bus
    }

    /// The row of a frame, from its bytes and metadata. It is counted in the statistics, but not yet added to the batch; only
    /// its bytes and findings are. Frames get the numbers in the file, counted on from those given before it.
    ///
    /// `line_number` is the line of a serial interface; on a connection the direction gives the line.
    fn reimport_frame(
        &mut self,
        reimport: &ReimportState,
        (bus, line_number): (usize, u8),
        metadata: &PacketMetadata<'_>,
        packet: u64,
        time: Option<Ns>,
    ) -> Frame {
        let mut scratch = Vec::new();
        let adu = if metadata.fields.verdict.is_good() { adu_of(metadata, &mut scratch) } else { &[][..] };
        let number = reimport.frames_before + metadata.fields.number;
        self.next_frame = self.next_frame.max(number + 1);
        let char_ns = self.bus_rows[bus].line.map_or(0, |line| line.char_ns());
        let observed = observed(metadata, number, adu, char_ns, (packet, time));
        self.stats.frame(self.buses[bus].counts, observed.mode, &observed);
        let is_connection = self.bus_rows[bus].network.is_some();
        let line = if is_connection { connection_line(observed.direction) } else { line_number };
        Frame {
            bus: bus as u32,
            line,
            wire: self.batch.store(&metadata.bytes),
            elapsed: elapsed(self.origin, observed.start),
            txn: metadata::number(metadata.frame, "txn").map(|txn| reimport.txns_before + txn),
            findings: self.batch.store_findings(&finding_codes(metadata.frame)),
            ..frame_row(metadata, &observed)
        }
    }

    /// Emits a finding on the frame itself, or any finding on a frame that belongs to no transaction. It is counted in any
    /// case, but gets a row only if findings are wanted.
    fn emit_frame_finding(&mut self, frame: &Frame, (finding, detail): (Finding, String)) {
        self.stats.finding(finding);
        if self.wanted.findings {
            let place = FindingPlace {
                frame: Some(frame.number),
                txn: frame.txn,
                bus: frame.bus as usize,
                start: frame.start,
                recording_start: self.origin,
                unit: frame.unit,
                origin: frame.origin,
            };
            self.batch.findings.push(place.row(finding, detail));
        }
    }

    /// Keeps a frame until its transaction is read, with the findings that are not on the frame itself. Those on a frame
    /// without transaction are emitted at once, and it is not kept. If too many wait, the one with the smallest number is
    /// dropped; its transaction will lack this half. Transactions of the session are numbered on after those read.
    fn wait_for_transaction(
        &mut self,
        reimport: &mut ReimportState,
        frame: &Frame,
        metadata: &PacketMetadata<'_>,
        other_findings: Vec<(Finding, String)>,
    ) {
        let fields = &metadata.fields;
        let Some(txn) = frame.txn else {
            for finding in other_findings {
                self.emit_frame_finding(frame, finding);
            }
            return;
        };
        self.next_txn = self.next_txn.max(txn + 1);
        let mut scratch = Vec::new();
        let adu = if fields.verdict.is_good() {
            adu_of(metadata, &mut scratch).to_vec()
        } else {
            frame.unit.into_iter().chain(frame.code).collect()
        };
        let buffered = BufferedFrame::new(frame.number, &metadata.bytes, adu.get(1..).unwrap_or(&[]), frame.start);
        let (bus, gap, packet, direction) = (frame.bus as usize, frame.gap, frame.origin, fields.direction);
        let waiting = WaitingFrame { bus, txn, mode: fields.mode, adu, frame: buffered, direction, other_findings, gap, packet };
        reimport.waiting.insert(frame.number, waiting);
        if reimport.waiting.len() > MAX_WAITING_FRAMES {
            reimport.waiting.pop_first();
        }
    }

    /// Emits a transaction with the frames that it names, as far as they wait in `reimport`. `text` is its metadata.
    ///
    /// A transaction of which no frame waits is left out, and so is one with an unknown status. Other frames of this
    /// transaction, such as an echo, stop waiting.
    fn reimport_transaction(&mut self, reimport: &mut ReimportState, text: &str) {
        let txn = reimport.txns_before + number(text, "transaction").unwrap_or(0);
        let halves = ["request", "response"].map(|key| take_half(reimport, text, key));
        let Some(first) = halves.iter().flatten().next() else { return };
        let bus = first.bus;
        let Some(mut transaction) = transaction_in(text, reimport.txns_before, first) else { return };
        let [request, response] = halves.map(|half| half.map(|half| self.emit_delayed_findings_of(half, &mut transaction)));
        (transaction.request, transaction.response) = (request.unwrap_or_default(), response.unwrap_or_default());
        self.done.push(transaction);
        self.emit_transactions(bus);
        reimport.waiting.retain(|_, waiting| waiting.txn != txn);
    }

    /// Gives the findings that waited with a frame to its transaction if that names them in its metadata; the others showed
    /// only after the frame's row was written, and are emitted as such. Returns the frame without its findings.
    fn emit_delayed_findings_of(&mut self, half: WaitingFrame, transaction: &mut PendingTransaction) -> BufferedFrame {
        let place = FindingPlace {
            frame: Some(half.frame.number),
            txn: Some(transaction.txn),
            bus: half.bus,
            start: half.frame.start,
            recording_start: self.origin,
            unit: Some(transaction.unit),
            origin: half.packet,
        };
        for (finding, detail) in half.other_findings {
            if transaction.findings.contains(&finding) {
                transaction.imported_findings.push((finding, detail));
                continue;
            }
            self.stats.finding(finding);
            if self.wanted.findings {
                self.batch.findings.push(place.row(finding, detail));
            }
        }
        half.frame
    }

    /// Ends the import of a file. Transactions of which only frames were read were open when the file was written: each is
    /// emitted with its first frame only, as `unsolicited` if that is a response and else as `not_observed`. The findings
    /// that waited with its frames are dropped.
    pub(super) fn end_reimport(&mut self, reimport: &mut ReimportState) {
        while let Some((_, first)) = reimport.waiting.pop_first() {
            reimport.waiting.retain(|_, other| other.txn != first.txn);
            let mut transaction = Box::new(PendingTransaction {
                status: if first.direction == Direction::Response { Status::Unsolicited } else { Status::NotObserved },
                gap: first.gap,
                ..transaction_of(&first, first.txn)
            });
            let is_response = first.direction == Direction::Response;
            *(if is_response { &mut transaction.response } else { &mut transaction.request }) = first.frame;
            self.done.push(transaction);
            self.emit_transactions(first.bus);
        }
    }
}

/// Whether the row of this frame or transaction was unconfirmed.
fn is_unconfirmed(text: &str) -> bool {
    text.split(' ').any(|word| current(Vocabulary::Column, word) == "unconfirmed")
}

/// The confidence of this frame or transaction.
fn confidence_of(text: &str) -> u8 {
    number(text, "confidence").map_or(metadata::DEFAULTS.confidence, |bits| bits as u8)
}
