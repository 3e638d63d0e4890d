//! Frames as a capture that Wireshark opens without any configuration: pcapng, or classic pcap.
//!
//! What each frame becomes is told in `payload`, which ports and identifiers it gets in `ports`, what is said of it in
//! `words`. Frames stay in their order. In a file a frame waits until its transaction is complete, so that what was found
//! on the pair becomes a comment, and so that a filter on transactions can keep all their frames.

pub mod blocks;
mod packet;
mod payload;
mod ports;
mod style;
mod tcp;
mod told;
mod words;

use std::collections::{BTreeMap, BTreeSet, HashSet, VecDeque};
use std::sync::Arc;

use blocks::{Interface, LINK_ETHERNET, LINK_UPPER_PDU};
use payload::Route;
use ports::Ports;
use tcp::{Connections, Segment};
use told::Told;
use words::Note;

use modlens_engine::records::{Batch, Frame, Transaction};
use modlens_protocol::direction::Direction;
use modlens_protocol::finding::Finding;
use modlens_protocol::Ns;
use modlens_readers::pcap::adu::unwrap;
use modlens_tables::columns::{Table, TableKind};

pub use style::{Options, Style};
pub use words::settings;

/// Writes a capture, batch by batch.
#[derive(Debug)]
pub struct Capture {
    options: Options,
    begun: bool,
    filtered: Option<TableKind>,
    waiting: VecDeque<(Arc<Batch>, usize)>,
    /// Findings of frames that are still to be written.
    notes: BTreeMap<u64, Vec<Note>>,
    /// Numbers of transactions or frames that the filter kept.
    kept: HashSet<u64>,
    /// Complete transactions: all up to this one, and further ones of a live tap.
    done_to: u64,
    done: HashSet<u64>,
    /// Frames that the filter left out, for the context of the next one.
    before: VecDeque<(Arc<Batch>, usize)>,
    behind: usize,
    /// Transactions whose words no packet has yet.
    told: Told,
    /// Transactions that have packets, but were not complete then: those of a live tap.
    untold: BTreeSet<u64>,
    /// Name and line of the bus of each.
    interfaces: Vec<(String, u8)>,
    /// Some block says when the recording began.
    origin_told: bool,
    /// Of the packet before: bus, connection, line, and the interface.
    latest: Option<((u32, u64, u8), u32)>,
    ports: Ports,
    connections: Connections,
    newest: u64,
    /// Frames written, and left out because the style has no place for them.
    pub written: u64,
    left_out: u64,
}

/// Numbers that are remembered before those that no frame can need any more are let go of.
const REMEMBERED: usize = 100_000;

impl Capture {
    /// A capture of these wishes.
    pub fn new(options: Options) -> Self {
        Self {
            options,
            begun: false,
            filtered: None,
            waiting: VecDeque::new(),
            notes: BTreeMap::new(),
            kept: HashSet::new(),
            done_to: 0,
            done: HashSet::new(),
            before: VecDeque::new(),
            behind: 0,
            told: Told::default(),
            untold: BTreeSet::new(),
            interfaces: Vec::new(),
            origin_told: false,
            latest: None,
            ports: Ports::default(),
            connections: Connections::default(),
            newest: 0,
            written: 0,
            left_out: 0,
        }
    }

    /// Takes a batch; `kept` are the rows of it that a filter kept: transactions or frames. `more` gives what is decided.
    pub fn put(&mut self, batch: &Arc<Batch>, kept: Option<&Table>) {
        if let Some(kept) = kept {
            self.filtered = Some(kept.kind);
            self.kept.extend((0..kept.len()).filter_map(|row| kept.number(row)));
        }
        for row in &batch.findings {
            if let Some(frame) = row.frame {
                self.notes.entry(frame).or_default().push((row.finding, row.detail.clone()));
            }
        }
        for (at, row) in batch.transactions.iter().enumerate() {
            if !self.options.classic && self.options.style != Style::Tcp {
                self.told.insert(row.number, batch, at);
            }
            if self.options.live && self.filtered.is_some() {
                self.done.insert(row.number);
            } else {
                self.done_to = self.done_to.max(row.number);
            }
        }
        if !batch.frames.is_empty() {
            self.waiting.push_back((Arc::clone(batch), 0));
        }
    }

    /// Appends what can be written now, until `out` holds so many bytes: memory that is used again and again stays in the
    /// processor's cache. Nothing is appended when there is nothing left.
    pub fn more(&mut self, enough: usize, out: &mut Vec<u8>) {
        self.head(out);
        self.drain(false, enough, out);
    }

    /// Appends the rest.
    pub fn end(&mut self, out: &mut Vec<u8>) {
        self.head(out);
        self.drain(true, usize::MAX, out);
        if self.left_out > 0 && !self.options.classic {
            let words = format!("{} frames are not in this file: damaged ones, noise, or of unknown direction", self.left_out);
            blocks::statistics(0, self.newest, &words, out);
        }
    }

    fn head(&mut self, out: &mut Vec<u8>) {
        if std::mem::replace(&mut self.begun, true) {
            return;
        }
        if self.options.classic {
            blocks::classic_head(self.link(), out);
        } else {
            blocks::section(&self.options.application, self.options.style.words().1, out);
        }
    }

    fn link(&self) -> u16 {
        if self.options.style == Style::Tcp {
            LINK_ETHERNET
        } else {
            LINK_UPPER_PDU
        }
    }

    fn drain(&mut self, all: bool, enough: usize, out: &mut Vec<u8>) {
        while let Some((batch, first)) = self.waiting.pop_front() {
            for (at, frame) in batch.frames.iter().enumerate().skip(first) {
                let keep = if out.len() < enough { self.wanted(frame, all) } else { None };
                let Some(keep) = keep else {
                    self.waiting.push_front((batch, at));
                    self.forget();
                    return;
                };
                self.frame(&batch, at, keep, out);
            }
        }
        self.forget();
    }

    /// Whether a frame is to be written; `None` while its transaction is not complete.
    fn wanted(&self, frame: &Frame, all: bool) -> Option<bool> {
        let complete = all || frame.txn.is_none_or(|txn| txn <= self.done_to || self.done.contains(&txn));
        match self.filtered {
            None if self.options.live || complete => Some(true),
            Some(TableKind::Frames) if self.options.live || complete => Some(self.kept.contains(&frame.number)),
            Some(_) if complete => Some(frame.txn.is_some_and(|txn| self.kept.contains(&txn))),
            _ => None,
        }
    }

    /// Lets go of numbers that belong to frames already written.
    fn forget(&mut self) {
        if self.waiting.is_empty() {
            self.notes.clear();
        }
        if self.filtered.is_some() {
            // Of frames that were left out.
            let next = self.waiting.front().map_or(u64::MAX, |(batch, first)| batch.frames[*first].number);
            let next = self.before.front().map_or(next, |(batch, at)| batch.frames[*at].number);
            let untold = &self.untold;
            self.told.retain(|batch, at| {
                let row = &batch.transactions[at];
                last_frame(row) >= next || untold.contains(&row.number)
            });
        }
        if self.kept.len() + self.done.len() < REMEMBERED {
            return;
        }
        let waiting = self.waiting.iter().flat_map(|(batch, first)| &batch.frames[*first..]);
        let oldest = match self.filtered {
            Some(TableKind::Frames) => waiting.map(|frame| frame.number).min(),
            _ => waiting.filter_map(|frame| frame.txn).min(),
        };
        let oldest = oldest.unwrap_or(u64::MAX);
        self.kept.retain(|&number| number >= oldest);
        self.done.retain(|&number| number >= oldest);
    }

    /// Writes a frame, or keeps it as the context of the next one.
    fn frame(&mut self, batch: &Arc<Batch>, at: usize, keep: bool, out: &mut Vec<u8>) {
        if keep {
            for (batch, at) in std::mem::take(&mut self.before) {
                self.write(&batch, at, out);
            }
            self.behind = self.options.context;
            self.write(batch, at, out);
        } else if self.behind > 0 {
            self.behind -= 1;
            self.write(batch, at, out);
        } else if self.options.context > 0 {
            self.before.push_back((Arc::clone(batch), at));
            if self.before.len() > self.options.context {
                self.before.pop_front();
            }
        }
    }

    fn write(&mut self, batch: &Batch, at: usize, out: &mut Vec<u8>) {
        let frame = &batch.frames[at];
        let notes = if self.notes.is_empty() { Vec::new() } else { self.notes.remove(&frame.number).unwrap_or_default() };
        let time = frame.start.map_or(self.newest, |ns| ns.max(0) as u64);
        self.newest = self.newest.max(time);
        let echo = frame.findings.of(&batch.codes).contains(&Finding::LocalEcho);
        let txn = frame.txn.unwrap_or(frame.number);
        let route = self.ports.route(frame.bus as usize, txn, frame.direction, echo || frame.txn.is_none());
        if self.options.style == Style::Tcp {
            self.synthetic(batch, frame, route, time, out);
            return;
        }
        self.written += 1;
        if self.options.classic {
            let start = blocks::begin_classic(time, out);
            packet::bytes(self.options.style, batch, frame, route, &notes, out);
            blocks::end_classic(start, out);
            return;
        }
        let interface = self.interface(batch, frame, out);
        let start = blocks::begin_packet(interface, time, out);
        packet::bytes(self.options.style, batch, frame, route, &notes, out);
        blocks::end_bytes(start, out);
        let origin = if self.origin_told { None } else { origin(frame) };
        self.origin_told |= origin.is_some();
        packet::remarks(self.options.style, batch, frame, &notes, origin, out);
        self.transactions(frame, out);
        blocks::end_options(out);
        blocks::end_block(start, out);
    }

    /// The words of the transactions that are complete with this frame.
    fn transactions(&mut self, frame: &Frame, out: &mut Vec<u8>) {
        if let Some(txn) = frame.txn {
            match self.told.get(txn).map(|(batch, at)| &batch.transactions[at]) {
                Some(row) if frame.number < last_frame(row) => {}
                Some(_) => {
                    self.tell(txn, out);
                    self.untold.remove(&txn);
                }
                None => {
                    self.untold.insert(txn);
                }
            }
        }
        if !self.untold.is_empty() {
            let late: Vec<u64> = self.untold.iter().copied().filter(|&txn| self.told.get(txn).is_some()).collect();
            for txn in late {
                self.untold.remove(&txn);
                self.tell(txn, out);
            }
        }
    }

    fn tell(&mut self, txn: u64, out: &mut Vec<u8>) {
        if let Some((batch, at)) = self.told.get(txn) {
            blocks::custom(out, |out| words::transaction(batch, &batch.transactions[at], out));
        }
        self.told.remove(txn);
    }

    /// The packets of the style `tcp`; frames that TCP could not carry are counted only.
    fn synthetic(&mut self, batch: &Batch, frame: &Frame, route: Route, time: u64, out: &mut Vec<u8>) {
        if !frame.verdict.good() || frame.direction == Direction::Unknown {
            self.left_out += 1;
            return;
        }
        let mut scratch = Vec::new();
        let (adu, _) = unwrap(frame.mode, frame.verdict, frame.wire.of(&batch.arena), &mut scratch);
        let segment = Segment { bus: frame.bus as u8, unit: adu.first().copied().unwrap_or(0), route, adu };
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

    /// The number of the interface of a frame's bus and line; its block is written when it is first needed.
    ///
    /// A connection is no interface of its own: those to one server share one.
    fn interface(&mut self, batch: &Batch, frame: &Frame, out: &mut Vec<u8>) -> u32 {
        let bus = &batch.buses[frame.bus as usize];
        // Numbers of buses are used again when their connection is over.
        let key = (frame.bus, bus.network.as_ref().map_or(0, |network| network.connection), frame.line);
        if let Some((_, at)) = self.latest.filter(|(known, _)| *known == key) {
            return at;
        }
        let line = if bus.network.is_some() { 0 } else { frame.line };
        let known = self.interfaces.iter().position(|(name, of)| *of == line && *name == bus.name);
        let at = known.unwrap_or_else(|| {
            let origin = origin(frame);
            self.origin_told |= origin.is_some();
            let (name, description, custom) = words::interface(bus, line, origin, self.options.style.words().0);
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

/// The last frame of a transaction.
fn last_frame(row: &Transaction) -> u64 {
    row.request.frame.max(row.response.frame)
}

/// The first moment of the recording.
fn origin(frame: &Frame) -> Option<Ns> {
    Some(frame.start? - frame.elapsed?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use modlens_engine::session::{BusOptions, Session, Wanted};
    use modlens_readers::chunk::{Chunk, Times};

    /// A tap may go on for years: of a transaction that has its packets, nothing stays.
    #[test]
    fn a_live_capture_remembers_no_transaction_that_is_told() {
        let wanted = Wanted { frames: true, transactions: true, findings: true };
        let mut session = Session::new(Arc::default(), wanted, true, None);
        let bus = session.add_bus(BusOptions::named("bus"));
        let mut capture = Capture::new(Options { live: true, ..Options::default() });
        let mut out = Vec::new();
        let frames: [&[u8]; 2] = [&[1, 3, 0, 0, 0, 1, 0x84, 0x0A], &[1, 3, 2, 0, 7, 0xF9, 0x86]];
        for at in 0..40 {
            session.feed(bus, &Chunk { bytes: frames[at % 2], times: Times::Read(at as Ns * 200_000_000), ..Chunk::default() });
            capture.put(&Arc::new(session.take()), None);
            capture.more(usize::MAX, &mut out);
        }
        assert!(capture.written >= 38, "{}", capture.written);
        assert!(capture.untold.len() < 2, "{:?}", capture.untold);
    }
}
