//! Bytes and time in: what is decided when.

use crate::session::Session;
use modlens_protocol::Ns;
use modlens_readers::chunk::Chunk;

impl Session {
    /// Bytes of one line of a bus.
    pub fn feed(&mut self, bus: usize, chunk: &Chunk<'_>) {
        let time = self.take_in(bus, chunk);
        if let Some(time) = time {
            self.buses[bus].close_silent_lines(time);
        }
        self.decide(bus, time);
    }

    /// The same, but what they are may be decided later, with more of them: when `decide_waiting` is called at the latest.
    ///
    /// Whatever changes how earlier bytes are looked at has them decided first.
    pub(super) fn feed_later(&mut self, bus: usize, chunk: &Chunk<'_>) {
        if self.waiting.is_some_and(|waiting| waiting != bus) {
            self.decide_waiting();
        }
        if self.live || !self.buses[bus].may_wait(chunk) {
            self.decide_waiting();
            self.feed(bus, chunk);
        } else {
            self.take_in(bus, chunk);
            self.waiting = Some(bus);
        }
    }

    /// Decides what waits to be decided.
    pub(super) fn decide_waiting(&mut self) {
        if let Some(bus) = self.waiting.take() {
            self.decide(bus, self.buses[bus].newest);
        }
    }

    /// Decides what the bytes are that have come on a bus up to this time, as far as it can be.
    pub(super) fn decide(&mut self, bus: usize, time: Option<Ns>) {
        self.frames_of(bus);
        if let Some(time) = time {
            self.tick(bus, time);
        }
    }

    /// Takes the bytes of a chunk; gives its time.
    fn take_in(&mut self, bus: usize, chunk: &Chunk<'_>) -> Option<Ns> {
        let time = chunk.time();
        // Where the tap was away, nothing that is open gets an answer; a connection goes on behind lost segments.
        let away = chunk.hole && self.buses[bus].options.bus.network.is_none();
        // Nobody knows since when bytes were missing before others; without any, the tap goes away now.
        if away && !chunk.bytes.is_empty() {
            self.flush_bus(bus);
        }
        if let Some(time) = time.filter(|_| self.live) {
            // Whether anybody has polled in the meantime must not matter: what time alone decides is decided now.
            self.poll(time - 1);
        }
        if away {
            self.flush_bus(bus);
        }
        let state = &mut self.buses[bus];
        let line = state.line_for(chunk);
        line.input.push(chunk);
        if let Some(ahead) = &mut line.ahead {
            ahead.input.push(chunk);
        }
        if let Some(time) = time {
            state.jumped |= state.newest.is_some_and(|newest| time < newest);
            state.newest = Some(time);
            state.latest = state.latest.max(Some(time));
            let char_ns = state.options.line.map_or(0, |line| line.char_ns());
            let first = time - chunk.bytes.len() as Ns * char_ns;
            self.origin.get_or_insert(first);
        }
        time
    }

    /// Time goes on without bytes: ends silences and time-outs.
    pub fn poll(&mut self, now: Ns) {
        // In their order, or the numbers of rows of several buses would depend on when somebody polls.
        while self.buses.len() > 1 {
            let due = self.buses.iter().enumerate().filter_map(|(bus, state)| Some((state.deadline()?, bus))).min();
            let Some((deadline, bus)) = due.filter(|(deadline, _)| *deadline <= now) else { break };
            self.pass(bus, deadline);
            if self.buses[bus].deadline() == Some(deadline) {
                break;
            }
        }
        for bus in 0..self.buses.len() {
            self.pass(bus, now);
        }
    }

    fn pass(&mut self, bus: usize, now: Ns) {
        self.buses[bus].close_silent_lines(now);
        self.frames_of(bus);
        self.tick(bus, now);
    }

    /// The recording is over: decides everything that is still open.
    pub fn flush(&mut self) {
        for bus in 0..self.buses.len() {
            self.flush_bus(bus);
        }
    }

    /// A file is over: the raw recordings in it may go on in the next one.
    pub fn flush_file(&mut self) {
        for bus in (0..self.buses.len()).filter(|bus| self.recorded.iter().all(|(_, other)| other != bus)).collect::<Vec<_>>() {
            self.flush_bus(bus);
        }
    }

    /// The recording of one bus is over, or a part of it is missing from here on.
    pub fn flush_bus(&mut self, bus: usize) {
        for (_, line) in &mut self.buses[bus].lines {
            (line.input.closed, line.input.ended) = (true, true);
        }
        self.frames_of(bus);
        let mut done = std::mem::take(&mut self.done);
        self.buses[bus].pairing.finish(&mut done);
        self.done = done;
        self.write_done(bus);
    }

    fn tick(&mut self, bus: usize, now: Ns) {
        let mut done = std::mem::take(&mut self.done);
        let state = &mut self.buses[bus];
        // Bytes that are not framed yet may be the answer: time has come only to the first of them.
        let undecided = state.lines.iter().filter_map(|(_, line)| line.input.byte_time(0)).min();
        state.pairing.tick(undecided.map_or(now, |first| first.min(now)), &mut done);
        self.done = done;
        if !self.done.is_empty() {
            self.write_done(bus);
        }
    }

    pub(super) fn frames_of(&mut self, bus: usize) {
        let mut adu = std::mem::take(&mut self.adu);
        loop {
            self.routine(bus);
            let Some((at, cut)) = self.buses[bus].next_cut(&self.functions, self.live, &mut adu) else { break };
            self.frame(bus, at, &cut, &adu);
        }
        self.adu = adu;
    }
}
