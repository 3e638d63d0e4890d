//! Exchanges that need no thought.
//!
//! Most traffic is plain reads and writes that are answered at once. Where a unit and a function are known, nothing is open, and a request
//! that asks for what may be asked for is followed by just the answer it announces, there is nothing to search, to pair
//! or to find. The rows are those of the long way, which every chunking that parts a request from its answer takes
//! (`tests/properties.rs`).

mod ascii;
mod rows;

use crate::framer::exchange::Exchange;
use crate::records::Span;
use crate::session::bus::{learn_side, LineState};
use crate::session::capture::FROM_SERVER;
use crate::session::moment::{Moment, Setting};
use crate::session::Session;
use crate::stats::Key;
use modlens_profiles::points::sunspec::may_begin_in;
use modlens_protocol::checksum::CHECKSUM;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Plain;
use modlens_protocol::mbap::HEADER as MBAP;
use modlens_protocol::Ns;

use rows::Told;

/// An exchange on the wire.
struct Found {
    known: Exchange,
    mode: Mode,
    /// Transaction identifier.
    id: Option<u16>,
    /// The lines of request and answer, and their lengths there.
    lines: [usize; 2],
    lengths: [usize; 2],
}

impl Session {
    /// Tells exchanges at the head of the input, as long as each leaves no doubt.
    pub(super) fn routine(&mut self, bus: usize) {
        let state = &self.buses[bus];
        if state.jumped || !state.pairing.idle() || !state.lines.iter().all(|(_, line)| line.is_settled()) {
            return;
        }
        match &state.lines[..] {
            [(_, line)] if line.framer.mode() == Mode::Rtu => self.routine_rtu(bus),
            [(_, line)] if line.framer.mode() == Mode::Ascii => self.routine_ascii(bus),
            [(first, line), _] if state.options.bus.network.is_some() && line.framer.mode() == Mode::Tcp => {
                let server_first = *first == FROM_SERVER;
                self.routine_tcp(bus, [usize::from(server_first), usize::from(!server_first)]);
            }
            _ => {}
        }
    }

    /// On one line, request and answer follow each other.
    fn routine_rtu(&mut self, bus: usize) {
        let state = &mut self.buses[bus];
        // What silences say is told of each frame.
        if state.lines[0].1.input.timed && state.options.rule().is_some() {
            return;
        }
        let setting = state.setting(0);
        let told_apart = 2 * state.coarsest();
        let mut run = Run::default();
        let mut last: Option<Exchange> = None;
        let mut before = state.lines[0].1.framer.routine().and_then(|framer| framer.before());
        let first = self.batch.arena.len();
        loop {
            let state = &mut self.buses[bus];
            let line = &mut state.lines[0].1;
            let patience = if setting.clocked { state.pairing.patience() } else { Ns::MAX };
            let Some(framer) = line.framer.routine() else { break };
            let pause = |index| state.pairing.tempo.judge(line.input.pause_before(index));
            let known = framer.exchange(&self.functions, &line.input, before, patience, pause).filter(unmarked);
            let Some(known) = known else { break };
            let (asked, answered) = (known.asked + CHECKSUM, known.answered + CHECKSUM);
            let (request, response) = line.input.bytes()[..asked + answered].split_at(asked);
            // From here on, note is taken of it.
            if !state.profiles.take(&self.functions, request, known.block(&response[..known.answered])) {
                break;
            }
            framer.again(request, response, known.mirrored);
            let found = Found { known, mode: Mode::Rtu, id: None, lines: [0, 0], lengths: [asked, answered] };
            // Their bytes are kept at the end, all at once.
            let wires = both(first + run.bytes, found.lengths);
            self.exchange(bus, &found, wires, None, &setting, told_apart, &mut run);
            before = Some((known.unit, known.code));
            last = Some(known);
        }
        let Some(known) = last else { return };
        let state = &mut self.buses[bus];
        let line = &mut state.lines[0].1;
        self.batch.arena.extend_from_slice(line.input.forgotten(run.bytes));
        self.stats.run(state.counts, Mode::Rtu, run.exchanges, run.bytes as u64);
        if let Some(framer) = line.framer.routine() {
            framer.resume(&line.input, &known);
        }
        let response = &line.input.forgotten(known.answered + CHECKSUM)[..known.answered];
        state.pairing.resume(response[0], &response[1..]);
    }

    /// On a connection, each side has its own line, and a message comes in a packet.
    fn routine_tcp(&mut self, bus: usize, lines: [usize; 2]) {
        let [client, server] = lines;
        let state = &mut self.buses[bus];
        let setting = state.setting(client);
        let told_apart = 2 * state.coarsest();
        let mut run = Run::default();
        let mut last = None;
        loop {
            let state = &mut self.buses[bus];
            let (asking, answering) = (&state.lines[client].1.input, &state.lines[server].1.input);
            let Some((header, request)) = asking.bytes().split_first_chunk::<MBAP>() else { break };
            let Some(known) = Exchange::of(&self.functions, Mode::Tcp, request).filter(unmarked) else { break };
            let lengths = [MBAP + known.asked, MBAP + known.answered];
            let Some((after, next)) = asking.packet(lengths[0]).zip(answering.packet(lengths[1])) else { break };
            // In the order of time: no other request came before the answer.
            let (sent, following) = after;
            let in_turn = sent < next.0 && next.0 - sent < state.pairing.patience() && following.is_none_or(|time| time > next.0);
            // A packet that is there is whole.
            let (request, response) = (&request[..known.asked], &answering.bytes()[..lengths[1]]);
            let id = [header[0], header[1]];
            let begins = |head: &[u8], length: usize| *head == [id[0], id[1], 0, 0, 0, length as u8];
            let framed = begins(header, known.asked) && begins(&response[..MBAP], known.answered);
            let response = &response[MBAP..];
            if !(in_turn && framed && known.is_answered(request, response)) {
                break;
            }
            if !state.profiles.take(&self.functions, request, known.block(response)) {
                break;
            }
            let found = Found { known, mode: Mode::Tcp, id: Some(u16::from_be_bytes(id)), lines, lengths };
            let wires = [0, 1].map(|at| self.batch.keep(&state.lines[lines[at]].1.input.bytes()[..lengths[at]]));
            self.exchange(bus, &found, wires, None, &setting, told_apart, &mut run);
            last = Some(known.answered);
        }
        let Some(answered) = last else { return };
        let state = &mut self.buses[bus];
        self.stats.run(state.counts, Mode::Tcp, run.exchanges, run.bytes as u64);
        let response = state.lines[server].1.input.forgotten(answered);
        state.pairing.resume(response[0], &response[1..]);
    }

    /// Tells an exchange at the heads of its lines, whose bytes are or will be in the arena at `wires`. `pdus`: where those
    /// of both are, where the lines have characters.
    #[inline(always)]
    #[allow(clippy::inline_always, clippy::too_many_arguments)] // The body of three loops; apart, most of its time goes to its arguments.
    fn exchange(
        &mut self,
        bus: usize,
        found: &Found,
        wires: [Span; 2],
        pdus: Option<[Span; 2]>,
        setting: &Setting,
        told_apart: Ns,
        run: &mut Run,
    ) {
        let state = &mut self.buses[bus];
        let Found { known, mode, id, lines: [client, server], lengths } = found;
        let asked = taken(&mut state.lines[*client].1, lengths[0], setting);
        let answered = taken(&mut state.lines[*server].1, lengths[1], setting);
        learn_side(&mut state.sides, asked.side, Direction::Request);
        learn_side(&mut state.sides, answered.side, Direction::Response);
        let response_time = state.pairing.since(asked.end, answered.start, answered.clean_start);
        state.pairing.again(known.unit, *id, known.mirrored, response_time);
        let unit = usize::from(known.unit);
        (state.known_units[unit], state.paired_units[unit]) = (true, true);
        let told = Told {
            number: self.next_txn,
            frame: self.next_frame,
            bus: bus as u32,
            lines: [state.lines[*client].0, state.lines[*server].0],
            found,
            request: wires[0],
            response: wires[1],
            asked,
            answered,
            response_time: response_time.filter(|&ns| ns >= told_apart),
            recording: self.origin,
        };
        let spans = [asked.span(), answered.span()];
        let key = Key::plain(known.unit, known.code, known.address, known.quantity);
        self.stats.again(state.counts, key, spans, told.response_time);
        run.exchanges += 1;
        run.bytes += lengths[0] + lengths[1];
        self.next_txn += 1;
        self.next_frame += 2;
        let findings = Span { start: self.batch.codes.len() as u32, length: 0 };
        if self.wanted.frames {
            self.batch.frames.push(told.frame(Direction::Request, findings));
            self.batch.frames.push(told.frame(Direction::Response, findings));
        }
        if self.wanted.transactions {
            let inside = || [inside(*mode, wires[0], known.asked), inside(*mode, wires[1], known.answered)];
            let points = state.profiles.of(known.unit);
            self.held.push(told.transaction(points, pdus.unwrap_or_else(inside), findings));
        }
    }
}

/// Exchanges one behind the other, and their bytes.
#[derive(Clone, Copy, Debug, Default)]
struct Run {
    exchanges: u64,
    bytes: usize,
}

/// Whether no profile of a unit begins in what is read.
fn unmarked(known: &Exchange) -> bool {
    known.kind != Plain::ReadRegisters || !may_begin_in(known.address, usize::from(known.quantity))
}

/// The PDU in the bytes of a frame, behind its unit.
fn inside(mode: Mode, wire: Span, length: usize) -> Span {
    let before = if mode == Mode::Tcp { MBAP + 1 } else { 1 };
    Span { start: wire.start + before as u32, length: length as u32 - 1 }
}

/// A request at this place of the arena, and its answer behind it.
fn both(start: usize, [asked, answered]: [usize; 2]) -> [Span; 2] {
    let span = |start: usize, length: usize| Span { start: start as u32, length: length as u32 };
    [span(start, asked), span(start + asked, answered)]
}

/// The first bytes of a line, told.
#[inline(always)]
#[allow(clippy::inline_always)] // See `Session::exchange`.
fn taken(line: &mut LineState, length: usize, setting: &Setting) -> Moment {
    let moment = Moment::of(&line.input, length, &Setting { last_end: line.last_end, ..*setting });
    line.input.consume(length);
    line.last_end = moment.end.or(line.last_end);
    moment
}
