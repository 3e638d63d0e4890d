//! Exchanges of one kind of traffic, one after the other.

use crate::family::kinds::Kind;
use crate::rng::Rng;
use crate::sim::requests::mask_padding;

/// Registers of a unit; addresses beyond them begin again.
const IMAGE_WORDS: usize = 2048;

/// The chance that a register other than 0 has moved by one since it was read last.
const DRIFT: f64 = 0.2;

/// What came of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    Answered,
    Refused,
    Silent,
}

/// A request and what came of it; bytes are unit and PDU.
#[derive(Clone, Debug)]
pub(super) struct Exchange {
    pub request: Vec<u8>,
    /// Empty if there was none.
    pub response: Vec<u8>,
    pub outcome: Outcome,
}

/// An endless source of exchanges.
pub(super) struct Traffic<'a> {
    kind: &'a Kind,
    rng: Rng,
    polls: Vec<[u16; 4]>,
    turn: usize,
    images: Vec<Vec<u16>>,
    again: Option<Vec<u8>>,
}

impl<'a> Traffic<'a> {
    pub fn new(kind: &'a Kind, seed: u64) -> Self {
        let mut rng = Rng::new(seed, kind.name);
        let polls = (0..kind.polls).map(|at| poll(kind, at, &mut rng)).collect();
        let word = |rng: &mut Rng| match rng.below(3) {
            0 => 0,
            1 => rng.range(1, 999) as u16,
            _ => rng.bits() as u16,
        };
        let images = (0..kind.units).map(|_| (0..IMAGE_WORDS).map(|_| word(&mut rng)).collect()).collect();
        Self { kind, rng, polls, turn: 0, images, again: None }
    }

    /// Returns the next exchange.
    pub fn next(&mut self) -> Exchange {
        let is_again = self.again.is_some();
        let request = self.again.take().unwrap_or_else(|| self.request());
        if !is_again && self.rng.chance(self.kind.retried) {
            self.again = Some(request.clone());
            return Exchange { request, response: Vec::new(), outcome: Outcome::Silent };
        }
        if !is_again && self.rng.chance(self.kind.silent) {
            return Exchange { request, response: Vec::new(), outcome: Outcome::Silent };
        }
        if self.rng.chance(self.kind.refused) {
            let response = vec![request[0], request[1] | 0x80, self.rng.pick(&[1, 2, 2, 3, 4, 6])];
            return Exchange { request, response, outcome: Outcome::Refused };
        }
        let response = self.response(&request);
        Exchange { request, response, outcome: Outcome::Answered }
    }

    fn request(&mut self) -> Vec<u8> {
        if self.rng.chance(self.kind.writes) {
            return self.write();
        }
        self.turn += 1;
        let at = if self.kind.is_random { self.rng.below(self.polls.len()) } else { self.turn % self.polls.len() };
        let [unit, code, address, quantity] = self.polls[at];
        head(unit as u8, code as u8, &[address, quantity])
    }

    /// Returns a write with random values to a random address.
    fn write(&mut self) -> Vec<u8> {
        let kind = self.kind;
        let (unit, code) = (self.rng.range(1, kind.units.into()) as u8, self.rng.pick(kind.write_codes));
        let [first, last] = kind.addresses.map(usize::from);
        let address = self.rng.range(first, last) as u16;
        match code {
            5 => head(unit, code, &[address, self.rng.pick(&[0, 0xFF00])]),
            6 => head(unit, code, &[address, self.rng.range(0, 4999) as u16]),
            15 => {
                let quantity = self.rng.range(1, 64) as u16;
                let mut data: Vec<u8> = (0..quantity.div_ceil(8)).map(|_| self.rng.byte()).collect();
                mask_padding(&mut data, quantity);
                with_data(head(unit, code, &[address, quantity]), &data)
            }
            16 => {
                let quantity = self.rng.pick(&[1, 2, 2, 4, 8, 32, 100]);
                with_data(head(unit, code, &[address, quantity]), &self.words(quantity))
            }
            23 => {
                let (read, write) = (self.rng.pick(&[2, 4, 8, 16, 64]), self.rng.range(1, 8) as u16);
                with_data(head(unit, code, &[address, read, address, write]), &self.words(write))
            }
            _ => head(unit, code, &[address, self.rng.range(0, 999) as u16]),
        }
    }

    fn words(&mut self, count: u16) -> Vec<u8> {
        (0..count).flat_map(|_| (self.rng.range(0, 4999) as u16).to_be_bytes()).collect()
    }

    /// Returns what the unit answers.
    fn response(&mut self, request: &[u8]) -> Vec<u8> {
        let [unit, code] = [request[0], request[1]];
        let [address, quantity] = [2, 4].map(|at| u16::from_be_bytes([request[at], request[at + 1]]));
        let image = &mut self.images[usize::from(unit) - 1];
        let mut next = |at: u16| {
            let word = &mut image[usize::from(address.wrapping_add(at)) % IMAGE_WORDS];
            if *word != 0 && self.rng.chance(DRIFT) {
                *word = if self.rng.chance(0.5) { word.saturating_add(1) } else { (*word - 1).max(1) };
            }
            *word
        };
        let data: Vec<u8> = match code {
            1 | 2 => {
                let mut data: Vec<u8> = (0..quantity.div_ceil(8)).map(|at| next(at) as u8).collect();
                mask_padding(&mut data, quantity);
                data
            }
            3 | 4 | 23 => (0..quantity).flat_map(|at| next(at).to_be_bytes()).collect(),
            // Of a vendor's function the answer is as free as the request: the value, and one more.
            65 => return [&request[..6], &next(0).to_be_bytes()].concat(),
            _ => return request[..6].to_vec(),
        };
        with_data(vec![unit, code], &data)
    }
}

/// Draws an entry of the poll list: unit, function, address and quantity.
fn poll(kind: &Kind, at: u16, rng: &mut Rng) -> [u16; 4] {
    let code = rng.pick(kind.reads);
    let quantity = rng.pick(if code > 2 { kind.registers } else { kind.bits });
    let [first, last] = kind.addresses.map(usize::from);
    [at % u16::from(kind.units) + 1, code.into(), rng.range(first, last) as u16, quantity]
}

/// Returns unit, function and these big-endian words.
fn head(unit: u8, code: u8, words: &[u16]) -> Vec<u8> {
    let words = words.iter().flat_map(|word| word.to_be_bytes());
    [unit, code].into_iter().chain(words).collect()
}

/// Appends a byte count and the data.
fn with_data(mut head: Vec<u8>, data: &[u8]) -> Vec<u8> {
    head.push(data.len() as u8);
    head.extend_from_slice(data);
    head
}
