//! The state of one bus: its lines with their framers, its pairing, and what was learned of it.

use std::collections::VecDeque;

use crate::fast_path::request_memo::RequestMemo;
use crate::findings::contradictions::ContradictionCounts;
use crate::framer::auto::AutoFramer;
use crate::framer::line_framer::LineFramer;
use crate::framer::silence::SilenceRule;
use crate::framer::{FrameResult, Framer, FramerContext};
use crate::input::Input;
use crate::pairing::{ObservedFrame, Pairing};
use crate::records::Bus;
use crate::session::answer_order::WaitingFrame;
use crate::session::connection_tally::ConnectionTally;
use crate::session::frame_timing::TimingConfig;
use crate::session::inner_pauses::InnerPauses;
use crate::session::lateness::Lateness;
use crate::session::line::{LineState, UnmergedFrames};
use crate::session::profiles::Profiles;
use crate::session::unit_habits::UnitHabits;
use modlens_protocol::direction::Direction;
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::line::LineSettings;
use modlens_protocol::source::{Clock, Place};
use modlens_protocol::Ns;
use modlens_readers::chunk::{Chunk, Side, Times};
use modlens_readers::text::Reader;

/// The numbers of the two lines of a TCP connection: from the client, and from the server.
pub(crate) const FROM_CLIENT: u8 = 1;
pub(crate) const FROM_SERVER: u8 = 2;

/// The silence between frames on a fast line (serial line specification, 2.5.1.1).
const MIN_T35_NS: Ns = 1_750_000;

/// Votes beyond which a further frame no longer changes what a log's words `sent` and `received` mean.
const MAX_SIDE_VOTES: i32 = 100;

/// What the source of a bus knows about it in advance.
#[derive(Clone, Debug)]
pub struct BusOptions {
    /// Name, source, clock.
    pub bus: Bus,
    /// Framing; detected where `None`.
    pub mode: Option<Mode>,
    /// Line settings.
    pub line: Option<LineSettings>,
    /// The step of the clock; estimated from the reads where `None`.
    pub resolution: Option<Ns>,
    /// RTU frames end at these silences only, as the specification says; by evidence where `None`.
    pub rule: Option<SilenceRule>,
}

/// The state of one bus, or of one TCP connection.
pub(crate) struct BusState {
    pub(crate) options: BusOptions,
    /// The lines with their numbers, in the order in which they appeared.
    pub(crate) lines: Vec<(u8, LineState)>,
    pub(crate) pairing: Pairing,
    /// Index of its counters in the statistics. Connections to one server share them.
    pub(crate) counts: usize,
    /// Units that took part in a good frame.
    pub(crate) known_units: Box<[bool; 256]>,
    /// Units that took part in a paired transaction.
    pub(crate) paired_units: Box<[bool; 256]>,
    /// For each of the words `sent` and `received` of a log: requests less responses seen under it.
    pub(crate) side_votes: [i32; 2],
    /// Time of the last chunk.
    pub(crate) newest: Option<Ns>,
    /// The greatest time of all chunks. It differs from `newest` where the clock goes back or segments come out of order.
    pub(crate) latest: Option<Ns>,
    /// How far time has advanced, with bytes or without.
    pub(crate) now: Option<Ns>,
    /// The survey of who speaks on which line is over; see `survey_is_open`.
    pub(crate) is_surveyed: bool,
    /// A tap began somewhere in the traffic, and what came so far may be due to that; see `tap_start`.
    pub(crate) begins_inside: bool,
    /// The clock went back with the last chunk, and no frame was emitted since.
    pub(crate) clock_jumped: bool,
    /// The finding that only one side was heard is made.
    pub(crate) has_one_side_finding: bool,
    /// The finding that no framing fits is made.
    pub(crate) has_no_valid_frame_finding: bool,
    /// What the responses of units have in common.
    pub(crate) habits: UnitHabits,
    pub(crate) profiles: Profiles,
    /// Reads that came before.
    pub(crate) memo: RequestMemo,
    /// What is counted of a connection.
    pub(crate) connection: ConnectionTally,
    /// The reader of a recording in text.
    pub(crate) reader: Option<Box<Reader>>,
    /// Device keys of the text reader, and the bus of each.
    pub(crate) devices: Vec<(usize, usize)>,
    /// The step of the time stamps in a recording in text.
    pub(crate) stamps_resolution: Option<Ns>,
    /// The lines of the next frames, where their order is inferred from their content.
    pub(super) merged_order: VecDeque<usize>,
    /// A response of a recording that may belong to either of two requests.
    pub(super) waiting: Option<WaitingFrame>,
}

impl BusOptions {
    /// A bus without clock or settings.
    pub fn named(name: &str) -> Self {
        let bus =
            Bus { name: name.into(), source: name.into(), place: Place::Offset, clock: Clock::None, line: None, network: None };
        Self { bus, mode: None, line: None, resolution: None, rule: None }
    }

    /// The silences that frames are checked against: those the user gave, or the specification's for these line settings.
    pub fn silence_rule(&self) -> Option<SilenceRule> {
        self.rule.or_else(|| self.line.map(|line| SilenceRule { t35_ns: line.t35_ns(), t15_ns: line.t15_ns() }))
    }
}

impl BusState {
    pub(crate) fn new(options: BusOptions, pairing: Pairing, counts: usize, profiles: Profiles) -> Self {
        Self {
            pairing,
            counts,
            lines: Vec::new(),
            known_units: Box::new([false; 256]),
            paired_units: Box::new([false; 256]),
            side_votes: [0; 2],
            newest: None,
            latest: None,
            now: None,
            is_surveyed: false,
            begins_inside: false,
            clock_jumped: false,
            has_one_side_finding: false,
            has_no_valid_frame_finding: false,
            habits: UnitHabits::default(),
            reader: None,
            devices: Vec::new(),
            stamps_resolution: None,
            merged_order: VecDeque::new(),
            waiting: None,
            profiles,
            memo: RequestMemo::default(),
            connection: ConnectionTally::default(),
            options,
        }
    }

    /// Returns whether the bus already has this clock, and line numbers for places.
    #[inline]
    pub(crate) fn has_clock_of(&self, clock: Clock) -> bool {
        let row = &self.options.bus;
        row.clock == clock && row.place == Place::Line
    }

    /// The line of this number, which is added if it is new.
    pub(crate) fn line(&mut self, id: u8) -> &mut LineState {
        if let Some(at) = self.lines.iter().position(|(line, _)| *line == id) {
            return &mut self.lines[at].1;
        }
        let settings = self.options.line;
        let framer = match self.options.mode {
            // The mode of a connection is that of its client; some gateways answer in RTU.
            Some(Mode::Tcp) if id == FROM_SERVER => LineFramer::Detected(AutoFramer::of_connection()),
            mode => LineFramer::new(mode, settings, self.options.rule),
        };
        let mut input = Input::new(settings.map(|line| line.char_ns()));
        input.break_ns = framer.break_ns(settings.as_ref());
        let lateness = Lateness::default();
        self.lines.push((
            id,
            LineState {
                request_votes: 0,
                input,
                framer,
                last_end: None,
                lateness,
                inner_pauses: InnerPauses::default(),
                contradictions: ContradictionCounts::default(),
                unmerged: None,
            },
        ));
        &mut self.lines.last_mut().expect("just pushed").1
    }

    /// The line of a chunk, which is added if it is new.
    ///
    /// The first chunk of the bus decides how its frames are ordered: if the tap has two lines (numbers from 1, no connection),
    /// the chunk has no times and starts no record, the frames wait unmerged, so that their order is inferred from their
    /// content. Those of a further line wait, too, even if its reads have times, because nothing orders them among frames
    /// without. Pairing notes that the order is inferred.
    #[inline]
    pub(crate) fn line_for(&mut self, chunk: &Chunk<'_>) -> &mut LineState {
        if let Some(known) = self.lines.iter().position(|(line, _)| *line == chunk.line) {
            return &mut self.lines[known].1;
        }
        let is_two_line_tap = chunk.line != 0 && self.options.bus.network.is_none();
        let is_untimed = matches!(chunk.times, Times::None) && !chunk.starts_record;
        let waits = self.lines.first().map_or(is_two_line_tap && is_untimed, |(_, first)| first.unmerged.is_some());
        let line = self.line(chunk.line);
        if waits {
            line.unmerged = Some(Box::new(UnmergedFrames::new(Input::new(line.input.char_ns))));
            self.pairing.order_is_inferred = true;
        }
        self.line(chunk.line)
    }

    /// The step of a line's clock in ns: two times that differ by less may be in any order. It is the one that the source has
    /// stated; else the one learned from the reads, but not below that of the time stamps in a text.
    pub(crate) fn resolution(&self, at: usize) -> Ns {
        let line = &self.lines[at].1;
        let reads = line.lateness.resolution(&line.input);
        self.options.resolution.unwrap_or_else(|| self.stamps_resolution.map_or(reads, |stamps| reads.max(stamps)))
    }

    /// The coarsest step of all lines' clocks, which limits the times from a request to its response.
    pub(crate) fn coarsest_resolution(&self) -> Ns {
        (0..self.lines.len()).map(|at| self.resolution(at)).max().unwrap_or(0)
    }

    /// The longest silence that is too short to stand between two frames of line `at`, given how late its reads come; `None`
    /// where that is not known to be less than the silence between frames.
    fn immediate_ns(&self, at: usize) -> Option<Ns> {
        let t35_ns = self.options.line.map_or(MIN_T35_NS, |line| line.t35_ns());
        Some(t35_ns - self.resolution(at)).filter(|&ns| ns > 0)
    }

    /// Whether a chunk may be added to bytes that are not decided yet, because it does not change how they are decided. Asked
    /// in recordings only, before the chunk is added.
    ///
    /// No line may see a change of marks or of the kind of times. Without a time the bus may have line 0 only.
    #[inline]
    pub(crate) fn may_wait(&self, chunk: &Chunk<'_>) -> bool {
        if !self.lines.iter().all(|(_, line)| line.input.is_uniform_with(chunk)) {
            return false;
        }
        let Some((time, newest)) = chunk.time().zip(self.newest) else { return self.lines.len() == 1 && chunk.line == 0 };
        match self.lines.len() {
            1 => chunk.line == 0 && time >= newest,
            // The two sides of a connection: in the order of time, without two segments at the same time, and without a
            // silence that would end a frame of either side.
            2 if self.options.bus.network.is_some() => self.is_in_order(time),
            _ => false,
        }
    }

    /// Notes that a unit has answered a request.
    #[inline]
    pub(crate) fn note_paired(&mut self, unit: u8) {
        self.pairing.note_answering(unit);
        let unit = usize::from(unit);
        (self.known_units[unit], self.paired_units[unit]) = (true, true);
    }

    /// Whether a time is after that of all bytes of a connection, and not after a silence that would end a frame of either
    /// side.
    #[inline]
    fn is_in_order(&self, time: Ns) -> bool {
        let is_silent = |line: &LineState| line.input.last_byte_time().is_some_and(|last| time - last >= line.input.break_ns);
        Some(time) > self.latest && !self.lines.iter().any(|(_, line)| is_silent(line))
    }

    /// The parameters from which the times of the next frame of line `at` are computed. On this occasion pairing gets the
    /// finest step of that line's clock, the step that was learned, and whether frames come in the order of the wire: not if
    /// one of several lines has reads of several bytes, which an adapter may have held back. What is learned changes with
    /// every frame.
    pub(crate) fn timing_config(&mut self, at: usize) -> TimingConfig {
        let resolution = self.resolution(at);
        let has_several_lines = self.lines.len() > 1;
        let (_, line) = &self.lines[at];
        self.pairing.resolution = self.options.resolution.unwrap_or_else(|| Lateness::finest_resolution(&line.input));
        self.pairing.read_lateness = resolution;
        self.pairing.is_wire_order = !(has_several_lines && self.lines.iter().any(|(_, line)| line.input.has_multibyte_reads));
        TimingConfig {
            has_clock: self.options.bus.clock != Clock::None,
            resolution,
            place: self.options.bus.place,
            mode: line.framer.mode(),
            clock_jumped: self.clock_jumped,
            last_end: line.last_end,
        }
    }

    /// The next time at which something is decided without further bytes: a silence that ends a frame, a timeout, or
    /// the end of the wait for the other line.
    pub(crate) fn deadline(&self) -> Option<Ns> {
        let silences = self.lines.iter().filter_map(|(_, line)| line.input.deadline());
        silences.chain(self.pairing.deadline()).chain(self.turn_deadline()).min()
    }

    /// Lets time advance to `now` on all lines, so that silences end their frames.
    pub(crate) fn advance_silence(&mut self, now: Ns) {
        self.now = self.now.max(Some(now));
        for (_, line) in &mut self.lines {
            line.input.advance_time(now);
        }
    }

    /// The next frame and the index of its line; `adu` gets its unit and PDU. `None` if more bytes or time are needed: while
    /// it is not known which line is next (`line_of_next_frame`), or as long as that line's framer decides nothing. The bytes
    /// of the frame are left in the input.
    ///
    /// Where no clock shows the order of two lines, `next_frame_without_clock` says which frame is next. The framer looks ahead
    /// in recordings only. If it finds another framing, another silence ends the frames of this line (`break_ns`), and it is asked
    /// again.
    pub(crate) fn next_frame(&mut self, functions: &Functions, live: bool, adu: &mut Vec<u8>) -> Option<(usize, FrameResult)> {
        if self.lines.first().is_some_and(|(_, line)| line.unmerged.is_some()) {
            return self.next_frame_without_clock(functions, live, adu);
        }
        let at = self.line_of_next_frame(functions, live)?;
        // On a two-line tap the silence on one line says nothing about the other's, so it is no evidence.
        let is_single_line = self.lines.len() == 1;
        let (timing, side_votes) = (&self.pairing.timing, self.side_votes);
        let context = FramerContext {
            functions,
            outstanding_request: self.pairing.outstanding_request(),
            may_look_ahead: !live,
            is_multi_line: !is_single_line,
            line_direction: if is_single_line { None } else { self.speaker(at) },
            connection_side: self.options.bus.network.as_ref().and_then(|_| connection_side(self.lines[at].0)),
            known_units: &self.known_units,
            paired_units: &self.paired_units,
            timeout_log_odds: &|silence| timing.timeout_log_odds(silence.filter(|_| is_single_line)),
            immediate_ns: self.immediate_ns(at).filter(|_| is_single_line),
            poll_log_odds: &|silence| timing.poll_log_odds(silence.filter(|_| is_single_line)),
            declared_direction: &move |side| declared_direction(side_votes, side),
        };
        let state = &mut self.lines[at].1;
        loop {
            let result = state.framer.next(&state.input, &context, adu);
            let break_ns = state.framer.break_ns(self.options.line.as_ref());
            let is_unchanged = std::mem::replace(&mut state.input.break_ns, break_ns) == break_ns;
            if is_unchanged || result.is_some() {
                return Some((at, result?));
            }
        }
    }

    /// The index of the line that has the next frame: the only line if it has bytes; of two lines with a clock, the one whose
    /// frame was on the wire first (`turn`). `None` if that is not known yet, and while the survey is open.
    #[inline]
    fn line_of_next_frame(&mut self, functions: &Functions, live: bool) -> Option<usize> {
        if self.survey_is_open(functions, live) {
            return None;
        }
        match &self.lines[..] {
            [(_, only)] => (!only.input.bytes().is_empty()).then_some(0),
            _ => self.turn(functions),
        }
    }
}

/// Who speaks on a line of a TCP connection.
fn connection_side(line: u8) -> Option<Direction> {
    match line {
        FROM_CLIENT => Some(Direction::Request),
        FROM_SERVER => Some(Direction::Response),
        _ => None,
    }
}

/// Learns what a log's words `sent` and `received` mean, from a frame whose direction is certain.
#[inline]
pub(crate) fn learn_side(side_votes: &mut [i32; 2], side: Option<Side>, direction: Direction) {
    let Some(side) = side else { return };
    let vote = match direction {
        Direction::Request => 1,
        Direction::Response => -1,
        Direction::Unknown => 0,
    };
    let slot = &mut side_votes[usize::from(side == Side::Received)];
    *slot = (*slot + vote).clamp(-MAX_SIDE_VOTES, MAX_SIDE_VOTES);
}

/// Learns what `learn_side` learns of the requests of the recording's client and of as many responses of its server.
pub(crate) fn learn_sides(side_votes: &mut [i32; 2], exchanges: u64) {
    let votes = exchanges.min(2 * MAX_SIDE_VOTES.unsigned_abs() as u64) as i32;
    side_votes[0] = (side_votes[0] + votes).min(MAX_SIDE_VOTES);
    side_votes[1] = (side_votes[1] - votes).max(-MAX_SIDE_VOTES);
}

/// Learns from a good frame which units there are, and what the log's words mean.
pub(crate) fn learn(known_units: &mut [bool; 256], side_votes: &mut [i32; 2], frame: &ObservedFrame<'_>, side: Option<Side>) {
    if !frame.verdict.is_good() || frame.adu.len() < 2 {
        return;
    }
    known_units[frame.adu[0] as usize] = true;
    learn_side(side_votes, side, frame.direction);
}

/// The direction that a log's word stands for. Until its frames have shown otherwise, the process that writes the log is
/// taken to be the master, so that `sent` means requests.
pub(crate) fn declared_direction(side_votes: [i32; 2], side: Side) -> Direction {
    let is_log_of_master = side_votes[0] - side_votes[1] >= 0;
    if (side == Side::Sent) == is_log_of_master {
        Direction::Request
    } else {
        Direction::Response
    }
}

/// So many more requests than responses of one side show what its word stands for, without any frame of the other side.
const MIN_VOTES_OF_ONE_SIDE: i32 = 3;

/// The same, unless the frames of the recording contradict it: they show it on both sides, or several on this one, or nothing yet.
pub(crate) fn shown_direction(side_votes: [i32; 2], side: Side) -> Option<Direction> {
    let [sent, received] = side_votes.map(i32::signum);
    let own = side_votes[usize::from(side == Side::Received)];
    let direction = declared_direction(side_votes, side);
    let agrees = (own > 0) == (direction == Direction::Request);
    let is_shown = sent * received < 0 || (own.abs() >= MIN_VOTES_OF_ONE_SIDE && agrees);
    (is_shown || side_votes == [0, 0]).then_some(direction)
}

#[cfg(test)]
mod tests {
    use crate::session::{BusOptions, Session};
    use modlens_protocol::checksum::crc16;
    use modlens_protocol::framing::Mode;
    use modlens_readers::chunk::Chunk;

    #[test]
    fn stream_offsets_beyond_four_gib_are_not_truncated() {
        for mode in [Some(Mode::Rtu), None] {
            offsets_count_from_where_the_stream_begins(mode);
        }
    }

    fn offsets_count_from_where_the_stream_begins(mode: Option<Mode>) {
        const START: u64 = (1 << 32) - 20;
        let mut session = Session::default();
        let bus = session.add_bus(BusOptions { mode, ..BusOptions::named("bus") });
        session.begin_at(bus, 0, START);
        let with_crc = |adu: &[u8]| [adu, &crc16(adu).to_le_bytes()].concat();
        let transaction = [with_crc(&[1, 3, 0, 0, 0, 1]), with_crc(&[1, 3, 2, 0, 7])].concat();
        for _ in 0..10 {
            session.feed(bus, &Chunk { bytes: &transaction, ..Chunk::default() });
        }
        session.flush();
        let batch = session.take();
        let offsets: Vec<u64> = batch.frames.iter().map(|frame| frame.offset).collect();
        let expected: Vec<u64> = (0..10).flat_map(|at| [START + 15 * at, START + 15 * at + 8]).collect();
        assert_eq!(offsets, expected);
        assert!(batch.frames.iter().all(|frame| frame.verdict.is_good()));
    }
}
