//! The blocks that clients have not got yet: one bounded queue for all of them.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use modlens_pcapng::recording::{self, PortRead};
use modlens_protocol::Ns;

use crate::feed::ReadSink;
use crate::segments::{new_session, RecordedPort};
use crate::writer::{describe, Block};

/// What a queued block counts towards the limit beside its bytes.
const BLOCK_OVERHEAD_BYTES: usize = 96;

/// What is written to a client at once, or a single block.
const WRITE_BYTES: usize = 1 << 16;

/// A queued block.
struct Queued {
    block: Block,
    /// Ports that were described before it.
    ports: usize,
    /// Bytes of the line in all blocks before it.
    line_bytes_before: u64,
    /// It describes a port.
    describes_port: bool,
}

#[derive(Default)]
struct State {
    ports: Vec<RecordedPort>,
    /// The interface block of each port.
    descriptions: Vec<Vec<u8>>,
    queue: VecDeque<Queued>,
    /// The number of the oldest block in the queue.
    first: u64,
    /// The memory of the queue in bytes.
    size: usize,
    line_bytes: u64,
    clients: usize,
    /// All reads before this time are queued.
    time: Ns,
}

/// The queue that readers of ports fill and clients read.
pub struct Hub {
    state: Mutex<State>,
    application: String,
    session: String,
    /// The most memory of the queue in bytes.
    limit: usize,
}

/// How far a client has come.
#[derive(Clone, Copy, Debug, Default)]
pub struct Position {
    /// The number of its next block.
    next: u64,
    /// Ports whose descriptions it has.
    ports: usize,
    /// Bytes of the line in all blocks before its next one.
    line_bytes: u64,
    /// Bytes of the line that it did not get, because it was too slow.
    pub lost: u64,
}

impl Hub {
    pub fn new(application: String, limit: usize) -> Self {
        Self { state: Mutex::default(), application, session: new_session(), limit }
    }

    /// Adds a client, whose stream begins with the header and the description of each port.
    pub fn join(&self, out: &mut Vec<u8>) -> Position {
        let mut state = self.state();
        state.clients += 1;
        recording::head(&self.application, &self.session, 1, out);
        state.descriptions.iter().for_each(|description| out.extend_from_slice(description));
        let next = state.first + state.queue.len() as u64;
        Position { next, ports: state.descriptions.len(), line_bytes: state.line_bytes, lost: 0 }
    }

    /// Removes a client. Without clients nothing is queued.
    pub fn leave(&self) {
        let mut state = self.state();
        state.clients -= 1;
        if state.clients == 0 {
            state.first += state.queue.len() as u64;
            state.queue.clear();
            state.size = 0;
        }
    }

    /// Appends the next blocks of a client. A client that has missed some gets, for each port, the mark of a loss first.
    pub fn read(&self, position: &mut Position, out: &mut Vec<u8>) {
        let state = self.state();
        if position.next < state.first {
            let Some(oldest) = state.queue.front() else { return };
            position.lost += oldest.line_bytes_before - position.line_bytes;
            position.next = state.first;
            let missed = position.ports..oldest.ports;
            state.descriptions[missed].iter().for_each(|description| out.extend_from_slice(description));
            position.ports = oldest.ports;
            let time = state.queue.iter().find(|queued| !queued.describes_port).map_or(state.time, |queued| queued.block.time);
            let hole = PortRead { time, hole: true, ..PortRead::default() };
            (0..oldest.ports as u32).for_each(|port| recording::read(port, &hole, out));
        }
        let begun = out.len();
        for queued in state.queue.range((position.next - state.first) as usize..) {
            if out.len() > begun && out.len() - begun + queued.block.bytes.len() > WRITE_BYTES {
                break;
            }
            out.extend_from_slice(&queued.block.bytes);
            position.next += 1;
            position.line_bytes = queued.line_bytes_before + queued.block.line_bytes;
            position.ports = queued.ports + usize::from(queued.describes_port);
        }
    }

    /// Appends an empty packet for each port that a client has, which only says how far time has advanced.
    pub fn beat(&self, position: &Position, out: &mut Vec<u8>) {
        let state = self.state();
        if state.time > 0 {
            (0..position.ports as u32).for_each(|port| recording::time(port, state.time, out));
        }
    }

    /// Whether a client has everything.
    pub fn is_at_end(&self, position: &Position) -> bool {
        let state = self.state();
        position.next == state.first + state.queue.len() as u64
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn push(&self, state: &mut State, block: Block, describes_port: bool) {
        let ports = state.ports.len() - usize::from(describes_port);
        let line_bytes_before = state.line_bytes;
        state.line_bytes += block.line_bytes;
        if state.clients == 0 {
            state.first += 1;
            return;
        }
        state.size += cost_of(&block);
        state.queue.push_back(Queued { block, ports, line_bytes_before, describes_port });
        while state.size > self.limit {
            let Some(oldest) = state.queue.pop_front() else { break };
            state.size -= cost_of(&oldest.block);
            state.first += 1;
        }
    }
}

fn cost_of(block: &Block) -> usize {
    block.bytes.len() + BLOCK_OVERHEAD_BYTES
}

impl ReadSink for Hub {
    fn add_port(&self, port: RecordedPort) -> u32 {
        let mut state = self.state();
        let mut bytes = Vec::new();
        describe(&port, &state.ports, &mut bytes);
        state.ports.push(port);
        state.descriptions.push(bytes.clone());
        self.push(&mut state, Block { bytes, ..Block::default() }, true);
        state.ports.len() as u32 - 1
    }

    fn write(&self, port: u32, read: &PortRead<'_>) {
        self.push(&mut self.state(), Block::of(port, read), false);
    }

    fn mark_clock_step(&self, port: u32, time: Ns, step: Ns) {
        self.push(&mut self.state(), Block::of_clock_step(port, time, step), false);
    }

    fn advance(&self, time: Ns) {
        self.state().time = time;
    }
}
