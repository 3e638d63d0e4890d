//! The input of a session, bytes and time, and when it decides what they are.

use crate::session::Session;
use modlens_protocol::Ns;
use modlens_readers::chunk::Chunk;

impl Session {
    /// Takes bytes of one line of a bus and emits the frames that they complete.
    pub fn feed(&mut self, bus: usize, chunk: &Chunk<'_>) {
        let time = self.buffer_chunk(bus, chunk);
        if let Some(time) = time {
            self.buses[bus].advance_silence(time);
        }
        self.decide(bus, time);
    }

    /// Takes bytes of one line of a bus, but may leave them undecided until `decide_waiting` is called: the fast path
    /// wants the records of a request and of its response together.
    ///
    /// A chunk that changes how the bytes before it are decided has them decided first.
    pub(super) fn feed_later(&mut self, bus: usize, chunk: &Chunk<'_>) {
        if self.waiting.is_some_and(|waiting| waiting != bus) {
            self.decide_waiting();
        }
        if self.live || !self.buses[bus].may_wait(chunk) {
            self.decide_waiting();
            self.feed(bus, chunk);
        } else {
            self.buffer_chunk(bus, chunk);
            self.waiting = Some(bus);
        }
    }

    /// Decides the bytes that `feed_later` has left undecided.
    pub(super) fn decide_waiting(&mut self) {
        if let Some(bus) = self.waiting.take() {
            self.decide(bus, self.buses[bus].newest);
        }
    }

    /// Emits the frames in the bytes of a bus, and lets its requests time out up to `time`.
    pub(super) fn decide(&mut self, bus: usize, time: Option<Ns>) {
        self.emit_frames(bus);
        if let Some(time) = time {
            self.advance_pairing(bus, time);
        }
    }

    /// Appends the bytes of a chunk to the input of its line; gives the time of the chunk.
    fn buffer_chunk(&mut self, bus: usize, chunk: &Chunk<'_>) -> Option<Ns> {
        let time = chunk.time();
        // A hole on a serial line means that the tap was away: no response to an open request will come. A connection goes
        // on behind lost segments.
        let tap_was_away = chunk.follows_loss && self.buses[bus].options.bus.network.is_none();
        // If bytes follow, it is unknown when the tap went away, so the bus is flushed before time advances. A chunk
        // without bytes says that the tap goes away at this moment.
        if tap_was_away && !chunk.bytes.is_empty() {
            self.flush_bus(bus);
        }
        if let Some(time) = time.filter(|_| self.live) {
            // Everything that time alone decides is decided now, so that the result does not depend on earlier polls.
            self.poll(time - 1);
        }
        if tap_was_away {
            self.flush_bus(bus);
        }
        let state = &mut self.buses[bus];
        let line = state.line_for(chunk);
        line.input.push(chunk);
        if let Some(unmerged) = &mut line.unmerged {
            unmerged.input.push(chunk);
        }
        if let Some(time) = time {
            state.clock_jumped |= state.newest.is_some_and(|newest| time < newest);
            state.newest = Some(time);
            state.latest = state.latest.max(Some(time));
            let char_ns = state.options.line.map_or(0, |line| line.char_ns());
            let first = time - chunk.bytes.len() as Ns * char_ns;
            self.origin.get_or_insert(first);
        }
        time
    }

    /// Lets time advance to `now` without bytes: silences end frames, and open requests time out.
    ///
    /// Buses are taken in the order of their deadlines. Otherwise the numbers of rows would depend on how often a session
    /// with several buses is polled.
    pub fn poll(&mut self, now: Ns) {
        while self.buses.len() > 1 {
            let due = self.buses.iter().enumerate().filter_map(|(bus, state)| Some((state.deadline()?, bus))).min();
            let Some((deadline, bus)) = due.filter(|(deadline, _)| *deadline <= now) else { break };
            self.advance_bus(bus, deadline);
            if self.buses[bus].deadline() == Some(deadline) {
                break;
            }
        }
        for bus in 0..self.buses.len() {
            self.advance_bus(bus, now);
        }
    }

    fn advance_bus(&mut self, bus: usize, now: Ns) {
        self.buses[bus].advance_silence(now);
        self.emit_frames(bus);
        self.advance_pairing(bus, now);
    }

    /// Decides everything that is still open, at the end of the recording.
    pub fn flush(&mut self) {
        for bus in 0..self.buses.len() {
            self.flush_bus(bus);
        }
    }

    /// Decides everything that is still open at the end of a file, but for raw recordings, which may go on in the next
    /// file.
    pub fn flush_file(&mut self) {
        let may_go_on = |bus: &usize| self.recorded.iter().any(|(_, recorded)| recorded == bus);
        for bus in (0..self.buses.len()).filter(|bus| !may_go_on(bus)).collect::<Vec<_>>() {
            self.flush_bus(bus);
        }
    }

    /// Decides everything that is still open on one bus: its recording ends, or a part of it is missing from here on.
    pub fn flush_bus(&mut self, bus: usize) {
        for (_, line) in &mut self.buses[bus].lines {
            (line.input.is_closed, line.input.is_ended) = (true, true);
        }
        self.emit_frames(bus);
        self.buses[bus].pairing.finish(&mut self.done);
        self.emit_transactions(bus);
    }

    /// Lets the requests of a bus time out. Bytes that are not framed yet may be a response, so time advances only up to
    /// the first of them.
    fn advance_pairing(&mut self, bus: usize, now: Ns) {
        let state = &mut self.buses[bus];
        let unframed_since = state.lines.iter().filter_map(|(_, line)| line.input.byte_time(0)).min();
        state.pairing.advance_time(unframed_since.map_or(now, |first| first.min(now)), &mut self.done);
        if !self.done.is_empty() {
            self.emit_transactions(bus);
        }
    }

    /// Emits all frames of a bus that can be decided, on the fast path as far as it goes and frame by frame where it does
    /// not.
    pub(super) fn emit_frames(&mut self, bus: usize) {
        let mut adu = std::mem::take(&mut self.adu);
        loop {
            self.emit_exchanges(bus);
            let Some((at, framed)) = self.buses[bus].next_frame(&self.functions, self.live, &mut adu) else { break };
            self.emit_frame(bus, at, &framed, &adu);
        }
        self.adu = adu;
    }
}
