//! Read requests, and the addresses and quantities that requests of all kinds draw.

use crate::rng::Rng;
use crate::sim::slave::Slave;

/// The most registers that fit into a response with four bytes per register.
const MAX_ENRON_REGISTERS: u16 = 62;

/// The PDU of a read request for coils or registers. Slaves that violate the specification may be asked for more than the
/// limit.
pub(crate) fn read(function: u8, slave: &Slave, rng: &mut Rng) -> Vec<u8> {
    let exceeds_limit = slave.quirk && rng.chance(0.1);
    let quantity = match (function, exceeds_limit) {
        (1 | 2, true) => 2001,
        (1 | 2, false) => bits(2000, rng),
        (_, true) => rng.pick(&[126, 127]),
        (_, false) => registers(if slave.enron { MAX_ENRON_REGISTERS } else { 125 }, rng),
    };
    body(function, &[address(rng), quantity])
}

/// A random address: often 0 or a low one, sometimes any.
pub(crate) fn address(rng: &mut Rng) -> u16 {
    let (low, high) = rng.pick(&[(0, 0), (0, 200), (0, 5000), (0x1000, 0xF000)]);
    rng.range(low, high) as u16
}

/// A random quantity of coils or inputs, at most `most`.
pub(crate) fn bits(most: u16, rng: &mut Rng) -> u16 {
    let (low, high) = rng.pick(&[(1, 1), (8, 8), (16, 16), (24, 24), (1, 200), (1, 2000)]);
    rng.range(low, high.min(usize::from(most))) as u16
}

/// A random quantity of registers, at most `most`.
pub(crate) fn registers(most: u16, rng: &mut Rng) -> u16 {
    let (low, high) = rng.pick(&[(1, 1), (2, 2), (2, 2), (4, 4), (10, 10), (1, 40), (1, 125)]);
    rng.range(low, high.min(usize::from(most))) as u16
}

/// A function code followed by big-endian words.
pub(crate) fn body(code: u8, words: &[u16]) -> Vec<u8> {
    let mut pdu = vec![code];
    pdu.extend(words.iter().flat_map(|word| word.to_be_bytes()));
    pdu
}
