//! The input of a session, bytes and time, and when it decides what they are.

use crate::session::answer_order::answers_previous;
use crate::session::decoder::Decoder;
use modlens_protocol::Ns;
use modlens_readers::chunk::Chunk;

impl Decoder {
    /// Takes bytes of one line of a bus, lets time advance on the bus to that of the chunk, and emits the frames that can be
    /// decided by now. Without a time, only the bytes are decided.
    pub(super) fn feed(&mut self, bus: usize, chunk: &Chunk<'_>) {
        let time = self.buffer_chunk(bus, chunk);
        if let Some(time) = time {
            self.buses[bus].advance_silence(time);
        }
        self.decide(bus, time);
    }

    /// Takes bytes of one line of a bus, but in a recording may leave them undecided until `decide_waiting` is called: the
    /// fast path wants the records of a request and of its response together. At most one bus has undecided bytes, so those
    /// of another bus are decided first.
    ///
    /// In a live session, and where the chunk would change how the bytes before it are decided (`may_wait`), these are
    /// decided first, and then those of the chunk at once.
    #[inline]
    pub(super) fn feed_later(&mut self, bus: usize, chunk: &Chunk<'_>) {
        self.end_messages();
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

    /// Decides the bytes that `feed_later` has left undecided, if there are any, as of the last chunk's time; and a request that
    /// is in hand for its response.
    pub(crate) fn decide_waiting(&mut self) {
        self.end_messages();
        if let Some(bus) = self.waiting.take() {
            self.decide(bus, self.buses[bus].newest);
        }
    }

    /// Emits the frames in the bytes of a bus, and lets its requests time out up to `time`, or not at all without a clock.
    pub(crate) fn decide(&mut self, bus: usize, time: Option<Ns>) {
        self.emit_frames(bus);
        if let Some(time) = time {
            self.advance_pairing(bus, time);
        }
    }

    /// Appends the bytes of a chunk to the input of its line, which is added if it is new, and notes the time of the chunk,
    /// which it gives back: that of its last byte, or `None` without a clock. Frames in these bytes are not decided here;
    /// what lies before the chunk may be (`decide_before`).
    ///
    /// The first chunk with a time sets the beginning of the recording, unless the source has.
    #[inline]
    fn buffer_chunk(&mut self, bus: usize, chunk: &Chunk<'_>) -> Option<Ns> {
        let time = chunk.time();
        self.decide_before(bus, chunk, time);
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
            let start = time - chunk.bytes.len() as Ns * char_ns;
            self.origin.get_or_insert(start);
        }
        time
    }

    /// Decides what is known before a chunk comes: all that is open on a serial bus if the tap was away, and, in a live
    /// session, everything on all buses that time alone decides up to just before `time`, that of the chunk.
    ///
    /// A hole on a serial line means that the tap was away: no response to an open request will come. (A connection goes on
    /// after lost segments.) If bytes follow the hole, it is unknown when the tap went away, so the bus is flushed before
    /// time advances. A chunk without bytes says that the tap goes away at this moment, so it is flushed afterwards.
    #[inline]
    fn decide_before(&mut self, bus: usize, chunk: &Chunk<'_>, time: Option<Ns>) {
        let tap_was_away = chunk.follows_loss && self.buses[bus].options.bus.network.is_none();
        if tap_was_away && !chunk.bytes.is_empty() {
            self.flush_bus(bus);
        }
        if let Some(time) = time.filter(|_| self.live) {
            // Not at `time` itself, so that the result does not depend on earlier polls.
            self.poll(time - 1);
        }
        if tap_was_away {
            self.flush_bus(bus);
        }
    }

    /// Lets time advance to `now` on all buses without bytes, in a live session: silences end frames, open requests time out,
    /// and lines stop waiting for each other.
    ///
    /// Several buses are advanced deadline by deadline, the earliest first. Otherwise the numbers of rows would depend on how
    /// often a session is polled. A deadline that stays though its bus has been advanced to it ends this, since it would never
    /// get further. At last, every bus is advanced to `now`.
    pub(super) fn poll(&mut self, now: Ns) {
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

    /// Lets time advance to `now` on one bus, and emits what that decides.
    fn advance_bus(&mut self, bus: usize, now: Ns) {
        self.buses[bus].advance_silence(now);
        self.emit_frames(bus);
        self.advance_pairing(bus, now);
    }

    /// Decides everything that is still open on the buses that this selects.
    pub(super) fn flush_all(&mut self, selects: impl Fn(usize) -> bool) {
        for bus in self.open.iter().copied().filter(|&bus| selects(bus)).collect::<Vec<_>>() {
            self.flush_bus(bus);
        }
    }

    /// Decides everything that is still open on one bus: its recording ends, or a part of it is missing from here on. All
    /// bytes become frames or noise, and all open requests are closed. The bus goes on as usual if further bytes are fed.
    pub(super) fn flush_bus(&mut self, bus: usize) {
        for (_, line) in &mut self.buses[bus].lines {
            (line.input.is_closed, line.input.is_ended) = (true, true);
        }
        self.emit_frames(bus);
        self.buses[bus].pairing.finish(&mut self.done);
        self.emit_transactions(bus);
        self.find_on_line(bus);
    }

    /// Lets the requests of a bus time out up to `now`. Bytes that are not framed yet may be a response, so time advances
    /// only up to the first of them.
    ///
    /// Only in a live session does a timeout close a transaction, which is emitted here; in a recording the request is
    /// marked.
    pub(crate) fn advance_pairing(&mut self, bus: usize, now: Ns) {
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
            let waiting = self.buses[bus].waiting.take().map(|(at, framed, waiting)| {
                adu = waiting;
                (at, framed)
            });
            if waiting.is_none() {
                self.emit_exchanges(bus);
            }
            let next = waiting.or_else(|| self.buses[bus].next_frame(&self.functions, self.live, &mut adu));
            let Some((at, framed)) = next else { break };
            if !self.live && self.buses[bus].lines.len() == 1 {
                let state = &mut self.buses[bus];
                let input = &state.lines[at].1.input;
                let Some(answers_previous) = answers_previous(&self.functions, &state.pairing, input, (&framed, &adu)) else {
                    state.waiting = Some((at, framed, adu.clone()));
                    break;
                };
                state.pairing.next_answers_previous = answers_previous;
            }
            self.emit_frame(bus, at, &framed, &adu);
        }
        self.adu = adu;
    }
}
