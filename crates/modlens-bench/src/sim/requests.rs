//! The requests of the master: those of the poll cycle, ad-hoc requests and broadcasts (application protocol, section 6).

use crate::checksum::rtu;
use crate::rng::Rng;
use crate::sim::bus::SimulatedBus;
use crate::sim::reads::{address, bits, body, read, registers};
use crate::sim::registers::{anything, draw, payload};
use crate::sim::scenario::Scenario;
use crate::sim::slave::LengthStyle;

/// The share of requests that are broadcasts.
const BROADCAST_SHARE: f64 = 0.01;

/// Ad-hoc functions with their weights. 0x0E2B and 0x0D2B are the two MEI types of function 43, 0 is a proprietary function.
const AD_HOC: [(u16, u32); 20] = [
    (1, 6),
    (2, 6),
    (3, 20),
    (4, 12),
    (5, 6),
    (6, 8),
    (15, 5),
    (16, 10),
    (7, 2),
    (8, 3),
    (11, 2),
    (12, 2),
    (17, 2),
    (20, 3),
    (21, 3),
    (22, 3),
    (23, 4),
    (24, 2),
    (0x0E2B, 3),
    (0x0D2B, 1),
];

/// A request that the master is about to send.
#[derive(Clone, Debug)]
pub(crate) struct PlannedRequest {
    pub(crate) unit: u8,
    pub(crate) pdu: Vec<u8>,
    /// The slave that has to respond; `None` for broadcasts and for Force Listen Only Mode.
    pub(crate) slave: Option<usize>,
}

impl SimulatedBus {
    /// The next request.
    pub(crate) fn next_request(&mut self, scenario: &Scenario, rng: &mut Rng) -> PlannedRequest {
        if scenario.repeated.is_none() && rng.chance(BROADCAST_SHARE) {
            let function = rng.pick(&[5, 6, 15, 16, 22]);
            let pdu = self.operation(0, function, scenario, rng);
            return PlannedRequest { unit: 0, pdu, slave: None };
        }
        if scenario.repeated.is_some() || !rng.chance(scenario.adhoc) {
            let item = self.poll[self.turn % self.poll.len()].clone();
            self.turn += 1;
            return PlannedRequest { unit: self.slaves[item.slave].unit, pdu: item.pdu, slave: Some(item.slave) };
        }
        let slave = rng.below(self.slaves.len());
        let mut weights = AD_HOC.map(|(_, weight)| weight).to_vec();
        weights.push(scenario.custom_weight);
        let function = AD_HOC.get(rng.weighted(&weights)).map_or(0, |(function, _)| *function);
        let pdu = self.operation(slave, function, scenario, rng);
        // Force Listen Only Mode has no response (application protocol, 6.8).
        let answering = (!pdu.starts_with(&[8, 0, 4])).then_some(slave);
        PlannedRequest { unit: self.slaves[slave].unit, pdu, slave: answering }
    }

    /// A request of the poll list to another slave than `unit`, which a second master sends.
    pub(crate) fn other_request(&mut self, unit: u8, rng: &mut Rng) -> PlannedRequest {
        loop {
            let item = self.poll[rng.below(self.poll.len())].clone();
            let other = self.slaves[item.slave].unit;
            if other != unit {
                return PlannedRequest { unit: other, pdu: item.pdu, slave: Some(item.slave) };
            }
        }
    }

    /// A random PDU of a function; `slave` is the one that is addressed.
    fn operation(&mut self, slave: usize, function: u16, scenario: &Scenario, rng: &mut Rng) -> Vec<u8> {
        let zero_heavy = scenario.zero_heavy;
        let code = function as u8;
        match function {
            1..=4 => read(code, &self.slaves[slave], rng),
            5 => body(code, &[address(rng), rng.pick(&[0, 0xFF00])]),
            6 => body(code, &[address(rng), draw(zero_heavy, rng)]),
            15 => {
                let count = bits(1968, rng);
                let mut data = self.write_payload(usize::from(count).div_ceil(8), scenario, rng);
                mask_padding(&mut data, count);
                join(body(code, &[address(rng), count]), &[&[data.len() as u8], &data])
            }
            16 => {
                let count = registers(123, rng);
                let data = self.write_payload(2 * usize::from(count), scenario, rng);
                join(body(code, &[address(rng), count]), &[&[data.len() as u8], &data])
            }
            7 | 11 | 12 | 17 => vec![code],
            8 => diagnostics(zero_heavy, rng),
            20 => file_read(rng),
            21 => self.file_write(scenario, rng),
            22 => body(code, &[address(rng), rng.bits() as u16, rng.bits() as u16]),
            23 => {
                let (read, write) = (registers(125, rng), registers(121, rng));
                let data = self.write_payload(2 * usize::from(write), scenario, rng);
                let head = body(code, &[address(rng), read, address(rng), write]);
                join(head, &[&[data.len() as u8], &data])
            }
            24 => body(code, &[address(rng)]),
            0x0E2B => vec![0x2B, 0x0E, rng.range(1, 4) as u8, rng.pick(&[0, 0, 0, 1, 2, 0x80])],
            0x0D2B => {
                let length = rng.range(4, 14);
                join(vec![0x2B, 0x0D], &[&anything(length - 1, false, rng)])
            }
            _ => self.custom(zero_heavy, rng),
        }
    }

    fn custom(&self, zero_heavy: bool, rng: &mut Rng) -> Vec<u8> {
        let custom = rng.pick(&self.proprietary_functions);
        let (counted, length) = match custom.style {
            LengthStyle::Fixed { request, .. } => (false, request),
            LengthStyle::Counted => (true, rng.range(0, 16)),
            LengthStyle::Random => (false, rng.range(0, 24)),
        };
        let mut pdu = vec![custom.code];
        if counted {
            pdu.push(length as u8);
        }
        join(pdu, &[&anything(length, zero_heavy, rng)])
    }

    fn file_write(&mut self, scenario: &Scenario, rng: &mut Rng) -> Vec<u8> {
        let mut groups = Vec::new();
        for _ in 0..rng.range(1, 2) {
            let count = rng.range(1, 20);
            let data = self.write_payload(2 * count, scenario, rng);
            groups = join(groups, &[&file_group(count, rng), &data]);
        }
        join(vec![21, groups.len() as u8], &[&groups])
    }

    /// The data of a write request. With the probability `nested` it contains a complete frame of this bus.
    fn write_payload(&mut self, length: usize, scenario: &Scenario, rng: &mut Rng) -> Vec<u8> {
        let mut data = payload(length, scenario.zero_heavy, rng);
        if length >= 8 && rng.chance(scenario.nested) {
            let item = self.poll[rng.below(self.poll.len())].clone();
            let unit = self.slaves[item.slave].unit;
            let mut frame = rtu(unit, &item.pdu);
            if rng.chance(0.5) {
                let answer = rtu(unit, &self.respond(item.slave, &item.pdu, scenario, rng));
                if answer.len() <= length {
                    frame = answer;
                }
            }
            let at = rng.range(0, length - frame.len());
            data[at..at + frame.len()].copy_from_slice(&frame);
        }
        data
    }
}

fn diagnostics(zero_heavy: bool, rng: &mut Rng) -> Vec<u8> {
    if rng.chance(3.0 / 17.0) {
        let length = if rng.chance(0.7) { 2 } else { 2 * rng.range(1, 40) };
        return join(vec![8, 0, 0], &[&payload(length, zero_heavy, rng)]);
    }
    let sub = rng.pick(&[1, 2, 3, 4, 10, 11, 12, 13, 14, 15, 16, 17, 18, 20]);
    let data = match sub {
        1 => rng.pick(&[0, 0xFF00]),
        3 => 0x0A00,
        _ => 0,
    };
    body(8, &[sub, data])
}

fn file_read(rng: &mut Rng) -> Vec<u8> {
    let mut groups = Vec::new();
    for _ in 0..rng.range(1, 3) {
        let count = rng.range(1, 16);
        groups.extend(file_group(count, rng));
    }
    join(vec![20, groups.len() as u8], &[&groups])
}

/// A sub-request for file records: reference type 6, file, record, length (application protocol, 6.14).
fn file_group(count: usize, rng: &mut Rng) -> Vec<u8> {
    body(6, &[rng.range(1, 10) as u16, rng.range(0, 9999) as u16, count as u16])
}

/// Clears the unused bits of the last byte of `count` coils (application protocol, 6.1).
pub(crate) fn mask_padding(data: &mut [u8], count: u16) {
    if let (Some(last), used @ 1..) = (data.last_mut(), count % 8) {
        *last &= (1 << used) - 1;
    }
}

fn join(mut head: Vec<u8>, parts: &[&[u8]]) -> Vec<u8> {
    head.extend(parts.concat());
    head
}
