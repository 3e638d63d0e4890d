//! The master's program: polls, waits, retries; and what its slaves and a second master make of it.

use crate::checksum::{ascii, rtu};
use crate::model::{Direction, Framing};
use crate::rng::Rng;
use crate::sim::bus::Bus;
use crate::sim::damage::Damage;
use crate::sim::requests::Ask;
use crate::sim::scenario::Scenario;
use crate::sim::wire::{Fate, Role, Sent, Wire};

/// How often a master asks again.
const RETRIES: usize = 2;

/// How long it waits for an answer, in ns.
const TIMEOUT: f64 = 250e6;

/// The typical silence before a request, in ns.
const BEFORE_REQUEST: f64 = 12e6;

/// An answer that did not come in time.
struct Overdue {
    request: usize,
    pdu: Vec<u8>,
}

/// The whole play.
pub(crate) struct Play<'a> {
    scenario: &'a Scenario,
    bus: Bus,
    pub(crate) wire: Wire,
    rng: Rng,
    /// What the master has to wait before its next request, if not the usual silence.
    wait: Option<f64>,
    transactions: u32,
    episodes: u32,
}

impl<'a> Play<'a> {
    /// Plays until so many frames were sent.
    pub(crate) fn new(scenario: &'a Scenario, seed: u64, frames: usize) -> Self {
        let mut rng = Rng::new(seed, scenario.name);
        let bus = Bus::new(scenario, &mut rng);
        let wire = Wire::new(bus.settings, scenario);
        let mut this = Self { scenario, bus, wire, rng, wait: None, transactions: 0, episodes: 0 };
        while this.wire.frames.len() < frames {
            this.transaction();
            if this.rng.chance(scenario.storm) {
                this.wire.storm(&mut this.rng);
            }
        }
        let cuts = (scenario.cuts * f64::from(this.transactions)).round() as usize;
        this.wire.cut(cuts, &mut this.rng);
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
        let ask = self.bus.next_request(self.scenario, &mut self.rng);
        if ask.slave.is_some() && self.rng.chance(self.scenario.two_masters) {
            self.meeting(&ask);
        } else {
            self.exchange(&ask);
        }
    }

    /// A request, its answer, and what follows if there is none.
    fn exchange(&mut self, ask: &Ask) {
        let mut role = Role::Request;
        let mut overdue: Option<Overdue> = None;
        for _ in 0..=RETRIES {
            let (request, heard) = self.request(ask, role, 0);
            let Some(slave) = ask.slave else {
                // The turnaround delay after a broadcast (serial line specification, 2.4.1).
                self.wire.frames[request].fate = Fate::NotDue;
                self.wait = Some(self.rng.uniform(20e6, 100e6));
                return;
            };
            let in_time = heard && !self.rng.chance(self.scenario.timeout);
            if let Some(late) = overdue.take() {
                let role = Role::Late { old: late.request, now: request };
                self.response(slave, ask.unit, &late.pdu, role, 0);
                if in_time {
                    self.answer(ask, slave, request);
                }
                return;
            }
            if in_time && self.answer(ask, slave, request) {
                return;
            }
            if heard && !in_time && self.rng.chance(self.scenario.late) {
                let pdu = self.bus.respond(slave, &ask.pdu, self.scenario, &mut self.rng);
                overdue = Some(Overdue { request, pdu });
            }
            self.wait = Some(TIMEOUT * self.rng.uniform(0.95, 1.05));
            role = Role::Retry(request);
        }
    }

    /// A second master asks another slave before the first one has its answer.
    fn meeting(&mut self, first: &Ask) {
        self.episodes += 1;
        let episode = self.episodes;
        let second = self.bus.other_request(first.unit, &mut self.rng);
        let mut asked = Vec::new();
        let mut role = Role::Request;
        for ask in [first, &second] {
            let (request, heard) = self.request(ask, role, episode);
            let slave = ask.slave.expect("only requests to one slave meet");
            asked.push((request, heard, ask, slave));
            role = Role::Intruder(request);
            let answer = self.bus.slaves[slave].answer_ns;
            self.wait = Some((answer * self.rng.uniform(0.2, 0.7)).max(self.shortest()));
        }
        self.wait = None;
        if self.rng.chance(0.3) {
            asked.swap(0, 1);
        }
        for (request, heard, ask, slave) in asked {
            if heard {
                let pdu = self.bus.respond(slave, &ask.pdu, self.scenario, &mut self.rng);
                let answer = self.response(slave, ask.unit, &pdu, Role::Answer(request), episode);
                self.wire.frames[request].fate = Fate::Answered(answer);
            } else {
                self.wait = Some(TIMEOUT * self.rng.uniform(0.95, 1.05));
            }
        }
    }

    /// Sends a request (and its echo); says which frame it is and whether the slave can read it.
    fn request(&mut self, ask: &Ask, role: Role, episode: u32) -> (usize, bool) {
        let silence = self.wait.take().unwrap_or_else(|| self.silence(BEFORE_REQUEST, 0.6));
        self.transactions += 1;
        let txn = self.transactions;
        let mut sent = self.frame(ask.unit, &ask.pdu, Direction::Request, role, false);
        (sent.txn, sent.episode) = (txn, episode);
        let request = self.wire.frames.len();
        let copy = Sent { role: Role::Echo(request), ..sent.clone() };
        let heard = self.wire.transmit(silence, sent, self.scenario, &mut self.rng);
        if self.rng.chance(self.scenario.echo) {
            self.wire.transmit(0.0, copy, self.scenario, &mut self.rng);
        }
        (request, heard)
    }

    /// Sends the answer, from whomever and as often as it comes; says whether the master accepts it.
    fn answer(&mut self, ask: &Ask, slave: usize, request: usize) -> bool {
        let pdu = self.bus.respond(slave, &ask.pdu, self.scenario, &mut self.rng);
        if self.rng.chance(self.scenario.wrong_unit) {
            let unit = self.stranger(ask.unit);
            self.response(slave, unit, &pdu, Role::WrongUnit(request), 0);
            self.wire.frames[request].fate = Fate::Elsewhere;
            return false;
        }
        let answer = self.response(slave, ask.unit, &pdu, Role::Answer(request), 0);
        self.wire.frames[request].fate = Fate::Answered(answer);
        if self.rng.chance(self.scenario.dup_reply) {
            self.response(slave, ask.unit, &pdu, Role::Duplicate(answer), 0);
        }
        true
    }

    fn response(&mut self, slave: usize, unit: u8, pdu: &[u8], role: Role, episode: u32) -> usize {
        let answer_ns = self.bus.slaves[slave].answer_ns;
        let silence = self.silence(answer_ns, 0.5);
        let lower_case = self.bus.slaves[slave].lower_case;
        let mut sent = self.frame(unit, pdu, Direction::Response, role, lower_case);
        let txn = role.earlier().map_or(0, |earlier| self.wire.frames[earlier].txn);
        (sent.txn, sent.episode) = (txn, episode);
        let index = self.wire.frames.len();
        self.wire.transmit(silence, sent, self.scenario, &mut self.rng);
        index
    }

    fn frame(&self, unit: u8, pdu: &[u8], direction: Direction, role: Role, lower_case: bool) -> Sent {
        Sent {
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
            fate: Fate::Silence,
            damage: Damage::default(),
            episode: 0,
        }
    }

    /// A silence as long as usual, or the far too short one of this scenario.
    fn silence(&mut self, typical: f64, spread: f64) -> f64 {
        if self.rng.chance(self.scenario.nogap) {
            return self.rng.uniform(0.0, 2.5) * self.bus.settings.char_ns();
        }
        self.rng.log_normal(typical, spread).max(self.shortest())
    }

    fn shortest(&self) -> f64 {
        1.02 * self.bus.settings.t35_ns()
    }

    /// Another unit than this one: a slave of this bus, or one that nobody knows.
    fn stranger(&mut self, unit: u8) -> u8 {
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
