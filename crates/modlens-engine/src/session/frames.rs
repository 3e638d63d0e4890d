//! Emission of frames: each is checked, paired and written to the tables, and the bus learns from it.

use crate::findings::{self, words, Found};
use crate::framer::silence::SilenceRule;
use crate::framer::FrameResult;
use crate::input::Input;
use crate::pairing::{ObservedFrame, Pairing};
use crate::records::{Batch, Frame, Span};
use crate::rtu_model::damage_kind::DamageKind;
use crate::session::bus::{learn, shown_direction, BusState};
use crate::session::decoder::Decoder;
use crate::session::frame_timing::{FrameTiming, TimingConfig};
use crate::session::lateness::Lateness;
use crate::session::line::add_vote;
use crate::session::rows::{elapsed, FindingPlace};
use crate::session::tap_start;
use crate::session::unit_habits::UnitHabits;
use crate::stats::Stats;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::{Mode, Verdict};
use modlens_protocol::functions::{Functions, EXCEPTION_BIT};
use modlens_protocol::Ns;

impl Decoder {
    /// Emits the next frame (or noise) of a line, the first `framed.length` bytes of its input. `at` is the index of the line
    /// in the bus, `adu` the frame's unit and PDU, without checksum.
    ///
    /// In this order: its times are computed; it is checked by itself, and pairing gets the codes of what was found; open
    /// requests time out up to its start; it is paired, which may add one more finding; its findings and its row are written,
    /// as far as these tables are wanted, and counted in any case; the bus learns from it; its bytes are consumed; and the
    /// transactions that it has closed are emitted, with the findings on earlier frames that it has made certain.
    pub(super) fn emit_frame(&mut self, bus: usize, at: usize, framed: &FrameResult, adu: &[u8]) {
        let number = self.next_frame;
        self.next_frame += 1;
        let state = &mut self.buses[bus];
        // This also shows pairing how exact the clock is by now.
        let config = state.timing_config(at);
        state.clock_jumped = false;
        let rule = state.options.silence_rule();
        let unit = adu.first().copied().unwrap_or(0);
        let proven_pause = rule.and_then(|_| state.lines[at].1.proven_pause(framed, unit));
        let input = state.lines[at].1.emission_input();
        let timing = FrameTiming::of(input, framed.length, &config);
        timing.list_inner_packets(input, (number, framed.length), config.place, &mut self.batch.inner_packets);
        let wire = &input.bytes()[..framed.length];
        let responses_of = |unit| self.stats.responses_of(state.counts, unit);
        let recognised = recognise((&mut state.habits, responses_of), &state.pairing, framed, wire, config.mode);
        let rest = state.begins_inside.then(|| tap_start::rest_of_frame(input, framed)).flatten();
        let framed = rest.as_ref().or(recognised.as_ref()).unwrap_or(framed);
        let said = as_said(input, framed, state.side_votes);
        let framed = said.as_ref().unwrap_or(framed);
        let mut frame = observed(number, wire, adu, framed, &timing, config.mode);
        frame.is_cut = is_cut_by_recording(input, framed, (state.now, state.begins_inside));
        frame.lacks_request = state.begins_inside && tap_start::lacks_request(input, &state.pairing);
        self.found.clear();
        find_on_frame(&self.functions, input, framed, &frame, (&config, rule, proven_pause), &mut self.found);
        if state.begins_inside {
            self.found.retain(|(finding, _)| !tap_start::is_due_to_start(framed, timing.offset, *finding));
            state.begins_inside = frame.is_cut || tap_start::goes_on(framed, timing.offset);
        }
        if let Some(rule) = rule.filter(|_| config.has_clock && input.has_times && config.mode == Mode::Rtu) {
            count_silence(&mut self.stats, state.counts, input, &frame, (timing.offset, rule));
        }
        self.codes.clear();
        self.codes.extend(self.found.iter().map(|(finding, _)| *finding));
        frame.codes = &self.codes;
        if let Some(start) = timing.start {
            state.pairing.advance_time(start, &mut self.done);
        }
        if state.options.bus.network.is_some() && framed.verdict.is_good() {
            state.connection.note_frame(&self.functions, &frame, &state.pairing);
        }
        let result = state.pairing.add_frame(&self.functions, &frame, &mut self.next_txn, &mut self.done);
        if let Some(finding) = result.finding {
            self.found.push((finding, words::order(finding, &result, &frame)));
        }
        let place = FindingPlace {
            frame: Some(number),
            txn: result.txn,
            bus,
            start: timing.start,
            recording_start: self.origin,
            unit: adu.first().copied(),
            origin: timing.origin,
        };
        for (finding, detail) in &self.found {
            self.stats.finding(*finding);
            if self.wanted.findings {
                self.batch.findings.push(place.row(*finding, detail.clone()));
            }
        }
        if self.wanted.frames {
            let findings = store_codes(&mut self.batch, &self.found);
            let wire = self.batch.store(wire);
            let elapsed = elapsed(self.origin, timing.start);
            let row = frame_row(framed, &frame, &timing, wire, findings);
            self.batch.frames.push(Frame { bus: bus as u32, line: state.lines[at].0, elapsed, txn: result.txn, ..row });
        }
        self.stats.frame(state.counts, config.mode, &frame);
        learn(&mut state.known_units, &mut state.side_votes, &frame, timing.side);
        state.consume_frame(at, &self.functions, framed, adu, timing.end);
        if !state.pairing.delayed_findings.is_empty() || !self.done.is_empty() {
            self.emit_transactions(bus);
        }
    }
}

impl BusState {
    /// Removes an emitted frame from the input of its line `at`, and remembers its `end` for the start of the next one, if it
    /// is known. From a good frame it learns how late reads come and, on one of two lines, who speaks there.
    #[inline]
    fn consume_frame(&mut self, at: usize, functions: &Functions, framed: &FrameResult, adu: &[u8], end: Option<Ns>) {
        let (line_id, line) = &mut self.lines[at];
        if framed.verdict.is_good() {
            line.lateness.learn(&line.input, framed.length);
            line.contradictions.add(&line.input, framed.length, Lateness::finest_resolution(&line.input));
            // Line 0 is the only one of its bus. Frames that waited to be merged have voted before.
            if *line_id != 0 && line.unmerged.is_none() && !framed.unconfirmed {
                line.request_votes = add_vote(line.request_votes, functions, adu);
            }
        }
        line.consume(framed.length);
        line.last_end = end.or(line.last_end);
    }
}

/// The row as what it evidently is, if it is not good and shows a habit of its unit, of which so many responses were counted.
#[inline]
fn recognise(
    (habits, responses_of): (&mut UnitHabits, impl Fn(u8) -> u64),
    pairing: &Pairing,
    framed: &FrameResult,
    wire: &[u8],
    mode: Mode,
) -> Option<FrameResult> {
    if framed.verdict.is_good() || mode != Mode::Rtu {
        return None;
    }
    habits.recognise(framed, wire, pairing.unit_of_last_response(), responses_of)
}

/// A damaged frame, or one whose sender is not known, with the direction that the recording's words in front of all its bytes
/// stand for, as its sound frames show; `None` if it has that already.
#[inline]
fn as_said(input: &Input, framed: &FrameResult, side_votes: [i32; 2]) -> Option<FrameResult> {
    let is_known = framed.verdict.is_good() && framed.direction != Direction::Unknown;
    if is_known || framed.verdict == Verdict::Noise {
        return None;
    }
    let side = input.first_read()?.side?;
    let is_of_one = input.read(framed.length - 1).is_some_and(|last| last.side == Some(side));
    let direction = shown_direction(side_votes, side).filter(|direction| is_of_one && *direction != framed.direction)?;
    Some(FrameResult { direction, ..*framed })
}

/// Copies the codes of these findings into the batch: first those on the frame itself, after them that of pairing, if any.
#[inline]
fn store_codes(batch: &mut Batch, found: &Found) -> Span {
    let start = batch.codes.len() as u32;
    batch.codes.extend(found.iter().map(|(finding, _)| *finding));
    Span { start, length: found.len() as u32 }
}

/// The frame as pairing and the checks get it; its findings are not known yet.
#[inline]
fn observed<'a>(
    number: u64,
    wire: &'a [u8],
    adu: &'a [u8],
    framed: &FrameResult,
    timing: &FrameTiming,
    mode: Mode,
) -> ObservedFrame<'a> {
    ObservedFrame {
        number,
        wire,
        adu,
        verdict: framed.verdict,
        direction: framed.direction,
        mode,
        start: timing.start,
        end: timing.end,
        clean_start: timing.clean_start,
        gap: timing.gap,
        mbap_id: framed.mbap_id,
        origin: timing.origin,
        unconfirmed: framed.unconfirmed,
        confidence: framed.confidence,
        is_cut: false,
        lacks_request: false,
        side: timing.side,
        codes: &[],
    }
}

/// Adds the findings on a frame itself to `found`: its content, its silences, and what receiver, clock and framer report about
/// it. The frame is the first `framed.length` bytes of the input. Without a `rule`, silences are not checked.
#[inline]
fn find_on_frame(
    functions: &Functions,
    input: &Input,
    framed: &FrameResult,
    frame: &ObservedFrame<'_>,
    (config, rule, proven_pause): (&TimingConfig, Option<SilenceRule>, Option<Ns>),
    found: &mut Found,
) {
    if !frame.is_cut {
        findings::frame::content(functions, frame, found);
        findings::frame::framing(framed, found);
    }
    findings::timing::silences(input, rule, (config.resolution, proven_pause), frame, found);
    findings::frame::reception(input, framed.length, found);
    findings::timing::clock(config.clock_jumped, found);
}

/// Whether an incomplete frame at the head of the input lacks only what was sent before the recording began or after it ended:
/// neither its sender nor the line nor the tap has failed. Records are whole, and a recording that is one frame has no more.
/// Where a tap `begins_inside` the traffic, that needs no further evidence.
fn is_cut_by_recording(input: &Input, framed: &FrameResult, (now, begins_inside): (Option<Ns>, bool)) -> bool {
    let is_all = framed.length == input.bytes().len() && input.is_ended;
    if framed.verdict != Verdict::Incomplete || tap_start::comes_in_records(input) || (is_all && input.offset() == 0) {
        return false;
    }
    let lacks_head = framed.direction == Direction::Unknown || begins_inside;
    let lacks_end = match framed.damage {
        None | Some(DamageKind::Truncated { .. }) => true,
        Some(DamageKind::LostBytes { at, .. }) => at == framed.length,
        Some(_) => false,
    };
    let is_silent = now.zip(input.last_byte_time()).is_some_and(|(now, last)| now - last >= input.break_ns);
    (input.offset() == 0 && lacks_head) || (is_all && lacks_end && !is_silent)
}

/// Counts whether a receiver that goes by silences of t3.5 alone would have delimited this frame like the framer did: whether
/// there is one before it, and none inside. The beginning of the stream, or a boundary of the input, counts as a silence.
/// `offset` is the stream offset of the frame, which is at the head of the input.
#[inline]
fn count_silence(stats: &mut Stats, counts: usize, input: &Input, frame: &ObservedFrame<'_>, (offset, rule): (u64, SilenceRule)) {
    let is_long = |pause: Option<Ns>| pause.is_some_and(|pause| pause >= rule.t35_ns);
    let before = input.is_boundary(0) || offset == 0 || is_long(input.pause_before(0));
    let inside = is_long(input.longest_pause(0, frame.wire.len()));
    stats.silence(counts, rule.t35_ns, frame, before, inside);
}

/// The row of a frame; bus, line, transaction and time since the beginning are filled in by the caller. Noise has neither unit
/// nor function code, and only a good frame has an exception code. `wire` and `findings` are ranges of the batch.
#[inline]
fn frame_row(framed: &FrameResult, frame: &ObservedFrame<'_>, timing: &FrameTiming, wire: Span, findings: Span) -> Frame {
    let is_frame = framed.verdict != Verdict::Noise;
    let code = frame.adu.get(1).copied().filter(|_| is_frame);
    let is_exception = code.is_some_and(|code| code & EXCEPTION_BIT != 0) && framed.verdict.is_good();
    Frame {
        number: frame.number,
        bus: 0,
        line: 0,
        offset: timing.offset,
        wire,
        start: timing.start,
        end: timing.end,
        elapsed: None,
        gap: timing.gap,
        pauses: timing.pauses,
        mode: frame.mode,
        direction: framed.direction,
        unit: frame.adu.first().copied().filter(|_| is_frame),
        code,
        exception: frame.adu.get(2).copied().filter(|_| is_exception),
        verdict: framed.verdict,
        unconfirmed: framed.unconfirmed,
        confidence: framed.confidence,
        delimited_by: framed.delimited_by,
        txn: None,
        mbap_id: framed.mbap_id,
        findings,
        origin: timing.origin,
        last_origin: timing.last_origin,
        side: timing.side,
    }
}
