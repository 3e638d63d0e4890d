//! Simulates the traffic of a bus: the polls, timeouts and retries of the master, the responses of the slaves, and a second
//! master.

use crate::checksum::{ascii, rtu};
use crate::model::{Direction, Framing};
use crate::rng::Rng;
use crate::sim::bus::SimulatedBus;
use crate::sim::damage::Damage;
use crate::sim::requests::PlannedRequest;
use crate::sim::scenario::Scenario;
use crate::sim::wire::{FrameRole, RequestOutcome, SentFrame, Wire};

/// How often a master repeats a request without response.
const MAX_RETRIES: usize = 2;

/// The response timeout of the master.
const RESPONSE_TIMEOUT_NS: f64 = 250e6;

/// By how much, as a logarithm, pauses and response times scatter where the same requests are sent again and again.
const REPEATED_SPREAD: f64 = 0.1;

/// The typical silence before a request.
const REQUEST_DELAY_NS: f64 = 12e6;

/// A response that the slave sends only after the timeout.
struct LateResponse {
    request: usize,
    pdu: Vec<u8>,
}

/// A simulation in progress.
pub(crate) struct Simulation<'a> {
    scenario: &'a Scenario,
    bus: SimulatedBus,
    pub(crate) wire: Wire,
    rng: Rng,
    /// The silence in ns before the next request, if it is not the usual one.
    wait: Option<f64>,
    transactions: u32,
    overlaps: u32,
    /// Frames to be sent in all.
    frames: usize,
}

impl<'a> Simulation<'a> {
    /// Runs the simulation until so many frames were sent.
    pub(crate) fn new(scenario: &'a Scenario, seed: u64, frames: usize) -> Self {
        let mut rng = Rng::new(seed, scenario.name);
        let bus = SimulatedBus::new(scenario, &mut rng);
        let wire = Wire::new(bus.settings, scenario);
        let mut this = Self { scenario, bus, wire, rng, wait: None, transactions: 0, overlaps: 0, frames };
        while this.wire.frames.len() < frames {
            this.transaction();
            if this.rng.chance(scenario.storm) {
                this.wire.storm(&mut this.rng);
            }
        }
        let cuts = (scenario.cuts * f64::from(this.transactions)).round() as usize;
        this.wire.cut(cuts, &mut this.rng);
        if let Some(direction) = scenario.only {
            this.wire.keep_only(direction);
        }
        if scenario.midstart {
            this.wire.start_in_the_middle(&mut this.rng);
        }
        this
    }

    /// The settings of the line.
    pub(crate) fn settings(&self) -> crate::model::Settings {
        self.bus.settings
    }

    fn transaction(&mut self) {
        let planned = self.bus.next_request(self.scenario, &mut self.rng);
        if planned.slave.is_some() && self.rng.chance(self.scenario.two_masters) {
            self.overlap(&planned);
        } else {
            self.exchange(&planned);
        }
    }

    /// Simulates a request, its response, and the retries if there is none.
    fn exchange(&mut self, planned: &PlannedRequest) {
        let mut role = FrameRole::Request;
        let mut overdue: Option<LateResponse> = None;
        let retries = self.scenario.repeated.as_ref().map_or(MAX_RETRIES, |repeated| repeated.retries);
        for _ in 0..=retries {
            let (request, is_received) = self.request(planned, role, 0);
            let Some(slave) = planned.slave else {
                // The turnaround delay after a broadcast (serial line specification, 2.4.1).
                self.wire.frames[request].outcome = RequestOutcome::NoResponseExpected;
                self.wait = Some(self.rng.uniform(20e6, 100e6));
                return;
            };
            let is_dead =
                self.scenario.repeated.as_ref().is_some_and(|repeated| repeated.is_dead(planned.slave, self.share_sent()));
            let in_time = is_received && !is_dead && !self.rng.chance(self.scenario.timeout);
            if let Some(late) = overdue.take() {
                let role = FrameRole::Late { old: late.request, now: request };
                self.response(slave, planned.unit, &late.pdu, role, 0);
                if in_time {
                    self.answer(planned, slave, request);
                }
                return;
            }
            if in_time && self.answer(planned, slave, request) {
                return;
            }
            if is_received && !in_time && self.rng.chance(self.scenario.late) {
                let pdu = self.bus.respond(slave, &planned.pdu, self.scenario, &mut self.rng);
                overdue = Some(LateResponse { request, pdu });
            }
            let pause = self.scenario.repeated.as_ref().map_or(0.0, |repeated| 1e6 * repeated.pause_ms);
            self.wait = Some(self.timeout_ns().max(pause) * self.rng.uniform(0.95, 1.05));
            role = FrameRole::Retry(request);
        }
    }

    /// Simulates a second master, which addresses another slave before the first master has its response.
    fn overlap(&mut self, first: &PlannedRequest) {
        self.overlaps += 1;
        let overlap_id = self.overlaps;
        let second = self.bus.other_request(first.unit, &mut self.rng);
        let mut asked = Vec::new();
        let mut role = FrameRole::Request;
        for planned in [first, &second] {
            let (request, is_received) = self.request(planned, role, overlap_id);
            let slave = planned.slave.expect("only requests to one slave meet");
            asked.push((request, is_received, planned, slave));
            role = FrameRole::Intruder(request);
            let answer = self.bus.slaves[slave].response_time_ns;
            self.wait = Some((answer * self.rng.uniform(0.2, 0.7)).max(self.shortest()));
        }
        self.wait = None;
        if self.rng.chance(0.3) {
            asked.swap(0, 1);
        }
        for (request, is_received, planned, slave) in asked {
            if is_received {
                let pdu = self.bus.respond(slave, &planned.pdu, self.scenario, &mut self.rng);
                let answer = self.response(slave, planned.unit, &pdu, FrameRole::Response(request), overlap_id);
                self.wire.frames[request].outcome = RequestOutcome::Response(answer);
            } else {
                self.wait = Some(self.timeout_ns() * self.rng.uniform(0.95, 1.05));
            }
        }
    }

    /// Sends a request and its local echo, if there is one; returns the index of the frame and whether the slave can read it.
    fn request(&mut self, planned: &PlannedRequest, role: FrameRole, overlap_id: u32) -> (usize, bool) {
        let silence = self.wait.take().unwrap_or_else(|| self.pause());
        self.transactions += 1;
        let txn = self.transactions;
        let mut sent = self.frame(planned.unit, &planned.pdu, Direction::Request, role, false);
        (sent.txn, sent.overlap_id) = (txn, overlap_id);
        let request = self.wire.frames.len();
        let copy = SentFrame { role: FrameRole::Echo(request), ..sent.clone() };
        let is_received = self.wire.transmit(silence, sent, self.scenario, &mut self.rng);
        if self.rng.chance(self.scenario.echo) {
            self.wire.transmit(0.0, copy, self.scenario, &mut self.rng);
        }
        (request, is_received)
    }

    /// Sends the response, possibly from the wrong unit or twice; returns whether the master accepts it.
    fn answer(&mut self, planned: &PlannedRequest, slave: usize, request: usize) -> bool {
        let pdu = self.bus.respond(slave, &planned.pdu, self.scenario, &mut self.rng);
        if self.rng.chance(self.scenario.wrong_unit) {
            let unit = self.other_unit(planned.unit);
            self.response(slave, unit, &pdu, FrameRole::WrongUnit(request), 0);
            self.wire.frames[request].outcome = RequestOutcome::WrongUnit;
            return false;
        }
        let answer = self.response(slave, planned.unit, &pdu, FrameRole::Response(request), 0);
        self.wire.frames[request].outcome = RequestOutcome::Response(answer);
        if self.rng.chance(self.scenario.dup_reply) {
            self.response(slave, planned.unit, &pdu, FrameRole::Duplicate(answer), 0);
        }
        true
    }

    fn response(&mut self, slave: usize, unit: u8, pdu: &[u8], role: FrameRole, overlap_id: u32) -> usize {
        let response_time_ns = self.bus.slaves[slave].response_time_ns;
        let is_slow = self.scenario.slow > 0.0 && self.rng.chance(self.scenario.slow);
        let typical = if is_slow { self.scenario.slow_ns } else { response_time_ns };
        let usual_spread = if self.scenario.repeated.is_some() { REPEATED_SPREAD } else { 0.5 };
        let silence = self.silence(typical, if is_slow { 0.05 } else { usual_spread });
        let lower_case = self.bus.slaves[slave].lower_case;
        let mut sent = self.frame(unit, pdu, Direction::Response, role, lower_case);
        let txn = role.earlier().map_or(0, |earlier| self.wire.frames[earlier].txn);
        (sent.txn, sent.overlap_id) = (txn, overlap_id);
        let index = self.wire.frames.len();
        let damaged = self.scenario.repeated.as_ref().map_or(0.0, |repeated| repeated.damaged);
        if damaged > 0.0 && self.rng.chance(damaged) {
            self.wire.transmit(silence, sent, &Scenario { flip: 1.0, ..self.scenario.clone() }, &mut self.rng);
        } else {
            self.wire.transmit(silence, sent, self.scenario, &mut self.rng);
        }
        index
    }

    /// How long the master waits for a response.
    fn timeout_ns(&self) -> f64 {
        RESPONSE_TIMEOUT_NS.max(2.0 * self.scenario.slow_ns)
    }

    /// The silence in ns before a request.
    fn pause(&mut self) -> f64 {
        match &self.scenario.repeated {
            Some(repeated) => self.silence(1e6 * repeated.pause_ms, REPEATED_SPREAD),
            None => self.silence(REQUEST_DELAY_NS, 0.6),
        }
    }

    /// Which share of the frames was sent.
    fn share_sent(&self) -> f64 {
        self.wire.frames.len() as f64 / self.frames as f64
    }

    /// A frame that is ready to be sent, without transaction.
    fn frame(&self, unit: u8, pdu: &[u8], direction: Direction, role: FrameRole, lower_case: bool) -> SentFrame {
        SentFrame {
            wire: match self.scenario.framing {
                Framing::Rtu => rtu(unit, pdu),
                Framing::Ascii => ascii(unit, pdu, lower_case),
            },
            line: usize::from(direction == Direction::Response),
            direction,
            unit,
            code: pdu[0],
            txn: 0,
            role,
            outcome: RequestOutcome::NoResponse,
            damage: Damage::default(),
            overlap_id: 0,
        }
    }

    /// The silence in ns before a frame: log-normal, or far too short with the probability of this scenario.
    fn silence(&mut self, typical: f64, spread: f64) -> f64 {
        if self.rng.chance(self.scenario.nogap) {
            return self.rng.uniform(0.0, 2.5) * self.bus.settings.char_ns();
        }
        self.rng.log_normal(typical, spread).max(self.shortest())
    }

    fn shortest(&self) -> f64 {
        1.02 * self.bus.settings.t35_ns()
    }

    /// Another unit than this one, which is a slave of this bus or an unknown one.
    fn other_unit(&mut self, unit: u8) -> u8 {
        loop {
            let known = self.rng.pick(&[true, false]);
            let slave = self.rng.below(self.bus.slaves.len());
            let other = if known { self.bus.slaves[slave].unit } else { self.rng.range(1, 247) as u8 };
            if other != unit {
                return other;
            }
        }
    }
}
