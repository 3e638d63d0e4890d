//! The best path through the bytes: frames and what lies between them, scored in bits.
//!
//! Nodes stand at ends of frames only. What lies between two frames costs the same however it is read, so nothing has
//! to be kept for single bytes. A frame is told once no rival reading within `THETA` bits is left without it.

mod ahead;
mod decide;
mod holds;
mod paths;

use crate::direction::{self, Asked, Direction, Match};
use crate::framer::rtu::announced;
use crate::framer::rtu::certain::{answer, Length};
use crate::framer::rtu::costs::{self, Copy, Model, Setting};
use crate::framer::rtu::gain::{self, REQUEST, RESPONSE};
use crate::framer::rtu::join::{Join, REACH};
use crate::framer::rtu::pending::{Open, Pending, Request, Requests};
use crate::framer::rtu::search::paths::Node;
use crate::framer::Context;
use crate::functions::{Extent, Layout, EXCEPTION_BIT};
use crate::input::Input;
use crate::Ns;

/// The shortest frame with a length of its own is a request of eight bytes, or its answer of five.
const SHORTEST_DAMAGED: u64 = 5;

/// What was decided.
pub enum Told {
    /// A frame from here to there.
    Frame {
        /// Stream offset of its first byte.
        start: u64,
        /// Stream offset behind it.
        end: u64,
        /// Who sent it.
        direction: Direction,
        /// Bits.
        confidence: u8,
        /// Isolated in noise, from a unit that has not been seen in a paired transaction.
        tentative: bool,
    },
    /// A frame with a wrong checksum.
    Damaged {
        /// Stream offset of its first byte.
        start: u64,
        /// Stream offset behind it.
        end: u64,
        /// Who sent it.
        direction: Direction,
    },
    /// No frame begins before this stream offset.
    Junk(u64),
}

/// The search over one line.
pub struct Search {
    nodes: Vec<Node>,
    join: Join,
    found: Vec<u64>,
    /// The first byte not looked at.
    next: u64,
    /// The join has begun behind the root.
    running: bool,
    /// Before this place no damaged frame can end.
    wake: u64,
    /// Before this place nothing can be decided, unless frames are found.
    calm: u64,
    /// The frame that was last seen to be possible still: the node behind which it begins, and where.
    threat: Option<(usize, u64)>,
    requests: Requests,
    /// Before this place nothing has begun that may still be worth more, as far as the paths have not changed.
    cleared: u64,
    /// What was told last was tentative, or noise that goes on.
    doubtful: bool,
    /// So many frames were told without a byte between them.
    glued: u8,
    /// What was found could not be decided without more bytes.
    short: bool,
    /// What was found cannot be decided until more is found.
    steady: bool,
    /// Whether a frame of any length that has begun here, behind what was told, has come.
    any_length: Option<(u64, bool)>,
    /// What was learned.
    pub model: Model,
}

impl Default for Search {
    fn default() -> Self {
        Self {
            nodes: vec![Node::root()],
            join: Join::default(),
            found: Vec::new(),
            next: 0,
            running: false,
            wake: 0,
            calm: 0,
            threat: None,
            requests: Requests::default(),
            cleared: 0,
            doubtful: false,
            glued: 0,
            short: false,
            steady: false,
            any_length: None,
            model: Model::default(),
        }
    }
}

impl Search {
    /// The end of what was told.
    #[inline]
    pub fn told(&self) -> u64 {
        self.nodes[0].end
    }

    /// Whether nothing behind what was told was looked at.
    pub fn idle(&self) -> bool {
        self.nodes.len() == 1 && (!self.running || self.next == self.told())
    }

    /// Whether nothing behind what was told speaks against a frame that begins there, behind so many strays.
    pub fn admits(&self, strays: usize, length: Length) -> bool {
        if self.nodes.len() == 1 {
            return true;
        }
        let direction = if length.request() { REQUEST } else { RESPONSE };
        let first = self.nodes[self.best().0].first;
        let frame = &self.nodes[first];
        let start = self.told() + strays as u64;
        (first == 0 && strays == 0)
            || (frame.start, frame.end, frame.direction) == (start, start + length.bytes() as u64, direction)
    }

    /// Who sent the frame that was told last.
    #[inline]
    pub fn direction(&self) -> Direction {
        gain::direction(self.nodes[0].direction)
    }

    /// The request that waits.
    #[inline]
    pub fn asked(&self) -> Option<&Request> {
        self.nodes[0].pending.asked.map(|slot| self.requests.get(slot))
    }

    /// All that may be answered.
    pub fn pending(&self) -> Open<'_> {
        self.requests.open(self.nodes[0].pending)
    }

    /// The request that waits is known from elsewhere: the other line of a two-line tap.
    pub fn set_asked(&mut self, asked: Option<Asked<'_>>) {
        self.make_room();
        let slot = asked.map(|asked| self.requests.keep(asked.unit, asked.pdu));
        self.nodes[0].pending.asked = slot;
    }

    #[inline]
    fn make_room(&mut self) {
        self.requests.make_room(self.nodes.iter().map(|node| &node.pending));
    }

    /// The request that waits is sure, so a frame behind a few strays needs no weighing if it leaves no doubt by itself.
    pub fn is_plain(&self) -> bool {
        self.asked().is_none_or(|asked| !asked.tentative && !asked.damaged)
    }

    /// Whether nothing behind this place was looked at, and no request may be answered there.
    pub fn settled(&self, offset: u64) -> bool {
        let Pending { asked, late, .. } = self.nodes[0].pending;
        self.nodes.len() == 1 && self.told() == offset && asked.is_none() && late.is_none()
    }

    /// An exchange ends here, and nothing is open: as if `pass` had taken both of its frames.
    pub fn resume(&mut self, request: &[u8], response: &[u8], end: u64) {
        self.make_room();
        let pending = &mut self.nodes[0].pending;
        self.requests.ask(pending, request, request.len(), None);
        pending.answer(response);
        let root = &mut self.nodes[0];
        (root.direction, root.start, root.end) = (RESPONSE, end - response.len() as u64, end);
        (self.next, self.running, self.doubtful) = (end, false, false);
    }

    /// A frame was found without search, right behind what was told and some strays, at the beginning of these bytes.
    #[inline]
    pub fn pass(&mut self, context: &Context<'_>, bytes: &[u8], strays: usize, length: Length) {
        if self.nodes.len() > 1 {
            self.nodes.truncate(1);
        }
        let (junk, bytes) = bytes.split_at(strays);
        let frame = &bytes[..length.bytes()];
        let waiting = self.nodes[0].pending.asked.is_some();
        let mut copy = Copy::Unclear;
        let direction = if length.request() { REQUEST } else { RESPONSE };
        if length.request() {
            self.make_room();
            let row = context.functions.row(frame[1], &frame[2..]);
            let answer = row.and_then(|row| answer(row, &frame[1..frame.len() - 2]));
            if row.is_some_and(|row| !row.mirrored) {
                copy = Copy::First;
            }
            self.requests.ask(&mut self.nodes[0].pending, bytes, frame.len(), answer);
        } else {
            self.learn_late(context, frame, true);
            self.nodes[0].pending.answer(frame);
        }
        let root = &mut self.nodes[0];
        root.direction = direction;
        root.start = root.end + strays as u64;
        root.end = root.start + frame.len() as u64;
        self.next = root.end;
        (self.running, self.doubtful) = (false, false);
        // In the certain case its layout is known.
        self.model.learn(frame, direction, Setting { waiting, junk: strays as u64 }, copy);
        if strays > 0 {
            self.model.learn_noise(junk);
        }
    }

    /// Learns how often the old answer comes behind a retry's own. An answer that repeats its request may be either.
    #[inline]
    fn learn_late(&mut self, context: &Context<'_>, frame: &[u8], answers: bool) {
        let Open { asked, late: Some(late), .. } = self.pending() else { return };
        let pdu = &frame[1..frame.len() - 2];
        if late.pdu == pdu {
            return;
        }
        match asked {
            Some(asked) if answers && (asked.unit, &asked.pdu) == (late.unit, &late.pdu) => self.model.learn_late(false),
            None if direction::answers(context.functions, late.asked(), frame[0], pdu) == Match::Fully => {
                self.model.learn_late(true);
            }
            _ => {}
        }
    }

    /// Bytes up to here belong to no frame, as somebody else decided.
    pub fn jump(&mut self, to: u64) {
        self.nodes.truncate(1);
        self.nodes[0].end = to;
        self.next = to;
        self.running = false;
    }

    /// Looks at the bytes that have come, until something is decided.
    pub fn advance(&mut self, input: &Input, context: &Context<'_>, silence: Ns) -> Option<Told> {
        if !self.running {
            self.join.restart(self.told());
            self.next = self.told();
            self.nodes[0].wake = self.told() + SHORTEST_DAMAGED;
            self.model.settle();
            (self.wake, self.calm, self.cleared, self.threat) = (self.nodes[0].wake, 0, 0, None);
            self.short = false;
            self.running = true;
        }
        if std::mem::take(&mut self.short) {
            let told = self.decide(input, context, false);
            if told.is_some() || self.short {
                return told;
            }
        }
        let base = input.offset();
        let end = base + input.bytes().len() as u64;
        let mut read_end = self.next;
        while self.next < end {
            let index = (self.next - base) as usize;
            if self.next == read_end {
                if self.next > self.told() && input.hard_edge(index) {
                    if let Some(told) = self.decide(input, context, true) {
                        return Some(told);
                    }
                    self.join.restart(self.next);
                }
                read_end = input.read(index).map_or(end, |read| read.end);
            }
            // Up to here nothing happens, unless a valid substring ends.
            let quiet = end.min(read_end).min(self.wake.min(self.calm).max(self.next + 1));
            let mut found = std::mem::take(&mut self.found);
            let bytes = &input.bytes()[index..(quiet - base) as usize];
            self.next += self.join.scan(self.next, bytes, &mut found) as u64;
            let before = self.nodes.len();
            let floor = if found.is_empty() { 0.0 } else { self.floor() };
            for &start in &found {
                self.consider(input, context, start, silence, floor);
            }
            if self.next >= self.wake {
                self.suppose(input, context, silence, found.is_empty());
            }
            self.found = found;
            if self.nodes.len() > before {
                self.calm = 0;
            }
            if self.next >= self.calm {
                let told = self.decide(input, context, false);
                if told.is_some() || self.short {
                    return told;
                }
            }
        }
        // What begins no frame may be one whose end the adapter still holds back.
        let over = input.closed || (input.paused && self.nodes[self.best().0].first != 0);
        if over && self.next > self.told() {
            return self.decide(input, context, true);
        }
        None
    }

    /// Adds the readings of a substring with a right CRC that ends here.
    fn consider(&mut self, input: &Input, context: &Context<'_>, start: u64, silence: Ns, floor: f32) {
        if start < self.told() {
            return;
        }
        let (from, to) = ((start - input.offset()) as usize, (self.next - input.offset()) as usize);
        let frame = &input.bytes()[from..to];
        if gain::is_none(frame) {
            return;
        }
        let held = if self.may_hold(context, frame) { self.held(start) } else { Vec::new() };
        let timing = timing(input, from, to, silence);
        let said = context.said_at(input, from);
        let pause = (context.pause)(input.pause_before(from));
        for direction in [REQUEST, RESPONSE] {
            let Some(own) = gain::frame(&self.model, context, frame, direction) else { continue };
            let told = match said {
                Some(said) if said == gain::direction(direction) => 0.0,
                Some(_) if context.speaker.is_some() => costs::WRONG_LINE,
                Some(_) => costs::BROKEN_RULE,
                None => 0.0,
            };
            // A request is a state of its own, whatever was before; a response leaves or clears the request that waits.
            let mut best: [Option<(f32, usize, f32)>; 2] = [None, None];
            let nobody = self.nodes.iter().any(|node| node.pending.asked.is_none());
            let begun = if direction == RESPONSE && nobody && self.model.has_seen(frame[0], frame[1]) {
                begun(input, from, frame)
            } else {
                None
            };
            // Most readings have the same request waiting.
            let mut known = None;
            for (i, node) in self.nodes.iter().enumerate().filter(|(_, node)| node.end <= start) {
                let junk = start - node.end;
                let strays = (1..costs::MAY_HOLD_A_FRAME).contains(&junk);
                let begun = begun.is_some_and(|place| place >= node.end);
                let key = (node.pending, junk >= costs::MAY_HOLD_A_FRAME, begun);
                let (around, answered) = match known {
                    Some((before, worth)) if before == key && !strays => worth,
                    _ => {
                        let open = self.requests.open(node.pending);
                        // Strays on a line that is silent otherwise do not make the silence shorter.
                        let strays = strays && node.end >= input.offset();
                        let pause = if strays { (context.pause)(input.quiet_since(node.end, from)) } else { pause };
                        gain::context(&self.model, context, open, frame, direction, pause, (junk, begun))
                    }
                };
                known = (!strays).then_some((key, (around, answered)));
                let gain = own + timing - told + around;
                let inside = held.get(i).copied().unwrap_or(0.0);
                let score = node.score - self.model.between(start - node.end) + gain + inside;
                let slot = &mut best[usize::from(answered)];
                if score > floor && slot.is_none_or(|(known, ..)| score > known) {
                    *slot = Some((score, i, gain));
                }
            }
            for (answered, found) in best.into_iter().enumerate() {
                let Some((score, parent, gain)) = found else { continue };
                let answers = answered == 1;
                self.make_room();
                let pending = self.requests.after(self.nodes[parent].pending, frame, direction, answers, true);
                self.push(Node { direction, score, gain, parent, answers, pending, ..self.node(start) });
            }
        }
    }

    /// A frame from there to here, of which nothing else is known yet.
    fn node(&self, start: u64) -> Node {
        Node {
            start,
            end: self.next,
            direction: REQUEST,
            score: 0.0,
            gain: 0.0,
            parent: 0,
            first: 0,
            wake: self.next + SHORTEST_DAMAGED,
            answers: false,
            whole: true,
            pending: Pending::default(),
        }
    }

    fn push(&mut self, node: Node) {
        let first = if node.parent == 0 { self.nodes.len() } else { self.nodes[node.parent].first };
        self.wake = self.wake.min(node.wake);
        self.nodes.push(Node { first, ..node });
    }

    /// Adds frames with a wrong checksum that begin right behind another one and have just the length they announce.
    ///
    /// Nothing is added where a frame with a right checksum ends (`alone` is false).
    fn suppose(&mut self, input: &Input, context: &Context<'_>, silence: Ns, alone: bool) {
        self.wake = u64::MAX;
        for parent in 0..self.nodes.len() {
            if self.nodes[parent].wake <= self.next {
                self.nodes[parent].wake = self.suppose_behind(input, context, parent, silence, alone);
            }
            self.wake = self.wake.min(self.nodes[parent].wake);
        }
    }

    /// The same behind one frame; says where it is to be looked for next.
    fn suppose_behind(&mut self, input: &Input, context: &Context<'_>, parent: usize, silence: Ns, alone: bool) -> u64 {
        let start = self.nodes[parent].end;
        let length = self.next - start;
        if start < input.offset() || length > REACH {
            return u64::MAX;
        }
        if length < SHORTEST_DAMAGED {
            return start + SHORTEST_DAMAGED;
        }
        let from = (start - input.offset()) as usize;
        let frame = &input.bytes()[from..from + length as usize];
        let mut wake = u64::MAX;
        for (way, extent) in announced(context, frame).into_iter().flatten() {
            let direction = if way == Direction::Response { RESPONSE } else { REQUEST };
            match extent {
                Extent::Exactly(announced) if announced == frame.len() => {
                    // Where bytes come one by one, a frame that lost some ends at a pause before it has its length.
                    let paused = !input.coarse && input.edge_after(from, from + frame.len() - 1, silence).is_some();
                    let damaged = alone && !paused && frame[1] & EXCEPTION_BIT == 0;
                    let asked = self.nodes[parent].pending.asked.filter(|_| damaged).map(|slot| self.requests.get(slot));
                    let gain = if damaged { gain::damaged(&self.model, context, asked, frame, direction) } else { None };
                    if let Some(gain) = gain {
                        let score = self.nodes[parent].score + gain;
                        let answers = direction == RESPONSE;
                        self.make_room();
                        let pending = self.requests.after(self.nodes[parent].pending, frame, direction, answers, false);
                        self.push(Node { direction, score, gain, parent, answers, whole: false, pending, ..self.node(start) });
                    }
                }
                Extent::Exactly(announced) | Extent::AtLeast(announced) if announced > frame.len() => {
                    wake = wake.min(start + announced as u64);
                }
                Extent::AtLeast(_) => wake = wake.min(self.next + 1),
                Extent::Exactly(_) | Extent::Open(_) => {}
            }
        }
        wake
    }
}

/// Where unit and function of a frame last stand among the bytes before it: perhaps its request was damaged.
fn begun(input: &Input, from: usize, frame: &[u8]) -> Option<u64> {
    let function = frame[1] & !EXCEPTION_BIT;
    let first = from.saturating_sub(REACH as usize);
    let before = &input.bytes()[first..from];
    let mut units = memchr::memrchr_iter(frame[0], before);
    let place = units.find(|&place| before.get(place + 1) == Some(&function))?;
    Some(input.offset() + (first + place) as u64)
}

/// Learns from a frame that is certain.
fn learn(model: &mut Model, context: &Context<'_>, frame: &[u8], direction: usize, setting: Setting, copy: Copy, sure: bool) {
    model.learn(frame, direction, setting, copy);
    let (code, body) = (frame[1], &frame[2..frame.len() - 2]);
    if sure && code & EXCEPTION_BIT == 0 {
        let row = context.functions.row(code, body);
        let layout = row.map(|row| if direction == REQUEST { &row.request } else { &row.response });
        if layout.is_none_or(|layout| *layout == Layout::Unknown) {
            model.learn_length(code, direction, body);
        }
    }
}

/// Bits that pauses and record boundaries give or take.
fn timing(input: &Input, from: usize, to: usize, silence: Ns) -> f32 {
    let paused = input.pause_before(from).is_some_and(|pause| pause >= silence);
    let before = if paused || input.read(from).is_some_and(|read| read.record && input.starts_read(from)) {
        costs::PAUSE_BEFORE
    } else {
        0.0
    };
    let inside = if input.edge_after(from, to - 1, silence).is_some() { costs::PAUSE_INSIDE } else { 0.0 };
    before - inside
}

/// What a request is to the one before. Where the answer may be an echo, nothing is learned.
fn copy(context: &Context<'_>, frame: &[u8], again: bool) -> Copy {
    let row = context.functions.row(frame[1] & !EXCEPTION_BIT, &frame[2..]);
    match row {
        Some(row) if !row.mirrored => {
            if again {
                Copy::Again
            } else {
                Copy::First
            }
        }
        _ => Copy::Unclear,
    }
}
