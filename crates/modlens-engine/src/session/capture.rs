//! Captures in a session: a connection becomes a bus of two lines, a serial interface a bus of one.

use std::collections::HashSet;
use std::sync::Arc;

use crate::framer::silence::Rule;
use crate::pairing::Pairing;
use crate::records::{Bus, FindingRow, Network};
use crate::session::bus::BusState;
use crate::session::told::Retold;
use crate::session::{BusOptions, Session};
use modlens_protocol::finding::Finding;
use modlens_protocol::framing::Mode;
use modlens_protocol::line::Line;
use modlens_protocol::source::{Clock, Place};
use modlens_protocol::Ns;
use modlens_readers::chunk::{Chunk, Side, Times};
use modlens_readers::pcap::own::{PortMetadata, RecordingSegment};
use modlens_readers::pcap::{Capture, Content, Endpoint, Event, Interface, Piece, Ports};

/// Times below this are not of our days: the clock started with the recording.
const FIRST_DAY: Ns = 100_000_000 * 1_000_000_000;

/// The lines of a connection's bus.
pub(super) const FROM_CLIENT: u8 = 1;
pub(super) const FROM_SERVER: u8 = 2;

/// What a capture is told about itself.
#[derive(Clone, Debug)]
pub struct CaptureOptions {
    /// The file, as `source` names it.
    pub source: String,
    /// Where Modbus is looked for.
    pub ports: Ports,
    /// Framing of serial interfaces; found out where `None`.
    pub mode: Option<Mode>,
    /// Line settings of serial interfaces.
    pub line: Option<Line>,
    /// See `BusOptions`.
    pub rule: Option<Rule>,
}

pub(super) struct CaptureState {
    options: CaptureOptions,
    reader: Capture,
    /// The bus of each slot.
    slots: Vec<Option<usize>>,
    /// The bus of each serial interface.
    lines: Vec<Option<usize>>,
    /// Rows that are read back.
    retold: Retold,
    clock: Clock,
    resolution: Ns,
}

impl CaptureState {
    /// The smallest number of a transaction that is read back and not complete.
    pub(super) fn oldest(&self) -> Option<u64> {
        self.retold.oldest()
    }
}

impl Session {
    /// Adds a capture; they are numbered from 0. Its buses are made as they show.
    pub fn add_capture(&mut self, options: CaptureOptions) -> usize {
        self.captures.push(Some(CaptureState {
            reader: Capture::new(options.ports.clone()),
            options,
            slots: Vec::new(),
            lines: Vec::new(),
            retold: Retold::new(self.next_frame - 1, self.next_txn - 1),
            clock: Clock::None,
            resolution: 0,
        }));
        self.captures.len() - 1
    }

    /// A block of a capture, cut anywhere; `last` ends it.
    pub fn feed_capture(&mut self, capture: usize, block: &[u8], last: bool) {
        let Some(mut state) = self.captures[capture].take() else { return };
        let mut reader = std::mem::take(&mut state.reader);
        let functions = Arc::clone(&self.functions);
        reader.push(&functions, block, &mut |event| self.event(&mut state, event));
        if last {
            reader.finish(&functions, &mut |event| self.event(&mut state, event));
            self.end_retold(&mut state.retold);
        }
        self.decide_waiting();
        state.reader = reader;
        self.captures[capture] = Some(state);
    }

    /// What a capture has shown: packets, what was left out, the clock and its resolution, the framings.
    pub fn capture(&self, capture: usize) -> Option<CaptureReport> {
        let state = self.captures.get(capture)?.as_ref()?;
        Some(CaptureReport {
            packets: state.reader.packets(),
            left_out: state.reader.left_out(),
            clock: state.clock,
            resolution: state.resolution,
        })
    }

    fn event(&mut self, state: &mut CaptureState, event: Event<'_>) {
        if !matches!(event, Event::Time(..) | Event::Bytes { .. }) {
            self.decide_waiting();
        }
        match event {
            Event::Time(time, by) => {
                if state.clock == Clock::None {
                    let guess = if time < FIRST_DAY { Clock::Relative } else { Clock::Utc };
                    state.clock = by.own.as_ref().map_or(guess, |port| port.clock);
                }
                state.resolution = state.resolution.max(by.resolution);
                if by.own.is_none() {
                    self.origin.get_or_insert(time);
                }
            }
            Event::Opened { slot, client, server, mode } => self.opened(state, slot, client, server, mode),
            Event::Bytes { slot, from_client, piece, record, heard } => {
                if let Some(&Some(bus)) = state.slots.get(slot) {
                    if self.buses[bus].pairing.heard != heard || piece.missing > 0 {
                        self.decide_waiting();
                    }
                    self.buses[bus].pairing.heard = heard;
                    self.piece(bus, from_client, &piece, record);
                }
            }
            Event::Found { slot, finding, detail, packet, time } => {
                if let Some(&Some(bus)) = state.slots.get(slot) {
                    self.found(bus, finding, detail, packet, time);
                }
            }
            Event::Closed { slot } => {
                if let Some(bus) = state.slots.get_mut(slot).and_then(Option::take) {
                    self.flush_bus(bus);
                    self.retired.push(bus);
                }
            }
            Event::Line { interface, by, content, errors, packet, time } => {
                let bus = self.serial_bus(state, interface, by);
                let line = by.own.as_ref().map_or(0, |port| port.line);
                // A tap receives everything: that says nothing of who has sent it.
                let side = content.side.filter(|_| by.own.is_none());
                self.content(bus, line, &Content { side, ..content }, &errors, packet, time);
            }
            Event::Reimported { by, metadata, packet, time, .. } => {
                self.retell(&mut state.retold, &state.options, by, &metadata, packet, time)
            }
        }
    }

    fn opened(&mut self, state: &mut CaptureState, slot: usize, client: Endpoint, server: Endpoint, mode: Mode) {
        self.connections += 1;
        let server = server.to_string();
        let network = Network { client: client.address.to_string(), server: server.clone(), connection: self.connections };
        let bus = Bus {
            name: server,
            source: state.options.source.clone(),
            place: Place::Packet,
            clock: state.clock,
            line: None,
            network: Some(network),
        };
        let options = BusOptions { bus, mode: Some(mode), line: None, resolution: Some(state.resolution.max(1)), rule: None };
        let counts = self.stats.bus_named(&options.bus.name);
        let pairing = Pairing::new(self.timeout, self.live);
        let profiles = self.profiles_of(&options.bus.name);
        let rows = Arc::make_mut(&mut self.bus_rows);
        let bus = if let Some(bus) = self.free.pop() {
            rows[bus] = options.bus.clone();
            self.buses[bus] = BusState::new(options, pairing, counts, profiles);
            bus
        } else {
            rows.push(options.bus.clone());
            self.buses.push(BusState::new(options, pairing, counts, profiles));
            self.buses.len() - 1
        };
        if state.slots.len() <= slot {
            state.slots.resize(slot + 1, None);
        }
        state.slots[slot] = Some(bus);
    }

    fn piece(&mut self, bus: usize, from_client: bool, piece: &Piece<'_>, record: bool) {
        if piece.missing > 0 {
            self.buses[bus].pairing.lost();
            let detail = format!("{} bytes are missing before packet {}", piece.missing, piece.packet);
            self.found(bus, Finding::MissingSegment, detail, piece.packet, piece.time);
        }
        let chunk = Chunk {
            bytes: piece.bytes,
            line: if from_client { FROM_CLIENT } else { FROM_SERVER },
            times: piece.time.map_or(Times::None, Times::Read),
            side: Some(if from_client { Side::Sent } else { Side::Received }),
            record,
            hole: piece.missing > 0,
            origin: piece.packet,
            ..Chunk::default()
        };
        self.feed_later(bus, &chunk);
    }

    fn content(&mut self, bus: usize, line: u8, content: &Content<'_>, errors: &[u32], packet: u64, time: Option<Ns>) {
        let chunk = Chunk {
            bytes: content.bytes,
            line,
            times: time.map_or(Times::None, Times::Read),
            side: content.side,
            record: content.record,
            hole: content.hole,
            // Which ones is more than that there are some.
            line_error: content.line_error && errors.is_empty(),
            errors,
            no_checksum: content.no_checksum,
            origin: packet,
            ..Chunk::default()
        };
        self.feed(bus, &chunk);
    }

    fn serial_bus(&mut self, state: &mut CaptureState, interface: usize, by: &Interface) -> usize {
        if state.lines.len() <= interface {
            state.lines.resize(interface + 1, None);
        }
        if let Some(bus) = state.lines[interface] {
            return bus;
        }
        let bus = if let Some(port @ PortMetadata { recording: Some(segment), .. }) = &by.own {
            self.recorded_bus(state, port, segment)
        } else {
            let name = by.name.clone().unwrap_or_else(|| state.options.source.clone());
            let source = state.options.source.clone();
            self.add_serial(state, name, (source, Place::Packet), state.options.line)
        };
        state.lines[interface] = Some(bus);
        bus
    }

    fn add_serial(&mut self, state: &CaptureState, name: String, (source, place): (String, Place), line: Option<Line>) -> usize {
        let bus = Bus { name, source, place, clock: state.clock, line, network: None };
        self.add_bus(BusOptions { bus, mode: state.options.mode, line, resolution: None, rule: state.options.rule })
    }

    /// The bus of a port of a raw recording: the lines of a bus are one, and the files of a recording go on.
    fn recorded_bus(&mut self, state: &CaptureState, port: &PortMetadata, segment: &RecordingSegment) -> usize {
        let line = state.options.line.or(port.settings);
        let known = self.recorded.iter_mut().find(|(of, _)| of.session == segment.session && of.bus == segment.bus);
        if let Some((of, bus)) = known {
            let (bus, missing) = (*bus, segment.number > of.number + 1);
            of.number = segment.number;
            if missing {
                self.flush_bus(bus);
            }
            return bus;
        }
        // Played again, the rows are those of the tap, which knew ports only.
        let from = if self.live { (port.name.clone(), Place::Offset) } else { (state.options.source.clone(), Place::Packet) };
        let bus = self.add_serial(state, port.name.clone(), from, line);
        self.recorded.push((segment.clone(), bus));
        bus
    }

    /// A finding on a connection, not on a frame.
    fn found(&mut self, bus: usize, finding: Finding, detail: String, packet: u64, time: Option<Ns>) {
        self.stats.finding(finding);
        if self.wanted.findings {
            let elapsed = super::rows::elapsed(self.origin, time);
            let row = FindingRow {
                frame: None,
                txn: None,
                bus: bus as u32,
                start: time,
                elapsed,
                unit: None,
                finding,
                detail,
                origin: packet,
            };
            self.batch.findings.push(row);
        }
    }

    /// Lets go of the buses of closed connections that no held row names.
    pub(super) fn release(&mut self) {
        if self.retired.is_empty() {
            return;
        }
        let named: HashSet<usize> = self.held.iter().map(|row| row.bus as usize).collect();
        let free = &mut self.free;
        self.retired.retain(|bus| {
            let busy = named.contains(bus);
            if !busy {
                free.push(*bus);
            }
            busy
        });
    }
}

/// What a capture has shown.
#[derive(Clone, Debug)]
pub struct CaptureReport {
    /// Packets so far.
    pub packets: u64,
    /// What was left out, by reason.
    pub left_out: Vec<(String, u64)>,
    /// Its clock.
    pub clock: Clock,
    /// What that can tell apart.
    pub resolution: Ns,
}
