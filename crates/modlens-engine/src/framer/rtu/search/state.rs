//! The best path through the bytes: frames and what lies between them, scored in bits.
//!
//! Nodes stand at ends of frames only. What lies between two frames costs the same however it is read, so nothing has
//! to be kept for single bytes. A frame is told once no rival reading within `THETA` bits is left without it.

mod ahead;
mod decide;
mod holds;
mod paths;
mod readings;

use crate::framer::rtu::certain::{answer, Length};
use crate::framer::rtu::gain::{self, REQUEST, RESPONSE};
use crate::framer::rtu::join::Join;
use crate::framer::rtu::model::{Copy, Model, Setting};
use crate::framer::rtu::pending::{Open, Pending, Request, Requests};
use crate::framer::rtu::search::paths::Node;
use crate::framer::Context;
use crate::input::Input;
use modlens_protocol::direction::{self, Asked, Direction, Match};
use modlens_protocol::functions::{Layout, EXCEPTION_BIT};
use modlens_protocol::Ns;

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
