//! Exchanges that need no thought.
//!
//! Most traffic is reads that are answered at once. Where a unit and a function are known, nothing is open, and a request
//! that asks for what may be asked for is followed by just the answer it announces, there is nothing to search, to pair
//! or to find. The rows are those of the long way, which every chunking that parts a request from its answer takes
//! (`tests/properties.rs`).

mod expected;
mod rows;

use crate::checksum::crc_valid_at;
use crate::direction::Direction;
use crate::framer::Mode;
use crate::records::{Batch, Span};
use crate::session::bus::{learn_side, LineState};
use crate::session::capture::FROM_SERVER;
use crate::session::moment::{Moment, Setting};
use crate::session::Session;
use crate::Ns;

use expected::Expected;
use rows::Told;

impl Session {
    /// Tells exchanges at the head of the input, as long as each leaves no doubt.
    pub(super) fn routine(&mut self, bus: usize) {
        let state = &self.buses[bus];
        if state.jumped || !state.pairing.idle() {
            return;
        }
        match &state.lines[..] {
            [(_, line)] if line.framer.mode() == Mode::Rtu && line.ahead.is_none() => self.routine_rtu(bus),
            [(first, line), _] if state.options.bus.network.is_some() && line.framer.mode() == Mode::Tcp => {
                let server_first = *first == FROM_SERVER;
                self.routine_tcp(bus, usize::from(server_first), usize::from(!server_first));
            }
            _ => {}
        }
    }

    /// On one line, request and answer follow each other.
    fn routine_rtu(&mut self, bus: usize) {
        let state = &mut self.buses[bus];
        let line = &state.lines[0].1;
        // What silences say is told of each frame.
        let silences = line.input.timed && state.options.rule().is_some();
        if silences || !line.framer.settled(line.input.offset()) {
            return;
        }
        let setting = state.setting(0);
        let told_apart = 2 * state.coarsest();
        let mut last = None;
        loop {
            let state = &mut self.buses[bus];
            let line = &mut state.lines[0].1;
            let Some(known) = Expected::of(&self.functions, Mode::Rtu, line.input.bytes()) else { break };
            let (request, rest) = line.input.bytes().split_at(known.asked.min(line.input.bytes().len()));
            let patience = if setting.clocked { state.pairing.patience() } else { Ns::MAX };
            let whole = known.is_answered(rest) && crc_valid_at(request, known.asked);
            if !whole || !line.input.holds_exchange(known.asked, known.answered, patience) {
                break;
            }
            let settled = state.profiles.settled(&self.functions, request, &rest[3..known.answered - 2]);
            let (Some(framer), true) = (line.framer.routine(), settled) else { break };
            if !framer.again(request, &rest[..known.answered]) {
                break;
            }
            last = Some(self.exchange(bus, &known, [0, 0], &setting, told_apart));
        }
        let Some((request, response)) = last else { return };
        let state = &mut self.buses[bus];
        let line = &mut state.lines[0].1;
        let (request, response) = (request.of(&self.batch.arena), response.of(&self.batch.arena));
        if let Some(framer) = line.framer.routine() {
            framer.resume(request, response, line.input.offset());
        }
        state.pairing.resume(response[0], &response[1..response.len() - 2]);
    }

    /// On a connection, each side has its own line, and a message comes in a packet.
    fn routine_tcp(&mut self, bus: usize, client: usize, server: usize) {
        let state = &mut self.buses[bus];
        if !state.lines.iter().all(|(_, line)| line.framer.settled(line.input.offset())) {
            return;
        }
        let setting = state.setting(client);
        let told_apart = 2 * state.coarsest();
        let mut last = None;
        loop {
            let state = &self.buses[bus];
            let (asked, answered) = (&state.lines[client].1.input, &state.lines[server].1.input);
            let Some(known) = Expected::of(&self.functions, Mode::Tcp, asked.bytes()) else { break };
            let Some((after, next)) = asked.packet(known.asked).zip(answered.packet(known.answered)) else { break };
            // In the order of time: no other request came before the answer.
            let (sent, following) = after;
            let in_turn = sent < next.0 && next.0 - sent < state.pairing.patience() && following.is_none_or(|time| time > next.0);
            let (request, response) = (asked.bytes(), answered.bytes());
            let whole = in_turn && known.is_answered(response);
            // Behind the header, the unit stands before the function as on a serial line.
            if !(whole && state.profiles.settled(&self.functions, &request[6..], &response[9..known.answered])) {
                break;
            }
            last = Some(self.exchange(bus, &known, [client, server], &setting, told_apart));
        }
        if let Some((_, response)) = last {
            let response = response.of(&self.batch.arena);
            self.buses[bus].pairing.resume(response[6], &response[7..]);
        }
    }

    /// Tells an exchange at the heads of these lines; gives its bytes.
    fn exchange(&mut self, bus: usize, known: &Expected, lines: [usize; 2], setting: &Setting, told_apart: Ns) -> (Span, Span) {
        let state = &mut self.buses[bus];
        let [client, server] = lines;
        let (request, asked) = taken(&mut self.batch, &mut state.lines[client].1, known.asked, setting);
        let (response, answered) = taken(&mut self.batch, &mut state.lines[server].1, known.answered, setting);
        learn_side(&mut state.sides, asked.side, Direction::Request);
        learn_side(&mut state.sides, answered.side, Direction::Response);
        let response_time = state.pairing.since(asked.end, answered.start, answered.clean_start);
        state.pairing.again(known.unit, known.id, response_time);
        let unit = usize::from(known.unit);
        (state.known_units[unit], state.paired_units[unit]) = (true, true);
        let told = Told {
            number: self.next_txn,
            frame: self.next_frame,
            bus: bus as u32,
            lines: [state.lines[client].0, state.lines[server].0],
            known,
            request,
            response,
            asked,
            answered,
            response_time: response_time.filter(|&ns| ns >= told_apart),
            recording: self.origin,
        };
        let spans = [asked.span(), answered.span()];
        self.stats.again(state.counts, known.mode, known.key, known.asked + known.answered, spans, told.response_time);
        self.next_txn += 1;
        self.next_frame += 2;
        let findings = self.batch.keep_codes(&[]);
        if self.wanted.frames {
            self.batch.frames.push(told.frame(Direction::Request, findings));
            self.batch.frames.push(told.frame(Direction::Response, findings));
        }
        if self.wanted.transactions {
            let points = state.profiles.of(known.unit);
            self.held.push(told.transaction(points, findings));
        }
        (request, response)
    }
}

/// The first bytes of a line, kept and told.
fn taken(batch: &mut Batch, line: &mut LineState, length: usize, setting: &Setting) -> (Span, Moment) {
    let wire = batch.keep(&line.input.bytes()[..length]);
    let moment = Moment::of(&line.input, length, &Setting { last_end: line.last_end, ..*setting });
    line.input.consume(length);
    line.last_end = moment.end.or(line.last_end);
    (wire, moment)
}
