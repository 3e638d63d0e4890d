//! Packet captures: each TCP connection becomes a bus of two lines, each serial interface a bus of one.

use std::collections::HashSet;
use std::sync::Arc;

use crate::findings;
use crate::pairing::Pairing;
use crate::records::{Bus, Connection, Network};
use crate::session::bus::BusState;
use crate::session::connection_tally::ConnectionTally;
use crate::session::connections::{self, Beside};
use crate::session::profiles::Profiles;
use crate::session::sources::{CaptureOptions, CaptureReport, CaptureState, ReimportState, SlotState};
use crate::session::{BusOptions, Session};
use modlens_protocol::framing::Mode;
use modlens_protocol::line::LineSettings;
use modlens_protocol::source::{Clock, Place};
use modlens_protocol::Ns;
use modlens_readers::chunk::{Chunk, Times};
use modlens_readers::pcap::metadata::{PortMetadata, RecordingSegment};
use modlens_readers::pcap::{Capture, EndedConnection, Endpoint, Event, Interface, SerialContent};

/// Requests of quiet connections are given up at most so much later than their waiting time says.
pub(super) const SWEEP_NS: Ns = 1_000_000_000;

impl Session {
    /// Adds a capture; they are numbered from 0. Its buses are added when their first packet is read.
    pub fn add_capture(&mut self, options: CaptureOptions) -> usize {
        self.captures.push(Some(CaptureState {
            reader: Capture::new(options.ports.clone()),
            source: options.source.as_str().into(),
            options,
            slots: Vec::new(),
            lines: Vec::new(),
            ended_lines: 0,
            resumable: Vec::new(),
            reimport: ReimportState::new(self.decoder.next_frame - 1, self.decoder.next_txn - 1),
            clock: Clock::None,
            resolution: 0,
            last_sweep: None,
        }));
        self.captures.len() - 1
    }

    /// Takes a block of a capture, cut anywhere; `last` ends the capture: what its reader and the import of our own files
    /// still hold is handed over. Its buses are not flushed; `flush` does that. No bytes are left for the fast path to decide
    /// later.
    pub fn feed_capture(&mut self, capture: usize, block: &[u8], last: bool) {
        let Some(mut state) = self.captures[capture].take() else { return };
        let mut reader = std::mem::take(&mut state.reader);
        let functions = Arc::clone(&self.decoder.functions);
        reader.push(&functions, block, &mut |event| self.handle_event(&mut state, event));
        if last {
            reader.finish(&functions, &mut |event| self.handle_event(&mut state, event));
            self.decoder.end_reimport(&mut state.reimport);
        }
        self.decoder.decide_waiting();
        state.reader = reader;
        self.captures[capture] = Some(state);
    }

    /// Whether this is the number of a capture that was added and is not closed.
    pub fn has_capture(&self, capture: usize) -> bool {
        matches!(self.captures.get(capture), Some(Some(_)))
    }

    /// What a capture has shown so far: packets, those that were skipped, the clock and its resolution.
    pub fn capture(&self, capture: usize) -> Option<CaptureReport> {
        let state = self.captures.get(capture)?.as_ref()?;
        Some(CaptureReport {
            packets: state.reader.packets(),
            left_out: state.reader.left_out(),
            clock: state.clock,
            resolution: state.resolution,
        })
    }

    /// Handles one event of the capture's reader. `state` is that of the capture; `slot` is the place of a connection in the
    /// reader's table, which the next connection may take once it is closed. Events of a slot without bus are ignored.
    ///
    /// Further bytes of the same connection may be decided together with those before them (`feed_later`). Any other event
    /// would change how these are decided, so they are decided first; so would bytes after a gap, or where the server's side
    /// begins or ceases to be recorded. A time says nothing about them and only teaches the clock.
    ///
    /// The end of a connection flushes its bus, which a later connection takes once no row names it any more. That one side
    /// ends it comes before: after all bytes of that side, and while requests are still open.
    pub(super) fn handle_event(&mut self, state: &mut CaptureState, event: Event<'_>) {
        match event {
            Event::Time(time, interface) => {
                state.note_time(time, interface, &mut self.decoder.origin);
                self.sweep_connections(state, time);
            }
            Event::InTurn(packets, interface) => self.take_in_turn(state, packets, interface),
            Event::Bytes { slot, from_client, chunk, is_whole_message, server_side_recorded } => {
                if let Some(bus) = state.slot(slot).bus {
                    self.decoder.note_recorded_side(bus, server_side_recorded);
                    self.decoder.take_packet(bus, from_client, &chunk, is_whole_message);
                }
            }
            other => self.handle_rare_event(state, other),
        }
    }

    /// Handles an event that is neither a time nor bytes of a connection.
    #[cold]
    fn handle_rare_event(&mut self, state: &mut CaptureState, event: Event<'_>) {
        self.decoder.decide_waiting();
        match event {
            Event::Begun { slot } => state.slot(slot).connection = Some(self.connections.begin()),
            Event::Opened { slot, client, server, mode } => self.add_connection(state, slot, client, server, mode),
            Event::Repetition { slot, kind, packet, time } => {
                if let Some(bus) = state.slot(slot).bus {
                    self.decoder.emit_connection_finding(bus, findings::connection::repetition(kind, packet), packet, time);
                }
            }
            Event::Conflict { slot, conflict, packet, time } => {
                if let Some(bus) = state.slot(slot).bus {
                    self.decoder.emit_connection_finding(bus, findings::connection::conflict(conflict, packet), packet, time);
                }
            }
            Event::Time(..) | Event::InTurn(..) | Event::Bytes { .. } | Event::Closing { .. } => {}
            Event::Closed { slot, connection } => self.close_connection(state, slot, connection.as_ref()),
            Event::Line { interface: index, section, by: interface, content, errors, packet, time } => {
                self.end_lines_before(state, section);
                let bus = self.serial_bus(state, (index, section), interface);
                self.feed_serial(bus, interface, content, &errors, packet, time);
            }
            Event::Reimported { by: interface, metadata, packet, time, .. } => {
                self.decoder.reimport_packet(&mut state.reimport, &state.options, interface, &metadata, packet, time);
            }
        }
    }

    /// Ends the connection in a slot: its bus is flushed, and becomes free once no row names it any more; its row is complete.
    pub(super) fn close_connection(&mut self, state: &mut CaptureState, slot: usize, ended: Option<&EndedConnection<'_>>) {
        let SlotState { connection, bus } = std::mem::take(state.slot(slot));
        let mut tally = ConnectionTally::default();
        if let Some(bus) = bus {
            self.decoder.buses[bus].pairing.connection_end = ended.and_then(connections::connection_end);
            self.decoder.flush_bus(bus);
            self.retired.push(bus);
            tally = std::mem::take(&mut self.decoder.buses[bus].connection);
            if let Some(last) = tally.in_flight.last_answer {
                let server = self.decoder.bus_rows[bus].name.clone();
                let known = self.last_answers.entry(server).or_insert(last);
                *known = last.max(*known);
            }
        }
        if let Some((number, ended)) = connection.zip(ended) {
            let mode = bus.and_then(|bus| self.decoder.buses[bus].options.mode);
            let source = (Arc::clone(&state.source), state.clock);
            let by_server = ended.history.closed_by.is_some_and(|side| side != ended.client_side);
            let server = ended.server.to_string();
            let beside = beside(self, state, &server, &tally, by_server);
            self.connections.end(connections::row(number, ended, source, mode, (tally, beside)));
        }
    }

    /// Gives up the requests of all connections whose waiting time is over, once in `SWEEP_NS`: a connection on which nothing
    /// happens any more must not hold back the rows of the others.
    #[inline]
    pub(super) fn sweep_connections(&mut self, state: &mut CaptureState, now: Ns) {
        if state.last_sweep.is_none_or(|last| (now - last).abs() >= SWEEP_NS) {
            self.sweep_all_connections(state, now);
        }
    }

    /// The same at once.
    #[cold]
    fn sweep_all_connections(&mut self, state: &mut CaptureState, now: Ns) {
        state.last_sweep = Some(now);
        // A request that is not decided yet has no deadline.
        if self.decoder.message_runs.is_due(now) {
            self.decoder.decide_waiting();
        }
        let is_due = |session: &Self, bus: usize| session.decoder.buses[bus].pairing.deadline().is_some_and(|due| due <= now);
        for bus in state.slots.iter().filter_map(|slot| slot.bus) {
            if is_due(self, bus) {
                self.decoder.end_messages_of(bus);
                self.decoder.advance_pairing(bus, now);
            }
        }
    }

    /// Adds the bus of a connection, if possible in place of that of a closed one, whose state is then dropped, and puts it
    /// into the `slot` of the reader's table. The bus is named after the server, and counted together with its other
    /// connections.
    fn add_connection(&mut self, state: &mut CaptureState, slot: usize, client: Endpoint, server: Endpoint, mode: Mode) {
        let connection = state.slot(slot).connection.unwrap_or_else(|| self.connections.number());
        let server = server.to_string();
        let network =
            Network { client: client.address.to_string(), client_port: Some(client.port), server: server.clone(), connection };
        let bus = Bus {
            name: server,
            source: state.options.source.clone(),
            place: Place::Packet,
            clock: state.clock,
            line: None,
            network: Some(network),
        };
        let options = BusOptions { bus, mode: Some(mode), line: None, resolution: Some(state.resolution.max(1)), rule: None };
        state.slot(slot).bus = Some(self.add_connection_bus(options));
    }

    /// Adds a bus with these options in place of one that is free, if there is one; gives its index.
    fn add_connection_bus(&mut self, options: BusOptions) -> usize {
        let counts = self.decoder.stats.bus_named(&options.bus.name);
        let pairing = Pairing::new(self.decoder.timeout, self.decoder.live);
        let profiles = Profiles::of_bus(&self.decoder.assignments, &options.bus.name);
        let rows = Arc::make_mut(&mut self.decoder.bus_rows);
        if let Some(bus) = self.free.pop() {
            rows[bus] = options.bus.clone();
            self.decoder.buses[bus] = BusState::new(options, pairing, counts, profiles);
            bus
        } else {
            rows.push(options.bus.clone());
            self.decoder.buses.push(BusState::new(options, pairing, counts, profiles));
            self.decoder.open.insert(self.decoder.buses.len() - 1);
            self.decoder.buses.len() - 1
        }
    }

    /// Feeds the bytes of a packet of a serial interface.
    fn feed_serial(
        &mut self,
        bus: usize,
        interface: &Interface,
        content: SerialContent<'_>,
        errors: &[u32],
        packet: u64,
        time: Option<Ns>,
    ) {
        let chunk = Chunk {
            bytes: content.bytes,
            line: interface.written_by_modlens.as_ref().map_or(0, |port| port.line),
            times: time.map_or(Times::None, Times::Read),
            // A tap of modlens receives everything, so that its word `received` does not tell who has sent the bytes.
            side: content.side.filter(|_| interface.written_by_modlens.is_none()),
            starts_record: content.is_whole_frame,
            follows_loss: content.follows_loss,
            // Marks on single bytes say more than a mark on the whole packet.
            has_line_error: content.has_line_error && errors.is_empty(),
            error_positions: errors,
            lacks_checksum: content.lacks_checksum,
            origin: packet,
            ..Chunk::default()
        };
        self.decoder.feed(bus, &chunk);
    }

    /// The bus of the serial interface of this `index` in the capture, in the section whose first interface is `section`. If the interface is new, it is that of its port in a
    /// raw recording of modlens (`recorded_bus`), that of the interface of the same name in the section before, or one that is
    /// added, named after the interface or else after the file. A further interface without a name gets its number, so that it
    /// is not taken for the same bus.
    fn serial_bus(&mut self, state: &mut CaptureState, (index, section): (usize, usize), interface: &Interface) -> usize {
        if state.lines.len() <= index {
            state.lines.resize(index + 1, None);
        }
        if let Some(bus) = state.lines[index] {
            return bus;
        }
        let bus = if let Some(port @ PortMetadata { recording: Some(segment), .. }) = &interface.written_by_modlens {
            self.recorded_bus(state, port, segment)
        } else {
            let name = interface.name.clone().unwrap_or_else(|| {
                let name = self.name_after(&state.options.source);
                let mut others = state.lines.iter().skip(section).flatten();
                let is_taken = others.any(|&bus| self.decoder.buses[bus].options.bus.name == name);
                if is_taken {
                    format!("{name}:{}", index - section + 1)
                } else {
                    name
                }
            });
            let source = state.options.source.clone();
            self.resumed_line(state, &name)
                .unwrap_or_else(|| self.add_serial(state, name, (source, Place::Packet), state.options.line))
        };
        state.lines[index] = Some(bus);
        bus
    }

    /// Adds the bus of a serial interface.
    fn add_serial(
        &mut self,
        state: &CaptureState,
        name: String,
        (source, place): (String, Place),
        line: Option<LineSettings>,
    ) -> usize {
        let bus = Bus { name, source, place, clock: state.clock, line, network: None };
        self.decoder.add_bus(BusOptions { bus, mode: state.options.mode, line, resolution: None, rule: state.options.rule })
    }

    /// The bus of a port in a raw recording, which is added if no port of that session and bus has been read. The two lines
    /// of a bus are two ports with one bus, and a recording of several files goes on with the same bus; where a file is
    /// missing between, the bus is flushed. The user's line settings win over those of the port.
    fn recorded_bus(&mut self, state: &CaptureState, port: &PortMetadata, segment: &RecordingSegment) -> usize {
        let line = state.options.line.or(port.settings);
        let known = self.recorded.iter_mut().find(|(of, _)| of.session == segment.session && of.bus == segment.bus);
        if let Some((of, bus)) = known {
            let (bus, missing) = (*bus, segment.number > of.number + 1);
            of.number = segment.number;
            if missing {
                self.decoder.flush_bus(bus);
            }
            return bus;
        }
        // A replay gives the same rows as the tap did, which knew ports and offsets only.
        let from =
            if self.decoder.live { (port.name.clone(), Place::Offset) } else { (state.options.source.clone(), Place::Packet) };
        let bus = self.add_serial(state, port.name.clone(), from, line);
        self.decoder.buses[bus].begins_inside = true;
        self.recorded.push((segment.clone(), bus));
        bus
    }

    /// Frees the buses of closed connections that no row in `held` names, so that further connections may take them. Called by
    /// `take`, which has emptied the batch: no other row can name them.
    pub(super) fn release_buses(&mut self) {
        if self.retired.is_empty() {
            return;
        }
        let named: HashSet<usize> = self.decoder.held.buses().collect();
        let free = &mut self.free;
        self.retired.retain(|bus| {
            let is_named = named.contains(bus);
            if !is_named {
                free.push(*bus);
            }
            is_named
        });
    }
}

/// What has come so far of the TCP connections that are open: their rows come when they are over, which may be never.
pub fn open_connections(session: &Session) -> Vec<Connection> {
    let mut rows = Vec::new();
    for state in session.captures.iter().flatten() {
        for bus in state.slots.iter().filter_map(|slot| slot.connection.and(slot.bus)) {
            let (own, row) = (&session.decoder.buses[bus], &session.decoder.bus_rows[bus]);
            let tally = &own.connection;
            let beside = beside(session, state, &row.name, tally, false);
            rows.extend(connections::open_row(row, Arc::clone(&state.source), own.options.mode, (tally, beside)));
        }
    }
    rows
}

/// What other connections to the same server show beside one without any answer: whether one is open and was answered before the
/// server closed this one, or was answered after this one had asked.
fn beside(session: &Session, state: &CaptureState, server: &str, own: &ConnectionTally, is_closed_by_server: bool) -> Beside {
    if own.answered > 0 {
        return Beside::default();
    }
    let asked = own.in_flight.first_request;
    let is_later = |last: Ns| asked.is_some_and(|asked| last > asked);
    let last_answer = |bus: usize| {
        let last = session.decoder.buses[bus].connection.in_flight.last_answer?;
        (session.decoder.bus_rows[bus].name == server).then_some(last)
    };
    // A server that is down, or was restarted, has no other connection open; one that hangs answers none.
    let of_open = state.slots.iter().filter_map(|slot| last_answer(slot.bus?)).max();
    let of_ended = session.last_answers.get(server).copied();
    let is_answered = of_open.is_some_and(|last| is_closed_by_server || is_later(last)) || of_ended.is_some_and(is_later);
    Beside { is_answered, until: of_open.max(of_ended) }
}
