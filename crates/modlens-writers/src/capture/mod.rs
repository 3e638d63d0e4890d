//! Writes frames to a capture file (pcapng or classic pcap) that Wireshark opens without any configuration.
//!
//! `payload` encapsulates a frame, `ports` chooses its ports and identifier, `annotations` makes its annotations. Frames keep
//! their order. When a file is converted, a frame waits until its transaction is complete, so that findings on the
//! transaction become comments, and so that a filter on transactions keeps all of their frames.

mod annotations;
mod options;
mod packet;
mod payload;
mod pending_annotations;
mod ports;
mod tcp;

use std::collections::{BTreeMap, BTreeSet, HashSet, VecDeque};
use std::sync::Arc;

use annotations::FindingNote;
use payload::Route;
use pending_annotations::PendingAnnotations;
use ports::Ports;
use tcp::{Connections, Ends, Segment};

use modlens_engine::records::{Batch, Frame, Transaction};
use modlens_pcapng::blocks::{self, Interface, LINK_ETHERNET, LINK_UPPER_PDU};
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::Ns;
use modlens_readers::pcap::adu::unwrap;
use modlens_tables::columns::{Table, TableKind};

pub use options::{CaptureOptions, Encapsulation};

/// Writes a capture file, batch by batch.
#[derive(Debug)]
pub struct Capture {
    options: CaptureOptions,
    /// Whether the file header was written.
    has_header: bool,
    /// The table that the filter applies to; `None` without a filter.
    filtered: Option<TableKind>,
    /// Batches with frames to be written, and the index of the first such frame.
    waiting: VecDeque<(Arc<Batch>, usize)>,
    /// The findings of frames that are still to be written, by frame number.
    findings_by_frame: BTreeMap<u64, Vec<FindingNote>>,
    /// The numbers of the transactions or frames that the filter kept.
    kept: HashSet<u64>,
    /// All transactions up to this number are complete, and those in `complete_beyond` (from a live tap).
    complete_up_to: u64,
    complete_beyond: HashSet<u64>,
    /// Frames that the filter left out and that may become the context of the next frame it keeps.
    context_before: VecDeque<(Arc<Batch>, usize)>,
    /// The number of frames still to be written as context after a kept one.
    context_left: usize,
    /// Transactions whose annotation was not written yet.
    pending_annotations: PendingAnnotations,
    /// Transactions of a live tap whose last packet was written before they were complete.
    unannotated: BTreeSet<u64>,
    /// The name of the bus and the line of each interface.
    interfaces: Vec<(String, u8)>,
    /// Whether a block already states when the recording began.
    origin_written: bool,
    /// The bus, connection and line of the previous packet, and its interface.
    latest: Option<((u32, u64, u8), u32)>,
    ports: Ports,
    connections: Connections,
    /// The latest time that was written, in ns.
    newest: u64,
    /// The number of frames written, and of those left out because the style cannot represent them.
    pub written: u64,
    left_out: u64,
}

/// When this many numbers are stored, those that no waiting frame refers to are dropped.
const MAX_NUMBERS: usize = 100_000;

impl Capture {
    /// A capture file with these options.
    pub fn new(options: CaptureOptions) -> Self {
        Self {
            options,
            has_header: false,
            filtered: None,
            waiting: VecDeque::new(),
            findings_by_frame: BTreeMap::new(),
            kept: HashSet::new(),
            complete_up_to: 0,
            complete_beyond: HashSet::new(),
            context_before: VecDeque::new(),
            context_left: 0,
            pending_annotations: PendingAnnotations::default(),
            unannotated: BTreeSet::new(),
            interfaces: Vec::new(),
            origin_written: false,
            latest: None,
            ports: Ports::default(),
            connections: Connections::default(),
            newest: 0,
            written: 0,
            left_out: 0,
        }
    }

    /// Adds a batch. `kept` has its transactions or frames that a filter kept. Call `append_ready` to get what can be
    /// written.
    pub fn add_batch(&mut self, batch: &Arc<Batch>, kept: Option<&Table>) {
        if let Some(kept) = kept {
            self.filtered = Some(kept.kind);
            self.kept.extend((0..kept.len()).filter_map(|row| kept.number(row)));
        }
        for row in &batch.findings {
            if let Some(frame) = row.frame {
                self.findings_by_frame.entry(frame).or_default().push((row.finding, row.detail.clone()));
            }
        }
        for (at, row) in batch.all_transactions().iter().enumerate() {
            if !self.options.classic && self.options.style != Encapsulation::Tcp {
                self.pending_annotations.insert(row.number, batch, at);
            }
            if self.options.live && self.filtered.is_some() {
                self.complete_beyond.insert(row.number);
            } else {
                self.complete_up_to = self.complete_up_to.max(row.number);
            }
        }
        if !batch.frames.is_empty() {
            self.waiting.push_back((Arc::clone(batch), 0));
        }
    }

    /// Appends the packets that can be written now, until `out` holds `enough` bytes: a small buffer that is used again
    /// and again stays in the processor's cache. Appends nothing if nothing is left.
    pub fn append_ready(&mut self, enough: usize, out: &mut Vec<u8>) {
        self.append_header(out);
        self.write_waiting(false, enough, out);
    }

    /// Appends all remaining packets.
    pub fn finish(&mut self, out: &mut Vec<u8>) {
        self.append_header(out);
        self.write_waiting(true, usize::MAX, out);
        if self.left_out > 0 && !self.options.classic {
            let words = format!("{} frames are not in this file: damaged, noise, or of unknown direction", self.left_out);
            blocks::statistics(0, self.newest, &words, out);
        }
    }

    /// Appends the file header, once.
    fn append_header(&mut self, out: &mut Vec<u8>) {
        if std::mem::replace(&mut self.has_header, true) {
            return;
        }
        if self.options.classic {
            blocks::classic_head(self.link(), out);
        } else {
            blocks::section(&self.options.application, self.options.style.words().1, out);
        }
    }

    /// The link type of the packets.
    fn link(&self) -> u16 {
        if self.options.style == Encapsulation::Tcp {
            LINK_ETHERNET
        } else {
            LINK_UPPER_PDU
        }
    }

    /// Writes the waiting frames until one has to wait, or `enough` bytes were written. `all` is set at the end of the
    /// recording, when no frame waits any longer.
    fn write_waiting(&mut self, all: bool, enough: usize, out: &mut Vec<u8>) {
        while let Some((batch, first)) = self.waiting.pop_front() {
            for (at, frame) in batch.frames.iter().enumerate().skip(first) {
                let keep = if out.len() < enough { self.should_write(frame, all) } else { None };
                let Some(keep) = keep else {
                    self.waiting.push_front((batch, at));
                    self.drop_written();
                    return;
                };
                self.write_or_keep(&batch, at, keep, out);
            }
        }
        self.drop_written();
    }

    /// Whether a frame is to be written; `None` if that is not known before its transaction is complete.
    fn should_write(&self, frame: &Frame, all: bool) -> Option<bool> {
        let complete = all || frame.txn.is_none_or(|txn| txn <= self.complete_up_to || self.complete_beyond.contains(&txn));
        match self.filtered {
            None if self.options.live || complete => Some(true),
            Some(TableKind::Frames) if self.options.live || complete => Some(self.kept.contains(&frame.number)),
            Some(_) if complete => Some(frame.txn.is_some_and(|txn| self.kept.contains(&txn))),
            _ => None,
        }
    }

    /// Drops everything that belongs to frames already written.
    fn drop_written(&mut self) {
        if self.waiting.is_empty() {
            self.findings_by_frame.clear();
        }
        if self.filtered.is_some() {
            // A transaction whose frames the filter left out never gets a packet that could carry its annotation.
            let next = self.waiting.front().map_or(u64::MAX, |(batch, first)| batch.frames[*first].number);
            let next = self.context_before.front().map_or(next, |(batch, at)| batch.frames[*at].number);
            let unannotated = &self.unannotated;
            self.pending_annotations.retain(|batch, at| {
                let row = &batch.all_transactions()[at];
                last_frame(row) >= next || unannotated.contains(&row.number)
            });
        }
        if self.kept.len() + self.complete_beyond.len() < MAX_NUMBERS {
            return;
        }
        let waiting = self.waiting.iter().flat_map(|(batch, first)| &batch.frames[*first..]);
        let oldest = match self.filtered {
            Some(TableKind::Frames) => waiting.map(|frame| frame.number).min(),
            _ => waiting.filter_map(|frame| frame.txn).min(),
        };
        let oldest = oldest.unwrap_or(u64::MAX);
        self.kept.retain(|&number| number >= oldest);
        self.complete_beyond.retain(|&number| number >= oldest);
    }

    /// Writes a frame, or keeps it as possible context of the next one.
    fn write_or_keep(&mut self, batch: &Arc<Batch>, at: usize, keep: bool, out: &mut Vec<u8>) {
        if keep {
            for (batch, at) in std::mem::take(&mut self.context_before) {
                self.write(&batch, at, out);
            }
            self.context_left = self.options.context;
            self.write(batch, at, out);
        } else if self.context_left > 0 {
            self.context_left -= 1;
            self.write(batch, at, out);
        } else if self.options.context > 0 {
            self.context_before.push_back((Arc::clone(batch), at));
            if self.context_before.len() > self.options.context {
                self.context_before.pop_front();
            }
        }
    }

    /// Writes a frame as a packet.
    fn write(&mut self, batch: &Batch, at: usize, out: &mut Vec<u8>) {
        let frame = &batch.frames[at];
        let findings_by_frame = if self.findings_by_frame.is_empty() {
            Vec::new()
        } else {
            self.findings_by_frame.remove(&frame.number).unwrap_or_default()
        };
        let time = frame.start.map_or(self.newest, |ns| ns.max(0) as u64);
        self.newest = self.newest.max(time);
        let echo = frame.findings.of(&batch.codes).contains(&Finding::LocalEcho);
        let txn = frame.txn.unwrap_or(frame.number);
        let route = self.ports.route(frame.bus as usize, txn, frame.direction, echo || frame.txn.is_none());
        if self.options.style == Encapsulation::Tcp {
            self.write_tcp_frame(batch, frame, route, time, out);
            return;
        }
        self.written += 1;
        if self.options.classic {
            let start = blocks::begin_classic(time, out);
            packet::bytes(self.options.style, batch, frame, route, &findings_by_frame, out);
            blocks::end_classic(start, out);
            return;
        }
        let interface = self.interface(batch, frame, out);
        let start = blocks::begin_packet(interface, time, out);
        packet::bytes(self.options.style, batch, frame, route, &findings_by_frame, out);
        blocks::end_bytes(start, out);
        let origin = if self.origin_written { None } else { origin(frame) };
        self.origin_written |= origin.is_some();
        packet::annotations(self.options.style, batch, frame, &findings_by_frame, origin, out);
        self.append_annotations(frame, out);
        blocks::end_options(out);
        blocks::end_block(start, out);
    }

    /// Appends the annotations of all transactions that are complete with this frame.
    fn append_annotations(&mut self, frame: &Frame, out: &mut Vec<u8>) {
        if let Some(txn) = frame.txn {
            match self.pending_annotations.get(txn).map(|(batch, at)| &batch.all_transactions()[at]) {
                Some(row) if frame.number < last_frame(row) => {}
                Some(_) => {
                    self.write_annotation(txn, out);
                    self.unannotated.remove(&txn);
                }
                None => {
                    self.unannotated.insert(txn);
                }
            }
        }
        if !self.unannotated.is_empty() {
            let late: Vec<u64> =
                self.unannotated.iter().copied().filter(|&txn| self.pending_annotations.get(txn).is_some()).collect();
            for txn in late {
                self.unannotated.remove(&txn);
                self.write_annotation(txn, out);
            }
        }
    }

    /// Appends the annotation of a transaction.
    fn write_annotation(&mut self, txn: u64, out: &mut Vec<u8>) {
        if let Some((batch, at)) = self.pending_annotations.get(txn) {
            blocks::custom(out, |out| annotations::transaction(batch, &batch.all_transactions()[at], out));
        }
        self.pending_annotations.remove(txn);
    }

    /// Writes a frame in the style `tcp`. Frames that TCP could not carry are only counted.
    fn write_tcp_frame(&mut self, batch: &Batch, frame: &Frame, route: Route, time: u64, out: &mut Vec<u8>) {
        if !frame.verdict.is_good() || frame.direction == Direction::Unknown {
            self.left_out += 1;
            return;
        }
        let mut scratch = Vec::new();
        let (adu, _) = unwrap(frame.mode, frame.verdict, frame.wire.of(&batch.arena), &mut scratch);
        let to_server = frame.direction == Direction::Request;
        let port = if to_server { route.from } else { route.to };
        let network = batch.buses[frame.bus as usize].network.as_ref();
        let captured = network.and_then(|network| Ends::of(network, port));
        let ends = captured.unwrap_or_else(|| Ends::invented(frame.bus as u8, adu.first().copied().unwrap_or(0), port));
        let id = frame.mbap_id.filter(|_| captured.is_some()).unwrap_or(route.id);
        let segment = Segment { ends, to_server, id, adu };
        let mut connections = std::mem::take(&mut self.connections);
        let interface = if self.options.classic { 0 } else { self.interface(batch, frame, out) };
        let classic = self.options.classic;
        connections.packets(segment, |packet| {
            if classic {
                let start = blocks::begin_classic(time, out);
                out.extend_from_slice(packet);
                blocks::end_classic(start, out);
            } else {
                let start = blocks::begin_packet(interface, time, out);
                out.extend_from_slice(packet);
                blocks::end_bytes(start, out);
                blocks::end_block(start, out);
            }
        });
        self.connections = connections;
        self.written += 1;
    }

    /// The number of the interface for a frame's bus and line. Its block is written when it is first needed.
    ///
    /// All connections to a server share one interface.
    fn interface(&mut self, batch: &Batch, frame: &Frame, out: &mut Vec<u8>) -> u32 {
        let bus = &batch.buses[frame.bus as usize];
        // The numbers of buses are reused after their connection was closed.
        let key = (frame.bus, bus.network.as_ref().map_or(0, |network| network.connection), frame.line);
        if let Some((_, at)) = self.latest.filter(|(known, _)| *known == key) {
            return at;
        }
        let line = if bus.network.is_some() { 0 } else { frame.line };
        let known = self.interfaces.iter().position(|(name, of)| *of == line && *name == bus.name);
        let at = known.unwrap_or_else(|| {
            let origin = origin(frame);
            self.origin_written |= origin.is_some();
            let (name, description, custom) = annotations::interface(bus, line, origin, self.options.style.words().0);
            let what = Interface {
                link: self.link(),
                name: &name,
                description: &description,
                speed: bus.line.map(|line| u64::from(line.baud)),
                digits: 9,
                custom: &custom,
            };
            blocks::interface(&what, out);
            self.interfaces.push((bus.name.clone(), line));
            self.interfaces.len() - 1
        }) as u32;
        self.latest = Some((key, at));
        at
    }
}

/// The number of a transaction's last frame.
fn last_frame(row: &Transaction) -> u64 {
    row.request.frame.max(row.response.frame)
}

/// The time of the first frame of the recording, from which `elapsed` counts.
fn origin(frame: &Frame) -> Option<Ns> {
    Some(frame.start? - frame.elapsed?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use modlens_engine::session::{BusOptions, Session, WantedTables};
    use modlens_readers::chunk::{Chunk, Times};

    /// A tap may run for years: nothing of a transaction may stay once its packets are written.
    #[test]
    fn a_live_capture_keeps_no_transaction_that_is_written() {
        let should_write = WantedTables { frames: true, transactions: true, findings: true };
        let mut session = Session::new(Arc::default(), should_write, true, None);
        let bus = session.add_bus(BusOptions::named("bus"));
        let mut capture = Capture::new(CaptureOptions { live: true, ..CaptureOptions::default() });
        let mut out = Vec::new();
        let frames: [&[u8]; 2] = [&[1, 3, 0, 0, 0, 1, 0x84, 0x0A], &[1, 3, 2, 0, 7, 0xF9, 0x86]];
        for at in 0..40 {
            session.feed(bus, &Chunk { bytes: frames[at % 2], times: Times::Read(at as Ns * 200_000_000), ..Chunk::default() });
            capture.add_batch(&Arc::new(session.take()), None);
            capture.append_ready(usize::MAX, &mut out);
        }
        assert!(capture.written >= 38, "{}", capture.written);
        assert!(capture.unannotated.len() < 2, "{:?}", capture.unannotated);
    }
}
