//! Lines on which the same requests are sent again and again: set-points, watchdogs, heartbeats, polls of a dead unit.
//!
//! The response to such a write has the same bytes, so only times and habits tell it from the same request once more. Where
//! neither does, the truth says that the recording does not decide (`mark_undecided`).

use crate::model::{Direction, Label};
use crate::rng::Rng;
use crate::sim::case::TrafficLine;
use crate::sim::reads::{self, address, body};
use crate::sim::requests::PlannedRequest;
use crate::sim::scenario::{Scenario, BASE};
use crate::sim::slave::{PollItem, Slave};
use crate::sim::tap::TapMode;
use crate::sim::truth::TruthFrame;

/// Functions whose response repeats the request (application protocol, 6.5, 6.6, 6.8 and 6.16).
const MIRRORED_FUNCTIONS: [u8; 4] = [5, 6, 8, 22];

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
const WRITE: Repeated = Repeated {
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

/// The defaults of these scenarios.
const QUIET: Scenario = Scenario { frames: 800, midstart: false, timeout: 0.0, exceptions: 0.0, ..BASE };

/// Lines with constant writes, dead units and damaged responses.
pub const REPEATED: [Scenario; 17] = [
    Scenario { name: "writes_25ms", repeated: Some(Repeated { pause_ms: 25.0, ..WRITE }), ..QUIET },
    Scenario { name: "writes_100ms", repeated: Some(WRITE), ..QUIET },
    Scenario { name: "writes_1s", repeated: Some(Repeated { pause_ms: 1000.0, ..WRITE }), ..QUIET },
    Scenario { name: "echo_25ms", repeated: Some(Repeated { pause_ms: 25.0, ..WRITE }), echo: 1.0, ..QUIET },
    Scenario { name: "echo_100ms", repeated: Some(WRITE), echo: 1.0, ..QUIET },
    Scenario { name: "echo_1s", repeated: Some(Repeated { pause_ms: 1000.0, ..WRITE }), echo: 1.0, ..QUIET },
    Scenario { name: "writes_polls", repeated: Some(MIXED), timeout: 0.02, ..QUIET },
    Scenario { name: "writes_twice", repeated: Some(Repeated { writes: 1, are_doubled: true, ..MIXED }), ..QUIET },
    Scenario { name: "echo_polls", repeated: Some(MIXED), timeout: 0.02, echo: 1.0, ..QUIET },
    Scenario { name: "heart_dies", repeated: Some(Repeated { writes_die_at: 0.5, ..WRITE }), ..QUIET },
    Scenario { name: "heart_dies_1s", repeated: Some(Repeated { writes_die_at: 0.5, pause_ms: 1000.0, ..WRITE }), ..QUIET },
    Scenario { name: "heart_polls", repeated: Some(Repeated { writes_die_at: 0.5, retries: 1, ..MIXED }), ..QUIET },
    Scenario { name: "heart_dead", repeated: Some(Repeated { writes_die_at: 0.0, pause_ms: 1000.0, ..WRITE }), ..QUIET },
    Scenario {
        name: "dead_unit",
        repeated: Some(Repeated { writes: 1, polls: 6, writes_die_at: 0.0, poll_dies_at: 0.0, ..MIXED }),
        ..QUIET
    },
    Scenario { name: "dead_two", repeated: Some(Repeated { polls: 1, writes_die_at: 0.0, ..WRITE }), ..QUIET },
    Scenario { name: "damaged_25", repeated: Some(Repeated { writes: 0, polls: 1, damaged: 0.25, ..WRITE }), ..QUIET },
    Scenario { name: "damaged_75", repeated: Some(Repeated { writes: 0, polls: 1, damaged: 0.75, ..WRITE }), ..QUIET },
];

/// Two constant writes among twenty polls.
const MIXED: Repeated = Repeated { writes: 2, polls: 20, pause_ms: 12.0, ..WRITE };

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

    /// Whether the slave of a request is dead where this share of the recording is over.
    pub(crate) fn is_dead(&self, planned: &PlannedRequest, share: f64) -> bool {
        let is_write = planned.slave.is_some_and(|slave| slave < self.writes);
        let is_first_poll = planned.slave == Some(self.writes);
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

/// Marks the frames whose direction no listener can tell: in a row of equal frames without times, from the first request without
/// response on; and all of them where the adapter echoes requests, unless polls show that it does. An adapter that holds bytes
/// back as long as units take to respond shows as little of an echo as no clock.
///
/// What would be required of them is then allowed only.
pub(crate) fn mark_undecided(truth: &mut [TruthFrame], lines: &[TrafficLine], scenario: &Scenario, mode: TapMode) {
    let Some(repeated) = &scenario.repeated else { return };
    let hides_echo = scenario.echo > 0.0 && repeated.polls == 0 && mode == TapMode::Ftdi16;
    if mode != TapMode::None && !hides_echo {
        return;
    }
    let bytes = |frame: &TruthFrame| &lines[0].bytes[frame.start as usize..frame.end as usize];
    let mut from = 0;
    while from < truth.len() {
        let length = truth[from..].iter().take_while(|frame| bytes(frame) == bytes(&truth[from])).count();
        let row = &mut truth[from..from + length];
        let answered: Vec<u32> =
            row.iter().filter(|frame| frame.direction == Direction::Response).map(|frame| frame.txn).collect();
        let shows_no_echo = scenario.echo > 0.0 && repeated.polls == 0;
        let silent = row.iter().position(|frame| !answered.contains(&frame.txn));
        let first = if shows_no_echo { Some(0) } else { silent };
        let is_mirrored = MIRRORED_FUNCTIONS.contains(&row[0].function);
        if let Some(first) = first.filter(|_| length > 1 && is_mirrored) {
            row[first..].iter_mut().for_each(leave_open);
        }
        from += length;
    }
}

fn leave_open(frame: &mut TruthFrame) {
    frame.is_undecided = true;
    for label in [Label::NoResponse, Label::Retry, Label::Echo] {
        frame.labels.remove(label);
        frame.allowed_labels.insert(label);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::case::Traffic;

    fn truth(name: &str, mode: TapMode) -> Vec<TruthFrame> {
        Traffic::new(Scenario::named(name).unwrap(), 1, 400).tap(mode).truth
    }

    #[test]
    fn writes_and_their_responses_are_equal_and_alternate() {
        let traffic = Traffic::new(Scenario::named("writes_100ms").unwrap(), 1, 400);
        let bytes = |frame: &TruthFrame| &traffic.lines[0].bytes[frame.start as usize..frame.end as usize];
        assert!(traffic.truth.windows(2).all(|pair| bytes(&pair[0]) == bytes(&pair[1])));
        assert!(traffic.truth.windows(2).all(|pair| pair[0].direction != pair[1].direction));
    }

    #[test]
    fn a_heart_that_dies_sends_requests_only() {
        let truth = truth("heart_dies", TapMode::Exact);
        let dead = &truth[truth.len() / 2 + 2..];
        assert!(dead.iter().all(|frame| frame.direction == Direction::Request && frame.labels.contains(Label::NoResponse)
            || frame.txn == dead[dead.len() - 1].txn));
        assert!(truth[..truth.len() / 2 - 2].iter().filter(|frame| frame.direction == Direction::Response).count() > 90);
    }

    #[test]
    fn only_without_times_something_is_undecided() {
        let undecided = |name, mode| truth(name, mode).iter().filter(|frame| frame.is_undecided).count();
        assert_eq!((undecided("heart_dies", TapMode::Exact), undecided("writes_25ms", TapMode::None)), (0, 0));
        assert!((190..=210).contains(&undecided("heart_dies", TapMode::None)));
        assert_eq!(undecided("echo_25ms", TapMode::None), truth("echo_25ms", TapMode::None).len());
        // Two other units are polled between two heartbeats, so each is alone.
        assert_eq!(undecided("dead_two", TapMode::None), 0);
    }
}
