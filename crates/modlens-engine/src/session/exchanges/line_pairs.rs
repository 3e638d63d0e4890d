//! The fast path on a log with times whose lines are a whole RTU frame each: requests and responses are matched as their lines
//! come, without an input and its reads.
//!
//! A request is kept in hand until the next line. If that is its response, the exchange is emitted as `rtu_batch` emits one at
//! the head of the bus's only line, which is left as if both had come and been consumed. In any other case both take the general
//! way, in their order. That a line is decided earlier than there changes nothing: a block of the log may end after any line.

use crate::fast_path::rtu_exchange::{Answered, LastExchange};
use crate::framer::rtu::traffic_model::LearningRun;
use crate::framer::Framer;
use crate::input::Read;
use crate::session::bus::BusState;
use crate::session::exchanges::emit::{adjacent_spans, ExchangePlaces};
use crate::session::exchanges::line_run::LineRun;
use crate::session::exchanges::rtu_batch::{match_exchange, LineContext};
use crate::session::exchanges::run::Run;
use crate::session::frame_timing::{FrameTiming, TimingConfig};
use crate::session::line::LineState;
use crate::session::Session;
use modlens_protocol::framing::Mode;
use modlens_protocol::source::Place;
use modlens_protocol::Ns;
use modlens_readers::text::LogEntry;

/// Returns whether a line may be a frame of such an exchange: it is one whose checksum the reader has found valid.
fn is_plain(entry: &LogEntry) -> bool {
    entry.proven_framing == Some(Mode::Rtu) && entry.line == 0 && !entry.follows_loss && !entry.lacks_checksum
}

/// Notes a line of a log that is exactly a frame of so many bytes, as if it had come and been consumed; returns when and where it
/// was.
#[inline(always)]
#[allow(clippy::inline_always)] // The result is large, and `Session::emit_timed` takes it apart at once.
fn pass(line: &mut LineState, entry: &LogEntry, time: Ns, length: usize, run: &Run) -> FrameTiming {
    let end = line.input.offset() + length as u64;
    let read = Read {
        end,
        time,
        origin: entry.number,
        side: entry.side,
        starts_record: false,
        has_line_error: false,
        lacks_checksum: false,
        proven_framing: None,
    };
    let config = TimingConfig { last_end: line.last_end, ..run.config };
    let frame = FrameTiming::of_timed_read(&line.input, &read, length, &config);
    line.input.pass(end, time, length);
    line.last_end = frame.end;
    frame
}

/// Returns whether nothing on this bus is undecided and its next lines may be matched in pairs.
fn takes_lines(state: &BusState) -> bool {
    let is_ready = |line: &LineState| line.input.takes_packets() && line.is_settled() && line.framer.mode() == Mode::Rtu;
    let is_only_line = matches!(&state.lines[..], [(0, line)] if is_ready(line));
    is_only_line && !state.clock_jumped && state.pairing.is_idle() && state.options.rule().is_none()
}

impl Session {
    /// Takes a line of a log if it is a request to be kept in hand, or the response to the one in hand. `false`, with nothing
    /// changed, if it is neither: then it has to be fed, after the request in hand (`end_line_run`).
    #[inline]
    pub(crate) fn take_line(&mut self, bus: usize, entry: &LogEntry, bytes: &[u8]) -> bool {
        let Some(time) = entry.time.filter(|_| is_plain(entry)) else { return false };
        if self.line_run.as_ref().is_none_or(|current| current.bus != bus) && !self.begin_line_run(bus) {
            return false;
        }
        let Some(mut current) = self.line_run.take() else { return false };
        let is_taken = if let Some((request, asked)) = &current.request {
            let (requested_at, request_line, asked) = (request.time.unwrap_or(time), *request, *asked);
            time >= requested_at && self.match_line(&mut current, (&request_line, requested_at, asked), (entry, time, bytes))
        } else {
            let is_in_order = Some(time) >= self.buses[bus].newest;
            if is_in_order {
                self.batch.arena.extend_from_slice(bytes);
                current.request = Some((*entry, bytes.len()));
            }
            is_in_order
        };
        self.line_run = Some(current);
        is_taken
    }

    /// Begins a run on this bus, if nothing on it is undecided; that of another bus ends.
    #[cold]
    fn begin_line_run(&mut self, bus: usize) -> bool {
        if self.live || self.buses[bus].options.bus.place != Place::Line {
            return false;
        }
        if self.waiting.is_some() && !self.line_tries.is_due() {
            return false;
        }
        self.decide_waiting();
        let is_compact = self.emits_compact_lines(bus);
        let state = &mut self.buses[bus];
        let run = if takes_lines(state) { Some(Run::new(state, 0)).filter(Run::has_clock) } else { None };
        let Some(mut run) = run else {
            self.line_tries.note_run(0);
            return false;
        };
        run.is_compact = is_compact;
        let answered_before = state.lines[0].1.framer.rtu_mut().map_or(Answered::default(), |framer| framer.answered());
        self.line_run =
            Some(Box::new(LineRun { bus, run, answered_before, last: None, learning: LearningRun::default(), request: None }));
        true
    }

    /// Emits the exchange of the request in hand (its line, time and length) and this line (its bytes), if they are one without a
    /// doubt.
    #[inline(always)]
    #[allow(clippy::inline_always)] // Called once.
    fn match_line(
        &mut self,
        current: &mut LineRun,
        (request, requested_at, asked): (&LogEntry, Ns, usize),
        (response, answered_at, bytes): (&LogEntry, Ns, &[u8]),
    ) -> bool {
        let LineRun { bus, run, answered_before, last, learning, request: in_hand } = current;
        let state = &mut self.buses[*bus];
        let request_timeout = run.request_timeout(state);
        let LineState { input, framer, .. } = &mut state.lines[0].1;
        let Some(framer) = framer.rtu_mut() else { return false };
        let start = self.batch.arena.len() - asked;
        self.batch.arena.extend_from_slice(bytes);
        let known = LineContext {
            framer,
            learning,
            reads: &state.memo,
            profiles: &mut state.profiles,
            timing: &state.pairing.timing,
            answered: last.map_or(*answered_before, LastExchange::answered),
            has_times: true,
            has_proven_lines: true,
        };
        let has_place = |lengths| lengths == [asked, bytes.len()] && answered_at - requested_at < request_timeout;
        let duration = bytes.len() as Ns * input.char_ns.unwrap_or(0);
        let silence = |_| Some(answered_at - requested_at - duration);
        let Some((matched, odds)) = match_exchange(&self.functions, known, &self.batch.arena[start..], has_place, silence) else {
            self.batch.arena.truncate(start + asked);
            return false;
        };
        let line = &mut state.lines[0].1;
        let timings = [pass(line, request, requested_at, asked, run), pass(line, response, answered_at, bytes.len(), run)];
        (state.newest, state.latest) = (Some(answered_at), state.latest.max(Some(answered_at)));
        let places = ExchangePlaces { wires: adjacent_spans(start, matched.lengths), pdus: None };
        self.emit_timed(*bus, &matched, &places, timings, run);
        if matched.counters.is_none() {
            let state = &mut self.buses[*bus];
            let request = &self.batch.arena[start..start + asked];
            state.memo.keep(&mut self.stats, state.counts, request, &matched.expected);
        }
        (*last, *in_hand) = (Some(LastExchange { expected: matched.expected, odds }), None);
        true
    }

    /// Ends the run of exchanges that are matched in their lines, if there is one: its bus is brought up to date, and the
    /// request in hand, which has no response here, takes the general way.
    #[inline]
    pub(crate) fn end_line_run(&mut self) {
        if let Some(ended) = self.line_run.take() {
            self.end_lines(*ended);
        }
    }

    #[cold]
    fn end_lines(&mut self, mut ended: LineRun) {
        let in_hand = ended.request.map(|(entry, length)| (entry, self.batch.arena.split_off(self.batch.arena.len() - length)));
        self.line_tries.note_run(ended.run.totals.exchanges);
        if let Some(last) = ended.last {
            if let Some(framer) = self.buses[ended.bus].lines[0].1.framer.rtu_mut() {
                framer.learn_run(&mut ended.learning);
            }
            self.end_rtu_run(ended.bus, &ended.run.totals, last);
            self.decide(ended.bus, self.buses[ended.bus].newest);
        }
        if let Some((entry, bytes)) = in_hand {
            self.feed_entry(ended.bus, &entry, &bytes);
        }
    }
}
