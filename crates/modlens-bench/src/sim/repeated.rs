//! Lines on which the same requests are sent again and again: set-points, watchdogs, heartbeats, polls of a dead unit.
//!
//! The response to such a write has the same bytes, so only times and habits tell it from the same request again. Where
//! neither does, the truth says that the recording does not decide (`undecided`).

use crate::rng::Rng;
use crate::sim::reads::{self, address, body};
use crate::sim::slave::{PollItem, Slave};

/// Functions whose response repeats the request (application protocol, 6.5, 6.6, 6.8 and 6.16).
pub(crate) const MIRRORED_FUNCTIONS: [u8; 4] = [5, 6, 8, 22];

/// A fixed cycle of requests, which replaces the random traffic of the other scenarios.
#[derive(Clone, Debug)]
pub struct Repeated {
    /// Writes with constant content, to a unit each.
    pub writes: usize,
    /// Each write is sent twice in succession.
    pub are_doubled: bool,
    /// Polls, to units of their own.
    pub polls: usize,
    /// The typical silence before a request, in ms.
    pub pause_ms: f64,
    /// The typical response time, in ms.
    pub response_ms: f64,
    /// The units of the writes are silent from this share of the recording on.
    pub writes_die_at: f64,
    /// The unit of the first poll is silent from this share of the recording on.
    pub poll_dies_at: f64,
    /// How often the master repeats a request without response.
    pub retries: usize,
    /// Share of responses that arrive damaged.
    pub damaged: f64,
}

/// One constant write that is always answered.
pub(crate) const WRITE: Repeated = Repeated {
    writes: 1,
    are_doubled: false,
    polls: 0,
    pause_ms: 100.0,
    response_ms: 6.0,
    writes_die_at: 1.0,
    poll_dies_at: 1.0,
    retries: 0,
    damaged: 0.0,
};

/// Two constant writes among twenty polls.
pub(crate) const MIXED: Repeated = Repeated { writes: 2, polls: 20, pause_ms: 12.0, ..WRITE };

impl Repeated {
    /// The cycle: polls with the writes spread among them. Each write has a slave of its own, the first ones; each three polls
    /// share one.
    pub(crate) fn cycle(&self, slaves: &[Slave], rng: &mut Rng) -> Vec<PollItem> {
        let first = rng.below(MIRRORED_FUNCTIONS.len());
        let writes = (0..self.writes).map(|at| {
            let pdu = constant_write(MIRRORED_FUNCTIONS[(first + at) % MIRRORED_FUNCTIONS.len()], rng);
            PollItem { slave: at, pdu }
        });
        let mut cycle: Vec<PollItem> = writes.collect();
        for at in 0..self.polls {
            let slave = self.writes + at / 3;
            let function = [1, 2, 3, 4][rng.weighted(&[10, 10, 55, 25])];
            cycle.push(PollItem { slave, pdu: reads::read(function, &slaves[slave], rng) });
        }
        if self.are_doubled {
            cycle.insert(0, cycle[0].clone());
        }
        if self.writes == 2 {
            let second = cycle.remove(1);
            cycle.insert(cycle.len() / 2, second);
        }
        cycle
    }

    /// How many slaves the cycle needs.
    pub(crate) fn slaves(&self) -> usize {
        self.writes + self.polls.div_ceil(3)
    }

    /// Whether this slave is dead where this share of the recording is over.
    pub(crate) fn is_dead(&self, slave: Option<usize>, share: f64) -> bool {
        let is_write = slave.is_some_and(|slave| slave < self.writes);
        let is_first_poll = slave == Some(self.writes);
        (is_write && share >= self.writes_die_at) || (is_first_poll && share >= self.poll_dies_at)
    }
}

fn constant_write(function: u8, rng: &mut Rng) -> Vec<u8> {
    match function {
        5 => body(5, &[address(rng), rng.pick(&[0, 0xFF00])]),
        8 => body(8, &[0, rng.bits() as u16]),
        22 => body(22, &[address(rng), rng.bits() as u16, rng.bits() as u16]),
        _ => body(6, &[address(rng), rng.bits() as u16]),
    }
}
