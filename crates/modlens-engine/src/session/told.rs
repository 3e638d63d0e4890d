//! Rows that are read back from a capture that modlens has written: as they were, not decided anew.
//!
//! The file holds what its writer knew: the bytes around a cut, the reads behind a pause and the requests before an answer
//! may not be in it. Bytes are decoded again; what they are worth, who sent them and what answers what is told.

use std::collections::BTreeMap;

use crate::pairing::{Exchange, Kept, Seen};
use crate::records::{Bus, FindingRow, Frame, Network};
use crate::session::rows::elapsed;
use crate::session::{BusOptions, CaptureOptions, Session};
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::EXCEPTION_BIT;
use modlens_protocol::source::Place;
use modlens_protocol::status::Status;
use modlens_protocol::Ns;
use modlens_readers::pcap::adu::unwrap;
use modlens_readers::pcap::own::{self, micros, named, number, unhex, value, PacketMetadata};
use modlens_readers::pcap::Interface;

/// Frames that wait for the words on their transaction; in a file that was cut some wait for ever.
const MOST_WAITING: usize = 4_096;

/// What is read back of a capture.
#[derive(Debug, Default)]
pub(super) struct Retold {
    /// Numbers that were given before this file.
    frames_before: u64,
    txns_before: u64,
    /// The bus of each name, connection and whether it is one.
    buses: Vec<((String, Option<u64>), usize)>,
    /// Frames of transactions that are not told yet.
    waiting: BTreeMap<u64, Waiting>,
}

#[derive(Debug)]
struct Waiting {
    bus: usize,
    txn: u64,
    mode: Mode,
    adu: Vec<u8>,
    kept: Kept,
    direction: Direction,
    /// What was found, but not on the frame itself.
    notes: Vec<(Finding, String)>,
    gap: Option<Ns>,
    packet: u64,
}

impl Retold {
    pub(super) fn new(frames_before: u64, txns_before: u64) -> Self {
        Self { frames_before, txns_before, ..Self::default() }
    }

    /// The smallest number of a transaction that is not told yet.
    pub(super) fn oldest(&self) -> Option<u64> {
        self.waiting.values().map(|waiting| waiting.txn).min()
    }
}

fn findings(words: &str) -> Vec<Finding> {
    value(words, "findings").map_or(Vec::new(), |list| list.split(',').filter_map(Finding::from_code).collect())
}

/// A comment that is a finding: `severity code: title: detail`, as `write::capture::words::comment` has it.
fn finding(comment: &str) -> Option<(Finding, String)> {
    let (head, rest) = comment.split_once(": ")?;
    let (severity, code) = head.split_once(' ')?;
    let finding = Finding::from_code(code).filter(|finding| finding.doc().severity.text() == severity)?;
    let detail = rest.strip_prefix(finding.doc().title)?;
    Some((finding, detail.strip_prefix(": ").unwrap_or(detail).to_owned()))
}

impl Session {
    /// A packet with our words: a frame, and the transactions that are complete with it.
    pub(super) fn retell(
        &mut self,
        retold: &mut Retold,
        options: &CaptureOptions,
        by: &Interface,
        told: &PacketMetadata<'_>,
        packet: u64,
        time: Option<Ns>,
    ) {
        let Some(port) = &by.own else { return };
        let later = || value(told.frame, "origin_ns").and_then(|text| text.parse().ok());
        if let Some(origin) = port.origin.or_else(later) {
            self.origin.get_or_insert(origin);
        }
        let bus = self.retold_bus(retold, options, by, told.frame);
        let frame = self.retold_frame(retold, (bus, port.line), told, packet, time);
        let mut codes = findings(told.frame);
        let mut notes = Vec::new();
        for (finding, detail) in told.comments.iter().filter_map(|comment| finding(comment)) {
            if let Some(at) = codes.iter().position(|code| *code == finding) {
                codes.remove(at);
                self.retold_finding(&frame, (finding, detail));
            } else {
                notes.push((finding, detail));
            }
        }
        self.keep_waiting(retold, &frame, told, notes);
        if self.wanted.frames {
            self.batch.frames.push(frame);
        }
        for words in &told.transactions {
            self.retold_transaction(retold, words);
        }
    }

    fn retold_bus(&mut self, retold: &mut Retold, options: &CaptureOptions, by: &Interface, words: &str) -> usize {
        let Some(port) = &by.own else { return 0 };
        let connection = number(words, "connection");
        if let Some((_, bus)) = retold.buses.iter().rev().find(|((name, of), _)| *of == connection && *name == port.name) {
            return *bus;
        }
        let network = connection.map(|connection| Network {
            client: value(words, "client").unwrap_or_default().to_owned(),
            server: port.name.clone(),
            connection,
        });
        let name = port.name.clone();
        let row =
            Bus { name, source: options.source.clone(), place: Place::Packet, clock: port.clock, line: port.settings, network };
        let bus = self.add_bus(BusOptions { bus: row, mode: None, line: port.settings, resolution: None, rule: None });
        retold.buses.push(((port.name.clone(), connection), bus));
        bus
    }

    fn retold_frame(
        &mut self,
        retold: &Retold,
        (bus, line_number): (usize, u8),
        told: &PacketMetadata<'_>,
        packet: u64,
        time: Option<Ns>,
    ) -> Frame {
        let (text, words) = (told.frame, &told.fields);
        let mut scratch = Vec::new();
        let adu = if words.verdict.good() { unwrap(words.mode, words.verdict, &told.bytes, &mut scratch).0 } else { &[][..] };
        let said = |key: &str| number(text, key).map(|value| value as u8);
        let (unit, code) =
            if words.verdict.good() { (adu.first().copied(), adu.get(1).copied()) } else { (said("unit"), said("code")) };
        let exception = code.filter(|code| code & EXCEPTION_BIT != 0 && words.verdict.good()).and_then(|_| adu.get(2).copied());
        let start = time.filter(|_| !text.split(' ').any(|word| word == "no_time"));
        let number = retold.frames_before + words.number;
        self.next_frame = self.next_frame.max(number + 1);
        let line = self.bus_rows[bus].line;
        let sides = || [1, 2][usize::from(words.direction == Direction::Response)];
        let line_of = if self.bus_rows[bus].network.is_some() { sides() } else { line_number };
        let length = told.bytes.len() as Ns;
        let seen = Seen {
            frame: number,
            wire: &told.bytes,
            adu,
            verdict: words.verdict,
            direction: words.direction,
            mode: words.mode,
            start,
            end: start.map(|start| start + length * line.map_or(0, |line| line.char_ns())),
            clean_start: true,
            gap: micros(text, "gap_us"),
            mbap_id: own::number(text, "mbap_id").map(|id| id as u16),
            origin: packet,
            tentative: text.split(' ').any(|word| word == "tentative"),
            codes: &[],
        };
        self.stats.frame(self.buses[bus].counts, words.mode, &seen);
        Frame {
            number,
            bus: bus as u32,
            line: line_of,
            offset: own::number(text, "offset").unwrap_or(0),
            wire: self.batch.keep(&told.bytes),
            start,
            elapsed: elapsed(self.origin, start),
            gap: seen.gap,
            mode: words.mode,
            direction: words.direction,
            unit,
            code,
            exception,
            verdict: words.verdict,
            tentative: seen.tentative,
            confidence: said("confidence").unwrap_or(own::DEFAULTS.confidence),
            cut_by: words.cut_by,
            txn: own::number(text, "txn").map(|txn| retold.txns_before + txn),
            mbap_id: seen.mbap_id,
            findings: self.batch.keep_codes(&findings(text)),
            origin: packet,
            last_origin: packet,
        }
    }

    fn retold_finding(&mut self, frame: &Frame, (finding, detail): (Finding, String)) {
        self.stats.finding(finding);
        if self.wanted.findings {
            self.batch.findings.push(FindingRow {
                frame: Some(frame.number),
                txn: frame.txn,
                bus: frame.bus,
                start: frame.start,
                elapsed: frame.elapsed,
                unit: frame.unit,
                finding,
                detail,
                origin: frame.origin,
            });
        }
    }

    /// Keeps a frame until its transaction is told.
    fn keep_waiting(&mut self, retold: &mut Retold, frame: &Frame, told: &PacketMetadata<'_>, notes: Vec<(Finding, String)>) {
        let words = &told.fields;
        let Some(txn) = frame.txn else {
            for note in notes {
                self.retold_finding(frame, note);
            }
            return;
        };
        self.next_txn = self.next_txn.max(txn + 1);
        let mut scratch = Vec::new();
        let adu = if words.verdict.good() {
            unwrap(words.mode, words.verdict, &told.bytes, &mut scratch).0.to_vec()
        } else {
            frame.unit.into_iter().chain(frame.code).collect()
        };
        let kept = Kept::new(frame.number, &told.bytes, adu.get(1..).unwrap_or(&[]), frame.start);
        let (bus, gap, packet) = (frame.bus as usize, frame.gap, frame.origin);
        let waiting = Waiting { bus, txn, mode: words.mode, adu, kept, direction: words.direction, notes, gap, packet };
        retold.waiting.insert(frame.number, waiting);
        if retold.waiting.len() > MOST_WAITING {
            retold.waiting.pop_first();
        }
    }

    /// A transaction, of the frames that it names as far as they are in the file.
    fn retold_transaction(&mut self, retold: &mut Retold, words: &str) {
        let txn = retold.txns_before + number(words, "transaction").unwrap_or(0);
        let mut half = |key: &str| {
            let found = retold.waiting.remove(&(retold.frames_before + number(words, key)?))?;
            Some(match value(words, &format!("{key}_pdu")).and_then(unhex) {
                Some(pdu) => Waiting { kept: found.kept.clone().with_pdu(&pdu), ..found },
                None => found,
            })
        };
        let (request, response) = (half("request"), half("response"));
        let Some(first) = request.as_ref().or(response.as_ref()) else { return };
        let status = own::value_or_default(words, "status", own::DEFAULTS.status, |name| named(&Status::ALL, Status::text, name));
        let Some(status) = status else { return };
        let other = |key: &str| number(words, key).map(|txn| retold.txns_before + txn);
        let mut exchange = Box::new(Exchange {
            txn,
            unit: first.adu.first().copied().unwrap_or(0),
            function: first.adu.get(1).map_or(0, |code| code & !EXCEPTION_BIT),
            status,
            exception: number(words, "exception").map(|code| code as u8),
            response_time: micros(words, "response_us"),
            waited: micros(words, "waited_us"),
            late_response: micros(words, "late_us"),
            retry_of: other("retry_of"),
            late_for: other("late_for"),
            gap: micros(words, "gap_us"),
            mbap_id: number(words, "mbap_id").map(|id| id as u16),
            findings: findings(words),
            origin: first.packet,
            retold: true,
            ..Exchange::new(first.mode)
        });
        let bus = first.bus;
        for (half, kept) in [(request, true), (response, false)] {
            let Some(half) = half else { continue };
            let (pair, later): (Vec<_>, Vec<_>) = half.notes.into_iter().partition(|(code, _)| exchange.findings.contains(code));
            exchange.told.extend(pair);
            for (finding, detail) in later {
                self.retold_note(bus, &half.kept, (txn, exchange.unit, half.packet), finding, detail);
            }
            *(if kept { &mut exchange.request } else { &mut exchange.response }) = half.kept;
        }
        self.done.push(exchange);
        self.write_done(bus);
        retold.waiting.retain(|_, waiting| waiting.txn != txn);
    }

    /// What showed later of a frame.
    fn retold_note(&mut self, bus: usize, kept: &Kept, of: (u64, u8, u64), finding: Finding, detail: String) {
        self.stats.finding(finding);
        if self.wanted.findings {
            let (txn, unit, origin) = of;
            self.batch.findings.push(FindingRow {
                frame: Some(kept.frame),
                txn: Some(txn),
                bus: bus as u32,
                start: kept.start,
                elapsed: elapsed(self.origin, kept.start),
                unit: Some(unit),
                finding,
                detail,
                origin,
            });
        }
    }

    /// The file is over: transactions that nobody told the end of were open when it was written.
    pub(super) fn end_retold(&mut self, retold: &mut Retold) {
        while let Some((_, first)) = retold.waiting.pop_first() {
            retold.waiting.retain(|_, other| other.txn != first.txn);
            let mut exchange = Box::new(Exchange {
                txn: first.txn,
                unit: first.adu.first().copied().unwrap_or(0),
                function: first.adu.get(1).map_or(0, |code| code & !EXCEPTION_BIT),
                status: if first.direction == Direction::Response { Status::Unrequested } else { Status::NotSeen },
                gap: first.gap,
                origin: first.packet,
                retold: true,
                ..Exchange::new(first.mode)
            });
            *(if first.direction == Direction::Response { &mut exchange.response } else { &mut exchange.request }) = first.kept;
            self.done.push(exchange);
            self.write_done(first.bus);
        }
    }
}
