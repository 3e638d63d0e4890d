//! What the bytes may be: frames with a right checksum, and damaged ones of the right length, each behind every path that
//! ends before it.

use crate::framer::rtu::announced_length::announced;
use crate::framer::rtu::costs;
use crate::framer::rtu::gain::{self, REQUEST, RESPONSE};
use crate::framer::rtu::join::REACH;
use crate::framer::rtu::pending::Pending;
use crate::framer::rtu::search::paths::Node;
use crate::framer::rtu::search::{Search, SHORTEST_DAMAGED};
use crate::framer::Context;
use crate::input::Input;
use modlens_protocol::direction::Direction;
use modlens_protocol::functions::{Extent, EXCEPTION_BIT};
use modlens_protocol::Ns;

impl Search {
    /// Adds the readings of a substring with a right CRC that ends here.
    pub(super) fn consider(&mut self, input: &Input, context: &Context<'_>, start: u64, silence: Ns, floor: f32) {
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
    pub(super) fn suppose(&mut self, input: &Input, context: &Context<'_>, silence: Ns, alone: bool) {
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
