//! The state of one bus: its lines, its framers, what it has shown.

use std::collections::VecDeque;

use crate::framer::auto::{make, Auto};
use crate::framer::silence::Rule;
use crate::framer::{Context, Cut, Framer};
use crate::input::Input;
use crate::pairing::{Pairing, Seen};
use crate::records::Bus;
use crate::session::ahead::{next_lines, Ahead};
use crate::session::clock::Lateness;
use crate::session::moment::Setting;
use crate::session::profiles::Profiles;
use modlens_protocol::direction::{readings, Direction};
use modlens_protocol::framing::Mode;
use modlens_protocol::functions::Functions;
use modlens_protocol::line::Line;
use modlens_protocol::source::{Clock, Place};
use modlens_protocol::Ns;
use modlens_readers::chunk::{Chunk, Side, Times};
use modlens_readers::text::Reader;

/// What a bus is told about itself.
#[derive(Clone, Debug)]
pub struct BusOptions {
    /// Name, source, clock.
    pub bus: Bus,
    /// Framing; found out where `None`.
    pub mode: Option<Mode>,
    /// Line settings.
    pub line: Option<Line>,
    /// What the clock can tell apart; judged from the reads where `None`.
    pub resolution: Option<Ns>,
    /// RTU frames end at silences only, as the specification says; by evidence where `None`.
    pub rule: Option<Rule>,
}

pub(super) struct LineState {
    /// Requests less responses seen on it.
    pub(super) votes: i32,
    pub(super) input: Input,
    pub(super) framer: Box<dyn Framer>,
    pub(super) last_end: Option<Ns>,
    pub(super) lateness: Lateness,
    /// Where the order of two lines is to be found.
    pub(super) ahead: Option<Box<Ahead>>,
}

impl LineState {
    /// Whether nothing is open on it.
    pub(super) fn is_settled(&self) -> bool {
        self.ahead.is_none() && self.framer.settled(self.input.offset())
    }
}

pub(super) struct BusState {
    pub(super) options: BusOptions,
    pub(super) lines: Vec<(u8, LineState)>,
    pub(super) pairing: Pairing,
    /// Where the statistics count it: connections to one server count together.
    pub(super) counts: usize,
    pub(super) known_units: Box<[bool; 256]>,
    pub(super) paired_units: Box<[bool; 256]>,
    /// For what the log calls sent and received: requests less responses seen so far.
    pub(super) sides: [i32; 2],
    pub(super) newest: Option<Ns>,
    /// The latest of all times: clocks go back, and segments come out of turn.
    pub(super) latest: Option<Ns>,
    /// Time has come to here, with bytes or without.
    pub(super) now: Option<Ns>,
    /// Who speaks on which line is known, or cannot be found out in advance.
    pub(super) surveyed: bool,
    pub(super) jumped: bool,
    pub(super) profiles: Profiles,
    pub(super) reader: Option<Box<Reader>>,
    /// The buses of the devices that the reader's lines name.
    pub(super) devices: Vec<(usize, usize)>,
    /// What the stamps of a recording can express.
    pub(super) stamps_resolution: Option<Ns>,
    /// The lines that the next frames are of, where no clock tells it.
    order: VecDeque<usize>,
}
impl BusOptions {
    /// A bus without clock or settings.
    pub fn named(name: &str) -> Self {
        let bus =
            Bus { name: name.into(), source: name.into(), place: Place::Offset, clock: Clock::None, line: None, network: None };
        Self { bus, mode: None, line: None, resolution: None, rule: None }
    }
}
impl BusOptions {
    /// The silences that frames are checked against: those given, or the specification's for this line.
    pub fn rule(&self) -> Option<Rule> {
        self.rule.or_else(|| self.line.map(|line| Rule { t35_ns: line.t35_ns(), t15_ns: line.t15_ns() }))
    }
}

impl BusState {
    pub(super) fn new(options: BusOptions, pairing: Pairing, counts: usize, profiles: Profiles) -> Self {
        Self {
            pairing,
            counts,
            lines: Vec::new(),
            known_units: Box::new([false; 256]),
            paired_units: Box::new([false; 256]),
            sides: [0; 2],
            newest: None,
            latest: None,
            now: None,
            surveyed: false,
            jumped: false,
            reader: None,
            devices: Vec::new(),
            stamps_resolution: None,
            order: VecDeque::new(),
            profiles,
            options,
        }
    }

    pub(super) fn line(&mut self, id: u8) -> &mut LineState {
        if let Some(at) = self.lines.iter().position(|(line, _)| *line == id) {
            return &mut self.lines[at].1;
        }
        let settings = self.options.line;
        let framer: Box<dyn Framer> = match self.options.mode {
            Some(mode) => make(mode, settings.as_ref(), self.options.rule),
            None => Box::new(Auto::new(settings, self.options.rule)),
        };
        let mut input = Input::new(settings.map(|line| line.char_ns()));
        input.break_ns = framer.break_ns(settings.as_ref());
        self.lines.push((id, LineState { votes: 0, input, framer, last_end: None, lateness: Lateness::default(), ahead: None }));
        &mut self.lines.last_mut().expect("just pushed").1
    }

    /// The line of a chunk. Without a clock, the order of two lines is found by what they say.
    pub(super) fn line_for(&mut self, chunk: &Chunk<'_>) -> &mut LineState {
        let fresh = self.lines.iter().all(|(line, _)| *line != chunk.line);
        let first = self.lines.iter().all(|(_, line)| line.ahead.is_some());
        let two = chunk.line != 0 && self.options.bus.network.is_none();
        let untimed = matches!(chunk.times, Times::None) && !chunk.record;
        let line = self.line(chunk.line);
        if fresh && first && two && untimed {
            line.ahead = Some(Box::new(Ahead::new(Input::new(line.input.char_ns))));
            self.pairing.guessed = true;
        }
        self.line(chunk.line)
    }

    /// What the clock of a line can tell apart.
    pub(super) fn resolution(&self, at: usize) -> Ns {
        let line = &self.lines[at].1;
        let reads = line.lateness.resolution(&line.input);
        self.options.resolution.unwrap_or_else(|| self.stamps_resolution.map_or(reads, |stamps| reads.max(stamps)))
    }

    /// Of all lines, the coarsest clock: what may be said of a request and its answer.
    pub(super) fn coarsest(&self) -> Ns {
        (0..self.lines.len()).map(|at| self.resolution(at)).max().unwrap_or(0)
    }

    /// Whether a chunk changes nothing of how the bytes before it are looked at, so that all may be decided together.
    pub(super) fn may_wait(&self, chunk: &Chunk<'_>) -> bool {
        if !self.lines.iter().all(|(_, line)| line.input.takes_alike(chunk)) {
            return false;
        }
        let Some((time, newest)) = chunk.time().zip(self.newest) else { return self.lines.len() == 1 && chunk.line == 0 };
        match self.lines.len() {
            1 => chunk.line == 0 && time >= newest,
            // In the order of time, no side may end a frame by being silent, and nothing comes at the same time.
            2 if self.options.bus.network.is_some() => {
                let silent = |line: &LineState| line.input.newest().is_some_and(|last| time - last >= line.input.break_ns);
                Some(time) > self.latest && !self.lines.iter().any(|(_, line)| silent(line))
            }
            _ => false,
        }
    }

    /// What the times of the next frame of a line depend on. Pairing gets to know the clock, too.
    pub(super) fn setting(&mut self, at: usize) -> Setting {
        let resolution = self.resolution(at);
        let several = self.lines.len() > 1;
        let (_, line) = &self.lines[at];
        self.pairing.resolution = self.options.resolution.unwrap_or_else(|| Lateness::least(&line.input));
        self.pairing.lateness = resolution;
        self.pairing.ordered = !(several && self.lines.iter().any(|(_, line)| line.input.coarse));
        Setting {
            clocked: self.options.bus.clock != Clock::None,
            resolution,
            place: self.options.bus.place,
            mode: line.framer.mode(),
            jumped: self.jumped,
            last_end: line.last_end,
        }
    }

    /// When time alone decides something next.
    pub(super) fn deadline(&self) -> Option<Ns> {
        let silences = self.lines.iter().filter_map(|(_, line)| line.input.deadline());
        silences.chain(self.pairing.deadline()).chain(self.turn_deadline()).min()
    }

    /// Ends the frames of lines that have been silent for long.
    pub(super) fn close_silent_lines(&mut self, now: Ns) {
        self.now = self.now.max(Some(now));
        for (_, line) in &mut self.lines {
            line.input.wait(now);
        }
    }

    /// The next frame: of the line whose turn it is, so that two lines are told in the order of the wire.
    pub(super) fn next_cut(&mut self, functions: &Functions, live: bool, adu: &mut Vec<u8>) -> Option<(usize, Cut)> {
        if self.lines.first().is_some_and(|(_, line)| line.ahead.is_some()) {
            return self.next_heard(functions, live, adu);
        }
        let settings = self.options.line;
        if self.surveys(functions, live) {
            return None;
        }
        let at = match self.lines.len() {
            1 if self.lines[0].1.input.bytes().is_empty() => return None,
            1 => 0,
            _ => self.turn(functions)?,
        };
        // On a two-line tap the silence on one line says nothing of the other's.
        let one_line = self.lines.len() == 1;
        let tempo = &self.pairing.tempo;
        let sides = self.sides;
        let context = Context {
            functions,
            asked: self.pairing.asked(),
            ahead: !live,
            shared: !one_line,
            speaker: if one_line { None } else { self.speaker(at) },
            certain: self.options.bus.network.as_ref().and_then(|_| side_of(self.lines[at].0)),
            known_units: &self.known_units,
            paired_units: &self.paired_units,
            pause: &|gap| tempo.judge(gap.filter(|_| one_line)),
            said: &move |side| said(sides, side),
        };
        let state = &mut self.lines[at].1;
        let cut = state.framer.next(&state.input, &context, adu);
        state.input.break_ns = state.framer.break_ns(settings.as_ref());
        Some((at, cut?))
    }
}

impl BusState {
    /// The next frame of two lines without a clock.
    fn next_heard(&mut self, functions: &Functions, live: bool, adu: &mut Vec<u8>) -> Option<(usize, Cut)> {
        if self.order.is_empty() {
            let mut at = 0;
            let mut quiet = 0;
            while quiet < self.lines.len() {
                let context = Context {
                    functions,
                    asked: None,
                    ahead: !live,
                    shared: true,
                    speaker: self.speaker(at),
                    certain: None,
                    known_units: &self.known_units,
                    paired_units: &self.paired_units,
                    pause: &|_| 0.0,
                    said: &|side| said(self.sides, side),
                };
                let found = self.lines[at].1.look_ahead(&context);
                quiet = if found { 0 } else { quiet + 1 };
                at = (at + 1) % self.lines.len();
            }
            for at in 0..self.lines.len() {
                if let Some(speaker) = self.speaker(at) {
                    self.lines[at].1.all_said_by(functions, speaker);
                }
            }
            self.order = next_lines(functions, &mut self.lines).into();
        }
        let at = self.order.pop_front()?;
        Some((at, self.lines[at].1.next_heard(adu)?))
    }

    /// Who has a line of a two-line tap for himself, once both lines have shown it.
    pub(super) fn speaker(&self, at: usize) -> Option<Direction> {
        let votes: i32 =
            self.lines.iter().enumerate().map(|(line, (_, state))| if line == at { state.votes } else { -state.votes }).sum();
        match votes {
            3.. => Some(Direction::Request),
            ..=-3 => Some(Direction::Response),
            _ => None,
        }
    }
}

/// Votes for the master, less those for the units, with those of one more frame. What either may send has none.
pub(super) fn voted(votes: i32, functions: &Functions, adu: &[u8]) -> i32 {
    const MOST: i32 = 50;
    let vote = match readings(functions, adu.get(1..).unwrap_or(&[])) {
        (true, false) => 1,
        (false, true) => -1,
        _ => 0,
    };
    (votes + vote).clamp(-MOST, MOST)
}

/// Who speaks on a line of a connection: the client's is 1, the server's 2.
fn side_of(line: u8) -> Option<Direction> {
    match line {
        1 => Some(Direction::Request),
        2 => Some(Direction::Response),
        _ => None,
    }
}

/// Remembers what the words of a log mean, by a frame that leaves no doubt of who sent it.
#[inline]
pub(super) fn learn_side(sides: &mut [i32; 2], side: Option<Side>, direction: Direction) {
    let Some(side) = side else { return };
    let vote = match direction {
        Direction::Request => 1,
        Direction::Response => -1,
        Direction::Unknown => 0,
    };
    let slot = &mut sides[usize::from(side == Side::Received)];
    *slot = (*slot + vote).clamp(-100, 100);
}

/// Remembers who speaks on this bus, and what its log's words mean.
pub(super) fn learn(known_units: &mut [bool; 256], sides: &mut [i32; 2], seen: &Seen<'_>, side: Option<Side>) {
    if !seen.verdict.good() || seen.adu.len() < 2 {
        return;
    }
    known_units[seen.adu[0] as usize] = true;
    learn_side(sides, side, seen.direction);
}

/// What a log's word means: what its frames have shown, or else that the logging process is the master.
pub(super) fn said(sides: [i32; 2], side: Side) -> Direction {
    let lead = sides[0] - sides[1];
    let master_logs = lead >= 0;
    if (side == Side::Sent) == master_logs {
        Direction::Request
    } else {
        Direction::Response
    }
}

#[cfg(test)]
mod tests {
    use crate::input::Input;
    use crate::session::{BusOptions, Session};
    use modlens_protocol::checksum::crc16;
    use modlens_protocol::framing::Mode;
    use modlens_readers::chunk::Chunk;

    #[test]
    fn offsets_beyond_four_gib_are_told_whole() {
        const START: u64 = (1 << 32) - 20;
        let mut session = Session::default();
        let bus = session.add_bus(BusOptions { mode: Some(Mode::Rtu), ..BusOptions::named("bus") });
        let line = session.buses[bus].line(0);
        line.input = Input::at(START);
        line.framer.jump(START);
        let framed = |body: &[u8]| [body, &crc16(body).to_le_bytes()].concat();
        let round = [framed(&[1, 3, 0, 0, 0, 1]), framed(&[1, 3, 2, 0, 7])].concat();
        for _ in 0..10 {
            session.feed(bus, &Chunk { bytes: &round, ..Chunk::default() });
        }
        session.flush();
        let batch = session.take();
        let places: Vec<u64> = batch.frames.iter().map(|frame| frame.offset).collect();
        let wanted: Vec<u64> = (0..10).flat_map(|at| [START + 15 * at, START + 15 * at + 8]).collect();
        assert_eq!(places, wanted);
        assert!(batch.frames.iter().all(|frame| frame.verdict.good()));
    }
}
